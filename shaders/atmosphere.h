// SPDX-License-Identifier: Apache-2.0
// Sunlight scattered by a planet's atmosphere, in 16 spectral bands. Every radiance here is relative to the sun's
// irradiance above the air in the same band (unit 1/sr), so that no solar spectrum is needed: who wants colours weighs
// the bands with one. atmosphere.cpp opens with the formulas and their sources.
//
// Cost: the tables take about 0.4 s of one processor, shared out by `Loop`; a path about 5 us.
// Accuracy (tests/unit/shaders/daylight_test.cpp): light scattered once within 1 % of fine integration, 2 % where view
// and sun are both at the horizon. All light, against a random walk with the true phases at 550 nm: 1 % in pure air,
// 4 % in clear air with aerosol. A planet without absorption sends back 1.03 of what it receives.
#pragma once

#include "core/math/vec.h"

#include <array>
#include <cstddef>
#include <functional>
#include <vector>

namespace marram {

inline constexpr int band_count = 16;
using Spectrum = Eigen::Array<float, band_count, 1>;

inline constexpr double planet_radius = 6.371e6;   // m, the earth's mean
inline constexpr double atmosphere_height = 1.0e5; // m; 7e-6 of the air is above
inline constexpr double zenith_wavelength = 550.0; // nm, at which aerosol's optical depth is told

// Middle of a band, nm: the bands are 20 nm wide and lie side by side from 380 to 700.
inline constexpr double wavelength_of(int band) { return 390.0 + 20.0 * band; }

// Runs body(0) ... body(count - 1), in any order and maybe several at once: how a caller lends its threads.
using Loop = std::function<void(size_t count, const std::function<void(size_t)>& body)>;
void one_by_one(size_t count, const std::function<void(size_t)>& body);

struct AirSettings {
    double air = 1.0;                    // molecules, as a share of those of the earth's standard atmosphere
    double aerosol = 0.1;                // optical depth from sea level straight up at 550 nm
    double aerosol_albedo = 0.925;       // share of what aerosol takes out of a beam that it scatters
    double ozone = 300.0;                // Dobson units
    double ground_albedo = 0.2;          // share of light that the ground reflects, evenly in all directions
    double sun_radius = 0.2665 * degree; // angular, radians: the width of the planet's half-shadow
};

// Vertical optical depth of the standard atmosphere's molecules; wavelength in nm.
double rayleigh_depth(double wavelength);

// Per steradian, normalised over the sphere.
double rayleigh_phase(double cosine);
double aerosol_phase(double cosine);

// What radiates towards a viewer, cut into segments; where the sun stands is not part of it.
struct PathStep {
    double distance;             // m, from the viewer to the middle of the segment
    double height;               // m, there
    Spectrum by_air, by_aerosol; // transmittance from there times scattering, integrated over the segment
};
struct Path {
    double radius = planet_radius; // of the viewer
    double cosine = 1.0;           // with the vertical there
    std::vector<PathStep> steps;
    bool meets_ground = false;
    double length = 0.0;
    Spectrum transmittance = Spectrum::Ones(); // along all of it
};

// Radiance is by_air rayleigh_phase(c) + by_aerosol aerosol_phase(c) + rest; c is the cosine between view and sun.
struct Scattered {
    Spectrum by_air = Spectrum::Zero(), by_aerosol = Spectrum::Zero(); // once
    Spectrum rest = Spectrum::Zero();                                  // more often, and off the ground
};

// Heights are in metres above sea level, 0 ... atmosphere_height; cosines are with the local vertical.
class Atmosphere {
  public:
    // Without `scatters` it transmits light and scatters none, which takes much less to make.
    explicit Atmosphere(const AirSettings& settings, const Loop& loop = one_by_one, bool scatters = true);

    // From a height to space; 0 where the ground is in the way.
    Spectrum transmittance(double height, double cosine) const;
    // The same of the sun's whole disc: the part of it that is above the horizon.
    Spectrum sunlight(double height, double sun_cosine) const;

    Path path(double height, double cosine, int segments) const;
    // view_sun: cosine between the path's direction and the sun's.
    Scattered scattered(const Path& path, double sun_cosine, double view_sun) const;

    // Per metre at a height: what is scattered by molecules, by aerosol, and what is lost in all.
    struct Coefficients {
        Spectrum by_air, by_aerosol, extinction;
    };
    Coefficients coefficients(double height) const;

  private:
    // Means over the sphere of radiance times components of its direction: up, and level towards the sun.
    struct Moments {
        Spectrum up, level, up_up, level_level, up_level;
    };
    static constexpr std::array all_moments = {&Moments::up, &Moments::level, &Moments::up_up,
                                               &Moments::level_level, &Moments::up_level};
    // Light of one or more orders of scattering: mean radiance by height and sun, irradiance of the ground by sun.
    struct Field {
        std::vector<Spectrum> mean, ground;
        std::vector<Moments> moments; // beside each mean
    };
    struct Cell;

    void make_columns(const Loop& loop);
    void make_field(const Loop& loop);
    Field next_order(const Field* before, const Loop& loop) const;
    static std::vector<Cell> cells_around(double horizon);
    static void average_phases(std::vector<Cell>& cells, double sun);
    void gather(size_t row, const Field* before, Field& order) const;
    Spectrum arriving(const Path& path, double sun_cosine, const Cell& cell, const Field* before) const;
    std::array<double, 3> columns(double height, double cosine) const;
    Spectrum again(const PathStep& step, double sun_cosine, double view_cosine, double view_sun) const;
    static Spectrum mean_at(const Field& field, double height, double sun_cosine);
    static Spectrum ground_at(const Field& field, double sun_cosine);

    AirSettings settings_;
    Spectrum air_, aerosol_, ozone_; // extinction per metre where each is densest
    std::vector<std::array<float, 3>> columns_;
    Field field_;
};

} // namespace marram
