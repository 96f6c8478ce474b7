// SPDX-License-Identifier: Apache-2.0
// Copies structs and arrays across the plug-in contract, whose other side may know more or fewer fields.
// Fields that both sides know are copied; the others are zero. See core/plugin/marram_plugin.h, "Extension".
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace marram {

// Copies a struct that begins with its `size`.
template <typename T>
T known_part(const T* given) {
    T known{};
    std::memcpy(&known, given, std::min(sizeof(T), given->size));
    known.size = sizeof(T);
    return known;
}

// The other direction: fills the fields that the owner of `out` knows.
template <typename T>
void fill_known_part(const T& known, T* out) {
    const size_t size = out->size;
    std::memcpy(out, &known, std::min(sizeof(T), size));
    out->size = size;
}

// Copies an array whose elements are `stride` bytes apart. A null pointer is an empty array.
template <typename T>
std::vector<T> known_parts(const T* first, uint32_t count, uint32_t stride) {
    std::vector<T> known(first ? count : 0);
    const auto* bytes = reinterpret_cast<const char*>(first);
    for (size_t i = 0; i < known.size(); ++i)
        std::memcpy(&known[i], bytes + i * stride, std::min(sizeof(T), size_t(stride)));
    return known;
}

} // namespace marram
