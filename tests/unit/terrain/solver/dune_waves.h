// SPDX-License-Identifier: Apache-2.0
// Growth and speed of a small wave on a flat bed, measured and from theory. Shared by the tests and the
// printed table.
#pragma once

#include "procedural/terrain/solver/solver.h"

#include <cmath>
#include <complex>
#include <vector>

namespace marram {

struct DuneWave {
    double growth = 0.0, speed = 0.0; // in units of L_sat and its time
};

// omega = k^2 (A + i B) / (1 + i k), growth Im omega, speed Re omega / k; k in 1 / L_sat.
inline DuneWave dune_wave_theory(const DuneSolverSettings& settings, double shear_velocity, double k) {
    const double r = shear_velocity / settings.physics.threshold;
    const double a = settings.shear.in_phase,
                 b = settings.shear.out_of_phase - 1.0 / (settings.physics.slope_scale * r * r);
    const std::complex<double> omega = k * k * std::complex<double>(a, b) / std::complex<double>(1.0, k);
    return {omega.imag(), omega.real() / k};
}

// A wave with crests across the wind: `row` and `column` wavelengths over `size` cells along z and x.
inline DuneWave dune_wave_measured(const DuneSolverSettings& settings, double shear_velocity, double k,
                                   int size, int row, int column, double turns = 0.02) {
    const double length = settings.physics.saturation_length(), count = std::hypot(row, column);
    const double cell = 2.0 * pi * length / k * count / size;
    const int nx = column == 0 ? 4 : size, nz = row == 0 ? 4 : size;
    const Domain domain{nx, nz, cell, 0.0, 0.0};
    std::vector<float> rock(domain.count(), 0.0F);
    std::vector<SandUnits> sand(domain.count());
    const auto phase = [&](size_t s) {
        return 2.0 * pi * (double(row) * double(int(s) / nx) + double(column) * double(int(s) % nx)) / size;
    };
    const double height = 1e-3 * length / k;
    for (size_t s = 0; s < sand.size(); ++s) sand[s] = sand_units(10.0 + height * std::cos(phase(s)));
    DuneSolver solver(domain, settings, rock.data(), sand.data());
    const SandWind wind{column / count, row / count, shear_velocity};
    const auto amplitude = [&] {
        solver.sand(sand);
        std::complex<double> sum = 0.0;
        for (size_t s = 0; s < sand.size(); ++s) sum += sand_metres(sand[s]) * std::polar(1.0, -phase(s));
        return sum;
    };
    const double r = shear_velocity / settings.physics.threshold;
    const double unit = length * length * settings.physics.bulk_density * (r * r - 1.0) /
                        (settings.physics.saturated_flux(shear_velocity) * r * r);
    const DuneWave theory = dune_wave_theory(settings, shear_velocity, k);
    const double seconds = turns * 2.0 * pi / (theory.speed * k) * unit;
    solver.advance(steady_wind(wind), 0.2 * seconds); // skips the initial Euler step
    const std::complex<double> before = amplitude();
    const double start = solver.time();
    solver.advance(steady_wind(wind), seconds);
    const std::complex<double> rate = std::log(amplitude() / before) / ((solver.time() - start) / unit);
    return {rate.real(), -rate.imag() / k};
}

} // namespace marram
