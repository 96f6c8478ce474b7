// SPDX-License-Identifier: Apache-2.0
// What the dune solver does row by row, eight cells at a time: rows are padded to whole vectors.
#pragma once

#include "procedural/abi/parallel.h"

#include <algorithm>
#include <cstddef>

namespace marram {

inline constexpr size_t solver_slack = 16; // padding after the last row: loaded but without effect

template <typename T, typename U>
void solver_transpose(const T* from, int rows, int columns, size_t from_pitch, U* to, size_t to_pitch) {
    constexpr int side = 16;
    marram::parallel_for(0, (columns + side - 1) / side, [&](int block) {
        const int c1 = std::min((block + 1) * side, columns);
        for (int r0 = 0; r0 < rows; r0 += side)
            for (int c = block * side; c < c1; ++c)
                for (int r = r0; r < std::min(r0 + side, rows); ++r)
                    to[size_t(c) * to_pitch + size_t(r)] = U(from[size_t(r) * from_pitch + size_t(c)]);
    });
}

template <typename T, typename U>
void solver_copy(const T* from, int rows, int columns, size_t from_pitch, U* to, size_t to_pitch) {
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c)
            to[size_t(r) * to_pitch + size_t(c)] = U(from[size_t(r) * from_pitch + size_t(c)]);
}

void solver_heights(const float* ground, const double* sand, int count, float* height);

// height + part (height - before). Extends least and most by its range.
void solver_extrapolate(const float* height, const float* before, int columns, float part, float* out,
                        float& least, float& most);
void solver_add(const float* a, const float* b, int count, float* out);

// Plant height p after a step: p gains the fraction `gain` of the missing height and loses |change of the
// ground|.
void solver_grow(const float* height, const float* before, const float* most, int count, double gain,
                 double full, double* plant_height, float* plants);

// Adds the air of a direction of the wind, weighted by how near each cell's direction is to it.
void solver_weigh(const float* direction, float index, bool first, const float* field, int count, float* sum);

} // namespace marram
