// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/solver/solver_rows.h"

#include "core/math/simd.h"
#include "procedural/terrain/fields.h"

namespace marram {

MARRAM_HOT void solver_heights(const float* ground, const double* sand, int count, float* height) {
    for (int b = 0; b < count; b += lanes) {
        const VDouble metres = to_double(vload(ground + b)) + vload(sand + b) * (1.0 / sand_units_per_metre);
        vstore(height + b, to_float(metres));
    }
}

MARRAM_HOT void solver_extrapolate(const float* height, const float* before, int columns, float part,
                                   float* out, float& least, float& most) {
    VFloat low = splat_float(least), high = splat_float(most);
    int b = 0;
    for (; b + lanes <= columns; b += lanes) {
        VFloat h = vload(height + b);
        h = h + part * (h - vload(before + b));
        vstore(out + b, h);
        low = vmin(low, h), high = vmax(high, h);
    }
    for (int l = 0; l < lanes; ++l) least = std::min(least, low[l]), most = std::max(most, high[l]);
    for (; b < columns; ++b) {
        out[b] = height[b] + part * (height[b] - before[b]);
        least = std::min(least, out[b]), most = std::max(most, out[b]);
    }
}

MARRAM_HOT void solver_add(const float* a, const float* b, int count, float* out) {
    for (int k = 0; k < count; k += lanes) {
        vstore(out + k, vload(a + k) + vload(b + k));
    }
}

MARRAM_HOT void solver_grow(const float* height, const float* before, const float* most, int count,
                            double gain, double full, double* plant_height, float* plants) {
    for (int b = 0; b < count; b += lanes) {
        const VFloat h = vload(height + b), was = vload(before + b), m = vload(most + b);
        VDouble p = vload(plant_height + b);
        const VFloat moved = h > was ? h - was : was - h;
        p = vmax(p + ((full - p) * gain - to_double(moved)), VDouble{});
        const VDouble share = p * (1.0 / full);
        vstore(plant_height + b, p);
        vstore(plants + b, to_float(to_double(m) * share * share));
    }
}

MARRAM_HOT void solver_weigh(const float* direction, float index, bool first, const float* field, int count,
                             float* sum) {
    for (int b = 0; b < count; b += lanes) {
        const VFloat d = vload(direction + b) - index, away = d < 0.0F ? -d : d;
        const VFloat added = vmax(splat_float(0.0F), 1.0F - away) * vload(field + b);
        vstore(sum + b, first ? added : vload(sum + b) + added);
    }
}

} // namespace marram
