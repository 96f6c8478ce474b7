// SPDX-License-Identifier: Apache-2.0
#include "core/math/text.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace marram {

Place place_of(const std::string& path, std::string_view bytes, size_t offset) {
    const char newline = bytes.find('\n') == std::string_view::npos ? '\r' : '\n';
    const std::string_view before = bytes.substr(0, offset);
    const size_t line_start = before.rfind(newline) + 1; // npos + 1 is 0
    return {path, int(std::count(before.begin(), before.end(), newline)) + 1, int(offset - line_start) + 1};
}

template <typename Real>
NumberFault parse_number(std::string_view token, Real& value) {
    if (token.starts_with('+') && !token.starts_with("+-")) token.remove_prefix(1);
    const char* end = token.data() + token.size();
    const auto [stop, error] = std::from_chars(token.data(), end, value);
    if (stop != end || token.empty() || error == std::errc::invalid_argument)
        return NumberFault::not_a_number;
    if (error == std::errc::result_out_of_range) {
        // Overflow or underflow: the exponent's sign tells which, or the digits before the point.
        const size_t exponent = token.find_first_of("eE");
        const bool underflow = exponent == std::string_view::npos
                                   ? token[token.find_first_not_of("-0")] == '.'
                                   : token.substr(exponent + 1, 1) == "-";
        if (!underflow) return NumberFault::not_finite;
        value = Real(0);
    }
    return std::isfinite(value) ? NumberFault::none : NumberFault::not_finite;
}

template NumberFault parse_number<float>(std::string_view, float&);
template NumberFault parse_number<double>(std::string_view, double&);

WholeFault parse_whole(std::string_view token, int64_t least, int64_t greatest, int64_t& value) {
    if (token.starts_with('+') && !token.starts_with("+-")) token.remove_prefix(1);
    int64_t number = 0;
    const char* end = token.data() + token.size();
    const auto [stop, error] = std::from_chars(token.data(), end, number);
    if (stop != end || token.empty() || error == std::errc::invalid_argument) return WholeFault::not_whole;
    if (error != std::errc() || number < least || number > greatest) return WholeFault::out_of_range;
    value = number;
    return WholeFault::none;
}

} // namespace marram
