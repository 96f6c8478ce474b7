// SPDX-License-Identifier: Apache-2.0
#include "core/math/clock.h"
#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"
#include "procedural/strands/grown/groom_bounds.h"
#include "procedural/strands/grown/groom_canopy.h"
#include "procedural/strands/grown/groom_instance.h"
#include "procedural/strands/grown/groom_output.h"
#include "procedural/strands/grown/groom_placing.h"
#include "procedural/strands/grown/groom_warnings.h"
#include "procedural/strands/grown/guide_motion.h"
#include "procedural/strands/rest_strands.h"
#include "procedural/strands/wind_words.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>
#include <new>
#include <optional>
#include <string>

namespace marram {

const std::vector<MarramParam>& GroomInstance::params() {
    static const std::vector<MarramParam> params = with_wind_params(groom_params());
    return params;
}

std::span<const MarramAttribute> GroomInstance::type_attributes() { return groom_attributes(); }

// ---- Values

// Settings parsed from the host's values.
struct ParsedGroom {
    Groom groom;
    Wind wind;
    uint64_t roots_digest = 0, values_digest = 0;
};

namespace {

ParsedGroom parse(const MarramHost& host, std::span<const MarramValue> list) {
    const Values given(list);
    ParsedGroom parsed;
    parsed.groom = read_groom(given);
    const std::optional<Blade>& blade = parsed.groom.blade;
    parsed.wind = blade ? read_wind(given, natural_frequency(*blade, blade->mean_length)) : read_wind(given);
    if (parsed.wind.point_envelope) parsed.groom.envelope = *parsed.wind.point_envelope;
    warn_invisible_strands(host, given, parsed.groom);
    warn_of_ignored(host, given, parsed.groom);
    warn_of_idle_wind(host, given, parsed.wind);
    if (blade) warn_of_heavy_blade(host, *blade);
    // "Those of the strand" needs a strand: with automatic CVs, one of 8 CVs.
    constexpr int segments_of_automatic_cvs = 7;
    if (parsed.groom.cvs == 0 && parsed.wind.reference_segments == 0)
        parsed.wind.reference_segments = segments_of_automatic_cvs;
    parsed.roots_digest = roots_digest(given);
    parsed.values_digest = digest_of_values(list);
    return parsed;
}

} // namespace

void GroomInstance::apply(ParsedGroom parsed) {
    groom = std::move(parsed.groom);
    automatic.cvs = groom.cvs == 0;
    canopy.reset();
    take_wind(std::move(parsed.wind));
    roots_digest = parsed.roots_digest;
    values_digest = parsed.values_digest;
}

void GroomInstance::take(std::span<const MarramValue> list) { apply(parse(host, list)); }

// Roots are kept unless the mesh, the guides or the values that place them change. Collider trees are kept;
// make_chain_frame() rebuilds them if meshes or query bounds have changed.
uint32_t GroomInstance::update(std::span<const MarramValue> list, uint32_t inputs) {
    ParsedGroom parsed = parse(host, list);
    if (parsed.values_digest == values_digest && inputs == MARRAM_NOTHING) return MARRAM_NOTHING;
    const bool same_roots = parsed.roots_digest == roots_digest;
    // Only begin() can compare the meshes: mesh_may_differ tells it to.
    const bool uses_guides = parsed.groom.guides.has_value();
    const bool uses_attributes = !parsed.groom.density_masks.factors.empty();
    const uint32_t placement_inputs =
        MARRAM_POSITIONS | MARRAM_TOPOLOGY | (uses_attributes ? uint32_t(MARRAM_ATTRIBUTES) : 0U);
    const bool same_mesh = (inputs & placement_inputs) == 0;
    const bool same_layout = same_roots && same_mesh && !(uses_guides && inputs != MARRAM_NOTHING) &&
                             parsed.groom.cvs != 0 && !automatic.cvs && !parsed.groom.level_of_detail &&
                             parsed.groom.cvs == groom.cvs && parsed.groom.basis == groom.basis &&
                             parsed.groom.shape == groom.shape;
    apply(std::move(parsed));
    if (!same_roots || (uses_guides && inputs != MARRAM_NOTHING)) placed = false;
    if (!same_mesh) mesh_may_differ = true;
    return same_layout ? uint32_t(MARRAM_POSITIONS | MARRAM_ATTRIBUTES) : uint32_t(MARRAM_EVERYTHING);
}

// ---- A frame

void GroomInstance::lay_out() {
    find_mesh(*this);
    prepare_images(*this);
    resolve_attributes(groom, attributes);
    if (placed && !mesh_may_differ && placed_topology_digest != topology_digest(*mesh))
        throw SceneFault("groom.topology", groom.mesh_place,
                         "the mesh '" + groom.mesh +
                             "' has other triangles than when its strands were placed",
                         "keep its topology, or create the procedural again");
    mesh_instances = find_mesh_instances(frame, *mesh);
    lod = level_of_detail_of(groom, frame);
    if (placed) invalidate_roots_if_mesh_changed(*this);
    if (!placed) {
        forget_past();
        place_strands(*this);
        place_sample(*this);
        warn_of_no_strands(*this);
    } else if (digest_of_levels(*this) != placed_levels_digest) {
        place_strands(*this);
        if (lod && sample.empty()) place_sample(*this);
    }
    if (wind.jiggle) { // attributes may scale lengths or the wind, and differ from frame to frame
        Digest digest;
        for (const Factors* factors : factors_of(groom))
            for (const Factor& factor : *factors) {
                if (factor.image) continue; // included in the digest of the values
                const MarramAttribute& attribute = attributes[factor.index];
                const size_t count =
                    attribute.rate == MARRAM_PER_FACE ? mesh->triangle_count : mesh->vertex_count;
                digest.add(attribute.values, count * sizeof(float));
            }
        if (digest.value() != attributes_digest) forget_past();
        attributes_digest = digest.value();
    }
    made = choose_strands(*this);
    if (guides) groom.length = {0.0, guides->longest_child()};
    find_canopy(*this);
}

PilotGroom GroomInstance::pilot_groom() const {
    return {groom,
            wind,
            frame,
            *mesh,
            lod ? sample : roots,
            poses(0).bind,
            lod ? guided(sample_blends, 0, sample.size()) : guided(0, roots.size()),
            max_instance_scale(mesh_instances)};
}

JigglePilot GroomInstance::pilot(double tolerance, size_t strands) const {
    return jiggle_pilot(pilot_groom(), tolerance, strands);
}

void GroomInstance::choose_cvs() {
    if (automatic.cvs) {
        const Choice choice = cvs_for(pilot_groom());
        groom.cvs = int(choice.value);
        if (!choice.enough) inexact.push_back("cvs = " + std::to_string(groom.cvs));
    }
    if (groom.blade) resolve_blades(wind, groom.cvs, longest(), frame.tolerance, *groom.blade);
    radius_profile.clear();
    for (int k = 0; k < groom.cvs; ++k)
        radius_profile.push_back(float(0.5 * groom.width_profile(double(k) / double(groom.cvs - 1))));
}

LongWork GroomInstance::work() const {
    LongWork amount;
    amount.cvs = double(made.curves) * groom.cvs;
    amount.cvs_per_strand = groom.cvs;
    amount.remedy = "ask for fewer strands or CVs, a larger tolerance, or stronger jiggle.damping";
    return amount;
}

Eigen::AlignedBox3d GroomInstance::bounds() const { return bounds_at_rest(*this); }

ChainFrame GroomInstance::make_chain(PastWind* earlier) {
    return make_chain_frame({wind, groom.envelope, frame, mesh, radius_profile, groom.basis, past.window,
                             wind.collision ? bounds_of_strands(*this) : everywhere(),
                             wind.gusts ? bounds_at_rest(*this) : everywhere(), &trees, earlier, ground,
                             canopy.get(), blade()});
}

void GroomInstance::finish_frame() {
    warn_of_rounding(*this);
    warn_of_length(*this);
    blow_guides(*this);
}

MarramOutput GroomInstance::output() {
    MarramOutput output{};
    output.kind = MARRAM_CURVES;
    made.number_patches(uint32_t(strands_per_patch(groom.cvs)));
    output.curve_count = made.curves;
    output.all_curves = made.all_curves;
    output.cvs_per_curve = uint32_t(groom.cvs);
    output.patch_count = made.patches;
    output.time_count = time_count;
    output.basis = groom.basis;
    output.shape = groom.shape;
    return output;
}

MarramPatch GroomInstance::patch(uint32_t index) const { return patch_bounds(*this, index); }

namespace {

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

} // namespace

void GroomInstance::tessellate(uint32_t index, const MarramPatchBuffers& buffers) {
    Worker& worker = workers.local();
    const GroomPatch patch = patch_at(index);
    Strands& strands = worker.strands;
    strands.has_wind_share = !groom.factors[of_wind].empty();
    strands.has_contact = asks_for_contact(buffers);
    strands.resize(int(patch.roots.size()), groom.cvs, oriented());
    strands.instance = patch.mesh_instance.is_instance ? patch.mesh_instance.mesh : nullptr;
    const RestStrandSource rest_strands = patch_rest_strand_source(*this, patch, worker.chain.clock);
    const bool follows = !guide_motion.blown.empty();
    const bool jiggles = !past.window.empty() && !follows;
    if (jiggles) {
        const KeptState kept = kept_state(index, 0, strands);
        jiggle_patch(chain, rest_strands, strands, worker.chain, patch.within, kept.get());
    }
    for (uint32_t time = 0; time < time_count; ++time) {
        // If the mesh is static, later motion samples reuse the rest strands.
        if (rest_strands.moves || (time == 0 && !jiggles)) rest_strands.at_time(time, strands);
        if (follows) {
            {
                const StageTimer timer(worker.chain.clock.bend);
                follow_guides(*this, patch, time, strands);
            }
            collide_pose(chain, time, strands, worker.chain);
        } else {
            run_chain(chain, time, strands, worker.chain);
        }
        const StageTimer timer(worker.chain.clock.expand);
        write_vertices(*this, patch, strands, buffers.vertices[time]);
        if (strands.oriented) write_normals(strands, patch.roots.size(), buffers.normals[time]);
        if (time > 0) continue;
        for (uint32_t a = 0; a < buffers.attribute_count; ++a)
            write_attribute(*this, patch, strands, buffers.attributes[a], buffers.attribute_values[a]);
    }
}

// ---- Statistics

void GroomInstance::report_own(const ReportSink& sink) const {
    if (automatic.cvs) sink("chosen.cvs", groom.cvs);
    sink("roots.covered", double(covered_roots));
    if (canopy) {
        sink("canopy.plant_area_index", canopy->mean_index());
        sink("canopy.height", canopy->mean_height());
    }
    sink("seconds.place_roots", begin_seconds.place);
}

// The candidates of placing are freed before the rest is allocated.
StrandInstance::Bytes GroomInstance::bytes() const {
    return {(roots.capacity() + sample.capacity()) * sizeof(Root) + ranks.capacity() * sizeof(float) +
                made.bytes() + bind_positions.capacity() * 4 + blends.capacity() * sizeof(GuideBlend) +
                (guides ? guides->bytes() : 0) + (canopy ? canopy->bytes() : 0),
            0, placing_peak_bytes};
}

std::span<const MarramReportEntry> GroomInstance::report_entries() {
    static constexpr auto sum = [](const char* path, const char* unit, const char* help) {
        return MarramReportEntry{path, unit, MARRAM_SUM, nullptr, nullptr, help};
    };
    static constexpr auto each = [](const char* path, const char* unit, const char* help) {
        return MarramReportEntry{path, unit, MARRAM_EACH, nullptr, nullptr, help};
    };
    static constexpr std::array others = {
        sum("seconds.place_roots", "s", "placing roots"),
        sum("seconds.choose_settings", "s", "choosing CVs, rays and the step of jiggle by the tolerance"),
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
        sum("bend.unsolved", "count", "poses of blades that are not solved to the tolerance"),
        each("canopy.plant_area_index", "1",
             "one-sided area of strands over the area of the ground they stand on"),
        each("canopy.height", "m", "mean height of the stand"),
        each("chosen.cvs", "1", "CVs per strand"),
        each("chosen.shield_rays", "1", "rays per CV"),
        each("chosen.jiggle_step", "frames", "interval between samples of the past"),
        each("chosen.octaves", "1", "octaves of noise"),
    };
    static const std::vector<MarramReportEntry> entries = [] {
        std::vector<MarramReportEntry> list;
        for (const StageClock::Stage& stage : StageClock::stages())
            list.push_back(sum(stage.path, "thread s", stage.help));
        for (const MarramReportEntry& entry : others) list.push_back(entry);
        return list;
    }();
    return entries;
}

} // namespace marram
