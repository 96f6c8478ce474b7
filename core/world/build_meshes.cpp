// SPDX-License-Identifier: Apache-2.0
// Builds the meshes of a frame: the scene's, growth surfaces made by procedurals, and their render meshes.
#include "core/world/build_state.h"

#include "core/geometry/embree_buffer.h"
#include "core/math/digest.h"
#include "core/math/known_part.h"
#include "core/world/lent_geometry.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// NaN fails every comparison.
bool in_embree_range(const Vec3f& p) { return (p.array().abs() < float(embree_limit)).all(); }

MeshGeometry place_mesh(const SceneMesh& source, const std::vector<double>& times, double frame) {
    const Mesh& object = source.object().mesh;
    MeshGeometry mesh{source.name, source.material, source.light, {}, {}, {}, {}};
    mesh.triangles.reserve(object.triangles.size() + 2);
    mesh.triangles = object.triangles;
    mesh.uvs = object.uvs;
    if (source.to_world(frame).linear().determinant() < 0.0)
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    for (const double time : times) {
        mesh.positions.push_back(source.positions_at(time));
        if (!object.normals.empty()) mesh.normals.push_back(source.normals_at(time));
    }
    // A transform can move a valid mesh out of range.
    for (const auto& positions : mesh.positions)
        for (const Vec3f& p : positions)
            if (!in_embree_range(p))
                throw InputError({source.name}, "the mesh's transform moves it beyond 1e18 m",
                                 "use smaller translations and scales");
    mesh.roles = source.roles;
    mesh.shadow_catcher = source.shadow_catcher;
    return mesh;
}

uint64_t topology_of(const MeshGeometry& mesh) {
    return Digest()
        .add(mesh.positions[0].size())
        .add(mesh.triangles.data(), 12 * mesh.triangles.size())
        .value();
}

// Places a mesh of the scene. One that does not move is reused from the previous frame.
MeshGeometry place_mesh(Build& build, const SceneMesh& mesh) {
    const auto id = uint32_t(build.world.meshes.size());
    const uint64_t digest = mesh.moves() ? 0 : mesh.digest() | 1U;
    if (std::optional<MeshGeometry> kept = build.kept.take_growth_surface(id, digest, mesh.roles)) {
        build.reused_meshes[id] = true;
        return *std::move(kept);
    }
    const BuildSettings& settings = build.settings;
    const double open = build.open(), close = build.close();
    const bool moves = open < close && mesh.moves_within(open, close);
    uint32_t keys = std::max(settings.motion_keys, 2U);
    if (build.chooses_keys()) keys = motion_keys_for(mesh, settings.tolerance, settings.view, open, close);
    if (moves) {
        const double error = motion_error(mesh, settings.view, keys, open, close);
        build.stats.mesh_motion_error = std::max(build.stats.mesh_motion_error, error);
        build.stats.motion_keys = std::max(build.stats.motion_keys, keys);
        if (build.chooses_keys()) build.stats.chosen[mesh.name + ".motion_keys"] = keys;
        if (build.chooses_keys() && error > settings.tolerance)
            build.stats.warnings.push_back(
                {{},
                 fmt::format("mesh '{}' moves so fast that {} motion keys are off by {:.3g} m, the tolerance "
                             "is {:.3g} m",
                             mesh.name, keys, error, settings.tolerance),
                 "shorten camera.shutter, or give more tolerance",
                 "mesh.motion"});
    }
    const auto outward = [&](double frame) { return mesh.to_world(frame).linear().determinant() > 0.0; };
    if (moves && outward(open) != outward(close))
        build.stats.warnings.push_back(
            {{},
             fmt::format(
                 "the scale of mesh '{}' changes sign while the shutter is open: normals and emission "
                 "are those at the frame",
                 mesh.name),
             "keep the signs of its scale",
             "mesh.mirrored"});
    MeshGeometry placed = place_mesh(mesh, moves ? build.times(keys) : std::vector{open}, settings.frame);
    placed.topology = topology_of(placed);
    placed.digest = digest;
    return placed;
}

// ---- meshes made by procedurals --------------------------------------------------------------------------

bool all_finite(const std::vector<float>& values) {
    return std::ranges::all_of(values, [](float value) { return std::isfinite(value); });
}

void check_mesh(const Procedural& procedural, const MeshGeometry& mesh) {
    constexpr float unit = 1e-3F; // tolerance for the length, enough for shading
    for (const auto& normals : mesh.normals)
        for (const Vec3f& n : normals)
            if (!(std::abs(n.norm() - 1.0F) < unit))
                procedural.refuse("a normal of its mesh is not of unit length", "fix the library");
    for (const auto& positions : mesh.positions)
        for (const Vec3f& p : positions)
            if (!in_embree_range(p))
                procedural.refuse("a vertex of its mesh is not a number below 1e18", "fix the library");
    for (const auto& triangle : mesh.triangles)
        for (const uint32_t vertex : triangle)
            if (vertex >= mesh.positions[0].size())
                procedural.refuse("a triangle of its mesh names a vertex that is not there",
                                  "fix the library");
    for (const AttributeValues& attribute : mesh.attributes)
        if (!all_finite(attribute.values))
            procedural.refuse("a value of its attribute '" + attribute.name + "' is not a finite number",
                              "fix the library");
}

GridValues copy_grid(const Procedural& procedural, const MarramGrid& grid) {
    if (!grid.name || !grid.values || grid.nx == 0 || grid.ny == 0 || grid.nz == 0 || grid.components == 0 ||
        grid.components > 4)
        procedural.refuse("it hands over a grid without a name or values", "fix the library");
    const double most = 4e9; // values: 16 GB
    if (double(grid.nx) * grid.ny * grid.nz * grid.components > most)
        procedural.refuse(std::string("its grid '") + grid.name + "' has more than 4e9 values",
                          "make it coarser");
    const size_t count = size_t(grid.nx) * grid.ny * grid.nz * grid.components;
    GridValues copy{grid.name, grid, {grid.values, grid.values + count}};
    if (!all_finite(copy.values))
        procedural.refuse("a value of its grid '" + copy.name + "' is not a finite number",
                          "fix the library");
    return copy;
}

// Lets a procedural fill a mesh by mesh() or view_mesh(), and checks the result.
void fill_mesh(Procedural& procedural, const MarramOutput& output, MeshGeometry& mesh,
               void (Procedural::*fill)(MarramMeshBuffers&)) {
    std::vector<float*> positions;
    for (uint32_t t = 0; t < output.time_count; ++t) {
        mesh.positions.push_back(embree_buffer<Vec3f>(output.vertex_count));
        positions.push_back(components(mesh.positions.back()));
    }
    std::vector<float*> normals;
    for (uint32_t t = 0; output.has_normals && t < output.time_count; ++t) {
        mesh.normals.emplace_back(output.vertex_count);
        normals.push_back(components(mesh.normals.back()));
    }
    mesh.triangles = embree_buffer<std::array<uint32_t, 3>>(output.triangle_count);
    if (output.has_uvs) mesh.uvs.resize(output.vertex_count);
    std::vector<uint32_t> asked;
    std::vector<float*> values;
    const std::vector<MarramAttribute>& attributes = procedural.attributes();
    for (uint32_t a = 0; a < attributes.size(); ++a) {
        const MarramAttribute& attribute = attributes[a];
        if ((attribute.rate != MARRAM_PER_VERTEX && attribute.rate != MARRAM_PER_FACE) ||
            attribute.components < 1 || attribute.components > 4)
            procedural.refuse(
                fmt::format("its attribute '{}' is not 1 to 4 floats a vertex or face", attribute.name),
                "fix the library");
        const size_t count = attribute.rate == MARRAM_PER_FACE ? output.triangle_count : output.vertex_count;
        asked.push_back(a);
        mesh.attributes.push_back({attribute.name, attribute.components, attribute.rate,
                                   std::vector<float>(count * attribute.components), attribute.discrete != 0,
                                   attribute.animated != 0});
        values.push_back(mesh.attributes.back().values.data());
    }
    MarramMeshBuffers buffers{};
    buffers.size = sizeof buffers;
    buffers.positions = positions.data();
    buffers.triangles = components(mesh.triangles);
    buffers.uvs = output.has_uvs ? components(mesh.uvs) : nullptr;
    buffers.attribute_count = uint32_t(asked.size());
    buffers.attributes = asked.data();
    buffers.attribute_values = values.data();
    buffers.grid_stride = sizeof(MarramGrid);
    buffers.normals = output.has_normals ? normals.data() : nullptr;
    (procedural.*fill)(buffers);
    for (const MarramGrid& grid : known_parts(buffers.grids, buffers.grid_count, buffers.grid_stride))
        mesh.grids.push_back(copy_grid(procedural, grid));
    check_mesh(procedural, mesh);
    if (!output.has_normals)
        for (const auto& positions_at : mesh.positions)
            mesh.normals.push_back(vertex_normals(positions_at, mesh.triangles));
    mesh.topology = topology_of(mesh);
}

// MeshGeometry::digest of a procedural's mesh: unique to this instance. 0 if the mesh moves or has no
// digest.
uint64_t digest_of(const Procedural& procedural, const MarramOutput& output) {
    if (output.digest == 0 || output.time_count != 1) return 0;
    return Digest().add(procedural.instance_number()).add(output.digest).value() | 1U;
}

// Largest distance, half-way between motion samples, of the interpolated mesh from the procedural's pose(),
// enlarged by the view.
double pose_error(const Build& build, Procedural& procedural, const MeshGeometry& mesh,
                  const std::vector<double>& times) {
    double most = 0.0;
    std::vector<Vec3f> there(mesh.positions[0].size());
    for (size_t t = 0; t + 1 < times.size() && t + 1 < mesh.positions.size(); ++t) {
        procedural.pose(0.5 * (times[t] + times[t + 1]), components(there));
        for (size_t v = 0; v < there.size(); ++v) {
            const Vec3d between =
                0.5 * (mesh.positions[t][v].cast<double>() + mesh.positions[t + 1][v].cast<double>());
            const Vec3d p = there[v].cast<double>();
            const double gap = (p - between).norm();
            if (gap > most) most = std::max(most, gap * build.settings.view.enlarged(p));
        }
    }
    return most;
}

} // namespace

MarramView view_of(const Build& build, const CameraSamples& camera) {
    MarramView view{};
    view.size = sizeof view;
    view.frame = build.settings.frame;
    view.time_count = uint32_t(camera.times.size());
    view.times = camera.times.data();
    view.positions = camera.positions[0].data();
    view.directions = camera.directions[0].data();
    view.ups = camera.ups[0].data();
    view.fov = camera.fov;
    view.width = camera.width;
    view.height = camera.height;
    const View& seen = build.settings.view;
    if (seen.reference_depth > 0.0) // convert a tolerance in pixels back from metres
        view.tolerance_pixels = build.settings.tolerance / (seen.pixel_angle * seen.reference_depth);
    else
        view.tolerance = build.settings.tolerance;
    return view;
}

void place_meshes(Build& build) {
    for (const SceneMesh& mesh : build.geometry.meshes) {
        if (build.cancel.load()) throw Cancelled{};
        build.reused_meshes.push_back(false);
        build.world.meshes.push_back(place_mesh(build, mesh));
        build.mesh_procedurals.push_back(nullptr);
    }
    build.mesh_ids.resize(build.geometry.procedurals.size());
    for (size_t i = 0; i < build.geometry.procedurals.size(); ++i) {
        Procedural& procedural = *build.geometry.procedurals[i];
        if (procedural.kind() != MARRAM_MESH) continue;
        build.mesh_ids[i] = uint32_t(build.world.meshes.size());
        build.mesh_procedurals.push_back(&procedural);
        build.reused_meshes.push_back(false);
        MeshGeometry& mesh = build.world.meshes.emplace_back();
        mesh.name = procedural.name();
        mesh.material = procedural.material;
        mesh.roles = procedural.roles;
    }
    build.mesh_geometries.resize(build.world.meshes.size());
}

void make_mesh(Build& build, Procedural& procedural, uint32_t id) {
    uint32_t keys = build.open() < build.close() ? std::max(build.settings.motion_keys, 2U) : 1;
    while (true) {
        const std::vector<double> times = build.times(keys);
        const auto lent = build.lent.emplace_back(std::make_shared<LentGeometry>(build, procedural, times));
        if (procedural.prepares()) prepare(build, procedural, lent->frame());
        take_warnings(build.stats, procedural); // of the preparation, which is not repeated
        build.progress.phase = "making meshes";
        const MarramOutput output = procedural.begin(lent->frame());
        if (output.time_count != 1 && output.time_count != times.size())
            procedural.refuse("its number of motion samples is not the requested one", "fix the library");
        if (output.time_count > 1 && !procedural.has_pose())
            procedural.refuse("its mesh moves, but it has no function pose()", "fix the library");
        const uint64_t digest = digest_of(procedural, output);
        if (std::optional<MeshGeometry> kept = build.kept.take_growth_surface(id, digest, procedural.roles)) {
            build.world.meshes[id] = *std::move(kept);
            build.reused_meshes[id] = true;
            break;
        }
        MeshGeometry mesh = build.world.meshes[id];
        fill_mesh(procedural, output, mesh, &Procedural::mesh);
        mesh.digest = digest;
        const bool moves = output.time_count > 1;
        const double left = moves ? pose_error(build, procedural, mesh, times) : 0.0;
        if (build.chooses_keys() && left > build.settings.tolerance && 2 * keys - 1 <= max_motion_keys) {
            keys = 2 * keys - 1;
            build.lent.pop_back();
            take_warnings(build.stats, procedural); // of what the next pass does not repeat
            continue;
        }
        if (moves) {
            build.stats.mesh_motion_error = std::max(build.stats.mesh_motion_error, left);
            build.stats.motion_keys = std::max(build.stats.motion_keys, keys);
            if (build.chooses_keys()) build.stats.chosen[mesh.name + ".motion_keys"] = keys;
        }
        build.world.meshes[id] = std::move(mesh);
        break;
    }
    build.stats.report.add(procedural.name(), procedural.report(), 0.0);
    take_warnings(build.stats, procedural);
}

void make_render_meshes(Build& build) {
    if (!build.settings.camera || !build.settings.render_meshes) return;
    const MarramView view = view_of(build, *build.settings.camera);
    for (size_t i = 0; i < build.geometry.procedurals.size(); ++i) {
        Procedural& procedural = *build.geometry.procedurals[i];
        if (procedural.kind() != MARRAM_MESH || !procedural.has_view()) continue;
        const MarramOutput output = procedural.begin_view(view);
        take_warnings(build.stats, procedural);
        if (output.triangle_count == 0) continue;
        if (output.time_count != 1)
            procedural.refuse("its render mesh moves: only a growth surface can", "fix the library");
        const uint32_t id = build.mesh_ids[i];
        MeshGeometry& growth = build.world.meshes[id];
        if (growth.positions.size() > 1)
            procedural.refuse("it makes a render mesh of a growth surface that moves", "fix the library");
        const uint64_t digest = digest_of(procedural, output);
        std::optional<MeshGeometry> mesh = build.kept.take_render_mesh(id, digest);
        if (!mesh) {
            mesh = MeshGeometry{growth.name, growth.material, growth.light, {}, {}, {}, {}};
            fill_mesh(procedural, output, *mesh, &Procedural::view_mesh);
            mesh->digest = digest;
        }
        mesh->roles = growth.roles;
        build.world.growth_surfaces.emplace(id, std::move(growth));
        build.world.meshes[id] = *std::move(mesh);
        build.mesh_geometries[id] = nullptr; // collider scenes keep the growth surface's
    }
}

RTCGeometry mesh_geometry(Build& build, uint32_t id) {
    std::shared_ptr<RTCGeometryTy>& made = build.mesh_geometries[id];
    if (made) return made.get();
    MeshGeometry& mesh = build.world.meshes[id];
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    made = {geometry, [](RTCGeometry g) { rtcReleaseGeometry(g); }};
    rtcSetGeometryTimeStepCount(geometry, unsigned(mesh.positions.size()));
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               12, mesh.triangles.size());
    for (size_t t = 0; t < mesh.positions.size(); ++t)
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, unsigned(t), RTC_FORMAT_FLOAT3,
                                   mesh.positions[t].data(), 0, sizeof(Vec3f), mesh.positions[t].size());
    const bool darkens = (mesh.roles & MARRAM_CASTS_SHADOWS) != 0 && !mesh.shadow_catcher;
    rtcSetGeometryMask(geometry, mesh.roles | MARRAM_NAMED | (darkens ? darkens_catchers : 0U));
    rtcCommitGeometry(geometry);
    return geometry;
}

RTCScene collider_scene(Build& build, const std::vector<uint32_t>& ids) {
    if (ids.empty()) return nullptr;
    std::shared_ptr<RTCSceneTy>& scene = build.world.collider_scenes[ids];
    if (scene) return scene.get();
    const auto kept = build.kept.collider_scenes.find(ids);
    if (kept != build.kept.collider_scenes.end() &&
        std::ranges::all_of(ids, [&](uint32_t id) { return build.reused_meshes[id] != 0; })) {
        scene = std::move(kept->second);
        return scene.get();
    }
    const double begin = wall_seconds();
    scene = new_scene(build, RTC_SCENE_FLAG_NONE);
    for (const uint32_t id : ids) rtcAttachGeometryByID(scene.get(), mesh_geometry(build, id), id);
    commit(build, scene.get(), "building colliders");
    build.stats.colliders += wall_seconds() - begin;
    return scene.get();
}

PosedMesh pose_mesh(const SceneGeometry& geometry, const MeshSource& mesh, double frame, bool with_normals) {
    if (!mesh.maker) {
        const SceneMesh& drawn = geometry.meshes[mesh.id];
        return {drawn.positions_at(frame), with_normals ? drawn.normals_at(frame) : std::vector<Vec3f>{}};
    }
    PosedMesh posed{embree_buffer<Vec3f>(mesh.positions.size()), {}};
    if (!mesh.maker->has_pose()) {
        std::ranges::copy(mesh.positions, posed.positions.begin());
        if (with_normals) posed.normals.assign(mesh.normals.begin(), mesh.normals.end());
        return posed;
    }
    mesh.maker->pose(frame, components(posed.positions));
    for (const Vec3f& p : posed.positions)
        if (!in_embree_range(p))
            mesh.maker->refuse("a vertex of its mesh is not a number below 1e18", "fix the library");
    if (with_normals) posed.normals = vertex_normals(posed.positions, mesh.triangles);
    return posed;
}

} // namespace marram
