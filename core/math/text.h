// SPDX-License-Identifier: Apache-2.0
// What all readers of text files share: the encoding, numbers, and places for messages.
#pragma once

#include "core/math/problem.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace marram {

// Bytes of the byte order mark that a text file begins with: 3 for UTF-8, 0 without a mark. It is no part of the text.
// Throws InputError for UTF-16 and UTF-32, which no reader knows.
// Inline, as libraries of procedurals link this folder and know no InputError.
inline size_t byte_order_mark(const std::string& path, std::string_view bytes) {
    using namespace std::string_view_literals;
    constexpr std::string_view utf8 = "\xef\xbb\xbf";
    if (bytes.starts_with(utf8)) return utf8.size();
    const bool utf32 = bytes.starts_with("\xff\xfe\0\0"sv) || bytes.starts_with("\0\0\xfe\xff"sv);
    if (utf32 || bytes.starts_with("\xff\xfe") || bytes.starts_with("\xfe\xff"))
        throw InputError({path, 1, 1}, utf32 ? "is text in UTF-32" : "is text in UTF-16", "save it as UTF-8");
    return 0;
}

// The line and column of bytes[offset]. Lines end in \n, or in \r if there is no \n.
Place place_of(const std::string& path, std::string_view bytes, size_t offset);

enum class NumberFault { none, not_a_number, not_finite };
// Each parses all of `token`, with or without a sign. Real: float or double; underflow gives 0.
template <typename Real>
NumberFault parse_number(std::string_view token, Real& value);

enum class WholeFault { none, not_whole, out_of_range };
// value: unchanged unless the number is in [least, greatest].
WholeFault parse_whole(std::string_view token, int64_t least, int64_t greatest, int64_t& value);

} // namespace marram
