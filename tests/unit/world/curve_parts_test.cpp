// SPDX-License-Identifier: Apache-2.0
// Curves that two motion keys follow are traced with two, the others as one part for each span between keys:
// every ray must hit what it hits when all curves have all keys, at every time of the shutter.
#include "build_scene.h"

#include "core/geometry/time_step.h"
#include "core/trace/hit.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <random>

namespace marram::testing {
namespace {

// Grass on a square that turns: the corners move fastest.
const std::string turning = mesh("ground", "plane",
                                 "size = [4, 4]\ntransform = { keys = [{ frame = 1, rotate = [0, 0, 0] }, "
                                 "{ frame = 3, rotate = [0, 60, 0] }] }\n");

struct Case {
    const char* name;
    const char* groom; // nullptr: imported curves that differ in their number of CVs
    int pieces;
    bool beside = false; // others that keep more than two keys
    friend std::ostream& operator<<(std::ostream& out, const Case& of) { return out << of.name; }
};

// Curves of which all need more than two keys.
const std::string wheel = mesh("wheel", "sphere",
                               "transform = { keys = [{ frame = 1, translate = [9, 0, 0] }, { frame = 3, "
                               "translate = [9, 0, 0], rotate = [0, 300, 0] }] }\n") +
                          groom("spokes", "wheel", "count = 500\n");

std::string text_of(const Case& of) {
    if (of.groom) return turning + groom("hair", "ground", of.groom) + (of.beside ? wheel : "");
    return turning +
           "[[curves]]\nname = \"file\"\ntype = \"points\"\npoints = [[0, 0, 0], [0, 1, 0]]\n"
           "[[procedural]]\ntype = \"strands\"\nname = \"hair\"\ncurves = \"file\"\non = \"ground\"\n"
           "width = 0.01\n";
}

// 1600 curves of 3 to 6 CVs on a lattice.
void draw_curves(SceneCurves& curves) {
    curves = {};
    curves.name = "file";
    for (int i = 0; i < 1600; ++i) {
        const Vec3d root(0.0995 * (i % 40) - 1.94, 0.0, 0.0995 * (i / 40) - 1.94);
        std::vector<Vec3d> points;
        for (int k = 0; k < 3 + i % 4; ++k) points.emplace_back(root + Vec3d(0.002 * k * k, 0.04 * k, 0.0));
        curves.add(points, false);
    }
}

void open_shutter(TestScene& scene, const Case& of, uint32_t keys) {
    scene.settings.frame = 2.0;
    scene.settings.shutter_open = -0.25;
    scene.settings.shutter_close = 0.25;
    scene.settings.motion_keys = keys;
    scene.settings.tolerance =
        0.025; // 15 degrees in the shutter: two keys are 0.02 m off at 2.34 m from the axis
    scene.settings.curve_pieces = of.pieces;
}

class CurveParts : public ::testing::TestWithParam<Case> {};

TEST_P(CurveParts, AreHitWhereAllKeysAreHit) {
    TestScene chosen(text_of(GetParam())), whole(text_of(GetParam()));
    if (!GetParam().groom) {
        draw_curves(chosen.geometry.curves[0]);
        draw_curves(whole.geometry.curves[0]);
    }
    open_shutter(chosen, GetParam(), 0);
    const World parts = chosen.build();
    const auto keys = uint32_t(parts.curves[0].vertices.size());
    open_shutter(whole, GetParam(), keys);
    const World all = whole.build();
    ASSERT_GT(keys, 2U);
    ASSERT_EQ(parts.curve_parts.size(), GetParam().beside ? 2 : keys);
    if (GetParam().beside) {
        ASSERT_GT(parts.curves[1].vertices.size(), 2U);
    }
    ASSERT_TRUE(all.curve_parts.empty());
    ASSERT_EQ(parts.curves[0].pieces, all.curves[0].pieces);
    const CurveGeometry& curves = all.curves[0];
    const CurveLayout layout = curves.layout();
    const size_t of_curve = std::max(curves.pieces, 1U);
    EXPECT_EQ(parts.curve_parts[0].primitives->size() + parts.curve_parts[1].primitives->size(),
              layout.segment_count() * of_curve);
    for (size_t i = 2; i < parts.curve_parts.size(); ++i)
        EXPECT_EQ(*parts.curve_parts[i].primitives, *parts.curve_parts[1].primitives);
    std::vector<char> with_all(layout.curve_count); // [curve]
    for (const uint32_t primitive : *parts.curve_parts[1].primitives)
        with_all[curves.offsets.empty() ? primitive / of_curve / (curves.cvs_per_curve - 1)
                                        : curves.curve_of_segment[primitive]] = 1;
    const auto needed = std::ranges::count(with_all, 1);
    EXPECT_GT(needed, 0);
    EXPECT_LE(8 * needed, long(layout.curve_count));

    // Rays at each strand, where its own keys put it: at the keys, just before and after, and in between.
    std::mt19937 random(1);
    size_t rays = 0, met = 0, of_parts = 0, exact = 0;
    double most = 0.0;
    std::vector<float> times = {0.0F, 1.0F};
    for (uint32_t k = 1; k < keys; ++k)
        for (const float within : {-0.5F, -1e-6F, 0.0F, 1e-6F})
            times.push_back(std::min((float(k) + within) / float(keys - 1), 1.0F));
    for (uint64_t c = 0; c < layout.curve_count; ++c)
        for (const float time : times) {
            const auto at = [&](const KeyPair& pair) {
                const auto key = [&](size_t n) -> Vec3d {
                    return Vec3f::Map(curves.vertices[n] + 4 * (layout.first_vertex(c) + 2)).cast<double>();
                };
                return Vec3d(key(pair.before) + pair.within * (key(pair.after) - key(pair.before)));
            };
            const Vec3d target = at(keys_around(keys, time, !with_all[c]));
            most = std::max(most, (target - at(keys_around(keys, time, false))).norm());
            const double turn = 6.28 * double(random()) / 4294967296.0;
            const Vec3d from = target + 0.05 * Vec3d(std::cos(turn), 0.3, std::sin(turn));
            Ray ray;
            ray.origin = from.cast<float>();
            ray.direction = (target - from).normalized().cast<float>();
            ray.time = time;
            SurfacePoint hit, expected;
            ++rays;
            const bool some = intersect(parts, ray, hit, false, nullptr);
            EXPECT_EQ(occluded(parts, ray, nullptr), some);
            if (!some || hit.geometry != parts.meshes.size() || hit.strand != c) continue;
            ++met;
            if (!with_all[c]) continue;
            ++of_parts;
            exact += intersect(all, ray, expected, false, nullptr) && hit.strand == expected.strand &&
                     (hit.position - expected.position).norm() < 1e-5;
        }
    std::printf(
        "[ parts ] %s: %u keys for %ld of %zu curves; %zu of %zu rays hit their strand; with all keys "
        "%zu of %zu at the same point; with two, strands are up to %.3g m off\n",
        GetParam().name, keys, needed, size_t(layout.curve_count), met, rays, exact, of_parts, most);
    EXPECT_GE(double(met), 0.95 * double(rays)); // others hide it
    EXPECT_GE(double(of_parts), 0.95 * double(needed) * double(times.size()));
    EXPECT_EQ(exact, of_parts);
    EXPECT_GT(most, 0.0);
    EXPECT_LE(most, chosen.settings.tolerance / strand_motion_margin);
}

INSTANTIATE_TEST_SUITE_P(
    All, CurveParts,
    ::testing::Values(Case{"cubic ribbons", "count = 1500\nshape = \"ribbon\"\n", 0},
                      Case{"ribbons in pieces", "count = 1500\nshape = \"ribbon\"\n", 2},
                      Case{"round cubics", "count = 1500\nshape = \"round\"\n", 0},
                      Case{"round pieces", "count = 1500\nshape = \"round\"\n", 2},
                      Case{"different CV counts", nullptr, 0},
                      Case{"round pieces beside others", "count = 1500\nshape = \"round\"\n", 2, true},
                      Case{"oriented ribbons", "count = 1500\nshape = \"oriented-ribbon\"\n", 0}),
    [](const auto& info) {
        std::string name = info.param.name;
        std::ranges::replace(name, ' ', '_');
        return name;
    });

// Where many curves need all keys, or the scene sets the keys, no parts are made.
TEST(CurveParts, AreNotMadeWhereTheyCostMore) {
    const Case plain{"", "count = 500\n", 0};
    TestScene scene(turning + groom("hair", "ground", plain.groom));
    open_shutter(scene, plain, 3);
    EXPECT_TRUE(scene.build().curve_parts.empty());
    open_shutter(scene, plain, 0);
    scene.settings.tolerance = 0.004; // nearly all strands turn by more
    EXPECT_TRUE(scene.build().curve_parts.empty());
    EXPECT_GT(scene.stats.chosen.at("hair.more_than_two_keys"), 0.25);
}

} // namespace
} // namespace marram::testing
