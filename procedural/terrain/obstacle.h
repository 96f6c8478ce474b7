// SPDX-License-Identifier: Apache-2.0
// The height field of a mesh that stands on a terrain. The model is documented in obstacle.cpp.
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
        float height; // metres
    };

    Obstacle() = default;
    // Copies what it needs of the mesh's first motion sample. Triangles with an invalid index or a coordinate that
    // is not finite are left out. Cost: 0.2 us for each triangle and cell that it crosses. Memory: 16 bytes each, up
    // to 80 during construction.
    Obstacle(const Domain& domain, const MarramMesh& mesh);

    bool empty() const { return spans_.empty(); }
    // The number of samples whose vertical line enters the mesh without leaving it, or the reverse: it is not closed.
    size_t hollow() const { return hollow_; }
    // The samples where the mesh stands on the terrain `below`, in order, with the height of its top.
    std::vector<Top> tops(const Fields& below) const;

  private:
    struct Span {
        size_t sample;
        float low, high; // metres
    };
    double cell_ = 1.0;
    size_t hollow_ = 0;
    std::vector<Span> spans_; // of all cells, sorted by sample, then by low
};

// Sets the sand at the samples of `tops` to the level beside them, so that the interpolated surface meets the
// faces of the mesh. Sand on the mesh is kept where the mesh is buried: no ground within two samples lies more than
// a cell below its top, and either it is deeper than a quarter of a cell or the surface beside is as high as the top.
// `sand`: of the terrain; `on_top`: the part of it on the mesh, one for each of `tops`.
void fill_obstacle(const Domain& domain, const float* bedrock, const std::vector<Obstacle::Top>& tops,
                   const std::vector<SandUnits>& on_top, SandUnits* sand);

} // namespace marram
