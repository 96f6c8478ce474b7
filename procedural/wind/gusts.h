// SPDX-License-Identifier: Apache-2.0
// Gusts: influences that travel through the scene and raise the wind's envelope where they are. After A. Somasundaram,
// "Enhancing the Realism of Procedural Wind on Curves with Collision, Shielding, and Gusts" (SIGGRAPH 2019 Talks).
//
// WHAT THERE IS. At a time there is a number of influences, each a function I(P) of a rest CV's place in the world:
//
//     I(P) = weight * ramp(t),   t = T(x),   x = M (P - C),   and I = 0 exactly where not t < 1
//
//     sphere        T(x) = |x| / (1 - lumps * nu(1.5 x))             nu in [0, 1): smooth noise, below; controls: lumps = 0
//     in/out box    T(x) = max over axes a of 0 where |x_a| <= i_a, (|x_a| - i_a) / (1 - i_a) where i_a < |x_a| < 1, else 1
//
// so t is 0 at the centre of a sphere or in all of the inner box, 1 at the boundary of the unit sphere or of the unit cube
// [-1, 1]^3. A gust's sum at a CV is the sum of all I(P); it is not clamped here (chain.md: the envelope is). A ramp's
// value at 1 is 0 (read_gusts insists), so nothing jumps at a boundary; only a box whose inner is its outer does, as asked.
//
// A CONTROL is placed by the artist: C the translation, M = (rotation * scale)^-1 of its keyed transform at the frame,
// weight its `strength`. At the instant that an interpolated scale passes through 0 it has no volume and no influence.
//
// A PROCEDURAL GUST is number i of `num_gusts` in repetition m of the set, m any integer (`period` frames apart; only m = 0
// where period = 0). Let m' = m where `redraw` is set and 0 where not, hash(), unit_double() those of core/math/hash.h, and
//
//     key  = hash(hash(seed, uint64(m')), i)                                 (m' in two's complement)
//     draw(p) = unit_double(hash(key, p)),       draw(p, [low, high]) = low + (high - low) * draw(p)
//
//     p = 0  place across: (draw - 1/2) * extent[0] along a      p = 4  speed          m/s
//     p = 1  place across: (draw - 1/2) * extent[1] along b      p = 5  start_frame
//     p = 2  radius                                              p = 6  life           frames
//     p = 3  radius_noise = lumps                                p = 7  decay          frames
//     p = 8  seed of nu: the upper 32 bits of hash(key, 8)
//
// with w the wind's unit direction, a = e_y x w (e_x x w where |w_y| > 0.999) made unit, b = w x a: level and upright in
// a level wind. With age = frame - start_frame - m * period in frames,
//
//     C = center - distance * w + place + w * speed * age / fps,    M = 1 / radius,
//     weight = strength * s(min(1, (age + d) / d)) * s(min(1, (life - age) / d)),   d = min(max(decay, 1), life)
//     s(y) = y^2 (3 - 2 y)                                          alive: -d < age < life and life > 0 and 1 / radius is finite.
//
// It stands in the plane upwind, in full strength, at its start frame and fades out over the last d frames of its life:
// over all of it where decay is longer, over one frame where decay is shorter, for nothing may pop. For the same reason it
// swells over the d frames *before* its start frame, on its way to the plane. That is seen only where an artist has put the
// plane among the strands; the plane that fix_gusts() finds lies outside by the greatest radius.
//
// nu is value noise: lattice points have values h * 2^-24, h the upper 24 bits of mix32(mix32(mix32(seed + i) + j) + k) in
// uint32 arithmetic, blended along x, then y, then z by 6f^5 - 15f^4 + 10f^3. Being a mean of values in [0, 1) it stays in
// [0, 1), so a gust never leaves the ball of its radius, which culling relies on; at lumps = 1 its boundary could come
// down to the centre, so lumps are at most 0.9. It has 1.5 cells a radius and goes with the gust.
//
// ERROR. Everything is computed in double from the CVs' floats and summed in double; strands.gust is rounded once. Against
// the formulas above: < 1e-6 (tests/unit/procedural/gusts_test.cpp).
//
// COST. gusts_at() is about 0.3 us a gust and repetition, once a time, not a patch. Its result is a tree of boxes, eight
// children a node, so a patch asks a few nodes for what touches it (under 1 us with 90,000 gusts alive), and pays 3 ns a CV
// for each of those, 11 ns with lumps, whatever else there is. Influences are added in the tree's order, in which those that
// do not touch are left out; they would add 0, so patches may be cut in any way and culled or not: the bits are the same.
#pragma once

#include "core/math/ramp.h"
#include "core/math/transform.h"
#include "core/math/vec.h"
#include "procedural/values.h"
#include "procedural/wind/colliders.h"
#include "procedural/wind/strands.h"

#include <optional>
#include <span>
#include <vector>

namespace marram {

struct GustControl {
    bool box = false; // else a sphere
    KeyedTransform transform;
    Vec3d inner = Vec3d::Zero(); // of a box: half lengths of the inner one where the outer's are 1
    Ramp ramp;                   // from the centre (0) to the boundary (1)
    double strength = 1.0;
};

struct Gusts {
    uint32_t num_gusts = 0;
    Vec2d radius{2.0, 4.0};       // m; this and the next: drawn from [low, high]
    Vec2d radius_noise{0.0, 0.0}; // 0 ... 0.9
    Vec2d speed{0.0, 0.0};        // m/s
    Vec2d start_frame{0.0, 0.0}, life{0.0, 0.0}, decay{0.0, 0.0};
    double period = 0.0; // frames, 0 or >= 1
    bool redraw = false; // every repetition draws anew
    double strength = 1.0;
    Ramp ramp;
    uint32_t seed = 0;
    std::optional<Vec3d> center;    // m
    std::optional<Vec2d> extent;    // m, across the wind: level, upright
    std::optional<double> distance; // m, upwind of the centre
    std::vector<GustControl> controls;
};

// Parameters of [wind] that begin with "gusts.".
std::span<const MarramParam> gust_params();

// From values named "wind.gusts....". Nothing when the scene asks for no gusts. Throws SceneFault.
std::optional<Gusts> read_gusts(const Values& values);

// Gives center, extent and distance where the scene gives none: those of a box that holds all strands, once a shot (at
// bind_frame), never that of the frame at hand. The plane comes to lie upwind of the box by the greatest radius.
// A box that is empty or not finite counts as the point 0.
void fix_gusts(Gusts& gusts, const Vec3d& lower, const Vec3d& upper, const Vec3d& wind_direction);

// False: the influences are the same at every time.
bool gusts_move(const Gusts& gusts);

// One influence at one time.
struct Influence {
    Vec3d center;            // C
    Eigen::Matrix3d to_unit; // M
    bool box = false;
    Vec3d inner = Vec3d::Zero();
    double lumps = 0.0;
    uint32_t lump_seed = 0;
    double weight = 0.0;
    const Ramp* ramp = nullptr;
    Vec3d lower, upper; // its bounds in the world
};

struct alignas(sizeof(VDouble)) EightBoxes { // lanes without a box are empty: lower = +inf, upper = -inf
    Wide3d lower, upper;
};

// All that may be felt at one time. Points into the Gusts that it was made from.
struct GustField {
    std::vector<Influence> influences; // along a space-filling curve
    // levels[0][i] are the boxes of influences 8 i ... 8 i + 7, levels[l + 1][i] those around levels[l][8 i ... 8 i + 7]; the
    // last level is one node. No level where there are no influences.
    std::vector<WideVector<EightBoxes>> levels;

    size_t bytes() const;
};

// Center, extent and distance must be there if num_gusts > 0 (fix_gusts). `wind_direction` is unit. Only influences that touch the
// box `within` are kept, about 0.3 KB each: add_gusts() gives the same bits for CVs in the box.
GustField gusts_at(const Gusts& gusts, const Vec3d& wind_direction, double frame, double fps,
                   const Eigen::AlignedBox3d& within = everywhere());

// strands.gust += the sum of influences at each CV of strands.rest; the caller sets it to 0 before. Returns how many influences were evaluated: those whose
// bounds touch those of the strands. Any thread.
size_t add_gusts(const GustField& field, Strands& strands);

} // namespace marram
