// SPDX-License-Identifier: Apache-2.0
// Structs and arrays from the other side of the plug-in contract, which may know more or fewer fields than we do: what both know is
// copied, what we alone know is zero. core/plugin/marram_plugin.h, "Growing".
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace marram {

// A struct that begins with its size.
template <typename T>
T known_part(const T* given) {
    T known{};
    std::memcpy(&known, given, std::min(sizeof(T), given->size));
    known.size = sizeof(T);
    return known;
}

// The same the other way: fills what the owner of `out` knows.
template <typename T>
void fill_known_part(const T& known, T* out) {
    const size_t size = out->size;
    std::memcpy(out, &known, std::min(sizeof(T), size));
    out->size = size;
}

// An array of elements that are `stride` bytes apart. A null pointer is an empty one.
template <typename T>
std::vector<T> known_parts(const T* first, uint32_t count, uint32_t stride) {
    std::vector<T> known(first ? count : 0);
    const auto* bytes = reinterpret_cast<const char*>(first);
    for (size_t i = 0; i < known.size(); ++i)
        std::memcpy(&known[i], bytes + i * stride, std::min(sizeof(T), size_t(stride)));
    return known;
}

} // namespace marram
