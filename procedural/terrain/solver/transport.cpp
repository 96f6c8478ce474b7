// SPDX-License-Identifier: Apache-2.0
// Sand transport by wind: saturated flux and its relaxation.
//
// Saturated flux (O. Duran, P. Claudin, B. Andreotti, Aeolian Research 3, 2011; J. Kok et al., Rep. Prog.
// Phys. 75, 2012: the constant is about 5), kg per metre and second:
//
//   q_sat = 5 (rho_a / g) u*_t (u*^2 - u*_t^2),  0 below the threshold
//
// u*^2 = tau / rho_a is the local stress: |wind (1 + tau'_x) + across tau'_y| times that of the undisturbed
// wind. It is 0 in a bubble, where the streamline is higher than a tenth of a cell above the ground; in
// between it falls linearly, so brinks move by less than a cell. It is at most 4 times that of the
// undisturbed wind: air flows around a cylinder at most twice as fast as before it, but linear theory has no
// bound at the corners of walls. Nor is 1 + tau'_x below 0, or |tau'_y| above half of it: the stress turns by
// 27 degrees at most.
//
// Along slopes of tangent s in the direction of the stress, the threshold in the bracket is that of a grain
// with friction mu (J. Iversen and K. Rasmussen, Sedimentology 41, 1994): u*_t^2 (1 + s / mu) / sqrt(1 +
// s^2).
//
// Across the stress, grains roll downhill as they saltate: the flux turns by an angle whose tangent is
// side_slope times the cross slope. The balance of drag, friction and weight of grains in flight (G.
// Sauermann, K. Kroy, H. Herrmann, Phys. Rev. E 64, 2001: 1 / (v / (u_f sqrt(2 alpha)) + 1 / 2 alpha) with
// alpha = 0.42, v near 1 m/s and u_f = 1.8 m/s) gives about 0.55. Nothing else in the model levels grooves
// along the wind.
//
// With obstacles, faces steeper than 45 degrees (or the angle of repose: SandPhysics.steepest) are walls, not
// slopes of sand: grains neither climb them nor roll off them, and the terms above take 0 for their slope.
//
// Over plants (M. Raupach, D. Gillette, J. Leys, J. Geophys. Res. 98, 1993) the stress is divided by 1 +
// plant_drag lambda, lambda the frontal area per area of ground. Behind plants it recovers (wake.cpp).
//
// Relaxation. Grains need a length L_sat = 2.2 (rho_s / rho_a) d to reach equilibrium (B. Andreotti, P.
// Claudin, O. Pouliquen, Geomorphology 123, 2010), nearly independent of the wind. Eroded sand stays in the
// air; with e the direction of the stress,
//
//   div(q e) = (q_sat - q) / L_sat = erosion per area, limited by the available sand
//
// (Along a straight stream tube this is dq/ds = (q_sat - q) / L_sat; where tubes widen, the divergence
// conserves mass.)
//
// March. Rows are crossed one after the other, downwind. F = q e_row is the flux through the face between two
// rows. With a along the rows' normal, b along the row and t = e_b / e_a:
//
//   dF/da + d(t F)/db = (q_sat e_a - F) / (e_a L_sat)
//
// a conservation law with a as its time. A cell has three steps: exchange with the bed over half a cell,
// exact for a constant right side (1 - exp(-cell / 2 e_a L_sat)); transport along the row over a cell (van
// Leer's limited slopes, flux at half the way, exact for t = 1); exchange over the other half cell. Each half
// uses q_sat at the mean origin of the flux at its end, a distance y before that end,
//
//   y / cell = 1 / (2 D) - 1 / (2 (exp(D) - 1)),  D = cell / (2 e_a L_sat)
//
// (1/4 for short cells, 0 for long ones) along its streamline, by limited slopes of q_sat. (With q_sat at the
// middle of the cell, the growth rate of waves would be wrong by k cell^2 / 12 L_sat of their frequency.) The
// scheme is second order where smooth, and stable for any cell length. If the flux anywhere turns by more
// than a column per row, the transport is split into as many substeps (up to 5: 79 degrees off the rows'
// normal). Fluxes are whole sand units: they are rounded at the exchange, and a cell passes on at most what
// it has. So the bed changes by exactly what crosses the faces, which is Exner's equation, rho_b dh/dt = -div
// q, and the balance at the borders is exact.
//
// Threads. Blocks of 12 rows; within a block, strips of columns. Each strip also computes a margin as wide as
// the transport of the rows that are left in the block can reach. A cell's values do not depend on the strip
// that computes them.
//
// Cost: 5 ns a cell for q_sat, 6 ns for the march (one core).
#include "procedural/terrain/solver/transport.h"

#include "procedural/abi/parallel.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

constexpr int transport_pad = 8;              // elements before and after a row, for neighbour access
constexpr int transport_block_rows = 12;      // rows per block
constexpr float transport_most_stress = 4.0F; // times that of the undisturbed wind
constexpr double transport_brink = 0.1;       // cells; under streamlines this high the stress is 0

// An excess of up to 0.01 above a whole number is ignored.
int transport_substeps(double turn) { return std::clamp(int(std::ceil(turn - 0.01)), 1, int(steepest_turn)); }

struct SaturationRow {
    const float *before, *here, *after; // heights; `here` is padded on both sides
    const float *excess, *along, *across, *plants, *wake, *turn_cos, *turn_sin, *stress_factor;
    float *flux, *relax, *turn, *reach;
    float *cell_turn, *gain, *rise;   // scratch rows, padded by one before the start
    int columns, count;               // count: columns rounded up to a multiple of 8
    float row_slope, column_slope;    // 1 / distance between the samples of the differences
    float wind_row, wind_column;      // unit vector; wind_row >= 0, downwind
    float stress, threshold, q_scale; // shear velocities squared; kg s / m^3
    float slope_scale, side_slope, plant_drag,
        bubble;                // bubble: 1 / streamline height at which the stress is 0
    float steepest_sand;       // tangent
    float steepest_turn, side; // side: -1 if rows are crossed backwards
    double half_cell;          // half a cell / L_sat
};

// A slope, or 0 if it is a wall's.
MARRAM_INLINE VFloat transport_ground_slope(VFloat slope, float steepest) {
    return slope * slope <= steepest * steepest ? slope : splat_float(0.0F);
}

MARRAM_HOT SaturationMaxima transport_saturate(const SaturationRow& row) {
    const VFloat none = splat_float(0.0F), one = splat_float(1.0F);
    VFloat most = none, max_flux = none, max_turn = none;
    for (int b = 0; b < row.count; b += lanes) {
        const VFloat open = vmax(none, vmin(one, one - row.bubble * vload(row.excess + b)));
        VFloat along = open * vmax(none, 1.0F + vload(row.along + b));
        VFloat across = (row.side * open) * vload(row.across + b);
        across = vmax(-0.5F * along, vmin(0.5F * along, across)); // at most 27 degrees: linear theory
        const VFloat size = vsqrt(along * along + across * across);
        const VFloat inverse = size > 0.0F ? one / size : none;
        const VFloat u = size > 0.0F ? along * inverse : one, v = size > 0.0F ? across * inverse : none;
        VFloat wind_row = none + row.wind_row, wind_column = none + row.wind_column;
        if (row.turn_cos) {
            const VFloat c = vload(row.turn_cos + b), s = row.side * vload(row.turn_sin + b);
            const VFloat turned = wind_row * c - wind_column * s;
            wind_column = wind_column * c + wind_row * s;
            wind_row = turned;
        }
        const VFloat u_row = u * wind_row - v * wind_column, u_column = u * wind_column + v * wind_row;
        const VFloat g_row = transport_ground_slope(
            row.row_slope * (vload(row.after + b) - vload(row.before + b)), row.steepest_sand);
        const VFloat g_column = transport_ground_slope(
            row.column_slope * (vload(row.here + b + 1) - vload(row.here + b - 1)), row.steepest_sand);
        const VFloat slope = u_row * g_row + u_column * g_column;
        const VFloat down = u_row - row.side_slope * (g_row - slope * u_row);
        const VFloat side = u_column - row.side_slope * (g_column - slope * u_column);
        const VFloat ahead = vmax(down, splat_float(1e-3F)); // avoid division by 0
        const VFloat limit = splat_float(row.steepest_turn);
        const VFloat turn = vmax(-limit, vmin(limit, side / ahead));
        const VFloat e_row = one / vsqrt(one + turn * turn);
        VFloat stress = row.stress * vmin(size, splat_float(transport_most_stress));
        if (row.stress_factor) stress *= vload(row.stress_factor + b);
        if (row.plants) {
            const VFloat open_stress = stress;
            stress /= 1.0F + row.plant_drag * vload(row.plants + b);
            if (row.wake) {
                const VFloat left = 1.0F - vload(row.wake + b);
                stress = vmin(stress, open_stress * (left * left));
            }
        }
        const VFloat threshold =
            row.threshold * vmax(none, 1.0F + slope * row.slope_scale) / vsqrt(one + slope * slope);
        VFloat flux = e_row * row.q_scale * vmax(none, stress - threshold);
        for (int l = std::max(row.columns - b, 0); l < lanes; ++l)
            stress[l] = flux[l] = 0.0F; // padding beyond the row
        most = vmax(most, stress);
        max_flux = vmax(max_flux, flux);
        vstore(row.flux + b, flux);
        const VDouble way = row.half_cell / to_double(e_row);
        const VDouble kept = vexp(-way);
        vstore(row.relax + b, to_float(1.0 - kept));
        vstore(row.reach + b,
               to_float(row.half_cell < 0.005 // series; its next term is below 1e-9
                            ? 0.25 - way * (1.0 / 24.0)
                            : 0.5 / way - 0.5 * kept / (1.0 - kept)));
        vstore(row.cell_turn + b, turn);
        max_turn = vmax(max_turn, flux > 0.0F ? vmax(turn, -turn) : none);
        vstore(row.gain + b, 0.5F * row.side_slope * (one - u_column * u_column) / ahead);
        vstore(row.rise + b, g_column);
    }
    SaturationMaxima peak;
    for (int l = 0; l < lanes; ++l)
        peak.stress = std::max(peak.stress, double(most[l])),
        peak.flux = std::max(peak.flux, double(max_flux[l])),
        peak.turn = std::max(peak.turn, double(max_turn[l]));
    return peak;
}

// The turn at the face before each cell. It uses the slope across the face itself: central differences would
// miss steps between neighbours.
MARRAM_HOT void transport_turns(const SaturationRow& row) {
    const VFloat limit = splat_float(row.steepest_turn);
    for (int b = 0; b < row.count; b += lanes) {
        const VFloat face = transport_ground_slope(
            2.0F * row.column_slope * (vload(row.here + b) - vload(row.here + b - 1)), row.steepest_sand);
        const VFloat seen = 0.5F * (vload(row.rise + b) + vload(row.rise + b - 1));
        const VFloat turn = 0.5F * (vload(row.cell_turn + b) + vload(row.cell_turn + b - 1)) -
                            (vload(row.gain + b) + vload(row.gain + b - 1)) * (face - seen);
        vstore(row.turn + b, vmax(-limit, vmin(limit, turn)));
    }
}

// Copies columns [first, first + count) of a row that wraps around (periodic) or repeats its end values.
template <typename T>
void transport_copy(const T* row, int columns, bool periodic, int first, int count, T* out) {
    if (!periodic) {
        for (int k = 0; k < count; ++k) out[k] = row[std::clamp(first + k, 0, columns - 1)];
        return;
    }
    int b = ((first % columns) + columns) % columns;
    while (count > 0) {
        const int run = std::min(count, columns - b);
        std::memcpy(out, row + b, size_t(run) * sizeof(T));
        out += run, count -= run, b = 0;
    }
}

// One strip of a block of rows. Arrays have transport_pad values before and after the strip's `width`.
struct MarchStrip {
    int width = 0, wide = 0; // wide: width rounded up to lanes
    int substeps = 1;
    double scale = 0.0;
    double *flux = nullptr, *sand = nullptr, *moved = nullptr;
    float *before = nullptr, *saturated = nullptr, *after = nullptr; // saturated flux of three rows
    float *relax = nullptr, *turn = nullptr, *reach = nullptr;
    float *first = nullptr, *second = nullptr; // saturated flux for the first and second half of a cell

    // The strip without its first `left` columns, a multiple of `lanes`, and its last `right` ones.
    MarchStrip part(int left, int right) const {
        MarchStrip s = *this;
        for (double** field : {&s.flux, &s.sand, &s.moved}) *field += left;
        for (float** field :
             {&s.before, &s.saturated, &s.after, &s.relax, &s.turn, &s.reach, &s.first, &s.second})
            *field += left;
        s.width -= left + right;
        s.wide = (s.width + lanes - 1) / lanes * lanes;
        return s;
    }
};

MARRAM_INLINE VFloat transport_slope(VFloat a, VFloat b, VFloat c) { // van Leer's limiter
    const VFloat rise = b - a, next = c - b, product = rise * next;
    return product > 0.0F ? 2.0F * product / (rise + next) : splat_float(0.0F);
}

MARRAM_HOT void transport_flux_origin(const MarchStrip& s) {
    for (int b = 0; b < s.wide; b += lanes) {
        const VFloat here = vload(s.saturated + b), none = splat_float(0.0F);
        const VFloat down = transport_slope(vload(s.before + b), here, vload(s.after + b));
        const VFloat side =
            vload(s.turn + b) * transport_slope(vload(s.saturated + b - 1), here, vload(s.saturated + b + 1));
        const VFloat reach = vload(s.reach + b), rest = 0.5F - reach;
        vstore(s.first + b, vmax(none, here - reach * down + rest * side));
        vstore(s.second + b, vmax(none, here + rest * down - reach * side));
    }
}

MARRAM_HOT void transport_exchange(const MarchStrip& s, const float* saturated) {
    for (int b = 0; b < s.wide; b += lanes) {
        const VDouble flux = vload(s.flux + b), sand = vload(s.sand + b);
        const VDouble wanted = to_double(vload(saturated + b)) * s.scale;
        VDouble taken = to_double(vload(s.relax + b)) * (wanted - flux);
        taken = vround(vmin(taken, sand));
        vstore(s.flux + b, flux + taken);
        vstore(s.sand + b, sand - taken);
    }
}

// Vectors of four: rows are short.
using MarchFloat = float __attribute__((vector_size(16), aligned(16)));
constexpr int transport_lanes = 4;

MARRAM_INLINE Double4 transport_load4(const double* p) {
    Double4 v;
    std::memcpy(&v, p, sizeof v);
    return v;
}
MARRAM_INLINE Double4 transport_load4(const float* p) {
    MarchFloat v;
    std::memcpy(&v, p, sizeof v);
    return __builtin_convertvector(v, Double4);
}
MARRAM_INLINE void transport_store4(double* p, Double4 v) { std::memcpy(p, &v, sizeof v); }
MARRAM_INLINE Double4 transport_min4(Double4 a, Double4 b) { return a < b ? a : b; }
MARRAM_INLINE Double4 transport_max4(Double4 a, Double4 b) { return a > b ? a : b; }

// Units that cross the face between cells b - 1 and b, for b = 0 ... width.
MARRAM_HOT void transport_faces(const MarchStrip& s) {
    const double part = 1.0 / s.substeps;
    const Double4 none = {}, one = none + 1.0;
    for (int b = 0; b <= s.width; b += transport_lanes) {
        const Double4 f0 = transport_load4(s.flux + b - 2), f1 = transport_load4(s.flux + b - 1);
        const Double4 f2 = transport_load4(s.flux + b), f3 = transport_load4(s.flux + b + 1);
        const Double4 t0 = transport_load4(s.turn + b - 1), t1 = transport_load4(s.turn + b);
        const Double4 t2 = transport_load4(s.turn + b + 1);
        const Double4 t = part * t1;
        const Long4 right = t > none;
        const Double4 size = transport_min4(transport_max4(t, -t), one);
        const Double4 donor = right ? f1 : f2, middle = f2 - f1;
        const Double4 outer =
            right ? f1 - f0 : f3 - f2; // outer, middle: differences on both sides of the donor
        const Double4 product = transport_max4(outer * middle, none);
        const Double4 sum = outer + middle;
        const Double4 slope = (product + product) / (product > none ? sum : one);
        const Double4 ahead = 0.5 * (one - size) * slope;
        const Double4 value = right ? donor + ahead : donor - ahead;
        // A cell that gives to both sides gives at most half to each.
        const Double4 other = right ? t0 : -t2;
        const Double4 most = other < none ? 0.5 * donor : donor;
        const Double4 wanted = transport_max4(none, transport_min4(size * value, most));
        Double4 moved = vround(wanted); // rounded down
        moved = moved - (moved > wanted ? one : none);
        transport_store4(s.moved + b, right ? moved : -moved);
    }
}

MARRAM_HOT void transport_apply(const MarchStrip& s) {
    for (int b = 0; b < s.wide; b += lanes)
        vstore(s.flux + b, vload(s.flux + b) + vload(s.moved + b) - vload(s.moved + b + 1));
}

// A face at the grid's border. Adds what crosses an open border to `crossed`.
double transport_border_face(const MarchStrip& s, DuneBorder border, double turn, int donor, double inner,
                             double outside, BorderFlux& crossed) {
    // turn > 0: into the grid. inner > 0: units that the border cell gives to its inner neighbour.
    if (border == DuneBorder::walled) return 0.0;
    const double size = std::min(std::abs(turn) / s.substeps, 1.0);
    const double moved =
        turn > 0.0 ? std::floor(size * outside)
                   : std::min(std::floor(size * s.flux[donor]), s.flux[donor] - std::max(inner, 0.0));
    (turn > 0.0 ? crossed.in : crossed.out) += SandUnits(moved);
    return turn > 0.0 ? moved : -moved;
}

struct TransportScratch {
    WideVector<double> doubles;
    WideVector<float> floats;

    MarchStrip strip(int width) {
        const size_t wide = size_t(width + lanes - 1) / lanes * lanes, whole = wide + 2 * transport_pad;
        doubles.assign(3 * whole, 0.0);
        floats.assign(8 * whole, 0.0F);
        MarchStrip s;
        s.width = width, s.wide = int(wide);
        s.flux = doubles.data() + transport_pad, s.sand = s.flux + whole, s.moved = s.sand + whole;
        float* at = floats.data() + transport_pad;
        for (float** field :
             {&s.before, &s.saturated, &s.after, &s.relax, &s.turn, &s.reach, &s.first, &s.second})
            *field = at, at += whole;
        return s;
    }
};

} // namespace

double SandPhysics::saturated_flux(double shear_velocity) const {
    return flux_scale * air_density / gravity * threshold *
           std::max(0.0, shear_velocity * shear_velocity - threshold * threshold);
}

double SandPhysics::shear_velocity_of_flux(double flux) const {
    return std::sqrt(flux * gravity / (flux_scale * air_density * threshold) + threshold * threshold);
}

SaturationMaxima saturate(const DownwindGrid& course, DuneBorder border, const SandPhysics& physics,
                          double plant_drag, double wind_row, double wind_column, double shear_velocity,
                          const AirFields& air, size_t pitch, const SaturationFields& out) {
    const bool periodic = border == DuneBorder::periodic;
    std::vector<SaturationMaxima> peaks(static_cast<size_t>(course.rows));
    tbb::enumerable_thread_specific<WideVector<float>> heights;
    marram::parallel_for(0, course.rows, [&](int step) {
        const auto height = [&](int n) {
            const int wrapped =
                periodic ? (n + course.rows) % course.rows : std::clamp(n, 0, course.rows - 1);
            return air.height + size_t(course.row(wrapped)) * pitch;
        };
        const size_t at = size_t(course.row(step)) * pitch;
        WideVector<float>& line = heights.local();
        const size_t room = pitch + 2 * transport_pad;
        line.resize(4 * room);
        transport_copy(height(step), course.columns, periodic, -transport_pad,
                       course.columns + 2 * transport_pad, line.data());
        const int rows_apart = periodic ? 2 : std::min(step + 1, course.rows - 1) - std::max(step - 1, 0);
        SaturationRow row = {};
        row.before = height(step - 1), row.here = line.data() + transport_pad, row.after = height(step + 1);
        row.excess = air.excess + at, row.along = air.along + at, row.across = air.across + at;
        row.plants = air.plants ? air.plants + at : nullptr;
        row.wake = air.wake ? air.wake + at : nullptr;
        if (air.turn_cos)
            row.turn_cos = air.turn_cos + at, row.turn_sin = air.turn_sin + at,
            row.stress_factor = air.stress_factor + at;
        row.flux = out.flux + at, row.relax = out.relax + at, row.turn = out.turn + at,
        row.reach = out.reach + at;
        row.columns = course.columns;
        row.count = (course.columns + lanes - 1) / lanes * lanes;
        row.row_slope = rows_apart > 0 ? float(1.0 / (rows_apart * course.cell)) : 0.0F;
        row.column_slope = float(0.5 / course.cell);
        row.steepest_sand = float(physics.steepest);
        row.wind_row = float(std::abs(wind_row)), row.wind_column = float(wind_column);
        row.stress = float(shear_velocity * shear_velocity);
        row.threshold = float(physics.threshold * physics.threshold);
        row.q_scale = float(physics.flux_scale * physics.air_density / physics.gravity * physics.threshold);
        row.slope_scale = float(1.0 / physics.slope_scale), row.side_slope = float(physics.side_slope),
        row.plant_drag = float(plant_drag);
        row.bubble = float(1.0 / (transport_brink * course.cell));
        row.steepest_turn = float(steepest_turn);
        row.cell_turn = line.data() + room + transport_pad;
        row.gain = row.cell_turn + room, row.rise = row.gain + room;
        row.side = course.backwards ? -1.0F : 1.0F;
        row.half_cell =
            std::min(0.5 * course.cell / physics.saturation_length(), 300.0); // exp(-300) is practically 0
        peaks[size_t(step)] = transport_saturate(row);
        const int before = periodic ? course.columns - 1 : 0;
        for (float* field : {row.cell_turn, row.gain, row.rise}) field[-1] = field[before];
        transport_turns(row);
        for (size_t b = size_t(course.columns); b < pitch; ++b)
            row.flux[b] = row.relax[b] = row.turn[b] = row.reach[b] = 0.0F;
    });
    SaturationMaxima peak;
    for (const SaturationMaxima& row : peaks)
        peak.stress = std::max(peak.stress, row.stress), peak.flux = std::max(peak.flux, row.flux),
        peak.turn = std::max(peak.turn, row.turn);
    return peak;
}

BorderFlux March::run(const DownwindGrid& course, DuneBorder border, const Input& input, size_t pitch,
                      double* front, double* sand_out) {
    const bool periodic = border == DuneBorder::periodic;
    const int columns = course.columns, substeps = transport_substeps(input.turn);
    const int columns_per_row =
        2 * substeps; // that a row's transport can reach: limited slopes need two neighbours
    const int margin = transport_block_rows * columns_per_row;
    const int strip_width = columns >= 1024 ? 256 : 128, strips = (columns + strip_width - 1) / strip_width;
    next_.resize(pitch);
    tbb::enumerable_thread_specific<TransportScratch> scratches;
    std::vector<BorderFlux> crossed(static_cast<size_t>(strips));
    for (int row0 = 0; row0 < course.rows; row0 += transport_block_rows) {
        const int row1 = std::min(row0 + transport_block_rows, course.rows);
        const auto work = [&](int index) {
            const int b0 = index * strip_width, b1 = std::min(b0 + strip_width, columns);
            const bool whole = strips == 1 && periodic;
            int begin = b0 - margin, end = b1 + margin; // columns of the first row
            if (!periodic) begin = std::max(begin, 0), end = std::min(end, columns);
            if (whole) begin = 0, end = columns;
            MarchStrip strip = scratches.local().strip(end - begin);
            strip.substeps = substeps, strip.scale = input.scale;
            transport_copy(front, columns, periodic, begin, end - begin, strip.flux);
            for (int step = row0; step < row1; ++step) {
                if (step > row0) {
                    float* const old = strip.before;
                    strip.before = strip.saturated, strip.saturated = strip.after, strip.after = old;
                }
                // Beyond its end the strip has no values: what they would change has come this far into the
                // margin.
                const int spoiled = whole ? 0 : (step - row0) * columns_per_row / lanes * lanes;
                const int left = begin == 0 && !periodic ? 0 : spoiled;
                const int right = end == columns && !periodic ? 0 : spoiled;
                const MarchStrip s = strip.part(left, right);
                const int lo = begin + left, hi = end - right;
                const auto load = [&](const float* from, float* to) {
                    transport_copy(from, columns, periodic, lo - transport_pad, hi - lo + 2 * transport_pad,
                                   to - transport_pad);
                };
                const size_t at = size_t(course.row(step)) * pitch;
                transport_copy(input.sand + at, columns, periodic, lo, hi - lo, s.sand);
                const auto near = [&](int n) {
                    const int wrapped =
                        periodic ? (n + course.rows) % course.rows : std::clamp(n, 0, course.rows - 1);
                    return input.air->flux + size_t(course.row(wrapped)) * pitch;
                };
                if (step == row0) load(near(step - 1), s.before), load(near(step), s.saturated);
                load(near(step + 1), s.after);
                load(input.air->relax + at, s.relax);
                load(input.air->turn + at, s.turn);
                transport_copy(input.air->reach + at, columns, periodic, lo, hi - lo, s.reach);
                transport_flux_origin(s);
                transport_exchange(s, s.first);
                for (int k = 0; k < substeps; ++k) {
                    for (int l = 1; l <= transport_pad; ++l) { // fill the padding
                        s.flux[-l] = whole ? s.flux[(s.width * transport_pad - l) % s.width] : s.flux[0];
                        s.flux[s.width - 1 + l] = whole ? s.flux[(l - 1) % s.width] : s.flux[s.width - 1];
                    }
                    transport_faces(s);
                    const auto face = [&](int donor, double sign, double inner, bool owned) {
                        BorderFlux here;
                        const double outside = input.influx * double(s.saturated[donor]) * s.scale;
                        const double moved = transport_border_face(s, border, sign * double(s.turn[donor]),
                                                                   donor, inner, outside, here);
                        if (owned)
                            crossed[size_t(index)].in += here.in, crossed[size_t(index)].out += here.out;
                        return sign * moved;
                    };
                    if (!periodic && lo == 0) s.moved[0] = face(0, 1.0, s.moved[1], b0 == 0);
                    if (!periodic && hi == columns)
                        s.moved[s.width] = face(s.width - 1, -1.0, -s.moved[s.width - 1], b1 == columns);
                    transport_apply(s);
                }
                for (int l = s.width; l < s.wide; ++l) s.flux[l] = 0.0;
                transport_exchange(s, s.second);
                if (border == DuneBorder::walled && step + 1 == course.rows)
                    for (int b = 0; b < s.width; ++b) s.sand[b] += s.flux[b], s.flux[b] = 0.0;
                std::memcpy(sand_out + at + b0, s.sand + (b0 - lo), size_t(b1 - b0) * sizeof(double));
            }
            std::memcpy(next_.data() + b0, strip.flux + (b0 - begin), size_t(b1 - b0) * sizeof(double));
        };
        if (strips == 1)
            work(0);
        else
            marram::parallel_for(0, strips, work);
        std::memcpy(front, next_.data(), size_t(columns) * sizeof(double));
    }
    BorderFlux sum;
    for (const BorderFlux& part : crossed) sum.in += part.in, sum.out += part.out;
    return sum;
}

} // namespace marram
