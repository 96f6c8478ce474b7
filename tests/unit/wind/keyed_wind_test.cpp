// SPDX-License-Identifier: Apache-2.0
// The way of the air when speed and direction have keys, against closed forms and against sums of many small steps.
#include "procedural/wind/keyed_wind.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <numbers>
#include <string>
#include <vector>

using namespace marram;

namespace {

constexpr auto linear = KeyInterpolation::linear, smooth = KeyInterpolation::smooth,
               constant = KeyInterpolation::constant;
const Vec3d along(0.6, 0.0, 0.8);

Keyframes directions(std::vector<double> frames, const std::vector<Vec3d>& list,
                     KeyInterpolation interpolation = linear) {
    Keyframes keys{std::move(frames), {}, interpolation};
    for (const Vec3d& d : list)
        for (const double x : d.normalized()) keys.numbers.push_back(x);
    return keys;
}

// Kahan's sum of the midpoint rule, with many steps between any two keys.
Vec3d brute_force(const AirPath& path, double begin, double end, int steps) {
    Vec3d sum = Vec3d::Zero(), lost = Vec3d::Zero();
    const double h = (end - begin) / steps;
    for (int i = 0; i < steps; ++i) {
        const double t = begin + (i + 0.5) * h;
        const Vec3d term = path.speed(t) * path.direction(t) * h - lost, next = sum + term;
        lost = (next - sum) - term;
        sum = next;
    }
    return sum;
}

TEST(AirPath, IsExactForSpeedsAtAllInterpolations) {
    // keys 2 -> 9 in frames 10 to 34, then 9 -> 3 to frame 60
    for (const KeyInterpolation how : {linear, smooth, constant}) {
        const AirPath path(0.0, along, Keyframes{{10, 34, 60}, {2, 9, 3}, how}, {});
        const auto way = [&](double t) { // the closed form
            double d = 2.0 * std::min(t, 10.0);
            const auto between = [&](double a, double b, double v, double w) {
                const double s = std::clamp((t - a) / (b - a), 0.0, 1.0);
                const double eased = how == linear   ? 0.5 * s * s
                                     : how == smooth ? s * s * s - 0.5 * s * s * s * s
                                                     : 0.0;
                return (b - a) * (v * s + (w - v) * eased);
            };
            if (t > 10.0) d += between(10, 34, 2, 9);
            if (t > 34.0) d += between(34, 60, 9, 3);
            if (t > 60.0) d += 3.0 * (t - 60.0);
            return d;
        };
        for (double t = -50.0; t < 120.0; t += 0.37)
            ASSERT_LT((path.displacement(t) - along * way(t)).norm(), 1e-12 * std::abs(way(t)) + 1e-13) << t;
        EXPECT_NEAR(path.speed(22), how == constant ? 2.0 : 5.5, 1e-14); // half way
    }
}

TEST(AirPath, IsStraightToTheBitUntilSomethingChanges) {
    const AirPath same(0.0, along, Keyframes{{5, 24, 30}, {3.7, 3.7, 8}, linear}, {});
    for (double t = -1000.0; t <= 24.0; t += 7.3) {
        EXPECT_TRUE(same.is_steady_until(t));
        EXPECT_EQ(same.displacement(t), Vec3d(3.7 * along * t));
        EXPECT_EQ(same.direction(t), along);
    }
    EXPECT_FALSE(same.is_steady_until(24.01));
    EXPECT_NEAR((same.displacement(24.0 + 1e-9) - same.displacement(24.0)).norm(), 3.7e-9, 1e-12);
    const AirPath never(2.0, along, Keyframes{{1, 2}, {2, 2}, linear}, {});
    EXPECT_TRUE(never.is_steady_until(1e12));
}

// Quarter turns, almost a reversal, a full turn, with a speed that changes at other frames.
TEST(AirPath, IsExactWhereTheDirectionTurns) {
    const double nearly = 179.9 / 180.0 * std::numbers::pi;
    const std::vector<std::pair<const char*, Keyframes>> cases = {
        {"quarter", directions({1, 24}, {{1, 0, 0}, {0, 0, 1}})},
        {"quarter, smooth", directions({1, 24}, {{1, 0, 0}, {0, 1, 1}}, smooth)},
        {"full turn", directions({1, 20, 30, 70}, {{1, 0, 0}, {-1, 0, 2}, {-1, 0, -2}, {1, 0, 0}})},
        {"nearly reversed", directions({1, 24}, {{1, 0, 0}, {std::cos(nearly), 0, std::sin(nearly)}})},
    };
    for (const auto& [name, turns] : cases) {
        const AirPath path(0.0, {}, Keyframes{{-3, 7.5, 15, 40}, {1, 8, 2, 5}, smooth}, turns);
        double most = 0.0;
        for (const double t : {1.5, 9.0, 12.4999, 12.5001, 15.0, 33.0, 90.0}) {
            // in parts, so that no step straddles a key
            const std::array breaks = {1.0, 7.5, 15.0, 20.0, 24.0, 30.0, 40.0, 70.0};
            Vec3d sum = path.displacement(1.0);
            double from = 1.0, way = 0.0;
            const auto add = [&](double to) {
                sum += brute_force(path, from, to, 400000);
                way += (to - from) * 8.0;
                from = to;
            };
            for (const double b : breaks)
                if (b > from && b < t) add(b);
            add(t);
            most = std::max(most, (path.displacement(t) - sum).norm() / way);
        }
        std::printf("%s: %.2g of the way\n", name, most);
        EXPECT_LT(most, 1e-9) << name; // the sums are good to 1e-10
    }
}

// Where keys are dense and late, the rounding of frames must not halve pieces without end.
TEST(AirPath, HasFewPiecesForManyKeys) {
    for (const double from : {1.0, 2400.0, 1e6}) {
        Keyframes turns{{}, {}, linear}, speeds{{}, {}, linear};
        for (int i = 0; i < 8760; ++i) {
            const double angle = 0.7 * std::sin(i * 12.9898);
            turns.frames.push_back(from + i * (240.0 / 8760));
            turns.numbers.insert(turns.numbers.end(), {std::cos(angle), 0.0, std::sin(angle)});
            speeds.frames.push_back(turns.frames.back());
            speeds.numbers.push_back(5.0 + 4.0 * std::sin(i * 78.233));
        }
        EXPECT_LT(AirPath(0.0, {}, speeds, turns).piece_count(), 5U * 8760U) << from;
    }
}

// The way does not depend on where it is asked for: parts add up.
TEST(AirPath, AddsUp) {
    const AirPath path(4.0, {}, {}, directions({1, 24, 48}, {{1, 0, 0}, {0, 0, 1}, {-1, 0, 0.1}}));
    const Vec3d whole = path.displacement(48.0) - path.displacement(1.0);
    Vec3d sum = Vec3d::Zero();
    for (int i = 0; i < 47 * 64; ++i)
        sum += path.displacement(1.0 + (i + 1) / 64.0) - path.displacement(1.0 + i / 64.0);
    EXPECT_LT((sum - whole).norm(), 1e-10);
    for (double t = 1.0; t < 50.0;
         t += 0.01) // no faster than the wind, and hardly slower over so short a way
        EXPECT_NEAR((path.displacement(t + 1e-3) - path.displacement(t)).norm(), 4e-3, 1e-8) << t;
}

TEST(Keyframes, AreExactAtKeysAndConstantBeyond) {
    const Keyframes keys{{1, 3, 7}, {1, 10, 2, 20, 4, 80}, linear};
    std::array<double, 2> at{};
    for (size_t k = 0; k < 3; ++k) {
        keys.at(keys.frames[k], at);
        EXPECT_TRUE(std::ranges::equal(at, keys.key(k)));
    }
    keys.at(-5, at);
    EXPECT_TRUE(std::ranges::equal(at, keys.key(0)));
    keys.at(1e9, at);
    EXPECT_TRUE(std::ranges::equal(at, keys.key(2)));
    keys.at(5, at);
    EXPECT_EQ(at[1], 50.0);
}

// Each parameter that declares that it may have keys has a place where they are read.
TEST(KeyedWind, KnowsEveryKeyableParameter) {
    size_t keyable = 0;
    std::vector<MarramValue> values;
    std::deque<std::string> names;
    std::deque<std::vector<double>> numbers;
    const std::array<double, 2> frames = {1, 10};
    std::deque<MarramKeyframes> keys;
    Wind wind;
    wind.response = Ramp(std::array{0.0, 0.0, 10.0, 1.0}, "linear");
    wind.gusts.emplace().controls.emplace_back();
    wind.fields.emplace_back();
    wind.jiggle.emplace().start_frame = 0.0;
    wind.shielding.emplace();
    wind.collision.emplace();
    for (const MarramParam& param : wind_params()) {
        if (!param.keyable) continue;
        ++keyable;
        std::string name = "wind." + std::string(param.name);
        if (const size_t list = name.find("[]"); list != std::string::npos) name.insert(list + 1, "0");
        const size_t count = param.type == MARRAM_VEC3 ? 3 : param.type == MARRAM_RAMP ? 4 : 1;
        std::vector<double>& two = numbers.emplace_back(2 * count, 0.5);
        if (param.type == MARRAM_RAMP) two = {0, 1, 1, 0.5, 0, 0.2, 1, 2};
        if (name == "wind.response") two = {0, 0, 1, 0.5, 0, 0, 1, 0.5};
        if (param.type == MARRAM_VEC3) two = {1, 0, 0, 0, 0, 1};
        two.back() += 0.25;
        keys.push_back({sizeof(MarramKeyframes), 2, frames.data(), two.data(), "linear"});
        MarramValue& value = values.emplace_back();
        value.name = names.emplace_back(name).c_str();
        value.type = param.type;
        value.numbers = two.data();
        value.number_count = count;
        value.text = "linear";
        value.place = "";
        value.keyframes = &keys.back();
    }
    read_keys(Values(values), wind);
    ASSERT_TRUE(wind.keys);
    EXPECT_EQ(wind.keys->tracks.size(), keyable);
    EXPECT_GE(keyable, 13U);
    const Wind first = wind_at(wind, -3.0), middle = wind_at(wind, 5.5), last = wind_at(wind, 99.0);
    EXPECT_EQ(first.direction, Vec3d::UnitX());
    EXPECT_LT((middle.direction - Vec3d(1, 0, 1).normalized()).norm(), 1e-15);
    EXPECT_NEAR(middle.speed, 0.625, 1e-15);
    EXPECT_EQ(last.speed, 0.75);
    EXPECT_EQ(last.gusts->controls[0].strength, 0.75);
    EXPECT_EQ(wind.jiggle->frequency, 0.5); // the longest memory
    EXPECT_EQ(wind.speed, 0.75);            // the strongest wind
    EXPECT_EQ(last.ramp_rotate(1.0), 2.25);
}

} // namespace
