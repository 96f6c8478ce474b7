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
    std::vector<uint32_t> samples; // of its first vertices; empty: not made
    DicedMesh mesh;
    DisplacedRegion region; // reach 0: nothing is displaced
};

// A view, and what was said of its render mesh.
struct TerrainView {
    MarramView view{}; // of the vectors below
    std::vector<double> times, positions, directions, ups;
    MarramOutput output{}; // its version is a digest of the terrain's and of all but the view's times
    bool begun = false;    // since begin()

    void take(const MarramView& given);
};

// What a layer did to the terrain below it.
struct LayerChange {
    double highest = 0.0; // metres: the greatest change of the height at a sample
    SandUnits sand = 0;   // sum over samples
};

// What report() needs a look at every sample for.
struct TerrainSums {
    uint64_t version = 0; // of the terrain
    std::vector<LayerChange> layers;
    double steepest = 0.0; // degrees
};

struct TerrainInstance {
    MarramHost host{};
    StoredValues values;
    uint64_t digest = 0; // of the values
    Domain domain;
    Simulation simulation; // before the stack, whose layers use it
    std::unique_ptr<Stack> stack;
    std::vector<float> heights; // of the growth surface
    uint64_t version = 0;       // of all that mesh() hands over
    uint64_t evaluated = 0;     // tiles of all layers, ever
    SeenTerrain seen;
    TerrainView view;
    TerrainSums sums;
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
