// SPDX-License-Identifier: Apache-2.0
// Whole files, for tests. By iterators of a stream, without optimisation, a file of 10 MB takes seconds.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace marram {

// "" if there is no such file.
inline std::string read_file(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    std::string bytes(file ? size_t(file.tellg()) : 0, '\0');
    file.seekg(0).read(bytes.data(), std::streamsize(bytes.size()));
    return bytes;
}

} // namespace marram
