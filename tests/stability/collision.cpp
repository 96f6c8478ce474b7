// SPDX-License-Identifier: Apache-2.0
// Strands against difficult geometry: the complete collision stage, checked by the oracle on the stored
// floats.
#include "tests/oracle/contact.h"
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

Triangle flipped(const Triangle& t) { return {t.a, t.c, t.b}; }

// Strands 1 m long that grow around `root` and are blown along `wind`; straight and kinked ones.
Strands blown(const Vec3d& root, const Vec3d& up, const Vec3d& wind, int strands, int cvs, uint64_t seed,
              double spread = 0.2, double length = 1.0, double width = 0.004) {
    Draw draw(seed);
    std::vector<Curve> rest, pose;
    for (int i = 0; i < strands; ++i) {
        const Vec3d at = root + spread * (draw.in_cube() - up * up.dot(draw.in_cube()));
        const Vec3d on = at + up * (up.dot(root - at));
        const double kinks = i % 3 == 0 ? 0.0 : i % 3 == 1 ? 0.3 : 1.0;
        rest.push_back(wandering(draw, on, up, length, cvs, kinks));
        const double step = length / (cvs - 1);
        pose.push_back(straight(on, step * (wind + 0.3 * draw.in_cube()).normalized(), cvs));
    }
    Strands result = strands_of(rest, width, up);
    set_pose(result, pose);
    return result;
}

// Six winds, each with a seed of its own.
Verdict in_all_winds(const Scene& scene, const Vec3d& root, const Vec3d& up, int cvs = 7,
                     const Collision& settings = {}, double spread = 0.2) {
    Verdict all;
    uint64_t seed = 41;
    for (const Vec3d& wind : {x, Vec3d(-x), y, Vec3d(-y), z, Vec3d(-z)}) {
        Strands strands = blown(root, up, wind, 12, cvs, seed++, spread);
        all += solve(scene, strands, settings);
    }
    return all;
}

TEST(Collision, OneTriangle) {
    const Scene scene({body_of({{Vec3d(-0.5, 0.3, -0.4), Vec3d(0.5, 0.35, -0.4), Vec3d(0, 0.3, 0.6)}})});
    report("one triangle", in_all_winds(scene, Vec3d::Zero(), y));
}

TEST(Collision, AThinShellThinnerThanAnyStep) {
    std::vector<Triangle> shell = oracle::floor_mesh(-0.011, 2.0);
    for (const Triangle& t : oracle::floor_mesh(-0.011 - 1e-6, 2.0)) shell.push_back(flipped(t));
    for (const Triangle& t : oracle::floor_mesh(0.4, 0.35)) shell.push_back(t);
    for (const Triangle& t : oracle::floor_mesh(0.4 - 1e-6, 0.35)) shell.push_back(flipped(t));
    const Scene scene({body_of(shell)});
    report("thin shell (1e-6 m)", in_all_winds(scene, Vec3d::Zero(), y));
}

TEST(Collision, AConcaveWedge) {
    for (const double opening : {2.0, 0.3, 0.05}) { // radians
        const double c = std::cos(0.5 * opening), s = std::sin(0.5 * opening);
        const Vec3d left(-s, c, 0), right(s, c, 0), deep = 2.0 * z;
        const auto wall = [&](const Vec3d& d) {
            return std::vector<Triangle>{{-deep, deep, 3.0 * d + deep},
                                         {-deep, 3.0 * d + deep, 3.0 * d - deep}};
        };
        std::vector<Triangle> wedge = wall(left);
        for (const Triangle& t : wall(right)) wedge.push_back(flipped(t));
        const Scene scene({body_of(wedge)});
        char name[64];
        std::snprintf(name, sizeof name, "concave wedge, %g rad", opening);
        // The root is at the depth with 2 cm of room on either side.
        report(name, in_all_winds(scene, y * (0.02 / s), y, 7, {}, 0.0));
    }
}

TEST(Collision, AConeTip) {
    std::vector<Triangle> cone;
    constexpr int sides = 24;
    for (int i = 0; i < sides; ++i) {
        const auto rim = [&](int j) {
            const double a = 2.0 * pi * j / sides;
            return Vec3d(0.2 * std::cos(a), -1.0, -0.2 * std::sin(a));
        };
        cone.push_back({Vec3d::Zero(), rim(i), rim(i + 1)});
    }
    const Scene scene({body_of(cone)});
    report("cone tip, root above it", in_all_winds(scene, y * 0.012, y, 7, {}, 0.0));
    report("cone tip, roots around it", in_all_winds(scene, y * 0.012, y, 7, {}, 0.1));
    // Strands beside the cone, blown onto its tip.
    report("cone tip, blown onto it", in_all_winds(scene, Vec3d(-0.6, -0.4, 0.0), y));
}

TEST(Collision, VerticesAndEdgesHitDeadOn) {
    // A straight strand along y, blown to x: its segments turn in the plane z = 0, which contains the vertex
    // and the edges.
    const Triangle vertex{Vec3d(0.5, 0.2, 0), Vec3d(1.5, -0.5, 1), Vec3d(1.5, -0.5, -1)},
        in_plane{Vec3d(0.4, 0.3, 0), Vec3d(1.4, -0.7, 0), Vec3d(1.0, -2.0, 1.0)},
        across{Vec3d(0.6, 0.2, 1), Vec3d(0.6, 0.2, -1), Vec3d(1.5, -1, 0)},
        of_the_end{Vec3d(0.6, 0.8, 1), Vec3d(0.6, 0.8, -1), Vec3d(1.5, 2, 0)};
    const std::pair<const char*, Triangle> cases[] = {{"vertex dead on", vertex},
                                                      {"edge in the plane of the turn", in_plane},
                                                      {"edge dead on", across},
                                                      {"edge at the end's very reach", of_the_end}};
    for (const auto& [name, triangle] : cases) {
        const Scene scene({body_of({triangle})});
        Verdict all;
        for (const int cvs : {2, 3, 5, 9})
            for (const double width : {0.0, 0.002, 0.2}) {
                Strands strands = strands_of({straight(Vec3d::Zero(), y / (cvs - 1), cvs)}, width);
                set_pose(strands, {straight(Vec3d::Zero(), x / (cvs - 1), cvs)});
                all += solve(scene, strands);
            }
        report(name, all);
    }
}

TEST(Collision, GrazingContact) {
    // A straight strand turns past a vertex, an edge and a face that are slightly within or beyond its reach.
    Verdict all;
    for (const double hair : {-1e-6, -1e-9, 0.0, 1e-9, 1e-6, 1e-4})
        for (const double width : {0.0, 0.01})
            for (int feature = 0; feature < 3; ++feature) {
                const double c = std::max(0.5 * width, 0.125 * 0.012);
                const double reach = 1.0 + c + hair;
                const Vec3d at = Vec3d(reach * std::sqrt(0.5), reach * std::sqrt(0.5), 0),
                            out = Vec3d(1, 1, 0), side = Vec3d(1, -1, 0);
                const Triangle t = feature == 0 ? Triangle{at, at + out + 0.1 * z, at + out - 0.1 * z}
                                   : feature == 1
                                       ? Triangle{at + z, at - z, at + out}
                                       : Triangle{at + 3 * side, at - 3 * side - z, at - 3 * side + z};
                const Scene scene({body_of({t})});
                Strands strands = strands_of({straight(Vec3d::Zero(), y, 2)}, width);
                set_pose(strands, {straight(Vec3d::Zero(), x, 2)});
                Collision settings;
                settings.offset_root = 0.012;
                all += solve(scene, strands, settings);
            }
    report("grazing contact", all);
}

TEST(Collision, OpenAndNonManifoldMeshes) {
    // A fan of sheets around one edge, with gaps, and an open book.
    std::vector<Triangle> fan;
    for (int i = 0; i < 9; ++i) {
        const double a = 0.35 * i - 1.4;
        const Vec3d d(std::sin(a), -std::abs(std::cos(a)) - 0.05, 0);
        fan.push_back({-z, z, 2.0 * d + z});
        if (i % 2 == 0) fan.push_back({-z, 2.0 * d + z, 2.0 * d - z});
    }
    const Scene scene({body_of(fan)});
    report("non-manifold edge of nine sheets", in_all_winds(scene, 0.02 * y, y, 7, {}, 0.0));
    std::vector<Triangle> sheets = oracle::floor_mesh(-0.012, 0.5);
    for (int i = 0; i < 5; ++i) {
        const double at = -0.5 + 0.25 * i + 0.06;
        sheets.push_back({Vec3d(at, -0.5, -0.6), Vec3d(at, -0.5, 0.6), Vec3d(at, 0.6, 0)});
    }
    const Scene open({body_of(sheets)});
    report("open sheets that pass through each other", in_all_winds(open, Vec3d::Zero(), y));
}

TEST(Collision, DegenerateAndDuplicateTriangles) {
    std::vector<Triangle> mesh = oracle::floor_mesh(-0.012, 2.0);
    const std::vector<Triangle> box = oracle::box_mesh({0.1, 0.2, -0.5}, {0.5, 0.6, 0.5});
    for (int i = 0; i < 3; ++i) mesh.insert(mesh.end(), box.begin(), box.end());
    for (const Triangle& t : box) mesh.push_back(flipped(t));
    for (const Vec3d& p : {Vec3d(-0.3, 0.4, 0.0), Vec3d(0.0, 0.5, 0.2)}) {
        mesh.push_back({p, p, p});
        mesh.push_back({p, p + 0.5 * x, p});
        mesh.push_back({p, p + 0.25 * z, p + 0.5 * z});
        mesh.push_back({p, p + 0.25 * z, p + 0.5 * z + 1e-8 * x});
    }
    const Scene scene({body_of(mesh)});
    report("degenerate and duplicate triangles", in_all_winds(scene, Vec3d::Zero(), y));
}

TEST(Collision, TwoCoincidentSheetsAndInconsistentWinding) {
    std::vector<Triangle> sheets = oracle::floor_mesh(-0.012, 2.0), up = oracle::floor_mesh(0.35, 0.6);
    for (const Triangle& t : oracle::floor_mesh(-0.012, 2.0)) sheets.push_back(flipped(t));
    for (const Triangle& t : up) {
        sheets.push_back(t);
        sheets.push_back(flipped(t));
    }
    const Scene scene({body_of(sheets)});
    report("two coincident sheets", in_all_winds(scene, Vec3d::Zero(), y));
    std::vector<Triangle> bumpy = oracle::sphere_mesh(
        24, [](const Vec3d& u) { return 1.0 + 0.05 * std::sin(7.0 * u.x()) * std::cos(9.0 * u.y() + 1.0); });
    Draw draw(51);
    for (Triangle& t : bumpy)
        if (draw.below(2) == 0) t = flipped(t);
    const Scene sphere({body_of(bumpy)});
    Collision settings;
    settings.offset_scale = 0.5;
    report(
        "inconsistent winding, with offset scale",
        in_all_winds(sphere, y * (1.0 + 0.05 * std::cos(10.0) * std::sin(0.0) + 0.012), y, 7, settings, 0.0));
}

TEST(Collision, RootsInAndOnACollider) {
    const Scene scene({body_of(oracle::box_mesh({-0.5, -1.0, -0.5}, {0.5, 0.0, 0.5}))});
    const std::pair<const char*, Vec3d> cases[] = {{"root inside a collider", Vec3d(0.1, -0.5, 0.1)},
                                                   {"root exactly on a triangle", Vec3d(0.25, 0.0, 0.125)},
                                                   {"root exactly on an edge", Vec3d(0.5, 0.0, 0.125)},
                                                   {"root exactly on a vertex", Vec3d(0.5, 0.0, 0.5)},
                                                   {"root 1e-9 above a triangle", Vec3d(0.25, 1e-9, 0.125)}};
    for (const auto& [name, root] : cases) report(name, in_all_winds(scene, root, y, 7, {}, 0.0));
}

TEST(Collision, RootsHardlyAboveACollider) {
    const Scene scene({body_of(oracle::box_mesh({-0.5, -1.0, -0.5}, {0.5, 0.0, 0.5}))});
    report("root 1e-5 above a triangle", in_all_winds(scene, Vec3d(0.25, 1e-5, 0.125), y, 7, {}, 0.0));
}

TEST(Collision, AColliderThatMovesThroughTheStrandsWithinTheShutter) {
    Body plate = body_of(oracle::box_mesh({-0.02, -0.5, -1.0}, {0.0, 1.5, 1.0}));
    constexpr int samples = 9;
    plate = moved(plate, 1.0, Vec3d(-0.5, 0, 0));
    for (int t = 1; t < samples; ++t)
        plate.later.push_back(moved(plate, 1.0, Vec3d(double(t) / (samples - 1), 0, 0)).positions);
    const Scene scene({body_of(oracle::floor_mesh(-0.012, 2.0)), plate});
    Verdict all;
    double jump = 0.0;
    Curve before;
    for (uint32_t t = 0; t < samples; ++t) {
        Strands strands = blown(Vec3d::Zero(), y, x, 16, 7, 61);
        all += solve(scene, strands, {}, true, t);
        const Curve now = pose_of(strands, 0);
        if (!before.empty()) jump = std::max(jump, (now.back() - before.back()).norm());
        before = now;
    }
    report("collider moving through in the shutter", all);
    figure("collider moving through: a tip's jump between keys", jump, "of the length");
}

TEST(Collision, AMillionTriangles) {
    const auto bumpy = [](const Vec3d& u) {
        return 1.0 + 0.02 * std::sin(31.0 * u.x()) * std::cos(29.0 * u.y()) * std::sin(33.0 * u.z() + 1.0);
    };
    const std::vector<Triangle> mesh = oracle::sphere_mesh(500, bumpy); // 998,000
    const Scene scene({body_of(mesh)});
    Verdict all;
    Draw draw(71);
    for (const Vec3d& wind : {x, Vec3d(-x), z}) {
        std::vector<Curve> rest, pose;
        for (int i = 0; i < 16; ++i) {
            const Triangle& t = mesh[size_t(draw.below(int(mesh.size())))];
            const Vec3d n = oracle::area_normal(t).normalized(), root = (t.a + t.b + t.c) / 3.0 + 0.001 * n;
            rest.push_back(wandering(draw, root, n, 0.1, 8, 0.1));
            pose.push_back(straight(root, 0.1 / 7 * wind, 8));
        }
        Strands strands = strands_of(rest, 1e-4);
        set_pose(strands, pose);
        all += solve(scene, strands);
    }
    report("a collider of a million triangles", all);
}

// Triangles of all kinds around strands of all kinds. Roots are free by construction.
struct Soup {
    const char* name;
    int scenes, cvs;
    double kinks;
    double clearance; // in segment lengths
    int triangles;
    double size;
    bool spikes = false; // one of three corners far away
    double distance = 0.0, scale = 1.0;
    std::optional<double> offset_scale{};
    bool judge_contacts = true, far_away = false;
};

Verdict soup_of_strands(const Soup& soup, uint64_t seed) {
    const char* many = std::getenv("MARRAM_FUZZ"); // manual: more scenes
    const int scenes = many ? soup.scenes * std::max(1, std::atoi(many) / 500) : soup.scenes;
    Verdict all;
    for (int i = 0; i < scenes; ++i) {
        Draw draw(hash(seed, uint64_t(i)));
        std::vector<Triangle> mesh = oracle::soup(draw, soup.triangles, soup.size);
        for (size_t k = 0; k < mesh.size() && soup.spikes; ++k)
            mesh[k] = {mesh[k].a, mesh[k].b * 0.01 + mesh[k].c * 0.99, mesh[k].c + 3.0 * draw.direction()};
        const Vec3d by = soup.distance * draw.direction();
        const Scene scene({moved(body_of(mesh), soup.scale, by)});
        std::vector<Curve> rest, pose;
        const double length = 1.5 * soup.scale, clearance = soup.clearance * length / (soup.cvs - 1);
        for (int tries = 0; tries < 300 && rest.size() < 8; ++tries) {
            const Vec3d root = (soup.scale * draw.in_cube() + by).cast<float>().cast<double>();
            if (scene.triangles().nearest(root, root, 1.5 * clearance).triangle >= 0) continue;
            rest.push_back(wandering(draw, root, draw.direction(), length, soup.cvs, soup.kinks));
            pose.push_back(wandering(draw, root, draw.direction(), length, soup.cvs, 0.3 * soup.kinks));
        }
        if (rest.empty()) continue;
        Strands strands = strands_of(rest, 2.0 * clearance);
        set_pose(strands, pose);
        Collision settings;
        settings.clearance = clearance;
        settings.offset_scale = soup.offset_scale;
        const Verdict verdict = solve(scene, strands, settings, soup.judge_contacts);
        if (verdict.crossed > 0 || verdict.missed_open > 0 || verdict.not_free > 0)
            std::printf("  %s: seed %d, scene %d\n", soup.name, int(seed), i);
        all += verdict;
    }
    return all;
}

TEST(Collision, RandomSoup) {
    const Soup soups[] = {
        {"soup, n = 2", 20, 2, 0.5, 0.01, 30, 0.5},
        {"soup, n = 8", 20, 8, 0.5, 0.01, 150, 0.2},
        {"soup, n = 8, kinked", 20, 8, 3.0, 0.05, 150, 0.2},
        {"soup, n = 8, dense", 10, 8, 1.0, 0.02, 600, 0.15},
        {"soup, n = 8, pockets", 10, 8, 1.0, 0.02, 200, 0.6},
        {"soup, n = 40, spikes", 4, 40, 0.5, 0.05, 60, 0.5, true},
        {"soup, n = 8, spikes", 10, 8, 0.5, 0.01, 150, 0.5, true},
        {"soup, clearance of a segment", 10, 8, 0.5, 1.0, 60, 0.1},
        {"soup, clearance of three segments", 10, 16, 0.5, 3.0, 60, 0.05},
        {"soup, clearance 1e-6 segments", 20, 8, 0.5, 1e-6, 150, 0.2},
        {"soup, offset scale", 20, 8, 0.5, 0.01, 150, 0.2, false, 0.0, 1.0, 1.0},
        {"soup, n = 1000", 1, 1000, 0.1, 0.1, 150, 0.2, false, 0.0, 1.0, {}, false},
    };
    uint64_t seed = 81;
    for (const Soup& soup : soups) report(soup.name, soup_of_strands(soup, seed++));
}

TEST(Collision, RandomSoupFarAwayAndOfAnySize) {
    const Soup soups[] = {
        {"soup 1e3 from the origin", 10, 8, 0.5, 0.02, 150, 0.2, false, 1e3},
        {"soup 1e5 from the origin", 10, 8, 0.5, 0.1, 150, 0.2, false, 1e5, 1.0, {}, true, true},
        {"soup 1e6 from the origin", 10, 8, 0.5, 0.5, 60, 0.1, false, 1e6, 1.0, {}, true, true},
        {"soup 1e7 from the origin", 10, 8, 0.5, 0.5, 60, 0.1, false, 1e7, 1.0, {}, true, true},
        {"soup of 1e-4 the size", 10, 8, 0.5, 0.02, 150, 0.2, false, 0.0, 1e-4},
        {"soup of 1e5 the size", 10, 8, 0.5, 0.02, 150, 0.2, false, 0.0, 1e5},
        {"soup of 1e-4 the size at 10", 10, 8, 0.5, 0.02, 150, 0.2, false, 10.0, 1e-4, {}, true, true},
    };
    uint64_t seed = 101;
    for (const Soup& soup : soups) report(soup.name, soup_of_strands(soup, seed++), soup.far_away);
}

TEST(Collision, StrandsOfNoLengthAndOfAbsurdSize) {
    const Vec3d low(-0.4, 0.3, -0.4);
    Verdict gaps, tiny, huge;
    const Scene scene({body_of(oracle::box_mesh(low, {0.4, 0.6, 0.4}))});
    {
        Draw draw(91);
        std::vector<Curve> rest, pose;
        for (int i = 0; i < 24; ++i) {
            Curve c =
                wandering(draw, Vec3d(0.8 * draw.signed_unit(), 0, 0.8 * draw.signed_unit()), y, 1.0, 8, 0.5);
            c[size_t(1 + i % 7)] = c[size_t(i % 7)]; // one segment of zero length
            if (i % 4 == 0) c[3] = c[2] = c[1] = c[0];
            if (i % 6 == 0) std::fill(c.begin(), c.end(), c[0]); // all CVs at one point
            rest.push_back(c);
            Curve p = straight(c[0], Vec3d(0.1, -0.05, 0), 8);
            if (i % 5 == 0 || i % 6 == 0) p = Curve(8, c[0]); // all targets at one point
            pose.push_back(p);
        }
        Strands strands = strands_of(rest, 0.01);
        set_pose(strands, pose);
        gaps = solve(scene, strands);
    }
    for (const double size : {1e-30, 1e-37, 1e-12}) {
        Draw draw(92);
        std::vector<Curve> rest, pose;
        for (int i = 0; i < 8; ++i) {
            const Vec3d root(0.2 * draw.signed_unit(), 0.1, 0);
            rest.push_back(i < 4 ? wandering(draw, Vec3d::Zero(), y, size, 6, 0.5)
                                 : straight(root, size * y, 6));
            pose.push_back(straight(rest.back()[0], size / 5 * x, 6));
        }
        Strands strands = strands_of(rest, 0.0);
        set_pose(strands, pose);
        tiny += solve(scene, strands);
    }
    for (const double size : {1e6, 1e12, 1e18, 1e30}) {
        Draw draw(93);
        std::vector<Curve> rest, pose;
        for (int i = 0; i < 8; ++i) {
            rest.push_back(wandering(draw, Vec3d::Zero(), y, size, 6, 0.5));
            pose.push_back(straight(rest.back()[0], size / 5 * x, 6));
        }
        Strands strands = strands_of(rest, 0.01);
        set_pose(strands, pose);
        huge += solve(scene, strands, {}, false);
    }
    report("collision of segments without length", gaps);
    report("collision of segments of 1e-12 ... 1e-37", tiny);
    // A ball of 1 m within a reach of 1e30 m: what floats and Embree cannot resolve may be passed through,
    // but results are finite.
    none("collision of strands 1e6 ... 1e30 m long: not finite", huge.not_finite, "strands");
    row("collision of strands 1e6 ... 1e30 m long: lengths", huge.length, 1.0, "of allowed");
    figure("collision of strands 1e6 ... 1e30 m long: crosses", double(huge.crossed), "segments");
}

TEST(Collision, StrandsAtRestInStillAir) {
    // Targets equal to the start: nothing turns, except segments inside a collider, which are turned out.
    Verdict all;
    long long moved = 0;
    for (uint64_t seed = 0; seed < 10; ++seed) {
        Draw draw(hash(94, seed));
        const Scene scene({body_of(oracle::soup(draw, 60, 0.3))});
        std::vector<Curve> rest;
        for (int tries = 0; tries < 200 && rest.size() < 16; ++tries) {
            const Vec3d root = draw.in_cube().cast<float>().cast<double>();
            if (scene.triangles().nearest(root, root, 0.005).triangle >= 0) continue;
            rest.push_back(wandering(draw, root, draw.direction(), 1.0, 7, 0.5));
        }
        Strands strands = strands_of(rest, 0.002);
        all += solve(scene, strands);
        for (int i = 0; i < strands.count; ++i) {
            const Curve before = rest_of(strands, i);
            double room = 1.0;
            for (size_t k = 0; k + 1 < before.size(); ++k)
                room =
                    std::min(room, scene.triangles().nearest(before[k], before[k + 1], 0.1).closest.distance);
            // The curve and the clearance have room, so the strand is unchanged.
            if (room > 0.09) moved += pose_of(strands, i) != before;
        }
    }
    report("strands at rest in still air", all);
    none("strands at rest with room around: moved", moved, "strands");
}

TEST(Collision, StraightStrandsOnGridsAndAxes) {
    // All coordinates are binary fractions: closest points on edges, parallel edges, coplanar triangles,
    // segments along the axes.
    std::vector<Triangle> grid;
    for (int i = -4; i < 4; ++i)
        for (int j = -4; j < 4; ++j) {
            const Vec3d a(0.25 * i, 0, 0.25 * j), b = a + 0.25 * x, c = a + 0.25 * z, d = b + 0.25 * z;
            grid.push_back({a, c, b});
            grid.push_back({b, c, d});
        }
    for (const Triangle& t : oracle::box_mesh({0.5, 0.0, -0.25}, {0.75, 0.5, 0.25})) grid.push_back(t);
    for (const Triangle& t : oracle::box_mesh({-0.5, 0.25, -0.5}, {0.0, 0.5, 0.5})) grid.push_back(t);
    const Scene scene({body_of(grid)});
    Verdict all;
    for (const double width : {0.0, 0.03125, 0.25})
        for (const Vec3d& wind : {x, Vec3d(-x), z, Vec3d(-z), Vec3d(-y), Vec3d(x - y), Vec3d(x + z)}) {
            std::vector<Curve> rest, pose;
            for (int i = -3; i <= 3; ++i)
                for (int j = -2; j <= 2; ++j) {
                    const Vec3d root(0.25 * i, 0.03125, 0.25 * j);
                    if (scene.triangles().nearest(root, root, 0.03).triangle >= 0) continue;
                    rest.push_back(straight(root, 0.125 * y, 9));
                    pose.push_back(straight(root, 0.125 * wind.normalized(), 9));
                }
            Strands strands = strands_of(rest, width);
            set_pose(strands, pose);
            Collision settings;
            settings.offset_root = 0.03125;
            all += solve(scene, strands, settings);
        }
    report("everything on binary fractions", all);
}

TEST(Collision, FixedStepsAreFiniteAndKeepLengths) {
    Collision steps;
    steps.solver = Solver::steps;
    Draw draw(95);
    const Scene scene({body_of(oracle::soup(draw, 150, 0.2))});
    std::vector<Curve> rest, pose;
    for (int i = 0; i < 40; ++i) {
        const Vec3d root = draw.in_cube();
        rest.push_back(wandering(draw, root, draw.direction(), 1.5, 8, i % 2 == 0 ? 0.5 : 3.0));
        pose.push_back(i % 3 == 0 ? rest.back() : wandering(draw, root, draw.direction(), 1.5, 8, 0.3));
    }
    Strands strands = strands_of(rest, 0.01);
    set_pose(strands, pose);
    const Verdict verdict = solve(scene, strands, steps, false);
    none("solver steps: not finite", verdict.not_finite, "strands");
    row("solver steps: lengths", verdict.length, 1.0, "of allowed");
    figure("solver steps: crosses a triangle (the talk's method)", double(verdict.crossed_all),
           "segments of 280");
}

} // namespace
} // namespace marram::stability
