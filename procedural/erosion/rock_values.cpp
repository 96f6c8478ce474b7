// SPDX-License-Identifier: Apache-2.0
// The settings of grains, hardness and erosion that the values of a rock give.
#include "procedural/erosion/rock_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

namespace marram {
namespace {

double rock_speed(const Values& values) {
    return std::min(values.has("speed") ? values.number("speed") : values.number("wind.speed"), 100.0);
}

GrainSettings grain_settings_of(const Values& values) {
    GrainSettings s;
    s.paths = uint64_t(values.number("paths"));
    s.seed = uint32_t(values.integer("seed"));
    s.wind = values.vec3("wind.direction");
    s.transport = values.number("transport");
    s.height = values.number("height");
    s.speed = rock_speed(values);
    s.bed_speed = std::min(values.number("bed_speed"), s.speed);
    s.speed_height = values.number("speed_height");
    s.spread = radians(values, "spread");
    s.drag_time = values.number("drag_time");
    s.threshold_speed = values.number("threshold");
    s.energy_per_volume = values.number("energy_per_volume");
    s.angle_exponent = values.number("angle_exponent");
    s.normal_restitution = values.number("normal_restitution");
    s.tangent_restitution = values.number("tangent_restitution");
    s.scatter = values.number("scatter");
    s.reach = values.number("reach");
    if (values.has("sand_level")) s.ground = values.number("sand_level");
    s.ray_mask = MARRAM_NAMED;
    return s;
}

} // namespace

std::vector<RockWind> rock_winds(const Values& values) {
    const GrainSettings grains = grain_settings_of(values);
    std::vector<RockWind> winds;
    for (size_t n = 0; values.has(fmt::format("winds[{}].direction", n)); ++n) {
        winds.push_back({grains, values.number(fmt::format("winds[{}].share", n))});
        winds.back().grains.wind = values.vec3(fmt::format("winds[{}].direction", n));
    }
    if (winds.empty()) winds.push_back({grains, 1.0});
    return winds;
}

HardnessSettings rock_hardness_settings(const Values& values) {
    HardnessSettings s;
    s.hardness = values.number("hardness");
    s.strata.thickness = values.number("strata.thickness");
    s.strata.contrast = values.number("strata.contrast");
    s.strata.laminae = values.number("strata.laminae");
    s.strata.dip = radians(values, "strata.dip");
    s.strata.dip_direction = radians(values, "strata.dip_direction");
    s.strata.fold = values.number("strata.fold");
    s.strata.fold_length = values.number("strata.fold_length");
    s.noise = values.number("noise.contrast");
    s.noise_length = values.number("noise.length");
    s.noise_octaves = values.integer("noise.octaves");
    s.seed = uint32_t(values.integer("seed"));
    for (size_t n = 0; values.has(fmt::format("hard[{}].center", n)); ++n) {
        const auto name = [n](const char* field) { return fmt::format("hard[{}].{}", n, field); };
        s.masks.push_back({values.vec3(name("center")), values.vec3(name("radius")),
                           values.number(name("hardness")), values.number(name("edge"))});
    }
    return s;
}

ErosionSettings rock_erosion_settings(const Values& values, const MarramMesh& mesh) {
    ErosionSettings s;
    s.levels = values.integer("levels");
    s.stop_after = values.has("level") ? std::min(values.integer("level"), s.levels) : s.levels;
    Box3f box;
    for (size_t c = 0; c < 3 * size_t(mesh.triangle_count); ++c)
        box.extend(Vec3f(mesh.positions[0] + 3 * size_t(mesh.triangles[c])));
    s.voxel = values.has("voxel") || box.isEmpty() ? (values.has("voxel") ? values.number("voxel") : 1.0)
                                                   : double(box.sizes().maxCoeff()) / 128.0;
    s.years = values.number("years");
    s.detail = values.number("detail");
    s.hardness = rock_hardness_settings(values);
    return s;
}

bool is_list_mesh(std::string_view name, std::string_view list) {
    return name.starts_with(list) && name.ends_with("].mesh");
}

} // namespace marram
