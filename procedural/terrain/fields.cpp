// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/fields.h"

namespace marram {

namespace {

// The sample at or before a coordinate, in cells, clamped to [-1, count] before the cast to int.
int sample_at(double metres, int count) { return int(std::clamp(std::floor(metres), -1.0, double(count))); }

} // namespace

void Tiles::add_box(const Vec2d& lower, const Vec2d& upper) {
    const int i0 = std::max(sample_at((lower.x() - domain_.x0) / domain_.cell, domain_.nx), 0),
              j0 = std::max(sample_at((lower.y() - domain_.z0) / domain_.cell, domain_.nz), 0),
              i1 = std::min(sample_at((upper.x() - domain_.x0) / domain_.cell, domain_.nx) + 1,
                            domain_.nx - 1),
              j1 = std::min(sample_at((upper.y() - domain_.z0) / domain_.cell, domain_.nz) + 1,
                            domain_.nz - 1);
    if (i0 > i1 || j0 > j1) return;
    for (int row = j0 / side; row <= j1 / side; ++row)
        for (int column = i0 / side; column <= i1 / side; ++column) add(column, row);
}

Tiles Tiles::grown(double metres) const {
    if (none()) return *this;
    if (!std::isfinite(metres)) return Tiles(domain_, true);
    const double wide = std::ceil(metres / (side * domain_.cell));
    const int by = int(std::min(wide, double(std::max(columns_, rows_))));
    Tiles result = *this;
    for (int row = 0; row < rows_; ++row)
        for (int column = 0; column < columns_; ++column) {
            if (!has(column, row)) continue;
            for (int r = std::max(row - by, 0); r <= std::min(row + by, rows_ - 1); ++r)
                for (int c = std::max(column - by, 0); c <= std::min(column + by, columns_ - 1); ++c)
                    result.add(c, r);
        }
    return result;
}

std::vector<Rect> Tiles::rects() const {
    std::vector<Rect> list;
    for (int row = 0; row < rows_; ++row)
        for (int column = 0; column < columns_; ++column)
            if (has(column, row)) list.push_back(rect(column, row));
    return list;
}

} // namespace marram
