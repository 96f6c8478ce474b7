// SPDX-License-Identifier: Apache-2.0
#include "procedural/erosion/rock_declaration.h"

#include "procedural/abi/param.h"
#include "procedural/erosion/erosion.h"
#include "procedural/wind/wind.h"

#include <array>
#include <string_view>
#include <utility>

namespace marram {
namespace {

constexpr std::array rock_values = {
    param::mesh("mesh", "", "", "the mesh that wears"),
    param::number("sand_level", "m", "none", -1e6, 1e6,
                  "height of level sand everywhere; none: only the meshes in sand"),
    param::mesh("sand[].mesh", "", "", "a mesh of sand: a grain that lands is replaced by a new one"),
    param::mesh("shelter[].mesh", "", "", "a mesh that stops grains"),
    param::integer("paths", "", "250000", 1, 0x1p28, "grains that are traced", "16000|64000|250000|1000000",
                   "seconds.procedural_meshes"),
    param::integer("seed", "", "0", 0, 1e9, "of all its random numbers"),
    param::number("transport", "kg/m", "30000", 0, 1e9,
                  "sand that the wind carries in a year across each metre of width"),
    param::number("height", "m", "0.1", 1e-4, 1e4,
                  "over which the flux of sand falls by e; 0.03 over sand, 0.1 over stones"),
    param::number("speed", "m/s", "none", 0, 100, "of grains high above the ground; none: the wind's speed"),
    param::number("bed_speed", "m/s", "1", 0, 100, "of grains at the ground, no more than speed"),
    param::number("speed_height", "m", "0.4", 1e-4, 1e4,
                  "over which the grains' speed comes closer to speed by e"),
    param::number("spread", "deg", "10", 0, 45, "greatest angle of a grain to the wind's direction"),
    param::number("drag_time", "s", "0.2", 0, 1e3,
                  "time in which the velocity difference to the air falls by a factor e; 0: no drag"),
    param::number("threshold", "m/s", "1", 0, 100, "grains that hit more slowly wear nothing"),
    param::number("energy_per_volume", "J/m^3", "1e9", 1e3, 1e15,
                  "energy that it takes to wear rock; 5e8 for weak sandstone, 4e9 for granite"),
    param::number("angle_exponent", "", "2", 0, 8,
                  "n of energy sin^n(angle to the surface): 2 for brittle rock, 0 for all of the energy"),
    param::number("normal_restitution", "", "0.6", 0, 1,
                  "speed off the surface after a rebound, over that before"),
    param::number("tangent_restitution", "", "0.85", 0, 1, "the same along the surface"),
    param::number("scatter", "", "0.3", 0, 1, "how far rebounds leave the mirror direction"),
    param::number("reach", "m", "20", 0, 1e6, "how far around the mesh grains are traced"),
    param::number("full", "mm", "none", 1e-9, 1e9,
                  "wear rate per year at which wear is 1; none: the 95 % quantile over the worn area"),
    param::vec3("winds[].direction", "", "", -1e9, 1e9,
                "a wind that takes the place of the scene's, in turn with the others"),
    param::number("winds[].share", "", "1", 0, 1e6, "of the time, beside the other winds"),
    param::integer("levels", "", "0", 0, max_erosion_levels,
                   "number of erosion levels, coarse first; 0: no erosion"),
    param::integer("level", "", "none", 1, max_erosion_levels, "level to output; none: the last", "1..levels",
                   "seconds.procedural_meshes"),
    param::number("voxel", "m", "none", 1e-5, 1e4,
                  "of the last level; none: a 128th of the mesh's greatest extent"),
    param::number("years", "", "1000", 0, 1e9, "of wind"),
    param::number("detail", "", "0.75", 0, 1, "depth of what a level adds, in voxels of the one before"),
    param::number("hardness", "", "1", 1e-3, 1e6, "of all of it: divides the wear"),
    param::number("strata.thickness", "m", "0", 0, 1e4, "mean of a bed; 0: no beds"),
    param::number("strata.contrast", "", "4", 1, 1e3, "of the hardest and the softest bed"),
    param::number("strata.laminae", "", "0", 0, 1,
                  "contrast of beds within the beds, as a power of strata.contrast"),
    param::number("strata.dip", "deg", "0", -90, 90, "angle of the beds to level"),
    param::number("strata.dip_direction", "deg", "0", -360, 360, "where the beds go down, from x towards z"),
    param::number("strata.fold", "m", "0", 0, 1e4, "amplitude of their folds"),
    param::number("strata.fold_length", "m", "10", 1e-4, 1e6, "length of their folds"),
    param::number("noise.contrast", "", "1", 1, 1e3,
                  "of the hardest and the softest place by noise; 1: none"),
    param::number("noise.length", "m", "1", 1e-4, 1e6, "of the noise's coarsest octave"),
    param::integer("noise.octaves", "", "3", 1, 8, "each half as long and as strong"),
    param::vec3("hard[].center", "m", "", -1e7, 1e7, "of an ellipsoid of other hardness"),
    param::vec3("hard[].radius", "m", "[1, 1, 1]", 1e-6, 1e7, "along x, y and z"),
    param::number("hard[].hardness", "", "4", 1e-3, 1e6, "factor of the hardness in it"),
    param::number("hard[].edge", "", "0.2", 0, 1, "share of the radius over which it begins"),
    param::integer("map", "", "0", 0, 16384, "pixels of a side of the images by uv; 0: none"),
};

} // namespace

const std::vector<MarramParam>& RockDeclaration::params() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> list(rock_values.begin(), rock_values.end());
        add_constant_wind(list);
        list.push_back(ignored_field_param());
        return list;
    }();
    return params;
}

std::span<const MarramReportEntry> RockDeclaration::report_entries() {
    static constexpr std::array entries = {
        MarramReportEntry{"rock.grains", "count", MARRAM_SUM, nullptr, nullptr, "grains of sand traced"},
        MarramReportEntry{"rock.rays", "count", MARRAM_SUM, nullptr, nullptr,
                          "straight segments of their paths"},
        MarramReportEntry{"rock.hits", "count", MARRAM_SUM, nullptr, nullptr, "hits on rock that wears"},
        MarramReportEntry{"rock.volume", "m^3", MARRAM_SUM, nullptr, nullptr, "rock worn in a year"},
        MarramReportEntry{"rock.seconds", "s", MARRAM_SUM, nullptr, nullptr, "tracing grains"},
        MarramReportEntry{"rock.erosion_passes", "count", MARRAM_SUM, nullptr, nullptr,
                          "of erosion, all levels"},
        MarramReportEntry{"rock.erosion_removed", "m^3", MARRAM_SUM, nullptr, nullptr,
                          "rock that is gone, of what was given"},
        MarramReportEntry{"rock.erosion_seconds", "s", MARRAM_SUM, nullptr, nullptr, "eroding"},
    };
    return entries;
}

} // namespace marram
