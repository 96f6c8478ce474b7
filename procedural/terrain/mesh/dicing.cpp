// SPDX-License-Identifier: Apache-2.0
// dicing: subdivides the triangles of a render mesh near the camera.
//
// Each round splits every side that is too long at its midpoint: a triangle with one, two or three such sides
// becomes two, three or four. The test depends only on the side's ends, so both adjacent triangles agree and
// no cracks appear, in any order.
//
// A side of length l is too long if l > max(side, pixel_angle d), where d is the distance from the nearest
// camera to the ball around its midpoint with radius 0.87 l, and that ball overlaps the region. A triangle
// lies entirely in the ball of its longest side (the third corner is at most sqrt(3)/2 of that side from its
// midpoint). So every triangle that overlaps the region is found, even if its corners are far outside, as on
// level ground.
//
// Cost: about 0.5 us a triangle, one thread.
#include "procedural/terrain/mesh/dicing.h"

#include "core/math/hash.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr double dicing_margin = 10.0 * degree; // displacement fades out over this angle outside the film

double dicing_step(double t) {
    t = std::clamp(t, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// Angle between two directions; the second has unit length. 0 if the first is the zero vector.
double dicing_angle(const Vec3d& way, const Vec3d& forward) {
    return std::atan2(way.cross(forward).norm(), way.dot(forward));
}

bool too_long(const DisplacedRegion& region, const Vec3d& a, const Vec3d& b) {
    const double length = (a - b).norm(), radius = 0.5 * std::sqrt(3.0) * length;
    if (!(length > region.side)) return false;
    const Vec3d middle = 0.5 * (a + b);
    for (const DisplacedRegion::Camera& camera : region.cameras) {
        const Vec3d way = middle - camera.position;
        const double distance = way.norm(), nearest = std::max(distance - radius, 0.0);
        if (!(nearest < region.reach) || !(length > region.pixel_angle * nearest)) continue;
        if (nearest == 0.0) return true;
        const double wide = std::asin(std::min(radius / distance, 1.0));
        if (dicing_angle(way, camera.forward) < region.corner + dicing_margin + wide) return true;
    }
    return false;
}

// Hash map from a side's two vertices to its midpoint, for one round.
class Midpoints {
  public:
    explicit Midpoints(size_t sides) {
        size_t size = 16;
        while (size < 2 * sides) size *= 2;
        keys_.assign(size, none);
        values_.resize(size);
    }
    // The midpoint vertex of side (a, b). Inserts `next` if there is none yet.
    uint32_t at(uint32_t a, uint32_t b, uint32_t next) {
        const uint64_t key = uint64_t(std::min(a, b)) << 32 | std::max(a, b);
        size_t slot = size_t(hash(key, 0)) & (keys_.size() - 1);
        while (keys_[slot] != none && keys_[slot] != key) slot = (slot + 1) & (keys_.size() - 1);
        if (keys_[slot] == none) keys_[slot] = key, values_[slot] = next;
        return values_[slot];
    }

  private:
    static constexpr uint64_t none = ~uint64_t(0);
    std::vector<uint64_t> keys_;
    std::vector<uint32_t> values_;
};

using DicedTriangle = std::array<uint32_t, 3>;

// Returns false if there would be more than `most` triangles.
bool dice_within(std::span<const Vec3d> given, std::span<const uint32_t> triangles,
                 const DisplacedRegion& region, size_t most, DicedMesh& out) {
    std::vector<Vec3d> positions(given.begin(), given.end());
    out.first = uint32_t(given.size());
    out.midpoints.clear();
    out.triangles.clear();
    out.reach = region.reach;
    std::vector<DicedTriangle> active, next;
    active.reserve(triangles.size() / 3);
    for (size_t t = 0; t + 2 < triangles.size(); t += 3)
        active.push_back({triangles[t], triangles[t + 1], triangles[t + 2]});
    std::vector<uint8_t> cuts;
    while (!active.empty()) {
        cuts.assign(active.size(), 0);
        size_t sides = 0;
        for (size_t t = 0; t < active.size(); ++t)
            for (unsigned k = 0; k < 3; ++k)
                if (too_long(region, positions[active[t][k]], positions[active[t][(k + 1) % 3]]))
                    cuts[t] = uint8_t(cuts[t] | 1U << k), ++sides;
        if (out.triangles.size() / 3 + active.size() + sides > most) return false;
        Midpoints midpoints(sides);
        const auto middle = [&](uint32_t a, uint32_t b) {
            const uint32_t vertex = midpoints.at(a, b, uint32_t(positions.size()));
            if (vertex == positions.size()) {
                const uint32_t low = std::min(a, b), high = std::max(a, b);
                out.midpoints.push_back({low, high});
                positions.push_back(0.5 * (positions[low] + positions[high]));
            }
            return vertex;
        };
        next.clear();
        for (size_t t = 0; t < active.size(); ++t) {
            const unsigned cut = cuts[t];
            if (cut == 0) {
                out.triangles.insert(out.triangles.end(), active[t].begin(), active[t].end());
                continue;
            }
            // Rotate the triangle: one split side becomes side 0, two become sides 0 and 1.
            unsigned turn = 0;
            while (cut != 7 && !((cut >> turn & 1U) && !(cut >> ((turn + 2) % 3) & 1U))) ++turn;
            const uint32_t a = active[t][turn], b = active[t][(turn + 1) % 3], c = active[t][(turn + 2) % 3];
            const uint32_t ab = middle(a, b);
            if (cut == 7) {
                const uint32_t bc = middle(b, c), ca = middle(c, a);
                next.insert(next.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
            } else if (cut >> ((turn + 1) % 3) & 1U) {
                const uint32_t bc = middle(b, c);
                next.push_back({ab, b, bc});
                // Split the quad a, ab, bc, c along its shorter diagonal.
                if ((positions[a] - positions[bc]).squaredNorm() <=
                    (positions[ab] - positions[c]).squaredNorm())
                    next.insert(next.end(), {{a, ab, bc}, {a, bc, c}});
                else
                    next.insert(next.end(), {{a, ab, c}, {ab, bc, c}});
            } else {
                next.insert(next.end(), {{a, ab, c}, {ab, b, c}});
            }
        }
        std::swap(active, next);
    }
    return true;
}

} // namespace

double DisplacedRegion::share(const Vec3d& p) const {
    double most = 0.0;
    for (const Camera& camera : cameras) {
        const Vec3d way = p - camera.position;
        const double near = dicing_step(2.0 - 2.0 * way.norm() / reach);
        if (!(near > most)) continue;
        const double outside = dicing_angle(way, camera.forward) - corner;
        most = std::max(most, near * dicing_step(1.0 - outside / dicing_margin));
    }
    return most;
}

DicedMesh dice(std::span<const Vec3d> positions, std::span<const uint32_t> triangles,
               const DisplacedRegion& region, size_t most) {
    DicedMesh mesh;
    DisplacedRegion within = region;
    most = std::max(most, triangles.size() / 3);
    while (!dice_within(positions, triangles, within, most, mesh))
        within.reach = within.reach > region.side ? 0.7 * within.reach : 0.0;
    return mesh;
}

} // namespace marram
