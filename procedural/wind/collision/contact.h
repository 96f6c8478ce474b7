// SPDX-License-Identifier: Apache-2.0
// Exact contact of a rotating segment with triangles. See contact.cpp for the derivation.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"

#include <span>
#include <vector>

namespace marram {

// A capsule of radius `clearance` around a segment that rotates about the origin in a plane: at angle t the
// segment runs from 0 to length * (from cos t + across sin t). `from`, `across` and `normal` = from x across
// are orthonormal.
struct TurningCapsule {
    Vec3d from, across, normal;
    double length, clearance; // > 0

    Vec3d direction(double cosine, double sine) const { return from * cosine + across * sine; }
};

// Angles are compared by a number that needs no trigonometry, their arc length along the diamond |c| + |s| =
// 1: 0 at angle 0, 1 at a right angle, 2 at pi, negative for negative angles; p(angle + pi) = p(angle) + 2
// exactly.
inline double diamond(double cosine, double sine) {
    const double across = std::abs(sine) / (std::abs(cosine) + std::abs(sine));
    const double p = cosine < 0.0 ? 2.0 - across : across;
    return sine < 0.0 ? -p : p;
}
// The inverse: the unit vector (cosine, sine).
inline Vec2d from_diamond(double p) {
    const double r = std::remainder(p, 4.0), a = std::abs(r);
    const Vec2d v =
        a <= 1.0 ? Vec2d(1.0 - a, std::copysign(a, r)) : Vec2d(1.0 - a, std::copysign(2.0 - a, r));
    return v.normalized();
}
inline double diamond_of_angle(double angle) { return diamond(std::cos(angle), std::sin(angle)); }

// Eight triangles relative to the pivot. Lanes may repeat.
struct alignas(64) Triangles8 {
    Wide3d corner[3];
};

// Triangles in blocks of eight, appended one by one.
class TriangleList {
  public:
    void clear() { count_ = 0; }
    size_t size() const { return count_; }
    void push(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
        if (count_ == blocks_.size() * lanes) blocks_.emplace_back();
        Triangles8& block = blocks_[count_ / lanes];
        const size_t lane = count_++ % lanes;
        for (size_t i = 0; i < 3; ++i) {
            const Vec3d& p = i == 0 ? a : i == 1 ? b : c;
            block.corner[i].x[lane] = p.x();
            block.corner[i].y[lane] = p.y();
            block.corner[i].z[lane] = p.z();
        }
    }
    void push(const Triangles8& from, int lane) {
        const auto corner = [&](size_t i) {
            return Vec3d(from.corner[i].x[lane], from.corner[i].y[lane], from.corner[i].z[lane]);
        };
        push(corner(0), corner(1), corner(2));
    }
    // The blocks in use; unused lanes of the last block repeat its first triangle.
    std::span<Triangles8> blocks() {
        const size_t used = (count_ + lanes - 1) / lanes;
        for (size_t lane = count_ % lanes; lane > 0 && lane < lanes; ++lane)
            for (Wide3d& p : blocks_[used - 1].corner) {
                p.x[lane] = p.x[0];
                p.y[lane] = p.y[0];
                p.z[lane] = p.z[0];
            }
        return {blocks_.data(), used};
    }

  private:
    WideVector<Triangles8> blocks_;
    size_t count_ = 0;
};

// The angles at which a triangle is closer than the clearance: one interval, shorter than half a turn, in
// diamond units with -4 < low <= high < 4, high - low < 2. If it contains 0, low < 0 < high; else low >= 0.
struct Blocked {
    double low, high;
};

// Appends the interval of every triangle that blocks an angle between `begin` and `end` (diamond units, begin
// <= 0 <= end, each at most 2 from 0), and possibly those of some that block other angles only. Triangles are
// tested exactly: the ends are good to 1e-12 + 1e-15 * distance / clearance except at grazing contact, where
// the distance is good to 1e-10 lengths. The pivot must be clear of every triangle. Cost: about 5 ns for a
// distant triangle, 60 ns for a close one.
void blocked_turns(const TurningCapsule& capsule, double begin, double end, std::span<Triangles8> triangles,
                   size_t count, std::vector<Blocked>& out);

struct FirstBlocked {
    double turn;       // negative: angle 0 is blocked
    Vec3d corner[3];   // of a triangle that blocks it; NaN if only rounding hides the contact
    TriangleList near; // scratch
};

// The first angle in [0, end] that a triangle blocks. False: there is none.
bool first_blocked(const TurningCapsule& capsule, double end, TriangleList& triangles, FirstBlocked& found);

// True: the pivot is farther than `clearance` from every triangle. False: it may be closer (a coarse test of
// planes and boxes).
bool clear_of_pivot(std::span<Triangles8> triangles, double clearance);

} // namespace marram
