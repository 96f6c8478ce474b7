// SPDX-License-Identifier: Apache-2.0
// The dune solver: sand moved by the wind, over years. See solver.cpp for the model.
#pragma once

#include "procedural/air/shear.h"
#include "procedural/terrain/solver/avalanche.h"
#include "procedural/terrain/solver/transport.h"
#include "procedural/terrain/solver/wake.h"
#include "procedural/terrain/solver/winds.h"

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Plants that grow, are buried and lose their ground. rate 0: plants do not change.
struct PlantGrowth {
    double rate = 0.0;         // growth of small plants on steady ground, m/s
    double height = 1.0;       // of full-grown plants, metres
    double start_cover = 0.0;  // initial cover, as a fraction of the mask
    double frontal_area = 0.2; // of full-grown plants, per area of ground
    double wake = 0.0;         // length over which the wind recovers behind them, in plant heights; 0: none
    bool operator==(const PlantGrowth&) const = default;
};

struct DuneSolverSettings {
    SandPhysics physics;
    ShearCoefficients shear;
    SeparationSettings separation;
    AvalancheSettings avalanche;
    double plant_drag = 16.0; // stress is divided by 1 + plant_drag * frontal area per area of ground
    PlantGrowth growth;
    DuneBorder border = DuneBorder::periodic;
    double influx = 0.0;            // through open borders, as a fraction of the saturated flux; 0 to 1
    double shear_resolution = 1.0;  // above 0 to 1: see shear.h
    double stability = 0.5;         // time step, as a fraction of the fastest wave's time scale
    double longest_step = infinity; // seconds
};

// Everything that a run needs to continue bit-identically.
struct DuneState {
    std::vector<SandUnits> sand;                  // sample (i, j) at j * nx + i
    std::vector<float> height_before;             // before the last time step, metres above the reference
    std::vector<double> plant_height;             // metres; empty if plants do not grow
    std::array<std::vector<double>, 2> seam_flux; // last flux across the periodic z and x border, kg / (m s)
    std::array<std::vector<SandUnits>, 2> airborne; // flux not yet balanced at that border
    std::array<int, 2> seam_direction = {0, 0};
    std::array<double, 2> seam_saturated = {0.0, 0.0};
    double time = 0.0, step_before = 0.0, step_allowed = 0.0; // seconds
    int64_t steps = 0;
    SandUnits in = 0, out = 0; // total across the borders
};

struct DuneProgress {
    double time = 0.0, end = 0.0; // seconds
    int64_t steps = 0;
};
struct DuneCallbacks {
    std::function<bool()> cancelled;
    std::function<void(const DuneProgress&)> progress;
};

// Total seconds spent in each stage.
struct DuneTimes {
    double surface = 0.0, separation = 0.0, wake = 0.0, shear = 0.0, saturation = 0.0, march = 0.0,
           avalanche = 0.0;
};

class DuneSolver {
  public:
    // The problem with these inputs, or "". Bedrock must be within 2^18 m of 0, sand 0 to 2^18 m deep.
    static std::string problem(const Domain& domain, const DuneSolverSettings& settings, const float* bedrock,
                               const SandUnits* sand, const WindField& field = {});

    // `plants`: fraction of the ground that full-grown plants cover, 0 to 1, or NULL. `field`: how the wind
    // differs from place to place; empty: nowhere. Copies all arrays.
    DuneSolver(const Domain& domain, const DuneSolverSettings& settings, const float* bedrock,
               const SandUnits* sand, const float* plants = nullptr, const WindField& field = {});

    // Advances by `seconds`. Returns false if cancelled, after a whole step.
    bool advance(const WindHistory& wind, double seconds, const DuneCallbacks& callbacks = {});
    // One time step of at most `seconds`. Returns its length.
    double step(const SandWind& wind, double seconds);

    double time() const { return state_.time; }
    int64_t steps() const { return state_.steps; }
    SandUnits in() const { return state_.in; }
    SandUnits out() const { return state_.out; }
    // Sand not yet balanced at periodic borders, about what a step carries at most. Bed + airborne - in + out
    // is constant.
    SandUnits airborne() const;
    void sand(std::span<SandUnits> out) const;
    // The fraction of the ground that plants cover. Requires plants.
    void cover(std::span<float> out) const;
    const DuneTimes& times() const { return times_; }
    // For how many directions of the wind the air is computed in each step: 1 without a wind field.
    int wind_directions() const { return direction_count_; }

    DuneState save() const;
    void restore(const DuneState& state);

  private:
    void orient(bool transposed);
    void set_wind_field(const WindField& field);
    void surface();
    void envelope();
    double compute_air(double x, double z);
    void compute_air_of_one_wind(double x, double z);
    void blend_air(int direction, bool first);
    void set_plants();
    void grow(double seconds);
    double stable_step(double stress) const;
    SandUnits settle(const DownwindGrid& course, size_t column, double units);
    void march(const DownwindGrid& course, double wind_row, const SandWind& wind,
               const SaturationMaxima& peak, double seconds);

    size_t pitch() const { return size_t(Shear::pitch(columns_)); }

    Domain domain_;
    DuneSolverSettings settings_;
    double reference_ = 0.0; // metres: heights are floats relative to it
    bool transposed_ = false;
    int rows_ = 0, columns_ = 0; // along z and x, or along x and z
    WideVector<float> ground_, height_, before_;
    WideVector<float> plants_;        // frontal area per area of ground
    WideVector<float> max_plants_;    // if they grow: plants_ when full-grown
    WideVector<double> plant_height_; // metres; double, because the change per step is below float precision
    WideVector<double> sand_, sand_next_;
    WideVector<float> air_height_;
    // The wind field: cosine and sine of its turn relative to the wind of the moment, positive from the rows'
    // normal towards increasing columns; factor of the stress; and the local direction as a fractional index
    // among the directions that compute_air() goes through. Empty without one.
    WideVector<float> turn_cos_, turn_sin_, stress_factor_, direction_index_;
    double first_turn_ = 0.0, turn_spacing_ = 0.0; // radians: of direction 0, and between neighbours
    int direction_count_ = 1;
    double max_strength_ = 1.0; // greatest factor of the shear velocity
    WideVector<float> along_mean_, across_mean_, excess_mean_,
        wake_mean_;                  // over directions, if there are several
    WideVector<float> wake_deficit_; // deficit of the shear velocity; empty without wakes
    // Shared buffers. First AirFields (along, across, excess) and the envelope; saturate() then overwrites
    // them row by row with SaturationFields (flux, relax, turn, reach).
    WideVector<float> along_flux_, across_relax_, excess_turn_, envelope_reach_;
    WideVector<double> front_;
    double range_ = 0.0;                          // maximum - minimum of air_height_
    std::array<std::unique_ptr<Shear>, 2> shear_; // by orientation
    Separation separation_;
    Wake wake_;
    March march_;
    Avalanche avalanche_;
    DuneState state_; // without sand, height_before and plant_height
    DuneTimes times_;
};

} // namespace marram
