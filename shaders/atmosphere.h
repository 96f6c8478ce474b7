// SPDX-License-Identifier: Apache-2.0
// Sunlight scattered by a planet's atmosphere, in 16 spectral bands. Every radiance here is relative to the
// sun's irradiance above the air in the same band (unit 1/sr), so that no solar spectrum is needed here: a
// caller that needs colours multiplies the bands by one. atmosphere.cpp opens with the formulas and their
// sources.
//
// Cost: the tables take about 0.4 s on one core, parallelised with `Loop`; a path about 5 us.
// Accuracy (tests/unit/shaders/daylight_test.cpp): single scattering within 1 % of fine integration, 2 % if
// view and sun are both at the horizon. All orders, against a random walk with the exact phase functions at
// 550 nm: 1 % in pure air, 4 % in clear air with aerosol. A planet without absorption sends back 1.03 of the
// light it receives.
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
inline constexpr double zenith_wavelength = 550.0; // nm, at which aerosol's optical depth is given

// Centre of a band, nm. The bands are 20 nm wide and adjacent, from 380 to 700.
inline constexpr double wavelength_of(int band) { return 390.0 + 20.0 * band; }

// Runs body(0) ... body(count - 1), in any order and possibly in parallel on the caller's threads.
using Loop = std::function<void(size_t count, const std::function<void(size_t)>& body)>;
void serial_loop(size_t count, const std::function<void(size_t)>& body);

struct AirSettings {
    double air = 1.0;                    // amount of molecules relative to the standard atmosphere
    double aerosol = 0.1;                // vertical optical depth from sea level at 550 nm
    double aerosol_albedo = 0.925;       // single scattering albedo of the aerosol
    double ozone = 300.0;                // Dobson units
    double ground_albedo = 0.2;          // reflectance of the ground, Lambertian
    double sun_radius = 0.2665 * degree; // angular radius, radians: sets the width of the penumbra
};

// Vertical optical depth of the standard atmosphere's molecules; wavelength in nm.
double rayleigh_depth(double wavelength);

// Per steradian, normalised over the sphere.
double rayleigh_phase(double cosine);
double aerosol_phase(double cosine);

// A view path in segments, with the scattering towards the viewer. Independent of the sun's position.
struct PathStep {
    double distance;             // m, from the viewer to the middle of the segment
    double height;               // m, at that point
    Spectrum by_air, by_aerosol; // transmittance to the viewer times scattering, over the segment
};
struct Path {
    double radius = planet_radius; // m, viewer from the planet's centre
    double cosine = 1.0;           // of the direction with the viewer's vertical
    std::vector<PathStep> steps;
    bool meets_ground = false;
    double length = 0.0;
    Spectrum transmittance = Spectrum::Ones(); // along the whole path
};

// Radiance is by_air rayleigh_phase(c) + by_aerosol aerosol_phase(c) + rest; c is the cosine between view and
// sun.
struct Scattered {
    Spectrum by_air = Spectrum::Zero(), by_aerosol = Spectrum::Zero(); // single scattering
    Spectrum rest = Spectrum::Zero();                                  // multiple scattering and ground
    Spectrum white_ground = Spectrum::Zero(); // of the ground alone, if its albedo were 1 in the same light
};

// Heights are in metres above sea level, 0 ... atmosphere_height; cosines are with the local vertical.
class Atmosphere {
  public:
    // Without `scatters` only the transmittance is computed, not the scattering: much faster to build.
    explicit Atmosphere(const AirSettings& settings, const Loop& loop = serial_loop, bool scatters = true);

    // From a height to space; 0 if the ground blocks the path.
    Spectrum transmittance(double height, double cosine) const;
    // Transmittance to the sun's disc, times the fraction of the disc above the horizon.
    Spectrum sunlight(double height, double sun_cosine) const;

    Path path(double height, double cosine, int segments) const;
    // view_sun: cosine between the path's direction and the sun's.
    Scattered scattered(const Path& path, double sun_cosine, double view_sun) const;

    // Per metre at a height: scattering by molecules and by aerosol, and total extinction.
    struct Coefficients {
        Spectrum by_air, by_aerosol, extinction;
    };
    Coefficients coefficients(double height) const;

  private:
    // Means over the sphere of radiance times components of its direction: up, and horizontally towards the
    // sun.
    struct Moments {
        Spectrum up, level, up_up, level_level, up_level;
    };
    static constexpr std::array all_moments = {&Moments::up, &Moments::level, &Moments::up_up,
                                               &Moments::level_level, &Moments::up_level};
    // Light of one or more scattering orders: mean radiance over height and sun cosine, irradiance of the
    // ground over sun cosine.
    struct Field {
        std::vector<Spectrum> mean, ground;
        std::vector<Moments> moments; // one for each mean
    };
    struct Cell;

    void make_columns(const Loop& loop);
    void make_field(const Loop& loop);
    Field next_order(const Field* before, const Loop& loop) const;
    static std::vector<Cell> cells_around(double horizon);
    static void average_phases(std::vector<Cell>& cells, double sun);
    void compute_table_row(size_t row, const Field* before, Field& order) const;
    Spectrum incident_radiance(const Path& path, double sun_cosine, const Cell& cell,
                               const Field* before) const;
    std::array<double, 3> columns(double height, double cosine) const;
    Spectrum multiple_scattering(const PathStep& step, double sun_cosine, double view_cosine,
                                 double view_sun) const;
    static Spectrum mean_at(const Field& field, double height, double sun_cosine);
    static Spectrum ground_at(const Field& field, double sun_cosine);

    AirSettings settings_;
    Spectrum air_, aerosol_, ozone_; // extinction per metre at each one's maximum density
    std::vector<std::array<float, 3>> columns_;
    Field field_;
};

} // namespace marram
