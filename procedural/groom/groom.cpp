// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/groom.h"

#include "core/math/clock.h"
#include "procedural/border.h"
#include "procedural/groom/automatic_settings.h"
#include "procedural/groom/covered_roots.h"
#include "procedural/groom/groom_bounds.h"
#include "procedural/groom/groom_instance.h"
#include "procedural/groom/groom_output.h"
#include "procedural/groom/groom_warnings.h"
#include "procedural/groom/guide_motion.h"
#include "procedural/groom/rest_strands.h"
#include "procedural/groom/strand_calls.h"
#include "procedural/groom/wind_words.h"
#include "procedural/parallel.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>
#include <new>
#include <optional>
#include <string>

namespace marram {
namespace {

GroomInstance& self(MarramInstance* instance) { return *reinterpret_cast<GroomInstance*>(instance); }

template <typename Body>
MarramStatus guarded(const MarramHost& host, Body&& body) {
    return marram::guarded(host, "groom", "lower its density or count", std::forward<Body>(body));
}

const std::vector<MarramParam>& all_params() {
    static const std::vector<MarramParam> params = with_wind_params(groom_params());
    return params;
}

// Settings parsed from the host's values.
struct ParsedValues {
    Groom groom;
    Wind wind;
    Automatic automatic;
    uint64_t roots_digest = 0, values_digest = 0;
};

ParsedValues parse_values(const MarramHost& host, const Values& given, std::span<const MarramValue> values) {
    ParsedValues parsed_values;
    Groom& groom = parsed_values.groom = read_groom(given);
    Wind& wind = parsed_values.wind = read_wind(given);
    warn_invisible_strands(host, given, groom);
    warn_of_ignored(host, given, groom);
    warn_of_idle_wind(host, given, wind);
    parsed_values.automatic = {groom.cvs == 0,
                               wind.shielding && wind.shielding->spread > 0.0 && wind.shielding->rays == 0,
                               wind.jiggle && wind.jiggle->step == 0.0};
    // The wind turns each segment of the authored strand. With automatic CVs and no reference_segments, a
    // strand of 8 CVs is assumed.
    constexpr int default_reference_segments = 7;
    if (parsed_values.automatic.cvs && wind.reference_segments == 0)
        wind.reference_segments = default_reference_segments;
    parsed_values.roots_digest = roots_digest(given);
    parsed_values.values_digest = digest_of_values(values);
    return parsed_values;
}

void apply_values(GroomInstance& instance, ParsedValues parsed_values) {
    instance.groom = std::move(parsed_values.groom);
    instance.wind = std::move(parsed_values.wind);
    instance.automatic = parsed_values.automatic;
    instance.roots_digest = parsed_values.roots_digest;
    instance.values_digest = parsed_values.values_digest;
    instance.chosen_for.reset();
    instance.gust_start = {};
    instance.gusts_checked = false;
    instance.begun = false;
}

MarramStatus create(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    if (!can_create(host, out)) return MARRAM_ERROR;
    const MarramHost known = known_part(host);
    return guarded(known, [&] {
        return create_instance<GroomInstance>(
            known, values, out, all_params(),
            [&](GroomInstance& instance, std::span<const MarramValue> list) {
                apply_values(instance, parse_values(known, Values(list), list));
            });
    });
}

// Stores new values. Returns what changes of the output (MarramChange). Roots are kept unless the mesh, the guides or
// the values that place them change. Collider trees are kept; make_chain_frame() rebuilds them if meshes or query
// bounds have changed.
uint32_t take_update(GroomInstance& instance, ParsedValues parsed_values, uint32_t inputs) {
    if (parsed_values.values_digest == instance.values_digest && inputs == MARRAM_NOTHING)
        return MARRAM_NOTHING;
    const bool same_roots = parsed_values.roots_digest == instance.roots_digest;
    // Only begin() can compare the meshes: mesh_may_differ tells it to.
    const bool uses_guides = parsed_values.groom.guides.has_value();
    const bool uses_attributes = !parsed_values.groom.density_masks.factors.empty();
    const uint32_t placement_inputs =
        MARRAM_POSITIONS | MARRAM_TOPOLOGY | (uses_attributes ? uint32_t(MARRAM_ATTRIBUTES) : 0U);
    const bool same_mesh = (inputs & placement_inputs) == 0;
    const bool same_layout = same_roots && same_mesh && !(uses_guides && inputs != MARRAM_NOTHING) &&
                             !parsed_values.automatic.cvs && !instance.automatic.cvs &&
                             parsed_values.groom.cvs == instance.groom.cvs &&
                             parsed_values.groom.basis == instance.groom.basis &&
                             parsed_values.groom.shape == instance.groom.shape;
    apply_values(instance, std::move(parsed_values));
    if (!same_roots || (uses_guides && inputs != MARRAM_NOTHING)) instance.placed = false;
    if (!same_mesh) instance.mesh_may_differ = true;
    return same_layout ? uint32_t(MARRAM_POSITIONS | MARRAM_ATTRIBUTES) : uint32_t(MARRAM_EVERYTHING);
}

MarramStatus update(MarramInstance* opaque, const MarramUpdate* given, uint32_t* changed) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        const auto take = [&](std::span<const MarramValue> list, uint32_t inputs) {
            return take_update(instance, parse_values(instance.host, Values(list), list), inputs);
        };
        return update_instance(instance.host, given, changed, all_params(), take);
    });
}

void find_mesh(GroomInstance& instance) {
    instance.mesh = nullptr;
    for (uint32_t i = 0; i < instance.frame.mesh_count; ++i)
        if (instance.meshes[i].instance_of == 0 && instance.groom.mesh == instance.meshes[i].name)
            instance.mesh = &instance.meshes[i];
    instance.attributes.clear();
    if (instance.mesh)
        instance.attributes = known_parts(instance.mesh->attributes, instance.mesh->attribute_count,
                                          instance.mesh->attribute_stride);
    if (!instance.mesh)
        throw SceneFault("groom.no_mesh", instance.groom.mesh_place,
                         "there is no mesh '" + instance.groom.mesh + "' to grow on",
                         "name one of the scene's");
}

// Images need uvs. Where the mesh has uvs outside the unit square, images repeat unless the groom says otherwise.
void prepare_images(GroomInstance& instance) {
    constexpr float rounding = 1e-4F; // of exporters
    const std::vector<ScalarImage*> images = images_of(instance.groom);
    if (images.empty()) return;
    const MarramMesh& mesh = *instance.mesh;
    if (!mesh.uvs)
        throw SceneFault("groom.no_uvs", images[0]->place(),
                         "the mesh '" + instance.groom.mesh + "' has no uvs for this image",
                         "give it uvs, or use one of its attributes, height or slope");
    const bool tiled = std::ranges::any_of(std::span(mesh.uvs, 2 * size_t(mesh.vertex_count)),
                                           [](float v) { return v < -rounding || v > 1.0F + rounding; });
    for (ScalarImage* image : images) image->set_repeats(instance.groom.images_repeat.value_or(tiled));
}

// Digest of a mesh's topology. If the host gives none, only the counts are compared.
uint64_t topology_digest(const MarramMesh& mesh) {
    return Digest().add(mesh.topology).add(mesh.vertex_count).add(mesh.triangle_count).value();
}

// Digest of everything in the mesh that determines the roots: triangles, bind pose, uvs, and attributes that
// scale the density.
uint64_t mesh_digest(const GroomInstance& instance) {
    const MarramMesh& mesh = *instance.mesh;
    Digest digest;
    digest.add(topology_digest(mesh))
        .add(mesh.triangles, 12 * size_t(mesh.triangle_count))
        .add(instance.bind_positions);
    if (mesh.uvs) digest.add(mesh.uvs, 8 * size_t(mesh.vertex_count));
    for (const Factor& factor : instance.groom.density_masks.factors) {
        if (factor.image) continue; // included in the digest of the values
        const MarramAttribute& attribute = instance.attributes[factor.index];
        const size_t count = attribute.rate == MARRAM_PER_FACE ? mesh.triangle_count : mesh.vertex_count;
        digest.add(attribute.values, count * sizeof(float));
    }
    return digest.value();
}

MarramStatus read_bind_pose(GroomInstance& instance) {
    instance.bind_positions.resize(3 * size_t(instance.mesh->vertex_count));
    const bool normals = instance.groom.guides && instance.mesh->normals;
    instance.bind_normals.resize(normals ? instance.bind_positions.size() : 0);
    const auto index = uint32_t(instance.mesh - instance.meshes.data());
    return pose_lent_mesh(instance.frame, index, instance.frame.bind_frame, instance.bind_positions.data(),
                          normals ? instance.bind_normals.data() : nullptr);
}

// Reads the vertices of the guides in the bind pose.
MarramStatus guide_vertices_at_bind(const GroomInstance& instance, const LentCurves& curves,
                                    std::vector<float>& vertices) {
    const MarramFrame& frame = instance.frame;
    vertices.resize(4 * (curves.cv_count() + 2 * curves.count()));
    if (!curves.curves.moves) {
        std::copy_n(curves.curves.vertices[0], vertices.size(), vertices.begin());
        return MARRAM_OK;
    }
    if (!frame.pose_curves)
        throw SceneFault("contract.no_pose_curves", "", "MarramFrame.pose_curves is NULL",
                         "give a function that poses curves at any time, or static curves");
    return pose_lent_curves(frame, curves.index, frame.bind_frame, 0, curves.count(), vertices);
}

// Digest of the guide curves and parting lines. If a procedural grows them on an evolving terrain, they
// differ from frame to frame.
MarramStatus guides_digest(const GroomInstance& instance, uint64_t& out) {
    Digest digest;
    out = 0;
    if (!instance.groom.guides) return MARRAM_OK;
    const GuideSettings& settings = *instance.groom.guides;
    const LentCurves curves = find_curves(instance.frame, settings.curves, settings.place);
    std::vector<float> vertices;
    if (const MarramStatus status = guide_vertices_at_bind(instance, curves, vertices); status != MARRAM_OK)
        return status;
    digest.add(vertices).add(curves.count());
    if (!settings.lines.empty()) {
        const LentCurves lines = find_curves(instance.frame, settings.lines, settings.lines_place);
        digest.add(lines.curves.vertices[0], 16 * (lines.cv_count() + 2 * lines.count())).add(lines.count());
    }
    out = digest.value();
    return MARRAM_OK;
}

// Thins the roots where no guide is near.
void leave_out_roots_beyond_guides(GroomInstance& instance, const Surface& bind) {
    const size_t count = instance.roots.size();
    const uint32_t seed = instance.groom.seed;
    std::vector<char> beyond(count, false);
    marram::parallel_for(tbb::blocked_range<size_t>(0, count, 4096), [&](const auto& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const Root root = instance.roots[i];
            const double density =
                instance.guides->density_at(bind.point(root.triangle, root_weights(seed, root)));
            beyond[i] = unit_double(root_hash(seed, root, Purpose::reach)) >= density;
        }
    });
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i)
        if (!beyond[i]) instance.roots[kept++] = instance.roots[i];
    instance.roots.resize(kept);
    warn_beyond_guides(instance, count - kept, count);
}

// Builds the guides in the bind pose, and each strand's blend of them.
MarramStatus build_guides(GroomInstance& instance, const std::function<bool()>& cancelled) {
    instance.guides.reset();
    instance.blends.clear();
    if (!instance.groom.guides) return MARRAM_OK;
    const GuideSettings& settings = *instance.groom.guides;
    const MarramFrame& frame = instance.frame;
    const LentCurves curves = find_curves(frame, settings.curves, settings.place);
    std::vector<float> vertices;
    if (const MarramStatus status = guide_vertices_at_bind(instance, curves, vertices); status != MARRAM_OK)
        return status;
    std::vector<std::vector<Vec3d>> lines;
    if (!settings.lines.empty()) {
        const LentCurves parting_curves = find_curves(frame, settings.lines, settings.lines_place);
        for (uint64_t c = 0; c < parting_curves.count(); ++c) {
            std::vector<Vec3d>& line = lines.emplace_back();
            const float* v = parting_curves.curves.vertices[0] + 4 * (parting_curves.first_vertex(c) + 1);
            for (uint32_t k = 0; k < parting_curves.cvs(c); ++k)
                line.emplace_back(double(v[4 * k]), double(v[4 * k + 1]), double(v[4 * k + 2]));
        }
    }
    const Surface bind{instance.bind_positions.data(),
                       instance.bind_normals.empty() ? nullptr : instance.bind_normals.data(),
                       instance.mesh->triangles,
                       instance.mesh->uvs,
                       instance.mesh->triangle_count,
                       {}};
    instance.guides = std::make_shared<const GuideSet>(
        settings, curves, vertices.data(), bind, instance.mesh->vertex_count, std::move(lines), cancelled);
    if (cancelled()) return MARRAM_CANCELLED;
    warn_of_guides(instance, instance.guides->binding());
    leave_out_roots_beyond_guides(instance, bind);
    instance.blends.resize(instance.roots.size());
    marram::parallel_for(tbb::blocked_range<size_t>(0, instance.roots.size(), 256), [&](const auto& range) {
        if (cancelled()) return;
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const Root root = instance.roots[i];
            const Vec3d weights = root_weights(instance.groom.seed, root);
            instance.blends[i] = instance.guides->blend_at(bind.point(root.triangle, weights),
                                                           frame_at(bind, root.triangle, weights).normal);
        }
    });
    return cancelled() ? MARRAM_CANCELLED : MARRAM_OK;
}

// The meshes that can cover roots: none unless strands collide.
std::vector<const MarramMesh*> covering_meshes_of(const GroomInstance& instance) {
    if (!instance.wind.collision || !instance.groom.clear_of_meshes) return {};
    return covering_meshes(instance.frame, instance.meshes, *instance.mesh);
}

// Leaves out the roots, and their blends of guides, that other meshes cover.
MarramStatus leave_out_covered_roots(GroomInstance& instance, const std::function<bool()>& cancelled) {
    instance.covered_roots = 0;
    const std::vector<const MarramMesh*> covering = covering_meshes_of(instance);
    instance.placed_covering_digest = digest_of_meshes(covering);
    if (covering.empty() || instance.roots.empty()) return MARRAM_OK;
    const RootCover cover(instance.frame.device, covering);
    constexpr size_t batch = 512;
    const size_t count = instance.roots.size();
    std::vector<int> covered(count);
    std::vector<Vec3f> starts(count);
    Groom groom = instance.groom;
    groom.cvs = 2;                             // only the first is looked at
    const SkinPoses poses = instance.poses(0); // the mesh does not move
    marram::parallel_for(size_t{0}, (count + batch - 1) / batch, [&](size_t b) {
        if (cancelled()) return;
        const size_t first = b * batch, size = std::min(batch, count - first);
        const std::span<const Root> roots = std::span(instance.roots).subspan(first, size);
        Strands strands;
        strands.resize(int(size), groom.cvs, false);
        const auto guided = instance.guided(first, size);
        expand(groom, instance.wind, poses, roots, strands, guided ? &*guided : nullptr);
        for (size_t i = 0; i < size; ++i) {
            const Wide3f& start = strands.rest[i / lanes * size_t(groom.cvs)];
            const auto lane = int(i % lanes);
            starts[first + i] = Vec3f(start.x[lane], start.y[lane], start.z[lane]);
            covered[first + i] =
                cover.covered_by(poses.bind.point(roots[i].triangle, root_weights(groom.seed, roots[i])),
                                 starts[first + i].cast<double>());
        }
    });
    if (cancelled()) return MARRAM_CANCELLED;
    std::vector<Cover> covers(covering.size());
    const bool shared = has_instances(instance.frame, instance.meshes, *instance.mesh); // of the roots
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i) {
        if (covered[i] < 0 || shared) {
            instance.roots[kept] = instance.roots[i];
            if (!instance.blends.empty()) instance.blends[kept] = instance.blends[i];
            ++kept;
        }
        if (covered[i] < 0) continue;
        Cover& by = covers[size_t(covered[i])];
        if (by.roots++ == 0) by.mesh = cover.mesh(covered[i]).name, by.place = starts[i].cast<double>();
    }
    instance.roots.resize(kept);
    if (!instance.blends.empty()) instance.blends.resize(kept);
    instance.covered_roots = count - kept;
    warn_of_covered_roots(instance, covers, count);
    return MARRAM_OK;
}

// Keeps the roots if everything that places them is unchanged. On an evolving terrain they are placed again
// in each frame. Whether a strand exists depends on its own hash, so most strands persist between frames.
MarramStatus invalidate_roots_if_mesh_changed(GroomInstance& instance) {
    MarramStatus status = read_bind_pose(instance);
    uint64_t guides = 0;
    if (status == MARRAM_OK) status = guides_digest(instance, guides);
    if (status == MARRAM_OK &&
        (mesh_digest(instance) != instance.placed_mesh_digest || guides != instance.placed_guides_digest ||
         digest_of_meshes(covering_meshes_of(instance)) != instance.placed_covering_digest))
        instance.placed = false;
    instance.mesh_may_differ = false;
    return status;
}

MarramStatus place(GroomInstance& instance) {
    const double begin = wall_seconds();
    if (const MarramStatus status = read_bind_pose(instance); status != MARRAM_OK) return status;
    const auto cancelled = [&] { return instance.host.cancelled(instance.host.user) != 0; };
    PlacedRoots placed = place_roots(instance.groom, instance.poses(0).bind, cancelled);
    instance.roots = std::move(placed.roots);
    instance.placing_peak_bytes = placed.peak_bytes;
    if (cancelled()) return MARRAM_CANCELLED;
    warn_of_no_strands(instance);
    warn_of_tiles(instance);
    if (const MarramStatus status = build_guides(instance, cancelled); status != MARRAM_OK) return status;
    if (const MarramStatus status = leave_out_covered_roots(instance, cancelled); status != MARRAM_OK)
        return status;
    instance.placed = true;
    instance.mesh_may_differ = false;
    instance.placed_topology_digest = topology_digest(*instance.mesh);
    instance.placed_mesh_digest = mesh_digest(instance);
    if (const MarramStatus status = guides_digest(instance, instance.placed_guides_digest);
        status != MARRAM_OK)
        return status;
    instance.placing_seconds = wall_seconds() - begin;
    return MARRAM_OK;
}

// Whether the strands' roots move during the shot.
bool skin_moves(const GroomInstance& instance) {
    return instance.mesh->time_count > 1 || instance.mesh->moves != 0 ||
           std::ranges::any_of(instance.mesh_instances, [](const MeshInstance& mesh_instance) {
               return mesh_instance.moves() || mesh_instance.mesh->moves != 0;
           });
}

MarramStatus begin(MarramInstance* opaque, const MarramFrame* frame, MarramOutput* out) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        instance.begun = false;
        if (!out)
            throw SceneFault("contract.null_output", "", "the output is NULL", "pass a non-NULL pointer");
        instance.frame = borrowed_frame(frame, instance.meshes);
        const bool traces = instance.wind.collision || instance.wind.shielding;
        if (traces && !instance.frame.colliders)
            throw SceneFault("contract.no_colliders", "", "MarramFrame.colliders is NULL",
                             "pass the committed scene of the frame's meshes");
        instance.workers.clear();
        instance.placing_seconds = 0.0;
        find_mesh(instance);
        prepare_images(instance);
        resolve_attributes(instance.groom, instance.attributes);
        if (instance.placed && !instance.mesh_may_differ &&
            instance.placed_topology_digest != topology_digest(*instance.mesh))
            throw SceneFault("groom.topology", instance.groom.mesh_place,
                             "the mesh '" + instance.groom.mesh +
                                 "' has other triangles than when its strands were placed",
                             "keep its topology, or create the procedural again");
        if (instance.placed)
            if (const MarramStatus status = invalidate_roots_if_mesh_changed(instance); status != MARRAM_OK)
                return status;
        if (!instance.placed) {
            const MarramStatus status = place(instance);
            if (status != MARRAM_OK) return status;
        }
        if (const MarramStatus status =
                find_mesh_instances(instance.frame, *instance.mesh, instance.mesh_instances);
            status != MARRAM_OK)
            return status;
        if (instance.guides) instance.groom.length = {0.0, instance.guides->longest_child()};
        if (const MarramStatus status =
                set_gust_plane_once(instance.host, instance.frame, {}, instance.wind, instance.gust_start);
            status != MARRAM_OK)
            return status;
        const double choose_start = wall_seconds();
        if (const MarramStatus status = choose_settings(instance); status != MARRAM_OK) return status;
        instance.placing_seconds += wall_seconds() - choose_start;
        const bool blown = instance.frame.stage != MARRAM_REST;
        bool moves =
            instance.mesh->time_count > 1 ||
            std::ranges::any_of(instance.mesh_instances, &MeshInstance::moves) ||
            (blown && (wind_moves(instance.wind) || moving_meshes_matter(instance.wind, instance.frame)));
        instance.past = {};
        if (instance.wind.jiggle && instance.frame.stage == MARRAM_FINAL) {
            double travel = 0.0;
            if (const MarramStatus found = measure_travel(instance.frame, instance.mesh_instances, travel);
                found != MARRAM_OK)
                return found;
            const MarramStatus status = read_past(
                instance.frame, uint32_t(instance.mesh - instance.meshes.data()), *instance.wind.jiggle,
                longest_strand(instance.groom) * max_instance_scale(instance.mesh_instances), instance.past,
                travel, [&](int64_t samples) { announce_long_work(instance, samples); });
            if (status != MARRAM_OK) return status;
            bool instances_moved = false;
            if (const MarramStatus past =
                    sample_past_transforms(instance.frame, *instance.wind.jiggle, instance.past.window,
                                           instance.mesh_instances, instances_moved);
                past != MARRAM_OK)
                return past;
            // Without motion there is no jiggle.
            if (instance.past.moves() || instances_moved || wind_moves(instance.wind))
                moves = true;
            else
                instance.past = {};
        }
        instance.time_count = moves ? instance.frame.time_count : 1;
        instance.frame.time_count = instance.time_count; // the motion samples that the chain computes
        const double before = wall_seconds();
        instance.chain = {}; // release the last frame's trees before building new ones
        instance.chain = make_chain_frame(
            {instance.wind, instance.groom.envelope, instance.frame, instance.mesh, instance.radius_profile,
             instance.groom.basis, instance.past.window,
             instance.wind.collision ? bounds_of_strands(instance) : everywhere(),
             instance.wind.gusts ? bounds_at_rest(instance) : everywhere(), &instance.trees});
        warn_of_gusts(instance.host, instance.groom.mesh_place, instance.chain);
        instance.gust_bounds = instance.wind.gusts ? bounds_at_rest(instance) : Eigen::AlignedBox3d();
        if (!instance.gusts_checked && !skin_moves(instance))
            warn_of_untouching_gusts(instance.host, instance.wind, instance.frame, instance.gust_bounds);
        instance.gusts_checked = true;
        warn_of_rounding(instance);
        warn_of_length(instance);
        announce_long_work(instance, instance.past.window.count());
        blow_guides(instance);
        instance.prepare_seconds = wall_seconds() - before;
        MarramOutput output{};
        output.kind = MARRAM_CURVES;
        output.curve_count = instance.mesh_instances.size() * instance.roots.size();
        output.cvs_per_curve = uint32_t(instance.groom.cvs);
        output.patch_count = instance.patch_count();
        output.time_count = instance.time_count;
        output.basis = instance.groom.basis;
        output.shape = instance.groom.shape;
        fill_known_part(output, out);
        instance.begun = true;
        return MARRAM_OK;
    });
}

MarramStatus summarize(MarramInstance* opaque, void (*sink)(void*, const char*), void* user) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    const GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        if (!sink) throw SceneFault("contract.null_sink", "", "the sink is NULL", "pass a function");
        if (!instance.begun)
            throw SceneFault("contract.no_frame", "", "no frame has begun", "call begin first");
        sink(user, wind_summary(instance.wind, instance.frame, instance.gust_bounds).c_str());
        return MARRAM_OK;
    });
}

void check_patch(const GroomInstance& instance, uint32_t index) {
    if (!instance.begun) throw SceneFault("contract.no_frame", "", "no frame has begun", "call begin first");
    if (index >= instance.patch_count())
        throw SceneFault("contract.patch_range", "", "there is no patch " + std::to_string(index),
                         "ask for 0 to " + std::to_string(int64_t(instance.patch_count()) - 1));
}

MarramStatus patch(MarramInstance* opaque, uint32_t index, MarramPatch* out) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    const GroomInstance& instance = self(opaque);
    return guarded(instance.host, [&] {
        if (!out) throw SceneFault("contract.null_patch", "", "the patch is NULL", "pass a non-NULL pointer");
        check_patch(instance, index);
        MarramPatch patch{};
        patch_bounds(instance, index, &patch);
        fill_known_part(patch, out);
        return MARRAM_OK;
    });
}

RestStrandSource patch_rest_strand_source(const GroomInstance& instance, const GroomPatch& patch,
                                          StageClock& clock) {
    const std::span<const Root> roots = patch.roots;
    const auto lay_out = [&instance, roots](const Surface& now, Strands& strands) {
        const auto guided = instance.guided(roots);
        expand(instance.groom, instance.wind, {instance.poses(0).bind, now}, roots, strands,
               guided ? &*guided : nullptr);
    };
    return rest_strand_source(instance, patch.mesh_instance, lay_out, &clock);
}

MarramStatus tessellate(MarramInstance* opaque, uint32_t index, const MarramPatchBuffers* buffers) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    GroomInstance& instance = self(opaque);
    if (instance.host.cancelled(instance.host.user)) return MARRAM_CANCELLED;
    return guarded(instance.host, [&] {
        check_patch(instance, index);
        check_buffers(buffers, instance.time_count, instance.groom.shape == MARRAM_ORIENTED_RIBBON,
                      groom_attributes().size());
        Worker& worker = instance.workers.local();
        const GroomPatch patch = instance.patch_at(index);
        const std::span<const Root> roots = patch.roots;
        Strands& strands = worker.strands;
        strands.has_wind_share = !instance.groom.factors[of_wind].empty();
        strands.resize(int(roots.size()), instance.groom.cvs, instance.groom.shape == MARRAM_ORIENTED_RIBBON);
        strands.instance = patch.mesh_instance.is_instance ? patch.mesh_instance.mesh : nullptr;
        const RestStrandSource rest_strands = patch_rest_strand_source(instance, patch, worker.chain.clock);
        const bool follows = !instance.guide_motion.blown.empty();
        if (instance.past.window.count() > 0 && !follows)
            jiggle_patch(instance.chain, rest_strands, strands, worker.chain);
        for (uint32_t time = 0; time < instance.time_count; ++time) {
            // If the mesh is static, later motion samples reuse the rest strands.
            if (time < instance.mesh->time_count || patch.mesh_instance.moves())
                rest_strands.at_time(time, strands);
            if (follows) {
                {
                    const StageTimer timer(worker.chain.clock.bend);
                    follow_guides(instance, patch, time, strands);
                }
                collide_pose(instance.chain, time, strands, worker.chain);
            } else {
                run_chain(instance.chain, time, strands, worker.chain);
            }
            const StageTimer timer(worker.chain.clock.write);
            write_vertices(instance, roots, strands, buffers->vertices[time]);
            if (strands.oriented) write_normals(strands, roots.size(), buffers->normals[time]);
            if (time > 0) continue;
            for (uint32_t a = 0; a < buffers->attribute_count; ++a)
                write_attribute(instance, patch, strands, buffers->attributes[a],
                                buffers->attribute_values[a]);
        }
        return MARRAM_OK;
    });
}

void report(MarramInstance* opaque, void (*sink)(void*, const char*, double), void* user) {
    if (!opaque || !sink) return;
    GroomInstance& instance = self(opaque);
    size_t scratch = 0;
    const CollisionCounts counts = report_chain(instance.workers, sink, user, scratch);
    warn_of_collisions(instance.host, instance.groom.mesh_place, instance.groom.mesh, instance.time_count > 1,
                       counts);
    const Wind& wind = instance.wind;
    if (instance.automatic.cvs) sink(user, "chosen.cvs", instance.groom.cvs);
    if (instance.automatic.rays) sink(user, "chosen.shield_rays", wind.shielding->rays);
    if (instance.automatic.step && instance.past.window.count() > 0)
        sink(user, "chosen.jiggle_step", wind.jiggle->step);
    if (wind.noise.left_out > 0) sink(user, "chosen.octaves", wind.noise.octaves - wind.noise.left_out);
    sink(user, "roots.covered", double(instance.covered_roots));
    sink(user, "seconds.place_roots", instance.placing_seconds);
    sink(user, "seconds.prepare_wind", instance.prepare_seconds);
    // The peak is the larger of the two: the candidates of placing are freed before the rest is allocated.
    const size_t lasting = instance.roots.capacity() * sizeof(Root) + instance.bind_positions.capacity() * 4 +
                           instance.blends.capacity() * sizeof(GuideBlend) +
                           (instance.guides ? instance.guides->bytes() : 0) + instance.past.bytes() +
                           instance.trees.bytes() + instance.chain.gust_bytes() + scratch;
    sink(user, "memory.curve_extra_bytes", double(std::max(lasting, instance.placing_peak_bytes)));
    if (instance.mesh_instances.size() < 2) return;
    sink(user, "instances.count", double(instance.mesh_instances.size() - 1));
    sink(user, "instances.shared_bytes",
         double(instance.roots.capacity() * sizeof(Root) + instance.bind_positions.capacity() * 4 +
                instance.blends.capacity() * sizeof(GuideBlend) +
                (instance.guides ? instance.guides->bytes() : 0) + instance.past.bytes()));
}

void destroy(MarramInstance* opaque) { delete reinterpret_cast<GroomInstance*>(opaque); } // NULL is fine

} // namespace

MarramProcedural groom_procedural() {
    MarramProcedural procedural{};
    procedural.name = "groom";
    procedural.help = "hair, fur or grass that grows on a mesh and bends in the scene's wind";
    procedural.kind = MARRAM_CURVES;
    procedural.params = all_params().data();
    procedural.param_count = uint32_t(all_params().size());
    procedural.param_stride = sizeof(MarramParam);
    procedural.attributes = groom_attributes().data();
    procedural.attribute_count = uint32_t(groom_attributes().size());
    procedural.attribute_stride = sizeof(MarramAttribute);
    procedural.create = create;
    procedural.begin = begin;
    procedural.patch = patch;
    procedural.tessellate = tessellate;
    procedural.report = report;
    procedural.destroy = destroy;
    procedural.update = update;
    procedural.summarize = summarize;
    return procedural;
}

std::span<const MarramReportEntry> groom_report_entries() {
    static constexpr auto sum = [](const char* path, const char* unit, const char* help) {
        return MarramReportEntry{path, unit, MARRAM_SUM, nullptr, nullptr, help};
    };
    static constexpr auto each = [](const char* path, const char* unit, const char* help) {
        return MarramReportEntry{path, unit, MARRAM_EACH, nullptr, nullptr, help};
    };
    static constexpr std::array entries = {
        sum("thread_seconds.expand", "thread s", "laying out strands and writing their CVs"),
        sum("thread_seconds.gusts", "thread s", "gusts"),
        sum("thread_seconds.shield", "thread s", "shielding"),
        sum("thread_seconds.bend", "thread s", "bend"),
        sum("thread_seconds.jiggle", "thread s", "jiggle"),
        sum("thread_seconds.collide", "thread s", "collision"),
        sum("seconds.place_roots", "s", "placing roots, choosing settings"),
        sum("seconds.prepare_wind", "s", "collider trees, gusts, and the wind on guides"),
        sum("collision.contacts", "count", "segments that touch a mesh"),
        sum("collision.pushed_out", "count", "segments that started inside a mesh and were turned out of it"),
        sum("collision.unresolved", "count", "segments or roots without a free direction"),
        sum("collision.targets_not_raised", "count",
            "CVs not raised: offset_scale found no consistent side of the skin"),
        sum("collision.dips", "count",
            "strands whose rendered curve enters a mesh by more than the tolerance"),
        sum("collision.goal_angle", "rad", "sum of the angles between start and goal of all segments"),
        sum("collision.turned_angle", "rad",
            "sum of the angles by which segments turned towards their goals"),
        MarramReportEntry{"collision.reached", "1", MARRAM_RATIO, "collision.turned_angle",
                          "collision.goal_angle", "fraction of the goal angle that was reached"},
        sum("roots.covered", "count", "roots left out because another mesh covers them (clear_of)"),
        sum("memory.curve_extra_bytes", "bytes", "peak memory of the groom besides its CVs"),
        sum("instances.count", "count", "instances that strands grow on, each with the wind at its position"),
        sum("instances.shared_bytes", "bytes",
            "roots, guides and the mesh's past, kept once for all instances; CVs are each one's own"),
        each("chosen.cvs", "1", "CVs per strand"),
        each("chosen.shield_rays", "1", "rays per CV"),
        each("chosen.jiggle_step", "frames", "interval between samples of the past"),
        each("chosen.octaves", "1", "octaves of noise"),
    };
    return entries;
}

} // namespace marram
