// SPDX-License-Identifier: Apache-2.0
// The map of the ground plane that a control net gives; the model is in lattice.cpp.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"

#include <optional>
#include <vector>

namespace marram {

// Weights of the four control points of one segment of a uniform cubic B-spline, and their derivatives. t in
// [0, 1].
MARRAM_INLINE void cubic_bspline(double t, double (&b)[4], double (&slope)[4]) {
    const double r = 1.0 - t, t2 = t * t;
    b[0] = r * r * r * (1.0 / 6.0);
    b[1] = (3.0 * t2 * t - 6.0 * t2 + 4.0) * (1.0 / 6.0);
    b[2] = (-3.0 * t2 * t + 3.0 * t2 + 3.0 * t + 1.0) * (1.0 / 6.0);
    b[3] = t2 * t * (1.0 / 6.0);
    slope[0] = -0.5 * r * r;
    slope[1] = 1.5 * t2 - 2.0 * t;
    slope[2] = -1.5 * t2 + t + 0.5;
    slope[3] = 0.5 * t2;
}

// A net of nu by nv control points and their offsets. The rest position of point (i, j) is origin + i
// along_row + j across_rows.
struct LatticeNet {
    int nu = 0, nv = 0;
    Vec2d origin = Vec2d::Zero(), along_row = Vec2d::UnitX(), across_rows = Vec2d::UnitY();
    std::vector<Vec3d> offsets; // metres; point (i, j) at j * nu + i
};

// The cell between control points (i, j) and (i + 1, j + 1). The border around the net has cells too: i goes
// from -2 to nu.
struct LatticeCell {
    int i = 0, j = 0;
    double jacobian = 0.0; // at some point of the cell, or a lower bound: not above min_jacobian
};

// Control point as stored for evaluation: sideways offset in net steps, vertical offset in metres.
struct alignas(32) LatticeControl {
    double values[4] = {0.0, 0.0, 0.0, 0.0}; // u, v, y, 0
};

// The map (x, z) -> (x + dx, z + dz) of the ground plane, with the vertical offset dy.
class LatticeMap {
  public:
    // A Jacobian at or below this value counts as a fold.
    static constexpr double min_jacobian = 1e-3;

    // `accuracy`: tolerance of the inverse in metres.
    LatticeMap(const LatticeNet& net, double accuracy);

    // The first folded cell in row order.
    std::optional<LatticeCell> fold() const;
    // These take a rest position. Outside support() the offset is 0 and the Jacobian is 1.
    Vec3d offset(const Vec2d& rest) const;
    Vec2d forward(const Vec2d& rest) const;
    double jacobian(const Vec2d& rest) const;
    // The rest position that maps to `at`. The map must have no fold.
    Vec2d inverse(const Vec2d& at) const;
    // Inverts `count` points of row z, starting at x, `cell` apart. Outputs rest position minus point, in x
    // and z, and the vertical offset there. All three are exactly 0 where nothing moves. Does not allocate.
    void row(double x, double z, double cell, int count, double* to_rest_x, double* to_rest_z,
             double* lift) const;

    bool is_vertical_only() const { return only_lifts_; }
    double max_shift() const { return max_shift_; } // metres: upper bound of the sideways offset
    // Bounding box of the region that can move.
    void support(Vec2d& lower, Vec2d& upper) const;
    // Bounding box, in rest positions, of the region that control point (i, j) moves.
    void support(int i, int j, Vec2d& lower, Vec2d& upper) const;

  private:
    Vec2d to_net(const Vec2d& world) const { return to_net_ * (world - origin_); }
    void box(const Vec2d& low, const Vec2d& high, Vec2d& lower, Vec2d& upper) const;

    int nu_, nv_, stride_;
    Vec2d origin_;
    Eigen::Matrix2d to_world_, to_net_;
    std::vector<LatticeControl> controls_; // padded by three points with zero offset on each side
    double tolerance_;                     // of the inverse, in net steps
    double max_shift_ = 0.0;
    bool only_lifts_ = true;
};

} // namespace marram
