// SPDX-License-Identifier: Apache-2.0
// Rooms: finds samples that walls enclose, joins them to rooms, and fills each room to one level.
#include "procedural/terrain/ruin/ruin_shaper.h"

#include "procedural/abi/parallel.h"
#include "procedural/terrain/ruin/ruin_zones.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr int ruin_directions = 16, ruin_open = 10, ruin_enclosed = 15; // numbers of rays
constexpr double ruin_least_room = 0.25, ruin_tallest_room = 16.0;      // m: wall heights above the sand

// Horizontal directions. The first few are far apart, so that a few rays identify open ground.
const std::array<Vec3d, ruin_directions> ruin_ray_directions = [] {
    std::array<Vec3d, ruin_directions> round;
    for (int n = 0; n < ruin_directions; ++n) {
        const int turn = (n * 7) % ruin_directions;
        const double angle = 2.0 * pi * (turn + ruin_ray_offset) / ruin_directions;
        round[size_t(n)] = Vec3d(std::cos(angle), 0.0, std::sin(angle));
    }
    return round;
}();

} // namespace

// Enclosure of a point, 0 to 1, from the number of rays (of 16) that hit the mesh.
double RuinShaper::around(const Vec2d& p, double y, double reach) const {
    int met = ruin_directions;
    for (const Vec3d& way : ruin_ray_directions)
        if (!mesh_.occluded({p.x(), y, p.y()}, way, reach) && --met <= ruin_open) return 0.0;
    return ruin_smooth(double(met - ruin_open) / (ruin_enclosed - ruin_open));
}

// True if most of the faces hit are front-facing. From inside a solid most would be back-facing.
bool RuinShaper::hits_front_faces(const Vec2d& p, double y, double reach) const {
    int faces = 0;
    for (const Vec3d& way : ruin_ray_directions) {
        const double away = mesh_.first({p.x(), y, p.y()}, way, reach).dot(way);
        faces += int(away < 0.0) - int(away > 0.0);
    }
    return faces > 0;
}

// First tests enclosure near the sand, within the reach of the tallest walls. Then finds the wall height with
// the largest enclosure * height.
RuinRoom RuinShaper::room_at(const Vec2d& p, double ground) const {
    const double top = mesh_.upper().y() - ground;
    RuinRoom best;
    if (!(top > ruin_least_room)) return best;
    const double least = around(p, ground + ruin_least_room, 8.0 * std::min(top, ruin_tallest_room));
    if (!(least > 0.0)) return best;
    for (double h = ruin_tallest_room; h >= ruin_least_room; h *= 0.5) {
        if (!(h < top && h > best.share * best.walls)) continue;
        const double share = std::min(least, around(p, ground + h, 8.0 * h));
        if (share * h > best.share * best.walls && hits_front_faces(p, ground + h, 8.0 * h))
            best = {share, h};
    }
    return best;
}

// Traces one sample in each block of half a metre, and the samples that a wall separates from it.
void RuinShaper::find_rooms() {
    const int side = ruin_block_side(domain_.cell);
    const auto parted = [&](int i, int j, int i1, int j1) { // path along the row, then the column
        for (int x = i; x < i1; ++x)
            if (grid_.wall_x[grid_.at(x, j)]) return true;
        for (int z = j; z < j1; ++z)
            if (grid_.wall_z[grid_.at(i1, z)]) return true;
        return false;
    };
    marram::parallel_for(0, (grid_.nz + side - 1) / side, [&](int row) {
        for (int j = row * side; j < std::min((row + 1) * side, grid_.nz); ++j)
            for (int i = 0; i < grid_.nx; ++i) {
                const size_t k = grid_.at(i, j);
                const Vec2d p = place(i, j);
                if (!near(p, 0.0) || grid_.solid[k]) continue;
                const int i0 = i / side * side, j0 = row * side;
                const size_t first = grid_.at(i0, j0);
                const bool known =
                    k != first && near(place(i0, j0), 0.0) && !grid_.solid[first] && !parted(i0, j0, i, j);
                const RuinRoom room =
                    known ? RuinRoom{grid_.room[first], grid_.walls[first]} : room_at(p, grid_.ground[k]);
                grid_.room[k] = room.share, grid_.walls[k] = room.walls;
            }
    });
}

// Flood fill: all samples of the room that contains `first`.
std::vector<size_t> RuinShaper::flood(size_t first, std::vector<char>& seen) const {
    std::vector<size_t> room{first};
    seen[first] = 1;
    const auto nx = size_t(grid_.nx);
    const auto add = [&](size_t k, char parted) {
        if (parted || seen[k] || !(grid_.room[k] > 0.0)) return;
        seen[k] = 1;
        room.push_back(k);
    };
    for (size_t n = 0; n < room.size(); ++n) {
        const size_t k = room[n], i = k % nx, j = k / nx;
        if (i > 0) add(k - 1, grid_.wall_x[k - 1]);
        if (i + 1 < nx) add(k + 1, grid_.wall_x[k]);
        if (j > 0) add(k - nx, grid_.wall_z[k - nx]);
        if (j + 1 < size_t(grid_.nz)) add(k + nx, grid_.wall_z[k]);
    }
    return room;
}

// The sand level of a room: its mean height plus a fraction of the mean height of its walls.
double RuinShaper::level_of(const std::vector<size_t>& room) const {
    double ground = 0.0, walls = 0.0, sum = 0.0;
    for (const size_t k : room) {
        sum += grid_.room[k];
        ground += grid_.room[k] * grid_.ground[k], walls += grid_.room[k] * grid_.walls[k];
    }
    return (ground + settings_.inside * settings_.drift * walls) / sum;
}

void RuinShaper::fill_rooms(RuinResult& result) {
    if (!(settings_.inside * settings_.drift > 0.0)) return;
    find_rooms();
    std::vector<char> seen(grid_.count());
    std::vector<double>& level = grid_.walls; // reused: sand level * enclosure
    for (size_t k = 0; k < grid_.count(); ++k) {
        if (seen[k] || !(grid_.room[k] > 0.0)) continue;
        const std::vector<size_t> room = flood(k, seen);
        const bool counts = room.size() >= 4; // fewer samples: just a corner
        result.rooms += counts;
        const double rises = level_of(room);
        for (const size_t n : room) {
            if (!counts) grid_.room[n] = 0.0;
            level[n] = grid_.room[n] * rises;
        }
    }
    if (result.rooms == 0) return;
    // Enclosure is quantised by rays and blocks: blur it over half a metre, with at most 64 passes of 3
    // samples.
    const int times = int(std::clamp(0.5 / (domain_.cell * domain_.cell), 1.0, 64.0));
    for (int n = 0; n < times; ++n) smooth_field(grid_.room), smooth_field(level);
    rows([&](int, int, size_t k) {
        const double share = grid_.room[k];
        if (!(share > 0x1p-20)) return; // negligible: a millionth of a deposit
        const double rise = std::max(level[k] / share - grid_.ground[k], 0.0);
        grid_.scour[k] *= 1.0 - share;
        grid_.deposit[k] += share * (rise - grid_.deposit[k]);
    });
}

} // namespace marram
