// SPDX-License-Identifier: Apache-2.0
#include "core/math/clock.h"
#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"
#include "procedural/strands/grown/covered_roots.h"
#include "procedural/strands/grown/groom_bounds.h"
#include "procedural/strands/grown/groom_canopy.h"
#include "procedural/strands/grown/groom_instance.h"
#include "procedural/strands/grown/groom_output.h"
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
                             parsed.groom.cvs != 0 && !automatic.cvs && parsed.groom.cvs == groom.cvs &&
                             parsed.groom.basis == groom.basis && parsed.groom.shape == groom.shape;
    apply(std::move(parsed));
    if (!same_roots || (uses_guides && inputs != MARRAM_NOTHING)) placed = false;
    if (!same_mesh) mesh_may_differ = true;
    return same_layout ? uint32_t(MARRAM_POSITIONS | MARRAM_ATTRIBUTES) : uint32_t(MARRAM_EVERYTHING);
}

// ---- Roots

namespace {

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

// Images need uvs. Where the mesh has uvs outside the unit square, images repeat unless the groom says
// otherwise.
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

void read_bind_pose(GroomInstance& instance) {
    instance.bind_positions.resize(3 * size_t(instance.mesh->vertex_count));
    const bool normals = instance.groom.guides && instance.mesh->normals;
    instance.bind_normals.resize(normals ? instance.bind_positions.size() : 0);
    pose_lent_mesh(instance.frame, instance.mesh_index(), instance.frame.bind_frame,
                   instance.bind_positions.data(), normals ? instance.bind_normals.data() : nullptr);
}

// The vertices of the guides in the bind pose.
std::vector<float> guide_vertices_at_bind(const GroomInstance& instance, const LentCurves& curves) {
    const MarramFrame& frame = instance.frame;
    std::vector<float> vertices(4 * (curves.cv_count() + 2 * curves.count()));
    if (!curves.curves.moves) {
        std::copy_n(curves.curves.vertices[0], vertices.size(), vertices.begin());
        return vertices;
    }
    if (!frame.pose_curves)
        throw SceneFault("contract.no_pose_curves", "", "MarramFrame.pose_curves is NULL",
                         "give a function that poses curves at any time, or static curves");
    pose_lent_curves(frame, curves.index, frame.bind_frame, 0, curves.count(), vertices);
    return vertices;
}

// Digest of the guide curves and parting lines; 0: none. If a procedural grows them on an evolving terrain,
// they differ from frame to frame.
uint64_t guides_digest(const GroomInstance& instance) {
    Digest digest;
    if (!instance.groom.guides) return 0;
    const GuideSettings& settings = *instance.groom.guides;
    const LentCurves curves = find_curves(instance.frame, settings.curves, settings.place);
    digest.add(guide_vertices_at_bind(instance, curves)).add(curves.count());
    if (!settings.lines.empty()) {
        const LentCurves lines = find_curves(instance.frame, settings.lines, settings.lines_place);
        digest.add(lines.curves.vertices[0], 16 * (lines.cv_count() + 2 * lines.count())).add(lines.count());
    }
    return digest.value();
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
void build_guides(GroomInstance& instance, const std::function<bool()>& cancelled) {
    instance.guides.reset();
    instance.blends.clear();
    if (!instance.groom.guides) return;
    const GuideSettings& settings = *instance.groom.guides;
    const MarramFrame& frame = instance.frame;
    const LentCurves curves = find_curves(frame, settings.curves, settings.place);
    const std::vector<float> vertices = guide_vertices_at_bind(instance, curves);
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
    instance.stop_if_cancelled();
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
    instance.stop_if_cancelled();
}

// The meshes that can cover roots: none unless strands collide.
std::vector<const MarramMesh*> covering_meshes_of(const GroomInstance& instance) {
    if (!instance.wind.collision || !instance.groom.clear_of_meshes) return {};
    return covering_meshes(instance.frame, instance.meshes, *instance.mesh);
}

// Leaves out the roots, and their blends of guides, that other meshes cover.
void leave_out_covered_roots(GroomInstance& instance, const std::function<bool()>& cancelled) {
    instance.covered_roots = 0;
    const std::vector<const MarramMesh*> covering = covering_meshes_of(instance);
    instance.placed_covering_digest = digest_of_meshes(covering);
    if (covering.empty() || instance.roots.empty()) return;
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
    instance.stop_if_cancelled();
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
}

// Keeps the roots if everything that places them is unchanged. On an evolving terrain they are placed again
// in each frame. Whether a strand exists depends on its own hash, so most strands persist between frames.
void invalidate_roots_if_mesh_changed(GroomInstance& instance) {
    read_bind_pose(instance);
    if (mesh_digest(instance) != instance.placed_mesh_digest ||
        guides_digest(instance) != instance.placed_guides_digest ||
        digest_of_meshes(covering_meshes_of(instance)) != instance.placed_covering_digest)
        instance.placed = false;
    instance.mesh_may_differ = false;
}

void place_strands(GroomInstance& instance) {
    const double begin = wall_seconds();
    read_bind_pose(instance);
    const auto cancelled = [&] { return instance.cancelled(); };
    PlacedRoots placed = place_roots(instance.groom, instance.poses(0).bind, cancelled);
    instance.roots = std::move(placed.roots);
    instance.placing_peak_bytes = placed.peak_bytes;
    instance.stop_if_cancelled();
    warn_of_no_strands(instance);
    warn_of_tiles(instance);
    build_guides(instance, cancelled);
    leave_out_covered_roots(instance, cancelled);
    instance.canopy.reset();
    instance.placed = true;
    instance.mesh_may_differ = false;
    instance.placed_topology_digest = topology_digest(*instance.mesh);
    instance.placed_mesh_digest = mesh_digest(instance);
    instance.placed_guides_digest = guides_digest(instance);
    instance.begin_seconds.place += wall_seconds() - begin;
}

} // namespace

// ---- A frame

namespace {

// The roots of the frame's share: they depend on the hash of each alone.
void choose_roots(GroomInstance& instance) {
    instance.share = instance.frame.share > 0.0 && instance.frame.share < 1.0 ? instance.frame.share : 1.0;
    instance.chosen_roots.clear();
    instance.chosen_blends.clear();
    if (instance.share == 1.0) return;
    for (size_t i = 0; i < instance.roots.size(); ++i) {
        const Root root = instance.roots[i];
        if (unit_double(root_hash(instance.groom.seed, root, Purpose::share)) >= instance.share) continue;
        instance.chosen_roots.push_back(root);
        if (!instance.blends.empty()) instance.chosen_blends.push_back(instance.blends[i]);
    }
}

} // namespace

void GroomInstance::lay_out() {
    find_mesh(*this);
    prepare_images(*this);
    resolve_attributes(groom, attributes);
    if (placed && !mesh_may_differ && placed_topology_digest != topology_digest(*mesh))
        throw SceneFault("groom.topology", groom.mesh_place,
                         "the mesh '" + groom.mesh +
                             "' has other triangles than when its strands were placed",
                         "keep its topology, or create the procedural again");
    if (placed) invalidate_roots_if_mesh_changed(*this);
    if (!placed) {
        forget_past();
        place_strands(*this);
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
    mesh_instances = find_mesh_instances(frame, *mesh);
    choose_roots(*this);
    if (guides) groom.length = {0.0, guides->longest_child()};
    find_canopy(*this);
}

PilotGroom GroomInstance::pilot_groom() const {
    return {groom,
            wind,
            frame,
            *mesh,
            roots,
            poses(0).bind,
            guided(0, roots.size()),
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
    amount.cvs = double(made_roots().size() * mesh_instances.size()) * groom.cvs;
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
    output.curve_count = mesh_instances.size() * made_roots().size();
    output.all_curves = mesh_instances.size() * roots.size();
    output.cvs_per_curve = uint32_t(groom.cvs);
    output.patch_count = patch_count();
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
        jiggle_patch(chain, rest_strands, strands, worker.chain, index % patches_per_instance(), kept.get());
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
        write_vertices(*this, patch.roots, strands, buffers.vertices[time]);
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
    return {(roots.capacity() + chosen_roots.capacity()) * sizeof(Root) + bind_positions.capacity() * 4 +
                blends.capacity() * sizeof(GuideBlend) + (guides ? guides->bytes() : 0) +
                (canopy ? canopy->bytes() : 0),
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
