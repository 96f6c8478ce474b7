// SPDX-License-Identifier: Apache-2.0
// Lattice: a drawn net of points bends the terrain below it. The page of the model is in lattice.cpp.
#pragma once

#include "core/math/simd.h"
#include "procedural/terrain/layer_types.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Shares of the four control points around a segment of a uniform cubic B-spline, and their derivatives; t
// from 0 to 1.
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

// Control points at rest, nu by nv of them, and how far each is moved. Point (i, j) rests at origin + i
// along_row + j across_rows.
struct LatticeNet {
    int nu = 0, nv = 0;
    Vec2d origin = Vec2d::Zero(), along_row = Vec2d::UnitX(), across_rows = Vec2d::UnitY();
    std::vector<Vec3d> offsets; // metres; point (i, j) at j * nu + i
};

// A cell of the lattice: between points (i, j) and (i + 1, j + 1). Those of the border around the net count
// as well: i from -2 to nu.
struct LatticeCell {
    int i = 0, j = 0;
    double jacobian = 0.0; // at one of its points: not above least_jacobian; or a bound of it
};

// A control point as it is evaluated: the offset sideways in steps of the net, the one upwards in metres.
struct alignas(32) LatticeControl {
    double values[4] = {0.0, 0.0, 0.0, 0.0}; // u, v, y, 0
};

// The map of the ground (x, z) -> (x + dx, z + dz), and the lift dy that goes with it.
class LatticeMap {
  public:
    // What is squeezed further than to this share of its area counts as a fold.
    static constexpr double least_jacobian = 1e-3;

    // `accuracy`: metres that the inverse may be off.
    LatticeMap(const LatticeNet& net, double accuracy);

    // The first cell that is folded, row by row.
    std::optional<LatticeCell> fold() const;
    // Of a point at rest. All of them are 0, and the Jacobian 1, outside of support().
    Vec3d offset(const Vec2d& rest) const;
    Vec2d forward(const Vec2d& rest) const;
    double jacobian(const Vec2d& rest) const;
    // The point at rest that is moved to `at`. Needs a map without a fold.
    Vec2d inverse(const Vec2d& at) const;
    // For `count` points of row z from x on, `cell` apart: their points at rest less themselves, x and z,
    // and the lift there. All three are exactly 0 where nothing is moved. Nothing is allocated.
    void row(double x, double z, double cell, int count, double* to_rest_x, double* to_rest_z,
             double* lift) const;

    bool only_lifts() const { return only_lifts_; }
    double largest_shift() const { return largest_shift_; } // sideways, metres: a bound
    // The box around all that can move.
    void support(Vec2d& lower, Vec2d& upper) const;
    // The box around what control point (i, j) moves, at rest.
    void support(int i, int j, Vec2d& lower, Vec2d& upper) const;

  private:
    Vec2d to_net(const Vec2d& world) const { return to_net_ * (world - origin_); }
    void box(const Vec2d& low, const Vec2d& high, Vec2d& lower, Vec2d& upper) const;

    int nu_, nv_, stride_;
    Vec2d origin_;
    Eigen::Matrix2d to_world_, to_net_;
    std::vector<LatticeControl> controls_; // with three more on each side, which rest
    double tolerance_;                     // of the inverse, in steps of the net
    double largest_shift_ = 0.0;
    bool only_lifts_ = true;
};

class LatticeLayer : public Layer {
  public:
    enum class Target { bedrock, sand };
    LatticeLayer(const LatticeNet& net, const Domain& domain, Target target, std::vector<std::string> masks);

    Writes writes() const override { return {target_ == Target::bedrock, true}; }
    std::vector<std::string> mask_names() const override { return masks_; }
    double reach() const override;
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    Tiles changed_since(const Layer& before, const Domain& domain) const override;

    const LatticeMap& map() const { return map_; }

  private:
    struct Span; // samples of a row
    void evaluate_row(const Span& span, const Fields& below, const LayerOutput& out) const;

    LatticeNet net_;
    Domain domain_;
    Target target_;
    std::vector<std::string> masks_;
    LatticeMap map_;
};

// The net that curves at rest and the same ones bent describe. A SceneFault at `place` where they do not
// fit each other.
LatticeNet lattice_net(std::span<const DrawnCurve> rest, std::span<const DrawnCurve> bent,
                       const std::string& place);

LayerType lattice_layer_type();

} // namespace marram
