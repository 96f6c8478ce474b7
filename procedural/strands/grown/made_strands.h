// SPDX-License-Identifier: Apache-2.0
// Which strands of a groom are made in a frame: all; or those of its level of detail; or a preview's share.
#pragma once

#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/grown/level_of_detail.h"
#include "procedural/strands/grown/roots.h"
#include "procedural/strands/mesh_instances.h"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace marram {

struct GroomInstance;

struct MadeStrands {
    // The strands on a mesh instance: some of `roots`, in patches of their own.
    struct OnInstance {
        size_t begin = 0, count = 0;
        uint64_t first_curve = 0;
        uint32_t first_patch = 0;
    };

    bool all = true; // GroomInstance::roots, on each instance; the lists below are empty
    // Else a list that all instances share, or with a level of detail the lists of all instances, one after
    // another.
    std::vector<Root> roots;
    std::vector<GuideBlend> blends;   // [root], if there are guides
    std::vector<float> width_factors; // [root], if there is a level of detail
    double widest = 1.0;              // factor; of rendered widths alone: strands move and collide as all do
    std::vector<OnInstance> on;       // [mesh instance]
    uint64_t curves = 0, all_curves = 0; // all: without the preview's share
    double share = 1.0;                  // of a preview
    uint32_t patches = 0;
    uint64_t digest = 0; // of what is chosen; 0: all

    void number_patches(uint32_t strands_a_patch); // once the CVs are chosen: on[].first_patch, and patches

    size_t bytes() const {
        return roots.capacity() * sizeof(Root) + blends.capacity() * sizeof(GuideBlend) +
               width_factors.capacity() * sizeof(float);
    }
};

// The frame's level of detail; nullopt: all strands are wanted.
std::optional<LevelOfDetail> level_of_detail_of(const Groom& groom, const MarramFrame& frame);

// Digest of what shares depend on: roots are placed anew if it differs. 0 without a level of detail.
uint64_t digest_of_levels(const GroomInstance& instance);

// The greatest share wanted around each triangle, on any of the mesh instances; empty without a level of
// detail. The instance must outlive it.
ShareAround share_around(const GroomInstance& instance);

// Chooses among the instance's roots, for its frame and mesh instances. Cost: with a level of detail, a distance
// for each root on each mesh instance.
MadeStrands choose_strands(const GroomInstance& instance);

} // namespace marram
