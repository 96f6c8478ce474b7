// SPDX-License-Identifier: Apache-2.0
// strands: imported hair, fur or grass in the scene's wind.
//
// What it models. CVs, CV counts, widths and all other attributes are those of the file. Strands with a mesh
// (`on`) are bound to it at bind_frame, each at the point closest to its root (binding.h), and follow it
// rigidly as it moves and deforms. Strands that are animated in their file, or whose [[curves]] has a moving
// transform, follow that motion at every instant; the wind is added to it. All strands pass through the chain
// like grown ones (procedural/wind/chain.h). Their order is the file's.
//
//     [[curves]]
//     name = "bangs"
//     type = "strands"
//     file = "bangs.hair"
//
//     [[procedural]]
//     type = "strands"
//     name = "hair"
//     curves = "bangs"
//     on = "head"                     # absent: not bound, but blown all the same
//     material = "hair"
//     width = 0.0001                  # if the file has no widths, or to override them
//     wind.collision.solver = "exact"
//
// The wind turns each segment, so strands with more segments bend more unless wind.reference_segments is
// given. With collision, roots must be root_offset above the skin (wind.collision.offset_root): strands with
// lower roots are raised. The number of roots below the skin is reported.
#include "procedural/groom/imported.h"

#include "core/math/clock.h"
#include "core/math/digest.h"
#include "procedural/border.h"
#include "procedural/groom/imported_output.h"
#include "procedural/groom/imported_shape.h"
#include "procedural/groom/pilot.h"
#include "procedural/groom/wind_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>

namespace marram {
namespace {

ImportInstance& self_of(MarramInstance* instance) { return *reinterpret_cast<ImportInstance*>(instance); }

template <typename Body>
MarramStatus guarded_import(const MarramHost& host, Body&& body) {
    return marram::guarded(host, "strands", "use a file with fewer strands", std::forward<Body>(body));
}

const std::vector<MarramParam>& strand_params() {
    static const std::vector<MarramParam> params = with_wind_params(import_params());
    return params;
}

// ---- Values

void apply_values(ImportInstance& instance, const Values& given, std::span<const MarramValue> list) {
    ImportSettings settings = read_import(given);
    for (const PassedAttribute& a : settings.passed_attributes)
        for (const std::string_view computed : {"envelope", "gust", "shield"})
            if (a.name == computed)
                send(instance.host, MARRAM_WARNING, "strands.attribute_replaced", given.at("curves").place,
                     "the file's attribute '" + a.name +
                         "' is not taken over: the wind computes one of that name",
                     "rename it in the file where it is needed");
    Wind wind = read_wind(given);
    if (settings.mesh.empty() && wind.collision && wind.collision->offset_scale)
        throw SceneFault("strands.no_skin", given.at("curves").place,
                         "wind.collision.offset_scale needs the skin that strands grow on",
                         "name it: on = \"...\"");
    warn_of_idle_wind(instance.host, given, wind);
    instance.settings = std::move(settings);
    instance.wind = std::move(wind);
    instance.automatic_rays = instance.wind.shielding && instance.wind.shielding->spread > 0.0 &&
                              instance.wind.shielding->rays == 0;
    instance.automatic_step = instance.wind.jiggle && instance.wind.jiggle->step == 0.0;
    instance.attributes = import_attribute_list(instance.settings);
    instance.values_digest = digest_of_values(list);
    instance.binding_digest = binding_digest(instance.settings);
    instance.chosen_for.reset();
    instance.gust_start = {};
    instance.gusts_checked = false;
    instance.begun = false;
}

MarramStatus create_import(const MarramHost* host, const MarramValues* values, MarramInstance** out) {
    if (!can_create(host, out)) return MARRAM_ERROR;
    const MarramHost known = known_part(host);
    return guarded_import(known, [&] {
        return create_instance<ImportInstance>(
            known, values, out, strand_params(),
            [](ImportInstance& instance, std::span<const MarramValue> list) {
                apply_values(instance, Values(list), list);
            });
    });
}

// Strands stay bound if neither the binding settings nor the geometry have changed.
MarramStatus update_import(MarramInstance* opaque, const MarramUpdate* given, uint32_t* changed) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    ImportInstance& instance = self_of(opaque);
    return guarded_import(instance.host, [&] {
        const auto take = [&](std::span<const MarramValue> list, uint32_t inputs) -> uint32_t {
            if (digest_of_values(list) == instance.values_digest && inputs == MARRAM_NOTHING)
                return MARRAM_NOTHING; // the current frame stays valid
            const uint64_t previous_digest = instance.binding_digest;
            const MarramShape shape = instance.settings.shape;
            const auto basis = instance.settings.basis;
            apply_values(instance, Values(list), list);
            if (inputs != MARRAM_NOTHING || previous_digest != instance.binding_digest)
                instance.is_bound = false;
            const bool same_layout =
                instance.is_bound && shape == instance.settings.shape && basis == instance.settings.basis;
            return same_layout ? uint32_t(MARRAM_POSITIONS | MARRAM_ATTRIBUTES) : uint32_t(MARRAM_EVERYTHING);
        };
        return update_instance(instance.host, given, changed, strand_params(), take);
    });
}

MarramStatus import_attributes(MarramInstance* opaque, MarramAttributeList* out) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    const ImportInstance& instance = self_of(opaque);
    return guarded_import(instance.host, [&] {
        if (!out) throw SceneFault("contract.null_list", "", "the list is NULL", "pass a non-NULL pointer");
        const MarramAttributeList list{sizeof(MarramAttributeList), instance.attributes.data(),
                                       uint32_t(instance.attributes.size()), sizeof(MarramAttribute)};
        fill_known_part(list, out);
        return MARRAM_OK;
    });
}

// ---- A frame

void find_skin(ImportInstance& instance) {
    instance.mesh = nullptr;
    const ImportSettings& settings = instance.settings;
    if (settings.mesh.empty()) return;
    for (const MarramMesh& mesh : instance.meshes)
        if (mesh.instance_of == 0 && settings.mesh == mesh.name) instance.mesh = &mesh;
    if (!instance.mesh)
        throw SceneFault("strands.no_mesh", settings.mesh_place,
                         "there is no mesh '" + settings.mesh + "' to bind strands to",
                         "name one of the scene's");
}

constexpr size_t max_patches = std::numeric_limits<uint32_t>::max();

void find_strands(ImportInstance& instance) {
    const ImportSettings& settings = instance.settings;
    instance.curves = find_curves(instance.frame, settings.curves, settings.curves_place);
    const LentCurves& lent = instance.curves;
    if (lent.curves.moves && !instance.frame.pose_curves)
        throw SceneFault("contract.no_pose_curves", "", "MarramFrame.pose_curves is NULL",
                         "give a function that poses curves at any time, or static curves");
    instance.basis =
        settings.basis.value_or(lent.curves.basis == MARRAM_BSPLINE ? MARRAM_BSPLINE : MARRAM_CATMULL_ROM);
    for (const CurveFactor& factor : settings.wind_by) {
        const MarramAttribute* found = lent.find(factor.name);
        if (!found || found->rate != MARRAM_PER_CURVE || found->components != 1) {
            std::string known;
            for (const MarramAttribute& a : lent.attributes)
                if (a.rate == MARRAM_PER_CURVE && a.components == 1)
                    known += (known.empty() ? "" : ", ") + std::string(a.name);
            throw SceneFault("strands.no_attribute", factor.place,
                             "the curves '" + settings.curves + "' have no attribute '" + factor.name +
                                 "' of one number a curve",
                             known.empty() ? "leave it out" : "choose among " + known);
        }
    }
}

MarramStatus read_bind_poses(ImportInstance& instance) {
    const MarramFrame& frame = instance.frame;
    if (const MarramMesh* mesh = instance.mesh) {
        instance.bind_positions.resize(3 * size_t(mesh->vertex_count));
        instance.bind_normals.resize(mesh->normals ? instance.bind_positions.size() : 0);
        const MarramStatus status = pose_lent_mesh(frame, uint32_t(mesh - instance.meshes.data()),
                                                   frame.bind_frame, instance.bind_positions.data(),
                                                   mesh->normals ? instance.bind_normals.data() : nullptr);
        if (status != MARRAM_OK) return status;
    }
    const LentCurves& lent = instance.curves;
    instance.bind_vertices.clear();
    if (!lent.curves.moves) return MARRAM_OK;
    instance.bind_vertices.resize(4 * (lent.cv_count() + 2 * lent.count()));
    return pose_lent_curves(frame, lent.index, frame.bind_frame, 0, lent.count(), instance.bind_vertices);
}

void check_skin(const ImportInstance& instance) {
    double area = 0.0;
    const Surface bind = instance.bind_surface();
    for (uint32_t t = 0; t < bind.triangle_count; ++t) area += bind.area(t);
    if (!(area > 0.0))
        throw SceneFault("strands.no_area", instance.settings.mesh_place,
                         "the mesh '" + instance.settings.mesh + "' has no area",
                         "strands need a surface to be bound to");
}

void check_widths(const ImportInstance& instance) {
    if (instance.settings.width) return;
    for (const ImportPatch& patch : instance.patches)
        if (patch.max_radius > 0.0) return;
    if (instance.curves.count() == 0) return;
    throw SceneFault("strands.no_width", instance.settings.curves_place,
                     "the curves '" + instance.settings.curves + "' have no widths",
                     "give width = the diameter in metres");
}

void warn_of_binding(const ImportInstance& instance) {
    const Binding& binding = instance.binding;
    const std::string& mesh = instance.settings.mesh;
    if (const RootProblem problem = root_problem(binding, "strands", mesh); !problem.id.empty())
        instance.warn(("strands." + problem.id).c_str(), problem.what, problem.fix);
    if (binding.inside > 0 && instance.wind.collision)
        instance.warn(
            "strands.inside",
            fmt::format("{} of {} strands begin inside '{}', up to {:.3g} m deep, and are raised out",
                        binding.inside, binding.root_bindings.size(), mesh, binding.deepest),
            "move their roots to the surface where that shows");
    if (binding.no_length > 0)
        instance.warn(
            "strands.no_length",
            fmt::format("{} of {} strands have no length", binding.no_length, binding.root_bindings.size()),
            "remove them from the file");
}

// Digest of the data that the patches depend on.
uint64_t layout_digest(const LentCurves& lent) {
    const uint64_t numbers[] = {lent.count(), lent.curves.moves != 0, lent.curves.cvs_per_curve};
    const uint64_t digest = digest_bytes(numbers, sizeof numbers);
    return lent.curves.offsets
               ? digest_bytes(lent.curves.offsets, (lent.count() + 1) * sizeof(uint64_t), digest)
               : digest;
}

MarramStatus bind(ImportInstance& instance) {
    const double begin = wall_seconds();
    if (const MarramStatus status = read_bind_poses(instance); status != MARRAM_OK) return status;
    const auto cancelled = [&] { return instance.host.cancelled(instance.host.user) != 0; };
    make_patches(instance);
    instance.binding = {};
    if (instance.mesh) {
        check_skin(instance);
        instance.binding = bind_strands(instance.curves, instance.bind_pose(), instance.bind_surface(),
                                        instance.mesh->vertex_count, cancelled);
    }
    if (cancelled()) return MARRAM_CANCELLED;
    instance.is_bound = true;
    instance.bind_layout_digest = layout_digest(instance.curves);
    instance.bind_topology_digest = instance.mesh ? instance.mesh->topology : 0;
    instance.binding_seconds = wall_seconds() - begin;
    warn_of_binding(instance);
    return MARRAM_OK;
}

uint64_t bind_pose_digest(const ImportInstance& instance) {
    return Digest()
        .add(instance.bind_positions)
        .add(instance.bind_normals)
        .add(instance.bind_vertices)
        .value();
}

// The bind pose of an evolving terrain, for example, may differ between frames. If it does, binds the strands
// again.
MarramStatus rebind_if_changed(ImportInstance& instance) {
    const uint64_t before = bind_pose_digest(instance);
    if (const MarramStatus status = read_bind_poses(instance); status != MARRAM_OK) return status;
    return bind_pose_digest(instance) == before ? MARRAM_OK : bind(instance);
}

void check_still_bound(const ImportInstance& instance) {
    if (instance.mesh && instance.bind_topology_digest != instance.mesh->topology)
        throw SceneFault("strands.topology", instance.settings.mesh_place,
                         "the triangles of the mesh '" + instance.settings.mesh +
                             "' have changed since the strands were bound to it",
                         "keep its topology, or create the procedural again");
    if (instance.bind_layout_digest != layout_digest(instance.curves))
        throw SceneFault("strands.counts", instance.settings.curves_place,
                         "the numbers of curves or of CVs of '" + instance.settings.curves +
                             "' have changed since the strands were bound, or whether they move",
                         "keep them, or create the procedural again");
}

// Estimates how far the roots of moving curves travel, from about a thousand of them.
MarramStatus travel_of(const ImportInstance& instance, double& travel) {
    const LentCurves& lent = instance.curves;
    const MarramFrame& frame = instance.frame;
    travel = 0.0;
    const uint64_t step = std::max<uint64_t>(lent.count() / 1000, 1);
    std::vector<float> now, then;
    for (uint64_t c = 0; c < lent.count(); c += step) {
        now.resize(4 * (size_t(lent.cvs(c)) + 2));
        then.resize(now.size());
        MarramStatus status = pose_lent_curves(frame, lent.index, frame.times[0], c, 1, now);
        for (const double back : {1.0, 4.0, 16.0, 64.0, 256.0}) {
            if (status == MARRAM_OK)
                status = pose_lent_curves(frame, lent.index, frame.times[0] - back, c, 1, then);
            if (status != MARRAM_OK) return status;
            double squared = 0.0;
            for (size_t axis = 4; axis < 7; ++axis)
                squared += std::pow(double(now[axis]) - double(then[axis]), 2);
            travel = std::max(travel, std::sqrt(squared));
        }
    }
    return MARRAM_OK;
}

void announce_long_work(ImportInstance& instance, int64_t past_samples) {
    const auto strands = double(instance.curves.count()), cvs = double(instance.curves.cv_count()),
               meshes = double(instance.mesh_instances.size());
    LongWork work;
    // Few strands on a mesh leave lanes idle.
    work.cvs = strands > 0.0 ? meshes * cvs * std::max(lanes / strands, 1.0) : 0.0;
    work.cvs_per_strand = strands > 0.0 ? cvs / strands : 0.0;
    work.samples = instance.frame.time_count;
    work.past_samples = past_samples;
    work.collides = instance.wind.collision && instance.frame.stage == MARRAM_FINAL;
    work.remedy = "import strands of fewer CVs, ask for a larger tolerance, or stronger jiggle.damping";
    announce_long_work(instance.host, "strands.long_work", instance.settings.curves_place, work,
                       instance.frame.frame, instance.announced);
}

// Reads the skin's poses over the window of the jiggle.
MarramStatus read_jiggle_past(ImportInstance& instance) {
    instance.past = {};
    if (!instance.wind.jiggle || instance.frame.stage != MARRAM_FINAL) return MARRAM_OK;
    const Jiggle& jiggle = *instance.wind.jiggle;
    const MarramFrame& frame = instance.frame;
    double travel = 0.0;
    if (instance.curves.curves.moves)
        if (const MarramStatus status = travel_of(instance, travel); status != MARRAM_OK) return status;
    const double length = instance.longest + 0.5 * travel;
    if (instance.mesh) {
        double instance_travel = 0.0;
        if (const MarramStatus status = measure_travel(frame, instance.mesh_instances, instance_travel);
            status != MARRAM_OK)
            return status;
        return read_past(frame, uint32_t(instance.mesh - instance.meshes.data()), jiggle, length,
                         instance.past, instance_travel,
                         [&](int64_t samples) { announce_long_work(instance, samples); });
    }
    instance.past.window = jiggle_window(jiggle, std::span(frame.times, frame.time_count), frame.fps,
                                         2.0 * length, frame.tolerance);
    return MARRAM_OK;
}

// Places the mesh's instances at the past samples of jiggle. Sets `moved` if one was elsewhere.
MarramStatus sample_instances_past(ImportInstance& instance, bool& moved) {
    if (!instance.mesh || instance.past.window.count() == 0) return MARRAM_OK;
    return sample_past_transforms(instance.frame, *instance.wind.jiggle, instance.past.window,
                                  instance.mesh_instances, moved);
}

// A few strands of the most frequent CV count, for choosing the step of jiggle.
JigglePilot pilot_of(const ImportInstance& instance, double tolerance) {
    std::map<uint32_t, uint64_t> by_cvs;
    for (uint64_t c = 0; c < instance.curves.count(); ++c) ++by_cvs[instance.curves.cvs(c)];
    const auto most = std::ranges::max_element(by_cvs, {}, [](const auto& one) { return one.second; });
    const uint32_t cvs = most == by_cvs.end() ? 2 : most->first;
    const uint64_t count_of_cvs = most == by_cvs.end() ? 0 : most->second,
                   step = std::max<uint64_t>(count_of_cvs / 96, 1);
    std::vector<uint32_t> some;
    for (uint64_t c = 0, seen = 0; c < instance.curves.count() && some.size() < 96; ++c)
        if (instance.curves.cvs(c) == cvs && seen++ % step == 0) some.push_back(uint32_t(c));
    const size_t count = some.size();
    Eigen::AlignedBox3d rest = bounds_of_import(instance);
    return {instance.wind,
            instance.frame,
            instance.mesh,
            instance.settings.envelope,
            instance.basis,
            instance.longest,
            tolerance,
            rest,
            count,
            int(cvs),
            true,
            [&instance, cvs, some = std::move(some)](const Wind&, Strands& out) {
                const float* vertices = instance.bind_pose();
                if (!instance.mesh) return expand_imported(instance, nullptr, vertices, 0, some, cvs, out);
                const SkinPoses at_bind{instance.bind_surface(), instance.bind_surface()};
                expand_imported(instance, &at_bind, vertices, 0, some, cvs, out);
                scale_strands(out, max_instance_scale(instance.mesh_instances));
            }};
}

MarramStatus choose(ImportInstance& instance) {
    Wind& wind = instance.wind;
    const MarramFrame& frame = instance.frame;
    const double tolerance = frame.tolerance > 0.0 ? frame.tolerance : 1e-3 * instance.longest;
    const ChosenFor now{frame.frame, frame.times[0], frame.times[frame.time_count - 1], tolerance,
                        frame.stage};
    if (instance.chosen_for != now) {
        instance.inexact.clear();
        const auto add = [&](const std::string& what) {
            instance.inexact.push_back("the tolerance is not reached with " + what);
        };
        wind.noise.left_out = negligible_octaves(wind, instance.longest, tolerance);
        if (instance.automatic_rays) {
            bool enough = true;
            const bool many_reference_segments = wind.reference_segments > 2 * int(instance.fewest_cvs);
            wind.shielding->rays = cone_rays(*wind.shielding, instance.longest, max_turn_fraction(wind),
                                             many_reference_segments, tolerance, enough);
            if (!enough) add("wind.shielding.rays = " + std::to_string(wind.shielding->rays));
        }
        if (instance.automatic_step) {
            wind.jiggle->step = default_jiggle_step;
            if (frame.stage == MARRAM_FINAL) {
                if (const MarramStatus status = read_jiggle_past(instance); status != MARRAM_OK)
                    return status;
                bool instances_moved = false;
                if (const MarramStatus status = sample_instances_past(instance, instances_moved);
                    status != MARRAM_OK)
                    return status;
                const bool moves =
                    instance.past.moves() || instances_moved || instance.curves.curves.moves != 0;
                const Choice choice = jiggle_step_for(pilot_of(instance, tolerance), moves);
                wind.jiggle->step = choice.value;
                if (!choice.enough) add(fmt::format("wind.jiggle.step = {:.6g}", choice.value));
            }
        }
        instance.chosen_for = now;
    }
    for (const std::string& text : instance.inexact)
        instance.warn("strands.inexact", text, "set it by hand, or give a larger tolerance");
    return MARRAM_OK;
}

bool strands_move(const ImportInstance& instance) {
    const bool blown = instance.frame.stage != MARRAM_REST;
    return instance.moves() ||
           (blown && (wind_moves(instance.wind) || moving_meshes_matter(instance.wind, instance.frame)));
}

MarramStatus begin_import(MarramInstance* opaque, const MarramFrame* frame, MarramOutput* out) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    ImportInstance& instance = self_of(opaque);
    return guarded_import(instance.host, [&] {
        instance.begun = false;
        if (!out)
            throw SceneFault("contract.null_output", "", "the output is NULL", "pass a non-NULL pointer");
        instance.frame = borrowed_frame(frame, instance.meshes);
        if ((instance.wind.collision || instance.wind.shielding) && instance.frame.mesh_count > 0 &&
            !instance.frame.colliders)
            throw SceneFault("contract.no_colliders", "", "MarramFrame.colliders is NULL",
                             "pass the committed scene of the frame's meshes");
        instance.workers.clear();
        instance.binding_seconds = 0.0;
        find_skin(instance);
        find_strands(instance);
        if (!instance.is_bound)
            if (const MarramStatus status = bind(instance); status != MARRAM_OK) return status;
        check_still_bound(instance);
        if (const MarramStatus status = rebind_if_changed(instance); status != MARRAM_OK) return status;
        check_widths(instance);
        MarramStatus status = MARRAM_OK;
        instance.mesh_instances.assign(1, MeshInstance{instance.mesh});
        if (instance.mesh)
            status = find_mesh_instances(instance.frame, *instance.mesh, instance.mesh_instances);
        if (status != MARRAM_OK) return status;
        if (instance.mesh_instances.size() > max_patches / std::max<size_t>(instance.patches.size(), 1))
            throw SceneFault("strands.too_many", instance.settings.curves_place,
                             fmt::format("{} strands on {} meshes are too many", instance.curves.count(),
                                         instance.mesh_instances.size()),
                             "write fewer instances");
        instance.longest = longest_in_frame(instance) * max_instance_scale(instance.mesh_instances);
        status = set_gust_plane_once(instance.host, instance.frame, instance.bind_box, instance.wind,
                                     instance.gust_start);
        if (status == MARRAM_OK) status = choose(instance);
        if (status == MARRAM_OK) status = read_jiggle_past(instance);
        if (status != MARRAM_OK) return status;
        bool moves = strands_move(instance), instances_moved = false;
        status = sample_instances_past(instance, instances_moved);
        if (status != MARRAM_OK) return status;
        if (instance.past.window.count() > 0) {
            // Without motion there is no jiggle.
            if (instance.past.moves() || instances_moved || instance.curves.curves.moves ||
                wind_moves(instance.wind))
                moves = true;
            else
                instance.past = {};
        }
        instance.time_count = moves ? instance.frame.time_count : 1;
        instance.frame.time_count = instance.time_count; // the motion samples that the chain computes
        const double before = wall_seconds();
        instance.chain = {}; // release the last frame's trees before building new ones
        const Eigen::AlignedBox3d query_bounds =
            instance.wind.collision ? bounds_of_import(instance) : everywhere();
        instance.chain = make_chain_frame({instance.wind,
                                           instance.settings.envelope,
                                           instance.frame,
                                           instance.mesh,
                                           {},
                                           instance.basis,
                                           instance.past.window,
                                           query_bounds,
                                           everywhere(),
                                           &instance.trees});
        warn_of_gusts(instance.host, instance.settings.curves_place, instance.chain);
        instance.gust_bounds = instance.wind.gusts ? bounds_of_import(instance) : Eigen::AlignedBox3d();
        if (!instance.gusts_checked && !instance.moves() && !instance.curves.curves.moves &&
            !(instance.mesh && instance.mesh->moves != 0))
            warn_of_untouching_gusts(instance.host, instance.wind, instance.frame, instance.gust_bounds);
        instance.gusts_checked = true;
        announce_long_work(instance, instance.past.window.count());
        instance.prepare_seconds = wall_seconds() - before;
        const MarramCurves& lent = instance.curves.curves;
        MarramOutput output{};
        output.kind = MARRAM_CURVES;
        output.curve_count = instance.mesh_instances.size() * lent.curve_count;
        output.cvs_per_curve = lent.offsets ? 0 : lent.cvs_per_curve;
        output.offsets = lent.offsets;
        if (lent.offsets && lent.curve_count > 0) { // a fixed CV count is faster to trace
            const uint32_t cvs = instance.curves.cvs(0);
            bool same = true;
            for (uint64_t c = 1; same && c < lent.curve_count; ++c) same = instance.curves.cvs(c) == cvs;
            if (same) {
                output.cvs_per_curve = cvs;
                output.offsets = nullptr;
            }
        }
        if (lent.curve_count == 0) output.cvs_per_curve = 2;
        instance.offsets.clear();
        if (output.offsets && instance.mesh_instances.size() > 1) {
            for (size_t i = 0; i < instance.mesh_instances.size(); ++i)
                for (uint64_t c = 0; c < lent.curve_count; ++c)
                    instance.offsets.push_back(i * instance.curves.cv_count() + lent.offsets[c]);
            instance.offsets.push_back(instance.mesh_instances.size() * instance.curves.cv_count());
            output.offsets = instance.offsets.data();
        }
        output.patch_count = instance.patch_count();
        output.time_count = instance.time_count;
        output.basis = instance.basis;
        output.shape = instance.settings.shape;
        fill_known_part(output, out);
        instance.begun = true;
        return MARRAM_OK;
    });
}

void check_import_patch(const ImportInstance& instance, uint32_t index) {
    if (!instance.begun) throw SceneFault("contract.no_frame", "", "no frame has begun", "call begin first");
    if (index >= instance.patch_count())
        throw SceneFault("contract.patch_range", "", "there is no patch " + std::to_string(index),
                         "ask for one below MarramOutput.patch_count, " +
                             std::to_string(instance.patch_count()));
}

MarramStatus patch_of_import(MarramInstance* opaque, uint32_t index, MarramPatch* out) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    const ImportInstance& instance = self_of(opaque);
    return guarded_import(instance.host, [&] {
        if (!out) throw SceneFault("contract.null_patch", "", "the patch is NULL", "pass a non-NULL pointer");
        check_import_patch(instance, index);
        MarramPatch patch{};
        import_patch_bounds(instance, index, &patch);
        fill_known_part(patch, out);
        return MARRAM_OK;
    });
}

MarramStatus tessellate_import(MarramInstance* opaque, uint32_t index, const MarramPatchBuffers* buffers) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    ImportInstance& instance = self_of(opaque);
    if (instance.host.cancelled(instance.host.user)) return MARRAM_CANCELLED;
    return guarded_import(instance.host, [&] {
        check_import_patch(instance, index);
        check_buffers(buffers, instance.time_count, instance.settings.shape == MARRAM_ORIENTED_RIBBON,
                      instance.attributes.size());
        Worker& worker = instance.workers.local();
        const ImportPatchOnMesh on = instance.patch_at(index);
        const ImportPatch& patch = on.patch;
        Strands& strands = worker.strands;
        strands.instance = on.mesh_instance.is_instance ? on.mesh_instance.mesh : nullptr;
        strands.has_wind_share = !instance.settings.wind_by.empty();
        strands.irregular = true;
        const uint32_t rest_time_count =
            std::max(instance.mesh ? instance.mesh->time_count : 1U, instance.curves.curves.time_count);
        for (const auto& run : patch.runs) {
            const std::span curves(patch.order.data() + run[0], run[1] - run[0]);
            const ImportBatch batch{instance, patch, on.mesh_instance, curves,
                                    instance.curves.cvs(patch.first + curves[0])};
            strands.resize(int(curves.size()), int(batch.cvs),
                           instance.settings.shape == MARRAM_ORIENTED_RIBBON);
            const RestStrandSource rest_strands = imported_rest_strands(batch, worker.chain.clock);
            if (instance.past.window.count() > 0)
                jiggle_patch(instance.chain, rest_strands, strands, worker.chain);
            for (uint32_t time = 0; time < instance.time_count; ++time) {
                // If skin and curves are static, later motion samples reuse the rest strands.
                if (time < rest_time_count || on.mesh_instance.moves()) rest_strands.at_time(time, strands);
                run_chain(instance.chain, time, strands, worker.chain);
                const StageTimer timer(worker.chain.clock.write);
                write_import_vertices(batch, strands, buffers->vertices[time]);
                if (strands.oriented) write_import_normals(batch, strands, buffers->normals[time]);
                if (time == 0) write_import_attributes(batch, strands, *buffers);
            }
        }
        write_file_attributes(instance, patch, *buffers);
        return MARRAM_OK;
    });
}

MarramStatus summarize_import(MarramInstance* opaque, void (*sink)(void*, const char*), void* user) {
    if (!opaque) return MARRAM_ERROR; // no host to report to
    const ImportInstance& instance = self_of(opaque);
    return guarded_import(instance.host, [&] {
        if (!sink) throw SceneFault("contract.null_sink", "", "the sink is NULL", "pass a function");
        if (!instance.begun)
            throw SceneFault("contract.no_frame", "", "no frame has begun", "call begin first");
        sink(user, wind_summary(instance.wind, instance.frame, instance.gust_bounds).c_str());
        return MARRAM_OK;
    });
}

void report_import(MarramInstance* opaque, void (*sink)(void*, const char*, double), void* user) {
    if (!opaque || !sink) return;
    ImportInstance& instance = self_of(opaque);
    size_t scratch = 0;
    const CollisionCounts counts = report_chain(instance.workers, sink, user, scratch);
    warn_of_collisions(instance.host, instance.settings.curves_place, instance.settings.mesh,
                       instance.time_count > 1, counts);
    const Wind& wind = instance.wind;
    if (instance.automatic_rays) sink(user, "chosen.shield_rays", wind.shielding->rays);
    if (instance.automatic_step && instance.past.window.count() > 0)
        sink(user, "chosen.jiggle_step", wind.jiggle->step);
    if (wind.noise.left_out > 0) sink(user, "chosen.octaves", wind.noise.octaves - wind.noise.left_out);
    sink(user, "seconds.bind", instance.binding_seconds);
    sink(user, "seconds.prepare_wind", instance.prepare_seconds);
    const Binding& binding = instance.binding;
    sink(user, "binding.strands", double(binding.root_bindings.size()));
    sink(user, "binding.greatest_distance", binding.greatest_distance);
    sink(user, "binding.mean_distance", binding.mean_distance);
    sink(user, "binding.far", double(binding.far));
    sink(user, "binding.inside", double(binding.inside));
    sink(user, "binding.deepest", binding.deepest);
    sink(user, "binding.no_length", double(binding.no_length));
    size_t lists = 0;
    for (const ImportPatch& patch : instance.patches)
        lists += sizeof patch + patch.order.capacity() * 4 + patch.runs.capacity() * 8;
    sink(user, "memory.curve_extra_bytes",
         double(binding.root_bindings.capacity() * sizeof(RootBinding) + lists +
                (instance.bind_positions.capacity() + instance.bind_normals.capacity() +
                 instance.bind_vertices.capacity()) *
                    sizeof(float) +
                instance.past.bytes() + instance.trees.bytes() + instance.chain.gust_bytes() + scratch +
                instance.offsets.capacity() * sizeof(uint64_t)));
    if (instance.mesh_instances.size() < 2) return;
    sink(user, "instances.count", double(instance.mesh_instances.size() - 1));
    sink(user, "instances.shared_bytes",
         double(binding.root_bindings.capacity() * sizeof(RootBinding) + lists +
                (instance.bind_positions.capacity() + instance.bind_normals.capacity() +
                 instance.bind_vertices.capacity()) *
                    sizeof(float) +
                instance.past.bytes()));
}

void destroy_import(MarramInstance* opaque) {
    delete reinterpret_cast<ImportInstance*>(opaque);
} // NULL is fine

} // namespace

MarramProcedural strands_procedural() {
    MarramProcedural procedural{};
    procedural.name = "strands";
    procedural.help = "hair, fur or grass that was groomed elsewhere, on a mesh or in the open, and bends in "
                      "the scene's wind";
    procedural.kind = MARRAM_CURVES;
    procedural.params = strand_params().data();
    procedural.param_count = uint32_t(strand_params().size());
    procedural.param_stride = sizeof(MarramParam);
    procedural.attributes = computed_attributes().data();
    procedural.attribute_count = uint32_t(computed_attributes().size());
    procedural.attribute_stride = sizeof(MarramAttribute);
    procedural.create = create_import;
    procedural.summarize = summarize_import;
    procedural.begin = begin_import;
    procedural.patch = patch_of_import;
    procedural.tessellate = tessellate_import;
    procedural.report = report_import;
    procedural.destroy = destroy_import;
    procedural.update = update_import;
    procedural.attributes_of = import_attributes;
    return procedural;
}

std::span<const MarramReportEntry> strands_report_entries() {
    static constexpr auto entry = [](const char* path, const char* unit, MarramCombine combine,
                                     const char* help) {
        return MarramReportEntry{path, unit, combine, nullptr, nullptr, help};
    };
    static constexpr std::array entries = {
        entry("seconds.bind", "s", MARRAM_SUM, "binding imported strands to their mesh"),
        entry("binding.strands", "count", MARRAM_SUM, "strands that are bound to a mesh"),
        entry("binding.greatest_distance", "m", MARRAM_MAXIMUM, "of a root from its mesh, as in the file"),
        entry("binding.mean_distance", "m", MARRAM_EACH, "of roots from their mesh, as in the file"),
        entry("binding.far", "count", MARRAM_SUM, "roots farther away than a tenth of their strand's length"),
        entry("binding.inside", "count", MARRAM_SUM, "roots under the skin, as in the file"),
        entry("binding.deepest", "m", MARRAM_MAXIMUM, "how deep the deepest of them is"),
        entry("binding.no_length", "count", MARRAM_SUM, "strands without length"),
    };
    return entries;
}

} // namespace marram
