// SPDX-License-Identifier: Apache-2.0
// rock: a mesh with its wear by wind-blown sand as attributes for shaders and grooms. With `levels` the mesh
// is also eroded to the shape that the wind gives it.
//
// Model. Grains of sand are traced through the scene (model and sources in grains.cpp) and wear the mesh. The
// output is a copy of the mesh with its uvs and normals, and with the attributes
//     wear        0 to 1: rate / full, clamped to 1
//     wear_rate   mm of rock a year
//     hardness    divides the wear: beds, noise, and ellipsoids (hardness.cpp)
// The source mesh stays in the scene: switch off its roles, as below, or both are rendered. Grains hit only
// the meshes that are named: `mesh`, those in `shelter`, and those in `sand`, where a grain that lands is
// replaced by a new grain of the stream. `sand_level` is level sand everywhere. Wind direction and speed are
// the scene's. Vertices at equal positions are merged for the wear, so that uv seams do not show.
//
//     [[mesh]]
//     name = "boulder"
//     type = "file"
//     file = "boulder.obj"
//     collides = false
//     shelters = false
//     casts_shadows = false
//     seen_by_camera = false
//
//     [[procedural]]
//     type = "rock"
//     name = "worn"
//     mesh = "boulder"
//     material = "patina"             # of type blend, attribute = "wear"
//     sand_level = 0
//     [[procedural.shelter]]
//     mesh = "wall"
//
// With `levels` the mesh is eroded for `years` as a level set (erosion.cpp): it must be closed. The first
// level is coarse; each further level halves the voxel size, keeps the shape and adds detail. `level` stops
// at one of them for a fast preview: its shape is the smoothed final shape. `winds` replace the scene's wind
// and share the time; two winds make a keel. The output mesh has no uvs.
//
//     [[procedural]]
//     type = "rock"
//     name = "ventifact"
//     mesh = "boulder"
//     sand_level = 0
//     levels = 3
//     voxel = 0.004
//     years = 800
//     strata = { thickness = 0.03, contrast = 2, dip = 15 }
//     [[procedural.winds]]
//     direction = [1, 0, 0.7]
//     [[procedural.winds]]
//     direction = [-1, 0, 0.5]
//     [[procedural.hard]]             # a cap that shelters what is below it
//     center = [0, 0.3, 0]
//     radius = [0.3, 0.05, 0.3]
//     hardness = 5
//
// With `map`, wear and wear_rate are also baked to images by uv; `marram bake -o wear.exr` writes them. Row 0
// is v = 1. A pixel takes the value of the triangle at its centre; two pixels around each island are filled
// with the mean of their neighbours.
//
// Cost: about a million rays per second and core; a grain takes 5 to 30. The noise at a vertex falls with the
// square root of the number of grains that hit its triangles.
#include "procedural/erosion/rock.h"

#include "core/math/clock.h"
#include "procedural/border.h"
#include "procedural/erosion/erosion.h"
#include "procedural/terrain/stored_values.h"
#include "procedural/wind/wind.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

namespace marram {
namespace {

struct RockInstance {
    MarramHost host{};
    StoredValues values;
    uint64_t values_digest = 0;
    uint64_t digest = 0; // of all inputs of `wear`; 0: not computed yet
    std::vector<float> positions, normals, uvs;
    std::vector<uint32_t> triangles;
    std::vector<float> wear, rate, hardness; // per vertex
    ErosionResult erosion;                   // no levels if the mesh is not eroded
    double erosion_seconds = 0.0;
    std::array<std::vector<float>, 2> maps;
    std::array<MarramGrid, 2> grids{};
    GrainReport report;
    bool begun = false;
};

RockInstance& rock(MarramInstance* instance) { return *reinterpret_cast<RockInstance*>(instance); }

template <typename Body>
MarramStatus guarded_rock(const MarramHost& host, Body&& body) {
    return guarded(host, "rock", "use a mesh of fewer triangles, or a smaller map", std::forward<Body>(body));
}

constexpr std::array rock_values = {
    MarramParam{"mesh", MARRAM_MESH_NAME, "", "", 0, 0, "", "the mesh that wears"},
    MarramParam{"sand_level", MARRAM_NUMBER, "m", "none", -1e6, 1e6, "",
                "height of level sand everywhere; none: only the meshes in sand"},
    MarramParam{"sand[].mesh", MARRAM_MESH_NAME, "", "", 0, 0, "",
                "a mesh of sand: a grain that lands is replaced by a new one"},
    MarramParam{"shelter[].mesh", MARRAM_MESH_NAME, "", "", 0, 0, "", "a mesh that stops grains"},
    MarramParam{"paths", MARRAM_INTEGER, "", "250000", 1, 0x1p28, "", "grains that are traced",
                "16000|64000|250000|1000000|4000000", ""},
    MarramParam{"seed", MARRAM_INTEGER, "", "0", 0, 1e9, "", "of all its random numbers"},
    MarramParam{"transport", MARRAM_NUMBER, "kg/m", "30000", 0, 1e9, "",
                "sand that the wind carries in a year across each metre of width"},
    MarramParam{"height", MARRAM_NUMBER, "m", "0.1", 1e-4, 1e4, "",
                "over which the flux of sand falls by e; 0.03 over sand, 0.1 over stones"},
    MarramParam{"speed", MARRAM_NUMBER, "m/s", "none", 0, 100, "",
                "of grains high above the ground; none: the wind's speed"},
    MarramParam{"bed_speed", MARRAM_NUMBER, "m/s", "1", 0, 100, "",
                "of grains at the ground, no more than speed"},
    MarramParam{"speed_height", MARRAM_NUMBER, "m", "0.4", 1e-4, 1e4, "",
                "over which the grains' speed comes closer to speed by e"},
    MarramParam{"spread", MARRAM_NUMBER, "deg", "10", 0, 45, "",
                "greatest angle of a grain to the wind's direction"},
    MarramParam{"drag_time", MARRAM_NUMBER, "s", "0.2", 0, 1e3, "",
                "time in which the velocity difference to the air falls by a factor e; 0: no drag"},
    MarramParam{"threshold", MARRAM_NUMBER, "m/s", "1", 0, 100, "",
                "grains that hit more slowly wear nothing"},
    MarramParam{"energy_per_volume", MARRAM_NUMBER, "J/m^3", "1e9", 1e3, 1e15, "",
                "energy that it takes to wear rock; 5e8 for weak sandstone, 4e9 for granite"},
    MarramParam{"angle_exponent", MARRAM_NUMBER, "", "2", 0, 8, "",
                "n of energy sin^n(angle to the surface): 2 for brittle rock, 0 for all of the energy"},
    MarramParam{"normal_restitution", MARRAM_NUMBER, "", "0.6", 0, 1, "",
                "speed off the surface after a rebound, over that before"},
    MarramParam{"tangent_restitution", MARRAM_NUMBER, "", "0.85", 0, 1, "", "the same along the surface"},
    MarramParam{"scatter", MARRAM_NUMBER, "", "0.3", 0, 1, "", "how far rebounds leave the mirror direction"},
    MarramParam{"reach", MARRAM_NUMBER, "m", "20", 0, 1e6, "", "how far around the mesh grains are traced"},
    MarramParam{"full", MARRAM_NUMBER, "mm", "none", 1e-9, 1e9, "",
                "wear rate per year at which wear is 1; none: the 95 % quantile over the worn area"},
    MarramParam{"winds[].direction", MARRAM_VEC3, "", "", -1e9, 1e9, "",
                "a wind that takes the place of the scene's, in turn with the others"},
    MarramParam{"winds[].share", MARRAM_NUMBER, "", "1", 0, 1e6, "", "of the time, beside the other winds"},
    MarramParam{"levels", MARRAM_INTEGER, "", "0", 0, max_erosion_levels, "",
                "number of erosion levels, coarse first; 0: no erosion"},
    MarramParam{"level", MARRAM_INTEGER, "", "none", 1, max_erosion_levels, "",
                "level to output; none: the last"},
    MarramParam{"voxel", MARRAM_NUMBER, "m", "none", 1e-5, 1e4, "",
                "of the last level; none: a 128th of the mesh's greatest extent"},
    MarramParam{"years", MARRAM_NUMBER, "", "1000", 0, 1e9, "", "of wind"},
    MarramParam{"detail", MARRAM_NUMBER, "", "0.75", 0, 1, "",
                "depth of what a level adds, in voxels of the one before"},
    MarramParam{"hardness", MARRAM_NUMBER, "", "1", 1e-3, 1e6, "", "of all of it: divides the wear"},
    MarramParam{"strata.thickness", MARRAM_NUMBER, "m", "0", 0, 1e4, "", "mean of a bed; 0: no beds"},
    MarramParam{"strata.contrast", MARRAM_NUMBER, "", "4", 1, 1e3, "", "of the hardest and the softest bed"},
    MarramParam{"strata.laminae", MARRAM_NUMBER, "", "0", 0, 1, "",
                "contrast of beds within the beds, as a power of strata.contrast"},
    MarramParam{"strata.dip", MARRAM_NUMBER, "deg", "0", -90, 90, "", "angle of the beds to level"},
    MarramParam{"strata.dip_direction", MARRAM_NUMBER, "deg", "0", -360, 360, "",
                "where the beds go down, from x towards z"},
    MarramParam{"strata.fold", MARRAM_NUMBER, "m", "0", 0, 1e4, "", "amplitude of their folds"},
    MarramParam{"strata.fold_length", MARRAM_NUMBER, "m", "10", 1e-4, 1e6, "", "length of their folds"},
    MarramParam{"noise.contrast", MARRAM_NUMBER, "", "1", 1, 1e3, "",
                "of the hardest and the softest place by noise; 1: none"},
    MarramParam{"noise.length", MARRAM_NUMBER, "m", "1", 1e-4, 1e6, "", "of the noise's coarsest octave"},
    MarramParam{"noise.octaves", MARRAM_INTEGER, "", "3", 1, 8, "", "each half as long and as strong"},
    MarramParam{"hard[].center", MARRAM_VEC3, "m", "", -1e7, 1e7, "", "of an ellipsoid of other hardness"},
    MarramParam{"hard[].radius", MARRAM_VEC3, "m", "[1, 1, 1]", 1e-6, 1e7, "", "along x, y and z"},
    MarramParam{"hard[].hardness", MARRAM_NUMBER, "", "4", 1e-3, 1e6, "", "factor of the hardness in it"},
    MarramParam{"hard[].edge", MARRAM_NUMBER, "", "0.2", 0, 1, "",
                "share of the radius over which it begins"},
    MarramParam{"map", MARRAM_INTEGER, "", "0", 0, 16384, "",
                "pixels of a side of the images by uv; 0: none"},
};

const std::vector<MarramParam>& rock_params() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> list(rock_values.begin(), rock_values.end());
        for (const MarramParam& param : wind_params())
            for (const auto& [name, full] :
                 {std::pair("direction", "wind.direction"), std::pair("speed", "wind.speed")})
                if (std::string_view(param.name) == name) {
                    list.push_back(param);
                    list.back().name = full;
                }
        return list;
    }();
    return params;
}

constexpr std::array rock_attributes = {
    MarramAttribute{"wear", 1, MARRAM_PER_VERTEX, 0, "what the wind wears, 0 to 1 of the parameter full",
                    nullptr, 0},
    MarramAttribute{"wear_rate", 1, MARRAM_PER_VERTEX, 0, "rock that the wind wears, mm a year", nullptr, 0},
    MarramAttribute{"hardness", 1, MARRAM_PER_VERTEX, 0, "hardness of the rock, which divides the wear",
                    nullptr, 0},
};

// ---- values ----

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

// The winds that wear the rock.
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

const MarramMesh& rock_mesh_named(std::span<const MarramMesh> meshes, const MarramValue& value) {
    for (const MarramMesh& mesh : meshes)
        if (mesh.name && std::string_view(mesh.name) == value.text) return mesh;
    throw SceneFault("rock.no_mesh", value.place, fmt::format("there is no mesh '{}'", value.text),
                     "name one of the scene's");
}

bool is_list_mesh(std::string_view name, std::string_view list) {
    return name.starts_with(list) && name.ends_with("].mesh");
}

// Checks combinations of valid values and stores them in the instance.
void take_rock_values(RockInstance& instance, std::span<const MarramValue> list) {
    StoredValues stored(list);
    const Values values(stored.all());
    for (size_t n = 0; n < rock_winds(values).size(); ++n) {
        const std::string own = fmt::format("winds[{}].direction", n);
        const MarramValue& value = values.at(values.has(own) ? own : "wind.direction");
        if (value.numbers[0] == 0.0 && value.numbers[2] == 0.0)
            throw SceneFault("rock.no_wind", value.place,
                             "the wind's direction has no level part, so that no sand is blown",
                             "give a vector such as [1, 0, 0]");
    }
    double share = 0.0;
    for (const RockWind& wind : rock_winds(values)) share += wind.share;
    if (share == 0.0)
        throw SceneFault("rock.no_share", values.at("winds[0].share").place,
                         "no wind has a share of the time", "give one of them a share above 0");
    if (values.has("level") && values.integer("level") > values.integer("levels"))
        throw SceneFault("rock.level", values.at("level").place,
                         fmt::format("there are {} levels", values.integer("levels")),
                         "raise levels, or lower level");
    if (values.number("transport") == 0.0)
        throw SceneFault("rock.no_sand", values.at("transport").place, "no sand is blown",
                         "give transport above 0");
    const std::string_view mesh = values.text("mesh");
    for (const MarramValue& value : stored.all())
        if (value.text == mesh && (is_list_mesh(value.name, "sand[") || is_list_mesh(value.name, "shelter[")))
            throw SceneFault("rock.mesh_twice", value.place, fmt::format("'{}' is the mesh that wears", mesh),
                             "leave it out here, or name another mesh");
    Digest digest;
    for (const MarramValue& value : list) add_value(digest, value);
    instance.values = std::move(stored);
    instance.values_digest = digest.value();
    instance.begun = false;
}

MarramStatus create_rock(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    if (!can_create(host, out)) return MARRAM_ERROR;
    const MarramHost known = known_part(host);
    return guarded_rock(known, [&] {
        const std::vector<MarramValue> list = values_of(values);
        if (!check_values(known, rock_params(), list)) return MARRAM_ERROR;
        auto instance = std::make_unique<RockInstance>();
        instance->host = known;
        take_rock_values(*instance, list);
        *out = reinterpret_cast<MarramInstance*>(instance.release());
        return MARRAM_OK;
    });
}

MarramStatus update_rock(MarramInstance* opaque, const MarramUpdate* given, uint32_t* changed) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    RockInstance& instance = rock(opaque);
    return guarded_rock(instance.host, [&] {
        if (!given || !changed)
            throw SceneFault("contract.null_update", "", "the update is NULL",
                             "pass an update and a place for the changes");
        const MarramUpdate update = known_part(given);
        const std::vector<MarramValue> list = values_of(update.values);
        if (!check_values(instance.host, rock_params(), list)) return MARRAM_ERROR;
        const uint64_t before = instance.values_digest;
        const std::string mesh(Values(instance.values.all()).text("mesh"));
        take_rock_values(instance, list);
        const Values now(instance.values.all());
        *changed = update.inputs != MARRAM_NOTHING || now.text("mesh") != mesh ||
                           (instance.values_digest != before &&
                            (now.integer("levels") > 0 || !instance.erosion.levels.empty()))
                       ? MARRAM_EVERYTHING
                   : instance.values_digest != before ? MARRAM_ATTRIBUTES
                                                      : MARRAM_NOTHING;
        return MARRAM_OK;
    });
}

// ---- wear ----

// For each vertex the first vertex at the same position.
std::vector<uint32_t> first_at_place(const std::vector<float>& positions) {
    const size_t count = positions.size() / 3;
    std::vector<uint32_t> order(count), first(count);
    std::iota(order.begin(), order.end(), 0U);
    const auto place = [&](uint32_t v) {
        const float* p = positions.data() + 3 * size_t(v);
        return std::array{p[0], p[1], p[2]};
    };
    std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
        const auto pa = place(a), pb = place(b);
        return pa != pb ? pa < pb : a < b;
    });
    for (size_t k = 0; k < count; ++k)
        first[order[k]] = k > 0 && place(order[k]) == place(order[k - 1]) ? first[order[k - 1]] : order[k];
    return first;
}

// Area-weighted quantile of the rate over the worn area.
double rate_of_area(const std::vector<float>& positions, const std::vector<uint32_t>& triangles,
                    const std::vector<float>& rate, double share) {
    std::vector<std::pair<double, double>> areas; // rate, area
    double sum = 0.0;
    for (size_t f = 0; f + 2 < triangles.size(); f += 3) {
        std::array<Vec3d, 3> p;
        double mean = 0.0;
        for (size_t k = 0; k < 3; ++k) {
            const size_t v = triangles[f + k];
            p[k] = Vec3d(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]);
            mean += double(rate[v]) / 3.0;
        }
        const double area = (p[1] - p[0]).cross(p[2] - p[0]).norm();
        if (!(mean > 0.0) || !(area > 0.0)) continue;
        areas.emplace_back(mean, area);
        sum += area;
    }
    std::sort(areas.begin(), areas.end());
    double below = 0.0;
    for (const auto& [mean, area] : areas)
        if ((below += area) >= share * sum) return mean;
    return 0.0;
}

// Bakes a vertex attribute to an image by uv.
std::vector<float> uv_map(const RockInstance& instance, const std::vector<float>& values, int size) {
    std::vector<float> map(size_t(size) * size_t(size), 0.0F);
    std::vector<char> known(map.size(), 0);
    for (size_t f = 0; f + 2 < instance.triangles.size(); f += 3) {
        std::array<Vec2d, 3> p;
        std::array<double, 3> value;
        for (size_t k = 0; k < 3; ++k) {
            const size_t v = instance.triangles[f + k];
            p[k] = Vec2d(instance.uvs[2 * v] * size - 0.5, (1.0 - instance.uvs[2 * v + 1]) * size - 0.5);
            value[k] = values[v];
        }
        const Vec2d a = p[1] - p[0], b = p[2] - p[0];
        const double area = a.x() * b.y() - a.y() * b.x();
        if (!(std::abs(area) > 0.0) || !(std::abs(area) < infinity)) continue;
        const Vec2d low = p[0].cwiseMin(p[1]).cwiseMin(p[2]), high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
        const int j0 = int(std::ceil(std::clamp(low.y(), 0.0, double(size)))),
                  j1 = int(std::floor(std::clamp(high.y(), -1.0, size - 1.0)));
        const int i0 = int(std::ceil(std::clamp(low.x(), 0.0, double(size)))),
                  i1 = int(std::floor(std::clamp(high.x(), -1.0, size - 1.0)));
        for (int j = j0; j <= j1; ++j)
            for (int i = i0; i <= i1; ++i) {
                const Vec2d q = Vec2d(i, j) - p[0];
                const double u = (q.x() * b.y() - q.y() * b.x()) / area,
                             v = (a.x() * q.y() - a.y() * q.x()) / area;
                if (u < -1e-9 || v < -1e-9 || u + v > 1.0 + 1e-9) continue;
                const size_t at = size_t(j) * size_t(size) + size_t(i);
                map[at] = float((1.0 - u - v) * value[0] + u * value[1] + v * value[2]);
                known[at] = 1;
            }
    }
    for (int round = 0; round < 2; ++round) { // dilate the islands
        const std::vector<char> before = known;
        for (int j = 0; j < size; ++j)
            for (int i = 0; i < size; ++i) {
                const size_t at = size_t(j) * size_t(size) + size_t(i);
                if (before[at]) continue;
                float sum = 0.0F;
                int count = 0;
                for (const auto& [x, y] : {std::pair(i - 1, j), {i + 1, j}, {i, j - 1}, {i, j + 1}}) {
                    if (x < 0 || y < 0 || x >= size || y >= size) continue;
                    const size_t beside = size_t(y) * size_t(size) + size_t(x);
                    if (before[beside]) sum += map[beside], ++count;
                }
                if (count > 0) map[at] = sum / float(count), known[at] = 1;
            }
    }
    return map;
}

void make_maps(RockInstance& instance, const Values& values) {
    const int size = values.integer("map");
    if (size > 0 && instance.uvs.empty())
        throw SceneFault("rock.no_uvs", values.at("map").place,
                         fmt::format("the mesh '{}' has no uvs to make a map by", values.text("mesh")),
                         "give the mesh uvs, or leave out map");
    for (size_t k = 0; k < 2; ++k) {
        instance.maps[k] =
            size > 0 ? uv_map(instance, k == 0 ? instance.wear : instance.rate, size) : std::vector<float>();
        MarramGrid& grid = instance.grids[k] = {};
        grid.name = rock_attributes[k].name;
        grid.nx = grid.ny = uint32_t(std::max(size, 1));
        grid.nz = grid.components = 1;
        const double pixel = 1.0 / std::max(size, 1);
        grid.origin[0] = 0.5 * pixel, grid.origin[1] = 1.0 - 0.5 * pixel;
        grid.axes[0][0] = pixel, grid.axes[1][1] = -pixel, grid.axes[2][2] = 1.0;
        grid.values = instance.maps[k].data();
    }
}

uint64_t digest_of_rock(const RockInstance& instance, std::span<const MarramMesh> meshes) {
    Digest digest;
    digest.add(instance.values_digest);
    for (const MarramMesh& mesh : meshes) {
        digest.add(mesh.name ? mesh.name : "")
            .add(mesh.positions[0], 12 * size_t(mesh.vertex_count))
            .add(mesh.triangles, 12 * size_t(mesh.triangle_count));
        if (mesh.normals) digest.add(mesh.normals[0], 12 * size_t(mesh.vertex_count));
        if (mesh.uvs) digest.add(mesh.uvs, 8 * size_t(mesh.vertex_count));
    }
    return digest.value() | 1U;
}

void copy_mesh(RockInstance& instance, const MarramMesh& mesh) {
    const size_t vertices = mesh.vertex_count;
    instance.positions.assign(mesh.positions[0], mesh.positions[0] + 3 * vertices);
    instance.triangles.assign(mesh.triangles, mesh.triangles + 3 * size_t(mesh.triangle_count));
    instance.normals.clear(), instance.uvs.clear();
    if (mesh.normals && mesh.normals[0])
        instance.normals.assign(mesh.normals[0], mesh.normals[0] + 3 * vertices);
    if (mesh.uvs) instance.uvs.assign(mesh.uvs, mesh.uvs + 2 * vertices);
}

struct RockSurroundings {
    RockScenery scenery;
    std::function<bool()> cancelled;
};

RockSurroundings rock_surroundings(const RockInstance& instance, const Values& values,
                                   const MarramFrame& frame, std::span<const MarramMesh> meshes,
                                   const MarramMesh& mesh) {
    RockSurroundings around;
    around.cancelled = [&instance] { return instance.host.cancelled(instance.host.user) != 0; };
    around.scenery.device = frame.device;
    around.scenery.rock_id = mesh.geometry_id;
    around.scenery.winds = rock_winds(values);
    for (const RockWind& wind : around.scenery.winds)
        if (const std::string fault = grain_settings_fault(wind.grains); !fault.empty())
            throw SceneFault("rock.value", values.at("mesh").place, fault, "change that value");
    for (const MarramMesh& other : meshes)
        if (other.geometry_id != mesh.geometry_id && frame.colliders)
            around.scenery.others.emplace_back(other.geometry_id,
                                               rtcGetGeometry(frame.colliders, other.geometry_id));
    for (const MarramValue& value : instance.values.all())
        if (is_list_mesh(value.name, "sand["))
            around.scenery.sand.push_back(rock_mesh_named(meshes, value).geometry_id);
    return around;
}

// Erodes the mesh. false: cancelled.
bool erode_rock(RockInstance& instance, const Values& values, const RockSurroundings& around,
                const MarramMesh& mesh) {
    const double begin = wall_seconds();
    ErosionHooks hooks;
    hooks.cancelled = around.cancelled;
    if (MARRAM_HAS(&instance.host, progress) && instance.host.progress)
        hooks.progress = [&](double share, const std::string& words) {
            instance.host.progress(instance.host.user, share, ("erosion: " + words).c_str());
        };
    try {
        const ErosionSettings settings = rock_erosion_settings(values, mesh);
        instance.erosion = erode({mesh.positions[0], 3 * size_t(mesh.vertex_count)},
                                 {mesh.triangles, 3 * size_t(mesh.triangle_count)}, settings,
                                 grain_wear(around.scenery, around.cancelled), hooks);
        if (instance.erosion.cancelled) return false;
        if (const size_t pieces =
                instance.erosion.levels.empty() ? 0 : instance.erosion.levels.front().pieces)
            send(instance.host, MARRAM_WARNING, "rock.pieces", values.at("mesh").place,
                 fmt::format("the rock has fallen apart, or was {} pieces: the largest is kept", pieces + 1),
                 "give each piece a rock of its own");
        if (instance.erosion.years < settings.years)
            send(instance.host, MARRAM_WARNING, "rock.ended_early", values.at("years").place,
                 fmt::format("erosion ended after {:.3g} of {:.3g} years", instance.erosion.years,
                             settings.years),
                 "lower years, or raise voxel: larger voxels allow longer time steps");
    } catch (const LevelSetError& error) {
        const std::string what = error.what();
        const bool sizes = what.find("voxels") != std::string::npos;
        throw SceneFault("rock.level_set", values.at(sizes && values.has("voxel") ? "voxel" : "mesh").place,
                         sizes ? what.substr(0, what.find(':')) : what,
                         what.find("larger than the rock") != std::string::npos ? "make voxel smaller"
                         : sizes                                                ? "make voxel larger"
                                                                                : "give a closed mesh");
    }
    LevelSet& rock = instance.erosion.levels.back().rock;
    if (rock.mesh().triangles.empty())
        throw SceneFault("rock.nothing_left", values.at("years").place, "the wind wears away all of the rock",
                         "lower years, or make the rock harder");
    instance.positions = rock.mesh().positions;
    instance.normals = rock.mesh().normals;
    instance.triangles = rock.mesh().triangles;
    instance.uvs.clear();
    instance.erosion_seconds = wall_seconds() - begin;
    return true;
}

// Computes the attributes. false: cancelled.
bool wear_rock(RockInstance& instance, const Values& values, const MarramFrame& frame,
               const RockSurroundings& around, const MarramMesh& mesh) {
    const std::vector<uint32_t> first = first_at_place(instance.positions);
    std::vector<double> depth(first.size()), hardness(first.size());
    if (!instance.erosion.levels.empty()) {
        LevelSet& rock = instance.erosion.levels.back().rock;
        instance.report = wear_by_grains(around.scenery, rock.mesh(), 0, depth, around.cancelled);
        blur_over_surface(rock.mesh(), 3, depth);
    } else {
        std::vector<uint32_t> joined(instance.triangles.size());
        std::transform(instance.triangles.begin(), instance.triangles.end(), joined.begin(),
                       [&](uint32_t v) { return first[v]; });
        const WornMesh worn{mesh.geometry_id, instance.positions.data(), instance.positions.size() / 3,
                            joined.data(), joined.size() / 3};
        instance.report = trace_winds(frame.colliders, worn, around.scenery, 0, depth, around.cancelled);
    }
    if (instance.report.cancelled) return false;
    rock_hardness(rock_hardness_settings(values), instance.positions, 0.0, hardness);
    instance.hardness.assign(hardness.begin(), hardness.end());
    instance.rate.resize(first.size()), instance.wear.resize(first.size());
    for (size_t v = 0; v < first.size(); ++v)
        instance.rate[v] = float(1e3 * depth[first[v]] / hardness[v]); // mm
    const double full = values.has("full")
                            ? values.number("full")
                            : rate_of_area(instance.positions, instance.triangles, instance.rate, 0.95);
    for (size_t v = 0; v < first.size(); ++v)
        instance.wear[v] = full > 0.0 ? float(std::min(double(instance.rate[v]) / full, 1.0)) : 0.0F;
    return true;
}

void send_rock_warnings(const RockInstance& instance, const Values& values, const MarramMesh& mesh) {
    const std::string& place = values.at("mesh").place;
    if (mesh.time_count > 1)
        send(instance.host, MARRAM_WARNING, "rock.moves", place,
             fmt::format("the mesh '{}' has motion keys, but worn rock does not move", mesh.name),
             "use a mesh without keys");
    if (instance.report.worn_hits == 0)
        send(instance.host, MARRAM_WARNING, "rock.no_hits", place,
             fmt::format("no grain has hit the mesh '{}'", mesh.name),
             "raise height or paths, or see whether something upwind shelters all of it");
    else if (instance.report.worn == 0)
        send(instance.host, MARRAM_WARNING, "rock.no_wear", place,
             fmt::format("grains hit the mesh '{}', but none above the threshold", mesh.name),
             "raise speed or lower threshold");
}

// Computes the output unless it is up to date. false: cancelled.
bool evaluate_rock(RockInstance& instance, const Values& values, const MarramFrame& frame,
                   std::span<const MarramMesh> meshes) {
    const MarramMesh& mesh = rock_mesh_named(meshes, values.at("mesh"));
    const bool erodes = values.integer("levels") > 0;
    if (!frame.colliders)
        throw SceneFault("contract.no_colliders", "", "MarramFrame.colliders is NULL",
                         "pass the committed scene of all meshes");
    if (erodes && !frame.device)
        throw SceneFault("contract.no_device", "", "MarramFrame.device is NULL", "pass Embree's device");
    if (!erodes) copy_mesh(instance, mesh);
    const uint64_t digest = digest_of_rock(instance, meshes);
    if (digest == instance.digest) return true;
    instance.digest = 0;
    instance.erosion = {};
    const RockSurroundings around = rock_surroundings(instance, values, frame, meshes, mesh);
    if (erodes && !erode_rock(instance, values, around, mesh)) return false;
    if (!wear_rock(instance, values, frame, around, mesh)) return false;
    make_maps(instance, values);
    instance.digest = digest;
    send_rock_warnings(instance, values, mesh);
    return true;
}

MarramStatus prepare_rock(MarramInstance* opaque, const MarramFrame* given, const MarramStates*) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    RockInstance& instance = rock(opaque);
    return guarded_rock(instance.host, [&] {
        std::vector<MarramMesh> meshes;
        const MarramFrame frame = borrowed_frame(given, meshes);
        const Values values(instance.values.all());
        if (values.integer("levels") == 0) return MARRAM_OK; // fast enough for begin
        return evaluate_rock(instance, values, frame, meshes) ? MARRAM_OK : MARRAM_CANCELLED;
    });
}

MarramStatus begin_rock(MarramInstance* opaque, const MarramFrame* given, MarramOutput* out) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    RockInstance& instance = rock(opaque);
    return guarded_rock(instance.host, [&] {
        if (!out)
            throw SceneFault("contract.null_output", "", "the output is NULL", "pass a non-NULL pointer");
        instance.begun = false;
        std::vector<MarramMesh> meshes;
        const MarramFrame frame = borrowed_frame(given, meshes);
        const Values values(instance.values.all());
        if (!evaluate_rock(instance, values, frame, meshes)) return MARRAM_CANCELLED;
        MarramOutput output{};
        output.kind = MARRAM_MESH;
        output.time_count = 1;
        output.vertex_count = uint32_t(instance.positions.size() / 3);
        output.triangle_count = uint32_t(instance.triangles.size() / 3);
        output.has_uvs = instance.uvs.empty() ? 0 : 1;
        output.has_normals = instance.normals.empty() ? 0 : 1;
        output.digest = instance.digest;
        fill_known_part(output, out);
        instance.begun = true;
        return MARRAM_OK;
    });
}

void check_rock_buffers(const RockInstance& instance, const MarramMeshBuffers* buffers) {
    if (!instance.begun) throw SceneFault("contract.no_frame", "", "no frame has begun", "call begin first");
    bool there = buffers && buffers->positions && buffers->positions[0] && buffers->triangles &&
                 (buffers->attribute_count == 0 || (buffers->attributes && buffers->attribute_values));
    for (uint32_t a = 0; there && a < buffers->attribute_count; ++a) {
        if (buffers->attributes[a] >= rock_attributes.size())
            throw SceneFault("contract.attribute_range", "",
                             fmt::format("there is no attribute {}", buffers->attributes[a]),
                             "ask for 0, 1 or 2");
        there = buffers->attribute_values[a] != nullptr;
    }
    if (!there)
        throw SceneFault("contract.null_buffer", "", "a buffer is NULL",
                         "pass positions, triangles and a value buffer for each requested attribute");
}

MarramStatus mesh_rock(MarramInstance* opaque, MarramMeshBuffers* buffers) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    RockInstance& instance = rock(opaque);
    return guarded_rock(instance.host, [&] {
        check_rock_buffers(instance, buffers);
        std::copy(instance.positions.begin(), instance.positions.end(), buffers->positions[0]);
        std::copy(instance.triangles.begin(), instance.triangles.end(), buffers->triangles);
        if (buffers->uvs) std::copy(instance.uvs.begin(), instance.uvs.end(), buffers->uvs);
        if (MARRAM_HAS(buffers, normals) && buffers->normals && buffers->normals[0])
            std::copy(instance.normals.begin(), instance.normals.end(), buffers->normals[0]);
        for (uint32_t a = 0; a < buffers->attribute_count; ++a) {
            const std::array all{&instance.wear, &instance.rate, &instance.hardness};
            const std::vector<float>& values = *all[buffers->attributes[a]];
            std::copy(values.begin(), values.end(), buffers->attribute_values[a]);
        }
        if (!instance.maps[0].empty()) {
            buffers->grids = instance.grids.data();
            buffers->grid_count = uint32_t(instance.grids.size());
            buffers->grid_stride = sizeof(MarramGrid);
        }
        return MARRAM_OK;
    });
}

void report_rock(MarramInstance* opaque, void (*sink)(void*, const char*, double), void* user) {
    if (!opaque || !sink) return;
    const RockInstance& instance = rock(opaque);
    if (!instance.begun) return;
    const GrainReport& r = instance.report;
    sink(user, "rock.grains", double(r.grains));
    sink(user, "rock.rays", double(r.rays));
    sink(user, "rock.hits", double(r.worn_hits));
    sink(user, "rock.volume", r.volume);
    sink(user, "rock.seconds", r.seconds);
    if (instance.erosion.levels.empty()) return;
    int passes = 0;
    for (const ErosionLevel& level : instance.erosion.levels) passes += level.passes;
    sink(user, "rock.erosion_passes", passes);
    sink(user, "rock.erosion_removed",
         instance.erosion.levels.front().start - instance.erosion.levels.back().left);
    sink(user, "rock.erosion_seconds", instance.erosion_seconds);
}

void destroy_rock(MarramInstance* opaque) { delete reinterpret_cast<RockInstance*>(opaque); } // NULL is fine

} // namespace

MarramProcedural rock_procedural() {
    MarramProcedural procedural{};
    procedural.name = "rock";
    procedural.help = "a mesh with what wind-blown sand wears of it";
    procedural.kind = MARRAM_MESH;
    procedural.params = rock_params().data();
    procedural.param_count = uint32_t(rock_params().size());
    procedural.param_stride = sizeof(MarramParam);
    procedural.attributes = rock_attributes.data();
    procedural.attribute_count = uint32_t(rock_attributes.size());
    procedural.attribute_stride = sizeof(MarramAttribute);
    procedural.create = create_rock;
    procedural.begin = begin_rock;
    procedural.mesh = mesh_rock;
    procedural.report = report_rock;
    procedural.destroy = destroy_rock;
    procedural.update = update_rock;
    procedural.prepare = prepare_rock;
    return procedural;
}

std::span<const MarramReportEntry> rock_report_entries() {
    static constexpr std::array entries = {
        MarramReportEntry{"rock.grains", "count", MARRAM_SUM, nullptr, nullptr, "grains of sand traced"},
        MarramReportEntry{"rock.rays", "count", MARRAM_SUM, nullptr, nullptr,
                          "straight segments of their paths"},
        MarramReportEntry{"rock.hits", "count", MARRAM_SUM, nullptr, nullptr, "hits on rock that wears"},
        MarramReportEntry{"rock.volume", "m^3", MARRAM_SUM, nullptr, nullptr, "rock worn in a year"},
        MarramReportEntry{"rock.seconds", "s", MARRAM_SUM, nullptr, nullptr, "tracing grains"},
        MarramReportEntry{"rock.erosion_passes", "count", MARRAM_SUM, nullptr, nullptr,
                          "of erosion, all levels"},
        MarramReportEntry{"rock.erosion_removed", "m^3", MARRAM_SUM, nullptr, nullptr, "rock that is gone"},
        MarramReportEntry{"rock.erosion_seconds", "s", MARRAM_SUM, nullptr, nullptr, "eroding"},
    };
    return entries;
}

} // namespace marram
