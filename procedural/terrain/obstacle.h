// SPDX-License-Identifier: Apache-2.0
// The vertical spans of a mesh in each cell of a terrain, and the height field that follows from them. The
// model is documented in obstacle.cpp.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/terrain/fields.h"

#include <cstddef>
#include <vector>

namespace marram {

class Obstacle {
  public:
    struct Top {
        size_t sample;
        float height; // elevation, metres
    };

    Obstacle() = default;
    // Copies what it needs of the mesh's first motion sample. Triangles with an invalid index or a coordinate
    // that is not finite are left out. Cost: 0.2 us for each triangle and cell that it crosses. Memory: 16
    // bytes each, up to 80 during construction.
    Obstacle(const Domain& domain, const MarramMesh& mesh);

    bool empty() const { return spans_.empty(); }
    // The number of samples where entries and exits of the vertical line do not balance: the mesh is not
    // closed there.
    size_t open_samples() const { return open_samples_; }
    // The samples where the mesh stands on the terrain `below`, or lies in its sand, in order, with its top.
    std::vector<Top> tops(const Fields& below) const;

  private:
    struct Span {
        size_t sample;
        float low, high; // metres
    };
    double cell_ = 1.0;
    size_t open_samples_ = 0;
    std::vector<Span> spans_; // of all cells, sorted by sample, then by low
};

// Fills the samples of `tops` inwards from the level of the sand beside them, so that the interpolated
// surface meets the faces of the mesh. A sample keeps the sand on its top if neither it nor a neighbouring
// sample of the mesh stands more than a cell above the ground beside it, and that sand is deeper than a
// quarter of a cell or the mean level of its neighbours is at least its top. `sand`: of the terrain, the mesh
// included. `on_top`: the part of it on the mesh, one for each of `tops`.
void fill_obstacle(const Domain& domain, const float* bedrock, const std::vector<Obstacle::Top>& tops,
                   const std::vector<SandUnits>& on_top, SandUnits* sand);

} // namespace marram
