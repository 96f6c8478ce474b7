// SPDX-License-Identifier: Apache-2.0
// Stages that query the skin around a strand: offset scale, the guarantees of collision, shielding.
#include "tests/oracle/offset_scale.h"
#include "tests/oracle/promise.h"
#include "tests/oracle/shield.h"
#include "tests/oracle/test_shapes.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram::oracle {
namespace {

TEST(OracleOffset, OverAPlaneHeightsAreHeights) {
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    const std::vector<Vec3d> rest{{1, 0, 0.5}, {1, 1, 0.5}, {1, 2, 0.5}, {1, 3, 0.5}};
    const std::vector<Vec3d> bent{{1, 0, 0.5}, {2, 0.2, 0.5}, {3, -1, 0.5}, {2, 2.9, 0.5}};
    const Pushed half = push_targets(rest, bent, y, 0.5, ground);
    EXPECT_EQ(half.skipped, 0);
    EXPECT_NEAR(half.cvs[1].y(), 0.5, 1e-15);
    EXPECT_NEAR(half.cvs[2].y(), 1.0, 1e-15) << "from below the skin";
    EXPECT_NEAR(half.push[2], 2.0, 1e-15);
    EXPECT_EQ((half.cvs[3] - bent[3]).norm(), 0.0) << "high enough";
    EXPECT_EQ((half.cvs[0] - bent[0]).norm(), 0.0);
    const Pushed whole = push_targets(rest, bent, y, 1.0, ground);
    for (size_t k = 1; k < 4; ++k) EXPECT_NEAR(whole.cvs[k].y(), rest[k].y(), 1e-15);
}

TEST(OracleOffset, OnAThinEarTheSideThatTheStrandGrowsOnCounts) {
    const TriangleSet ear(box_mesh({-5, -0.01, -5}, {5, 0.01, 5}));
    const std::vector<Vec3d> rest{{0, 0.01, 0.3}, {0, 1.01, 0.3}}, bent{{0, 0.01, 0.3}, {0.6, -0.5, 0.3}};
    const Pushed pushed = push_targets(rest, bent, y, 1.0, ear);
    EXPECT_NEAR((pushed.cvs[1] - Vec3d(0.6, 1.01, 0.3)).norm(), 0.0, 1e-14);
    EXPECT_EQ(push_targets(rest, bent, y, 1.0, TriangleSet(floor_mesh(0.0, 1.0))).skipped, 0);
    EXPECT_EQ(push_targets(rest, bent, -y, 1.0, TriangleSet(floor_mesh(0.0, 1.0))).skipped, 1) << "no side";
}

TEST(OracleOffset, SignsAreRightAroundEdgesAndCornersOfAClosedMesh) {
    const TriangleSet box(box_mesh({-1, -1, -1}, {1, 1, 1}));
    Draw draw(81);
    int on_edge = 0;
    for (int i = 0; i < 500; ++i) {
        const Vec3d p = 2.0 * draw.in_cube(), facing = p.normalized();
        const SkinPoint closest = closest_on_skin(p, facing, box);
        ASSERT_TRUE(closest.found);
        const Vec3d beyond = (p.cwiseAbs() - Vec3d::Ones()).cwiseMax(0.0);
        if (p.cwiseAbs().maxCoeff() > 1.0)
            EXPECT_NEAR(closest.height, beyond.norm(), 1e-14);
        else
            EXPECT_NEAR(closest.height, p.cwiseAbs().maxCoeff() - 1.0, 1e-14);
        on_edge += closest.on_edge ? 1 : 0;
    }
    std::printf("  %d of 500 feet on edges\n", on_edge);
    EXPECT_GT(on_edge, 50);
}

TEST(OracleOffset, AtASharpRidgeTheSignAndTheSideAreThoseOfTheRightFace) {
    // A wedge of 20 degrees, its ridge along z at the origin: normals (+-cos 10, sin 10).
    const double c = std::cos(10.0 * degree), s = std::sin(10.0 * degree), deep = 20.0;
    std::vector<Triangle> faces;
    for (double side : {1.0, -1.0}) {
        const Vec3d front(0, 0, 9), back(0, 0, -9), closest(side * s * deep, -c * deep, 0);
        faces.push_back(side > 0.0 ? Triangle{front, closest, back} : Triangle{back, closest, front});
    }
    const Vec3d normal(c, s, 0), other(-c, s, 0);
    for (int order = 0; order < 2; ++order, std::swap(faces[0], faces[1])) {
        const TriangleSet wedge(faces);
        for (double angle :
             {15.0, 90.0, 165.0}) { // the ridge is nearest; the outer two points are below one face's plane
            const Vec3d p(0.1 * std::cos(angle * degree), 0.1 * std::sin(angle * degree), 0.2);
            const SkinPoint closest = closest_on_skin(p, y, wedge);
            EXPECT_TRUE(closest.on_edge);
            EXPECT_NEAR(closest.height, 0.1, 1e-15) << angle;
        }
        // A CV bent over the ridge and down beside the other face still belongs to the face that it grows on.
        const Vec3d rest = Vec3d(s, -c, 0) + 0.3 * normal, bent = Vec3d(-s, -c, 0) + 0.1 * other;
        const Pushed pushed = push_targets({rest, rest}, {rest, bent}, y, 1.0, wedge);
        EXPECT_EQ(pushed.skipped, 0);
        EXPECT_NEAR(pushed.push[1], 0.3 - normal.dot(bent), 1e-14);
        EXPECT_NEAR((pushed.cvs[1] - bent - pushed.push[1] * normal).norm(), 0.0, 1e-14);
    }
}

TEST(OracleOffset, AroundASphereHeightsAreRadii) {
    const TriangleSet sphere(sphere_mesh(100, [](const Vec3d&) { return 1.0; }));
    Draw draw(82);
    double worst = 0.0, aside = 0.0;
    for (int i = 0; i < 200; ++i) {
        const Vec3d u = draw.direction(), v = (u + 0.4 * draw.in_cube()).normalized();
        const std::vector<Vec3d> rest{u, 1.3 * u}, bent{u, (0.7 + 0.5 * draw.unit()) * v};
        const Pushed pushed = push_targets(rest, bent, u, 0.8, sphere);
        EXPECT_EQ(pushed.skipped, 0);
        worst = std::max(worst, std::abs(pushed.cvs[1].norm() - std::max(1.24, bent[1].norm())));
        aside = std::max(aside, (pushed.cvs[1] - bent[1]).cross(u).norm());
    }
    // A push may stop at 0.98 of a height of 0.24. Facet normals differ from the sphere's by at most 1.6
    // degrees, over a push of 0.56: errors of 5e-4 in height and 0.016 sideways.
    std::printf("  radius off by %.1e, the way by %.1e\n", worst, aside);
    EXPECT_LT(worst, 0.02 * 0.24 + 1e-3);
    EXPECT_LT(aside, 0.016);
}

TEST(OraclePromise, CrossedSegmentsAreCounted) {
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    EXPECT_EQ(crossed_segments({{0, 1, 0.5}, {1, 0.5, 0.5}, {2, -0.5, 0.5}, {3, 0.5, 0.5}}, ground), 2);
    EXPECT_EQ(crossed_segments({{0, 1, 0.5}, {1, 0.25, 0.5}}, ground), 0);
}

TEST(OraclePromise, SplinesMeetTheirClosedForms) {
    const std::vector<Vec3d> cvs{{0, 0, 0}, {1, 2, 0}, {3, 1, 1}, {4, 4, 2}};
    for (size_t k = 0; k < 3; ++k) {
        EXPECT_NEAR((spline_point(cvs, Spline::catmull_rom, k, 0.0) - cvs[k]).norm(), 0.0, 1e-15);
        EXPECT_NEAR((spline_point(cvs, Spline::catmull_rom, k, 1.0) - cvs[k + 1]).norm(), 0.0, 1e-15);
    }
    for (size_t k = 1; k < 3; ++k)
        EXPECT_NEAR(
            (spline_point(cvs, Spline::b_spline, k, 0.0) - (cvs[k - 1] + 4.0 * cvs[k] + cvs[k + 1]) / 6.0)
                .norm(),
            0.0, 1e-15);
    EXPECT_NEAR((spline_point(cvs, Spline::b_spline, 0, 0.0) - cvs[0]).norm(), 0.0, 1e-15)
        << "by the phantom CV";
    EXPECT_NEAR((spline_point(cvs, Spline::b_spline, 2, 1.0) - cvs[3]).norm(), 0.0, 1e-15);
    EXPECT_NEAR((spline_point({{0, 0, 0}, {2, 0, 0}}, Spline::b_spline, 0, 0.5) - x).norm(), 0.0, 1e-15);
}

TEST(OraclePromise, ACurveThatCutsTheCornerDipsByWhatItCuts) {
    // The polygon goes over a narrow plate at height 0.8, the B-spline passes under it at 2/3.
    const TriangleSet plate({{Vec3d(-0.01, 0.8, -9), Vec3d(-0.01, 0.8, 9), Vec3d(0.01, 0.8, 9)},
                             {Vec3d(-0.01, 0.8, -9), Vec3d(0.01, 0.8, 9), Vec3d(0.01, 0.8, -9)}});
    const std::vector<Vec3d> cvs{{-1, 0, 0.5}, {0, 1, 0.5}, {1, 0, 0.5}};
    const double r = 0.01;
    const std::vector<double> dips = deepest_penetrations(cvs, {r, r, r}, Spline::b_spline, 64, 1.0, plate);
    EXPECT_NEAR(dips[0], r + 0.8 - 2.0 / 3.0, 1e-12);
    EXPECT_NEAR(dips[1], r + 0.8 - 2.0 / 3.0, 1e-12);
    const std::vector<double> above =
        deepest_penetrations({{0, 0.3, 0}, {1, 0.3, 0}, {2, 0.3, 0}}, {0.1, 0.1, 0.2}, Spline::catmull_rom,
                             16, 1.0, TriangleSet(floor_mesh(0.0, 10.0)));
    EXPECT_NEAR(above[0], 0.1 - 0.3, 1e-15);
    EXPECT_NEAR(above[1], 0.2 - 0.3, 1e-15);
}

TEST(OracleShield, AWallUpwindShieldsWhatIsLowerThanIt) {
    const TriangleSet wall({{Vec3d(-1, -1, -5), Vec3d(-1, -1, 5), Vec3d(-1, 0.5, 5)},
                            {Vec3d(-1, -1, -5), Vec3d(-1, 0.5, 5), Vec3d(-1, 0.5, -5)}});
    std::vector<Vec3d> cvs;
    for (int k = 0; k < 10; ++k) cvs.push_back({0, 0.1 * k + 0.05, 0.2});
    const Shielding behind = shield_curve(cvs, x, 3.0, 1e-3, wall);
    for (size_t k = 0; k < 10; ++k) EXPECT_EQ(behind.hit[k], k < 5) << k;
    EXPECT_DOUBLE_EQ(behind.alpha, 0.5);
    EXPECT_EQ(shield_curve(cvs, x, 0.9, 1e-3, wall).alpha, 0.0) << "the ray begins behind the wall";
    EXPECT_EQ(shield_curve(cvs, -x, 3.0, 1e-3, wall).alpha, 0.0) << "the lee is on the other side";
    const Shielding edge =
        shield_curve({{0, 0.5 + 2e-6, 0.2}, {0, 0.5 - 2e-6, 0.2}, {0, 0.5 - 4e-6, 0.2}}, x, 3.0, 1e-3, wall);
    EXPECT_TRUE(edge.grazing[0] && edge.grazing[1] && !edge.hit[0] && edge.hit[1]);
    EXPECT_FALSE(edge.grazing[2]);
    EXPECT_TRUE(shield_curve({{2, 0.2, 0.3}}, x, 3.0, 1e-3, wall).grazing[0]) << "the ray begins on the wall";
    EXPECT_DOUBLE_EQ(shield_envelope(0.5, 0.5), 0.75);
    EXPECT_EQ(shield_envelope(2.0, 1.0), 0.0);
}

TEST(OracleShield, OnASphereWindwardRootsAreOpenAndLeeRootsShieldedAtAnyScale) {
    for (double scale : {1e-4, 1.0, 1e5}) {
        const std::vector<Triangle> mesh =
            moved(sphere_mesh(24, [](const Vec3d&) { return 1.0; }), scale, Vec3d::Zero());
        const TriangleSet set(mesh);
        int wrong = 0, sample_patches = 0;
        for (const Triangle& t : mesh) {
            const Vec3d root = (t.a + t.b + t.c) / 3.0, normal = area_normal(t).normalized();
            if (std::abs(normal.dot(x)) < 0.05) continue;
            const Shielding s = shield_curve({root}, x, 10.0 * scale, 1e-4, set);
            wrong += s.hit[0] != (normal.dot(x) > 0.0) ? 1 : 0;
            ++sample_patches;
        }
        std::printf("  scale %g: %d roots\n", scale, sample_patches);
        EXPECT_EQ(wrong, 0);
    }
}

TEST(OracleShield, ShelterFadesWithTheDistanceBehindTheNearestOfSeveralWalls) {
    std::vector<Triangle> walls;
    for (double at : {-1.0, -2.0}) // two triangles each
        for (const auto& [b, c] :
             {std::pair(Vec3d(at, -9, 9), Vec3d(at, 9, 9)), {Vec3d(at, 9, 9), Vec3d(at, 9, -9)}})
            walls.push_back({Vec3d(at, -9, -9), b, c});
    const TriangleSet set(walls);
    const Fade fade = [](int triangle) { return triangle < 2 ? 1.6 : 4.0; };
    const auto at = [&](double px) { return shelter_from({px, 0.2, 0.3}, -x, 8.0, 1e-6, set, fade).value; };
    EXPECT_NEAR(at(0.0), 1.0 - 1.0 / 1.6, 1e-15);
    EXPECT_NEAR(at(0.5), 1.0 - 1.5 / 1.6, 1e-15);
    EXPECT_EQ(at(0.7), 0.0) << "the wall behind the nearest one does not count";
    EXPECT_NEAR(at(-1.5), 1.0 - 0.5 / 4.0, 1e-15);
    EXPECT_EQ(at(-2.5), 0.0);
    EXPECT_EQ(shelter_from({0, 0.2, 0.3}, -x, 8.0, 1e-6, set).value, 1.0);
}

TEST(OracleShield, ABallInAConeOfWindSheltersByItsShareOfTheSolidAngle) {
    const double spread = 20 * degree, distance = 3.0, radius = 0.6, fade = 5.0;
    const TriangleSet ball(moved(sphere_mesh(96, [&](const Vec3d&) { return radius; }), 1.0, -x * distance));
    const double share = (1.0 - std::sqrt(1.0 - 0.04)) / (1.0 - std::cos(spread));
    const Vec3d p = Vec3d::Zero();
    EXPECT_NEAR(cone_shelter(p, -x, x, spread, 20000, 8.0, 1e-6, ball), share, 2e-3 * share);
    // Fading: 1 - d / fade over the directions that hit, d = D c - sqrt(r^2 - D^2 (1 - c^2)); by the midpoint
    // rule in c.
    double faded = 0.0;
    const int n = 100000;
    const double low = std::sqrt(1.0 - 0.04);
    for (int i = 0; i < n; ++i) {
        const double c = low + (1.0 - low) * (i + 0.5) / n;
        const double d =
            distance * c - std::sqrt(std::max(radius * radius - distance * distance * (1.0 - c * c), 0.0));
        faded += share / n * (1.0 - d / fade);
    }
    EXPECT_NEAR(cone_shelter(p, -x, x, spread, 20000, 8.0, 1e-6, ball, [&](int) { return fade; }), faded,
                2e-3 * faded);
    // The half of the cone below the ground is excluded.
    const TriangleSet wall({{Vec3d(-1, 0, -50), Vec3d(-1, 0, 50), Vec3d(-1, -50, 0)}});
    EXPECT_EQ(cone_shelter(p, y, x, spread, 4096, 8.0, 1e-6, wall), 0.0);
    EXPECT_NEAR(cone_shelter(p, -x, x, spread, 4096, 8.0, 1e-6, wall), 0.5, 1e-3);
}

} // namespace
} // namespace marram::oracle
