// SPDX-License-Identifier: Apache-2.0
// The state of imported strands between create and destroy.
#pragma once

#include "procedural/strands/binding.h"
#include "procedural/strands/imported/imported_settings.h"
#include "procedural/strands/lent_curves.h"
#include "procedural/strands/strand_instance.h"

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

struct ImportInstance : StrandInstance {
    ImportSettings settings;
    uint64_t binding_digest = 0; // of the values that determine the binding
    std::vector<MarramAttribute>
        attributes; // output; names point into settings.passed_attributes or are constants

    bool is_bound = false;
    std::vector<float> bind_positions, bind_normals; // of the mesh; empty if strands are not bound
    std::vector<float> bind_vertices; // of moving curves, in the bind pose; others use the frame's vertices
    Binding binding;                  // empty if strands are not bound
    std::vector<ImportPatch> patches;
    Eigen::AlignedBox3d bind_box; // of all CVs in the bind pose
    uint64_t past_digest = 0;     // of what else the past depends on, if there is jiggle
    // Of CV counts and whether curves move; of the mesh's topology.
    uint64_t bind_layout_digest = 0, bind_topology_digest = 0;
    uint32_t least_cvs = 2; // of a strand
    double longest_at_bind = 0.0,
           longest_now = 0.0; // longest strand, m: in the bind pose; also over the frame

    std::vector<uint64_t> offsets; // of the output, if there are instances and CV counts differ
    LentCurves curves;
    MarramBasis basis = MARRAM_CATMULL_ROM;

    // The members that entry_points.h asks for (imported.cpp); the rest is in StrandInstance.
    static constexpr const char* name = "strands";
    static constexpr const char* help =
        "hair, fur or grass that was groomed elsewhere, on a mesh or in the open, "
        "and bends in the scene's wind";
    static constexpr const char* memory_remedy = "use a file with fewer strands";
    static const std::vector<MarramParam>& params();
    static std::span<const MarramAttribute> type_attributes();
    static std::span<const MarramReportEntry> report_entries();
    std::span<const MarramAttribute> attribute_list() const { return attributes; }
    void take(std::span<const MarramValue> list);
    uint32_t update(std::span<const MarramValue> list, uint32_t inputs);
    bool oriented() const { return settings.shape == MARRAM_ORIENTED_RIBBON; }
    MarramPatch patch(uint32_t index) const;
    void tessellate(uint32_t index, const MarramPatchBuffers& buffers);

    uint32_t patch_count() const { return uint32_t(mesh_instances.size() * patches.size()); }
    // Patches are grouped by mesh instance.
    ImportPatchOnMesh patch_at(uint32_t index) const {
        const size_t on = index / patches.size();
        const ImportPatch& patch = patches[index % patches.size()];
        return {patch, mesh_instances[on], on * curves.count() + patch.first};
    }
    bool moves() const override { // at rest, within the shutter
        return (mesh && mesh->time_count > 1) || curves.curves.time_count > 1 || instances_move();
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

  protected:
    const char* type() const override { return name; }
    const std::string& place() const override { return settings.curves_place; }
    const std::string& skin_name() const override { return settings.mesh; }
    void lay_out() override;
    Eigen::AlignedBox3d bounds_without_meshes() const override { return bind_box; }
    double longest() const override { return longest_now; }
    int min_cvs() const override { return int(least_cvs); }
    JigglePilot pilot(double tolerance, size_t strands) const override;
    bool curves_move() const override { return curves.curves.moves != 0; }
    double travel_of_curves() const override;
    LongWork work() const override;
    ChainFrame make_chain(PastWind* earlier) override;
    Eigen::AlignedBox3d bounds() const override;
    MarramOutput output() override;
    Bytes bytes() const override;
    void report_own(const ReportSink& sink) const override;
};

} // namespace marram
