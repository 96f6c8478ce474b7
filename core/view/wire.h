// SPDX-License-Identifier: Apache-2.0
// A binary message to a page: the length of a header in bytes (32 bits), the header (JSON, padded with
// blanks so that what follows begins at a multiple of 8), and arrays, little-endian, each at a multiple of
// 8 bytes from the end of the header.
#pragma once

#include <nlohmann/json.hpp>

#include <bit>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <utility>

namespace marram {

static_assert(std::endian::native == std::endian::little);

struct WireMessage {
    nlohmann::json header = nlohmann::json::object();
    std::string payload;

    // Makes room for an array; returns its offset, which the header gives.
    size_t add(size_t bytes) {
        const size_t offset = payload.size();
        payload.resize((offset + bytes + 7) / 8 * 8);
        return offset;
    }
    char* at(size_t offset) { return payload.data() + offset; }
};

// [x, y, z], of floats or doubles.
template <typename Vector>
nlohmann::json json_of(const Vector& v) {
    return nlohmann::json::array({v[0], v[1], v[2]});
}

inline std::shared_ptr<const std::string> to_bytes(const WireMessage& message) {
    std::string text = message.header.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    text.resize((4 + text.size() + 7) / 8 * 8 - 4, ' ');
    const auto length = uint32_t(text.size());
    auto bytes = std::make_shared<std::string>();
    bytes->reserve(4 + text.size() + message.payload.size());
    bytes->append(reinterpret_cast<const char*>(&length), 4).append(text).append(message.payload);
    return bytes;
}

} // namespace marram
