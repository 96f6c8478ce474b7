// SPDX-License-Identifier: Apache-2.0
// How far a point is from the meshes, user geometries and instances in an Embree scene: a lower bound, from a
// coarse grid. What flies through empty space needs no rays there.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"
#include "core/plugin/embree.h"

#include <array>
#include <cstdint>
#include <vector>

namespace marram {

// Eight parabolas x + v t - gravity y t^2 / 2 in metres and seconds. x is relative to EmptySpace::low().
struct alignas(64) Parabolas8 {
    VFloat x[3], v[3];
    float gravity;    // m/s^2, 0 or more
    VFloat t_max;     // s
    VFloat min_step;  // s: shorter steps are not taken
    VFloat clearance; // m: how far around its points space must be empty; includes the rounding of x and v
    VFloat t_clear;   // s: space is empty up to here
    VInt is_near;     // a mask: something may be near the point at t_clear
};

// Two at a time: a processor goes on with one while it waits for the other.
using ParabolaPair = std::array<Parabolas8, 2>;

struct EmptySpaceGrid {
    float high[3] = {};                                     // its extent, m
    float cell = 0.0F, cells_per_metre = 0.0F, code = 0.0F; // m, 1/m, m
    int count[3] = {};
    // [z][y][x], radii of empty balls around the cells' centres in units of `code`; none where nothing is
    // known.
    std::vector<uint8_t> codes;
};

class EmptySpace {
  public:
    EmptySpace() = default; // nothing is known to be empty

    // What lies outside `box` may be missed, and so are curves, points and subdivision surfaces. `cells`:
    // along its longest edge, 1 to 128. 64 take 75 ms on two cores around 1.5 10^6 triangles, and 256 kB.
    EmptySpace(RTCScene scene, const Eigen::AlignedBox3d& box, int cells);

    const Vec3d& low() const { return low_; }
    // Moves `t_clear` on in each of sixteen parabolas by `steps`, 1 or more, each as far as it stays in a
    // ball that is empty at the first motion sample (later ones are not looked at). The ball's radius is a
    // lower bound: at most 255/8 cells; below that, for points inside the grid, too small by at most 3.5
    // cells and the extent of a leaf of Embree's BVH, and on average by half a cell within two cells of
    // something.
    void step(ParabolaPair& parabolas, int steps) const;

  private:
    Vec3d low_ = Vec3d::Zero();
    EmptySpaceGrid grid_;
};

} // namespace marram
