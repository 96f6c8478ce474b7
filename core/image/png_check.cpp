// SPDX-License-Identifier: Apache-2.0
// PNG (ISO 15948), section 5: an 8-byte signature, then chunks of length, type, data and the CRC-32 of type
// and data.
#include "core/image/png_check.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <vector>

namespace marram {
namespace {

constexpr std::array<unsigned char, 8> signature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

constexpr std::array<uint32_t, 256> crc_table = [] {
    std::array<uint32_t, 256> table{};
    for (uint32_t i = 0; i < 256; ++i) {
        uint32_t c = i;
        for (int bit = 0; bit < 8; ++bit) c = c & 1U ? 0xedb88320U ^ (c >> 1) : c >> 1;
        table[i] = c;
    }
    return table;
}();

uint32_t crc32(const unsigned char* bytes, size_t count) {
    uint32_t c = ~0U;
    for (size_t i = 0; i < count; ++i) c = crc_table[(c ^ bytes[i]) & 0xffU] ^ (c >> 8);
    return ~c;
}

uint32_t big_endian(const unsigned char* p) {
    return (uint32_t(p[0]) << 24) | (uint32_t(p[1]) << 16) | (uint32_t(p[2]) << 8) | uint32_t(p[3]);
}

// True if a chunk, given from its type on, is an image header with a size above 0.
bool starts_a_picture(const std::vector<unsigned char>& chunk) {
    return std::memcmp(chunk.data(), "IHDR", 4) == 0 && chunk.size() == 4 + 13 + 4 &&
           big_endian(chunk.data() + 4) > 0 && big_endian(chunk.data() + 8) > 0;
}

} // namespace

std::string png_fault(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::array<unsigned char, 8> head{};
    file.read(reinterpret_cast<char*>(head.data()), head.size());
    if (!file || !std::equal(head.begin(), head.begin() + 4, signature.begin())) return "";
    if (head != signature) return "its signature is damaged";
    std::vector<unsigned char> chunk;
    for (bool first = true;; first = false) {
        std::array<unsigned char, 4> length{};
        if (!file.read(reinterpret_cast<char*>(length.data()), 4)) return "the file is cut short";
        const uint32_t bytes = big_endian(length.data());
        if (bytes > 0x7fffffffU) return "a chunk's length is damaged";
        constexpr size_t step = size_t(1) << 20; // a damaged length must not allocate gigabytes
        chunk.clear();
        for (size_t wanted = size_t(bytes) + 8; chunk.size() < wanted;) {
            const size_t have = chunk.size(), more = std::min(step, wanted - have);
            chunk.resize(have + more);
            if (!file.read(reinterpret_cast<char*>(chunk.data() + have), std::streamsize(more)))
                return "the file is cut short";
        }
        if (crc32(chunk.data(), size_t(bytes) + 4) != big_endian(chunk.data() + bytes + 4))
            return "a checksum is wrong: the file is damaged";
        if (first && !starts_a_picture(chunk)) return "its header is damaged";
        if (std::memcmp(chunk.data(), "IEND", 4) == 0) return "";
    }
}

} // namespace marram
