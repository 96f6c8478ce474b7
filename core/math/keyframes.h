// SPDX-License-Identifier: Apache-2.0
// Values that change in time: keys, each with a frame and the same count of numbers.
#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace marram {

enum class KeyInterpolation {
    linear,
    smooth,  // flat at every key: 3 t^2 - 2 t^3
    constant // until the next key
};

// "linear", "smooth", "constant", separated by "|".
inline constexpr std::string_view key_interpolations = "linear|smooth|constant";
std::optional<KeyInterpolation> key_interpolation(std::string_view name);
const char* name_of(KeyInterpolation interpolation);

// Each number is interpolated by itself, so between two keys it is between its values there. Before the first
// key and after the last it is constant.
struct Keyframes {
    std::vector<double> frames;  // strictly ascending, at least one
    std::vector<double> numbers; // [key * numbers_per_key() + i]
    KeyInterpolation interpolation = KeyInterpolation::linear;

    size_t count() const { return frames.size(); }
    size_t numbers_per_key() const { return numbers.size() / frames.size(); }
    std::span<const double> key(size_t i) const {
        return std::span(numbers).subspan(i * numbers_per_key(), numbers_per_key());
    }
    // Exact at the keys.
    void at(double frame, std::span<double> out) const; // [numbers_per_key()]
    double at(double frame) const;                      // of keys with one number
    size_t keys_until(double frame) const;              // number of keys at or before the frame
    // The same as at(), for frames between two neighbouring keys, with after = keys_until(frame).
    void at(double frame, size_t after, std::span<double> out) const;
    bool operator==(const Keyframes&) const = default;
};

} // namespace marram
