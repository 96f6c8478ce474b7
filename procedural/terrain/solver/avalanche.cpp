// SPDX-License-Identifier: Apache-2.0
// Avalanches on slip faces: sand steeper than the static angle of repose slides until it is at the dynamic
// one.
//
// The slope is that of a quad of four samples a, b (row i), c, d (row i + 1): g_b = (b - a + d - c) / 2, g_a
// = (c - a + d - b) / 2. This gradient has no preferred grid direction. Where it is too steep, sand moves
// from d to a and from c to b,
//
//   d1 = w (1 - tan(stops) / |g|) (g_b + g_a) / 2,  d2 = w (1 - tan(stops) / |g|) (g_a - g_b) / 2
//
// which removes the fraction w of the excess along the gradient. All quads move at once. A sample belongs to
// four quads; on a uniform slope neighbouring moves add up to a diffusion with number w, stable below 1 / 2;
// w = 0.4. Moves are whole units and at most a quarter of a sample's sand, so no sand becomes negative.
//
// Walls. A sample whose ground stands more than a cell (45 degrees, or the angle of repose) above the surface
// of another sample of its quad is a wall: its height is no slope of the sand below. Sand on a wall falls to
// the sample opposite, if that is lower. Beside one wall the two samples that are opposite each other move by
// the slope of the plane through the three that are no walls. Nothing else moves in such a quad, and a sample
// with less sand than the diameter of a grain gives none: dust on walls would keep tiles awake.
//
// Tiles of 32 x 32 quads sleep. A tile wakes if one of its quads exceeds the static angle or a neighbouring
// tile moved sand. In an awake tile all quads above the dynamic angle plus 0.1 degrees move towards the
// dynamic angle. (Without that slack they would converge unit by unit.) Sweeps end when all tiles sleep, or
// after `max_sweeps`; the rest is left for the next time step. Sand supplied at the top of a face of n cells
// needs n^2 / 10 sweeps to reach its foot. Under steady supply this does not matter: the face is slightly
// steeper, in proportion to the supply, by half a degree at the longest stable time step.
//
// Threads: first all moves are computed, then each sample gathers those of its four quads.
// Cost: 1 ns a cell to find steep quads (one core); 8 ns a sweep and cell of awake tiles.
#include "procedural/terrain/solver/avalanche.h"

#include "procedural/abi/parallel.h"
#include "procedural/terrain/fields.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

constexpr int avalanche_side = 32;     // quads along a tile's side
constexpr double avalanche_rate = 0.4; // w
constexpr double avalanche_slack = 0.1 * degree;
constexpr double avalanche_grain = 0x1p-12 * sand_units_per_metre; // 0.24 mm

// Sets tiles[] where a quad between two rows is too steep. `limit`: square of twice the height difference.
MARRAM_HOT void avalanche_scan(const float* upper, const float* lower, int quads, float limit, char* tiles) {
    for (int b = 0; b < quads; b += lanes) {
        const VFloat a = vload(upper + b), next = vload(upper + b + 1);
        const VFloat c = vload(lower + b), beside = vload(lower + b + 1);
        const VFloat gb = (next - a) + (beside - c), ga = (c - a) + (beside - next);
        const VInt steep = gb * gb + ga * ga > limit; // both are twice the difference
        int any = 0;
        for (int l = 0; l < lanes; ++l) any |= b + l < quads ? steep[l] : 0;
        if (any) tiles[b / avalanche_side] = 1;
    }
}

struct AvalancheGrid {
    int rows, columns, quad_rows, quad_columns, tile_rows, tile_columns;
    bool periodic;
    size_t pitch;

    int row(int i) const { return i >= rows ? i - rows : i; }
    int column(int j) const { return j >= columns ? j - columns : j; }
    size_t tile(int i, int j) const { return size_t(i) * size_t(tile_columns) + size_t(j); }
    size_t tiles() const { return size_t(tile_rows) * size_t(tile_columns); }
};

constexpr size_t avalanche_slot = size_t(2) * avalanche_side * avalanche_side; // doubles

// Units that a sample beside a wall, or on it, gives at most.
double avalanche_most(double sand) { return sand < avalanche_grain ? 0.0 : 0.25 * sand; }

struct AvalancheMoves {
    double d1, d2; // from d to a, from c to b
};

// The moves of a quad some of whose samples are walls. Order: a, b, c, d; k and 3 - k are opposite each
// other.
AvalancheMoves avalanche_beside_walls(const std::array<double, 4>& sand, const std::array<double, 4>& height,
                                      const std::array<bool, 4>& wall, double stops, double still) {
    const auto falls = [&](size_t to, size_t from) {
        if (wall[from] == wall[to] || wall[from] != (height[from] > height[to])) return 0.0;
        return wall[from] ? avalanche_most(sand[from]) : -avalanche_most(sand[to]);
    };
    AvalancheMoves moves = {std::trunc(falls(0, 3)), std::trunc(falls(1, 2))};
    if (std::count(wall.begin(), wall.end(), true) != 1) return moves;
    const auto k = size_t(std::find(wall.begin(), wall.end(), true) - wall.begin());
    const size_t to = k == 0 || k == 3 ? 1 : 0, from = 3 - to; // the pair beside the wall
    const double slope = std::hypot(height[3 - k] - height[to], height[3 - k] - height[from]);
    if (!(slope > still)) return moves;
    const double move = 0.5 * avalanche_rate * (1.0 - stops / slope) * (height[from] - height[to]);
    (to == 0 ? moves.d1 : moves.d2) =
        std::trunc(std::clamp(move, -avalanche_most(sand[to]), avalanche_most(sand[from])));
    return moves;
}

// Computes the moves of all quads of a tile. Returns false if all are 0.
bool avalanche_moves(const AvalancheGrid& grid, int tile_row, int tile_column, double stops, double still,
                     double steepest, const float* ground, const double* sand, double* moves) {
    bool any = false;
    const int i0 = tile_row * avalanche_side, j0 = tile_column * avalanche_side;
    const int i1 = std::min(i0 + avalanche_side, grid.quad_rows),
              j1 = std::min(j0 + avalanche_side, grid.quad_columns);
    std::fill_n(moves, avalanche_slot, 0.0);
    for (int i = i0; i < i1; ++i) {
        const size_t upper = size_t(i) * grid.pitch, lower = size_t(grid.row(i + 1)) * grid.pitch;
        for (int j = j0; j < j1; ++j) {
            const size_t next = size_t(grid.column(j + 1)), here = size_t(j);
            const double sa = sand[upper + here], sb = sand[upper + next], sc = sand[lower + here],
                         sd = sand[lower + next];
            const double a = double(ground[upper + here]) * sand_units_per_metre + sa,
                         b = double(ground[upper + next]) * sand_units_per_metre + sb,
                         c = double(ground[lower + here]) * sand_units_per_metre + sc,
                         d = double(ground[lower + next]) * sand_units_per_metre + sd;
            const double gb = 0.5 * ((b - a) + (d - c)), ga = 0.5 * ((c - a) + (d - b));
            const double square = gb * gb + ga * ga;
            if (!(square > still * still)) continue;
            AvalancheMoves found{};
            const double wall = std::min({a, b, c, d}) + steepest; // ground above it is a wall
            if (std::max({a - sa, b - sb, c - sc, d - sd}) > wall)
                found = avalanche_beside_walls({sa, sb, sc, sd}, {a, b, c, d},
                                               {a - sa > wall, b - sb > wall, c - sc > wall, d - sd > wall},
                                               stops, still);
            else {
                const double k = 0.5 * avalanche_rate * (1.0 - stops / std::sqrt(square));
                found = {std::trunc(std::clamp(k * (gb + ga), -0.25 * sa, 0.25 * sd)),
                         std::trunc(std::clamp(k * (ga - gb), -0.25 * sb, 0.25 * sc))};
            }
            const auto [d1, d2] = found;
            double* const move = moves + 2 * (size_t(i - i0) * avalanche_side + size_t(j - j0));
            move[0] = d1, move[1] = d2;
            any = any || d1 != 0.0 || d2 != 0.0;
        }
    }
    return any;
}

// Runs work(k) for each tile; few tiles are done faster without threads.
template <typename F>
void avalanche_each(size_t count, F&& work) {
    if (count >= 16)
        marram::parallel_for(size_t(0), count, work);
    else
        for (size_t k = 0; k < count; ++k) work(k);
}

} // namespace

int Avalanche::run(int rows, int columns, bool periodic, double cell, const AvalancheSettings& settings,
                   const float* ground, double* sand, float* height, size_t pitch) {
    AvalancheGrid grid{};
    grid.rows = rows, grid.columns = columns, grid.periodic = periodic, grid.pitch = pitch;
    grid.quad_rows = periodic ? rows : rows - 1, grid.quad_columns = periodic ? columns : columns - 1;
    if (grid.quad_rows <= 0 || grid.quad_columns <= 0) return 0;
    grid.tile_rows = (grid.quad_rows + avalanche_side - 1) / avalanche_side;
    grid.tile_columns = (grid.quad_columns + avalanche_side - 1) / avalanche_side;
    // Samples beyond the last quad (non-periodic borders) are in no tile; the gather below adds them to the
    // last one.

    std::vector<char> awake(grid.tiles(), 0);
    const double start = 2.0 * std::tan(settings.starts) * cell;
    marram::parallel_for(0, grid.tile_rows, [&](int t) {
        char* const flags = awake.data() + grid.tile(t, 0);
        for (int i = t * avalanche_side; i < std::min((t + 1) * avalanche_side, grid.quad_rows); ++i) {
            float* const upper = height + size_t(i) * pitch;
            float* const lower = height + size_t(grid.row(i + 1)) * pitch;
            avalanche_scan(upper, lower, columns - 1, float(start * start), flags);
            if (!periodic) continue;
            const float a = upper[columns - 1], b = upper[0], c = lower[columns - 1], d = lower[0];
            const float gb = (b - a) + (d - c), ga = (c - a) + (d - b);
            if (gb * gb + ga * ga > float(start * start)) flags[grid.tile_columns - 1] = 1;
        }
    });

    const double stops = std::tan(settings.stops) * cell * sand_units_per_metre;
    const double steepest = std::max(1.0, std::tan(settings.starts)) * cell * sand_units_per_metre;
    const double still = std::tan(settings.stops + avalanche_slack) * cell * sand_units_per_metre;
    std::vector<int> slots(grid.tiles(), -1);
    std::vector<int> list, gathered;
    std::vector<char> moved, touched(grid.tiles());
    int sweep = 0;
    for (; sweep < settings.max_sweeps; ++sweep) {
        list.clear();
        for (size_t t = 0; t < awake.size(); ++t) {
            slots[t] = awake[t] ? int(list.size()) : -1;
            if (awake[t]) list.push_back(int(t));
        }
        if (list.empty()) break;
        if (moves_.size() < list.size() * avalanche_slot) moves_.resize(list.size() * avalanche_slot);
        moved.assign(list.size(), 0);
        avalanche_each(list.size(), [&](size_t slot) {
            const int tile = list[slot];
            moved[slot] =
                char(avalanche_moves(grid, tile / grid.tile_columns, tile % grid.tile_columns, stops, still,
                                     steepest, ground, sand, moves_.data() + slot * avalanche_slot));
        });
        // A tile's quads extend one sample into the next tiles.
        std::fill(touched.begin(), touched.end(), char(0));
        std::fill(awake.begin(), awake.end(), char(0));
        const auto wrap = [&](int k, int count) { return periodic ? (k + count) % count : k; };
        for (size_t slot = 0; slot < list.size(); ++slot) {
            if (!moved[slot]) {
                slots[size_t(list[slot])] = -1;
                continue;
            }
            const int ti = list[slot] / grid.tile_columns, tj = list[slot] % grid.tile_columns;
            for (int di = -1; di <= 1; ++di)
                for (int dj = -1; dj <= 1; ++dj) {
                    const int i = wrap(ti + di, grid.tile_rows), j = wrap(tj + dj, grid.tile_columns);
                    if (i < 0 || j < 0 || i >= grid.tile_rows || j >= grid.tile_columns) continue;
                    awake[grid.tile(i, j)] = 1;
                    if (di >= 0 && dj >= 0) touched[grid.tile(i, j)] = 1;
                }
        }
        gathered.clear();
        for (size_t t = 0; t < touched.size(); ++t)
            if (touched[t]) gathered.push_back(int(t));
        const auto quad = [&](int i, int j) -> const double* {
            if (periodic)
                i = i < 0 ? i + rows : i, j = j < 0 ? j + columns : j;
            else if (i < 0 || j < 0 || i >= grid.quad_rows || j >= grid.quad_columns)
                return nullptr;
            const int slot = slots[grid.tile(i / avalanche_side, j / avalanche_side)];
            return slot < 0
                       ? nullptr
                       : moves_.data() + size_t(slot) * avalanche_slot +
                             2 * (size_t(i % avalanche_side) * avalanche_side + size_t(j % avalanche_side));
        };
        avalanche_each(gathered.size(), [&](size_t n) {
            const int ti = gathered[n] / grid.tile_columns, tj = gathered[n] % grid.tile_columns;
            const int i1 = ti + 1 == grid.tile_rows ? rows : (ti + 1) * avalanche_side;
            const int j1 = tj + 1 == grid.tile_columns ? columns : (tj + 1) * avalanche_side;
            for (int i = ti * avalanche_side; i < i1; ++i)
                for (int j = tj * avalanche_side; j < j1; ++j) {
                    double sum = 0.0;
                    if (const double* q = quad(i, j)) sum += q[0];
                    if (const double* q = quad(i, j - 1)) sum += q[1];
                    if (const double* q = quad(i - 1, j)) sum -= q[1];
                    if (const double* q = quad(i - 1, j - 1)) sum -= q[0];
                    if (sum == 0.0) continue;
                    const size_t at = size_t(i) * pitch + size_t(j);
                    sand[at] += sum;
                    height[at] = float(double(ground[at]) + sand[at] * (1.0 / sand_units_per_metre));
                }
        });
    }
    return sweep;
}

} // namespace marram
