// SPDX-License-Identifier: Apache-2.0
// Tests of the fusion layer's documentation: sand conserved exactly, slopes bounded on both diagonals,
// identical bits at any thread count.
#include "procedural/terrain/drape.h"
#include "procedural/terrain/mesh/fusion.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>
#include <vector>

namespace marram {
namespace {

struct FusionScene {
    Domain domain;
    std::vector<float> rock;
    std::vector<SandUnits> sand;

    explicit FusionScene(int nx, int nz, double cell = 1.0)
        : domain{nx, nz, cell, 0.0, 0.0}, rock(domain.count(), 0.0F), sand(domain.count(), 0) {}
    template <typename F>
    void pile(F&& height) { // height(x, z): metres, relative to the middle
        for (int j = 0; j < domain.nz; ++j)
            for (int i = 0; i < domain.nx; ++i) {
                const double x = (i - domain.nx / 2) * domain.cell, z = (j - domain.nz / 2) * domain.cell;
                sand[domain.index(i, j)] = sand_units(std::max(0.0, double(height(x, z))));
            }
    }
    double height(int i, int j) const {
        return double(rock[domain.index(i, j)]) + sand_metres(sand[domain.index(i, j)]);
    }
};

// Steepest triangle with three sandy corners, in degrees. Independent code, corner by corner.
double fusion_steepest_degrees(const FusionScene& scene) {
    const Domain& d = scene.domain;
    double steepest = 0.0;
    for (int j = 0; j + 1 < d.nz; ++j)
        for (int i = 0; i + 1 < d.nx; ++i)
            for (int corner = 0; corner < 4; ++corner) {
                const int px = i + (corner & 1), pz = j + (corner >> 1);
                const int qx = 2 * i + 1 - px, rz = 2 * j + 1 - pz;
                if (scene.sand[d.index(px, pz)] <= 0 || scene.sand[d.index(qx, pz)] <= 0 ||
                    scene.sand[d.index(px, rz)] <= 0)
                    continue;
                const double h = scene.height(px, pz);
                steepest = std::max(steepest, std::hypot(scene.height(qx, pz) - h, scene.height(px, rz) - h));
            }
    return std::atan(steepest / d.cell) / degree;
}

FusionResult fusion_expect_relaxed(FusionScene& scene, FusionSettings settings = {}) {
    const std::vector<SandUnits> before = scene.sand;
    const FusionResult result = relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), settings, {});
    SandUnits lost = 0, least = 0;
    for (size_t k = 0; k < before.size(); ++k) {
        lost += before[k] - scene.sand[k];
        least = std::min(least, scene.sand[k]);
    }
    EXPECT_EQ(lost, 0);
    EXPECT_EQ(least, 0);
    EXPECT_TRUE(result.settled);
    EXPECT_FALSE(result.cancelled);
    const double steepest = fusion_steepest_degrees(scene);
    EXPECT_LE(steepest, settings.repose / degree + 0.5);
    EXPECT_NEAR(steepest, result.steepest / degree, 1e-3);
    return result;
}

TEST(Fusion, ConesAndRidgesInAnyDirectionComeToRest) {
    for (const double angle : {0.0, std::atan(0.4), 45.0 * degree, 88.0 * degree}) {
        FusionScene ridge(160, 144);
        const double c = std::cos(angle), s = std::sin(angle);
        ridge.pile([&](double x, double z) {
            return std::min(12.0 - 1.5 * std::abs(x * c + z * s), 30.0 - std::abs(z * c - x * s));
        });
        EXPECT_GT(fusion_expect_relaxed(ridge).moved, 10.0);
    }
    for (const double repose : {5.0, 20.0, 34.0, 60.0}) {
        FusionScene cone(128, 128);
        cone.pile([](double x, double z) { return 20.0 * (1.0 - std::hypot(x, z) / 10.0); });
        fusion_expect_relaxed(cone, {.repose = repose * degree});
    }
}

TEST(Fusion, ARelaxedConeIsRound) {
    FusionScene cone(192, 192);
    cone.pile([](double x, double z) { return (40.0 - std::hypot(x, z)) * std::tan(50.0 * degree); });
    fusion_expect_relaxed(cone);
    std::vector<double> radii;
    for (int n = 0; n < 8; ++n) { // radius at half the height
        const double half = 0.5 * cone.height(96, 96);
        const double c = std::cos(n * pi / 4), s = std::sin(n * pi / 4);
        const auto at = [&](double distance) {
            const double x = 96 + distance * c, z = 96 + distance * s;
            const int i = int(x), j = int(z);
            const double u = x - i, v = z - j;
            return (1 - u) * (1 - v) * cone.height(i, j) + u * (1 - v) * cone.height(i + 1, j) +
                   (1 - u) * v * cone.height(i, j + 1) + u * v * cone.height(i + 1, j + 1);
        };
        double r = 0.0;
        while (at(r) > half) r += 0.01;
        radii.push_back(r);
        EXPECT_NEAR(std::atan((at(r - 10) - at(r + 10)) / 20.0) / degree, 34.0, 1.0) << n;
    }
    const auto [least, most] = std::minmax_element(radii.begin(), radii.end());
    std::printf("radii at half height: %.3f to %.3f\n", *least, *most);
    EXPECT_LT(*most / *least, 1.05); // along diagonals triangles are steeper than the cone by 1 / (4 r)
    for (size_t n = 0; n < 4; ++n) EXPECT_NEAR(radii[n] / radii[n + 4], 1.0, 0.01) << n; // no drift
    for (size_t n = 0; n < 6; ++n) EXPECT_NEAR(radii[n] / radii[n + 2], 1.0, 0.02) << n; // x like z
}

TEST(Fusion, RandomHeapsOnRandomRock) {
    for (uint64_t seed = 1; seed <= 3; ++seed) {
        FusionScene scene(150, 131);
        for (size_t k = 0; k < scene.rock.size(); ++k) {
            scene.rock[k] = float(6.0 * unit_double(hash(seed, k / 7)));
            scene.sand[k] = sand_units(std::max(0.0, 9.0 * unit_double(hash(seed + 9, k)) - 5.0));
        }
        const std::vector<float> rock = scene.rock;
        fusion_expect_relaxed(scene);
        EXPECT_EQ(rock, scene.rock);
    }
}

TEST(Fusion, ACliffOfSandCollapses) {
    FusionScene cliff(200, 40);
    cliff.pile([](double x, double) { return x < 0.0 ? 30.0 : 0.0; });
    fusion_expect_relaxed(cliff);
    EXPECT_LT(cliff.height(99, 20), 16.5); // a wedge around the former cliff
    EXPECT_GT(cliff.height(99, 20), 13.5);
}

TEST(Fusion, SandSlidesOffSteepRock) {
    for (const int turn : {0, 1, 2}) {
        FusionScene ramp(96, 96);
        for (int j = 0; j < 96; ++j)
            for (int i = 0; i < 96; ++i) {
                const double up = turn == 0 ? i : turn == 1 ? 95 - j : (i + j) * std::sqrt(0.5);
                ramp.rock[ramp.domain.index(i, j)] = float(std::max(0.0, up - 30.0) * std::tan(60 * degree));
                ramp.sand[ramp.domain.index(i, j)] = sand_units(0.2);
            }
        fusion_expect_relaxed(ramp);
        EXPECT_EQ(ramp.sand[ramp.domain.index(90, turn == 1 ? 5 : 90)], 0);
        EXPECT_GT(ramp.sand[ramp.domain.index(turn == 1 ? 48 : 30, turn == 1   ? 65
                                                                   : turn == 2 ? 12
                                                                               : 48)],
                  sand_units(0.2));
    }
}

TEST(Fusion, StableSandStaysToTheBit) {
    FusionScene scene(130, 70);
    scene.pile(
        [](double x,
           double z) { // a cone with a rounded top: a sharp one is steeper at its top than at its flank
            return (25.0 - std::sqrt(x * x + z * z + 25.0)) * std::tan(33.5 * degree);
        });
    const auto before = scene.sand;
    EXPECT_EQ(fusion_expect_relaxed(scene).sweeps, 0);
    EXPECT_EQ(before, scene.sand);
    FusionScene bare(70, 70); // no sand on very steep rock: nothing moves
    for (size_t k = 0; k < bare.rock.size(); ++k) bare.rock[k] = float(unit_double(hash(1, k)) * 1e5);
    EXPECT_EQ(fusion_expect_relaxed(bare).moved, 0.0);
}

TEST(Fusion, SandInAHollowOfASteepFaceStays) {
    FusionScene stairs(96, 64); // treads of 8 samples that tilt backwards, and risers: mean slope 45 degrees
    for (int j = 0; j < 64; ++j)
        for (int i = 0; i < 96; ++i) {
            const bool lip = i % 8 == 0;
            stairs.rock[stairs.domain.index(i, j)] = float(8 * (i / 8) + (lip ? 1.0 : 0.0));
            stairs.sand[stairs.domain.index(i, j)] = lip ? 0 : sand_units(0.9);
        }
    const auto before = stairs.sand;
    stairs.sand[stairs.domain.index(91, 60)] += sand_units(3.0); // makes the corner unstable
    fusion_expect_relaxed(stairs);
    for (int i = 0; i < 80; ++i)
        EXPECT_EQ(before[stairs.domain.index(i, 20)], stairs.sand[stairs.domain.index(i, 20)]) << i;
}

TEST(Fusion, TheSameBitsAtAnyThreadCount) {
    std::vector<SandUnits> results[2];
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        FusionScene scene(260, 200);
        for (size_t k = 0; k < scene.rock.size(); ++k) scene.rock[k] = float(unit_double(hash(4, k / 11)));
        scene.pile([](double x, double z) { return 14.0 - 1.6 * std::hypot(x * 0.2, z) + std::sin(x); });
        relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), {}, {});
        results[threads - 1] = scene.sand;
    }
    EXPECT_EQ(results[0], results[1]);
}

TEST(Fusion, SmallDomainsAndExtremeCells) {
    for (const auto& [nx, nz] : {std::pair{1, 1}, {1, 40}, {40, 1}, {2, 2}, {17, 3}, {65, 66}}) {
        FusionScene scene(nx, nz);
        scene.pile([](double x, double z) { return 9.0 - std::abs(x) - std::abs(z); });
        scene.sand[0] += sand_units(50.0);
        fusion_expect_relaxed(scene);
    }
    for (const double cell : {0.001, 100.0})
        for (const double base : {0.0, 1e5}) {
            FusionScene scene(64, 64, cell);
            std::fill(scene.rock.begin(), scene.rock.end(), float(base));
            scene.pile([&](double x, double z) { return 2.0 * (15.0 * cell - std::hypot(x, z)); });
            EXPECT_GT(fusion_expect_relaxed(scene).moved, 0.0);
        }
}

TEST(Fusion, OutOfRangeAndCancelledLeaveTheSand) {
    FusionScene scene(32, 32);
    scene.pile([](double x, double) { return 9.0 - 3.0 * std::abs(x); });
    const auto before = scene.sand;
    EXPECT_TRUE(
        relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), {}, [] { return true; }).cancelled);
    EXPECT_EQ(before, scene.sand);
    scene.rock[5] = std::numeric_limits<float>::max();
    EXPECT_FALSE(relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), {}, {}).settled);
    EXPECT_EQ(before, scene.sand);
}

// A face of 60 degrees with a ledge of 12 m behind a lip of 3 m, 28 m above a floor, so that no heap at the
// foot reaches the lip. `down`: metres in the direction of descent.
double pocket_rock(double down) {
    const double tangent = std::tan(60.0 * degree);
    if (down < -6.0) return 3.0 * tangent + (-6.0 - down) * tangent; // the face above
    if (down < 6.0) return down < 5.0 ? 3.0 * tangent : 3.0 * tangent + 3.0 * (down - 5.0);
    return std::max(3.0 * tangent + 3.0 - (down - 6.0) * tangent, -20.0);
}
constexpr double pocket_lip = 6.0;

// Capacity in m^2 of the pocket below a surface that rises from its lip at angle `repose`; samples `step`
// apart.
double pocket_capacity(double repose, double step) {
    double sum = 0.0;
    for (double back = step; back < 30.0; back += step) {
        const double line = pocket_rock(pocket_lip) + back * std::tan(repose);
        const double depth = line - pocket_rock(pocket_lip - back);
        if (back > 11.5 && depth < 0.0) break;
        sum += std::max(depth, 0.0) * step;
    }
    return sum;
}

struct Pocket {
    double above = 0.0, inside = 0.0, beyond = 0.0; // m^2 of sand on the middle half of the face
};

// Puts `supply` m^2 of sand on the face above the pocket. The face descends towards `angle`.
Pocket pocket_filled(double supply, double angle) {
    const double cell = 0.5;
    FusionScene face(200, 200, cell);
    const double c = std::cos(angle), s = std::sin(angle), thick = supply / 6.0;
    const auto down = [&](int i, int j) { return ((i - 100) * c + (j - 100) * s) * cell; };
    for (int j = 0; j < 200; ++j)
        for (int i = 0; i < 200; ++i) {
            const double u = down(i, j);
            face.rock[face.domain.index(i, j)] = float(pocket_rock(u));
            if (u < -18.0 && u >= -24.0) face.sand[face.domain.index(i, j)] = sand_units(thick);
        }
    fusion_expect_relaxed(face);
    Pocket sand;
    for (int j = 0; j < 200; ++j)
        for (int i = 0; i < 200; ++i) {
            const double across = ((j - 100) * c - (i - 100) * s) * cell;
            if (!(across > -12.0 && across <= 12.0)) continue;
            const double u = down(i, j), area = sand_metres(face.sand[face.domain.index(i, j)]) * cell * cell;
            // The surface of a full pocket rises from its lip by tan 34 and meets the face 22.5 m behind it.
            (u > pocket_lip ? sand.beyond : u > -17.5 ? sand.inside : sand.above) += area / 24.0;
        }
    return sand;
}

TEST(Fusion, APocketOnASteepFaceFillsToTheAngleOfReposeAndNoFurther) {
    // Documented: over steep rock up to 2.5 degrees below repose.
    const double least = pocket_capacity(31.5 * degree, 0.01), most = pocket_capacity(34.5 * degree, 0.01);
    for (const double angle : {0.0, 90.0 * degree, 180.0 * degree, 45.0 * degree}) {
        const Pocket half = pocket_filled(0.5 * least, angle), over = pocket_filled(1.8 * least, angle);
        std::printf("capacity %.2f to %.2f; half: %.3f %.3f %.3f, over: %.3f %.3f %.3f\n", least, most,
                    half.above, half.inside, half.beyond, over.above, over.inside, over.beyond);
        EXPECT_EQ(half.above, 0.0);  // no sand stops above the pocket
        EXPECT_EQ(half.beyond, 0.0); // no sand passes the lip of a half-full pocket
        EXPECT_NEAR(half.inside, 0.5 * least, 0.02 * least);
        EXPECT_EQ(over.above, 0.0);
        EXPECT_GT(over.inside, least); // not underfilled
        EXPECT_LT(over.inside, most);  // not overfilled
        EXPECT_NEAR(over.inside + over.beyond, 1.8 * least, 0.04 * least);
    }
}

TEST(Fusion, AnObliqueFaceSettlesWhereCoarseAndFineGridsUndoEachOther) {
    for (const double angle : {20.0 * degree, 30.0 * degree, 65.0 * degree}) pocket_filled(120.0, angle);
}

TEST(Fusion, SaysWhereItDidNotSettle) {
    FusionScene cliff(120, 120); // steep rock oblique to the grid needs hundreds of sweeps
    for (int j = 0; j < 120; ++j)
        for (int i = 0; i < 120; ++i)
            cliff.rock[cliff.domain.index(i, j)] = float(1.7 * std::max(0.0, i + 0.4 * j - 60.0));
    std::fill(cliff.sand.begin(), cliff.sand.end(), sand_units(0.2));
    std::vector<SandUnits> sand = cliff.sand;
    const Fields below{cliff.rock.data(), cliff.sand.data(), {}};
    const auto said = [&](const FusionSettings& settings) {
        LayerNotes notes;
        const FusionLayer layer(cliff.domain, settings, "", "desert.toml:7:1");
        EXPECT_TRUE(layer.evaluate_whole(below, {nullptr, sand.data(), {}, &notes}, {}));
        SandUnits lost = 0;
        for (size_t k = 0; k < sand.size(); ++k) lost += cliff.sand[k] - sand[k];
        EXPECT_EQ(lost, 0);
        return notes;
    };
    const LayerNotes good = said({});
    EXPECT_TRUE(good.warnings.empty());
    ASSERT_EQ(good.numbers.size(), 4u);
    EXPECT_EQ(good.numbers[3], std::pair(std::string("settled"), 1.0));
    const LayerNotes bad = said({.cycles = 1});
    ASSERT_EQ(bad.warnings.size(), 1u);
    EXPECT_EQ(bad.warnings[0].place, "desert.toml:7:1");
    EXPECT_NE(bad.warnings[0].what.find("12 sweeps"), std::string::npos) << bad.warnings[0].what;
    EXPECT_EQ(bad.numbers[3].second, 0.0);
    cliff.rock[5] = 2e6F;
    EXPECT_NE(said({}).warnings.at(0).what.find("out of range"), std::string::npos);
    EXPECT_EQ(sand, cliff.sand);
}

// ---- masks ----

FusionScene fusion_heap() {
    FusionScene heap(150, 150);
    for (size_t k = 0; k < heap.rock.size(); ++k) heap.rock[k] = float(unit_double(hash(4, k / 9)));
    heap.pile([](double x, double z) { return 30.0 - 1.4 * std::hypot(x, 0.7 * z) + std::sin(x); });
    return heap;
}

FusionResult fusion_masked(FusionScene& scene, const std::vector<float>& mask, FusionSettings settings = {}) {
    const std::vector<SandUnits> before = scene.sand;
    const FusionResult result =
        relax_sand(scene.domain, scene.rock.data(), scene.sand.data(), settings, {}, mask.data());
    SandUnits lost = 0;
    for (size_t k = 0; k < before.size(); ++k) {
        lost += before[k] - scene.sand[k];
        const double share = std::clamp(double(mask[k]), 0.0, 1.0);
        EXPECT_GE(scene.sand[k], before[k] - SandUnits(share * double(before[k]))); // the fixed part stays
    }
    EXPECT_EQ(lost, 0);
    return result;
}

TEST(Fusion, AMaskIsTheShareThatIsLoose) {
    const FusionScene heap = fusion_heap();
    FusionScene all = heap, none = heap, masked = heap;
    relax_sand(all.domain, all.rock.data(), all.sand.data(), {}, {});
    for (const float one : {1.0F, 7.0F}) { // values outside of [0, 1] are clamped
        masked.sand = heap.sand;
        fusion_masked(masked, std::vector<float>(heap.sand.size(), one));
        EXPECT_EQ(masked.sand, all.sand);
    }
    for (const float zero : {0.0F, -3.0F}) {
        EXPECT_EQ(fusion_masked(none, std::vector<float>(heap.sand.size(), zero)).moved, 0.0);
        EXPECT_EQ(none.sand, heap.sand);
    }
    // Half of the sand is loose: it comes to rest on top of the fixed half.
    for (const FusionSettings settings : {FusionSettings{}, FusionSettings{.drape = 3.0}}) {
        masked.sand = heap.sand;
        EXPECT_TRUE(fusion_masked(masked, std::vector<float>(heap.sand.size(), 0.5F), settings).settled);
        EXPECT_NE(masked.sand, heap.sand);
    }
    FusionScene loose = masked;
    for (size_t k = 0; k < heap.sand.size(); ++k) loose.sand[k] -= heap.sand[k] - heap.sand[k] / 2;
    for (size_t k = 0; k < heap.sand.size(); ++k)
        loose.rock[k] += float(sand_metres(heap.sand[k] - heap.sand[k] / 2));
    EXPECT_LE(fusion_steepest_degrees(loose), 34.5);
}

TEST(Fusion, ASmallMaskMovesLittleAndAnEdgeOfItIsNoWall) {
    const FusionScene heap = fusion_heap();
    double total = 0.0;
    for (const SandUnits sand : heap.sand) total += sand_metres(sand);
    double last = 0.0;
    for (const float share : {1e-6F, 1e-3F, 0.1F}) {
        FusionScene scene = heap;
        const double moved = fusion_masked(scene, std::vector<float>(heap.sand.size(), share)).moved;
        EXPECT_LE(moved, double(share) * total);
        EXPECT_GT(moved, last);
        last = moved;
    }
    // Slightly different masks give slightly different results everywhere.
    FusionScene a = heap, b = heap;
    std::vector<float> mask(heap.sand.size());
    for (size_t k = 0; k < mask.size(); ++k) mask[k] = float(k % 150) / 149.0F;
    fusion_masked(a, mask);
    for (float& share : mask) share = std::min(share + 1e-5F, 1.0F);
    fusion_masked(b, mask);
    double differ = 0.0;
    for (size_t k = 0; k < mask.size(); ++k)
        differ = std::max(
            differ, std::abs(a.height(int(k % 150), int(k / 150)) - b.height(int(k % 150), int(k / 150))));
    std::printf("masks 1e-5 apart: heights differ by %.2e m at most\n", differ);
    EXPECT_LT(differ, 1e-3);
    // Where no sand is loose, sand may arrive but none leaves.
    FusionScene half = heap;
    for (size_t k = 0; k < mask.size(); ++k) mask[k] = k % 150 < 75 ? 0.0F : 1.0F;
    fusion_masked(half, mask);
    SandUnits arrived = 0;
    for (size_t k = 0; k < mask.size(); ++k)
        if (mask[k] == 0.0F) arrived += half.sand[k] - heap.sand[k];
    EXPECT_GT(arrived, 0);
}

// ---- drape ----

// Level sand that meets rock with a slope of 25 degrees, which rises towards `angle`.
FusionScene fusion_shore(double angle, double cell = 0.1, double slope = 25.0) {
    FusionScene shore(160, 160, cell);
    for (int j = 0; j < 160; ++j)
        for (int i = 0; i < 160; ++i) {
            const double up = ((i - 80) * std::cos(angle) + (j - 80) * std::sin(angle)) * cell;
            const double rock = up * std::tan(slope * degree);
            shore.rock[shore.domain.index(i, j)] = float(rock);
            shore.sand[shore.domain.index(i, j)] = sand_units(std::max(0.0, -rock));
        }
    return shore;
}

// Maximum second difference of the surface along x or z, in the middle.
double fusion_kink(const FusionScene& scene) {
    double most = 0.0;
    for (int j = 30; j < 130; ++j)
        for (int i = 30; i < 130; ++i) {
            const double twice = 2.0 * scene.height(i, j);
            most = std::max({most, std::abs(scene.height(i - 1, j) + scene.height(i + 1, j) - twice),
                             std::abs(scene.height(i, j - 1) + scene.height(i, j + 1) - twice)});
        }
    return most;
}

TEST(Drape, LeavesNoKinkWhereSandMeetsRock) {
    for (const double angle : {0.0, std::atan(0.4), 45.0 * degree, 90.0 * degree}) {
        FusionScene shore = fusion_shore(angle), draped = shore;
        fusion_expect_relaxed(draped, {.drape = 0.5});
        const double seam = fusion_kink(shore), fillet = fusion_kink(draped);
        std::printf("kink %.4f, draped %.4f\n", seam, fillet);
        EXPECT_LT(fillet, 0.15 * seam);
        // The sand climbs, but above its level by at most the drape.
        double highest = 0.0;
        for (int j = 30; j < 130; ++j)
            for (int i = 30; i < 130; ++i)
                if (draped.sand[draped.domain.index(i, j)] > sand_units(0.001))
                    highest = std::max(highest, draped.height(i, j));
        EXPECT_GT(highest, 0.1);
        EXPECT_LT(highest, 0.5);
    }
}

TEST(Drape, ThickSandKeepsItsBits) {
    const double drape = 0.5;
    FusionScene shore = fusion_shore(0.3), draped = shore;
    fusion_expect_relaxed(draped, {.drape = drape});
    size_t kept = 0;
    for (int j = 1; j < 159; ++j)
        for (int i = 1; i < 159; ++i) {
            double least = infinity; // minimum over the sample and its neighbours
            for (int n = 0; n < 9; ++n)
                least = std::min(least,
                                 sand_metres(shore.sand[shore.domain.index(i - 1 + n % 3, j - 1 + n / 3)]));
            if (least < 4.0 * drape) continue;
            ++kept;
            ASSERT_EQ(shore.sand[shore.domain.index(i, j)], draped.sand[shore.domain.index(i, j)]);
        }
    EXPECT_GT(kept, 1000u);
    // Zero, and a drape thinner than a sand unit, change nothing.
    for (const double none : {0.0, 1e-11}) {
        draped.sand = shore.sand;
        fusion_expect_relaxed(draped, {.drape = none});
        EXPECT_EQ(draped.sand, shore.sand);
    }
}

TEST(Drape, RoughRockIsThinnestWhereItStandsOut) {
    FusionScene rough(128, 128, 0.2);
    for (int j = 0; j < 128; ++j)
        for (int i = 0; i < 128; ++i) {
            rough.rock[rough.domain.index(i, j)] = float(0.4 * std::sin(0.3 * i) * std::sin(0.21 * j));
            rough.sand[rough.domain.index(i, j)] = sand_units(0.3);
        }
    fusion_expect_relaxed(rough, {.drape = 0.8});
    double crest = 0.0, hollow = 0.0; // mean thickness
    int crests = 0, hollows = 0;
    for (size_t k = 0; k < rough.sand.size(); ++k) {
        if (rough.rock[k] > 0.3F) crest += sand_metres(rough.sand[k]), ++crests;
        if (rough.rock[k] < -0.3F) hollow += sand_metres(rough.sand[k]), ++hollows;
    }
    EXPECT_LT(crest / crests, 0.25);
    EXPECT_GT(hollow / hollows, 0.35);
}

TEST(Drape, TheSameBitsAtAnyThreadCountAndTenCellsAtMost) {
    const auto draped = [](double drape, int threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        FusionScene scene(70, 66, 0.1);
        for (size_t k = 0; k < scene.rock.size(); ++k) {
            scene.rock[k] = float(2.0 * unit_double(hash(3, k / 13)));
            scene.sand[k] = sand_units(std::max(0.0, unit_double(hash(5, k / 23)) - 0.5));
        }
        fusion_expect_relaxed(scene, {.drape = drape});
        return scene.sand;
    };
    EXPECT_EQ(draped(0.4, 1), draped(0.4, 2));
    EXPECT_EQ(draped(1.0, 2), draped(1000.0, 2));
    EXPECT_NE(draped(0.9, 2), draped(1.0, 2));
}

TEST(Drape, CancelledLeavesTheSand) {
    const FusionScene shore = fusion_shore(0.0);
    const Domain& d = shore.domain;
    std::vector<double> ground(d.count()), sand(d.count());
    for (size_t k = 0; k < d.count(); ++k) {
        ground[k] = std::rint(double(shore.rock[k]) * sand_units_per_metre);
        sand[k] = double(shore.sand[k]);
    }
    const std::vector<double> before = sand;
    int calls = 0;
    EXPECT_FALSE(drape_sand(d, ground.data(), sand.data(), 0.5, [&] { return ++calls > 3; }));
    EXPECT_EQ(sand, before);
    EXPECT_EQ(calls, 4);
    EXPECT_TRUE(drape_sand(d, ground.data(), sand.data(), 0.5, {}));
    EXPECT_NE(sand, before);
}

} // namespace
} // namespace marram
