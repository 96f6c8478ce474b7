// SPDX-License-Identifier: Apache-2.0
// The bytes of a state that a host keeps (MarramStates): numbers, plain structs without padding, and lists of
// these, in the order in which they were added.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

namespace marram {

class StateWriter {
  public:
    template <typename T>
    void add(const T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        const size_t at = bytes.size();
        bytes.resize(at + sizeof value);
        std::memcpy(bytes.data() + at, &value, sizeof value);
    }
    template <typename T>
    void add_list(const std::vector<T>& list) {
        add(uint64_t(list.size()));
        const size_t at = bytes.size(), size = list.size() * sizeof(T);
        bytes.resize(at + size);
        if (size > 0) std::memcpy(bytes.data() + at, list.data(), size);
    }
    std::vector<char> bytes;
};

class StateReader {
  public:
    explicit StateReader(std::span<const char> bytes) : left_(bytes) {}
    template <typename T>
    void get(T& value) {
        whole = whole && left_.size() >= sizeof value;
        if (!whole) return;
        std::memcpy(&value, left_.data(), sizeof value);
        left_ = left_.subspan(sizeof value);
    }
    template <typename T>
    void get_list(std::vector<T>& list) {
        uint64_t count = 0;
        get(count);
        whole = whole && count <= left_.size() / sizeof(T);
        if (!whole) return;
        list.resize(count);
        if (count > 0) std::memcpy(list.data(), left_.data(), count * sizeof(T));
        left_ = left_.subspan(count * sizeof(T));
    }
    bool at_end() const { return whole && left_.empty(); }
    bool whole = true;

  private:
    std::span<const char> left_;
};

} // namespace marram
