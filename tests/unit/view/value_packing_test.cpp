// SPDX-License-Identifier: Apache-2.0
#include "core/view/value_packing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace marram {
namespace {

// Two strands of 2 and 3 CVs with a value a CV and one a strand, and a mesh with one a vertex.
struct Valued {
    Valued() {
        CurveGeometry curves;
        curves.name = "grass";
        curves.curve_count = 2;
        curves.offsets = {0, 2, 5};
        vertices.resize(4 * 9);
        curves.vertices = {vertices.data()};
        curves.attributes.push_back({"gust", 1, MARRAM_PER_CV, {1.0F, 2.0F, 3.0F, 4.0F, 5.0F}});
        curves.attributes.push_back({"height", 1, MARRAM_PER_CURVE, {7.0F, 9.0F}});
        curves.attributes.push_back({"direction", 3, MARRAM_PER_CURVE, std::vector<float>(6, 1.0F)});
        world.curves.push_back(curves);
        MeshGeometry mesh;
        mesh.name = "sand";
        mesh.positions = {{Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 0, 1)}};
        mesh.triangles = {{0, 1, 2}};
        mesh.attributes.push_back(
            {"gust", 1, MARRAM_PER_VERTEX, {-1.0F, std::numeric_limits<float>::quiet_NaN(), 2.0F}});
        world.meshes.push_back(mesh);
        selection = select_strands(world, 10, layout_digest(world));
        drawn.push_back(drawn_mesh(world.meshes[0], 100));
        add_strand_positions(world, selection, true, message);
    }
    std::vector<double> read(size_t offset, size_t count) const {
        const double lower = message.header["values"]["lower"], upper = message.header["values"]["upper"];
        std::vector<double> values;
        for (size_t i = 0; i < count; ++i) {
            uint16_t steps = 0;
            std::memcpy(&steps, message.payload.data() + offset + 2 * i, 2);
            values.push_back(lower + steps / 65535.0 * (upper - lower));
        }
        return values;
    }
    std::vector<float> vertices;
    World world;
    StrandSelection selection;
    std::vector<DrawnMesh> drawn;
    WireMessage message;
};

void expect_near(const std::vector<double>& values, const std::vector<double>& wanted, double most) {
    ASSERT_EQ(values.size(), wanted.size());
    for (size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(values[i], wanted[i], most);
}

TEST(ValuePacking, GivesEachVertexTheValueOfItsCv) {
    Valued v;
    add_values(v.world, v.selection, v.drawn, "gust", v.message);
    EXPECT_EQ(v.message.header["values"]["lower"], -1.0);
    EXPECT_EQ(v.message.header["values"]["upper"], 5.0);
    const double half_step = 0.5 * 6.0 / 65535.0 + 1e-12;
    const size_t strands = v.message.header["parts"][0]["chunks"][0]["values"];
    expect_near(v.read(strands, 9), {1, 1, 2, 2, 3, 3, 4, 5, 5}, half_step);
    const size_t mesh = v.message.header["mesh_values"].at(0)["offset"];
    expect_near(v.read(mesh, 3), {-1, -1, 2}, half_step); // not a number: the lowest
}

TEST(ValuePacking, GivesEachVertexTheValueOfItsStrand) {
    Valued v;
    add_values(v.world, v.selection, v.drawn, "height", v.message);
    const size_t strands = v.message.header["parts"][0]["chunks"][0]["values"];
    expect_near(v.read(strands, 9), {7, 7, 7, 7, 9, 9, 9, 9, 9}, 1e-4);
    EXPECT_TRUE(v.message.header["mesh_values"].empty());
}

TEST(ValuePacking, LeavesOutWhatIsNoNumberOrIsNotThere) {
    for (const char* name : {"direction", "nothing"}) {
        Valued v;
        add_values(v.world, v.selection, v.drawn, name, v.message);
        EXPECT_FALSE(v.message.header["parts"][0]["chunks"][0].contains("values"));
        EXPECT_EQ(v.message.header["values"]["upper"], 0.0);
    }
}

} // namespace
} // namespace marram
