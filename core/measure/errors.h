// SPDX-License-Identifier: Apache-2.0
// Errors of a setting: the scene as it was built with the setting, against the same scene built with the
// dial's reference.
#pragma once

#include "core/measure/report.h"
#include "core/shot/shot.h"

namespace marram {

// Metres per pixel at the distance of the camera's target.
double pixel_size(const Shot& shot, double frame);

// Meshes made by procedurals, in metres: heights of terrains at the samples of the reference's grids, and the
// distances of others. Sets error (root mean square) and worst.
void compare_surfaces(const World& world, const World& reference, SettingResult& result);

// The first attribute of all meshes, relative to its root mean square in the reference. Sets error, worst, or
// refused.
void compare_attributes(const World& world, const World& reference, SettingResult& result);

// Heights of render meshes of terrains at the visible vertices of the reference's, in pixels at their
// distance: a ray for each of 100,000 vertices. Both worlds need curves and meshes that can be traced. Sets
// error, worst.
void compare_views(const Shot& shot, double frame, const World& world, const World& reference,
                   SettingResult& result);

// CVs: of DialError::motion in pixels, else relative to lengths. Sets error, worst, most, and crossing for
// dials that count it.
void compare_strands(const Dial& dial, const Shot& shot, double frame, const World& world,
                     const World& reference, SettingResult& result);

// After contact. Sets beyond: the fraction of strands that are farther than `tolerance` from the reference.
void compare_after_contact(const World& world, const World& reference, double tolerance,
                           SettingResult& result);

} // namespace marram
