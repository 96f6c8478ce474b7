// SPDX-License-Identifier: Apache-2.0
// Rock as a level set: it wears at the given rate, independently of its orientation to the grid, and never
// grows.
#include "procedural/erosion/level_set.h"
#include "tests/unit/erosion/rock_shapes.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstdio>
#include <limits>
#include <string>

namespace marram::testing {
namespace {

LevelSet level_set_of(const LevelMesh& mesh, double voxel) {
    return LevelSet::from_mesh(mesh.positions, mesh.triangles, voxel);
}

// Nonuniform wear: 0 in places, at most a voxel.
std::vector<double> patchy_wear(const LevelMesh& mesh, double voxel, uint64_t seed) {
    std::vector<double> depth(mesh.vertex_count());
    for (size_t v = 0; v < depth.size(); ++v) {
        const Vec3d p = vertex_of(mesh, v);
        const double wave =
            std::sin(9.0 * p.x() + double(seed)) * std::cos(11.0 * p.y()) + 0.3 * std::sin(25.0 * p.z());
        depth[v] = voxel * std::max(0.0, wave);
    }
    return depth;
}

TEST(LevelSet, ASphereShrinksAtTheSpeedOfItsWear) {
    const SphereWear coarse = wear_sphere(0.1), fine = wear_sphere(0.05);
    std::printf("error / h: %.4f, %.4f\n", coarse.error / 0.1, fine.error / 0.05);
    EXPECT_LT(fine.error, 0.02 * 0.05);
    EXPECT_GE(std::log2(coarse.error / fine.error), 1.0); // order
    EXPECT_LT(fine.spread, 0.15 * 0.05);
}

TEST(LevelSet, WhatGoesIsTheIntegralOfTheWear) {
    const SphereWear wear = wear_sphere(0.08);
    EXPECT_NEAR(wear.removed / wear.integral, 1.0, 2e-3);

    const LevelMesh box = rock_box(Vec3d::Zero(), {0.5, 0.4, 0.3},
                                   Eigen::AngleAxisd(0.4, Vec3d(1, 2, 3).normalized()).toRotationMatrix());
    LevelSet rock = level_set_of(box, 0.02);
    double integral = 0.0;
    const double before = mesh_volume(rock.mesh());
    for (uint64_t pass = 0; pass < 6; ++pass) {
        const LevelMesh mesh = rock.mesh();
        const std::vector<double> depth = patchy_wear(mesh, 0.02, pass);
        for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
            const uint32_t* const c = mesh.triangles.data() + t;
            const Vec3d a = vertex_of(mesh, c[0]), b = vertex_of(mesh, c[1]) - a,
                        d = vertex_of(mesh, c[2]) - a;
            integral += 0.5 * b.cross(d).norm() * (depth[c[0]] + depth[c[1]] + depth[c[2]]) / 3.0;
        }
        rock.advance(depth);
    }
    const double removed = before - mesh_volume(rock.mesh());
    std::printf("removed / integral: %.4f\n", removed / integral);
    EXPECT_NEAR(removed / integral, 1.0, 0.05); // at edges the wear of adjacent faces overlaps
}

TEST(LevelSet, APlaneWearsEvenlyAtAnyAngleToTheGrid) {
    for (const double x : {0.0, 0.4636}) {
        const double h = 1.0 / 40.0;
        const PlaneWear wear = wear_plane(x, 0.3, h, 0.37);
        EXPECT_NEAR(wear.mean, 0.0, 2e-3 * h) << x;
        EXPECT_GT(wear.least, -0.05 * h) << x;
        EXPECT_LT(wear.greatest, 0.05 * h) << x;
    }
}

TEST(LevelSet, RockIsNeverAdded) {
    const LevelMesh box = rock_box({0.1, 0.2, 0.3}, {0.5, 0.4, 0.3},
                                   Eigen::AngleAxisd(0.7, Vec3d(1, 1, 3).normalized()).toRotationMatrix());
    LevelSet rock = level_set_of(box, 0.03);
    std::vector<float> distance;
    for (uint64_t pass = 0; pass < 8; ++pass) {
        const LevelSet before(rock);
        const double volume = mesh_volume(rock.mesh());
        rock.advance(patchy_wear(rock.mesh(), 0.03, pass));
        EXPECT_LT(mesh_volume(rock.mesh()), volume);
        distance.resize(rock.mesh().vertex_count());
        before.sample(rock.mesh().positions, distance);
        // Both surfaces are interpolated between voxels, which differs at creases.
        EXPECT_LT(*std::max_element(distance.begin(), distance.end()), 0.1F * 0.03F) << pass;
    }
}

TEST(LevelSet, WithoutWearItStaysToTheBit) {
    const LevelMesh box =
        rock_box(Vec3d::Zero(), {0.5, 0.4, 0.3}, Eigen::AngleAxisd(0.7, Vec3d::UnitX()).toRotationMatrix());
    LevelSet rock = level_set_of(box, 0.04);
    const std::vector<float> before = rock.mesh().positions;
    for (int pass = 0; pass < 20; ++pass) rock.advance(std::vector<double>(rock.mesh().vertex_count(), 0.0));
    EXPECT_EQ(rock.mesh().positions, before);
}

TEST(LevelSet, AVertexWearsWithinOneVoxelWhateverItIsTold) {
    const LevelMesh ball = rock_sphere(Vec3d::Zero(), 1.0, 60);
    for (const double depth : {1e30, std::numeric_limits<double>::infinity(), -1.0, std::nan("")}) {
        LevelSet rock = level_set_of(ball, 0.1);
        const double before = mesh_volume(rock.mesh());
        rock.advance(std::vector<double>(rock.mesh().vertex_count(), depth));
        const double radius = depth > 0.0 ? 0.9 : 1.0;
        EXPECT_NEAR(mesh_volume(rock.mesh()), before * radius * radius * radius, 0.02 * before) << depth;
    }
    LevelSet rock = level_set_of(ball, 0.1);
    EXPECT_THROW(rock.advance({}), LevelSetError);
}

TEST(LevelSet, WearsAwayToNothing) {
    LevelSet rock = level_set_of(rock_sphere(Vec3d::Zero(), 0.35, 40), 0.1);
    for (int pass = 0; pass < 6; ++pass) rock.advance(std::vector<double>(rock.mesh().vertex_count(), 0.1));
    EXPECT_TRUE(rock.empty());
    EXPECT_EQ(rock.mesh().triangle_count(), 0u);
    rock.advance({});
    EXPECT_TRUE(rock.refined(0.0).empty());
}

TEST(LevelSet, MeshesAreClosedAndFaceOutward) {
    LevelSet rock = level_set_of(
        rock_box(Vec3d::Zero(), {0.5, 0.4, 0.3}, Eigen::AngleAxisd(0.7, Vec3d::UnitX()).toRotationMatrix()),
        0.05);
    rock.advance(patchy_wear(rock.mesh(), 0.05, 3));
    const LevelMesh& mesh = rock.mesh();
    EXPECT_NO_THROW(level_set_of(mesh, 0.05));
    EXPECT_GT(mesh_volume(mesh), 0.3);
    size_t turned = 0; // flipped at creases finer than voxels
    for (size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const uint32_t* const c = mesh.triangles.data() + t;
        const Vec3d a = vertex_of(mesh, c[0]),
                    face = (vertex_of(mesh, c[1]) - a).cross(vertex_of(mesh, c[2]) - a);
        const Vec3d normal = normal_of(mesh, c[0]) + normal_of(mesh, c[1]) + normal_of(mesh, c[2]);
        turned += face.dot(normal) < 0.0;
    }
    EXPECT_LT(turned, mesh.triangle_count() / 300);
}

TEST(LevelSet, HalfTheVoxelSizeIsTheSameSurface) {
    LevelSet ball = level_set_of(rock_sphere({0.3, 0.0, 0.1}, 1.0, 90), 0.1);
    LevelSet fine = ball.refined(0.0), grown = ball.refined(0.05);
    EXPECT_DOUBLE_EQ(fine.voxel(), 0.05);
    double most = 0.0, max_grown = 0.0;
    for (size_t v = 0; v < fine.mesh().vertex_count(); ++v)
        most = std::max(most, std::abs((vertex_of(fine.mesh(), v) - Vec3d(0.3, 0.0, 0.1)).norm() - 1.0));
    for (size_t v = 0; v < grown.mesh().vertex_count(); ++v)
        max_grown =
            std::max(max_grown, std::abs((vertex_of(grown.mesh(), v) - Vec3d(0.3, 0.0, 0.1)).norm() - 1.05));
    EXPECT_LT(most, 0.004);
    EXPECT_LT(max_grown, 0.005);
}

TEST(LevelSet, KeepsWhatIsRockInBoth) {
    LevelSet left = level_set_of(rock_sphere({-0.3, 0.0, 0.0}, 0.5, 60), 0.03);
    const LevelSet right = level_set_of(rock_sphere({0.3, 0.0, 0.0}, 0.5, 60), 0.03);
    left.intersect(right);
    const double cap = 0.2, lens = 2.0 * pi * cap * cap * (0.5 - cap / 3.0);
    EXPECT_NEAR(mesh_volume(left.mesh()), lens, 0.02 * lens);
    EXPECT_THROW(left.intersect(level_set_of(rock_sphere(Vec3d::Zero(), 0.5, 40), 0.05)), LevelSetError);
}

TEST(LevelSet, KeepsTheLargestPiece) {
    LevelMesh two = rock_sphere({-0.6, 0.0, 0.0}, 0.5, 60);
    const LevelMesh small = rock_sphere({0.3, 0.0, 0.0}, 0.2, 40);
    const auto first = uint32_t(two.vertex_count());
    two.positions.insert(two.positions.end(), small.positions.begin(), small.positions.end());
    for (const uint32_t v : small.triangles) two.triangles.push_back(first + v);
    LevelSet rock = level_set_of(two, 0.04);
    EXPECT_EQ(rock.keep_largest(), 1u);
    EXPECT_NEAR(mesh_volume(rock.mesh()), 4.0 / 3.0 * pi * 0.125, 0.01);
    EXPECT_EQ(rock.keep_largest(), 0u);
    rock.advance(std::vector<double>(rock.mesh().vertex_count(), 0.04));
    EXPECT_NEAR(mesh_volume(rock.mesh()), 4.0 / 3.0 * pi * std::pow(0.46, 3), 0.01);
}

TEST(LevelSet, IsTheSameForAnyNumberOfThreads) {
    const auto worn = [](size_t threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        LevelSet rock =
            level_set_of(rock_box(Vec3d::Zero(), {0.5, 0.4, 0.3},
                                  Eigen::AngleAxisd(0.7, Vec3d(1, 1, 3).normalized()).toRotationMatrix()),
                         0.04);
        for (uint64_t pass = 0; pass < 3; ++pass) rock.advance(patchy_wear(rock.mesh(), 0.04, pass));
        LevelSet fine = rock.refined(0.02);
        fine.advance(patchy_wear(fine.mesh(), 0.02, 9));
        LevelMesh mesh = fine.mesh();
        mesh.positions.insert(mesh.positions.end(), mesh.normals.begin(), mesh.normals.end());
        return mesh;
    };
    const LevelMesh one = worn(1), two = worn(2);
    EXPECT_EQ(one.positions, two.positions);
    EXPECT_EQ(one.triangles, two.triangles);
}

TEST(LevelMesh, HasQuadsIfAllTrianglesArePairs) {
    LevelMesh mesh;
    mesh.triangles = {0, 1, 2, 0, 2, 3, 3, 2, 4, 3, 4, 5};
    EXPECT_TRUE(has_quads(mesh));
    mesh.triangles[9] = 4, mesh.triangles[10] = 5, mesh.triangles[11] = 3; // the last pair, turned
    EXPECT_FALSE(has_quads(mesh));
    mesh.triangles.resize(9);
    EXPECT_FALSE(has_quads(mesh));
}

TEST(LevelSet, RefusesMeshesThatAreNoRock) {
    const LevelMesh ball = rock_sphere(Vec3d::Zero(), 1.0, 20);
    const auto refused = [](const LevelMesh& mesh, double voxel, const char* why) {
        try {
            level_set_of(mesh, voxel);
            ADD_FAILURE() << "accepted: " << why;
        } catch (const LevelSetError& error) {
            EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
        }
    };
    refused({}, 0.1, "empty");
    refused(ball, 0.0, "voxel size");
    refused(ball, std::nan(""), "voxel size");
    refused(ball, 3.0, "larger than the rock");
    refused(ball, 1e-7, "from the origin");
    refused(ball, 1.0 / 60000.0, "2^27");
    LevelMesh open = ball;
    open.triangles.resize(open.triangles.size() - 3 * 30);
    refused(open, 0.1, "open");
    LevelMesh wrong = ball;
    wrong.triangles[5] = 1u << 30;
    refused(wrong, 0.1, "not there");
    wrong = ball;
    wrong.positions[7] = std::numeric_limits<float>::quiet_NaN();
    refused(wrong, 0.1, "not a number");
    wrong.positions[7] = std::numeric_limits<float>::infinity();
    refused(wrong, 0.1, "infinite");
    LevelMesh flat = ball;
    for (size_t k = 1; k < flat.positions.size(); k += 3) flat.positions[k] = 0.0F;
    refused(flat, 0.1, "larger than the rock");
    LevelMesh line = ball;
    std::fill(line.positions.begin(), line.positions.end(), 0.5F);
    refused(line, 0.1, "no area");
    // Degenerate triangles among valid ones are harmless.
    LevelMesh good = ball;
    for (const uint32_t v : {3u, 3u, 9u, 7u, 7u, 7u}) good.triangles.push_back(v);
    EXPECT_NEAR(mesh_volume(level_set_of(good, 0.05).mesh()), mesh_volume(ball), 0.01);
}

} // namespace
} // namespace marram::testing
