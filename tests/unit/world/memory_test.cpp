// SPDX-License-Identifier: Apache-2.0
// The memory that a frame takes: forecasts beside what Embree takes; refusals; lazy patches that are evicted
// and built again.
#include "build_scene.h"

#include "core/math/resident_memory.h"
#include "core/trace/hit.h"
#include "core/world/curve_memory.h"
#include "core/world/lazy_curves.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <tbb/parallel_for.h>

#include <random>

namespace marram::testing {
namespace {

const std::string plain_square = mesh("ground", "plane", "size = [4, 4]\ndivisions = 32\n");
const std::string turned_square =
    mesh("ground", "plane",
         "size = [4, 4]\ntransform = { keys = [{ frame = 1, rotate = [0, 0, 0] }, "
         "{ frame = 3, rotate = [0, 60, 0] }] }\n");

struct MemoryCase {
    const char* name;
    const char* shape;
    int pieces = 0;
    uint32_t keys = 1;
    friend std::ostream& operator<<(std::ostream& out, const MemoryCase& of) { return out << of.name; }
};

class CurveMemoryTest : public ::testing::TestWithParam<MemoryCase> {};

TEST_P(CurveMemoryTest, IsForecast) {
    const MemoryCase& of = GetParam();
    constexpr uint32_t count = 40000, cvs = 8;
    TestScene scene((of.keys > 1 ? turned_square : plain_square) +
                    groom("hair", "ground",
                          "count = " + std::to_string(count) + "\ncvs = 8\nshape = \"" + of.shape + "\"\n"));
    scene.settings.frame = 2.0;
    if (of.keys > 1) scene.settings.shutter_open = -(scene.settings.shutter_close = 0.25);
    scene.settings.motion_keys = of.keys;
    scene.settings.curve_pieces = of.pieces;
    const World world = scene.build();
    CurveBuild item;
    item.procedural = scene.geometry.procedurals[0].get();
    item.output.curve_count = count;
    item.output.cvs_per_curve = cvs;
    item.output.time_count = of.keys;
    item.output.shape = world.curves[0].shape;
    const CurveMemory forecast = curve_memory(item, uint32_t(of.pieces));
    const double primitives = double(count) * (cvs - 1) * std::max(of.pieces, 1);
    const double bvh = double(scene.stats.embree_bytes) - double(forecast.arrays),
                 building = double(scene.stats.embree_peak_bytes) - double(scene.stats.embree_bytes);
    EXPECT_NEAR(bvh / double(forecast.bvh), 1.0, 0.125) << bvh / primitives << " bytes a primitive";
    EXPECT_NEAR(building / double(forecast.building), 1.0, 0.125)
        << building / primitives << " bytes a primitive";
}
INSTANTIATE_TEST_SUITE_P(
    All, CurveMemoryTest,
    ::testing::Values(
        MemoryCase{"round", "round"}, MemoryCase{"ribbon", "ribbon"},
        MemoryCase{"oriented", "oriented-ribbon"}, MemoryCase{"moving_round", "round", 0, 2},
        MemoryCase{"moving_ribbon", "ribbon", 0, 2}, MemoryCase{"three_keys", "ribbon", 0, 3},
        MemoryCase{"pieces", "ribbon", 1}, MemoryCase{"two_pieces", "ribbon", 2},
        MemoryCase{"moving_pieces", "ribbon", 2, 2}, MemoryCase{"pieces_of_three_keys", "ribbon", 2, 3},
        MemoryCase{"round_pieces", "round", 2}, MemoryCase{"moving_oriented", "oriented-ribbon", 0, 2},
        MemoryCase{"oriented_of_three_keys", "oriented-ribbon", 0, 3}, MemoryCase{"five_keys", "round", 0, 5},
        MemoryCase{"pieces_of_five_keys", "round", 2, 5}),
    [](const auto& info) { return std::string(info.param.name); });

// Sanitizers keep what was freed: what is resident says little.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool is_sanitized = true;
#else
constexpr bool is_sanitized = false;
#endif

TEST(Memory, OfTrianglesIsForecast) {
    TestScene scene(mesh("ball", "sphere", "divisions = 400\n"));
    const World world = scene.build();
    EXPECT_NEAR(double(triangle_bvh_bytes(scene.stats.triangles)) / double(scene.stats.embree_peak_bytes),
                1.0, 0.125)
        << double(scene.stats.embree_peak_bytes) / double(scene.stats.triangles) << " bytes a triangle";
}

const std::string lawn =
    plain_square + groom("hair", "ground", "count = 150000\ncvs = 8\nshape = \"round\"\n");

TEST(Memory, ThatDoesNotSufficeIsRefusedBeforeCurvesAreMade) {
    TestScene scene(lawn);
    scene.settings.memory.limit = resident_bytes() + (uint64_t(20) << 20);
    const std::string errors = scene.build_errors();
    EXPECT_NE(errors.find("--memory"), std::string::npos) << errors;
    EXPECT_NE(errors.find("the frame needs more than"), std::string::npos) << errors;
    EXPECT_EQ(scene.stats.cvs, 0U);
    scene.settings.memory.limit = 0;
    EXPECT_EQ(scene.build_errors(), "");
}

// What the caller takes later counts.
TEST(Memory, OfTheFilmIsReserved) {
    TestScene scene(lawn);
    scene.settings.memory = {uint64_t(8) << 30, 0};
    EXPECT_EQ(scene.build_errors(), "");
    scene.settings.memory.reserved = uint64_t(8) << 30;
    EXPECT_NE(scene.build_errors().find("the frame needs"), std::string::npos);
}

TEST(Memory, OfSeveralGroomsIsAddedUp) {
    TestScene scene(lawn + groom("more", "ground", "count = 300000\ncvs = 8\n"));
    scene.settings.memory.limit = resident_bytes() + (uint64_t(20) << 20);
    const auto needed = [&] {
        const std::string errors = scene.build_errors();
        const size_t at = errors.find("more than ");
        return at == std::string::npos ? 0.0 : std::stod(errors.substr(at + 10));
    };
    const double both = needed();
    TestScene one(lawn);
    one.settings.memory = scene.settings.memory;
    const std::string errors = one.build_errors();
    EXPECT_GT(both, std::stod(errors.substr(errors.find("more than ") + 10)) + 0.05) << errors;
}

std::vector<Ray> lawn_rays(size_t count) {
    std::mt19937 random(7);
    const auto uniform = [&](double from, double to) {
        return from + (to - from) * double(random()) / 4294967296.0;
    };
    std::vector<Ray> rays(count);
    for (size_t i = 0; i < count; ++i) { // row by row, as pictures are rendered
        Ray& ray = rays[i];
        const Vec3d target(uniform(-2.0, 2.0), uniform(0.0, 0.2), -2.0 + 4.0 * double(i) / double(count)),
            from = target + 0.3 * Vec3d(uniform(-1, 1), uniform(0.5, 1), uniform(-1, 1));
        ray.origin = from.cast<float>();
        ray.direction = (target - from).normalized().cast<float>();
    }
    return rays;
}

struct MetPoint {
    bool hit = false;
    SurfacePoint point{};
    float id = 0.0F;
};

// As the renderer traces: evicts now and then, and looks at what was hit before it lets go.
std::vector<MetPoint> trace_lawn(const World& world, const std::vector<Ray>& rays) {
    std::vector<MetPoint> met(rays.size());
    const AttributeValues& ids = *attribute(world.curves[0], "id");
    tbb::parallel_for(tbb::blocked_range<size_t>(0, rays.size(), 64), [&](const auto& range) {
        auto kept = world.lazy ? world.lazy->keep() : std::shared_lock<tbb::rw_mutex>();
        for (size_t i = range.begin(); i < range.end(); ++i) {
            if (world.lazy && world.lazy->is_short()) {
                kept.unlock();
                world.lazy->evict_patches();
                kept.lock();
            }
            met[i].hit = intersect(world, rays[i], met[i].point, false, nullptr);
            if (met[i].hit && met[i].point.geometry >= world.meshes.size())
                attribute_at(world.curves[0], ids, met[i].point, &met[i].id);
        }
    });
    return met;
}

size_t differences(const std::vector<MetPoint>& a, const std::vector<MetPoint>& b) {
    size_t different = 0;
    for (size_t i = 0; i < a.size(); ++i)
        different += a[i].hit != b[i].hit ||
                     (a[i].hit && (a[i].point.distance != b[i].point.distance || a[i].id != b[i].id ||
                                   a[i].point.position != b[i].point.position ||
                                   a[i].point.strand_u != b[i].point.strand_u));
    return different;
}

class EvictedPatches : public ::testing::TestWithParam<int> {};

TEST_P(EvictedPatches, AreBuiltAgainToTheSameBits) {
    TestScene eager(lawn), lazy(lawn);
    for (TestScene* scene : {&eager, &lazy}) {
        scene->settings.curve_pieces = GetParam();
        scene->settings.attributes = {"id"};
    }
    lazy.settings.lazy = Lazy::always;
    const std::vector<Ray> rays = lawn_rays(4000);
    std::vector<MetPoint> wanted;
    {
        const World world = eager.build();
        wanted = trace_lawn(world, rays);
    }
    malloc_trim(0);
    lazy.settings.memory = {resident_bytes() + (uint64_t(is_sanitized ? 4096 : 96) << 20),
                            0}; // all patches take more
    const World world = lazy.build();
    ASSERT_TRUE(world.curves[0].lazy);
    uint64_t most = 0;
    for (int pass = 0; pass < 2; ++pass) {
        EXPECT_EQ(differences(trace_lawn(world, rays), wanted), 0U);
        most = std::max(most, resident_bytes());
        world.lazy->merge_built_patches();
    }
    world.lazy->raise_failure();
    EXPECT_LE(most, lazy.settings.memory.limit);
    add_lazy_stats(world, lazy.stats);
    if (!is_sanitized) {
        EXPECT_GT(lazy.stats.evicted_patches, 0U);
        EXPECT_GT(lazy.stats.rebuilt_patches, 0U);
    }
    EXPECT_LE(lazy.stats.built_patches, lazy.stats.patches);
}
INSTANTIATE_TEST_SUITE_P(Pieces, EvictedPatches, ::testing::Values(0, 2));

// Also those that are merged, and a thousand times.
TEST(LazyPatches, AreEvictedInARow) {
    const std::string small =
        plain_square + groom("hair", "ground", "count = 1200\ncvs = 8\nshape = \"round\"\n");
    TestScene scene(small);
    scene.settings.curve_pieces = 2;
    scene.settings.attributes = {"id"};
    scene.settings.lazy = Lazy::always;
    const World world = scene.build();
    auto& lazy = static_cast<LazyWorld&>(*world.lazy);
    const std::vector<Ray> rays = lawn_rays(50);
    const std::vector<MetPoint> wanted = trace_lawn(world, rays);
    for (int i = 0; i < 400; ++i) { // three patches each
        if (i % 10 == 0) lazy.merge_built_patches();
        lazy.evict(0);
        ASSERT_EQ(differences(trace_lawn(world, rays), wanted), 0U) << i;
    }
    lazy.raise_failure();
    if (is_sanitized) return;
    const uint64_t bytes = resident_bytes();
    for (int i = 0; i < 100; ++i) {
        lazy.evict(0);
        trace_lawn(world, rays);
    }
    EXPECT_LT(resident_bytes(), bytes + (uint64_t(4) << 20)); // nothing is lost
}

TEST(LazyPatches, ThatCannotFitAreRefused) {
    TestScene scene(lawn);
    scene.settings.lazy = Lazy::always;
    scene.settings.memory.limit = resident_bytes() + (uint64_t(4) << 20);
    const std::string errors = scene.build_errors();
    EXPECT_NE(errors.find("--memory"), std::string::npos) << errors;
}

} // namespace
} // namespace marram::testing
