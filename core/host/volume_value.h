// SPDX-License-Identifier: Apache-2.0
// Volumes of a scene, as the contract passes them: the velocity grid of a file, or those of numbered files.
#pragma once

#include "core/math/digest.h"
#include "core/math/params.h"
#include "core/plugin/marram_plugin.h"
#include "core/read/velocity_file.h"

#include <memory>
#include <string>
#include <vector>

namespace marram {

struct VolumeValue {
    MarramVolume volume{}; // points into the members below
    std::vector<double> frames;
    std::vector<MarramGrid> grids;
    std::vector<std::shared_ptr<const VelocityGrid>> files;

    void add_to(Digest& digest) const;
};

inline constexpr double max_volume_bytes = 4e9; // of all frames

// The files of a value of ParamType::volume. All frames are read at once. Throws InputError: files that are
// missing or cannot be read, more than 4 GB, staggered and other grids in one sequence.
std::shared_ptr<const VolumeValue> read_volume_value(const ParamValue& value);

// The files of such a value.
std::vector<std::string> volume_files(const ParamValue& value);

} // namespace marram
