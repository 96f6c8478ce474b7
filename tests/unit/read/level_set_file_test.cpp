// SPDX-License-Identifier: Apache-2.0
#include "core/math/problem.h"
#include "core/read/level_set_file.h"
#include "core/read/mesh_file.h"
#include "core/write/grid_export.h"
#include "tests/unit/files.h"

#include <gtest/gtest.h>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <sstream>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct LevelSetFile : ::testing::Test {
    std::string path =
        (fs::temp_directory_path() / ("marram_level_set_" + std::to_string(::getpid()) + ".vdb")).string();
    ~LevelSetFile() override { fs::remove(path); }

    void write_bytes(const std::string& bytes) const {
        std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
    }
    std::string bytes() const { return marram::read_file(path); }
    void write_grid(const openvdb::GridBase::Ptr& grid) const {
        std::ostringstream out;
        openvdb::io::Stream(out).write(openvdb::GridPtrVec{grid});
        write_bytes(out.str());
    }
    std::string refusal() const {
        try {
            load_mesh(path, true);
        } catch (const InputError& error) {
            return to_string(error.problems.at(0));
        }
        return "";
    }
};

MeshGeometry geometry_of(const Mesh& mesh) {
    MeshGeometry out;
    out.name = "worn";
    out.positions = {mesh.positions};
    out.triangles = mesh.triangles;
    return out;
}

double volume_of(const Mesh& mesh) {
    double sum = 0.0;
    for (const auto& t : mesh.triangles)
        sum += mesh.positions[t[0]].cast<double>().dot(
                   mesh.positions[t[1]].cast<double>().cross(mesh.positions[t[2]].cast<double>())) /
               6.0;
    return sum;
}

TEST_F(LevelSetFile, HoldsAClosedMeshToAFractionOfAVoxel) {
    const Mesh ball =
        sphere_mesh(2.0F, 40, 0.0F, 1.0F); // its seam and poles have several vertices at one place
    write_level_set(path, geometry_of(ball));
    const Mesh back = load_mesh(path, true);
    const double edge = 2.0 * std::sqrt(4.0 * std::numbers::pi * 4.0 / double(ball.triangles.size()));
    EXPECT_GT(back.triangles.size(), ball.triangles.size() / 2);
    double worst = 0.0;
    for (const Vec3f& p : back.positions) worst = std::max(worst, std::abs(double(p.norm()) - 2.0));
    EXPECT_LT(worst, 0.1 * edge);
    EXPECT_NEAR(volume_of(back), volume_of(ball), 0.005 * volume_of(ball)); // positive: faces outwards
    ASSERT_EQ(back.normals.size(), back.positions.size());
    for (size_t v = 0; v < back.normals.size(); ++v)
        EXPECT_GT(back.normals[v].dot(back.positions[v].normalized()), 0.98F);
}

TEST_F(LevelSetFile, HasFineVoxelsWhereTrianglesAreLarge) {
    write_level_set(path, geometry_of(box_mesh(Vec3f(1.0F, 2.0F, 3.0F))));
    const Mesh back = load_mesh(path, true);
    EXPECT_GT(back.triangles.size(), 20000u);
    EXPECT_NEAR(volume_of(back), 6.0, 0.06);
}

TEST_F(LevelSetFile, RefusesASurfaceThatIsOpen) {
    EXPECT_THROW(write_level_set(path, geometry_of(plane_mesh(Vec2f(1, 1), 4))), InputError);
    Mesh ball = sphere_mesh(1.0F, 10, 0.0F, 1.0F);
    ball.triangles.pop_back();
    EXPECT_THROW(write_level_set(path, geometry_of(ball)), InputError);
    EXPECT_FALSE(fs::exists(path));
}

TEST_F(LevelSetFile, KeepsItsTransform) {
    openvdb::initialize();
    const openvdb::FloatGrid::Ptr grid =
        openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0F, openvdb::Vec3f(0.0F), 0.1F);
    grid->transform().postScale(openvdb::Vec3d(1.0, 2.0, -1.0)); // mirrored
    grid->transform().postTranslate(openvdb::Vec3d(5.0, 0.0, 0.0));
    write_grid(grid);
    const Mesh mesh = load_mesh(path, true);
    Eigen::AlignedBox3f box;
    for (const Vec3f& p : mesh.positions) box.extend(p);
    EXPECT_NEAR(box.center().x(), 5.0F, 0.01F);
    EXPECT_NEAR(box.sizes().y(), 4.0F, 0.03F);
    EXPECT_NEAR(volume_of(mesh), 8.0 / 3.0 * std::numbers::pi, 0.1); // faces outwards
}

TEST_F(LevelSetFile, SaysWhatElseItHolds) {
    openvdb::initialize();
    const openvdb::FloatGrid::Ptr fog =
        openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0F, openvdb::Vec3f(0.0F), 0.1F);
    openvdb::tools::sdfToFogVolume(*fog);
    fog->setName("density");
    write_grid(fog);
    EXPECT_NE(
        refusal().find("holds no level set of 32-bit floats, but \"density\" (float, fog volume): write"),
        std::string::npos)
        << refusal();
    const auto sphere = [](const char* name) {
        const openvdb::FloatGrid::Ptr grid =
            openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0F, openvdb::Vec3f(0.0F), 0.1F);
        grid->setName(name);
        return grid;
    };
    std::ostringstream several;
    openvdb::io::Stream(several).write(openvdb::GridPtrVec{sphere("left"), fog, sphere("right")});
    write_bytes(several.str());
    EXPECT_NE(refusal().find("holds several level sets, \"left\" and \"right\": write each"),
              std::string::npos)
        << refusal();
    const openvdb::FloatGrid::Ptr air = sphere("air");
    for (auto value = air->beginValueAll(); value; ++value) value.setValue(std::abs(*value) + 0.1F);
    write_grid(air);
    EXPECT_NE(refusal().find("is a level set without a surface"), std::string::npos) << refusal();
    write_bytes("this is not a level set");
    EXPECT_NE(refusal().find("is no OpenVDB file, or is damaged"), std::string::npos) << refusal();
    write_bytes("");
    EXPECT_NE(refusal(), "");
    const openvdb::FloatGrid::Ptr bad =
        openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1.0F, openvdb::Vec3f(0.0F), 0.1F);
    bad->beginValueOn().setValue(std::nanf(""));
    write_grid(bad);
    EXPECT_NE(refusal().find("not finite"), std::string::npos) << refusal();
}

TEST_F(LevelSetFile, IsRefusedWhereverItIsCut) {
    write_level_set(path, geometry_of(sphere_mesh(1.0F, 4, 0.0F, 1.0F)));
    const std::string whole = bytes();
    for (size_t size = 0; size < whole.size(); size += size < 200 ? 1 : 1 + whole.size() / 60) {
        write_bytes(whole.substr(0, size));
        EXPECT_NE(refusal(), "") << size;
    }
}

// OpenVDB itself does not survive some of these.
TEST_F(LevelSetFile, IsReadOrRefusedWhateverByteIsChanged) {
    write_level_set(path, geometry_of(sphere_mesh(1.0F, 4, 0.0F, 1.0F)));
    const std::string whole = bytes();
    std::mt19937 random(20261127);
    int refused = 0;
    for (int k = 0; k < 60; ++k) {
        std::string changed = whole;
        const size_t at = random() % (k % 2 == 0 ? 2000 : whole.size());
        changed[at] = char(random() % 256);
        write_bytes(changed);
        refused += refusal() != "";
    }
    EXPECT_GT(refused, 5);
}

// An open surface: which side is rock is known by the sign of the distances.
TEST_F(LevelSetFile, OfAnOpenSurfaceFacesAwayFromTheRock) {
    openvdb::initialize();
    const openvdb::FloatGrid::Ptr grid = openvdb::FloatGrid::create(3.0F);
    for (int x = -8; x < 8; ++x)
        for (int z = -8; z < 8; ++z)
            for (int y = -13; y <= -7; ++y) grid->tree().setValue({x, y, z}, float(y) + 10.25F); // rock below
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
    write_grid(grid);
    const Mesh mesh = load_mesh(path, false);
    ASSERT_GT(mesh.triangles.size(), 100u);
    double up = 0.0;
    for (const auto& t : mesh.triangles)
        up += double((mesh.positions[t[1]] - mesh.positions[t[0]])
                         .cross(mesh.positions[t[2]] - mesh.positions[t[0]])
                         .y());
    EXPECT_GT(up, 0.0);
}

TEST_F(LevelSetFile, HasVoxelsOfAUsableSize) {
    EXPECT_THROW(write_level_set(path, geometry_of(sphere_mesh(5e-4F, 40, 0.0F, 1.0F))), InputError);
    Mesh ball = sphere_mesh(1.0F, 40, 0.0F, 1.0F);
    for (Vec3f& p : ball.positions) p.x() += 1e5F;
    EXPECT_THROW(write_level_set(path, geometry_of(ball)), InputError);
    EXPECT_FALSE(fs::exists(path));
}

} // namespace
} // namespace marram
