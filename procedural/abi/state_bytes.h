// SPDX-License-Identifier: Apache-2.0
// The bytes of a state that a host keeps (MarramStates): numbers, plain structs without padding, lists of these, and
// arrays of lists. A state has one function that passes its fields to either class, in the order of the bytes:
//     void visit_fields(auto& state, auto& visit) { visit(state.time, state.sand); }
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

namespace marram {

class StateWriter {
  public:
    template <typename... Fields>
    void operator()(const Fields&... fields) {
        (add(fields), ...);
    }
    std::vector<char> bytes;

  private:
    void append(const void* data, size_t size) {
        const size_t at = bytes.size();
        bytes.resize(at + size);
        if (size > 0) std::memcpy(bytes.data() + at, data, size);
    }
    template <typename T>
    void add(const T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        append(&value, sizeof value);
    }
    template <typename T>
    void add(const std::vector<T>& list) {
        add(uint64_t(list.size()));
        append(list.data(), list.size() * sizeof(T));
    }
    template <typename T, size_t n>
    void add(const std::array<std::vector<T>, n>& lists) {
        for (const auto& list : lists) add(list);
    }
};

class StateReader {
  public:
    explicit StateReader(std::span<const char> bytes) : left_(bytes) {}
    // Fields keep their values from where the bytes end.
    template <typename... Fields>
    void operator()(Fields&... fields) {
        (get(fields), ...);
    }
    // All fields were read, and nothing is left.
    bool at_end() const { return whole_ && left_.empty(); }

  private:
    template <typename T>
    void get(T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        whole_ = whole_ && left_.size() >= sizeof value;
        if (!whole_) return;
        std::memcpy(&value, left_.data(), sizeof value);
        left_ = left_.subspan(sizeof value);
    }
    template <typename T>
    void get(std::vector<T>& list) {
        uint64_t count = 0;
        get(count);
        whole_ = whole_ && count <= left_.size() / sizeof(T);
        if (!whole_) return;
        list.resize(count);
        if (count > 0) std::memcpy(list.data(), left_.data(), count * sizeof(T));
        left_ = left_.subspan(count * sizeof(T));
    }
    template <typename T, size_t n>
    void get(std::array<std::vector<T>, n>& lists) {
        for (auto& list : lists) get(list);
    }

    std::span<const char> left_;
    bool whole_ = true;
};

} // namespace marram
