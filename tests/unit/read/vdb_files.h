// SPDX-License-Identifier: Apache-2.0
// OpenVDB files of velocities, for tests.
#pragma once

#include "core/math/vec.h"

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>

#include <fstream>
#include <sstream>
#include <string>

namespace marram::testing {

inline std::string vdb_bytes(const openvdb::GridPtrVec& grids) {
    std::ostringstream out;
    openvdb::io::Stream(out).write(grids);
    return out.str();
}

inline void write_vdb(const std::string& path, const openvdb::GridPtrVec& grids) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << vdb_bytes(grids);
}

// Active in all voxels from `least` on; the velocity of each is that of velocity(centre in metres).
inline openvdb::Vec3SGrid::Ptr velocity_grid(const openvdb::Coord& least, const openvdb::Coord& counts,
                                             const openvdb::math::Transform::Ptr& transform, auto velocity,
                                             const std::string& name = "vel") {
    openvdb::initialize();
    const auto grid = openvdb::Vec3SGrid::create();
    grid->setName(name);
    grid->setTransform(transform);
    auto values = grid->getAccessor();
    for (int i = 0; i < counts.x(); ++i)
        for (int j = 0; j < counts.y(); ++j)
            for (int k = 0; k < counts.z(); ++k) {
                const openvdb::Coord at = least + openvdb::Coord(i, j, k);
                const openvdb::Vec3d p = transform->indexToWorld(at);
                const Vec3d v = velocity(Vec3d(p.x(), p.y(), p.z()));
                values.setValue(at, openvdb::Vec3s(float(v.x()), float(v.y()), float(v.z())));
            }
    return grid;
}

inline openvdb::math::Transform::Ptr voxels_of(double size) {
    return openvdb::math::Transform::createLinearTransform(size);
}

} // namespace marram::testing
