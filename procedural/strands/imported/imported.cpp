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
#include "core/math/clock.h"
#include "core/math/digest.h"
#include "procedural/abi/border.h"
#include "procedural/strands/imported/imported_instance.h"
#include "procedural/strands/imported/imported_output.h"
#include "procedural/strands/imported/imported_shape.h"
#include "procedural/strands/pilot.h"
#include "procedural/strands/wind_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>

namespace marram {

const std::vector<MarramParam>& ImportInstance::params() {
    static const std::vector<MarramParam> params = with_wind_params(import_params());
    return params;
}

std::span<const MarramAttribute> ImportInstance::type_attributes() { return computed_attributes(); }

// ---- Values

void ImportInstance::take(std::span<const MarramValue> list) {
    const Values given(list);
    ImportSettings read = read_import(given);
    for (const PassedAttribute& a : read.passed_attributes)
        for (const std::string_view computed : {"envelope", "gust", "shield", "contact"})
            if (a.name == computed)
                send(host, MARRAM_WARNING, "strands.attribute_replaced", given.at("curves").place,
                     "the file's attribute '" + a.name +
                         "' is not taken over: the wind computes one of that name",
                     "rename it in the file where it is needed");
    Wind blown = read_wind(given);
    if (blown.point_envelope) read.envelope = *blown.point_envelope;
    if (read.mesh.empty() && blown.collision && blown.collision->offset_scale)
        throw SceneFault("strands.no_skin", given.at("curves").place,
                         "wind.collision.offset_scale needs the skin that strands grow on",
                         "name it: on = \"...\"");
    warn_of_idle_wind(host, given, blown);
    settings = std::move(read);
    take_wind(std::move(blown));
    attributes = import_attribute_list(settings);
    values_digest = digest_of_values(list);
    binding_digest = marram::binding_digest(settings);
}

// Strands stay bound if neither the binding settings nor the geometry have changed.
uint32_t ImportInstance::update(std::span<const MarramValue> list, uint32_t inputs) {
    if (digest_of_values(list) == values_digest && inputs == MARRAM_NOTHING)
        return MARRAM_NOTHING; // the current frame stays valid
    const uint64_t previous_digest = binding_digest;
    const MarramShape shape = settings.shape;
    const auto previous_basis = settings.basis;
    take(list);
    if (inputs != MARRAM_NOTHING || previous_digest != binding_digest) is_bound = false;
    const bool same_layout = is_bound && shape == settings.shape && previous_basis == settings.basis;
    return same_layout ? uint32_t(MARRAM_POSITIONS | MARRAM_ATTRIBUTES) : uint32_t(MARRAM_EVERYTHING);
}

namespace {

// ---- Mesh and curves

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

void read_bind_poses(ImportInstance& instance) {
    const MarramFrame& frame = instance.frame;
    if (const MarramMesh* mesh = instance.mesh) {
        instance.bind_positions.resize(3 * size_t(mesh->vertex_count));
        instance.bind_normals.resize(mesh->normals ? instance.bind_positions.size() : 0);
        pose_lent_mesh(frame, instance.mesh_index(), frame.bind_frame, instance.bind_positions.data(),
                       mesh->normals ? instance.bind_normals.data() : nullptr);
    }
    const LentCurves& lent = instance.curves;
    instance.bind_vertices.clear();
    if (!lent.curves.moves) return;
    instance.bind_vertices.resize(4 * (lent.cv_count() + 2 * lent.count()));
    pose_lent_curves(frame, lent.index, frame.bind_frame, 0, lent.count(), instance.bind_vertices);
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

void bind(ImportInstance& instance) {
    const double begin = wall_seconds();
    read_bind_poses(instance);
    make_patches(instance);
    instance.binding = {};
    if (instance.mesh) {
        check_skin(instance);
        instance.binding = bind_strands(instance.curves, instance.bind_pose(), instance.bind_surface(),
                                        instance.mesh->vertex_count, [&] { return instance.cancelled(); });
    }
    instance.stop_if_cancelled();
    instance.is_bound = true;
    instance.bind_layout_digest = layout_digest(instance.curves);
    instance.bind_topology_digest = instance.mesh ? instance.mesh->topology : 0;
    instance.begin_seconds.place += wall_seconds() - begin;
    warn_of_binding(instance);
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
bool rebind_if_changed(ImportInstance& instance) {
    const uint64_t before = bind_pose_digest(instance);
    read_bind_poses(instance);
    if (bind_pose_digest(instance) == before) return false;
    instance.is_bound = false; // if binding is cancelled
    bind(instance);
    return true;
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

} // namespace

// ---- A frame

void ImportInstance::lay_out() {
    find_skin(*this);
    find_strands(*this);
    if (!is_bound) {
        forget_past();
        bind(*this);
    }
    check_still_bound(*this);
    if (rebind_if_changed(*this)) forget_past();
    if (wind.jiggle) { // curves that a procedural makes may differ from frame to frame
        Digest digest;
        if (!curves.curves.moves)
            digest.add(vertices(0), 4 * sizeof(float) * (curves.cv_count() + 2 * curves.count()));
        for (const CurveFactor& factor : settings.wind_by)
            digest.add(curves.find(factor.name)->values, curves.count() * sizeof(float));
        if (digest.value() != past_digest) forget_past();
        past_digest = digest.value();
    }
    check_widths(*this);
    mesh_instances.assign(1, MeshInstance{mesh});
    if (mesh) mesh_instances = find_mesh_instances(frame, *mesh);
    if (mesh_instances.size() > max_patches / std::max<size_t>(patches.size(), 1))
        throw SceneFault(
            "strands.too_many", settings.curves_place,
            fmt::format("{} strands on {} meshes are too many", curves.count(), mesh_instances.size()),
            "write fewer instances");
    longest_now = longest_in_frame(*this) * max_instance_scale(mesh_instances);
}

// From the roots of about a thousand curves.
double ImportInstance::travel_of_curves() const {
    double travel = 0.0;
    const uint64_t step = std::max<uint64_t>(curves.count() / 1000, 1);
    std::vector<float> now, then;
    for (uint64_t c = 0; c < curves.count(); c += step) {
        now.resize(4 * (size_t(curves.cvs(c)) + 2));
        then.resize(now.size());
        pose_lent_curves(frame, curves.index, frame.times[0], c, 1, now);
        for (const double back : {1.0, 4.0, 16.0, 64.0, 256.0}) {
            pose_lent_curves(frame, curves.index, frame.times[0] - back, c, 1, then);
            double squared = 0.0;
            for (size_t axis = 4; axis < 7; ++axis)
                squared += std::pow(double(now[axis]) - double(then[axis]), 2);
            travel = std::max(travel, std::sqrt(squared));
        }
    }
    return travel;
}

LongWork ImportInstance::work() const {
    const auto strands = double(curves.count()), cvs = double(curves.cv_count());
    LongWork amount;
    // Few strands on a mesh leave lanes idle.
    amount.cvs = strands > 0.0 ? double(mesh_instances.size()) * cvs * std::max(lanes / strands, 1.0) : 0.0;
    amount.cvs_per_strand = strands > 0.0 ? cvs / strands : 0.0;
    amount.remedy = "import strands of fewer CVs, ask for a larger tolerance, or stronger jiggle.damping";
    return amount;
}

// A few strands of the most frequent CV count, for choosing the step of jiggle.
JigglePilot ImportInstance::pilot(double tolerance, size_t strands) const {
    const ImportInstance& instance = *this;
    std::map<uint32_t, uint64_t> by_cvs;
    for (uint64_t c = 0; c < instance.curves.count(); ++c) ++by_cvs[instance.curves.cvs(c)];
    const auto most = std::ranges::max_element(by_cvs, {}, [](const auto& one) { return one.second; });
    const uint32_t cvs = most == by_cvs.end() ? 2 : most->first;
    const uint64_t count_of_cvs = most == by_cvs.end() ? 0 : most->second,
                   step = std::max<uint64_t>(count_of_cvs / strands, 1);
    std::vector<uint32_t> some;
    for (uint64_t c = 0, seen = 0; c < instance.curves.count() && some.size() < strands; ++c)
        if (instance.curves.cvs(c) == cvs && seen++ % step == 0) some.push_back(uint32_t(c));
    const size_t count = some.size();
    return {instance.wind,
            instance.frame,
            instance.mesh,
            instance.settings.envelope,
            instance.basis,
            instance.longest_now,
            tolerance,
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

Eigen::AlignedBox3d ImportInstance::bounds() const { return bounds_of_import(*this); }

ChainFrame ImportInstance::make_chain(PastWind* earlier) {
    return make_chain_frame({wind,
                             settings.envelope,
                             frame,
                             mesh,
                             {},
                             basis,
                             past.window,
                             wind.collision ? bounds() : everywhere(),
                             everywhere(),
                             &trees,
                             earlier,
                             ground});
}

MarramOutput ImportInstance::output() {
    const MarramCurves& lent = curves.curves;
    MarramOutput output{};
    output.kind = MARRAM_CURVES;
    output.curve_count = mesh_instances.size() * lent.curve_count;
    output.cvs_per_curve = lent.offsets ? 0 : lent.cvs_per_curve;
    output.offsets = lent.offsets;
    if (lent.offsets && lent.curve_count > 0) { // a fixed CV count is faster to trace
        const uint32_t cvs = curves.cvs(0);
        bool same = true;
        for (uint64_t c = 1; same && c < lent.curve_count; ++c) same = curves.cvs(c) == cvs;
        if (same) {
            output.cvs_per_curve = cvs;
            output.offsets = nullptr;
        }
    }
    if (lent.curve_count == 0) output.cvs_per_curve = 2;
    offsets.clear();
    if (output.offsets && mesh_instances.size() > 1) {
        for (size_t i = 0; i < mesh_instances.size(); ++i)
            for (uint64_t c = 0; c < lent.curve_count; ++c)
                offsets.push_back(i * curves.cv_count() + lent.offsets[c]);
        offsets.push_back(mesh_instances.size() * curves.cv_count());
        output.offsets = offsets.data();
    }
    output.patch_count = patch_count();
    output.time_count = time_count;
    output.basis = basis;
    output.shape = settings.shape;
    return output;
}

MarramPatch ImportInstance::patch(uint32_t index) const { return import_patch_bounds(*this, index); }

void ImportInstance::tessellate(uint32_t index, const MarramPatchBuffers& buffers) {
    Worker& worker = workers.local();
    const ImportPatchOnMesh on = patch_at(index);
    const ImportPatch& patch = on.patch;
    Strands& strands = worker.strands;
    strands.instance = on.mesh_instance.is_instance ? on.mesh_instance.mesh : nullptr;
    strands.has_wind_share = !settings.wind_by.empty();
    strands.has_contact = asks_for_contact(*this, buffers);
    strands.irregular = true;
    for (const auto& run : patch.runs) {
        const std::span numbers(patch.order.data() + run[0], run[1] - run[0]);
        const ImportBatch batch{*this, patch, on.mesh_instance, numbers,
                                curves.cvs(patch.first + numbers[0])};
        strands.resize(int(numbers.size()), int(batch.cvs), oriented());
        const RestStrandSource rest_strands = imported_rest_strands(batch, worker.chain.clock);
        const bool jiggles = !past.window.empty();
        const auto run_index = size_t(&run - patch.runs.data());
        if (jiggles) {
            const KeptState kept = kept_state(index, run_index, strands);
            jiggle_patch(chain, rest_strands, strands, worker.chain, index % uint32_t(patches.size()),
                         kept.get());
        }
        for (uint32_t time = 0; time < time_count; ++time) {
            // If skin and curves are static, later motion samples reuse the rest strands.
            if (rest_strands.moves || (time == 0 && !jiggles)) rest_strands.at_time(time, strands);
            run_chain(chain, time, strands, worker.chain);
            const StageTimer timer(worker.chain.clock.expand);
            write_import_vertices(batch, strands, buffers.vertices[time]);
            if (strands.oriented) write_import_normals(batch, strands, buffers.normals[time]);
            if (time == 0) write_import_attributes(batch, strands, buffers);
        }
    }
    write_file_attributes(*this, patch, buffers);
}

// ---- Statistics

void ImportInstance::report_own(const ReportSink& sink) const {
    sink("seconds.bind", begin_seconds.place);
    sink("binding.strands", double(binding.root_bindings.size()));
    sink("binding.greatest_distance", binding.greatest_distance);
    sink("binding.mean_distance", binding.mean_distance);
    sink("binding.far", double(binding.far));
    sink("binding.inside", double(binding.inside));
    sink("binding.deepest", binding.deepest);
    sink("binding.no_length", double(binding.no_length));
}

StrandInstance::Bytes ImportInstance::bytes() const {
    size_t lists = 0;
    for (const ImportPatch& patch : patches)
        lists += sizeof patch + patch.order.capacity() * 4 + patch.runs.capacity() * 8;
    return {binding.root_bindings.capacity() * sizeof(RootBinding) + lists +
                (bind_positions.capacity() + bind_normals.capacity() + bind_vertices.capacity()) *
                    sizeof(float),
            offsets.capacity() * sizeof(uint64_t), 0};
}

std::span<const MarramReportEntry> ImportInstance::report_entries() {
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
