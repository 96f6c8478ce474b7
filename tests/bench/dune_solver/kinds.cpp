// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/dune_solver/kinds.h"

#include "procedural/terrain/solver/solver.h"
#include "tests/bench/dune_solver/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

namespace marram {
namespace {

// A heap of this height at (x, z), metres from the grid's centre, with flanks of up to 20 degrees.
std::vector<SandUnits> heap_at(const Domain& domain, double height, double x, double z) {
    const double radius = 2.4 * height;
    std::vector<SandUnits> sand(domain.count());
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const double dx = (i - domain.nx / 2) * domain.cell - x,
                         dz = (j - domain.nz / 2) * domain.cell - z;
            sand[domain.index(i, j)] = sand_units(std::max(
                0.0, 1.02 * height * std::exp(-(dx * dx + dz * dz) / (radius * radius)) - 0.02 * height));
        }
    return sand;
}

// The elongation of a finger: tan a = sum Q sin t / sum Q cos t with Q = share (1 + 1.6 |sin(t - a)|)
// (Courrech du Pont, Narteau and Gao, Geology 2014).
double finger_direction(std::span<const double> towards, std::span<const double> shares) {
    double a = 0.0;
    for (int k = 0; k < 200; ++k) {
        double x = 0.0, z = 0.0;
        for (size_t w = 0; w < towards.size(); ++w) {
            const double q = shares[w] * (1.0 + 1.6 * std::abs(std::sin(towards[w] - a)));
            x += q * std::cos(towards[w]), z += q * std::sin(towards[w]);
        }
        a += 0.5 * std::remainder(std::atan2(z, x) - a, 2.0 * pi);
    }
    return a;
}

} // namespace

void print_fingers(const std::string& pictures) {
    constexpr double shear_velocity = 0.44, height = 5.0, cell = 2.0;
    constexpr int n = 192;
    std::printf(
        "fingers: a source of sand on hard ground, open borders, two winds in turn; the direction from the "
        "source to the sand beyond it\n%8s %8s %8s %8s %8s %9s\n",
        "apart", "share", "finger", "theory", "error", "length m");
    for (const auto& [apart, share] : std::vector<std::pair<double, double>>{
             {105.0, 0.5}, {105.0, 2.0 / 3.0}, {150.0, 0.5}, {150.0, 0.6}}) {
        const std::array towards = {20.0 * degree, (20.0 + apart) * degree};
        const std::array shares = {share, 1.0 - share};
        const double theory = finger_direction(towards, shares);
        const Domain domain{n, n, cell, 0.0, 0.0};
        const double sx = -0.3 * n * cell * std::cos(theory), sz = -0.3 * n * cell * std::sin(theory);
        const std::vector<SandUnits> source = heap_at(domain, height, sx, sz);
        const std::vector<float> rock(domain.count(), 0.0F);
        DuneSolverSettings settings;
        settings.border = DuneBorder::open;
        DuneSolver solver(domain, settings, rock.data(), source.data());
        const double cycle = 6.0 * 86400.0; // of both winds, seconds
        const WindHistory winds = wind_sequence(
            {{{std::cos(towards[0]), std::sin(towards[0]), shear_velocity}, cycle * share},
             {{std::cos(towards[1]), std::sin(towards[1]), shear_velocity}, cycle * (1.0 - share)}});
        for (int k = 0; k < 100; ++k) {
            solver.advance(winds, cycle);
            DuneState state = solver.save(); // theory has a source that does not run dry
            for (size_t c = 0; c < source.size(); ++c) state.sand[c] = std::max(state.sand[c], source[c]);
            solver.restore(state);
        }
        std::vector<SandUnits> sand(domain.count());
        solver.sand(sand);
        // The far half: near the source the finger is as broad as the source.
        double x = 0.0, z = 0.0, furthest = 0.0;
        for (const bool far_half : {false, true})
            for (int j = 0; j < n; ++j)
                for (int i = 0; i < n; ++i) {
                    const double dx = (i - n / 2) * cell - sx, dz = (j - n / 2) * cell - sz,
                                 d = std::hypot(dx, dz);
                    const double h = sand_metres(sand[domain.index(i, j)]);
                    if (h < 0.1 * height) continue;
                    if (far_half && d > 0.5 * furthest) x += h * dx, z += h * dz;
                    if (!far_half) furthest = std::max(furthest, d);
                }
        if (!pictures.empty())
            write_dune_picture(fmt::format("{}/finger{:.0f}_{:.2f}.pgm", pictures, apart, share), domain,
                               sand);
        const double finger = std::atan2(z, x);
        std::printf("%8.0f %8.2f %8.1f %8.1f %8.1f %9.0f\n", apart, share, finger / degree, theory / degree,
                    std::remainder(finger - theory, 2.0 * pi) / degree, furthest);
        std::fflush(stdout);
    }
}

namespace {

struct Shape {
    double height = 0.0, steepest = 0.0; // metres, degrees
    double elongation = 0.0;             // ratio of the axes of the sand's inertia
    int arms = 0, slip_faces = 0;
};

// The furthest sand of at least `low` metres in 36 directions from the middle, smoothed over three.
std::array<double, 36> reach_by_direction(const Domain& domain, std::span<const SandUnits> sand, double x,
                                          double z, double low) {
    std::array<double, 36> reach{}, smooth{};
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            if (sand_metres(sand[domain.index(i, j)]) < low) continue;
            const double dx = i - x, dz = j - z, a = std::atan2(dz, dx) / (2.0 * pi) + 1.0;
            double& at = reach[size_t(a * 36.0) % 36];
            at = std::max(at, std::hypot(dx, dz) * domain.cell);
        }
    for (size_t k = 0; k < 36; ++k) smooth[k] = (reach[(k + 35) % 36] + reach[k] + reach[(k + 1) % 36]) / 3.0;
    return smooth;
}

// Maxima of a periodic function that rise above the minima on both sides by `prominence` at least.
int count_peaks(std::span<const double> f, double prominence) {
    const size_t n = f.size(), start = size_t(std::ranges::min_element(f) - f.begin());
    int count = 0;
    double low = f[start], high = f[start];
    bool up = true; // looking for a peak
    for (size_t k = 0; k <= n; ++k) {
        const double v = f[(start + k) % n];
        if (up) {
            high = std::max(high, v);
            if (high - low >= prominence && high - v >= prominence) ++count, up = false, low = v;
            if (high - low < prominence) low = std::min(low, v);
        } else {
            low = std::min(low, v);
            if (v - low >= prominence) up = true, high = v;
        }
    }
    return count;
}

Shape measure_shape(const Domain& domain, const std::vector<SandUnits>& sand) {
    Shape shape;
    double mass = 0.0, x = 0.0, z = 0.0;
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const double h = sand_metres(sand[domain.index(i, j)]);
            mass += h, x += h * i, z += h * j, shape.height = std::max(shape.height, h);
        }
    x /= mass, z /= mass;
    double xx = 0.0, xz = 0.0, zz = 0.0;
    std::array<double, 36> steep{}; // cells of steep sand by aspect
    for (int j = 1; j + 1 < domain.nz; ++j)
        for (int i = 1; i + 1 < domain.nx; ++i) {
            const auto at = [&](int a, int b) { return sand_metres(sand[domain.index(i + a, j + b)]); };
            const double h = at(0, 0), gx = (at(1, 0) - at(-1, 0)) / (2.0 * domain.cell),
                         gz = (at(0, 1) - at(0, -1)) / (2.0 * domain.cell),
                         slope = std::atan(std::hypot(gx, gz)) / degree;
            xx += h * (i - x) * (i - x), xz += h * (i - x) * (j - z), zz += h * (j - z) * (j - z);
            shape.steepest = std::max(shape.steepest, slope);
            if (slope > 29.0 && h > 0.1 * shape.height)
                steep[size_t((std::atan2(-gz, -gx) / (2.0 * pi) + 1.0) * 36.0) % 36] += 1.0;
        }
    const double middle = 0.5 * (xx + zz), difference = std::hypot(0.5 * (xx - zz), xz);
    shape.elongation = std::sqrt((middle + difference) / (middle - difference));
    const auto reach = reach_by_direction(domain, sand, x, z, 0.1 * shape.height);
    double mean = 0.0;
    for (const double r : reach) mean += r / 36.0;
    shape.arms = count_peaks(reach, 0.15 * mean);
    const double most = *std::ranges::max_element(steep);
    shape.slip_faces = most > 0.0 ? count_peaks(steep, 0.2 * most) : 0;
    return shape;
}

} // namespace

void print_kinds(const std::string& pictures) {
    constexpr double shear_velocity = 0.44;
    const Domain domain{160, 160, 2.5, 0.0, 0.0};
    const std::vector<float> rock(domain.count(), 0.0F);
    struct Kind {
        const char* name;
        std::vector<double> towards; // degrees
        double height, turn, days;
    };
    std::printf("kinds: one heap on hard ground, periodic; winds of u* = %.2f m/s in turn\n%8s %8s %7s %7s "
                "%9s %11s %6s %11s\n",
                shear_velocity, "winds", "years", "heap m", "high m", "steep deg", "elongation", "arms",
                "slip faces");
    for (const Kind& kind :
         {Kind{"one", {0.0}, 6.0, 10.0, 100.0}, Kind{"two", {-60.0, 60.0}, 6.0, 5.0, 400.0},
          Kind{"five", {10.0, 154.0, 298.0, 82.0, 226.0}, 20.0, 20.0, 800.0}}) {
        std::vector<SandUnits> sand = heap_at(domain, kind.height, 0.0, 0.0);
        DuneSolver solver(domain, {}, rock.data(), sand.data());
        std::vector<TimedWind> winds;
        for (const double t : kind.towards)
            winds.push_back(
                {{std::cos(t * degree), std::sin(t * degree), shear_velocity}, kind.turn * 86400.0});
        solver.advance(wind_sequence(winds), kind.days * 86400.0);
        solver.sand(sand);
        const Shape shape = measure_shape(domain, sand);
        std::printf("%8s %8.1f %7.0f %7.1f %9.1f %11.2f %6d %11d\n", kind.name, kind.days / 365.25,
                    kind.height, shape.height, shape.steepest, shape.elongation, shape.arms,
                    shape.slip_faces);
        std::fflush(stdout);
        if (!pictures.empty()) write_dune_picture(pictures + "/" + kind.name + ".pgm", domain, sand);
    }
}

} // namespace marram
