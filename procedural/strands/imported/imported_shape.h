// SPDX-License-Identifier: Apache-2.0
// Rest poses of imported strands at a given time, before the wind.
#pragma once

#include "procedural/strands/imported/imported_instance.h"

#include <span>

namespace marram {

// Fills strands.rest (rest_normal, noise_origin, root_normal, width, radius, u, wind_share) for some curves
// of one CV count, given by their numbers relative to `first`. `vertices`: of the curves from `first` on, at
// this time if they move, else in the bind pose.
//
// Strands without motion in their file follow the frame of their triangle rigidly: P' = R (P - foot) + foot',
// R = F' F^T, with F the orthonormal frame of normal and first edge, and foot the point of the skin closest
// to the root. If the triangle is as in the bind pose, P' = P exactly. Strands that move in their file are
// placed as in the file. With collision, roots that are lower than root_offset() above the skin are raised to
// that height together with their strands.
void expand_imported(const ImportInstance& instance, const SkinPoses* skin, const float* vertices,
                     uint64_t first, std::span<const uint32_t> curves, uint32_t cvs, Strands& strands);

// Computes the time-independent data of the curves: instance.patches, longest_at_bind, least_cvs and
// bind_box.
void make_patches(ImportInstance& instance);

// The longest strand in the bind pose and at the frame's motion samples, m.
double longest_in_frame(const ImportInstance& instance);

// The range of curves of one patch, and its box at all motion samples of the frame, bent or at rest.
MarramPatch import_patch_bounds(const ImportInstance& instance, uint32_t index);

// The union of the boxes of all patches, widths and clearances included. Poses at the past samples of jiggle
// are not included.
Eigen::AlignedBox3d bounds_of_import(const ImportInstance& instance);

} // namespace marram
