// SPDX-License-Identifier: Apache-2.0
// Traces rays; computes points at hits, and attributes at them. spawn.cpp computes the rays that leave them.
//
// Embree returns t with an error that grows with the distance. Positions are therefore recomputed in double
// from the hit's primitive coordinates: barycentrics, or the parameter u of the curve C(u) of radius r(u), at
// the ray's time (vertices are linear between the time steps, as in Embree). What remains is the difference
// between this point and the surface that Embree's float arithmetic sees; `error` bounds it along the normal.
// With U = 2^-23, c the largest coordinate and l the extent of the primitive:
//
//   triangle  c U (the origin is rounded to float, vertices are interpolated in float) + l U q. Embree
//             decides t > 0 by the sign of (v0 - o) . (e1 x e2), with rounding error U l |e1| |e2|.
//             Divided by |e1 x e2| that is a distance, hence q = |e1| |e2| / |e1 x e2|, large for slivers.
//   curves    c U + 64 l U: Newton's iteration in Embree stops at residuals of a few times 16 U l.
//   round     plus 4 l r U / 1 m: Embree's error estimate adds lengths to products of lengths, which matters
//             in huge scenes.
//   pieces    round: plus 2 c U: each corner is rounded to float separately, so straight strands bend a bit.
//   ribbons   Embree draws a segment as 4 quadrilaterals. Points lie on these, not on C(u). C(u) is up to
//             |C''| (1/4)^2 / 8 off, always on the same side of the bend, so paths of many bounces would
//             drift that way: a million ribbons without absorption on a black ball reflected 2 % more.
//
// Embree's assertions abort on rays that are not finite or whose tnear or time is out of range: valid() is
// called before every trace.
#include "core/trace/hit.h"

#include "core/geometry/cubic.h"
#include "core/geometry/time_step.h"
#include "core/plugin/embree.h"
#include "core/trace/curve_pieces.h"
#include "core/trace/ray_precision.h"
#include "core/trace/round_pieces.h"

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

constexpr double curve_residual =
    64.0; // Newton's tolerance in Embree is 16, and it may stop on both sides of a surface
constexpr double huge_residual = 4.0;  // 1/m
constexpr double piece_residual = 2.0; // each corner is rounded to float separately
constexpr uint32_t ribbon_pieces = 4;  // Embree's default tessellation rate

double greatest(const Vec3d& v) { return v.cwiseAbs().maxCoeff(); }

// The vertices of a segment, `Size` floats each, between two motion keys.
template <int Size>
using Control = Eigen::Matrix<double, Size, 4>;

template <int Size>
Control<Size> control_of(const std::vector<const float*>& vertices, size_t first_vertex,
                         const KeyPair& keys) {
    using Points = Eigen::Map<const Eigen::Matrix<float, Size, 4>>;
    Control<Size> control = Points(vertices[keys.before] + Size * first_vertex).template cast<double>();
    if (keys.within > 0.0)
        control += keys.within *
                   (Points(vertices[keys.after] + Size * first_vertex).template cast<double>() - control);
    return control;
}

template <int Size>
Eigen::Matrix<double, Size, 1> weigh(const Control<Size>& control, const std::array<double, 4>& weights) {
    return weights[0] * control.col(0) + weights[1] * control.col(1) + weights[2] * control.col(2) +
           weights[3] * control.col(3);
}

struct CurvePoint { // of a segment
    Vec4d value, first, second;
    Vec3d axis() const { return value.head<3>(); }
};

CurvePoint curve_at(const Control<4>& control, const CubicBasis& basis) {
    return {weigh<4>(control, basis.value), weigh<4>(control, basis.first), weigh<4>(control, basis.second)};
}

// Embree's oriented ribbon is C(u) + v D(u), v = -1 ... 1: D the cubic with the value and derivative of
// r N x C' / |N x C'| at both ends of the segment.
struct HalfWidth {
    Vec3d value, first;
};

HalfWidth half_width_at_end(const Control<4>& control, const Control<3>& normals, MarramBasis kind,
                            double u) {
    const CubicBasis basis = cubic_basis(kind, u);
    const CurvePoint c = curve_at(control, basis);
    const Vec3d n = weigh<3>(normals, basis.value), dn = weigh<3>(normals, basis.first);
    const Vec3d dc = c.first.head<3>(), ddc = c.second.head<3>();
    const Vec3d b = n.cross(dc), db = dn.cross(dc) + n.cross(ddc);
    const double length = b.norm();
    const Vec3d k = b / length, dk = (db - k * k.dot(db)) / length;
    return {c.value[3] * k, c.first[3] * k + c.value[3] * dk};
}

HalfWidth half_width_at(const Control<4>& control, const Control<3>& normals, MarramBasis kind, double u) {
    const HalfWidth a = half_width_at_end(control, normals, kind, 0.0),
                    b = half_width_at_end(control, normals, kind, 1.0);
    const double u2 = u * u, u3 = u2 * u;
    return {(2.0 * u3 - 3.0 * u2 + 1.0) * a.value + (u3 - 2.0 * u2 + u) * a.first +
                (3.0 * u2 - 2.0 * u3) * b.value + (u3 - u2) * b.first,
            (6.0 * u2 - 6.0 * u) * (a.value - b.value) + (3.0 * u2 - 4.0 * u + 1.0) * a.first +
                (3.0 * u2 - 2.0 * u) * b.first};
}

void set_triangle(const MeshGeometry& mesh, uint32_t triangle, const Vec2f& barycentrics, float time,
                  SurfacePoint& point) {
    const auto& corner = mesh.triangles[triangle];
    const Vec3d a = mesh_vertex(mesh, corner[0], time), b = mesh_vertex(mesh, corner[1], time),
                c = mesh_vertex(mesh, corner[2], time);
    const float u = barycentrics.x(), v = barycentrics.y(), w = 1.0F - u - v;
    const Vec3d ab = b - a, ac = c - a, cross = ab.cross(ac);
    const double area = cross.norm(), edges = ab.norm() * ac.norm();
    point.shape = PointShape::triangle;
    point.position = a + static_cast<double>(u) * ab + static_cast<double>(v) * ac;
    point.geometric_normal = (cross / area).cast<float>();
    point.normal = point.geometric_normal;
    point.tangent = ab.normalized().cast<float>();
    point.area = static_cast<float>(0.5 * area);
    const double extent = std::max(greatest(ab), greatest(ac));
    point.error = float_step * (std::max({greatest(a), greatest(b), greatest(c)}) + extent * (edges / area));
    point.uv = mesh.uvs.empty()
                   ? barycentrics
                   : Vec2f(w * mesh.uvs[corner[0]] + u * mesh.uvs[corner[1]] + v * mesh.uvs[corner[2]]);
    point.patch_offset = {Vec3f::Zero(), Vec3f::Zero()};
    if (!mesh.normals.empty()) {
        const Step step = step_of(mesh.normals.size(), time);
        const auto normal_of = [&](size_t k) -> Vec3f {
            const Vec3f& n = mesh.normals[step.first][corner[k]];
            if (!(step.within > 0.0)) return n;
            const Vec3f between =
                n + static_cast<float>(step.within) * (mesh.normals[step.first + 1][corner[k]] - n);
            const float length = between.norm();
            return length > 0.0F ? Vec3f(between / length) : n;
        };
        const std::array<Vec3f, 3> normals = {normal_of(0), normal_of(1), normal_of(2)};
        const Vec3f n = w * normals[0] + u * normals[1] + v * normals[2];
        const float length = n.norm();
        if (length > 0.0F) point.normal = n / length;
        const float side = point.normal.dot(point.geometric_normal) < 0.0F ? -1.0F : 1.0F; // see hit.h
        point.normal *= side;
        const std::array<float, 3> weight = {w, u, v};
        const std::array<const Vec3d*, 3> vertex = {&a, &b, &c};
        for (size_t k = 0; k < 3; ++k) {
            const Vec3f normal = side * normals[k];
            const float height = (point.position - *vertex[k]).cast<float>().dot(normal);
            point.patch_offset[height < 0.0F ? 0 : 1] -= weight[k] * height * normal;
        }
    }
    point.sidedness_normal = point.geometric_normal;
    point.strand_u = point.h = point.radius = 0.0F;
    point.barycentrics = barycentrics;
    point.material = mesh.material;
    point.light = mesh.light;
}

// Shading with vertex normals lights parts of a triangle that its own plane, or a neighbour's, keeps from the
// light: the border of the shadow would show the triangles. So shading and rays that leave treat the surface
// as the smooth one: the sign of normal . d says on which side a direction d is, and a ray near the plane or
// below it starts on a curved patch (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021). Not
// at silhouettes, where the smooth surface faces away from the ray.
void choose_sidedness_normal(const Vec3f& direction, SurfacePoint& point) {
    const float cos_plane = point.geometric_normal.dot(direction), cos_smooth = point.normal.dot(direction);
    if ((cos_plane < 0.0F) == (cos_smooth < 0.0F) && point.geometric_normal.dot(point.normal) > 0.0F)
        point.sidedness_normal = point.normal;
    else
        point.patch_offset = {Vec3f::Zero(), Vec3f::Zero()};
}

// Some direction across the fibre, for a ray along it.
Vec3d any_across(const Vec3d& tangent) {
    Vec3d a, b;
    orthonormal_basis(tangent, a, b);
    return a;
}

void set_round(const Vec3d& seen, const CurvePoint& c, const Vec3d& tangent, double slope, double extent,
               SurfacePoint& point) {
    Vec3d out = seen - c.axis();
    out -= out.dot(tangent) * tangent;
    const double length = out.norm();
    out = length > 0.0 ? Vec3d(out / length) : any_across(tangent);
    point.shape = PointShape::round;
    point.error += float_step * huge_residual * extent * c.value[3];
    point.from_axis = (c.value[3] * out).cast<float>();
    point.position = c.axis() + c.value[3] * out;
    point.geometric_normal = (out - slope * tangent).normalized().cast<float>();
    point.normal = point.geometric_normal;
}

// Perpendicular to the tangent and to a ray.
Vec3d across_ray(const Vec3d& tangent, const Vec3d& direction) {
    const Vec3d across = -tangent.cross(direction);
    const double sine = across.norm();
    return sine > min_sine * min_sine ? Vec3d(across / sine) : any_across(tangent);
}

// The normal of a flat ribbon is the direction to the ray's origin, made perpendicular to the tangent. The
// offset across the ribbon is computed from the ray. Embree's v does not give it: v refers to the two
// triangles of a quadrilateral and is not a fraction of the width if the width varies.
void set_ribbon(const Vec3d& seen, const Vec3d& side, const CurvePoint& c, const Vec3d& tangent,
                SurfacePoint& point) { // c.value: on the quadrilateral
    const double radius = c.value[3];
    const Vec3d w = std::clamp((seen - c.axis()).dot(side), -radius, radius) * side;
    point.shape = PointShape::ribbon;
    point.from_axis = w.cast<float>();
    point.position = c.axis() + w;
    point.geometric_normal = side.cross(tangent).cast<float>();
    point.normal = point.geometric_normal;
}

void set_oriented(const Vec3d& seen, const Vec3d& facing, const Control<4>& control,
                  const Control<3>& normals, const CurveGeometry& curves, double u, const CurvePoint& c,
                  SurfacePoint& point) {
    const HalfWidth across = half_width_at(control, normals, curves.basis, u);
    const double width2 = across.value.squaredNorm();
    const double v = width2 > 0.0 ? std::clamp((seen - c.axis()).dot(across.value) / width2, -1.0, 1.0) : 0.0;
    const Vec3d w = v * across.value;
    // At an end where the width is 0: the direction in which the ribbon opens.
    const Vec3d over = width2 > 0.0 ? across.value : u < 0.5 ? across.first : Vec3d(-across.first);
    Vec3d normal = (c.first.head<3>() + v * across.first).cross(over).normalized();
    point.shape = PointShape::oriented_ribbon;
    if (!w.allFinite() || !normal.allFinite() ||
        normal.isZero()) { // given normals are along the strand: use Embree's, if there is one
        normal = point.normal.isZero() || !point.normal.allFinite() ? facing : point.normal.cast<double>();
        point.from_axis = (seen - c.axis()).cast<float>();
        point.position = seen;
    } else {
        point.from_axis = w.cast<float>();
        point.position = c.axis() + w;
    }
    point.geometric_normal = normal.cast<float>();
    point.normal = point.geometric_normal;
}

// A point on a straight piece, and the chord of the whole piece. along, begin, end: fractions of the chord,
// at the hit and at the ends of the traced part.
struct PiecePoint {
    Vec4d value = Vec4d::Zero();
    Vec3d chord = Vec3d::Zero();
    double along = 0.0, begin = 0.0, end = 1.0;
    double u = 0.0; // of the segment
};

// The point on one of the quadrilaterals of a ribbon's segment.
PiecePoint quadrilateral_at(const Control<4>& control, MarramBasis basis, double u) {
    const double piece = std::max(0.0, std::min(ribbon_pieces - 1.0, std::floor(u * ribbon_pieces)));
    const Chord whole = chord_of(control, basis, static_cast<uint32_t>(piece), ribbon_pieces);
    const Vec4d way = whole.end - whole.begin;
    const double along = u * ribbon_pieces - piece;
    return {.value = whole.begin + along * way, .chord = way.head<3>(), .along = along, .u = u};
}

// The point on a piece of a strand's segment; u: fraction of the traced part.
PiecePoint piece_at(const CurveGeometry& curves, const Control<4>& control, size_t first_vertex,
                    uint32_t segment, uint32_t piece, double u) {
    const auto chord = [&](const Control<4>& at) { return chord_of(at, curves.basis, piece, curves.pieces); };
    const bool root = segment == 0 && piece == 0,
               tip = segment + 2 == curves.cvs_per_curve && piece + 1 == curves.pieces;
    const Chord whole = chord(control);
    const Vec4d way = whole.end - whole.begin;
    double begin = 0.0, end = 1.0;
    if (root || tip) {
        const Chord first = chord(control_of<4>(curves.vertices, first_vertex, KeyPair{0, 0, 0.0}));
        if (root) begin = end_share(first, false);
        if (tip) end = 1.0 - end_share(first, true);
    }
    const double along = begin + u * (end - begin);
    return {whole.begin + along * way, way.head<3>(), along, begin, end, (piece + along) / curves.pieces};
}

// A flat piece faces each ray, as the ribbon does.
void set_ribbon_piece(const Vec3d& seen, const Vec3d& direction, const PiecePoint& piece,
                      const Vec3d& tangent, SurfacePoint& point) {
    const double length = point.piece, radius = std::abs(piece.value[3]); // splines may undershoot 0
    const Vec3d along = length > 0.0 ? Vec3d(piece.chord / length) : tangent;
    const Vec3d across = across_ray(along, direction), axis = piece.value.head<3>();
    const Vec3d w = std::clamp((seen - axis).dot(across), -radius, radius) * across;
    point.shape = PointShape::ribbon;
    point.from_axis = w.cast<float>();
    point.position = axis + w;
    point.geometric_normal = across.cross(along).cast<float>();
    point.normal = point.geometric_normal;
}

// A round piece is a cone with a ball at each end, and is shaded as such. With the curve's own normals, 1 %
// of the light would be lost, in directions that are on different sides of the curve and of the piece.
// Segments whose bends at the corners would be visible have more pieces.
void set_round_piece(const Vec3d& seen, const PiecePoint& piece, const Vec3d& tangent, float along,
                     SurfacePoint& point) {
    const double length = point.piece, radius = std::abs(piece.value[3]);
    const Vec3d chord = length > 0.0 ? Vec3d(piece.chord / length) : tangent, axis = piece.value.head<3>();
    Vec3d out = seen - axis;
    const double distance = out.norm();
    out = distance > 0.0 ? Vec3d(out / distance) : any_across(tangent);
    const bool cone = along > 0.0F && along < 1.0F && length > 0.0;
    const double slope = point.taper;
    point.shape = PointShape::round;
    point.error += piece_residual * float_step * greatest(axis);
    point.from_axis = (radius * out).cast<float>();
    point.position = axis + radius * out;
    point.geometric_normal = (cone ? Vec3d((out - slope * chord).normalized()) : out).cast<float>();
    point.normal = point.geometric_normal;
}

void set_curve(const CurveGeometry& curves, const CurvePrimitive& traced, const RTCRay& ray, float u_of_hit,
               double t, SurfacePoint& point) {
    const uint32_t primitive = traced.primitive;
    const uint32_t pieces = std::max(curves.pieces, 1U), piece = primitive % pieces;
    const CurveLayout layout = curves.layout();
    uint32_t segments = curves.cvs_per_curve - 1, segment = 0;
    if (layout.offsets) {
        point.strand = curves.curve_of_segment[primitive];
        segments = layout.cvs(point.strand) - 1;
        segment = primitive - uint32_t(layout.first_segment(point.strand));
    } else {
        segment = primitive / pieces % segments;
        point.strand = primitive / pieces / segments;
    }
    const size_t first = layout.first_vertex(point.strand) + segment;
    const KeyPair keys = keys_around(curves.vertices.size(), ray.time, traced.end_keys_only);
    const Control<4> control = control_of<4>(curves.vertices, first, keys);
    const float hit_u = std::clamp(u_of_hit, 0.0F, 1.0F); // seen end-on, Embree's may be outside
    PiecePoint straight;
    if (curves.pieces > 0)
        straight = piece_at(curves, control, first, segment, piece, hit_u);
    else if (curves.shape == MARRAM_RIBBON)
        straight = quadrilateral_at(control, curves.basis, hit_u);
    const bool cubic = curves.pieces == 0 && curves.shape != MARRAM_RIBBON;
    const double u = cubic ? static_cast<double>(hit_u) : straight.u;
    CurvePoint c = curve_at(control, cubic_basis(curves.basis, u));
    if (!cubic) c.value = straight.value;
    if (c.value[3] < 0.0) { // splines may undershoot 0: use the absolute width
        c.value[3] = -c.value[3];
        c.first[3] = -c.first[3];
    }
    const Vec3d dc = c.first.head<3>();
    const double speed = dc.norm();
    const Vec3d direction(ray.dir_x, ray.dir_y, ray.dir_z);
    const Vec3d seen = Vec3d(ray.org_x, ray.org_y, ray.org_z) + t * direction;
    const Vec3d tangent = speed > 0.0 ? Vec3d(dc / speed) : any_across(direction);
    const Vec3d side = across_ray(tangent, direction);

    const Vec4d lower = control.rowwise().minCoeff(), upper = control.rowwise().maxCoeff();
    const double extent = (upper - lower).head<3>().maxCoeff();
    point.error = float_step * (std::max(upper.head<3>().maxCoeff(), -lower.head<3>().minCoeff()) +
                                curve_residual * (extent + c.value[3]));
    point.tangent = tangent.cast<float>();
    const double slope = speed > 0.0 ? c.first[3] / speed : 0.0;
    point.taper = static_cast<float>(slope);
    point.curvature =
        speed > 0.0 ? static_cast<float>(tangent.cross(c.second.head<3>()).cwiseAbs().sum() / (speed * speed))
                    : 0.0F;
    point.radius = static_cast<float>(c.value[3]);
    const double length = straight.chord.norm();
    point.piece = static_cast<float>(length);
    point.joints = curves.pieces > 0;
    point.to_begin = static_cast<float>(length * (straight.along - straight.begin));
    point.to_end = static_cast<float>(length * (straight.end - straight.along));
    if (curves.shape == MARRAM_ROUND && curves.pieces > 0)
        set_round_piece(seen, straight, tangent, hit_u, point);
    else if (curves.shape == MARRAM_ROUND)
        set_round(seen, c, tangent, slope, extent, point);
    else if (curves.pieces > 0)
        set_ribbon_piece(seen, direction, straight, tangent, point);
    else if (curves.shape == MARRAM_RIBBON)
        set_ribbon(seen, side, c, tangent, point);
    else
        set_oriented(seen, side.cross(tangent), control, control_of<3>(curves.normals, first, keys), curves,
                     u, c, point);
    const double h = c.value[3] > 0.0 ? point.from_axis.cast<double>().dot(side) / c.value[3] : 0.0;
    point.h = static_cast<float>(std::clamp(h, -1.0, 1.0));
    point.segment_position = static_cast<float>(segment + u);
    point.strand_u = std::min(point.segment_position / static_cast<float>(segments), 1.0F);
    point.uv = {point.strand_u, 0.5F * (1.0F + point.h)};
    point.area = 0.0F;
    point.material = curves.material;
    point.light = -1;
}

} // namespace

Vec3d mesh_vertex(const MeshGeometry& mesh, uint32_t vertex, float time) {
    const Step step = step_of(mesh.positions.size(), time);
    const Vec3d at = mesh.positions[step.first][vertex].cast<double>();
    if (step.within == 0.0) return at;
    return at + step.within * (mesh.positions[step.first + 1][vertex].cast<double>() - at);
}

SurfacePoint mesh_point(const World& world, uint32_t mesh, uint32_t triangle, const Vec2f& barycentrics,
                        float time) {
    SurfacePoint point;
    point.geometry = mesh;
    point.primitive = triangle;
    set_triangle(world.meshes[mesh], triangle, barycentrics, time, point);
    point.patch_offset = {Vec3f::Zero(), Vec3f::Zero()}; // no ray says on which side it is seen
    return point;
}

bool valid(const Ray& ray) {
    constexpr auto limit = float(embree_limit); // NaN fails every comparison
    return ray.origin.cwiseAbs().maxCoeff() <= limit && ray.origin.allFinite() && ray.direction.allFinite() &&
           ray.direction.cwiseAbs().maxCoeff() > 0.0F && ray.tnear >= 0.0F && ray.tnear <= limit &&
           ray.tfar >= 0.0F && ray.time >= 0.0F && ray.time <= 1.0F;
}

namespace {

RTCRay to_embree(const Ray& ray) {
    return {ray.origin.x(),
            ray.origin.y(),
            ray.origin.z(),
            ray.tnear,
            ray.direction.x(),
            ray.direction.y(),
            ray.direction.z(),
            ray.time,
            ray.tfar,
            ray.mask,
            0,
            0};
}

} // namespace

bool intersect(const World& world, const Ray& ray, SurfacePoint& point, bool coherent, RayCounts* counts) {
    if (!valid(ray)) {
        if (counts) ++counts->invalid;
        return false;
    }
    if (counts) ++counts->intersect;
    if (!(ray.tnear < ray.tfar)) return false;
    RTCRayHit query;
    query.ray = to_embree(ray);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    double t = 0.0;
    if (world.filtered) {
        intersect_round(world, query, coherent, t);
    } else {
        marram_intersect1(world.scene.get(), &query, coherent ? 1 : 0);
        t = query.ray.tfar;
    }
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return false;
    point.geometry = query.hit.geomID;
    point.primitive = query.hit.primID;
    point.distance = query.ray.tfar;
    if (query.hit.geomID < world.meshes.size()) {
        set_triangle(world.meshes[query.hit.geomID], query.hit.primID, {query.hit.u, query.hit.v}, ray.time,
                     point);
        choose_sidedness_normal(ray.direction, point);
    } else {
        point.normal = Vec3f(query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z).normalized();
        const CurvePrimitive traced = curve_primitive(world, query.hit.geomID, query.hit.primID);
        point.geometry = uint32_t(world.meshes.size()) + traced.curves;
        point.primitive = traced.primitive;
        set_curve(world.curves[traced.curves], traced, query.ray, query.hit.u, t, point);
    }
    return true;
}

bool occluded(const World& world, const Ray& ray, RayCounts* counts) {
    if (!valid(ray)) {
        if (counts) ++counts->invalid;
        return false;
    }
    if (!(ray.tnear < ray.tfar)) return false;
    if (counts) ++counts->occluded;
    RTCRay query = to_embree(ray);
    if (world.filtered)
        occluded_round(world, query);
    else
        marram_occluded1(world.scene.get(), &query);
    return query.tfar < 0.0F;
}

void attribute_at(const CurveGeometry& curves, const AttributeValues& attribute, const SurfacePoint& point,
                  float* values) {
    const size_t components = attribute.components;
    if (attribute.rate == MARRAM_PER_CURVE) {
        std::copy_n(attribute.data() + point.strand * components, components, values);
        return;
    }
    const CurveLayout layout = curves.layout();
    const uint32_t first =
        std::min(static_cast<uint32_t>(point.segment_position), layout.cvs(point.strand) - 2);
    const float within = point.segment_position - static_cast<float>(first);
    const float* a = attribute.data() + (layout.first_cv(point.strand) + first) * components;
    if (attribute.discrete) {
        std::copy_n(within < 0.5F ? a : a + components, components, values);
        return;
    }
    for (size_t i = 0; i < components; ++i) values[i] = a[i] + within * (a[i + components] - a[i]);
}

void attribute_at(const MeshGeometry& mesh, const AttributeValues& attribute, const SurfacePoint& point,
                  float* values) {
    const size_t components = attribute.components;
    if (attribute.rate == MARRAM_PER_FACE) {
        std::copy_n(attribute.data() + point.primitive * components, components, values);
        return;
    }
    const std::array<uint32_t, 3>& corners = mesh.triangles[point.primitive];
    const float u = point.barycentrics.x(), v = point.barycentrics.y(), w = 1.0F - u - v;
    const auto corner = [&](size_t k) { return attribute.data() + size_t(corners[k]) * components; };
    if (attribute.discrete) {
        std::copy_n(corner(w >= u && w >= v ? 0 : u >= v ? 1 : 2), components, values);
        return;
    }
    for (size_t i = 0; i < components; ++i)
        values[i] = w * corner(0)[i] + u * corner(1)[i] + v * corner(2)[i];
}

} // namespace marram
