// SPDX-License-Identifier: Apache-2.0
// Sand in the wind: what it can carry, and how what it carries follows. The page is in transport.cpp.
#pragma once

#include "procedural/terrain/fields.h"
#include "procedural/terrain/solver/separation.h"

namespace marram {

enum class DuneBorder { periodic, open, walled };

// Sand and air. SI units.
struct SandPhysics {
    double air_density = 1.225;
    double grain_density = 2650.0;
    double grain_diameter = 0.25e-3;
    double bulk_density = 1590.0; // of the bed: 60 % of it grains
    double gravity = 9.81;
    double threshold = 0.22;   // shear velocity below which nothing moves on level ground, m/s
    double flux_scale = 5.0;   // of the saturated flux
    double slope_scale = 0.63; // tangent at which grains roll by themselves
    double side_slope = 0.55;  // how far the flux turns down a slope across it: tangent per tangent
    double saturation_scale = 2.2;
    bool operator==(const SandPhysics&) const = default;

    // L_sat, metres.
    double saturation_length() const {
        return saturation_scale * grain_density / air_density * grain_diameter;
    }
    // Saturated flux over level ground, kg / (m s).
    double saturated_flux(double shear_velocity) const;
    // Its change with the logarithm of the stress.
    double flux_response(double shear_velocity) const {
        return flux_scale * air_density / gravity * threshold * shear_velocity * shear_velocity;
    }
};

// What the air does to each cell: rows of `pitch` floats.
struct AirFields {
    const float* height = nullptr; // metres
    const float* excess = nullptr; // of the streamline over the ground, metres
    const float* along = nullptr;  // relative perturbation of the stress along the wind
    const float* across = nullptr; // towards (-wind_column, wind_row)
    const float* plants = nullptr; // frontal area of plants per area of ground; NULL: none
};

// What the march over the rows needs.
struct SaturationFields {
    float* flux = nullptr;  // saturated flux through a face between rows, kg / (m s)
    float* relax = nullptr; // what of the difference to it is made up for in half a cell
    float* turn = nullptr;  // columns a row, at the face before each cell
    float* reach =
        nullptr; // how far before the end of half a cell it takes its exchange from, on the average; cells
};

struct SandWind {
    double towards_x = 1.0, towards_z = 0.0; // unit vector to which it blows
    double shear_velocity = 0.0;             // u*, m/s
    bool operator==(const SandWind&) const = default;
};

struct SaturationPeak {
    double stress = 0.0; // the greatest, as shear velocity squared
    double flux = 0.0;   // kg / (m s)
    double turn = 0.0;   // columns a row, up to steepest_turn
};
// The flux turns no further than this from the rows' normal (79 degrees), columns a row.
inline constexpr double steepest_turn = 5.0;
// Saturated flux of every cell. `wind_row`, `wind_column`: unit vector. Row by row: `out` may stand in the place of `air`, flux in along, relax in
// across, turn in excess.
SaturationPeak saturate(const DuneCourse& course, DuneBorder border, const SandPhysics& physics,
                        double plant_drag, double wind_row, double wind_column, double shear_velocity,
                        const AirFields& air, size_t pitch, const SaturationFields& out);

// Sand that one march took over the borders, in units.
struct BorderFlux {
    SandUnits in = 0, out = 0;
};

// Marches over the rows downwind: takes sand from each cell or leaves it there. Whole units of sand, as doubles.
class March {
  public:
    struct Input {
        const SaturationFields* air = nullptr;
        const double* sand = nullptr;
        double scale = 0.0;  // units of sand on a cell per kg / (m s): dt 2^32 / (bulk density * cell)
        double influx = 0.0; // of the saturated flux, over open borders
        double turn = 0.0;   // the greatest of all cells
    };
    // `front`: what enters the first row, units; on return what leaves the last. `sand_out`: sand afterwards, not `sand`.
    BorderFlux run(const DuneCourse& course, DuneBorder border, const Input& input, size_t pitch,
                   double* front, double* sand_out);

  private:
    WideVector<double> next_;
};

} // namespace marram
