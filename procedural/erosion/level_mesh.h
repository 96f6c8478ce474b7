// SPDX-License-Identifier: Apache-2.0
// The surface of a rock as a mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <vector>

namespace marram {

// A closed surface.
struct LevelMesh {
    std::vector<float> positions;    // xyz per vertex, metres
    std::vector<float> normals;      // xyz per vertex, unit, outward: gradient of the level set
    std::vector<uint32_t> triangles; // 3 per triangle, anticlockwise seen from outside
    size_t vertex_count() const { return positions.size() / 3; }
    size_t triangle_count() const { return triangles.size() / 3; }
};

double mesh_area(const LevelMesh& mesh);   // m^2
double mesh_volume(const LevelMesh& mesh); // m^3

// Signed volume (m^3) of each connected piece, stored at its first vertex. Negative volumes are cavities.
std::vector<double> piece_volumes(const LevelMesh& mesh);

// Whether each two triangles are a b c and a c d, as those of a level set.
bool has_quads(const LevelMesh& mesh);

// Error in a mesh or a voxel size; the message is for the user.
struct LevelSetError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

inline constexpr double level_set_band = 3.0; // half width of a level set's narrow band, in voxels

// Checks the mesh of a level set and returns its triangles, without those of zero area. `voxel` is in metres.
std::vector<uint32_t> checked_triangles(std::span<const float> positions, std::span<const uint32_t> triangles,
                                        double voxel);

} // namespace marram
