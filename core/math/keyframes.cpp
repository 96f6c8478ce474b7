// SPDX-License-Identifier: Apache-2.0
#include "core/math/keyframes.h"

#include <algorithm>
#include <array>
#include <cassert>

namespace marram {
namespace {

constexpr std::array<const char*, 3> names = {"linear", "smooth", "constant"}; // [KeyInterpolation]

} // namespace

std::optional<KeyInterpolation> key_interpolation(std::string_view name) {
    for (size_t i = 0; i < names.size(); ++i)
        if (name == names[i]) return KeyInterpolation(i);
    return {};
}

const char* name_of(KeyInterpolation interpolation) { return names[size_t(interpolation)]; }

size_t Keyframes::keys_until(double frame) const {
    return size_t(std::ranges::upper_bound(frames, frame) - frames.begin());
}

void Keyframes::at(double frame, std::span<double> out) const { at(frame, keys_until(frame), out); }

void Keyframes::at(double frame, size_t after, std::span<double> out) const {
    assert(out.size() == numbers_per_key());
    const std::span<const double> before = key(after == 0 ? 0 : after - 1);
    std::ranges::copy(before, out.begin());
    if (after == 0 || after == frames.size() || interpolation == KeyInterpolation::constant) return;
    double t = (frame - frames[after - 1]) / (frames[after] - frames[after - 1]);
    if (interpolation == KeyInterpolation::smooth) t = t * t * (3.0 - 2.0 * t);
    const std::span<const double> next = key(after);
    for (size_t i = 0; i < out.size(); ++i) out[i] += t * (next[i] - before[i]);
}

double Keyframes::at(double frame) const {
    double value = 0.0;
    at(frame, {&value, 1});
    return value;
}

} // namespace marram
