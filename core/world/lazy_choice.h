// SPDX-License-Identifier: Apache-2.0
// Which curves are lazy (lazy_curves.h), and what is known of them before.
#pragma once

#include "core/world/build_state.h"

#include <vector>

namespace marram {

// Whether the curves of a procedural are made when rays meet them, as BuildSettings::lazy says. They can be if
// nobody else reads them and there are several patches. Where that is automatic, they are if all of them would
// take at least 1 GB and the camera has less than half of them in view: rays that leave the view meet some of
// the others, and lazy curves that are all met cost a few percent more time. The choice is the same on every
// machine, whatever memory it has.
bool is_lazy(const Build& build, const CurveBuild& item);

// Of all curves, the share whose patches' boxes are in view at any time of the shutter, hidden ones too.
double share_in_view(std::span<const MarramPatch> patches, const CameraSamples& camera);

// The patches that are made before, to choose settings from: up to 64, by the distance of their boxes from
// the camera, and evenly spaced.
std::vector<uint32_t> patches_to_look_at(const CurveBuild& item, const View& view);

} // namespace marram
