// SPDX-License-Identifier: Apache-2.0
// The world of one frame as Embree sees it: two scenes that share the collider geometries. Plain data; who builds it is
// core/geometry/build.h, who reads it is the path tracer.
#pragma once

#include "core/geometry/mesh.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace marram {

// A mesh at the motion samples of the frame, in world space. Its geometry ID is its index in World::meshes.
struct MeshGeometry {
    std::string name;
    int material = -1; // index into the scene's materials
    int light = -1;    // index into the scene's lights where it emits, else -1
    std::vector<std::array<uint32_t, 3>> triangles;
    std::vector<Vec2f> uvs; // empty, or one a vertex
    std::vector<std::vector<Vec3f>>
        positions; // [time], one (at rest) or more, equally spaced over the shutter; spare bytes behind each
    std::vector<std::vector<Vec3f>> normals; // [time], unit; empty: facetted
};

struct CurveAttributeValues {
    std::string name;
    uint32_t components = 1;
    bool per_cv = false;
    std::vector<float> values; // curve_count * components, or curve_count * cvs_per_curve * components
    bool discrete = false;     // a name rather than a quantity: never averaged
};

// The curves of one procedural. Its geometry ID is World::meshes.size() + its index in World::curves.
// Curve c holds vertices [c * (cvs_per_curve + 2), ...): see MarramPatchBuffers. With s segments a curve, cvs_per_curve - 1,
// Embree's primitive p is segment p % s of curve p / s; with n pieces a segment it is piece p % n of what p / n would be.
struct CurveGeometry {
    std::string name;
    int material = -1;
    MarramBasis basis = MARRAM_BSPLINE;
    MarramShape shape = MARRAM_ROUND;
    uint64_t curve_count = 0;
    uint32_t cvs_per_curve = 0;
    uint32_t pieces = 0; // straight ones that a segment is traced as; 0: the cubic (curve_pieces.h)
    std::vector<const float*>
        vertices; // [time] x, y, z, radius; owned by Embree; one (at rest) or more, its own number
    std::vector<const float*> normals; // [time], 3 floats a vertex; oriented ribbons only
    std::vector<float*>
        round_pieces; // [time] what is traced, (segments * pieces + 1) vertices a curve; else empty
    std::vector<CurveAttributeValues> attributes;
};

struct World {
    std::shared_ptr<RTCDeviceTy> device;
    std::shared_ptr<RTCSceneTy> colliders; // meshes only
    std::shared_ptr<RTCSceneTy> scene;     // the same meshes and the curves: what rays are traced against
    double frame = 0.0;
    // Motion samples in frames, equally spaced, of what has most of them; a ray's time 0 ... 1 runs from the first to the last.
    std::vector<double> times;
    std::vector<MeshGeometry> meshes;
    std::vector<CurveGeometry> curves;
    double reach =
        0.0;      // the greatest length of a round piece with its ball, m (round_pieces.h); 0: there are none
    Box3f bounds; // of everything at every motion sample
    std::vector<std::shared_ptr<RTCGeometryTy>>
        curve_buffers; // what the pointers in `curves` point into, attached or not
};

} // namespace marram
