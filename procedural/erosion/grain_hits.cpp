// SPDX-License-Identifier: Apache-2.0
// Ray origins are offset from a surface by the error bound of the hit point: 2 U (c + l q), with U = 2^-23, c the largest
// coordinate, l the triangle's longest edge, q = |e1| |e2| / |e1 x e2|, as derived in core/trace/hit.cpp. q is that of the
// corner at which Embree begins, which differs between triangles and quads: here that of the two longest edges, the largest.
// What does not wear has no corners here. Its triangle has twice the area A = |Ng|, so the bound is estimated by
// 2 U (2 (c + d) + 4 sqrt(A)), d being the length of the ray.
//
// Limit: within rounding of the diagonal of a quad (2^-23) the normal can be that of its other triangle.
#include "procedural/erosion/grain_hits.h"

#include "procedural/erosion/grain_lanes.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr double offset_margin = 2.0;
constexpr double max_sliver = 1e4; // maximum q

struct alignas(64) Hits8 {
    Wide3f origin, direction, geometric_normal; // of the ray and its hit
    VFloat tfar;
    Wide3f corner[3]; // of the triangle, if it wears
    VLong wears;      // a mask
    VDouble u, v;
    EventKeys8 keys;
    // Found:
    Wide3d x, normal, arriving, rebound;
    VDouble sine;
};

const GrainMesh* worn_mesh(const GrainTracer& tracer, unsigned id) {
    const auto found =
        std::lower_bound(tracer.meshes.begin(), tracer.meshes.end(), id,
                         [](const GrainMesh& mesh, unsigned other) { return mesh.mesh.geometry < other; });
    return found != tracer.meshes.end() && found->mesh.geometry == id ? &*found : nullptr;
}

void set_lane(Wide3f& to, int lane, float x, float y, float z) {
    to.x[lane] = x, to.y[lane] = y, to.z[lane] = z;
}

// x and normal: of the triangle if it wears, else of Embree's hit.
MARRAM_INLINE void find_place(Hits8& h) {
    const Wide3d way = to_double(h.direction), p0 = to_double(h.corner[0]);
    const Wide3d e1 = to_double(h.corner[1]) - p0, e2 = to_double(h.corner[2]) - p0;
    const Wide3d across = select(h.wears, cross(e1, e2), to_double(h.geometric_normal));
    const VDouble area = length(across), l1 = length(e1), l2 = length(e2), l3 = length(e2 - e1);
    const VDouble longest = vmax(vmax(l1, l2), l3), shortest = vmin(vmin(l1, l2), l3), distance = length(way);
    const VLong has_area = area > 0.0;
    h.normal = select(has_area, across, way) * (1.0 / select(has_area, area, vmax(distance, 1e-300)));
    h.normal = h.normal * select(dot(h.normal, way) > 0.0, -1.0, 1.0);
    const Wide3d point =
        select(h.wears, p0 + e1 * h.u + e2 * h.v, to_double(h.origin) + way * to_double(h.tfar));
    const VDouble q = l1 * l2 * l3 / (shortest * area); // NaN without area
    const VDouble sliver = select(has_area, vmin(q, max_sliver), max_sliver);
    const VDouble c = max_coordinate(point);
    const VDouble error = select(h.wears, c + longest * sliver, 2.0 * (c + distance) + 4.0 * vsqrt(area));
    h.x = point + h.normal * (error * (offset_margin * grain_step));
}

MARRAM_INLINE void find_arrival(const GrainTracer& tracer, const std::array<const Grain*, lanes>& grains,
                                Hits8& h) {
    Wide3d v, acceleration;
    VDouble chord_time, begin, end;
    load_four(grains, v, chord_time, [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.v.data(); });
    load_four(grains, acceleration, begin,
              [](const Grain& grain) MARRAM_ALWAYS_INLINE { return grain.acceleration.data(); });
    if (tracer.settings.drag_time <= 0.0)
        acceleration = {splat(0.0), splat(-tracer.settings.gravity), splat(0.0)};
    for (int lane = 0; lane < lanes; ++lane) end[lane] = grains[size_t(lane)]->chord_t1;
    const VDouble share = vmin(vmax(to_double(h.tfar), 0.0), 1.0), t = begin + share * (end - begin);
    const double tau = tracer.settings.drag_time;
    // With drag towards the final velocity, v + acceleration tau.
    h.arriving = v + acceleration * (tau > 0.0 ? tau * one_minus_exp(t / tau) : t);
}

MARRAM_INLINE void find_rebound(const GrainSettings& s, Hits8& h) {
    const Wide3d& n = h.normal;
    const VDouble towards = dot(h.arriving, n);
    h.sine = select(towards < 0.0, vmin(-towards / length(h.arriving), 1.0), 0.0);
    const Wide3d mirrored =
        (h.arriving - n * towards) * splat(s.tangent_restitution) - n * (s.normal_restitution * towards);
    h.rebound = mirrored;
    if (s.scatter <= 0.0) return;
    VDouble u0, u1, sine, cosine;
    event_numbers(h.keys, u0, u1);
    sincos(2.0 * pi * u1, sine, cosine);
    const VDouble z = 2.0 * u0 - 1.0, r = vsqrt(vmax(1.0 - z * z, 0.0)), speed = length(mirrored);
    Wide3d d = mirrored * (1.0 / speed) + Wide3d{r * cosine, r * sine, z} * splat(s.scatter);
    const VDouble size = length(d);
    d = d * (1.0 / size);
    const VDouble rise = dot(d, n), risen = vabs(rise);
    d = d - n * (2.0 * vmin(rise, 0.0));
    const Wide3d lifted = d + n * (min_rebound_sine - risen);
    d = select(risen < min_rebound_sine, lifted * (1.0 / length(lifted)), d);
    h.rebound = select((speed > 0.0) & (size > 1e-6), d * speed, mirrored);
}

MARRAM_HOT void compute_hits(const GrainTracer& tracer, const std::array<const Grain*, lanes>& grains,
                             Hits8& h) {
    find_place(h);
    find_arrival(tracer, grains, h);
    find_rebound(tracer.settings, h);
}

} // namespace

WornPlace worn_place(const GrainTracer& tracer, const RTCRayHit& ray) {
    const GrainMesh* const mesh = worn_mesh(tracer, lent_id(ray));
    const bool quads = mesh && mesh->mesh.quads;
    const size_t triangle = quads ? 2 * size_t(ray.hit.primID) : ray.hit.primID;
    if (!mesh || triangle >= mesh->mesh.triangle_count) return {};
    const auto u = double(ray.hit.u), v = double(ray.hit.v);
    if (!quads) return {mesh, triangle, u, v};
    // In the quad d a b c: u = 1 at a and b, v = 1 at b and c.
    return u + v > 1.0 ? WornPlace{mesh, triangle, u + v - 1.0, 1.0 - u}
                       : WornPlace{mesh, triangle + 1, v, 1.0 - u - v};
}

void prefetch_triangle(const GrainTracer& tracer, const WornPlace& place) {
    if (!place.mesh) return;
    __builtin_prefetch(place.corners());
    if (!tracer.triangle_quanta.empty())
        __builtin_prefetch(&tracer.triangle_quanta[place.mesh->first_triangle + place.triangle], 1);
}

void prefetch_corners(const GrainTracer& tracer, const WornPlace& place) {
    if (!place.mesh) return;
    for (int k = 0; k < 3; ++k) {
        const size_t v = place.corners()[k];
        __builtin_prefetch(place.mesh->mesh.vertices + 3 * v);
        __builtin_prefetch(&tracer.vertex_quanta[place.mesh->first_vertex + v], 1);
    }
}

void find_hits(const GrainTracer& tracer, GrainBatch grains, const std::array<const RTCRayHit*, lanes>& rays,
               const std::array<WornPlace, lanes>& places, std::array<GrainHit, lanes>& hits) {
    Hits8 h;
    for (int lane = 0; lane < lanes; ++lane) {
        const size_t k = size_t(lane) < grains.size() ? size_t(lane) : 0;
        const auto& [ray, hit] = *rays[k];
        set_lane(h.origin, lane, ray.org_x, ray.org_y, ray.org_z);
        set_lane(h.direction, lane, ray.dir_x, ray.dir_y, ray.dir_z);
        set_lane(h.geometric_normal, lane, hit.Ng_x, hit.Ng_y, hit.Ng_z);
        h.tfar[lane] = ray.tfar;
        const WornPlace& place = places[k];
        h.wears[lane] = place.mesh ? -1 : 0;
        h.u[lane] = place.u, h.v[lane] = place.v;
        for (size_t c = 0; c < 3; ++c) {
            const float* const p =
                place.mesh ? place.mesh->mesh.vertices + 3 * size_t(place.corners()[c]) : &ray.org_x;
            set_lane(h.corner[c], lane, p[0], p[1], p[2]);
        }
        if (tracer.settings.scatter > 0.0) set_keys(tracer, *grains[k], 2 * grains[k]->hits, lane, h.keys);
    }
    compute_hits(tracer, all_lanes_of(grains), h);
    for (size_t k = 0; k < grains.size(); ++k) {
        const int lane = int(k);
        hits[k] = {in_lane(h.x, lane), in_lane(h.normal, lane), in_lane(h.arriving, lane),
                   in_lane(h.rebound, lane), h.sine[lane]};
    }
}

} // namespace marram
