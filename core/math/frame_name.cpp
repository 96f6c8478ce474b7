// SPDX-License-Identifier: Apache-2.0
#include "core/math/frame_name.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace marram {
namespace {

// Position of the first # of the file's name; npos if there is none.
size_t frame_mark(const std::string& path) {
    const size_t slash = path.rfind('/');
    return path.find('#', slash == std::string::npos ? 0 : slash);
}

} // namespace

bool has_frame_mark(const std::string& path) { return frame_mark(path) != std::string::npos; }

std::string numbered(const std::string& path, double frame) {
    const size_t first = frame_mark(path);
    if (first == std::string::npos) return path;
    const size_t end = std::min(path.find_first_not_of('#', first), path.size());
    std::array<char, 512> digits{}; // the shortest text that gives the same double back
    const char* last =
        std::to_chars(digits.begin(), digits.end(), std::abs(frame), std::chars_format::fixed).ptr;
    const std::string number(static_cast<const char*>(digits.data()), last);
    const size_t whole = std::min(number.find('.'), number.size()), wide = end - first;
    return path.substr(0, first) + (frame < 0.0 ? "-" : "") + std::string(wide - std::min(wide, whole), '0') +
           number + path.substr(end);
}

} // namespace marram
