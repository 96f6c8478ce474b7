// SPDX-License-Identifier: Apache-2.0
// drape: where sand meets rock it thins out along the rock and leaves no seam. A part of the fusion layer.
//
// A seam is a kink: the surface of sand runs into rock at an angle. Two surfaces, rock b and a level H of sand, join without one by the smooth maximum
// of layer.h over k = drape, whose slope is continuous:
//
//   thickness s(H - b),  s(u) = 0 for u <= -k,  (u + k)^2 / 4k for |u| < k,  u for u >= k
//
// H has to be known under bare rock too, and the added sand has to come from somewhere. Both follow when it is read the other way round: sand of
// thickness s on rock b is at the level
//
//   phi = b + L(s),  L(s) = 2 sqrt(k s) - k for s < k,  s for s >= k  (the inverse of s(u): L and its slope are continuous at k)
//
// and flows from higher to lower phi until phi is level. (Liquids have such a term for thin films, the disjoining pressure.) At rest that is the smooth
// maximum: a fillet that begins k below the level of the sand and ends, with slope 0 to the rock, k above it. Where the sand is thicker
// than k, phi is its surface.
//
// Sand is no liquid: this must not go on to rest everywhere, or dunes would flow apart. It goes on for as long as diffusion takes to spread over
// sqrt(2) k, and only where the sand is thin: the flow between two samples is multiplied by 1 where the thinner one has 2 k at most, by 0 from 4 k on, and
// smoothly between. So sand thicker than 4 k whose neighbours are too keeps its bits. Even sand on an even slope of rock stays as well, but for its ends:
// they creep downhill by about k tan(slope), films of less than k/100 by some k.
//
// A step takes from p, the higher one, to its neighbour q
//
//   f = 1/5 fade(min(s_p, s_q)) min(s_p - s(phi_q - b_p), s(phi_p - b_q) - s_q)
//
// rounded down to whole units. The first term brings p down to the level of q, the second q up to that of p; each sample has four neighbours, so that
// neither is overshot and no sand is negative. Where both are thick that is diffusion with 0.2 cells^2 a step: 5 (k / cell)^2 steps, 8 at least, for
// a spread of sqrt(2) k. Both ends compute the same f from the same numbers, so that nothing is made or lost, on any number of threads.
//
// k is 10 cells at most: 500 steps. Tiles in whose neighbourhood nothing moved in the last step sleep. Borders are walls.
// Cost: 80 ns a sample and step of one core in tiles that are awake, measured on a busy machine; samples that are all bare or all thick nearly nothing. 32 bytes a sample while it runs.
#include "procedural/terrain/drape.h"

#include "core/math/simd.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

namespace marram {
namespace {

constexpr double drape_share = 0.2; // of what is out of level, to one neighbour
constexpr double drape_least_steps = 8.0;

// L(s).
MARRAM_INLINE VDouble drape_level(VDouble s, double k) { return select(s < k, 2.0 * vsqrt(k * s) - k, s); }

// s(u).
MARRAM_INLINE VDouble drape_thickness(VDouble u, double k) {
    const VDouble v = vmax(u + k, 0.0);
    return select(u < k, v * v * (0.25 / k), u);
}

// 1 up to 2 k, 0 from 4 k on.
MARRAM_INLINE VDouble drape_fade(VDouble thinner, double k) {
    const VDouble t = vmax(vmin(2.0 - thinner * (0.5 / k), 1.0), 0.0);
    return t * t * (3.0 - 2.0 * t);
}

struct DrapeSample {
    VDouble ground, sand, level;
};

// What a loses to b, or (negative) gains from it.
MARRAM_INLINE VDouble drape_flow(const DrapeSample& a, const DrapeSample& b, double k) {
    const VLong down = a.level > b.level;
    const VDouble high_ground = select(down, a.ground, b.ground),
                  low_ground = select(down, b.ground, a.ground);
    const VDouble high_sand = select(down, a.sand, b.sand), low_sand = select(down, b.sand, a.sand);
    const VDouble high = vmax(a.level, b.level), low = vmin(a.level, b.level);
    const VDouble give = high_sand - drape_thickness(low - high_ground, k);
    const VDouble take = drape_thickness(high - low_ground, k) - low_sand;
    const VDouble wanted = vmax(vmin(give, take), 0.0);
    const VDouble f = vfloor(drape_share * drape_fade(vmin(a.sand, b.sand), k) * wanted);
    return select(down, f, -f);
}

// Rows have `stride` samples, lanes of them before the first column and after the last, and there is a row above the first and below the last.
struct DrapeGrid {
    DrapeGrid(const Domain& d)
        : nx(d.nx), nz(d.nz), stride((size_t(d.nx) + 2 * lanes + lanes - 1) / lanes * lanes),
          ground(std::make_unique<double[]>(count())), level(std::make_unique<double[]>(count())),
          sand(std::make_unique<double[]>(count())), next(std::make_unique<double[]>(count())) {}
    size_t count() const { return stride * (size_t(nz) + 2); }
    size_t at(int i, int j) const { return stride * size_t(j + 1) + size_t(i + lanes); }

    int nx, nz;
    size_t stride;
    std::unique_ptr<double[]> ground, level, sand, next;
};

MARRAM_HOT void drape_levels(DrapeGrid& grid, const Rect& rect, double k) {
    for (int j = rect.j0; j < rect.j1; ++j)
        for (size_t s = grid.at(rect.i0, j), end = grid.at(rect.i1, j); s < end; s += lanes) {
            const VDouble level = vload(&grid.ground[s]) + drape_level(vload(&grid.sand[s]), k);
            const size_t part = std::min(end - s, size_t(lanes));
            if (part == size_t(lanes))
                vstore(&grid.level[s], level);
            else
                for (size_t l = 0; l < part; ++l) grid.level[s + l] = level[l];
        }
}

MARRAM_INLINE DrapeSample drape_sample(const DrapeGrid& grid, size_t s) {
    return {vload(&grid.ground[s]), vload(&grid.sand[s]), vload(&grid.level[s])};
}

// One step of a tile, from `sand` to `next`. True: something moved.
MARRAM_HOT bool drape_step(DrapeGrid& grid, const Rect& rect, double k) {
    VLong moved{};
    for (int j = rect.j0; j < rect.j1; ++j)
        for (int i = rect.i0; i < rect.i1; i += lanes) {
            const size_t s = grid.at(i, j);
            const VLong column = lane_index + int64_t(i);
            const VLong here = column < int64_t(rect.i1);
            const VLong west = here & (column > 0), east = here & (column < int64_t(grid.nx - 1));
            const VDouble zero = splat(0.0);
            const DrapeSample own = drape_sample(grid, s);
            const size_t around[] = {s - 1, s + 1, s - grid.stride, s + grid.stride};
            VDouble least = own.sand, most = own.sand;
            for (const size_t n : around) {
                const VDouble beside = vload(&grid.sand[n]);
                least = vmin(least, beside), most = vmax(most, beside);
            }
            // All bare, or all thick: nothing flows.
            if (!any(here & (most > 0.0) & (least < 4.0 * k))) {
                if (i + lanes <= rect.i1) {
                    vstore(&grid.next[s], own.sand);
                    continue;
                }
            }
            VDouble lost = select(west, drape_flow(own, drape_sample(grid, s - 1), k), zero);
            lost += select(east, drape_flow(own, drape_sample(grid, s + 1), k), zero);
            if (j > 0) lost += select(here, drape_flow(own, drape_sample(grid, s - grid.stride), k), zero);
            if (j < grid.nz - 1)
                lost += select(here, drape_flow(own, drape_sample(grid, s + grid.stride), k), zero);
            moved |= lost != 0.0;
            const VDouble left = own.sand - lost;
            const int part = std::min(rect.i1 - i, lanes);
            if (part == lanes)
                vstore(&grid.next[s], left);
            else
                for (int l = 0; l < part; ++l) grid.next[s + size_t(l)] = left[l];
        }
    return any(moved);
}

} // namespace

bool drape_sand(const Domain& domain, const double* ground, double* sand, double drape,
                const std::function<bool()>& cancelled) {
    const double cells = std::min(drape / domain.cell, most_drape_cells);
    const double k = cells * domain.cell * sand_units_a_metre;
    if (!(k >= 1.0)) return true; // less than a unit of sand
    const int steps = int(std::max(std::ceil(5.0 * cells * cells), drape_least_steps));
    DrapeGrid grid(domain);
    const auto rows = [&](auto&& act) { tbb::parallel_for(0, domain.nz, act); };
    rows([&](int j) {
        std::copy_n(ground + domain.index(0, j), domain.nx, &grid.ground[grid.at(0, j)]);
        std::copy_n(sand + domain.index(0, j), domain.nx, &grid.sand[grid.at(0, j)]);
        std::copy_n(sand + domain.index(0, j), domain.nx, &grid.next[grid.at(0, j)]);
    });
    Tiles awake(domain, true);
    for (int step = 0; step < steps && !awake.none(); ++step) {
        if (cancelled && cancelled()) return false;
        const std::vector<Rect> rects = awake.rects();
        std::vector<char> moved(rects.size());
        // The levels of samples beside a tile that sleeps are those of the step before: its sand is the same.
        tbb::parallel_for(size_t(0), rects.size(), [&](size_t r) { drape_levels(grid, rects[r], k); });
        tbb::parallel_for(size_t(0), rects.size(),
                          [&](size_t r) { moved[r] = drape_step(grid, rects[r], k); });
        std::swap(grid.sand, grid.next);
        Tiles still(domain);
        for (size_t r = 0; r < rects.size(); ++r)
            if (moved[r]) still.add(rects[r].i0 / Tiles::side, rects[r].j0 / Tiles::side);
        awake = still.grown(domain.cell);
    }
    rows([&](int j) { std::copy_n(&grid.sand[grid.at(0, j)], domain.nx, sand + domain.index(0, j)); });
    return true;
}

} // namespace marram
