// SPDX-License-Identifier: Apache-2.0
// Newton's method for the chain of elastica.cpp.
//
// The unknowns are the turns of the pieces: of piece i's tangent, towards its e1 and e2, x_i = (x, y), and
// about it, its twist w_i. Let N and A be the derivatives of M_i and F_i by (x_i, w_i): the response of all
// that lies beyond. From the tip to the root,
//   a piece adds its loads:    A += l dq/dx,   N += l (e_j x (F + l q / 2) + t x (A + l/2 dq/dx)),
//   dq/dx = -k [|u_n| u_t 1 + u_t u_n u_n^T / |u_n| + |u_n| t u_n^T]   with u_t = u . t, k the drag,
//   a hinge is solved for x_i as a linear function of x_(i-1), w_(i-1): a pivot of 2x2,
//   and its twist w_i = w_(i-1) + tan(bend / 2) (x_i + x_(i-1)), by holonomy, since it does not twist.
// M and F stay fixed in space where a hinge turns, so that x_i = x_(i-1) if M_i does not change: no
// transport. Then a sweep from the root to the tip adds up the turns. All derivatives are exact for straight
// blades; for curved ones, to second order in the kinks. Convergence is quadratic.
//
// From the rest pose Newton's method must find the pose that the blade would bend to:
// - steps are limited, and large loads grow from Ca about 30, by 4 a step;
// - pieces that are pushed towards the root are damped, by as much as they are pushed times the square of the
//   last step, and weak pivots are raised: both make the matrix positive definite and lead downhill;
// - lanes that fail start again with smaller steps;
// - a pose with a negative pivot is left once by a kick along the last step.
// The coarse chain gives the pose within 0.02 L; each finer one starts from the last and needs a step or two.
#include "procedural/wind/blade/elastica_chain.h"

namespace marram {
namespace {

// Chosen by the number of steps and of unconverged blades among 10^4 random ones, Ca from 0.1 to 10^5.
constexpr float elastica_max_turn = 0.7f;      // of any piece in a step, radians,
constexpr float elastica_careful_turn = 0.25f; // of any piece in a second attempt
constexpr float elastica_max_fine_turn = 0.3f; // and on the fine chain, where all is nearly in place
constexpr float elastica_max_bend = 4.0f;      // tan(angle / 2) of a hinge: 152 degrees
constexpr float elastica_max_twist = 0.5f;     // tan(angle / 2) of a hinge: beyond any solved pose
// A hinge's stiffness with all beyond it, relative to its own. Below the first it is raised to the second.
constexpr float elastica_weak_pivot = 0.2f, elastica_min_pivot = 0.7f;
constexpr float elastica_kick = 0.2f;        // turn of the step away from an unstable pose, radians
constexpr float elastica_noise = 1e-6f;      // a smaller turn is rounding: an exact equilibrium is kept
constexpr float elastica_light = 5.0f;       // loads below cannot buckle a blade (7.8 does): no damping
constexpr float elastica_first_load = 30.0f; // larger loads are raised to their full value from here,
constexpr float elastica_load_step = 4.0f;   // by this factor a step,
constexpr float elastica_calm = 0.5f;        // after a step that turns no piece by more
constexpr float elastica_coarse_stop = 0.1f; // the coarse chain is done if a step turns no piece by more
constexpr int elastica_max_steps = 32;
constexpr float elastica_huge = 1e30f;

// From components in the frame of a piece to those in the frame of the piece before.
MARRAM_INLINE void elastica_carry(const ElasticaJoint& j, bool at_cv, Wide3f& v) {
    if (at_cv) v = {j.spin_cos * v.x - j.spin_sin * v.y, j.spin_sin * v.x + j.spin_cos * v.y, v.z};
    const VFloat d = (j.qz * v.z - (j.qx * v.x + j.qy * v.y)) * j.scale;
    v = {v.x + d * j.qx, v.y + d * j.qy, d * j.qz - v.z};
}

MARRAM_INLINE void elastica_hinges(const ElasticaChain& c) {
    VFloat before{}; // halves of the pieces on both sides
    for (int k = 0; k < c.last; ++k) {
        const ElasticaSegment& s = c.segments[k];
        const VFloat behind = 0.5f * c.per_piece * s.length;
        const VFloat step = (c.segments[k + 1].rigidity - s.rigidity) * c.per_piece;
        for (int i = 0; i < c.pieces; ++i) {
            ElasticaJoint& j = c.joints[k * c.pieces + i];
            j.compliance = (before + behind) / (s.rigidity + step * float(i));
            j.skew = 0.5f * (behind - before);
            j.spread = (before * before - before * behind + behind * behind) * (1.0f / 6.0f);
            before = behind;
        }
    }
}

MARRAM_INLINE void elastica_frames(const ElasticaChain& c) {
    const ElasticaSegment& first = c.segments[0];
    ElasticaFrame f{first.e1, first.e2, first.t};
    for (int k = 0; k < c.last; ++k)
        for (int i = 0; i < c.pieces; ++i) {
            ElasticaJoint& j = c.joints[k * c.pieces + i];
            const VFloat x = j.bend_x, y = j.bend_y;
            j.flat = 1.0f / (1.0f + x * x + y * y);
            j.qx = x;
            j.qy = y;
            j.qz = splat_float(1.0f);
            j.scale = j.flat + j.flat;
            j.twist_x = y;
            j.twist_y = -x;
            if (i == 0) {
                const ElasticaSegment& s = c.segments[k];
                const VFloat square = s.kink_x * s.kink_x + s.kink_y * s.kink_y;
                const VFloat both = 2.0f * (s.kink_x * x + s.kink_y * y);
                const VFloat qx = s.kink_x * (2.0f - both) + x * (1.0f + square);
                const VFloat qy = s.kink_y * (2.0f - both) + y * (1.0f + square);
                const VFloat scalar = 1.0f - square - both, spin = (1.0f + square) * j.twist;
                // (-qy, qx, spin, scalar) as a turn without twist after one about the tangent.
                const VFloat norm2 = scalar * scalar + spin * spin;
                const VFloat per_norm = elastica_ratio(splat_float(1.0f), vsqrt(norm2));
                const VInt turns = norm2 > VFloat{};
                j.spin_cos =
                    turns ? (scalar * scalar - spin * spin) * per_norm * per_norm : splat_float(1.0f);
                j.spin_sin = 2.0f * scalar * spin * per_norm * per_norm;
                const VFloat c = turns ? scalar * per_norm : splat_float(1.0f), e = spin * per_norm;
                j.qx = c * qx - e * qy;
                j.qy = c * qy + e * qx;
                j.qz = norm2 * per_norm;
                const VFloat q2 = j.qx * j.qx + j.qy * j.qy, z2 = j.qz * j.qz;
                j.scale = 2.0f / (q2 + z2);
                const VFloat per = j.qz / (z2 + 1e-4f * q2); // 1 / qz, bounded at a reversal
                j.twist_x = j.qy * per;
                j.twist_y = -j.qx * per;
            }
            elastica_turn(f, j.qx, j.qy, j.qz, j.scale);
            if (i == 0) {
                const Wide3f e1 = f.e1;
                f.e1 = e1 * j.spin_cos + f.e2 * j.spin_sin;
                f.e2 = f.e2 * j.spin_cos - e1 * j.spin_sin;
            }
            j.e1 = f.e1;
            j.e2 = f.e2;
            j.t = f.t;
        }
}

// The state of the sweep from the tip to the root, in the frame of the present piece.
struct ElasticaSweep {
    VFloat load, damping;
    VFloat headwind{};                      // drag beyond that pushes towards the root
    Wide3f force{}, moment{};               // of all loads beyond the node
    Wide3f force_x{}, force_y{}, force_t{}; // their derivatives: by the turn of the piece towards e1 and e2,
    Wide3f moment_x{}, moment_y{}, moment_t{}; // and by its twist
    VInt unstable{};                           // a pivot is not positive definite
    Wide3f force_0{}, moment_0{};              // their changes while it does not turn
};

// Adds the loads of a piece. Returns its load per length.
MARRAM_INLINE Wide3f elastica_add_piece(ElasticaSweep& w, const ElasticaSegment& s, const ElasticaJoint& j,
                                        float per_piece) {
    const VFloat zero{};
    const VFloat h = s.length * per_piece, half = 0.5f * h, drag = w.load * s.drag,
                 weight = w.load * s.weight;
    const VFloat ux = dot(j.e1, s.wind), uy = dot(j.e2, s.wind), uz = dot(j.t, s.wind);
    const VFloat speed = vsqrt(ux * ux + uy * uy), k = drag * speed, k_per_u2 = elastica_ratio(drag, speed);
    const Wide3f q{k * ux - weight * j.e1.y, k * uy - weight * j.e2.y, -weight * j.t.y};
    const VFloat xx = -h * uz * (k + k_per_u2 * ux * ux), xy = -h * uz * k_per_u2 * ux * uy,
                 yy = -h * uz * (k + k_per_u2 * uy * uy);
    const VFloat fx = w.force.x + half * q.x, fy = w.force.y + half * q.y;
    VFloat tension = w.force.z + half * q.z;
    w.headwind += h * k * vmax(-uz, zero);
    tension += w.damping * (vmax(-tension, zero) + 2.0f * w.headwind);
    w.moment.x -= h * fy;
    w.moment.y += h * fx;
    w.moment_x.x -= h * (w.force_x.y + 0.5f * xy);
    w.moment_x.y += h * (w.force_x.x + 0.5f * xx - tension);
    w.moment_x.z += h * fy;
    w.moment_y.x -= h * (w.force_y.y + 0.5f * yy - tension);
    w.moment_y.y += h * (w.force_y.x + 0.5f * xy);
    w.moment_y.z -= h * fx;
    w.moment_t.x -= h * w.force_t.y;
    w.moment_t.y += h * w.force_t.x;
    w.moment_0.x -= h * w.force_0.y;
    w.moment_0.y += h * w.force_0.x;
    w.force = w.force + q * h;
    w.force_x = w.force_x + Wide3f{xx, xy, -h * k * ux};
    w.force_y = w.force_y + Wide3f{xy, yy, -h * k * uy};
    return q;
}

// M x t on both sides of a hinge, and its derivatives.
struct ElasticaHinge {
    VFloat x{}, y{}, z{}; // z: the moment about the tangent
    VFloat xx{}, xy{}, yx{}, yy{}, xt{}, yt{}, x0{}, y0{};
};

MARRAM_INLINE void elastica_add_side(const ElasticaSweep& w, ElasticaHinge& m) {
    m.x += w.moment.y;
    m.y -= w.moment.x;
    m.z += w.moment.z;
    m.xx += w.moment_x.y;
    m.yx -= w.moment_x.x;
    m.xy += w.moment_y.y;
    m.yy -= w.moment_y.x;
    m.xt += w.moment_t.y;
    m.yt -= w.moment_t.x;
    m.x0 += w.moment_0.y;
    m.y0 -= w.moment_0.x;
}

// Moments at a distance `skew` behind the node.
MARRAM_INLINE void elastica_move(const ElasticaSweep& w, VFloat skew, ElasticaHinge& m) {
    m.x -= skew * w.force.x;
    m.y -= skew * w.force.y;
    m.xx -= skew * (w.force_x.x - w.force.z);
    m.yx -= skew * w.force_x.y;
    m.xy -= skew * w.force_y.x;
    m.yy -= skew * (w.force_y.y - w.force.z);
    m.xt -= skew * w.force_t.x;
    m.yt -= skew * w.force_t.y;
    m.x0 -= skew * w.force_0.x;
    m.y0 -= skew * w.force_0.y;
}

// Solves a hinge's equation for the turn (x, y) of the piece behind it.
MARRAM_INLINE void elastica_eliminate(ElasticaHinge m, ElasticaJoint& j, VInt& unstable) {
    const VFloat zero{}, mu = 0.5f * j.compliance, bx = j.bend_x, by = j.bend_y, fx = j.flat * bx,
                         fy = j.flat * by;
    // A turn in the plane of the bend changes tan(angle / 2) by half of 1 + bend^2 as much, one across it by
    // half.
    const auto flatten = [&](VFloat& x, VFloat& y) MARRAM_ALWAYS_INLINE {
        const VFloat along = bx * x + by * y;
        x -= fx * along;
        y -= fy * along;
    };
    VFloat x = mu * (m.x + m.x0) - 2.0f * bx, y = mu * (m.y + m.y0) - 2.0f * by;
    flatten(x, y);
    flatten(m.xx, m.yx);
    flatten(m.xy, m.yy);
    flatten(m.xt, m.yt);
    const VFloat twist = 0.5f * mu * m.z;
    VFloat xx = 1.0f - mu * m.xx, yy = 1.0f - mu * m.yy;
    const VFloat xy = twist - mu * m.xy, yx = -twist - mu * m.yx;
    const VFloat off = 0.5f * elastica_abs(xy + yx), lowest = vmin(xx, yy) - off;
    unstable |= (xx <= zero) | (xx * yy <= off * off);
    const VFloat shift = lowest < elastica_weak_pivot ? elastica_min_pivot - lowest : zero;
    xx += shift;
    yy += shift;
    const VFloat det = 1.0f / (xx * yy - xy * yx);
    const VFloat ixx = yy * det, ixy = -xy * det, iyx = -yx * det, iyy = xx * det;
    j.x0 = ixx * x + ixy * y;
    j.y0 = iyx * x + iyy * y;
    const VFloat xt = mu * m.xt, yt = mu * m.yt;
    j.xt = ixx * xt + ixy * yt;
    j.yt = iyx * xt + iyy * yt;
    j.xx = ixx + ixy * twist;
    j.xy = ixy - ixx * twist;
    j.yx = iyx + iyy * twist;
    j.yy = iyy - iyx * twist;
}

// From functions of a piece's turn to functions of the turn of the piece before.
MARRAM_INLINE void elastica_substitute(const ElasticaJoint& j, Wide3f& by_x, Wide3f& by_y, Wide3f& by_t,
                                       Wide3f& by_0) {
    const Wide3f x = by_x, y = by_y;
    by_0 = by_0 + x * j.x0 + y * j.y0;
    by_t = by_t + x * j.xt + y * j.yt;
    by_x = x * j.xx + y * j.yx + by_t * j.twist_x;
    by_y = x * j.xy + y * j.yy + by_t * j.twist_y;
}

// The hinge at a CV turns half-way through the kink, T = tan(kink / 4); the strand bends before and behind
// it.
// With half the hinge on each side, t the tangent half-way, n the axis of the kink and M the moment, they
// turn by
//     compliance (M_n n + cos^2(kink / 2) M_c (t x n) + sin^2(kink / 2) M_t t).
// M x t, the mean of both sides, has cos(kink / 2) M_c across the kink's plane: another cosine, which is
// 1 - 2 T^2 / (1 + T^2), is missing. The twist about t is that of the last step's pose.
MARRAM_INLINE void elastica_add_kink(const ElasticaSegment& s, VFloat load, ElasticaJoint& j,
                                     ElasticaHinge& m) {
    constexpr float steepest = 0.25f; // cosine; beyond, twists are bounded
    const VFloat tx = s.kink_x, ty = s.kink_y, square = tx * tx + ty * ty, scale = 2.0f / (1.0f + square);
    const VFloat cosine = (1.0f - square) * (0.5f * scale), sine2 = square * scale * scale;
    // m.z = 2 cos(kink / 2) M_t
    const VFloat twist =
        0.25f * j.compliance * (m.z - load * j.rest_z) * sine2 / vmax(cosine, splat_float(steepest));
    j.next_twist = vmin(vmax(twist, splat_float(-elastica_max_twist)), splat_float(elastica_max_twist));
    const auto shorten = [&](VFloat& x, VFloat& y) MARRAM_ALWAYS_INLINE {
        const VFloat across = scale * (tx * y - ty * x);
        x += across * ty;
        y -= across * tx;
    };
    shorten(m.x, m.y);
    shorten(m.xx, m.yx);
    shorten(m.xy, m.yy);
    shorten(m.xt, m.yt);
    shorten(m.x0, m.y0);
}

MARRAM_INLINE void elastica_cross(ElasticaSweep& w, const ElasticaSegment& s, const Wide3f& q, bool at_cv,
                                  ElasticaJoint& j) {
    // A piece's twist follows from the turns on both sides of its hinge. Here, that of its own side.
    w.force_x = w.force_x + w.force_t * j.twist_x;
    w.force_y = w.force_y + w.force_t * j.twist_y;
    w.moment_x = w.moment_x + w.moment_t * j.twist_x;
    w.moment_y = w.moment_y + w.moment_t * j.twist_y;
    ElasticaHinge m;
    elastica_add_side(w, m);
    if (at_cv) elastica_move(w, 2.0f * j.skew, m); // else 0
    elastica_carry(j, at_cv, w.force);
    elastica_carry(j, at_cv, w.moment);
    elastica_carry(j, at_cv, w.force_x);
    elastica_carry(j, at_cv, w.force_y);
    elastica_carry(j, at_cv, w.force_t);
    elastica_carry(j, at_cv, w.force_0);
    elastica_carry(j, at_cv, w.moment_x);
    elastica_carry(j, at_cv, w.moment_y);
    elastica_carry(j, at_cv, w.moment_t);
    elastica_carry(j, at_cv, w.moment_0);
    elastica_add_side(w, m);
    m.x += 2.0f * j.spread * q.x;
    m.y += 2.0f * j.spread * q.y;
    m.x -= w.load * j.rest_x;
    m.y -= w.load * j.rest_y;
    if (at_cv) elastica_add_kink(s, w.load, j, m);
    elastica_eliminate(m, j, w.unstable);
    elastica_substitute(j, w.force_x, w.force_y, w.force_t, w.force_0);
    elastica_substitute(j, w.moment_x, w.moment_y, w.moment_t, w.moment_0);
}

MARRAM_INLINE VInt elastica_backward(const ElasticaChain& c, VFloat load, VFloat damping) {
    ElasticaSweep w{load, damping};
    for (int k = c.last - 1; k >= 0; --k) {
        const ElasticaSegment& s = c.segments[k];
        for (int i = c.pieces - 1; i >= 0; --i) {
            ElasticaJoint& j = c.joints[k * c.pieces + i];
            const Wide3f q = elastica_add_piece(w, s, j, c.per_piece);
            elastica_cross(w, s, q, i == 0, j);
        }
        // A twist turns the rest kink. Its sine is 4 tan(angle / 4) to third order.
        const VFloat x = -4.0f * s.kink_y, y = 4.0f * s.kink_x;
        w.force_t = w.force_t + w.force_x * x + w.force_y * y;
        w.moment_t = w.moment_t + w.moment_x * x + w.moment_y * y;
    }
    return w.unstable;
}

// Changes of the bends, into x0 and y0. Returns the square of the largest turn of a piece.
MARRAM_INLINE VFloat elastica_forward(const ElasticaChain& c) {
    VFloat x{}, y{}, twist{}, largest{};
    for (int k = 0; k < c.last; ++k) {
        const ElasticaSegment& s = c.segments[k];
        x -= 4.0f * twist * s.kink_y;
        y += 4.0f * twist * s.kink_x;
        for (int i = 0; i < c.pieces; ++i) {
            ElasticaJoint& j = c.joints[k * c.pieces + i];
            const VFloat half_way = twist + j.twist_x * x + j.twist_y * y;
            const VFloat nx = j.xx * x + j.xy * y + j.xt * half_way + j.x0;
            const VFloat ny = j.yx * x + j.yy * y + j.yt * half_way + j.y0;
            const VFloat behind = half_way + j.twist_x * nx + j.twist_y * ny;
            const VFloat mean = 0.5f * (twist + behind);
            const VFloat dx = 0.5f * (nx - x), dy = 0.5f * (ny - y);
            const VFloat along = dx * j.bend_x + dy * j.bend_y;
            j.x0 = dx + along * j.bend_x + mean * j.bend_y;
            j.y0 = dy + along * j.bend_y - mean * j.bend_x;
            x = nx;
            y = ny;
            twist = behind;
            largest = vmax(largest, x * x + y * y);
        }
    }
    return largest;
}

MARRAM_INLINE void elastica_update(const ElasticaChain& c, VInt frozen, VInt best, VFloat factor) {
    const VFloat one = splat_float(1.0f);
    for (int i = 0; i < c.last * c.pieces; ++i) {
        ElasticaJoint& j = c.joints[i];
        j.best_x = best ? j.bend_x : j.best_x;
        j.best_y = best ? j.bend_y : j.best_y;
        VFloat x = j.bend_x + factor * j.x0, y = j.bend_y + factor * j.y0;
        const VFloat square = x * x + y * y;
        if (elastica_any(square > elastica_max_bend * elastica_max_bend)) [[unlikely]] {
            const VFloat shorter = vmin(one, elastica_max_bend / vsqrt(vmax(square, one)));
            x *= shorter;
            y *= shorter;
        }
        j.bend_x = frozen ? j.bend_x : x;
        j.bend_y = frozen ? j.bend_y : y;
        j.twist = frozen ? j.twist : j.next_twist;
    }
}

// Back to the pose of the smallest step.
MARRAM_INLINE void elastica_return(const ElasticaChain& c, VInt lanes_back) {
    for (int i = 0; i < c.last * c.pieces; ++i) {
        ElasticaJoint& j = c.joints[i];
        j.bend_x = lanes_back ? j.best_x : j.bend_x;
        j.bend_y = lanes_back ? j.best_y : j.bend_y;
    }
}

// Newton's method from the present bends. `done`: lanes that keep them. Returns that and the lanes that have
// converged: a step at full load turned no piece by more than sqrt(stop2).
MARRAM_INLINE VInt elastica_newton(const ElasticaChain& c, VInt done, VFloat load, VFloat damping,
                                   VFloat stop2, float max_turn) {
    const VFloat one = splat_float(1.0f);
    VInt kicked{};
    VFloat best2 = splat_float(elastica_huge);
    elastica_frames(c);
    for (int step = 0; step < elastica_max_steps && elastica_any(~done); ++step) {
        const VInt unstable = elastica_backward(c, load, damping);
        const VFloat turn2 = elastica_forward(c);
        const VInt finite = turn2 < elastica_huge; // false for NaN
        const VFloat turn = vsqrt(vmax(turn2, splat_float(elastica_noise * elastica_noise)));
        const VInt ends = (turn2 <= stop2) & (load >= one) & (damping < 0.5f);
        const VInt kick = ends & unstable & ~kicked & (turn > elastica_noise);
        kicked |= kick;
        const VFloat reach = kick ? elastica_kick / turn : one;
        const VInt best = (turn2 < best2) & (load >= one);
        best2 = best ? turn2 : best2;
        elastica_update(c, done | ~finite, best, vmin(reach, max_turn / turn));
        elastica_frames(c);
        damping = finite & ~kick ? vmin(one, turn2) : one;
        done |= ends & ~kick;
        load = turn2 < elastica_calm * elastica_calm ? vmin(one, load * elastica_load_step) : load;
    }
    const VInt returns = ~done & (best2 < elastica_huge);
    if (elastica_any(returns)) {
        elastica_return(c, returns);
        elastica_frames(c);
    }
    return done;
}

// What weight does to each hinge of the chain at rest: M x t on both sides, as in elastica_cross(). The
// groomed shape balances it, so it bends no hinge; what acts is the difference to it, carried along with
// the blade.
MARRAM_INLINE void elastica_hang(const ElasticaChain& c, bool hangs) {
    const VFloat zero{};
    for (int i = 0; i < c.last * c.pieces; ++i) {
        ElasticaJoint& j = c.joints[i];
        j.bend_x = j.bend_y = j.twist = j.next_twist = j.rest_x = j.rest_y = j.rest_z = zero;
    }
    if (!hangs) return;
    elastica_frames(c);
    Wide3f force{}, moment{};
    for (int k = c.last - 1; k >= 0; --k) {
        const ElasticaSegment& s = c.segments[k];
        const VFloat h = s.length * c.per_piece;
        for (int i = c.pieces - 1; i >= 0; --i) {
            ElasticaJoint& j = c.joints[k * c.pieces + i];
            const Wide3f q{-s.weight * j.e1.y, -s.weight * j.e2.y, -s.weight * j.t.y};
            moment.x -= h * (force.y + 0.5f * h * q.y);
            moment.y += h * (force.x + 0.5f * h * q.x);
            force = force + q * h;
            VFloat x = moment.y, y = -moment.x;
            if (i == 0) {
                x -= 2.0f * j.skew * force.x;
                y -= 2.0f * j.skew * force.y;
            }
            const VFloat behind = moment.z;
            elastica_carry(j, i == 0, force);
            elastica_carry(j, i == 0, moment);
            j.rest_z = behind + moment.z;
            j.rest_x = x + moment.y + 2.0f * j.spread * q.x;
            j.rest_y = y - moment.x + 2.0f * j.spread * q.y;
        }
    }
}

// First bends of a chain: moments are interpolated between the hinges of a coarser one, to 0 at the tip.
MARRAM_INLINE void elastica_refine(const ElasticaChain& coarse, const ElasticaChain& fine) {
    const int parts = fine.pieces / coarse.pieces, hinges = coarse.last * coarse.pieces;
    const float per_part = 1.0f / float(parts);
    const ElasticaJoint* from = coarse.joints;
    VFloat x = elastica_ratio(from[0].bend_x, from[0].compliance);
    VFloat y = elastica_ratio(from[0].bend_y, from[0].compliance);
    for (int k = 0; k < hinges; ++k) {
        VFloat nx{}, ny{};
        if (k + 1 < hinges) {
            nx = elastica_ratio(from[k + 1].bend_x, from[k + 1].compliance);
            ny = elastica_ratio(from[k + 1].bend_y, from[k + 1].compliance);
        }
        if (k == 0) { // the hinge at the root has the mean moment of the first half, that of its middle
            x += (x - nx) * (1.0f / 3.0f);
            y += (y - ny) * (1.0f / 3.0f);
        }
        for (int i = 0; i < parts; ++i) {
            ElasticaJoint& j = fine.joints[k * parts + i];
            const float u = (k == 0 && i == 0 ? 0.25f : float(i)) * per_part;
            j.bend_x = (x + (nx - x) * u) * j.compliance;
            j.bend_y = (y + (ny - y) * u) * j.compliance;
        }
        if (k % coarse.pieces == 0) {
            ElasticaJoint& at_cv = fine.joints[k * parts];
            at_cv.twist = elastica_ratio(from[k].twist, from[k].compliance) * at_cv.compliance;
        }
        x = nx;
        y = ny;
    }
}

MARRAM_HOT void elastica_solve_chains(std::span<const ElasticaChain> chains, const ElasticaLoads& loads,
                                      const VFloat& stop2, VInt& done, VInt& half_done) {
    const VFloat zero{}, one = splat_float(1.0f);
    const ElasticaChain& coarse = chains[0];
    elastica_hinges(coarse);
    elastica_hang(coarse, loads.hangs);
    const VFloat load = vmin(one, elastica_first_load / vmax(loads.number, one));
    const VFloat damping = loads.number > elastica_light ? one : zero;
    const bool guesses = chains.size() > 2; // its pose is not extrapolated from
    const VFloat stop =
        guesses ? vmax(splat_float(elastica_coarse_stop * elastica_coarse_stop), stop2) : stop2;
    done = loads.idle;
    for (const float max_turn : {elastica_max_turn, elastica_careful_turn}) {
        if (!elastica_any(~done)) break;
        for (int k = 0; k < coarse.last; ++k) {
            ElasticaJoint& j = coarse.joints[k];
            j.bend_x = done & ~loads.idle ? j.bend_x : zero;
            j.bend_y = done & ~loads.idle ? j.bend_y : zero;
        }
        done = elastica_newton(coarse, done, load, damping, stop, max_turn);
    }
    for (size_t i = 1; i < chains.size(); ++i) {
        half_done = done;
        elastica_hinges(chains[i]);
        elastica_hang(chains[i], loads.hangs);
        elastica_refine(chains[i - 1], chains[i]);
        done = elastica_newton(chains[i], loads.idle, one, done ? zero : one, stop2, elastica_max_fine_turn);
    }
}

} // namespace

void elastica_solve(std::span<const ElasticaChain> chains, const ElasticaLoads& loads, const VFloat& stop2,
                    VInt& done, VInt& half_done) {
    elastica_solve_chains(chains, loads, stop2, done, half_done);
}

} // namespace marram
