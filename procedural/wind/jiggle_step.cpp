// SPDX-License-Identifier: Apache-2.0
// A CV follows its target g(s) as a damped oscillator, in x, y and z alike,
//
//     x'' + 2 zeta omega x' + omega^2 x = omega^2 g(s),       omega = 2 pi frequency stiffness(k / (n - 1))
//
// In the angle tau = omega s, let w = dx/dtau and e = x - g, the lag:
//
//     de/dtau = w - dg/dtau          dw/dtau = -e - 2 zeta w
//
// Both e and w are continuous, so they are the whole state. A static target leaves e = w = 0 exactly 0. Let
// S be the homogeneous solution with S(0) = 0, S'(0) = 1, and C = S' + 2 zeta S (C(0) = 1, C' = -S). Over a
// step of tau radians, with t from 0 to 1 and g'(t) = dg/dt,
//
//     e1 = C e0 + S w0 - int C(tau (1 - t)) g'(t) dt         w1 = -S e0 + S' w0 + int S(tau (1 - t)) g'(t) dt
//
// For g a cubic, g' = a1 + 2 a2 t + 3 a3 t^2, so three moments of C and three of S are needed:
//
//     F_j = int C(tau (1 - t)) t^j dt          G_j = int S(tau (1 - t)) t^j dt
//
// Their closed forms cancel for small tau, and divide by it up to three times. Instead they are summed as power
// series where (fastest pole) tau <= 1, with S = sum s_n tau^n / n!, s_n+2 = -2 zeta s_n+1 - s_n,
//
//     F_j = sum c_n tau^n j! / (n + j + 1)!,  c_n+1 = -s_n          (term n is below 1 / n!)
//
// and a longer step is put together from two halves, as often as needed: the first half's response decays over
// the second, where t = (1 + t') / 2,
//
//     (-F_j, G_j)(2 tau) = 2^-(j+1) (M(tau) (-F_j, G_j)(tau) + sum over i of binom(j, i) (-F_i, G_i)(tau)),   M(2 tau) = M(tau)^2
//
// with M = (C, S; -S, S'). M shrinks every state, so that rounding does not grow. This holds for any
// damping, and gives the steps of 2, 4, ... samples on the way.
//
// The cubic. With the changes D0, D1, D2 of four samples, Catmull and Rom's cubic between the middle two is
//
//     a1 = (D0 + D1) / 2       a2 = -D0 + 3/2 D1 - 1/2 D2       a3 = 1/2 D0 - D1 + 1/2 D2
//
// Over the first `share` q of it, t = q t': a1 q, a2 q^2, a3 q^3. Collecting a1 F0 + 2 a2 F1 + 3 a3 F2 by
// D0, D1 and D2 gives f; for D0 = D1 = D2 it is F_0 q D1, the response to steady motion.
#include "procedural/wind/jiggle_step.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

template <typename Real>
struct Moments {
    Real c, s, d;
    std::array<Real, 3> f, g;
};

double vmin(double a, double b) { return std::min(a, b); }
double greatest(double x) { return x; }
double greatest(const VDouble& x) {
    double most = x[0];
    for (int i = 1; i < lanes; ++i) most = std::max(most, x[i]);
    return most;
}

template <typename Real>
MARRAM_INLINE Moments<Real> series(double damping, const Real& tau) {
    constexpr int terms = 20; // 1 / 20! = 4e-19
    Moments<Real> m{};
    double c = 1.0, s = 0.0, next_s = 1.0; // c_n, s_n, s_n+1
    Real term = tau * 0.0 + 1.0;           // tau^n / n!
    for (int n = 0; n < terms; ++n) {
        const double weights[3] = {1.0 / (n + 1), 1.0 / ((n + 1) * (n + 2)),
                                   2.0 / ((n + 1) * (n + 2) * (n + 3))}; // n! j! / (n + j + 1)!
        m.c = m.c + term * c;
        m.s = m.s + term * s;
        m.d = m.d + term * next_s;
        for (size_t j = 0; j < 3; ++j) {
            m.f[j] = m.f[j] + term * (c * weights[j]);
            m.g[j] = m.g[j] + term * (s * weights[j]);
        }
        const double after = -2.0 * damping * next_s - s;
        c = -s;
        s = next_s;
        next_s = after;
        term = term * tau * (1.0 / (n + 1));
    }
    return m;
}

template <typename Real>
MARRAM_INLINE Moments<Real> doubled(const Moments<Real>& m) {
    const auto join = [&](double scale, const Real& f, const Real& g, const Real& sum_f, const Real& sum_g,
                          Real& out_f, Real& out_g) MARRAM_ALWAYS_INLINE {
        out_f = (m.c * f - m.s * g + sum_f) * scale;
        out_g = (m.s * f + m.d * g + sum_g) * scale;
    };
    Moments<Real> twice;
    twice.c = m.c * m.c - m.s * m.s;
    twice.s = m.c * m.s + m.s * m.d;
    twice.d = m.d * m.d - m.s * m.s;
    join(0.5, m.f[0], m.g[0], m.f[0], m.g[0], twice.f[0], twice.g[0]);
    join(0.25, m.f[1], m.g[1], m.f[0] + m.f[1], m.g[0] + m.g[1], twice.f[1], twice.g[1]);
    join(0.125, m.f[2], m.g[2], m.f[0] + m.f[1] * 2.0 + m.f[2], m.g[0] + m.g[1] * 2.0 + m.g[2], twice.f[2],
         twice.g[2]);
    return twice;
}

template <typename Real>
MARRAM_INLINE Moments<Real> moments(double damping, const Real& radians) {
    const double fastest = damping > 1.0 ? 2.0 * damping : 1.0; // pole, b < 2 zeta
    // Beyond, a step is many decays or more turns than a float can tell apart; each doubling doubles a
    // rounded turn.
    constexpr double longest = 0x1p30;
    const Real limited = vmin(radians, longest / fastest);
    const double most = greatest(limited) * fastest;
    const int doublings = most > 1.0 ? std::ilogb(most) + 1 : 0;
    Moments<Real> m = series(damping, limited * std::ldexp(1.0, -doublings));
    for (int i = 0; i < doublings; ++i) m = doubled(m);
    return m;
}

template <typename Real>
MARRAM_INLINE void weights_of_changes(const std::array<Real, 3>& moment, double share,
                                      std::array<Real, 3>& out) {
    const Real steady = moment[0] * (0.5 * share), second = moment[1] * (share * share),
               third = moment[2] * (1.5 * share * share * share);
    out[0] = steady - second * 2.0 + third;
    out[1] = steady + second * 3.0 - third * 2.0;
    out[2] = third - second;
}

template <typename Real>
MARRAM_INLINE JiggleStep<Real> step_of(const Moments<Real>& m, double share) {
    JiggleStep<Real> step{m.c, m.s, m.d, {}, {}};
    weights_of_changes(m.f, share, step.f);
    weights_of_changes(m.g, share, step.g);
    return step;
}

template <typename Real>
MARRAM_INLINE void steps_of(double damping, const Real& radians, std::span<JiggleStep<Real>> out) {
    if (out.empty()) return;
    Moments<Real> m = moments(damping, radians);
    for (size_t level = 0; level < out.size(); ++level) {
        if (level > 0) m = doubled(m);
        out[level] = step_of(m, 1.0);
    }
}

} // namespace

JiggleStep<double> jiggle_step(double damping, double radians, double share) {
    return step_of(moments(damping, radians), share);
}

void jiggle_steps(double damping, double radians, std::span<JiggleStep<double>> out) {
    steps_of(damping, radians, out);
}

MARRAM_HOT void jiggle_steps(double damping, const VDouble& radians, std::span<JiggleStep<VDouble>> out) {
    steps_of(damping, radians, out);
}

MARRAM_HOT JiggleStep<VDouble> jiggle_step(double damping, const VDouble& radians, double share) {
    return step_of(moments(damping, radians), share);
}

double jiggle_tail(double damping, double radians) {
    if (damping >= 1.0) return jiggle_step(damping, radians).c;
    const double p = std::sqrt((1.0 - damping) * (1.0 + damping)), x = damping * radians;
    return std::exp(-x) * std::min(1.0 / p, (1.0 + x) / damping) / damping;
}

} // namespace marram
