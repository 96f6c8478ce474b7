// SPDX-License-Identifier: Apache-2.0
// How far the air has come when speed and direction of the wind have keys: noise and gusts ride on it.
//
//     D(t) = integral of speed(tau) w(tau) d tau
//     w = a + s (b - a), normalised, between keys with unit directions a and b
//
// with s the interpolation's share of the way between two keys; D in metres a second times frames, so
// divided by fps it is metres. D is v0 w0 t, with the first key's speed and direction, until the last key
// before the first one that differs from it, and is integrated from there on. So a key moves nothing at
// frames before the key that precedes it. (If noise rode on speed(t) t, which changes at v + t v', a breath
// more of wind at a late frame would sweep it far.)
//
// Computed by Gauss-Legendre quadrature with eight points, which is exact for the polynomials of linear and
// smooth speed. Where the direction turns, pieces between keys are halved until halving again changes D by
// less than 1e-13 of the way or by the rounding of frames; keyed_wind_test.cpp compares D with
// sums of small steps: below 1e-9 of the way.
#pragma once

#include "core/math/keyframes.h"
#include "core/math/vec.h"

#include <cmath>
#include <optional>
#include <vector>

namespace marram {

// A direction interpolated between unit ones, as a unit vector. Unit ones keep their bits, so that a wind
// whose keys are equal has those of one without keys.
inline Vec3d renormalised(const Vec3d& between) {
    constexpr double rounding = 1e-14; // of a squared length
    return std::abs(between.squaredNorm() - 1.0) < rounding ? between : between.normalized();
}

class AirPath {
  public:
    // With keys, `speed` or `direction` is not used. Directions, xyz in the keys, are unit and point
    // downwind; no key is opposed to the next, as there the interpolation would pass through zero.
    AirPath(double speed, const Vec3d& direction, std::optional<Keyframes> speeds,
            std::optional<Keyframes> directions);

    double speed(double frame) const { return speeds_ ? speeds_->at(frame) : speed_; }
    Vec3d direction(double frame) const;
    // True: D is exactly speed * direction * frame, at all frames up to this one.
    bool is_steady_until(double frame) const { return frame <= steady_until_; }
    Vec3d displacement(double frame) const; // D, in metres a second times frames
    bool moves() const;                     // false: D is 0 at all times
    size_t piece_count() const { return pieces_.size(); }
    bool has_direction_keys() const { return directions_.has_value(); }

  private:
    struct Piece {
        double begin;
        Vec3d displacement; // at `begin`
    };
    Vec3d velocity(double frame) const { return speed(frame) * direction(frame); }
    Vec3d integral(double begin, double end) const; // between frames of one piece
    void add_pieces(double begin, double end, int halvings);

    double speed_;
    Vec3d direction_;
    std::optional<Keyframes> speeds_, directions_;
    double steady_until_;       // infinity if nothing changes; there are no pieces then
    std::vector<Piece> pieces_; // [0] begins at steady_until_; the last has no end
};

} // namespace marram
