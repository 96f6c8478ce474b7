// SPDX-License-Identifier: Apache-2.0
// Rock as a level set: signed distance on a sparse grid, with wear and mesh extraction. Documented in
// level_set.cpp.
#pragma once

#include "procedural/erosion/level_mesh.h"

#include <memory>

namespace marram {

class LevelSet {
  public:
    // All of these throw LevelSetError. `voxel` is in metres.
    // positions: xyz per vertex; triangles: 3 indices each. The mesh must be closed: every edge has an even
    // number of triangles. Orientation does not matter; triangles without area are ignored.
    static LevelSet from_mesh(std::span<const float> positions, std::span<const uint32_t> triangles,
                              double voxel);

    LevelSet(LevelSet&&) noexcept;
    LevelSet& operator=(LevelSet&&) noexcept;
    LevelSet(const LevelSet&);
    LevelSet& operator=(const LevelSet&) = delete;
    ~LevelSet();

    double voxel() const;         // metres
    bool empty() const;           // no rock is left
    size_t bytes() const;

    // The surface. Cached until the rock changes.
    const LevelMesh& mesh();

    // Wears the rock. `depth`: metres along the normal at each vertex of mesh(), clamped to 0 ... voxel();
    // NaN counts as 0. Rock is never added.
    void advance(std::span<const double> depth);

    // The same rock with half the voxel size, grown outward by `offset` metres, at most one voxel of this
    // level set.
    LevelSet refined(double offset) const;
    // Intersection with another level set of the same voxel size.
    void intersect(const LevelSet& other);
    // Removes all pieces except the one with the most voxels; returns the number of removed pieces.
    size_t keep_largest();

    // Signed distances at points (xyz each), metres, negative in rock. Tricubic near the surface, clamped to
    // three voxels away from it.
    void sample(std::span<const float> points, std::span<float> distance) const;

  private:
    struct Data;
    explicit LevelSet(std::unique_ptr<Data> data);
    std::unique_ptr<Data> data_;
};

// Signed distance (metres) of points (xyz each) near the surface of `mesh` from that surface, smoothed by a
// Gaussian of standard deviation `sigma` metres. Reference for tests of "a coarse level is the smoothed fine
// level".
void smoothed_distance(const LevelMesh& mesh, double sigma, std::span<const float> points,
                       std::span<float> distance);

} // namespace marram
