// SPDX-License-Identifier: Apache-2.0
// Tests of the stones layer's documentation: positions and sizes, facets, burial, displaced sand, local
// edits.
#include "procedural/terrain/sand/stones.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <vector>

namespace marram {
namespace {

// Kolmogorov-Smirnov statistic: maximum difference between the distribution of `values` and F, times the root
// of their number.
template <typename Function>
double stones_ks(std::vector<double> values, Function&& f) {
    std::sort(values.begin(), values.end());
    double worst = 0.0;
    const double n = double(values.size());
    for (size_t i = 0; i < values.size(); ++i)
        worst = std::max(
            {worst, std::abs(f(values[i]) - double(i) / n), std::abs(f(values[i]) - double(i + 1) / n)});
    return worst * std::sqrt(n);
}
constexpr double stones_ks_limit = 1.95; // exceeded by chance once in 1000

struct StonesGround {
    explicit StonesGround(const Domain& d)
        : domain(d), bedrock(d.count()), sand(d.count()), mask(d.count(), 1.0F) {}
    Fields fields() const { return {bedrock.data(), sand.data(), masks}; }
    Domain domain;
    std::vector<float> bedrock;
    std::vector<SandUnits> sand;
    std::vector<float> mask;
    std::vector<MaskView> masks;
};

struct StonesMade {
    std::vector<float> bedrock;
    std::vector<SandUnits> sand;
    bool operator==(const StonesMade&) const = default;
};

StonesMade stones_made(const TerrainLayer& layer, const StonesGround& ground) {
    StonesMade made{std::vector<float>(ground.domain.count()), std::vector<SandUnits>(ground.domain.count())};
    const std::vector<Rect> rects = Tiles(ground.domain, true).rects();
    tbb::parallel_for(size_t(0), rects.size(), [&](size_t r) {
        layer.evaluate(rects[r], ground.fields(), {made.bedrock.data(), made.sand.data(), {}});
    });
    return made;
}

// Hills with sand in their hollows.
StonesGround stones_hills(const Domain& domain) {
    StonesGround ground(domain);
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const double rock = 2.0 * std::sin(0.11 * domain.x(i)) * std::cos(0.07 * domain.z(j));
            ground.bedrock[domain.index(i, j)] = float(rock);
            ground.sand[domain.index(i, j)] = sand_units(std::max(0.0, 0.5 - rock));
        }
    return ground;
}

TEST(Stones, AreAsManyAsAskedAndAnywhere) {
    StoneSettings settings;
    settings.density = 0.2;
    const Stones stones = place_stones(settings, 0.0, {-200.0, -100.0}, {200.0, 300.0});
    EXPECT_NEAR(double(stones.list.size()), 0.2 * 400 * 400, 0.003 * 0.2 * 400 * 400);
    EXPECT_EQ(stones.too_small, 0u);
    const double side = std::sqrt(5.0);
    std::vector<double> x, z;
    for (const Stone& stone : stones.list) {
        x.push_back(stone.at.x() / side - std::floor(stone.at.x() / side));
        z.push_back(stone.at.y() / side - std::floor(stone.at.y() / side));
    }
    const auto uniform = [](double u) { return u; };
    EXPECT_LT(stones_ks(x, uniform), stones_ks_limit); // no lattice
    EXPECT_LT(stones_ks(z, uniform), stones_ks_limit);
    EXPECT_TRUE(std::is_sorted(stones.list.begin(), stones.list.end(),
                               [](const Stone& a, const Stone& b) { return a.id < b.id; }));
    // Counts in areas of 31 squares vary less than for independent positions, whose variance equals the mean.
    std::vector<double> counts(32 * 32);
    const double block = 400.0 / 32.0;
    for (const Stone& stone : stones.list)
        ++counts[size_t((stone.at.x() + 200.0) / block) + 32 * size_t((stone.at.y() + 100.0) / block)];
    const double mean = 0.2 * block * block;
    double variance = 0.0;
    for (const double count : counts) variance += (count - mean) * (count - mean) / double(counts.size());
    EXPECT_LT(variance / mean, 0.5);
    EXPECT_GT(variance / mean, 0.05);
}

TEST(Stones, SizesFollowAPowerLaw) {
    for (const double p : {0.0, 1.0, 2.0, 3.5}) {
        StoneSettings settings;
        settings.density = 1.0;
        settings.size = {0.3, 6.0};
        settings.size_power = p;
        settings.seed = 3;
        const Stones stones = place_stones(settings, 0.0, {0.0, 0.0}, {150.0, 150.0});
        std::vector<double> sizes;
        for (const Stone& stone : stones.list) sizes.push_back(stone.size);
        const auto below = [&](double size) { // fraction of smaller stones
            if (p == 0.0) return std::log(size / 0.3) / std::log(20.0);
            return (1.0 - std::pow(size / 0.3, -p)) / (1.0 - std::pow(20.0, -p));
        };
        EXPECT_LT(stones_ks(sizes, below), stones_ks_limit) << p;
        EXPECT_GE(*std::min_element(sizes.begin(), sizes.end()), 0.3);
        EXPECT_LE(*std::max_element(sizes.begin(), sizes.end()), 6.0);
        // Stones smaller than the limit are only counted.
        const Stones large = place_stones(settings, 1.0, {0.0, 0.0}, {150.0, 150.0});
        const auto count =
            size_t(std::count_if(sizes.begin(), sizes.end(), [](double s) { return s >= 1.0; }));
        EXPECT_EQ(large.list.size(), count);
        EXPECT_EQ(large.too_small, sizes.size() - count);
    }
}

TEST(Stones, DependOnSeedAndPlaceOnly) {
    StoneSettings settings;
    const Stones all = place_stones(settings, 0.6, {-150.0, -150.0}, {150.0, 150.0});
    const Stones part = place_stones(settings, 0.6, {-37.0, 10.0}, {90.5, 77.0});
    std::vector<Stone> inside;
    for (const Stone& s : all.list)
        if (s.at.x() >= -37.0 && s.at.x() < 90.5 && s.at.y() >= 10.0 && s.at.y() < 77.0) inside.push_back(s);
    EXPECT_GT(inside.size(), 100u);
    EXPECT_EQ(part.list, inside);
    settings.seed = 1;
    EXPECT_NE(place_stones(settings, 0.6, {-37.0, 10.0}, {90.5, 77.0}).list, inside);
}

TEST(Stones, TheSameBitsAtAnyThreadCountAndInAnyRectangle) {
    for (const StoneKind kind : {StoneKind::stone, StoneKind::outcrop}) {
        const StonesGround ground = stones_hills({301, 222, 0.1, -7.0, 3.0});
        StoneSettings settings;
        settings.kind = kind;
        settings.density = 0.3;
        const StonesLayer layer(settings, ground.domain);
        const StonesMade made = stones_made(layer, ground);
        EXPECT_NE(made.bedrock, ground.bedrock);
        {
            const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
            EXPECT_EQ(stones_made(StonesLayer(settings, ground.domain), ground), made);
        }
        StonesMade whole = made;
        std::fill(whole.bedrock.begin(), whole.bedrock.end(), 0.0F);
        layer.evaluate({0, 0, 301, 222}, ground.fields(), {whole.bedrock.data(), whole.sand.data(), {}});
        EXPECT_EQ(whole, made);
        for (const Rect rect : {Rect{3, 5, 77, 70}, Rect{150, 64, 151, 190}}) {
            StonesMade part = made;
            for (int j = rect.j0; j < rect.j1; ++j)
                for (int i = rect.i0; i < rect.i1; ++i) part.bedrock[ground.domain.index(i, j)] = -1.0F;
            layer.evaluate(rect, ground.fields(), {part.bedrock.data(), part.sand.data(), {}});
            EXPECT_EQ(part, made);
        }
    }
}

TEST(Stones, SandGivesWayAndTheSurfaceNeverFalls) {
    const StonesGround ground = stones_hills({256, 256, 0.1, 0.0, 0.0});
    StoneSettings settings;
    settings.density = 0.3;
    settings.burial = {0.2, 1.2}; // some completely
    const StonesMade made = stones_made(StonesLayer(settings, ground.domain), ground);
    size_t raised = 0, under = 0, bare = 0;
    SandUnits taken = 0, held = 0;
    for (size_t k = 0; k < made.sand.size(); ++k) {
        const double rise = double(made.bedrock[k]) - double(ground.bedrock[k]);
        ASSERT_GE(rise, 0.0);
        ASSERT_GE(made.sand[k], 0);
        taken += ground.sand[k] - made.sand[k];
        held += std::min(ground.sand[k], sand_units(rise)); // the sand in the height that the stone now fills
        if (rise == 0.0) {
            ASSERT_EQ(made.sand[k], ground.sand[k]);
            continue;
        }
        ++raised;
        const double before = double(ground.bedrock[k]) + sand_metres(ground.sand[k]);
        const double after = double(made.bedrock[k]) + sand_metres(made.sand[k]);
        ASSERT_GE(after, before - 1e-9);
        const double most = made.sand[k] > 0 ? before + 1e-9 : infinity; // a buried one is invisible
        ASSERT_LE(after, most);
        ++(made.sand[k] > 0 ? under : bare);
    }
    EXPECT_EQ(taken, held);
    EXPECT_GT(under, 100u);
    EXPECT_GT(bare, 100u);
    EXPECT_EQ(raised, under + bare);
}

// A stone of 4 m on level terrain, and its shape.
struct OneStone {
    double size = 0.0, top = 0.0;
    int samples = 0;
    double flat = 0.0; // fraction of samples on a facet, where second differences are small
    double wide = 0.0; // metres
};

OneStone one_stone(StoneSettings settings, uint64_t seed) {
    settings.seed = seed;
    settings.density = 1e-4;
    settings.size = {4.0, 4.0};
    const Stones all = place_stones(settings, 0.0, {-500.0, -500.0}, {500.0, 500.0});
    const Stone stone = all.list.at(all.list.size() / 2);
    const Domain domain{240, 240, 0.03, stone.at.x() - 3.6, stone.at.y() - 3.6};
    const StonesGround ground(domain);
    const StonesMade made = stones_made(StonesLayer(settings, domain), ground);
    OneStone one;
    one.size = stone.size;
    for (int j = 1; j + 1 < domain.nz; ++j)
        for (int i = 1; i + 1 < domain.nx; ++i) {
            const auto at = [&](int a, int b) { return double(made.bedrock[domain.index(a, b)]); };
            if (at(i, j) <= 0.0) continue;
            ++one.samples;
            one.top = std::max(one.top, at(i, j));
            one.wide = std::max(one.wide, (Vec2d(domain.x(i), domain.z(j)) - stone.at).norm());
            const double xx = at(i - 1, j) + at(i + 1, j) - 2.0 * at(i, j),
                         zz = at(i, j - 1) + at(i, j + 1) - 2.0 * at(i, j),
                         xz = 0.25 *
                              (at(i + 1, j + 1) + at(i - 1, j - 1) - at(i + 1, j - 1) - at(i - 1, j + 1));
            // A sphere of 4 m diameter has a curvature of 0.5 / m everywhere.
            one.flat +=
                std::max({std::abs(xx), std::abs(zz), std::abs(xz)}) < 0.1 * domain.cell * domain.cell;
        }
    one.flat /= std::max(one.samples, 1);
    return one;
}

TEST(Stones, HaveFacetsAndAreNeverBalls) {
    StoneSettings settings;
    settings.roughness = 0.0;
    settings.roundness = 0.03;
    double least = 1.0;
    for (uint64_t seed = 0; seed < 20; ++seed) {
        const OneStone stone = one_stone(settings, seed);
        least = std::min(least, stone.flat);
        EXPECT_GT(stone.samples, 1000) << seed;
        EXPECT_LE(stone.wide, 0.5 * 1.5 * 4.0) << seed;
        EXPECT_GT(stone.wide, 0.25 * 4.0) << seed;
    }
    std::printf("share of a stone that is flat: %.2f at least\n", least);
    EXPECT_GT(least, 0.5);
    settings.roundness = 1.0;
    EXPECT_LT(one_stone(settings, 0).flat, 0.2); // the measure detects a round stone
}

TEST(Stones, AreBuriedAsFarAsAsked) {
    StoneSettings settings;
    settings.roughness = 0.0;
    double shown = 0.0, half = 0.0;
    for (uint64_t seed = 0; seed < 8; ++seed) {
        settings.burial = {1.0, 1.0};
        EXPECT_EQ(one_stone(settings, seed).samples, 0) << seed;
        settings.burial = {0.0, 0.0};
        const OneStone whole = one_stone(settings, seed);
        settings.burial = {0.5, 0.5};
        const OneStone buried = one_stone(settings, seed);
        // At most 2 c, with c = 0.6 to 1 times 0.48 to 0.72 half sizes. The tilt raises it, cuts lower it.
        EXPECT_GT(whole.top, 0.6);
        EXPECT_LT(whole.top, 4.0);
        shown += whole.top, half += buried.top;
    }
    EXPECT_NEAR(half / shown, 0.45, 0.07);
}

TEST(Stones, AMaskIsTheirProbability) {
    StonesGround ground({600, 600, 0.1, 0.0, 0.0});
    ground.masks = {{"gravel", ground.mask.data()}};
    StoneSettings settings;
    settings.density = 0.25;
    settings.size = {0.45, 0.55};
    settings.burial = {0.0, 0.1};
    settings.mask = "gravel";
    const StonesLayer layer(settings, ground.domain);
    const auto there = [&](double share) { // ids of stones whose center is raised
        std::fill(ground.mask.begin(), ground.mask.end(), float(share));
        const StonesMade made = stones_made(layer, ground);
        std::vector<uint64_t> ids;
        for (const Stone& stone : layer.stones().list) {
            const auto i = size_t(std::lround(stone.at.x() / 0.1)),
                       j = size_t(std::lround(stone.at.y() / 0.1));
            if (made.bedrock[j * 600 + i] > 0.0F) ids.push_back(stone.id);
        }
        return ids;
    };
    const std::vector<uint64_t> all = there(1.0), few = there(0.3), some = there(0.5);
    EXPECT_GE(all.size(), layer.stones().list.size() * 99 / 100);
    EXPECT_TRUE(there(0.0).empty());
    const double n = double(all.size());
    EXPECT_NEAR(double(few.size()) / n, 0.3,
                0.05 + 0.02); // three standard deviations, plus stones that cover others' centers
    EXPECT_NEAR(double(some.size()) / n, 0.5, 0.05 + 0.02);
    EXPECT_TRUE(std::includes(some.begin(), some.end(), few.begin(), few.end()));
}

TEST(Stones, WhatTheGridCannotHoldIsLeftOutAndSaid) {
    const Domain domain{200, 200, 0.2, 0.0, 0.0};
    StoneSettings settings;
    settings.density = 1.0;
    settings.size = {0.2, 3.0};
    const StonesLayer layer(settings, domain);
    for (const Stone& stone : layer.stones().list) ASSERT_GE(stone.size, 0.8);
    const auto report = layer.report();
    ASSERT_EQ(report.size(), 2u);
    EXPECT_EQ(report[0], std::pair(std::string("stones"), double(layer.stones().list.size())));
    EXPECT_EQ(report[1], std::pair(std::string("too_small"), double(layer.stones().too_small)));
    EXPECT_GT(layer.stones().too_small, layer.stones().list.size());
    settings.size = {0.8, 3.0};
    EXPECT_EQ(StonesLayer(settings, domain).stones().too_small, 0u);
}

// Samples that differ lie in the set's tiles, and the set does not contain all tiles.
void expect_only_within(const Tiles& tiles, const StonesMade& a, const StonesMade& b, const Domain& domain) {
    size_t differ = 0;
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const size_t k = domain.index(i, j);
            if (a.bedrock[k] == b.bedrock[k] && a.sand[k] == b.sand[k]) continue;
            ++differ;
            ASSERT_TRUE(tiles.has(i / Tiles::side, j / Tiles::side)) << i << " " << j;
        }
    EXPECT_GT(differ, 0u);
    EXPECT_LT(tiles.count(), Tiles(domain, true).count());
}

TEST(Stones, AnEditEvaluatesItsOwnTilesOnly) {
    const StonesGround ground = stones_hills({700, 600, 0.1, 0.0, 0.0});
    const Domain& domain = ground.domain;
    StoneSettings settings;
    settings.density = 0.002;
    const StonesLayer layer(settings, domain);
    EXPECT_TRUE(StonesLayer(settings, domain).changed_since(layer, domain).none());
    const StonesMade made = stones_made(layer, ground);
    for (int edit = 0; edit < 4; ++edit) {
        StoneSettings other = settings;
        if (edit == 0) other.seed = 9;
        if (edit == 1) other.density = 0.0021;
        if (edit == 2) other.roundness = 0.5;
        if (edit == 3) other.size.y() = 3.0;
        const StonesLayer edited(other, domain);
        expect_only_within(edited.changed_since(layer, domain), made, stones_made(edited, ground), domain);
    }
    // An edit of one sample below the layer.
    StonesGround changed = ground;
    const Stone& stone = layer.stones().list.at(layer.stones().list.size() / 2);
    const int i = int(std::lround((stone.at.x() + 0.25 * stone.size) / 0.1)),
              j = int(std::lround(stone.at.y() / 0.1));
    changed.bedrock[domain.index(std::min(i, 699), std::min(j, 599))] += 1.0F;
    Tiles tiles(domain);
    tiles.add(std::min(i, 699) / Tiles::side, std::min(j, 599) / Tiles::side);
    expect_only_within(tiles.grown(layer.reach()), made, stones_made(layer, changed), domain);
    EXPECT_LT(layer.reach(), 1.1 * settings.size.y() + 0.5);
}

TEST(Stones, OutcropsHaveLedgesOfOneDip) {
    StoneSettings settings;
    settings.kind = StoneKind::outcrop;
    settings.density = 0.003;
    settings.size = {15.0, 25.0};
    settings.burial = {0.3, 0.4};
    settings.roughness = 0.04;
    settings.bed = 0.5;
    settings.dip = 10.0 * degree;
    settings.dip_direction = {0.6, 0.8};
    const StonesGround ground({700, 700, 0.1, 0.0, 0.0});
    const StonesMade made = stones_made(StonesLayer(settings, ground.domain), ground);
    // Two kinds of samples: on treads the gradient is close to that of the beds, on risers it is much
    // steeper.
    const Vec2d dip = -std::tan(settings.dip) * settings.dip_direction;
    int treads = 0, all = 0, steep = 0;
    std::vector<int> heights(20); // above the dipping plane, modulo a bed
    for (int j = 1; j < 699; ++j)
        for (int i = 1; i < 699; ++i) {
            const auto at = [&](int a, int b) { return double(made.bedrock[ground.domain.index(a, b)]); };
            if (std::min({at(i, j), at(i - 1, j), at(i + 1, j), at(i, j - 1), at(i, j + 1)}) <= 0.0) continue;
            const Vec2d gradient((at(i + 1, j) - at(i - 1, j)) / 0.2, (at(i, j + 1) - at(i, j - 1)) / 0.2);
            ++all;
            treads += (gradient - dip).norm() < 0.15;
            steep += gradient.norm() > 0.7;
            const double s = at(i, j) - dip.dot(Vec2d(ground.domain.x(i), ground.domain.z(j)));
            ++heights[size_t((s / 0.5 - std::floor(s / 0.5)) * 20.0)];
        }
    std::printf("treads %.2f, risers %.2f of %d\n", double(treads) / all, double(steep) / all, all);
    EXPECT_GT(all, 5000);
    EXPECT_GT(treads, all * 45 / 100);
    EXPECT_GT(steep, all * 5 / 100);
    // Ledges of all outcrops lie at the same levels relative to the dipping plane.
    std::sort(heights.begin(), heights.end());
    const int half = std::accumulate(heights.begin() + 10, heights.end(), 0);
    EXPECT_GT(half, all * 70 / 100);
}

TEST(Stones, StaySaneAtTheEndsOfTheirRanges) {
    for (const Domain& domain : {Domain{2, 2, 0.1, 0.0, 0.0}, Domain{1, 300, 0.1, 5.0, 5.0},
                                 Domain{90, 70, 50.0, -1e5, 0.0}, Domain{90, 70, 0.001, 0.0, 0.0}})
        for (const StoneKind kind : {StoneKind::stone, StoneKind::outcrop})
            for (const double end : {0.0, 1.0}) {
                StoneSettings settings;
                settings.kind = kind;
                settings.density = 300.0 / double(domain.count()) / (domain.cell * domain.cell);
                settings.size = Vec2d(1.0, 40.0) * 4.0 * domain.cell;
                settings.flatness = 0.9 * end, settings.tilt = 60.0 * degree * end, settings.roundness = end;
                settings.roughness = 0.3 * end, settings.burial = {0.0, end}, settings.size_power = 6.0 * end;
                settings.dip = 60.0 * degree * end, settings.bed = domain.cell;
                StonesGround ground(domain);
                for (size_t k = 0; k < ground.sand.size(); ++k) {
                    ground.bedrock[k] = float(1e3 * domain.cell * unit_double(hash(1, k)));
                    ground.sand[k] = sand_units(0.1 * domain.cell);
                }
                const StonesMade made = stones_made(StonesLayer(settings, domain), ground);
                for (size_t k = 0; k < made.sand.size(); ++k) {
                    ASSERT_GE(made.bedrock[k], ground.bedrock[k]);
                    ASSERT_LT(made.bedrock[k], float(2e3 * domain.cell));
                    ASSERT_GE(made.sand[k], 0);
                    ASSERT_LE(made.sand[k], ground.sand[k]);
                }
            }
    StoneSettings many;
    many.density = 1e6;
    EXPECT_THROW(place_stones(many, 0.0, {0.0, 0.0}, {100.0, 100.0}), SceneFault);
    many.density = 0.0;
    EXPECT_TRUE(place_stones(many, 0.0, {0.0, 0.0}, {100.0, 100.0}).list.empty());
}

TEST(Stones, Speed) {
    const StonesGround ground = stones_hills({2048, 2048, 0.1, 0.0, 0.0});
    for (const double roughness : {0.0, 0.1}) {
        StoneSettings settings;
        settings.density = 0.25;
        settings.roughness = roughness;
        const auto begin = std::chrono::steady_clock::now();
        const StonesLayer layer(settings, ground.domain);
        const auto placed = std::chrono::steady_clock::now();
        stones_made(layer, ground);
        const std::chrono::duration<double> place = placed - begin,
                                            evaluate = std::chrono::steady_clock::now() - placed;
        std::printf("%zu stones, roughness %.1f: placed in %.3f s, evaluated in %.3f s\n",
                    layer.stones().list.size(), roughness, place.count(), evaluate.count());
    }
}

} // namespace
} // namespace marram
