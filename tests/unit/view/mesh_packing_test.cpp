// SPDX-License-Identifier: Apache-2.0
#include "core/view/mesh_packing.h"

#include <gtest/gtest.h>

#include <cmath>

namespace marram {
namespace {

// A wavy square of n x n quads.
MeshGeometry wavy(uint32_t n) {
    MeshGeometry mesh;
    mesh.name = "wavy";
    mesh.positions.resize(1);
    for (uint32_t j = 0; j <= n; ++j)
        for (uint32_t i = 0; i <= n; ++i) {
            const float x = float(i) / float(n), z = float(j) / float(n);
            mesh.positions[0].emplace_back(x, 0.02F * std::sin(9.0F * x), z);
        }
    for (uint32_t j = 0; j < n; ++j)
        for (uint32_t i = 0; i < n; ++i) {
            const uint32_t a = j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
            mesh.triangles.push_back({a, c, b});
            mesh.triangles.push_back({b, c, d});
        }
    return mesh;
}

double area(const MeshGeometry& mesh, const DrawnMesh& drawn) {
    double sum = 0.0;
    const auto at = [&](uint32_t v) { return Vec3d(mesh.positions[0][drawn.vertices[v]].cast<double>()); };
    for (const auto& t : drawn.triangles) sum += 0.5 * (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).y();
    return sum;
}

TEST(MeshPacking, KeepsASmallMesh) {
    const MeshGeometry mesh = wavy(10);
    const DrawnMesh drawn = drawn_mesh(mesh, 1000);
    EXPECT_EQ(drawn.triangles, mesh.triangles);
    EXPECT_EQ(drawn.vertices.size(), mesh.positions[0].size());
}

// Seen from above a thinned square covers the same area, with its faces up.
TEST(MeshPacking, ThinsALargeMesh) {
    const MeshGeometry mesh = wavy(400);
    const double whole = area(mesh, drawn_mesh(mesh, 1'000'000));
    for (const size_t wanted : {1000U, 10'000U, 100'000U}) {
        const DrawnMesh drawn = drawn_mesh(mesh, wanted);
        EXPECT_LE(drawn.triangles.size(), wanted * 3 / 2);
        EXPECT_GE(drawn.triangles.size(), wanted / 3);
        EXPECT_NEAR(area(mesh, drawn), whole, 0.1 * whole);
    }
}

TEST(MeshPacking, MovesTheSameVertices) {
    MeshGeometry mesh = wavy(100);
    const DrawnMesh drawn = drawn_mesh(mesh, 2000);
    for (Vec3f& p : mesh.positions[0]) p.y() += 1.0F;
    EXPECT_EQ(drawn.topology, topology_of(mesh));
    WireMessage message;
    const nlohmann::json offsets = add_mesh_positions(mesh, drawn, message);
    EXPECT_EQ(offsets["normals"], -1);
    for (size_t i = 0; i < drawn.vertices.size(); ++i) {
        Vec3f sent;
        std::memcpy(sent.data(), message.payload.data() + size_t(offsets["positions"]) + 12 * i, 12);
        ASSERT_EQ(sent, mesh.positions[0][drawn.vertices[i]]);
    }
}

} // namespace
} // namespace marram
