// SPDX-License-Identifier: Apache-2.0
// Images in UDIM tiles: "fur.<UDIM>.png" stands for fur.1001.png, fur.1002.png, ... Tile 1001 + u + 10 v
// covers the square [u, u + 1] x [v, v + 1] of uv; u is 0 ... 9.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace marram {

struct UdimTile {
    int u = 0, v = 0;
    std::string file;
};

int udim_number(int u, int v);

// True if the file's name contains <UDIM>.
bool has_udim(std::string_view path);

// The files that exist of such a name, by number.
std::vector<UdimTile> udim_tiles(const std::string& path);

// "fur.<UDIM>.png" of "fur.1002.png": the name with its last number of four digits from 1001 on, set off by
// '.' or '_', replaced. "" if there is none.
std::string udim_pattern(const std::string& path);

} // namespace marram
