// SPDX-License-Identifier: Apache-2.0
// OpenVDB level sets as meshes, and back. The only file of core that includes OpenVDB.
#include "core/geometry/grid_export.h"
#include "core/geometry/mesh_reader.h"
#include "core/image/atomic_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <sstream>
#include <utility>

namespace marram {
namespace {

using openvdb::FloatGrid;

constexpr double most_voxels = 0x1p27; // of a narrow band that is read: 2 GB as a mesh
constexpr double finest_part = 0.01;   // of the largest side of a mesh: voxels are not larger

// The first level set of floats. Throws InputError.
FloatGrid::Ptr read_level_set(const std::string& path, std::string& bytes) {
    std::vector<std::string> others;
    try {
        openvdb::initialize();
        std::istringstream in(std::move(bytes));
        in.exceptions(std::ios::failbit | std::ios::badbit); // OpenVDB reads on after the end
        constexpr bool read_values_later = false;
        openvdb::io::Stream stream(in, read_values_later);
        for (const openvdb::GridBase::Ptr& grid : *stream.getGrids()) {
            if (grid->isType<FloatGrid>() && grid->getGridClass() == openvdb::GRID_LEVEL_SET)
                return openvdb::gridPtrCast<FloatGrid>(grid);
            others.push_back(fmt::format("\"{}\", {}", grid->getName(),
                                         openvdb::GridBase::gridClassToString(grid->getGridClass())));
        }
    } catch (const std::bad_alloc&) {
        throw InputError(Place{path}, "does not fit into memory, or is damaged", "write it again");
    } catch (const std::exception& error) {
        throw InputError(Place{path}, fmt::format("is no OpenVDB file, or is damaged: {}", error.what()),
                         "write it again");
    }
    throw InputError(Place{path},
                     others.empty()
                         ? std::string("holds no grids")
                         : fmt::format("holds no level set of floats, but {}", fmt::join(others, "; ")),
                     "write the surface as a level set (signed distance field)");
}

void check_level_set(const std::string& path, const FloatGrid& grid) {
    const double voxels = double(grid.activeVoxelCount());
    if (voxels > most_voxels)
        throw InputError(Place{path}, fmt::format("has {:.3g} active voxels, the limit is 2^27", voxels),
                         "write it with larger voxels");
    for (auto value = grid.cbeginValueOn(); value; ++value) {
        if (!value.isVoxelValue())
            throw InputError(Place{path}, "has active tiles: it is no narrow band", "write a narrow band");
        if (!std::isfinite(*value))
            throw InputError(Place{path}, "has a distance that is not finite", "repair the level set");
    }
}

double volume_of(std::span<const Vec3f> positions, std::span<const std::array<uint32_t, 3>> triangles) {
    double sum = 0.0;
    for (const auto& t : triangles) {
        const Vec3d a = positions[t[0]].cast<double>(), b = positions[t[1]].cast<double>(),
                    c = positions[t[2]].cast<double>();
        sum += a.dot(b.cross(c)) / 6.0;
    }
    return sum;
}

// True if each edge, between positions, is in as many triangles one way as the other.
bool is_closed(std::span<const uint32_t> first, std::span<const std::array<uint32_t, 3>> triangles) {
    std::vector<std::pair<uint64_t, int>> edges; // smaller and larger end; direction
    edges.reserve(3 * triangles.size());
    for (const auto& t : triangles)
        for (size_t k = 0; k < 3; ++k) {
            const uint64_t a = first[t[k]], b = first[t[(k + 1) % 3]];
            if (a != b) edges.emplace_back(std::min(a, b) << 32 | std::max(a, b), a < b ? 1 : -1);
        }
    std::sort(edges.begin(), edges.end());
    for (size_t i = 0; i < edges.size();) {
        int sum = 0;
        const uint64_t edge = edges[i].first;
        for (; i < edges.size() && edges[i].first == edge; ++i) sum += edges[i].second;
        if (sum != 0) return false;
    }
    return true;
}

// The edge of a square that is as large as two triangles on average.
double voxel_of(std::span<const Vec3f> positions, std::span<const std::array<uint32_t, 3>> triangles) {
    double area = 0.0;
    Eigen::AlignedBox3d box;
    for (const auto& t : triangles) {
        const Vec3d a = positions[t[0]].cast<double>(), b = positions[t[1]].cast<double>(),
                    c = positions[t[2]].cast<double>();
        area += 0.5 * (b - a).cross(c - a).norm();
        box.extend(a).extend(b).extend(c);
    }
    return std::min(std::sqrt(2.0 * area / double(triangles.size())), finest_part * box.sizes().maxCoeff());
}

} // namespace

Mesh read_vdb(const std::string& path, std::string& bytes) {
    const FloatGrid::Ptr grid = read_level_set(path, bytes);
    check_level_set(path, *grid);
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec4I> quads;
    openvdb::tools::volumeToMesh(*grid, points, quads);
    Mesh mesh;
    mesh.positions.reserve(points.size());
    for (const openvdb::Vec3s& p : points) {
        const Vec3f position(p.x(), p.y(), p.z());
        if (!(double(position.cwiseAbs().maxCoeff()) <= greatest_coordinate))
            throw InputError(Place{path}, "has a vertex beyond 1e18", "check its transform");
        mesh.positions.push_back(position);
    }
    mesh.triangles.reserve(2 * quads.size());
    const auto at = [&](const openvdb::Vec4I& quad, int k) { return mesh.positions[quad[k]]; };
    for (const openvdb::Vec4I& q : quads) { // along the shorter diagonal
        const bool first = (at(q, 2) - at(q, 0)).squaredNorm() <= (at(q, 3) - at(q, 1)).squaredNorm();
        mesh.triangles.push_back({q[0], q[1], first ? q[2] : q[3]});
        mesh.triangles.push_back({first ? q[0] : q[1], q[2], q[3]});
    }
    if (volume_of(mesh.positions, mesh.triangles) < 0.0) // a transform may mirror it
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    return mesh;
}

void write_level_set(const std::string& path, const MeshGeometry& mesh) {
    const std::vector<Vec3f>& positions = mesh.positions.at(0);
    if (mesh.triangles.empty() || !is_closed(weld(positions), mesh.triangles))
        throw InputError({path}, fmt::format("'{}' is no closed surface, and has no inside", mesh.name),
                         "bake it to .ply or .obj");
    const double voxel = voxel_of(positions, mesh.triangles);
    if (!(voxel > 0.0)) throw InputError({path}, fmt::format("'{}' has no size", mesh.name), "scale it up");
    std::vector<openvdb::Vec3s> points;
    points.reserve(positions.size());
    for (const Vec3f& p : positions) points.emplace_back(p.x(), p.y(), p.z());
    std::vector<openvdb::Vec3I> triangles;
    triangles.reserve(mesh.triangles.size());
    for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    openvdb::initialize();
    const FloatGrid::Ptr grid = openvdb::tools::meshToLevelSet<FloatGrid>(
        *openvdb::math::Transform::createLinearTransform(voxel), points, triangles);
    grid->setName(mesh.name);
    std::ostringstream bytes;
    openvdb::io::Stream(bytes).write(openvdb::GridPtrVec{grid});
    AtomicFile file(path);
    file.write(bytes.str());
    file.commit();
}

} // namespace marram
