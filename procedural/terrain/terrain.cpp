// SPDX-License-Identifier: Apache-2.0
// terrain: a desert built from a stack of layers.
//
// Model. A terrain is a grid of samples, `cell` metres apart, with bedrock, sand and named masks (fields.h),
// and an ordered list of layers. Each layer is a function of the terrain below it (layer.h). The stack starts
// from flat rock without sand. Its result is the growth surface: grooms grow on it, wind follows it, strands
// collide with it. As in a paint program, order matters; a layer can be switched off, masked and combined
// with what is below. An edit re-evaluates only the affected tiles (stack.h).
//
//     [[curves]]
//     name = "ridge"
//     type = "points"
//     points = [[-30, 0, -8], [-5, 0, 6], [25, 0, -4]]
//
//     [[procedural]]
//     type = "terrain"
//     name = "desert"
//     material = "sand"
//     size = [120, 120]
//     cell = 0.5
//     [[procedural.layer]]
//     type = "noise"                  # rock below
//     amplitude = 2
//     [[procedural.layer]]
//     type = "dune"                   # sand above
//     along = "ridge"
//
// Outputs for grooms, shaders, image layers and bake: the attributes sand (m; negative beside its edge, so that the
// edge can lie between samples: surface.cpp), slope (deg) and every mask, and grids of sand, masks, bedrock and
// height. A ripples layer adds the attributes ripples and ripple_wave
// (ripples.cpp). The uv square covers the terrain, u along +x and v along -z, so that a texture lies as the
// layer "image" reads it.
//
// Cost: one layer takes about 10 ms of one core for 2 * 10^6 samples. Memory: 8 bytes a sample for each layer
// that moves sand.
#include "core/math/clock.h"
#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"
#include "procedural/abi/param.h"
#include "procedural/terrain/surface.h"
#include "procedural/terrain/terrain_instance.h"
#include "procedural/wind/wind.h"

#include <fmt/format.h>

#include <array>
#include <utility>

namespace marram {

const std::vector<MarramParam>& TerrainInstance::params() {
    static const std::vector<MarramParam> params = [] {
        std::vector<MarramParam> list = {
            param::vec2("size", "m", "[100, 100]", 1e-3, 1e6, "extent in x and z, rounded to whole cells"),
            param::vec2("center", "m", "[0, 0]", -1e7, 1e7, "x and z of its middle"),
            param::number("cell", "m", "0.5", 1e-4, 1e4, "distance between samples", "2|1|0.5|0.25|0.125",
                          "seconds.procedural_meshes"),
            param::integer("seed", "", "0", 0, 1e9, "of all its random numbers"),
        };
        add_constant_wind(list);
        list.back().help = "10 m above the ground: what moves the sand of a dune_solver";
        list.push_back(ignored_field_param());
        list.push_back(param::table("wind.record", "none", "time|speed|direction",
                                    "CSV of a measured wind, of a dune_solver whose wind is \"record\""));
        return list;
    }();
    return params;
}

std::span<const MarramItemType> TerrainInstance::item_types() { return layer_item_types(); }

void TerrainInstance::take(std::span<const MarramValue> list) {
    StoredValues stored(list);
    const Values given(stored.all());
    const Domain described = read_domain(given);
    mask_names(given);                 // throws if a layer type is unknown
    const bool blown = evolves(given); // throws if two layers evolve
    if (!stack || !(described == domain)) stack = std::make_unique<Stack>(described);
    domain = described;
    digest = digest_of_values(list);
    values = std::move(stored);
    declare_attributes(*this, Values(values.all()));
    if (blown) tell_of_ignored_fields(host, Values(values.all()), "the sand of a dune_solver is");
    begun = false;
}

uint32_t TerrainInstance::update(std::span<const MarramValue> list, uint32_t inputs) {
    const uint64_t before = digest;
    take(list);
    // Topology counts as changed: the triangle count is constant, but diagonals follow the ridges.
    return digest == before && inputs == MARRAM_NOTHING ? MARRAM_NOTHING : MARRAM_EVERYTHING;
}

namespace {

// ---- outputs ----

void for_rows(const Domain& domain, const auto& body) {
    marram::parallel_for(0, domain.nz, [&](int j) { body(j); });
}

// Updates the heights of the tiles that layers have changed.
void find_heights(TerrainInstance& instance) {
    const Fields fields = instance.stack->fields();
    instance.heights.resize(instance.domain.count());
    const std::vector<Rect> rects = instance.stack->take_changed().rects();
    marram::parallel_for(size_t(0), rects.size(), [&](size_t r) {
        for (int j = rects[r].j0; j < rects[r].j1; ++j)
            for (int i = rects[r].i0; i < rects[r].i1; ++i) {
                const size_t sample = instance.domain.index(i, j);
                instance.heights[sample] = float(fields.height(sample));
            }
    });
}

// Two triangles a cell, split along the diagonal whose ends differ less in height: this keeps ridges and
// valleys intact. If a layer evolves, the diagonals alternate instead: strands keep the triangle of their
// root from frame to frame.
void write_triangles(const TerrainInstance& instance, uint32_t* triangles) {
    const Domain& d = instance.domain;
    const bool evolving = evolves(Values(instance.values.all()));
    const auto nx = uint32_t(d.nx);
    marram::parallel_for(0, d.nz - 1, [&](int j) {
        uint32_t* out = triangles + 6 * size_t(j) * (nx - 1);
        for (uint32_t i = 0; i + 1 < nx; ++i, out += 6) {
            const uint32_t a = uint32_t(j) * nx + i, b = a + 1, c = a + nx, e = c + 1;
            const auto gap = [&](uint32_t p, uint32_t q) {
                return std::abs(instance.heights[p] - instance.heights[q]);
            };
            const bool across = evolving ? (i + uint32_t(j)) % 2 == 0 : gap(b, c) <= gap(a, e);
            const std::array<uint32_t, 6> corners =
                across ? std::array{a, c, b, b, c, e} : std::array{a, c, e, a, e, b};
            std::copy(corners.begin(), corners.end(), out);
        }
    });
}

MarramGrid grid_of(const Domain& d, const std::string& name, const float* values) {
    MarramGrid grid{};
    grid.name = name.c_str();
    grid.nx = uint32_t(d.nx);
    grid.ny = uint32_t(d.nz);
    grid.nz = grid.components = 1;
    grid.origin[0] = d.x0;
    grid.origin[2] = d.z0;
    grid.axes[0][0] = grid.axes[1][2] = d.cell;
    grid.axes[2][1] = 1.0;
    grid.values = values;
    return grid;
}

void list_grids(TerrainInstance& instance) {
    const Fields fields = instance.stack->fields();
    const Domain& d = instance.domain;
    instance.grid_values.assign(1, std::vector<float>(d.count()));
    marram::parallel_for(size_t(0), d.count(), [&](size_t sample) {
        instance.grid_values[0][sample] = float(sand_metres(fields.sand[sample]));
    });
    instance.grid_names = {"height", "bedrock", "sand"};
    for (size_t a = 2; a < first_ripples_attribute(instance); ++a) // masks
        instance.grid_names.push_back(instance.attribute_names[a]);
    std::vector<const float*> values = {instance.heights.data(), fields.bedrock,
                                        instance.grid_values[0].data()};
    for (const float* mask : mask_values(instance, fields)) values.push_back(mask);
    instance.grids.clear();
    for (size_t g = 0; g < values.size(); ++g)
        instance.grids.push_back(grid_of(d, instance.grid_names[g], values[g]));
}

// Brings the layers up to date with the frame. Returns false if cancelled.
bool evaluate_layers(TerrainInstance& instance, const MarramFrame& frame,
                     std::span<const MarramMesh> meshes) {
    try {
        set_layers(instance, frame, meshes);
        const bool whole = instance.stack->evaluate([&] { return instance.cancelled(); });
        for (const Stack::Work& work : instance.stack->work()) instance.evaluated += uint64_t(work.tiles);
        return whole;
    } catch (const std::bad_alloc&) {
        throw SceneFault("terrain.memory", Values(instance.values.all()).at("cell").place,
                         fmt::format("{} layers of {} x {} samples do not fit into memory",
                                     instance.stack->work().size(), instance.domain.nx, instance.domain.nz),
                         "make cell larger or size smaller");
    }
}

// A digest of all that mesh() outputs: of the terrain's values, its layers with their inputs, and the number
// of tiles evaluated so far.
uint64_t digest_of_output(const TerrainInstance& instance) {
    return Digest().add(instance.digest).add(instance.stack->digest()).add(instance.evaluated).value() | 1U;
}

// Sends the warnings of the layers that were just evaluated; those of the other layers have been sent before.
void send_warnings(const TerrainInstance& instance) {
    const std::vector<Stack::Work> work = instance.stack->work();
    for (size_t k = 0; k < work.size(); ++k)
        if (work[k].tiles > 0)
            for (const LayerNotes::Warning& warning : instance.stack->notes(k).warnings)
                send(instance.host, MARRAM_WARNING, "terrain.layer", warning.place, warning.what,
                     warning.remedy);
}

void sum_work(TerrainInstance& instance) {
    instance.work = instance.stack->work();
    const std::vector<Stack::Work> before = std::exchange(instance.prepared_work, {});
    for (size_t k = 0; k < std::min(before.size(), instance.work.size()); ++k) {
        instance.work[k].tiles += before[k].tiles;
        instance.work[k].seconds += before[k].seconds;
    }
}

LayerChange change_of_layer(const TerrainInstance& instance, size_t layer) {
    const Fields below = instance.stack->fields(layer), above = instance.stack->fields(layer + 1);
    LayerChange change;
    if (below.bedrock == above.bedrock && below.sand == above.sand) return change;
    std::vector<LayerChange> rows(size_t(instance.domain.nz));
    for_rows(instance.domain, [&](int j) {
        LayerChange& row = rows[size_t(j)];
        for (int i = 0; i < instance.domain.nx; ++i) {
            const size_t sample = instance.domain.index(i, j);
            row.highest = std::max(row.highest, std::abs(above.height(sample) - below.height(sample)));
            row.sand += above.sand[sample] - below.sand[sample];
        }
    });
    for (const LayerChange& row : rows) {
        change.highest = std::max(change.highest, row.highest);
        change.sand += row.sand;
    }
    return change;
}

double steepest_slope(const TerrainInstance& instance) {
    std::vector<double> rows(size_t(instance.domain.nz));
    for_rows(instance.domain, [&](int j) {
        for (int i = 0; i < instance.domain.nx; ++i)
            rows[size_t(j)] = std::max(rows[size_t(j)], slope_at(instance, i, j));
    });
    return *std::max_element(rows.begin(), rows.end());
}

void update_totals(TerrainInstance& instance) {
    TerrainTotals& sums = instance.sums;
    if (sums.digest == instance.output_digest) return;
    sums.layers.clear();
    for (size_t k = 0; k < instance.stack->work().size(); ++k)
        sums.layers.push_back(change_of_layer(instance, k));
    sums.steepest = steepest_slope(instance);
    sums.digest = instance.output_digest;
}

} // namespace

bool TerrainInstance::prepares() const { return evolves(Values(values.all())); }

// Evaluates the layers with access to stored states. begin() then finds them up to date.
void TerrainInstance::prepare(const LentFrame& lent, const MarramStates* states) {
    if (!states)
        throw SceneFault("contract.null_states", "", "the states are NULL",
                         "pass functions that load and store");
    const double start = wall_seconds();
    struct Lent {
        Simulation& to;
        ~Lent() { to.states = nullptr; }
    } const lent_states{simulation};
    simulation = {&host, states, false};
    const bool whole = evaluate_layers(*this, lent.frame, lent.meshes);
    send_warnings(*this);
    prepared = wall_seconds() - start;
    prepared_work = stack->work();
    if (simulation.failed) throw Reported();
    if (!whole) throw Cancelled();
}

MarramOutput TerrainInstance::begin(const LentFrame& lent) {
    seen = {};
    view.begun = false;
    const double start = wall_seconds();
    const bool whole = evaluate_layers(*this, lent.frame, lent.meshes);
    send_warnings(*this);
    if (!whole) throw Cancelled();
    find_heights(*this);
    output_digest = digest_of_output(*this);
    seconds = wall_seconds() - start + std::exchange(prepared, 0.0);
    sum_work(*this);
    MarramOutput output{};
    output.kind = MARRAM_MESH;
    output.time_count = 1;
    output.vertex_count = uint32_t(domain.count());
    output.triangle_count = uint32_t(2 * size_t(domain.nx - 1) * size_t(domain.nz - 1));
    output.has_uvs = 1;
    output.digest = output_digest;
    return output;
}

void TerrainInstance::mesh(MarramMeshBuffers& buffers) {
    write_vertices(*this, {}, buffers.positions[0], nullptr, buffers.uvs);
    write_triangles(*this, buffers.triangles);
    for (uint32_t a = 0; a < buffers.attribute_count; ++a)
        write_attribute(*this, buffers.attributes[a], {}, buffers.attribute_values[a]);
    list_grids(*this);
    buffers.grids = grids.data();
    buffers.grid_count = uint32_t(grids.size());
    buffers.grid_stride = sizeof(MarramGrid);
}

MarramOutput TerrainInstance::begin_view(const MarramView& given) { return marram::begin_view(*this, given); }

void TerrainInstance::view_mesh(MarramMeshBuffers& buffers) { write_view(*this, buffers); }

void TerrainInstance::report(const ReportSink& sink) {
    update_totals(*this);
    const double area = domain.cell * domain.cell;
    int tiles = 0;
    double sand = 0.0;
    for (size_t k = 0; k < work.size(); ++k) {
        const std::string path = fmt::format("terrain.layer[{}].{}.", k, stack->type(k));
        const LayerChange& change = sums.layers[k];
        tiles += work[k].tiles;
        sand += sand_metres(change.sand) * area;
        sink(path + "highest_change", change.highest);
        sink(path + "sand", sand_metres(change.sand) * area);
        sink(path + "seconds", work[k].seconds);
        for (const auto& [entry, value] : stack->layer(k).report()) sink(path + entry, value);
        for (const auto& [entry, value] : stack->notes(k).numbers) sink(path + entry, value);
    }
    sink("terrain.samples", double(domain.count()));
    sink("terrain.bytes", double(stack->bytes() + heights.size() * sizeof(float)));
    sink("terrain.sand", sand);
    sink("terrain.steepest", sums.steepest);
    sink("terrain.tiles", tiles);
    sink("terrain.seconds", seconds);
}

std::vector<std::string> TerrainInstance::described() const {
    std::vector<std::string> texts;
    for (size_t k = 0; k < stack->work().size(); ++k)
        if (std::string text = stack->layer(k).described(k, stack->fields(k)); !text.empty())
            texts.push_back(std::move(text));
    return texts;
}

std::span<const MarramReportEntry> TerrainInstance::report_entries() {
    static constexpr std::array entries = {
        MarramReportEntry{"terrain.samples", "count", MARRAM_SUM, nullptr, nullptr, "samples of the grids"},
        MarramReportEntry{"terrain.bytes", "bytes", MARRAM_SUM, nullptr, nullptr, "kept by the layers"},
        MarramReportEntry{"terrain.sand", "m^3", MARRAM_SUM, nullptr, nullptr, "volume of sand"},
        MarramReportEntry{"terrain.steepest", "deg", MARRAM_MAXIMUM, nullptr, nullptr, "steepest slope"},
        MarramReportEntry{"terrain.tiles", "count", MARRAM_SUM, nullptr, nullptr,
                          "tiles that layers have evaluated"},
        MarramReportEntry{"terrain.seconds", "s", MARRAM_SUM, nullptr, nullptr, "evaluating the layers"},
        MarramReportEntry{"terrain.layer[].*.highest_change", "m", MARRAM_SUM, nullptr, nullptr,
                          "the largest change of height"},
        MarramReportEntry{"terrain.layer[].*.sand", "m^3", MARRAM_SUM, nullptr, nullptr,
                          "added by the layer"},
        MarramReportEntry{"terrain.layer[].*.seconds", "s", MARRAM_SUM, nullptr, nullptr,
                          "evaluating the layer, simulated frames included"},
        MarramReportEntry{"terrain.layer[].fusion.sweeps", "count", MARRAM_SUM, nullptr, nullptr,
                          "of avalanches"},
        MarramReportEntry{"terrain.layer[].fusion.moved", "m^3", MARRAM_SUM, nullptr, nullptr,
                          "sand that slid"},
        MarramReportEntry{"terrain.layer[].fusion.steepest", "deg", MARRAM_SUM, nullptr, nullptr,
                          "slope left"},
        MarramReportEntry{"terrain.layer[].dune_solver.days", "days", MARRAM_SUM, nullptr, nullptr,
                          "of wind"},
        MarramReportEntry{"terrain.layer[].dune_solver.steps", "count", MARRAM_SUM, nullptr, nullptr,
                          "of time"},
        MarramReportEntry{"terrain.layer[].dune_solver.sand_in", "m^3", MARRAM_SUM, nullptr, nullptr,
                          "that came over the borders"},
        MarramReportEntry{"terrain.layer[].dune_solver.sand_out", "m^3", MARRAM_SUM, nullptr, nullptr,
                          "that left over the borders"},
        MarramReportEntry{"terrain.layer[].dune_solver.sand_airborne", "m^3", MARRAM_SUM, nullptr, nullptr,
                          "in the air at the end"},
        MarramReportEntry{"terrain.layer[].dune_solver.dp", "kg/(m s)", MARRAM_SUM, nullptr, nullptr,
                          "drift potential: mean of the saturated flux"},
        MarramReportEntry{"terrain.layer[].dune_solver.rdp", "kg/(m s)", MARRAM_SUM, nullptr, nullptr,
                          "its resultant: magnitude of the mean vector"},
        MarramReportEntry{"terrain.layer[].dune_solver.wind_directions", "count", MARRAM_SUM, nullptr,
                          nullptr, "of the wind model's tables"},
        MarramReportEntry{"terrain.layer[].dune_solver.obstacle_samples", "count", MARRAM_SUM, nullptr,
                          nullptr, "of the ground that the obstacle covers"},
    };
    return entries;
}

} // namespace marram
