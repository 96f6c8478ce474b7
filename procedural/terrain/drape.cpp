// SPDX-License-Identifier: Apache-2.0
// drape: sand thins out along the rock where the two meet, without a seam. Part of the fusion layer.
//
// A seam is a kink where the sand surface meets the rock at an angle. For rock b and a horizontal sand level
// H, the smooth maximum of layer.h over k = drape removes it; its slope is continuous:
//
//   thickness s(H - b),  s(u) = 0 for u <= -k,  (u + k)^2 / 4k for |u| < k,  u for u >= k
//
// This needs H under bare rock too, and the added sand must come from somewhere. The inverse solves both:
// sand of thickness s on rock b has the level
//
//   phi = b + L(s),  L(s) = 2 sqrt(k s) - k for s < k,  s for s >= k  (the inverse of s(u): L and its slope are continuous at k)
//
// and flows from higher to lower phi until phi is constant. (The disjoining pressure of thin liquid films is
// such a term.) The steady state is the smooth maximum: a fillet that begins k below the sand level and ends
// k above it, tangent to the rock. Where the sand is thicker than k, phi is its surface.
//
// Run to the steady state, dunes would flow apart like a liquid. So it runs only for the time in which
// diffusion spreads over sqrt(2) k, and only where the sand is thin: the flow between two samples has a
// weight that falls smoothly from 1, where the thinner one has at most 2 k, to 0 at 4 k. Sand thicker than 4
// k whose neighbours are too stays bit-identical. Uniform sand on a uniform rock slope also stays, except its
// ends: they creep downhill by about k tan(slope), films thinner than k/100 by about k.
//
// A step moves from p, the higher sample, to its neighbour q
//
//   f = 1/5 fade(min(s_p, s_q)) min(s_p - s(phi_q - b_p), s(phi_p - b_q) - s_q)
//
// rounded down to whole units. The first term lowers p to the level of q, the second raises q to that of p.
// Each sample has four neighbours, so neither overshoots and no sand becomes negative. Where both are thick
// this is diffusion with 0.2 cells^2 a step: 5 (k / cell)^2 steps, at least 8, spread over sqrt(2) k. Both
// ends compute the same f from the same numbers, so sand is conserved exactly at any thread count.
//
// k is at most 10 cells: 500 steps. Tiles sleep if nothing moved in their neighbourhood in the last step.
// Borders are walls.
// Cost: 80 ns a sample and step of one core in awake tiles, measured on a busy machine; almost nothing for
// samples that are all bare or all thick. 32 bytes a sample while it runs.
#include "procedural/terrain/drape.h"

#include "core/math/simd.h"
#include "procedural/abi/parallel.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

namespace marram {
namespace {

constexpr double drape_rate = 0.2; // fraction of the level difference moved to one neighbour
constexpr double drape_min_steps = 8.0;

// L(s) of the file head.
MARRAM_INLINE VDouble drape_level(VDouble s, double k) { return select(s < k, 2.0 * vsqrt(k * s) - k, s); }

// s(u) of the file head.
MARRAM_INLINE VDouble drape_thickness(VDouble u, double k) {
    const VDouble v = vmax(u + k, 0.0);
    return select(u < k, v * v * (0.25 / k), u);
}

// 1 up to 2 k, 0 above 4 k.
MARRAM_INLINE VDouble drape_fade(VDouble thinner, double k) {
    const VDouble t = vmax(vmin(2.0 - thinner * (0.5 / k), 1.0), 0.0);
    return t * t * (3.0 - 2.0 * t);
}

struct DrapeSample {
    VDouble ground, sand, level;
};

// Sand that flows from a to b; negative from b to a.
MARRAM_INLINE VDouble drape_flow(const DrapeSample& a, const DrapeSample& b, double k) {
    const VLong down = a.level > b.level;
    const VDouble high_ground = select(down, a.ground, b.ground),
                  low_ground = select(down, b.ground, a.ground);
    const VDouble high_sand = select(down, a.sand, b.sand), low_sand = select(down, b.sand, a.sand);
    const VDouble high = vmax(a.level, b.level), low = vmin(a.level, b.level);
    const VDouble give = high_sand - drape_thickness(low - high_ground, k);
    const VDouble take = drape_thickness(high - low_ground, k) - low_sand;
    const VDouble wanted = vmax(vmin(give, take), 0.0);
    const VDouble f = vfloor(drape_rate * drape_fade(vmin(a.sand, b.sand), k) * wanted);
    return select(down, f, -f);
}

// Rows have `stride` samples, with padding of `lanes` samples before the first column and after the last, and
// one padding row above and below.
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

// One step of a tile, from `sand` to `next`. Returns true if sand moved.
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
    const double cells = std::min(drape / domain.cell, max_drape_cells);
    const double k = cells * domain.cell * sand_units_per_metre;
    if (!(k >= 1.0)) return true; // less than a unit of sand
    const int steps = int(std::max(std::ceil(5.0 * cells * cells), drape_min_steps));
    DrapeGrid grid(domain);
    const auto rows = [&](auto&& act) { marram::parallel_for(0, domain.nz, act); };
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
        // Sleeping tiles keep the levels of the previous step: their sand has not changed.
        marram::parallel_for(size_t(0), rects.size(), [&](size_t r) { drape_levels(grid, rects[r], k); });
        marram::parallel_for(size_t(0), rects.size(),
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
