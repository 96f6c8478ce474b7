// SPDX-License-Identifier: Apache-2.0
// A CV's target g(s) is its bent position at time s, in world space; it includes the motion of the root. CV k
// of n follows it as a damped oscillator, in x, y and z alike,
//
//     x'' + 2 zeta omega x' + omega^2 x = omega^2 g(s),       omega = 2 pi frequency stiffness(k / (n - 1))
//
// with g piecewise linear between samples at absolute multiples of a step. For such a g the solution below is
// exact.
//
// In the angle tau = omega s, let w = dx/dtau and e = x - g, the lag. While g moves by D over a step of tau
// radians,
//
//     de/dtau = w - D / tau          dw/dtau = -e - 2 zeta w
//
// Both e and w are continuous at samples, so they are the whole state. A static target has D = 0, and e = w =
// 0 stays exactly 0. Let S be the homogeneous solution with S(0) = 0, S'(0) = 1, and C = S' + 2 zeta S (C(0)
// = 1, C' = -S).
//
//     e1 = C e0 + S w0 - F D         w1 = -S e0 + S' w0 + G D
//     F = mean of C over the step = (S + 2 zeta (1 - C)) / tau      G = mean of S over the step = (1 - C) / tau
//
// S in closed form, p = sqrt(1 - zeta^2), q = sqrt(zeta^2 - 1), poles a = 1 / (zeta + q) <= 1 <= b = zeta +
// q:
//
//     zeta < 1    S = e^(-zeta tau) sin(p tau) / p                  S' = e^(-zeta tau) cos(p tau) - zeta S
//     zeta >= 1   S = e^(-a tau) (1 - e^(-2 q tau)) / (2 q)         S' = e^(-b tau) - a S
//
// sin(x) / x and (1 - e^-x) / x are smooth at 0, so both forms hold up to zeta = 1 and agree there. For zeta
// >= 1 also C = e^(-a tau) + a S, F = (1 - e^(-a tau)) / (a tau) + a G and G = a ((1 - e^(-a tau)) / (a tau)
// - S / tau): no large terms cancel. For b tau <= 1 the power series is summed instead, to keep the accuracy
// of G.
//
// Length of the window. x(t) is the integral of omega S(omega sigma) g(t - sigma) over sigma > 0. Taking the
// target as constant before the window's first sample, T ago, changes g by at most `reach` there, and x by at
// most reach * tail(omega T), where
//
//     tail(X) = integral of |S| from X to infinity
//             = C(X)                                                                       zeta >= 1, exactly: S > 0
//             <= e^(-zeta X) min(1 / (zeta p), (1 + zeta X) / zeta^2)                      zeta < 1
//
// from |sin| <= 1 and from |sin x| <= x. The first bound is that of chain.md. The second stays finite at zeta
// = 1, where it equals the exact (1 + X) e^-X. The bound decreases with omega: the CV with the lowest
// stiffness decides.
//
// The pose at t: offsets from the root are x_k = linear offset at t + lag. They start at the root at t. From
// root to tip each segment takes its direction from x_k+1 - x_k and its length from the rest strand at t.
//
// Step. A sinusoid of frequency f, linear between samples h apart, keeps the fraction (sin(pi f h) / (pi f
// h))^2 of its amplitude: the loss grows with the square of the step. Half a frame at 24 fps loses 1 % at 2.6
// Hz, whole frames lose it at 1.3 Hz. A groom tests a few of its strands to find the step that its tolerance
// allows (procedural/strands/pilot.h).
#include "procedural/wind/jiggle.h"

#include "procedural/abi/param.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

namespace marram {
namespace {

constexpr double initial_damping = 0.3;
constexpr double default_window_tolerance = 1e-6; // of the reach, if no tolerance is given
constexpr double max_past_samples =
    1e5; // each costs a bend of every strand: with more, a frame would take hours

// The difference of two filtered points is good to about 1e-14 of the strand, 1e-11 of one of 1000 segments.
// Below this fraction of the segment's length its direction has less than two digits.
constexpr double min_direction_ratio = 1e-9;

// Lags below this are set to 0 before they decay into slow subnormal numbers; no float can hold them (the
// smallest is 1e-45 m).
constexpr double min_lag = 1e-60;

constexpr std::array jiggle_values = {
    param::number("jiggle.frequency", "Hz", "none", 0, 1e9,
                  "natural frequency of the spring where stiffness is 1; 0 or absent: no jiggle"),
    param::number("jiggle.damping", "", "none", 0, 1e3,
                  "damping ratio: below 1 strands overshoot, at 0 they never come to rest; default: 0.3"),
    param::ramp("jiggle.stiffness", "", "none", 0, 1e9,
                "scale of the frequency from root (0) to tip (1); default: [[0, 4], [1, 1]]"),
    param::number("jiggle.step", "frames", "none", 1e-3, 1e3,
                  "time between samples of the past; default: as long as the tolerance allows",
                  "0.125|0.25|0.5|1|2", "seconds.jiggle"),
    param::number("jiggle.start_frame", "frames", "none", -1e7, 1e7,
                  "strands stay in their bent pose until this frame; required if damping is 0"),
};

[[noreturn]] void refuse(const Values& values, const char* name, const std::string& what,
                         const std::string& remedy) {
    throw SceneFault("jiggle.setting", values.at(name).place, what, remedy);
}

void refuse_without_frequency(const Values& values) {
    for (const MarramParam& param : jiggle_values) {
        const std::string name = std::string("wind.") + param.name;
        if (values.has(name))
            refuse(values, name.c_str(), std::string(param.name) + " has no effect without jiggle.frequency",
                   "add it in Hz, such as jiggle.frequency = 2");
    }
}

// (1 - e^-x) / x
double decay_mean(double x) { return x > 0.0 ? -std::expm1(-x) / x : 1.0; }

// The power series of S = sum s_n tau^n / n!, s_n+2 = -2 zeta s_n+1 - s_n, and its integrals. For b tau <= 1
// term n is below 1 / n!.
JiggleStep series_step(double damping, double tau) {
    constexpr int terms = 20;               // 1 / 20! = 4e-19
    double s0 = 0.0, s1 = 1.0, power = 1.0; // s_n, s_n+1, tau^n / n!
    double s = 0.0, d = 0.0, g = 0.0;
    for (int n = 0; n < terms; ++n) {
        s += s0 * power;
        d += s1 * power;
        g += s0 * power / double(n + 1);
        const double s2 = -2.0 * damping * s1 - s0;
        s0 = s1;
        s1 = s2;
        power *= tau / double(n + 1);
    }
    const double mean_d = tau > 0.0 ? s / tau : 1.0;
    return {1.0 - tau * g, s, d, mean_d + 2.0 * damping * g, g};
}

JiggleStep underdamped_step(double damping, double tau) { // zeta < 1
    const double p = std::sqrt((1.0 - damping) * (1.0 + damping));
    const double decay = std::exp(-damping * tau), angle = p * tau;
    const double s = decay * tau * (angle > 0.0 ? std::sin(angle) / angle : 1.0);
    const double d = decay * std::cos(angle) - damping * s;
    const double c = d + 2.0 * damping * s;
    const double g = (1.0 - c) / tau;
    return {c, s, d, s / tau + 2.0 * damping * g, g};
}

JiggleStep overdamped_step(double damping, double tau) { // zeta >= 1
    const double q = std::sqrt((damping - 1.0) * (damping + 1.0)), b = damping + q, a = 1.0 / b;
    const double slow = std::exp(-a * tau), mean_s = slow * decay_mean(2.0 * q * tau);
    const double s = tau * mean_s, mean_slow = decay_mean(a * tau);
    const double g = a * (mean_slow - mean_s);
    return {slow + a * s, s, std::exp(-b * tau) - a * s, mean_slow + a * g, g};
}

double min_stiffness(const Ramp& stiffness) { // minimum over the strand
    double least = std::min(stiffness(0.0), stiffness(1.0));
    for (size_t i = 0; i < stiffness.positions().size(); ++i)
        if (stiffness.positions()[i] > 0.0 && stiffness.positions()[i] < 1.0)
            least = std::min(least, stiffness.values()[i]);
    return least;
}

// The smallest angle whose tail is below `share`, to 0.1 %, rounded up.
double window_radians(double damping, double share) {
    if (!(jiggle_tail(damping, 0.0) > share)) return 0.0;
    double low = 0.0, high = 1.0;
    while (jiggle_tail(damping, high) > share && high < 1e300) {
        low = high;
        high *= 2.0;
    }
    while (high - low > 1e-3 * high) {
        const double middle = 0.5 * (low + high);
        (jiggle_tail(damping, middle) > share ? low : high) = middle;
    }
    return high;
}

MARRAM_INLINE Wide3d without_subnormals(const Wide3d& a, const Wide3d& b) {
    const VDouble zero{};
    return {select(vabs(a.x) + vabs(b.x) < min_lag, zero, a.x),
            select(vabs(a.y) + vabs(b.y) < min_lag, zero, a.y),
            select(vabs(a.z) + vabs(b.z) < min_lag, zero, a.z)};
}

MARRAM_INLINE WideJiggleStep wide(const JiggleStep& step) {
    return {splat(step.c), splat(step.s), splat(step.d), splat(step.f), splat(step.g)};
}
MARRAM_INLINE const WideJiggleStep& wide(const WideJiggleStep& step) { return step; }

// Advances the state of a block from one past sample to the next.
template <typename Step>
MARRAM_INLINE void advance_cvs(const Step* steps, int cvs, const Wide3f* from, const Wide3f* to, Wide3d* lag,
                               Wide3d* velocity) {
    for (int k = 1; k < cvs; ++k) {
        const WideJiggleStep step = wide(steps[k]);
        const Wide3d moved = to_double(to[k]) - to_double(from[k]);
        const Wide3d e = lag[k], w = velocity[k];
        const Wide3d e1 = e * step.c + w * step.s - moved * step.f;
        const Wide3d w1 = w * step.d - e * step.s + moved * step.g;
        lag[k] = without_subnormals(e1, w1);
        velocity[k] = without_subnormals(w1, e1);
    }
}

MARRAM_HOT void advance_block(const JiggleStep* steps, int cvs, const Wide3f* from, const Wide3f* to,
                              Wide3d* lag, Wide3d* velocity) {
    advance_cvs(steps, cvs, from, to, lag, velocity);
}
MARRAM_HOT void advance_block(const WideJiggleStep* steps, int cvs, const Wide3f* from, const Wide3f* to,
                              Wide3d* lag, Wide3d* velocity) {
    advance_cvs(steps, cvs, from, to, lag, velocity);
}

template <typename Step>
struct EmitView { // one block
    int cvs;
    const Step* steps; // from the previous past sample to the time of the pose
    double share;      // fraction of the way from that sample to the next
    const Wide3f *from, *to, *rest;
    const Wide3d *lag, *velocity;
    Wide3f* pose;
};

MARRAM_INLINE VLong differ(const Wide3d& a, const Wide3d& b) {
    return (a.x != b.x) | (a.y != b.y) | (a.z != b.z);
}

// v scaled to `length`, or `instead` if v is too short to have a direction.
MARRAM_INLINE Wide3d scaled_to(const Wide3d& v, VDouble length, const Wide3d& instead) {
    const VDouble norm = vsqrt(dot(v, v));
    const VLong good = norm > min_direction_ratio * length;
    return select(good, v * (length / select(good, norm, 1.0)), instead);
}

template <typename Step>
MARRAM_INLINE void emit_cvs(const EmitView<Step>& block) {
    const Wide3d from_root = to_double(block.from[0]), to_root = to_double(block.to[0]);
    Wide3d position = to_double(block.rest[0]), rest = position;
    Wide3d filtered{}, target{}; // offsets of CV k from the root
    VLong moves = differ(from_root, to_root) | differ(from_root, position);
    block.pose[0] = block.rest[0];
    for (int k = 1; k < block.cvs; ++k) {
        const WideJiggleStep step = wide(block.steps[k]);
        const Wide3d from = to_double(block.from[k]), to = to_double(block.to[k]);
        const Wide3d moved = (to - from) * splat(block.share);
        const Wide3d lag = block.lag[k] * step.c + block.velocity[k] * step.s - moved * step.f;
        moves |= differ(from, to) | differ(lag, Wide3d{});

        const Wide3d from_offset = from - from_root;
        const Wide3d next_target = from_offset + ((to - to_root) - from_offset) * splat(block.share);
        const Wide3d next_filtered = next_target + lag, next_rest = to_double(block.rest[k]);
        const Wide3d segment = next_rest - rest;
        const VDouble length = vsqrt(dot(segment, segment));
        const Wide3d target_segment = scaled_to(next_target - target, length, segment);
        position = position + scaled_to(next_filtered - filtered, length, target_segment);
        block.pose[k] = to_float(position);
        filtered = next_filtered;
        target = next_target;
        rest = next_rest;
    }
    if (!any(~moves)) return;
    // Strands that have never moved are copied from the target bit for bit.
    const VInt still = low_32_bits(~moves);
    for (int k = 1; k < block.cvs; ++k) {
        const Wide3f &to = block.to[k], &pose = block.pose[k];
        block.pose[k] = {still ? to.x : pose.x, still ? to.y : pose.y, still ? to.z : pose.z};
    }
}

MARRAM_HOT void emit_block(const EmitView<JiggleStep>& block) { emit_cvs(block); }
MARRAM_HOT void emit_block(const EmitView<WideJiggleStep>& block) { emit_cvs(block); }

// n rotated by the shortest arc from unit a onto unit b. If they are opposed to within 1e-12 (where the axis
// is only good to 1e-4 and getting worse) n is kept.
MARRAM_INLINE Wide3d turned(const Wide3d& n, const Wide3d& a, const Wide3d& b) {
    const Wide3d axis = cross(a, b);
    const VDouble c = 1.0 + dot(a, b);
    const VLong opposed = c < 1e-12;
    const VDouble along = dot(axis, n) / select(opposed, 1.0, c);
    return select(opposed, n, n * (c - 1.0) + cross(axis, n) + axis * along);
}

MARRAM_HOT void normals_block(int cvs, const Wide3f* bent, const Wide3f* bent_normal, const Wide3f* pose,
                              Wide3f* normal) {
    for (int k = 0; k < cvs; ++k) {
        const int start = std::min(k, cvs - 2); // the tip uses the last segment
        const Wide3d a = to_double(bent[start + 1]) - to_double(bent[start]);
        const Wide3d b = to_double(pose[start + 1]) - to_double(pose[start]);
        const VDouble aa = dot(a, a), bb = dot(b, b);
        const VLong turns = differ(a, b) & (aa > 0.0) & (bb > 0.0);
        const Wide3d unit_a = a * (1.0 / vsqrt(select(turns, aa, 1.0)));
        const Wide3d unit_b = b * (1.0 / vsqrt(select(turns, bb, 1.0)));
        const Wide3d n = to_double(bent_normal[k]);
        normal[k] = to_float(select(turns, turned(n, unit_a, unit_b), n));
    }
}

} // namespace

std::span<const MarramParam> jiggle_params() { return jiggle_values; }

std::optional<Jiggle> read_jiggle(const Values& values) {
    if (!values.has("wind.jiggle.frequency")) {
        refuse_without_frequency(values);
        return std::nullopt;
    }
    if (values.number("wind.jiggle.frequency") == 0.0) return std::nullopt; // a groom may switch it off
    Jiggle jiggle;
    jiggle.place = values.at("wind.jiggle.frequency").place;
    jiggle.frequency = values.number("wind.jiggle.frequency");
    const auto number_or = [&](const char* name, double initial) {
        return values.has(name) ? values.number(name) : initial;
    };
    jiggle.damping = number_or("wind.jiggle.damping", initial_damping);
    jiggle.step = number_or("wind.jiggle.step", 0.0);
    constexpr std::array initial_stiffness = {0.0, 4.0, 1.0, 1.0};
    jiggle.stiffness = values.has("wind.jiggle.stiffness") ? values.ramp("wind.jiggle.stiffness")
                                                           : Ramp(initial_stiffness, "linear");
    for (const double value : jiggle.stiffness.values())
        if (!(value > 0.0))
            refuse(values, "wind.jiggle.stiffness", "jiggle.stiffness is not above 0 everywhere",
                   "it scales the frequency, keep it positive");
    if (values.has("wind.jiggle.start_frame")) jiggle.start_frame = values.number("wind.jiggle.start_frame");
    if (jiggle.damping == 0.0 && !jiggle.start_frame)
        refuse(values, "wind.jiggle.damping",
               "jiggle.damping = 0 needs a start: the oscillation never decays",
               "give jiggle.start_frame, or some damping");
    return jiggle;
}

JiggleStep jiggle_step(double damping, double radians) {
    const double fastest = damping > 1.0 ? 2.0 * damping : 1.0; // pole, b < 2 zeta
    if (radians * fastest <= 1.0) return series_step(damping, radians);
    return damping < 1.0 ? underdamped_step(damping, radians) : overdamped_step(damping, radians);
}

double jiggle_tail(double damping, double radians) {
    if (damping >= 1.0) return jiggle_step(damping, radians).c;
    const double p = std::sqrt((1.0 - damping) * (1.0 + damping)), x = damping * radians;
    return std::exp(-x) * std::min(1.0 / p, (1.0 + x) / damping) / damping;
}

JiggleWindow jiggle_window(const Jiggle& jiggle, std::span<const double> times, double fps, double reach,
                           double tolerance) {
    const double share = tolerance > 0.0 ? tolerance / reach : default_window_tolerance;
    const double omega = 2.0 * pi * jiggle.frequency * min_stiffness(jiggle.stiffness);
    const double memory = reach > 0.0 ? window_radians(jiggle.damping, share) / omega * fps : 0.0; // frames
    const double first_time = times.front() - memory, last_time = times.back();

    double first = std::floor(first_time / jiggle.step), last = std::ceil(last_time / jiggle.step);
    if (first * jiggle.step > first_time) first -= 1.0; // if the division was rounded across a sample
    if (last * jiggle.step < last_time) last += 1.0;
    if (jiggle.start_frame) {
        const double start = std::floor(*jiggle.start_frame / jiggle.step);
        if (last_time < start * jiggle.step) return {};
        first = std::max(first, start);
    }
    if (!(last - first < max_past_samples))
        throw SceneFault("jiggle.too_long", jiggle.place,
                         "jiggle needs more than " + std::to_string(int(max_past_samples)) +
                             " samples of past frames",
                         "give more jiggle.damping, a higher frequency, a longer "
                         "jiggle.step, or a later jiggle.start_frame");
    return {int64_t(first), int64_t(last)};
}

void JiggleFilter::begin(const Jiggle& jiggle, double fps, int cvs, int blocks, std::span<const VDouble> u) {
    jiggle_ = jiggle;
    fps_ = fps;
    cvs_ = cvs;
    blocks_ = blocks;
    fed_ = 0;
    const size_t size = size_t(blocks) * size_t(cvs);
    lag_.assign(size, Wide3d{});
    velocity_.assign(size, Wide3d{});
    from_.resize(size);
    to_.resize(size);
    u_.clear();
    const bool same_everywhere = std::ranges::all_of(
        jiggle.stiffness.values(), [&](double value) { return value == jiggle.stiffness.values()[0]; });
    if (!same_everywhere) u_.assign(u.begin(), u.end());
    if (u_.empty())
        fill_steps(jiggle.step, whole_);
    else
        fill_steps(jiggle.step, strand_full_steps_);
}

void JiggleFilter::fill_steps(double frames, std::vector<JiggleStep>& steps) const {
    steps.resize(size_t(cvs_));
    for (int k = 1; k < cvs_; ++k) {
        const double omega = 2.0 * pi * jiggle_.frequency * jiggle_.stiffness(double(k) / double(cvs_ - 1));
        steps[size_t(k)] = jiggle_step(jiggle_.damping, omega * (frames / fps_));
    }
}

void JiggleFilter::fill_steps(double frames, WideVector<WideJiggleStep>& steps) const {
    steps.resize(u_.size());
    for (size_t i = 0; i < u_.size(); ++i)
        for (int lane = 0; lane < lanes; ++lane) {
            const double omega = 2.0 * pi * jiggle_.frequency * jiggle_.stiffness(u_[i][lane]);
            const JiggleStep step = jiggle_step(jiggle_.damping, omega * (frames / fps_));
            WideJiggleStep& eight = steps[i];
            eight.c[lane] = step.c;
            eight.s[lane] = step.s;
            eight.d[lane] = step.d;
            eight.f[lane] = step.f;
            eight.g[lane] = step.g;
        }
}

void JiggleFilter::feed(int64_t past_sample, const Strands& bent) {
    assert(bent.cvs == cvs_ && bent.blocks == blocks_ && (fed_ == 0 || past_sample == last_ + 1));
    if (fed_ == 2) {
        for (int i = 0; i < blocks_; ++i) {
            const size_t first = size_t(i) * size_t(cvs_);
            if (u_.empty())
                advance_block(whole_.data(), cvs_, &from_[first], &to_[first], &lag_[first],
                              &velocity_[first]);
            else
                advance_block(&strand_full_steps_[first], cvs_, &from_[first], &to_[first], &lag_[first],
                              &velocity_[first]);
        }
    }
    std::swap(from_, to_);
    std::copy(bent.pose.begin(), bent.pose.end(), to_.begin());
    if (fed_ == 0) {
        std::copy(bent.pose.begin(), bent.pose.end(), from_.begin());
        first_ = past_sample;
    }
    last_ = past_sample;
    fed_ = std::min(fed_ + 1, 2);
}

void JiggleFilter::emit(double frame, const Strands& now, WideVector<Wide3f>& pose) {
    assert(now.cvs == cvs_ && now.blocks == blocks_);
    pose.resize(now.pose.size());
    const double begin = jiggle_.frame_of(last_ - 1), end = jiggle_.frame_of(last_);
    if (fed_ == 0 || frame < jiggle_.frame_of(first_)) {
        std::copy(now.pose.begin(), now.pose.end(), pose.begin());
        return;
    }
    // A single sample counts as the end of a step without motion.
    const double share = std::clamp((frame - begin) / (end - begin), 0.0, 1.0);
    if (u_.empty())
        fill_steps(share * jiggle_.step, part_);
    else
        fill_steps(share * jiggle_.step, strand_partial_steps_);
    for (int i = 0; i < blocks_; ++i) {
        const size_t first = size_t(i) * size_t(cvs_);
        const auto emit = [&](const auto* steps) {
            emit_block({cvs_, steps, share, &from_[first], &to_[first], &now.rest[first], &lag_[first],
                        &velocity_[first], &pose[first]});
        };
        if (u_.empty())
            emit(part_.data());
        else
            emit(&strand_partial_steps_[first]);
    }
}

void jiggle_normals(const Strands& now, const WideVector<Wide3f>& pose, WideVector<Wide3f>& normals) {
    normals.resize(now.pose_normal.size());
    for (int i = 0; i < now.blocks; ++i) {
        const size_t first = size_t(i) * size_t(now.cvs);
        normals_block(now.cvs, &now.pose[first], &now.pose_normal[first], &pose[first], &normals[first]);
    }
}

} // namespace marram
