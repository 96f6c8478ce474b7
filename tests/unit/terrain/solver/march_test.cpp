// SPDX-License-Identifier: Apache-2.0
// The march over rows of sand: on periodic ground, strips of columns and their margins change no bit.
#include "procedural/terrain/solver/transport.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace marram {
namespace {

struct Marched {
    std::vector<double> sand, front;
};

// Random fields on periodic ground, all moved by `shift` columns.
Marched march(int rows, int columns, double max_turn, int shift) {
    const auto pitch = size_t(columns + 8) / 8 * 8;
    WideVector<float> flux(pitch * size_t(rows) + 8), relax(flux.size()), turn(flux.size()),
        reach(flux.size());
    WideVector<double> sand(flux.size()), out(flux.size()), front(pitch);
    for (int b = 0; b < columns; ++b) {
        const int to = (b + shift) % columns;
        front[size_t(to)] = std::floor(1e9 * unit_double(hash(1, b)));
        for (int a = 0; a < rows; ++a) {
            const size_t at = size_t(a) * pitch + size_t(to);
            const uint64_t key = hash(uint64_t(a), uint64_t(b));
            flux[at] = float(unit_double(hash(key, 2)));
            relax[at] = float(0.1 + 0.5 * unit_double(hash(key, 3)));
            turn[at] = float(max_turn * (2.0 * unit_double(hash(key, 4)) - 1.0));
            reach[at] = float(0.25 * unit_double(hash(key, 5)));
            sand[at] = key % 3 == 0 ? 0.0 : std::floor(3e8 * unit_double(hash(key, 6)));
        }
    }
    const SaturationFields air = {flux.data(), relax.data(), turn.data(), reach.data()};
    const DownwindGrid course = {rows, columns, true, 1.0, false, 0.5};
    March::Input input;
    input.air = &air, input.sand = sand.data(), input.scale = 1e9, input.turn = max_turn;
    March marcher;
    marcher.run(course, DuneBorder::periodic, input, pitch, front.data(), out.data());
    Marched result;
    for (int b = 0; b < columns; ++b) {
        const auto from = size_t((b + shift) % columns);
        result.front.push_back(front[from]);
        for (int a = 0; a < rows; ++a) result.sand.push_back(out[size_t(a) * pitch + from]);
    }
    return result;
}

// A strip's margin is what the rows of a block can reach: a wrong one shows where strips meet, which is
// elsewhere once the columns have moved.
TEST(DuneMarch, StripsDoNotShow) {
    for (const int columns : {9, 129, 300, 1025})
        for (const double turn : {0.5, 1.0, 2.3, 5.0}) {
            SCOPED_TRACE(testing::Message() << columns << " columns, turns up to " << turn);
            const Marched here = march(40, columns, turn, 0), moved = march(40, columns, turn, 37);
            ASSERT_TRUE(here.sand == moved.sand);
            ASSERT_TRUE(here.front == moved.front);
            ASSERT_GT(*std::max_element(here.front.begin(), here.front.end()), 0.0);
        }
}

} // namespace
} // namespace marram
