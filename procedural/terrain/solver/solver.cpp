// SPDX-License-Identifier: Apache-2.0
// The dune solver: sand moved by the wind, over years.
//
// The continuum model of K. Kroy, G. Sauermann and H. Herrmann (Phys. Rev. E 66, 2002), as used by O. Duran
// and L. Moore (PNAS 110, 2013) and S. Courrech du Pont, C. Narteau and X. Gao (Geology 42, 2014). A time
// step:
//
//   surface      heights at the middle of the step (below)
//   separation   separation.cpp: bubbles behind brinks and in front of steep faces
//   wake         wake.cpp: the wind recovers behind plants
//   shear        shear.cpp: stress over surface and bubbles, by Fourier transform
//   saturation   transport.cpp: saturated flux
//   march        transport.cpp: flux, erosion and deposition: Exner's equation
//   checkerboard checkerboard.cpp: damps patterns that oblique winds do not resolve
//   avalanche    avalanche.cpp: slopes that are too steep slide
//   grow         plants, if they grow (below)
//
// Time. The flux adapts to the surface instantly, so the state is the sand alone. The air gets the surface
// half a step ahead, h + (h - h_before) / 2. This makes the step a second-order Adams-Bashforth step. An
// Euler step would add omega^2 dt / 2 to the growth rate of waves with frequency omega, a tenth of it at the
// stable step. Step size: waves of wave number k change at the rate
//
//   |s| = Q' k^2 / rho_b (sqrt(A^2 + B^2) / sqrt(1 + k^2 L_sat^2) + side_slope),  Q' = dq_sat / d ln(tau)
//
// which is greatest at k = pi / cell; with Q' at the greatest stress, dt = stability / |s|. For decaying
// waves the scheme is stable up to stability 1.
//
// Borders. Periodic; open (sand leaves, `influx` of the saturated flux enters, the ground continues at the
// border's height); walled. For the latter two, transforms are a quarter longer than the grid, and the
// surface is blended smoothly from one border to the other there. Periodic transforms have exactly the grid's
// size: sizes with factors 2, 3, 5 are fast, all others correct.
//
// The march starts at a border whose inflow is not known yet. Periodic: the inflow is the previous step's
// outflow. On the first step, and if the wind changes, marches whose sand is discarded find it. The
// difference to this step's outflow is carried to the next step in `airborne`, column by column. The outflow
// remembers the fraction m = exp(-domain / L_sat) of the inflow: if all of the difference were paid at once,
// it would be paid too often in a domain that is shorter than L_sat, so 1 - m of it is (stable up to 2 (1 -
// m) / (1 + m)). A step pays little more than its flux, as the step before may have been far longer; what is
// left, and all of it in a calm, is added to the first row of the bed or taken from the first sand downwind.
//
// Array rows run along x or along z, so that the wind crosses them at less than 45 degrees to their normal.
// When that changes, the arrays are transposed.
//
// Wind fields. Where a field turns the wind (by up to 30 degrees), separation, wakes and stress are computed
// for winds everywhere along each of a few directions, at most 15 degrees apart, and every cell takes the
// mean of its two neighbours among them, weighted by angle. The perturbations are relative to the local wind,
// so they vary little between these directions. Flux and its relaxation take the exact local direction and
// strength. Each direction after the first adds half of the cost of a step (build/marram_bench).
//
// Plants (O. Duran and H. Herrmann, "Vegetation against dune mobility", Phys. Rev. Lett. 97, 2006) have a
// height p that grows towards P and loses what the ground rises (burial) or sinks (root exposure); V is the
// growth rate:
//
//   dp/dt = V (1 - p / P) - |dh/dt|,  0 <= p <= P;  cover of the ground (p / P)^2
//
// The frontal area that reduces the stress (transport.cpp) is proportional to the cover. A barchan whose sand
// moves more slowly than plants grow at its horns becomes a parabolic dune; a faster one stays bare. The
// growth is exact for steady ground.
//
// Cost and memory: build/marram_bench (figures dune_step and dune_memory of tests/README.md). Of the memory
// 60 bytes a cell are arrays; 4 more with plants, or 16 if they grow; 12 more with wakes, or 16 if plants
// grow; 28 more with a wind field.
#include "procedural/terrain/solver/solver.h"

#include "core/math/clock.h"
#include "procedural/abi/parallel.h"
#include "procedural/terrain/solver/checkerboard.h"
#include "procedural/terrain/solver/solver_rows.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

constexpr double solver_max_height = 0x1p18; // metres; whole units of it are exact in a double
// Of the flux across the periodic border: what a step may pay of the difference that earlier steps have left.
// They may have been much longer.
constexpr double max_owed = 1.25;
constexpr double min_units =
    0x1p16; // of a step's greatest flux, for the flux at the border to be known by it

int solver_lanes(int columns) { return (columns + lanes - 1) / lanes * lanes; }

} // namespace

std::string DuneSolver::problem(const Domain& domain, const DuneSolverSettings& settings,
                                const float* bedrock, const SandUnits* sand, const WindField& field) {
    if (domain.nx < 1 || domain.nz < 1) return "needs at least one sample along each axis";
    if (!(domain.cell > 0.0) || !std::isfinite(domain.cell)) return "the cell must be above 0";
    for (size_t k = 0; k < domain.count(); ++k) {
        if (!(std::abs(bedrock[k]) <= float(solver_max_height)))
            return "bedrock is not a number, or beyond 2^18 m";
        if (sand[k] < 0 || sand_metres(sand[k]) > solver_max_height)
            return "sand is below 0, or deeper than 2^18 m";
    }
    const SandPhysics& p = settings.physics;
    for (const double x :
         {p.air_density, p.grain_density, p.grain_diameter, p.bulk_density, p.gravity, p.threshold,
          p.flux_scale, p.slope_scale, p.saturation_scale, settings.stability, settings.longest_step})
        if (!(x > 0.0)) return "densities, lengths, gravity, scales, threshold and steps must be above 0";
    const PlantGrowth& growth = settings.growth;
    if (!(growth.rate >= 0.0) || !std::isfinite(growth.rate) || !(growth.height > 0.0) ||
        !std::isfinite(growth.height) || !(growth.frontal_area >= 0.0) || !(growth.wake >= 0.0) ||
        !std::isfinite(growth.wake) || !(growth.start_cover >= 0.0) || !(growth.start_cover <= 1.0))
        return "plants must have a height above 0, growth, area and wake of 0 or more, and cover 0 to 1";
    if (field.turn.size() != field.strength.size() || (!field.empty() && field.turn.size() != domain.count()))
        return "the wind field needs a turn and a strength for each sample";
    for (size_t k = 0; k < field.turn.size(); ++k) {
        if (!(std::abs(double(field.turn[k])) <= WindField::max_turn * (1.0 + 1e-6)))
            return "the wind field turns the wind by more than 30 degrees";
        if (!(field.strength[k] >= 0.0F) || !(field.strength[k] <= 10.0F))
            return "the wind field's strength is not 0 to 10";
    }
    if (!(settings.shear_resolution > 0.0) || !(settings.shear_resolution <= 1.0))
        return "the resolution of the shear must be above 0, to 1";
    if (!(settings.influx >= 0.0) || !(settings.influx <= 1.0)) return "influx must be 0 to 1";
    if (!(settings.separation.lee > 0.0) || !(settings.separation.windward > 0.0) ||
        !(settings.separation.steepest > settings.separation.lee / 1.5))
        return "slopes of separation must be above 0, and faces steeper than streamlines";
    return {};
}

DuneSolver::DuneSolver(const Domain& domain, const DuneSolverSettings& settings, const float* bedrock,
                       const SandUnits* sand, const float* plants, const WindField& field)
    : domain_(domain), settings_(settings), rows_(domain.nz), columns_(domain.nx) {
    const size_t wide =
        size_t(std::max(Shear::pitch(domain.nx) * domain.nz, Shear::pitch(domain.nz) * domain.nx)) +
        solver_slack;
    for (WideVector<float>* field : {&ground_, &height_, &before_, &air_height_, &along_flux_, &across_relax_,
                                     &excess_turn_, &envelope_reach_})
        field->assign(wide, 0.0F);
    sand_.assign(wide, 0.0), sand_next_.assign(wide, 0.0);
    front_.assign(size_t(std::max(Shear::pitch(domain.nx), Shear::pitch(domain.nz))), 0.0);
    reference_ = double(bedrock[0]);
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i)
            ground_[size_t(j) * pitch() + size_t(i)] =
                float(double(bedrock[domain.index(i, j)]) - reference_);
    if (plants) {
        const PlantGrowth& growth = settings_.growth;
        const float area = float(growth.frontal_area);
        plants_.assign(wide, 0.0F);
        solver_copy(plants, rows_, columns_, size_t(domain.nx), plants_.data(), pitch());
        for (float& cover : plants_) cover *= area;
        if (growth.rate > 0.0) {
            max_plants_ = plants_;
            plant_height_.assign(wide, growth.height * std::sqrt(growth.start_cover));
            set_plants();
        }
    }
    if (!field.empty()) set_wind_field(field);
    for (int axis = 0; axis < 2; ++axis) {
        const size_t count = size_t(axis == 0 ? domain.nx : domain.nz);
        state_.seam_flux[size_t(axis)].assign(count, 0.0);
        state_.airborne[size_t(axis)].assign(count, 0);
    }
    solver_copy(sand, rows_, columns_, size_t(domain.nx), sand_.data(), pitch());
    for (int r = 0; r < rows_; ++r)
        solver_heights(ground_.data() + size_t(r) * pitch(), sand_.data() + size_t(r) * pitch(),
                       solver_lanes(columns_), height_.data() + size_t(r) * pitch());
    before_ = height_;
}

void DuneSolver::orient(bool transposed) {
    if (transposed == transposed_) return;
    const size_t from = pitch();
    const int rows = rows_, columns = columns_;
    std::swap(rows_, columns_);
    transposed_ = transposed;
    const size_t to = pitch();
    const auto transpose = [&](auto& field) {
        if (field.empty()) return;
        std::remove_reference_t<decltype(field)> turned(field.size());
        solver_transpose(field.data(), rows, columns, from, turned.data(), to);
        field.swap(turned);
    };
    transpose(ground_), transpose(height_), transpose(before_), transpose(plants_), transpose(max_plants_),
        transpose(plant_height_);
    transpose(turn_cos_), transpose(turn_sin_), transpose(stress_factor_), transpose(direction_index_);
    for (float& sine : turn_sin_) sine = -sine; // rows and columns change places
    std::fill(sand_next_.begin(), sand_next_.end(), 0.0);
    solver_transpose(sand_.data(), rows, columns, from, sand_next_.data(), to);
    sand_.swap(sand_next_);
}

void DuneSolver::set_wind_field(const WindField& field) {
    constexpr double apart = 15.0 * degree; // of directions, at most
    const auto [least, most] = std::minmax_element(field.turn.begin(), field.turn.end());
    const double range = double(*most) - double(*least);
    direction_count_ = 1 + int(std::ceil(range / apart - 0.001)); // rounding is not another direction
    turn_spacing_ = direction_count_ > 1 ? range / (direction_count_ - 1) : 0.0;
    first_turn_ = direction_count_ > 1 ? double(*least) : 0.5 * (double(*least) + double(*most));
    max_strength_ = double(*std::max_element(field.strength.begin(), field.strength.end()));
    std::vector<float> values(field.turn.size());
    const auto set = [&](WideVector<float>& to, auto&& value) {
        for (size_t k = 0; k < values.size(); ++k) values[k] = float(value(k));
        to.assign(ground_.size(), 0.0F);
        solver_copy(values.data(), rows_, columns_, size_t(domain_.nx), to.data(), pitch());
    };
    set(turn_cos_, [&](size_t k) { return std::cos(double(field.turn[k])); });
    set(turn_sin_,
        [&](size_t k) { return -std::sin(double(field.turn[k])); }); // columns grow with x, rows with z
    set(stress_factor_, [&](size_t k) { return double(field.strength[k]) * double(field.strength[k]); });
    set(direction_index_, [&](size_t k) {
        return turn_spacing_ > 0.0 ? (double(field.turn[k]) - first_turn_) / turn_spacing_ : 0.0;
    });
}

void DuneSolver::surface() {
    const StageTimer clock(times_.surface);
    const double expected = std::min(state_.step_allowed, settings_.longest_step);
    const double part = state_.step_before > 0.0 ? std::min(0.5 * expected / state_.step_before, 0.5) : 0.0;
    std::vector<float> least(size_t(rows_), std::numeric_limits<float>::infinity());
    std::vector<float> most(size_t(rows_), -std::numeric_limits<float>::infinity());
    marram::parallel_for(0, rows_, [&](int r) {
        const size_t at = size_t(r) * pitch();
        solver_extrapolate(height_.data() + at, before_.data() + at, columns_, float(part),
                           air_height_.data() + at, least[size_t(r)], most[size_t(r)]);
    });
    range_ = double(*std::max_element(most.begin(), most.end())) -
             double(*std::min_element(least.begin(), least.end()));
}

// Surface plus bubbles, padded if not periodic.
void DuneSolver::envelope() {
    const bool periodic = settings_.border == DuneBorder::periodic;
    std::unique_ptr<Shear>& shear = shear_[transposed_ ? 1 : 0];
    if (!shear)
        shear = std::make_unique<Shear>(periodic ? rows_ : padded_size(rows_),
                                        periodic ? columns_ : padded_size(columns_), domain_.cell,
                                        settings_.shear_resolution);
    const int rows = shear->rows(), columns = shear->columns();
    const size_t wide = size_t(Shear::pitch(columns));
    envelope_reach_.resize(std::max(envelope_reach_.size(), wide * size_t(rows) + solver_slack));
    marram::parallel_for(0, rows_, [&](int r) {
        float* const out = envelope_reach_.data() + size_t(r) * wide;
        const size_t at = size_t(r) * pitch();
        solver_add(air_height_.data() + at, excess_turn_.data() + at, solver_lanes(columns_), out);
    });
    pad_surface(rows_, columns_, rows, columns, envelope_reach_.data());
}

void DuneSolver::set_plants() {
    for (size_t k = 0; k < plants_.size(); ++k) {
        const double share = plant_height_[k] * (1.0 / settings_.growth.height);
        plants_[k] = float(double(max_plants_[k]) * share * share);
    }
}

void DuneSolver::grow(double seconds) {
    const double full = settings_.growth.height, gain = -std::expm1(-settings_.growth.rate / full * seconds);
    marram::parallel_for(0, rows_, [&](int r) {
        const size_t at = size_t(r) * pitch();
        solver_grow(height_.data() + at, before_.data() + at, max_plants_.data() + at, solver_lanes(columns_),
                    gain, full, plant_height_.data() + at, plants_.data() + at);
    });
}

double DuneSolver::stable_step(double stress) const {
    const SandPhysics& physics = settings_.physics;
    const double k = pi / domain_.cell, length = physics.saturation_length();
    const double response =
        physics.flux_scale * physics.air_density / physics.gravity * physics.threshold * stress;
    const double waves = std::hypot(settings_.shear.in_phase, settings_.shear.out_of_phase);
    const double rate = response * k * k / physics.bulk_density *
                        (waves / std::sqrt(1.0 + k * k * length * length) + physics.side_slope);
    return rate > 0.0 ? settings_.stability / rate : infinity;
}

// Adds units of sand to the first row of a column, or takes them from the first rows that have some. Returns
// what was added.
SandUnits DuneSolver::settle(const DownwindGrid& course, size_t column, double units) {
    double left = units;
    for (int step = 0; left != 0.0 && step < rows_; ++step) {
        double& sand = sand_[size_t(course.row(step)) * pitch() + column];
        const double added = std::max(left, -sand);
        sand += added, left -= added;
    }
    return SandUnits(units - left);
}

void DuneSolver::march(const DownwindGrid& course, double wind_row, const SandWind& wind,
                       const SaturationMaxima& peak, double seconds) {
    const bool periodic = settings_.border == DuneBorder::periodic;
    const size_t axis = transposed_ ? 1 : 0;
    const SaturationFields air = {along_flux_.data(), across_relax_.data(), excess_turn_.data(),
                                  envelope_reach_.data()};
    March::Input input;
    input.air = &air, input.sand = sand_.data(), input.influx = settings_.influx, input.turn = peak.turn;
    input.scale = seconds * sand_units_per_metre / (settings_.physics.bulk_density * domain_.cell);
    std::fill(front_.begin(), front_.end(), 0.0);
    std::vector<double>& seam = state_.seam_flux[axis];
    std::vector<SandUnits>& airborne = state_.airborne[axis];
    const int direction = wind_row < 0.0 ? -1 : 1;
    const double saturated = settings_.physics.saturated_flux(max_strength_ * wind.shear_velocity);
    if (periodic) {
        const double length = rows_ * domain_.cell / settings_.physics.saturation_length();
        if (!(peak.flux > 0.0)) {
            std::fill(seam.begin(), seam.end(), 0.0);
        } else if (state_.seam_direction[axis] != direction || state_.seam_saturated[axis] != saturated) {
            March::Input probe = input; // long enough for its flux to be known, however short the step is
            probe.scale = std::max(input.scale, min_units / peak.flux);
            const int passes =
                2 + int(std::min(14.0 / length, 200.0)); // from 0: less than exp(-14) is missing
            for (int pass = 0; pass < passes; ++pass)
                march_.run(course, settings_.border, probe, pitch(), front_.data(), sand_next_.data());
            for (size_t b = 0; b < seam.size(); ++b) seam[b] = front_[b] / probe.scale;
        }
        const double forgotten = peak.flux > 0.0 ? -std::expm1(-length) : 1.0;
        for (size_t b = 0; b < seam.size(); ++b) {
            const double flux = seam[b] * input.scale, most = max_owed * flux;
            const double due = std::rint(forgotten * double(airborne[b])),
                         owed = std::clamp(due, -most, most);
            airborne[b] -= settle(course, b, due - std::rint(owed));
            front_[b] = std::max(std::rint(flux) + std::rint(owed), 0.0);
            airborne[b] -= SandUnits(front_[b]);
        }
    } else if (settings_.border == DuneBorder::open) {
        const float* const first = along_flux_.data() + size_t(course.row(0)) * pitch();
        for (int b = 0; b < columns_; ++b) {
            front_[size_t(b)] = std::floor(settings_.influx * double(first[b]) * input.scale);
            state_.in += SandUnits(front_[size_t(b)]);
        }
    }
    const BorderFlux crossed =
        march_.run(course, settings_.border, input, pitch(), front_.data(), sand_next_.data());
    state_.in += crossed.in, state_.out += crossed.out;
    const double drift = std::min(course.drift * course.drift, 1.0);
    if (drift > 0.01) {
        const SandPhysics& physics = settings_.physics;
        const double rate = 2.0 * pi * pi * physics.side_slope * std::sqrt(1.0 + drift) /
                            (physics.bulk_density * domain_.cell * domain_.cell); // per unit of flux
        damp_checkerboard(rows_, columns_, periodic, 0.25 * drift * rate * seconds, ground_.data(),
                          along_flux_.data(), sand_next_.data(), pitch(), sand_.data());
    } else
        sand_.swap(sand_next_);
    if (periodic) {
        const bool exact = peak.flux * input.scale >= min_units;
        for (size_t b = 0; b < seam.size(); ++b) {
            airborne[b] += SandUnits(front_[b]);
            if (exact) seam[b] = front_[b] / input.scale;
        }
        state_.seam_direction[axis] = direction, state_.seam_saturated[axis] = saturated;
        state_.seam_direction[1 - axis] = 0;
    } else
        for (int b = 0; b < columns_; ++b) state_.out += SandUnits(front_[size_t(b)]);
    marram::parallel_for(0, rows_, [&](int r) {
        const size_t at = size_t(r) * pitch();
        std::memcpy(before_.data() + at, height_.data() + at, size_t(columns_) * sizeof(float));
        solver_heights(ground_.data() + at, sand_.data() + at, solver_lanes(columns_), height_.data() + at);
    });
}

void DuneSolver::blend_air(int direction, bool first) {
    struct Field {
        const WideVector<float>& from;
        WideVector<float>& sum;
    };
    for (const Field& field : {Field{along_flux_, along_mean_}, Field{across_relax_, across_mean_},
                               Field{excess_turn_, excess_mean_}, Field{wake_deficit_, wake_mean_}}) {
        if (field.from.empty()) continue;
        field.sum.resize(field.from.size());
        marram::parallel_for(0, rows_, [&](int r) {
            const size_t at = size_t(r) * pitch();
            solver_weigh(direction_index_.data() + at, float(direction), first, field.from.data() + at,
                         solver_lanes(columns_), field.sum.data() + at);
        });
    }
}

// Bubbles, wakes and stress for a wind everywhere along the unit vector (x, z).
void DuneSolver::compute_air_of_one_wind(double x, double z) {
    const double wind_row = transposed_ ? x : z, wind_column = transposed_ ? z : x;
    const DownwindGrid course = {rows_,        columns_,       settings_.border == DuneBorder::periodic,
                                 domain_.cell, wind_row < 0.0, wind_column / std::abs(wind_row)};
    {
        const StageTimer clock(times_.separation);
        separation_.find(course, settings_.separation, air_height_.data(), range_, pitch(),
                         excess_turn_.data());
    }
    const PlantGrowth& growth = settings_.growth;
    if (!plants_.empty() && growth.wake > 0.0) {
        const StageTimer clock(times_.wake);
        wake_deficit_.resize(plants_.size());
        wake_.find(course, growth.wake,
                   {plants_.data(), plant_height_.empty() ? nullptr : plant_height_.data(), growth.height,
                    settings_.plant_drag},
                   pitch(), wake_deficit_.data());
    }
    const StageTimer clock(times_.shear);
    envelope();
    shear_[transposed_ ? 1 : 0]->perturbation(settings_.shear, wind_row, wind_column, envelope_reach_.data(),
                                              rows_, columns_, along_flux_.data(), across_relax_.data());
}

// The air for the wind of the moment, along the unit vector (x, z), and the wind field. Returns the greatest
// drift of its directions, columns per row.
double DuneSolver::compute_air(double x, double z) {
    double drift = 0.0;
    for (int k = 0; k < direction_count_; ++k) {
        const double turn = first_turn_ + k * turn_spacing_, c = std::cos(turn), s = std::sin(turn);
        const double turned_x = c * x - s * z, turned_z = c * z + s * x;
        compute_air_of_one_wind(turned_x, turned_z);
        drift = std::max(drift, std::abs(transposed_ ? turned_z / turned_x : turned_x / turned_z));
        if (direction_count_ > 1) blend_air(k, k == 0);
    }
    if (direction_count_ > 1)
        along_flux_.swap(along_mean_), across_relax_.swap(across_mean_), excess_turn_.swap(excess_mean_),
            wake_deficit_.swap(wake_mean_);
    return drift;
}

double DuneSolver::step(const SandWind& wind, double seconds) {
    const double size = std::hypot(wind.towards_x, wind.towards_z);
    const double x = size > 0.0 ? wind.towards_x / size : 1.0, z = size > 0.0 ? wind.towards_z / size : 0.0;
    orient(std::abs(x) > std::abs(z));
    const double wind_row = transposed_ ? x : z, wind_column = transposed_ ? z : x;
    const bool periodic = settings_.border == DuneBorder::periodic;
    surface();
    const double drift = compute_air(x, z);
    const DownwindGrid course = {rows_, columns_, periodic, domain_.cell, wind_row < 0.0, drift};
    SaturationMaxima peak;
    {
        const StageTimer clock(times_.saturation);
        const AirFields air = {air_height_.data(),
                               excess_turn_.data(),
                               along_flux_.data(),
                               across_relax_.data(),
                               plants_.empty() ? nullptr : plants_.data(),
                               turn_cos_.empty() ? nullptr : turn_cos_.data(),
                               turn_sin_.empty() ? nullptr : turn_sin_.data(),
                               stress_factor_.empty() ? nullptr : stress_factor_.data(),
                               wake_deficit_.empty() ? nullptr : wake_deficit_.data()};
        peak =
            saturate(course, settings_.border, settings_.physics, settings_.plant_drag, wind_row, wind_column,
                     wind.shear_velocity, air, pitch(),
                     {along_flux_.data(), across_relax_.data(), excess_turn_.data(), envelope_reach_.data()});
    }
    const double stable = peak.flux > 0.0 ? stable_step(peak.stress) : infinity;
    state_.step_allowed = std::min(stable, settings_.longest_step);
    // Without flux only unfinished avalanches change anything.
    const double length = std::min({seconds, stable, settings_.longest_step});
    {
        const StageTimer clock(times_.march);
        march(course, wind_row, wind, peak, length);
    }
    {
        const StageTimer clock(times_.avalanche);
        avalanche_.run(rows_, columns_, periodic, domain_.cell, settings_.avalanche, ground_.data(),
                       sand_.data(), height_.data(), pitch());
    }
    if (!plant_height_.empty()) grow(length);
    state_.step_before = length;
    state_.time += length;
    ++state_.steps;
    return length;
}

bool DuneSolver::advance(const WindHistory& wind, double seconds, const DuneCallbacks& callbacks) {
    const double end = state_.time + seconds;
    while (state_.time < end) {
        if (callbacks.cancelled && callbacks.cancelled()) return false;
        const WindSpan span = wind(state_.time);
        const double until = std::min(span.until, end), left = until - state_.time;
        if (step(span.wind, left) >= left) state_.time = until; // no rounding error
        if (callbacks.progress) callbacks.progress({state_.time, end, state_.steps});
    }
    return true;
}

SandUnits DuneSolver::airborne() const {
    SandUnits sum = 0;
    for (const std::vector<SandUnits>& axis : state_.airborne)
        for (const SandUnits units : axis) sum += units;
    return sum;
}

void DuneSolver::sand(std::span<SandUnits> out) const {
    if (transposed_)
        solver_transpose(sand_.data(), rows_, columns_, pitch(), out.data(), size_t(domain_.nx));
    else
        solver_copy(sand_.data(), rows_, columns_, pitch(), out.data(), size_t(domain_.nx));
}

void DuneSolver::cover(std::span<float> out) const {
    if (transposed_)
        solver_transpose(plants_.data(), rows_, columns_, pitch(), out.data(), size_t(domain_.nx));
    else
        solver_copy(plants_.data(), rows_, columns_, pitch(), out.data(), size_t(domain_.nx));
    const float area = float(settings_.growth.frontal_area);
    for (float& share : out) share = area > 0.0F ? std::min(share / area, 1.0F) : 0.0F;
}

DuneState DuneSolver::save() const {
    DuneState state = state_;
    state.sand.resize(domain_.count());
    sand(state.sand);
    const auto keep = [&](const auto& field, auto& out) {
        out.resize(domain_.count());
        if (transposed_)
            solver_transpose(field.data(), rows_, columns_, pitch(), out.data(), size_t(domain_.nx));
        else
            solver_copy(field.data(), rows_, columns_, pitch(), out.data(), size_t(domain_.nx));
    };
    keep(before_, state.height_before);
    if (!plant_height_.empty()) keep(plant_height_, state.plant_height);
    return state;
}

void DuneSolver::restore(const DuneState& state) {
    orient(false);
    state_ = state;
    solver_copy(state.sand.data(), rows_, columns_, size_t(domain_.nx), sand_.data(), pitch());
    solver_copy(state.height_before.data(), rows_, columns_, size_t(domain_.nx), before_.data(), pitch());
    for (int r = 0; r < rows_; ++r)
        solver_heights(ground_.data() + size_t(r) * pitch(), sand_.data() + size_t(r) * pitch(),
                       solver_lanes(columns_), height_.data() + size_t(r) * pitch());
    if (!plant_height_.empty()) {
        solver_copy(state.plant_height.data(), rows_, columns_, size_t(domain_.nx), plant_height_.data(),
                    pitch());
        set_plants();
    }
    state_.sand.clear(), state_.height_before.clear(), state_.plant_height.clear();
}

} // namespace marram
