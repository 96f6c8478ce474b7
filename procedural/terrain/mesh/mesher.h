// SPDX-License-Identifier: Apache-2.0
// The render mesh of a terrain: an adaptive, crack-free triangulation within a tolerance. The method is
// documented in mesher.cpp.
#pragma once

#include "core/math/vec.h"
#include "procedural/terrain/fields.h"

#include <cstdint>
#include <vector>

namespace marram {

// Tolerances at the samples: vertical distance to the mesh, and deviation of the gradient.
struct MeshTolerance {
    // Without cameras: the tolerance, m. With cameras: its lower bound, for samples close to a camera. 0
    // without cameras: the mesh interpolates every sample.
    double metres = 0.0;
    // With cameras the tolerance at a sample is pixels x pixel_angle x distance to the nearest camera, m.
    // This bounds the projected vertical error; seen from above, the error on the film is smaller. 0: cameras
    // are ignored.
    double pixels = 0.0;
    // Radians: the smallest angle that a pixel subtends (in a pinhole image that of the corner pixel).
    double pixel_angle = 0.0;
    // Largest allowed difference, m/m, between the gradient interpolated from the mesh's vertices and the
    // gradient at a sample. It bounds the error of shading with interpolated normals: at 0.02 dunes in low
    // light look as with the full grid. With cameras it is scaled by the width of a pixel in cells where that
    // exceeds 1. 0: off.
    double gradient = 0.0;
    // Camera position at each motion sample. The tolerance is not guaranteed between motion samples.
    std::vector<Vec3d> cameras;
};

struct RenderMesh {
    std::vector<uint32_t> samples; // grid sample of each vertex
    std::vector<uint32_t>
        triangles; // three indices into `samples` each; normals point up, as for (a, a + nx, a + 1)
};

// `heights`: nx * nz finite values. A domain below 2 x 2 samples gives no triangles. Same bits at any thread
// count.
RenderMesh mesh_terrain(const Domain& domain, const float* heights, const MeshTolerance& tolerance);

} // namespace marram
