// SPDX-License-Identifier: Apache-2.0
// Gives each curve the motion keys that it needs. The number of keys of a procedural suits 99 of 100 of its
// curves (motion_keys.h); most of these would do with the first and the last. Where Embree finds curves of
// more than two keys, even a few among many, it tries temporal splits, and the build takes several times as
// long.
//
// So curves whose motion two keys follow are attached with their first and last key, and the others once for
// each time segment, as geometry of two keys with a time range (rtcSetGeometryTimeRange). Parts share
// vertices and differ in their index buffers. The gain is seconds.bvh in the --stats of
//     marram render scenes/long_hair.toml --frame 1 --spp 2 --stats FILE.json [--set film.motion_keys=4]
// where the setting gives all curves the four keys that 12 % of them need.
//
// Curves with a time range overlap in the BVH whatever their times: rays became slower where more than 1/8 of
// the curves had one. Beyond that, or if they make more than half as many copies as there are curves, all
// curves keep their keys.
//
// If other curves of the scene keep more than two keys, no part has a time range: where Embree 3.13 makes
// temporal splits of those, rays miss 4 of 10,000 hits on curves with a time range. The curves that need more
// than two keys are then one part with all keys.
//
// Error: at the times of the keys, CVs and radii of curves with two keys are within the tolerance divided by
// strand_motion_margin. The error of linear interpolation between all keys is not included.
#pragma once

#include "core/world/build_state.h"

#include <span>

namespace marram {

// The vertices of a procedural's curves that Embree traces: of its cubics, or of their straight pieces.
struct TracedVertices {
    std::shared_ptr<RTCGeometryTy> geometry; // owns them; empty of lazy curves
    RTCGeometryType type{};
    std::vector<float*> vertices, normals; // [time]; normals: of oriented ribbons
    size_t vertex_count = 0;
    uint32_t segments = 0, stride = 0; // of each curve, in segments and vertices; 0: as the layout says
};

// Sets CurveGeometry::end_keys_only, and BuildStats::chosen to the fraction of curves that need more keys.
// Leaves end_keys_only empty if all curves are to be traced with all keys: they have at most two, too many
// curves need more, or the scene sets the number. Of lazy curves only those of known patches count, and just
// CurveBuild::has_parts is set.
void find_end_key_curves(Build& build, CurveBuild& item);

// Marks the curves of a patch that two keys follow: [curve of the patch] 1 if so. Returns their largest
// error, m, enlarged by the view.
double mark_end_key_curves(const CurveBuild& item, const MarramPatch& patch, double limit, const View& view,
                           char* marks);

// The curves of a patch, or of all patches, whose marks are as given.
struct PartIndices {
    std::vector<uint32_t> primitives; // of the CurveGeometry
    std::vector<uint32_t> vertices;   // of each primitive the first, counted from the first curve's
};
PartIndices part_indices(const CurveBuild& item, const TracedVertices& traced, uint64_t first_curve,
                         std::span<const char> marks, char wanted);

// The keys of each geometry that curves with these marks become: pairs of neighbours if `spans`, else all.
std::vector<std::vector<size_t>> part_keys(size_t keys, bool end_keys_only, bool spans);

// A geometry of some keys of a part, in which it is visible. Not committed yet.
std::shared_ptr<RTCGeometryTy> part_geometry(RTCDevice device, const TracedVertices& traced,
                                             std::span<const uint32_t> vertices,
                                             const std::vector<size_t>& keys);

// Attaches curves with end_keys_only as parts. set: index that the curves will have in World::curves. spans:
// curves that need more keys have one part for each time segment, else one part.
void attach_parts(Build& build, const CurveBuild& item, const TracedVertices& traced, uint32_t set,
                  bool spans);

// The box of a patch, larger by a few roundings of its largest coordinate: Embree tests it in float.
inline Box3f padded_box(const MarramPatch& patch) {
    const Vec3f lower(patch.lower), upper(patch.upper);
    const float more = 0x1p-20F * std::max(lower.cwiseAbs().maxCoeff(), upper.cwiseAbs().maxCoeff());
    return {lower.array() - more, upper.array() + more};
}

// Embree's mask of all curves.
inline constexpr uint32_t curve_mask = MARRAM_CASTS_SHADOWS | MARRAM_SEEN_BY_CAMERA | darkens_catchers;

// Commits a geometry and attaches it to the world scene.
void attach_geometry(Build& build, RTCGeometry geometry, unsigned id);

} // namespace marram
