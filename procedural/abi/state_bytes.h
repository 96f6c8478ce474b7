// SPDX-License-Identifier: Apache-2.0
// A procedural's state as bytes, which the host keeps (MarramStates): numbers and structs without padding or pointers as
// they lie in memory, std::vectors of these after their count, std::arrays of vectors. Not for other machines. A state has
// one function that passes its fields to a StateWriter or a StateReader, in the order of the bytes:
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
        static_assert(std::is_trivially_copyable_v<T>);
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
    explicit StateReader(std::span<const char> bytes) : remaining_(bytes) {}
    // If the bytes run out, that field and all later ones stay as they are.
    template <typename... Fields>
    void operator()(Fields&... fields) {
        (get(fields), ...);
    }
    // All fields were there, and no bytes are left.
    bool at_end() const { return ok_ && remaining_.empty(); }

  private:
    template <typename T>
    void get(T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        ok_ = ok_ && remaining_.size() >= sizeof value;
        if (!ok_) return;
        std::memcpy(&value, remaining_.data(), sizeof value);
        remaining_ = remaining_.subspan(sizeof value);
    }
    template <typename T>
    void get(std::vector<T>& list) {
        static_assert(std::is_trivially_copyable_v<T>);
        uint64_t count = 0;
        get(count);
        ok_ = ok_ && count <= remaining_.size() / sizeof(T);
        if (!ok_) return;
        list.resize(count);
        if (count > 0) std::memcpy(list.data(), remaining_.data(), count * sizeof(T));
        remaining_ = remaining_.subspan(count * sizeof(T));
    }
    template <typename T, size_t n>
    void get(std::array<std::vector<T>, n>& lists) {
        for (auto& list : lists) get(list);
    }

    std::span<const char> remaining_;
    bool ok_ = true;
};

} // namespace marram
