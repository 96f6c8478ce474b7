// SPDX-License-Identifier: Apache-2.0
// Buffers that Embree reads in place.
#pragma once

#include <cstddef>
#include <vector>

namespace marram {

// Embree reads up to 16 bytes past the end of a shared buffer. T has 8 bytes at least.
template <typename T>
std::vector<T> embree_buffer(size_t size) {
    static_assert(sizeof(T) >= 8);
    std::vector<T> buffer;
    buffer.reserve(size + 2);
    buffer.resize(size);
    return buffer;
}

// The first component of elements that may be none at all: a mesh without vertices has no normals' memory.
template <class Elements>
auto components(Elements& elements) {
    return elements.data() ? elements.data()->data() : nullptr;
}

} // namespace marram
