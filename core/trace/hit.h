// SPDX-License-Identifier: Apache-2.0
// Traces rays against a frame's world. Hits are exact enough for shading, and rays that leave them do not hit
// the same surface again. The head of spawn.cpp derives the offsets.
#pragma once

#include "core/geometry/world.h"

#include <array>
#include <cstdint>
#include <limits>

namespace marram {

// direction is a unit vector; time 0 ... 1 runs over World::times.
struct Ray {
    Vec3f origin = Vec3f::Zero();
    Vec3f direction = Vec3f::UnitZ();
    float tnear = 0.0F;
    float tfar = std::numeric_limits<float>::infinity();
    float time = 0.0F;
    uint32_t mask = ~0U; // bits of MarramRole that it hits
};

// Rays traced. invalid: rays that must not be passed to Embree (NaN, infinity; empty intervals are not among
// them).
struct RayCounts {
    uint64_t intersect = 0;
    uint64_t occluded = 0;
    uint64_t invalid = 0;
};

enum class PointShape : uint8_t { triangle, round, ribbon, oriented_ribbon };

struct SurfacePoint {
    Vec3d position =
        Vec3d::Zero();  // on the surface at the ray's time, from barycentrics or the curve, not from t
    double error = 0.0; // bound of |position - the surface as Embree computes it|, along the normal
    Vec3f geometric_normal =
        Vec3f::UnitZ(); // mesh: its anticlockwise side; round: away from the axis; ribbon: see hit.cpp
    // For shading: interpolated vertex normals if the mesh has them, turned to the side of geometric_normal.
    // Shaders turn both to the side that is seen. So a triangle that is wound against its normals or its
    // neighbours looks like these. Light never passes: sidedness_normal alone says which directions are
    // behind the surface.
    Vec3f normal = Vec3f::UnitZ();
    // Triangles: vertex normals stand for a smooth surface (Hanika 2021, see hit.cpp). The sign of
    // sidedness_normal . d says on which side of it a direction d is. patch_offset: m, where spawn() starts
    // grazing rays, from the position: [0] for rays on sidedness_normal's side, [1] for those on the other.
    // Not set on curves.
    Vec3f sidedness_normal = Vec3f::UnitZ();
    std::array<Vec3f, 2> patch_offset = {Vec3f::Zero(), Vec3f::Zero()};
    Vec3f tangent = Vec3f::UnitX(); // curves: unit, root to tip; meshes: a unit vector in the surface
    Vec2f uv =
        Vec2f::Zero();     // mesh: its uvs (barycentrics where it has none); curves: (strand_u, (1 + h) / 2)
    float strand_u = 0.0F; // 0 root ... 1 tip of the whole strand; 0 on meshes
    float h =
        0.0F; // curves: offset across the fibre as seen along the ray, -1 ... 1, towards tangent x (-ray)
    float radius = 0.0F;   // curves: radius here
    float area = 0.0F;     // triangles: area at the ray's time
    float distance = 0.0F; // along the ray
    PointShape shape = PointShape::triangle;
    int material = -1; // as in MeshGeometry and CurveGeometry
    int light = -1;
    uint32_t geometry = 0; // index in World::meshes, or World::meshes.size() + index in World::curves
    uint32_t primitive = 0;
    Vec2f barycentrics = Vec2f::Zero(); // triangles: of the second and third corner
    uint32_t strand = 0;                // curve of its procedural
    float segment_position = 0.0F;      // curves: segment + u, 0 ... CVs - 1
    // Also needed by spawn(), curves only.
    Vec3f from_axis = Vec3f::Zero(); // position - axis
    float curvature = 0.0F;          // 1/m, a bound
    float taper = 0.0F;              // d radius / d length
    float piece = 0.0F; // length of the straight piece or quadrilateral, m; 0 on round and oriented cubics
    float to_begin = 0.0F, to_end = 0.0F; // along it to its corners, m
    bool joints = false;                  // straight pieces: a disc or ball at each corner
};

// False if nothing is hit or the ray is not valid. coherent: camera rays. Thread-safe, allocates nothing.
bool intersect(const World& world, const Ray& ray, SurfacePoint& point, bool coherent,
               RayCounts* counts = nullptr);

// True if anything lies within the ray's interval; an empty interval and an invalid ray hit nothing.
bool occluded(const World& world, const Ray& ray, RayCounts* counts = nullptr);

// True if the ray may be passed to Embree: everything finite (tfar may be infinite), tnear >= 0, time within
// [0, 1].
bool valid(const Ray& ray);

// A ray that leaves the surface in `direction` (unit), on either side. On a round curve, a direction into the
// fibre starts beyond the far side of the fibre.
Ray spawn(const SurfacePoint& point, const Vec3f& direction, float time);

// A shadow ray from the point to a target on another surface. It ends target_error before the target.
Ray spawn_towards(const SurfacePoint& point, const Vec3d& target, double target_error, float time);

// The point of a triangle at barycentrics (of its second and third corner) and a ray's time.
SurfacePoint mesh_point(const World& world, uint32_t mesh, uint32_t triangle, const Vec2f& barycentrics,
                        float time);

// A vertex of a mesh at a ray's time, as Embree interpolates it.
Vec3d mesh_vertex(const MeshGeometry& mesh, uint32_t vertex, float time);

// An attribute at a point on a curve: `components` values. Values per CV are linear between the CVs; discrete
// ones are the nearest CV's.
void attribute_at(const CurveGeometry& curves, const AttributeValues& attribute, const SurfacePoint& point,
                  float* values);
// The same at a point on a mesh: values per vertex are linear over the triangle; discrete ones are the
// nearest corner's.
void attribute_at(const MeshGeometry& mesh, const AttributeValues& attribute, const SurfacePoint& point,
                  float* values);

} // namespace marram
