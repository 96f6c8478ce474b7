// SPDX-License-Identifier: Apache-2.0
// One terrain between create and destroy.
#pragma once

#include "procedural/abi/border.h"
#include "procedural/abi/stored_values.h"
#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/mesh/dicing.h"
#include "procedural/terrain/simulation.h"
#include "procedural/terrain/stack.h"

#include <memory>
#include <string>
#include <vector>

namespace marram {

// The render mesh, kept between begin_view() and view_mesh().
struct ViewRenderMesh {
    std::vector<uint32_t> samples; // of the first vertices; empty: no mesh
    DicedMesh mesh;
    DisplacedRegion region; // reach 0: nothing is displaced
};

// A copy of a view, with the output that begin_view() returned for it.
struct TerrainView {
    MarramView view{}; // points into the vectors below
    std::vector<double> times, positions, directions, ups;
    MarramOutput output{}; // digest: of the terrain's output and of the view except its times
    bool begun = false;    // between begin_view() and view_mesh()

    void take(const MarramView& given);
};

// The difference between the terrain above and below a layer.
struct LayerChange {
    double highest = 0.0; // metres: the largest absolute change of height at a sample
    SandUnits sand = 0;   // sum over samples
};

// Values that report() computes from all samples, cached by digest.
struct TerrainTotals {
    uint64_t digest = 0; // output_digest of the terrain
    std::vector<LayerChange> layers;
    double steepest = 0.0; // degrees
};

struct TerrainInstance : Instance {
    StoredValues values;
    uint64_t digest = 0; // of the values
    Domain domain;
    Simulation simulation; // declared before the stack, whose layers use it
    std::unique_ptr<Stack> stack;
    std::vector<float> heights; // of the growth surface
    uint64_t output_digest = 0; // of everything that mesh() outputs
    uint64_t evaluated = 0;     // tiles of all layers since creation
    ViewRenderMesh seen;
    TerrainView view;
    TerrainTotals sums;
    double seconds = 0.0, prepared = 0.0; // of the last begin(), and of the prepare() before it
    // Of the layers, likewise: begin() finds up to date what prepare() has evaluated.
    std::vector<Stack::Work> work, prepared_work;

    std::vector<std::string> attribute_names; // sand, slope, masks, then ripples and ripple_wave if any
    std::vector<MarramAttribute> attributes;
    std::vector<std::string> grid_names;
    std::vector<std::vector<float>> grid_values; // sand, converted to floats
    std::vector<MarramGrid> grids;

    // The members that entry_points.h asks for (terrain.cpp).
    static constexpr const char *name = "terrain",
                                *help = "a desert as a stack of layers: rock, dunes, masks";
    static constexpr const char* memory_remedy = "make cell larger or size smaller";
    static const std::vector<MarramParam>& params();
    static std::span<const MarramItemType> item_types();
    static std::span<const MarramReportEntry> report_entries();
    std::span<const MarramAttribute> attribute_list() const { return attributes; }
    void take(std::span<const MarramValue> list);
    uint32_t update(std::span<const MarramValue> list, uint32_t inputs);
    bool prepares() const;
    void prepare(const LentFrame& lent, const MarramStates* states);
    MarramOutput begin(const LentFrame& lent);
    void mesh(MarramMeshBuffers& buffers);
    MarramOutput begin_view(const MarramView& given);
    bool view_begun() const { return view.begun; }
    void view_mesh(MarramMeshBuffers& buffers);
    void report(const ReportSink& sink);
    std::vector<std::string> described() const;
};

// The domain given by the parameters size, cell and center. Throws SceneFault if it has too few or too many
// samples, or if floats cannot resolve a cell so far from the origin.
Domain read_domain(const Values& values);

// Sets the layers of the stack from the values and the frame's curves and meshes. Unchanged layers are kept.
void set_layers(TerrainInstance& instance, const MarramFrame& frame, std::span<const MarramMesh> meshes);

// Names of the masks that the layers will output, in order, without duplicates.
std::vector<std::string> mask_names(const Values& values);

// True if a layer depends on earlier frames. Throws SceneFault if more than one does.
bool evolves(const Values& values);

// The number of layers, including those switched off.
int layer_count(const Values& values);

} // namespace marram
