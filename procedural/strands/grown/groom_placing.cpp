// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/groom_placing.h"

#include "core/math/clock.h"
#include "core/math/digest.h"
#include "procedural/abi/border.h"
#include "procedural/abi/parallel.h"
#include "procedural/strands/grown/covered_roots.h"
#include "procedural/strands/grown/groom_warnings.h"
#include "procedural/strands/grown/strand_shape.h"

#include <algorithm>
#include <memory>
#include <span>
#include <vector>

namespace marram {

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

uint64_t topology_digest(const MarramMesh& mesh) {
    return Digest().add(mesh.topology).add(mesh.vertex_count).add(mesh.triangle_count).value();
}

namespace {

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
        if (!beyond[i]) {
            if (!instance.ranks.empty()) instance.ranks[kept] = instance.ranks[i];
            instance.roots[kept++] = instance.roots[i];
        }
    instance.roots.resize(kept);
    instance.ranks.resize(std::min(kept, instance.ranks.size()));
    warn_beyond_guides(instance, count - kept, count);
}

std::vector<GuideBlend> blends_of(const GroomInstance& instance, std::span<const Root> roots) {
    std::vector<GuideBlend> blends(roots.size());
    const Surface bind = instance.guided_skin();
    marram::parallel_for(tbb::blocked_range<size_t>(0, roots.size(), 256), [&](const auto& range) {
        if (instance.cancelled()) return;
        for (size_t i = range.begin(); i < range.end(); ++i) {
            const Vec3d weights = root_weights(instance.groom.seed, roots[i]);
            blends[i] = instance.guides->blend_at(bind.point(roots[i].triangle, weights),
                                                  frame_at(bind, roots[i].triangle, weights).normal);
        }
    });
    instance.stop_if_cancelled();
    return blends;
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
    const Surface bind = instance.guided_skin();
    instance.guides = std::make_shared<const GuideSet>(
        settings, curves, vertices.data(), bind, instance.mesh->vertex_count, std::move(lines), cancelled);
    instance.stop_if_cancelled();
    warn_of_guides(instance, instance.guides->binding());
    leave_out_roots_beyond_guides(instance, bind);
    instance.blends = blends_of(instance, instance.roots);
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
            if (!instance.ranks.empty()) instance.ranks[kept] = instance.ranks[i];
            ++kept;
        }
        if (covered[i] < 0) continue;
        Cover& by = covers[size_t(covered[i])];
        if (by.roots++ == 0) by.mesh = cover.mesh(covered[i]).name, by.place = starts[i].cast<double>();
    }
    instance.roots.resize(kept);
    if (!instance.blends.empty()) instance.blends.resize(kept);
    instance.ranks.resize(std::min(kept, instance.ranks.size()));
    instance.covered_roots = count - kept;
    warn_of_covered_roots(instance, covers, count);
}

} // namespace

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
    PlacedRoots placed =
        place_roots(instance.groom, instance.poses(0).bind, cancelled, share_around(instance));
    instance.roots = std::move(placed.roots);
    instance.ranks = std::move(placed.ranks);
    instance.placing_peak_bytes = placed.peak_bytes;
    instance.stop_if_cancelled();
    warn_of_tiles(instance);
    build_guides(instance, cancelled);
    leave_out_covered_roots(instance, cancelled);
    instance.canopy.reset();
    instance.placed = true;
    instance.mesh_may_differ = false;
    instance.placed_topology_digest = topology_digest(*instance.mesh);
    instance.placed_mesh_digest = mesh_digest(instance);
    instance.placed_guides_digest = guides_digest(instance);
    instance.placed_levels_digest = digest_of_levels(instance);
    instance.begin_seconds.place += wall_seconds() - begin;
}

void place_sample(GroomInstance& instance) {
    instance.sample.clear();
    instance.sample_blends.clear();
    if (!instance.lod) return;
    constexpr size_t enough = 4096;
    const double begin = wall_seconds();
    const Surface bind = instance.poses(0).bind;
    double all = double(instance.groom.count); // before masks
    if (instance.groom.count == 0)
        for (uint32_t t = 0; t < bind.triangle_count; ++t) all += instance.groom.density * bind.area(t);
    // Masks may thin them: more are placed until there are enough.
    for (double share = std::min(double(enough) / std::max(all, 1.0), 1.0);;
         share = std::min(16.0 * share, 1.0)) {
        instance.sample = place_roots(
                              instance.groom, bind, [&] { return instance.cancelled(); },
                              [share](uint32_t, double) { return share; })
                              .roots;
        instance.stop_if_cancelled();
        if (instance.sample.size() >= enough || share == 1.0) break;
    }
    if (instance.guides) instance.sample_blends = blends_of(instance, instance.sample);
    instance.begin_seconds.place += wall_seconds() - begin;
}

} // namespace marram
