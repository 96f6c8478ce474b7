// SPDX-License-Identifier: Apache-2.0
// Wakes: the wind recovers behind plants.
//
// Within plants of frontal area lambda per area of ground the shear velocity is R0 u*, R0 = 1 / sqrt(1 + drag
// lambda) (M. Raupach, D. Gillette, J. Leys, J. Geophys. Res. 98, 1993). At a distance x behind a plant of
// height p it is
//
//   u*(x) = u* (1 - (1 - R0) exp(-x / (recovery p)))
//
// (G. Okin, "A new model of wind erosion in the presence of vegetation", J. Geophys. Res. 113, 2008; a
// recovery of 2.1 heights: 99 % of the loss is recovered after 10). Where wakes meet, the larger deficit
// counts; a taller plant whose deficit is smaller is forgotten, although its wake would last longer. Sand
// settles where the wind is weak: a hummock in each tuft with a tail behind it, a nabkha (P. Hesp, "The
// formation of shadow dunes", J. Sediment. Petrol. 51, 1981). A tail is as wide as the tuft at its start;
// avalanches make it a ridge.
//
// Cost: 3 ns a cell on one core, 10 if plants grow (build/marram_bench). Memory: 8 bytes a cell, 12
// if plants grow, and more for oblique winds over open ground. Deficits below 1/10,000 are cut to 0.
#include "procedural/terrain/solver/wake.h"

#include "procedural/abi/parallel.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr float min_deficit = 1e-4F;

MARRAM_HOT void wake_own_deficit(const float* area, float drag, int count, float* deficit) {
    for (int b = 0; b < count; b += lanes)
        vstore(deficit + b, 1.0F - 1.0F / vsqrt(1.0F + drag * vload(area + b)));
}

// The fraction of a deficit that is left after one sample of a ray. `decay_height`: height of a plant,
// metres, whose wake decays to 1/e in one sample.
MARRAM_HOT void wake_decay(const double* height, double decay_height, int count, float* decay) {
    const VDouble least = splat(decay_height / 600.0); // vexp() ends at -700; dead plants have no height
    for (int b = 0; b < count; b += lanes)
        vstore(decay + b, to_float(vexp(-decay_height / vmax(least, vload(height + b)))));
}

// Sweeps one group of rays downwind: own deficits become those of wakes too. `decay` NULL: `uniform_decay`
// everywhere.
MARRAM_HOT void wake_sweep(int length, const float* decay, float uniform_decay, float* deficit) {
    constexpr int vectors = DownwindRays::width / lanes;
    VFloat carried[vectors], carried_decay[vectors];
    for (int v = 0; v < vectors; ++v) carried[v] = carried_decay[v] = splat_float(0.0F);
    for (int n = 0; n < length; ++n)
        for (int v = 0; v < vectors; ++v) {
            float* const here = deficit + size_t(n) * DownwindRays::width + size_t(v * lanes);
            const VFloat own = vload(here), left = carried[v] * carried_decay[v];
            const VFloat own_decay = decay
                                         ? vload(decay + size_t(n) * DownwindRays::width + size_t(v * lanes))
                                         : splat_float(uniform_decay);
            carried_decay[v] = own >= left ? own_decay : carried_decay[v];
            const VFloat most = vmax(own, left);
            carried[v] = most > min_deficit ? most : splat_float(0.0F);
            vstore(here, carried[v]);
        }
}

} // namespace

void Wake::find(const DownwindGrid& grid, double recovery, const WakePlants& plants, size_t pitch,
                float* deficit) {
    const double spacing = grid.spacing(),
                 longest = recovery * plants.full_height * -std::log(double(min_deficit));
    const double most =
        8.0 * (double(grid.rows) + grid.columns); // samples: so long a ray has crossed the ground many times
    const DownwindRays rays(grid, int(std::min(std::ceil(longest / spacing) + 1.0, most)), 0);
    const size_t count = pitch * size_t(grid.rows);
    const int padded_columns = (grid.columns + lanes - 1) / lanes * lanes;
    own_.resize(count);
    if (plants.height) decay_.resize(count);
    rays_.resize(rays.pitch() * size_t(grid.rows));
    marram::parallel_for(0, grid.rows, [&](int row) {
        const size_t at = size_t(row) * pitch;
        wake_own_deficit(plants.frontal_area + at, float(plants.drag), padded_columns, own_.data() + at);
        if (plants.height)
            wake_decay(plants.height + at, spacing / recovery, padded_columns, decay_.data() + at);
    });
    const float uniform_decay = float(std::exp(-spacing / (recovery * plants.full_height)));
    struct Scratch {
        WideVector<float> deficit, decay;
    };
    tbb::enumerable_thread_specific<Scratch> scratches;
    marram::parallel_for(0, rays.groups(), [&](int group) {
        Scratch& mine = scratches.local();
        mine.deficit.resize(size_t(rays.length()) * DownwindRays::width);
        rays.gather(own_.data(), pitch, group, mine.deficit.data());
        if (plants.height) {
            mine.decay.resize(mine.deficit.size());
            rays.gather(decay_.data(), pitch, group, mine.decay.data());
        }
        wake_sweep(rays.length(), plants.height ? mine.decay.data() : nullptr, uniform_decay,
                   mine.deficit.data());
        rays.store(mine.deficit.data(), group, rays_.data());
    });
    rays.scatter(rays_.data(), deficit, pitch);
}

} // namespace marram
