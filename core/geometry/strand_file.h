// SPDX-License-Identifier: Apache-2.0
// Strands and guides that were groomed elsewhere, with all that their file carries: .hair, .usda, .ply, .obj.
//
// To add a format, write its read_<format>_strands() here and name its extension in load_strand_file().
#pragma once

#include "core/geometry/attribute_values.h"
#include "core/math/problem.h"
#include "core/math/vec.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

// CVs and widths at one frame, for all curves one after the other.
struct StrandSample {
    double frame = 0.0;
    std::vector<Vec3f> points;
    std::vector<float> widths; // diameters, m; empty where the file has none
};

struct StrandFile {
    std::vector<uint32_t> counts; // CVs of each curve, 2 or more
    // How the CVs are drawn; MARRAM_LINEAR: the file says nothing but points.
    MarramBasis basis = MARRAM_LINEAR;
    std::vector<StrandSample> samples; // one, or by ascending frame two or more where the file animates
    std::vector<AttributeValues>
        attributes;         // per curve or per CV, in the file's order; of an animated one its first sample
    double deviation = 0.0; // m: how far the curve that is drawn from these CVs is from the file's, at most
    std::vector<std::string> warnings; // what the file has and is not taken over
};

// Whole files only: one that is cut, or whose counts do not add up, is an error. fps: frames a second of the scene, for files that
// count time in seconds or have a rate of their own. Throws InputError with line and column, or byte. Memory: a small multiple of the
// file, nothing on a count's word.
StrandFile load_strand_file(const std::string& file, double fps);

} // namespace marram
