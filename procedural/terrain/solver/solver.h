// SPDX-License-Identifier: Apache-2.0
// The dune solver: sand that the wind moves, over years. The page is in solver.cpp.
#pragma once

#include "procedural/terrain/solver/avalanche.h"
#include "procedural/terrain/solver/shear.h"
#include "procedural/terrain/solver/transport.h"
#include "procedural/terrain/solver/winds.h"

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Plants that grow, are buried and blown bare. rate 0: they stay as they are.
struct PlantGrowth {
    double rate = 0.0;         // of their height on bare ground that is still, m/s
    double height = 1.0;       // of those that are full grown, metres
    double start_cover = 0.0;  // at the beginning, of the ground that they can cover
    double frontal_area = 0.2; // per area of ground, of full grown ones
    bool operator==(const PlantGrowth&) const = default;
};

struct DuneSolverSettings {
    SandPhysics physics;
    ShearCoefficients shear;
    SeparationSettings separation;
    AvalancheSettings avalanche;
    double plant_drag = 16.0; // of stress, per frontal area of plants on an area of ground
    PlantGrowth growth;
    DuneBorder border = DuneBorder::periodic;
    double influx = 0.0;            // over open borders, of the saturated flux; 0 to 1
    double stability = 0.5;         // time steps, of the fastest wave's time
    double longest_step = infinity; // seconds
};

// Everything that a run needs to go on with the same bits.
struct DuneState {
    std::vector<SandUnits> sand;                  // sample (i, j) at j * nx + i
    std::vector<float> height_before;             // of the time step before, metres over the reference
    std::vector<double> plant_height;             // metres; empty: plants do not grow
    std::array<std::vector<double>, 2> seam_flux; // what crossed the border last, across z and x: kg / (m s)
    std::array<std::vector<SandUnits>, 2> airborne; // not yet accounted for there
    std::array<int, 2> seam_direction = {0, 0};
    std::array<double, 2> seam_saturated = {0.0, 0.0};
    double time = 0.0, step_before = 0.0, step_allowed = 0.0; // seconds
    int64_t steps = 0;
    SandUnits in = 0, out = 0; // over the borders so far
};

struct DuneProgress {
    double time = 0.0, end = 0.0; // seconds
    int64_t steps = 0;
};
struct DuneCallbacks {
    std::function<bool()> cancelled;
    std::function<void(const DuneProgress&)> progress;
};

// Seconds spent in each part, of all steps.
struct DuneTimes {
    double surface = 0.0, separation = 0.0, shear = 0.0, saturation = 0.0, march = 0.0, avalanche = 0.0;
};

class DuneSolver {
  public:
    // What is wrong with such a run, or nothing. Sand must be 0 to 2^18 m deep.
    static std::string problem(const Domain& domain, const DuneSolverSettings& settings, const float* bedrock,
                               const SandUnits* sand);

    // `plants`: the share of the ground that plants cover where they are full grown, 0 to 1, or NULL. Nothing is borrowed.
    DuneSolver(const Domain& domain, const DuneSolverSettings& settings, const float* bedrock,
               const SandUnits* sand, const float* plants = nullptr);

    // Goes on for `seconds`. false: cancelled, at a whole step.
    bool advance(const WindHistory& wind, double seconds, const DuneCallbacks& callbacks = {});
    // One time step of at most `seconds`. Returns its length.
    double step(const SandWind& wind, double seconds);

    double time() const { return state_.time; }
    int64_t steps() const { return state_.steps; }
    SandUnits in() const { return state_.in; }
    SandUnits out() const { return state_.out; }
    // Sand that a periodic border still owes; usually 0 or little. Bed + airborne - in + out never changes.
    SandUnits airborne() const;
    void sand(std::span<SandUnits> out) const;
    // The share of the ground that plants cover; of plants only.
    void cover(std::span<float> out) const;
    const DuneTimes& times() const { return times_; }

    DuneState save() const;
    void restore(const DuneState& state);

  private:
    void orient(bool transposed);
    void surface();
    void envelope();
    void set_plants();
    void grow(double seconds);
    double stable_step(double stress) const;
    void march(const DuneCourse& course, double wind_row, const SandWind& wind, const SaturationPeak& peak,
               double seconds);

    size_t pitch() const { return size_t(Shear::pitch(columns_)); }

    Domain domain_;
    DuneSolverSettings settings_;
    double reference_ = 0.0; // metres: heights are floats over it
    bool transposed_ = false;
    int rows_ = 0, columns_ = 0; // along z and x, or along x and z
    WideVector<float> ground_, height_, before_;
    WideVector<float> plants_;        // frontal area per area of ground
    WideVector<float> most_plants_;   // where they grow: plants_ when full grown
    WideVector<double> plant_height_; // metres; steps change it by less than a float would notice
    WideVector<double> sand_, sand_next_;
    WideVector<float> air_height_;
    // What the air does, then, row by row in its place, what the march needs of it: along the wind, across, over bubbles, envelope.
    WideVector<float> along_flux_, across_relax_, excess_turn_, envelope_reach_;
    WideVector<double> front_;
    double range_ = 0.0;                          // of air_height_
    std::array<std::unique_ptr<Shear>, 2> shear_; // by orientation
    Separation separation_;
    March march_;
    Avalanche avalanche_;
    DuneState state_; // without sand and height_before
    DuneTimes times_;
};

} // namespace marram
