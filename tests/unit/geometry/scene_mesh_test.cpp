// SPDX-License-Identifier: Apache-2.0
// Deforming meshes: their shape at any time, and the number of motion keys that they need.
#include "core/geometry/motion_keys.h"

#include <gtest/gtest.h>

namespace marram {
namespace {

// A triangle whose last corner rises to 1 m at frame 2 and is back at 0 at frame 3. It moves along x by 2 m a
// frame.
SceneMesh flapping() {
    SceneMesh mesh;
    mesh.name = "flap";
    mesh.mesh.triangles = {{0, 1, 2}};
    for (const float height : {0.0F, 1.0F, 0.0F}) {
        const std::vector<Vec3f> positions = {{0, 0, 0}, {0, 0, 1}, {1, height, 0}};
        mesh.shapes.push_back(
            {1.0 + double(mesh.shapes.size()), positions, vertex_normals(positions, mesh.mesh.triangles)});
    }
    mesh.mesh.positions = mesh.shapes[0].positions;
    mesh.mesh.normals = mesh.shapes[0].normals;
    mesh.transform = KeyedTransform(
        std::vector<double>{1, 0, 0, 0, 0, 0, 0, 1, 1, 1, 3, 4, 0, 0, 0, 0, 0, 1, 1, 1}, "linear");
    return mesh;
}

} // namespace

TEST(SceneMesh, GoesStraightFromShapeToShapeAndRestsOutside) {
    const SceneMesh mesh = flapping();
    for (const auto& [frame, height, along] :
         {std::tuple(-5.0, 0.0, 0.0), std::tuple(1.0, 0.0, 0.0), std::tuple(1.25, 0.25, 0.5),
          std::tuple(2.0, 1.0, 2.0), std::tuple(2.75, 0.25, 3.5), std::tuple(3.0, 0.0, 4.0),
          std::tuple(9.0, 0.0, 4.0)}) {
        const std::vector<Vec3f> positions = mesh.positions_at(frame), normals = mesh.normals_at(frame);
        ASSERT_EQ(positions.size(), 3U);
        EXPECT_LT((positions[2].cast<double>() - Vec3d(1.0 + along, height, 0.0)).norm(), 1e-6) << frame;
        EXPECT_EQ(mesh.vertices_at(std::array{size_t(2)}, frame)[0].cast<float>(), positions[2]);
        for (const Vec3f& normal : normals) EXPECT_NEAR(normal.norm(), 1.0F, 1e-6F);
    }
    // Normals are interpolated linearly between shapes, and stay close to those of the interpolated shape.
    const std::vector<Vec3f> halfway = mesh.positions_at(1.5);
    EXPECT_GT(mesh.normals_at(1.5)[0].dot(vertex_normals(halfway, mesh.mesh.triangles)[0]), 0.99F);
    SceneMesh facetted = flapping();
    facetted.mesh.normals.clear();
    for (MeshShape& shape : facetted.shapes) shape.normals.clear();
    EXPECT_TRUE(facetted.normals_at(1.5).empty());
}

TEST(SceneMesh, MovesWhileItsShapesDo) {
    SceneMesh mesh = flapping();
    mesh.transform = {};
    EXPECT_TRUE(mesh.moves() && mesh.moves_within(2.9, 3.1) && mesh.moves_within(0.0, 9.0));
    EXPECT_FALSE(mesh.moves_within(3.0, 4.0) || mesh.moves_within(0.0, 1.0) || mesh.moves_within(2.0, 2.0));
    mesh.shapes.clear();
    EXPECT_FALSE(mesh.moves());
}

TEST(SceneMesh, MotionKeysFollowShapes) {
    SceneMesh mesh = flapping();
    EXPECT_EQ(motion_keys_for(mesh, 1e-6, View{}, 1.1, 1.9), 2U) << "straight";
    EXPECT_NEAR(motion_error(mesh, View{}, 2, 1.75, 2.25), 0.25, 1e-6) << "the way bends at frame 2";
    EXPECT_EQ(motion_keys_for(mesh, 1e-6, View{}, 1.75, 2.25), 3U);
    EXPECT_NEAR(motion_error(mesh, View{}, 2, 1.9, 2.1), 0.1, 1e-6);
    EXPECT_EQ(motion_keys_for(mesh, 1e-6, View{}, 1.8, 2.5), 8U) << "two sevenths of the shutter";
    mesh.shapes.clear();
    EXPECT_EQ(motion_keys_for(mesh, 1e-6, View{}, 1.75, 2.25), 2U);
}

// One of 90,000 vertices has a kink in its path.
TEST(SceneMesh, OneVertexAmongManyAsksForItsMotionKeys) {
    SceneMesh mesh;
    mesh.mesh = plane_mesh(Vec2f(3.0F, 3.0F), 300);
    for (const float height : {0.0F, 0.6F, 0.0F}) {
        std::vector<Vec3f> positions = mesh.mesh.positions;
        positions[45677].y() = height;
        mesh.shapes.push_back({1.0 + double(mesh.shapes.size()), positions, mesh.mesh.normals});
    }
    EXPECT_NEAR(motion_error(mesh, View{}, 2, 1.5, 2.5), 0.3, 1e-6);
    EXPECT_EQ(motion_keys_for(mesh, 1e-3, View{}, 1.5, 2.5), 3U);
}

} // namespace marram
