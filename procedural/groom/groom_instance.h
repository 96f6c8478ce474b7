// SPDX-License-Identifier: Apache-2.0
// One groom between create and destroy: its description, its roots, and what holds for the frame that has begun.
#pragma once

#include "procedural/groom/description.h"
#include "procedural/groom/past.h"
#include "procedural/groom/places.h"
#include "procedural/groom/roots.h"
#include "procedural/groom/strand_calls.h"
#include "procedural/groom/strand_shape.h"
#include "procedural/wind/chain.h"

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// CVs that one patch aims at: enough to hide the cost of a task, few enough to stay in a core's cache.
inline constexpr int patch_cvs = 4096;

inline int strands_per_patch(int cvs) {
    return std::clamp((patch_cvs / cvs + lanes - 1) / lanes * lanes, lanes, 512);
}

// What settings that the tolerance chooses depend on, beside the description.
struct ChosenFor {
    double frame, first, last, tolerance;
    MarramStage stage;
    bool operator==(const ChosenFor&) const = default;
};

// What the tolerance chooses.
struct Automatic {
    bool cvs = false, rays = false, step = false;
};

// How the wind moves the guides, where children follow them.
struct GuideMotion {
    Wind wind; // of guides: without collision
    // [place][motion sample]; empty: the wind blows every strand for itself. Offsets are as on the groom's mesh.
    std::vector<std::vector<BlownGuides>> places;
};

// Some strands of one place.
struct GroomPatch {
    const Place& place;
    std::span<const Root> roots;
    uint64_t first_curve;
};

struct GroomInstance {
    MarramHost host{};
    Groom groom;
    Wind wind; // both with what the tolerance has chosen for the frame
    Automatic automatic;
    uint64_t digest = 0, roots_digest = 0; // of its values; of those that decide where strands stand
    std::optional<ChosenFor> chosen_for;
    std::vector<std::string> inexact; // warnings about settings that the tolerance cannot reach

    std::vector<Root> roots;
    std::vector<float> bind_positions;
    std::shared_ptr<const GuideSet> guides; // nullptr: none
    std::vector<GuideBlend> blends;         // [root] where there are guides
    std::vector<float> bind_normals;        // likewise, where the mesh has normals
    GuideMotion guide_motion;
    bool placed = false;
    double placing_seconds = 0.0, chain_seconds = 0.0; // wall time within begin
    size_t placing_bytes = 0;

    bool begun = false;              // a frame, without a fault
    std::optional<double> announced; // the frame whose work was said to be long
    MarramFrame frame{};
    std::vector<MarramMesh> meshes;          // the frame's
    const MarramMesh* mesh = nullptr;        // the one that strands grow on
    std::vector<Place> places;               // it, and its instances
    std::vector<MarramAttribute> attributes; // its
    // Of the mesh that the roots were placed on: digests of its triangles, and of all that places them.
    uint64_t placed_topology = 0, placed_mesh = 0, placed_guides = 0; // the last: of guides and parting lines
    bool mesh_may_differ = false;                                     // an update says so
    uint32_t time_count = 1;
    ChainFrame chain;
    ColliderTrees trees;
    PastSkin past;
    bool gusts_fixed = false;
    std::vector<float> width_profile; // [cvs], half of it: radius of a strand 1 wide

    Workers workers;

    void warn(const char* id, const std::string& what, const std::string& remedy) const {
        send(host, MARRAM_WARNING, id, groom.mesh_place, what, remedy);
    }
    GrowthPoses poses(uint32_t time) const {
        const uint32_t t = std::min(time, mesh->time_count - 1);
        const Surface now{mesh->positions[t],   mesh->normals ? mesh->normals[t] : nullptr,
                          mesh->triangles,      mesh->uvs,
                          mesh->triangle_count, attributes};
        const Surface bind{bind_positions.data(), nullptr,   mesh->triangles, mesh->uvs,
                           mesh->triangle_count,  attributes};
        return {bind, now};
    }
    // Where there are guides; of roots whose first is `first`.
    std::optional<Guided> guided(size_t first, size_t count) const {
        if (!guides) return std::nullopt;
        const Surface bind{bind_positions.data(), bind_normals.empty() ? nullptr : bind_normals.data(),
                           mesh->triangles,       mesh->uvs,
                           mesh->triangle_count,  {}};
        return Guided{*guides, std::span(blends).subspan(first, count), bind};
    }
    std::optional<Guided> guided(std::span<const Root> of) const {
        return guided(size_t(of.data() - roots.data()), of.size());
    }
    uint32_t patches_a_place() const {
        const auto size = uint64_t(strands_per_patch(groom.cvs));
        return uint32_t((roots.size() + size - 1) / size);
    }
    uint32_t patch_count() const { return uint32_t(places.size()) * patches_a_place(); }
    // Places follow each other, each with all patches.
    GroomPatch patch_at(uint32_t patch) const {
        const size_t place = patch / patches_a_place(), within = patch % patches_a_place();
        const auto size = size_t(strands_per_patch(groom.cvs));
        const size_t first = within * size;
        return {places[place], std::span(roots).subspan(first, std::min(size, roots.size() - first)),
                place * roots.size() + first};
    }
};

} // namespace marram
