// SPDX-License-Identifier: Apache-2.0
// Computes the output of a rock: the eroded shape, and wear, rate and hardness at its vertices. The head of
// rock.cpp documents them.
#include "core/math/clock.h"
#include "procedural/abi/border.h"
#include "procedural/erosion/rock_instance.h"
#include "procedural/erosion/rock_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {
namespace {

const MarramMesh& rock_mesh_named(std::span<const MarramMesh> meshes, const MarramValue& value) {
    for (const MarramMesh& mesh : meshes)
        if (mesh.name && std::string_view(mesh.name) == value.text) return mesh;
    throw SceneFault("rock.no_mesh", value.place, fmt::format("there is no mesh '{}'", value.text),
                     "name one of the scene's");
}

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

// Of the rock's volume: smaller pieces are not reported.
constexpr double min_piece = 1e-3;

// How far the volume of the first level, before wear, may be from that of the rock, relative to it.
constexpr double most_coarse = 0.1;

// The frame of the first rock that is kept, so that every frame finds it. Its digest tells whether it is the
// rock of that frame: always, if the inputs do not move.
constexpr double before_all_frames = -1e9;

struct RockSurroundings {
    RockScenery scenery;
    std::function<bool()> cancelled;
};

RockSurroundings rock_surroundings(const RockInstance& instance, const Values& values,
                                   const MarramFrame& frame, std::span<const MarramMesh> meshes,
                                   const MarramMesh& mesh) {
    RockSurroundings around;
    around.cancelled = [&instance] { return instance.cancelled(); };
    around.scenery.device = frame.device;
    around.scenery.rock_id = mesh.geometry_id;
    around.scenery.winds = rock_winds(values);
    for (const RockWind& wind : around.scenery.winds)
        if (const std::string fault = grain_settings_fault(wind.grains); !fault.empty())
            throw SceneFault("rock.value", values.at("mesh").place, fault, "change that value");
    for (const MarramMesh& other : meshes)
        if (other.geometry_id != mesh.geometry_id && other.triangle_count > 0)
            around.scenery.others.emplace_back(other.geometry_id,
                                               rtcGetGeometry(frame.colliders, other.geometry_id));
    for (const MarramValue& value : instance.values.all())
        if (is_list_mesh(value.name, "sand["))
            around.scenery.sand.push_back(rock_mesh_named(meshes, value).geometry_id);
    return around;
}

LevelSet erode_rock(RockInstance& instance, const Values& values, const RockSurroundings& around,
                    const MarramMesh& mesh) {
    const double begin = wall_seconds();
    ErosionHooks hooks;
    hooks.cancelled = around.cancelled;
    if (MARRAM_HAS(&instance.host, progress) && instance.host.progress)
        hooks.progress = [&](double share, const std::string& words) {
            instance.host.progress(instance.host.user, share, ("erosion: " + words).c_str());
        };
    ErosionResult result;
    try {
        result = erode({mesh.positions[0], 3 * size_t(mesh.vertex_count)},
                       {mesh.triangles, 3 * size_t(mesh.triangle_count)}, rock_erosion_settings(values, mesh),
                       grain_wear(around.scenery, around.cancelled), hooks);
        if (result.cancelled) throw Cancelled();
    } catch (const LevelSetError& error) {
        const std::string what = error.what();
        const auto says = [&](const char* words) { return what.find(words) != std::string::npos; };
        const bool sizes = says("voxels");
        throw SceneFault("rock.level_set", values.at(sizes && values.has("voxel") ? "voxel" : "mesh").place,
                         sizes ? what.substr(0, what.find(':')) : what,
                         says("larger than the rock")
                             ? "make voxel smaller, lower levels, or give a mesh with a volume"
                         : says("origin") ? "move the rock nearer to the origin, or make voxel larger"
                         : sizes          ? "make voxel larger"
                                          : "give a closed mesh");
    }
    LevelSet& rock = result.levels.back().rock;
    if (rock.mesh().triangles.empty())
        throw SceneFault("rock.nothing_left", values.at("years").place, "the wind wears away all of the rock",
                         "lower years, or make the rock harder");
    instance.positions = rock.mesh().positions;
    instance.normals = rock.mesh().normals;
    instance.triangles = rock.mesh().triangles;
    instance.uvs.clear();
    instance.erosion = {};
    for (const ErosionLevel& level : result.levels) {
        instance.erosion.passes += level.passes;
        if (level.start - level.removed - level.left > min_piece * result.given)
            instance.erosion.pieces += level.pieces;
    }
    instance.erosion.removed = result.given - result.levels.back().left;
    if (result.given > 0.0) instance.erosion.coarse = result.levels.front().start / result.given;
    instance.erosion.years = result.years;
    instance.erosion.seconds = wall_seconds() - begin;
    return std::move(rock);
}

// Computes the attributes. `eroded`: the rock, if it is eroded.
void wear_rock(RockInstance& instance, const Values& values, const MarramFrame& frame,
               const RockSurroundings& around, const MarramMesh& mesh, std::optional<LevelSet>& eroded) {
    const std::vector<uint32_t> first = first_at_place(instance.positions);
    std::vector<double> depth(first.size()), hardness(first.size());
    if (eroded) {
        instance.grains = wear_by_grains(around.scenery, eroded->mesh(), 0, depth, around.cancelled);
        blur_over_surface(eroded->mesh(), 3, depth);
    } else {
        std::vector<uint32_t> joined(instance.triangles.size());
        std::transform(instance.triangles.begin(), instance.triangles.end(), joined.begin(),
                       [&](uint32_t v) { return first[v]; });
        const WornMesh worn{mesh.geometry_id, instance.positions.data(), instance.positions.size() / 3,
                            joined.data(), joined.size() / 3};
        instance.grains = trace_winds(frame.colliders, worn, around.scenery, 0, depth, around.cancelled);
    }
    if (instance.grains.cancelled) throw Cancelled();
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
}

bool below(const MarramMesh& mesh, double height) {
    for (size_t c = 0; c < 3 * size_t(mesh.triangle_count); ++c)
        if (double(mesh.positions[0][3 * size_t(mesh.triangles[c]) + 1]) > height) return false;
    return true;
}

void send_rock_warnings(const RockInstance& instance, const Values& values, const MarramMesh& mesh) {
    const std::string& place = values.at("mesh").place;
    if (instance.eroded && instance.erosion.pieces > 0)
        send(instance.host, MARRAM_WARNING, "rock.pieces", place,
             "the rock has fallen apart, or was several pieces: the largest is kept",
             "give each piece a rock of its own");
    if (instance.eroded && std::abs(instance.erosion.coarse - 1.0) > most_coarse) {
        const ErosionSettings settings = rock_erosion_settings(values, mesh);
        send(instance.host, MARRAM_WARNING, "rock.coarse",
             values.at(values.has("voxel") ? "voxel" : "levels").place,
             fmt::format(
                 "the first of {} levels has voxels of {:.3g} m, and {:.0f} % of the rock's volume: what it "
                 "loses is lost on all levels",
                 settings.levels, std::ldexp(settings.voxel, settings.levels - 1),
                 100.0 * instance.erosion.coarse),
             "lower levels, or make voxel smaller");
    }
    if (const double years = rock_erosion_settings(values, mesh).years;
        instance.eroded && instance.erosion.years < years)
        send(instance.host, MARRAM_WARNING, "rock.ended_early", values.at("years").place,
             fmt::format("erosion ended after {:.3g} of {:.3g} years", instance.erosion.years, years),
             "lower years, or raise voxel: larger voxels allow longer time steps");
    if (mesh.time_count > 1)
        send(instance.host, MARRAM_WARNING, "rock.moves", place,
             fmt::format("the mesh '{}' has motion keys, but worn rock does not move", mesh.name),
             "use a mesh without keys");
    const GrainSettings grains = rock_winds(values)[0].grains;
    const double bed_speed = values.number("bed_speed");
    if (bed_speed > grains.speed && bed_speed > default_bed_speed)
        send(instance.host, MARRAM_WARNING, "rock.bed_speed", values.at("bed_speed").place,
             fmt::format("{:g} m/s is more than the grains' speed, {:g} m/s, which is taken", bed_speed,
                         grains.speed),
             "lower bed_speed, or raise speed");
    if (!values.has("speed") && values.number("wind.speed") > grains.speed)
        send(instance.host, MARRAM_WARNING, "rock.wind_speed", values.at("wind.speed").place,
             fmt::format("grains are taken to fly at {:g} m/s, not at the wind's {:g}", grains.speed,
                         values.number("wind.speed")),
             "lower the wind's speed, or give the rock a speed of its own");
    if (grains.speed <= 0.0)
        send(instance.host, MARRAM_WARNING, "rock.calm",
             values.at(values.has("speed") ? "speed" : "wind.speed").place,
             fmt::format("grains have no speed, so that none hits the mesh '{}'", mesh.name),
             "give the wind a speed, or the rock a speed above 0");
    else if (instance.grains.worn_hits == 0 && grains.ground && below(mesh, *grains.ground))
        send(instance.host, MARRAM_WARNING, "rock.buried", values.at("sand_level").place,
             fmt::format("all of the mesh '{}' is below the sand", mesh.name),
             "lower sand_level, or raise the mesh");
    else if (instance.grains.worn_hits == 0)
        send(instance.host, MARRAM_WARNING, "rock.no_hits", place,
             fmt::format("no grain has hit the mesh '{}'", mesh.name),
             "raise height or paths, or see whether something upwind shelters all of it");
    else if (instance.grains.worn == 0)
        send(instance.host, MARRAM_WARNING, "rock.no_wear", place,
             fmt::format("grains hit the mesh '{}', but none above the threshold", mesh.name),
             "raise speed or lower threshold");
}

} // namespace

void evaluate_rock(RockInstance& instance, const Values& values, const MarramFrame& frame,
                   std::span<const MarramMesh> meshes, const MarramStates* states) {
    const MarramMesh& mesh = rock_mesh_named(meshes, values.at("mesh"));
    const bool erodes = values.integer("levels") > 0;
    if (!frame.colliders)
        throw SceneFault("contract.no_colliders", "", "MarramFrame.colliders is NULL",
                         "pass the committed scene of the frame's meshes");
    if (erodes && !frame.device)
        throw SceneFault("contract.no_device", "", "MarramFrame.device is NULL", "pass Embree's device");
    if (!erodes) copy_mesh(instance, mesh);
    const uint64_t digest = digest_of_rock(instance, meshes);
    if (digest == instance.digest) return;
    instance.digest = 0;
    instance.eroded = false;
    MarramState kept{};
    kept.size = sizeof kept;
    if (!erodes) states = nullptr; // fast enough without
    if (states && states->load(states->user, frame.frame, &kept) != MARRAM_OK) throw Reported();
    if (!kept.data ||
        !read_rock_state({static_cast<const char*>(kept.data), kept.byte_count}, digest, instance)) {
        const RockSurroundings around = rock_surroundings(instance, values, frame, meshes, mesh);
        std::optional<LevelSet> eroded;
        if (erodes) eroded = erode_rock(instance, values, around, mesh);
        wear_rock(instance, values, frame, around, mesh, eroded);
        instance.eroded = erodes;
        if (states) {
            const std::vector<char> bytes = write_rock_state(instance, digest);
            const MarramState state{sizeof(MarramState), kept.data ? frame.frame : before_all_frames,
                                    bytes.data(), bytes.size()};
            if (states->store(states->user, &state) != MARRAM_OK) throw Reported();
        }
    }
    make_rock_maps(instance, values); // of an eroded rock: none
    instance.digest = digest;
    send_rock_warnings(instance, values, mesh);
}

} // namespace marram
