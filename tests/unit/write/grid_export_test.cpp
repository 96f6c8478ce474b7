// SPDX-License-Identifier: Apache-2.0
// Grids and surfaces in files: they are read back together with their placement.
#include "core/image/image.h"
#include "core/math/problem.h"
#include "core/read/grid_placement.h"
#include "core/read/mesh_file.h"
#include "core/write/grid_export.h"
#include "tests/unit/files.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct GridFiles : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_grid_test_" + std::to_string(::getpid()));
    MeshGeometry mesh;

    GridFiles() {
        fs::create_directories(folder);
        constexpr uint32_t nx = 7, nz = 5;
        mesh.name = "desert";
        GridValues& height = mesh.grids.emplace_back();
        height.name = "height";
        height.grid = {nullptr, nx, nz, 1, 1, {-3.3, 0, 10.1}, {{0.1, 0, 0}, {0, 0, 0.1}, {0, 1, 0}},
                       nullptr};
        for (uint32_t i = 0; i < nx * nz; ++i) height.values.push_back(300.0F + std::sin(float(i)) * 20.0F);
        std::vector<Vec3f>& positions = mesh.positions.emplace_back();
        std::vector<Vec3f>& normals = mesh.normals.emplace_back();
        for (uint32_t i = 0; i < nx * nz; ++i) {
            positions.emplace_back(0.1F * float(i % nx), height.values[i], 0.1F * float(i / nx));
            normals.emplace_back(0.0F, 1.0F, 0.0F);
            mesh.uvs.emplace_back(float(i % nx) / 6.0F, float(i / nx) / 4.0F);
        }
        for (uint32_t j = 0; j + 1 < nz; ++j)
            for (uint32_t i = 0; i + 1 < nx; ++i) {
                const uint32_t a = j * nx + i;
                mesh.triangles.push_back({a, a + nx, a + 1});
                mesh.triangles.push_back({a + 1, a + nx, a + nx + 1});
            }
    }
    ~GridFiles() override { fs::remove_all(folder); }
    std::string path(const std::string& name) const { return (folder / name).string(); }
    std::string bytes(const std::string& name) const { return marram::read_file(folder / name); }
};

TEST_F(GridFiles, EveryFormatSaysWhereItLies) {
    const std::vector<float>& height = mesh.grids[0].values;
    const auto [low, high] = std::ranges::minmax(height);
    for (const std::string name : {"a.exr", "a.tif", "a.TIFF", "a.png"}) {
        const bool is_png = name == "a.png";
        write_grids(path(name), mesh);
        const FilePlacement placement = read_placement(path(name));
        ASSERT_TRUE(placement.center && placement.size && placement.range) << name;
        EXPECT_EQ(*placement.center, Vec2d(-3.3 + 0.5 * 0.1 * 6, 10.1 + 0.5 * 0.1 * 4));
        EXPECT_EQ(*placement.size, Vec2d(0.1 * 7, 0.1 * 5));
        EXPECT_EQ(*placement.range, is_png ? Vec2d(double(low), double(high)) : Vec2d(0.0, 1.0));
        const Image image = read_image(path(name), ColorSpace::linear_data);
        ASSERT_EQ(image.width, 7);
        ASSERT_EQ(image.height, 5);
        for (size_t i = 0; i < height.size(); ++i) {
            const float value = image.pixels[i * size_t(image.channels)];
            const double metres =
                placement.range->x() + double(value) * (placement.range->y() - placement.range->x());
            // Half a step, and the rounding of a 16-bit value to a float.
            const double bound = is_png ? (0.5 / 65535.0 + 0x1p-25) * double(high - low) : 0.0;
            ASSERT_LE(std::abs(metres - double(height[i])), bound) << name << i;
        }
    }
    EXPECT_EQ(bytes("a.png").find("tIME"), std::string::npos);
    EXPECT_EQ(read_image(path("a.png"), ColorSpace::linear_data).channels, 1);
}

TEST_F(GridFiles, ALevelTerrainHasARangeToo) {
    std::fill(mesh.grids[0].values.begin(), mesh.grids[0].values.end(), 2.5F);
    write_grids(path("a.png"), mesh);
    EXPECT_EQ(*read_placement(path("a.png")).range, Vec2d(2.5, 3.5));
    for (const float value : read_image(path("a.png"), ColorSpace::linear_data).pixels)
        EXPECT_EQ(value, 0.0F);
}

TEST_F(GridFiles, ARangeMayBeGiven) {
    const std::vector<float>& height = mesh.grids[0].values;
    EXPECT_EQ(write_grids(path("a.png"), mesh, Vec2d(200.0, 400.0)), 0U);
    EXPECT_EQ(*read_placement(path("a.png")).range, Vec2d(200.0, 400.0));
    const std::vector<float> wide = read_image(path("a.png"), ColorSpace::linear_data).pixels;
    for (size_t i = 0; i < height.size(); ++i) EXPECT_NEAR(200.0F + 200.0F * wide[i], height[i], 0.002F);
    const auto above = size_t(std::ranges::count_if(height, [](float v) { return v > 305.0F; }));
    EXPECT_EQ(write_grids(path("a.png"), mesh, Vec2d(0.0, 305.0)), above);
    EXPECT_EQ(std::ranges::count(read_image(path("a.png"), ColorSpace::linear_data).pixels, 1.0F),
              long(above));
}

TEST_F(GridFiles, RefusesPlacesThatCannotBe) {
    const float pixel = 1.0F;
    const Layer layers[] = {{"", {"Y"}, &pixel, false}};
    const auto read = [&](const std::vector<Metadata>& metadata) {
        write_exr(path("a.exr"), 1, 1, layers, metadata);
        return read_placement(path("a.exr"));
    };
    EXPECT_THROW(read({{"marram:size_x", 1.0}}), InputError) << "half of it says nothing";
    EXPECT_THROW(read({{"marram:range_high", 1.0}}), InputError);
    EXPECT_THROW(read({{"marram:range_low", 0.0}, {"marram:range_high", 1e308}}), InputError)
        << "all else would be flat";
    EXPECT_FALSE(read({}).range);
    for (const double size : {0.0, -1.0, double(INFINITY), double(NAN)})
        EXPECT_THROW(read({{"marram:size_x", 1.0}, {"marram:size_z", size}}), InputError) << size;
    EXPECT_THROW(read({{"marram:range_low", std::string("low")}, {"marram:range_high", 1.0}}), InputError);
    EXPECT_EQ(*read({{"marram:range_low", 3.0}, {"marram:range_high", -1.0}}).range, Vec2d(3.0, -1.0));
}

TEST_F(GridFiles, TheSurfaceReadsBackAsAMesh) {
    mesh.attributes = {{"sand", 1, MARRAM_PER_VERTEX, std::vector<float>(35, 0.25F)},
                       {"x", 2, MARRAM_PER_VERTEX, std::vector<float>(70, 0.5F)},
                       {"y", 1, MARRAM_PER_VERTEX, std::vector<float>(35, 0.5F)},
                       {"dune.mask", 1, MARRAM_PER_FACE, std::vector<float>(48, 2.0F)}};
    write_surface_ply(path("a.ply"), mesh);
    const Mesh back = load_mesh(path("a.ply"), false);
    EXPECT_EQ(back.positions, mesh.positions[0]);
    EXPECT_EQ(back.normals, mesh.normals[0]);
    EXPECT_EQ(back.uvs, mesh.uvs);
    EXPECT_EQ(back.triangles, mesh.triangles);
    const std::string text = bytes("a.ply");
    for (const char* property :
         {"property float sand\nproperty float x_0\nproperty float x_1\nproperty float y_1\n",
          "vertex_indices\nproperty float dune_mask\nend_header\n"})
        EXPECT_NE(text.find(property), std::string::npos) << text.substr(0, 600);
    mesh.uvs.clear();
    mesh.normals.clear();
    write_surface_ply(path("b.ply"), mesh);
    EXPECT_EQ(load_mesh(path("b.ply"), false).positions, mesh.positions[0]);
}

} // namespace
} // namespace marram
