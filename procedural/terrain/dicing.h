// SPDX-License-Identifier: Apache-2.0
// Smaller triangles where the camera is near, for displacement that the terrain's grid cannot hold. See dicing.cpp for how.
#pragma once

#include "procedural/terrain/mesher.h"

#include <array>

namespace marram {

// Where displacement is seen: within `reach` of a camera, in the cone of what it sees.
struct DisplacedRegion {
    struct Camera {
        Vec3d position = Vec3d::Zero(), forward = -Vec3d::UnitZ(); // unit
    };
    std::vector<Camera> cameras; // one a motion sample
    double corner = 0.0;         // radians from `forward` to the film's corners
    double reach = 0.0;          // metres
    double side = 0.0;           // metres: the longest side of a triangle that displacement asks for
    double pixel_angle = 0.0;    // radians: sides shorter than a pixel are not asked for

    // Share of the displacement at a point: 1 up to half the reach, 0 from the reach on and 10 degrees outside the film.
    double share(const Vec3d& p) const;
};

// Triangles cut until no side that displacement is seen on is too long. Vertex `first` + k is halfway between the vertices
// midpoints[k], both of which come before it.
struct DicedMesh {
    uint32_t first = 0; // vertices that were there
    std::vector<std::array<uint32_t, 2>> midpoints;
    std::vector<uint32_t> triangles;
    double reach = 0.0; // of the region: shorter than asked for where there were too many triangles
};

// `positions`: of the vertices of `triangles`. At most `most` triangles come out, or as many as came in: the reach is shortened until it is so. Same
// bits at any thread count.
DicedMesh dice(std::span<const Vec3d> positions, std::span<const uint32_t> triangles,
               const DisplacedRegion& region, size_t most = size_t(1) << 24);

} // namespace marram
