// SPDX-License-Identifier: Apache-2.0
// Subdivides triangles near the camera, for displacement finer than the terrain's grid. See dicing.cpp.
#pragma once

#include "procedural/terrain/mesh/mesher.h"

#include <array>

namespace marram {

// Where displacement is visible: within `reach` of a camera and inside its view cone.
struct DisplacedRegion {
    struct Camera {
        Vec3d position = Vec3d::Zero(), forward = -Vec3d::UnitZ(); // unit
    };
    std::vector<Camera> cameras; // one a motion sample
    double corner = 0.0;         // radians from `forward` to the film's corners
    double reach = 0.0;          // metres
    double side = 0.0;           // metres: longest triangle side allowed where there is displacement
    double pixel_angle = 0.0;    // radians: sides shorter than one pixel are not split

    // Displacement weight at a point: 1 up to half the reach, 0 beyond the reach and 10 degrees outside the
    // film.
    double share(const Vec3d& p) const;
};

// Triangles, subdivided until no side in the region is too long. Vertex `first` + k is the midpoint of the
// two vertices midpoints[k], both of which have lower indices.
struct DicedMesh {
    uint32_t first = 0; // number of input vertices
    std::vector<std::array<uint32_t, 2>> midpoints;
    std::vector<uint32_t> triangles;
    double reach = 0.0; // reach used; shorter than requested if there were too many triangles
};

// `positions`: vertex positions of `triangles`. Shortens the reach until the result has at most
// max(`most`, input count) triangles. Bit-identical at any thread count.
DicedMesh dice(std::span<const Vec3d> positions, std::span<const uint32_t> triangles,
               const DisplacedRegion& region, size_t most = size_t(1) << 24);

} // namespace marram
