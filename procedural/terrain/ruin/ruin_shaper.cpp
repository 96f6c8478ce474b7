// SPDX-License-Identifier: Apache-2.0
// Scour and deposits on the grid: read from the zones of the faces, then limited in slope and smoothed. Walls
// between samples stop both.
#include "procedural/terrain/ruin/ruin_shaper.h"

#include "procedural/terrain/ruin/ruin_cones.h"
#include "procedural/terrain/ruin/ruin_zones.h"

#include <algorithm>
#include <utility>

namespace marram {

void RuinShaper::read(const RuinLines& lines) {
    const RuinZones zones(settings_, domain_.cell);
    rows([&](int i, int j, size_t k) {
        const size_t sample = domain_.index(grid_.rect.i0 + i, grid_.rect.j0 + j);
        const Vec2d p = place(i, j);
        const RuinShape shape = ruin_between_lines(lines, zones, p.x(), p.y());
        grid_.ground[k] = below_.height(sample);
        grid_.scour[k] = std::min(shape.scour, sand_metres(below_.sand[sample]));
        grid_.deposit[k] = shape.deposit;
    });
}

bool RuinShaper::wall(const Vec2d& p, const Vec2d& q, double y) const {
    const Vec2d way = q - p;
    const double length = way.norm();
    return mesh_.occluded({p.x(), y, p.y()}, {way.x() / length, 0.0, way.y() / length}, length);
}

// True if a point is inside a solid: rays upwards and downwind both have more exits than entries.
bool RuinShaper::within(const Vec2d& p, double y) const {
    static thread_local std::vector<RuinMesh::Hit> found;
    for (const Vec3d& way : {Vec3d(0.0, 1.0, 0.0), Vec3d(1.0, 0.0, 0.0)}) {
        mesh_.hits({p.x(), y, p.y()}, way, ruin_farthest, found);
        int left = 0;
        for (const RuinMesh::Hit& hit : found) left += hit.normal.dot(way) > 0.0 ? 1 : -1;
        if (left <= 0) return false;
    }
    return true;
}

// Tests for walls between neighbouring samples, a tenth of a cell above the higher one.
void RuinShaper::find_walls() {
    const double above = 0.1 * domain_.cell;
    rows([&](int i, int j, size_t k) {
        const Vec2d p = place(i, j);
        grid_.solid[k] = near(p, 0.0) && within(p, grid_.ground[k] + above);
    });
    rows([&](int i, int j, size_t k) {
        const Vec2d p = place(i, j);
        if (!near(p, 2.0 * domain_.cell)) return;
        const auto look = [&](int i1, int j1, std::vector<char>& walls) {
            if (i1 >= grid_.nx || j1 >= grid_.nz) return;
            const size_t n = grid_.at(i1, j1);
            walls[k] = grid_.solid[k] || grid_.solid[n] ||
                       wall(p, place(i1, j1), std::max(grid_.ground[k], grid_.ground[n]) + above);
        };
        look(i + 1, j, grid_.wall_x);
        look(i, j + 1, grid_.wall_z);
    });
}

// Lets sand at the rim of the scour slide into the pit.
void RuinShaper::collapse_pit_rim() {
    rows([&](int i, int j, size_t k) {
        const size_t sample = domain_.index(grid_.rect.i0 + i, grid_.rect.j0 + j);
        grid_.cap[k] = grid_.ground[k];
        grid_.floor[k] = grid_.ground[k] - sand_metres(below_.sand[sample]);
        grid_.level[k] = grid_.scour[k] > 0.0 ? grid_.ground[k] - grid_.scour[k] : infinity;
    });
    RuinCones(grid_, ruin_slope * domain_.cell).settle();
    rows([&](int, int, size_t k) { grid_.scour[k] = std::max(grid_.ground[k] - grid_.level[k], 0.0); });
    smooth_field(grid_.scour);
    rows([&](int, int, size_t k) {
        grid_.scour[k] = std::min(grid_.scour[k], grid_.ground[k] - grid_.floor[k]);
    });
}

// Smooths with weights 1, 2, 1 along rows and then columns, but not across walls. Without it triangles at the
// tips and creases of cones would be up to sqrt(2) times as steep as the cones.
void RuinShaper::smooth_field(std::vector<double>& field) {
    const auto pass = [&](size_t stride, const std::vector<char>& walls, auto&& inner) {
        std::copy(field.begin(), field.end(), grid_.level.begin());
        rows([&](int i, int j, size_t k) {
            const auto [has_before, has_after] = inner(i, j);
            const double own = grid_.level[k];
            const double before = has_before && !walls[k - stride] ? grid_.level[k - stride] : own;
            const double after = has_after && !walls[k] ? grid_.level[k + stride] : own;
            field[k] = 0.25 * before + 0.5 * own + 0.25 * after;
        });
    };
    pass(1, grid_.wall_x, [&](int i, int) { return std::pair(i > 0, i + 1 < grid_.nx); });
    pass(size_t(grid_.nx), grid_.wall_z, [&](int, int j) { return std::pair(j > 0, j + 1 < grid_.nz); });
}

// Limits deposits to the angle of repose.
void RuinShaper::limit_deposit_slope() {
    rows([&](int, int, size_t k) {
        grid_.floor[k] = grid_.ground[k] - grid_.scour[k];
        grid_.cap[k] = infinity;
        grid_.level[k] = grid_.floor[k] + grid_.deposit[k];
    });
    RuinCones(grid_, ruin_slope * domain_.cell).settle();
    rows([&](int, int, size_t k) { grid_.deposit[k] = grid_.level[k] - grid_.floor[k]; });
    smooth_field(grid_.deposit);
}

bool RuinShaper::shape(RuinResult& result, const std::function<bool()>& cancelled) {
    const auto stop = [&] { return cancelled && cancelled(); };
    RuinLines lines = ruin_find_faces(mesh_, domain_, below_);
    if (stop()) return false;
    for (const RuinLine& line : lines.lines) {
        result.windward += int(line.windward.size());
        result.lee += int(line.lee.size());
    }
    read(lines);
    find_walls();
    if (stop()) return false;
    fill_rooms(result);
    if (stop()) return false;
    collapse_pit_rim();
    if (stop()) return false;
    limit_deposit_slope();
    return !stop();
}

} // namespace marram
