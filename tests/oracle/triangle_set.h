// SPDX-License-Identifier: Apache-2.0
// A set of triangles, searched one by one or by a uniform grid. Both give the same answers
// (triangles_test.cpp compares them).
//
// Each triangle is listed in every cell that its bounding box overlaps. A query visits a superset of the
// cells that have a point within r of the segment. For each layer of cells along the segment's longest axis
// these are the cells in the bounding box, grown by r, of the part of the segment within r of the layer.
// Triangles and queries use one monotonic function from coordinates to cell indices, and r is increased by a
// bound of the rounding in the boxes, so no triangle is missed.
#pragma once

#include "tests/oracle/triangles.h"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace marram::oracle {

struct Nearest {
    Closest closest; // distance: infinite if nothing is within the limit
    int triangle = -1;
};

struct Hit {
    int triangle = -1;
    Crossing crossing;
};

class TriangleSet {
  public:
    enum class Search { one_by_one, grid };
    static constexpr double no_limit = std::numeric_limits<double>::infinity();
    using Filter = std::function<bool(int triangle)>;

    TriangleSet() = default;
    // Cells are as wide as a mean triangle's box, or wider to have at most 8 cells per triangle. Memory: 50
    // to 100 bytes per triangle in all.
    explicit TriangleSet(std::vector<Triangle> triangles, Search search = Search::grid);

    std::span<const Triangle> triangles() const { return triangles_; }

    // The triangle nearest to the segment pq (to the point p if q = p) within `limit`, among those that pass
    // the filter. Of equally near ones, the one with the lowest index.
    Nearest nearest(const Vec3d& p, const Vec3d& q, double limit = no_limit, const Filter& filter = {}) const;
    // All triangles within `reach` of pq, in ascending order.
    std::vector<int> within(const Vec3d& p, const Vec3d& q, double reach) const;
    // All triangles that the segment crosses, ordered along the segment.
    std::vector<Hit> crossings(const Vec3d& p, const Vec3d& q) const;
    bool any_crossing(const Vec3d& p, const Vec3d& q) const;

  private:
    int cell_index(int axis, double x) const; // clamped to [-1, size]: -1 and size lie outside
    template <typename Visitor> // visitor(triangle) -> true: stop. A triangle may be visited more than once.
    void visit(const Vec3d& p, const Vec3d& q, double reach, Visitor&& visitor) const;
    void build();

    std::vector<Triangle> triangles_;
    Search search_ = Search::one_by_one;
    Eigen::AlignedBox3d bounds_;
    double cell_ = 1.0;
    int size_[3] = {1, 1, 1};
    std::vector<uint32_t> first_, listed_; // cell -> its run in listed_
};

} // namespace marram::oracle
