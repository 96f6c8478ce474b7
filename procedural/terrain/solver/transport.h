// SPDX-License-Identifier: Apache-2.0
// Sand transport by wind: saturated flux and its relaxation. See transport.cpp for the model.
#pragma once

#include "procedural/air/separation.h"
#include "procedural/terrain/fields.h"

#include <limits>

namespace marram {

enum class DuneBorder { periodic, open, walled };

// Properties of sand and air. SI units.
struct SandPhysics {
    double air_density = 1.225;
    double grain_density = 2650.0;
    double grain_diameter = 0.25e-3;
    double bulk_density = 1590.0; // of the bed: 60 % of it grains
    double gravity = 9.81;
    double threshold = 0.22;   // threshold shear velocity on level ground, m/s
    double flux_scale = 5.0;   // factor of the saturated flux
    double slope_scale = 0.63; // mu: tangent of the slope at which grains roll without wind
    double side_slope = 0.55;  // tangent of the flux's downhill turn, per tangent of the cross slope
    double saturation_scale = 2.2;
    double steepest =
        std::numeric_limits<double>::infinity(); // tangent: a steeper face is a wall, no slope of sand
    bool operator==(const SandPhysics&) const = default;

    // L_sat, metres.
    double saturation_length() const {
        return saturation_scale * grain_density / air_density * grain_diameter;
    }
    // Saturated flux over level ground, kg / (m s).
    double saturated_flux(double shear_velocity) const;
    // Its inverse: the shear velocity, at least the threshold, that moves this flux of 0 or more.
    double shear_velocity_of_flux(double flux) const;
};

// Inputs from the air, per cell; rows of `pitch` floats. turn_* and stress_factor: NULL without a wind field.
struct AirFields {
    const float* height = nullptr; // metres
    const float* excess = nullptr; // height of the bubble's streamline above the ground, metres
    const float* along = nullptr;  // relative perturbation of the stress along the wind
    const float* across = nullptr; // the same across the wind, towards (-wind_column, wind_row)
    const float* plants = nullptr; // frontal area of plants per area of ground; NULL: none
    const float *turn_cos = nullptr,
                *turn_sin = nullptr; // local wind: the wind turned from the rows' normal towards the columns
    const float* stress_factor = nullptr; // factor of its stress
    const float* wake = nullptr; // missing fraction of the shear velocity behind plants (wake.h); NULL: none
};

// Inputs of the march, per cell.
struct SaturationFields {
    float* flux = nullptr;  // saturated flux through a face between rows, kg / (m s)
    float* relax = nullptr; // fraction of (flux - actual flux) exchanged over half a cell
    float* turn = nullptr;  // direction of the flux at the face before each cell, columns per row
    float* reach =
        nullptr; // mean distance, from the end of half a cell, to the origin of its exchange; cells
};

struct SandWind {
    double towards_x = 1.0, towards_z = 0.0; // unit vector of the direction it blows to
    double shear_velocity = 0.0;             // u*, m/s
    bool operator==(const SandWind&) const = default;
};

struct SaturationMaxima {
    double stress = 0.0; // maximum, as shear velocity squared
    double flux = 0.0;   // kg / (m s)
    double turn = 0.0;   // columns per row, up to steepest_turn
};
// Maximum turn of the flux from the rows' normal, columns per row (79 degrees).
inline constexpr double steepest_turn = 5.0;
// Computes the saturated flux of every cell, and returns the maxima. `wind_row`, `wind_column`: unit vector
// of the wind. Works row by row, so `out` may alias `air`: flux with along, relax with across, turn with
// excess.
SaturationMaxima saturate(const DownwindGrid& course, DuneBorder border, const SandPhysics& physics,
                          double plant_drag, double wind_row, double wind_column, double shear_velocity,
                          const AirFields& air, size_t pitch, const SaturationFields& out);

// Sand that crossed the borders in one march, in units.
struct BorderFlux {
    SandUnits in = 0, out = 0;
};

// Marches over the rows downwind, with erosion and deposition in each cell. Whole sand units, as doubles.
class March {
  public:
    struct Input {
        const SaturationFields* air = nullptr;
        const double* sand = nullptr;
        double scale = 0.0;  // sand units on a cell per kg / (m s): dt 2^32 / (bulk density * cell)
        double influx = 0.0; // through open borders, as a fraction of the saturated flux
        double turn = 0.0;   // maximum over all cells, columns per row
    };
    // `front`: inflow of the first row, units; on return the outflow of the last. `sand_out`: the new sand;
    // must not be `sand`.
    BorderFlux run(const DownwindGrid& course, DuneBorder border, const Input& input, size_t pitch,
                   double* front, double* sand_out);

  private:
    WideVector<double> next_;
};

} // namespace marram
