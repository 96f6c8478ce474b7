// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/sand/ripples.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <cstdio>
#include <cstring>

namespace marram {
namespace {

constexpr double wavelength = 0.11, repose = 34.0 * degree;
const RippleSettings settings{wavelength, 0.008, repose, 7};

Vec2d heading(double angle) { return {std::cos(angle), std::sin(angle)}; }

// A plane with its gradient (uphill) towards `uphill`.
Vec2d incline(double slope, double uphill) { return std::tan(slope) * heading(uphill); }

// A ridge of sand along z with a windward side of 10 degrees and a slip face of 33, on a thin sheet.
struct Ridge {
    Domain domain{512, 192, wavelength / 8.0, -2.0, 1.0};
    std::vector<float> bedrock = std::vector<float>(domain.count(), 1.0F);
    std::vector<SandUnits> sand = std::vector<SandUnits>(domain.count());
    std::vector<float> mask = std::vector<float>(domain.count(), 1.0F);
    std::vector<MaskView> views;

    static constexpr double crest = 1.5, high = 0.5, flat = 0.12; // metres
    static double height(double x) {
        const double up = high + (x - crest) * std::tan(10.0 * degree),
                     down = high - (x - crest) * std::tan(33.0 * degree);
        return std::max(std::min(up, down), 0.0);
    }
    Ridge() {
        for (int j = 0; j < domain.nz; ++j)
            for (int i = 0; i < domain.nx; ++i)
                sand[domain.index(i, j)] = sand_units(flat + height(domain.x(i)));
        views = {{"m", mask.data()}};
    }
    Fields fields() const { return {bedrock.data(), sand.data(), views}; }
};

std::vector<SandUnits> evaluate(const RipplesLayer& layer, const Domain& d, const Fields& below,
                                int width = Tiles::side) {
    std::vector<SandUnits> sand(d.count(), -1);
    tbb::parallel_for(0, (d.nz + width - 1) / width, [&](int row) {
        for (int i = 0; i < d.nx; i += width)
            layer.evaluate({i, row * width, std::min(i + width, d.nx), std::min((row + 1) * width, d.nz)},
                           below, {nullptr, sand.data(), {}});
    });
    return sand;
}

TEST(Ripples, LayerSparesLeeAndSlipFaceAndKeepsSand) {
    const Ridge ridge;
    const Domain& d = ridge.domain;
    const RipplesLayer layer({settings, Vec2d::UnitX(), 30.0, ""}, d);
    const auto sand = evaluate(layer, d, ridge.fields());
    double lee = 0.0, windward = 0.0, far = 0.0, added = 0.0, moved = 0.0;
    const double foot = Ridge::crest + Ridge::high / std::tan(33.0 * degree);
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) {
            const size_t at = d.index(i, j);
            const double more = sand_metres(sand[at] - ridge.sand[at]), x = d.x(i);
            ASSERT_GE(sand[at], 0);
            ASSERT_LE(std::abs(more), 0.0045);
            added += more, moved += std::abs(more);
            if (x > Ridge::crest + 0.15 && x < foot + 1.5 * Ridge::high) lee = std::max(lee, std::abs(more));
            if (x < Ridge::crest - 0.3 && x > -1.0) windward = std::max(windward, std::abs(more));
            if (x > Ridge::crest + 7.0 * Ridge::high) far = std::max(far, std::abs(more));
        }
    std::printf("greatest: windward %.2f mm, in the lee %.2f, behind it %.2f; volume %.4f of what is moved\n",
                1e3 * windward, 1e3 * lee, 1e3 * far, added / moved);
    EXPECT_EQ(lee, 0.0);
    EXPECT_GT(windward, 0.0035);
    EXPECT_GT(far, 0.0035);
    EXPECT_LT(std::abs(added), 0.01 * moved);
}

TEST(Ripples, LayerIsTheFieldOnAPlane) {
    Ridge plane;
    const Domain& d = plane.domain;
    const Vec2d gradient = incline(12.0 * degree, 100.0 * degree);
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) {
            plane.bedrock[d.index(i, j)] = float(gradient.dot(Vec2d(d.x(i), d.z(j))));
            plane.sand[d.index(i, j)] = sand_units(0.5);
        }
    const RipplesLayer layer({settings, heading(0.3), 30.0, ""}, d);
    const auto sand = evaluate(layer, d, plane.fields());
    const RippleField field(settings);
    double worst = 0.0; // including borders
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) {
            const double asked =
                field.displacement({{d.x(i), d.z(j)}, heading(0.3), gradient, 1.0}) / std::cos(12.0 * degree);
            worst = std::max(worst, std::abs(sand_metres(sand[d.index(i, j)]) - 0.5 - asked));
        }
    EXPECT_LT(worst, 1e-5);
}

TEST(Ripples, LayerNeverTakesMoreThanThereIs) {
    Ridge thin;
    for (size_t k = 0; k < thin.sand.size(); ++k) {
        thin.sand[k] = sand_units(0.006 * unit_double(hash(4, k)) * unit_double(hash(5, k)));
        if (k % 5 == 0) thin.sand[k] = 0;
        if (k % 7 == 0) thin.mask[k] = 0.0F;
    }
    const RipplesLayer layer({settings, Vec2d::UnitX(), 30.0, "m"}, thin.domain);
    const auto sand = evaluate(layer, thin.domain, thin.fields());
    int changed = 0;
    for (size_t k = 0; k < sand.size(); ++k) {
        ASSERT_GE(sand[k], 0);
        changed += sand[k] != thin.sand[k];
        ASSERT_TRUE(sand[k] == thin.sand[k] || (k % 5 != 0 && k % 7 != 0));
    }
    EXPECT_GT(changed, 1000);
}

TEST(Ripples, LayerReachIsHonestAndBitsDoNotDependOnTheCut) {
    const Ridge ridge;
    const Domain& d = ridge.domain;
    const RipplesLayer layer({settings, heading(0.4), 1.5, ""}, d);
    const auto whole = evaluate(layer, d, ridge.fields());
    EXPECT_TRUE(evaluate(layer, d, ridge.fields(), 17) == whole);
    EXPECT_TRUE(evaluate(layer, d, ridge.fields(), 1000) == whole);
    {
        const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
        EXPECT_TRUE(evaluate(layer, d, ridge.fields()) == whole);
    }
    double furthest = 0.0;
    for (const auto& [i, j] :
         {std::pair(30, 90), std::pair(0, 0), std::pair(511, 191), std::pair(505, 3), std::pair(60, 100)}) {
        Ridge other;
        other.sand[d.index(i, j)] += sand_units(2.0);
        const auto after = evaluate(layer, d, other.fields());
        for (int b = 0; b < d.nz; ++b)
            for (int a = 0; a < d.nx; ++a)
                if (after[d.index(a, b)] != whole[d.index(a, b)])
                    furthest = std::max(furthest, d.cell * std::hypot(a - i, b - j));
    }
    std::printf("reach %.2f m, the furthest change %.2f m\n", layer.reach(), furthest);
    EXPECT_LE(furthest, layer.reach());
    EXPECT_GT(furthest, 0.6 * layer.reach());
}

// On a grid too coarse for ripples the layer leaves the sand unchanged and outputs what the shader needs: the
// gradient of the surface and a strength, which is 1 in the open, 0 in the lee, and limited by the depth of
// the sand.
TEST(Ripples, LayerCarriesWhatACoarseGridCannotHold) {
    for (const double cell : {wavelength / 8.0, wavelength / 5.0, wavelength, 0.3}) {
        Ridge ridge;
        ridge.domain.cell = cell;
        const RipplesLayer layer({settings, Vec2d::UnitX(), 30.0, ""}, ridge.domain);
        const auto sand = evaluate(layer, ridge.domain, ridge.fields());
        const bool coarse = cell > wavelength / 6.0;
        EXPECT_EQ(layer.resolved(), !coarse);
        EXPECT_EQ(sand == ridge.sand, coarse);
        EXPECT_EQ(layer.reach() == 0.0, coarse);
    }
    const Domain d{200, 140, 0.3, 0.0, 0.0};
    std::vector<float> bedrock(d.count());
    std::vector<SandUnits> sand(d.count(), sand_units(1.0));
    for (int j = 0; j < d.nz; ++j)
        for (int i = 0; i < d.nx; ++i) {
            const double x =
                d.x(i); // a bank along z: its brink, 4 m high, is at 24 m; level again from 30.2 m on
            bedrock[d.index(i, j)] = float(x < 24.0 ? x / 6.0 : std::max(4.0 - 0.65 * (x - 24.0), 0.0));
            if (j < 40) sand[d.index(i, j)] = sand_units(0.002);
        }
    const Fields fields{bedrock.data(), sand.data(), {}};
    const RipplesLayer layer({settings, Vec2d::UnitX(), 30.0, ""}, d);
    std::vector<RipplesLayer::RippleInputs> all(d.count());
    layer.carried(fields, {}, all);
    const auto at = [&](double x, int j) { return all[d.index(int(x / d.cell), j)]; };
    EXPECT_NEAR(at(10.0, 70).gradient.x(), 1.0 / 6.0, 1e-6);
    EXPECT_NEAR(at(10.0, 70).gradient.y(), 0.0, 1e-6);
    EXPECT_EQ(at(10.0, 70).strength, 1.0F);
    EXPECT_NEAR(at(10.0, 20).strength, 0.5 / std::sqrt(1.0 + 1.0 / 36.0),
                1e-6);                      // sand of 2 mm, trough of 4 mm
    EXPECT_EQ(at(33.0, 70).strength, 0.0F); // in the lee
    EXPECT_GT(at(58.0, 70).strength, 0.9F); // behind the lee
    std::vector<uint32_t> some;
    for (uint32_t k = 0; k < d.count(); k += 37) some.push_back(uint32_t(d.count()) - 1 - k);
    std::vector<RipplesLayer::RippleInputs> few(some.size());
    layer.carried(fields, some, few);
    for (size_t k = 0; k < some.size(); ++k) {
        ASSERT_EQ(few[k].gradient, all[some[k]].gradient);
        ASSERT_EQ(few[k].strength, all[some[k]].strength);
    }
}

TEST(Ripples, LayerTakesTinyTerrains) {
    for (const int nx : {1, 2, 5, 13})
        for (const int nz : {1, 3, 14}) {
            const Domain d{nx, nz, wavelength / 8.0, 0.0, 0.0};
            const std::vector<float> bedrock(d.count(), 2.0F);
            const std::vector<SandUnits> deep(d.count(), sand_units(1.0));
            const RipplesLayer layer({settings, heading(0.4), 30.0, ""}, d);
            for (const SandUnits s : evaluate(layer, d, {bedrock.data(), deep.data(), {}}))
                ASSERT_NEAR(sand_metres(s), 1.0, 0.0041);
        }
}

TEST(Ripples, Speed) {
    const Ridge ridge;
    const RipplesLayer layer({settings, Vec2d::UnitX(), 30.0, ""}, ridge.domain);
    const RippleField field(settings);
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        const auto seconds = [](const auto& work) {
            const auto start = std::chrono::steady_clock::now();
            work();
            return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        };
        const double of_layer = seconds([&] { evaluate(layer, ridge.domain, ridge.fields()); });
        const double of_field = seconds([&] {
            for (int k = 0; k < 65536; ++k)
                field.displacement({{0.01 * (k % 256), 0.01 * (k / 256)}, Vec2d::UnitX(), {0.1, 0.1}, 1.0});
        });
        std::printf("%d threads: field %.0f ns a point, layer %.0f ns a sample\n", threads,
                    1e9 * of_field / 65536.0, 1e9 * of_layer / double(ridge.domain.count()));
    }
}

} // namespace
} // namespace marram
