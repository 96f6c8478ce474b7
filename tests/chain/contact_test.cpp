// SPDX-License-Identifier: Apache-2.0
// Solves each segment of the chain again with the oracle, from the same state.
#include "tests/chain/furred_collision.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

struct Agreement {
    size_t segments = 0, contacts = 0, grazes = 0, pushed_out = 0, larger_out = 0, not_free = 0, worse = 0,
           pockets = 0;
    double worst_angle = 0.0;
};

// Compares every `stride`-th traced segment.
Agreement compare(const Fur& fur, const oracle::TriangleSet& set, size_t stride) {
    Agreement sum;
    for (size_t i = 0; i < fur.trace.size(); i += stride) {
        const SegmentTrace& trace = fur.trace[i];
        const Segment& s = trace.segment;
        if (trace.turned.outcome == Outcome::unresolved) {
            ++sum.pockets;
            EXPECT_FALSE(oracle::any_free_direction(s.pivot, s.length, 0.0, set, 20000).has_value());
            continue;
        }
        ++sum.segments;
        const double margin = 0.25 * trace.rounding;
        const double kept = trace.turned.clearance - margin;
        sum.not_free += !oracle::is_free(s.pivot, trace.turned.direction, s.length, kept, set);
        const oracle::SegmentTurn turn =
            oracle::turn_segment(s.pivot, s.from, s.goal, s.lean, s.length, s.clearance, set,
                                 std::max(margin, 1e-7 * s.clearance));
        if (trace.turned.pushed_out || !turn.start_free) {
            ++sum.pushed_out;
            // Directions differ if a narrow free range was skipped; then the chain's turn is the larger one.
            const double mine = angle_between(s.from, trace.turned.direction);
            const double theirs = angle_between(s.from, turn.direction);
            sum.larger_out += std::abs(mine - theirs) > 1e-4;
            continue;
        }
        const double angle = angle_between(s.from, trace.turned.direction);
        sum.contacts += turn.contact.touches;
        if (turn.contact.grazes(1e-4)) {
            ++sum.grazes;
            const bool between = angle >= turn.contact.earliest - 1e-4 && angle <= turn.contact.latest + 1e-4;
            sum.worse += !between;
            continue;
        }
        const double error = std::abs(angle - std::min(turn.contact.angle, turn.goal_angle));
        sum.worst_angle = std::max(sum.worst_angle, error);
        if (error > 1e-4 && sum.worse++ < 3)
            std::printf("  segment %d of strand %zu: angle %.9g, oracle %.9g (%.9g ... %.9g), goal %.9g, c "
                        "%.3g, l %.3g\n",
                        trace.index, trace.strand, angle, turn.contact.angle, turn.contact.earliest,
                        turn.contact.latest, turn.goal_angle, s.clearance, s.length);
    }
    std::printf("  %zu segments, %zu contacts, %zu grazing; worst angle %.2g rad; %zu turned out, %zu of "
                "them farther "
                "than the oracle; %zu nearer than their clearance; %zu pockets\n",
                sum.segments, sum.contacts, sum.grazes, sum.worst_angle, sum.pushed_out, sum.larger_out,
                sum.not_free, sum.pockets);
    return sum;
}

void expect_agreement(std::vector<Mesh> meshes, const FurOptions& options, size_t stride) {
    const oracle::TriangleSet set = triangle_set(meshes);
    const FurredWorld world(std::move(meshes));
    const Fur fur = blow(world, options, true);
    const Agreement sum = compare(fur, set, stride);
    EXPECT_GT(sum.contacts, 10U);
    EXPECT_EQ(sum.worse, 0U);
    EXPECT_EQ(sum.not_free, 0U);
    EXPECT_LT(sum.worst_angle, 1e-4);
    EXPECT_LE(sum.larger_out, sum.pushed_out / 20);
}

} // namespace

TEST(Contact, AgreesWithTheOracleOnABumpySphere) {
    for (const Vec3d& wind : {Vec3d(1, 0, 0), Vec3d(0, -1, 0.3)}) {
        FurOptions options;
        options.wind = wind;
        expect_agreement({sphere_mesh(1.0F, 71, 0.03F, 9.0F)}, options, 1);
    }
}

TEST(Contact, AgreesWithTheOracleOnADenseSphere) {
    FurOptions options;
    options.count = 1000;
    expect_agreement({sphere_mesh(1.0F, 500, 0.03F, 9.0F)}, options, 4);
}

TEST(Contact, AgreesWithTheOracleWhereTheClearanceIsTinyOrWide) {
    for (const double clearance : {1e-6, 1e-4, 0.02}) {
        FurOptions options;
        options.count = 400;
        options.collision.clearance = clearance;
        options.collision.offset_root = clearance * 1.5;
        std::printf(" clearance %g\n", clearance);
        expect_agreement({sphere_mesh(1.0F, 24, 0.1F, 12.0F)}, options, 1);
    }
}

} // namespace marram
