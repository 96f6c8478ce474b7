// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/roots.h"

#include "tests/unit/strands/test_surfaces.h"

#include <gtest/gtest.h>
#include <limits>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <cstdio>
#include <set>

using namespace marram;

namespace {

const auto never = [] { return false; };

std::vector<Vec3d> places(const Groom& groom, const Surface& surface, const std::vector<Root>& roots) {
    std::vector<Vec3d> list;
    for (const Root root : roots)
        list.push_back(surface.point(root.triangle, root_weights(groom.seed, root)));
    return list;
}

std::set<std::pair<uint32_t, uint32_t>> identities(const std::vector<Root>& roots) {
    std::set<std::pair<uint32_t, uint32_t>> set;
    for (const Root root : roots) set.emplace(root.triangle, root.index);
    return set;
}

double nearest_pair(const std::vector<Vec3d>& points) {
    double nearest = 1e300;
    for (size_t i = 0; i < points.size(); ++i)
        for (size_t j = i + 1; j < points.size(); ++j)
            nearest = std::min(nearest, (points[i] - points[j]).norm());
    return nearest;
}

} // namespace

TEST(Roots, ACountIsExactWhateverTheMasks) {
    const TestSurface plane = grid_surface(40, 10.0);
    for (const uint64_t count : {1U, 7U, 1000U, 20'000U})
        for (const double spacing : {0.0, 0.5, 1.0})
            for (const bool masked : {false, true}) {
                Groom groom;
                groom.count = count;
                groom.spacing = spacing;
                if (masked) groom.density_masks.image = ScalarImage{2, 1, {0.05F, 0.4F}};
                const std::vector<Root> roots = place_roots(groom, plane.surface(), never).roots;
                EXPECT_EQ(roots.size(), count) << spacing << masked;
                EXPECT_EQ(identities(roots).size(), count) << "a root stands twice";
            }
}

TEST(Roots, ADensityIsMetWithinTwoPercent) {
    for (const int divisions : {1, 40, 300}) {
        const TestSurface plane = grid_surface(divisions, 10.0);
        for (const double spacing : {0.0, 0.7, 1.0}) {
            Groom groom;
            groom.density = 500.0;
            groom.spacing = spacing;
            const double found = double(place_roots(groom, plane.surface(), never).roots.size()) / 100.0;
            std::printf("divisions %3d spacing %.1f: %.1f of 500 a square metre\n", divisions, spacing,
                        found);
            EXPECT_NEAR(found / 500.0, 1.0, 0.02);
        }
    }
}

TEST(Roots, KeepTheirDistance) {
    const TestSurface plane = grid_surface(30, 2.0);
    for (const double spacing : {0.5, 1.0}) {
        Groom groom;
        groom.density = 1000.0;
        groom.spacing = spacing;
        const double bound = spacing * 0.5 / std::sqrt(groom.density);
        const double nearest =
            nearest_pair(places(groom, plane.surface(), place_roots(groom, plane.surface(), never).roots));
        EXPECT_GT(nearest, 0.994 * bound); // grid positions are stored to 1/1000 of a cell of 2 r
        EXPECT_LT(nearest, 1.2 * bound) << "the discs are smaller than they could be";
    }
    Groom random;
    random.density = 1000.0;
    random.spacing = 0.0;
    EXPECT_LT(
        nearest_pair(places(random, plane.surface(), place_roots(random, plane.surface(), never).roots)),
        0.2 / std::sqrt(1000.0));
}

// Counts in sixteen squares over several seeds. For random roots their variance would equal their mean.
TEST(Roots, AreSpreadEvenlyOverLargeAndSmallTriangles) {
    for (const int divisions : {1, 64}) {
        const TestSurface plane = grid_surface(divisions, 10.0);
        constexpr int seeds = 12;
        double variance = 0.0, mean[16] = {};
        for (uint32_t seed = 0; seed < seeds; ++seed) {
            Groom groom;
            groom.count = 16'000;
            groom.seed = seed;
            int cells[16] = {};
            for (const Vec3d& p :
                 places(groom, plane.surface(), place_roots(groom, plane.surface(), never).roots))
                ++cells[int(p.x() / 2.5) * 4 + int(p.z() / 2.5)];
            for (int i = 0; i < 16; ++i) {
                variance += (cells[i] - 1000.0) * (cells[i] - 1000.0) / (15.0 * seeds);
                mean[i] += double(cells[i]) / seeds;
            }
        }
        std::printf("%d squares a side: variance %.0f, of random roots 1000\n", divisions, variance);
        EXPECT_LT(variance, 550.0);
        for (const double cell : mean) EXPECT_NEAR(cell, 1000.0, 25.0);
    }
}

TEST(Roots, DoNotNoticeAChangeElsewhere) {
    const TestSurface plane = grid_surface(20, 10.0);
    Groom groom;
    groom.density = 300.0;
    const auto whole = identities(place_roots(groom, plane.surface(), never).roots);
    std::vector<float> half(64, 0.0F); // mask out the right half
    std::fill_n(half.begin(), 32, 1.0F);
    groom.density_masks.image = ScalarImage{64, 1, half};
    const std::vector<Root> left = place_roots(groom, plane.surface(), never).roots;
    size_t kept = 0;
    for (const Root root : left) kept += whole.count({root.triangle, root.index});
    // Only next to the seam can a strand grow that was suppressed by one that is now masked out.
    EXPECT_GT(left.size(), whole.size() / 3);
    EXPECT_GT(double(kept) / double(left.size()), 0.97);
    // At a higher density all strands that still exist keep their identity, so their root and shape.
    groom = {};
    groom.density = 600.0;
    groom.spacing = 0.0;
    const auto dense = identities(place_roots(groom, plane.surface(), never).roots);
    groom.density = 300.0;
    for (const auto& root : identities(place_roots(groom, plane.surface(), never).roots))
        EXPECT_TRUE(dense.contains(root));
}

TEST(Roots, HalfAMaskIsHalfTheStrands) {
    const TestSurface plane = grid_surface(50, 10.0);
    for (const float share : {0.1F, 0.5F, 0.9F}) {
        Groom groom;
        groom.density = 300.0;
        groom.density_masks.image = ScalarImage{1, 1, {share}};
        EXPECT_NEAR(double(place_roots(groom, plane.surface(), never).roots.size()) / 30'000, double(share),
                    0.02);
    }
}

// A quadrant of 8 x 8 pixels is white. Bilinear filtering spreads it by a pixel, but not to the opposite
// edges, unless it repeats.
TEST(Roots, AnImageEndsAtItsBorder) {
    const TestSurface plane = grid_surface(20, 2.0);
    std::vector<float> quadrant(64, 0.0F);
    for (size_t y = 0; y < 4; ++y)
        std::fill_n(quadrant.begin() + std::ptrdiff_t(8 * y), 4, 1.0F); // at u 0 ... 0.5, v 0.5 ... 1
    for (const bool repeats : {false, true}) {
        Groom groom;
        groom.density = 2000.0;
        groom.density_masks.image = ScalarImage{8, 8, quadrant};
        groom.density_masks.image->set_repeats(repeats);
        size_t beyond = 0;
        const std::vector<Root> roots = place_roots(groom, plane.surface(), never).roots;
        for (const Vec3d& p : places(groom, plane.surface(), roots)) beyond += p.x() > 1.2 || p.z() < 0.8;
        EXPECT_GT(roots.size(), 1500U);
        if (repeats)
            EXPECT_GT(double(beyond), 0.02 * double(roots.size()));
        else
            EXPECT_EQ(beyond, 0U);
    }
}

// Tiles 1001 and 1013 of 2 x 2 pixels, 1 at left and 2 at right; 1002, 1003, 1011 and 1012 are missing.
TEST(Roots, AnImageInTilesEndsAtTheirBorders) {
    constexpr float none = std::numeric_limits<float>::quiet_NaN();
    const float pixels[] = {none, none, none, none, 1,    2,    none, none, none, none, 1,    2, // v 1 ... 2
                            1,    2,    none, none, none, none, 1,    2,    none, none, none, none};
    MarramGrid grid{};
    grid.name = "mask.<UDIM>.png";
    grid.nx = 6;
    grid.ny = 4;
    grid.nz = grid.components = 1;
    grid.values = pixels;
    grid.axes[0][0] = 0.5;
    grid.axes[1][1] = -0.5;
    grid.origin[0] = 0.25;
    grid.origin[1] = 1.75;
    const ScalarImage image(grid, 0, 0.0F, "");
    EXPECT_TRUE(image.has_tile(0, 0) && image.has_tile(2, 1));
    EXPECT_FALSE(image.has_tile(1, 0) || image.has_tile(2, 0) || image.has_tile(3, 1) ||
                 image.has_tile(-1, 0));
    EXPECT_EQ(image(0.01, 0.5), 1.0);
    EXPECT_EQ(image(0.99, 0.99), 2.0);
    EXPECT_EQ(image(0.5, 0.5), 1.5);
    EXPECT_EQ(image(1.0, 0.5), 2.0) << "the border of the tile that is there";
    EXPECT_EQ(image(1.01, 0.5), 0.0);
    EXPECT_EQ(image(2.01, 1.5), 1.0);
    EXPECT_EQ(image(-0.01, 0.5), 0.0);
    EXPECT_EQ(image.low(), 0.0);
    EXPECT_EQ(image.high(), 2.0);
}

// A factor that is 0 over its whole image is rejected at once: searching for places would take a minute per
// 100 strands.
TEST(Roots, NothingGrowsWhereAnImageIsBlack) {
    const TestSurface plane = grid_surface(50, 10.0);
    Groom groom;
    groom.count = 10'000'000;
    groom.density_masks.factors = {
        {"", "", ScalarImage{2, 1, {-1.0F, 0.0F}}, Ramp(std::vector<double>{0, 0, 1, 1}, "linear")}};
    EXPECT_THROW(place_roots(groom, plane.surface(), never), SceneFault);
}

TEST(Roots, TheSameAtAnyThreadCount) {
    const TestSurface sphere = sphere_surface(60);
    Groom groom;
    groom.count = 30'000;
    std::vector<Root> lists[2];
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        tbb::task_arena(threads).execute(
            [&] { lists[threads - 1] = place_roots(groom, sphere.surface(), never).roots; });
    }
    ASSERT_EQ(lists[0].size(), lists[1].size());
    for (size_t i = 0; i < lists[0].size(); ++i) {
        EXPECT_EQ(lists[0][i].triangle, lists[1][i].triangle);
        EXPECT_EQ(lists[0][i].index, lists[1][i].index);
    }
}

TEST(Roots, NeighboursInTheListAreNeighboursInSpace) {
    const TestSurface sphere = sphere_surface(60);
    Groom groom;
    groom.count = 20'000;
    const auto points = places(groom, sphere.surface(), place_roots(groom, sphere.surface(), never).roots);
    double sum = 0.0;
    for (size_t i = 1; i < points.size(); ++i) sum += (points[i] - points[i - 1]).norm();
    EXPECT_LT(sum / double(points.size()), 3.0 * std::sqrt(4.0 * pi / 20'000));
}

TEST(Roots, HardMeshes) {
    // Degenerate and duplicate triangles, tiny and huge scenes, far from the origin.
    TestSurface mesh = grid_surface(4, 1.0);
    mesh.triangles.insert(mesh.triangles.end(), {0, 0, 1, 3, 3, 3, 0, 5, 1, 0, 5, 1});
    Groom groom;
    groom.count = 500;
    for (const Root root : place_roots(groom, mesh.surface(), never).roots) {
        EXPECT_GT(mesh.surface().area(root.triangle), 0.0);
    }
    for (const double scale : {1e-6, 1e5})
        for (const float far : {0.0F, 1e4F}) {
            TestSurface scaled = grid_surface(4, scale);
            for (float& x : scaled.positions) x += far * float(scale);
            EXPECT_EQ(place_roots(groom, scaled.surface(), never).roots.size(), 500U) << scale << far;
        }
    TestSurface empty = grid_surface(2, 1.0);
    for (float& x : empty.positions) x = 0.5F;
    EXPECT_THROW(place_roots(groom, empty.surface(), never), SceneFault);
    groom.density_masks.by_height = Ramp(std::vector<double>{0.0, 0.0}, "linear");
    EXPECT_THROW(place_roots(groom, mesh.surface(), never), SceneFault);
}
