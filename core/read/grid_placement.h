// SPDX-License-Identifier: Apache-2.0
// Placement and value range of height images: metadata that bake writes and that images given to procedurals
// may have.
//
//   marram:cell                       metres from sample to sample
//   marram:center_x, marram:center_z  metres: the middle of the samples
//   marram:size_x, marram:size_z      metres: samples times cell, so that pixel centres lie on samples
//   marram:range_low, marram:range_high  metres: heights of the values 0 and 1
//
// EXR stores them as attributes, PNG as texts (tEXt), TIFF as lines "key value" in ImageDescription.
#pragma once

#include "core/image/image.h"
#include "core/math/vec.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct GridPlacement {
    double cell = 1.0;
    Vec2d center = Vec2d::Zero(), size = Vec2d::Ones(); // x and z
    Vec2d range = Vec2d(0.0, 1.0);
};

std::vector<Metadata> metadata_of(const GridPlacement& placement, const std::string& mesh);
std::string description_of(std::span<const Metadata> metadata); // for TIFF

// Placement read from a file; a member is empty unless the file has both of its values. Throws InputError,
// which names the file, for invalid values: numbers that are not finite, a size that is not above 0.
struct FilePlacement {
    std::optional<Vec2d> center, size, range;
};
FilePlacement read_placement(const std::string& path);

} // namespace marram
