// SPDX-License-Identifier: Apache-2.0
// The whole chain on the same scene at other sizes and far from the origin.
#include "tests/oracle/promise.h"
#include "tests/stability/coat.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram::stability {
namespace {

struct Solved {
    std::vector<Curve> rest, pose; // in units of the ball's size, relative to its center
    long long not_finite = 0, crossed = 0;
    double length = 0.0;
    CollisionCounts counts;
};

Solved solved(const CoatSpec& spec) {
    const Coat coat(spec);
    ChainScratch scratch;
    Solved result;
    result.rest = coat.rest(coat.roots());
    result.pose = coat.poses(coat.roots(), 512, scratch)[0];
    result.counts = scratch.counts;
    for (size_t i = 0; i < result.pose.size(); ++i) {
        Curve &pose = result.pose[i], &rest = result.rest[i];
        if (!is_finite(pose)) {
            ++result.not_finite;
            continue;
        }
        result.length = std::max(result.length, worst_length(pose, rest));
        result.crossed += oracle::crossed_segments(pose, coat.triangles());
        for (Curve* curve : {&pose, &rest})
            for (Vec3d& p : *curve) p = (p - spec.place) / spec.size;
    }
    return result;
}

double deviation(const Curve& a, const Curve& b) {
    double worst = 0.0;
    for (size_t k = 0; k < a.size(); ++k) worst = std::max(worst, (a[k] - b[k]).norm());
    return worst / 0.2; // of the length
}

TEST(Scale, PowersOfTwoGiveTheSameBits) {
    const Solved one = solved({});
    for (const int power : {-30, -13, 17, 30}) {
        const Solved other = solved({.size = std::exp2(power)});
        long long differ = 0;
        double worst = 0.0;
        for (size_t i = 0; i < one.pose.size(); ++i) {
            differ += one.pose[i] != other.pose[i];
            worst = std::max(worst, deviation(one.pose[i], other.pose[i]));
        }
        char name[64];
        std::snprintf(name, sizeof name, "the chain at 2^%d times the size", power);
        row(std::string(name) + ": CVs", worst, 1e-3, "of the length");
        figure(std::string(name) + ": other bits", double(differ), "of 1500 strands");
        none(std::string(name) + ": crosses a triangle", other.crossed, "segments");
        none(std::string(name) + ": unresolved", (long long)other.counts.unresolved, "segments");
    }
}

TEST(Scale, OtherSizesScaleAlong) {
    const Solved one = solved({});
    none("the chain at size 1: crosses a triangle", one.crossed, "segments");
    none("the chain at size 1: unresolved", (long long)one.counts.unresolved, "segments");
    for (const double size : {1e-4, 1e-3, 1e-2, 0.1, 10.0, 1e2, 1e3, 1e4, 1e5}) {
        const Solved other = solved({.size = size});
        long long elsewhere = 0; // a decision was different
        double worst = 0.0;
        for (size_t i = 0; i < one.pose.size(); ++i) {
            const double d = deviation(one.pose[i], other.pose[i]);
            if (d > 1e-3)
                ++elsewhere;
            else
                worst = std::max(worst, d);
        }
        char name[64];
        std::snprintf(name, sizeof name, "the chain at %g times the size", size);
        row(std::string(name) + ": CVs", worst, 1e-3, "of the length");
        row(std::string(name) + ": strands that go another way", double(elsewhere) / double(one.pose.size()),
            0.01, "share");
        none(std::string(name) + ": crosses a triangle", other.crossed, "segments");
        none(std::string(name) + ": not finite", other.not_finite, "strands");
        none(std::string(name) + ": unresolved", (long long)other.counts.unresolved, "segments");
        row(std::string(name) + ": lengths", other.length, 1.0, "of allowed");
    }
}

TEST(Scale, FarFromTheOrigin) {
    const Solved one = solved({});
    for (const double far : {1e2, 1e3, 1e4, 1e5, 1e6, 1e7}) {
        const Solved other = solved({.place = far * Vec3d(1, -0.7, 0.4)});
        char name[64];
        std::snprintf(name, sizeof name, "the chain %g sizes from the origin", far);
        none(std::string(name) + ": not finite", other.not_finite, "strands");
        row(std::string(name) + ": lengths", other.length, 1.0, "of allowed");
        long long rests = 0;
        for (size_t i = 0; i < other.pose.size(); ++i) rests += other.pose[i] == other.rest[i];
        figure(std::string(name) + ": unresolved", double(other.counts.unresolved), "of 12000 segments");
        figure(std::string(name) + ": stand still in the wind", double(rests), "of 1500 strands");
        figure(std::string(name) + ": crosses a triangle", double(other.crossed), "segments");
    }
}

} // namespace
} // namespace marram::stability
