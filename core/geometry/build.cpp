// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/build.h"

#include "core/geometry/build_state.h"
#include "core/geometry/embree_buffer.h"
#include "core/geometry/lent_meshes.h"
#include "core/geometry/round_pieces.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cmath>

namespace marram {
namespace {

// Embree drops vertices beyond 1e18 without a word; NaN fails every comparison.
bool sound(const Vec3f& p) { return (p.array().abs() < 1e18F).all(); }

MeshGeometry place_mesh(const SceneMesh& source, const std::vector<double>& times, double frame) {
    MeshGeometry mesh{source.name, source.material, source.light, {}, {}, {}, {}};
    mesh.triangles.reserve(source.mesh.triangles.size() + 2);
    mesh.triangles = source.mesh.triangles;
    mesh.uvs = source.mesh.uvs;
    if (source.transform.at(frame).linear().determinant() < 0.0)
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    for (const double time : times) {
        mesh.positions.push_back(source.positions_at(time));
        if (!source.mesh.normals.empty()) mesh.normals.push_back(source.normals_at(time));
    }
    // A transform can throw a sound mesh far away.
    for (const auto& positions : mesh.positions)
        for (const Vec3f& p : positions)
            if (!sound(p))
                throw InputError({source.name}, "the mesh's transform moves it beyond 1e18 m",
                                 "use smaller translations and scales");
    return mesh;
}

bool on_commit_progress(void* user, double fraction) {
    Build& build = *static_cast<Build*>(user);
    build.progress.fraction.store(fraction, std::memory_order_relaxed);
    return !build.cancel.load(std::memory_order_relaxed);
}

void commit(Build& build, RTCScene scene, const char* phase) {
    build.progress.fraction = 0.0;
    build.progress.phase = phase;
    rtcSetSceneProgressMonitorFunction(scene, on_commit_progress, &build);
    rtcCommitScene(scene);
    rtcSetSceneProgressMonitorFunction(scene, nullptr, nullptr);
    build.check_device();
}

std::shared_ptr<RTCSceneTy> new_scene(const Build& build, RTCSceneFlags flags) {
    RTCScene scene = rtcNewScene(build.world.device.get());
    rtcSetSceneFlags(scene, flags);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM); // HIGH differs from run to run
    const auto device = build.world.device;
    return {scene, [device](RTCScene s) { rtcReleaseScene(s); }};
}

void attach_mesh(Build& build, MeshGeometry& mesh, unsigned id) {
    RTCGeometry geometry = rtcNewGeometry(build.world.device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetGeometryTimeStepCount(geometry, unsigned(mesh.positions.size()));
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               12, mesh.triangles.size());
    for (size_t t = 0; t < mesh.positions.size(); ++t)
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, unsigned(t), RTC_FORMAT_FLOAT3,
                                   mesh.positions[t].data(), 0, sizeof(Vec3f), mesh.positions[t].size());
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(build.world.colliders.get(), geometry, id);
    rtcAttachGeometryByID(build.world.scene.get(), geometry, id);
    rtcReleaseGeometry(geometry);
    build.stats.triangles += mesh.triangles.size();
}

void check_mesh(const Procedural& procedural, const MeshGeometry& mesh) {
    for (const Vec3f& p : mesh.positions[0])
        if (!sound(p))
            procedural.refuse("a vertex of its mesh is not a number below 1e18", "mend the library");
    for (const auto& triangle : mesh.triangles)
        for (const uint32_t vertex : triangle)
            if (vertex >= mesh.positions[0].size())
                procedural.refuse("a triangle of its mesh names a vertex that is not there",
                                  "mend the library");
}

// Phase 1 for one procedural that makes a mesh: it may read the meshes before it.
void add_procedural_mesh(Build& build, Procedural& procedural) {
    LentMeshes lent(build.world, build.geometry, build.times(2));
    const MarramOutput output = procedural.begin(lent.frame(build.settings, false));
    MeshGeometry mesh{procedural.name(), procedural.material, -1, {}, {}, {}, {}};
    mesh.positions.push_back(embree_buffer<Vec3f>(output.vertex_count));
    mesh.triangles = embree_buffer<std::array<uint32_t, 3>>(output.triangle_count);
    if (output.has_uvs) mesh.uvs.resize(output.vertex_count);
    const MarramMeshBuffers buffers{components(mesh.positions[0]), components(mesh.triangles),
                                    output.has_uvs ? components(mesh.uvs) : nullptr};
    procedural.mesh(buffers);
    check_mesh(procedural, mesh);
    mesh.normals.push_back(vertex_normals(mesh.positions[0], mesh.triangles));
    build.world.meshes.push_back(std::move(mesh));
}

// ---- how many motion keys ---------------------------------------------------------------------------------------

constexpr uint32_t few_instants = 5, more_instants = 17; // at which strands are looked at

// Looks at some patches of one procedural, unless it stands still.
StrandMotion look_at_motion(Build& build, Procedural& procedural, uint32_t instants) {
    StrandMotion motion;
    build.progress.phase = "looking at motion";
    LentMeshes lent(build.world, build.geometry, build.times(instants));
    const MarramOutput output = procedural.begin(lent.frame(build.settings, true));
    check_output(procedural, output);
    if (output.time_count != instants || output.patch_count == 0) return motion;
    // A few percent of the work, but no fewer than four: what moves most may be anywhere.
    const uint32_t count = std::min(output.patch_count, std::clamp(output.patch_count / 16, 4U, 64U));
    std::vector<StrandMotion> found(count);
    tbb::parallel_for(uint32_t{0}, count, [&](uint32_t i) {
        if (build.cancel.load(std::memory_order_relaxed)) throw Cancelled{};
        const auto index = uint32_t(uint64_t(i) * (output.patch_count - 1) / std::max(count - 1, 1U));
        const MarramPatch patch = procedural.patch(index);
        const size_t stride = output.cvs_per_curve + 2, vertices = patch.curve_count * stride;
        const bool oriented = output.shape == MARRAM_ORIENTED_RIBBON;
        std::vector<std::vector<float>> positions(instants), directions(instants);
        std::vector<float*> at(instants), normals(instants);
        for (uint32_t t = 0; t < instants; ++t) {
            positions[t].resize(4 * vertices);
            if (oriented) directions[t].resize(3 * vertices);
            at[t] = positions[t].data();
            normals[t] = directions[t].data();
        }
        procedural.tessellate(index, {at.data(), oriented ? normals.data() : nullptr, 0, nullptr, nullptr});
        std::vector<const float*> samples(instants);
        for (uint32_t strand = 0; strand < patch.curve_count; ++strand) {
            for (uint32_t t = 0; t < instants; ++t) samples[t] = at[t] + 4 * (strand * stride + 1);
            found[i].add(samples, output.cvs_per_curve, build.settings.view);
        }
    });
    for (const StrandMotion& one : found) motion.add(one);
    procedural.take_warnings(); // they come again
    return motion;
}

// What a strand's motion asks for, and what it grows on: it may bend its way between the instants looked at.
uint32_t choose_keys(Build& build, Procedural& procedural) {
    const BuildSettings& settings = build.settings;
    StrandMotion motion = look_at_motion(build, procedural, few_instants);
    // Strands that turn fast look like ones that jump, until they are looked at more often.
    constexpr double hardly_any = 0.01;
    if (motion.jumps(settings.tolerance) > hardly_any)
        motion = look_at_motion(build, procedural, more_instants);
    uint32_t keys = motion.keys_for(settings.tolerance);
    for (const SceneMesh& mesh : build.geometry.meshes)
        if (std::ranges::find(procedural.meshes(), mesh.name) != procedural.meshes().end())
            keys =
                motion_keys_for(mesh, settings.tolerance, settings.view, build.open(), build.close(), keys);
    const double left = motion.left(keys, settings.tolerance);
    build.stats.motion_error = std::max(build.stats.motion_error, left);
    build.stats.motion_jumps = std::max(build.stats.motion_jumps, motion.jumps(settings.tolerance));
    build.stats.chosen[procedural.name() + ".motion_keys"] = keys;
    if (left > settings.tolerance)
        build.stats.warnings.push_back(fmt::format(
            "{}: strands move so fast that {} motion keys are off by {:.3g} m, the tolerance is {:.3g} m: "
            "shorten camera.shutter, or give more tolerance",
            procedural.name(), keys, left, settings.tolerance));
    return keys;
}

MeshGeometry place_mesh(Build& build, const SceneMesh& mesh) {
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
            build.stats.warnings.push_back(fmt::format(
                "{}: moves so fast that {} motion keys are off by {:.3g} m, the tolerance is {:.3g} m: "
                "shorten camera.shutter, or give more tolerance",
                mesh.name, keys, error, settings.tolerance));
    }
    const auto outward = [&](double frame) { return mesh.transform.at(frame).linear().determinant() > 0.0; };
    if (moves && outward(open) != outward(close))
        build.stats.warnings.push_back(
            mesh.name + ": turns inside out while the shutter is open: it is lit, and shines, as it is at "
                        "the frame; keep the signs of its scale");
    return place_mesh(mesh, moves ? build.times(keys) : std::vector{open}, settings.frame);
}

// Phase 1.
void build_colliders(Build& build) {
    World& world = build.world;
    const double begin = wall_seconds();
    build.progress.phase = "placing meshes";
    world.colliders = new_scene(build, RTC_SCENE_FLAG_NONE);
    world.scene = new_scene(build, MARRAM_SCENE_FILTER);
    for (const SceneMesh& mesh : build.geometry.meshes) {
        if (build.cancel.load()) throw Cancelled{};
        world.meshes.push_back(place_mesh(build, mesh));
    }
    for (const auto& procedural : build.geometry.procedurals)
        if (procedural->type().kind == MARRAM_MESH) add_procedural_mesh(build, *procedural);
    for (size_t i = 0; i < world.meshes.size(); ++i) attach_mesh(build, world.meshes[i], unsigned(i));
    commit(build, world.colliders.get(), "building colliders");
    build.stats.colliders += wall_seconds() - begin;
}

// [procedural], how many motion keys its curves are to have.
std::vector<uint32_t> keys_of_curves(Build& build) {
    const double begin = wall_seconds();
    std::vector<uint32_t> keys;
    for (const auto& procedural : build.geometry.procedurals) {
        const bool looks = build.chooses_keys() && procedural->type().kind == MARRAM_CURVES;
        keys.push_back(looks ? choose_keys(build, *procedural) : std::max(build.settings.motion_keys, 2U));
        if (!(build.open() < build.close())) keys.back() = 1;
        build.stats.motion_keys = std::max(build.stats.motion_keys, keys.back());
    }
    if (build.chooses_keys()) build.stats.expand += wall_seconds() - begin;
    build.world.times = build.times(std::max(build.stats.motion_keys, 2U));
    build.stats.motion_keys = uint32_t(build.world.times.size());
    return keys;
}

} // namespace

uint32_t chosen_motion_keys(SceneGeometry& geometry, const BuildSettings& settings,
                            const std::atomic<bool>& cancel, BuildProgress& progress) {
    if (!(settings.shutter_open < settings.shutter_close)) return 1;
    if (settings.motion_keys != 0) return settings.motion_keys;
    BuildStats stats;
    Build build{geometry, settings, cancel, progress, stats, {}, {}, {}};
    build.world.device = make_device(build.errors);
    build_colliders(build);
    uint32_t most = 2;
    for (const uint32_t keys : keys_of_curves(build)) most = std::max(most, keys);
    return most;
}

World build_world(SceneGeometry& geometry, const BuildSettings& settings, const std::atomic<bool>& cancel,
                  BuildProgress& progress, BuildStats& stats) {
    Build build{geometry, settings, cancel, progress, stats, {}, {}, {}};
    World& world = build.world;
    world.frame = settings.frame;
    world.device = make_device(build.errors);
    build_colliders(build);
    add_curves(build, keys_of_curves(build));

    const double curves = wall_seconds();
    if (settings.curves_bvh) commit(build, world.scene.get(), "building the BVH");
    mark_round_pieces(world);
    stats.curves_bvh += wall_seconds() - curves;
    RTCBounds bounds{};
    rtcGetSceneBounds(settings.curves_bvh ? world.scene.get() : world.colliders.get(), &bounds);
    world.bounds = Box3f(Vec3f(bounds.lower_x, bounds.lower_y, bounds.lower_z),
                         Vec3f(bounds.upper_x, bounds.upper_y, bounds.upper_z));
    world.curve_buffers = std::move(build.curves);
    return std::move(build.world);
}

} // namespace marram
