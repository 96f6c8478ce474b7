// SPDX-License-Identifier: Apache-2.0
// fusion: sand drapes over rock without a seam, and loose sand relaxes to its angle of repose. Bedrock never
// changes.
//
//     [[procedural.layer]]
//     type = "fusion"
//     drape = 0.5                     # metres
//     mask = "loose"
//
// Order: the sand relaxes; with `drape` it thins out along the rock where they meet (drape.cpp) and relaxes
// again.
//
// mask: the fraction of the sand at a sample that is loose. The rest counts as rock, and "sand" below means
// loose sand. With 0 a sample gives no sand, but sand may slide over it and come to rest on it. The amount of
// loose sand varies smoothly with the mask. The mask only classifies sand, so sand is conserved.
//
// After the layer, no triangle of the grid with loose sand at all corners is steeper than repose + 0.4 degrees; without
// such triangles the sand stays bit-identical. fusion_relaxer.cpp describes how.
//
// Range. |bedrock| and sand up to 2^20 m (1,049 km), cells from 2^-20 m (1 um): there all sums are exact in
// a double. If an input is outside or not a number, the sand is unchanged and `settled` is false. `settled`
// is also false if 160 cycles do not suffice, or as much work as 4096 sweeps of the whole grid. Borders are
// walls. A single row or column has no triangle and stays.
//
// Sand that slides over steep rock into a hollow comes to rest up to 2.5 degrees below repose there, because
// of the coarser grids. It never rests above repose.
//
// Report: sweeps, m^3 moved, the steepest all-sand triangle and `settled`; a warning if it did not settle.
//
// Cost: 35 ns a sample where nothing moves (one core), of which half is copying; 2048^2 samples with 1,000
// dunes of 40 degrees: 1.1 to 1.3 s of one core. A steep rock face oblique to the grid settles slowest: 20
// to 10,500 sweeps for 200^2 samples, up to 1.7 s; with a mask, or on larger grids, it can take many times
// that. 16 bytes a sample, plus a third for the coarser grids.
#include "procedural/terrain/mesh/fusion.h"

#include "procedural/abi/parallel.h"
#include "procedural/abi/param.h"
#include "procedural/terrain/drape.h"
#include "procedural/terrain/mesh/fusion_relaxer.h"
#include "procedural/terrain/shape_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

namespace marram {
namespace {

constexpr double fusion_max_height = 0x1p20; // metres; sums of heights stay exact in a double
constexpr double fusion_min_cell = 0x1p-20;  // metres; below, the slope's slack is only a few sand units

// The loose part of the sand; the rest counts as ground.
SandUnits fusion_loose(SandUnits sand, const float* mask, size_t sample) {
    if (!mask) return sand;
    const double share = double(mask[sample]);
    return share < 1.0 ? SandUnits(std::max(share, 0.0) * double(sand)) : sand;
}

// Copies the terrain into the grid. Returns false if a sample is out of range.
bool fusion_read(const Domain& domain, const float* bedrock, const SandUnits* sand, const float* mask,
                 FusionGrid& grid) {
    std::vector<char> good(size_t(domain.nz), 1);
    constexpr SandUnits most = SandUnits(fusion_max_height * sand_units_per_metre);
    marram::parallel_for(0, domain.nz, [&](int j) {
        bool in = true;
        double* const ground_row = grid.ground.get() + grid.row(j);
        double* const sand_row = grid.sand.get() + grid.row(j);
        const size_t from = domain.index(0, j);
        for (int i = 0; i < domain.nx; ++i) {
            const size_t k = size_t(i & 1) * size_t(grid.half) + size_t(i >> 1);
            const double rock = double(bedrock[from + size_t(i)]);
            const SandUnits units = sand[from + size_t(i)];
            in = in && std::abs(rock) <= fusion_max_height && units >= 0 && units <= most;
            const SandUnits loose = fusion_loose(units, mask, from + size_t(i));
            ground_row[k] = std::rint(rock * sand_units_per_metre) + double(units - loose);
            sand_row[k] = double(loose);
        }
        grid.clear_padding(j);
        good[size_t(j)] = in;
    });
    return std::count(good.begin(), good.end(), char(0)) == 0;
}

// Copies the sand out. Returns the amount that moved, in metres times samples.
double fusion_write(const Domain& domain, const FusionGrid& grid, const float* mask, SandUnits* sand) {
    std::vector<double> moved(size_t(domain.nz), 0.0);
    marram::parallel_for(0, domain.nz, [&](int j) {
        for (int i = 0; i < domain.nx; ++i) {
            const size_t sample = domain.index(i, j);
            const SandUnits gain =
                SandUnits(grid.sand[grid.at(i, j)]) - fusion_loose(sand[sample], mask, sample);
            if (gain > 0) moved[size_t(j)] += sand_metres(gain);
            sand[sample] += gain;
        }
    });
    double sum = 0.0;
    for (const double row : moved) sum += row;
    return sum;
}

// Drapes the sand of the finest grid. Returns false if cancelled.
bool fusion_drape(const Domain& domain, double drape, const std::function<bool()>& cancelled,
                  FusionGrid& grid) {
    const auto ground = std::make_unique_for_overwrite<double[]>(domain.count());
    const auto sand = std::make_unique_for_overwrite<double[]>(domain.count());
    const auto samples = [&](auto&& act) {
        marram::parallel_for(0, domain.nz, [&](int j) {
            for (int i = 0; i < domain.nx; ++i) act(domain.index(i, j), grid.at(i, j));
        });
    };
    samples([&](size_t to, size_t from) { ground[to] = grid.ground[from], sand[to] = grid.sand[from]; });
    if (!drape_sand(domain, ground.get(), sand.get(), drape, cancelled)) return false;
    samples([&](size_t from, size_t to) { grid.sand[to] = sand[from]; });
    return true;
}

} // namespace

FusionResult relax_sand(const Domain& domain, const float* bedrock, SandUnits* sand,
                        const FusionSettings& settings, const std::function<bool()>& cancelled,
                        const float* mask) {
    FusionResult result;
    if (domain.nx < 1 || domain.nz < 1) return result;
    const double repose = std::clamp(settings.repose, 1.0 * degree, 80.0 * degree);
    FusionRelaxer relaxer(domain, repose, settings.cycles, cancelled);
    FusionGrid& grid = relaxer.finest();
    result.in_range = fusion_read(domain, bedrock, sand, mask, grid) && domain.cell >= fusion_min_cell;
    if (!result.in_range) {
        result.settled = false;
        return result;
    }
    const bool drapes = settings.drape > 0.0;
    result.cancelled =
        !relaxer.relax(result) ||
        (drapes && (!fusion_drape(domain, settings.drape, cancelled, grid) || !relaxer.relax(result)));
    if (result.cancelled) return result;
    result.moved = drapes || result.sweeps > 0 ? fusion_write(domain, grid, mask, sand) : 0.0;
    result.steepest = std::atan(std::sqrt(relaxer.steepest_squared()) / (domain.cell * sand_units_per_metre));
    return result;
}

void FusionLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    if (!out.sand || rect.empty()) return;
    for (int j = rect.j0; j < rect.j1; ++j) {
        const size_t first = domain_.index(rect.i0, j);
        std::copy_n(below.sand + first, size_t(rect.i1 - rect.i0), out.sand + first);
    }
}

bool FusionLayer::evaluate_whole(const Fields& below, const LayerOutput& out,
                                 const std::function<bool()>& cancelled) const {
    if (!out.sand) return true;
    evaluate({0, 0, domain_.nx, domain_.nz}, below, out);
    const float* mask = mask_.empty() ? nullptr : find_mask(below, mask_);
    const FusionResult result = relax_sand(domain_, below.bedrock, out.sand, settings_, cancelled, mask);
    if (result.cancelled) return false;
    if (!out.notes) return true;
    out.notes->numbers = {{"sweeps", double(result.sweeps)},
                          {"moved", result.moved * domain_.cell * domain_.cell},
                          {"steepest", result.steepest / degree},
                          {"settled", double(result.settled)}};
    if (!result.in_range)
        out.notes->warnings.push_back({place_, "heights or cells are out of range: the sand stays as it is",
                                       "keep rock and sand below 1000 km, cells above 1 um"});
    else if (!result.settled)
        out.notes->warnings.push_back(
            {place_,
             fmt::format("sand still slides after {} sweeps: its steepest slope is {:.1f} degrees",
                         result.sweeps, result.steepest / degree),
             "take coarser cells, or another fusion layer above"});
    return true;
}

Tiles FusionLayer::changed_since(const TerrainLayer& before, const Domain& domain) const {
    const auto* other = dynamic_cast<const FusionLayer*>(&before);
    const bool same =
        other && other->settings_ == settings_ && other->mask_ == mask_ && other->domain_ == domain_;
    return Tiles(domain, !same);
}

namespace {

constexpr std::array fusion_params = {
    param::number("repose", "deg", "34", 5, 60, "angle of repose of the sand"),
    param::number("drape", "m", "0", 0, 1e4,
                  "thickness below which sand follows the rock and leaves no seam; 0: off"),
    param::text("mask", "none", "name of a mask: share of the sand that is loose"),
};

std::unique_ptr<TerrainLayer> fusion_make(const LayerContext& context) {
    const LayerValues& values = context.values;
    FusionSettings settings;
    settings.repose = values.number("repose") * degree;
    settings.drape = values.number("drape");
    const double cell = context.domain.cell;
    if (settings.drape > max_drape_cells * cell && context.warn)
        context.warn(values.place("drape"),
                     fmt::format("drape {:g} m is above the limit of {:g} cells: {:g} m is used",
                                 settings.drape, max_drape_cells, max_drape_cells * cell),
                     "lower it, or take coarser cells");
    std::string mask;
    if (values.has("mask")) mask = required_mask_name(context, "mask");
    return std::make_unique<FusionLayer>(context.domain, settings, std::move(mask), values.place("type"));
}

} // namespace

LayerType fusion_layer_type() {
    return {"fusion", "sand drapes over rock, and slides until it is at its angle of repose", fusion_params,
            fusion_make};
}

} // namespace marram
