// SPDX-License-Identifier: Apache-2.0
// Height, widths and pinch along the curve of a dune: steps 2 to 4 of the model in dune_shape.cpp.
#pragma once

#include "core/math/hash.h"
#include "procedural/terrain/dune/dune_shape.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace marram {

inline constexpr double dune_max_value = 1e6; // of ramps and lengths

// Smooth noise in [-1, 1]. Period `cells`; 0: not periodic.
inline double dune_noise(double position, int64_t cells, uint64_t key) {
    const double cell = std::floor(position), t = position - cell;
    const auto value = [&](int64_t i) {
        if (cells > 0) i = ((i % cells) + cells) % cells;
        return 2.0 * unit_double(hash(key, uint64_t(i))) - 1.0;
    };
    const double a = value(int64_t(cell)), b = value(int64_t(cell) + 1);
    return a + t * t * (3.0 - 2.0 * t) * (b - a);
}

// Height, widths and pinch at a fraction of the length.
struct DuneCurveProfile {
    const DuneSettings& s;
    double length, spacing;
    bool closed;

    double height(double u) const {
        return std::clamp(s.max_height * s.main_curve_shape(u), 0.0, dune_max_value);
    }
    double width(double u, uint64_t side, const Ramp& fall_off, double mult) const {
        const double period = std::max(s.boundary_noise_length, 2.0 * spacing);
        const int64_t cells = closed ? std::max<int64_t>(2, std::llround(length / period)) : 0;
        const double position = closed ? u * double(cells) : u * length / period;
        const double noise = s.boundary_noise * dune_noise(position, cells, hash(s.seed, side));
        return std::clamp((s.slope_width + noise) * fall_off(u) * mult, 0.0, dune_max_value);
    }
    DuneCrestPoint at(const Vec2d& place, double along) const {
        const double u = closed && along >= 1.0 ? 0.0 : along;
        return {place,
                along,
                height(u),
                width(u, 1, s.outer_slope_fall_off_along_curve, s.outer_slope_mult),
                width(u, 2, s.inner_slope_fall_off_along_curve, s.inner_slope_mult),
                std::clamp(s.crest_pinch(u), 0.0, 1e3)};
    }
};

} // namespace marram
