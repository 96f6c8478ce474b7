// SPDX-License-Identifier: Apache-2.0
// The shape of one dune along one curve, and its height at any point of the ground. The page of the model is in dune_shape.cpp.
#pragma once

#include "core/math/ramp.h"
#include "core/math/simd.h"
#include "procedural/terrain/fields.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace marram {

// What an artist sets. Lengths in metres; ramps along the curve have positions from 0 at its first point to 1 at its last.
// Any finite values are good; what is out of its range is brought to the range's end (see the page).
struct DuneSettings {
    double max_height = 3.0;
    Ramp main_curve_shape = // height along the curve, share of max_height
        Ramp(std::array{0.0, 0.0, 0.5, 1.0, 1.0, 0.0}, "smooth");
    double slope_width = 12.0;             // from the crest to the foot of either slope, before what follows
    double outer_slope_mult = 1.0;         // the outer slope is the windward one
    double inner_slope_mult = 0.6;         // the inner slope is the slip face
    double inner_slope_angle = 0.0;        // radians; above 0 the slip face is straight and this steep
    Ramp outer_slope_fall_off_along_curve; // factor of the width along the curve
    Ramp inner_slope_fall_off_along_curve;
    Ramp outer_slope_shape = // height from the crest (0) to the foot (1), share of the crest's
        Ramp(std::array{0.0, 1.0, 1.0, 0.0}, "smooth");
    Ramp inner_slope_shape = Ramp(std::array{0.0, 1.0, 1.0, 0.0}, "linear");
    // How many times further the outer slope reaches along the dune's axis than across it. Widths are those along the axis, which is
    // square to the line from the first point to the last, and turned by outer_slope_turn (radians, from x to z).
    double outer_slope_stretch = 1.0, outer_slope_turn = 0.0;
    double crest_radius = 0.0;          // metres over which the crest is rounded; its height stays
    double boundary_noise = 0.0;        // metres that the foot moves in and out at most
    double boundary_noise_length = 8.0; // metres along the curve from one value to the next
    double max_dist = 0.0;              // where the mask has fallen off; 0: at the foot of the dune
    Ramp mask_fall_off =                // the mask from the crest (0) to max_dist (1)
        Ramp(std::array{0.0, 1.0, 1.0, 0.0}, "smooth");
    Ramp crest_push = Ramp(std::array{0.0, 0.0}, "linear");  // metres to the inner side, along the curve
    Ramp crest_pinch = Ramp(std::array{0.0, 0.0}, "linear"); // above 0: narrower towards the crest
    double smoothing = 0.1;       // of the drawn curve: standard deviation in slope widths
    double search_accuracy = 8.0; // points of the resampled curve in a slope width
    bool flip = false; // the outer side is the left one as one walks along the curve; true: the right one
    uint64_t seed = 0;
    bool operator==(const DuneSettings&) const = default;
};

// What the dune says of one point of the ground. Outside of the dune and of its mask all is 0 but `dist`, which is reach().
struct DuneSample {
    double height = 0.0; // metres above what it stands on
    double mask = 0.0;   // 0 to 1 where the ramp is
    // Share of the outer slope, 0 to 1, and of the inner one, which is the rest; each 0 beyond its foot.
    double outer = 0.0, inner = 0.0;
    double dist = 0.0; // distance to the crest, metres (smooth: see the page), not above DuneShape::reach()
    Vec2d sample_dir = Vec2d::Zero(); // unit vector towards the crest; 0 outside and on it
};

// A point of the resampled curve with what holds there.
struct DuneCrestPoint {
    Vec2d at;     // x, z
    double along; // share of the curve's length, 0 to 1
    double height, outer_width, inner_width, pinch;
};

// What a dune is evaluated from. Coordinates are relative to `origin`, so that a dune far from the world's is as exact.
struct DuneSegment {
    double x, z, ux, uz; // begin, unit direction
    double length, along;
    double height[4];                    // powers of the metres from the begin
    double outer[2], inner[2], pinch[2]; // at the begin, and the change in a metre
};
// A run of segments.
struct DuneChunk {
    int first, last; // segments [first, last)
    double length;
    double far_begin,
        far_blend; // square of the distance where the far field begins; 1 / width of the blend in it
    double x, z;   // the centre
    double height, outer, inner, pinch; // integrals along it
    double side_x, side_z, side_0;      // of the side: side_x x + side_z z - side_0
    double radius, cover;               // about the centre; the sum of its DuneCover's weights
};
// What bounds the share of a run of 8 segments in the sum that tells where the dune is 0: discs about their middles.
struct alignas(64) DuneCover {
    double x[lanes], z[lanes], half[lanes], weight[lanes];
};
// The curve in a plane where distances are measured: (x, z) goes to (xx x + xz z, xz x + zz z).
struct DuneField {
    std::vector<DuneSegment> segments; // and one more that is the end of the last
    std::vector<DuneChunk> chunks;
    std::vector<DuneCover> covers; // one for every chunk
    double softening2 = 0.0;       // eps^2 of the page
    double reach = 0.0;            // the greatest distance at which a slope or a mask is not 0
    double xx = 1.0, xz = 0.0, zz = 1.0;
};
// A ramp as it is evaluated: from positions[k] on, values[k] + steps[k] t with t = (x - positions[k]) inverses[k].
struct DuneRamp {
    std::vector<double> positions, values, steps, inverses; // the last knot's step is 0
    bool smooth = false;
};
struct DuneParts {
    DuneField plain, stretched; // stretched: for the outer slope; empty where outer_slope_stretch is 1
    DuneSettings settings;      // within their ranges
    DuneRamp outer_slope, inner_slope, mask;
    Vec2d origin = Vec2d::Zero();
    double reach = 0.0;
    double cotangent = 0.0;  // of the slip face's angle; 0: none is given
    double outer_sign = 1.0; // -1: flipped
    bool cubic = false;      // some height[2], height[3] are not 0
};

// A dune, ready to be evaluated: the drawn curve smoothed and resampled, with its settings at every point.
class DuneShape {
  public:
    // points: x, z of the drawn curve. Repeated ones are dropped, and those that are not finite or beyond 10^9 m. `closed`: the
    // last is joined to the first. Fewer than two points that differ make a shape that is empty().
    DuneShape(std::span<const Vec2d> points, bool closed, const DuneSettings& settings);

    bool empty() const { return parts_.plain.segments.empty(); }
    // Beyond this box the height and the mask are 0.
    const Vec2d& lower() const { return lower_; }
    const Vec2d& upper() const { return upper_; }
    // `dist` is never above this, and this where the height and the mask are 0.
    double reach() const { return parts_.reach; }
    // Of everything that the dune is made from: two with the same are the same dune.
    uint64_t digest() const { return digest_; }
    // The resampled curve, x and z: what is baked out. The last point of a closed one is its first.
    std::vector<Vec2d> crest() const;
    std::vector<DuneCrestPoint> crest_points() const;

    DuneSample sample(const Vec2d& at) const;
    // Heights and masks of `count` samples of row z from x on, `cell` apart. Same bits as sample(). Nothing is allocated.
    void row(double x, double z, double cell, int count, double* height, double* mask) const;
    // The same with all that sample() says.
    void row(double x, double z, double cell, int count, DuneSample* out) const;

  private:
    bool misses(double x0, double x1, double z) const;
    DuneSample outside() const;

    DuneParts parts_;
    Vec2d lower_ = Vec2d::Zero(), upper_ = Vec2d::Zero();
    uint64_t digest_ = 0;
};

} // namespace marram
