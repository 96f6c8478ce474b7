// SPDX-License-Identifier: Apache-2.0
// Velocities of OpenVDB files: what is read, and what is refused.
#include "core/read/velocity_file.h"

#include "core/math/problem.h"
#include "tests/unit/files.h"
#include "tests/unit/read/vdb_files.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <random>

namespace marram::testing {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;

Vec3d shear(const Vec3d& p) { return {1.0 + 2.0 * p.y(), 0.5 * p.z(), -p.x()}; }

struct VelocityFile : ::testing::Test {
    std::string path =
        (fs::temp_directory_path() / ("marram_velocity_" + std::to_string(::getpid()) + ".vdb")).string();
    ~VelocityFile() override { fs::remove(path); }

    void write_bytes(const std::string& bytes) const {
        std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
    }
    std::string refusal(const std::string& name = "") const {
        try {
            read_velocities(path, name);
        } catch (const InputError& error) {
            return to_string(error.problems.at(0));
        }
        return "";
    }
    void expect_refusal(const std::string& text, const std::string& name = "") const {
        EXPECT_NE(refusal(name).find(text), std::string::npos) << text << ": " << refusal(name);
        EXPECT_EQ(refusal(name).find(path), 0u) << refusal(name);
    }
};

TEST_F(VelocityFile, HasTheBoxOfItsActiveVoxels) {
    const auto transform = voxels_of(0.5);
    transform->postScale(openvdb::Vec3d(1.0, 2.0, 1.0));
    transform->postRotate(0.3, openvdb::math::Y_AXIS);
    transform->postTranslate(openvdb::Vec3d(3.0, 0.0, -1.0));
    const auto grid = velocity_grid(Coord(-3, 2, 5), Coord(4, 3, 10), transform, shear);
    write_vdb(path, {grid});
    const auto read = read_velocities(path, "");
    EXPECT_EQ(read->counts, (std::array<uint32_t, 3>{4, 3, 10}));
    EXPECT_FALSE(read->staggered);
    ASSERT_EQ(read->values.size(), 3u * 120u);
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 10; ++k) {
                const Vec3d p = read->origin + read->axes * Vec3d(i, j, k);
                const float* v = read->values.data() + 3 * (i + 4 * (j + 3 * k));
                EXPECT_LT((shear(p) - Vec3d(double(v[0]), double(v[1]), double(v[2]))).norm(), 1e-5);
            }
    EXPECT_EQ(read_velocities(path, ""), read); // in use: not read again
    write_vdb(path, {velocity_grid(Coord(0), Coord(2), transform, shear)});
    EXPECT_EQ(read_velocities(path, "")->counts[2], 2u); // unless the file has changed
}

TEST_F(VelocityFile, IsStaggeredIfItsGridIs) {
    const auto grid = velocity_grid(Coord(0), Coord(3), voxels_of(1.0), shear);
    grid->setGridClass(openvdb::GRID_STAGGERED);
    write_vdb(path, {grid});
    EXPECT_TRUE(read_velocities(path, "")->staggered);
}

openvdb::FloatGrid::Ptr part(const char* name, const openvdb::Vec3d& shift, float value) {
    openvdb::initialize();
    const auto grid = openvdb::FloatGrid::create();
    grid->setName(name);
    const auto transform = voxels_of(0.5);
    transform->preTranslate(shift);
    grid->setTransform(transform);
    grid->fill(openvdb::CoordBBox(Coord(0), Coord(3)), value);
    return grid;
}

// As Houdini writes velocities.
TEST_F(VelocityFile, MayBeThreeGridsOfFloats) {
    const openvdb::Vec3d none(0.0);
    write_vdb(path, {part("density", none, 9.0F), part("vel.x", none, 1.0F), part("vel.y", none, 2.0F),
                     part("vel.z", none, 3.0F)});
    const auto read = read_velocities(path, "");
    EXPECT_FALSE(read->staggered);
    EXPECT_EQ(read->counts[0], 4u);
    EXPECT_EQ(std::vector<float>(read->values.end() - 3, read->values.end()), (std::vector<float>{1, 2, 3}));
    EXPECT_EQ(read->origin, Vec3d(Vec3d::Zero()));
    // On faces: each half a voxel down its axis.
    const auto staggered = [](const char* name, int axis, float value) {
        openvdb::Vec3d shift(0.0);
        shift[axis] = -0.5;
        return part(name, shift, value);
    };
    write_vdb(path, {staggered("v.x", 0, 1.0F), staggered("v.y", 1, 2.0F), staggered("v.z", 2, 3.0F)});
    const auto faces = read_velocities(path, "v");
    EXPECT_TRUE(faces->staggered);
    EXPECT_LT(faces->origin.norm(), 1e-12);
    write_vdb(path, {part("v.x", none, 1.0F), part("v.y", openvdb::Vec3d(0.3, 0, 0), 2.0F),
                     part("v.z", none, 3.0F)});
    expect_refusal("neither in the same place nor on the faces");
}

TEST_F(VelocityFile, IsChosenByName) {
    const auto named = [](const char* name, int count) {
        return velocity_grid(Coord(0), Coord(count), voxels_of(1.0), shear, name);
    };
    write_vdb(path, {named("rest", 2), named("v", 3)});
    EXPECT_EQ(read_velocities(path, "")->counts[0], 3u);
    EXPECT_EQ(read_velocities(path, "rest")->counts[0], 2u);
    expect_refusal("does not hold one vector grid \"vel\", but \"rest\", \"v\": name one", "vel");
    write_vdb(path, {named("left", 2), named("right", 3)});
    expect_refusal("holds several vector grids, \"left\", \"right\": name one");
    write_vdb(path, {named("v", 2), named("vel", 3)});
    expect_refusal("holds several vector grids");
    write_vdb(path, {part("density", openvdb::Vec3d(0.0), 1.0F)});
    expect_refusal("holds no velocities, but \"density\" (float, ");
    write_vdb(path, {});
    expect_refusal("holds no grids");
}

TEST_F(VelocityFile, IsRefusedIfItsNumbersAreNotUsable) {
    const auto grid = velocity_grid(Coord(0), Coord(9), voxels_of(0.1), shear);
    for (const float bad : {std::nanf(""), INFINITY, 2e6F}) {
        grid->tree().setValue(Coord(8, 7, 6), openvdb::Vec3s(0.0F, bad, 0.0F));
        write_vdb(path, {grid});
        expect_refusal("m/s in voxel (8, 7, 6): write finite velocities below 1e+06 m/s");
    }
    write_vdb(path, {openvdb::Vec3SGrid::create()});
    expect_refusal("has no active voxels");
    grid->clear();
    grid->setTransform(openvdb::math::Transform::createFrustumTransform(
        openvdb::BBoxd(openvdb::Vec3d(0), openvdb::Vec3d(10)), 0.5, 3.0));
    grid->tree().setValue(Coord(1, 1, 1), openvdb::Vec3s(1.0F));
    write_vdb(path, {grid});
    expect_refusal("not linear");
}

// A few bytes that stand for 4096^3 voxels, and for 2^93.
TEST_F(VelocityFile, IsRefusedIfItIsHuge) {
    openvdb::initialize();
    const auto grid = openvdb::Vec3SGrid::create();
    grid->sparseFill(openvdb::CoordBBox(Coord(0), Coord(4095)), openvdb::Vec3s(1.0F));
    write_vdb(path, {grid});
    expect_refusal("covers 4096 x 4096 x 4096 voxels, 825 GB; the limit is 67108864 voxels");
    const auto apart = openvdb::Vec3SGrid::create();
    apart->tree().setValue(Coord(-2000000000), openvdb::Vec3s(1.0F));
    apart->tree().setValue(Coord(2000000000), openvdb::Vec3s(1.0F));
    write_vdb(path, {apart});
    expect_refusal("covers 4000000001 x 4000000001 x 4000000001 voxels");
}

TEST_F(VelocityFile, IsRefusedWhereverItIsCut) {
    const std::string whole =
        vdb_bytes({velocity_grid(Coord(0), Coord(20), voxels_of(0.1), shear)}); // 100 KB or so
    for (size_t size = 0; size < whole.size(); size += size < 100 ? 7 : 1024) {
        write_bytes(whole.substr(0, size));
        EXPECT_NE(refusal(), "") << size;
    }
}

// Bytes of every kilobyte are changed, and numbers that claim 16 GB are put in place of others.
TEST_F(VelocityFile, IsReadOrRefusedWhateverIsDamaged) {
    const std::string whole = vdb_bytes({velocity_grid(Coord(0), Coord(20), voxels_of(0.1), shear)});
    std::mt19937 random(20261130);
    const uint64_t huge = uint64_t(16) << 30;
    size_t refused = 0, tried = 0;
    for (size_t begin = 0; begin < whole.size(); begin += 1024) {
        std::string changed = whole;
        const size_t at = begin + random() % std::min<size_t>(1024, whole.size() - begin);
        if (at + sizeof huge <= whole.size() && begin % 2048 == 0)
            std::memcpy(changed.data() + at, &huge, sizeof huge);
        else
            changed[at] = char(random() % 256);
        write_bytes(changed);
        refused += refusal() != "";
        ++tried;
    }
    for (size_t at = 0; at < 1200; at += 40) { // the header, the metadata, the topology
        std::string changed = whole;
        std::memcpy(changed.data() + at, &huge, sizeof huge);
        write_bytes(changed);
        refused += refusal() != "";
        ++tried;
    }
    std::printf("%zu of %zu damaged files refused\n", refused, tried);
    EXPECT_GT(refused, tried / 5);
}

} // namespace
} // namespace marram::testing
