// SPDX-License-Identifier: Apache-2.0
#include "procedural/air/downwind_rays.h"

#include "core/math/vec.h"
#include "procedural/abi/parallel.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

// Interpolates between each value and the next.
MARRAM_HOT void downwind_between(const float* values, float part, int count, float* out) {
    int k = 0;
    for (; k + lanes <= count; k += lanes) {
        const VFloat a = vload(values + k), b = vload(values + k + 1);
        vstore(out + k, a + part * (b - a));
    }
    for (; k < count; ++k) out[k] = values[k] + part * (values[k + 1] - values[k]);
}

} // namespace

DownwindRays::DownwindRays(const DownwindGrid& grid, int lead, int tail)
    : grid_(grid), lead_(grid.periodic ? lead : 0), tail_(grid.periodic ? tail : 0) {
    const int swept = int(std::ceil(std::abs(grid.drift) * (grid.rows - 1)));
    first_column_ = grid.periodic || grid.drift < 0.0 ? 0 : -swept;
    count_ = grid.columns + (grid.periodic ? 0 : swept + 1);
    groups_ = (count_ + width - 1) / width;
}

DownwindRays::Offset DownwindRays::offset(int step) const {
    const double shift = step * grid_.drift, whole = std::floor(shift);
    return {int(whole), float(shift - whole)};
}

void DownwindRays::gather(const float* field, size_t field_pitch, int group, float* samples) const {
    const int rows = grid_.rows, columns = grid_.columns, first = first_column_ + group * width;
    for (int n = 0; n < length(); ++n) {
        const int step = n - lead_;
        const Offset shift = offset(step);
        const int wrapped = grid_.periodic ? ((step % rows) + rows) % rows : step;
        const float* row = field + size_t(grid_.row(wrapped)) * field_pitch;
        float* const out = samples + size_t(n) * width;
        int b = first + shift.whole;
        if (grid_.periodic) b = ((b % columns) + columns) % columns;
        if (b >= 0 && b + width < columns)
            downwind_between(row + b, shift.part, width, out);
        else
            for (int l = 0; l < width; ++l) {
                int c = b + l, d = b + l + 1;
                if (grid_.periodic)
                    c %= columns, d %= columns;
                else
                    c = std::clamp(c, 0, columns - 1), d = std::clamp(d, 0, columns - 1);
                out[l] = row[c] + shift.part * (row[d] - row[c]);
            }
    }
}

void DownwindRays::store(const float* samples, int group, float* rays) const {
    for (int step = 0; step < grid_.rows; ++step)
        std::memcpy(rays + size_t(grid_.row(step)) * pitch() + size_t(group) * width,
                    samples + size_t(step + lead_) * width, width * sizeof(float));
}

void DownwindRays::scatter(const float* rays, float* field, size_t field_pitch) const {
    const int columns = grid_.columns;
    marram::parallel_for(0, grid_.rows, [&](int step) {
        const Offset shift = offset(step);
        const size_t row = size_t(grid_.row(step));
        const float* const from = rays + row * pitch();
        float* const to = field + row * field_pitch;
        if (grid_.periodic) {
            int r = ((-shift.whole % columns) + columns) % columns;
            for (int b = 0; b < columns;) { // runs without wraparound
                const float before = from[r == 0 ? columns - 1 : r - 1];
                to[b] = std::max(from[r] + shift.part * (before - from[r]), 0.0F);
                const int run = std::min(columns - b, columns - r);
                downwind_between(from + r, 1.0F - shift.part, run - 1, to + b + 1);
                b += run;
                r = 0;
            }
        } else
            for (int b = 0; b < columns; ++b) {
                const int r = b - shift.whole - first_column_;
                const float here = r < count_ ? from[r] : 0.0F, before = r > 0 ? from[r - 1] : 0.0F;
                to[b] = here + shift.part * (before - here);
            }
    });
}

} // namespace marram
