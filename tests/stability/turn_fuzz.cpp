// SPDX-License-Identifier: Apache-2.0
// Compares turn_exactly() with the oracle, on random segments among random triangles: the same first contact,
// a free result, a way out if there is one. Every mismatch is printed with a minimal set of triangles that
// shows it.
#include "tests/oracle/contact.h"
#include "tests/oracle/turn.h"
#include "tests/stability/scene.h"
#include "tests/stability/table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <optional>

namespace marram::stability {
namespace {

using oracle::Triangle;
using oracle::TriangleSet;

double log_uniform(Draw& draw, double low, double high) { return low * std::pow(high / low, draw.unit()); }

struct Problem {
    Segment segment;
    std::vector<Triangle> triangles; // rounded to float
};

Triangle to_floats(const Triangle& t) {
    return {t.a.cast<float>().cast<double>(), t.b.cast<float>().cast<double>(),
            t.c.cast<float>().cast<double>()};
}

// Kinds of triangles.
enum class Kind { soup, spikes, slivers, fan, sheets, dead_on, count };
const char* const kind_names[] = {
    "soup", "spikes", "slivers", "fan about a point", "near-parallel sheets", "features dead on the circle"};

Triangle draw_triangle(Draw& draw, Kind kind, const Segment& s, const Vec3d& normal) {
    const double l = s.length;
    const double size = l * log_uniform(draw, 1e-2, 10.0);
    const Vec3d at = s.pivot + l * log_uniform(draw, 0.05, 1.3) * draw.direction();
    switch (kind) {
    case Kind::spikes: { // a point near the swept sector, the base far away
        const double turn = pi * draw.signed_unit();
        const Vec3d in_plane = s.from * std::cos(turn) + normal.cross(s.from) * std::sin(turn);
        const Vec3d tip = s.pivot + in_plane * l * draw.unit() + 1e-3 * l * draw.unit() * draw.in_cube();
        const Vec3d base = tip + 3.0 * l * draw.direction();
        return {tip, base, base + l * log_uniform(draw, 1e-6, 1e-2) * draw.in_cube()};
    }
    case Kind::slivers:
        return {at, at + size * draw.direction(), at + size * 1e-5 * draw.in_cube()};
    case Kind::sheets: { // nearly in the plane of the turn
        const double tilt = log_uniform(draw, 1e-9, 1e-1);
        const auto tilted = [&](const Vec3d& d) { return Vec3d(d - normal * normal.dot(d) * (1.0 - tilt)); };
        const Vec3d centre = s.pivot + l * draw.unit() * tilted(draw.direction()) +
                             normal * s.clearance * 3.0 * draw.signed_unit();
        return {centre + size * tilted(draw.in_cube()), centre + size * tilted(draw.in_cube()),
                centre + size * tilted(draw.in_cube())};
    }
    case Kind::dead_on: { // vertices and edges in the plane, on the circle of the segment's end
        const double turn = pi * draw.signed_unit();
        const Vec3d in_plane = s.from * std::cos(turn) + normal.cross(s.from) * std::sin(turn);
        const double reach = l + (draw.below(3) - 1) * s.clearance * draw.unit();
        const Vec3d on = s.pivot + in_plane * reach;
        const Vec3d across = draw.below(2) == 0 ? normal : Vec3d(draw.direction());
        const Vec3d away = in_plane * size;
        if (draw.below(2) == 0) return {on, on + across * size + away, on - across * size + away};
        return {on + across * size, on - across * size, on + away};
    }
    default:
        return {at + size * draw.in_cube(), at + size * draw.in_cube(), at + size * draw.in_cube()};
    }
}

Problem draw_problem(Draw& draw, Kind kind) {
    Problem p;
    Segment& s = p.segment;
    const double scale = log_uniform(draw, 1e-3, 1e3);
    s.length = scale;
    s.clearance = scale * log_uniform(draw, 1e-6, 2.0);
    s.pivot = scale * 2.0 * draw.in_cube();
    s.from = draw.direction();
    const int ends = draw.below(10);
    s.goal = ends == 0   ? Vec3d(-s.from)
             : ends == 1 ? Vec3d(s.from + 1e-3 * draw.in_cube()).normalized()
             : ends == 2 ? Vec3d(-s.from + 1e-5 * draw.in_cube()).normalized()
             : ends == 3 ? Vec3d(s.from + log_uniform(draw, 1e-18, 1e-6) * draw.in_cube()).normalized()
             : ends == 4 ? s.from
                         : draw.direction();
    s.lean = scale * draw.direction();
    s.clearance_unverified = draw.below(2) == 0;
    const Vec3d normal = arc_of(s).capsule.normal;
    const int count = 1 + int(log_uniform(draw, 1.0, 40.0));
    const Vec3d centre = s.pivot + s.length * 0.7 * draw.direction();
    for (int i = 0; i < count; ++i) {
        Triangle t = draw_triangle(draw, kind, s, normal);
        if (kind == Kind::fan) t.a = centre;
        t = to_floats(t);
        if (oracle::closest(s.pivot, s.pivot, t).distance > 1.2 * s.clearance) p.triangles.push_back(t);
    }
    return p;
}

struct Fault {
    enum Kind {
        contact,
        not_free,
        no_way_out,
        not_finite,
        called_blocked,
        called_free,
        not_clear,
        count
    } kind;
    double size;
};
const char* const fault_names[] = {"contact angle",
                                   "result not free",
                                   "a way out missed",
                                   "not finite",
                                   "free start called blocked",
                                   "blocked start called free",
                                   "undoubted pivot called not clear"};

struct Seen {
    int problems = 0, contacts = 0, outs = 0, grazes = 0, unresolved = 0, reduced = 0,
        clearance_unverified = 0;
    double worst = 0.0;
    std::array<int, Fault::count> faults{};
};

std::optional<Fault> fault_of(const Problem& p, Seen& seen) {
    const Scene scene({body_of(p.triangles)});
    const TriangleSet& set = scene.triangles();
    const Segment& s = p.segment;
    TurnScratch scratch;
    Turned turned = turn_exactly(scene.colliders(), s, scratch);
    if (turned.outcome == Outcome::not_clear) { // allowed: the pivot "may be too near"
        ++seen.clearance_unverified;
        Segment sure = s;
        sure.clearance_unverified = false;
        turned = turn_exactly(scene.colliders(), sure, scratch);
    }
    if (turned.outcome == Outcome::not_clear) return Fault{Fault::not_clear, 0.0};
    if (!turned.direction.allFinite() || !std::isfinite(turned.turned_angle) ||
        std::abs(turned.direction.norm() - 1.0) > 1e-9)
        return Fault{Fault::not_finite, 0.0};
    const double margin = 1e-9 * s.length;
    if (oracle::is_free(s.pivot, s.from, s.length, s.clearance + margin, set) == turned.pushed_out &&
        oracle::is_free(s.pivot, s.from, s.length, s.clearance - margin, set) == turned.pushed_out)
        return Fault{turned.pushed_out ? Fault::called_blocked : Fault::called_free, 0.0};
    if (turned.outcome == Outcome::unresolved) {
        ++seen.unresolved;
        // The solver states that no direction is free by 1e-6 lengths. It should find a free cone 0.3 rad
        // wide.
        const auto way = oracle::any_free_direction(s.pivot, s.length, 1e-4 * s.length, set, 1000);
        if (way) return Fault{Fault::no_way_out, 0.0};
        return std::nullopt;
    }
    const double kept = turned.clearance * (1.0 - 1e-6) - margin;
    if (!oracle::is_free(s.pivot, turned.direction, s.length, std::max(kept, 0.0), set))
        return Fault{Fault::not_free, turned.clearance};
    if (turned.pushed_out) {
        ++seen.outs;
        seen.reduced += turned.clearance < 0.9 * s.clearance;
        return std::nullopt;
    }
    const Arc arc = arc_of(s);
    const oracle::Contact contact = oracle::first_contact(s.pivot, s.from, arc.capsule.normal, arc.angle,
                                                          s.length, s.clearance, set, margin);
    seen.contacts += contact.touches;
    const double error = turned.turned_angle > contact.latest     ? turned.turned_angle - contact.latest
                         : turned.turned_angle < contact.earliest ? contact.earliest - turned.turned_angle
                                                                  : 0.0;
    if (contact.grazes(1e-4)) ++seen.grazes;
    if (error > 1e-4) return Fault{Fault::contact, error};
    if (!contact.grazes(1e-4))
        seen.worst = std::max(seen.worst, std::abs(turned.turned_angle - contact.angle));
    return std::nullopt;
}

void print(const Problem& p) {
    const auto vec = [](const Vec3d& v) { std::printf("{%.17g, %.17g, %.17g}", v.x(), v.y(), v.z()); };
    const Segment& s = p.segment;
    std::printf("    Segment{");
    vec(s.pivot);
    std::printf(", ");
    vec(s.from);
    std::printf(", ");
    vec(s.goal);
    std::printf(", ");
    vec(s.lean);
    std::printf(", %.17g, %.17g, %s}\n", s.length, s.clearance, s.clearance_unverified ? "true" : "false");
    for (const Triangle& t : p.triangles) {
        std::printf("    {");
        vec(t.a);
        std::printf(", ");
        vec(t.b);
        std::printf(", ");
        vec(t.c);
        std::printf("}\n");
    }
}

// Removes triangles as long as the same kind of fault remains.
Problem smallest(Problem p, Fault::Kind kind) {
    Seen ignored;
    for (size_t i = 0; i < p.triangles.size() && p.triangles.size() > 1;) {
        Problem less = p;
        less.triangles.erase(less.triangles.begin() + long(i));
        const auto fault = fault_of(less, ignored);
        if (fault && fault->kind == kind)
            p = less;
        else
            ++i;
    }
    return p;
}

void fuzz(Kind kind) {
    const char* many = std::getenv("MARRAM_FUZZ"); // manual: more problems
    const int problems = many ? std::atoi(many) : 500;
    Seen seen;
    for (const uint64_t seed : {11, 12, 13}) {
        for (int i = 0; i < problems; ++i) {
            Draw draw(hash(hash(seed, uint64_t(kind)), uint64_t(i)));
            const Problem problem = draw_problem(draw, kind);
            if (problem.triangles.empty()) continue;
            ++seen.problems;
            const auto fault = fault_of(problem, seen);
            if (!fault) continue;
            if (seen.faults[fault->kind]++ < 2) {
                std::printf("  seed %d, problem %d: %s, %g\n", int(seed), i, fault_names[fault->kind],
                            fault->size);
                print(smallest(problem, fault->kind));
            }
        }
    }
    const std::string name = std::string("turn, ") + kind_names[int(kind)];
    std::printf("  %s: %d problems, %d contacts, %d turned out (%d with less clearance), %d grazes, %d "
                "unresolved, %d pivots looked at twice\n",
                name.c_str(), seen.problems, seen.contacts, seen.outs, seen.reduced, seen.grazes,
                seen.unresolved, seen.clearance_unverified);
    row(name + ": contact angle", seen.worst, 1e-4, "rad");
    for (int i = 0; i < Fault::count; ++i)
        none(name + ": " + fault_names[i], seen.faults[size_t(i)], "segments");
}

// One triangle: compares the interval of blocked_turns() with the distance at many turns. A turn that is
// blocked by more than the margin must be in it, one that is free by more must not.
void fuzz_interval(Kind kind) {
    const char* many = std::getenv("MARRAM_FUZZ");
    const int problems = many ? std::atoi(many) : 500;
    constexpr int turns = 360;
    int tried = 0, blocked_count = 0, missed = 0, invented = 0;
    for (const uint64_t seed : {21, 22, 23})
        for (int i = 0; i < problems; ++i) {
            Draw draw(hash(hash(seed, uint64_t(kind)), uint64_t(i)));
            const Problem problem = draw_problem(draw, kind);
            if (problem.triangles.empty()) continue;
            const Segment& s = problem.segment;
            const TurningCapsule capsule = arc_of(s).capsule;
            const double end = draw.below(2) == 0 ? 2.0 : 2.0 * draw.unit();
            const Triangle& t = problem.triangles[0];
            TriangleList list;
            list.push(t.a - s.pivot, t.b - s.pivot, t.c - s.pivot);
            std::vector<Blocked> blocked;
            blocked_turns(capsule, 0.0, end, list.blocks(), 1, blocked);
            ++tried;
            blocked_count += !blocked.empty();
            const char* fault = nullptr;
            double at = 0.0, by = 0.0;
            for (int k = 0; k <= turns && !fault; ++k) {
                const double p = end * k / turns;
                const Vec2d cs = from_diamond(p);
                const Vec3d tip = s.pivot + s.length * capsule.direction(cs.x(), cs.y());
                const double room = oracle::closest(s.pivot, tip, t).distance - s.clearance;
                const double margin = 1e-8 * s.length;
                bool in = false;
                for (const Blocked& b : blocked)
                    for (const double period : {-4.0, 0.0, 4.0})
                        in |= b.low <= p + period && p + period <= b.high;
                if (in == (room < 0.0) || std::abs(room) <= margin) continue;
                fault = in ? "free turn called blocked" : "blocked turn missed";
                at = p;
                by = room / s.length;
            }
            for (const Blocked& b : blocked)
                for (const double p : {b.low, b.high}) {
                    const Vec2d cs = from_diamond(p);
                    const Vec3d tip = s.pivot + s.length * capsule.direction(cs.x(), cs.y());
                    const double room = oracle::closest(s.pivot, tip, t).distance - s.clearance;
                    if (fault || std::abs(room) <= 1e-8 * s.length) continue;
                    fault = "end of the interval off";
                    at = p;
                    by = room / s.length;
                }
            if (!fault) continue;
            if ((by < 0.0 ? missed : invented)++ >= 2) continue;
            std::printf(
                "  seed %d, problem %d: %s at %.9g of %.9g (room %.3g lengths, clearance %.3g lengths)",
                int(seed), i, fault, at, end, by, s.clearance / s.length);
            for (const Blocked& b : blocked) std::printf(", blocked %.9g ... %.9g", b.low, b.high);
            std::printf("\n");
            const Vec3d& n = capsule.normal;
            const auto local = [&](const Vec3d& v) {
                const Vec3d r = (v - s.pivot) / s.length;
                std::printf(" (%.17g, %.17g, %.17g)", r.dot(capsule.from), r.dot(capsule.across), r.dot(n));
            };
            std::printf("    in lengths along from, across, normal:");
            local(t.a);
            local(t.b);
            local(t.c);
            std::printf("\n");
        }
    const std::string name = std::string("interval, ") + kind_names[int(kind)];
    std::printf("  %s: %d triangles, %d block\n", name.c_str(), tried, blocked_count);
    none(name + ": blocked turns missed", missed, "triangles");
    none(name + ": free turns called blocked", invented, "triangles");
}

// Many triangles, large ones and small pieces of them: the first contact, found with early rejection, equals
// the minimum over the single triangles.
void fuzz_first(Kind kind) {
    const char* many = std::getenv("MARRAM_FUZZ");
    const int problems = many ? std::atoi(many) : 2000;
    int tried = 0, contacts = 0, at_start = 0, grazes = 0, wrong = 0;
    double worst = 0.0;
    FirstBlocked found;
    for (int i = 0; i < problems; ++i) {
        Draw draw(hash(hash(31, uint64_t(kind)), uint64_t(i)));
        const Problem problem = draw_problem(draw, kind);
        const Segment& s = problem.segment;
        const TurningCapsule capsule = arc_of(s).capsule;
        TriangleList list;
        std::vector<Triangle> alone;
        const auto add = [&](const Vec3d& a, const Vec3d& b, const Vec3d& c) {
            list.push(a, b, c);
            alone.push_back({a, b, c});
        };
        for (const Triangle& t : problem.triangles) {
            if (draw.below(2) == 0) add(t.a - s.pivot, t.b - s.pivot, t.c - s.pivot);
            const double size = log_uniform(draw, 1e-3, 0.5);
            for (int piece = int(draw.below(20)); piece > 0; --piece) {
                const double u = draw.unit(), v = (1.0 - u) * draw.unit();
                const Vec3d at = t.a + (t.b - t.a) * u + (t.c - t.a) * v;
                const auto near = [&](const Vec3d& p) { return Vec3d(at + (p - at) * size - s.pivot); };
                add(near(t.a), near(t.b), near(t.c));
            }
        }
        if (list.size() == 0) continue;
        ++tried;
        std::vector<Blocked> blocked;
        blocked_turns(capsule, 0.0, 2.0, list.blocks(), list.size(), blocked);
        const double infinity = std::numeric_limits<double>::infinity();
        double least = infinity, rounding = 1e-9;
        bool started = false, grazes_start = false;
        for (const Blocked& b : blocked) {
            started |= b.low < -rounding && b.high > rounding;
            grazes_start |= std::abs(b.low) <= rounding || (b.low < 0.0 && b.high <= rounding);
            if (b.low >= 0.0) least = std::min(least, b.low);
        }
        if (grazes_start && !started) continue;
        const double end = draw.below(2) == 0 ? 2.0 : 2.0 * draw.unit();
        const bool is = first_blocked(capsule, end, list, found);
        if (std::abs(least - end) <= rounding && !started) continue;
        at_start += started;
        contacts += !started && least <= end;
        const double off = started        ? (is && found.turn < 0.0 ? 0.0 : infinity)
                           : least <= end ? (is ? std::abs(found.turn - least) : infinity)
                                          : (is ? infinity : 0.0);
        // At a grazing contact turns are ill-conditioned: compare distances instead.
        if (off > 1e-10 && off < infinity) {
            const Vec2d cs = from_diamond(found.turn);
            const Vec3d tip = s.length * capsule.direction(cs.x(), cs.y());
            double room = infinity;
            for (const Triangle& t : alone)
                room = std::min(room, oracle::closest(Vec3d::Zero(), tip, t).distance - s.clearance);
            ++grazes;
            room /= s.length;
            if (found.turn > least ? room >= -1e-10 : room <= 1e-9) continue;
        }
        if (off < infinity) worst = std::max(worst, off);
        if (off > 1e-10 && wrong++ < 3)
            std::printf("  problem %d: %zu triangles, %s, found %d at %.12g, least %.12g of %.12g\n", i,
                        list.size(), started ? "blocked at once" : "free at first", int(is), found.turn,
                        least, end);
    }
    std::printf("  first, %s: %d problems, %d contacts, %d blocked at once, %d grazes\n",
                kind_names[int(kind)], tried, contacts, at_start, grazes);
    row(std::string("first contact, ") + kind_names[int(kind)] + ": against each triangle alone", worst,
        1e-10, "turn");
    none(std::string("first contact, ") + kind_names[int(kind)] + ": wrong ones", wrong, "problems");
}

TEST(FirstBlocked, Soup) { fuzz_first(Kind::soup); }
TEST(FirstBlocked, Spikes) { fuzz_first(Kind::spikes); }
TEST(FirstBlocked, Slivers) { fuzz_first(Kind::slivers); }
TEST(FirstBlocked, Fans) { fuzz_first(Kind::fan); }
TEST(FirstBlocked, SheetsInThePlaneOfTheTurn) { fuzz_first(Kind::sheets); }
TEST(FirstBlocked, FeaturesDeadOnTheCircleOfTheEnd) { fuzz_first(Kind::dead_on); }

TEST(BlockedTurns, Soup) { fuzz_interval(Kind::soup); }
TEST(BlockedTurns, Spikes) { fuzz_interval(Kind::spikes); }
TEST(BlockedTurns, Slivers) { fuzz_interval(Kind::slivers); }
TEST(BlockedTurns, SheetsInThePlaneOfTheTurn) { fuzz_interval(Kind::sheets); }
TEST(BlockedTurns, FeaturesDeadOnTheCircleOfTheEnd) { fuzz_interval(Kind::dead_on); }

TEST(TurnFuzz, Soup) { fuzz(Kind::soup); }
TEST(TurnFuzz, Spikes) { fuzz(Kind::spikes); }
TEST(TurnFuzz, Slivers) { fuzz(Kind::slivers); }
TEST(TurnFuzz, Fans) { fuzz(Kind::fan); }
TEST(TurnFuzz, SheetsInThePlaneOfTheTurn) { fuzz(Kind::sheets); }
TEST(TurnFuzz, FeaturesDeadOnTheCircleOfTheEnd) { fuzz(Kind::dead_on); }

} // namespace
} // namespace marram::stability
