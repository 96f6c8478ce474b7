// SPDX-License-Identifier: Apache-2.0
// The state of one groom between create and destroy: its description, its roots, and the data of the current
// frame.
#pragma once

#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/grown/level_of_detail.h"
#include "procedural/strands/grown/made_strands.h"
#include "procedural/strands/grown/roots.h"
#include "procedural/strands/grown/strand_shape.h"
#include "procedural/strands/strand_instance.h"
#include "procedural/wind/chain.h"

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Target number of CVs per patch: enough to hide the cost of a task, few enough for a core's cache.
inline constexpr int patch_cvs = 4096;

inline int strands_per_patch(int cvs) {
    return std::clamp((patch_cvs / cvs + lanes - 1) / lanes * lanes, lanes, 512);
}

// The motion of the guides in the wind, if children follow it.
struct GuideMotion {
    Wind wind; // the wind of the guides, without collision
    // [mesh instance][motion sample]; empty: the wind is evaluated for every strand. Offsets are in the space
    // of the groom's mesh.
    std::vector<std::vector<BlownGuides>> blown;
};

// A range of the strands on one mesh instance.
struct GroomPatch {
    const MeshInstance& mesh_instance;
    std::span<const Root> roots;
    std::span<const float> width_factors; // [root], or empty: 1
    uint64_t first_curve;
    uint32_t within; // number among the patches of the mesh instance
};

struct ParsedGroom; // groom.cpp

struct GroomInstance : StrandInstance {
    Groom groom;               // includes the settings chosen for the frame
    uint64_t roots_digest = 0; // of the values that determine the roots

    std::vector<Root> roots; // with a level of detail, those that may be made, and few others
    std::vector<float> bind_positions;
    std::shared_ptr<const GuideSet> guides; // nullptr: none
    std::vector<GuideBlend> blends;         // [root], if there are guides
    uint64_t covered_roots = 0;             // left out, see covered_roots.h
    std::optional<LevelOfDetail> lod;       // of the frame
    std::vector<float> ranks;               // [root], with a level of detail
    // With a level of detail: a sample of all roots, the same in every frame. What is chosen for the groom
    // depends on it.
    std::vector<Root> sample;
    std::vector<GuideBlend> sample_blends; // [root of the sample], if there are guides
    MadeStrands made;                      // in the frame
    std::vector<float> bind_normals;       // if there are guides and the mesh has normals
    GuideMotion guide_motion;
    std::shared_ptr<const Canopy> canopy; // of the strands, if groom.canopy
    bool placed = false;
    size_t placing_peak_bytes = 0;

    std::vector<MarramAttribute> attributes; // of the mesh
    // Digests taken when the roots were placed: of the mesh's topology, of all mesh data that determines the
    // roots, and of guides and parting lines.
    uint64_t placed_topology_digest = 0, placed_mesh_digest = 0, placed_guides_digest = 0;
    uint64_t placed_levels_digest = 0;   // digest_of_levels()
    uint64_t placed_covering_digest = 0; // of the meshes that can cover roots
    uint64_t attributes_digest = 0;      // of the mesh's, if there is jiggle
    bool mesh_may_differ = false;        // as announced by update()
    std::vector<float> radius_profile;   // [cvs]: radius of a strand of width 1, half of Groom::width_profile

    // The members that entry_points.h asks for (groom.cpp); the rest is in StrandInstance.
    static constexpr const char* name = "groom";
    static constexpr const char* help =
        "hair, fur or grass that grows on a mesh and bends in the scene's wind";
    static constexpr const char* memory_remedy = "lower its density or count";
    static const std::vector<MarramParam>& params();
    static std::span<const MarramAttribute> type_attributes();
    static std::span<const MarramReportEntry> report_entries();
    void take(std::span<const MarramValue> list);
    uint32_t update(std::span<const MarramValue> list, uint32_t inputs);
    bool oriented() const { return groom.shape == MARRAM_ORIENTED_RIBBON; }
    MarramPatch patch(uint32_t index) const;
    void tessellate(uint32_t index, const MarramPatchBuffers& buffers);

    SkinPoses poses(uint32_t time) const {
        const uint32_t t = std::min(time, mesh->time_count - 1);
        const Surface now{mesh->positions[t],   mesh->normals ? mesh->normals[t] : nullptr,
                          mesh->triangles,      mesh->uvs,
                          mesh->triangle_count, attributes};
        const Surface bind{bind_positions.data(), nullptr,   mesh->triangles, mesh->uvs,
                           mesh->triangle_count,  attributes};
        return {bind, now};
    }
    // The roots whose strands are made.
    std::span<const Root> made_roots() const { return made.all ? roots : made.roots; }
    // The guides of `count` roots from `first` on; nullopt if there are none.
    std::optional<Guided> guided(size_t first, size_t count) const { return guided(blends, first, count); }
    // The same of some of made_roots().
    std::optional<Guided> guided(std::span<const Root> of) const {
        return guided(made.all ? blends : made.blends, size_t(of.data() - made_roots().data()), of.size());
    }
    std::optional<Guided> guided(std::span<const GuideBlend> of, size_t first, size_t count) const {
        if (!guides) return std::nullopt;
        return Guided{*guides, of.subspan(first, count), guided_skin()};
    }
    Surface guided_skin() const { // in the bind pose
        return {bind_positions.data(), bind_normals.empty() ? nullptr : bind_normals.data(),
                mesh->triangles,       mesh->uvs,
                mesh->triangle_count,  {}};
    }
    uint32_t patch_count() const { return made.patches; }
    // Patches are grouped by mesh instance.
    GroomPatch patch_at(uint32_t patch) const {
        const auto after =
            std::ranges::upper_bound(made.on, patch, {}, &MadeStrands::OnInstance::first_patch);
        const MadeStrands::OnInstance& strands = *(after - 1);
        const uint32_t within = patch - strands.first_patch;
        const auto size = size_t(strands_per_patch(groom.cvs)), first = within * size,
                   count = std::min(size, strands.count - first);
        const std::span<const float> factors = made.width_factors;
        return {mesh_instances[size_t(&strands - made.on.data())],
                made_roots().subspan(strands.begin + first, count),
                factors.empty() ? factors : factors.subspan(strands.begin + first, count),
                strands.first_curve + first, within};
    }

  protected:
    const char* type() const override { return name; }
    const std::string& place() const override { return groom.mesh_place; }
    const std::string& skin_name() const override { return groom.mesh; }
    void lay_out() override;
    double longest() const override { return max_instance_scale(mesh_instances) * longest_strand(groom); }
    void choose_cvs() override;
    int min_cvs() const override { return groom.cvs; }
    const Blade* blade() const override { return groom.blade ? &*groom.blade : nullptr; }
    JigglePilot pilot(double tolerance, size_t strands) const override;
    bool moves() const override { return mesh->time_count > 1 || instances_move(); }
    uint64_t made_digest() const override { return made.digest; }
    LongWork work() const override;
    ChainFrame make_chain(PastWind* earlier) override;
    Eigen::AlignedBox3d bounds() const override;
    void finish_frame() override;
    MarramOutput output() override;
    Bytes bytes() const override;
    void report_own(const ReportSink& sink) const override;

  private:
    PilotGroom pilot_groom() const;
    void apply(ParsedGroom parsed);
};

} // namespace marram
