// SPDX-License-Identifier: Apache-2.0
// What a rock declares to hosts: its parameters, attributes and statistics.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <array>
#include <span>
#include <vector>

namespace marram {

// RockInstance::mesh() writes their values in this order; make_rock_maps() bakes the first two (rock_instance.h).
inline constexpr std::array rock_attributes = {
    MarramAttribute{"wear", 1, MARRAM_PER_VERTEX, 0, "what the wind wears, 0 to 1 of the parameter full",
                    nullptr, 0},
    MarramAttribute{"wear_rate", 1, MARRAM_PER_VERTEX, 0, "rock that the wind wears, mm a year", nullptr, 0},
    MarramAttribute{"hardness", 1, MARRAM_PER_VERTEX, 0, "hardness of the rock, which divides the wear",
                    nullptr, 0},
};

// The static members that entry_points.h asks for.
struct RockDeclaration {
    static constexpr const char *name = "rock", *help = "a mesh with what wind-blown sand wears of it";
    static constexpr const char* memory_remedy =
        "make voxel larger, use a mesh of fewer triangles, or a smaller map";
    static const std::vector<MarramParam>& params();
    static std::span<const MarramAttribute> type_attributes() { return rock_attributes; }
    static std::span<const MarramReportEntry> report_entries();
};

} // namespace marram
