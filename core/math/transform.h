// SPDX-License-Identifier: Apache-2.0
// Keyed transforms: translate, rotate, scale at given frames; exact at the keys, defined at any time.
#pragma once

#include "core/math/vec.h"

#include <span>
#include <string_view>
#include <vector>

namespace marram {

// p -> rotation * (scale * p) + translation. Angles of a key are Euler angles in degrees, applied about x,
// then y, then z. Each angle is interpolated by itself: 0 to 720 turns twice.
class KeyedTransform {
  public:
    KeyedTransform() = default; // identity at all times
    // numbers = 10 a key: frame, translate xyz, rotate xyz in degrees, scale xyz; frames strictly ascending.
    // interpolation: "linear", or "smooth" (flat at every key). Constant before the first and after the last
    // key.
    KeyedTransform(std::span<const double> numbers, std::string_view interpolation);

    Eigen::Affine3d at(double frame) const;
    bool moves() const; // false: at() is the same for every frame
    bool moves_within(double begin, double end) const;
    std::vector<double> frames() const; // of the keys
    uint64_t digest() const;            // of all that at() depends on

  private:
    struct Key {
        double frame;
        Vec3d translation;
        Vec3d angles; // radians
        Vec3d scale;
    };
    std::vector<Key> keys_;
    bool smooth_ = false;
};

} // namespace marram
