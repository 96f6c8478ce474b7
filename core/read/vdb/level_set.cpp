// SPDX-License-Identifier: Apache-2.0
// OpenVDB level sets as meshes, and back. A child process (child_process.h) sends the narrow band as leaves
// of 8 x 8 x 8 distances.
#include "core/read/vdb/child_process.h"
#include "core/read/vdb/level_set_library.h"
#include "core/read/vdb/velocities.h"

#include <fmt/format.h>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

namespace marram {
namespace {

using openvdb::FloatGrid;

using FloatTree = openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

constexpr uint64_t max_leaves = 0x1p22; // of a file: 2^31 voxels, 9 GB

// What the child process sends: a header, and leaves.
struct BandHeader {
    double matrix[16]; // from voxels to metres, row vectors
    float background;
    uint64_t leaves;
};
struct LeafRecord {
    int32_t origin[3];
    uint64_t active[Leaf::NUM_VALUES / 64];
    float values[Leaf::NUM_VALUES];
};

// ---- The child process ----

// The only level set of floats. Throws Refusal.
FloatGrid::Ptr read_level_set(std::string& bytes) {
    FloatGrid::Ptr found;
    std::string others;
    const openvdb::GridPtrVecPtr grids = grids_of(bytes);
    for (const openvdb::GridBase::Ptr& grid : *grids) {
        if (grid->isType<FloatGrid>() && grid->getGridClass() == openvdb::GRID_LEVEL_SET) {
            if (found)
                throw Refusal{fmt::format("holds several level sets, \"{}\" and \"{}\"", found->getName(),
                                          grid->getName()),
                              "write each to a file of its own"};
            found = openvdb::gridPtrCast<FloatGrid>(grid);
            continue;
        }
        others += (others.empty() ? "" : ", ") + description_of(*grid);
    }
    if (found) return found;
    throw Refusal{others.empty() ? "holds no grids" : "holds no level set of 32-bit floats, but " + others,
                  "write the surface as a level set (signed distances) of floats"};
}

void check_level_set(const FloatGrid& grid) {
    if (!grid.transform().isLinear()) throw Refusal{"has a transform that is not linear", "resample it"};
    const FloatTree& tree = grid.tree();
    auto tiles = tree.cbeginValueOn();
    tiles.setMaxDepth(FloatTree::ValueOnCIter::LEAF_DEPTH - 1);
    if (tiles)
        throw Refusal{"has active tiles", "write a level set whose active voxels are near the surface"};
    if (tree.leafCount() > max_leaves)
        throw Refusal{fmt::format("has {} leaves, the limit is {}", tree.leafCount(), max_leaves),
                      "write it with larger voxels"};
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf)
        for (auto value = leaf->cbeginValueOn(); value; ++value)
            if (!std::isfinite(*value)) throw Refusal{"has a distance that is not finite", "repair it"};
}

void send_grid(int file, const FloatGrid& grid) {
    BandHeader header{};
    const openvdb::Mat4R matrix = grid.transform().baseMap()->getAffineMap()->getMat4();
    std::copy_n(matrix.asPointer(), 16, header.matrix);
    header.background = grid.background();
    header.leaves = grid.tree().leafCount();
    begin_sending(file);
    write_all(file, &header, sizeof header);
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
        LeafRecord record{};
        for (int axis = 0; axis < 3; ++axis) record.origin[axis] = leaf->origin()[axis];
        for (openvdb::Index k = 0; k < Leaf::NUM_VALUES; ++k) {
            record.values[k] = leaf->getValue(k);
            if (leaf->isValueOn(k)) record.active[k / 64] |= uint64_t(1) << (k % 64);
        }
        write_all(file, &record, sizeof record);
    }
}

// ---- The parent ----

// Rebuilds the grid from what the child passes on. Throws Refusal.
FloatGrid::Ptr receive_grid(int file) {
    BandHeader header;
    read_all(file, &header, sizeof header);
    if (header.leaves > max_leaves || !std::isfinite(header.background)) throw damaged_file;
    for (const double number : header.matrix)
        if (!std::isfinite(number)) throw damaged_file;
    const FloatGrid::Ptr grid = FloatGrid::create(header.background);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(openvdb::Mat4R(header.matrix)));
    LeafRecord record;
    for (uint64_t k = 0; k < header.leaves; ++k) {
        read_all(file, &record, sizeof record);
        Leaf* leaf = grid->tree().touchLeaf({record.origin[0], record.origin[1], record.origin[2]});
        for (openvdb::Index n = 0; n < Leaf::NUM_VALUES; ++n)
            leaf->setValueOnly(n, record.values[n]),
                leaf->setActiveState(n, (record.active[n / 64] >> n % 64) & 1U);
    }
    openvdb::tools::signedFloodFill(grid->tree());
    return grid;
}

FloatGrid::Ptr read_band(const std::string& path, std::string& bytes) {
    FloatGrid::Ptr grid;
    read_in_child_process(
        path, bytes,
        [](int pipe, std::string& given) {
            const FloatGrid::Ptr found = read_level_set(given);
            check_level_set(*found);
            send_grid(pipe, *found);
        },
        [&](int pipe) { grid = receive_grid(pipe); });
    return grid;
}

Mesh read_level_set_mesh(const std::string& path, std::string& bytes) {
    const FloatGrid::Ptr grid = read_band(path, bytes);
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec4I> quads;
    openvdb::tools::volumeToMesh(*grid, points, quads);
    if (quads.empty())
        throw InputError(Place{path}, "is a level set without a surface",
                         "write distances that are below 0 inside, and above 0 outside");
    Mesh mesh;
    mesh.positions.reserve(points.size());
    for (const openvdb::Vec3s& p : points) {
        const Vec3f position(p.x(), p.y(), p.z());
        if (!(double(position.cwiseAbs().maxCoeff()) <= embree_limit))
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
    if (grid->transform().baseMap()->getAffineMap()->getMat4().det() < 0.0) // the transform mirrors the faces
        for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    return mesh;
}

std::string level_set_bytes(const std::string& path, const MeshGeometry& mesh, double voxel) {
    const std::vector<Vec3f>& positions = mesh.positions.at(0);
    std::vector<openvdb::Vec3s> points;
    points.reserve(positions.size());
    for (const Vec3f& p : positions) points.emplace_back(p.x(), p.y(), p.z());
    std::vector<openvdb::Vec3I> triangles;
    triangles.reserve(mesh.triangles.size());
    for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    std::ostringstream bytes;
    try {
        openvdb::initialize();
        const FloatGrid::Ptr grid = openvdb::tools::meshToLevelSet<FloatGrid>(
            *openvdb::math::Transform::createLinearTransform(voxel), points, triangles);
        grid->setName(mesh.name);
        openvdb::io::Stream(bytes).write(openvdb::GridPtrVec{grid});
    } catch (const openvdb::Exception& error) {
        throw InputError({path}, fmt::format("'{}' cannot be written: {}", mesh.name, error.what()),
                         "bake it to .ply or .obj");
    }
    return bytes.str();
}

} // namespace

} // namespace marram

extern "C" __attribute__((visibility("default"))) const marram::LevelSetLibrary* marram_level_set_library() {
    static const marram::LevelSetLibrary library = {
        .version = MARRAM_VERSION,
        .size = sizeof(marram::LevelSetLibrary),
        .read = marram::read_level_set_mesh,
        .bytes = marram::level_set_bytes,
        .velocities = marram::read_velocity_grid,
    };
    return &library;
}
