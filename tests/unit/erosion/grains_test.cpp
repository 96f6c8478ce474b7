// SPDX-License-Identifier: Apache-2.0
// Compares wear by traced grains with closed forms. build/grains prints the complete tables.
#include "core/math/hash.h"
#include "grain_cases.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <atomic>
#include <stdexcept>

namespace marram::testing {
namespace {

void expect_accounts(const GrainReport& r) {
    EXPECT_FALSE(r.cancelled);
    EXPECT_EQ(r.ended_grains(), r.grains);
    EXPECT_EQ(r.started + r.flight + r.sand, r.rock + r.ended);
}

TEST(Grains, PlatesWearByFluxTimesLaw) {
    for (const double exponent : {0.0, 2.0})
        for (const double angle : {10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0})
            EXPECT_NEAR(plate_ratio(angle * degree, exponent, 4096, 1), 1.0, 1e-3)
                << angle << " degrees, exponent " << exponent;
}

TEST(Grains, BelowTheThresholdNothingWears) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate(Vec3d::Zero(), Vec3d(0.0, 1.0, 0.0), Vec3d(0.0, 0.0, 1.0)));
    scene.commit();
    GrainSettings s = even_grains(1000);
    s.threshold_speed = s.speed * 1.001;
    const GrainResult result = traced(scene, scene.worn(id), s);
    EXPECT_EQ(result.report.worn_hits, 1000u);
    EXPECT_EQ(result.report.worn, 0);
    EXPECT_GT(result.report.rock, 0);
    expect_accounts(result.report);
}

TEST(Grains, SphereWearsAsItsClosedForm) { EXPECT_LT(sphere_error(1 << 16, 1, 32), 0.005); }

// The emission plane is at the cube's face. The cube is not taken for ground that would raise the stream.
TEST(Grains, CubeWearsAllOverItsFace) {
    GrainScene scene;
    GrainShape cube = grain_plate(Vec3d::Zero(), {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0});
    const GrainShape top = grain_plate({0.0, 1.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 0.0, 1.0});
    cube.vertices.insert(cube.vertices.end(), top.vertices.begin(), top.vertices.end());
    for (const uint32_t k : top.triangles) cube.triangles.push_back(4 + k);
    const unsigned id = scene.add(std::move(cube));
    scene.commit();
    const GrainSettings s = even_grains(4096);
    const double wearing = 0.5 * (s.speed * s.speed - s.threshold_speed * s.threshold_speed);
    EXPECT_NEAR(traced(scene, scene.worn(id), s).report.volume / (flux_of(s) * wearing / s.energy_per_volume),
                1.0, 1e-3);
}

TEST(Grains, PostWearsMostAtTheKink) {
    const auto [found, expected] = post_kink(1 << 17);
    EXPECT_NEAR(found, expected, 0.03);
}

TEST(Grains, StepKeepsGrainsOffBehindIt) {
    const StepWear step = step_wear(1 << 14, 1);
    expect_accounts(step.report);
    EXPECT_LT(step_error(step), 0.12);
    EXPECT_EQ(step.wear[0], 0.0); // no grain falls that steeply
}

TEST(Grains, SandKeepsTheStreamAsItIs) {
    const StepWear plain = step_wear(1 << 14, 2, 0.0, 10);
    expect_accounts(plain.report);
    EXPECT_LT(step_error(plain), 0.12);
}

TEST(Grains, CavityAgreesWithManyTimesTheGrains) {
    GrainReport report;
    const std::vector<double> few = cavity_wear(1 << 14, 1, &report), many = cavity_wear(1 << 17, 2);
    expect_accounts(report);
    EXPECT_GT(report.worn_hits, report.grains / 2);
    EXPECT_LT(relative_error(few, many), 0.1);
}

TEST(Grains, ErrorFallsAtLeastWithTheRootOfThePaths) {
    const std::array<uint64_t, 3> paths = {1 << 9, 1 << 12, 1 << 15};
    EXPECT_LT(error_slope([](uint64_t n, uint32_t seed) { return sphere_error(n, seed, 16); }, paths, 4),
              -0.5);
}

TEST(Grains, SameBitsForAnyNumberOfThreads) {
    const auto run = [](int threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        return cavity_wear(20000, 5);
    };
    EXPECT_EQ(run(1), run(2));
}

TEST(Grains, EveryGrainAndItsEnergyIsAccountedFor) {
    GrainScene scene;
    const unsigned rock = scene.add(grain_sphere({0.0, 0.5, 0.0}, 0.6, 12));
    scene.add(grain_plate({-2.0, 0.0, -1.5}, {0.0, 0.4, 0.0}, {0.0, 0.0, 1.5}));
    scene.commit();
    for (const bool ground : {false, true})
        for (const double drag : {0.0, 0.2}) {
            GrainSettings s;
            s.paths = 5000, s.spread = 0.2, s.drag_time = drag, s.height = 0.3;
            if (ground) s.ground = 0.0;
            const GrainResult result = traced(scene, scene.worn(rock), s);
            expect_accounts(result.report);
            EXPECT_EQ(result.report.grains, 5000u);
            EXPECT_GT(result.report.worn_hits, 100u);
            EXPECT_GT(result.report.other_hits, 10u);
            double sum = 0.0, vertices = 0.0;
            const WornMesh mesh = scene.worn(rock);
            std::vector<double> areas(mesh.vertex_count);
            for (size_t f = 0; f < mesh.triangle_count; ++f) {
                std::array<Vec3d, 3> p;
                for (size_t k = 0; k < 3; ++k) {
                    const float* v = mesh.vertices + 3 * size_t(mesh.triangles[3 * f + k]);
                    p[k] = Vec3d(v[0], v[1], v[2]);
                }
                const double area = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm();
                sum += area * result.triangles[f];
                for (size_t k = 0; k < 3; ++k) areas[mesh.triangles[3 * f + k]] += area / 3.0;
            }
            for (size_t v = 0; v < areas.size(); ++v) vertices += areas[v] * result.vertices[v];
            EXPECT_NEAR(sum / result.report.volume, 1.0, 1e-9);
            EXPECT_NEAR(vertices / result.report.volume, 1.0, 1e-9);
        }
}

// Without gravity a path to the first hit is one chord: a limit of one chord lets as many grains hit as one
// of one hit.
TEST(Grains, FlyTheLastPermittedChord) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate({0.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}, 4, 4));
    scene.commit();
    GrainSettings s;
    s.paths = 2000, s.gravity = 0.0, s.height = 0.5;
    GrainSettings one_chord = s, one_hit = s;
    one_chord.max_segments = 1, one_hit.max_hits = 1;
    const GrainReport chord = traced(scene, scene.worn(id), one_chord).report;
    const GrainReport hit = traced(scene, scene.worn(id), one_hit).report;
    EXPECT_GT(hit.worn_hits, 1000U);
    EXPECT_EQ(chord.worn_hits, hit.worn_hits);
}

// In air of one speed an arc with drag is exact however long its chords are, so hops are, too. Only the end
// of the box is seen later, half a hop of fifty.
TEST(Grains, LandWithDragAsWithFineChords) {
    GrainScene scene; // its rock is buried
    const unsigned id = scene.add(grain_plate({0.0, -1.0, 0.0}, {5.0, 0.0, 0.0}, {0.0, 0.0, 1.0}, 1, 1));
    scene.commit();
    const auto with_path_error = [&](double error) {
        GrainSettings s;
        s.paths = 2000, s.ground = 0.0, s.height = 0.02, s.speed = s.bed_speed = 1.0, s.drag_time = 0.3;
        s.settle_speed = 0.0, s.path_error = error;
        return traced(scene, scene.worn(id), s).report;
    };
    const GrainReport coarse = with_path_error(1e3), fine = with_path_error(1e-5);
    EXPECT_EQ(fine.worn_hits + coarse.worn_hits, 0U);
    EXPECT_GT(fine.sand_hits, 10000U);
    EXPECT_NEAR(double(coarse.sand_hits), double(fine.sand_hits), 0.02 * double(fine.sand_hits));
    EXPECT_NEAR(double(coarse.flight), double(fine.flight), 0.04 * std::abs(double(fine.flight)));
    EXPECT_NEAR(double(coarse.sand), double(fine.sand), 0.02 * std::abs(double(fine.sand)));
}

// Empty space saves rays and changes no bit: chords are the same with a ray for each.
TEST(Grains, EmptySpaceChangesNothing) {
    struct Case {
        const char* name;
        double drag, gravity, ground; // ground below 0: none
        bool sand;
        double reach, min_saved; // m; share of the rays
        uint32_t max_segments = 1 << 16;
    };
    for (const Case c : {Case{"parabolas", 0.0, 9.81, -1.0, false, infinity, 0.1},
                         Case{"parabolas in a small box", 0.0, 9.81, -1.0, false, 0.2, 0.0},
                         Case{"level sand", 0.0, 9.81, 0.0, false, infinity, 0.5},
                         Case{"drag", 0.2, 9.81, 0.0, false, infinity, 0.3},
                         Case{"drag in a small box", 0.2, 9.81, -1.0, false, 0.2, 0.0},
                         Case{"straight", 0.0, 0.0, -1.0, false, infinity, 0.0},
                         Case{"a mesh of sand", 0.0, 9.81, -1.0, true, infinity, 0.1},
                         Case{"drag and sand in a small box", 0.2, 9.81, 0.0, false, 0.2, 0.0},
                         Case{"few segments", 0.0, 9.81, 0.0, false, infinity, 0.2, 12},
                         Case{"few segments and drag", 0.2, 9.81, 0.0, false, infinity, 0.2, 12}}) {
        GrainScene scene;
        const unsigned rock = scene.add(grain_sphere({0.0, 0.5, 0.0}, 0.4, 24));
        const unsigned plate =
            scene.add(grain_plate({-2.0, 0.01, -1.5}, {0.0, 0.03, 4.0}, {4.0, 0.0, 0.0}, 8, 8));
        scene.commit();
        GrainSettings s;
        s.paths = 20000, s.spread = 0.2, s.height = 0.3, s.drag_time = c.drag, s.gravity = c.gravity;
        s.reach = c.reach, s.max_segments = c.max_segments;
        if (c.ground >= 0.0) s.ground = c.ground;
        if (c.sand) s.sand = std::span(&plate, 1);
        GrainHooks every;
        every.rays = [](std::span<const RTCRayHit>) {};
        const GrainResult few = traced(scene, scene.worn(rock), s),
                          all = traced(scene, scene.worn(rock), s, every);
        expect_accounts(few.report);
        EXPECT_GT(few.report.worn_hits, 300u) << c.name;
        EXPECT_EQ(few.vertices, all.vertices) << c.name;
        EXPECT_EQ(few.triangles, all.triangles) << c.name;
        EXPECT_EQ(few.report.left, all.report.left) << c.name;
        EXPECT_EQ(few.report.ended, all.report.ended) << c.name;
        EXPECT_EQ(few.report.sand_hits, all.report.sand_hits) << c.name;
        EXPECT_EQ(few.report.given_up, all.report.given_up) << c.name;
        EXPECT_LT(double(few.report.rays), (1.0 - c.min_saved) * double(all.report.rays)) << c.name;
    }
}

// A hop from level sand returns at the speed at which it left: nothing is lost or won but by landing.
TEST(Grains, LandsExactly) {
    GrainScene scene;
    const unsigned rock = scene.add(grain_sphere({0.0, 50.0, 0.0}, 1.0, 8)); // above all hops
    scene.add(grain_plate({-20.0, 0.0, -1.0}, {40.0, 0.0, 0.0}, {0.0, 0.0, 2.0}));
    scene.commit();
    GrainSettings s;
    s.paths = 1000, s.ground = 0.01;
    const GrainResult result = traced(scene, scene.worn(rock), s);
    expect_accounts(result.report);
    EXPECT_GT(result.report.sand_hits, 10000u);
    EXPECT_EQ(result.report.other_hits, 0u); // the plate is below the sand
    EXPECT_EQ(result.report.left[size_t(GrainSide::downwind)], 1000u);
}

// With drag an arc ends where it meets the sand, and not above what lies on it.
TEST(Grains, LandsOnWhatLiesOnTheSand) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate({0.0, 0.002, -0.5}, {0.0, 0.0, 1.0}, {1.0, 0.0, 0.0}, 4, 4));
    scene.commit();
    GrainSettings s;
    s.paths = 20000, s.ground = 0.0, s.drag_time = 0.2;
    const GrainResult coarse = traced(scene, scene.worn(id), s);
    s.path_error = 1e-6;
    const GrainResult fine = traced(scene, scene.worn(id), s);
    EXPECT_NEAR(coarse.report.volume / fine.report.volume, 1.0, 0.05);
    EXPECT_NEAR(double(coarse.report.worn_hits) / double(fine.report.worn_hits), 1.0, 0.1);
    EXPECT_EQ(coarse.report.given_up, 0u);
}

TEST(Grains, SlowGrainsHighUpArriveAndHit) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate({0.0, 0.0, -0.5}, {0.0, 0.0, 1.0}, {1.0, 0.0, 0.0}, 4, 4));
    scene.commit();
    GrainSettings s;
    s.paths = 200, s.height = 10.0, s.bed_speed = 0.0, s.speed = 0.01, s.path_error = 1e-12;
    expect_accounts(traced(scene, scene.worn(id), s).report); // no endless loop
    s.paths = 2000, s.height = 100.0, s.bed_speed = s.speed = 0.001, s.max_hits = 1;
    uint64_t below[2];
    for (const bool fine : {false, true}) {
        s.path_error = fine ? 1e-9 : 0.0, s.max_segments = 1000000000;
        below[fine ? 1 : 0] = traced(scene, scene.worn(id), s).report.left[size_t(GrainSide::below)];
    }
    EXPECT_LE(below[1], below[0] + 2); // none falls through the plate
}

TEST(Grains, IsCancelledInLongFlights) {
    GrainScene scene;
    const unsigned id = scene.add(grain_sphere({0.0, 10.0, 0.0}, 1.0, 8));
    scene.add(grain_sphere({300.0, 10.0, 0.0}, 1.0, 8));
    scene.commit();
    GrainSettings s;
    s.paths = 1 << 16, s.ground = 0.0;
    std::atomic<int> polls{0};
    GrainHooks hooks;
    hooks.cancelled = [&] { return ++polls > 50; };
    EXPECT_TRUE(traced(scene, scene.worn(id), s, hooks).report.cancelled);
    EXPECT_LT(polls, 200);
}

// ---- hostile inputs ----

TEST(Grains, NothingToWearOrNoWindIsNoError) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate(Vec3d::Zero(), Vec3d(0.0, 1.0, 0.0), Vec3d(0.0, 0.0, 1.0)));
    scene.commit();
    GrainSettings s = even_grains(100);
    WornMesh none = scene.worn(id);
    none.triangle_count = 0;
    EXPECT_EQ(traced(scene, none, s).report.grains, 0u);
    s.wind = Vec3d::Zero();
    EXPECT_EQ(traced(scene, scene.worn(id), s).report.grains, 0u);
    EXPECT_EQ(trace_grains(scene.get(), {}, even_grains(100), {}).grains, 0u);
    GrainScene empty;
    empty.commit();
    EXPECT_EQ(trace_grains(empty.get(), {}, even_grains(100), {}).grains, 0u);
}

TEST(Grains, FaultySettingsAreErrors) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate(Vec3d::Zero(), Vec3d(0.0, 1.0, 0.0), Vec3d(0.0, 0.0, 1.0)));
    scene.commit();
    const double nan = std::nan("");
    const auto fails = [&](const std::function<void(GrainSettings&)>& change) {
        GrainSettings s = even_grains(10);
        change(s);
        EXPECT_NE(grain_settings_fault(s), "");
        EXPECT_THROW(traced(scene, scene.worn(id), s), std::invalid_argument);
    };
    for (double GrainSettings::*field :
         {&GrainSettings::transport, &GrainSettings::height, &GrainSettings::speed, &GrainSettings::bed_speed,
          &GrainSettings::speed_height, &GrainSettings::spread, &GrainSettings::gravity,
          &GrainSettings::drag_time, &GrainSettings::path_error, &GrainSettings::energy_per_volume,
          &GrainSettings::threshold_speed, &GrainSettings::angle_exponent, &GrainSettings::normal_restitution,
          &GrainSettings::tangent_restitution, &GrainSettings::scatter, &GrainSettings::settle_speed,
          &GrainSettings::reach})
        for (const double value : {nan, -1.0}) fails([&](GrainSettings& s) { s.*field = value; });
    fails([](GrainSettings& s) { s.paths = 0; });
    fails([&](GrainSettings& s) { s.wind.x() = nan; });
    fails([&](GrainSettings& s) { s.ground = nan; });
    WornMesh bad = scene.worn(id);
    const std::array<uint32_t, 3> far = {0, 1, 99};
    bad.triangles = far.data(), bad.triangle_count = 1;
    EXPECT_THROW(traced(scene, bad, even_grains(10)), std::invalid_argument);
}

TEST(Grains, DegenerateTrianglesWearNothing) {
    GrainScene scene;
    GrainShape shape = grain_sphere({0.0, 0.5, 0.0}, 0.5, 8);
    const auto last = uint32_t(shape.vertices.size() / 3);
    shape.add({0.0, 0.5, 0.0}), shape.add({0.3, 0.5, 0.0}); // for a segment and a point
    for (const uint32_t k : {last, last + 1, last + 1, last, last, last}) shape.triangles.push_back(k);
    const unsigned id = scene.add(std::move(shape));
    scene.commit();
    GrainSettings s;
    s.paths = 3000;
    const GrainResult result = traced(scene, scene.worn(id), s);
    expect_accounts(result.report);
    EXPECT_GT(result.report.worn, 0);
    EXPECT_EQ(result.triangles.back(), 0.0);
    for (const double wear : result.vertices) EXPECT_TRUE(wear >= 0.0 && wear < infinity);
}

TEST(Grains, QuadsWearAsTheirTriangles) {
    GrainShape shape = grain_plate(Vec3d::Zero(), {1.0, 1.0, 0.0}, {0.0, 0.0, 1.0}, 20, 20);
    for (size_t k = 0; k < shape.vertices.size(); ++k) // folds the quads
        shape.vertices[k] += float(0.02 * (unit_double(hash(k, 5)) - 0.5));
    std::array<GrainResult, 2> results;
    for (const bool quads : {false, true}) {
        GrainScene scene;
        const unsigned id = scene.add(shape, quads);
        scene.commit();
        WornMesh mesh = scene.worn(id);
        mesh.quads = quads;
        results[quads] = traced(scene, mesh, even_grains(1 << 16));
        expect_accounts(results[quads].report);
        mesh.quads = true, mesh.triangle_count -= 1;
        EXPECT_THROW(traced(scene, mesh, even_grains(10)), std::invalid_argument);
    }
    const auto difference = [&](auto member) {
        double sum = 0.0, apart = 0.0;
        for (size_t k = 0; k < (results[0].*member).size(); ++k) {
            const double a = (results[0].*member)[k], b = (results[1].*member)[k];
            sum += a, apart += std::abs(a - b);
        }
        return apart / sum;
    };
    EXPECT_LT(difference(&GrainResult::vertices), 1e-4);
    EXPECT_LT(difference(&GrainResult::triangles),
              1e-3); // hits near an edge may be those of its other triangle
}

// Quads whose diagonal is a thousandth of their edges, far from the origin in units of it: rays leave them on
// their outer side, or grains would be caught inside.
TEST(Grains, LeaveSqueezedQuadsOutside) {
    std::array<GrainReport, 2> reports;
    for (const bool quads : {false, true}) {
        GrainScene scene;
        const unsigned id = scene.add(grain_sphere({3.0, 0.6, -4.0}, 0.5, 4000, 8, -1.0), quads);
        scene.commit();
        WornMesh mesh = scene.worn(id);
        mesh.quads = quads;
        GrainSettings s;
        s.paths = 1 << 15;
        reports[quads] = traced(scene, mesh, s).report;
        expect_accounts(reports[quads]);
        EXPECT_EQ(reports[quads].given_up, 0U);
        EXPECT_GT(reports[quads].worn_hits, 9000U);
    }
    EXPECT_NEAR(double(reports[1].worn_hits), double(reports[0].worn_hits),
                0.002 * double(reports[0].worn_hits));
}

TEST(Grains, ScaleAndPlaceDoNotMatter) {
    struct Case {
        double size, away;
        bool ground;
    };
    for (const Case c : {Case{1.0, 1e6, false}, Case{10.0, 1e6, true}, Case{1e-3, 0.0, false},
                         Case{1e-3, 0.0, true}, Case{100.0, 0.0, true}}) {
        GrainScene scene;
        const unsigned id = scene.add(grain_sphere({c.away, 0.5 * c.size, -c.away}, 0.5 * c.size, 8));
        scene.commit();
        GrainSettings s;
        s.paths = 1000, s.drag_time = 0.2, s.height = std::min(c.size, 1.0);
        if (c.ground) s.ground = 0.0;
        const GrainResult result = traced(scene, scene.worn(id), s);
        expect_accounts(result.report);
        EXPECT_GT(result.report.worn_hits, 50u) << c.size << " m, " << c.away << " m away";
        EXPECT_LT(result.report.given_up, 100u) << c.size << " m, " << c.away << " m away";
    }
}

TEST(Grains, CancelledWithoutWear) {
    GrainScene scene;
    const unsigned id = scene.add(grain_plate(Vec3d::Zero(), Vec3d(0.0, 1.0, 0.0), Vec3d(0.0, 0.0, 1.0)));
    scene.commit();
    GrainHooks hooks;
    hooks.cancelled = [] { return true; };
    const GrainResult result = traced(scene, scene.worn(id), even_grains(100000), hooks);
    EXPECT_TRUE(result.report.cancelled);
    for (const double wear : result.vertices) EXPECT_EQ(wear, 0.0);
}

} // namespace
} // namespace marram::testing
