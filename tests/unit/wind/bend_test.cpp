// SPDX-License-Identifier: Apache-2.0
// Compares curve wind with a literal implementation of the talk: all points behind P_k are turned, segment by
// segment, in O(n^2), in double precision, with Eigen's quaternions. Also checks invariants for any wind.
#include "procedural/wind/bend.h"
#include "procedural/wind/chain.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <cfloat>
#include <cstdio>
#include <cstring>

using namespace marram;

namespace {

using Curve = std::vector<Vec3d>;

Strands strands_of(const std::vector<Curve>& curves) {
    Strands strands;
    strands.resize(int(curves.size()), int(curves[0].size()), false);
    for (int i = 0; i < strands.blocks * lanes; ++i) {
        const Curve& curve = curves[std::min(size_t(i), curves.size() - 1)];
        for (size_t k = 0; k < curve.size(); ++k) {
            Wide3f& cv = strands.rest[size_t(i / lanes) * curve.size() + k];
            cv.x[i % lanes] = float(curve[k].x());
            cv.y[i % lanes] = float(curve[k].y());
            cv.z[i % lanes] = float(curve[k].z());
        }
        Wide3d& noise_origin = strands.noise_origin[size_t(i / lanes)];
        noise_origin.x[i % lanes] = double(float(curve[0].x()));
        noise_origin.y[i % lanes] = double(float(curve[0].y()));
        noise_origin.z[i % lanes] = double(float(curve[0].z()));
    }
    return strands;
}

Curve curve_of(const Strands& strands, const WideVector<Wide3f>& cvs, int i) {
    Curve curve;
    for (int k = 0; k < strands.cvs; ++k) {
        const Wide3f& cv = cvs[size_t(i / lanes) * size_t(strands.cvs) + size_t(k)];
        curve.emplace_back(double(cv.x[i % lanes]), double(cv.y[i % lanes]), double(cv.z[i % lanes]));
    }
    return curve;
}

// A random strand of n CVs, seeded by a hash: a random walk with drift, total length `length`.
Curve random_curve(uint64_t seed, int n, double length, const Vec3d& root) {
    const auto draw = [&](uint64_t i) { return 2.0 * unit_double(hash(seed, i)) - 1.0; };
    Curve curve{root};
    Vec3d direction(draw(0), draw(1), draw(2));
    for (int k = 1; k < n; ++k) {
        direction += 0.8 * Vec3d(draw(3 * uint64_t(k)), draw(3 * uint64_t(k) + 1), draw(3 * uint64_t(k) + 2));
        curve.push_back(curve.back() + direction.normalized() * (length / (n - 1)));
    }
    return curve;
}

Vec3d noise_at(const Wind& wind, const Vec3d& root, double arc, double seconds) {
    const Vec3d p = root + wind.direction * (arc * wind.waviness - wind.speed * seconds);
    const Wide3d point{splat(p.x()), splat(p.y()), splat(p.z())};
    Wide3f value;
    vector_noise(wind.noise, &point, 1, wind.evolution != 0.0, wind.evolution * seconds, &value);
    return Vec3d(double(value.x[0]), double(value.y[0]), double(value.z[0])) * wind.noise_amplitude;
}

// The talk's algorithm, literally.
Curve literal_bend(const Wind& wind, const Curve& rest, double envelope, double seconds) {
    Curve curve = rest;
    const size_t n = rest.size();
    std::vector<double> arc(n, 0.0);
    for (size_t k = 1; k < n; ++k) arc[k] = arc[k - 1] + (rest[k] - rest[k - 1]).norm();
    const double reference = wind.reference_segments > 0 ? wind.reference_segments : double(n - 1);
    for (size_t k = 0; k + 1 < n; ++k) {
        const Vec3d to_tip = curve[n - 1] - curve[k];
        const Vec3d to_wind = wind.direction + noise_at(wind, rest[0], arc[k], seconds);
        double f =
            std::clamp(wind.global_rotate * wind.ramp_rotate(arc[k] / arc[n - 1]) * envelope, 0.0, 1.0);
        const double span =
            wind.reference_segments == 0 ? arc[k + 1] - arc[k] : 0.5 * (arc[k + 1] - arc[k > 0 ? k - 1 : 0]);
        f = 1.0 - std::pow(1.0 - f, reference * span / arc[n - 1]);
        const Vec3d axis = to_tip.cross(to_wind);
        const double angle = std::atan2(axis.norm(), to_tip.dot(to_wind));
        if (axis.norm() == 0.0) continue;
        const Eigen::AngleAxisd q(f * angle, axis.normalized());
        for (size_t j = k + 1; j < n; ++j) curve[j] = curve[k] + q * (curve[j] - curve[k]);
    }
    return curve;
}

double length_of(const Curve& curve) {
    double sum = 0.0;
    for (size_t k = 1; k < curve.size(); ++k) sum += (curve[k] - curve[k - 1]).norm();
    return sum;
}

// Largest change of a segment's length, in units of accuracy.md's bound: <= 1 passes.
double length_error(const Curve& rest, const Curve& pose) {
    double worst = 0.0;
    for (size_t k = 1; k < rest.size(); ++k) {
        const double before = (rest[k] - rest[k - 1]).norm(), after = (pose[k] - pose[k - 1]).norm();
        const double largest = std::max(pose[k].cwiseAbs().maxCoeff(), pose[k - 1].cwiseAbs().maxCoeff());
        const double ulp = double(std::nextafter(float(largest), FLT_MAX)) - double(float(largest));
        worst = std::max(worst, std::abs(after - before) / (1e-5 * before + 2.0 * ulp));
    }
    return worst;
}

bool all_finite(const Curve& curve) {
    return std::ranges::all_of(curve, [](const Vec3d& p) { return p.allFinite(); });
}

Wind strong_wind() {
    Wind wind;
    wind.direction = Vec3d(1.0, 0.2, -0.4).normalized();
    wind.speed = 5.0;
    wind.response = Ramp(std::vector<double>{0, 0, 5, 1}, "linear");
    wind.global_rotate = 0.8;
    wind.ramp_rotate = Ramp(std::vector<double>{0, 0.3, 1, 1}, "smooth");
    wind.noise_amplitude = 0.7;
    wind.noise.frequency = 2.0;
    wind.noise.octaves = 2;
    return wind;
}

void run(const Wind& wind, Strands& strands, double frame = 10.0) {
    MarramFrame instant{};
    instant.fps = 24.0;
    instant.time_count = 1;
    instant.times = &frame;
    instant.stage = MARRAM_FINAL;
    const Ramp whole;

    ChainScratch scratch;
    run_chain(make_chain_frame({wind, whole, instant, nullptr, {}, MARRAM_BSPLINE}), 0, strands, scratch);
}

} // namespace

TEST(Bend, AgreesWithTheTalkWordByWord) {
    const Wind base = strong_wind();
    double worst = 0.0;
    for (const int n : {2, 3, 5, 8, 33}) {
        for (const int reference : {0, 4, 64}) {
            Wind wind = base;
            wind.reference_segments = reference;
            std::vector<Curve> curves;
            for (uint64_t i = 0; i < 403; ++i) // not a multiple of eight
                curves.push_back(
                    random_curve(hash(uint64_t(n), i), n, 0.3, Vec3d(double(i % 20), 0.0, double(i / 20))));
            Strands strands = strands_of(curves);
            run(wind, strands);
            for (int i = 0; i < strands.count; ++i) {
                const Curve rest = curve_of(strands, strands.rest, i),
                            pose = curve_of(strands, strands.pose, i);
                const Curve expected = literal_bend(wind, rest, wind_response(wind) * wind.calm, 10.0 / 24.0);
                for (size_t k = 0; k < rest.size(); ++k)
                    worst = std::max(worst, (pose[k] - expected[k]).norm() / length_of(rest));
            }
        }
    }
    std::printf("greatest CV distance: %.3g of the length\n", worst);
    EXPECT_LT(worst, 1e-5);
}

TEST(Bend, KeepsLengthsAtAnyStrengthAndPlace) {
    double worst = 0.0;
    for (const double amplitude : {0.0, 1.0, 1e3})
        for (const double far : {0.0, 1e3, 1e5})
            for (const double scale : {1e-4, 1.0, 1e5})
                for (const int n : {2, 5, 1000}) {
                    Wind wind = strong_wind();
                    wind.noise_amplitude = amplitude;
                    wind.global_rotate = 1.0;
                    wind.speed = 1e4;
                    wind.noise.frequency /= scale;
                    std::vector<Curve> curves;
                    for (uint64_t i = 0; i < 64; ++i)
                        curves.push_back(
                            random_curve(i + 77, n, 0.3 * scale, Vec3d(far, -far, 0.5 * far) * scale));
                    Strands strands = strands_of(curves);
                    run(wind, strands);
                    for (int i = 0; i < strands.count; ++i) {
                        const Curve pose = curve_of(strands, strands.pose, i);
                        ASSERT_TRUE(all_finite(pose));
                        worst = std::max(worst, length_error(curve_of(strands, strands.rest, i), pose));
                    }
                }
    std::printf("greatest change of a segment: %.3f of the bound\n", worst);
    EXPECT_LT(worst, 1.0);
}

TEST(Bend, NoWindIsTheRestPoseBitForBit) {
    std::vector<Curve> curves;
    for (uint64_t i = 0; i < 100; ++i) curves.push_back(random_curve(i, 9, 0.1, Vec3d(1000.0, 3.0, 7.0)));
    for (const bool by_envelope : {false, true}) {
        Wind wind = strong_wind();
        Strands strands = strands_of(curves);
        if (by_envelope) {
            std::ranges::fill(strands.envelope, VFloat{});
            bend(wind, 3.0, 24.0, strands);
        } else {
            wind.speed = 0.0;
            run(wind, strands);
        }
        EXPECT_EQ(
            0, std::memcmp(strands.rest.data(), strands.pose.data(), strands.rest.size() * sizeof(Wide3f)));
    }
}

// The result scales with the scene, from 0.1 mm to 100 km.
TEST(Bend, ScalesAlongWithTheScene) {
    const Wind base = strong_wind();
    const Curve curve = random_curve(5, 9, 1.0, Vec3d::Zero());
    Strands unit = strands_of({curve});
    run(base, unit);
    for (const double scale : {0x1p-14, 0x1p17, 0x1p-80, 0x1p80}) { // powers of two: floats scale exactly
        Wind wind = base;
        wind.noise.frequency /= scale;
        wind.speed *= scale; // the distance the field travels
        wind.response = Ramp(std::vector<double>{0, 0, 5.0 * scale, 1}, "linear");
        Curve scaled = curve;
        for (Vec3d& p : scaled) p *= scale;
        Strands strands = strands_of({scaled});
        run(wind, strands);
        const Curve expected = curve_of(unit, unit.pose, 0), pose = curve_of(strands, strands.pose, 0);
        for (size_t k = 0; k < pose.size(); ++k)
            EXPECT_LT((pose[k] / scale - expected[k]).norm(), 1e-5) << scale;
    }
}

TEST(Bend, OpposedWindIsFiniteAndDecidedByTheStrand) {
    Wind wind = strong_wind();
    wind.direction = Vec3d::UnitX();
    wind.ramp_rotate = Ramp();
    for (const double amplitude : {0.0, 0.5})
        for (const double off : {0.0, 1e-30, 1e-12, 1e-9, 1e-7, 1e-5}) {
            wind.noise_amplitude = amplitude;
            Curve straight;
            for (int k = 0; k < 6; ++k) straight.emplace_back(-0.1 * k, off * k, 0.0);
            Strands strands = strands_of({straight});
            run(wind, strands);
            const Curve pose = curve_of(strands, strands.pose, 0);
            ASSERT_TRUE(all_finite(pose));
            EXPECT_LT(length_error(curve_of(strands, strands.rest, 0), pose), 1.0);
            EXPECT_GT((pose.back() - straight.back()).norm(), 0.05) << "it must turn, whichever way";
        }
    // A strand that leans towards +y against the wind falls to +y, one that leans towards -y falls to -y.
    wind.noise_amplitude = 0.0;
    for (const double side : {1.0, -1.0}) {
        const Curve bowed = {{0, 0, 0}, {-0.1, -0.02 * side, 0}, {-0.2, -0.01 * side, 0}, {-0.3, 0, 0}};
        Strands strands = strands_of({bowed});
        run(wind, strands);
        EXPECT_GT(curve_of(strands, strands.pose, 0).back().y() * side, 0.05);
    }
}

TEST(Bend, DegenerateStrandsDoNotMoveOrBreak) {
    const Wind wind = strong_wind();
    const Curve point(5, Vec3d(1.0, 2.0, 3.0));
    Curve doubled = random_curve(3, 5, 0.2, Vec3d::Zero());
    doubled[2] = doubled[1]; // a segment of zero length
    doubled[4] = doubled[3];
    Curve closed = random_curve(4, 5, 0.2, Vec3d::Zero());
    closed[4] = closed[0]; // root and tip coincide: no direction to the tip
    Curve tiny = random_curve(6, 5, 1e-30, Vec3d::Zero()), huge = random_curve(6, 5, 1e15, Vec3d::Zero());
    Strands strands = strands_of({point, doubled, closed, tiny, huge});
    run(wind, strands);
    for (int i = 0; i < strands.count; ++i) {
        const Curve pose = curve_of(strands, strands.pose, i);
        ASSERT_TRUE(all_finite(pose)) << i;
        EXPECT_LT(length_error(curve_of(strands, strands.rest, i), pose), 1.0) << i;
    }
    EXPECT_EQ(curve_of(strands, strands.pose, 0), curve_of(strands, strands.rest, 0));
}

// The same strand with 5, 9, 17 and 65 CVs: with reference_segments the poses converge with the square of
// their number.
TEST(Bend, MoreCvsShowTheSamePose) {
    Wind wind = strong_wind();
    wind.direction = Vec3d::UnitX();
    wind.noise_amplitude = 0.0;
    wind.ramp_rotate = Ramp();
    wind.global_rotate = 0.5;
    const auto tip = [&](int segments, int reference) {
        wind.reference_segments = reference;
        Curve straight;
        for (int k = 0; k <= segments; ++k) straight.emplace_back(0.0, double(k) / segments, 0.0);
        Strands strands = strands_of({straight});
        run(wind, strands);
        return curve_of(strands, strands.pose, 0).back();
    };
    const Vec3d fine = tip(256, 4);
    double before = 1.0;
    for (const int segments : {4, 8, 16, 64}) {
        const double distance = (tip(segments, 4) - fine).norm();
        std::printf("%2d segments: %.4f L from 256\n", segments, distance);
        EXPECT_LT(distance, before);
        before = (segments == 16 ? 0.1 : 0.4) * distance;
    }
    EXPECT_LT(before / 0.4, 0.0005);
    EXPECT_GT((tip(64, 0) - tip(4, 0)).norm(), 0.3)
        << "without it the poses differ, or this test shows nothing";
}

TEST(Bend, NoiseTravelsWithTheWindAndLoopsClose) {
    Wind wind = strong_wind();
    const Curve curve = random_curve(9, 6, 0.4, Vec3d::Zero());
    // The field at the root now reaches a downwind point when the wind has travelled there.
    const double seconds = 0.5;
    Curve downwind = curve;
    for (Vec3d& p : downwind) p += wind.direction * (wind.speed * seconds);
    Strands here = strands_of({curve}), there = strands_of({downwind});
    run(wind, here, 24.0);
    run(wind, there, 24.0 + 24.0 * seconds);
    const Curve a = curve_of(here, here.pose, 0), b = curve_of(there, there.pose, 0);
    for (size_t k = 0; k < a.size(); ++k) EXPECT_LT((b[k] - b[0] - (a[k] - a[0])).norm(), 1e-5);

    wind.loops = true;
    wind.loop_begin = 1.0;
    wind.loop_end = 49.0;
    wind.evolution = 0.3;
    for (const NoiseType type : {NoiseType::perlin, NoiseType::billow, NoiseType::wavelet}) {
        wind.noise.type = type;
        Strands first = strands_of({curve}), last = first, next = first, middle = first;
        run(wind, first, 1.0);
        run(wind, last, 49.0);
        run(wind, next, 97.0);
        run(wind, middle, 20.0);
        const size_t bytes = first.pose.size() * sizeof(Wide3f);
        EXPECT_EQ(0, std::memcmp(first.pose.data(), last.pose.data(), bytes));
        EXPECT_EQ(0, std::memcmp(first.pose.data(), next.pose.data(), bytes));
        EXPECT_NE(0, std::memcmp(first.pose.data(), middle.pose.data(), bytes));
        Strands before = strands_of({curve});
        run(wind, before, 48.999);
        EXPECT_LT((curve_of(before, before.pose, 0).back() - curve_of(first, first.pose, 0).back()).norm(),
                  1e-3);
    }
}

TEST(Bend, ExtremeFramesStayFinite) {
    Wind wind = strong_wind();
    wind.evolution = 7.0;
    for (const NoiseType type : {NoiseType::perlin, NoiseType::billow, NoiseType::wavelet})
        for (const double frame : {-1e4, 1e6, 1e9, 1e15}) {
            wind.noise.type = type;
            Strands strands = strands_of({random_curve(1, 8, 0.3, Vec3d::Zero())});
            run(wind, strands, frame);
            EXPECT_TRUE(all_finite(curve_of(strands, strands.pose, 0))) << frame;
            EXPECT_LT(length_error(curve_of(strands, strands.rest, 0), curve_of(strands, strands.pose, 0)),
                      1.0);
        }
}
