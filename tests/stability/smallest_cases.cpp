// SPDX-License-Identifier: Apache-2.0
// Minimal reproductions of bugs that the fuzz tests in this folder have found. The comments describe the
// bugs.
#include "tests/oracle/contact.h"
#include "tests/stability/coat.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram::stability {
namespace {

using oracle::Triangle;

// A turn in the plane z = 0 from x towards y, length 1; the blocked interval of the triangle.
std::vector<Blocked> blocked_by(const Triangle& t, double clearance, double end = 2.0) {
    const TurningCapsule capsule{Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ(), 1.0, clearance};
    TriangleList list;
    list.push(t.a, t.b, t.c);
    std::vector<Blocked> blocked;
    blocked_turns(capsule, 0.0, end, list.blocks(), 1, blocked);
    return blocked;
}

// Maximum depth, in lengths, by which a turn outside of all intervals is blocked, and by which one inside is
// free.
struct IntervalError {
    double missed = 0.0, invented = 0.0, ends = 0.0; // ends: error of the interval's ends
};
IntervalError interval_error(const Triangle& t, double clearance) {
    const std::vector<Blocked> blocked = blocked_by(t, clearance);
    IntervalError result;
    const auto room_at = [&](double p) {
        const Vec2d cs = from_diamond(p);
        return oracle::closest(Vec3d::Zero(), Vec3d(cs.x(), cs.y(), 0), t).distance - clearance;
    };
    for (const Blocked& b : blocked)
        result.ends = std::max({result.ends, std::abs(room_at(b.low)), std::abs(room_at(b.high))});
    constexpr int turns = 20000;
    for (int k = 0; k <= turns; ++k) {
        const double p = 2.0 * k / turns, room = room_at(p);
        bool in = false;
        for (const Blocked& b : blocked)
            for (const double period : {-4.0, 0.0, 4.0}) in |= b.low <= p + period && p + period <= b.high;
        (in ? result.invented : result.missed) =
            std::max(in ? result.invented : result.missed, in ? room : -room);
    }
    return result;
}

// contact.cpp, end_touches(): the window of turns beside the edge is the whole circle, cut at an arbitrary
// turn. If that turn was blocked, both searches stopped there at once, and the interval was that one turn.
TEST(SmallestCases, AnEdgeThatTheEndIsBesideAllTheWayRound) {
    // An edge across the plane, beyond the segment's reach but within its clearance, just before half a turn.
    const Vec3d on = 1.1 * Vec3d(std::cos(3.1), std::sin(3.1), 0), out = 2.0 * on;
    const Triangle t{on + Vec3d(0, 0, 5), on - Vec3d(0, 0, 5), out};
    const double half = std::acos((1.1 * 1.1 + 1.0 - 0.3 * 0.3) / 2.2); // half of the blocked interval
    const Scene scene({body_of({t})});
    Segment segment{
        Vec3d::Zero(), Vec3d::UnitX(), Vec3d(std::cos(3.05), std::sin(3.05), 0), Vec3d::UnitX(), 1.0, 0.3};
    TurnScratch scratch;
    const Turned turned = turn_exactly(scene.colliders(), segment, scratch);
    row("edge across the plane at half a turn: contact angle", std::abs(turned.turned_angle - (3.1 - half)),
        1e-4, "rad");
    // The same with a slanted edge, as BlockedTurns found it.
    const Triangle slanted{{-0.17695472903534887, 1.0810354548170571, 0.67055650138846756},
                           {-0.17695470923876744, 1.0810353298722895, -0.6705564769394049},
                           {-0.28527667088312308, 1.7427849325344, -5.3941843214388996e-08}};
    row("edge across the plane: blocked turns missed", interval_error(slanted, 0.211).missed, 1e-8,
        "of the length");
    const Triangle oblique{{0.67302332749625593, 0.66698329708500737, 0.24493530042586462},
                           {0.11547694170002865, 1.5321593380842511, -0.19446857800316875},
                           {0.2651978166202153, -0.41473827699789939, 1.235952847224405}};
    row("oblique edge: blocked turns missed", interval_error(oblique, 0.286).missed, 1e-8, "of the length");
}

// The same function: a window that is blocked at both ends and free in the middle.
TEST(SmallestCases, AnEdgeWhoseWindowIsBlockedAtBothEnds) {
    const Triangle t{{-1.3015711227112228, 2.7299429154451134, 0.93040389922075373},
                     {-1.2260416161781702, 2.4624718412926621, 1.6635041327451703},
                     {-1.8087500197757898, 2.7702218843802324, 1.4106442722432093}};
    row("window blocked at both ends: end of the interval", interval_error(t, 2.9999333).ends, 1e-8,
        "of the length");
}

// contact.cpp, first_root(): 200 steps of a parabola with the circle's curvature were not enough if the edge
// runs along the circle: the search stopped short.
TEST(SmallestCases, AnEdgeThatRunsAlongTheCircle) {
    const Triangle t{{0.9646434174128764, 0.32025752410550945, 0.00063173533663201005},
                     {0.78864522839470164, 0.6419663456204987, -0.00063173419275642378},
                     {1.0373818644638396, 0.56932647808314085, 4.9412344795690677e-08}};
    row("edge along the circle: free turns called blocked", interval_error(t, 1.73e-5).invented, 1e-7,
        "of the length");
}

// turn.cpp, turn_out_in_plane(): the sweep of an unverified pivot returned at once, without a contact, if a
// triangle was closer to the pivot than 1.1 clearances. not_clear was ignored, so the part that was not swept
// counted as free.
TEST(SmallestCases, TurningOutOfAColliderFromADoubtedPivot) {
    const Segment segment{{0.028476134609573257, -0.005795822719368543, 0.00077632372380043841},
                          {-0.5300602429009742, -0.6053849936075919, 0.59375512495514182},
                          {0.66117129214778592, 0.74004348247382912, -0.12324027948537998},
                          {-0.011107599526780221, 0.016266156486664927, -0.02211409332553552},
                          0.029614181361410183,
                          0.0017355342235089346,
                          true};
    const Scene scene({body_of({{{0.029906062409281731, -0.004452709574252367, 0.0017889058217406273},
                                 {0.029764179140329361, -0.0050367172807455063, 0.0023619001731276512},
                                 {0.029540436342358589, -0.0047080903314054012, 0.0024402157869189978}},
                                {{0.022796368226408958, -0.0088893603533506393, -0.0006351004121825099},
                                 {0.038914550095796585, 0.016372485086321831, 0.015173116698861122},
                                 {0.011650983244180679, -0.0085849640890955925, 0.0095992246642708778}},
                                {{0.015190619044005871, -0.0016844784840941429, -0.015464914962649345},
                                 {0.049406692385673523, -0.024333326146006584, -0.026119491085410118},
                                 {0.042990308254957199, 0.016124755144119263, 0.0026043369434773922}},
                                {{-0.021044427528977394, 0.0043661966919898987, -0.026162987574934959},
                                 {0.063012458384037018, -0.024236211553215981, 0.053700156509876251},
                                 {0.041292671114206314, -0.016696486622095108, -0.043100759387016296}},
                                {{0.02738255076110363, -0.0070780264213681221, 0.0038879434578120708},
                                 {0.02746729739010334, -0.0067528551444411278, 0.0035410253331065178},
                                 {0.027565157040953636, -0.0065748468041419983, 0.0037879180163145065}}})});
    TurnScratch scratch;
    const Turned turned = turn_exactly(scene.colliders(), segment, scratch);
    if (turned.outcome == Outcome::not_clear)
        return; // solved again with a smaller clearance, which is also correct
    const double kept = scene.triangles()
                            .nearest(segment.pivot, segment.pivot + turned.direction * segment.length)
                            .closest.distance;
    row("doubted pivot, turned out: nearer than claimed by", turned.clearance - kept, 1e-6 * turned.clearance,
        "m");
}

// turn.cpp, arc_of(): for nearly equal directions the cross product has a relative error of 1e-16 / sine, so
// the plane's normal was not perpendicular to `from`, and gather() rejects triangles by their height above
// that plane.
TEST(SmallestCases, ThePlaneOfATurnThatIsHardlyOne) {
    double worst = 0.0;
    long long crossed = 0;
    Draw draw(31);
    for (double off = 1e-17; off < 1e-3; off *= 3.0)
        for (int i = 0; i < 100; ++i) {
            Segment segment{Vec3d::Zero(), draw.direction(), Vec3d::Zero(), draw.direction(), 1.0, 1e-5};
            segment.goal = (segment.from + off * draw.in_cube()).normalized();
            const TurningCapsule capsule = arc_of(segment).capsule;
            worst = std::max({worst, std::abs(capsule.normal.dot(capsule.from)),
                              std::abs(capsule.across.dot(capsule.from)),
                              std::abs(capsule.normal.dot(capsule.across)),
                              std::abs(capsule.normal.norm() - 1.0)});
            // A triangle across the segment.
            Vec3d side, other;
            orthonormal_basis<double>(segment.from, side, other);
            const Vec3d at = 0.7 * segment.from;
            const Scene scene(
                {body_of({{at + 0.1 * side, at - 0.1 * side + 0.05 * other, at - 0.1 * other}})});
            TurnScratch scratch;
            const Turned turned = turn_exactly(scene.colliders(), segment, scratch);
            crossed += scene.triangles().any_crossing(Vec3d::Zero(), turned.direction);
        }
    row("goal nearly at the start: frame of the turn", worst, 1e-12, "rad");
    none("goal nearly at the start: crosses a triangle", crossed, "segments");
}

// collide.cpp, advance(): a target was accepted if it was within 1e-5 lengths + 2^-22 of the largest
// coordinate of the end, which is up to four ulps; accuracy.md allows two.
TEST(SmallestCases, LengthsWhereTargetsAreTakenOver) {
    double worst = 0.0;
    for (const double far : {60.0, 100.0, 120.0, 200.0}) {
        const Coat coat({.place = far * Vec3d(1, -0.7, 0.4), .offset_scale = 0.4});
        ChainScratch scratch;
        const auto rest = coat.rest(coat.roots());
        const auto pose = coat.poses(coat.roots(), 512, scratch)[0];
        for (size_t i = 0; i < pose.size(); ++i) worst = std::max(worst, worst_length(pose[i], rest[i]));
    }
    row("pushed targets 60 ... 200 sizes from the origin: lengths", worst, 1.0, "of allowed");
}

// collide.cpp, solve_strand(): if the required clearance was below four roundings of a CV, nothing was tried,
// not even in open air: every segment was unresolved and the strand stayed at rest in the wind. By default
// the clearance is the greater of the radius and L / 800; the rounding is 2^-23 of the distance from the
// origin.
TEST(SmallestCases, FurBendsAKilometreFromTheOrigin) {
    // Strands 0.15 ... 0.25 m long; the float resolution is 0.06 mm here.
    for (const double hair : {0.1, 1.0})
        for (const double far : {300.0, 1e3}) {
            const Coat coat({.place = far * Vec3d::UnitX(), .hair = hair});
            ChainScratch scratch;
            coat.poses(coat.roots(), 512, scratch);
            char name[96];
            std::snprintf(name, sizeof name, "fur %g mm thick, %g m from the origin: unresolved", hair, far);
            none(name, (long long)scratch.counts.unresolved, "of 12000 segments");
        }
    // In open air nothing is unresolved, at any distance.
    const Vec3d far(1e5, 0, 0);
    const Scene scene({body_of(oracle::floor_mesh(-50.0, 10.0))});
    Strands strands = strands_of({straight(far, Vec3d(0, 0.1, 0), 6)}, 0.002);
    set_pose(strands, {straight(far, Vec3d(0, 0, 0.1), 6)});
    const Verdict verdict = solve(scene, strands, {}, false);
    none("open air 1e5 m from the origin: unresolved", verdict.unresolved, "of 5 segments");
}

} // namespace
} // namespace marram::stability
