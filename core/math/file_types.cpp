// SPDX-License-Identifier: Apache-2.0
#include "core/math/file_types.h"

#include <algorithm>
#include <filesystem>

namespace marram {

std::string extension_of(std::string_view path) {
    std::string extension = std::filesystem::path(path).extension().string();
    for (char& c : extension)
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    return extension;
}

bool is_one_of(std::string_view extension, std::span<const std::string_view> types) {
    return std::ranges::find(types, extension) != types.end();
}

std::string listed_files(std::span<const std::string_view> types) {
    std::string text;
    for (size_t i = 0; i < types.size(); ++i) {
        if (i > 0) text += i + 1 < types.size() ? ", " : " or ";
        text += types[i];
    }
    return text;
}

} // namespace marram
