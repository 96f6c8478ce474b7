// SPDX-License-Identifier: Apache-2.0
// Random numbers and the rotation that the files of the mass desert share.
#pragma once

#include "core/math/hash.h"
#include "core/math/vec.h"

namespace marram {

// Keys of the random numbers of one dune.
enum class MassRandomKey : uint64_t {
    place_x,
    place_z,
    spacing,
    priority,
    density,
    height,
    angle, // 4
    cover = angle + 4,
    variability,
    length,
    wave,             // 8
    crest = wave + 8, // heights along the crest, 16
    arm = crest + 16, // 16
    noise = arm + 16,
    row,
    stagger
};

// The random numbers of one dune or cell.
struct MassHash {
    uint64_t word;
    double operator()(MassRandomKey use, int more = 0) const { // in [0, 1)
        return unit_double(hash(word, uint64_t(use) + uint64_t(more)));
    }
    double in(const Vec2d& range, MassRandomKey use) const {
        return range.x() + (range.y() - range.x()) * (*this)(use);
    }
    double jitter(MassRandomKey use, int more = 0) const { return 2.0 * (*this)(use, more) - 1.0; }
    // Approximately normal: mean 0, variance 1, bounded by 3.5 (sum of four uniform numbers).
    double normal(MassRandomKey use) const {
        double sum = -2.0;
        for (int i = 0; i < 4; ++i) sum += (*this)(use, i);
        return sum * std::sqrt(3.0);
    }
};

// `v` turned by `angle`: radians, from the first axis to the second.
inline Vec2d mass_turned(const Vec2d& v, double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

} // namespace marram
