// SPDX-License-Identifier: Apache-2.0
// Balances scour and deposits exactly, in whole units of sand.
#include "procedural/terrain/ruin/ruin_budget.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

namespace marram {
namespace {

__extension__ using RuinWide = unsigned __int128;

// part * all / whole, rounded down; part <= whole, whole > 0.
SandUnits ruin_prorated(SandUnits part, SandUnits all, SandUnits whole) {
    return SandUnits(RuinWide(part) * RuinWide(all) / RuinWide(whole));
}

// Scales counts so that their sum is exactly `all`, by differences of the scaled running sum. sum(counts) =
// whole >= all. No count grows.
void ruin_scale(std::vector<SandUnits>& counts, SandUnits all, SandUnits whole) {
    if (all == whole) return;
    SandUnits running = 0, before = 0;
    for (SandUnits& count : counts) {
        if (count == 0) continue;
        running += count;
        const SandUnits now = ruin_prorated(running, all, whole);
        count = now - before;
        before = now;
    }
}

SandUnits ruin_sum(const std::vector<SandUnits>& counts) {
    return std::accumulate(counts.begin(), counts.end(), SandUnits(0));
}

} // namespace

void ruin_balance_sand(const RuinGrid& grid, const Domain& domain, double supply, SandUnits* sand,
                       RuinResult& result) {
    std::vector<SandUnits> taken(grid.count()), given(grid.count());
    const auto sample = [&](size_t k) {
        return domain.index(grid.rect.i0 + int(k % size_t(grid.nx)), grid.rect.j0 + int(k / size_t(grid.nx)));
    };
    for (size_t k = 0; k < grid.count(); ++k) {
        if (grid.scour[k] > 0.0) taken[k] = std::min(sand_units(grid.scour[k]), sand[sample(k)]);
        if (grid.deposit[k] > 0.0) given[k] = sand_units(grid.deposit[k]);
    }
    const SandUnits from = ruin_sum(taken), wanted = ruin_sum(given);
    result.taken = std::min(from, wanted);
    result.supplied = SandUnits(std::floor(supply * double(wanted - result.taken)));
    result.supplied = std::min(result.supplied, wanted - result.taken); // the double may have rounded up
    result.given = result.taken + result.supplied;
    if (from > 0) ruin_scale(taken, result.taken, from);
    if (wanted > 0) ruin_scale(given, result.given, wanted);
    for (size_t k = 0; k < grid.count(); ++k)
        if (taken[k] != given[k]) sand[sample(k)] += given[k] - taken[k];
}

} // namespace marram
