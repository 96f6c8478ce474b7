// SPDX-License-Identifier: Apache-2.0
// Curve wind, after A. Somasundaram, "Enhancing the Realism of Procedural Wind on Curves with Collision,
// Shielding, and Gusts" (SIGGRAPH 2019 Talks), section 2.
//
// From root to tip, at segment k with start P_k on the curve as bent so far:
//
//     a = P_tip - P_k          b = w + amplitude * noise(P_root + w s_k waviness, travelling along w)
//     f = 1 - (1 - clamp(global_rotate ramp(u_k) e_k))^(reference |segment k| / L)
//     Q = the shortest-arc rotation from a onto b, its angle scaled by f; Q rotates all beyond P_k about P_k
//
// Without reference_segments that is the talk to the letter: the turn of each segment happens at its start,
// so the pose depends on the number of segments. With them, turns are those of a smooth bend whose pose is
// the limit of many segments: the turn at P_k stands for the strand from the middle of segment k - 1 to the
// middle of segment k (|segment k| is replaced by that length; at the root, by half of segment 0). So segment
// k points as the bend does at its middle, and the error of the pose falls with the square of the number of
// segments instead of its first power.
//
// Rotating the rest of the curve at each k is O(n^2). But all rotations act on the same rigid rest curve, so
// only their product is needed: R_k = Q_k R_{k-1}, segment k of the result is R_k d_k with d_k the rest
// segment, and a = R_{k-1} (rest tip - rest P_k). One quaternion is carried; one Newton step a segment
// renormalises it, which keeps it unit to 1e-16 for any number of CVs.
//
// The angle is computed from |a x b| and a . b, which is accurate near 0 and near pi. If a and b are opposed
// to within `opposed`, the cross product gives no usable axis. The axis is then taken from the curve's own
// bend: d_k x a turns the segment towards the tip and continues the strand's lean. For a straight strand it
// is taken from the noise, a x noise; without noise, from the coordinate axis that a has the smallest
// component along. Each of these axes is perpendicular to a.
#include "procedural/wind/bend.h"

#include "procedural/abi/ramp_table.h"
#include "procedural/wind/noise_along.h"

#include <cmath>

namespace marram {
namespace {

// Sine of the angle to exact opposition below which another axis is used. The cross product of doubles is
// good to 1e-16, so at this limit the axis is good to 1e-7; stored CVs are floats and resolve no smaller
// bend.
constexpr double opposed = 1e-9;

struct Turn { // unit quaternions
    VDouble x, y, z, w;
};

MARRAM_INLINE Turn operator*(const Turn& a, const Turn& b) {
    return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}

MARRAM_INLINE Turn renormalised(const Turn& q) {
    const VDouble s = 1.5 - 0.5 * (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    return {q.x * s, q.y * s, q.z * s, q.w * s};
}

MARRAM_INLINE Wide3d rotate(const Turn& q, const Wide3d& v) {
    const Wide3d u{q.x, q.y, q.z};
    const Wide3d t = cross(u, v) * splat(2.0);
    return v + t * q.w + cross(u, t);
}

// Axis for opposed a and b: the first of three perpendiculars to `a` that is well defined.
MARRAM_INLINE Wide3d axis_of_opposed(const Wide3d& a, const Wide3d& segment, const Wide3d& noise) {
    const VDouble zero{}, one = splat(1.0);
    const VLong x_least = (vabs(a.x) <= vabs(a.y)) & (vabs(a.x) <= vabs(a.z));
    const VLong y_least = ~x_least & (vabs(a.y) <= vabs(a.z));
    const Wide3d least{select(x_least, one, zero), select(y_least, one, zero),
                       select(x_least | y_least, zero, one)};
    Wide3d axis = cross(a, least);
    const VDouble aa = dot(a, a);
    const Wide3d by_noise = cross(a, noise);
    axis = select(dot(by_noise, by_noise) > 1e-12 * aa * dot(noise, noise), by_noise, axis);
    const Wide3d by_bend = cross(segment, a);
    return select(dot(by_bend, by_bend) > 1e-12 * aa * dot(segment, segment), by_bend, axis);
}

// The rotation from a onto b, its angle scaled by f in [0, 1]. Identity (and turns = false) if f is 0 or the
// rotation is undefined. `segment` is called only if a and b are opposed.
template <typename Segment>
MARRAM_INLINE Turn scaled_turn(const Wide3d& a, const Wide3d& b, VDouble f, Segment&& segment,
                               const Wide3d& noise, VLong& turns) {
    const VDouble aa = dot(a, a), bb = dot(b, b), cosine = dot(a, b);
    turns = (f > 0.0) & (aa > 0.0) & (bb > 0.0);
    Wide3d axis = cross(a, b);
    const VDouble sine = vsqrt(dot(axis, axis));
    const VLong is_opposed = (cosine < 0.0) & (sine <= opposed * vabs(cosine)) & turns;
    if (any(is_opposed)) [[unlikely]]
        axis = select(is_opposed, axis_of_opposed(a, segment(), noise), axis);
    const VDouble axis_length = vsqrt(dot(axis, axis));
    turns &= axis_length > 0.0;
    const VDouble angle = angle_of(select(turns, sine, 0.0), select(turns, cosine, 1.0));
    VDouble s, c;
    sincos_half_pi(angle * f * 0.5, s, c);
    const VDouble scale = select(turns, s / select(turns, axis_length, 1.0), 0.0);
    return {axis.x * scale, axis.y * scale, axis.z * scale, select(turns, c, 1.0)};
}

// 1 - (1 - f)^x for f in [0, 1], x >= 0; exactly 0 at f = 0, exactly 1 at f = 1 unless x = 0.
MARRAM_INLINE VDouble compounded(VDouble f, VDouble x) {
    const VDouble rest = 1.0 - f;
    const VLong full = rest < 1e-300;
    const VDouble exponent = vmax(x * vlog(select(full, 1.0, rest)), -700.0);
    const VDouble result = 1.0 - vexp(exponent);
    return select(full, select(x > 0.0, 1.0, 0.0), vmax(result, VDouble{}));
}

// Rest arc length from the root to each CV; [cvs - 1] is the whole length.
MARRAM_HOT void arc_lengths(const Wide3f* rest, int cvs, VDouble* arc) {
    arc[0] = VDouble{};
    for (int k = 0; k + 1 < cvs; ++k) {
        const Wide3d d = to_double(rest[k + 1]) - to_double(rest[k]);
        arc[k + 1] = arc[k] + vsqrt(dot(d, d));
    }
}

struct BlockView { // one block of a Strands
    int cvs;
    const Wide3f *rest, *rest_normal;
    Wide3f *pose, *pose_normal;
    const VFloat* envelope;
    const VDouble* arc;
    const Wide3f* noise; // nullptr: no noise
    const Wide3d* wind;  // unit direction: of the strand, or [cvs]
    int wind_stride;     // 0 or 1
    VDouble* factors;    // [cvs - 1]
};

// The fraction of its angle that the strand turns by at each segment's start. With reference_segments, the
// turn stands for the strand from the middle of the segment before to the middle of this one (derived above).
// Nothing here depends on the previous segment, so the CPU can overlap the iterations; inside the loop of
// bend_block it could not.
MARRAM_HOT void turn_factors(const Wind& wind, const BlockView& block) {
    const int last = block.cvs - 1;
    const VDouble length = block.arc[last];
    const VDouble per_length = select(length > 0.0, 1.0 / select(length > 0.0, length, 1.0), 0.0);
    const bool centred = wind.reference_segments > 0;
    const double reference = centred ? wind.reference_segments : last;
    for (int k = 0; k < last; ++k) {
        VDouble f = evaluate(wind.ramp_rotate, block.arc[k] * per_length) * to_double(block.envelope[k]);
        f = vmin(vmax(f * wind.global_rotate, VDouble{}), 1.0);
        const VDouble own = block.arc[k + 1] - block.arc[k];
        const VDouble span = !centred ? own
                             : k == 0 ? own * 0.5
                                      : (block.arc[k + 1] - block.arc[k - 1]) * 0.5;
        block.factors[k] = compounded(f, span * per_length * reference);
    }
}

MARRAM_HOT void bend_block(const Wind& wind, const BlockView& block) {
    const int last = block.cvs - 1;
    const Wide3d tip = to_double(block.rest[last]);
    Turn turn{VDouble{}, VDouble{}, VDouble{}, splat(1.0)};
    VLong turned{};
    Wide3d position = to_double(block.rest[0]);
    block.pose[0] = block.rest[0];
    for (int k = 0; k < last; ++k) {
        const Wide3d start = to_double(block.rest[k]);
        const Wide3d end = to_double(block.rest[k + 1]);
        const Wide3d a = rotate(turn, tip - start);
        const Wide3d noise = block.noise ? to_double(block.noise[k]) * splat(wind.noise_amplitude) : Wide3d{};
        VLong turns;
        const auto segment = [&]() MARRAM_ALWAYS_INLINE { return rotate(turn, end - start); };
        const Turn q = scaled_turn(a, block.wind[k * block.wind_stride] + noise, block.factors[k], segment,
                                   noise, turns);
        turn = renormalised(q * turn);
        turned |= turns;
        // CVs before the first rotation are copied from the rest strand, bit for bit.
        position = select(turned, position + rotate(turn, end - start), end);
        block.pose[k + 1] = to_float(position);
        if (block.rest_normal) block.pose_normal[k] = to_float(rotate(turn, to_double(block.rest_normal[k])));
    }
    if (block.rest_normal)
        block.pose_normal[last] = to_float(rotate(turn, to_double(block.rest_normal[last])));
}

} // namespace

void bend(const Wind& wind, double frame, double fps, Strands& strands) {
    const int cvs = strands.cvs;
    WideVector<VDouble> arc(static_cast<size_t>(cvs)), factors(static_cast<size_t>(cvs));
    const bool noisy = wind.noise_amplitude > 0.0;
    const NoiseTimes times = noise_times(wind, frame, fps);
    const Wide3d mean = splat3(wind.direction.data());
    for (int i = 0; i < strands.blocks; ++i) {
        const size_t first = size_t(i) * size_t(cvs);
        arc_lengths(strands.rest.data() + first, cvs, arc.data());
        if (noisy) noise_along(wind, times, strands.noise_origin[size_t(i)], arc.data(), cvs - 1, strands);
        const BlockView block{cvs,
                              strands.rest.data() + first,
                              strands.oriented ? strands.rest_normal.data() + first : nullptr,
                              strands.pose.data() + first,
                              strands.oriented ? strands.pose_normal.data() + first : nullptr,
                              strands.envelope.data() + first,
                              arc.data(),
                              noisy ? strands.values.data() : nullptr,
                              strands.wind_direction.empty() ? &mean
                                                             : &strands.wind_direction[strands.wind_at(i, 0)],
                              strands.wind_at_cvs ? 1 : 0,
                              factors.data()};
        turn_factors(wind, block);
        bend_block(wind, block);
    }
}

} // namespace marram
