// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/predicates.h"
#include "tests/oracle/test_shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

namespace marram::oracle {
namespace {

const double inf = std::numeric_limits<double>::infinity();

TEST(OraclePredicates, PointsInAPlaneAndOneStepBesideItAreToldApart) {
    Draw draw(11);
    int checked = 0;
    for (int round = 0; round < 2000; ++round) {
        auto integer = [&] {
            return Vec3d(draw.below(2000) - 1000, draw.below(2000) - 1000, draw.below(2000) - 1000);
        };
        const Vec3d a = integer(), b = integer(), c = integer();
        const int i = draw.below(9) - 4, j = draw.below(9) - 4;
        Vec3d d = a + i * (b - a) + j * (c - a); // exact: small integers
        EXPECT_EQ(orientation(a, b, c, d), 0);
        const Vec3d normal = (b - a).cross(c - a);
        const int axis = draw.below(3);
        d[axis] = std::nextafter(d[axis], inf);
        EXPECT_EQ(orientation(a, b, c, d), normal[axis] > 0.0 ? 1 : normal[axis] < 0.0 ? -1 : 0);
        ++checked;
    }
    std::printf("  %d planes\n", checked);
}

TEST(OraclePredicates, TheSignTurnsWithTheOrderOfThePointsAtAnyScale) {
    Draw draw(12);
    for (double scale : {1e-30, 1e-6, 1.0, 1e7, 1e30})
        for (int round = 0; round < 500; ++round) {
            const Vec3d a = scale * draw.in_cube(), b = scale * draw.in_cube(), c = scale * draw.in_cube();
            Vec3d d = a + draw.unit() * (b - a) + draw.unit() * (c - a); // in the plane up to rounding
            const int sign = orientation(a, b, c, d);
            EXPECT_EQ(orientation(b, c, a, d), sign);
            EXPECT_EQ(orientation(b, a, c, d), -sign);
            EXPECT_EQ(orientation(d, c, b, a), sign) << "an even permutation";
        }
}

TEST(OracleTriangles, DistancesOfSimplePlacesAreTheObviousOnes) {
    const Triangle t{{0, 0, 0}, {4, 0, 0}, {0, 0, 4}};
    EXPECT_DOUBLE_EQ((nearest_point_on_triangle({1, 3, 1}, t) - Vec3d(1, 0, 1)).norm(), 0.0);
    EXPECT_DOUBLE_EQ((nearest_point_on_triangle({2, 3, -4}, t) - Vec3d(2, 0, 0)).norm(), 0.0);
    EXPECT_DOUBLE_EQ((nearest_point_on_triangle({-3, 3, -4}, t) - Vec3d(0, 0, 0)).norm(), 0.0);
    EXPECT_NEAR((nearest_point_on_triangle({4, 1, 4}, t) - Vec3d(2, 0, 2)).norm(), 0.0, 1e-15);
    EXPECT_DOUBLE_EQ(closest({1, 2, 1}, {1, 5, 1}, t).distance, 2.0);
    EXPECT_DOUBLE_EQ(closest({1, 2, 1}, {2, 2, 1}, t).distance, 2.0) << "parallel to the face";
    EXPECT_DOUBLE_EQ(closest({2, 1, -1}, {2, -1, -1}, t).distance, 1.0) << "edge against edge";
    EXPECT_DOUBLE_EQ(closest({1, -1, 1}, {1, 1, 1}, t).distance, 0.0);
    EXPECT_DOUBLE_EQ(closest({-2, 0, 1}, {-1, 0, 1}, t).distance, 1.0) << "in the plane, outside";
    EXPECT_DOUBLE_EQ(closest({1, 0, 1}, {1.5, 0, 1}, t).distance, 0.0) << "in the plane, inside";
    EXPECT_DOUBLE_EQ(closest({3, 4, 0}, {3, 4, 0}, t).distance, 4.0) << "segment of no length";
}

// Two convex sets are nearest at x and y if and only if the planes perpendicular to x - y at x and at y
// separate them.
void expect_nearest(const Vec3d& p, const Vec3d& q, const Triangle& t, double& worst) {
    const Closest c = closest(p, q, t);
    if (c.distance == 0.0) return;
    const Vec3d n = (c.on_segment - c.on_triangle) / c.distance;
    double excess = 0.0;
    for (const Vec3d& z : {t.a, t.b, t.c}) excess = std::max(excess, n.dot(z - c.on_triangle));
    for (const Vec3d& z : {p, q}) excess = std::max(excess, n.dot(c.on_segment - z));
    const double size = std::max({(t.b - t.a).norm(), (t.c - t.a).norm(), (q - p).norm(), c.distance});
    // Bound of the error relative to the sizes at hand; weighted down if the gap is below 1e-7 of the size,
    // where n is mostly rounding.
    worst = std::max(worst, excess / size * std::min(1.0, c.distance / size / 1e-7));
}

TEST(OracleTriangles, NearestPointsAreProvenByThePlanesThatPartThem) {
    for (uint64_t seed : {1, 2, 3}) {
        Draw draw(seed);
        double worst = 0.0;
        for (double scale : {1e-30, 1.0, 1e30}) {
            const std::vector<Triangle> mesh = moved(soup(draw, 10000, 1.0), scale, Vec3d::Zero());
            for (const Triangle& t : mesh) {
                const Vec3d p = scale * draw.in_cube();
                expect_nearest(p, p + scale * std::pow(10.0, -6.0 * draw.unit()) * draw.in_cube(), t, worst);
                expect_nearest(p, p, t, worst);
                expect_nearest(p, p + 0.7 * (t.b - t.a), t, worst); // parallel to an edge
            }
        }
        std::printf("  seed %d: nearest points off by %.1e of the size\n", int(seed), worst);
        EXPECT_LT(worst, 1e-11);
    }
}

TEST(OracleTriangles, ASegmentThroughAKnownPointCrossesAndTheMarginIsItsDistanceToTheBorder) {
    const Triangle t{{0, 0, 0}, {4, 0, 0}, {0, 0, 4}};
    const Crossing c = crossing({1, -0.5, 0.25}, {1, 2, 0.25}, t);
    EXPECT_TRUE(c.crosses);
    EXPECT_DOUBLE_EQ(c.parameter, 0.2);
    EXPECT_DOUBLE_EQ(c.margin, 0.25) << "from the edge z = 0";
    EXPECT_DOUBLE_EQ(crossing({1, -0.125, 1}, {1, 2, 1}, t).margin, 0.125) << "from the segment's start";
    EXPECT_DOUBLE_EQ(crossing({1, -1, -0.5}, {1, 1, -0.5}, t).margin, 0.5);
    EXPECT_FALSE(crosses({1, -1, -0.5}, {1, 1, -0.5}, t));
    EXPECT_TRUE(crosses({1, -1, 0}, {1, 1, 0}, t)) << "an edge dead on";
    EXPECT_TRUE(crosses({0, -1, 0}, {0, 1, 0}, t)) << "a vertex dead on";
    EXPECT_FALSE(crosses({0, -1, -5e-324}, {0, 1, -1e-300}, t)) << "beside it by the least there is";
    EXPECT_TRUE(crosses({-1, 0, 1}, {5, 0, 1}, t)) << "in the plane, through it";
    EXPECT_TRUE(crosses({0.5, 0, 1}, {1, 0, 1}, t)) << "in the plane, inside";
    EXPECT_FALSE(crosses({-1, 0, 1}, {-0.5, 0, 1}, t));
    EXPECT_FALSE(crosses({1, -1, 0}, {1, 1, 0}, {{0, 0, 0}, {2, 0, 0}, {4, 0, 0}})) << "no surface";
    EXPECT_EQ(crossing({1, -1, 0}, {1, 1, 0}, {{0, 0, 0}, {2, 0, 0}, {4, 0, 0}}).margin, 0.0);
}

TEST(OracleTriangles, NothingLeaksThroughEdgesAndCornersOfAClosedMesh) {
    const std::vector<Triangle> mesh =
        sphere_mesh(8, [](const Vec3d& u) { return 1.0 + 0.2 * u.x() * u.z(); });
    Draw draw(5);
    int shots = 0;
    for (const Triangle& t : mesh)
        for (int i = 0; i < 20; ++i, ++shots) {
            const double s = i == 0 ? 0.0 : draw.unit(); // first the corner, then points on the edge
            const Vec3d target = t.a + s * (t.b - t.a), from = 0.1 * draw.in_cube();
            const Vec3d to = from + 3.0 * (target - from);
            EXPECT_TRUE(std::any_of(mesh.begin(), mesh.end(), [&](auto& u) { return crosses(from, to, u); }));
        }
    std::printf("  %d shots\n", shots);
}

struct Case {
    double size, scale;
    Vec3d at;
};

void compare_searches(const Case& c, uint64_t seed) {
    Draw draw(seed);
    const std::vector<Triangle> mesh = moved(soup(draw, 1500, c.size), c.scale, c.at);
    const TriangleSet grid(mesh), plain(mesh, TriangleSet::Search::one_by_one);
    int hits = 0;
    for (int i = 0; i < 150; ++i) {
        const Vec3d p = c.at + c.scale * 1.5 * draw.in_cube();
        const double length = std::pow(10.0, 1.0 - 4.0 * draw.unit());
        const Vec3d q = i % 10 == 0 ? p : Vec3d(p + c.scale * length * draw.direction());
        const Nearest a = grid.nearest(p, q), b = plain.nearest(p, q);
        EXPECT_EQ(a.triangle, b.triangle);
        EXPECT_EQ(a.closest.distance, b.closest.distance);
        const double limit = c.scale * 0.3 * draw.unit();
        EXPECT_EQ(grid.nearest(p, q, limit).triangle, plain.nearest(p, q, limit).triangle);
        auto odd = [](int t) { return t % 7 == 3; };
        EXPECT_EQ(grid.nearest(p, p, inf, odd).triangle, plain.nearest(p, p, inf, odd).triangle);
        EXPECT_EQ(grid.within(p, q, limit), plain.within(p, q, limit));
        const std::vector<Hit> x = grid.crossings(p, q), y = plain.crossings(p, q);
        ASSERT_EQ(x.size(), y.size());
        for (size_t k = 0; k < x.size(); ++k) EXPECT_EQ(x[k].triangle, y[k].triangle);
        EXPECT_EQ(grid.any_crossing(p, q), !y.empty());
        hits += int(y.size());
    }
    std::printf("  size %g scale %g at %g: %d crossings, all found\n", c.size, c.scale, c.at.x(), hits);
}

TEST(OracleTriangleSet, GridAndBruteForceGiveTheSameAnswers) {
    uint64_t seed = 20;
    for (const Case& c : {Case{0.02, 1.0, Vec3d::Zero()}, Case{0.3, 1.0, Vec3d::Zero()},
                          Case{0.1, 1.0, Vec3d(1e7, -1e7, 3e6)}, Case{0.1, 1e-30, Vec3d::Zero()},
                          Case{0.1, 1e30, Vec3d::Zero()}, Case{0.1, 1e-4, Vec3d(1, 2, 3)}})
        compare_searches(c, seed++);
}

TEST(OracleTriangleSet, QueriesRightOnTheBordersOfCellsLoseNothing) {
    for (double at : {0.0, 1e3, -1e6}) {
        const double step = 0.1;
        const int count = 10;
        auto place = [&](int i) { return at + step * i; };
        std::vector<Triangle> mesh;
        for (int i = 0; i < count; ++i)
            for (int j = 0; j < count; ++j)
                for (int k = 0; k < count; ++k) // a facet across each axis in turn
                    mesh.push_back({{place(i), place(j), place(k)},
                                    {place(i + 1), place(j + (k + 1) % 2), place(k)},
                                    {place(i), place(j + k % 2), place(k + 1)}});
        const TriangleSet grid(mesh), plain(mesh, TriangleSet::Search::one_by_one);
        Draw draw(91);
        for (int n = 0; n < 300; ++n) {
            Vec3d p, q;
            for (int axis = 0; axis < 3; ++axis) p[axis] = place(draw.below(count + 3) - 1);
            q = p;
            const int along = draw.below(3);
            q[along] = place(draw.below(count + 3) - 1);
            const double reach = std::abs(place(draw.below(3)) - place(0));
            EXPECT_EQ(grid.within(p, q, reach), plain.within(p, q, reach));
            EXPECT_EQ(grid.any_crossing(p, q), plain.any_crossing(p, q));
            EXPECT_EQ(grid.nearest(p, q).triangle, plain.nearest(p, q).triangle);
        }
    }
}

TEST(OracleTriangleSet, FlatSingleAndEmptySetsAreSearchedToo) {
    const TriangleSet none{std::vector<Triangle>{}};
    EXPECT_EQ(none.nearest({0, 0, 0}, {1, 0, 0}).triangle, -1);
    EXPECT_FALSE(none.any_crossing({0, 0, 0}, {1, 0, 0}));
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    EXPECT_EQ(ground.nearest({3, 2, 1}, {3, 5, 1}).closest.distance, 2.0);
    EXPECT_EQ(ground.nearest({3, 2, 1}, {3, 5, 1}, 1.0).triangle, -1);
    EXPECT_DOUBLE_EQ(ground.nearest({1e30, 0, 0}, {1e30, 0, 0}).closest.distance, 1e30);
    const TriangleSet point({{Vec3d(1, 1, 1), Vec3d(1, 1, 1), Vec3d(1, 1, 1)}});
    EXPECT_EQ(point.nearest({1, 1, 3}, {1, 1, 3}).closest.distance, 2.0);
}

TEST(OracleTriangleSet, ASphereOfManyTrianglesHasTheSpheresDistances) {
    const int rows = 708; // 2 * rows * (2 * rows - 2) = 2.0 million triangles
    const TriangleSet set(sphere_mesh(rows, [](const Vec3d&) { return 1.0; }));
    const double sagitta =
        1.0 - std::cos(pi / rows); // the mesh lies at most that far inside (bound for a quad's diagonal)
    Draw draw(31);
    double worst = 0.0;
    for (int i = 0; i < 300; ++i) {
        const Vec3d u = draw.direction();
        const double r = 0.9 + 0.2 * draw.unit();
        worst = std::max(worst, std::abs(set.nearest(r * u, r * u).closest.distance - std::abs(r - 1.0)));
        EXPECT_EQ(set.crossings(0.9 * u, 1.1 * u).size(), 1u);
        EXPECT_FALSE(set.any_crossing(1.01 * u, 3.0 * u));
    }
    std::printf("  %zu triangles: distance off by %.2e, sagitta %.2e\n", set.triangles().size(), worst,
                sagitta);
    EXPECT_LT(worst, sagitta);
}

} // namespace
} // namespace marram::oracle
