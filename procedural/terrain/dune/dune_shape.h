// SPDX-License-Identifier: Apache-2.0
// The shape of one dune along one curve, and its height at any point. The model is described in
// dune_shape.cpp.
#pragma once

#include "core/math/ramp.h"
#include "core/math/simd.h"
#include "procedural/terrain/fields.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace marram {

// User settings. Lengths in metres; ramps along the curve have positions from 0 at its first point to 1 at
// its last. Values are clamped to their ranges (see the head of dune_shape.cpp); non-finite ones become the
// lower limit.
struct DuneSettings {
    double max_height = 3.0;
    Ramp main_curve_shape = // height along the curve, as a fraction of max_height
        Ramp(std::array{0.0, 0.0, 0.5, 1.0, 1.0, 0.0}, "smooth");
    double slope_width = 12.0;      // from the crest to the foot of either slope, before the factors below
    double outer_slope_mult = 1.0;  // the outer slope is the windward one
    double inner_slope_mult = 0.6;  // the inner slope is the slip face
    double inner_slope_angle = 0.0; // radians; above 0 the slip face is straight and this steep
    Ramp outer_slope_fall_off_along_curve; // factor of the width along the curve
    Ramp inner_slope_fall_off_along_curve;
    Ramp outer_slope_shape = // height from the crest (0) to the foot (1), as a fraction of the crest height
        Ramp(std::array{0.0, 1.0, 1.0, 0.0}, "smooth");
    Ramp inner_slope_shape = Ramp(std::array{0.0, 1.0, 1.0, 0.0}, "linear");
    // How many times further the outer slope reaches along the dune's axis than across it. Widths are those
    // along the axis, which is perpendicular to the line from first to last point, turned by outer_slope_turn
    // (radians, from x to z).
    double outer_slope_stretch = 1.0, outer_slope_turn = 0.0;
    double crest_radius = 0.0;          // metres over which the crest is rounded; its height stays
    double boundary_noise = 0.0;        // metres: maximum offset of the foot, in or out
    double boundary_noise_length = 8.0; // metres along the curve from one value to the next
    double max_dist = 0.0;              // metres from the crest where the mask ends; 0: at the foot
    Ramp mask_fall_off =                // the mask from the crest (0) to max_dist (1)
        Ramp(std::array{0.0, 1.0, 1.0, 0.0}, "smooth");
    Ramp crest_push = Ramp(std::array{0.0, 0.0}, "linear");  // metres to the inner side, along the curve
    Ramp crest_pinch = Ramp(std::array{0.0, 0.0}, "linear"); // above 0: narrower towards the crest
    double smoothing = 0.1;       // of the drawn curve: standard deviation in slope widths
    double search_accuracy = 8.0; // points of the resampled curve in a slope width
    bool flip = false;            // false: the outer side is on the left along the curve; true: on the right
    uint64_t seed = 0;
    bool operator==(const DuneSettings&) const = default;
};

// The dune at one point of the ground. Outside the dune and its mask all values are 0, except `dist`, which
// is reach().
struct DuneSample {
    double height = 0.0; // metres above the ground below
    double mask = 0.0;   // 0 to 1
    // Weights of the outer and the inner slope, 0 to 1, sum 1; each is 0 beyond its foot.
    double outer = 0.0, inner = 0.0;
    double dist = 0.0;                // smooth distance to the crest, metres, at most DuneShape::reach()
    Vec2d sample_dir = Vec2d::Zero(); // unit vector towards the crest; 0 outside and on it
};

// A point of the resampled curve with its height, widths and pinch.
struct DuneCrestPoint {
    Vec2d at;     // x, z
    double along; // fraction of the curve's length, 0 to 1
    double height, outer_width, inner_width, pinch;
};

// Evaluation data. Coordinates are relative to `origin`, so precision does not depend on the distance to the
// world origin.
struct DuneSegment {
    double x, z, ux, uz; // start, unit direction
    double length, along;
    double height[4];                    // coefficients in powers of the metres from the start
    double outer[2], inner[2], pinch[2]; // at the start, and the change per metre
};
// A run of segments.
struct DuneChunk {
    int first, last; // segments [first, last)
    double length;
    double far_begin,
        far_blend; // in squared distance: start of the far field, and 1 / width of its blend
    double x, z;   // the centre
    double height, outer, inner, pinch; // integrals along it
    double side_x, side_z, side_0;      // the integral of the signed side is side_x x + side_z z - side_0
    double radius, cover;               // radius about the centre; sum of the weights of its DuneCover
};
// Discs about the midpoints of a run of 8 segments. They bound its part of F, which tells where the dune is
// 0: see dune_bound.cpp.
struct alignas(64) DuneCover {
    double x[lanes], z[lanes], half[lanes], weight[lanes];
};
// The curve in the plane where distances are measured: (x, z) maps to (xx x + xz z, xz x + zz z).
struct DuneField {
    std::vector<DuneSegment> segments; // plus one more that holds the end of the last
    std::vector<DuneChunk> chunks;
    std::vector<DuneCover> covers; // one a chunk
    double softening2 = 0.0;       // eps^2, see dune_shape.cpp
    double reach = 0.0;            // slopes and mask are 0 beyond this distance
    double xx = 1.0, xz = 0.0, zz = 1.0;
};
// A ramp prepared for evaluation: for x >= positions[k], values[k] + steps[k] t with t = (x - positions[k])
// inverses[k].
struct DuneRamp {
    std::vector<double> positions, values, steps, inverses; // the last knot's step is 0
    bool smooth = false;
};
struct DuneParts {
    DuneField plain, stretched; // stretched: for the outer slope; empty if not stretched
    DuneSettings settings;      // clamped to their ranges
    DuneRamp outer_slope, inner_slope, mask;
    Vec2d origin = Vec2d::Zero();
    double reach = 0.0;
    double cotangent = 0.0;  // of the slip face's angle; 0: no angle set
    double outer_sign = 1.0; // -1 if flipped
    bool cubic = false;      // some height[2] or height[3] is not 0
};

// A dune, ready to be evaluated: the drawn curve smoothed and resampled, with its settings at every point.
class DuneShape {
  public:
    // points: x, z of the drawn curve. Drops points that are repeated, not finite or beyond 10^9 m. `closed`
    // joins the last point to the first. The shape is empty() if fewer than two different points remain.
    DuneShape(std::span<const Vec2d> points, bool closed, const DuneSettings& settings);

    bool empty() const { return parts_.plain.segments.empty(); }
    // Bounding box: height and mask are 0 outside.
    const Vec2d& lower() const { return lower_; }
    const Vec2d& upper() const { return upper_; }
    // Upper limit of `dist`, and its value where height and mask are 0.
    double reach() const { return parts_.reach; }
    // Hash of all inputs: equal digests mean equal dunes.
    uint64_t digest() const { return digest_; }
    // The resampled curve, x and z, for baking. On a closed curve the last point repeats the first.
    std::vector<Vec2d> crest() const;
    std::vector<DuneCrestPoint> crest_points() const;

    DuneSample sample(const Vec2d& at) const;
    // Heights and masks of `count` samples of row z from x on, `cell` apart. Bit-identical to sample().
    // Allocates nothing.
    void row(double x, double z, double cell, int count, double* height, double* mask) const;
    // The same for all values of sample().
    void row(double x, double z, double cell, int count, DuneSample* out) const;

  private:
    bool misses(double x0, double x1, double z) const;
    DuneSample outside() const;

    DuneParts parts_;
    Vec2d lower_ = Vec2d::Zero(), upper_ = Vec2d::Zero();
    uint64_t digest_ = 0;
};

} // namespace marram
