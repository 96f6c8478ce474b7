// SPDX-License-Identifier: Apache-2.0
// Compares jiggle with three independent references: the matrix exponential of the oscillator in long double,
// closed-form responses, and a Runge-Kutta integration of the whole history. Also checks invariants for any
// target.
#include "procedural/wind/jiggle_filter.h"
#include "procedural/wind/wind.h"

#include "core/math/hash.h"
#include "tests/whole.h"

#include <gtest/gtest.h>

#include <cfloat>
#include <chrono>
#include <complex>
#include <cstdio>
#include <cstring>
#include <functional>

using namespace marram;

namespace {

using Curve = std::vector<Vec3d>;
using Motion = std::function<Curve(double frame)>; // bent pose of one strand; also defines its rest lengths

constexpr double frame_rate = 24.0;
constexpr double zetas[] = {0.05, 0.3, 0.999999, 1.0, 1.0 + 1e-9, 1.5, 50.0};

double draw(uint64_t seed, uint64_t i) { return 2.0 * unit_double(hash(seed, i)) - 1.0; }

Vec3d draw3(uint64_t seed, uint64_t i) {
    return {draw(seed, 3 * i), draw(seed, 3 * i + 1), draw(seed, 3 * i + 2)};
}

void set_curve(WideVector<Wide3f>& cvs, int n, int i, const Curve& curve) {
    for (int k = 0; k < n; ++k) {
        Wide3f& cv = cvs[size_t(i / lanes * n + k)];
        cv.x[i % lanes] = float(curve[size_t(k)].x());
        cv.y[i % lanes] = float(curve[size_t(k)].y());
        cv.z[i % lanes] = float(curve[size_t(k)].z());
    }
}

Curve curve_of(const WideVector<Wide3f>& cvs, int n, int i) {
    Curve curve;
    for (int k = 0; k < n; ++k) {
        const Wide3f& cv = cvs[size_t(i / lanes * n + k)];
        curve.emplace_back(double(cv.x[i % lanes]), double(cv.y[i % lanes]), double(cv.z[i % lanes]));
    }
    return curve;
}

// Strands at one time, bent pose equal to rest pose. Unused lanes of the last block repeat the last strand.
void fill(Strands& strands, const std::vector<Motion>& motions, double frame) {
    const int n = int(motions[0](frame).size());
    strands.resize(int(motions.size()), n, false);
    for (int i = 0; i < strands.blocks * lanes; ++i)
        set_curve(strands.pose, n, i, motions[std::min(size_t(i), motions.size() - 1)](frame));
    strands.rest = strands.pose;
}

Curve rounded(const Curve& curve) {
    Curve r;
    for (const Vec3d& p : curve) r.push_back(p.cast<float>().cast<double>());
    return r;
}

// One strand's or several strands' filter, and the state that it keeps from time to time.
struct Filtered {
    const Jiggle& jiggle;
    const JiggleWindow window;
    const std::vector<Motion>& motions;
    uint32_t phase = 0;
    JiggleFilter filter{};
    JiggleState state{};
    int bends = 0; // past samples asked for so far

    std::vector<Curve> at(double time) {
        Strands strands;
        fill(strands, motions, time);
        if (window.empty() || (window.start && time < jiggle.frame_of(*window.start)))
            return curves(strands.pose, strands);
        filter.begin(jiggle, window, frame_rate, strands.cvs, strands.blocks);
        const auto bent = [&](int64_t past_sample, WideVector<Wide3f>& pose) {
            Strands then;
            fill(then, motions, jiggle.frame_of(past_sample));
            pose = then.pose;
            ++bends;
        };
        WideVector<Wide3f> pose;
        filter.advance(state, phase, time, bent);
        filter.emit(state, time, strands, bent, pose);
        return curves(pose, strands);
    }

  private:
    static std::vector<Curve> curves(const WideVector<Wide3f>& pose, const Strands& strands) {
        std::vector<Curve> list;
        for (int i = 0; i < strands.count; ++i) list.push_back(curve_of(pose, strands.cvs, i));
        return list;
    }
};

// [time][strand]
std::vector<std::vector<Curve>> run(const Jiggle& jiggle, const JiggleWindow& window,
                                    const std::vector<double>& times, const std::vector<Motion>& motions) {
    Filtered filtered{jiggle, window, motions};
    std::vector<std::vector<Curve>> result;
    for (const double time : times) result.push_back(filtered.at(time));
    return result;
}

std::vector<std::vector<Curve>> run(const Jiggle& jiggle, const std::vector<double>& times,
                                    const std::vector<Motion>& motions, double reach = 4.0,
                                    double tolerance = 0.0) {
    return run(jiggle, jiggle_window(jiggle, times, frame_rate, reach, tolerance), times, motions);
}

// One run from rest at `first`, sample by sample.
JiggleWindow whole_from(int64_t first) {
    JiggleWindow window;
    window.length = JiggleWindow::endless;
    window.start = window.first = first;
    window.last = JiggleWindow::endless;
    return window;
}

Jiggle jiggle_of(double frequency, double damping, double root_stiffness = 4.0) {
    Jiggle jiggle;
    jiggle.frequency = frequency;
    jiggle.damping = damping;
    const double knots[] = {0.0, root_stiffness, 1.0, 1.0};
    jiggle.stiffness = Ramp(knots, "linear");
    return jiggle;
}

double omega_of(const Jiggle& jiggle, int k, int n) {
    return 2.0 * pi * jiggle.frequency * jiggle.stiffness(double(k) / (n - 1));
}

// A strand of two CVs from which the filtered tip can be read back. The target is root + (1, g), where x is
// constant and has no lag, so the slope of the jiggled segment is the filtered g.
Motion slope_motion(const std::function<double(double)>& g) {
    return [g](double frame) { return Curve{{0, 0, 0}, {1, g(frame), 0}}; };
}
double slope_of(const Curve& curve) { return (curve[1].y() - curve[0].y()) / (curve[1].x() - curve[0].x()); }

// The response at `seconds` to a target that is 0 until time 0 and then rises by 1 per second.
double ramp_response(double zeta, double omega, double seconds) {
    if (seconds <= 0.0) return 0.0;
    const double t = omega * seconds;
    double e; // x - t, in radians
    if (zeta < 1.0) {
        const double p = std::sqrt(1.0 - zeta * zeta);
        e = std::exp(-zeta * t) *
                (2.0 * zeta * std::cos(p * t) + (2.0 * zeta * zeta - 1.0) / p * std::sin(p * t)) -
            2.0 * zeta;
    } else if (zeta == 1.0) {
        e = std::exp(-t) * (2.0 + t) - 2.0;
    } else {
        const double q = std::sqrt(zeta * zeta - 1.0), a = zeta - q, b = zeta + q;
        e = (b / a * std::exp(-a * t) - a / b * std::exp(-b * t)) / (b - a) - 2.0 * zeta;
    }
    return (t + e) / omega;
}

// One scalar oscillator whose target is g(s), s from 0 to `seconds`, integrated by fourth-order Runge-Kutta
// with steps of at most `fine` of the fastest time constant. Error about fine^4 / 100 of the change.
void runge_kutta(double zeta, double omega, double seconds, const std::function<double(double)>& g, double& x,
                 double& v) {
    constexpr double fine = 0.02;
    const int steps = std::max(8, int(std::ceil(seconds * omega * std::max(1.0, 2.0 * zeta) / fine)));
    const double h = seconds / steps;
    const auto acceleration = [&](double s, double y, double dy) {
        return omega * omega * (g(s) - y) - 2.0 * zeta * omega * dy;
    };
    for (int i = 0; i < steps; ++i) {
        const double s = i * h;
        const double a1 = acceleration(s, x, v);
        const double v2 = v + 0.5 * h * a1, a2 = acceleration(s + 0.5 * h, x + 0.5 * h * v, v2);
        const double v3 = v + 0.5 * h * a2, a3 = acceleration(s + 0.5 * h, x + 0.5 * h * v2, v3);
        const double v4 = v + h * a3, a4 = acceleration(s + h, x + h * v3, v4);
        x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
        v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }
}

// Catmull and Rom's cubic between b and c, by its four basis functions.
double catmull_rom(double a, double b, double c, double d, double t) {
    return 0.5 * (a * (-t + 2 * t * t - t * t * t) + b * (2 - 5 * t * t + 3 * t * t * t) +
                  c * (t + 4 * t * t - 3 * t * t * t) + d * (-t * t + t * t * t));
}

// The target of CV k between samples: the root moves along a line, the offset along a cubic.
double between(const std::array<Curve, 4>& around, size_t k, int axis, double t) {
    const auto offset = [&](size_t i) { return around[i][k][axis] - around[i][0][axis]; };
    return around[1][0][axis] + t * (around[2][0][axis] - around[1][0][axis]) +
           catmull_rom(offset(0), offset(1), offset(2), offset(3), t);
}

// The full definition: history from sample `first` on, filtered per CV, then segment lengths restored.
Curve whole_history(const Jiggle& jiggle, int64_t first, double frame, const Motion& motion) {
    const int n = int(motion(frame).size());
    const auto at = [&](int64_t past_sample) { return rounded(motion(jiggle.frame_of(past_sample))); };
    const auto last = int64_t(std::ceil(frame / jiggle.step));
    Curve x = at(first), v(size_t(n), Vec3d::Zero());
    Curve target = x;
    for (int64_t past_sample = first; past_sample < last; ++past_sample) {
        std::array<Curve, 4> around = {at(past_sample - 1), at(past_sample), at(past_sample + 1),
                                       at(past_sample + 2)};
        for (size_t k = 0; past_sample == first && k < size_t(n); ++k) // along the first step's line
            around[0][k] = 2.0 * around[1][k] - around[2][k];
        const double share = std::min(1.0, (frame - jiggle.frame_of(past_sample)) / jiggle.step);
        const double whole = jiggle.step / frame_rate;
        for (size_t k = 0; k < size_t(n); ++k)
            for (int c = 0; c < 3; ++c) {
                target[k][c] = between(around, k, c, share);
                if (k > 0)
                    runge_kutta(
                        jiggle.damping, omega_of(jiggle, int(k), n), share * whole,
                        [&](double s) { return between(around, k, c, s / whole); }, x[k][c], v[k][c]);
            }
    }
    const Curve rest = rounded(motion(frame));
    Curve result{rest[0]};
    x[0] = target[0];
    for (size_t k = 1; k < size_t(n); ++k)
        result.push_back(result.back() + (x[k] - x[k - 1]).normalized() * (rest[k] - rest[k - 1]).norm());
    return result;
}

double distance(const Curve& a, const Curve& b) {
    double worst = 0.0;
    for (size_t k = 0; k < a.size(); ++k) worst = std::max(worst, (a[k] - b[k]).norm());
    return worst;
}

bool same_bits(const Curve& a, const Curve& b) {
    return std::memcmp(a.data(), b.data(), a.size() * sizeof(Vec3d)) == 0;
}

// A strand of unit length with equal segments that sways while its root moves about.
Motion swaying(uint64_t seed, int n, double root_travel = 0.3, const Vec3d& place = Vec3d::Zero()) {
    return [=](double frame) {
        const double s = frame / frame_rate;
        const Vec3d root = place + root_travel * Vec3d(std::sin(3.0 * s + draw(seed, 900)),
                                                       0.2 * std::cos(5.0 * s), std::sin(2.0 * s));
        Curve curve{root};
        for (int k = 0; k + 1 < n; ++k) {
            const double bend = 0.7 * std::sin((6.0 + 4.0 * draw(seed, 901)) * s + 0.3 * k + draw(seed, 902));
            const Vec3d d = Vec3d::UnitY() + 0.4 * draw3(seed, 1) + bend * draw3(seed, 2) * (k + 1.0) / n;
            curve.push_back(curve.back() + d.normalized() / (n - 1));
        }
        return curve;
    };
}

using Matrix = Eigen::Matrix<long double, 5, 5>;

// Matrix exponential of the oscillator's generator for (e, w, a1, 2 a2, 6 a3), the derivatives of a cubic
// target in t from 0 to 1, by scaling and squaring.
Matrix exponential(double zeta, double tau) {
    Matrix a = Matrix::Zero();
    a(0, 1) = tau;
    a(0, 2) = -1;
    a(1, 0) = -tau;
    a(1, 1) = -2.0L * zeta * tau;
    a(2, 3) = a(3, 4) = 1;
    int halvings = 0;
    while (a.cwiseAbs().maxCoeff() > 0.25L) {
        a /= 2;
        ++halvings;
    }
    Matrix sum = Matrix::Identity(), term = sum;
    for (int i = 1; i < 20; ++i) {
        term = (term * a / i).eval();
        sum += term;
    }
    while (halvings-- > 0) sum = (sum * sum).eval();
    return sum;
}

} // namespace

TEST(Jiggle, OneStepIsTheMatrixExponential) {
    double worst = 0.0;
    for (const double zeta : {0.0, 1e-12, 0.05, 0.3, 0.9, 0.999999, 1.0 - 1e-12, 1.0, 1.0 + 1e-12, 1.0 + 1e-9,
                              1.001, 1.5, 50.0, 1000.0}) {
        for (double tau = 1e-8; tau < 2e4; tau *= 1.37) {
            const JiggleStep<double> step = jiggle_step(zeta, tau);
            const Matrix m = exponential(zeta, tau);
            // Rounding of the angle (see jiggle_step.h), and of the reference, whose error doubles with each
            // squaring.
            const double scale = 1.0 + tau * std::max(1.0, 2.0 * zeta);
            const double reference = 8.0 * double(LDBL_EPSILON);
            // Columns of the derivatives, for a change before (1), here (2) and after (3): see jiggle_step.cpp.
            const long double changes[3][3] = {{0.5, -2, 3}, {0.5, 3, -6}, {0, -1, 3}};
            long double want[9] = {m(0, 0), m(0, 1), m(1, 1)};
            for (int i = 0; i < 3; ++i)
                for (int row = 0; row < 2; ++row)
                    for (int j = 0; j < 3; ++j)
                        want[3 + 3 * row + i] += (row == 0 ? -1 : 1) * m(row, 2 + j) * changes[i][j];
            const double got[9] = {step.c,    step.s,    step.d,    step.f[0], step.f[1],
                                   step.f[2], step.g[0], step.g[1], step.g[2]};
            for (int i = 0; i < 9; ++i) {
                const double error = std::abs(double(got[i] - want[i])) / scale;
                if (reference < 1e-15) worst = std::max(worst, error);
                EXPECT_LT(error, 4e-15 + reference)
                    << "zeta " << zeta << " tau " << tau << " coefficient " << i;
            }
        }
    }
    std::printf("one step: worst error %.2g\n", worst);
}

TEST(Jiggle, OneStepIsFiniteAtEverySize) {
    for (const double zeta : {0.0, 1e-300, 1e-12, 0.3, 1.0, 1.0 + 1e-15, 50.0, 1000.0})
        for (double tau = 1e-300; tau < 1e300; tau *= 10.0) {
            const JiggleStep<double> step = jiggle_step(zeta, tau);
            for (const double x :
                 {step.c, step.s, step.d, step.f[0], step.f[1], step.f[2], step.g[0], step.g[1], step.g[2]}) {
                EXPECT_TRUE(std::isfinite(x)) << zeta << " " << tau;
                EXPECT_LE(std::abs(x), 1.2) << zeta << " " << tau; // a cubic swings beyond its samples
            }
        }
    const JiggleStep<double> none = jiggle_step(0.3, 0.0);
    EXPECT_EQ(none.c, 1.0);
    EXPECT_EQ(none.s, 0.0);
    EXPECT_EQ(none.d, 1.0);
    EXPECT_EQ(none.f[0] + none.f[1] + none.f[2], 1.0);
    EXPECT_EQ(none.g[0] + none.g[1] + none.g[2], 0.0);
}

TEST(Jiggle, RampAndSinusoidHaveTheirClosedForm) {
    using namespace std::complex_literals;
    double worst_ramp = 0.0, worst_sine = 0.0;
    for (const double zeta : zetas) {
        if (std::abs(zeta - 1.0) < 1e-5) continue; // the closed forms of this test cancel there
        Jiggle jiggle = jiggle_of(2.0, zeta, 1.0);
        jiggle.step = 1.0 / 16.0;
        jiggle.start_frame = 2.0;
        const double omega = omega_of(jiggle, 1, 2), rate = 0.4 * frame_rate; // of the sinusoid, 1/s
        const Motion rising = slope_motion([](double f) { return f >= 2.0 ? (f - 2.0) / frame_rate : 0.0; });
        const Motion sine =
            slope_motion([](double f) { return f > 2.0 ? 0.5 * std::sin(0.4 * (f - 2.0)) : 0.0; });
        // From rest, driven by exp(i r tau): the steady state and both poles, so that x and x' begin at 0.
        const std::complex<double> root = std::sqrt(std::complex<double>(zeta * zeta - 1.0)),
                                   p = -zeta + root, q = -zeta - root, ir = 1i * (rate / omega);
        const auto sine_response = [&](double seconds) {
            const double tau = omega * seconds;
            const auto transient = ((q - ir) * std::exp(p * tau) - (p - ir) * std::exp(q * tau)) / (q - p);
            return 0.5 * ((std::exp(ir * tau) - transient) / (1.0 + ir * ir + 2.0 * zeta * ir)).imag();
        };
        for (const double time : {2.2, 3.0, 7.25, 12.5, 19.9, 31.3}) {
            const auto got = run(jiggle, {time}, {rising, sine})[0];
            const double seconds = (time - 2.0) / frame_rate;
            worst_ramp =
                std::max(worst_ramp, std::abs(slope_of(got[0]) - ramp_response(zeta, omega, seconds)));
            worst_sine = std::max(worst_sine, std::abs(slope_of(got[1]) - sine_response(seconds)));
        }
    }
    std::printf("closed forms: ramp %.2g, sine %.2g (a float's half unit: 6e-8)\n", worst_ramp, worst_sine);
    EXPECT_LT(worst_ramp, 1e-6);
    EXPECT_LT(worst_sine, 3e-6); // the cubic through samples of it, 0.025 rad apart
}

TEST(Jiggle, WholeStrandsFollowARungeKuttaRunOfTheirHistory) {
    for (const double zeta : zetas) {
        Jiggle jiggle = jiggle_of(1.7, zeta);
        jiggle.start_frame = 100.0;
        std::vector<Motion> motions;
        for (uint64_t seed = 1; seed <= 3; ++seed) motions.push_back(swaying(seed, 5));
        const std::vector<double> times = {100.2, 107.0, 123.3, 123.5, 140.75};
        const auto got = run(jiggle, times, motions, 4.0, 0.0);
        double worst = 0.0, lag = 0.0;
        for (size_t i = 0; i < times.size(); ++i)
            for (size_t s = 0; s < motions.size(); ++s) {
                worst =
                    std::max(worst, distance(got[i][s], whole_history(jiggle, 200, times[i], motions[s])));
                lag = std::max(lag, distance(got[i][s], motions[s](times[i])));
            }
        std::printf("zeta %-10.9g seeds 1-3: error %.2g of the length where the lag is up to %.2g\n", zeta,
                    worst, lag);
        EXPECT_LT(worst, 1e-6);
        EXPECT_GT(lag, 0.01);
    }
}

TEST(Jiggle, AConstantTargetIsTheBentPoseBitForBit) {
    for (const double zeta : zetas)
        for (const double scale : {1e-30, 1e-3, 1.0, 1e6, 1e30})
            for (const int n : {2, 3, 9}) {
                std::vector<Motion> motions;
                for (uint64_t seed = 1; seed <= 11; ++seed) {
                    Curve curve = swaying(seed, n)(double(seed));
                    for (Vec3d& p : curve) p = (p + draw3(seed, 77)) * scale;
                    motions.emplace_back([curve](double) { return curve; });
                }
                const auto got = run(jiggle_of(2.0, zeta), {9.75, 10.0, 10.1, 10.25}, motions);
                for (const auto& curves : got)
                    for (size_t s = 0; s < motions.size(); ++s)
                        EXPECT_TRUE(same_bits(curves[s], rounded(motions[s](0.0))));
            }
}

// A still strand in the same block of eight as moving strands stays exact.
TEST(Jiggle, AStillStrandAmongMovingOnesStaysExact) {
    const Curve still = swaying(5, 9)(3.0);
    const std::vector<Motion> motions = {swaying(1, 9), [&](double) { return still; }, swaying(2, 9)};
    const auto got = run(jiggle_of(2.0, 0.3), {10.1}, motions);
    EXPECT_TRUE(same_bits(got[0][1], rounded(still)));
    EXPECT_GT(distance(got[0][0], motions[0](10.1)), 1e-3);
}

namespace {

// The same steps after many more of the longest ones.
JiggleWindow lengthened(JiggleWindow window) {
    const auto level = int(window.steps.size()) - 1;
    const int64_t more = 2 * window.count() + 50;
    window.steps.back() += more;
    window.length += more << level;
    window.first -= more << level;
    return window;
}

} // namespace

// Worst case before the window: the target jumps between its extremes with the sign of the kernel.
TEST(Jiggle, TheWindowForgetsNoMoreThanTheTolerance) {
    constexpr double reach = 2.0, tolerance = reach / 1024.0; // a power of 4 of it
    for (const double zeta : zetas) {
        Jiggle jiggle = jiggle_of(2.0, zeta, 1.0);
        const double omega = omega_of(jiggle, 1, 2);
        const auto period = jiggle_window(jiggle, std::array{0.0}, frame_rate, reach, tolerance).period;
        const double frame = jiggle.frame_of(5 * period); // an epoch: later, more is forgotten
        const JiggleWindow window = jiggle_window(jiggle, std::array{frame}, frame_rate, reach, tolerance);
        const double first_frame = jiggle.frame_of(window.run_at(jiggle.sample_before(frame), 0).first);
        const auto worst_case = [&](double f) {
            if (f >= first_frame) return 0.0;
            return jiggle_step(zeta, omega * (frame - f) / frame_rate).s < 0.0 ? -reach : reach;
        };
        std::vector<Motion> motions = {slope_motion(worst_case)};
        for (uint64_t seed = 1; seed <= 15; ++seed)
            motions.push_back(slope_motion([=](double f) {
                // a random motion within +- reach / 2, so that no two values are more than reach apart
                return 0.5 * reach * std::sin(10.0 * draw(seed, 1) + f * 0.5 * draw(seed, 2)) *
                       std::cos(f * 0.2 * draw(seed, 3));
            }));
        const auto cut = run(jiggle, window, {frame}, motions);
        const auto whole = run(jiggle, lengthened(window), {frame}, motions);
        double worst = 0.0, random = 0.0;
        for (size_t s = 0; s < motions.size(); ++s)
            (s == 0 ? worst : random) =
                std::max(s == 0 ? worst : random, std::abs(slope_of(cut[0][s]) - slope_of(whole[0][s])));
        std::printf("zeta %-10.9g window %4d samples: worst target %.3f of the tolerance, random ones %.3f\n",
                    zeta, int(window.most_samples()), worst / tolerance, random / tolerance);
        EXPECT_LE(worst, tolerance + 4e-7);
        EXPECT_LE(random, tolerance + 4e-7);
        EXPECT_GT(worst, 0.03 * tolerance); // no longer than needed, up to one of the longest steps
    }
}

TEST(Jiggle, TruncatedStrandsDifferByLittleMoreThanTheTolerance) {
    constexpr double tolerance = 1e-3;
    for (const double zeta : zetas) {
        const Jiggle jiggle = jiggle_of(1.5, zeta);
        std::vector<Motion> motions;
        for (uint64_t seed = 1; seed <= 64; ++seed) motions.push_back(swaying(seed, 9));
        const std::vector<double> times = {500.3};
        const double reach = 2.0 + 0.6; // twice the length plus the travel of the root
        const JiggleWindow window = jiggle_window(jiggle, times, frame_rate, reach, tolerance);
        const auto cut = run(jiggle, window, times, motions);
        const auto whole = run(jiggle, lengthened(window), times, motions);
        double worst = 0.0;
        for (size_t s = 0; s < motions.size(); ++s) worst = std::max(worst, distance(cut[0][s], whole[0][s]));
        std::printf("zeta %-10.9g whole strands, seeds 1-64: %.3f of the tolerance\n", zeta,
                    worst / tolerance);
        EXPECT_LE(worst, 2.0 * tolerance);
    }
}

TEST(Jiggle, SegmentsKeepTheirLengths) {
    double worst = 0.0; // 1 is the bound
    size_t index = 0;
    for (const double zeta : zetas)
        for (const double far : {0.0, 1e3, 1e6})
            for (const int n : {2, 5, 65}) {
                if (!marram::testing::in_this_run(index++, 2)) continue;
                std::vector<Motion> motions;
                for (uint64_t seed = 1; seed <= 9; ++seed)
                    motions.push_back(swaying(seed, n, 5.0, far * Vec3d(1, -0.5, 0.3)));
                const std::vector<double> times = {20.25, 20.4, 20.75};
                const auto got = run(jiggle_of(0.7, zeta), times, motions, 12.0);
                for (size_t i = 0; i < times.size(); ++i)
                    for (size_t s = 0; s < motions.size(); ++s) {
                        const Curve rest = rounded(motions[s](times[i]));
                        EXPECT_EQ(got[i][s][0], rest[0]);
                        for (size_t k = 1; k < size_t(n); ++k) {
                            const double length = (rest[k] - rest[k - 1]).norm();
                            const double is = (got[i][s][k] - got[i][s][k - 1]).norm();
                            const double ulp = double(FLT_EPSILON) * got[i][s][k].cwiseAbs().maxCoeff();
                            worst = std::max(worst, std::abs(is - length) / (1e-5 * length + 2.0 * ulp));
                        }
                    }
            }
    std::printf("lengths: %.3f of 1e-5 relative + 2 ulp\n", worst);
    EXPECT_LE(worst, 1.0);
}

TEST(Jiggle, ARootThatMovesDragsItsStrandBehindIt) {
    const double speed = 1.5, gain = 3.0; // m/s, m/s^2
    double worst_even = 0.0, worst_faster = 0.0;
    for (const double zeta : {0.3, 0.999999, 1.0, 1.5}) {
        const Jiggle jiggle = jiggle_of(4.0, zeta, 1.0);
        const double omega = omega_of(jiggle, 1, 2);
        const auto strand_at = [](double x) { return Curve{{x, 0, 0}, {x, 1, 0}}; };
        const Motion even = [&](double f) { return strand_at(speed * f / frame_rate); };
        const Motion faster = [&](double f) {
            return strand_at(0.5 * gain * f * f / frame_rate / frame_rate);
        };
        const double reach = 200.0; // the root has travelled far
        const auto got = run(jiggle, {96.0}, {even, faster}, reach, 1e-7);
        const auto lean = [](const Curve& c) { return (c[1].x() - c[0].x()) / (c[1].y() - c[0].y()); };
        worst_even = std::max(worst_even, std::abs(lean(got[0][0]) + 2.0 * zeta * speed / omega));
        const double v = gain * 96.0 / frame_rate;
        const double want = -2.0 * zeta * v / omega + (4.0 * zeta * zeta - 1.0) * gain / (omega * omega);
        worst_faster = std::max(worst_faster, std::abs(lean(got[0][1]) - want));
    }
    // A parabola through samples a distance h apart lies on average a h^2 / 12 below its chords.
    const double chords = gain / 12.0 * 0.25 / frame_rate / frame_rate;
    std::printf("moving root: even %.2g, accelerated %.2g (chords of the step: %.2g)\n", worst_even,
                worst_faster, chords);
    EXPECT_LT(worst_even, 2e-6); // the root's float error is 6e-8 * 6 m
    EXPECT_LT(worst_faster, 2.0 * chords + 1e-5);
}

TEST(Jiggle, ATurningStrandLagsAndSettles) {
    const Motion turning = [](double f) { // half a turn per second until frame 48, then still
        const double angle = pi * std::min(f, 48.0) / frame_rate;
        Curve curve;
        for (int k = 0; k < 5; ++k) curve.push_back(0.25 * k * Vec3d(std::cos(angle), 0.2, std::sin(angle)));
        return curve;
    };
    for (const double zeta : {0.3, 1.0, 1.5}) {
        const auto got = run(jiggle_of(2.0, zeta), {47.5, 48.5, 600.0}, {turning}, 4.0, 1e-6);
        EXPECT_GT(distance(got[0][0], turning(47.5)), 0.05);
        EXPECT_GT(distance(got[1][0], turning(48.5)), 0.05);
        EXPECT_TRUE(same_bits(got[2][0], rounded(turning(600.0)))); // still over the whole window
    }
}

// No jump between keys, at samples, or at the start frame.
TEST(Jiggle, PosesAreContinuousInTime) {
    Jiggle jiggle = jiggle_of(2.0, 0.3);
    jiggle.start_frame = 11.0;
    std::vector<double> times;
    for (int i = 0; i <= 4000; ++i) times.push_back(10.0 + i * 0.001);
    const Motion motion = swaying(3, 5);
    const auto got = run(jiggle, times, {motion});
    double step = 0.0;
    for (size_t i = 1; i < times.size(); ++i) step = std::max(step, distance(got[i][0], got[i - 1][0]));
    double bent_step = 0.0;
    for (size_t i = 1; i < times.size(); ++i)
        bent_step = std::max(bent_step, distance(rounded(motion(times[i])), rounded(motion(times[i - 1]))));
    std::printf("time: greatest move in 0.001 frames %.2g, of the target %.2g\n", step, bent_step);
    EXPECT_LT(step, 2.0 * bent_step);
    EXPECT_TRUE(same_bits(got[500][0], rounded(motion(times[500])))); // 10.5: before the start frame
    EXPECT_GT(distance(got[4000][0], motion(times[4000])), 1e-3);
}

TEST(Jiggle, DifferentMotionSamplesAgreeWhereTheyMeet) {
    for (const double zeta : {0.05, 0.3, 1.0, 1.5, 50.0}) {
        const Jiggle jiggle = jiggle_of(2.0, zeta);
        std::vector<Motion> motions;
        for (uint64_t seed = 1; seed <= 8; ++seed) motions.push_back(swaying(seed, 9));
        const double tolerance = 1e-4;
        const auto one = run(jiggle, {48.0}, motions, 2.6, tolerance);
        const auto many = run(jiggle, {47.75, 47.875, 48.0, 48.125, 48.25}, motions, 2.6, tolerance);
        const auto early = run(jiggle, {41.0, 48.0}, motions, 2.6, tolerance);
        double worst = 0.0;
        for (size_t s = 0; s < motions.size(); ++s)
            worst = std::max({worst, distance(one[0][s], many[2][s]), distance(one[0][s], early[1][s])});
        std::printf("zeta %-4g shared time: %.3f of the tolerance\n", zeta, worst / tolerance);
        EXPECT_LE(worst, 2.0 * tolerance);
    }
}

TEST(Jiggle, KeysOfOneFrameShareTheirKnotsWithTheNext) {
    const Jiggle jiggle = jiggle_of(2.0, 0.3);
    const JiggleWindow a = jiggle_window(jiggle, std::array{99.75, 100.25}, frame_rate, 2.0, 1e-4);
    const JiggleWindow b = jiggle_window(jiggle, std::array{100.75, 101.25}, frame_rate, 2.0, 1e-4);
    EXPECT_EQ(a.first + 2, b.first);
    EXPECT_EQ(a.last + 2, b.last);
    EXPECT_LE(jiggle.frame_of(a.first), 99.75);
    EXPECT_GE(jiggle.frame_of(a.last), 100.25);
    for (const double step : {0.1, 0.3, 1.0 / 3.0, 0.7}) { // samples that are not exact in double
        Jiggle odd = jiggle;
        odd.step = step;
        for (int i = -2000; i < 2000; ++i) {
            const double time = i * step;
            const int64_t before = odd.sample_before(time);
            EXPECT_LE(odd.frame_of(before), time);
            EXPECT_GT(odd.frame_of(before + 1), time);
        }
    }
}

TEST(Jiggle, FramesFarFromZeroAreLikeAnyOther) {
    double worst = 0.0;
    for (const double zeta : {0.05, 1.0, 50.0})
        for (const double far : {-1e4, 1e6}) {
            const Motion here = swaying(4, 9);
            const Jiggle jiggle = jiggle_of(2.0, zeta);
            const JiggleWindow window = jiggle_window(jiggle, std::array{40.0, 40.3}, frame_rate, 2.6, 0.0);
            const double period = jiggle.frame_of(window.period); // the same steps lead to both
            const double by = period * std::round(far / period);
            const Motion there = [&](double f) { return here(f - by); };
            const auto a = run(jiggle, {40.0, 40.3}, {here}, 2.6);
            const auto b = run(jiggle, {by + 40.0, by + 40.3}, {there}, 2.6);
            for (size_t i = 0; i < 2; ++i) worst = std::max(worst, distance(a[i][0], b[i][0]));
        }
    std::printf("frames -1e4 and 1e6: %.2g\n", worst);
    EXPECT_LT(worst, 1e-6);
}

TEST(Jiggle, FarFromTheOriginOnlyTheFloatsAreCoarse) {
    for (const double far : {1e3, 1e6, 1e7}) {
        const Vec3d place = far * Vec3d(1, 0.5, -1);
        Jiggle jiggle = jiggle_of(2.0, 0.3);
        jiggle.start_frame = 0.0;
        const Motion motion = swaying(6, 5, 0.3, place);
        const auto got = run(jiggle, {30.3}, {motion});
        // Segments of rounded points may be shorter than an ulp, so the reference uses the same floats.
        const Curve want = whole_history(jiggle, 0, 30.3, motion);
        const double error = distance(got[0][0], want), ulp = double(FLT_EPSILON) * far;
        std::printf("%g m from the origin: error %.2g ulp\n", far, error / ulp);
        for (const Vec3d& p : got[0][0]) EXPECT_TRUE(p.allFinite());
        EXPECT_LT(error, 1.0 * ulp);
    }
}

TEST(Jiggle, OddStrandsGiveFinitePosesAndNoMotionOfTheirOwn) {
    for (const double zeta : zetas)
        for (const double scale : {1e-38, 1e-30, 1.0, 1e30}) {
            const Motion point = [=](double f) { return Curve(5, scale * Vec3d(std::sin(f), 0, 0)); };
            const Motion partly = [=](double f) {
                const Vec3d d = scale * Vec3d(std::sin(f), std::cos(f), 0);
                return Curve{{0, 0, 0}, {0, 0, 0}, d, d, 2.0 * d};
            };
            // The filtered tip passes through its root: x reverses within one step.
            const Motion flips = [=](double f) {
                const double sign = f < 5.0 ? 1.0 : -1.0;
                return Curve{{0, 0, 0},
                             {sign * scale, 0, 0},
                             {sign * 2 * scale, 0, 0},
                             {sign * 3 * scale, 0, 0},
                             {sign * 4 * scale, 0, 0}};
            };
            std::vector<double> times;
            for (int i = 0; i < 100; ++i) times.push_back(4.0 + 0.1 * i);
            const auto got = run(jiggle_of(2.0, zeta), times, {point, partly, flips}, 8.0 * scale);
            for (size_t i = 0; i < times.size(); ++i) {
                for (const Curve& curve : got[i])
                    for (const Vec3d& p : curve) ASSERT_TRUE(p.allFinite());
                EXPECT_TRUE(same_bits(got[i][0], rounded(point(times[i]))));
                EXPECT_EQ(got[i][1][1], got[i][1][0]);
                EXPECT_EQ(got[i][1][3], got[i][1][2]);
                for (size_t k = 1; k < 5; ++k)
                    EXPECT_NEAR((got[i][2][k] - got[i][2][k - 1]).norm() / scale, 1.0,
                                scale < 1e-36 ? 1e-3 : 1e-5);
            }
        }
}

TEST(Jiggle, HardSpringsPassThroughTheKnotsAndSoftOnesStayBehind) {
    const Motion motion = swaying(7, 9);
    const auto hard = run(jiggle_of(1e9, 0.3), {30.0}, {motion});
    EXPECT_LT(distance(hard[0][0], motion(30.0)), 1e-6);
    Jiggle soft = jiggle_of(1e-9, 0.3);
    soft.start_frame = 0.0;
    const Motion turning = [](double f) {
        return Curve{{0, 0, 0}, {std::cos(0.1 * f), std::sin(0.1 * f), 0}};
    };
    const auto stays = run(soft, {10.0}, {turning});
    EXPECT_LT(distance(stays[0][0], turning(0.0)), 1e-6);
}

TEST(Jiggle, UndampedStrandsNeedAStartAndSwingForEver) {
    Jiggle jiggle = jiggle_of(2.0, 0.0, 1.0);
    EXPECT_THROW(jiggle_window(jiggle, std::array{10.0}, frame_rate, 2.0, 1e-3), SceneFault);
    jiggle.start_frame = 0.0;
    // A step of the target, then a long history: at 2 Hz and 24 fps the response has a period of 12 frames.
    const Motion step = slope_motion([](double f) { return f >= 2.0 ? 1.0 : 0.0; });
    const auto got = run(jiggle, {20.3, 20.3 + 12.0 * 1000.0}, {step});
    std::printf("undamped: 1000 periods later %.2g off\n", distance(got[0][0], got[1][0]));
    EXPECT_LT(distance(got[0][0], got[1][0]), 1e-6);
    EXPECT_GT(std::abs(slope_of(got[0][0]) - 1.0), 0.1);
    const auto before = run(jiggle, {-20.0, -19.3}, {step});
    EXPECT_TRUE(same_bits(before[1][0], rounded(step(-19.3))));
    EXPECT_THROW(jiggle_window(jiggle, std::array{1e6}, frame_rate, 2.0, 1e-3), SceneFault);
    jiggle.damping = 1e-7;
    EXPECT_NO_THROW(jiggle_window(jiggle, std::array{10.0}, frame_rate, 2.0, 1e-3));
    jiggle.start_frame.reset();
    try {
        jiggle_window(jiggle, std::array{10.0}, frame_rate, 2.0, 1e-3);
        FAIL();
    } catch (const SceneFault& fault) {
        EXPECT_NE(fault.remedy.find("jiggle.start_frame"), std::string::npos);
    }
}

TEST(Jiggle, AStartFrameDoesNotLengthenTheWindow) {
    Jiggle jiggle = jiggle_of(2.0, 0.3);
    const JiggleWindow free = jiggle_window(jiggle, std::array{1000.0}, frame_rate, 2.0, 1e-4);
    jiggle.start_frame = 1.0;
    EXPECT_EQ(jiggle_window(jiggle, std::array{1000.0}, frame_rate, 2.0, 1e-4).first, free.first);
    EXPECT_EQ(jiggle_window(jiggle, std::array{5.0}, frame_rate, 2.0, 1e-4).first, 2);
    EXPECT_LE(jiggle_window(jiggle, std::array{-5.0}, frame_rate, 2.0, 1e-4).count(), 0);
}

TEST(Jiggle, AFilterUsedAgainGivesTheSameBits) {
    const Jiggle jiggle = jiggle_of(2.0, 0.3);
    const std::vector<Motion> first = {swaying(1, 9), swaying(2, 9)}, second = {swaying(3, 5)};
    const std::vector<double> times = {30.0, 30.2};
    const JiggleWindow window = jiggle_window(jiggle, times, frame_rate, 2.6, 1e-5);
    Filtered used{jiggle, window, first}, again{jiggle, window, second}, fresh{jiggle, window, second};
    used.at(times[0]);
    again.filter = used.filter;
    for (const double time : times) EXPECT_TRUE(same_bits(again.at(time)[0], fresh.at(time)[0]));
}

namespace {

// Motions that are hard to follow in few samples. Strands are 1 m long.
struct HardMotion {
    const char* what;
    Motion motion;
};

std::vector<HardMotion> hard_motions() {
    const auto leaning = [](double angle, double x) {
        Curve curve{{x, 0, 0}};
        for (int k = 1; k < 5; ++k)
            curve.push_back(curve.back() +
                            0.25 * Vec3d(std::sin(angle * k / 4.0), std::cos(angle * k / 4.0), 0));
        return curve;
    };
    return {{"a gust that passes within two frames",
             [=](double f) {
                 const double t = std::abs(f - 60.0);
                 return leaning(t < 1.0 ? 1.2 * (1.0 - t) * (1.0 - t) * (1.0 + 2.0 * t) : 0.0, 0.0);
             }},
            {"a skin that stops dead, from 3 m/s", // its keys are at whole frames
             [=](double f) { return leaning(0.2, std::min(f, 60.0) * 3.0 / frame_rate); }},
            {"a skin that turns back, 3 m/s",
             [=](double f) { return leaning(0.2, std::abs(f - 60.0) * 3.0 / frame_rate); }},
            {"a wind that turns back within a frame",
             [=](double f) { return leaning(0.8 * std::clamp(2.0 * (f - 60.0), -1.0, 1.0), 0.0); }},
            {"a sway at the strand's own frequency",
             [=](double f) { return leaning(0.8 * std::sin(2.0 * pi * 2.0 * f / frame_rate), 0.0); }},
            {"flutter of 9 Hz",
             [=](double f) { return leaning(0.3 * std::sin(2.0 * pi * 9.0 * f / frame_rate), 0.0); }}};
}

} // namespace

// The pose against a run over the whole history in small steps. The error of a step is shown for steps of 1,
// 1/2, 1/4 and 1/8 frame, and bounded: by the tolerance's window, and by the fall of the steps' own error.
TEST(Jiggle, HardMotionsConvergeToTheirWholeHistory) {
    constexpr double tolerance = 1e-3, reach = 10.0, finest = 1.0 / 32.0;
    for (const HardMotion& hard : hard_motions())
        for (const auto& [hertz, zeta] : std::initializer_list<std::pair<double, double>>{{0.2, 0.3},
                                                                                          {2.0, 0.01},
                                                                                          {2.0, 0.1},
                                                                                          {2.0, 0.3},
                                                                                          {2.0, 1.0},
                                                                                          {2.0, 5.0},
                                                                                          {20.0, 0.3},
                                                                                          {2.0, 0.0}}) {
            Jiggle jiggle = jiggle_of(hertz, zeta);
            if (zeta == 0.0) jiggle.start_frame = 0.0;
            const std::vector<double> times = {60.0, 60.4, 61.0, 62.0, 63.7, 66.0, 71.3};
            Jiggle fine = jiggle;
            fine.step = finest;
            const auto right =
                run(fine, whole_from(zeta == 0.0 ? 0 : int64_t(-2000.0 / finest)), times, {hard.motion});
            std::printf("%-40s %4g Hz, damping %-4g:", hard.what, hertz, zeta);
            double before = 0.0;
            for (const double step : {1.0, 0.5, 0.25, 0.125}) {
                jiggle.step = step;
                const auto got = run(jiggle, times, {hard.motion}, reach, tolerance);
                double worst = 0.0;
                for (size_t i = 0; i < times.size(); ++i)
                    worst = std::max(worst, distance(got[i][0], right[i][0]));
                std::printf("  %.1e", worst);
                if (step == 0.25) before = worst;
                if (step == 0.125) {
                    EXPECT_LT(worst, std::max(0.6 * before, tolerance)) << hard.what;
                }
            }
            std::printf("\n");
        }
}

// Callers have poses of the skin and gusts for the window's samples only.
TEST(Jiggle, AsksForNoSampleBeyondItsWindow) {
    int windows = 0;
    for (const double zeta : {1e-3, 0.1, 0.3, 0.5, 1.0, 3.0, 50.0})
        for (double hertz = 0.02; hertz < 2e3; hertz *= 1.23)
            for (const double step : {0.02, 0.125, 0.5, 2.0, 7.0})
                for (const std::optional<double> start : {std::optional<double>(), std::optional(-90.0)}) {
                    Jiggle jiggle = jiggle_of(hertz, zeta);
                    jiggle.step = step;
                    jiggle.start_frame = start;
                    const double time = -40.0 + hertz;
                    JiggleWindow window;
                    try {
                        window = jiggle_window(jiggle, std::array{time}, frame_rate, 2.0, 1e-4);
                    } catch (const SceneFault&) {
                        continue; // too long
                    }
                    if (window.empty() || window.most_samples() > 3000) continue;
                    ++windows;
                    for (uint32_t phase = 0; phase < std::min<int64_t>(window.period, 17); ++phase) {
                        JiggleFilter filter;
                        JiggleState state;
                        Strands strands;
                        strands.resize(1, 2, false);
                        int64_t asked = 0;
                        const auto bent = [&](int64_t past_sample, WideVector<Wide3f>&) {
                            EXPECT_GE(past_sample, window.first);
                            EXPECT_LE(past_sample, window.last);
                            ++asked;
                        };
                        filter.begin(jiggle, window, frame_rate, 2, 1);
                        filter.advance(state, phase, time, bent);
                        WideVector<Wide3f> pose;
                        filter.emit(state, time, strands, bent, pose);
                        EXPECT_LE(asked, window.most_samples());
                    }
                }
    EXPECT_GT(windows, 1000);
}

// Frames in any order, alone, in sequence and within a shutter, with the state dropped at random.
TEST(Jiggle, WhatIsKeptChangesNoBit) {
    size_t compared = 0, differ = 0;
    for (const double zeta : {0.0, 0.05, 0.3, 1.0, 5.0})
        for (const double step : {0.1, 0.125, 0.5, 2.0}) {
            Jiggle jiggle = jiggle_of(2.0, zeta);
            jiggle.step = step;
            if (zeta == 0.0 || step == 0.1) jiggle.start_frame = 3.0;
            const std::vector<Motion> motions = {swaying(1, 5), swaying(2, 5), swaying(3, 5)};
            for (const uint32_t phase : {0U, 5U}) {
                const JiggleWindow window =
                    jiggle_window(jiggle, std::array{0.0, 100.0}, frame_rate, 2.6, 1e-3);
                Filtered kept{jiggle, window, motions, phase};
                double time = 40.0;
                for (uint64_t i = 0; i < 150; ++i) {
                    const double kind = unit_double(hash(17, i));
                    time = kind < 0.5   ? time + 1.0
                           : kind < 0.7 ? time + 0.25
                                        : 10.0 + 80.0 * unit_double(hash(18, i));
                    if (time > 98.0) time -= 60.0;
                    if (unit_double(hash(19, i)) < 0.1) kept.state = {};
                    const std::vector<Curve> with = kept.at(time);
                    const std::vector<Curve> alone = Filtered{jiggle, window, motions, phase}.at(time);
                    for (size_t m = 0; m < motions.size(); ++m, ++compared)
                        differ += !same_bits(with[m], alone[m]);
                }
            }
        }
    std::printf("kept states: %zu of %zu poses differ\n", differ, compared);
    EXPECT_EQ(differ, 0U);
}

// A sequence of ten minutes pays for its own samples and a window once a period; its memory stays as it is.
TEST(Jiggle, ASequencePaysForItsOwnSamples) {
    for (const double zeta : {0.1, 0.3, 1.0}) {
        Jiggle jiggle = jiggle_of(2.0, zeta);
        jiggle.step = 1.0;
        const std::vector<Motion> motions = {swaying(1, 5)};
        const JiggleWindow window = jiggle_window(jiggle, std::array{1.0, 14400.0}, frame_rate, 2.0, 1e-3);
        Filtered kept{jiggle, window, motions};
        for (int f = 1; f <= 100; ++f) kept.at(f);
        const size_t bytes = kept.state.bytes();
        kept.bends = 0;
        for (int f = 101; f <= 14400; ++f) kept.at(f);
        const double per_frame = kept.bends / 14300.0;
        int alone = 0;
        for (int f = 101; f < 101 + window.period; ++f) {
            Filtered one{jiggle, window, motions};
            one.at(f);
            alone += one.bends;
            EXPECT_LE(one.bends, window.most_samples());
        }
        std::printf("damping %.1f: %.2f bends a frame in sequence, %.1f alone\n", zeta, per_frame,
                    alone / double(window.period));
        EXPECT_LT(per_frame, 3.5);
        EXPECT_EQ(kept.state.bytes(), bytes);
    }
}

TEST(Jiggle, NormalsTurnWithTheirSegments) {
    Strands now;
    fill(now, {swaying(1, 9), swaying(2, 9), swaying(3, 9)}, 5.0);
    now.oriented = true;
    WideVector<Wide3f> pose = now.pose, normals;
    now.pose_normal.resize(now.pose.size());
    for (int i = 0; i < lanes; ++i) {
        const Curve curve = curve_of(now.pose, 9, i);
        Curve normal;
        for (size_t k = 0; k < 9; ++k) {
            const size_t start = std::min<size_t>(k, 7);
            normal.push_back((curve[start + 1] - curve[start]).cross(Vec3d::UnitX()).normalized());
        }
        set_curve(now.pose_normal, 9, i, normal);
    }
    set_curve(pose, 9, 1, swaying(2, 9)(9.0));
    Curve opposed{swaying(3, 9)(5.0)};
    for (Vec3d& p : opposed) p = 2.0 * opposed[0] - p;
    set_curve(pose, 9, 2, opposed);
    jiggle_normals(now, pose, normals);
    EXPECT_TRUE(same_bits(curve_of(normals, 9, 0), curve_of(now.pose_normal, 9, 0)));
    for (const int i : {1, 2}) {
        const Curve curve = curve_of(pose, 9, i), normal = curve_of(normals, 9, i);
        for (size_t k = 0; k < 9; ++k) {
            const size_t start = std::min<size_t>(k, 7);
            EXPECT_NEAR(normal[k].norm(), 1.0, 1e-6);
            EXPECT_NEAR(normal[k].dot((curve[start + 1] - curve[start]).normalized()), 0.0, 1e-5);
        }
    }
}

namespace {

struct Given { // values as a renderer passes them
    std::vector<std::pair<std::string, std::vector<double>>> numbers;
    std::optional<Jiggle> read() const {
        std::vector<MarramValue> values;
        for (const auto& [name, list] : numbers)
            values.push_back({name.c_str(), list.size() > 1 ? MARRAM_RAMP : MARRAM_NUMBER, list.data(),
                              list.size(), "linear", nullptr, name.c_str()});
        return read_jiggle(Values(values));
    }
    std::string fault() const {
        try {
            read();
        } catch (const SceneFault& fault) {
            return fault.place + ": " + fault.what() + ": " + fault.remedy;
        }
        return "";
    }
};

} // namespace

TEST(Jiggle, ScenesAreReadAndContradictionsRefused) {
    EXPECT_FALSE(Given{}.read());
    const std::optional<Jiggle> plain = Given{{{"wind.jiggle.frequency", {3}}}}.read();
    ASSERT_TRUE(plain);
    EXPECT_EQ(plain->frequency, 3.0);
    EXPECT_EQ(plain->stiffness(0.0), 4.0);
    EXPECT_EQ(plain->stiffness(1.0), 1.0);
    EXPECT_FALSE(plain->start_frame);
    const std::optional<Jiggle> full = Given{
        {{"wind.jiggle.frequency", {3}},
         {"wind.jiggle.damping", {0}},
         {"wind.jiggle.step", {0.25}},
         {"wind.jiggle.stiffness", {0, 2, 1, 0.5}},
         {"wind.jiggle.start_frame",
          {-7}}}}.read();
    ASSERT_TRUE(full);
    EXPECT_EQ(full->damping, 0.0);
    EXPECT_EQ(full->step, 0.25);
    EXPECT_EQ(full->stiffness(1.0), 0.5);
    EXPECT_EQ(full->start_frame, -7.0);
    for (const char* name : {"damping", "step", "start_frame", "stiffness"}) {
        const std::string whole = std::string("wind.jiggle.") + name;
        EXPECT_EQ(Given({{{whole, {1}}}}).fault(),
                  whole + ": jiggle." + name +
                      " has no effect without jiggle.frequency: add it in Hz, such as jiggle.frequency = 2");
    }
    EXPECT_FALSE(Given({{{"wind.jiggle.frequency", {0}}, {"wind.jiggle.damping", {1}}}}).read())
        << "switched off";
    EXPECT_NE(
        Given({{{"wind.jiggle.frequency", {2}}, {"wind.jiggle.damping", {0}}}}).fault().find("start_frame"),
        std::string::npos);
    EXPECT_NE(Given({{{"wind.jiggle.frequency", {2}}, {"wind.jiggle.stiffness", {0, 1, 1, 0}}}})
                  .fault()
                  .find("keep it positive"),
              std::string::npos);
    size_t listed = 0;
    for (const MarramParam& param : wind_params()) listed += std::string(param.name).starts_with("jiggle");
    EXPECT_EQ(listed, jiggle_params().size());
}

// Prints the error of the step between samples and the cost per sample. Only the error of the step has a
// bound.
TEST(Jiggle, MeasuredErrorOfTheStepAndCost) {
    for (const double hertz : {1.0, 2.0, 5.0})
        for (const double step : {2.0, 1.0, 0.5, 0.25, 0.125}) {
            double worst = 0.0;
            const Motion sway =
                slope_motion([=](double f) { return 0.5 * std::sin(2.0 * pi * hertz * f / frame_rate); });
            Jiggle jiggle = jiggle_of(2.0, 0.3, 1.0), finest = jiggle;
            jiggle.step = step;
            finest.step = 1.0 / 64.0;
            for (const double t : {100.0, 101.3, 102.6, 103.9, 105.2, 106.5, 107.8})
                worst = std::max(worst, std::abs(slope_of(run(jiggle, {t}, {sway}, 1.0)[0][0]) -
                                                 slope_of(run(finest, {t}, {sway}, 1.0)[0][0])));
            std::printf("sway of %g Hz, step %-5g frames: error %.2g of its amplitude\n", hertz, step,
                        worst / 0.5);
            EXPECT_LT(worst, 0.5 * std::pow(pi * hertz * step / frame_rate,
                                            2.0)); // sinc^2 and the gain of the spring
        }
    Strands strands;
    std::vector<Motion> motions;
    for (uint64_t seed = 0; seed < 128; ++seed) motions.push_back(swaying(seed, 9));
    fill(strands, motions, 0.0);
    Jiggle jiggle = jiggle_of(2.0, 0.3);
    jiggle.step = 1.0;
    const JiggleWindow window = whole_from(0);
    JiggleFilter filter;
    WideVector<Wide3f> pose;
    constexpr int repeats = 200, past_samples = 20;
    double advancing = 0.0, emitting = 0.0;
    for (int r = 0; r < repeats; ++r) {
        JiggleState state;
        const auto bent = [&](int64_t past_sample, WideVector<Wide3f>& out) {
            strands.pose[1].x += 0.001F * float(past_sample);
            out = strands.pose;
        };
        filter.begin(jiggle, window, frame_rate, strands.cvs, strands.blocks);
        const auto t0 = std::chrono::steady_clock::now();
        filter.advance(state, 0, past_samples, bent);
        const auto t1 = std::chrono::steady_clock::now();
        for (int i = 0; i < past_samples; ++i)
            filter.emit(state, past_samples + 0.3 + 0.01 * i, strands, bent, pose);
        advancing += std::chrono::duration<double>(t1 - t0).count();
        emitting += std::chrono::duration<double>(std::chrono::steady_clock::now() - t1).count();
    }
    const double cvs = 128.0 * 9.0 * repeats * past_samples;
    std::printf("cost: %.2f ns a CV and past sample, %.2f ns a CV and pose\n", advancing / cvs * 1e9,
                emitting / cvs * 1e9);
}
