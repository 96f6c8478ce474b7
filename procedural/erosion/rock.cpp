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
// and share the time; two winds make a keel. The output mesh has no uvs. A host keeps the result as a state,
// so that further frames and later runs do not erode again.
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
// is v = 1. A pixel takes the value of the triangle at its centre, the greatest if there are several; two
// pixels around each island are filled with the mean of their neighbours. uvs are within 0 to 1.
//
// Cost: about a million rays per second and core; a grain takes 2 to 10, more in cavities. The noise at a
// vertex falls with the square root of the number of grains that hit its triangles.
#include "procedural/abi/border.h"
#include "procedural/erosion/rock_instance.h"
#include "procedural/erosion/rock_values.h"
#include "procedural/wind/field/placed_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {

// Checks combinations of valid values and stores them in the instance.
void RockInstance::take(std::span<const MarramValue> list) {
    StoredValues stored(list);
    const Values given(stored.all());
    for (size_t n = 0; n < rock_winds(given).size(); ++n) {
        const std::string own = fmt::format("winds[{}].direction", n);
        const MarramValue& value = given.at(given.has(own) ? own : "wind.direction");
        if (value.numbers[0] == 0.0 && value.numbers[2] == 0.0)
            throw SceneFault("rock.no_wind", value.place,
                             "the wind's direction has no level part, so that no sand is blown",
                             "give a vector such as [1, 0, 0]");
    }
    double share = 0.0;
    for (const RockWind& wind : rock_winds(given)) share += wind.share;
    if (share == 0.0)
        throw SceneFault("rock.no_share", given.at("winds[0].share").place, "no wind has a share of the time",
                         "give one of them a share above 0");
    if (given.has("level") && given.integer("level") > given.integer("levels"))
        throw SceneFault("rock.level", given.at("level").place,
                         fmt::format("there are {} levels", given.integer("levels")),
                         "raise levels, or lower level");
    if (given.integer("map") > 0 && given.integer("levels") > 0)
        throw SceneFault("rock.no_uvs", given.at("map").place, "an eroded rock has no uvs to make a map by",
                         "remove map, or set levels = 0");
    if (given.number("transport") == 0.0)
        throw SceneFault("rock.no_sand", given.at("transport").place, "no sand is blown",
                         "give transport above 0");
    const std::string_view worn = given.text("mesh");
    for (const MarramValue& value : stored.all())
        if (value.text == worn && (is_list_mesh(value.name, "sand[") || is_list_mesh(value.name, "shelter[")))
            throw SceneFault("rock.mesh_twice", value.place, fmt::format("'{}' is the mesh that wears", worn),
                             "leave it out here, or name another mesh");
    values_digest = digest_of_values(list);
    values = std::move(stored);
    tell_of_ignored_fields(host, Values(values.all()), "the grains that wear rock are");
    begun = false;
}

uint32_t RockInstance::update(std::span<const MarramValue> list, uint32_t inputs) {
    const uint64_t before = values_digest;
    const std::string worn(Values(values.all()).text("mesh"));
    take(list);
    const Values now(values.all());
    const bool differs = values_digest != before;
    if (inputs != MARRAM_NOTHING || now.text("mesh") != worn ||
        (differs && (now.integer("levels") > 0 || eroded)))
        return MARRAM_EVERYTHING;
    return differs ? MARRAM_ATTRIBUTES : MARRAM_NOTHING;
}

bool RockInstance::prepares() const {
    return Values(values.all()).integer("levels") > 0;
} // else begin() is fast enough

void RockInstance::prepare(const LentFrame& lent, const MarramStates* states) {
    begun = false; // the buffers of the last frame may be too small
    evaluate_rock(*this, Values(values.all()), lent.frame, lent.meshes, states);
}

MarramOutput RockInstance::begin(const LentFrame& lent) {
    evaluate_rock(*this, Values(values.all()), lent.frame, lent.meshes, nullptr);
    MarramOutput output{};
    output.kind = MARRAM_MESH;
    output.time_count = 1;
    output.vertex_count = uint32_t(positions.size() / 3);
    output.triangle_count = uint32_t(triangles.size() / 3);
    output.has_uvs = uvs.empty() ? 0 : 1;
    output.has_normals = normals.empty() ? 0 : 1;
    output.digest = digest;
    return output;
}

void RockInstance::mesh(MarramMeshBuffers& buffers) {
    std::ranges::copy(positions, buffers.positions[0]);
    std::ranges::copy(triangles, buffers.triangles);
    if (buffers.uvs) std::ranges::copy(uvs, buffers.uvs);
    if (MARRAM_HAS(&buffers, normals) && buffers.normals && buffers.normals[0])
        std::ranges::copy(normals, buffers.normals[0]);
    for (uint32_t a = 0; a < buffers.attribute_count; ++a) {
        const std::array all{&wear, &rate, &hardness};
        std::ranges::copy(*all[buffers.attributes[a]], buffers.attribute_values[a]);
    }
    if (maps[0].empty()) return;
    buffers.grids = grids.data();
    buffers.grid_count = uint32_t(grids.size());
    buffers.grid_stride = sizeof(MarramGrid);
}

void RockInstance::report(const ReportSink& sink) const {
    sink("rock.grains", double(grains.grains));
    sink("rock.rays", double(grains.rays));
    sink("rock.hits", double(grains.worn_hits));
    sink("rock.volume", grains.volume);
    sink("rock.seconds", grains.seconds);
    if (!eroded) return;
    sink("rock.erosion_passes", double(erosion.passes));
    sink("rock.erosion_removed", erosion.removed);
    sink("rock.erosion_seconds", erosion.seconds);
}

} // namespace marram
