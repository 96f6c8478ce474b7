// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/level_of_detail.h"

#include "procedural/strands/grown/adsorption.h"
#include "procedural/strands/grown/roots.h"
#include "tests/unit/strands/test_surfaces.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <map>

using namespace marram;

namespace {

const auto not_cancelled = [] { return false; };

MarramView view_from(const Vec3d& position, double tolerance_pixels = 0.5) {
    MarramView view{};
    view.time_count = 1;
    view.positions = position.data();
    view.fov = 0.6;
    view.width = 320, view.height = 200;
    view.tolerance_pixels = tolerance_pixels;
    return view;
}

using Ranks = std::map<std::pair<uint32_t, uint32_t>, float>;

Ranks ranks_of(const PlacedRoots& placed) {
    Ranks ranks;
    for (size_t i = 0; i < placed.roots.size(); ++i)
        ranks[{placed.roots[i].triangle, placed.roots[i].index}] = placed.ranks[i];
    return ranks;
}

} // namespace

TEST(LevelOfDetail, TheWidestStrandIsAsWideAsTheTolerance) {
    const Vec3d camera(1, 2, 3);
    const double width = 0.004, tolerance = 0.7;
    const LevelOfDetail lod(view_from(camera, tolerance), width);
    const double pixel = 2.0 * std::tan(0.3) / 200.0;
    double before = 1.0;
    for (double distance = 0.1; distance < 1e5; distance *= 1.01) {
        const double share = lod.share_at(distance);
        const double pixels = width / (pixel * distance);
        EXPECT_LE(share, before);
        before = share;
        if (pixels >= tolerance) {
            EXPECT_EQ(share, 1.0);
        } else {
            EXPECT_NEAR(pixels * width_factor(0.0, share), tolerance, 1e-12 * tolerance);
        }
    }
    EXPECT_DOUBLE_EQ(lod.distance_of(Vec3d(1, 2, 7)), 4.0);
}

TEST(LevelOfDetail, TheAreaStaysAndNothingPops) {
    constexpr int ranks = 20000;
    for (double share = 1.0; share > 0.005; share *= 0.97) {
        double sum = 0.0, jump = 0.0;
        const double next = share * 0.999;
        for (int i = 0; i < ranks; ++i) {
            const double rank = (i + 0.5) / ranks, now = width_factor(rank, share);
            sum += now;
            // In units of the widest strand: a step of a thousandth changes a strand that fades by 1 / t of it.
            jump = std::max(jump, std::abs(width_factor(rank, next) - now) * share);
        }
        EXPECT_NEAR(sum / ranks, 1.0, 3e-4) << share;
        // Where t = 1 - s, both s and t change.
        EXPECT_LT(jump, share > 0.8 ? 0.0022 / (1.0 - share + 1e-3) + 0.003 : 0.0075) << share;
    }
    EXPECT_EQ(width_factor(0.999, 1.0), 1.0);
    EXPECT_EQ(width_factor(0.5, 0.5), 0.0);
}

TEST(LevelOfDetail, RanksAreTheOrderOfThrowing) {
    for (const double coverage : {0.0, 0.05, 0.196}) {
        const KeptByAttempts order(coverage);
        for (double share = 0.0; share <= 1.0; share += 0.01) {
            EXPECT_NEAR(order.kept(order.attempts(share)), share, 1e-12);
            if (coverage == 0.0) {
                EXPECT_NEAR(order.attempts(share), share, 1e-12);
            }
        }
        EXPECT_EQ(order.attempts(1.0), 1.0);
        EXPECT_EQ(order.kept(0.0), 0.0);
    }
}

// A strand exists or not by its own rank and place, whatever is wanted elsewhere.
TEST(LevelOfDetail, RootsAreThoseOfAllWhoseRankIsBelowTheShare) {
    for (const int divisions : {3, 40})
        for (const double spacing : {0.0, 0.6, 1.0})
            for (const bool masked : {false, true}) {
                const TestSurface plane = grid_surface(divisions, 30.0);
                const Surface surface = plane.surface();
                Groom groom;
                groom.density = 60.0;
                groom.spacing = spacing;
                groom.seed = 5;
                if (masked) groom.density_masks.image = ScalarImage{2, 1, {0.0F, 0.9F}};
                const auto share_at = [](const Vec3d& p) {
                    return std::min(1.0, 4.0 / (p - Vec3d(0, 1, 0)).norm());
                };
                const ShareAround everything = [](uint32_t, double) { return 1.0; };
                const ShareAround near = [&](uint32_t t, double margin) {
                    const auto p = surface.corners(t);
                    const Vec3d centre = (p[0] + p[1] + p[2]) / 3.0;
                    const double reach = (p[0] - centre).norm() + (p[1] - centre).norm() + margin;
                    return std::min(1.0, 4.0 / std::max((centre - Vec3d(0, 1, 0)).norm() - reach, 1e-3));
                };
                const PlacedRoots plain = place_roots(groom, surface, not_cancelled),
                                  all = place_roots(groom, surface, not_cancelled, everything),
                                  some = place_roots(groom, surface, not_cancelled, near);
                if (spacing == 0.0) {
                    ASSERT_EQ(plain.roots.size(), all.roots.size());
                    for (size_t i = 0; i < all.roots.size(); ++i) {
                        EXPECT_EQ(plain.roots[i].triangle, all.roots[i].triangle);
                        EXPECT_EQ(plain.roots[i].index, all.roots[i].index);
                    }
                }
                EXPECT_NEAR(double(all.roots.size()) / double(plain.roots.size()), 1.0, 0.01);
                const auto wanted = [&](const Ranks& of) {
                    Ranks list;
                    for (const auto& [root, rank] : of) {
                        const Vec3d at =
                            surface.point(root.first, root_weights(5, {root.first, root.second}));
                        if (double(rank) < share_at(at)) list[root] = rank;
                    }
                    return list;
                };
                const Ranks of_all = wanted(ranks_of(all)), of_some = wanted(ranks_of(some));
                EXPECT_EQ(of_all, of_some) << divisions << " " << spacing;
                std::printf("%2d squares, spacing %.1f%s: %zu roots, %zu wanted, %zu placed for them\n",
                            divisions, spacing, masked ? ", a mask" : "", all.roots.size(), of_all.size(),
                            some.roots.size());
                EXPECT_LT(of_all.size(), all.roots.size() / 2);
                if (divisions == 40) {
                    EXPECT_LT(double(some.roots.size()), 1.3 * double(of_all.size()));
                }
                // Ranks are uniform.
                for (const double rank : {0.1, 0.3, 0.7}) {
                    const auto below =
                        double(std::ranges::count_if(all.ranks, [&](float r) { return double(r) < rank; }));
                    const auto count = double(all.ranks.size());
                    EXPECT_NEAR(below / count, rank, 0.01 + 3.0 * std::sqrt(rank / count)) << spacing;
                }
            }
}

TEST(LevelOfDetail, ACountIsMetWithinTwoPercent) {
    const TestSurface plane = grid_surface(40, 10.0);
    for (const double spacing : {0.0, 1.0}) {
        Groom groom;
        groom.count = 40000;
        groom.spacing = spacing;
        groom.density_masks.image = ScalarImage{2, 1, {0.05F, 0.4F}};
        const auto all =
            place_roots(groom, plane.surface(), not_cancelled, [](uint32_t, double) { return 1.0; });
        EXPECT_NEAR(double(all.roots.size()) / 40000.0, 1.0, 0.02) << spacing;
        const auto tenth =
            place_roots(groom, plane.surface(), not_cancelled, [](uint32_t, double) { return 0.1; });
        EXPECT_NEAR(double(tenth.roots.size()) / 4000.0, 1.0, 0.06) << spacing;
    }
}
