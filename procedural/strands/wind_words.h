// SPDX-License-Identifier: Apache-2.0
// The wind in words: warnings of a wind that does nothing, and a summary for `marram info SCENE`. Texts name
// no groom: procedurals that share the scene's wind send the same text, and the host shows it once.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"
#include "procedural/wind/blade/blade.h"
#include "procedural/wind/wind.h"

#include <string>

namespace marram {

// Warns where the values show that the wind does nothing, or not what its numbers suggest: no speed, no
// response, no background wind, a speed beyond the end of the response.
void warn_of_idle_wind(const MarramHost& host, const Values& given, const Wind& wind);

// Warns, as MARRAM_COMMON_WARNING, of gusts that touch nothing in the box of the strands at any frame of the
// shot, if that is known. The centre of the gusts must be set (set_gust_plane_once).
void warn_of_untouching_gusts(const MarramHost& host, const Wind& wind, const MarramFrame& frame,
                              const Eigen::AlignedBox3d& strands);

// Direction, speed, strength, gusts that touch the box of the strands in the shot, stages. Lines end with
// '\n'.
std::string wind_summary(const Wind& wind, const MarramFrame& frame, const Eigen::AlignedBox3d& strands);

// Says so if a blade cannot carry itself upright; hair that hangs may be as heavy as it likes.
void warn_of_heavy_blade(const MarramHost& host, const Blade& blade);

// Warns of blades whose equations were not solved to the tolerance in the frame.
void warn_of_unsolved_blades(const MarramHost& host, const std::string& place, uint64_t unsolved);

} // namespace marram
