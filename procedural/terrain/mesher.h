// SPDX-License-Identifier: Apache-2.0
// The render mesh of a terrain: as few triangles as hold a tolerance, without cracks. See mesher.cpp for how.
#pragma once

#include "core/math/vec.h"
#include "procedural/terrain/fields.h"

#include <cstdint>
#include <vector>

namespace marram {

// The greatest vertical distance between the mesh and a sample, and how far normals may be off.
struct MeshTolerance {
    // Without a camera: the tolerance, m. With one: the least that any sample asks for, a floor for what touches the camera. 0: the
    // mesh meets every sample.
    double metres = 0.0;
    // With a camera, at each sample: pixels x pixel_angle x distance from the sample to the nearest camera, m. A tolerance in
    // projected height: what is seen from straight above errs by less. 0: no camera.
    double pixels = 0.0;
    // Radians, of the pixel that spans the smallest angle (in a pinhole image the one in the corner).
    double pixel_angle = 0.0;
    // The greatest difference between the gradient that the mesh's vertices interpolate at a sample and the sample's own, metres of
    // rise a metre. It holds the shading of interpolated normals as the others hold the outline: at 0.02 dunes in low light look as
    // those of the whole grid do. With a camera it grows where a pixel is wider than a cell, by as much. 0: off.
    double gradient = 0.0;
    // Where the camera is in each motion sample. It has to be near enough in time: between two of them nothing is promised.
    std::vector<Vec3d> cameras;
};

struct RenderMesh {
    std::vector<uint32_t> samples; // of the grid, one a vertex
    std::vector<uint32_t>
        triangles; // three each, into `samples`; their normals point up, as those of (a, a + nx, a + 1) do
};

// `heights`: nx * nz, finite. A domain of fewer than 2 x 2 samples has no triangles. Same bits at any thread count.
RenderMesh mesh_terrain(const Domain& domain, const float* heights, const MeshTolerance& tolerance);

} // namespace marram
