// SPDX-License-Identifier: Apache-2.0
// One terrain between create and destroy.
#pragma once

#include "procedural/terrain/dicing.h"
#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/simulation.h"
#include "procedural/terrain/stack.h"
#include "procedural/terrain/stored_values.h"

#include <memory>
#include <string>
#include <vector>

namespace marram {

// The render mesh between begin_view() and view_mesh().
struct SeenTerrain {
    std::vector<uint32_t> samples; // of its first vertices
    DicedMesh mesh;
    DisplacedRegion region; // reach 0: nothing is displaced
};

struct TerrainInstance {
    MarramHost host{};
    StoredValues values;
    uint64_t digest = 0; // of the values
    Domain domain;
    Simulation simulation; // before the stack, whose layers use it
    std::unique_ptr<Stack> stack;
    std::vector<float> heights; // of the growth surface
    SeenTerrain seen;
    bool begun = false;
    double seconds = 0.0, prepared = 0.0; // of the last begin(), and of prepare() before it

    std::vector<std::string> attribute_names; // sand, slope, then the masks
    std::vector<MarramAttribute> attributes;
    std::vector<std::string> grid_names;
    std::vector<std::vector<float>> grid_values; // bedrock and sand, as floats
    std::vector<MarramGrid> grids;
};

// The domain that the parameters size, cell and center describe. Throws SceneFault where it has too many samples.
Domain read_domain(const Values& values);

// Gives the stack the layers that the values and the frame's curves and meshes describe: those that have not changed are kept.
void set_layers(TerrainInstance& instance, const MarramFrame& frame, std::span<const MarramMesh> meshes);

// Names of the masks that the layers will hand out, in order, each once.
std::vector<std::string> mask_names(const Values& values);

// Whether a layer needs its past.
bool evolves(const Values& values);

// How many layers there are, switched off or not.
int layer_count(const Values& values);

} // namespace marram
