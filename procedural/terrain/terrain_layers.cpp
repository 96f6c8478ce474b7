// SPDX-License-Identifier: Apache-2.0
// Builds the stack of layers from scene values.
#include "procedural/terrain/terrain_instance.h"

#include "procedural/abi/border.h"
#include "procedural/wind/wind.h"

#include <fmt/format.h>

namespace marram {

namespace {

constexpr double most_samples = 1e8;

std::string prefix_of(int layer) { return fmt::format("layer[{}].", layer); }

std::vector<DrawnCurve> drawn_curves(const MarramFrame& frame, std::string_view name,
                                     const std::string& place) {
    for (const MarramCurves& curves : known_parts(frame.curves, frame.curves_count, frame.curves_stride))
        if (curves.name && name == curves.name) return marram::drawn_curves(curves);
    throw SceneFault("terrain.no_curves", place, fmt::format("there are no curves '{}'", name),
                     "name those of a [[curves]]");
}

const MarramMesh& mesh_named(std::span<const MarramMesh> meshes, std::string_view name,
                             const std::string& place) {
    for (const MarramMesh& mesh : meshes)
        if (mesh.name && name == mesh.name) return mesh;
    throw SceneFault("terrain.no_mesh", place, fmt::format("there is no mesh '{}'", name),
                     "name one of the scene's");
}

// Digest of all inputs of a layer: its values, the curves and meshes it names, and the inputs that all layers
// share.
uint64_t digest_of_layer(const TerrainInstance& instance, int layer, const MarramFrame& frame,
                         std::span<const MarramMesh> meshes, uint64_t shared, bool with_frame) {
    Digest digest;
    digest.add(shared);
    if (with_frame) digest.add(&frame.frame, sizeof frame.frame);
    const std::string prefix = prefix_of(layer);
    for (const MarramValue& value : instance.values.all()) {
        if (!std::string_view(value.name).starts_with(prefix)) continue;
        digest.add(std::string_view(value.name).substr(prefix.size())).add(value.text);
        digest.add(value.numbers, value.number_count * sizeof(double));
        if (const MarramGrid* grid = value.grid)
            digest.add(grid->nx).add(grid->ny).add(grid->values,
                                                   size_t(grid->nx) * grid->ny * grid->components * 4);
        add_placement(digest, value.placement);
        if (value.type == MARRAM_MESH_NAME) {
            const MarramMesh& mesh = mesh_named(meshes, value.text, value.place);
            digest.add(mesh.positions[0], 12 * size_t(mesh.vertex_count))
                .add(mesh.triangles, 12 * size_t(mesh.triangle_count));
        }
        if (value.type != MARRAM_CURVES_NAME) continue;
        for (const DrawnCurve& curve : drawn_curves(frame, value.text, value.place)) {
            digest.add(uint64_t(curve.closed)).add(curve.points.size());
            for (const Vec3d& p : curve.points) digest.add(p.data(), 3 * sizeof(double));
        }
    }
    return digest.value();
}

const LayerType& type_of(const Values& values, int layer) {
    const MarramValue& type = values.at(prefix_of(layer) + "type");
    if (const LayerType* found = find_layer_type(type.text)) return *found;
    throw SceneFault("terrain.layer_type", type.place, fmt::format("there is no layer type '{}'", type.text),
                     "see marram info terrain");
}

Vec2d wind_of(const Values& values) {
    const Vec3d direction = values.vec3("wind.direction");
    const Vec2d level(direction.x(), direction.z());
    const double length = level.stableNorm();
    if (!(direction.stableNorm() > 0.0))
        throw SceneFault("wind.no_direction", values.at("wind.direction").place,
                         "the wind's direction is zero", "give a vector, such as [1, 0, 0]");
    return length > 0.0 ? Vec2d(level / length) : Vec2d(1.0, 0.0);
}

} // namespace

int layer_count(const Values& values) {
    int count = 0;
    while (values.has(prefix_of(count) + "type")) ++count;
    return count;
}

bool evolves(const Values& values) {
    int found = 0;
    for (int layer = 0; layer < layer_count(values); ++layer) {
        const LayerValues own(values, layer);
        if (!type_of(values, layer).evolves || !own.boolean("on")) continue;
        if (++found > 1)
            throw SceneFault("terrain.two_solvers", own.place("type"), "a terrain has one layer that evolves",
                             "put a second terrain beside it, or take one of them out");
    }
    return found > 0;
}

std::vector<std::string> mask_names(const Values& values) {
    std::vector<std::string> names;
    for (int layer = 0; layer < layer_count(values); ++layer) {
        const LayerType& type = type_of(values, layer);
        const LayerValues own(values, layer);
        if (!type.masks || !own.boolean("on")) continue;
        for (const std::string& name : type.masks(own))
            if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
    return names;
}

Domain read_domain(const Values& values) {
    const Vec2d size(values.at("size").numbers), center(values.at("center").numbers);
    const double cell = values.number("cell");
    const double nx = std::round(size.x() / cell) + 1.0, nz = std::round(size.y() / cell) + 1.0;
    if (!(nx >= 2.0 && nz >= 2.0))
        throw SceneFault("terrain.too_small", values.at("cell").place,
                         fmt::format("the terrain has {:g} x {:g} samples", nx, nz),
                         "make size larger or cell smaller: 2 x 2 is the least");
    if (!(nx * nz <= most_samples))
        throw SceneFault(
            "terrain.too_large", values.at("cell").place,
            fmt::format("the terrain has {:g} x {:g} samples, more than {:g}", nx, nz, most_samples),
            "make cell larger or size smaller");
    Domain domain{int(nx), int(nz), cell, 0.0, 0.0};
    domain.x0 = center.x() - 0.5 * cell * (domain.nx - 1);
    domain.z0 = center.y() - 0.5 * cell * (domain.nz - 1);
    // Vertices are floats: neighbouring samples must stay distinct.
    const double farthest = center.cwiseAbs().maxCoeff() + 0.5 * size.maxCoeff();
    const double step = farthest * double(std::numeric_limits<float>::epsilon());
    if (!(cell > 4.0 * step))
        throw SceneFault(
            "terrain.too_far", values.at("cell").place,
            fmt::format("a vertex {:g} m from the origin is a multiple of {:g} m, a cell is {:g} m", farthest,
                        step, cell),
            "bring the terrain nearer to the origin, or make cell larger");
    return domain;
}

void set_layers(TerrainInstance& instance, const MarramFrame& frame, std::span<const MarramMesh> meshes) {
    const Values values(instance.values.all());
    const Vec2d wind = wind_of(values);
    const auto seed = uint64_t(values.integer("seed"));
    Digest shared;
    const Vec3d direction = values.vec3("wind.direction");
    // Along the ground. A vertical wind blows no sand.
    const double speed = direction.x() != 0.0 || direction.z() != 0.0 ? values.number("wind.speed") : 0.0;
    const bool steady = (direction.x() != 0.0 || direction.z() != 0.0) &&
                        (!values.find("wind.record") || is_given(values, "wind.direction"));
    shared.add(&instance.domain, sizeof(Domain))
        .add(wind.data(), 2 * sizeof(double))
        .add(&speed, sizeof speed)
        .add(uint64_t(steady))
        .add(seed);
    if (const MarramValue* record = values.find("wind.record")) add_value(shared, *record);
    std::vector<StackLayer> layers;
    std::vector<std::string> masks;
    for (int k = 0; k < layer_count(values); ++k) {
        const LayerValues own(values, k);
        if (!own.boolean("on")) continue;
        const LayerType& type = type_of(values, k);
        StackLayer made{type.name, digest_of_layer(instance, k, frame, meshes, shared.value(), type.evolves),
                        nullptr};
        made.layer = instance.stack->find(layers.size(), made.type, made.digest);
        if (!made.layer) {
            LayerContext context{own, instance.domain, wind, seed};
            context.masks = masks;
            const std::shared_ptr<const TerrainLayer> before = instance.stack->find(layers.size(), made.type);
            context.before = before.get();
            context.frame = frame.frame;
            context.wind_speed = speed;
            context.simulation = &instance.simulation;
            context.record = values.find("wind.record");
            context.steady_wind = steady;
            context.scene = frame.colliders;
            context.curves = [&](std::string_view name) {
                return drawn_curves(frame, name, own.place("type"));
            };
            context.mesh = [&](std::string_view name) -> const MarramMesh& {
                return mesh_named(meshes, name, own.place("type"));
            };
            context.warn = [&](const std::string& place, const std::string& what, const std::string& remedy) {
                send(instance.host, MARRAM_WARNING, "terrain.layer", place, what, remedy);
            };
            made.layer = type.make(context);
        }
        for (const std::string& name : made.layer->mask_names()) masks.push_back(name);
        layers.push_back(std::move(made));
    }
    instance.stack->set_layers(std::move(layers));
}

} // namespace marram
