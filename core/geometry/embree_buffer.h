// SPDX-License-Identifier: Apache-2.0
// Buffers that Embree reads in place.
#pragma once

#include <cstddef>
#include <vector>

namespace marram {

// Reserves the 16 bytes that Embree may read past the end of a shared buffer.
template <typename Element>
void reserve_spare_bytes(std::vector<Element>& buffer) {
    buffer.reserve(buffer.size() + (16 + sizeof(Element) - 1) / sizeof(Element));
}

// Embree reads up to 16 bytes past the end of a shared buffer: two spare elements of 8 bytes or more.
template <typename T>
std::vector<T> embree_buffer(size_t size) {
    static_assert(sizeof(T) >= 8);
    std::vector<T> buffer;
    buffer.reserve(size + 2);
    buffer.resize(size);
    return buffer;
}

// Pointer to the first component; nullptr if there are no elements, such as the normals of a mesh without
// vertices.
template <class Elements>
auto components(Elements& elements) {
    return elements.data() ? elements.data()->data() : nullptr;
}

} // namespace marram
