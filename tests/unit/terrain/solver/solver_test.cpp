// SPDX-License-Identifier: Apache-2.0
// The dune solver: waves against linear theory, sand conserved to the unit, identical bits at any thread
// count and after a restart, hard cases.
#include "core/math/hash.h"
#include "tests/unit/terrain/solver/dune_waves.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <functional>
#include <numeric>

namespace marram {
namespace {

struct DuneScene {
    Domain domain;
    std::vector<float> rock;
    std::vector<SandUnits> sand;

    DuneScene(int nx, int nz, double cell)
        : domain{nx, nz, cell, 0.0, 0.0}, rock(domain.count(), 0.0F), sand(domain.count(), 0) {}
    template <typename F>
    void fill(F&& metres) { // metres(x, z): relative to the middle
        for (int j = 0; j < domain.nz; ++j)
            for (int i = 0; i < domain.nx; ++i)
                sand[domain.index(i, j)] =
                    sand_units(std::max(0.0, double(metres((i - domain.nx / 2) * domain.cell,
                                                           (j - domain.nz / 2) * domain.cell))));
    }
    SandUnits total() const { return std::accumulate(sand.begin(), sand.end(), SandUnits(0)); }
};

std::vector<SandUnits> dune_sand(const DuneSolver& solver, const DuneScene& scene) {
    std::vector<SandUnits> sand(scene.sand.size());
    solver.sand(sand);
    return sand;
}

// Runs the solver and checks the invariants of every run. Returns the sand.
std::vector<SandUnits> dune_run(const DuneScene& scene, const DuneSolverSettings& settings,
                                const WindHistory& wind, int steps, double longest = 1e7) {
    EXPECT_EQ(DuneSolver::problem(scene.domain, settings, scene.rock.data(), scene.sand.data()), "");
    DuneSolver solver(scene.domain, settings, scene.rock.data(), scene.sand.data());
    for (int k = 0; k < steps; ++k) {
        const WindSpan span = wind(solver.time());
        const double step = solver.step(span.wind, std::min(longest, span.until - solver.time()));
        EXPECT_GT(step, 0.0);
        EXPECT_TRUE(std::isfinite(step));
    }
    std::vector<SandUnits> sand = dune_sand(solver, scene);
    EXPECT_GE(*std::min_element(sand.begin(), sand.end()), 0);
    EXPECT_LE(*std::max_element(sand.begin(), sand.end()), sand_units(1e5));
    EXPECT_EQ(std::accumulate(sand.begin(), sand.end(), SandUnits(0)) + solver.airborne() + solver.out() -
                  solver.in(),
              scene.total());
    if (settings.border == DuneBorder::walled) {
        EXPECT_EQ(solver.in(), 0);
        EXPECT_EQ(solver.out(), 0);
    }
    return sand;
}

double dune_lumps(double x, double z) { // heaps on bare ground and a thin cover
    return 2.5 * std::sin(0.13 * x) * std::cos(0.11 * z + 0.05 * x) + 0.4 * std::sin(0.7 * x + 0.3 * z);
}

WindHistory dune_two_winds() {
    return wind_sequence({{{1.0, 0.0, 0.4}, 3.0 * seconds_per_hour},
                          {{-0.3, 0.9, 0.5}, 2.0 * seconds_per_hour},
                          {{0.7, -0.7, 0.1}, seconds_per_hour},
                          {{0.8, -0.7, 0.6}, seconds_per_hour}});
}

TEST(DuneSolver, WavesGrowAndTravelAsLinearTheorySays) {
    const DuneSolverSettings settings;
    const double shear_velocity = 2.0 * settings.physics.threshold;
    double greatest = 0.0;
    for (double k = 0.01; k < 1.0; k += 0.001)
        greatest = std::max(greatest, dune_wave_theory(settings, shear_velocity, k).growth);
    struct Direction {
        int size, row, column;
    };
    for (const Direction d : {Direction{48, 0, 1}, {48, 1, 0}, {256, 2, 5}, {64, 1, -1}})
        for (const double k : {0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6}) {
            const DuneWave theory = dune_wave_theory(settings, shear_velocity, k);
            const DuneWave wave = dune_wave_measured(settings, shear_velocity, k, d.size, d.row, d.column,
                                                     d.size > 100 ? 0.005 : 0.02);
            EXPECT_NEAR(wave.growth, theory.growth, 0.02 * greatest) << k << ' ' << d.row << ' ' << d.column;
            EXPECT_NEAR(wave.speed, theory.speed, 0.005 * theory.speed)
                << k << ' ' << d.row << ' ' << d.column;
        }
    // The fastest-growing wave has a length of 21.2 L_sat, the shortest growing one 13.7 L_sat.
    EXPECT_NEAR(dune_wave_theory(settings, shear_velocity, 2 * pi / 13.72).growth, 0.0, 1e-4);
    EXPECT_NEAR(dune_wave_theory(settings, shear_velocity, 2 * pi / 21.2).growth, greatest, 1e-5);
}

TEST(DuneSolver, SandIsConservedToTheUnit) {
    for (const DuneBorder border : {DuneBorder::periodic, DuneBorder::open, DuneBorder::walled})
        for (const int size : {40, 150}) {
            DuneScene scene(size, size - 7, 1.0);
            scene.fill(dune_lumps);
            DuneSolverSettings settings;
            settings.border = border;
            settings.influx = 0.5;
            dune_run(scene, settings, dune_two_winds(), 120);
        }
}

TEST(DuneSolver, SameBitsAtAnyThreadCount) {
    DuneScene scene(300, 280, 1.0);
    scene.fill(dune_lumps);
    std::array<std::vector<SandUnits>, 2> sand;
    for (const size_t threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        sand[threads - 1] = dune_run(scene, {}, dune_two_winds(), 40);
    }
    EXPECT_EQ(sand[0], sand[1]);
    EXPECT_NE(sand[0], scene.sand);
}

TEST(DuneSolver, ResumesWithTheSameBits) {
    for (const DuneBorder border : {DuneBorder::periodic, DuneBorder::open}) {
        DuneScene scene(72, 60, 1.0);
        scene.fill(dune_lumps);
        DuneSolverSettings settings;
        settings.border = border, settings.influx = 0.3;
        const auto solver = [&] {
            return DuneSolver(scene.domain, settings, scene.rock.data(), scene.sand.data());
        };
        DuneSolver whole = solver(), half = solver(), rest = solver();
        const double hours = 6.5 * seconds_per_hour;
        ASSERT_TRUE(whole.advance(dune_two_winds(), hours));
        int left = 25;
        EXPECT_FALSE(half.advance(dune_two_winds(), hours, {.cancelled = [&] { return left-- == 0; }}));
        rest.restore(half.save());
        ASSERT_TRUE(rest.advance(dune_two_winds(), hours - rest.time()));
        EXPECT_EQ(dune_sand(whole, scene), dune_sand(rest, scene));
        EXPECT_EQ(whole.steps(), rest.steps());
        EXPECT_EQ(whole.airborne(), rest.airborne());
        EXPECT_EQ(whole.out(), rest.out());
    }
}

TEST(DuneSolver, HardCases) {
    for (const double cell : {1e-3, 1.0, 100.0})
        for (const int size : {1, 2, 3, 17})
            for (const DuneBorder border : {DuneBorder::periodic, DuneBorder::open, DuneBorder::walled})
                for (const double shear_velocity : {0.0, 0.1, 0.5, 100.0}) {
                    DuneScene scene(size, size == 17 ? 13 : size, cell);
                    DuneSolverSettings settings;
                    settings.border = border, settings.influx = 1.0;
                    const WindHistory wind = steady_wind({-1.0, 1.0, shear_velocity});
                    dune_run(scene, settings, wind, 3); // no sand
                    scene.fill([&](double x, double z) {
                        return cell * (20.0 + std::sin(37.0 * (x + 1.3 * z) / cell));
                    });
                    dune_run(scene, settings, wind, 3);
                    for (size_t k = 0; k < scene.rock.size(); ++k) // steep rock, half of it bare
                        scene.rock[k] = float(cell * 5.0 * unit_double(hash(1, k)));
                    scene.fill(
                        [&](double x, double z) { return cell * std::sin(2.0 * (x + 0.3 * z) / cell); });
                    dune_run(scene, settings, wind, 3);
                }
}

TEST(DuneSolver, NothingMovesBelowTheThreshold) {
    DuneScene scene(32, 32, 1.0);
    scene.fill([](double x, double z) { return 1.0 + 0.1 * std::sin(0.2 * x + 0.2 * z); });
    EXPECT_EQ(dune_run(scene, {}, steady_wind({0.6, 0.8, 0.1}), 3), scene.sand);
    EXPECT_NE(dune_run(scene, {}, steady_wind({0.6, 0.8, 0.3}), 3), scene.sand);
}

TEST(DuneSolver, PlantsHoldSand) {
    DuneScene scene(32, 32, 1.0);
    scene.fill([](double x, double z) { return 1.0 + 0.1 * std::sin(0.2 * x + 0.2 * z); });
    const std::vector<float> plants(scene.sand.size(), 0.25F); // reduces u* to u* / sqrt(5)
    DuneSolverSettings settings;
    settings.growth.frontal_area = 1.0;
    DuneSolver solver(scene.domain, settings, scene.rock.data(), scene.sand.data(), plants.data());
    solver.step({1.0, 0.0, 0.45}, 1e5);
    EXPECT_EQ(dune_sand(solver, scene), scene.sand);
}

// The saved state is complete: nothing else that a solver has done before, such as turning to a wind across,
// affects the result. The sizes are not multiples of the vector width.
TEST(DuneSolver, ResumesAtAnySizeAfterWindsAcross) {
    DuneScene scene(47, 29, 1.0);
    scene.fill([](double x, double z) { return 3.0 + std::sin(0.4 * x + 0.1 * z) + std::sin(0.5 * z); });
    DuneSolverSettings settings;
    settings.border = DuneBorder::open;
    const WindHistory wind = wind_sequence({{{1.0, 0.0, 0.45}, 130000.0}, {{0.0, 1.0, 0.45}, 130000.0}});
    DuneSolver whole(scene.domain, settings, scene.rock.data(), scene.sand.data());
    for (int part = 0; part < 4; ++part) {
        whole.advance(wind, 170000.0);
        DuneSolver resumed(scene.domain, settings, scene.rock.data(), scene.sand.data());
        resumed.restore(whole.save());
        whole.advance(wind, 90000.0), resumed.advance(wind, 90000.0);
        EXPECT_EQ(dune_sand(whole, scene), dune_sand(resumed, scene)) << part;
        EXPECT_EQ(whole.steps(), resumed.steps());
    }
}

// Wind at any angle to the grid makes the same dune, without grid-aligned grooves along the wind.
TEST(DuneSolver, GridsTurnedByAnyAngleGiveTheSameDune) {
    DuneSolverSettings settings;
    settings.border = DuneBorder::open;
    double upright = 0.0;
    for (const double angle : {0.0, 30.0, 45.0}) {
        const double cx = std::cos(angle * degree), cz = std::sin(angle * degree);
        DuneScene scene(48, 48, 2.0);
        scene.fill([&](double x, double z) {
            const double a = x + 15.0 * cx, b = z + 15.0 * cz;
            return 4.08 * std::exp(-(a * a + b * b) / 144.0) - 0.08;
        });
        DuneSolver solver(scene.domain, settings, scene.rock.data(), scene.sand.data());
        solver.advance(steady_wind({cx, cz, 0.5}), 500.0 * seconds_per_hour);
        double most = 0.0;
        for (const SandUnits sand : dune_sand(solver, scene)) most = std::max(most, sand_metres(sand));
        if (angle == 0.0) upright = most;
        EXPECT_NEAR(most, upright, 0.06 * upright) << angle << " degrees";
    }
}

// p' = V (1 - p / P) where the ground is still, minus the change of its height elsewhere. A restored state
// continues with the same bits.
TEST(DuneSolver, PlantsGrowAndAreBuried) {
    DuneScene scene(48, 32, 1.0);
    scene.fill([](double x, double z) { return 3.0 * std::exp(-(x * x + z * z) / 40.0) - 0.01; });
    const std::vector<float> plants(scene.sand.size(), 0.8F);
    DuneSolverSettings settings;
    settings.growth = {2.0 / seconds_per_year, 0.5, 0.04, 0.2};
    DuneSolver still(scene.domain, settings, scene.rock.data(), scene.sand.data(), plants.data());
    const double time = 0.1 * seconds_per_year;
    still.advance(steady_wind({1.0, 0.0, 0.1}), time); // below the threshold: sand does not move
    std::vector<float> cover(scene.sand.size());
    still.cover(cover);
    const double height = 0.5 - (0.5 - 0.1) * std::exp(-2.0 * 0.1 / 0.5);
    for (const float share : cover) EXPECT_NEAR(share, 0.8 * std::pow(height / 0.5, 2), 1e-5);

    DuneSolver blown(scene.domain, settings, scene.rock.data(), scene.sand.data(), plants.data());
    const WindHistory wind = steady_wind({0.8, 0.6, 0.45});
    blown.advance(wind, 0.5 * time);
    DuneSolver resumed(scene.domain, settings, scene.rock.data(), scene.sand.data(), plants.data());
    resumed.restore(blown.save());
    blown.advance(wind, 0.5 * time), resumed.advance(wind, 0.5 * time);
    std::vector<float> again(scene.sand.size());
    blown.cover(cover), resumed.cover(again);
    EXPECT_EQ(cover, again);
    EXPECT_EQ(dune_sand(blown, scene), dune_sand(resumed, scene));
    EXPECT_EQ(*std::min_element(cover.begin(), cover.end()), 0.0F); // buried or eroded
    EXPECT_GT(*std::max_element(cover.begin(), cover.end()), 0.5F * 0.8F * float(std::pow(height / 0.5, 2)));
}

TEST(DuneSolver, ProblemsAreNamed) {
    DuneScene scene(4, 4, 1.0);
    scene.sand[3] = -1;
    EXPECT_NE(DuneSolver::problem(scene.domain, {}, scene.rock.data(), scene.sand.data()), "");
    scene.sand[3] = 0, scene.rock[2] = std::numeric_limits<float>::quiet_NaN();
    EXPECT_NE(DuneSolver::problem(scene.domain, {}, scene.rock.data(), scene.sand.data()), "");
    scene.rock[2] = 0.0F, scene.domain.cell = 0.0;
    EXPECT_NE(DuneSolver::problem(scene.domain, {}, scene.rock.data(), scene.sand.data()), "");
}

// A quarter turn of scene and wind rotates the result by a quarter turn. Rounding can change single avalanche
// decisions; then the results differ by millimetres.
TEST(DuneSolver, TurnedScenesGiveTheSame) {
    struct Case {
        double height, tolerance;
    };
    for (const Case c : {Case{0.8, 2e-5}, {3.0, 0.03}}) {
        DuneScene scene(64, 64, 1.0), turned(64, 64, 1.0);
        scene.fill([&](double x, double z) {
            return c.height * std::exp(-(x * x + z * z + 0.5 * x * z) / 90.0) - 0.01;
        });
        for (int j = 0; j < 64; ++j)
            for (int i = 0; i < 64; ++i)
                turned.sand[turned.domain.index(63 - j, i)] = scene.sand[scene.domain.index(i, j)];
        DuneSolverSettings settings;
        settings.border = DuneBorder::open;
        const auto a = dune_run(scene, settings, steady_wind({0.8, 0.6, 0.4}), 60, 600.0);
        const auto b = dune_run(turned, settings, steady_wind({-0.6, 0.8, 0.4}), 60, 600.0);
        SandUnits worst = 0;
        for (int j = 0; j < 64; ++j)
            for (int i = 0; i < 64; ++i)
                worst = std::max(worst,
                                 std::abs(b[turned.domain.index(63 - j, i)] - a[scene.domain.index(i, j)]));
        EXPECT_LT(sand_metres(worst), c.tolerance) << c.height;
    }
}

TEST(DuneSolver, AHeapBecomesABarchan) {
    DuneScene scene(112, 96, 1.0);
    scene.fill([](double x, double z) {
        const double r2 = (x + 30.0) * (x + 30.0) + z * z;
        return 3.5 * std::exp(-r2 / 100.0) - 0.02;
    });
    DuneSolverSettings settings;
    settings.border = DuneBorder::open;
    DuneSolver solver(scene.domain, settings, scene.rock.data(), scene.sand.data());
    ASSERT_TRUE(solver.advance(steady_wind({1.0, 0.0, 0.5}), 420.0 * seconds_per_hour));
    const std::vector<SandUnits> sand = dune_sand(solver, scene);
    // Downwind end of the dune (20 cm high) along its middle, and the furthest downwind ends: the horns.
    int middle = 0, horns[2] = {0, 0};
    double crest = 0.0, asymmetry = 0.0, steepest = 0.0;
    for (int j = 1; j + 1 < 96; ++j)
        for (int i = 1; i + 1 < 112; ++i) {
            const double h = sand_metres(sand[scene.domain.index(i, j)]);
            crest = std::max(crest, h);
            if (h > 0.2) {
                if (j == 48) middle = std::max(middle, i);
                int& horn = horns[j < 48 ? 0 : 1];
                horn = std::max(horn, i);
            }
            asymmetry = std::max(asymmetry, std::abs(h - sand_metres(sand[scene.domain.index(i, 96 - j)])));
            const auto at = [&](int a, int b) { return sand_metres(sand[scene.domain.index(i + a, j + b)]); };
            steepest = std::max(steepest, std::hypot(at(1, 0) - at(0, 0) + at(1, 1) - at(0, 1),
                                                     at(0, 1) - at(0, 0) + at(1, 1) - at(1, 0)) /
                                              2.0);
        }
    std::printf("crest %.2f m, horns %d and %d m ahead, steepest %.1f deg, asymmetry %.3g m, %d steps\n",
                crest, horns[0] - middle, horns[1] - middle, std::atan(steepest) / degree, asymmetry,
                int(solver.steps()));
    EXPECT_GT(crest, 2.0);
    EXPECT_GE(horns[0] - middle, 3);
    EXPECT_GE(horns[1] - middle, 3);
    EXPECT_GT(std::atan(steepest) / degree, 32.0);
    EXPECT_LT(std::atan(steepest) / degree, 34.6);
    EXPECT_LT(asymmetry, 0.05 * crest);
}

// What is on its way across the periodic border after any step of `seconds`: of all sand, and of what the
// greatest step can carry.
struct Airborne {
    double of_all = 0.0, of_carried = 0.0;
};
Airborne max_airborne(const Domain& domain, const std::vector<SandUnits>& sand, const WindHistory& wind,
                      double seconds, double longest = infinity) {
    const std::vector<float> rock(domain.count(), 0.0F);
    const SandPhysics physics;
    DuneSolver solver(domain, {}, rock.data(), sand.data());
    const double all = double(std::accumulate(sand.begin(), sand.end(), SandUnits(0)));
    double most = 0.0, carried = 1.0;
    while (solver.time() < seconds) {
        const WindSpan span = wind(solver.time());
        const double step = solver.step(span.wind, std::min(span.until - solver.time(), longest));
        if (const double flux = physics.saturated_flux(span.wind.shear_velocity); flux > 0.0)
            carried = std::max(carried, flux * step * sand_units_per_metre /
                                            (physics.bulk_density * domain.cell) * domain.nx);
        most = std::max(most, std::abs(double(solver.airborne())));
    }
    return {most / all, most / carried};
}

std::vector<SandUnits> sand_of(const Domain& domain,
                               const std::function<double(double x, double z)>& height) {
    std::vector<SandUnits> sand(domain.count());
    for (size_t k = 0; k < sand.size(); ++k)
        sand[k] = sand_units(std::max(0.0, height(double(k % size_t(domain.nx)) / domain.nx,
                                                  double(k / size_t(domain.nx)) / domain.nz)));
    return sand;
}

TEST(DuneSolver, NoSandIsMadeAtThePeriodicBorder) {
    const double threshold = SandPhysics().threshold, day = 24.0 * seconds_per_hour;
    const Domain metres{32, 32, 1.0, 0.0, 0.0};
    const std::vector<SandUnits> waves = sand_of(metres, [](double x, double z) {
        return 1.0 + std::sin(4.0 * pi * x + 1.0) * std::cos(2.0 * pi * z) + 0.3 * std::sin(6.0 * pi * x);
    });
    // Level sand hardly moves in the first wind, crests do; then the wind is strong. It was 20 times all
    // sand.
    for (const double above : {2.8e-3, 1.6e-4, 2.5e-6, 6e-7}) {
        const SandWind weak{1.0, 0.0, threshold * (1.0 + above)}, strong{1.0, 0.0, 2.37 * threshold};
        EXPECT_LT(
            max_airborne(metres, waves, wind_sequence({{weak, day}, {strong, day}, {weak, day}}), 4.0 * day)
                .of_all,
            2e-5)
            << above;
    }
    // Many winds, most of them above the threshold; a step of a weak one is long. It was 1 %.
    ChaoticWind chaos;
    chaos.spread = 20.0 * degree, chaos.mean = 1.18 * threshold, chaos.seconds = 3.0 * seconds_per_hour;
    for (const uint64_t seed : {1, 2, 3}) {
        chaos.seed = seed;
        EXPECT_LT(max_airborne(metres, waves, chaotic_wind(chaos), 20.0 * day).of_all, 5e-4) << seed;
    }
    // Domains much shorter than the saturation length, whose outflow remembers the inflow: on a slope, and in
    // a calm after a strong wind. It was 0.7 times all sand.
    const auto slope = [](double x, double z) { return 1.0 + 1e-4 * (x + z); };
    const Domain millimetres{32, 32, 1e-3, 0.0, 0.0}, centimetres{32, 32, 0.01, 0.0, 0.0};
    EXPECT_LT(
        max_airborne(millimetres, sand_of(millimetres, slope), steady_wind({1.0, 0.0, 0.391}), 1.6).of_all,
        2e-5);
    EXPECT_LT(max_airborne(centimetres, sand_of(centimetres, slope),
                           wind_sequence({{{1.0, 0.0, 0.434}, 60.0}, {{1.0, 0.0, 0.13}, day}}), 2.0 * day)
                  .of_all,
              2e-5);
    // A heap on rock, in a wind off the grid: what reaches a column of bare rock after some round trips.
    // Winds and calms in turn, two winds in turn, and steps that carry next to nothing. It was up to 4,300
    // times what a step carries.
    const std::vector<SandUnits> heap = sand_of(metres, [](double x, double z) {
        return 3.0 * (0.15 - 5.0 * (std::pow(x - 0.5, 2) + std::pow(z - 0.5, 2)));
    });
    const auto towards = [](double degrees, double shear) {
        return SandWind{std::cos(degrees * degree), std::sin(degrees * degree), shear};
    };
    const SandWind wind = towards(20.3, 0.39), calm = towards(20.3, 0.1), other = towards(110.3, 0.39);
    EXPECT_LT(max_airborne(metres, heap, wind_sequence({{wind, 100.0}, {calm, 100.0}}), 4e4).of_carried, 1.0);
    EXPECT_LT(max_airborne(metres, heap, wind_sequence({{wind, 100.0}, {other, 100.0}}), 4e4).of_carried,
              1.0);
    EXPECT_LT(max_airborne(metres, heap, steady_wind(wind), 900.0, 0.3).of_carried, 1.0);
}

} // namespace
} // namespace marram
