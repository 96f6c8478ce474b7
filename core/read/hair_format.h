// SPDX-License-Identifier: Apache-2.0
// Header of Cem Yuksel's HAIR files, byte for byte. A strand has segments + 1 points.
#pragma once

#include <bit>
#include <cstdint>

namespace marram {

static_assert(std::endian::native == std::endian::little);

struct HairHeader {
    char magic[4] = {'H', 'A', 'I', 'R'};
    uint32_t strands = 0, points = 0, flags = 0, default_segments = 0;
    float default_thickness = 0.0f, default_transparency = 0.0f, default_color[3] = {1.0f, 1.0f, 1.0f};
    char info[88] = "Marram: y up, metres";
};
static_assert(sizeof(HairHeader) == 128);

enum HairFlag : uint32_t {
    hair_segments = 1,
    hair_points = 2,
    hair_thickness = 4,
    hair_transparency = 8,
    hair_color = 16
};

} // namespace marram
