// SPDX-License-Identifier: Apache-2.0
// Many triangles, searched one by one or by a uniform grid; both give the same answers (triangles_test.cpp
// proves the grid against the other).
//
// Each triangle is listed in every cell that its bounding box overlaps. A query visits a superset of the
// cells that have a point within r of the segment: for each layer of cells along the segment's longest axis,
// the part of the segment within r of the layer, its bounding box grown by r. Cell indices come from one
// monotonic function of the coordinate, for triangles and queries alike, and r is grown by a bound of the
// rounding in the boxes, so nothing is lost between.
#pragma once

#include "tests/oracle/triangles.h"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace marram::oracle {

struct Nearest {
    Closest closest; // distance infinite where nothing is within the limit
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
    // Cells are as wide as a mean triangle's box, or wider so that there are at most 8 a triangle: 50 to 100
    // bytes a triangle in all.
    explicit TriangleSet(std::vector<Triangle> triangles, Search search = Search::grid);

    std::span<const Triangle> triangles() const { return triangles_; }

    // The triangle nearest to the segment pq (to the point p where q = p) within `limit`, of those that the
    // filter lets through; of equally near ones the one with the least index.
    Nearest nearest(const Vec3d& p, const Vec3d& q, double limit = no_limit, const Filter& filter = {}) const;
    // All triangles not further than `reach` from pq, ascending.
    std::vector<int> within(const Vec3d& p, const Vec3d& q, double reach) const;
    // All triangles that the segment crosses, in the order of the segment.
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
