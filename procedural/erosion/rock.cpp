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
// and share the time; two winds make a keel. The output mesh has no uvs. A host keeps the result as a state, so
// that further frames and later runs do not erode again.
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
// is v = 1. A pixel takes the value of the triangle at its centre, the greatest if there are several; two pixels around
// each island are filled with the mean of their neighbours. uvs are within 0 to 1.
//
// Cost: about a million rays per second and core; a grain takes 2 to 10, more in cavities. The noise at a vertex falls
// with the square root of the number of grains that hit its triangles.
#include "procedural/erosion/rock.h"

#include "procedural/border.h"
#include "procedural/erosion/rock_instance.h"
#include "procedural/erosion/rock_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {
namespace {

RockInstance& rock(MarramInstance* instance) { return *reinterpret_cast<RockInstance*>(instance); }

template <typename Body>
MarramStatus guarded_rock(const MarramHost& host, Body&& body) {
    return guarded(host, "rock", "make voxel larger, use a mesh of fewer triangles, or a smaller map", std::forward<Body>(body));
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
    if (values.integer("map") > 0 && values.integer("levels") > 0)
        throw SceneFault("rock.no_uvs", values.at("map").place, "an eroded rock has no uvs to make a map by",
                         "remove map, or set levels = 0");
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
        return create_instance<RockInstance>(known, values, out, rock_params(), take_rock_values);
    });
}

MarramStatus update_rock(MarramInstance* opaque, const MarramUpdate* given, uint32_t* changed) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    RockInstance& instance = rock(opaque);
    return guarded_rock(instance.host, [&] {
        const auto take = [&](std::span<const MarramValue> list, uint32_t inputs) -> uint32_t {
            const uint64_t before = instance.values_digest;
            const std::string mesh(Values(instance.values.all()).text("mesh"));
            take_rock_values(instance, list);
            const Values now(instance.values.all());
            const bool differs = instance.values_digest != before;
            if (inputs != MARRAM_NOTHING || now.text("mesh") != mesh ||
                (differs && (now.integer("levels") > 0 || instance.eroded)))
                return MARRAM_EVERYTHING;
            return differs ? MARRAM_ATTRIBUTES : MARRAM_NOTHING;
        };
        return update_instance(instance.host, given, changed, rock_params(), take);
    });
}

MarramStatus prepare_rock(MarramInstance* opaque, const MarramFrame* given, const MarramStates* states) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    RockInstance& instance = rock(opaque);
    return guarded_rock(instance.host, [&] {
        std::vector<MarramMesh> meshes;
        const MarramFrame frame = borrowed_frame(given, meshes);
        const Values values(instance.values.all());
        if (values.integer("levels") == 0) return MARRAM_OK; // fast enough for begin
        instance.begun = false; // the buffers of the last frame may be too small
        if (!states) return evaluate_rock(instance, values, frame, meshes, nullptr);
        if (!states->load || !states->store)
            throw SceneFault("contract.null_states", "", "the states are NULL",
                             "pass functions that load and store");
        const MarramStates known = known_part(states);
        return evaluate_rock(instance, values, frame, meshes, &known);
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
        if (const MarramStatus status = evaluate_rock(instance, values, frame, meshes, nullptr);
            status != MARRAM_OK)
            return status;
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
    if (buffers) check_size(buffers);
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
    if (!instance.eroded) return;
    sink(user, "rock.erosion_passes", double(instance.erosion.passes));
    sink(user, "rock.erosion_removed", instance.erosion.removed);
    sink(user, "rock.erosion_seconds", instance.erosion.seconds);
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
        MarramReportEntry{"rock.erosion_removed", "m^3", MARRAM_SUM, nullptr, nullptr, "rock that is gone, of what was given"},
        MarramReportEntry{"rock.erosion_seconds", "s", MARRAM_SUM, nullptr, nullptr, "eroding"},
    };
    return entries;
}

} // namespace marram
