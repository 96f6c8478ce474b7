// SPDX-License-Identifier: Apache-2.0
#include "core/trace/round_pieces.h"

#include "core/geometry/time_step.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

// Intersects the ball at a corner, and keeps the nearer entry.
void enter_ball(const Vec4d& corner, double along, const Vec3d& origin, const Vec3d& direction, double tnear,
                Entry& entry) {
    const Vec3d from = origin - corner.head<3>();
    const double b = from.dot(direction), c = (from - b * direction).squaredNorm(),
                 root2 = corner[3] * corner[3] - c;
    if (!(root2 > 0.0)) return;
    const double t = -b - std::sqrt(root2);
    if (t >= tnear && t < entry.t) entry = {t, along};
}

} // namespace

bool enter(const RoundPiece& piece, const Vec3d& origin, const Vec3d& direction, double tnear, Entry& entry) {
    const Vec3d axis = (piece.end - piece.begin).head<3>();
    const double length2 = axis.squaredNorm();
    entry.t = std::numeric_limits<double>::infinity();
    if (length2 > 0.0) {
        // Across the axis |w + t d| = r + t g; the ray enters at the smaller root.
        const Vec3d from = origin - piece.begin.head<3>();
        const double inverse = 1.0 / length2, slope = piece.end[3] - piece.begin[3]; // for all of the piece
        const double d = direction.dot(axis) * inverse, w = from.dot(axis) * inverse;
        const Vec3d across = direction - d * axis, aside = from - w * axis;
        const double g = slope * d, r = piece.begin[3] + slope * w;
        const double a = across.squaredNorm() - g * g, b = aside.dot(across) - g * r,
                     c = aside.squaredNorm() - r * r, root2 = b * b - a * c;
        if (a > 0.0) {
            if (root2 < 0.0) return false; // the balls lie within the cone
            const double t = (-b - std::sqrt(root2)) / a, along = w + t * d;
            if (along >= 0.0 && along <= 1.0) {
                entry = {t, along};
                return t >= tnear;
            }
        }
    }
    enter_ball(piece.begin, 0.0, origin, direction, tnear, entry);
    enter_ball(piece.end, 1.0, origin, direction, tnear, entry);
    return entry.t < std::numeric_limits<double>::infinity();
}

namespace {

struct Query {
    const World* world;
    Vec3d origin, direction;
    double tnear, tfar; // the ray's own
    float time;
    double t;     // of the nearest hit
    uint64_t hit; // its number (Found)
    double reach; // of the pieces that are traced now
};

// A piece at a time, interpolated as in Embree, but in double.
RoundPiece piece_of(const CurveGeometry& curves, const CurvePrimitive& traced, float time) {
    const uint32_t per_curve = (curves.cvs_per_curve - 1) * curves.pieces;
    const size_t first = 4 * (traced.primitive + static_cast<size_t>(traced.primitive / per_curve));
    const KeyPair keys = keys_around(curves.round_pieces.size(), time, traced.end_keys_only);
    const auto corner = [&](size_t at) -> Vec4d {
        const auto key = [&](size_t step) { return Eigen::Map<const Vec4f>(curves.round_pieces[step] + at); };
        const Vec4d before = key(keys.before).cast<double>();
        if (keys.within == 0.0) return before;
        return before + keys.within * (key(keys.after).cast<double>() - before);
    };
    RoundPiece piece{corner(first), corner(first + 4)};
    piece.begin[3] = std::abs(piece.begin[3]); // see mark_round_pieces
    piece.end[3] = std::abs(piece.end[3]);
    return piece;
}

// What Embree has hit.
struct Found {
    CurvePrimitive traced{}; // of curves
    bool round_piece = false;
    uint64_t number = 0; // of all primitives of the world
};

Found found_by(const RTCFilterFunctionNArguments* args, const Query& query) {
    const World& world = *query.world;
    const RTCHit& hit = *reinterpret_cast<const RTCHit*>(args->hit);
    const auto* part = static_cast<const PatchPart*>(args->geometryUserPtr); // in the scene of a patch
    if (!part && hit.geomID < world.meshes.size()) return {.number = uint64_t(hit.geomID) << 32 | hit.primID};
    const CurvePrimitive traced =
        part ? curve_primitive(*part, hit.primID) : curve_primitive(world, hit.geomID, hit.primID);
    return {traced, !world.curves[traced.curves].round_pieces.empty(),
            (world.meshes.size() + traced.curves) << 32 | traced.primitive};
}

bool entered(const Query& query, const CurvePrimitive& traced, Entry& entry) {
    const RoundPiece piece = piece_of(query.world->curves[traced.curves], traced, query.time);
    return enter(piece, query.origin, query.direction, query.tnear, entry);
}

// An upper bound of t that includes the error of Embree's own t.
float beyond(double t) { return static_cast<float>(t * (1.0 + 0x1p-20)); }

void nearest(const RTCFilterFunctionNArguments* args) {
    Query& query = *static_cast<Query*>(marram_query_of(args));
    RTCRay& ray = *reinterpret_cast<RTCRay*>(args->ray);
    RTCHit& hit = *reinterpret_cast<RTCHit*>(args->hit);
    const Found found = found_by(args, query);
    Entry entry{ray.tfar, 0.0};
    const bool met = !found.round_piece || entered(query, found.traced, entry);
    // Neighbouring pieces share what is at their corner: whichever Embree finds first, the same one is hit.
    if (!met || entry.t > query.t || (entry.t == query.t && found.number >= query.hit)) {
        args->valid[0] = 0;
        return;
    }
    if (found.round_piece) hit.u = static_cast<float>(entry.along);
    query.hit = found.number;
    query.t = entry.t;
    ray.tfar = beyond(query.t + query.reach);
}

void any(const RTCFilterFunctionNArguments* args) {
    const Query& query = *static_cast<Query*>(marram_query_of(args));
    const RTCRay& ray = *reinterpret_cast<const RTCRay*>(args->ray);
    Entry entry;
    const Found found = found_by(args, query);
    const bool met = found.round_piece ? entered(query, found.traced, entry) && entry.t < query.tfar
                                       : static_cast<double>(ray.tfar) <= query.tfar;
    if (!met) args->valid[0] = 0;
}

double reach_of(const World& world) {
    return world.lazy ? std::max(world.reach, world.lazy->reach) : world.reach;
}

Query query_of(const World& world, RTCRay& ray) {
    const Query query{&world,
                      {ray.org_x, ray.org_y, ray.org_z},
                      {ray.dir_x, ray.dir_y, ray.dir_z},
                      ray.tnear,
                      ray.tfar,
                      ray.time,
                      ray.tfar,
                      0, // nothing at tfar itself is hit
                      reach_of(world)};
    ray.tfar = beyond(query.tfar + query.reach);
    return query;
}

} // namespace

double reach_of(const float* vertices, size_t curves, size_t pieces) {
    double reach = 0.0;
    for (size_t curve = 0; curve < curves; ++curve)
        for (size_t i = 0; i < pieces; ++i) {
            const float* v = vertices + 4 * (curve * (pieces + 1) + i);
            const double length = (Vec3f::Map(v + 4) - Vec3f::Map(v)).norm();
            reach = std::max(reach, length + std::max(std::abs(v[3]), std::abs(v[7])));
        }
    return reach;
}

void mark_round_vertices(float* vertices, size_t count) {
    for (size_t i = 0; i < count; ++i) vertices[4 * i + 3] = -std::abs(vertices[4 * i + 3]);
}

void add_round_pieces(World& world, CurveGeometry& curves, float* vertices) {
    const size_t pieces = (curves.cvs_per_curve - 1) * curves.pieces;
    const double reach = tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, curves.curve_count, 4096), 0.0,
        [=](const auto& range, double reach) {
            return std::max(reach,
                            reach_of(vertices + 4 * range.begin() * (pieces + 1), range.size(), pieces));
        },
        [](double a, double b) { return std::max(a, b); });
    world.reach = std::max(world.reach, reach);
    world.filtered = true;
    curves.round_pieces.push_back(vertices);
}

void mark_round_pieces(World& world) {
    for (CurveGeometry& curves : world.curves) {
        if (curves.lazy) continue;
        for (float* vertices : curves.round_pieces) {
            const size_t count = curves.curve_count * ((curves.cvs_per_curve - 1) * curves.pieces + 1);
            tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 65536), [=](const auto& range) {
                mark_round_vertices(vertices + 4 * range.begin(), range.size());
            });
        }
    }
}

void intersect_round(const World& world, RTCRayHit& hit, bool coherent, double& t) {
    Query query = query_of(world, hit.ray);
    marram_intersect1_filtered(world.scene.get(), &hit, coherent ? 1 : 0, nearest, &query);
    t = query.t;
    hit.ray.tfar = static_cast<float>(t);
}

void occluded_round(const World& world, RTCRay& ray) {
    Query query = query_of(world, ray);
    marram_occluded1_filtered(world.scene.get(), &ray, any, &query);
}

void intersect_patch(const RTCIntersectFunctionNArguments* args, RTCScene patch, double reach,
                     RTCRayHit& hit) {
    if (reach == 0.0) { // whatever is traced there is no round piece
        marram_nested_intersect1(args, patch, &hit);
        return;
    }
    Query& query = *static_cast<Query*>(marram_query_of(args));
    query.reach = reach;
    hit.ray.tfar = beyond(query.t + reach);
    marram_nested_intersect1(args, patch, &hit);
    query.reach = reach_of(*query.world);
    hit.ray.tfar = beyond(query.t + query.reach);
}

void occluded_patch(const RTCOccludedFunctionNArguments* args, RTCScene patch, double reach, RTCRay& ray) {
    if (reach == 0.0) {
        marram_nested_occluded1(args, patch, &ray);
        return;
    }
    const Query& query = *static_cast<const Query*>(marram_query_of(args));
    ray.tfar = beyond(query.tfar + reach);
    marram_nested_occluded1(args, patch, &ray);
    if (ray.tfar >= 0.0F) ray.tfar = beyond(query.tfar + query.reach);
}

} // namespace marram
