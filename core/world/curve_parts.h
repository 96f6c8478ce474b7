// SPDX-License-Identifier: Apache-2.0
// Gives each curve the motion keys that it needs. The number of keys of a procedural suits 99 of 100 of its
// curves (motion_keys.h), and most of these would do with two: of the hill of grass that the figures below
// are of, 96 %. Embree's BVH of three keys takes 3.4 times as long to build as that of two, since it tries to
// divide nodes in time, and 1.1 to 1.2 times as long to trace. A few curves of three keys among many of two
// are enough.
//
// So curves whose motion two keys follow are attached with their first and last key, the others once for each
// span between keys, as geometry of two keys that is visible in that span (rtcSetGeometryTimeRange): no
// geometry has more than two keys. Measured on 423,000 blades and stalks (relative to three keys for all):
//
//   curves that need three    building    tracing    BVH's memory
//             4 %               0.30        0.95         0.60
//             7                 0.30        0.97         0.65
//            13                 0.41        0.98         0.74
//            20                 0.36        1.15         0.85
//            34                 0.52        1.21         1.03
//
// Beyond 1/8 of the curves, or half as many spans as curves, all curves keep their keys. The hair of
// scenes/long_hair.toml in frame 1, 12 % of four keys: building 0.43, tracing 1.0. Vertices are shared: parts
// differ in their index buffers.
//
// If other curves of the scene keep more than two keys, spans are not used: where Embree 3.13 divides nodes
// of those in time, rays miss 4 of 10,000 hits on curves with a time range. The curves that need more keys
// are then one geometry with all of them (4 % of three keys: building 0.7, tracing 0.95).
//
// Error: CVs and radii of curves with two keys are within the tolerance, divided by strand_motion_margin, of
// all keys at the times of these. What the keys themselves leave in between adds to it where the path does
// not bend evenly.
#pragma once

#include "core/world/build_state.h"

namespace marram {

// The vertices of a procedural's curves that Embree traces: of its cubics, or of their straight pieces.
struct TracedVertices {
    std::shared_ptr<RTCGeometryTy> geometry; // owns them; not attached yet
    RTCGeometryType type{};
    std::vector<float*> vertices, normals; // [time]; normals: of oriented ribbons
    size_t vertex_count = 0;
    uint32_t segments = 0, stride = 0; // of each curve, in segments and vertices; 0: as the layout says
};

// Finds the curves that two keys follow (CurveGeometry::two_keys) and says in `chosen` how many need more.
// None if all curves are to be traced with all keys: they have at most two, too many curves need more, or the
// scene sets the number.
void choose_two_keys(Build& build, CurveBuild& item);

// Attaches curves with two_keys as parts. set: index that the curves will have in World::curves. spans: use
// parts with a time range.
void attach_parts(Build& build, const CurveBuild& item, const TracedVertices& traced, uint32_t set,
                  bool spans);

// Commits a geometry and attaches it to the world scene.
void attach_geometry(Build& build, RTCGeometry geometry, unsigned id);

} // namespace marram
