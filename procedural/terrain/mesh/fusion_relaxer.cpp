// SPDX-License-Identifier: Apache-2.0
// Guarantee. A quad of the grid has corners a, b (row j) and c, d (row j + 1). Its two diagonals give four
// triangles, whose gradients pair one of (b - a, d - c) with one of (c - a, d - b). After the layer, no
// triangle with sand at all corners has a gradient above tan(repose + 0.4 degrees). The norm of the gradient
// has no preferred grid direction. Steeper triangles move sand until they are at tan(repose + 0.05 degrees).
// If no triangle exceeds the first limit, the sand stays bit-identical.
//
// Moves between the corners of one quad, in whole sand units (so sand is conserved) and at most what a corner
// has:
// - All corners carry sand. The heights are a mean, a mean gradient (gx, gz) and a twist w = d - c - b + a.
//   The steepest triangle has (|gx| + |w|/2)^2 + (|gz| + |w|/2)^2. The twist is reduced first, then the
//   gradient. Every move lowers the sum of squared heights, that is, the potential energy. Moving one
//   triangle at a time raises its neighbours instead and converges ten times slower.
// - A corner is bare or has less than 64 units (15 nm). A triangle moves along its gradient if all corners
//   that must give carry sand. If no triangle moves, sand falls along edges (sides and diagonals) steeper
//   than repose. So sand leaves steep rock until it is bare, and rock above sand does not attract sand.
//
// Order of updates: Gauss-Seidel. Tiles of 64 x 64 quads in four colours; tiles of one colour share no
// sample, so the result does not depend on threads. Within a tile, rows alternate upwards and downwards, each
// in two colours of eight quads at once. Blocks of 16 x 8 quads sleep until they or a neighbour have moved
// sand.
//
// Large steep regions. Relaxation is diffusive: N samples take N^2 sweeps. So coarser grids of 2^l x 2^l
// samples (l up to 8) come first, starting at the coarsest. The height of a coarse sample is the mean of its
// samples, its sand is their minimum, and all of them gain or lose the same. A coarse sample is at least as
// high as any bare rock in it; else sand would pass through a lip. Coarse grids test mean gradients only: two
// slopes at repose that meet in a crease would have triangles up to sqrt(2) steeper across blocks. A move
// covers half of the excess, or the row order would be visible: the radii of a cone along x and z differ by
// 0.6 %, with full moves by 2 %. Level l relaxes to repose - 0.1 - 0.1 l degrees from 0.1 above that: without
// slack for the roughness of the next finer grid, that grid would be diffusive again. So beside oversteep
// sand these levels may lower sand at repose by as much. If the finest grid does not settle in 12 sweeps, the
// cycle repeats. Now and then the coarse and the finest grid undo each other's moves forever: after 16 cycles the
// finest has 24 sweeps, after 32 cycles 48, and so on.
#include "procedural/terrain/mesh/fusion_relaxer.h"

#include "core/math/simd.h"
#include "procedural/abi/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

constexpr int fusion_tile_blocks = Tiles::side / fusion_block_columns;
constexpr int fusion_tile_block_rows = Tiles::side / fusion_block_rows;
constexpr int fusion_max_levels = 8, fusion_coarse_sweeps = 256;
constexpr int fusion_cycle_sweeps = 12, fusion_doubling_cycles = 16; // sweeps a cycle double after so many
constexpr size_t fusion_most_sweeps = 4096; // of the whole finest grid, where all of it is awake
constexpr size_t fusion_smallest_work_limit = size_t(1) << 22; // blocks: 10 s of one core at most
constexpr double fusion_min_covered = 64.0; // units; thinner samples use scalar moves that do not round to 0

// Offsets of the corners of eight quads of a row: a and b in row j, c and d in row j + 1; 8 doubles each.
struct FusionQuads {
    size_t a, b, c, d;
    VLong valid;
};

MARRAM_INLINE VDouble fusion_round(VDouble x) { // to a whole number; above 2^52 unchanged
    const VDouble magic = select(x < 0.0, -0x1p52, 0x1p52);
    const VDouble rounded = (x + magic) - magic;
    return select(vabs(x) < 0x1p52, rounded, x);
}

struct FusionHeights {
    VDouble a, b, c, d;
};

// Transfers that flatten the mean gradient of a quad towards the target: from d to a and from c to b.
MARRAM_INLINE void fusion_quad_move(const FusionHeights& h, double target, VLong where, FusionHeights& s) {
    const VDouble gx = 0.5 * ((h.b - h.a) + (h.d - h.c)), gz = 0.5 * ((h.c - h.a) + (h.d - h.b));
    const VDouble k = 0.25 * (1.0 - target / vsqrt(gx * gx + gz * gz)); // half of the excess
    VDouble da = k * (gx + gz), cb = k * (gz - gx);
    const VDouble da_from = select(da > 0.0, s.d, s.a), cb_from = select(cb > 0.0, s.c, s.b);
    VDouble share = splat(1.0);
    share = vmin(share, da_from / vmax(vabs(da), 1.0));
    share = vmin(share, cb_from / vmax(vabs(cb), 1.0));
    da = select(where, fusion_round(share * da), 0.0);
    cb = select(where, fusion_round(share * cb), 0.0);
    da = vmax(-s.a, vmin(s.d, da));
    cb = vmax(-s.b, vmin(s.c, cb));
    s.a += da, s.d -= da, s.b += cb, s.c -= cb;
}

// Flattens quads to the target slope. The twist makes the triangles of a quad differ. It is reduced first,
// until no triangle exceeds the target; if that is not enough, the mean gradient too. The mean height stays.
MARRAM_INLINE void fusion_flatten(const FusionHeights& h, double target, VLong where, FusionHeights& s) {
    const VDouble gx = 0.5 * ((h.b - h.a) + (h.d - h.c)), gz = 0.5 * ((h.c - h.a) + (h.d - h.b));
    const VDouble twist = 0.5 * ((h.d - h.c) - (h.b - h.a)), zero = splat(0.0);
    const VDouble sum = vabs(gx) + vabs(gz), square = gx * gx + gz * gz;
    const VDouble room = vmax(target * target - square, zero);
    const VDouble allowed =
        0.5 * (vsqrt(sum * sum + 2.0 * room) - sum); // maximum twist; 0 if the mean gradient is too steep
    const VDouble excess = 0.5 * vmax(vabs(twist) - allowed, zero);
    const VDouble flat = select(twist > 0.0, excess, -excess);
    const VDouble k = select(square > target * target, 0.5 * (1.0 - target / vsqrt(square)), zero);
    FusionHeights move = {k * (gx + gz) - flat, k * (gz - gx) + flat, k * (gx - gz) + flat, zero};
    move.d = -(move.a + move.b + move.c);
    const VDouble one = splat(1.0);
    VDouble share = vmin(s.a / vmax(-move.a, one), s.b / vmax(-move.b, one));
    share = vmin(vmin(share, one), vmin(s.c / vmax(-move.c, one), s.d / vmax(-move.d, one)));
    move.a = select(where, vmax(fusion_round(share * move.a), -s.a), zero);
    move.b = select(where, vmax(fusion_round(share * move.b), -s.b), zero);
    move.c = select(where, vmax(fusion_round(share * move.c), -s.c), zero);
    // Rounding may take up to two units too many from d; subtract them from the corner that gains most.
    const VDouble missing = vmax(move.a + move.b + move.c - s.d, zero);
    const VLong to_a = (move.a >= move.b) & (move.a >= move.c), to_b = ~to_a & (move.b >= move.c);
    move.a -= select(to_a, missing, zero), move.b -= select(to_b, missing, zero);
    move.c -= select(to_a | to_b, zero, missing);
    s.a += move.a, s.b += move.b, s.c += move.c, s.d -= move.a + move.b + move.c;
}

// A triangle with possibly bare corners: sand moves only if all corners that must give carry some. Returns
// true if sand moved.
bool fusion_partial_triangle(const FusionGrid& grid, const FusionSlopes& slopes, size_t p, size_t q,
                             size_t r) {
    const double gx = grid.height(q) - grid.height(p), gz = grid.height(r) - grid.height(p);
    const double steep = std::sqrt(gx * gx + gz * gz);
    if (!(steep > slopes.trigger)) return false;
    const double k = (1.0 - slopes.target / steep) / 3.0;
    double q_to_p = k * (2.0 * gx - gz), r_to_p = k * (2.0 * gz - gx);
    const double lost = -(q_to_p + r_to_p);
    double* const sand = grid.sand.get();
    double share = 1.0;
    if (q_to_p > 0.0) share = std::min(share, sand[q] / std::max(q_to_p, 1.0));
    if (r_to_p > 0.0) share = std::min(share, sand[r] / std::max(r_to_p, 1.0));
    if (lost > 0.0) share = std::min(share, sand[p] / std::max(lost, 1.0));
    q_to_p = std::min(std::rint(share * q_to_p), sand[q]);
    r_to_p = std::min(std::rint(share * r_to_p), sand[r]);
    const double missing = std::min(0.0, sand[p] + (q_to_p + r_to_p));
    (q_to_p < 0.0 ? q_to_p : r_to_p) -= missing;
    sand[q] -= q_to_p, sand[r] -= r_to_p, sand[p] += q_to_p + r_to_p;
    if (q_to_p != 0.0 || r_to_p != 0.0) return true;
    // Rounded to nothing, as a corner that must give has a few units only: it gives them and is bare.
    const size_t corners[] = {p, q, r};
    size_t lowest = p, thinnest = p;
    for (const size_t k : corners) {
        if (grid.height(k) < grid.height(lowest)) lowest = k;
        if (sand[k] < sand[thinnest]) thinnest = k;
    }
    // The corner stays above the lowest one, so that the potential energy falls.
    const double give = sand[thinnest], fall = grid.height(thinnest) - grid.height(lowest);
    if (!(give > 0.0 && give < fusion_min_covered && fall > give)) return false;
    sand[lowest] += sand[thinnest], sand[thinnest] = 0.0;
    return true;
}

// Moves sand down an edge that is too steep; `far`: edge length in cells. Returns true if sand moved.
bool fusion_edge(const FusionGrid& grid, const FusionSlopes& slopes, double far, size_t a, size_t b) {
    const double fall = grid.height(a) - grid.height(b);
    if (!(std::abs(fall) > slopes.trigger * far)) return false;
    if (fall < 0.0) std::swap(a, b);
    const double amount = std::rint(0.5 * (std::abs(fall) - slopes.target * far));
    const double give = std::min(grid.sand[a], amount);
    grid.sand[a] -= give, grid.sand[b] += give;
    return give > 0.0;
}

// A quad with a bare or thin corner. Returns true if sand moved.
bool fusion_bare_quad(const FusionGrid& grid, const FusionSlopes& slopes, size_t a, size_t b, size_t c,
                      size_t d) {
    bool moved = fusion_partial_triangle(grid, slopes, a, b, c);
    moved |= fusion_partial_triangle(grid, slopes, d, c, b);
    moved |= fusion_partial_triangle(grid, slopes, b, a, d);
    moved |= fusion_partial_triangle(grid, slopes, c, d, a);
    if (moved) return true;
    moved |= fusion_edge(grid, slopes, std::numbers::sqrt2, a, d);
    moved |= fusion_edge(grid, slopes, std::numbers::sqrt2, b, c);
    moved |= fusion_edge(grid, slopes, 1.0, a, b);
    moved |= fusion_edge(grid, slopes, 1.0, c, d);
    moved |= fusion_edge(grid, slopes, 1.0, a, c);
    moved |= fusion_edge(grid, slopes, 1.0, b, d);
    return moved;
}

MARRAM_INLINE FusionHeights fusion_load(const double* from, const FusionQuads& q) {
    return {vload(from + q.a), vload(from + q.b), vload(from + q.c), vload(from + q.d)};
}
MARRAM_INLINE void fusion_store(double* to, const FusionQuads& q, const FusionHeights& s) {
    vstore(to + q.a, s.a), vstore(to + q.b, s.b);
    vstore(to + q.c, s.c), vstore(to + q.d, s.d);
}
MARRAM_INLINE FusionHeights operator+(const FusionHeights& g, const FusionHeights& s) {
    return {g.a + s.a, g.b + s.b, g.c + s.c, g.d + s.d};
}
MARRAM_INLINE VDouble fusion_steepness(const FusionHeights& h) { // squared gradient of the steepest triangle
    const VDouble gx = vmax(vabs(h.b - h.a), vabs(h.d - h.c));
    const VDouble gz = vmax(vabs(h.c - h.a), vabs(h.d - h.b));
    return gx * gx + gz * gz;
}
MARRAM_INLINE VDouble fusion_mean_steepness(const FusionHeights& h) {
    const VDouble gx = 0.5 * ((h.b - h.a) + (h.d - h.c)), gz = 0.5 * ((h.c - h.a) + (h.d - h.b));
    return gx * gx + gz * gz;
}
MARRAM_INLINE VLong fusion_covered(const FusionHeights& s) {
    return vmin(vmin(s.a, s.b), vmin(s.c, s.d)) >= fusion_min_covered;
}

// Eight quads of the finest grid. Returns true if sand moved.
MARRAM_INLINE bool fusion_fine_quads(const FusionGrid& grid, const FusionSlopes& slopes,
                                     const FusionQuads& q) {
    FusionHeights s = fusion_load(grid.sand.get(), q);
    const FusionHeights h = fusion_load(grid.ground.get(), q) + s;
    const VLong some = vmax(vmax(s.a, s.b), vmax(s.c, s.d)) > 0.0;
    const VLong steep = (fusion_steepness(h) > slopes.trigger * slopes.trigger) & some & q.valid;
    if (!any(steep)) return false;
    const VLong covered = fusion_covered(s) & steep;
    const bool some_covered = any(covered);
    bool moved = some_covered;
    if (some_covered) {
        fusion_flatten(h, slopes.target, covered, s);
        fusion_store(grid.sand.get(), q, s);
    }
    const VLong partial = steep & ~covered;
    if (!any(partial)) return moved;
    for (size_t l = 0; l < size_t(lanes); ++l)
        if (partial[l]) moved |= fusion_bare_quad(grid, slopes, q.a + l, q.b + l, q.c + l, q.d + l);
    return moved;
}

// Eight quads of a coarser grid: mean gradients only.
MARRAM_INLINE bool fusion_coarse_quads(const FusionGrid& grid, const FusionSlopes& slopes,
                                       const FusionQuads& q) {
    FusionHeights s = fusion_load(grid.sand.get(), q);
    const FusionHeights h = fusion_load(grid.ground.get(), q) + s;
    const VLong some = vmax(vmax(s.a, s.b), vmax(s.c, s.d)) > 0.0;
    const VLong steep = (fusion_mean_steepness(h) > slopes.trigger * slopes.trigger) & some & q.valid;
    if (!any(steep)) return false;
    const FusionHeights before = s;
    fusion_quad_move(h, slopes.target, steep, s);
    if (!any((s.a != before.a) | (s.b != before.b))) return false;
    fusion_store(grid.sand.get(), q, s);
    return true;
}

// One colour of the quads of block `column` in row j: quads 2k, or 2k + 1 if `odd`. Returns true if sand
// moved.
MARRAM_INLINE bool fusion_row_of_block(const FusionGrid& grid, const FusionSlopes& slopes, bool fine,
                                       int column, int j, int odd) {
    const int first = column * (fusion_block_columns / 2);
    const VLong k = lane_index + int64_t(first);
    const size_t half = size_t(grid.half), above = grid.row(j) + size_t(first), below = above + 2 * half;
    const VLong valid = k < int64_t(odd ? (grid.nx - 1) / 2 : grid.nx / 2);
    const FusionQuads q = odd ? FusionQuads{above + half, above + 1, below + half, below + 1, valid}
                              : FusionQuads{above, above + half, below, below + half, valid};
    return fine ? fusion_fine_quads(grid, slopes, q) : fusion_coarse_quads(grid, slopes, q);
}

struct FusionTile {
    int first_column, columns, first_row, rows; // in blocks
};

FusionTile fusion_tile(const FusionGrid& grid, int column, int row) {
    const int c = column * fusion_tile_blocks, r = row * fusion_tile_block_rows;
    return {c, std::min(fusion_tile_blocks, grid.block_columns - c), r,
            std::min(fusion_tile_block_rows, grid.block_rows - r)};
}

// Whether a block, or a neighbour in the same tile, moved sand in this sweep.
MARRAM_INLINE bool fusion_moved_nearby(const FusionGrid& grid, const FusionTile& tile, int column, int row) {
    for (int r = std::max(row - 1, tile.first_row); r <= std::min(row + 1, tile.first_row + tile.rows - 1);
         ++r)
        for (int c = std::max(column - 1, tile.first_column);
             c <= std::min(column + 1, tile.first_column + tile.columns - 1); ++c)
            if (grid.changed[grid.block(c, r)]) return true;
    return false;
}

// One pass over a tile, up or down: rows first, first + step, ... of each row of blocks.
MARRAM_INLINE void fusion_rows(FusionGrid& grid, const FusionSlopes& slopes, bool fine,
                               const FusionTile& tile, bool up, int first, int step) {
    for (int n = 0; n < tile.rows; ++n) {
        const int r = tile.first_row + (up ? n : tile.rows - 1 - n);
        int awake[fusion_tile_blocks], count = 0;
        for (int c = tile.first_column; c < tile.first_column + tile.columns; ++c)
            if (grid.active[grid.block(c, r)] || fusion_moved_nearby(grid, tile, c, r)) awake[count++] = c;
        const int rows = std::min(fusion_block_rows, grid.nz - 1 - r * fusion_block_rows);
        for (int m = 0; count > 0 && m < fusion_block_rows; m += step) {
            const int row = up ? m + first : fusion_block_rows - 1 - m - first;
            if (row >= rows) continue;
            for (int odd = 0; odd < 2; ++odd)
                for (int w = 0; w < count; ++w)
                    if (fusion_row_of_block(grid, slopes, fine, awake[w], r * fusion_block_rows + row,
                                            up ? odd : 1 - odd))
                        grid.changed[grid.block(awake[w], r)] = 1;
        }
    }
}

// The finest grid goes row by row, which carries sliding sand far. Coarser ones use four colours, symmetric
// in x and z.
MARRAM_HOT void fusion_pass(FusionGrid& grid, const FusionSlopes& slopes, bool fine, const FusionTile& tile,
                            bool up) {
    if (fine) return fusion_rows(grid, slopes, true, tile, up, 0, 1);
    fusion_rows(grid, slopes, false, tile, up, 0, 2);
    fusion_rows(grid, slopes, false, tile, up, 1, 2);
}

// A block is awake in the next sweep if it or a neighbour moved sand in this one. Returns true if any is.
bool fusion_wake(FusionGrid& grid) {
    std::fill(grid.active.begin(), grid.active.end(), char(0));
    bool some = false;
    for (int r = 0; r < grid.block_rows; ++r)
        for (int c = 0; c < grid.block_columns; ++c) {
            if (!grid.changed[grid.block(c, r)]) continue;
            some = true;
            for (int y = std::max(r - 1, 0); y <= std::min(r + 1, grid.block_rows - 1); ++y)
                for (int x = std::max(c - 1, 0); x <= std::min(c + 1, grid.block_columns - 1); ++x)
                    grid.active[grid.block(x, y)] = 1;
        }
    std::fill(grid.changed.begin(), grid.changed.end(), char(0));
    return some;
}

bool fusion_tile_awake(const FusionGrid& grid, const FusionTile& tile) {
    for (int r = tile.first_row; r < tile.first_row + tile.rows; ++r)
        for (int c = tile.first_column; c < tile.first_column + tile.columns; ++c)
            if (grid.active[grid.block(c, r)]) return true;
    return false;
}

// Two passes over all awake tiles, one tile colour after the other. Tiles of one colour share no sample, so
// the result does not depend on threads. Returns false if no block is awake any more.
bool fusion_sweep(FusionGrid& grid, const FusionSlopes& slopes, bool fine, bool flip) {
    std::vector<FusionTile> tiles;
    for (int colour = 0; colour < 4; ++colour) {
        tiles.clear();
        for (int row = colour >> 1; row < grid.tile_rows(); row += 2)
            for (int column = colour & 1; column < grid.tile_columns(); column += 2)
                if (const FusionTile tile = fusion_tile(grid, column, row); fusion_tile_awake(grid, tile))
                    tiles.push_back(tile);
        marram::parallel_for(size_t(0), tiles.size(), [&](size_t t) {
            fusion_pass(grid, slopes, fine, tiles[t], !flip);
            fusion_pass(grid, slopes, fine, tiles[t], flip);
        });
    }
    return fusion_wake(grid);
}

// Squared gradient of a quad's steepest triangle with sand at all three corners; 0 if there is none.
MARRAM_INLINE VDouble fusion_sand_steepness(const FusionHeights& h, const FusionHeights& s) {
    const VDouble none = splat(0.0);
    VDouble x0 = h.b - h.a, x1 = h.d - h.c, z0 = h.c - h.a, z1 = h.d - h.b;
    x0 *= x0, x1 *= x1, z0 *= z0, z1 *= z1;
    const VLong a = s.a > 0.0, b = s.b > 0.0, c = s.c > 0.0, d = s.d > 0.0;
    const VDouble upper = vmax(select(a & b & c, x0 + z0, none), select(a & b & d, x0 + z1, none));
    const VDouble lower = vmax(select(a & c & d, x1 + z0, none), select(b & c & d, x1 + z1, none));
    return vmax(upper, lower);
}

// Result of a survey of the grid: the steepest all-sand triangle, and whether any block is awake.
struct FusionSurvey {
    double steepest = 0.0; // squared
    bool awake = false;
};

MARRAM_INLINE void fusion_survey_quads(const FusionGrid& grid, const FusionQuads& q, VDouble& sandy,
                                       VDouble& steepest) {
    const FusionHeights s = fusion_load(grid.sand.get(), q);
    const FusionHeights h = fusion_load(grid.ground.get(), q) + s;
    const VLong some = (vmax(vmax(s.a, s.b), vmax(s.c, s.d)) > 0.0) & q.valid;
    if (!any(some)) return;
    const VDouble zero = splat(0.0);
    sandy = vmax(sandy, select(q.valid, fusion_sand_steepness(h, s), zero));
    steepest = vmax(steepest, select(some, fusion_steepness(h), zero));
}

// Surveys a row of blocks; sets `active` where a quad with sand is steeper than the trigger.
MARRAM_HOT void fusion_survey_row(FusionGrid& grid, double trigger, int r, FusionSurvey& found) {
    const size_t half = size_t(grid.half);
    VDouble all = splat(0.0);
    for (int column = 0; column < grid.block_columns; ++column) {
        VDouble steepest = splat(0.0);
        const int first = column * (fusion_block_columns / 2);
        const VLong k = lane_index + int64_t(first);
        const int begin = r * fusion_block_rows, end = std::min(begin + fusion_block_rows, grid.nz - 1);
        for (int j = begin; j < end; ++j) {
            const size_t above = grid.row(j) + size_t(first), below = above + 2 * half;
            fusion_survey_quads(grid,
                                {above, above + half, below, below + half, VLong(k < int64_t(grid.nx / 2))},
                                all, steepest);
            fusion_survey_quads(
                grid,
                {above + half, above + 1, below + half, below + 1, VLong(k < int64_t((grid.nx - 1) / 2))},
                all, steepest);
        }
        const bool awake = any(steepest > trigger * trigger);
        grid.active[grid.block(column, r)] = awake;
        found.awake |= awake;
    }
    for (int l = 0; l < lanes; ++l) found.steepest = std::max(found.steepest, all[l]);
}

FusionSurvey fusion_survey(FusionGrid& grid, double trigger) {
    std::vector<FusionSurvey> rows(size_t(grid.block_rows));
    marram::parallel_for(0, grid.block_rows,
                         [&](int r) { fusion_survey_row(grid, trigger, r, rows[size_t(r)]); });
    FusionSurvey all;
    for (const FusionSurvey& row : rows) {
        all.steepest = std::max(all.steepest, row.steepest);
        all.awake |= row.awake;
    }
    return all;
}

// One coarse sample from four fine ones. Its sand is their minimum, which all four can give. Its height is
// their mean, but at least that of any bare one, or sand would pass through a lip of rock.
void fusion_coarsen_row(const FusionGrid& fine, FusionGrid& coarse, int j) {
    for (int i = 0; i < coarse.nx; ++i) {
        const size_t a = fine.at(2 * i, 2 * j), b = fine.at(2 * i, 2 * j + 1);
        const size_t four[] = {a, fine.at(2 * i + 1, 2 * j), b, fine.at(2 * i + 1, 2 * j + 1)};
        double least = fine.sand[a], sum = 0.0, lip = -infinity;
        for (const size_t k : four) {
            const double height = fine.height(k);
            least = std::min(least, fine.sand[k]);
            sum += height;
            if (!(fine.sand[k] > 0.0)) lip = std::max(lip, height);
        }
        const size_t to = coarse.at(i, j);
        coarse.sand[to] = least;
        coarse.ground[to] = std::max(0.25 * sum, lip) - least;
    }
    coarse.clear_padding(j);
}

void fusion_coarsen(const FusionGrid& fine, FusionGrid& coarse) {
    marram::parallel_for(0, coarse.nz, [&](int j) { fusion_coarsen_row(fine, coarse, j); });
    std::fill(coarse.active.begin(), coarse.active.end(), char(0));
    for (int r = 0; r < fine.block_rows; ++r)
        for (int c = 0; c < fine.block_columns; ++c)
            if (fine.active[fine.block(c, r)] && c / 2 < coarse.block_columns && r / 2 < coarse.block_rows)
                coarse.active[coarse.block(c / 2, r / 2)] = 1;
}

// Applies the gain or loss of a coarse sample to each of its four fine samples.
void fusion_refine_row(FusionGrid& fine, const FusionGrid& coarse, int j) {
    for (int i = 0; i < coarse.nx; ++i) {
        const size_t four[] = {fine.at(2 * i, 2 * j), fine.at(2 * i + 1, 2 * j), fine.at(2 * i, 2 * j + 1),
                               fine.at(2 * i + 1, 2 * j + 1)};
        double least = fine.sand[four[0]];
        for (const size_t k : four) least = std::min(least, fine.sand[k]);
        const double gain = coarse.sand[coarse.at(i, j)] - least;
        if (gain == 0.0) continue;
        for (const size_t k : four) fine.sand[k] += gain;
        fine.changed[fine.block(2 * i / fusion_block_columns, 2 * j / fusion_block_rows)] = 1;
    }
}

void fusion_refine(FusionGrid& fine, const FusionGrid& coarse) {
    constexpr int rows =
        fusion_block_rows / 2; // coarse rows of one fine block row, so only one task sets a block's flag
    marram::parallel_for(0, (coarse.nz + rows - 1) / rows, [&](int r) {
        for (int j = r * rows; j < std::min((r + 1) * rows, coarse.nz); ++j)
            fusion_refine_row(fine, coarse, j);
    });
    for (size_t b = 0; b < fine.blocks(); ++b) fine.changed[b] = char(fine.changed[b] | fine.active[b]);
    fusion_wake(fine);
}

FusionSlopes fusion_slopes(double repose, double slack, double target, double distance) {
    return {std::tan(repose + slack) * distance * sand_units_per_metre,
            std::tan(repose + target) * distance * sand_units_per_metre};
}

} // namespace

double FusionRelaxer::steepest_squared() { return fusion_survey(finest(), fine_slopes().trigger).steepest; }

FusionSlopes FusionRelaxer::fine_slopes() const {
    return fusion_slopes(repose_, 0.4 * degree, 0.05 * degree, cell_);
}

void FusionRelaxer::add_grids() {
    while (grids_.size() <= size_t(fusion_max_levels) && grids_.back()->nx >= 8 && grids_.back()->nz >= 8)
        grids_.push_back(std::make_unique<FusionGrid>(grids_.back()->nx / 2, grids_.back()->nz / 2));
}

// Relaxes from the coarsest grid to the second finest. Blocks where sand moved are awake in the finest.
bool FusionRelaxer::cascade() {
    add_grids();
    for (size_t level = 1; level < grids_.size(); ++level) fusion_coarsen(*grids_[level - 1], *grids_[level]);
    for (size_t level = grids_.size() - 1; level > 0; --level) {
        const double distance = std::ldexp(cell_, int(level));
        const double less = (0.2 + 0.1 * double(level - 1)) * degree; // below repose
        const FusionSlopes slopes = fusion_slopes(repose_, 0.1 * degree - less, -less, distance);
        FusionGrid& grid = *grids_[level];
        for (int sweep = 0; sweep < fusion_coarse_sweeps; ++sweep) {
            if (!fusion_sweep(grid, slopes, false, sweep & 1)) break;
            if (stop()) return false;
        }
        fusion_refine(*grids_[level - 1], grid);
    }
    return true;
}

bool FusionRelaxer::relax(FusionResult& result) {
    const FusionSlopes slopes = fine_slopes();
    if (!fusion_survey(finest(), slopes.trigger).awake) return true;
    size_t work = 0; // blocks that were awake, over all sweeps of the finest grid
    const size_t max_work = std::max(fusion_most_sweeps * finest().blocks(), fusion_smallest_work_limit);
    for (int cycle = 0; cycle < cycles_; ++cycle) {
        if (!cascade()) return false;
        const int sweeps = fusion_cycle_sweeps << std::min(cycle / fusion_doubling_cycles, 20);
        if (work > max_work) break;
        for (int sweep = 0; sweep < sweeps; ++sweep) {
            if (stop()) return false;
            ++result.sweeps;
            work += size_t(std::count(finest().active.begin(), finest().active.end(), char(1)));
            if (!fusion_sweep(finest(), slopes, true, sweep & 1)) return true;
            if (work > max_work) break;
        }
    }
    result.settled = false;
    return true;
}

} // namespace marram
