// SPDX-License-Identifier: Apache-2.0
// Rock as a level set: signed distance on a sparse grid, which is worn away and comes out as a mesh. The page is in level_set.cpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace marram {

// A closed surface.
struct LevelMesh {
    std::vector<float> positions;    // xyz a vertex, metres
    std::vector<float> normals;      // xyz a vertex, unit, outward: the gradient of the level set
    std::vector<uint32_t> triangles; // 3 a triangle, anticlockwise seen from outside
    size_t vertex_count() const { return positions.size() / 3; }
    size_t triangle_count() const { return triangles.size() / 3; }
};

double mesh_area(const LevelMesh& mesh);   // m^2
double mesh_volume(const LevelMesh& mesh); // m^3

// What is wrong with a mesh, a file or a voxel size, in words for the user.
struct LevelSetError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

class LevelSet {
  public:
    // All of these throw LevelSetError. `voxel` is in metres.
    // positions: xyz a vertex; triangles: 3 indices each, closed: every edge has an even number of triangles. Their orientation does
    // not matter, and triangles without area are left out.
    static LevelSet from_mesh(std::span<const float> positions, std::span<const uint32_t> triangles,
                              double voxel);
    // The first level set of a .vdb file.
    static LevelSet read(const std::string& file);
    void write(const std::string& file) const;

    LevelSet(LevelSet&&) noexcept;
    LevelSet& operator=(LevelSet&&) noexcept;
    LevelSet(const LevelSet&);
    LevelSet& operator=(const LevelSet&) = delete;
    ~LevelSet();

    double voxel() const;         // metres
    bool empty() const;           // no rock is left
    size_t active_voxels() const; // of the narrow band
    size_t bytes() const;

    // The surface. Kept until the rock changes.
    const LevelMesh& mesh();

    // Wears the rock: `depth` is metres along the normal at each vertex of mesh(), cut to 0 ... voxel(); what is not a number
    // is 0. Rock is never added.
    void advance(std::span<const double> depth);

    // The same rock with voxels of half the size, grown outward by `offset` metres, at most one of the present voxels.
    LevelSet refined(double offset) const;
    // Keeps what is rock in both; they must have the same voxels.
    void intersect(const LevelSet& other);
    // Removes rock that is not connected to the largest piece; returns how many pieces went.
    size_t keep_largest();

    // Signed distances at points (xyz each), metres, negative in rock: tricubic near the surface, cut to three voxels away from it.
    void sample(std::span<const float> points, std::span<float> distance) const;

  private:
    struct Data;
    explicit LevelSet(std::unique_ptr<Data> data);
    std::unique_ptr<Data> data_;
};

// How far the surface of `mesh`, smoothed by a Gaussian of standard deviation `sigma` metres, is from points that lie near it
// (xyz each): signed, metres. The reference of what is meant by "a coarse level is the fine one, smoothed".
void smoothed_distance(const LevelMesh& mesh, double sigma, std::span<const float> points,
                       std::span<float> distance);

} // namespace marram
