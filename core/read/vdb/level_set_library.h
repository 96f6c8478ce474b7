// SPDX-License-Identifier: Apache-2.0
// Code that uses OpenVDB is in this folder, in a library that is loaded when the first .vdb file is read or written.
#pragma once

#include "core/geometry/mesh.h"
#include "core/geometry/world.h"
#include "core/math/problem.h"
#include "core/read/velocity_file.h"

#include <cstddef>
#include <string>

namespace marram {

// The functions that the library exports: core/math/own_library.h.
struct LevelSetLibrary {
    const char* version;
    size_t size;
    // The surface of the first level set in a file's bytes, which are freed. Throws InputError.
    Mesh (*read)(const std::string& path, std::string& bytes);
    // A closed mesh at the first motion sample as a file's bytes; voxel in metres. Throws InputError.
    std::string (*bytes)(const std::string& path, const MeshGeometry& mesh, double voxel);
    // The velocities of a file's bytes, which are freed. Throws InputError.
    VelocityGrid (*velocities)(const std::string& path, const std::string& grid, std::string& bytes);
};

} // namespace marram
