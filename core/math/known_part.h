// SPDX-License-Identifier: Apache-2.0
// Copies structs and arrays across the plug-in contract, whose other side may know more or fewer fields.
// Fields that both sides know are copied; the others are zero. See core/plugin/marram_plugin.h, "Extension".
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <typeinfo>
#include <vector>

namespace marram {

// A struct whose owner has not set its `size`: it does not even hold the field after it.
class UnsetSize : public std::runtime_error {
  public:
    using std::runtime_error::runtime_error;
};

template <typename T>
bool is_sized(const T* given) {
    return given->size > sizeof given->size;
}

// Throws UnsetSize, "MarramFrame.size is 0". The functions below call it.
template <typename T>
void check_size(const T* given) {
    if (is_sized(given)) return;
    const std::string mangled = typeid(T).name(); // "11MarramFrame"
    throw UnsetSize(mangled.substr(std::min(mangled.find_first_not_of("0123456789"), mangled.size())) +
                    ".size is " + std::to_string(given->size));
}

// Copies a struct that begins with its `size`.
template <typename T>
T known_part(const T* given) {
    check_size(given);
    T known{};
    std::memcpy(&known, given, std::min(sizeof(T), given->size));
    known.size = sizeof(T);
    return known;
}

// The other direction: fills the fields that the owner of `out` knows.
template <typename T>
void fill_known_part(const T& known, T* out) {
    check_size(out);
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
