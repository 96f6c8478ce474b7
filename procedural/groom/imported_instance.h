// SPDX-License-Identifier: Apache-2.0
// The state of imported strands between create and destroy.
#pragma once

#include "procedural/groom/binding.h"
#include "procedural/groom/imported_settings.h"
#include "procedural/groom/mesh_instances.h"
#include "procedural/groom/past.h"
#include "procedural/groom/strand_calls.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// A range of consecutive curves, which are processed in batches of equal CV count.
struct ImportPatch {
    uint64_t first, count; // curves
    double longest, longest_segment,
        max_radius;              // m, in the bind pose: longest strand, longest segment, greatest radius
    std::vector<uint32_t> order; // curves relative to `first`, sorted by CV count
    std::vector<std::array<uint32_t, 2>> runs; // ranges of `order` with equal CV count
};

// The curves of a patch on one mesh instance.
struct ImportPatchOnMesh {
    const ImportPatch& patch;
    const MeshInstance& mesh_instance;
    uint64_t first_curve; // in the output
};

struct ImportInstance {
    MarramHost host{};
    ImportSettings settings;
    Wind wind; // includes the settings chosen for the frame
    bool automatic_rays = false, automatic_step = false;
    uint64_t values_digest = 0, binding_digest = 0; // of all values; of those that determine the binding
    std::optional<ChosenFor> chosen_for;
    std::vector<std::string> inexact; // warnings where no setting reaches the tolerance
    std::vector<MarramAttribute>
        attributes; // output; names point into settings.passed_attributes or are constants

    bool is_bound = false;
    std::vector<float> bind_positions, bind_normals; // of the mesh; empty if strands are not bound
    std::vector<float> bind_vertices; // of moving curves, in the bind pose; others use the frame's vertices
    Binding binding;                  // empty if strands are not bound
    std::vector<ImportPatch> patches;
    Eigen::AlignedBox3d bind_box; // of all CVs in the bind pose
    // Of CV counts and whether curves move; of the mesh's topology.
    uint64_t bind_layout_digest = 0, bind_topology_digest = 0;
    uint32_t fewest_cvs = 2;                     // of a strand
    double longest_at_bind = 0.0, longest = 0.0; // longest strand, m: in the bind pose; also over the frame
    double binding_seconds = 0.0, prepare_seconds = 0.0; // wall time within begin
    std::optional<double> announced;                     // the frame for which long work was announced

    bool begun = false; // a frame has begun without errors
    MarramFrame frame{};
    std::vector<MarramMesh> meshes; // the frame's
    const MarramMesh* mesh = nullptr;
    std::vector<MeshInstance> mesh_instances; // the mesh and its instances; one if strands are not bound
    std::vector<uint64_t> offsets;            // of the output, if there are instances and CV counts differ
    LentCurves curves;
    MarramBasis basis = MARRAM_CATMULL_ROM;
    uint32_t time_count = 1;
    ChainFrame chain;
    ColliderTrees trees;
    PastSkin past; // its window is used even without a skin
    GustStart gust_start;
    bool gusts_checked = false;      // whether any touches a strand
    Eigen::AlignedBox3d gust_bounds; // of the strands in the last frame begun, if there are gusts
    Workers workers;

    void warn(const char* id, const std::string& what, const std::string& remedy) const {
        send(host, MARRAM_WARNING, id, settings.curves_place, what, remedy);
    }
    uint32_t patch_count() const { return uint32_t(mesh_instances.size() * patches.size()); }
    // Patches are grouped by mesh instance.
    ImportPatchOnMesh patch_at(uint32_t index) const {
        const size_t on = index / patches.size();
        const ImportPatch& patch = patches[index % patches.size()];
        return {patch, mesh_instances[on], on * curves.count() + patch.first};
    }
    bool moves() const { // at rest, within the shutter
        return (mesh && mesh->time_count > 1) || curves.curves.time_count > 1 ||
               std::any_of(mesh_instances.begin(), mesh_instances.end(),
                           [](const MeshInstance& mesh_instance) { return mesh_instance.moves(); });
    }
    const float* vertices(uint32_t time) const { // of the curves, as in the file
        return curves.curves.vertices[std::min(time, curves.curves.time_count - 1)];
    }
    const float* bind_pose() const { return curves.curves.moves ? bind_vertices.data() : vertices(0); }
    Surface surface(uint32_t time) const {
        const uint32_t t = std::min(time, mesh->time_count - 1);
        return {mesh->positions[t],   mesh->normals ? mesh->normals[t] : nullptr,
                mesh->triangles,      mesh->uvs,
                mesh->triangle_count, {}};
    }
    Surface bind_surface() const {
        return {bind_positions.data(), bind_normals.empty() ? nullptr : bind_normals.data(),
                mesh->triangles,       mesh->uvs,
                mesh->triangle_count,  {}};
    }
};

} // namespace marram
