// SPDX-License-Identifier: Apache-2.0
// Imported strands between create and destroy.
#pragma once

#include "procedural/groom/binding.h"
#include "procedural/groom/imported_settings.h"
#include "procedural/groom/past.h"
#include "procedural/groom/strand_calls.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

// Curves that follow each other, and how they are made: those of one CV count together.
struct ImportPatch {
    uint64_t first, count; // curves
    double longest, longest_segment,
        max_radius;              // m, of a strand, of a segment and of a radius; in the bind pose
    std::vector<uint32_t> order; // relative to `first`, by CV count
    std::vector<std::array<uint32_t, 2>> runs; // of `order`, each of one CV count
};

// What the tolerance chooses, and what for.
struct ImportChoice {
    double frame, first, last, tolerance;
    MarramStage stage;
    bool operator==(const ImportChoice&) const = default;
};

struct ImportInstance {
    MarramHost host{};
    ImportSettings settings;
    Wind wind; // with what the tolerance has chosen for the frame
    bool automatic_rays = false, automatic_step = false;
    uint64_t digest = 0, binding_key = 0; // of all values; of those that decide how strands are bound
    std::optional<ImportChoice> choice_key;
    std::vector<std::string> inexact; // warnings about settings that the tolerance cannot reach
    std::vector<MarramAttribute>
        attributes; // handed over; names point into settings.carried or are constants

    bool is_bound = false;
    std::vector<float> bind_positions, bind_normals; // of the mesh; empty where strands are bound to nothing
    std::vector<float> bind_vertices; // of curves that move, in the bind pose; else they are the frame's
    Binding binding;                  // empty likewise
    std::vector<ImportPatch> patches;
    Eigen::AlignedBox3d bind_box; // of all CVs in the bind pose
    uint64_t bind_layout = 0,
             bind_topology = 0; // digest of the CV counts and of whether curves move; the mesh's
    uint32_t fewest_cvs = 2;    // of a strand
    double longest_at_bind = 0.0, longest = 0.0; // strand, m: in the bind pose; there and in the frame
    double binding_seconds = 0.0, chain_seconds = 0.0;
    std::optional<double> announced; // the frame whose work was said to be long

    bool begun = false; // a frame, without a fault
    MarramFrame frame{};
    std::vector<MarramMesh> meshes; // the frame's
    const MarramMesh* mesh = nullptr;
    LentCurves curves;
    MarramBasis basis = MARRAM_CATMULL_ROM;
    uint32_t time_count = 1;
    ChainFrame chain;
    ColliderTrees trees;
    PastSkin past; // its window is the strands' even where there is no skin
    bool gusts_fixed = false;
    Workers workers;

    void warn(const char* id, const std::string& what, const std::string& remedy) const {
        send(host, MARRAM_WARNING, id, settings.curves_place, what, remedy);
    }
    const float* vertices(uint32_t time) const { // of the curves, as the file has them
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
