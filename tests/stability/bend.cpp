// SPDX-License-Identifier: Apache-2.0
// Curve wind where directions vanish, are opposite, or have extreme lengths.
#include "procedural/wind/bend.h"
#include "tests/oracle/bend.h"
#include "tests/stability/scene.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

namespace marram::stability {
namespace {

Wind wind_along(const Vec3d& direction, double global_rotate = 1.0) {
    Wind wind;
    wind.direction = direction;
    wind.global_rotate = global_rotate;
    return wind;
}

// Bent curves; rounds the rest curves to float.
std::vector<Curve> bent(const Wind& wind, std::vector<Curve>& rest, float envelope = 1.0F,
                        double frame = 1.0) {
    Strands strands = strands_of(rest);
    std::fill(strands.envelope.begin(), strands.envelope.end(), splat_float(envelope));
    bend(wind, frame, 24.0, strands);
    std::vector<Curve> curves;
    for (int i = 0; i < strands.count; ++i) {
        rest[size_t(i)] = rest_of(strands, i);
        curves.push_back(pose_of(strands, i));
    }
    return curves;
}

double largest(const Curve& curve) {
    double m = 0.0;
    for (const Vec3d& p : curve) m = std::max(m, p.cwiseAbs().maxCoeff());
    return m;
}
double length_of(const Curve& curve) {
    double sum = 0.0;
    for (size_t k = 0; k + 1 < curve.size(); ++k) sum += (curve[k + 1] - curve[k]).stableNorm();
    return sum;
}
double angle_between(const Vec3d& a, const Vec3d& b) {
    const Vec3d u = a.stableNormalized(), v = b.stableNormalized();
    return std::atan2(u.cross(v).norm(), u.dot(v));
}

// Largest CV error against the oracle, relative to the tolerance in accuracy.md: 1e-5 of the length plus two
// ulps. Infinity if not finite.
double against_oracle(const Wind& wind, const Curve& rest, const Curve& pose, double envelope) {
    if (!is_finite(pose)) return std::numeric_limits<double>::infinity();
    oracle::Bend reference;
    reference.wind = wind.direction;
    reference.global_rotate = wind.global_rotate;
    reference.ramp_rotate = wind.ramp_rotate;
    reference.envelope.assign(rest.size(), envelope);
    reference.reference_segments = double(rest.size() - 1);
    reference.own_spans = true;
    const Curve right = oracle::bend_curve(rest, reference);
    const double allowed =
        1e-5 * length_of(rest) + 0x1p-22 * std::max(largest(rest), largest(pose)) + 1e-45; // smallest float
    double worst = 0.0;
    for (size_t k = 0; k < rest.size(); ++k)
        worst = std::max(worst, (pose[k] - right[k]).stableNorm() / allowed);
    return worst;
}

struct Worst {
    double pose = 0.0, length = 0.0;
};
Worst compare(const Wind& wind, std::vector<Curve> rest, float envelope = 1.0F) {
    Worst worst;
    const std::vector<Curve> poses = bent(wind, rest, envelope);
    for (size_t i = 0; i < rest.size(); ++i) {
        worst.pose = std::max(worst.pose, against_oracle(wind, rest[i], poses[i], double(envelope)));
        worst.length = std::max(worst.length, is_finite(poses[i]) ? worst_length(poses[i], rest[i])
                                                                  : std::numeric_limits<double>::infinity());
    }
    return worst;
}
void report_worst(const std::string& name, const Worst& worst) {
    row(name + ": pose", worst.pose, 1.0, "of allowed");
    row(name + ": lengths", worst.length, 1.0, "of allowed");
}
void take(Worst& worst, const Worst& other) {
    worst.pose = std::max(worst.pose, other.pose);
    worst.length = std::max(worst.length, other.length);
}

std::vector<Curve> many(uint64_t seed, int count, int cvs, double length, const Vec3d& root = Vec3d::Zero()) {
    Draw draw(seed);
    std::vector<Curve> curves;
    for (int i = 0; i < count; ++i)
        curves.push_back(wandering(draw, root, draw.direction(), length, cvs, i % 2 == 0 ? 0.3 : 1.0));
    return curves;
}

TEST(Bend, WindAgainstTheStrand) {
    // A straight strand turns within one plane; in any plane its angles to the wind equal the oracle's.
    for (const double off : {0.0, 1e-15, 1e-12, 1e-9, 1e-8, 1e-7}) {
        double angle = 0.0, length = 0.0;
        for (const int cvs : {2, 3, 9, 64})
            for (const float envelope : {0.1F, 0.5F, 1.0F})
                for (const Vec3d& up : {y, x, Vec3d(Vec3d(1, 2, 3).normalized()), Vec3d(-1e-3, 1, 0)}) {
                    Vec3d side, other;
                    orthonormal_basis<double>(up.normalized(), side, other);
                    const Wind wind = wind_along((-up.normalized() + off * side).normalized());
                    std::vector<Curve> rest{straight(Vec3d::Zero(), up.normalized() / (cvs - 1), cvs)};
                    const Curve pose = bent(wind, rest, envelope)[0];
                    ASSERT_TRUE(is_finite(pose));
                    oracle::Bend reference;
                    reference.wind = wind.direction;
                    reference.envelope.assign(size_t(cvs), double(envelope));
                    const Curve right = oracle::bend_curve(straight(Vec3d::Zero(), y / (cvs - 1), cvs), [&] {
                        oracle::Bend b = reference;
                        b.wind = Vec3d(std::sin(pi - off), std::cos(pi - off), 0);
                        return b;
                    }());
                    for (size_t k = 0; k + 1 < pose.size(); ++k) {
                        const double is = angle_between(pose[k + 1] - pose[k], wind.direction);
                        const double was = angle_between(right[k + 1] - right[k],
                                                         Vec3d(std::sin(pi - off), std::cos(pi - off), 0));
                        // Float storage: 2 ulp of a coordinate of 1, over the segment's length.
                        angle = std::max(angle, std::abs(is - was) / (1e-6 + 0x1p-22 * (cvs - 1)));
                    }
                    length = std::max(length, worst_length(pose, rest[0]));
                }
        char name[64];
        std::snprintf(name, sizeof name, "wind against the strand, off by %g", off);
        row(std::string(name) + ": angle (1e-6 rad + 2 ulp)", angle, 1.0, "of allowed");
        row(std::string(name) + ": lengths", length, 1.0, "of allowed");
    }
}

TEST(Bend, WindAgainstCurvedStrands) {
    // The tip is exactly upwind but the strand is curved: its own bend defines the axis, and f = 1 puts the
    // tip downwind.
    double length = 0.0, tip = 0.0;
    for (const double bow : {1e-6, 1e-3, 0.1, 0.4}) {
        std::vector<Curve> rest{{{0, 0, 0}, {bow, 0.25, 0}, {bow, 0.5, 0}, {bow, 0.75, 0}, {0, 1, 0}}};
        const Curve pose = bent(wind_along(-y), rest)[0];
        ASSERT_TRUE(is_finite(pose));
        length = std::max(length, worst_length(pose, rest[0]));
        tip = std::max(tip, angle_between(pose[1] - pose[0], rest[0][0] - rest[0][1]));
        EXPECT_LT(std::abs(pose[4].z()), 1e-6) << "turned out of its own plane";
    }
    row("wind against curved strands: lengths", length, 1.0, "of allowed");
    row("wind against curved strands: root turns by pi", tip, 1e-5, "rad");
}

TEST(Bend, ZeroWind) {
    long long moved = 0;
    for (const int which : {0, 1, 2}) {
        std::vector<Curve> rest = many(5, 64, 9, 1.0);
        const Wind wind = wind_along(which == 0 ? Vec3d(Vec3d::Zero()) : x, which == 1 ? 0.0 : 1.0);
        const std::vector<Curve> poses = bent(wind, rest, which == 2 ? 0.0F : 1.0F);
        for (size_t i = 0; i < rest.size(); ++i) moved += poses[i] != rest[i];
    }
    none("zero wind: strands that moved", moved, "strands");
}

TEST(Bend, SegmentsOfNoLengthTinyAndHuge) {
    Worst zero, tiny, huge, mixed;
    for (const float envelope : {0.3F, 1.0F}) {
        const Wind wind = wind_along(Vec3d(1, 0.2, -0.3).normalized());
        std::vector<Curve> gaps = many(6, 32, 9, 1.0);
        for (size_t i = 0; i < gaps.size(); ++i) {
            Curve& c = gaps[i];
            c[1 + i % 8] = c[i % 8]; // one segment of zero length, including the first and the last
            if (i % 3 == 0) c[3] = c[2] = c[1];
        }
        take(zero, compare(wind, gaps, envelope));
        take(tiny, compare(wind, many(7, 32, 9, 1e-30), envelope));
        take(tiny, compare(wind, many(7, 32, 5, 1e-37), envelope));
        take(huge, compare(wind, many(8, 32, 9, 1e6), envelope));
        take(huge, compare(wind, many(8, 32, 9, 1e18), envelope));
        take(huge, compare(wind, many(8, 32, 9, 1e30), envelope));
        std::vector<Curve> steps = many(9, 32, 4, 1.0);
        for (Curve& c : steps) {
            c[1] = c[0] + 1e-30 * (c[1] - c[0]);
            c[2] = c[1] + (c[2] - c[1]);
            c[3] = c[2] + 1e12 * (c[3] - c[2]).normalized();
        }
        take(mixed, compare(wind, steps, envelope));
    }
    report_worst("segments without length", zero);
    report_worst("segments of 1e-30", tiny);
    report_worst("segments of 1e6 ... 1e30", huge);
    report_worst("segments of 1e-30 beside 1e12", mixed);
}

TEST(Bend, AllCvsInOnePoint) {
    long long moved = 0;
    for (const double at : {0.0, 1.0, 1e7}) {
        std::vector<Curve> rest(20, Curve(7, Vec3d(at, -at, 0.5 * at)));
        const std::vector<Curve> poses = bent(wind_along(x), rest);
        for (size_t i = 0; i < rest.size(); ++i) moved += poses[i] != rest[i];
    }
    none("all CVs in one point: strands that moved", moved, "strands");
}

TEST(Bend, TwoAndAThousandCvsNearAndFar) {
    const Wind wind = wind_along(Vec3d(0.3, -0.5, 1).normalized());
    report_worst("n = 2", compare(wind, many(10, 64, 2, 1.0), 0.6F));
    report_worst("n = 1000", compare(wind, many(11, 16, 1000, 1.0), 0.002F));
    for (const double far : {1e3, 1e4, 1e5, 1e6, 1e7}) {
        char name[64];
        std::snprintf(name, sizeof name, "bend %g from the origin", far);
        report_worst(name, compare(wind, many(12, 64, 9, 1.0, Vec3d(far, -0.7 * far, 0.3 * far)), 0.6F));
    }
}

TEST(Bend, FramesFarFromTheShot) {
    double length = 0.0;
    for (const NoiseType type : {NoiseType::perlin, NoiseType::billow, NoiseType::wavelet})
        for (const double frame : {-1e4, 1e6, 1e12, -1e30})
            for (const double evolution : {0.0, 1.7}) {
                Wind wind = wind_along(x, 0.8);
                wind.speed = 9.0;
                wind.noise_amplitude = 2.0;
                wind.noise.type = type;
                wind.noise.octaves = 4;
                wind.evolution = evolution;
                std::vector<Curve> rest = many(13, 64, 9, 1.0);
                const std::vector<Curve> poses = bent(wind, rest, 1.0F, frame);
                for (size_t i = 0; i < rest.size(); ++i)
                    length = std::max(length, is_finite(poses[i]) ? worst_length(poses[i], rest[i])
                                                                  : std::numeric_limits<double>::infinity());
            }
    row("frames -1e4, 1e6, 1e12, -1e30: lengths", length, 1.0, "of allowed");
}

} // namespace
} // namespace marram::stability
