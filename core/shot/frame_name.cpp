// SPDX-License-Identifier: Apache-2.0
#include "core/shot/frame_name.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace marram {

std::string numbered(const std::string& output, double frame) {
    const size_t first = output.find('#');
    if (first == std::string::npos) return output;
    const size_t end = std::min(output.find_first_not_of('#', first), output.size());
    std::array<char, 512> digits{}; // the shortest text that gives the same double back
    const char* last =
        std::to_chars(digits.begin(), digits.end(), std::abs(frame), std::chars_format::fixed).ptr;
    const std::string number(static_cast<const char*>(digits.data()), last);
    const size_t whole = std::min(number.find('.'), number.size()), wide = end - first;
    return output.substr(0, first) + (frame < 0.0 ? "-" : "") +
           std::string(wide - std::min(wide, whole), '0') + number + output.substr(end);
}

} // namespace marram
