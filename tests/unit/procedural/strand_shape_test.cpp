// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/strand_shape.h"

#include "procedural/groom/roots.h"
#include "tests/unit/procedural/test_surfaces.h"

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

// Everything at once.
Groom wild_groom(int cvs) {
    Groom groom = plain_groom(cvs);
    groom.lean = 0.4;
    groom.lean_variation = 0.3;
    groom.arc = 1.0;
    groom.arc_variation = 0.5;
    groom.curl_radius = 0.03;
    groom.curl_turns = 2.5;
    groom.clump_size = 0.1;
    groom.clump_amount = 0.6;
    groom.clump_profile = Ramp(std::vector<double>{0, 0, 1, 1}, "linear");
    groom.frizz_amplitude = 0.02;
    groom.frizz_frequency = 5.0;
    return groom;
}

} // namespace

TEST(StrandShape, begins_at_its_root_with_equal_segments_of_the_length_asked) {
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

TEST(StrandShape, stands_up_leans_and_combs) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom groom = plain_groom(8);
    const std::vector<Root> roots = roots_on(groom, plane);
    const Strands upright = grown(groom, plane, plane, roots);
    for (int i = 0; i < upright.count; ++i) {
        const Vec3d d = cv(upright, i, 7) - cv(upright, i, 0);
        EXPECT_LT(std::hypot(d.x(), d.z()), 1e-5);
    }
    groom.combed = true;
    groom.comb = Vec3d(0.6, 0.5, 0.8).normalized(); // its part along the surface counts
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

TEST(StrandShape, clumps_draw_tips_together) {
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
    groom.clump_size = 0.15;
    groom.clump_amount = 0.95;
    groom.clump_profile = Ramp(std::vector<double>{0, 0, 1, 1}, "linear");
    EXPECT_LT(mean_tip_gap(grown(groom, plane, plane, roots)), 0.3 * loose);
}

TEST(StrandShape, rides_rigidly_with_its_surface) {
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

// A parameter changes what it is for and nothing else.
TEST(StrandShape, parameters_do_not_reshuffle_each_other) {
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

TEST(StrandShape, ribbons_face_across_their_length) {
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

TEST(StrandShape, length_masks_shorten) {
    const TestSurface plane = grid_surface(10, 1.0);
    Groom groom = plain_groom(4);
    groom.length = {1.0, 1.0};
    groom.length_masks.image = Mask{2, 1, {0.25F, 0.75F}};
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
