// SPDX-License-Identifier: Apache-2.0
// Velocities from OpenVDB files: a vector grid, or three grids of floats, as an array of all samples.
#pragma once

#include "core/math/vec.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace marram {

// The box of the grid's active voxels. Voxels in it that are not active have the value that the file gives
// them, as a rule 0.
struct VelocityGrid {
    std::array<uint32_t, 3> counts{};                   // samples along each axis, 1 or more
    Vec3d origin = Vec3d::Zero();                       // of the first sample: the centre of its voxel, m
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity(); // column a: from a sample to the next along axis a, m
    bool staggered =
        false; // component a of a sample is half a step before it along axis a: on a face of its voxel
    std::vector<float>
        values; // x, y, z of each sample, m/s along the axes of the file; the first axis runs fastest
};

inline constexpr size_t max_velocity_samples = size_t(1) << 26; // of a file: 805 MB
inline constexpr double max_velocity = 1e6;                     // m/s

// grid: the name of the vector grid, or what the names of three grids of floats have before ".x", ".y" and
// ".z". "": the only one; of several the one named v, vel or velocity. A file that is read again while its
// grid is in use is not read twice, unless it has changed. Any thread. Throws InputError: damaged files, too
// many samples, numbers that are not finite, transforms that are not linear.
std::shared_ptr<const VelocityGrid> read_velocities(const std::string& path, const std::string& grid);

} // namespace marram
