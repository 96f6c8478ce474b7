// SPDX-License-Identifier: Apache-2.0
// Damps checkerboard patterns under oblique winds.
//
// Grains that roll down across the wind level grooves along it (transport.cpp). With wind at 45 degrees to
// the grid the narrowest grooves form a checkerboard. Streamlines run between its diagonals and pass high and
// low samples in turn, so the flux does not resolve them and nothing levels them. This stage applies the same
// physics: a bed of height h and flux q spreads across the wind as
//
//   dh/dt = side_slope q / rho_b d2h/dy2,  the checkerboard (k = sqrt(2) pi / cell) at the rate  2 pi^2 side_slope q / (rho_b cell^2)
//
// The saddle of a quad of four samples a, b (row i), c, d (row i + 1) is s = (a - b - c + d) / 4. A fraction
// of it moves from a to b and from d to c. A sample belongs to four quads. On a smooth surface this is a
// fourth-order difference, cell^4 d4h/dx2dy2: second order in the cell at the rate above. It is weighted by
// the square of the drift (columns per row), 1 at 45 degrees. Moves are whole units and at most a quarter of
// a sample's sand.
//
// Cost: part of `march` in build/marram_bench; nothing for winds along the grid.
#include "procedural/terrain/solver/checkerboard.h"

#include "core/math/simd.h"
#include "procedural/abi/parallel.h"

#include <tbb/enumerable_thread_specific.h>

#include <array>
#include <cstring>

namespace marram {
namespace {

constexpr int checker_pad = 8;   // elements before and after a row
constexpr int checker_band = 16; // rows per task

struct CheckerRow {
    WideVector<double> height, sand; // units; one extra sample before the first and after the last
    WideVector<double> flux;
};

MARRAM_HOT void checker_fill(const float* ground, const float* flux, const double* sand, int columns,
                             CheckerRow& row) {
    double *const h = row.height.data() + checker_pad, *const s = row.sand.data() + checker_pad,
                  *const f = row.flux.data() + checker_pad;
    for (int b = 0; b < columns; ++b) {
        s[b] = sand[b];
        h[b] = double(ground[b]) * sand_units_per_metre + sand[b];
        f[b] = double(flux[b]);
    }
    for (double* field : {h, s, f}) field[-1] = field[columns - 1], field[columns] = field[0];
}

// The moves of the quads between columns q - 1 and q, q = 0 ... count - 1, of two rows.
MARRAM_HOT void checker_moves(const CheckerRow& upper, const CheckerRow& lower, int count, double part,
                              double* moves) {
    const double *const hu = upper.height.data() + checker_pad, *const hl = lower.height.data() + checker_pad;
    const double *const su = upper.sand.data() + checker_pad, *const sl = lower.sand.data() + checker_pad;
    const double *const fu = upper.flux.data() + checker_pad, *const fl = lower.flux.data() + checker_pad;
    const VDouble none{};
    for (int q = 0; q < count; q += lanes) {
        const VDouble saddle =
            0.25 * ((vload(hu + q - 1) - vload(hu + q)) - (vload(hl + q - 1) - vload(hl + q)));
        const VDouble flux =
            0.25 * ((vload(fu + q - 1) + vload(fu + q)) + (vload(fl + q - 1) + vload(fl + q)));
        const VDouble share = vmin(part * flux, none + 0.125);
        const VDouble down = 0.25 * vmin(vload(su + q - 1), vload(sl + q)); // limit of a and d
        const VDouble up = 0.25 * vmin(vload(su + q), vload(sl + q - 1));   // limit of b and c
        const VDouble most = select(saddle > none, down, up), size = select(saddle > none, saddle, -saddle);
        const VDouble wanted = vmin(share * size, most);
        const VDouble moved = vfloor(wanted);
        vstore(moves + q, select(saddle > none, moved, -moved));
    }
}

MARRAM_HOT void checker_gather(const double* sand, const double* up, const double* down, int count,
                               double* out) {
    for (int b = 0; b < count; b += lanes) {
        const VDouble sum = (vload(down + b) - vload(down + b + 1)) + (vload(up + b + 1) - vload(up + b));
        const VDouble next = vload(sand + b) + sum;
        vstore(out + b, next);
    }
}

struct CheckerScratch {
    std::array<CheckerRow, 3> rows;
    WideVector<double> up, down, out;
};

} // namespace

void damp_checkerboard(int rows, int columns, bool periodic, double part, const float* ground,
                       const float* flux, const double* sand, size_t pitch, double* sand_out) {
    const size_t room = size_t(columns) + 4 * checker_pad;
    tbb::enumerable_thread_specific<CheckerScratch> scratches;
    marram::parallel_for(0, (rows + checker_band - 1) / checker_band, [&](int band) {
        CheckerScratch& mine = scratches.local();
        for (CheckerRow& row : mine.rows)
            row.height.resize(room), row.sand.resize(room), row.flux.resize(room);
        for (WideVector<double>* line : {&mine.up, &mine.down, &mine.out}) line->resize(room);
        const auto line = [&](int n) -> CheckerRow& { return mine.rows[size_t((n + 3) % 3)]; };
        const auto fill = [&](int n) {
            const size_t at = size_t((n + rows) % rows) * pitch;
            checker_fill(ground + at, flux + at, sand + at, columns, line(n));
        };
        const auto moves = [&](int n, WideVector<double>& out) { // quads between rows n and n + 1
            if (!periodic && (n < 0 || n + 1 == rows)) {
                std::fill(out.begin(), out.end(), 0.0);
                return;
            }
            checker_moves(line(n), line(n + 1), columns + 1, part, out.data());
            if (!periodic) out[0] = out[size_t(columns)] = 0.0;
        };
        const int r0 = band * checker_band, r1 = std::min(r0 + checker_band, rows);
        fill(r0 - 1), fill(r0);
        moves(r0 - 1, mine.up);
        for (int r = r0; r < r1; ++r) {
            fill(r + 1);
            moves(r, mine.down);
            checker_gather(line(r).sand.data() + checker_pad, mine.up.data(), mine.down.data(), columns,
                           mine.out.data());
            std::memcpy(sand_out + size_t(r) * pitch, mine.out.data(), size_t(columns) * sizeof(double));
            mine.up.swap(mine.down);
        }
    });
}

} // namespace marram
