// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/fields.h"

#include <array>
#include <cmath>
#include <deque>

namespace marram::bench {
namespace {

constexpr double half_width = 9.0; // m

PlacedField field_of(FieldShape shape) {
    PlacedField field;
    field.shape = shape;
    field.transform = KeyedTransform(
        std::array{1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, half_width, half_width, half_width}, "linear");
    field.ramp = Ramp(std::vector<double>{0, 1, 0.5, 1, 1, 0}, "smooth");
    return field;
}

// Lives as long as the program, as the host's numbers do.
MarramVolume lent_volume(int frames, bool staggered) {
    static std::deque<std::vector<float>> values;
    static std::deque<std::vector<MarramGrid>> grids;
    static std::deque<std::vector<double>> times;
    constexpr uint32_t nx = 128, ny = 64;
    std::vector<MarramGrid>& list = grids.emplace_back();
    std::vector<double>& when = times.emplace_back();
    for (int frame = 1; frame <= frames; ++frame) {
        std::vector<float>& numbers = values.emplace_back(3 * size_t(nx) * ny * nx);
        for (size_t i = 0; i < numbers.size(); ++i)
            numbers[i] = float(3.0 * std::sin(0.01 * double(i) + frame));
        MarramGrid& grid = list.emplace_back();
        grid.name = "vel";
        grid.nx = grid.nz = nx, grid.ny = ny;
        grid.components = 3;
        for (int a = 0; a < 3; ++a) {
            grid.axes[a][a] = 2.0 / (a == 1 ? ny : nx);
            grid.origin[a] = -1.0 + 0.5 * grid.axes[a][a];
        }
        grid.values = numbers.data();
        when.push_back(frame);
    }
    return {sizeof(MarramVolume), uint32_t(frames), sizeof(MarramGrid),
            list.data(),          when.data(),      staggered ? 1U : 0U};
}

} // namespace

PlacedField whirl_field() {
    PlacedField field = field_of(FieldShape::sphere);
    field.swirl = 3.0;
    field.pull = 1.0;
    return field;
}

PlacedField grid_field(int frames, bool staggered) {
    PlacedField field = field_of(FieldShape::grid);
    field.velocities = std::make_shared<const Velocities>(velocities_of(lent_volume(frames, staggered)));
    return field;
}

PlacedField image_field() {
    PlacedField field = field_of(FieldShape::image);
    std::vector<float> pixels(2 * 1024 * 1024);
    for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = float(std::sin(0.02 * double(i)));
    MarramGrid grid{};
    grid.nx = grid.ny = 1024, grid.nz = 1;
    grid.components = 2;
    grid.values = pixels.data();
    field.map = std::make_shared<const PlanMap>(image_map(grid, ""));
    return field;
}

PlacedField curves_field() {
    PlacedField field = field_of(FieldShape::curves);
    DrawnCurve curve;
    for (int i = 0; i <= 40; ++i)
        curve.points.emplace_back(half_width * (0.05 * i - 1.0), 0.0, 2.0 * std::sin(0.3 * i));
    field.reach = 4.0;
    field.map = std::make_shared<const PlanMap>(guide_map(std::array{curve}, field.reach, field.ramp, ""));
    return field;
}

} // namespace marram::bench
