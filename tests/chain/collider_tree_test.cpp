// SPDX-License-Identifier: Apache-2.0
// The tree may return too many triangles but never too few: regions are placed around points of known
// triangles.
#include "procedural/wind/collision/collider_tree.h"

#include "core/geometry/mesh.h"
#include "core/math/hash.h"
#include "core/math/nearest_point.h"
#include "procedural/wind/collision/colliders.h"
#include "procedural/wind/collision/near.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <random>
#include <thread>

namespace marram {
namespace {

struct Lent { // meshes at some motion samples, without Embree
    std::vector<Mesh> meshes;
    std::vector<std::vector<std::vector<Vec3f>>> poses; // [mesh][sample]
    std::vector<std::vector<const float*>> pointers;
    std::vector<MarramMesh> lent;
    MarramFrame frame{};

    void finish(uint32_t samples) {
        for (size_t i = 0; i < meshes.size(); ++i) {
            if (poses.size() <= i) poses.push_back({meshes[i].positions});
            pointers.emplace_back();
            for (const auto& pose : poses[i]) pointers.back().push_back(pose.data()->data());
        }
        for (size_t i = 0; i < meshes.size(); ++i)
            lent.push_back({"mesh", uint32_t(i), MARRAM_ALL_ROLES, uint32_t(meshes[i].positions.size()),
                            uint32_t(meshes[i].triangles.size()), uint32_t(poses[i].size()),
                            pointers[i].data(), nullptr, meshes[i].triangles.data()->data(), nullptr});
        frame.time_count = samples;
        frame.mesh_count = uint32_t(lent.size());
        frame.meshes = lent.data();
    }
};

struct Random {
    std::mt19937_64 bits{7};
    double operator()(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(bits);
    }
    Vec3d in_ball() {
        for (;;) {
            const Vec3d v((*this)(-1, 1), (*this)(-1, 1), (*this)(-1, 1));
            if (v.squaredNorm() <= 1.0) return v;
        }
    }
    size_t below(size_t n) { return size_t(bits() % n); }
};

bool names(const std::vector<NearCluster>& found, const MarramMesh* mesh, uint32_t triangle) {
    return std::any_of(found.begin(), found.end(), [&](const NearCluster& near) {
        const uint32_t* first = near.cluster->triangle;
        return near.mesh == mesh->geometry_id &&
               std::find(first, first + near.count, triangle) != first + near.count;
    });
}

// Mean number of triangles returned per query.
double check(const Lent& lent, const ColliderTree& tree, uint32_t time, double size, int count) {
    Random random;
    std::vector<NearCluster> found;
    double named = 0.0;
    for (int i = 0; i < count; ++i) {
        const MarramMesh& mesh = lent.lent[random.below(lent.lent.size())];
        const auto triangle = uint32_t(random.below(mesh.triangle_count));
        const float* positions = mesh.positions[mesh.time_count > 1 ? time : 0];
        double a = random(0, 1), b = random(0, 1);
        if (a + b > 1.0) a = 1.0 - a, b = 1.0 - b;
        Vec3d p[3];
        for (size_t k = 0; k < 3; ++k)
            p[k] = Eigen::Map<const Vec3f>(positions + 3 * size_t(mesh.triangles[3 * size_t(triangle) + k]))
                       .cast<double>();
        const Vec3d on_it = p[0] * (1.0 - a - b) + p[1] * a + p[2] * b;
        const double radius = size * std::pow(10.0, random(-6, -1)),
                     spread = size * std::pow(10.0, random(-3, 0));
        const Vec3d inside = on_it + random.in_ball() * radius * 0.999;
        const bool flat = random.below(2) == 0;
        const Vec3d normal = random.in_ball().normalized();
        // Points whose mean is `inside`.
        std::vector<Vec3d> points(1 + random.below(6));
        Vec3d mean = Vec3d::Zero();
        for (Vec3d& point : points) {
            point = random.in_ball() * spread;
            if (flat) point -= normal * normal.dot(point);
            mean += point / double(points.size());
        }
        SearchRegion region(radius);
        for (const Vec3d& point : points) region.add(point - mean + inside);
        if (flat) region.limit_to_slab(normal);
        EXPECT_TRUE(tree.find(lent.frame.meshes, region, SIZE_MAX, found));
        EXPECT_TRUE(names(found, &mesh, triangle)) << "triangle " << triangle << ", question " << i;
        for (const NearCluster& near : found) named += double(near.count) / count;
    }
    return named;
}

Mesh soup(size_t count, double size, const Vec3d& where) { // triangles of all sizes, some degenerate
    Random random;
    Mesh mesh;
    for (size_t i = 0; i < count; ++i) {
        const Vec3d centre = random.in_ball() * size + where;
        const double extent = size * std::pow(10.0, random(-5, 0));
        for (int k = 0; k < 3; ++k)
            mesh.positions.push_back((centre + random.in_ball() * extent).cast<float>());
        const auto first = uint32_t(3 * i);
        mesh.triangles.push_back({first, first + (i % 10 != 0), first + 2 * (i % 20 != 0)});
    }
    return mesh;
}

} // namespace

TEST(ColliderTree, NamesEveryTriangleThatIsNear) {
    for (const double size : {1e-25, 1e-4, 1.0, 1e5}) {
        for (const double far : {0.0, 1e3}) {
            Lent lent;
            lent.meshes = {soup(3000, size, Vec3d(far, -far, far) * size),
                           soup(7, size, Vec3d(far + 1, -far, far) * size)};
            lent.finish(1);
            const ColliderTree tree(lent.frame, everywhere(), 0);
            check(lent, tree, 0, size, 4000);
        }
    }
}

// Meshes are sorted by place, so an index in the tree is not the one in the frame.
TEST(ColliderTree, KnowsManyMeshesInAnyOrder) {
    Random random;
    Lent lent;
    for (int i = 0; i < 300; ++i)
        lent.meshes.push_back(
            soup(1 + random.below(100), 0.05, random.in_ball().cwiseProduct(Vec3d(1, 0, 1))));
    lent.finish(1);
    const ColliderTree tree(lent.frame, everywhere(), 0);
    check(lent, tree, 0, 0.05, 4000);
}

// From the centre all of a sphere is equally far: the search keeps more than a stack of nodes would hold.
TEST(ColliderTree, FindsTheClosestOfManyThatAreEquallyFar) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 160, 0.0F, 1.0F)};
    lent.finish(1);
    Colliders colliders;
    colliders.lent = lent.frame.meshes;
    colliders.meshes = {lent.frame.meshes};
    colliders.tree = std::make_shared<ColliderTree>(lent.frame, everywhere(), 0);
    Random random;
    for (int i = 0; i < 20; ++i) {
        const Vec3d p = i == 0 ? Vec3d(Vec3d::Zero()) : Vec3d(random.in_ball() * std::pow(10.0, -i / 3.0));
        double least = infinity;
        for (uint32_t t = 0; t < lent.lent[0].triangle_count; ++t)
            least = std::min(least, (nearest_point(colliders.corners(lent.lent[0], t), p) - p).norm());
        const NearestTriangle found = nearest_triangle(colliders, p, 2.0);
        ASSERT_NE(found.mesh, nullptr);
        EXPECT_EQ(found.distance, least);
    }
}

TEST(ColliderTree, HoldsTheSmallestMeshes) {
    for (size_t count = 1; count < 20; ++count) {
        Lent lent;
        lent.meshes = {soup(count, 1.0, Vec3d::Zero())};
        lent.finish(1);
        const ColliderTree tree(lent.frame, everywhere(), 0);
        check(lent, tree, 0, 1.0, 200);
    }
}

TEST(ColliderTree, FollowsMeshesThatMove) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 30, 0.03F, 9.0F), soup(500, 1.0, Vec3d(2, 0, 0))};
    lent.poses = {{lent.meshes[0].positions, lent.meshes[0].positions}};
    for (Vec3f& p : lent.poses[0][1]) p = 3.0F * p + Vec3f(10, 0, 0);
    lent.finish(2);
    const ColliderTree first(lent.frame, everywhere(), 0), second(lent.frame, everywhere(), 1, &first);
    check(lent, first, 0, 1.0, 2000);
    check(lent, second, 1, 1.0, 2000);
}

TEST(ColliderTree, KnowsWhatFliesIntoReachAfterTheFirstSample) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 10, 0.0F, 0.0F)};
    lent.poses = {{lent.meshes[0].positions, lent.meshes[0].positions}};
    for (Vec3f& p : lent.poses[0][0]) p.x() += 50.0F;
    lent.finish(2);
    const Eigen::AlignedBox3d reach(Vec3d::Constant(-2), Vec3d::Constant(2));
    const ColliderTree first(lent.frame, reach, 0), second(lent.frame, reach, 1, &first);
    check(lent, second, 1, 1.0, 1000);
    SearchRegion all(2.0);
    all.add(Vec3d::Zero());
    std::vector<NearCluster> found;
    first.find(lent.frame.meshes, all, SIZE_MAX, found);
    EXPECT_TRUE(found.empty());
}

// The contents of a block are built on first access, by any thread.
TEST(ColliderTree, AnswersManyThreadsAsItAnswersOne) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 60, 0.03F, 9.0F), soup(3000, 1.0, Vec3d(1, 0, 0))};
    // Neighbouring triangles far apart in the table: as many runs as triangles.
    std::shuffle(lent.meshes[0].triangles.begin(), lent.meshes[0].triangles.end(), std::mt19937(3));
    lent.finish(1);
    constexpr size_t questions = 4000;
    const auto ask = [&](const ColliderTree& tree, size_t i) {
        Random random;
        random.bits.seed(i);
        SearchRegion region(std::pow(10.0, random(-4, -1)));
        for (int k = 0; k < 4; ++k) region.add(1.1 * random.in_ball());
        std::vector<NearCluster> found;
        tree.find(lent.frame.meshes, region, 64, found);
        std::vector<uint32_t> named;
        for (const NearCluster& near : found) {
            named.push_back(near.mesh);
            named.insert(named.end(), near.cluster->triangle, near.cluster->triangle + near.count);
        }
        return named;
    };
    const ColliderTree alone(lent.frame, everywhere(), 0);
    check(lent, alone, 0, 1.0, 2000);
    std::vector<std::vector<uint32_t>> expected(questions);
    for (size_t i = 0; i < questions; ++i) expected[i] = ask(alone, i);
    const size_t whole = alone.bytes();
    for (int round = 0; round < 5; ++round) {
        const ColliderTree tree(lent.frame, everywhere(), 0);
        const size_t closed = tree.bytes();
        EXPECT_LT(closed, whole);
        std::atomic<size_t> different = 0;
        std::vector<std::thread> threads;
        for (size_t t = 0; t < 8; ++t)
            threads.emplace_back([&] {
                for (size_t i = 0; i < questions; ++i) different += ask(tree, i) != expected[i];
            });
        for (std::thread& thread : threads) thread.join();
        EXPECT_EQ(different, 0U);
        EXPECT_GT(tree.bytes(), closed);
        EXPECT_LE(tree.bytes(), whole);
    }
}

TEST(ColliderTree, FindsNothingAtInfinityAndWhereThereIsNoNumber) {
    Lent lent;
    lent.meshes = {soup(5, 1.0, Vec3d::Zero())};
    lent.finish(1);
    const ColliderTree tree(lent.frame, everywhere(), 0);
    constexpr double infinity = std::numeric_limits<double>::infinity(),
                     nan = std::numeric_limits<double>::quiet_NaN();
    std::vector<NearCluster> found;
    for (const double x : {infinity, -infinity, nan, 0.0})
        for (const double radius : {infinity, nan, 1.0}) {
            if (x == 0.0 && radius == 1.0) continue;
            SearchRegion region(radius);
            region.add(Vec3d(x, 0, 0));
            region.add(Vec3d(0, 0, 0));
            EXPECT_TRUE(tree.find(lent.frame.meshes, region, SIZE_MAX, found));
            EXPECT_TRUE(found.empty());
        }
}

// The tree is reused in later frames until the geometry or the reach changes.
TEST(ColliderTree, ServesTheNextFramesUntilSomethingChanges) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 10, 0.0F, 0.0F), soup(50, 1.0, Vec3d(2, 0, 0))};
    lent.poses = {{lent.meshes[0].positions}, {lent.meshes[1].positions, lent.meshes[1].positions}};
    lent.finish(2);
    // The scene is only checked for presence.
    lent.frame.colliders = reinterpret_cast<RTCScene>(&lent); // NOLINT
    Eigen::AlignedBox3d reach(Vec3d::Constant(-3.0), Vec3d::Constant(3.0));
    ColliderTrees trees;
    const auto given = [&] {
        Colliders at[2] = {colliders_at(lent.frame, 0), colliders_at(lent.frame, 1)};
        const bool made = trees.build_or_reuse(lent.frame, reach, std::array{&at[0], &at[1]});
        EXPECT_TRUE(at[0].tree && at[1].tree);
        EXPECT_EQ(at[0].tree == at[1].tree, lent.frame.mesh_count == 1); // the other mesh moves
        return made;
    };
    EXPECT_TRUE(given());
    EXPECT_FALSE(given());
    const std::vector<MarramMesh> elsewhere = lent.lent; // a renderer's tables may move
    lent.frame.meshes = elsewhere.data();
    EXPECT_FALSE(given());
    lent.frame.meshes = lent.lent.data();
    const auto change = [&](auto& value, auto other) {
        std::swap(value, other);
        EXPECT_TRUE(given());
        EXPECT_FALSE(given());
        std::swap(value, other);
        EXPECT_TRUE(given());
    };
    float& x = lent.poses[1][1][7].x();
    change(x, std::nextafter(x, 10.0F));
    float& y = lent.poses[0][0][0].y();
    change(y, std::nextafter(y, 10.0F));
    auto& corners = lent.meshes[0].triangles[3];
    change(corners[0], corners[1]);
    change(reach, Eigen::AlignedBox3d(Vec3d::Constant(-2.0), Vec3d::Constant(3.0)));
    change(lent.frame.mesh_count, 1U);
}

// A very large ground must not make the tree coarser around the objects on it.
TEST(ColliderTree, StaysSharpBesideAWideGround) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 100, 0.0F, 0.0F), plane_mesh(Vec2f(1e5F, 1e5F), 1)};
    for (Vec3f& p : lent.meshes[1].positions) p += Vec3f(4e4F, -2.0F, 4e4F);
    lent.finish(1);
    const ColliderTree tree(lent.frame, {Vec3d::Constant(-1.5), Vec3d::Constant(1.5)}, 0);
    const ColliderTree with_ground(lent.frame, {Vec3d::Constant(-3.0), Vec3d::Constant(3.0)}, 0);
    Random random;
    std::vector<NearCluster> found;
    size_t named[2] = {0, 0};
    for (int i = 0; i < 1000; ++i) {
        const Vec3d up = random.in_ball().normalized();
        SearchRegion sweep(1e-4);
        sweep.add(up * 1.001);
        sweep.add(up * 1.02);
        tree.find(lent.frame.meshes, sweep, SIZE_MAX, found);
        named[0] += found.size();
        with_ground.find(lent.frame.meshes, sweep, SIZE_MAX, found);
        named[1] += found.size();
    }
    EXPECT_LE(named[1], named[0] + 100);
}

TEST(ColliderTree, LeavesOutWhatIsOutOfReachOrNotFinite) {
    Lent lent;
    lent.meshes = {sphere_mesh(1.0F, 30, 0.0F, 0.0F)};
    lent.meshes[0].positions[5].x() = std::numeric_limits<float>::quiet_NaN();
    lent.finish(1);
    const Eigen::AlignedBox3d reach(Vec3d(-2, 0.5, -2), Vec3d(2, 2, 2));
    const ColliderTree tree(lent.frame, reach, 0);
    SearchRegion all(10.0);
    all.add(Vec3d::Zero());
    std::vector<NearCluster> found;
    ASSERT_TRUE(tree.find(lent.frame.meshes, all, SIZE_MAX, found));
    std::vector<char> named(lent.lent[0].triangle_count, 0);
    for (const NearCluster& near : found)
        for (uint32_t t = 0; t < near.count; ++t) ++named[near.cluster->triangle[t]];
    for (uint32_t t = 0; t < lent.lent[0].triangle_count; ++t) {
        float highest = -1.0F;
        bool finite = true;
        for (const uint32_t v : lent.meshes[0].triangles[t]) {
            highest = std::max(highest, lent.meshes[0].positions[v].y());
            finite = finite && lent.meshes[0].positions[v].allFinite();
        }
        EXPECT_EQ(named[t], finite && highest >= 0.5F ? 1 : 0) << t;
    }
    EXPECT_FALSE(tree.find(lent.frame.meshes, all, 3, found));
    EXPECT_LE(found.size(), 3U);
}

TEST(ColliderTree, IsEmptyWhereThereIsNothing) {
    Lent lent;
    lent.finish(1);
    const ColliderTree tree(lent.frame, everywhere(), 0);
    EXPECT_TRUE(tree.empty());
    SearchRegion all(10.0);
    all.add(Vec3d::Zero());
    std::vector<NearCluster> found(1);
    EXPECT_TRUE(tree.find(lent.frame.meshes, all, SIZE_MAX, found));
    EXPECT_TRUE(found.empty());
}

// A sector above a skin: the tree rejects nearly all triangles, large or small.
TEST(ColliderTree, PartsAStrandFromTheSkinBelowIt) {
    for (const int divisions : {40, 200}) {
        Lent lent;
        lent.meshes = {sphere_mesh(1.0F, divisions, 0.0F, 0.0F)};
        lent.finish(1);
        const ColliderTree tree(lent.frame, everywhere(), 0);
        Random random;
        std::vector<NearCluster> found;
        size_t named = 0, in_ball = 0;
        for (int i = 0; i < 1000; ++i) {
            const Vec3d up = random.in_ball().normalized(), side = up.unitOrthogonal();
            const Vec3d root = up * 1.01;
            SearchRegion sweep(0.004);
            sweep.add(root);
            sweep.add(root + 0.1 * up);
            sweep.add(root + 0.1 * (up + side));
            sweep.add(root + 0.1 * side);
            tree.find(lent.frame.meshes, sweep, SIZE_MAX, found);
            for (const NearCluster& near : found) named += near.count;
            SearchRegion ball(0.1);
            ball.add(root);
            tree.find(lent.frame.meshes, ball, SIZE_MAX, found);
            for (const NearCluster& near : found) in_ball += near.count;
        }
        std::printf("%6zu triangles: %.1f named of %.1f in the ball around\n",
                    lent.meshes[0].triangles.size(), double(named) / 1000, double(in_ball) / 1000);
        EXPECT_LT(double(named), 0.1 * double(in_ball));
    }
}

} // namespace marram
