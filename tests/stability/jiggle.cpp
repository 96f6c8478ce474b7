// SPDX-License-Identifier: Apache-2.0
// Jiggle at the limits of its ranges: no damping, critical damping, fifty times that; frames far from the
// shot; strands of zero length.
#include "tests/oracle/jiggle.h"
#include "procedural/wind/jiggle_filter.h"
#include "tests/stability/scene.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

#include <functional>

namespace marram::stability {
namespace {

constexpr double fps = 24.0;
using Motion = std::function<Curve(double frame)>; // the bent pose

Jiggle jiggle_of(double damping, std::optional<double> start) {
    Jiggle jiggle;
    jiggle.frequency = 1.7;
    jiggle.damping = damping;
    jiggle.stiffness = Ramp(std::vector<double>{0, 3, 1, 1}, "linear");
    jiggle.start_frame = start;
    return jiggle;
}

Strands at(const std::vector<Motion>& motions, double frame) {
    std::vector<Curve> curves;
    for (const Motion& motion : motions) curves.push_back(motion(frame));
    return strands_of(curves);
}

// [time][strand]
std::vector<std::vector<Curve>> run(const Jiggle& jiggle, const std::vector<double>& times,
                                    const std::vector<Motion>& motions, double reach = 4.0) {
    const JiggleWindow window = jiggle_window(jiggle, times, fps, reach, 0.0);
    JiggleFilter filter;
    JiggleState state;
    const auto bent = [&](int64_t past_sample, WideVector<Wide3f>& pose) {
        pose = at(motions, jiggle.frame_of(past_sample)).pose;
    };
    std::vector<std::vector<Curve>> result;
    for (const double time : times) {
        const Strands now = at(motions, time);
        WideVector<Wide3f> pose;
        filter.begin(jiggle, window, fps, now.cvs, now.blocks);
        filter.advance(state, 0, time, bent);
        filter.emit(state, time, now, bent, pose);
        std::vector<Curve>& curves = result.emplace_back();
        for (int i = 0; i < now.count; ++i) curves.push_back(curve_of(now, pose, i));
    }
    return result;
}

Curve rounded(const Curve& curve) {
    Curve r;
    for (const Vec3d& p : curve) r.push_back(p.cast<float>().cast<double>());
    return r;
}

// The oracle's pose, with a history from the start of the window.
Curve right(const Jiggle& jiggle, double first, double frame, const Motion& motion) {
    oracle::History history;
    history.cubic = true;
    for (double f = first; f < frame + 2.0 * jiggle.step; f += jiggle.step) {
        history.times.push_back(f / fps);
        history.poses.push_back(rounded(motion(f)));
    }
    const Curve now = rounded(motion(frame));
    std::vector<double> omega, lengths;
    for (size_t k = 0; k < now.size(); ++k)
        omega.push_back(2.0 * pi * jiggle.frequency * jiggle.stiffness(double(k) / double(now.size() - 1)));
    for (size_t k = 0; k + 1 < now.size(); ++k) lengths.push_back((now[k + 1] - now[k]).norm());
    return oracle::restored_lengths(oracle::filtered_pose(history, omega, jiggle.damping, frame / fps), now,
                                    lengths);
}

// A strand of unit length that sways; its root stays on `root`.
Motion swaying(uint64_t seed, int cvs, const Vec3d& root = Vec3d::Zero(), double length = 1.0) {
    return [=](double frame) {
        Draw draw(seed);
        const Vec3d lean = 0.4 * draw.in_cube(), swing = 0.5 * draw.in_cube();
        const double phase = 6.0 * draw.unit(), s = std::fmod(frame, 2.4e5) / fps;
        Curve curve{root};
        for (int k = 0; k + 1 < cvs; ++k) {
            const Vec3d d =
                Vec3d::UnitY() + lean + swing * std::sin(5.0 * s + 0.3 * k + phase) * (k + 1.0) / cvs;
            curve.push_back(curve.back() + d.normalized() * (length / (cvs - 1)));
        }
        return curve;
    };
}

TEST(Jiggle, DampingOf01And50) {
    for (const double zeta : {0.0, 1e-3, 1.0, 50.0}) {
        // Damping 50 has a long memory: the time constant of its slow pole is 100 / omega.
        const Jiggle jiggle = jiggle_of(zeta, 90.0);
        const std::vector<double> times{90.0, 90.25, 97.0, 121.3, 150.0};
        std::vector<Motion> motions;
        for (uint64_t seed = 1; seed <= 3; ++seed) motions.push_back(swaying(seed, 5));
        const auto got = run(jiggle, times, motions);
        double worst = 0.0, length = 0.0;
        for (size_t t = 0; t < times.size(); ++t)
            for (size_t i = 0; i < motions.size(); ++i) {
                const Curve reference = right(jiggle, 90.0, times[t], motions[i]);
                for (size_t k = 0; k < reference.size(); ++k)
                    worst = std::max(worst, (got[t][i][k] - reference[k]).norm());
                length = std::max(length, worst_length(got[t][i], rounded(motions[i](times[t]))));
            }
        char name[64];
        std::snprintf(name, sizeof name, "jiggle, damping %g", zeta);
        row(name, worst, 1e-5, "of the length");
        row(std::string(name) + ": lengths", length, 1.0, "of allowed");
    }
}

TEST(Jiggle, FramesFarFromTheShot) {
    // The same motion, with a period of 2.4e5 frames, at frames 0, -1e4 and 1e6: equal results up to the
    // rounding of time.
    double worst = 0.0;
    for (const double zeta : {0.05, 1.0, 3.0}) {
        const Jiggle jiggle = jiggle_of(zeta, {});
        const std::vector<Motion> motions{swaying(4, 5), swaying(5, 5)};
        for (const double shift : {-1e4, 1e6}) {
            std::vector<Motion> shifted;
            for (const Motion& m : motions) shifted.push_back([=](double f) { return m(f - shift); });
            const auto near = run(jiggle, {10.0, 10.25, 10.5}, motions),
                       far = run(jiggle, {shift + 10.0, shift + 10.25, shift + 10.5}, shifted);
            for (size_t t = 0; t < near.size(); ++t)
                for (size_t i = 0; i < motions.size(); ++i)
                    for (size_t k = 0; k < 5; ++k)
                        worst = std::max(worst, (near[t][i][k] - far[t][i][k]).norm());
        }
    }
    row("jiggle at frames -1e4 and 1e6 as at 0", worst, 1e-5, "of the length");
}

TEST(Jiggle, AConstantTarget) {
    long long moved = 0;
    for (const double zeta : {0.0, 0.3, 1.0, 50.0})
        for (const double far : {0.0, 1e7}) {
            const Curve still = rounded(swaying(6, 9, Vec3d(far, 0.5 * far, -far))(3.0));
            const auto got = run(jiggle_of(zeta, zeta == 0.0 ? std::optional(0.0) : std::nullopt),
                                 {20.0, 20.5}, {[&](double) { return still; }});
            for (const auto& curves : got) moved += curves[0] != still;
        }
    none("jiggle of a constant target: other bits", moved, "strands");
}

TEST(Jiggle, StrandsOfNoLengthAndOfAbsurdSize) {
    long long not_finite = 0;
    double length = 0.0;
    for (const double zeta : {0.0, 0.3, 50.0})
        for (const double size : {0.0, 1e-37, 1e-30, 1.0, 1e7, 1e18, 1e30})
            for (const int cvs : {2, 9}) {
                std::vector<Motion> motions{swaying(7, cvs, Vec3d::Zero(), size)};
                motions.push_back([=](double f) { // not valid (a varying segment), but must be finite
                    Curve c = motions[0](f);
                    c[1] = c[0];
                    return c;
                });
                const std::vector<double> times{20.0, 20.3, 20.6};
                const auto got = run(jiggle_of(zeta, zeta == 0.0 ? std::optional(0.0) : std::nullopt), times,
                                     motions, 2.0 * size + 1e-30);
                for (size_t t = 0; t < times.size(); ++t)
                    for (size_t i = 0; i < motions.size(); ++i) {
                        not_finite += !is_finite(got[t][i]);
                        if (is_finite(got[t][i]) && size < 1e20)
                            length = std::max(length, worst_length(got[t][i], rounded(motions[i](times[t]))));
                    }
            }
    none("jiggle of strands 0 ... 1e30 m long: not finite", not_finite, "strands");
    row("jiggle of strands 0 ... 1e18 m long: lengths", length, 1.0, "of allowed");
    // A filtered strand may fold over: where it passes through a point there is no direction.
    const Motion flip = [](double f) {
        const double s = f < 10.0 ? 1.0 : -1.0;
        return Curve{{0, 0, 0}, {0, 0.5 * s, 0}, {0, s, 0}};
    };
    long long bad = 0;
    double folded = 0.0;
    for (double f = 9.5; f < 40.0; f += 0.05) {
        const Curve c = run(jiggle_of(0.1, {}), {f}, {flip})[0][0];
        bad += !is_finite(c);
        if (is_finite(c)) folded = std::max(folded, worst_length(c, flip(f)));
    }
    none("jiggle of a strand that turns over at once: not finite", bad, "poses");
    row("jiggle of a strand that turns over at once: lengths", folded, 1.0, "of allowed");
}

TEST(Jiggle, OtherMotionSamplesGiveTheSameBits) {
    long long differ = 0;
    for (const double zeta : {0.0, 0.2, 1.0, 50.0}) {
        const Jiggle jiggle = jiggle_of(zeta, zeta == 0.0 ? std::optional(90.0) : std::nullopt);
        const std::vector<Motion> motions{swaying(8, 7), swaying(9, 7), swaying(10, 7)};
        const auto alone = run(jiggle, {100.25}, motions), pair = run(jiggle, {100.0, 100.25}, motions),
                   five = run(jiggle, {100.0, 100.125, 100.25, 100.375, 100.5}, motions),
                   other = run(jiggle, {99.9, 100.25, 101.7}, motions);
        for (size_t i = 0; i < motions.size(); ++i) {
            differ += alone[0][i] != pair[1][i];
            differ += alone[0][i] != five[2][i];
            differ += alone[0][i] != other[1][i];
        }
    }
    // The window starts relative to the first motion sample: what is before it is below the tolerance, but
    // not zero.
    figure("jiggle with other motion samples: other bits", double(differ), "of 36 strands");
}

TEST(Jiggle, OtherMotionSamplesGiveTheSamePose) {
    double worst = 0.0;
    for (const double zeta : {0.0, 0.2, 1.0, 50.0}) {
        const Jiggle jiggle = jiggle_of(zeta, zeta == 0.0 ? std::optional(90.0) : std::nullopt);
        const std::vector<Motion> motions{swaying(8, 7), swaying(9, 7), swaying(10, 7)};
        const auto alone = run(jiggle, {100.25}, motions),
                   other = run(jiggle, {99.9, 100.25, 101.7}, motions);
        for (size_t i = 0; i < motions.size(); ++i)
            for (size_t k = 0; k < 7; ++k) worst = std::max(worst, (alone[0][i][k] - other[1][i][k]).norm());
    }
    row("jiggle with other motion samples", worst, 1e-5, "of the length");
}

} // namespace
} // namespace marram::stability
