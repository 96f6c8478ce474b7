// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/grown/strand_shape.h"

#include "procedural/strands/grown/roots.h"
#include "tests/unit/strands/test_surfaces.h"

#include <gtest/gtest.h>

#include <cstring>

using namespace marram;

namespace {

Groom plain_groom(int cvs) {
    Groom groom;
    groom.count = 200;
    groom.length = {0.2, 0.4};
    groom.width = 0.01;
    groom.cvs = cvs;
    return groom;
}

std::vector<Root> roots_on(const Groom& groom, const TestSurface& mesh) {
    return place_roots(groom, mesh.surface(), [] { return false; }).roots;
}

Strands grown(const Groom& groom, const TestSurface& bind, const TestSurface& now,
              const std::vector<Root>& roots) {
    Strands strands;
    strands.resize(int(roots.size()), groom.cvs, groom.shape == MARRAM_ORIENTED_RIBBON);
    expand(groom, Wind{}, {bind.surface(), now.surface()}, roots, strands);
    return strands;
}

Vec3d cv(const Strands& strands, int strand, int k) {
    const Wide3f& v = strands.rest[size_t(strand / lanes) * size_t(strands.cvs) + size_t(k)];
    return {double(v.x[strand % lanes]), double(v.y[strand % lanes]), double(v.z[strand % lanes])};
}

// All features at once.
Groom wild_groom(int cvs) {
    Groom groom = plain_groom(cvs);
    groom.lean = 0.4;
    groom.lean_variation = 0.3;
    groom.arc = 1.0;
    groom.arc_variation = 0.5;
    groom.curl_radius = 0.03;
    groom.curl_turns = 2.5;
    groom.clumps = {{0.1, 0.6, Ramp(std::vector<double>{0, 0, 1, 1}, "linear")}};
    groom.frizz_amplitude = 0.02;
    groom.frizz_frequency = 5.0;
    return groom;
}

} // namespace

TEST(StrandShape, BeginsAtItsRootWithEqualSegmentsOfTheLengthAsked) {
    const TestSurface sphere = sphere_surface(30);
    for (const int cvs : {2, 3, 8, 200, 1000}) {
        for (const Groom& groom : {plain_groom(cvs), wild_groom(cvs)}) {
            const std::vector<Root> roots = roots_on(groom, sphere);
            const Strands strands = grown(groom, sphere, sphere, roots);
            for (int i = 0; i < int(roots.size()); ++i) {
                const Vec3d root = sphere.surface().point(roots[size_t(i)].triangle,
                                                          root_weights(groom.seed, roots[size_t(i)]));
                EXPECT_LT((cv(strands, i, 0) - root).norm(), 1e-6);
                double length = 0.0, shortest = 1.0, longest = 0.0;
                for (int k = 1; k < cvs; ++k) {
                    const double segment = (cv(strands, i, k) - cv(strands, i, k - 1)).norm();
                    length += segment;
                    shortest = std::min(shortest, segment);
                    longest = std::max(longest, segment);
                }
                EXPECT_GT(length, 0.2 - 1e-4);
                EXPECT_LT(length, 0.4 + 1e-4);
                EXPECT_LT(longest - shortest, 1e-6);
            }
        }
    }
}

TEST(StrandShape, StandsUpLeansAndCombs) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom groom = plain_groom(8);
    const std::vector<Root> roots = roots_on(groom, plane);
    const Strands upright = grown(groom, plane, plane, roots);
    for (int i = 0; i < upright.count; ++i) {
        const Vec3d d = cv(upright, i, 7) - cv(upright, i, 0);
        EXPECT_LT(std::hypot(d.x(), d.z()), 1e-5);
    }
    groom.combed = true;
    groom.comb = Vec3d(0.6, 0.5, 0.8).normalized(); // only its component along the surface counts
    groom.lean = 30.0 * degree;
    const Strands combed = grown(groom, plane, plane, roots);
    for (int i = 0; i < combed.count; ++i) {
        const Vec3d d = (cv(combed, i, 7) - cv(combed, i, 0)).normalized();
        EXPECT_NEAR(d.y(), std::cos(30.0 * degree), 1e-4);
        EXPECT_NEAR(std::atan2(d.z(), d.x()), std::atan2(0.8, 0.6), 1e-3);
    }
    groom.arc = 60.0 * degree;
    const Strands arced = grown(groom, plane, plane, roots);
    for (int i = 0; i < arced.count; ++i) {
        const Vec3d last = (cv(arced, i, 7) - cv(arced, i, 6)).normalized();
        EXPECT_NEAR(std::acos(last.y()) / degree, 30.0 + 60.0 * 6.5 / 7.0, 0.1);
    }
}

TEST(StrandShape, ClumpsDrawTipsTogether) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom groom = plain_groom(8);
    groom.count = 2000;
    groom.length = {0.5, 0.5};
    const std::vector<Root> roots = roots_on(groom, plane);
    const auto mean_tip_gap = [&](const Strands& strands) {
        double sum = 0.0;
        for (int i = 0; i < strands.count; ++i) {
            double nearest = 1e9;
            for (int j = 0; j < strands.count; ++j)
                if (i != j) nearest = std::min(nearest, (cv(strands, i, 7) - cv(strands, j, 7)).norm());
            sum += nearest;
        }
        return sum / strands.count;
    };
    const double loose = mean_tip_gap(grown(groom, plane, plane, roots));
    const Ramp to_the_tip(std::vector<double>{0, 0, 1, 1}, "linear");
    groom.clumps = {{0.15, 0.95, to_the_tip}};
    const Strands coarse = grown(groom, plane, plane, roots);
    EXPECT_LT(mean_tip_gap(coarse), 0.3 * loose);

    // Fine clumps inside coarse ones: tips of a fine clump stay together, and it moves to the coarse clump's
    // center as a whole.
    groom.clumps = {{0.3, 0.5, to_the_tip}, {0.05, 1.0, to_the_tip}};
    groom.lean = groom.lean_variation = groom.arc = groom.arc_variation = 0.0;
    const Strands both = grown(groom, plane, plane, roots);
    groom.clumps = {{0.3, 0.0, to_the_tip}, {0.05, 1.0, to_the_tip}};
    const Strands fine = grown(groom, plane, plane, roots);
    groom.clumps = {{0.3, 0.5, to_the_tip}};
    EXPECT_LT(mean_tip_gap(both), 0.2 * mean_tip_gap(grown(groom, plane, plane, roots)));
    int together = 0, torn = 0;
    for (int i = 0; i < fine.count; ++i)
        for (int j = 0; j < i; ++j) {
            const auto apart = [&](const Strands& strands) {
                const Vec3d gap = cv(strands, i, 7) - cv(strands, j, 7);
                return std::hypot(gap.x(), gap.z());
            };
            if (apart(fine) > 1e-3) continue; // not in the same fine clump
            (apart(both) < 4e-3 ? together : torn) += 1;
        }
    EXPECT_GT(together, 1000);
    EXPECT_LT(torn, together / 200);
}

TEST(StrandShape, RidesRigidlyWithItsSurface) {
    const TestSurface sphere = sphere_surface(24);
    const Eigen::Affine3d motion =
        Eigen::Translation3d(3.0, -2.0, 0.5) * Eigen::AngleAxisd(1.1, Vec3d(1, 2, 3).normalized());
    TestSurface moved = sphere;
    for (size_t i = 0; i < sphere.positions.size(); i += 3) {
        const Vec3d p = motion * Vec3d(double(sphere.positions[i]), double(sphere.positions[i + 1]),
                                       double(sphere.positions[i + 2]));
        const Vec3d n = motion.linear() * Vec3d(double(sphere.normals[i]), double(sphere.normals[i + 1]),
                                                double(sphere.normals[i + 2]));
        for (size_t axis = 0; axis < 3; ++axis) {
            moved.positions[i + axis] = float(p[int(axis)]);
            moved.normals[i + axis] = float(n[int(axis)]);
        }
    }
    const Groom groom = wild_groom(12);
    const std::vector<Root> roots = roots_on(groom, sphere);
    const Strands rest = grown(groom, sphere, sphere, roots), carried = grown(groom, sphere, moved, roots);
    for (int i = 0; i < rest.count; ++i)
        for (int k = 0; k < groom.cvs; ++k)
            EXPECT_LT((motion * cv(rest, i, k) - cv(carried, i, k)).norm(), 2e-5);
}

// A parameter changes only its own property.
TEST(StrandShape, ParametersDoNotReshuffleEachOther) {
    const TestSurface plane = grid_surface(10, 1.0);
    const Groom groom = wild_groom(8);
    const std::vector<Root> roots = roots_on(groom, plane);
    const Strands before = grown(groom, plane, plane, roots);
    Groom wider = groom;
    wider.width = 0.5;
    wider.density_masks.by_slope = Ramp(std::vector<double>{0, 1}, "linear");
    const Strands after = grown(wider, plane, plane, roots);
    EXPECT_EQ(0, std::memcmp(before.rest.data(), after.rest.data(), before.rest.size() * sizeof(Wide3f)));
    Groom other = groom;
    other.seed = 1;
    const Strands reseeded = grown(other, plane, plane, roots);
    EXPECT_NE(0, std::memcmp(before.rest.data(), reseeded.rest.data(), before.rest.size() * sizeof(Wide3f)));
}

TEST(StrandShape, RibbonsFaceAcrossTheirLength) {
    const TestSurface sphere = sphere_surface(24);
    Groom groom = wild_groom(9);
    groom.shape = MARRAM_ORIENTED_RIBBON;
    const std::vector<Root> roots = roots_on(groom, sphere);
    const Strands strands = grown(groom, sphere, sphere, roots);
    for (int i = 0; i < strands.count; ++i)
        for (int k = 1; k < groom.cvs; ++k) {
            const Wide3f& wide = strands.rest_normal[size_t(i / lanes) * size_t(groom.cvs) + size_t(k)];
            const Vec3d n(double(wide.x[i % lanes]), double(wide.y[i % lanes]), double(wide.z[i % lanes]));
            EXPECT_NEAR(n.norm(), 1.0, 1e-5);
            EXPECT_NEAR(n.dot((cv(strands, i, k) - cv(strands, i, k - 1)).normalized()), 0.0, 1e-4);
        }
}

TEST(StrandShape, LengthMasksShorten) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom groom = plain_groom(4);
    groom.length = {1.0, 1.0};
    groom.length_masks.image = ScalarImage{2, 1, {0.25F, 0.75F}};
    const std::vector<Root> roots = roots_on(groom, plane);
    const Strands strands = grown(groom, plane, plane, roots);
    for (int i = 0; i < strands.count; ++i) {
        const double x = cv(strands, i, 0).x(), length = (cv(strands, i, 3) - cv(strands, i, 0)).norm();
        if (std::abs(x - 0.25) < 0.01) {
            EXPECT_NEAR(length, 0.25, 0.03);
        }
        if (std::abs(x - 0.75) < 0.01) {
            EXPECT_NEAR(length, 0.75, 0.03);
        }
    }
}

// A factor scales its parameter: the result equals a groom with the scaled parameter. 0 removes it, 1 keeps
// it.
TEST(StrandShape, FactorsScaleWhatTheyAreOf) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom whole = wild_groom(8);
    whole.lean_variation = whole.arc_variation = 0.0;
    const std::vector<Root> roots = roots_on(whole, plane);
    const Factor halves{
        "", "", ScalarImage{2, 1, {0.0F, 1.0F}},
        Ramp(std::vector<double>{0, 0, 0.5, 1}, "constant")}; // 0 on one half of the plane, 1 on the other
    const auto without = [&](FactorOf what) {
        Groom groom = whole;
        if (what == of_width) groom.width = 0.0;
        if (what == of_lean) groom.lean = 0.0;
        if (what == of_arc) groom.arc = 0.0;
        if (what == of_curl) groom.curl_radius = 0.0;
        if (what == of_clump) groom.clumps.clear();
        if (what == of_frizz) groom.frizz_amplitude = 0.0;
        return groom;
    };
    const Strands full = grown(whole, plane, plane, roots);
    for (const FactorOf what : {of_width, of_lean, of_arc, of_curl, of_clump, of_frizz}) {
        SCOPED_TRACE(what);
        Groom scaled = whole;
        scaled.factors[what] = {halves};
        const Strands mixed = grown(scaled, plane, plane, roots),
                      none = grown(without(what), plane, plane, roots);
        int changed = 0, kept = 0;
        for (int i = 0; i < mixed.count; ++i) {
            const Root root = roots[size_t(i)];
            const double share = halves(plane.surface(), root.triangle, root_weights(whole.seed, root));
            ASSERT_TRUE(share == 0.0 || share == 1.0);
            const Strands& expected = share == 0.0 ? none : full;
            const auto width = [&](const Strands& s) { return s.width[size_t(i / lanes)][i % lanes]; };
            EXPECT_EQ(width(mixed), width(expected));
            for (int k = 0; k < whole.cvs; ++k)
                EXPECT_LT((cv(mixed, i, k) - cv(expected, i, k)).norm(), 1e-7) << i << " " << k;
            (share == 0.0 ? changed : kept) += 1;
        }
        EXPECT_GT(changed, 50);
        EXPECT_GT(kept, 50);
    }
    // Several factors are multiplied.
    Groom twice = whole;
    twice.factors[of_width] = {
        {"", "", ScalarImage{1, 1, {0.5F}}, Ramp(std::vector<double>{0, 0, 1, 1}, "linear")},
        {"", "", ScalarImage{1, 1, {0.25F}}, Ramp(std::vector<double>{0, 1, 1, 0}, "linear")}};
    const Strands thin = grown(twice, plane, plane, roots);
    for (int i = 0; i < thin.count; ++i)
        EXPECT_DOUBLE_EQ(thin.width[size_t(i / lanes)][i % lanes],
                         0.5 * 0.75 * full.width[size_t(i / lanes)][i % lanes]);
}

// A comb map combs along u and v in any orientation of the surface. Where it is grey, `comb` is used.
TEST(StrandShape, CombMapsGoByUv) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom groom = plain_groom(8);
    groom.lean = 0.8;
    groom.lean_variation = groom.comb_variation = 0.0;
    groom.combed = true;
    groom.comb = Vec3d(0, 0, 1);
    groom.comb_map = {ScalarImage{1, 1, {1.0F}}, ScalarImage{1, 1, {0.5F}}}; // along u
    const std::vector<Root> roots = roots_on(groom, plane);
    const Surface surface = plane.surface();
    const auto expect_towards = [&](auto&& direction_at) {
        const Strands strands = grown(groom, plane, plane, roots);
        for (int i = 0; i < strands.count; ++i) {
            Vec3d lean = cv(strands, i, 7) - cv(strands, i, 0);
            lean.y() = 0.0;
            EXPECT_GT(lean.normalized().dot(direction_at(roots[size_t(i)].triangle)), 0.999) << i;
        }
    };
    expect_towards([&](uint32_t t) { return surface.uv_directions(t)[0]; });
    groom.comb_map = {ScalarImage{1, 1, {0.5F}}, ScalarImage{1, 1, {0.0F}}};
    expect_towards([&](uint32_t t) { return Vec3d(-surface.uv_directions(t)[1]); });
    groom.comb_map = {ScalarImage{1, 1, {0.5F}}, ScalarImage{1, 1, {128.0F / 255.0F}}};
    expect_towards([&](uint32_t) { return groom.comb; });
    for (uint32_t t = 0; t < surface.triangle_count; ++t) { // u and v of the grid are x and z, up to sign
        const auto [u, v] = surface.uv_directions(t);
        EXPECT_NEAR(std::abs(u.x()), 1.0, 1e-6);
        EXPECT_NEAR(std::abs(v.z()), 1.0, 1e-6);
    }
}

// Both 8-bit codes next to the middle count as grey, also where the angle between u and v is small.
TEST(StrandShape, GreyCombMapsChangeNothing) {
    TestSurface plane = grid_surface(4, 1.0);
    for (size_t v = 0; v + 1 < plane.uvs.size(); v += 2) plane.uvs[v] += 0.9F * plane.uvs[v + 1];
    Groom groom = plain_groom(8);
    groom.lean = 0.8;
    groom.combed = true;
    groom.comb = Vec3d(0, 0, 1);
    const std::vector<Root> roots = roots_on(groom, plane);
    const Strands without = grown(groom, plane, plane, roots);
    for (const float code : {127.0F / 255.0F, 128.0F / 255.0F}) {
        groom.comb_map = {ScalarImage{1, 1, {code}}, ScalarImage{1, 1, {code}}};
        const Strands with = grown(groom, plane, plane, roots);
        for (int i = 0; i < without.count; ++i) EXPECT_EQ(cv(with, i, 7), cv(without, i, 7)) << i;
    }
}
