// SPDX-License-Identifier: Apache-2.0
// Lazy patches: every ray hits what it hits when all curves were made before, bit for bit; what no ray meets
// is not made; errors and cancellation while rays are traced.
#include "build_scene.h"

#include "core/trace/hit.h"
#include "core/world/lazy_curves.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <cstring>
#include <random>

namespace marram::testing {
namespace {

// A square that turns within the shutter: 15 degrees, more than two keys can follow at its corners.
const std::string turning_square =
    mesh("ground", "plane",
         "size = [4, 4]\ntransform = { keys = [{ frame = 1, rotate = [0, 0, 0] }, "
         "{ frame = 3, rotate = [0, 60, 0] }] }\n");
const std::string still_square = mesh("ground", "plane", "size = [4, 4]\n");
// More strands a square metre than the turning_square square has, which is as large: patches have 512.
const std::string many = "count = 6000\ncvs = 8\n";

struct LazyCase {
    const char* name;
    std::string text;
    int pieces = -1;
    double shutter = 0.0; // frames to both sides
    bool chooses_keys = false;
    friend std::ostream& operator<<(std::ostream& out, const LazyCase& of) { return out << of.name; }
};

void set_up_lazy(TestScene& scene, const LazyCase& of, bool lazy) {
    scene.settings.frame = 2.0;
    scene.settings.shutter_open = -of.shutter;
    scene.settings.shutter_close = of.shutter;
    scene.settings.motion_keys = of.chooses_keys ? 0 : 3;
    scene.settings.tolerance = 0.025;
    scene.settings.curve_pieces = of.pieces;
    scene.settings.attributes = {"id"};
    scene.settings.lazy = lazy ? Lazy::always : Lazy::never;
}

std::vector<Ray> rays_over_square(const World& world, size_t count) {
    std::mt19937 random(7);
    const auto uniform = [&](double from, double to) {
        return from + (to - from) * double(random()) / 4294967296.0;
    };
    std::vector<Ray> rays(count);
    for (size_t i = 0; i < count; ++i) {
        const Vec3d target(uniform(-2.0, 2.0), uniform(0.0, 0.2), uniform(-2.0, 2.0));
        // Half of them far away, half at a skin.
        const Vec3d from =
            target + (i % 2 == 0 ? 4.0 : 0.1) * Vec3d(uniform(-1, 1), uniform(0.05, 1), uniform(-1, 1));
        rays[i].origin = from.cast<float>();
        rays[i].direction = (target - from).normalized().cast<float>();
        rays[i].time = world.times.size() > 1 ? float(uniform(0.0, 1.0)) : 0.0F;
    }
    return rays;
}

struct Answer {
    bool hit = false, occluded = false;
    SurfacePoint point{};
};

// In parallel: threads meet at patches that nobody has built.
std::vector<Answer> answers_of(const World& world, const std::vector<Ray>& rays) {
    std::vector<Answer> answers(rays.size());
    tbb::parallel_for(size_t{0}, rays.size(), [&](size_t i) {
        answers[i].hit = intersect(world, rays[i], answers[i].point, i % 3 == 0, nullptr);
        answers[i].occluded = occluded(world, rays[i], nullptr);
    });
    return answers;
}

// Straight pieces of a ribbon share the disc at their corner: of eager ones a ray hits the one that Embree finds first.
bool is_same_corner(const SurfacePoint& a, const SurfacePoint& b) {
    return a.distance == b.distance && a.strand == b.strand &&
           std::abs(int(a.primitive) - int(b.primitive)) == 1;
}

void expect_same(const std::vector<Answer>& answers, const std::vector<Answer>& expected, size_t curve_id,
                 bool either_at_corners = false) {
    size_t strands = 0, other = 0;
    for (size_t i = 0; i < answers.size(); ++i) {
        const Answer &a = answers[i], &b = expected[i];
        strands += b.hit && b.point.geometry >= curve_id;
        bool same = a.hit == b.hit && a.occluded == b.occluded;
        if (a.hit && b.hit)
            same = same && a.point.geometry == b.point.geometry && a.point.primitive == b.point.primitive &&
                   a.point.distance == b.point.distance && a.point.position == b.point.position &&
                   a.point.geometric_normal == b.point.geometric_normal && a.point.strand == b.point.strand &&
                   a.point.strand_u == b.point.strand_u && a.point.h == b.point.h &&
                   a.point.error == b.point.error;
        if (!same && either_at_corners) same = a.hit && b.hit && is_same_corner(a.point, b.point);
        other += !same;
    }
    EXPECT_EQ(other, 0U) << "of " << answers.size();
    EXPECT_GT(5 * strands, answers.size());
}

class LazyCurvesTest : public ::testing::TestWithParam<LazyCase> {};

TEST_P(LazyCurvesTest, AreHitAsEagerOnesAre) {
    TestScene eager(GetParam().text), lazy(GetParam().text);
    set_up_lazy(eager, GetParam(), false);
    set_up_lazy(lazy, GetParam(), true);
    const World expected = eager.build();
    const World world = lazy.build();
    ASSERT_TRUE(world.lazy);
    ASSERT_EQ(world.curves[0].pieces, expected.curves[0].pieces);
    ASSERT_EQ(world.curves[0].vertices.size(), expected.curves[0].vertices.size());
    EXPECT_EQ(world.bounds.min(), expected.bounds.min());
    EXPECT_EQ(world.bounds.max(), expected.bounds.max());
    if (GetParam().chooses_keys) {
        EXPECT_FALSE(expected.curve_parts.empty());
    }

    const std::vector<Ray> rays = rays_over_square(world, 30000);
    const std::vector<Answer> wanted = answers_of(expected, rays);
    expect_same(answers_of(world, rays), wanted, world.meshes.size(), world.filtered && !expected.filtered);
    add_lazy_stats(world, lazy.stats);
    EXPECT_GT(lazy.stats.built_patches, 4U);
    // The same CVs.
    for (size_t g = 0; g < world.curves.size(); ++g) {
        const CurveGeometry &mine = world.curves[g], &its = expected.curves[g];
        const size_t floats = 4 * mine.layout().vertex_count();
        for (size_t t = 0; t < its.vertices.size() && lazy.stats.built_patches == lazy.stats.patches; ++t)
            EXPECT_EQ(std::memcmp(mine.vertices[t], its.vertices[t], 4 * floats), 0);
        EXPECT_EQ(mine.attributes[0].name, "id");
    }
    // Merged, with what is not built yet beside it, and merged again.
    const std::vector<Answer> first = answers_of(world, rays);
    for (int pass = 0; pass < 2; ++pass) {
        world.lazy->merge_built_patches();
        expect_same(answers_of(world, rays), first, world.meshes.size());
    }
    EXPECT_FALSE(world.lazy->failed());
}

INSTANTIATE_TEST_SUITE_P(
    All, LazyCurvesTest,
    ::testing::Values(
        LazyCase{"ribbons", still_square + groom("hair", "ground", many + "shape = \"ribbon\"\n")},
        LazyCase{"ribbons in pieces", still_square + groom("hair", "ground", many + "shape = \"ribbon\"\n"),
                 2},
        LazyCase{"round cubics", still_square + groom("hair", "ground", many + "shape = \"round\"\n"), 0},
        LazyCase{"round pieces", still_square + groom("hair", "ground", many + "shape = \"round\"\n"), 3},
        LazyCase{"oriented ribbons",
                 still_square + groom("hair", "ground", many + "shape = \"oriented-ribbon\"\n")},
        LazyCase{"moving ribbons", turning_square + groom("hair", "ground", many + "shape = \"ribbon\"\n"), 0,
                 0.25},
        LazyCase{"moving round pieces",
                 turning_square + groom("hair", "ground", many + "shape = \"round\"\n"), 2, 0.25},
        LazyCase{"ribbons with parts",
                 turning_square + groom("hair", "ground", many + "shape = \"ribbon\"\n"), 0, 0.25, true},
        LazyCase{"round pieces with parts",
                 turning_square + groom("hair", "ground", many + "shape = \"round\"\n"), 2, 0.25, true},
        LazyCase{"two grooms",
                 still_square + groom("hair", "ground", many + "shape = \"round\"\n") +
                     groom("grass", "ground", "count = 1200\nshape = \"ribbon\"\nbasis = \"catmull-rom\"\n"),
                 2}),
    [](const auto& info) {
        std::string name = info.param.name;
        std::ranges::replace(name, ' ', '_');
        return name;
    });

// Merging commits the world's scene again, with what is not lazy: a groom of one patch.
TEST(LazyPatches, AreMergedBesideEagerRoundPieces) {
    const LazyCase mixed{"",
                         still_square + groom("hair", "ground", many + "shape = \"round\"\n") +
                             groom("tuft", "ground", "count = 400\nshape = \"round\"\n"),
                         2};
    TestScene eager(mixed.text), lazy(mixed.text);
    set_up_lazy(eager, mixed, false);
    set_up_lazy(lazy, mixed, true);
    const World expected = eager.build();
    const World world = lazy.build();
    ASSERT_TRUE(world.curves[0].lazy);
    ASSERT_FALSE(world.curves[1].lazy);
    const std::vector<Ray> rays = rays_over_square(world, 20000);
    const std::vector<Answer> wanted = answers_of(expected, rays);
    expect_same(answers_of(world, rays), wanted, world.meshes.size());
    world.lazy->merge_built_patches();
    expect_same(answers_of(world, rays), wanted, world.meshes.size());
    EXPECT_GT(
        std::ranges::count_if(
            wanted, [&](const Answer& a) { return a.hit && a.point.geometry == world.meshes.size() + 1; }),
        100);
}

// The pieces of ribbons tie at their corners: a ray hits the same one in whatever order patches were built and merged.
TEST(LazyPatches, AreHitTheSameInAnyOrder) {
    const LazyCase ribbons{"", still_square + groom("hair", "ground", many + "shape = \"ribbon\"\n"), 2};
    TestScene first(ribbons.text), second(ribbons.text);
    set_up_lazy(first, ribbons, true);
    set_up_lazy(second, ribbons, true);
    const World forward = first.build();
    const World backward = second.build();
    std::vector<Ray> rays = rays_over_square(forward, 30000);
    const std::vector<Answer> wanted = answers_of(forward, rays);
    std::ranges::reverse(rays);
    answers_of(backward, {rays.begin(), rays.begin() + 100});
    backward.lazy->merge_built_patches();
    std::vector<Answer> answers = answers_of(backward, rays);
    std::ranges::reverse(answers);
    expect_same(answers, wanted, forward.meshes.size());
}

TEST(LazyPatches, ThatNoRayMeetsAreNotMade) {
    const LazyCase plain{"", still_square + groom("hair", "ground", "count = 20000\ncvs = 8\n"), 0};
    TestScene scene(plain.text);
    set_up_lazy(scene, plain, true);
    const World world = scene.build();
    Ray ray;
    ray.origin = {-1.8F, 0.05F, -3.0F};
    ray.direction = {0.0F, 0.0F, 1.0F};
    SurfacePoint point;
    EXPECT_TRUE(intersect(world, ray, point, false, nullptr));
    add_lazy_stats(world, scene.stats);
    EXPECT_GT(scene.stats.built_patches, 0U);
    EXPECT_LT(3 * scene.stats.built_patches, scene.stats.patches);
    // Others are not in memory: their CVs are 0.
    const CurveGeometry& curves = world.curves[0];
    size_t without = 0;
    for (uint64_t c = 0; c < curves.curve_count; ++c) without += cv(curves, 0, c, 0).isZero();
    EXPECT_GT(2 * without, curves.curve_count);
}

TEST(LazyPatches, AreNotMadeForCurvesThatOthersRead) {
    const LazyCase plain{"",
                         still_square + groom("hair", "ground", many) +
                             "[[procedural]]\ntype = \"strands\"\nname = \"copy\"\n" +
                             "curves = \"hair\"\nwidth = 0.01\n",
                         0};
    TestScene scene(plain.text);
    set_up_lazy(scene, plain, true);
    const World world = scene.build();
    EXPECT_FALSE(world.curves[0].lazy);
}

// A cancelled frame keeps the samples that were under way: patches are built all the same.
TEST(LazyPatches, AreBuiltAlthoughTheFrameIsCancelled) {
    const LazyCase plain{"", still_square + groom("hair", "ground", many), 0};
    TestScene eager(plain.text), lazy(plain.text);
    set_up_lazy(eager, plain, false);
    set_up_lazy(lazy, plain, true);
    const World expected = eager.build();
    const World world = lazy.build();
    lazy.cancel = true;
    const std::vector<Ray> rays = rays_over_square(world, 2000);
    expect_same(answers_of(world, rays), answers_of(expected, rays), world.meshes.size());
    EXPECT_FALSE(world.lazy->failed());
}

class LazyFault : public ::testing::TestWithParam<std::pair<const char*, const char*>> {};
TEST_P(LazyFault, IsThrownAfterThePass) {
    TestScene scene(mesh("ground", "plane") +
                    "\n[[procedural]]\ntype = \"faulty_curves\"\nname = \"broken\"\nfault = \"" +
                    GetParam().first + "\"\n");
    scene.settings.lazy = Lazy::always;
    scene.settings.curve_pieces = 0;
    const World world = scene.build();
    ASSERT_TRUE(world.lazy);
    tbb::parallel_for(0, 100, [&](int i) { // curves stand at 0 ... 11 m
        Ray ray;
        ray.origin = {0.12F * float(i), 1.0F, 5.0F};
        ray.direction = {0.0F, 0.0F, -1.0F};
        SurfacePoint point;
        intersect(world, ray, point, false, nullptr);
        occluded(world, ray, nullptr);
    });
    EXPECT_TRUE(world.lazy->failed());
    try {
        world.lazy->raise_failure();
        ADD_FAILURE() << "nothing is thrown";
    } catch (const InputError& error) {
        EXPECT_NE(to_string(error.problems.front()).find(GetParam().second), std::string::npos)
            << to_string(error.problems.front());
    }
}
INSTANTIATE_TEST_SUITE_P(All, LazyFault,
                         ::testing::Values(std::pair{"silent-tessellate", "failed without saying why"},
                                           std::pair{"nan", "a CV is not a finite number"},
                                           std::pair{"lies", "leaves the box of its patch"}),
                         [](const auto& info) {
                             std::string name = info.param.first;
                             std::ranges::replace(name, '-', '_');
                             return name;
                         });

} // namespace
} // namespace marram::testing
