// SPDX-License-Identifier: Apache-2.0
// Gusts: influences that travel through the scene and raise the wind's envelope locally. After A.
// Somasundaram, "Enhancing the Realism of Procedural Wind on Curves with Collision, Shielding, and Gusts"
// (SIGGRAPH 2019 Talks).
//
// DEFINITION. At a given time there is a set of influences, each a function I(P) of a rest CV's world
// position P:
//
//     I(P) = weight * ramp(t),   t = T(x),   x = M (P - C),   and I = 0 exactly unless t < 1
//
//     sphere        T(x) = |x| / (1 - lumps * nu(1.5 x))             nu in [0, 1): smooth noise, below; controls: lumps = 0
//     in/out box    T(x) = max over axes a of 0 where |x_a| <= i_a, (|x_a| - i_a) / (1 - i_a) where i_a < |x_a| < 1, else 1
//
// So t is 0 at the centre of a sphere or in all of the inner box, and 1 at the boundary of the unit sphere or
// of the unit cube [-1, 1]^3. The gust value of a CV is the sum of all I(P); it is not clamped here
// (chain.md: the envelope is). A ramp is 0 at 1 (read_gusts checks it), so the influence is continuous at the
// boundary, except for a box whose inner box equals its outer one.
//
// A CONTROL is placed by the artist: C is the translation and M = (rotation * scale)^-1 of its keyed
// transform at the frame; weight is its `strength`. At a time when an interpolated scale is 0 it has no
// volume and no influence.
//
// A PROCEDURAL GUST is number i of `num_gusts` in repetition m of the set, m any integer (`period` frames
// apart; only m = 0 if period = 0). Let m' = m if `redraw` is set, else 0; hash() and unit_double() are from
// core/math/hash.h, and
//
//     key  = hash(hash(seed, uint64(m')), i)                                 (m' in two's complement)
//     draw(p) = unit_double(hash(key, p)),       draw(p, [low, high]) = low + (high - low) * draw(p)
//
//     p = 0  offset across: (draw - 1/2) * extent[0] along a     p = 4  speed          m/s
//     p = 1  offset across: (draw - 1/2) * extent[1] along b     p = 5  start_frame
//     p = 2  radius                                              p = 6  life           frames
//     p = 3  radius_noise = lumps                                p = 7  decay          frames
//     p = 8  seed of nu: the upper 32 bits of hash(key, 8)
//
//     (speed_range absent: relative_speed_range, times the wind's speed)
//
// with w the wind's unit direction, a = e_y x w (e_x x w if |w_y| > 0.999) normalised, b = w x a: horizontal
// and vertical if the wind is horizontal. With age = frame - start_frame - m * period in frames,
//
//     C = center - distance * w + offset + w * speed * age / fps,    M = 1 / radius,
//     weight = strength * s(min(1, (age + d) / d)) * s(min(1, (life - age) / d)),   d = min(max(decay, 1), life)
//     s(y) = y^2 (3 - 2 y)                                          alive: -d < age < life and life > 0 and 1 / radius is finite.
//
// In a wind that has keys, w, a and b are those of the frame at which the gust begins to fade in,
// seen = start - d: it leaves from a plane across that wind, and does not know of a wind to come. It goes with
// the air, whose displacement is D (air_path.h): instead of w * speed * age / fps it has moved by
//
//     factor * (D(now) - D(seen) - d v(seen) w(seen)) / fps
//
// with the factor drawn from relative_speed_range and v the wind's speed; a gust with a speed of its own by the
// same with that speed as factor, and with D and v of a wind of 1 m/s. So a gust stands while the wind stops.
// (speed_range is an error if the wind's speed has keys.)
//
// At its start frame a gust is at the plane upwind, at full strength. It fades out over the last d frames of
// its life: over all of it if decay is longer, and over at least one frame, so that nothing pops. For the
// same reason it fades in over the d frames *before* its start frame, on its way to the plane. That is
// visible only if the artist has placed the plane among the strands; the plane that set_gust_plane() computes
// lies outside by the largest radius.
//
// nu is value noise: lattice points have values h * 2^-24, h the upper 24 bits of mix32(mix32(mix32(seed + i)
// + j) + k) in uint32 arithmetic, interpolated along x, then y, then z by 6f^5 - 15f^4 + 10f^3. As a mean of
// values in [0, 1) it stays in [0, 1), so a gust never leaves the ball of its radius; culling relies on this.
// At lumps = 1 the boundary could reach the centre, so lumps are at most 0.9. nu has 1.5 cells a radius and
// moves with the gust.
//
// ERROR. Everything is computed and summed in double from the CVs' floats; strands.gust is rounded once.
// Against the formulas above: < 1e-6 (tests/unit/wind/gusts_test.cpp).
//
// COST. gusts_at() takes about 0.3 us a gust and repetition, once for each time, not for each patch. Its
// result is a tree of boxes with eight children a node. For a patch a few nodes are tested (under 1 us with
// 90,000 gusts alive), and each influence that overlaps the patch costs 3 ns a CV, 11 ns with lumps; the
// others cost nothing. Influences are added in the tree's order. Those that do not overlap the patch are
// skipped and would add 0, so the result has the same bits however strands are divided into patches, with or
// without culling.
#pragma once

#include "core/math/ramp.h"
#include "core/math/transform.h"
#include "core/math/vec.h"
#include "procedural/abi/values.h"
#include "procedural/wind/collision/colliders.h"
#include "procedural/wind/strands.h"

#include <optional>
#include <span>
#include <vector>

namespace marram {

struct GustControl {
    bool box = false; // else a sphere
    KeyedTransform transform;
    Vec3d inner = Vec3d::Zero(); // half sides of the inner box, as fractions of the outer box
    Ramp ramp;                   // from the centre (0) to the boundary (1)
    double strength = 1.0;
};

struct Gusts {
    uint32_t num_gusts = 0;
    Vec2d radius{2.0, 4.0};       // m; this and the following: drawn from [low, high]
    Vec2d radius_noise{0.0, 0.0}; // 0 ... 0.9
    Vec2d speed{0.0, 0.0};        // m/s, or relative to the wind's speed
    bool speed_is_relative = false;
    Vec2d start_frame{0.0, 0.0}, life{0.0, 0.0}, decay{0.0, 0.0};
    double period = 0.0; // frames, 0 or >= 1
    bool redraw = false; // each repetition draws new gusts
    double strength = 1.0;
    Ramp ramp;
    uint32_t seed = 0;
    std::optional<Vec3d> center;    // m
    std::optional<Vec2d> extent;    // m, across the wind: horizontal, vertical
    std::optional<double> distance; // m, upwind of the centre
    std::vector<GustControl> controls;
};

// Parameters of [wind] that start with "gusts.".
std::span<const MarramParam> gust_params();

// Reads values named "wind.gusts....". Empty if the scene has no gusts. Throws SceneFault.
std::optional<Gusts> read_gusts(const Values& values);

class AirPath;

// The wind that gusts go with.
struct GustCarrier {
    template <typename Vector>
    GustCarrier(const Eigen::MatrixBase<Vector>& unit, double metres_a_second = 0.0,
                const AirPath* keyed = nullptr)
        : direction(unit), speed(metres_a_second), path(keyed) {}
    Vec3d direction; // unit
    double speed;    // of gusts whose speed is relative
    // nullptr: the wind has the same speed and direction at all times. Else of the air or, for gusts with a
    // speed of their own, of a wind of 1 m/s.
    const AirPath* path;
};

// Sets center, extent and distance if the scene does not give them, from a box that contains all strands.
// Call it once a shot, with the box at bind_frame, never with the box of the current frame. The plane is
// placed upwind of the box by the largest radius; of its bounding sphere, if the wind has keys and may
// turn. A box that is empty or not finite counts as the point 0.
void set_gust_plane(Gusts& gusts, const Vec3d& lower, const Vec3d& upper, const GustCarrier& wind);

// Which gusts touch a box at some time within frames [first, last].
struct GustContacts {
    bool counted = true;                // false: more than a million gusts, not looked at
    uint64_t passing = 0, touching = 0; // random gusts that live in that time, and those that touch the box
    std::vector<bool> controls;         // [control]: it touches
};
// center, extent and distance must be set if num_gusts > 0. Bounds of gusts are tested (where the wind
// turns, along 16 straight parts of the way), of controls at up to 1000 times. Cost: about 0.1 us a gust
// and repetition.
GustContacts gusts_touching(const Gusts& gusts, const GustCarrier& wind, const Vec2d& frames, double fps,
                            const Eigen::AlignedBox3d& box);

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
    Vec3d lower, upper; // bounds in world space
};

struct alignas(sizeof(VDouble)) EightBoxes { // lanes without a box are empty: lower = +inf, upper = -inf
    Wide3d lower, upper;
};

// All influences at one time. Points into the Gusts that it was made from.
struct GustField {
    std::vector<Influence> influences; // along a space-filling curve
    // levels[0][i] holds the boxes of influences 8 i ... 8 i + 7, levels[l + 1][i] the bounds of nodes 8 i
    // ... 8 i + 7 of levels[l]; the last level is one node. Without influences there are no levels.
    std::vector<WideVector<EightBoxes>> levels;

    size_t bytes() const;
};
void build_tree(GustField& field); // sets `levels` from `influences`

// Center, extent and distance must be set if num_gusts > 0 (set_gust_plane). Keeps only influences that
// overlap the box `within`, about 0.3 KB each: add_gusts() gives the same bits for CVs in the box.
// Strengths are those of `gusts`.
GustField gusts_at(const Gusts& gusts, const GustCarrier& wind, double frame, double fps,
                   const Eigen::AlignedBox3d& within = everywhere());

// The random gusts at one time as spheres, whose boundary lumps dent. Strength: at the centre.
struct GustSphere {
    Vec3d center;
    double radius, strength;
};
std::vector<GustSphere> random_gusts_at(const Gusts& gusts, const GustCarrier& wind, double frame,
                                        double fps);

// strands.gust += the sum of influences at each CV of strands.rest; the caller sets it to 0 first. Returns
// the number of influences evaluated: those whose bounds overlap the bounds of the strands. Thread-safe.
size_t add_gusts(const GustField& field, Strands& strands);

} // namespace marram
