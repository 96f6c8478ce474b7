// SPDX-License-Identifier: Apache-2.0
// How far the air has come when speed and direction of the wind have keys: noise and gusts ride on it.
//
//     D(t) = integral of speed(tau) w(tau) d tau,     w = a + s (b - a), normalised, between keys with unit directions a, b
//
// D is v0 w0 t up to the first key whose speed or direction differs from the first (v0, w0: those of the
// first key, t from frame 0), and grows from there on. So a key moves nothing at frames before the key that
// precedes it: air is never displaced at once, as it would be if noise rode on the product of speed and
// time.
//
// Computed by Gauss-Legendre quadrature with eight points, which is exact for the polynomials of linear and
// smooth speed. Where the direction turns, pieces between keys are halved until halving again changes D by
// less than 1e-13 of the way or by the rounding of frames; error < 1e-12 of the way plus what the air moves
// in 1e-15 of the frame's number (keyed_wind_test.cpp).
#pragma once

#include "core/math/keyframes.h"
#include "core/math/vec.h"

#include <cmath>
#include <optional>
#include <vector>

namespace marram {

// A direction interpolated between unit ones, as a unit vector. Unit ones are not changed by a bit.
inline Vec3d renormalised(const Vec3d& between) {
    constexpr double rounding = 1e-14; // of a squared length
    return std::abs(between.squaredNorm() - 1.0) < rounding ? between : between.normalized();
}

class AirPath {
  public:
    // `direction` and the keys of `directions` (xyz) are unit, and no key is opposed to the next.
    AirPath(double speed, const Vec3d& direction, std::optional<Keyframes> speeds,
            std::optional<Keyframes> directions);

    double speed(double frame) const { return speeds_ ? speeds_->at(frame) : speed_; }
    Vec3d direction(double frame) const;
    // True: until this frame the air has moved in a straight line at the speed that it has there, since ever.
    bool is_steady_until(double frame) const { return frame <= steady_until_; }
    Vec3d displacement(double frame) const; // D, in metres a second times frames
    bool moves() const;                     // false: D is 0 at all times
    size_t pieces() const { return pieces_.size(); }
    bool turns() const { return directions_.has_value(); }

  private:
    struct Piece {
        double begin;
        Vec3d displacement; // at `begin`
    };
    Vec3d velocity(double frame) const { return speed(frame) * direction(frame); }
    Vec3d over(double begin, double end) const; // the integral between frames of one piece
    void add_pieces(double begin, double end, int halvings);

    double speed_;
    Vec3d direction_;
    std::optional<Keyframes> speeds_, directions_;
    double steady_until_;
    std::vector<Piece> pieces_; // [0] begins at steady_until_; the last has no end
};

} // namespace marram
