// SPDX-License-Identifier: Apache-2.0
// Imported strands at rest: where they are at a time, before the wind.
#pragma once

#include "procedural/groom/imported_instance.h"

#include <span>

namespace marram {

// The skin twice, at the bind pose and at the time asked for.
struct SkinPoses {
    Surface bind, now;
};

// Fills strands.rest (rest_normal, anchor, root_normal, width, radius, u, wind_share) of some curves of one CV count, numbers relative to
// `first`. `vertices`: of curve `first` and those behind it, at this time where they move, else in the bind pose.
//
// Strands that rest are carried rigidly by the frame of their bond: P' = R (P - foot) + foot', R = F' F^T, with F the orthonormal frame
// of normal and first edge. Where the triangle is as it was in the bind pose P' = P to the bit. Strands that move in their file are where
// it says. Where strands collide, roots that are lower than root_offset() above the skin are lifted to it, their strands with them.
void expand_imported(const ImportInstance& instance, const SkinPoses* skin, const float* vertices,
                     uint64_t first, std::span<const uint32_t> curves, uint32_t cvs, Strands& strands);

// What is known of curves without regard to time. Fills instance.patches, longest_at_bind and bind_box.
void make_patches(ImportInstance& instance);

// Of the bind pose and the frame's motion samples, m.
double longest_in_frame(const ImportInstance& instance);

// The box and the curves of one patch at all motion samples of the frame, and at rest.
void find_import_patch(const ImportInstance& instance, uint32_t index, MarramPatch* out);

// All strands at all motion samples, widths and clearances included; and at rest, with the knots that jiggle looks back to.
Eigen::AlignedBox3d bounds_of_import(const ImportInstance& instance);

} // namespace marram
