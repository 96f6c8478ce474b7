// SPDX-License-Identifier: Apache-2.0
// Measures the dune solver against theory and field data, and prints tables. Its speed: build/marram_bench.
//
//     dune_solver waves         growth and speed of small waves against linear theory
//     dune_solver barchans [n] [u*] [B]  height, width, length and celerity of n sizes after three turnovers (7; the
//                               smallest has no slip face)
//     dune_solver ridges [B]    transverse ridges: celerity against the flux over the brink
//     dune_solver directions    orientation of crests on a sand-covered bed under pairs of winds
//     dune_solver fingers [DIR] orientation of what extends from a source of sand on hard ground
//     dune_solver kinds [DIR]   a heap in one wind, in two, in five: barchan, seif, star; pictures to DIR
//     dune_solver convergence   one dune with cells of 2, 1 and 1/2 m, and the grid turned by 45 degrees
//     dune_solver turned cell   one dune, the grid turned by 0, 15, 30, 45 degrees
//     dune_solver conservation [n]  sand after n steps (10,000), on one thread and on two, where the run is saved and
//                               resumed at ten random steps
//     dune_solver picture out.pgm hours u* [degrees]
#include "tests/bench/dune_solver/kinds.h"
#include "tests/bench/dune_solver/picture.h"
#include "tests/unit/terrain/solver/dune_waves.h"

#include "core/math/hash.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <tuple>

namespace marram {
namespace {

void print_waves() {
    const DuneSolverSettings settings;
    const double shear_velocity = 2.0 * settings.physics.threshold;
    double greatest = 0.0;
    for (double k = 0.01; k < 1.0; k += 0.001)
        greatest = std::max(greatest, dune_wave_theory(settings, shear_velocity, k).growth);
    std::printf("waves: r = 2, k in 1 / L_sat, rates in its time; errors in %% of the greatest growth and of "
                "the speed\n");
    std::printf("%10s %6s %10s %10s %7s %9s %9s %7s\n", "direction", "k", "growth", "theory", "error",
                "speed", "theory", "error");
    struct Direction {
        const char* name;
        int size, row, column;
    };
    for (const Direction d : {Direction{"0", 48, 0, 1}, {"atan 2/5", 256, 2, 5}, {"45", 64, 1, 1}})
        for (const double k : {0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6}) {
            const DuneWave theory = dune_wave_theory(settings, shear_velocity, k);
            const DuneWave wave = dune_wave_measured(settings, shear_velocity, k, d.size, d.row, d.column);
            std::printf("%10s %6.2f %10.5f %10.5f %6.2f%% %9.4f %9.4f %6.2f%%\n", d.name, k, wave.growth,
                        theory.growth, 100.0 * (wave.growth - theory.growth) / greatest, wave.speed,
                        theory.speed, 100.0 * (wave.speed / theory.speed - 1.0));
        }
}

// A sand-covered bed with a small random roughness.
std::vector<SandUnits> rough_cover(const Domain& domain, double depth, double roughness) {
    std::vector<SandUnits> sand(domain.count());
    for (size_t k = 0; k < sand.size(); ++k)
        sand[k] = sand_units(depth + roughness * (unit_double(hash(7, k)) - 0.5));
    return sand;
}

struct DuneFigures {
    double height = 0.0, width = 0.0, length = 0.0; // metres; length: foot to brink in the middle row
    double volume = 0.0, x = 0.0, middle = 0.0;     // x: centre of mass; middle: its row
    double brink = 0.0, slip_foot = 0.0;            // heights
    int brink_column = 0, slip_column = 0; // in the middle row, downwind of the crest; the same: no slip face
};

// Measures the sand higher than `foot` on a periodic grid, with the wind along +x.
DuneFigures measure_dune(const Domain& domain, const std::vector<SandUnits>& sand, double foot) {
    DuneFigures f;
    double cx = 0.0, sx = 0.0, cz = 0.0, sz = 0.0;
    const auto at = [&](int i, int j) {
        return sand_metres(sand[domain.index((i + 4 * domain.nx) % domain.nx, (j + domain.nz) % domain.nz)]);
    };
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const double h = at(i, j);
            f.volume += h * domain.cell * domain.cell;
            const double w = h > foot ? h : 0.0, a = 2 * pi * i / domain.nx, b = 2 * pi * j / domain.nz;
            cx += w * std::cos(a), sx += w * std::sin(a), cz += w * std::cos(b), sz += w * std::sin(b);
            f.height = std::max(f.height, h);
        }
    f.x = std::atan2(sx, cx) / (2 * pi) * domain.nx * domain.cell;
    f.middle = std::atan2(sz, cz) / (2 * pi) * domain.nz;
    const int row = (int(std::lround(f.middle)) + domain.nz) % domain.nz;
    int crest = 0;
    for (int i = 0; i < domain.nx; ++i)
        if (at(i, row) > at(crest, row)) crest = i;
    // The slip face runs from the brink, where the slope first exceeds 20 degrees, to where it no longer
    // does.
    const double steep = std::tan(20.0 * degree) * domain.cell;
    int brink = crest;
    while (brink < crest + domain.nx / 2 && at(brink, row) - at(brink + 1, row) < steep) ++brink;
    int end = brink;
    while (at(end, row) - at(end + 1, row) >= steep) ++end;
    f.brink_column = brink, f.slip_column = end;
    f.brink = at(brink, row), f.slip_foot = at(end, row);
    int start = crest;
    while (start > crest - domain.nx && at(start, row) > foot) --start;
    f.length = (brink - start) * domain.cell;
    const auto row_has = [&](int j) {
        for (int i = 0; i < domain.nx; ++i)
            if (at(i, j) > foot) return true;
        return false;
    };
    int up = 0, down = 0;
    while (up < domain.nz / 2 && row_has(row - up - 1)) ++up;
    while (down < domain.nz / 2 && row_has(row + down + 1)) ++down;
    f.width = (up + down + 1) * domain.cell;
    return f;
}

void print_barchans(int count, double shear_velocity, double out_of_phase) {
    DuneSolverSettings settings;
    settings.shear.out_of_phase = out_of_phase;
    const double flux = settings.physics.saturated_flux(shear_velocity) / settings.physics.bulk_density;
    std::printf(
        "barchans: constant volume, u* = %.2f m/s, Q = %.3g m^2/s, B = %.2f; field: W = 8.6 H + 8.8, L = "
        "5.5 H + 10.8\n",
        shear_velocity, flux, out_of_phase);
    std::printf("%6s %9s %7s %7s %7s %7s %7s %9s %9s %8s\n", "cell", "volume", "H", "W", "field", "L",
                "field", "c m/year", "Q / c m", "steps");
    std::vector<std::array<double, 2>> points;
    double width_error = 0.0, length_error = 0.0;
    for (int k = 0; k < count; ++k) {
        const double height = 2.5 * std::pow(1.35, k), cell = std::max(0.5, height / 4.0);
        const int n = 128;
        const Domain domain{n, n, cell, 0.0, 0.0};
        std::vector<float> rock(domain.count(), 0.0F);
        std::vector<SandUnits> sand(domain.count());
        for (int j = 0; j < n; ++j)
            for (int i = 0; i < n; ++i) {
                const double x = (i - n / 2) * cell, z = (j - n / 2) * cell, r = 3.3 * height;
                sand[domain.index(i, j)] = sand_units(
                    std::max(0.0, 1.02 * height * std::exp(-(x * x + z * z) / (r * r)) - 0.02 * height));
            }
        DuneSolver solver(domain, settings, rock.data(), sand.data());
        const WindHistory wind = steady_wind({1.0, 0.0, shear_velocity});
        const double turnover = 8.0 * height * height / (2.0 * flux); // about L / c
        solver.advance(wind, 3.0 * turnover);
        DuneFigures mean, before;
        double travelled = 0.0;
        int with_slip_face = 0;
        const int samples = 40;
        for (int s = 0; s <= samples; ++s) {
            solver.sand(sand);
            const DuneFigures f = measure_dune(domain, sand, 0.04 * height);
            mean.height += f.height / (samples + 1), mean.width += f.width / (samples + 1);
            mean.length += f.length / (samples + 1), mean.volume = f.volume;
            with_slip_face += f.slip_column > f.brink_column;
            if (s > 0) travelled += std::remainder(f.x - before.x, n * cell);
            before = f;
            if (s < samples) solver.advance(wind, turnover / samples);
        }
        const double c = travelled / turnover;
        const double field_width = 8.6 * mean.height + 8.8, field_length = 5.5 * mean.height + 10.8;
        std::printf("%6.2f %9.0f %7.2f %7.1f %7.1f %7.1f %7.1f %9.2f %9.2f %8d", cell, mean.volume,
                    mean.height, mean.width, field_width, mean.length, field_length, c * seconds_per_year,
                    flux / c, int(solver.steps()));
        if (with_slip_face == samples + 1) {
            points.push_back({mean.height, flux / c});
            width_error = std::max(width_error, std::abs(mean.width / field_width - 1.0));
            length_error = std::max(length_error, std::abs(mean.length / field_length - 1.0));
            std::printf("\n");
        } else {
            std::printf("  no slip face at %d of %d times: not a barchan\n", samples + 1 - with_slip_face,
                        samples + 1);
        }
        std::fflush(stdout);
    }
    if (points.empty()) return;
    std::printf("%zu barchans: greatest difference from the field's lines: W %.1f %%, L %.1f %%\n",
                points.size(), 100.0 * width_error, 100.0 * length_error);
    if (points.size() < 3) return; // no line through them
    double sh = 0.0, sy = 0.0, shh = 0.0, shy = 0.0, syy = 0.0;
    for (const auto& [h, y] : points) sh += h, sy += y, shh += h * h, shy += h * y, syy += y * y;
    const double m = double(points.size()), slope = (m * shy - sh * sy) / (m * shh - sh * sh);
    const double r2 = std::pow(m * shy - sh * sy, 2) / ((m * shh - sh * sh) * (m * syy - sy * sy));
    std::printf("Q / c = %.3f (H + %.2f m), R^2 %.4f\n", slope, (sy - slope * sh) / (m * slope), r2);
}

// Transverse ridges: all sand that passes the brink settles on the slip face.
void print_ridges(double out_of_phase) {
    DuneSolverSettings settings;
    settings.shear.out_of_phase = out_of_phase;
    const double shear_velocity = 0.5,
                 flux = settings.physics.saturated_flux(shear_velocity) / settings.physics.bulk_density;
    std::printf(
        "ridges across the wind, periodic: c (h_brink - h_slip foot) against what settles behind the brink\n"
        "%7s %7s %7s %9s %11s %11s %8s\n",
        "H", "brink", "L", "c m/year", "c h m^2/y", "q_brink", "error");
    for (const double height : {3.0, 5.0, 8.0}) {
        const double cell = height / 8.0;
        const Domain domain{256, 4, cell, 0.0, 0.0};
        const std::vector<float> rock(domain.count(), 0.0F);
        std::vector<SandUnits> sand(domain.count()), later(domain.count());
        for (int j = 0; j < domain.nz; ++j)
            for (int i = 0; i < domain.nx; ++i) {
                const double x = (i - 128) * cell, r = 5.0 * height;
                sand[domain.index(i, j)] =
                    sand_units(std::max(0.0, 1.02 * height * std::exp(-x * x / (r * r)) - 0.02 * height));
            }
        DuneSolver solver(domain, settings, rock.data(), sand.data());
        const WindHistory wind = steady_wind({1.0, 0.0, shear_velocity});
        const double turnover = 8.0 * height * height / (2.0 * flux);
        solver.advance(wind, 3.0 * turnover);
        double travelled = 0.0, law = 0.0, settled = 0.0;
        DuneFigures mean;
        const int samples = 50;
        const double interval = 0.5 * turnover / samples;
        solver.sand(sand);
        DuneFigures before = measure_dune(domain, sand, 0.02 * height);
        for (int s = 0; s < samples; ++s) {
            solver.advance(wind, interval);
            solver.sand(later);
            const DuneFigures f = measure_dune(domain, later, 0.02 * height);
            const double moved = std::remainder(f.x - before.x, domain.nx * cell);
            travelled += moved;
            law += moved * (before.brink - before.slip_foot);
            for (int i = before.brink_column + 1; i < before.brink_column + 96; ++i)
                settled += sand_metres(later[domain.index(i % domain.nx, 0)] -
                                       sand[domain.index(i % domain.nx, 0)]) *
                           cell;
            mean.height += f.height / samples, mean.brink += f.brink / samples,
                mean.length += f.length / samples;
            before = f, sand = later;
        }
        const double a_year = seconds_per_year / (interval * samples);
        std::printf("%7.2f %7.2f %7.1f %9.2f %11.1f %11.1f %7.2f%%\n", mean.height, mean.brink, mean.length,
                    travelled * a_year, law * a_year, settled * a_year, 100.0 * (law / settled - 1.0));
        std::fflush(stdout);
    }
}

// Direction of crests (radians from +x, 0 to pi) from the tensor of gradients.
double crest_direction(const Domain& domain, const std::vector<SandUnits>& sand) {
    double xx = 0.0, xz = 0.0, zz = 0.0;
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const auto h = [&](int a, int b) {
                return sand_metres(
                    sand[domain.index((i + a + domain.nx) % domain.nx, (j + b + domain.nz) % domain.nz)]);
            };
            const double gx = h(1, 0) - h(-1, 0), gz = h(0, 1) - h(0, -1);
            xx += gx * gx, xz += gx * gz, zz += gz * gz;
        }
    const double across = 0.5 * std::atan2(2.0 * xz, xx - zz); // direction of the strongest gradient
    return std::fmod(across + 0.5 * pi + pi, pi);
}

void print_directions() {
    const DuneSolverSettings settings;
    const double shear_velocity = 0.44, length = settings.physics.saturation_length();
    std::printf(
        "directions: covered bed, two equal winds in turn; crests against the greatest gross growth\n");
    std::printf("%8s %8s %8s %8s\n", "apart", "crest", "theory", "error");
    for (const double apart : {45.0, 75.0, 105.0, 150.0}) {
        const double middle = 20.0 * degree; // off the grid's axes
        std::array<double, 2> angles = {middle - 0.5 * apart * degree, middle + 0.5 * apart * degree};
        double best = 0.0, theory = 0.0;
        for (double a = 0.0; a < pi; a += 0.001) {
            double sum = 0.0;
            for (const double t : angles) {
                const double s = std::sin(t - a);
                sum += std::abs(s) + 1.6 * s * s;
            }
            if (sum > best) best = sum, theory = a;
        }
        const Domain domain{128, 128, length, 0.0, 0.0};
        const std::vector<float> rock(domain.count(), 0.0F);
        std::vector<SandUnits> sand = rough_cover(domain, 30.0, 0.2);
        DuneSolver solver(domain, settings, rock.data(), sand.data());
        const double turn = 24.0 * seconds_per_hour;
        std::vector<TimedWind> winds;
        for (const double t : angles) winds.push_back({{std::cos(t), std::sin(t), shear_velocity}, turn});
        solver.advance(wind_sequence(winds), 4000.0 * seconds_per_hour);
        solver.sand(sand);
        const double crest = crest_direction(domain, sand);
        std::printf("%8.0f %8.1f %8.1f %8.1f\n", apart, crest / degree, theory / degree,
                    std::remainder(crest - theory, pi) / degree);
        std::fflush(stdout);
    }
}

// A heap in a steady wind: crest height and distance travelled.
std::array<double, 2> travelled_heap(double cell, double angle) {
    const int n = int(96.0 / cell);
    const Domain domain{n, n, cell, 0.0, 0.0};
    const std::vector<float> rock(domain.count(), 0.0F);
    std::vector<SandUnits> sand(domain.count());
    const double cx = std::cos(angle), cz = std::sin(angle);
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const double x = (i + 0.5) * cell - 48.0 + 15.0 * cx, z = (j + 0.5) * cell - 48.0 + 15.0 * cz;
            sand[domain.index(i, j)] =
                sand_units(std::max(0.0, 4.08 * std::exp(-(x * x + z * z) / 144.0) - 0.08));
        }
    DuneSolverSettings settings;
    settings.border = DuneBorder::open;
    DuneSolver solver(domain, settings, rock.data(), sand.data());
    solver.advance(steady_wind({cx, cz, 0.5}), 500.0 * seconds_per_hour);
    solver.sand(sand);
    double height = 0.0, sum = 0.0, along = 0.0;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const double h = sand_metres(sand[domain.index(i, j)]);
            height = std::max(height, h);
            sum += h, along += h * (((i + 0.5) * cell - 48.0) * cx + ((j + 0.5) * cell - 48.0) * cz);
        }
    return {height, along / sum + 15.0};
}

void print_convergence() {
    std::printf("convergence: a heap of 4 m after 500 h, u* = 0.5 m/s, open border\n%8s %8s %9s %11s\n",
                "cell", "angle", "height m", "travelled m");
    std::array<std::array<double, 2>, 3> results = {};
    for (const double cell : {2.0, 1.0, 0.5}) {
        const auto turned = travelled_heap(cell, 45.0 * degree);
        std::printf("%8.2f %8.0f %9.3f %11.3f\n", cell, 45.0, turned[0], turned[1]);
        std::fflush(stdout);
    }
    int k = 0;
    for (const double cell : {2.0, 1.0, 0.5}) {
        results[size_t(k)] = travelled_heap(cell, 0.0);
        std::printf("%8.2f %8.0f %9.3f %11.3f\n", cell, 0.0, results[size_t(k)][0], results[size_t(k)][1]);
        std::fflush(stdout);
        ++k;
    }
    for (const size_t what : {0, 1})
        std::printf("order of %s: %.2f\n", what == 0 ? "height" : "distance",
                    std::log2(std::abs((results[0][what] - results[1][what]) /
                                       (results[1][what] - results[2][what]))));
}

void print_turned(double cell) {
    std::printf("turned: a heap of 4 m after 500 h, u* = 0.5 m/s, open border, cell %.2f m\n%8s %9s %11s\n",
                cell, "angle", "height m", "travelled m");
    for (const double angle : {0.0, 15.0, 30.0, 42.0, 45.0, 50.0}) {
        const auto result = travelled_heap(cell, angle * degree);
        std::printf("%8.0f %9.3f %11.3f\n", angle, result[0], result[1]);
        std::fflush(stdout);
    }
}

// Heaps in winds across each other.
void print_conservation(int64_t steps) {
    const Domain domain{95, 78, 1.0, 0.0, 0.0}; // no multiples of the vector width
    const std::vector<float> rock(domain.count(), 0.0F);
    std::vector<SandUnits> start(domain.count());
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i)
            start[domain.index(i, j)] = sand_units(std::max(
                0.0, 2.5 * std::sin(0.13 * i) * std::cos(0.11 * j) + 0.4 * std::sin(0.7 * i + 0.3 * j)));
    const WindHistory wind =
        wind_sequence({{{1.0, 0.0, 0.4}, 3.0 * seconds_per_hour},
                       {{-0.3, 0.9, 0.5}, 2.0 * seconds_per_hour},
                       {{0.7, -0.7, 0.1}, seconds_per_hour},
                       {{0.7, -0.7, 0.2201}, seconds_per_hour}, // hardly above the threshold
                       {{0.8, -0.7, 0.6}, seconds_per_hour}});
    const auto sum = [](const std::vector<SandUnits>& sand) {
        SandUnits all = 0;
        for (const SandUnits units : sand) all += units;
        return all;
    };
    const auto fields = [](const DuneState& s) {
        return std::tie(s.sand, s.height_before, s.plant_height, s.seam_flux, s.airborne, s.seam_direction,
                        s.seam_saturated, s.time, s.step_before, s.step_allowed, s.steps, s.in, s.out);
    };
    std::printf("conservation, in units of sand: bed + airborne + out - in against the bed at the start\n");
    std::printf("airborne: the most at any step, of the bed\n%10s %8s %10s %20s %20s %20s %12s %10s %16s\n",
                "border", "steps", "hours", "bed at start", "in", "out", "difference", "airborne",
                "resumed, threads");
    for (const auto& [border, name] : {std::pair{DuneBorder::periodic, "periodic"},
                                       {DuneBorder::open, "open"},
                                       {DuneBorder::walled, "walled"}}) {
        DuneSolverSettings settings;
        settings.border = border, settings.influx = 0.3;
        std::array<DuneState, 2> ends;
        for (const bool resumes : {false, true}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, resumes ? 2 : 1);
            std::vector<int64_t> stops{steps};
            for (uint64_t k = 0; resumes && k < 10; ++k)
                stops.push_back(int64_t(unit_double(hash(11, k)) * double(steps)));
            std::sort(stops.begin(), stops.end());
            DuneState state;
            SandUnits airborne = 0;
            for (size_t part = 0; part < stops.size(); ++part) {
                DuneSolver solver(domain, settings, rock.data(), start.data());
                if (part > 0) solver.restore(state);
                solver.advance(wind, infinity, {.cancelled = [&] {
                                   airborne = std::max(airborne, std::abs(solver.airborne()));
                                   return solver.steps() >= stops[part];
                               }});
                state = solver.save();
                if (part + 1 < stops.size()) continue;
                std::vector<SandUnits> sand(start.size());
                solver.sand(sand);
                if (!resumes)
                    std::printf(
                        "%10s %8lld %10.1f %20lld %20lld %20lld %12lld %10.2g", name,
                        (long long)solver.steps(), solver.time() / seconds_per_hour, (long long)sum(start),
                        (long long)solver.in(), (long long)solver.out(),
                        (long long)(sum(sand) + solver.airborne() + solver.out() - solver.in() - sum(start)),
                        double(airborne) / double(sum(start)));
                ends[resumes] = state;
            }
        }
        std::printf(" %16s\n", fields(ends[0]) == fields(ends[1]) ? "the same bits" : "DIFFERENT");
    }
}

bool picture(const char* path, double hours, double shear_velocity, double degrees) {
    const Domain domain{256, 256, 1.0, 0.0, 0.0};
    const std::vector<float> rock(domain.count(), 0.0F);
    std::vector<SandUnits> sand(domain.count());
    const double c = std::cos(degrees * degree), s = std::sin(degrees * degree);
    for (int j = 0; j < 256; ++j)
        for (int i = 0; i < 256; ++i) {
            const double x = i - 128 + 60 * c, z = j - 128 + 60 * s;
            sand[domain.index(i, j)] =
                sand_units(std::max(0.0, 4.08 * std::exp(-(x * x + z * z) / 200.0) - 0.08));
        }
    DuneSolverSettings settings;
    settings.border = DuneBorder::open;
    DuneSolver solver(domain, settings, rock.data(), sand.data());
    solver.advance(steady_wind({c, s, shear_velocity}), hours * seconds_per_hour);
    solver.sand(sand);
    return write_dune_picture(path, domain, sand);
}

} // namespace
} // namespace marram

int main(int argc, char** argv) {
    const auto is = [&](const char* name) { return argc > 1 && std::strcmp(argv[1], name) == 0; };
    if (is("waves"))
        marram::print_waves();
    else if (is("barchans"))
        marram::print_barchans(argc > 2 ? std::atoi(argv[2]) : 7, argc > 3 ? std::atof(argv[3]) : 0.36,
                               argc > 4 ? std::atof(argv[4]) : marram::ShearCoefficients().out_of_phase);
    else if (is("directions"))
        marram::print_directions();
    else if (is("fingers"))
        marram::print_fingers(argc > 2 ? argv[2] : "");
    else if (is("kinds"))
        marram::print_kinds(argc > 2 ? argv[2] : "");
    else if (is("convergence"))
        marram::print_convergence();
    else if (is("ridges"))
        marram::print_ridges(argc > 2 ? std::atof(argv[2]) : marram::ShearCoefficients().out_of_phase);
    else if (is("turned") && argc > 2)
        marram::print_turned(std::atof(argv[2]));
    else if (is("conservation"))
        marram::print_conservation(argc > 2 ? std::atoll(argv[2]) : 10000);
    else if (is("picture") && argc > 4)
        return marram::picture(argv[2], std::atof(argv[3]), std::atof(argv[4]),
                               argc > 5 ? std::atof(argv[5]) : 0.0)
                   ? 0
                   : 1;
    else {
        std::puts("dune_solver waves | barchans [COUNT] [U*] [B] | ridges [B] | directions | "
                  "fingers [DIR] "
                  "| kinds [DIR] | convergence "
                  "| turned CELL | conservation [STEPS] "
                  "| picture OUT.pgm "
                  "HOURS U* [DEGREES]");
        return 2;
    }
    return 0;
}
