// SPDX-License-Identifier: Apache-2.0
// Compares each feature's picture with its golden frame. A change of seed passes; planted faults must be
// found.
#include "tests/golden/goldens.h"
#include "tests/whole.h"

#include "core/compare/compare_page.h"
#include "core/image/atomic_file.h"
#include "core/math/hash.h"
#include "core/plugin/embree.h"
#include "core/trace/curve_pieces.h"
#include "core/trace/round_pieces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <set>

namespace marram::golden {
namespace {

namespace fs = std::filesystem;

Picture golden_frame(const Golden& golden) { return read_picture(path_of(golden)); }

Comparison against_golden(const Picture& picture, const Golden& golden) {
    return compare_pictures(picture, golden_frame(golden), golden.name, path_of(golden));
}

std::string text(const Comparison& comparison) {
    std::string all;
    for (const std::string& fault : comparison.faults) all += "\n  " + fault;
    return all;
}

// Writes a failed picture and a page that shows it beside its golden.
std::string page_of(const Picture& picture, const Golden& golden, const Comparison& comparison) {
    fs::create_directories("golden_failures");
    const std::string path = "golden_failures/" + golden.name;
    Picture alone = picture;
    alone.layers.push_back(*golden_frame(golden).find("variance"));
    write(alone, path + ".exr", golden);
    AtomicFile writer(path + ".html");
    writer.write(compare_page({path + ".exr", picture}, {path_of(golden), golden_frame(golden)}, comparison));
    writer.commit();
    return fs::absolute(path + ".html").string();
}

class Frame : public ::testing::TestWithParam<Golden> {};

TEST_P(Frame, IsAsItWas) {
    const Golden& golden = GetParam();
    const Picture picture = Stage(golden).render(1);
    const Comparison comparison = against_golden(picture, golden);
    EXPECT_TRUE(comparison.golden) << path_of(golden)
                                   << " carries no limits: make it with tests/golden/update";
    EXPECT_TRUE(comparison.alike()) << golden.name << " (" << golden.shows
                                    << ") is not as it was:" << text(comparison) << "\nlook at "
                                    << page_of(picture, golden, comparison)
                                    << "\nif it is meant to be: tests/golden/update " << golden.name
                                    << " --write";
}

INSTANTIATE_TEST_SUITE_P(Golden, Frame, ::testing::ValuesIn(goldens().begin(), goldens().end()),
                         [](const auto& info) { return info.param.name; });

TEST(Golden, FramesTakeNoMoreThanSixMebibytesAndAllAreKnown) {
    size_t bytes = 0;
    for (const auto& entry : fs::directory_iterator(MARRAM_SOURCE_DIR "/scenes/golden")) {
        if (entry.path().extension() != ".exr") continue;
        EXPECT_NO_THROW(golden_named(entry.path().stem().string())) << entry.path();
        bytes += entry.file_size();
    }
    EXPECT_LE(bytes, size_t(6) << 20);
}

// Renders that differ only in their seed, spread over all goldens.
TEST(Golden, AChangeOfSeedIsNoFault) {
    const size_t renders = testing::whole_run() ? 2 * goldens().size() : goldens().size();
    const size_t count = goldens().size();
    size_t alarms = 0, rendered = 0;
    for (size_t g = 0; g < count; ++g) {
        if (!testing::in_this_run(g, 10)) continue;
        const Golden& golden = goldens()[g];
        const Stage stage(golden);
        for (size_t i = g; i < renders; i += count) {
            const Comparison comparison = against_golden(stage.render(hash(uint64_t(0x5eed), i)), golden);
            EXPECT_TRUE(comparison.alike()) << golden.name << ", render " << i << text(comparison);
            alarms += !comparison.alike();
            ++rendered;
        }
    }
    std::printf("%zu false alarms in %zu renders\n", alarms, rendered);
}

// ---- faults ---------------------------------------------------------------------------------------------------------

// Expects the fault to be caught with every seed.
void expect_caught(
    const char* what, const Stage& stage, const Golden& golden,
    const std::function<void(Picture&)>& spoil = [](Picture&) {},
    const std::vector<uint64_t>& seeds = {11, 12, 13}) {
    for (const uint64_t seed : seeds) {
        Picture picture = stage.render(seed);
        spoil(picture);
        const Comparison comparison = against_golden(picture, golden);
        EXPECT_FALSE(comparison.alike()) << golden.name << ": " << what << " passes";
        const ScaleResult* worst = comparison.worst_scale();
        std::printf(
            "%-34s %-10s %8.1f deviations (%.1f) of %2d pixels a side, FLIP %.3f (%.3f), SSIM %.3f (%.3f)\n",
            what, golden.name.c_str(), worst->worst, worst->limit, worst->size, comparison.flip_mean,
            comparison.flip_mean_limit, comparison.ssim, comparison.ssim_limit);
    }
}

void expect_caught(const char* what, const std::string& name, const std::vector<std::string>& faults) {
    const Golden& golden = golden_named(name);
    expect_caught(what, Stage(golden, faults), golden);
}

// Updates the straight pieces that the cubics are traced as.
void edit_pieces(World& world, size_t g) {
    const CurveGeometry& curves = world.curves[g];
    RTCGeometry pieces = rtcGetGeometry(world.scene.get(), unsigned(world.meshes.size() + g));
    for (unsigned time = 0; time < curves.vertices.size(); ++time) {
        write_pieces({curves.vertices[time], curves.curve_count, curves.cvs_per_curve, curves.basis},
                     curves.vertices[0], curves.pieces,
                     static_cast<float*>(rtcGetGeometryBufferData(pieces, RTC_BUFFER_TYPE_VERTEX, time)));
        rtcUpdateGeometryBuffer(pieces, RTC_BUFFER_TYPE_VERTEX, time);
    }
    rtcCommitGeometry(pieces);
}

// Moves CVs in Embree's buffers and rebuilds its BVH.
void edit_curves(World& world, const std::function<void(uint64_t curve, float* vertex)>& edit) {
    ASSERT_TRUE(world.curve_parts.empty()) << "they would have to be committed again";
    for (size_t g = 0; g < world.curves.size(); ++g) {
        const CurveGeometry& curves = world.curves[g];
        RTCGeometry geometry = world.curve_buffers[g].get();
        for (unsigned time = 0; time < curves.vertices.size(); ++time) {
            auto* vertices =
                static_cast<float*>(rtcGetGeometryBufferData(geometry, RTC_BUFFER_TYPE_VERTEX, time));
            for (uint64_t v = 0; v < curves.curve_count * (curves.cvs_per_curve + 2); ++v)
                edit(v / (curves.cvs_per_curve + 2), vertices + 4 * v);
            rtcUpdateGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, time);
        }
        rtcCommitGeometry(geometry);
        if (curves.pieces > 0) edit_pieces(world, g);
    }
    rtcCommitScene(world.scene.get());
    mark_round_pieces(world);
}

} // namespace

TEST(GoldenFault, StrandsOffByHalfAPixel) {
    const Golden& golden = golden_named("still");
    Stage stage(golden);
    // The camera is 3.4 m away; its field of view is 34 degrees over 72 pixels.
    const float half = 0.5F * 3.4F * 2.0F * std::tan(17.0F * 3.14159265F / 180.0F) / 72.0F;
    edit_curves(stage.world(), [&](uint64_t, float* vertex) { vertex[0] += half; });
    expect_caught("strands off by half a pixel", stage, golden);
}

TEST(GoldenFault, AGustIsMissing) {
    expect_caught("the gust placed by hand is missing", "control",
                  {"wind.gusts.control=[{shape=\"sphere\", strength=0, transform={translate=[-0.3, 0.3, "
                   "0.4], scale=0.45}}]"});
    expect_caught("one of eight gusts is missing", "gusts",
                  {"wind.gusts={num_gusts=7, radius_range=[0.4, 0.6], speed_range=[1.5, 2.5], "
                   "start_frame_range=[6, 18], life_range=[40, 60], decay_range=[8, 8], period=0, center=[0, "
                   "0, 0], extent=[1, 1], distance=0.8, seed=2}"});
}

TEST(GoldenFault, JiggleIsOff) { expect_caught("jiggle is off", "jiggle", {"wind.jiggle={frequency=0}"}); }

TEST(GoldenFault, CollisionIsOffForOneStrandInAHundred) {
    const Golden& golden = golden_named("collision");
    Stage stage(golden), without(golden, {"wind.collision={solver=\"none\"}"});
    // 1 % of all strands, taken from those that collision moves by more than a pixel: of the others nothing
    // is visible.
    const CurveGeometry &with = stage.world().curves[0], &other = without.world().curves[0];
    const size_t stride = with.cvs_per_curve + 2, strands = with.curve_count;
    const float pixel = 2.0F * 3.4F * std::tan(17.0F * 3.14159265F / 180.0F) / 72.0F;
    std::vector<uint64_t> held;
    for (uint64_t c = 0; c < strands; ++c) {
        const float *a = with.vertices[0] + 4 * (stride * c + stride - 2),
                    *b = other.vertices[0] + 4 * (stride * c + stride - 2);
        if (std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) > pixel) held.push_back(c);
    }
    ASSERT_GT(held.size(), strands / 20);
    std::set<uint64_t> chosen;
    for (size_t i = 0; i < strands / 100; ++i) chosen.insert(held[i * held.size() / (strands / 100)]);
    size_t at = 0;
    edit_curves(stage.world(), [&](uint64_t curve, float* vertex) {
        const float* theirs = other.vertices[0] + 4 * at++;
        if (chosen.contains(curve)) std::memcpy(vertex, theirs, 4 * sizeof(float));
    });
    std::printf("%zu of %zu strands are held off by more than a pixel; %zu of them are let go\n", held.size(),
                size_t(strands), chosen.size());
    expect_caught("collision off, one strand in 100", stage, golden);
}

// Compares each frame with its scene without the feature that it shows, or with slightly more or less of it.
TEST(GoldenFault, WhatAFrameShowsIsMissed) {
    struct Missing {
        const char *golden, *what;
        std::vector<std::string> changes;
    };
    const std::vector<Missing> all = {
        {"sky", "a sky brighter by 2 %", {"light.sky.strength=0.612"}},
        {"lamp", "a lamp brighter by 2 %", {"light.lamp.radiance=[12.24, 10.2, 7.14]"}},
        {"environment", "the environment turned by 2 degrees", {"light.sky.rotation=32"}},
        {"lens", "a lens smaller by a tenth", {"camera.lens_radius=0.108"}},
        {"moving", "a shutter shorter by a fifth", {"camera.shutter=[-0.4, 0.4]"}},
        {"pan", "no blur", {"camera.shutter=[0, 0]"}},
        {"deform", "a sheet that holds still", {"mesh.sheet.file_frames=[2, 2]"}},
        {"filter", "the default filter", {"film.filter=\"gaussian\"", "film.filter_radius=1.5"}},
        {"noise", "a target half as near", {"film.noise=0.08"}},
        {"boxes",
         "a box that is not turned",
         {"wind.gusts.control=[{shape=\"box\", inner=[0.6, 0.3, 0.6], transform={translate=[0, 0.3, 0.2], "
          "scale=[0.7, 0.4, 0.8]}}, {shape=\"sphere\", strength=-1, transform={translate=[0.2, 0.4, 0.3], "
          "scale=0.3}}]"}},
        {"anchor", "noise that swims", {"wind.noise={amplitude=0.9, frequency=2}"}},
        {"round", "no clumps", {"procedural.grass.clump={size=0.3, amount=0}"}},
        {"oriented", "ribbons that face the camera", {"procedural.grass.shape=\"ribbon\""}},
        {"grass", "blades that let no light through", {"material.leaf.transmission_color=[0, 0, 0]"}},
        {"coast", "far blades that are not widened", {"tolerance_pixels=0.25"}},
        {"sand", "no ripples", {"material.dune.ripple_height=0"}},
        {"strands", "reeds thinner by a third", {"procedural.reed_strands.width=0.02"}},
        {"strands", "grass shorter by a fifth", {"procedural.grass.guides.length=0.4"}},
        {"tussocks",
         "an instance somewhere else",
         {"mesh.mound.instances[1].transform={translate=[-0.03, 0, 2.96], rotate=[0, 37, 0], scale=0.93}"}},
        {"surface", "paint duller by a fifth", {"material.paint.roughness=0.3"}},
        {"clamp", "no clamp", {"film.clamp=0"}},
        {"hair", "hair smoother by a tenth", {"material.hair.roughness=0.36"}},
        {"melanin", "a twentieth more melanin", {"material.melanin.melanin=0.63"}},
        {"bend", "wind weaker by a twentieth", {"wind.speed=5.7"}},
        {"perlin", "one octave less", {"wind.noise={amplitude=0.9, frequency=2, octaves=1}"}},
        {"billow", "noise that stands still", {"wind.noise={type=\"billow\", amplitude=0.9, frequency=2}"}},
        {"wavelet", "Perlin noise", {"wind.noise={amplitude=0.9, frequency=2}"}},
        {"shield", "shelter with a sharp edge", {"wind.shielding={shield=1, spread=0}"}},
        {"shield_cv", "a wake longer by a half", {"wind.shielding={shield=1, shield_per=\"cv\", wake=0.75}"}},
        {"leopard", "spots half as wide", {"material.fur.map_scale=[2, 1]"}},
        {"leopard", "strands combed another way", {"procedural.fur.comb_map=\"textures/leopard.png\""}},
        {"id", "a tint of half as much blue", {"material.fur.tint_color=[0.1, 0.3, 0.45]"}},
        {"steps", "no collision", {"wind.collision={solver=\"none\"}"}},
        {"blur", "no blur", {"camera.shutter=[0, 0]"}},
        {"default", "wind weaker by a tenth", {"wind.speed=7.2"}},
        {"strand", "wind weaker by a tenth", {"wind.speed=5.4"}},
        {"talk", "no gusts", {"wind.gusts.num_gusts=0"}},
        {"talk", "no shelter", {"wind.shielding.shield=0"}},
        {"talk", "no collision", {"wind.collision.solver=\"none\""}},
        {"figure1a", "wind weaker by a tenth", {"wind.speed=1.8"}},
        {"figure1b", "no collision", {"wind.collision.solver=\"none\""}},
        {"figure1c", "no shelter", {"wind.shielding.shield=0"}},
        {"figure2", "wind weaker by a tenth", {"wind.speed=7.2"}},
        {"gust_field", "no gusts", {"wind.gusts.num_gusts=0"}},
        {"dune", "a sun higher by two degrees", {"light.day.direction=[-0.55, 0.405, -1]"}},
        {"fur", "no collision", {"wind.collision.solver=\"none\""}},
        {"fur", "hair rougher by a third", {"material.fur.roughness=0.33"}},
    };
    for (size_t i = 0; i < all.size(); ++i) {
        if (!testing::in_this_run(i, 6)) continue;
        const Missing& missing = all[i];
        const Golden& golden = golden_named(missing.golden);
        expect_caught(missing.what, Stage(golden, missing.changes), golden, [](Picture&) {}, {14});
    }
}

// A square of a layer holds the values of another place.
TEST(GoldenFault, ALayerIsSpoilt) {
    const Golden& golden = golden_named("layers");
    const Picture picture = Stage(golden).render(15);
    ASSERT_TRUE(against_golden(picture, golden).alike());
    for (const std::string& name : golden.layers) {
        Picture spoilt = picture;
        const auto layer = std::ranges::find(spoilt.layers, name, &Picture::Layer::name);
        const size_t channels = layer->channels.size();
        const auto row = [&](int x, int y) {
            return layer->pixels.begin() + long((size_t(y) * size_t(picture.width) + size_t(x)) * channels);
        };
        for (int y = 0; y < 16; ++y) // from the fur to the sky or the floor
            std::copy_n(row(26, 20 + y), 16 * channels, row(3, 3 + y));
        const Comparison comparison = against_golden(spoilt, golden);
        EXPECT_FALSE(comparison.alike()) << name << ": a square of another place passes";
        std::printf("%-10s %s\n", name.c_str(), comparison.alike() ? "" : comparison.faults.front().c_str());
    }
}

TEST(GoldenFault, ASunBrighterByAHundredth) {
    expect_caught("a sun brighter by 1 %", "sun", {"light.sun.irradiance=[3.232, 3.03, 2.727]"});
}

TEST(GoldenFault, ChannelsAreSwapped) {
    const Golden& golden = golden_named("room");
    expect_caught("red and green swapped", Stage(golden), golden, [](Picture& picture) {
        std::vector<float>& p = picture.layers[0].pixels;
        for (size_t i = 0; i < p.size(); i += 3) std::swap(p[i], p[i + 1]);
    });
}

TEST(GoldenFault, OneFirefly) {
    for (const char* name : {"room", "bend"}) {
        const Golden& golden = golden_named(name);
        expect_caught("one firefly", Stage(golden), golden, [](Picture& picture) {
            for (size_t c = 0; c < 3; ++c) picture.layers[0].pixels[3 * (40 * 96 + 48) + c] += 60.0F;
        });
    }
}

} // namespace marram::golden
