// SPDX-License-Identifier: Apache-2.0
// One rock between create and destroy, and what computes its output.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/abi/border.h"
#include "procedural/abi/stored_values.h"
#include "procedural/abi/values.h"
#include "procedural/erosion/erosion.h"
#include "procedural/erosion/rock_declaration.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace marram {

// What erosion did to a rock. Numbers of 8 bytes, as it is stored with the state.
struct RockErosion {
    int64_t passes = 0;   // of all levels; 0: the mesh is not eroded
    uint64_t pieces = 0;  // that were removed, if they were more than 1e-3 of the rock
    double removed = 0.0; // m^3
    double coarse = 1.0;  // volume of the first level before wear, over that of the rock
    double years = 0.0;   // simulated
    double seconds = 0.0;
};

// The surface of a rock with its wear.
struct RockSurface {
    std::vector<float> positions, normals, uvs; // per vertex: 3 (m), 3 or none, 2 or none
    std::vector<uint32_t> triangles;            // 3 vertices each
    std::vector<float> wear, rate, hardness;    // per vertex; rate: mm a year
    bool eroded = false;
    RockErosion erosion;
    GrainReport grains;
};

struct RockInstance : Instance, RockDeclaration, RockSurface {
    StoredValues values;
    uint64_t values_digest = 0;
    uint64_t digest = 0;                    // of all inputs of `wear`; 0: not computed yet
    std::array<std::vector<float>, 2> maps; // wear, rate: a pixel each, row by row; or none
    std::array<MarramGrid, 2> grids{};      // point into maps

    // The other members that entry_points.h asks for (rock.cpp).
    void take(std::span<const MarramValue> list);
    uint32_t update(std::span<const MarramValue> list, uint32_t inputs);
    bool prepares() const;
    void prepare(const LentFrame& lent, const MarramStates* states);
    MarramOutput begin(const LentFrame& lent);
    void mesh(MarramMeshBuffers& buffers);
    void report(const ReportSink& sink) const;
};

// Computes the output unless it is up to date: the mesh, its attributes and images by uv
// (rock_evaluation.cpp). `meshes`: those of the frame. `states`: an eroded rock that the host has kept is
// taken, a new one is kept; may be NULL. Throws SceneFault.
void evaluate_rock(RockInstance& instance, const Values& values, const MarramFrame& frame,
                   std::span<const MarramMesh> meshes, const MarramStates* states);

// The output of an eroded rock as bytes, and back (rock_state.cpp). read_rock_state() returns false, and
// leaves the rock as it was, if the bytes are not those of a rock with this digest.
std::vector<char> write_rock_state(const RockSurface& rock, uint64_t digest);
bool read_rock_state(std::span<const char> bytes, uint64_t digest, RockSurface& rock);

// Bakes wear and wear_rate to images by uv, `map` pixels a side; 0: to none (rock_maps.cpp). Throws
// SceneFault if the mesh has no uvs.
void make_rock_maps(RockInstance& instance, const Values& values);

} // namespace marram
