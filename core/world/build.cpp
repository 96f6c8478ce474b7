// SPDX-License-Identifier: Apache-2.0
#include "core/world/build.h"

#include "core/host/geometry_graph.h"
#include "core/host/volume_value.h"
#include "core/math/digest.h"
#include "core/trace/round_pieces.h"
#include "core/world/build_state.h"
#include "core/world/curve_memory.h"
#include "core/world/lazy_curves.h"

#include <algorithm>
#include <bit>
#include <numeric>
#include <set>
#include <utility>

namespace marram {
namespace {

bool on_commit_progress(void* user, double fraction) {
    Build& build = *static_cast<Build*>(user);
    build.progress.fraction.store(fraction, std::memory_order_relaxed);
    return !build.cancel.load(std::memory_order_relaxed);
}

// Digest of a procedural's values and, recursively, of all geometry that it names. It depends on contents
// only.
uint64_t digest_of(const Build& build, const Procedural& procedural) {
    const SceneGeometry& geometry = build.geometry;
    Digest digest;
    digest.add(procedural.digest()).add(procedural.roles);
    for (const SceneMesh& mesh : geometry.meshes)
        if (depends_on_mesh(procedural, procedural.kind() == MARRAM_CURVES ? mesh.object().name : mesh.name,
                            mesh.roles))
            digest.add(mesh.name).add(mesh.digest());
    for (const SceneCurves& curves : geometry.curves)
        if (procedural.refers_to_curves(curves.name)) digest.add(curves.name).add(curves.digest());
    for (const auto& other : geometry.procedurals)
        if (other.get() != &procedural && depends_on(procedural, *other))
            digest.add(other->name()).add(digest_of(build, *other));
    return digest.value();
}

// Of all velocities that procedurals hold; a file that several hold counts once.
uint64_t volume_bytes(const SceneGeometry& geometry) {
    std::set<const VelocityGrid*> files;
    for (const auto& procedural : geometry.procedurals)
        for (const auto& volume : procedural->volumes())
            for (const auto& file : volume->files) files.insert(file.get());
    uint64_t bytes = 0;
    for (const VelocityGrid* file : files) bytes += file->values.size() * sizeof(float);
    return bytes;
}

// Makes meshes and procedurals in dependency order. Without `with_curves`, curves that nothing depends on are
// not made; only their number of motion keys is found.
void make_all(Build& build, bool with_curves) {
    const double begin = wall_seconds();
    build.progress.phase = "placing meshes";
    place_meshes(build);
    build.stats.report.declare(build.geometry.report_entries);
    for (const auto& procedural : build.geometry.procedurals)
        build.stats.report.declare(procedural->library().report_entries());
    build.stats.colliders += wall_seconds() - begin;
    build.stats.volume_bytes = volume_bytes(build.geometry);
    for (const size_t i : order_of(build.geometry.procedurals)) {
        Procedural& procedural = *build.geometry.procedurals[i];
        if (reads_refused(build, procedural)) continue;
        if (procedural.kind() == MARRAM_MESH) {
            const double start = wall_seconds(), colliders_before = build.stats.colliders;
            make_mesh(build, procedural, build.mesh_ids[i]);
            build.stats.procedural_meshes +=
                wall_seconds() - start - (build.stats.colliders - colliders_before);
            continue;
        }
        const uint32_t keys = motion_keys_of_curves(build, procedural);
        build.stats.motion_keys = std::max(build.stats.motion_keys, keys);
        const auto uses_procedural = [&](const auto& other) { return other->names(procedural.name()); };
        if (with_curves || std::ranges::any_of(build.geometry.procedurals, uses_procedural))
            make_curves(build, procedural, keys);
    }
    raise_refused(build);
    build.world.times = build.times(std::max(build.stats.motion_keys, 2U));
    build.stats.motion_keys = uint32_t(build.world.times.size());
    // The collider scene of all meshes: it detects penetrating strands, and gives the bounds if curves are
    // not traced.
    const bool wanted = !build.settings.trace_curves ||
                        std::ranges::any_of(build.geometry.procedurals,
                                            [](const auto& p) { return p->kind() == MARRAM_CURVES; });
    std::vector<uint32_t> all(wanted ? build.world.meshes.size() : 0);
    std::iota(all.begin(), all.end(), 0U);
    collider_scene(build, all);
    build.world.colliders =
        all.empty() ? new_scene(build, RTC_SCENE_FLAG_NONE) : build.world.collider_scenes.at(all);
    if (all.empty()) commit(build, build.world.colliders.get(), "building colliders");
}

// Reuses the previous frame's device if there is one: the kept collider scenes belong to it.
void make_device(Build& build) {
    World& world = build.world;
    world.device = std::move(build.kept.device);
    world.device_state = std::move(build.kept.device_state);
    if (world.device)
        reset(*world.device_state);
    else
        world.device = make_device(world.device_state);
    limit_device(build);
}

} // namespace

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
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM); // HIGH is not deterministic
    const auto device = build.world.device;
    return {scene, [device](RTCScene s) { rtcReleaseScene(s); }};
}

void prepare(Build& build, Procedural& procedural, const MarramFrame& lent_frame) {
    MarramFrame frame = lent_frame;
    // reference_depth > 0: the tolerance is in pixels and depends on the camera; simulated states must not.
    if (build.settings.view.reference_depth > 0.0) frame.tolerance = 0.0;
    build.progress.fraction = 0.0;
    build.progress.phase = "simulating";
    const uint64_t digest = Digest()
                                .add(digest_of(build, procedural))
                                .add(std::bit_cast<uint64_t>(frame.fps))
                                .add(std::bit_cast<uint64_t>(frame.bind_frame))
                                .add(std::bit_cast<uint64_t>(frame.tolerance))
                                .value();
    StateStore& states =
        build.geometry.states
            .try_emplace({procedural.name(), digest}, build.settings.state_folder, procedural.name(), digest)
            .first->second;
    procedural.prepare(frame, states, [&](double share, const std::string&) {
        build.progress.fraction.store(share, std::memory_order_relaxed);
    });
}

uint32_t chosen_motion_keys(SceneGeometry& geometry, const BuildSettings& settings,
                            const std::atomic<bool>& cancel, BuildProgress& progress) {
    if (!(settings.shutter_open < settings.shutter_close)) return 1;
    if (settings.motion_keys != 0) return settings.motion_keys;
    BuildStats stats;
    KeptGeometry none;
    Build build{geometry, settings, cancel, progress, stats, none};
    make_device(build);
    make_all(build, false);
    uint32_t most = 2;
    for (const auto& procedural : geometry.procedurals)
        if (const auto chosen = stats.chosen.find(procedural->name() + ".motion_keys");
            chosen != stats.chosen.end())
            most = std::max(most, uint32_t(chosen->second));
    return most;
}

namespace {

// Warnings that all procedurals that make curves have sent.
void take_common_warnings(Build& build) {
    std::vector<Problem> common;
    bool first = true;
    for (const auto& procedural : build.geometry.procedurals) {
        if (procedural->kind() != MARRAM_CURVES) continue;
        const std::vector<Problem> sent = procedural->take_common_warnings();
        if (std::exchange(first, false))
            common = sent;
        else
            std::erase_if(common, [&](const Problem& warning) {
                return std::ranges::find(sent, warning) == sent.end();
            });
    }
    for (Problem& warning : common)
        if (std::ranges::find(build.stats.warnings, warning) == build.stats.warnings.end())
            build.stats.warnings.push_back(std::move(warning));
}

} // namespace

World build_world(SceneGeometry& geometry, const BuildSettings& settings, const std::atomic<bool>& cancel,
                  BuildProgress& progress, BuildStats& stats, KeptGeometry kept) {
    Build build{geometry, settings, cancel, progress, stats, kept};
    World& world = build.world;
    world.frame = settings.frame;
    make_device(build);
    make_all(build, true);
    const double view_start = wall_seconds();
    make_render_meshes(build);
    build.stats.procedural_meshes += wall_seconds() - view_start;
    world.scene = new_scene(build, MARRAM_SCENE_FILTER);
    for (uint32_t id = 0; id < world.meshes.size(); ++id) {
        rtcAttachGeometryByID(world.scene.get(), mesh_geometry(build, id), id);
        stats.triangles += world.meshes[id].triangles.size();
    }
    attach_curves(build);

    limit_device(build);
    const double bvh_begin = wall_seconds();
    if (settings.trace_curves) commit(build, world.scene.get(), "building the BVH");
    mark_round_pieces(world);
    stats.bvh += wall_seconds() - bvh_begin;
    stats.embree_bytes = uint64_t(world.device_state->bytes.load());
    stats.embree_peak_bytes = uint64_t(world.device_state->peak.load());
    RTCBounds bounds{};
    rtcGetSceneBounds(settings.trace_curves ? world.scene.get() : world.colliders.get(), &bounds);
    world.bounds = Box3f(Vec3f(bounds.lower_x, bounds.lower_y, bounds.lower_z),
                         Vec3f(bounds.upper_x, bounds.upper_y, bounds.upper_z));
    for (const Box3f& box : stats.patch_bounds)
        if (settings.trace_curves) world.bounds.extend(box); // the same if curves are lazy
    for (const auto& procedural : geometry.procedurals)
        take_warnings(build.stats, *procedural); // from pose()
    take_common_warnings(build);
    world.curve_buffers = std::move(build.curves);
    if (world.lazy) {
        auto& lazy = static_cast<LazyWorld&>(*world.lazy);
        for (const CurveGeometry& curves : world.curves)
            for (float* vertices : curves.round_pieces)
                if (!curves.lazy)
                    lazy.round_pieces.emplace_back(
                        vertices, curves.curve_count * ((curves.cvs_per_curve - 1) * curves.pieces + 1));
        lazy.lent = std::move(build.lent);
        for (const auto& procedural : geometry.procedurals) {
            procedural->set_cancellable(false);
            lazy.procedurals.push_back(procedural.get());
        }
        lazy.set_budget(settings.memory);
    }
    return std::move(build.world);
}

} // namespace marram
