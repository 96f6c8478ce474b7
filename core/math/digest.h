// SPDX-License-Identifier: Apache-2.0
// Digests of contents: objects with equal digests are treated as equal (XXH3, 64 bits, chained). Cost: 0.1 ms
// per megabyte.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <vector>

namespace marram {

uint64_t digest_bytes(const void* bytes, size_t count, uint64_t seed = 0);

class Digest {
  public:
    Digest& add(uint64_t word) {
        value_ = digest_bytes(&word, sizeof word, value_);
        return *this;
    }
    Digest& add(std::string_view text) {
        add(text.size());
        value_ = digest_bytes(text.data(), text.size(), value_);
        return *this;
    }
    Digest& add(const char* text) { return add(std::string_view(text ? text : "")); }
    template <typename T>
    Digest& add(const std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T>);
        return add(values.data(), values.size() * sizeof(T));
    }
    Digest& add(const void* bytes, size_t count) {
        add(count);
        value_ = digest_bytes(bytes, count, value_);
        return *this;
    }
    uint64_t value() const { return value_; }

  private:
    uint64_t value_ = 0;
};

} // namespace marram
