// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/contact.h"
#include "tests/oracle/test_shapes.h"
#include "tests/oracle/turn.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram::oracle {
namespace {

TEST(OracleContact, OntoAPlaneTheTipTouchesWhereTheSineSays) {
    for (double scale : {1e-30, 1e-3, 1.0, 1e5, 1e30})
        for (double c : {0.0, 1e-3, 0.1}) {
            const TriangleSet ground(moved(floor_mesh(0.0, 10.0), scale, Vec3d::Zero()));
            const double h = 0.6, l = 1.0;
            const Contact contact =
                first_contact({0, h * scale, 0}, x, -z, 0.5 * pi, l * scale, c * scale, ground, 1e-7 * scale);
            const double exact = std::asin((h - c) / l);
            EXPECT_TRUE(contact.touches);
            EXPECT_NEAR(contact.angle, exact, 1e-9) << scale << ' ' << c;
            EXPECT_LE(contact.earliest, contact.angle);
            EXPECT_GE(contact.latest, contact.angle);
            EXPECT_FALSE(contact.grazes(1e-6));
        }
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    EXPECT_FALSE(first_contact({0, 0.6, 0}, x, -z, 0.5, 1.0, 0.0, ground).touches);
    EXPECT_EQ(first_contact({0, 0.6, 0}, x, -z, 0.5, 1.0, 0.0, ground).angle, 0.5);
    EXPECT_FALSE(first_contact({0, 2.0, 0}, x, -z, pi, 1.0, 0.5, ground).touches) << "out of reach";
}

// Contact angle of an edge or corner at distance r from the pivot and angle phi in the plane of the sweep.
double sharp_contact(double r, double phi, double l, double c) {
    if (r * std::cos(std::asin(std::min(1.0, c / r))) <= l)
        return phi - std::asin(c / r);                               // touched by the side
    return phi - std::acos((l * l + r * r - c * c) / (2.0 * l * r)); // by the tip
}

TEST(OracleContact, EdgesAndCornersTouchWhereTheCircleAroundThemSays) {
    const double phi = 1.1, l = 1.0;
    const Vec3d at = std::cos(phi) * x + std::sin(phi) * y,
                beyond = std::cos(phi + 0.4) * x + std::sin(phi + 0.4) * y;
    for (double r : {0.2, 0.7, 0.98, 1.005})
        for (double c : {1e-4, 0.01, 0.05}) {
            // an edge across the plane; its face points away from the approaching segment
            const TriangleSet edge({{r * at - 3.0 * z, r * at + 3.0 * z, 2.0 * beyond}});
            // a corner with its face behind it
            const TriangleSet corner({{r * at, 2.0 * beyond + z, 2.0 * beyond - z}});
            const bool touches = r < l + c;
            for (const TriangleSet* set : {&edge, &corner}) {
                const Contact contact = first_contact(Vec3d::Zero(), x, z, 2.0, l, c, *set);
                // A face that widens could be touched before its corner; these faces lie on the far side of
                // it.
                EXPECT_EQ(contact.touches, touches) << r << ' ' << c;
                EXPECT_NEAR(contact.angle, touches ? sharp_contact(r, phi, l, c) : 2.0, 1e-9)
                    << r << ' ' << c;
            }
        }
}

TEST(OracleContact, ACornerInTheWayWithoutClearanceIsHitDeadOn) {
    const double phi = 0.8;
    const Vec3d at = 0.5 * (std::cos(phi) * x + std::sin(phi) * y);
    const TriangleSet edge({{at - z, at + z, 3.0 * at + y}});
    const Contact contact = first_contact(Vec3d::Zero(), x, z, 2.0, 1.0, 0.0, edge);
    EXPECT_NEAR(contact.angle, phi, 1e-9);
}

TEST(OracleContact, AGrazeIsToldByTheMargin) {
    // A corner beside the plane of the sweep is closer than the clearance by a tenth of the margin, or
    // farther by as much.
    const double c = 0.1, margin = 1e-6;
    for (double by : {-0.1, 0.1}) {
        const TriangleSet spike({{Vec3d(0.3, 0.3, c - by * margin), Vec3d(0.3, 0.4, 2), Vec3d(0.4, 0.3, 2)}});
        const Contact contact = first_contact(Vec3d::Zero(), x, z, 2.0, 1.0, c, spike, margin);
        EXPECT_EQ(contact.touches, by > 0.0);
        EXPECT_TRUE(contact.grazes(0.1)) << by;
        EXPECT_LT(contact.earliest, pi / 4);
        EXPECT_EQ(contact.latest, 2.0);
    }
}

TEST(OracleContact, SlidingAlongASheetJustOutsideTheClearanceCostsNothing) {
    // The distance is constant over the whole rotation: the chord bound alone would need 1e12 intervals.
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    EXPECT_FALSE(first_contact({0, 0.1 + 1e-12, 0}, x, y, 3.0, 1.0, 0.1, ground).touches);
    EXPECT_EQ(first_contact({0, 0.1 - 1e-12, 0}, x, y, 3.0, 1.0, 0.1, ground).angle, 0.0);
}

TEST(OracleContact, RandomContactsAgreeWithAScan) {
    for (uint64_t seed : {41, 42, 43}) {
        Draw draw(seed);
        int touched = 0;
        double worst = 0.0;
        for (int i = 0; i < 60; ++i) {
            const TriangleSet set(soup(draw, 12, 0.5));
            const Vec3d pivot = 0.3 * draw.in_cube(), u = draw.direction(),
                        axis = u.cross(draw.direction()).normalized();
            const double length = 0.8, c = i % 3 == 0 ? 0.0 : 0.02, whole = 3.0;
            if (!is_free(pivot, u, length, c, set)) continue;
            const Contact contact = first_contact(pivot, u, axis, whole, length, c, set);
            auto free_at = [&](double a) { return is_free(pivot, turned(u, axis, a), length, c, set); };
            constexpr int steps = 400;
            for (int k = 0; k <= steps; ++k) {
                const double a = contact.angle * k / steps - (k == steps ? 1e-9 : 0.0);
                EXPECT_TRUE(a < 0.0 || free_at(a)) << seed << ' ' << i << ' ' << a;
            }
            if (!contact.touches) continue;
            ++touched;
            const Vec3d tip = pivot + length * turned(u, axis, contact.angle);
            worst = std::max(worst, std::abs(set.nearest(pivot, tip).closest.distance - c));
        }
        std::printf("  seed %d: %d contacts, distance there off by %.1e\n", int(seed), touched, worst);
        EXPECT_GT(touched, 10);
        EXPECT_LT(worst, 1e-9);
    }
}

TEST(OracleContact, OutOfAPlaneTheSmallerTurnIsWhereTheCosineSays) {
    const TriangleSet ground(floor_mesh(0.0, 10.0));
    for (double c : {0.0, 0.05}) {
        const double h = 0.6, exact = std::acos((h - c) / 1.0);
        const auto found = first_free({0, h, 0}, -y, z, 1.0, c, ground);
        ASSERT_TRUE(found);
        EXPECT_NEAR(*found, exact, 1e-9);
        const auto slanted = first_free({0, h, 0}, turned(-y, z, 0.3), -z, 1.0, c, ground);
        ASSERT_TRUE(slanted);
        EXPECT_NEAR(*slanted, exact + 0.3, 1e-9);
    }
    EXPECT_EQ(first_free({0, 0.6, 0}, y, z, 1.0, 0.0, ground).value(), 0.0) << "free as it is";
    EXPECT_FALSE(first_free({0, 0.04, 0}, -y, z, 1.0, 0.05, ground)) << "the pivot is too near";
}

TEST(OracleContact, RandomWaysOutAgreeWithAScan) {
    for (uint64_t seed : {51, 52, 53}) {
        Draw draw(seed);
        int out = 0, none = 0;
        for (int i = 0; i < 60; ++i) {
            const TriangleSet set(soup(draw, 40, 0.6));
            const Vec3d pivot = 0.3 * draw.in_cube(), u = draw.direction(),
                        axis = u.cross(draw.direction()).normalized();
            const double length = 0.8, c = i % 2 == 0 ? 0.0 : 0.02;
            const auto found = first_free(pivot, u, axis, length, c, set);
            (found ? out : none) += 1;
            auto free_at = [&](double a) { return is_free(pivot, turned(u, axis, a), length, c, set); };
            EXPECT_TRUE(!found || free_at(*found + 1e-13)) << seed << ' ' << i;
            const double until = found.value_or(2.0 * pi) - 1e-9;
            for (double a = 0.0; a < until; a += 0.01)
                EXPECT_FALSE(free_at(a)) << seed << ' ' << i << ' ' << a;
        }
        std::printf("  seed %d: %d found, %d planes without\n", int(seed), out, none);
        EXPECT_GT(out, 10);
    }
}

TEST(OracleContact, AClosedBoxHasNoFreeDirectionAndASmallHoleInItIsFound) {
    std::vector<Triangle> box = box_mesh({-1, -1, -1}, {1, 1, 1});
    const Vec3d pivot(0.1, 0.2, -0.1);
    EXPECT_FALSE(any_free_direction(pivot, 2.5, 0.0, TriangleSet(box), 20000));
    EXPECT_TRUE(any_free_direction(pivot, 0.5, 0.0, TriangleSet(box), 20000)) << "shorter than the box";
    box.back() = {box.back().a, box.back().b, box.back().a + 0.99 * (box.back().c - box.back().a)};
    const auto found = any_free_direction(pivot, 2.5, 0.0, TriangleSet(box), 20000);
    ASSERT_TRUE(found);
    EXPECT_FALSE(TriangleSet(box).any_crossing(pivot, pivot + 2.5 * *found));
    // The segment only just fits into one corner: no sample is free, but the search around the best ones
    // finds it.
    const double diagonal = (Vec3d(-1, -1, 1) - pivot).norm();
    EXPECT_TRUE(any_free_direction(pivot, diagonal - 1e-4, 0.0,
                                   TriangleSet(box_mesh({-1, -1, -1}, {1, 1, 1})), 20000));
}

TEST(OracleContact, ASlitIsFreeForWhatIsThinnerThanIt) {
    // Two sheets with a slit of 0.02 between them; the segment reaches through it.
    std::vector<Triangle> box = box_mesh({-1, -1, -1}, {1, 1, 1});
    std::erase_if(box, [](const Triangle& t) { return area_normal(t).y() > 0.0; });
    for (double side : {-1.0, 1.0}) {
        const Vec3d a(0.01 * side, 1, -1), b(0.01 * side, 1, 1), c(side, 1, 1), d(side, 1, -1);
        box.push_back({a, b, c});
        box.push_back({a, c, d});
    }
    const TriangleSet set(box);
    EXPECT_TRUE(any_free_direction(Vec3d::Zero(), 2.5, 0.0, set, 20000));
    const auto thin = any_free_direction(Vec3d::Zero(), 2.5, 0.0099, set, 20000);
    ASSERT_TRUE(thin);
    EXPECT_TRUE(is_free(Vec3d::Zero(), *thin, 2.5, 0.0099, set));
    EXPECT_FALSE(any_free_direction(Vec3d::Zero(), 2.5, 0.0101, set, 20000));
}

TEST(OracleContact, SlidingAlongAnEdgeWithinRoundingOfItIsDecided) {
    // The segment points at one edge, ends beyond it and slides along it over the whole rotation.
    const TriangleSet wall({{Vec3d(-1, 1, 0), Vec3d(1, 1, 0), Vec3d(0, 1, -3)}});
    for (double above : {0.0, 1e-15, 1e-13, 1e-11, 1e-9})
        for (double c : {0.0, 1e-12, 1e-6, 1e-2}) {
            const Vec3d a = Vec3d(-0.5, 1, c + above).normalized(), b = Vec3d(0.5, 1, c + above).normalized();
            const Turn turn = shortest_turn(a, b, a, a, a);
            const Contact contact = first_contact(Vec3d::Zero(), a, turn.axis, turn.angle, 2.0, c, wall);
            EXPECT_TRUE(contact.angle >= 0.0 && contact.angle <= turn.angle);
        }
}

} // namespace
} // namespace marram::oracle
