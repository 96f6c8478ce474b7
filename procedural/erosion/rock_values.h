// SPDX-License-Identifier: Apache-2.0
// The settings that the values of a rock give.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"
#include "procedural/erosion/erosion.h"

#include <string_view>
#include <vector>

namespace marram {

inline constexpr double default_bed_speed = 1.0; // m/s

// The winds that wear the rock.
std::vector<RockWind> rock_winds(const Values& values);

HardnessSettings rock_hardness_settings(const Values& values);

// mesh: the one that wears; its extent gives the voxel size if `voxel` is left out.
ErosionSettings rock_erosion_settings(const Values& values, const MarramMesh& mesh);

// True if a value's name is <list>n].mesh; list: "sand[" or "shelter[".
bool is_list_mesh(std::string_view name, std::string_view list);

} // namespace marram
