// SPDX-License-Identifier: Apache-2.0
// Grains that hit surfaces, up to eight at a time: where, how fast, and how they rebound. Internal to the
// tracer of grains. The model is documented in grains.cpp.
#pragma once

#include "procedural/erosion/grain_flight.h"

namespace marram {

inline constexpr double min_rebound_sine = 0.01; // minimum sine between a rebound and the surface

// On a triangle of a worn mesh, at p0 + u (p1 - p0) + v (p2 - p0).
struct WornPlace {
    const GrainMesh* mesh = nullptr; // nullptr: what was hit does not wear
    size_t triangle = 0;
    double u = 0.0, v = 0.0;

    const uint32_t* corners() const { return mesh->mesh.triangles + 3 * triangle; }
};

struct GrainHit {
    Vec3d x;           // the point that was hit, offset from the surface
    Vec3d normal;      // unit, facing the incoming path
    Vec3d v;           // of the grain that arrives
    Vec3d rebound;     // its velocity afterwards, if it hits rock
    double sine = 0.0; // between path and surface; 0 or less: the path leaves the surface
};

// The id of the geometry that was hit. Geometry in an instance is none of the lent meshes, whatever its id.
inline unsigned lent_id(const RTCRayHit& ray) {
    return ray.hit.instID[0] == RTC_INVALID_GEOMETRY_ID ? ray.hit.geomID : RTC_INVALID_GEOMETRY_ID;
}

WornPlace worn_place(const GrainTracer& tracer, const RTCRayHit& ray);

// Hits access memory at random. Prefetching saves a quarter of their time on a million triangles: the indices
// of a triangle first, what they lead to while later rays are traced.
void prefetch_triangle(const GrainTracer& tracer, const WornPlace& place);
void prefetch_corners(const GrainTracer& tracer, const WornPlace& place);

// The hit of each grain of a batch, whose ray has hit places[k]. places and hits have eight elements.
void find_hits(const GrainTracer& tracer, GrainBatch grains, const std::array<const RTCRayHit*, lanes>& rays,
               const std::array<WornPlace, lanes>& places, std::array<GrainHit, lanes>& hits);

} // namespace marram
