// SPDX-License-Identifier: Apache-2.0
// Rays that leave a surface: where they start, so that they do not hit it again. hit.cpp computes the points
// and `error`, a bound of the distance along the normal between a point and the surface as Embree computes
// it.
//
// The origin is offset along the geometric normal by that error, times a margin, to the side of the new
// direction d. From there a ray cannot hit the same plane or convex surface again, at any angle. Three cases
// need more: a grazing ray from a triangle with vertex normals (the patch offset), a ray through a round
// fibre, and a ray from a camera-facing ribbon.
//
//   The ray grazes a triangle with vertex normals, which stand for a smooth surface (choose_sidedness_normal in
//   hit.cpp). The sign of sidedness_normal . d is its side, for the offset by the error, too. The ray starts on a curved
//   patch: the position is moved by the patch offset (m)
//     - sum of c_k h_k n_k,   h_k = (position - v_k) . n_k,
//   with the barycentric coordinates c_k of the vertices v_k and their normals n_k. The sum is over the
//   vertices with h_k < 0 if the ray is on the side of sidedness_normal, else over the others: those whose tangent
//   planes are on the ray's side of the position. hit.cpp computes both sums (SurfacePoint::patch_offset).
//   Rays at the triangle's plane or below it start there, rays at a sine of 0.1 to it or more on the triangle,
//   and others in between. Only in hollows, where the sum is 0, a ray above the smooth surface and below the
//   triangle's plane hits the triangle.
//
// For the other two, let T be the tangent, w = position - axis, a = |d - (T.d) T|^2 = sin^2 of the angle
// between ray and fibre, b = -w.d.
//
//   The ray passes through a round fibre (b > 0), a cone of slope r' = dr / dlength. It is e behind it where
//     |w + s d_perp| = r + e + g s, g = r' (T.d):
//     s = (B + sqrt(B^2 + A (2 r e + e^2))) / A,   A = a - g^2,   B = b + g (r + e).
//   Over the length x = s |T.d| along the axis the fibre bends away by k x^2 / 2 (curvature k). So e starts
//   as the error and is increased by that in three iterations, to at most r: if the fibre has bent away by
//   its own radius, a hit there is correct. s becomes tnear; the origin stays.
//
//   The ray leaves a camera-facing ribbon. The ribbon turns towards the new ray, and the point, off the axis
//   by |w| <= r, is hit again where the ray passes the axis: of the points C + x T, the ray from C + w meets
//   (in projection along d) the one with x a = -(T.d)(w.d), at depth t = x (T.d) - w.d = -(w.d) / a <= r/sin.
//   tnear is that, with the same allowance for the bend, plus the error over sin. For w.d > 0 it lies behind.
//   With straight pieces or quadrilaterals of length p, the tangent at the hit differs from the piece's by up
//   to k p / 2, and beyond the next corner the pieces turn further: the bend is at most k x (x + p) / 2. The
//   ends of quadrilaterals are cut across the cubic's tangents, which turns them by as much: there x is at
//   least r/sin.
//   Straight pieces also have a disc of radius r at each corner, which faces the ray, too. A ray that passes
//   the axis at the distance m, m^2 = |w|^2 - (w.d)^2 / a, hits it at t' = t + (x' - x)(T.d) if the corner's
//   |x' - x| <= sqrt((r^2 - m^2) / a). tnear is that of the last such corner.
#include "core/trace/hit.h"
#include "core/trace/ray_precision.h"

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

constexpr double margin = 2.0; // measured: tests/unit/render/test_spawn.cpp prints the rates
// The start of a ray blends from the smooth surface (sine of its angle to the triangle's plane <= 0) to the
// triangle (this and more): only grazing light shows the triangles, and a start on the smooth surface may be
// beyond what shadows it.
constexpr double grazing_sine = 0.1;

// Additional distance to the last disc, at a corner of a ribbon's straight pieces, that the ray hits. Names
// as in exit_distance.
double corner_distance(const SurfacePoint& point, double along, double a, double b) {
    const double w2 = point.from_axis.cast<double>().squaredNorm(), least = std::max(0.0, w2 - b * b / a);
    const double passed = b * along / a, k = std::abs(point.taper);
    const double r = point.radius + k * std::abs(passed) + margin * point.error;
    // a reach^2 + m^2 = (r + k reach)^2: the radius may grow along the ray.
    const double cone = std::max(a - k * k, min_sine * min_sine);
    const double reach = (r * k + std::sqrt(r * r * k * k + cone * std::max(0.0, r * r - least))) / cone;
    // Positions along the fibre, from the hit in the direction of the ray. Finds the farthest corner within
    // reach. The corners of this piece are known; others are assumed to be as far apart.
    const bool onwards = along > 0.0;
    const double next = onwards ? point.to_end : point.to_begin,
                 previous = -static_cast<double>(onwards ? point.to_begin : point.to_end);
    const double from = onwards ? passed : -passed, far = from + reach, piece = point.piece;
    const double corner = far >= next       ? next + piece * std::floor((far - next) / piece)
                          : far >= previous ? previous
                                            : previous - piece * std::ceil((previous - far) / piece);
    return corner >= from - reach ? std::max(0.0, (corner - from) * std::abs(along)) : 0.0;
}

// Distance along d at which the ray has left the fibre (head of this file).
double exit_distance(const SurfacePoint& point, const Vec3d& d, double error) {
    const Vec3d tangent = point.tangent.cast<double>();
    const double along = tangent.dot(d), b = -point.from_axis.cast<double>().dot(d), r = point.radius;
    const double a = std::max((d - along * tangent).squaredNorm(), min_sine * min_sine);
    const double g = point.taper * along, cone = std::max(a - g * g, min_sine * min_sine);
    const double passes = std::max(0.0, b / a), over_sine = 1.0 / std::sqrt(a);
    const auto distance = [&](double e) {
        if (point.shape == PointShape::ribbon) return passes + e * over_sine;
        const double turned = b + g * (r + e);
        return (turned + std::sqrt(turned * turned + cone * (2.0 * r * e + e * e))) / cone;
    };
    double s = distance(error);
    // The ends of a quadrilateral are cut across the tangents there, not at this point: even for x = 0 the
    // bend over its width counts.
    const bool drawn = point.shape == PointShape::ribbon && !point.joints;
    const double least = drawn ? r * over_sine : 0.0;
    for (int i = 0; i < 3; ++i) {
        const double x = std::max(std::abs(s * along), least);
        s = distance(error + std::min(0.5 * point.curvature * x * (x + point.piece), r));
    }
    if (point.joints && point.piece > 0.0F) s += corner_distance(point, along, a, b);
    return std::min(s, 1e12); // bend tighter than the radius: the ray is lost, but stays finite
}

} // namespace

Ray spawn(const SurfacePoint& point, const Vec3f& direction, float time) {
    Ray ray;
    ray.direction = direction;
    ray.time = time;
    const Vec3d d = direction.cast<double>(), n = point.geometric_normal.cast<double>();
    const double error = margin * point.error, outward = n.dot(d);
    const bool through =
        point.shape == PointShape::ribbon || (point.shape == PointShape::round && outward < 0.0);
    if (through) {
        ray.origin = point.position.cast<float>();
        ray.tnear = static_cast<float>(exit_distance(point, d, error));
    } else if (point.shape == PointShape::triangle) {
        const double side = std::copysign(1.0, static_cast<double>(point.sidedness_normal.dot(direction)));
        // A ray well above the triangle's plane needs no patch, which may lie beyond what shadows the
        // triangle.
        const double patch_weight = std::clamp(1.0 - side * outward / grazing_sine, 0.0, 1.0);
        const Vec3d to_start = patch_weight * point.patch_offset[side < 0.0 ? 1 : 0].cast<double>();
        ray.origin = (point.position + to_start + side * error * n).cast<float>();
    } else {
        ray.origin = (point.position + std::copysign(error, outward) * n).cast<float>();
    }
    return ray;
}

Ray spawn_towards(const SurfacePoint& point, const Vec3d& target, double target_error, float time) {
    Ray ray = spawn(point, (target - point.position).normalized().cast<float>(), time);
    const Vec3d way = target - ray.origin.cast<double>();
    const double distance = way.norm();
    constexpr double rounding = 4.0 * float_step; // relative error of t
    ray.direction = (way / distance).cast<float>();
    ray.tfar = static_cast<float>(std::max(0.0, distance * (1.0 - rounding) - target_error));
    return ray;
}

} // namespace marram
