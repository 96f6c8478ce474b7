// SPDX-License-Identifier: Apache-2.0
// The static pose of a blade: an inextensible rod that bends equally in all directions
// and does not twist (Kirchhoff's rod; Antman, "Nonlinear Problems of Elasticity", ch. 8).
// With t the tangent, s the arc length, F and M the force and moment of all loads beyond s, EI the rigidity,
// u the wind and u_n its part normal to t,
//
//     F' = -q,   M' = -t x F,   F(L) = M(L) = 0,        q = 1/2 rho C_d w |u_n| u_n - weight y,
//     curvature - curvature at rest = (M normal to t) / EI,    the rest's carried in the frame without twist.
//
// Its numbers are Ca = drag U^2 L^3 / EI and B = weight L^3 / EI (Luhar and Nepf, "Flow-induced
// reconfiguration of buoyant and flexible aquatic vegetation", Limnology and Oceanography 2011). A straight
// upright blade topples at B = 7.84. At large Ca it lies in the wind but for a boundary layer of L Ca^(-1/3).
//
// The chain: every segment of the rest is cut into equal straight pieces. Between them are hinges, each for
// the halves of the two pieces it joins, length a before and b behind; at the root, for half a piece. A hinge
// bends by the angle
//
//     2 tan(angle / 2) = (a + b) / EI (mean of M over the hinge, normal to t, mean over both sides)
//     mean of M = M_i - (b - a) / 2 (t x F)_i + (a^2 - a b + b^2) / 6 t x q
//
// (a = l_(i-1)/2, b = l_i/2) and at a CV half before, half after the rest kink. There it also twists a
// little, for the moment about the tangent bends both sides of a kink (elastica_add_kink()). But for that,
// kink and bend together are a rotation without twist: with T = tan(kink / 4), B = tan(bend / 2) as vectors
// in the plane of e1 and e2,
//
//     K^(1/2) B K^(1/2) = (vector 2 T + (1 + T^2) B - 2 (T B) T, scalar 1 - T^2 - 2 T B)
//
// as a quaternion, so that a frame is carried over a joint by a reflection and a division: no trigonometry.
// The error of the chain is of second order in its pieces (segments of one length; where they differ, kinks
// leave one of first order, in the kink squared). With two pieces a segment or more, the segments' directions
// are extrapolated from two chains, one of half the pieces (Richardson): of fourth order. Solved in
// elastica_newton.cpp in floats; only CVs are summed in doubles.
//
// A segment of the pose has the length of the rest and points along the sum of its pieces. A bent segment's
// chord is shorter than its arc; the polyline is not shortened. So its CVs lie up to curvature^2 l^2 / 24 of
// the length beyond the points of the continuous blade: 0.2 % of the length for a bend of 90 degrees over 7
// segments. Errors below are against the polyline that is built likewise from a fine chain.
//
// Errors with 8 CVs at tolerance 1e-3 L: 800 random blades for each row, curved at rest, wind from anywhere,
// |B| up to 3 (tests/run -R Elastica.Errors -V):
//
//     Ca up to   pieces   99 %      worst
//     0.1        1        6e-5      7e-5
//     1          2        1e-5      2e-5
//     10         2        2e-4      6e-4
//     100        2        5e-4      1e-3
//     1000       4        6e-4      2e-3
//     10000      8        6e-4      another pose
//
// Against the oracle, Ca from 0.1 to 10^4, |B| up to 50: 99 % are within 8.3e-3 with 2 pieces, 2.1e-3 with 4,
// 8.3e-5 with 8. Of 1,969 such blades 4 were not solved with 8 pieces or found another pose (MARRAM_WHOLE=1
// tests/run -R Elastica.Agrees -V). In a wind that blows from the tip towards the root equilibria are often
// unstable, and several exist: more of those are not solved.
//
// Cost: grows with Ca and with the pieces; marram_bench prints it beside the talk's bend ("blade").
#include "procedural/wind/blade/elastica.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr float elastica_max_load = 1e6f; // load length^3 / rigidity; beyond, rigidity is raised

// Any two perpendiculars of a unit vector (Duff et al., "Building an Orthonormal Basis", JCGT 2017).
MARRAM_INLINE ElasticaFrame elastica_frame(const Wide3f& t) {
    const VFloat zero{}, one = splat_float(1.0f);
    const VFloat sign = t.z < zero ? -one : one;
    const VFloat a = -1.0f / (sign + t.z), b = t.x * t.y * a;
    return {{1.0f + sign * t.x * t.x * a, sign * b, -sign * t.x}, {b, sign + t.y * t.y * a, -t.y}, t};
}

// The frame of the next segment, whose direction is t, and the kink between them.
MARRAM_INLINE void elastica_kink(ElasticaFrame& f, const Wide3f& t, ElasticaSegment& s) {
    const VFloat zero{}, one = splat_float(1.0f);
    const VFloat x = dot(t, f.e1), y = dot(t, f.e2);
    const VFloat cosine = vsqrt(vmax(0.5f + 0.5f * dot(t, f.t), zero)); // of half the angle
    // Within 0.002 radians of a reversal the direction of the turn is that of e1.
    const VInt back = cosine < 1e-3f;
    const VFloat factor = 0.5f / (vmax(cosine, splat_float(1e-3f)) * (1.0f + cosine));
    s.kink_x = back ? one : x * factor;
    s.kink_y = back ? zero : y * factor;
    const VFloat square = s.kink_x * s.kink_x + s.kink_y * s.kink_y;
    const VFloat qx = s.kink_x + s.kink_x, qy = s.kink_y + s.kink_y, qz = 1.0f - square;
    elastica_turn(f, qx, qy, qz, 2.0f / (qx * qx + qy * qy + qz * qz));
}

MARRAM_HOT void elastica_set_up(const ElasticaBlock& b, ElasticaSegment* segments, ElasticaLoads& loads) {
    const int last = b.cvs - 1;
    const VFloat zero{}, one = splat_float(1.0f);
    VFloat length{}, stiffest{}, strongest{}, blown{}, speed2{};
    Wide3f start{zero, one, zero};
    for (int k = last - 1; k >= 0; --k) {
        const Wide3f d = b.rest[k + 1] - b.rest[k];
        const VFloat l = vsqrt(dot(d, d)), u2 = dot(b.wind[k], b.wind[k]);
        segments[k].length = l;
        length += l;
        start = elastica_select(l > zero, d * elastica_ratio(one, l), start);
        speed2 = vmax(speed2, u2);
        blown = vmax(blown, b.drag[k] * u2);
        strongest = vmax(strongest, b.drag[k] * u2 + elastica_abs(b.weight[k]));
        stiffest = vmax(stiffest, b.rigidity[k]);
    }
    const VFloat volume = length * length * length;
    loads.hangs = b.hangs;
    loads.idle = ~(((b.hangs ? blown : strongest) > zero) & (volume > zero));
    loads.length = length;
    const VFloat softest = strongest * volume * (1.0f / elastica_max_load);
    const VFloat unit = elastica_ratio(one, vmax(stiffest, softest)), load_unit = volume * unit;
    const VFloat per_length = elastica_ratio(one, length), per_speed = elastica_ratio(one, vsqrt(speed2));
    loads.number = strongest * load_unit;
    ElasticaFrame f = elastica_frame(start);
    for (int k = 0; k < last; ++k) {
        ElasticaSegment& s = segments[k];
        const Wide3f d = b.rest[k + 1] - b.rest[k];
        elastica_kink(f, elastica_select(s.length > zero, d * elastica_ratio(one, s.length), f.t), s);
        s.e1 = f.e1;
        s.e2 = f.e2;
        s.t = f.t;
        s.length *= per_length;
        s.rigidity = vmax(b.rigidity[k], softest) * unit;
        s.drag = b.drag[k] * speed2 * load_unit;
        s.weight = b.weight[k] * load_unit;
        s.wind = b.wind[k] * per_speed;
    }
    segments[last].rigidity = vmax(b.rigidity[last], softest) * unit;
}

// Direction of a segment of the chain. `sound`: false if it has none.
MARRAM_INLINE Wide3f elastica_direction(const ElasticaChain& c, int k, VInt& sound) {
    const ElasticaJoint* pieces = c.joints + k * c.pieces;
    Wide3f sum = pieces[0].t;
    for (int i = 1; i < c.pieces; ++i) sum = sum + pieces[i].t;
    const VFloat square = dot(sum, sum);
    sound = square > VFloat{}; // false for NaN
    return elastica_select(sound, sum * (1.0f / vsqrt(square)), c.segments[k].t);
}

// What is added to the direction `fine` of a segment, where a chain of half the pieces has `coarse`: a third
// of the difference d, over 1 + (d / 0.3)^4: where they differ much they are not near the limit, or are two
// poses.
MARRAM_INLINE Wide3f elastica_extrapolation(const Wide3f& fine, const Wide3f& coarse) {
    constexpr float trusted = 0.3f;
    const Wide3f d = fine - coarse;
    const VFloat square = dot(d, d) * (1.0f / (trusted * trusted));
    return d * ((1.0f / 3.0f) / (1.0f + square * square));
}

// `half`: the chain of half the pieces; that of `c` itself if there is none. `half_done`: where it has a pose
// to extrapolate from.
MARRAM_HOT void elastica_emit(const ElasticaBlock& b, const ElasticaChain& c, const ElasticaChain& half,
                              const VInt& idle, const VInt& half_done) {
    Wide3d position = to_double(b.rest[0]);
    b.pose[0] = b.rest[0];
    for (int k = 0; k < c.last; ++k) {
        const ElasticaSegment& s = c.segments[k];
        VInt sound, half_sound;
        Wide3f direction = elastica_direction(c, k, sound);
        if (half.pieces < c.pieces) {
            const Wide3f coarse = elastica_direction(half, k, half_sound);
            direction =
                elastica_select(half_done, direction + elastica_extrapolation(direction, coarse), direction);
            direction = direction * (1.0f / vsqrt(dot(direction, direction))); // at least 0.94
        }
        Wide3d d = to_double(direction);
        d = d * (1.5 - 0.5 * dot(d, d)); // a Newton step: unit to 1e-14
        const Wide3d rest = to_double(b.rest[k + 1]) - to_double(b.rest[k]);
        position = position + d * vsqrt(dot(rest, rest));
        b.pose[k + 1] = elastica_select(idle, b.rest[k + 1], to_float(position));
        if (!b.rest_normal) continue;
        const ElasticaJoint& m = c.joints[k * c.pieces + c.pieces / 2];
        for (int n = k; n == k || n == c.last; n += c.last - k) {
            const Wide3f& r = b.rest_normal[n];
            Wide3f v = m.e1 * dot(s.e1, r) + m.e2 * dot(s.e2, r) + m.t * dot(s.t, r);
            // From the middle piece's direction to the segment's.
            const Wide3f both = m.t + direction;
            const VFloat both2 = dot(both, both);
            v = v - both * elastica_ratio(2.0f * dot(both, v), both2) + direction * (2.0f * dot(m.t, v));
            b.pose_normal[n] = elastica_select(idle | ~sound, r, v);
            if (k + 1 < c.last) break;
        }
    }
}

} // namespace

int elastica_pieces(int cvs, double cauchy, double weight, double tolerance) {
    // 99th percentiles: of one piece a segment, and of the extrapolated pose. What weight adds is greatest
    // near buckling, and beyond it.
    const double l = 1.0 / (cvs - 1.0), l2 = l * l, near_buckling = cauchy + 3.0 * weight;
    const double load = near_buckling + weight * weight;
    int pieces = 1;
    double error = 0.03 * near_buckling * l2;
    while (pieces < 16 && error > tolerance) {
        pieces *= 2;
        const double h2 = l2 / (pieces * pieces);
        error = h2 * h2 * std::max(std::min(load, 0.7 * std::cbrt(load * load)), 0.13 * load);
    }
    return pieces;
}

unsigned elastica(const ElasticaBlock& block, ElasticaScratch& scratch) {
    const int last = block.cvs - 1;
    if (scratch.segments.size() < size_t(last) + 1) scratch.segments.resize(size_t(last) + 1);
    const int sizes[] = {1, block.pieces / 2, block.pieces}; // pieces of a segment in each chain
    const int skipped = block.pieces > 2 ? 0 : block.pieces > 1 ? 1 : 2;
    const size_t joints = size_t(last) * (size_t(block.pieces) * 3 / 2 + 1);
    if (scratch.joints.size() < joints) scratch.joints.resize(joints);
    std::array<ElasticaChain, 3> chains;
    size_t count = 0;
    ElasticaJoint* next = scratch.joints.data();
    for (int i = skipped; i < 3; ++i) {
        chains[count++] = {scratch.segments.data(), next, last, sizes[i], 1.0f / float(sizes[i])};
        next += last * sizes[i];
    }
    ElasticaLoads loads;
    elastica_set_up(block, scratch.segments.data(), loads);
    VInt done = loads.idle;
    VFloat stop2;
    for (int lane = 0; lane < lanes; ++lane)
        stop2[lane] = float(std::clamp(0.3 * block.tolerance / double(loads.length[lane]) *
                                           std::min(1.0, 10.0 / std::sqrt(double(loads.number[lane]))),
                                       1e-6, 1e-2));
    VInt half_done{};
    elastica_solve({chains.data(), count}, loads, stop2, done, half_done);
    elastica_emit(block, chains[count - 1], chains[count > 1 ? count - 2 : 0], loads.idle, half_done);
    unsigned unconverged = 0;
    for (int lane = 0; lane < lanes; ++lane) unconverged |= done[lane] == 0 ? 1U << lane : 0U;
    return unconverged;
}

} // namespace marram
