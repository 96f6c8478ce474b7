// SPDX-License-Identifier: Apache-2.0
#include "core/math/udim.h"

#include <algorithm>
#include <filesystem>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view marker = "<UDIM>";
constexpr int first_tile = 1001, columns = 10;
constexpr size_t digits = 4;

// The number that `text` is, or 0 if it is no tile's.
int tile_of(std::string_view text) {
    if (text.size() != digits || text.find_first_not_of("0123456789") != std::string_view::npos) return 0;
    int number = 0;
    for (const char c : text) number = 10 * number + (c - '0');
    return number >= first_tile ? number : 0;
}

} // namespace

int udim_number(int u, int v) { return first_tile + u + columns * v; }

bool has_udim(std::string_view path) {
    const size_t at = path.rfind(marker);
    return at != std::string_view::npos && path.find('/', at) == std::string_view::npos;
}

std::vector<UdimTile> udim_tiles(const std::string& path) {
    const fs::path pattern(path);
    const std::string name = pattern.filename().string();
    const size_t at = name.rfind(marker);
    std::vector<UdimTile> tiles;
    if (at == std::string::npos) return tiles;
    const std::string before = name.substr(0, at), after = name.substr(at + marker.size());
    std::error_code error;
    const fs::path folder = pattern.has_parent_path() ? pattern.parent_path() : fs::path(".");
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
        const std::string file = entry->path().filename().string();
        if (file.size() != before.size() + digits + after.size() || !file.starts_with(before) ||
            !file.ends_with(after))
            continue;
        const int number = tile_of(std::string_view(file).substr(before.size(), digits));
        if (number == 0) continue;
        tiles.push_back({(number - first_tile) % columns, (number - first_tile) / columns,
                         (pattern.parent_path() / file).string()});
    }
    std::ranges::sort(tiles, {}, [](const UdimTile& tile) { return udim_number(tile.u, tile.v); });
    return tiles;
}

std::string udim_pattern(const std::string& path) {
    const size_t name = path.rfind('/') + 1; // npos + 1 is 0
    const auto is_border = [](char c) { return c == '.' || c == '_'; };
    for (size_t at = path.size(); at-- > name + 1;) {
        const size_t end = at + digits;
        if (end < path.size() && is_border(path[at - 1]) && is_border(path[end]) &&
            tile_of(std::string_view(path).substr(at, digits)) != 0)
            return path.substr(0, at) + std::string(marker) + path.substr(end);
    }
    return "";
}

} // namespace marram
