// SPDX-License-Identifier: Apache-2.0
// Luminance of linear colours with the primaries and white point of Rec. 709.
#pragma once

namespace marram {

template <typename T>
constexpr T luminance(T red, T green, T blue) {
    return T(0.2126) * red + T(0.7152) * green + T(0.0722) * blue;
}

} // namespace marram
