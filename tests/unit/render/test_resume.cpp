// SPDX-License-Identifier: Apache-2.0
// A film that is continued from any point equals an uninterrupted render: all sums, and which pixels have
// converged.
#include "tests/unit/render/world_builder.h"
#include "tests/unit/shaders/default_params.h"

#include "core/render/adaptive.h"
#include "core/render/integrator.h"
#include "core/shot/film_part.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <random>
#include <set>
#include <thread>
#include <utility>

namespace marram {
namespace {

using testing::Cv;
using testing::WorldBuilder;

const std::vector<Material> grey = {testing::material_of("diffuse")};
const std::vector<std::string> layers = {"beauty", "alpha", "variance", "normal", "depth", "strand_u", "id"};

// Stalks on a floor in front of the sky: pixels that converge at once, soon and late, and pixels that resume.
class Resume : public ::testing::Test {
  protected:
    Resume() : builder_({0.0, 0.5}) {
        const auto floor = testing::quad({-1.0, 0.0, 1.0}, {2.0, 0.0, 0.0}, {0.0, 0.0, -2.0});
        builder_.mesh({floor.positions}, floor.triangles);
        std::vector<std::vector<Cv>> cvs(2);
        for (int t = 0; t < 2; ++t)
            for (int c = 0; c < 30; ++c)
                for (int i = 0; i < 5; ++i)
                    cvs[size_t(t)].push_back(Cv(0.05 * (c - 15) + 0.02 * t * i, 0.15 * i, 0.05 * (c % 5),
                                                0.008 * (1.0 - 0.2 * i)));
        builder_.curves(cvs, 5, MARRAM_ROUND, MARRAM_BSPLINE);
        AttributeValues id{"id", 1, MARRAM_PER_CURVE, {}};
        for (int c = 0; c < 30; ++c) id.values.push_back(float(c));
        id.discrete = true;
        builder_.world.curves[0].attributes = {id};
        builder_.commit();
        camera_.poses = {look_at({0.0, 0.5, 3.0}, {0.0, 0.3, 0.0}, Vec3d::UnitY())};
    }

    Film empty() const { return make_film(36, 24, layers, builder_.world); }
    RenderStats continue_render(Film& film, uint32_t samples, RenderProgress* progress = nullptr) const {
        RenderSettings settings;
        settings.samples = samples;
        settings.noise_threshold = noise;
        settings.max_depth = 3;
        return render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film,
                      progress);
    }
    Film uninterrupted_render(uint32_t samples) const {
        Film film = empty();
        continue_render(film, samples);
        return film;
    }
    static void expect_same(const Film& a, const Film& b) {
        EXPECT_TRUE(a.sums == b.sums);
        EXPECT_EQ(a.counts, b.counts);
        EXPECT_TRUE(a.pixel_states == b.pixel_states);
        EXPECT_TRUE(a.catchers == b.catchers);
        for (size_t i = 0; i < a.layers.size(); ++i)
            EXPECT_EQ(a.layers[i].values, b.layers[i].values) << a.layers[i].name;
    }

    double noise = 0.0;
    std::vector<LightDescription> lights = {SkyLight{}, SunLight{Vec3d(1.0, 2.0, 1.0)}};
    WorldBuilder builder_;
    Camera camera_;
};

TEST_F(Resume, FewerSamplesBecomeMore) {
    for (const double target : {0.0, 0.02, 0.04}) {
        noise = target;
        Film film = empty();
        for (const uint32_t samples : {1U, 3U, 5U, 16U, 21U, 22U, 48U, 75U, 120U}) {
            const RenderStats stats = continue_render(film, samples);
            EXPECT_FALSE(stats.cancelled);
            expect_same(film, uninterrupted_render(samples));
        }
        std::set<uint32_t> counts;
        for (const FilmPixel& pixel : film.pixel_states) counts.insert(pixel.samples);
        EXPECT_EQ(counts.size() >= 4, target > 0.0) << "pixels are done at different times";
    }
}

// A pass that exceeds the time stops where it is. The first pass is completed, so that there is a picture.
TEST_F(Resume, WhenTimeIsUp) {
    Film film = empty();
    RenderSettings settings;
    settings.samples = 40;
    settings.max_depth = 3;
    settings.seconds = 1e-9;
    const auto in_no_time = [&] {
        return render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film);
    };
    EXPECT_TRUE(in_no_time().out_of_time);
    EXPECT_EQ(count_samples(film).total, film.pixel_states.size());
    EXPECT_TRUE(in_no_time().out_of_time);
    EXPECT_EQ(count_samples(film).total, film.pixel_states.size()) << "not a sample of a pass of three";
    continue_render(film, 40);
    expect_same(film, uninterrupted_render(40));
}

// A clock that advances by a fixed cost per sample. The given time is used up for any pass sizes, and pixels
// stay even.
TEST_F(Resume, UsesTheTimeThatItIsGiven) {
    tbb::task_arena one_thread(1);
    one_thread.execute([&] {
        constexpr double cost = 0.25; // seconds a sample: powers of two, so that sums are exact
        for (const double samples : {1.5, 2.0, 3.25, 4.0, 7.0, 15.5, 17.0, 30.0, 63.0, 100.25}) {
            Film film = empty();
            const double pixels = double(film.pixel_states.size());
            RenderSettings settings;
            settings.samples = 4096;
            settings.max_depth = 1;
            settings.seconds = samples * pixels * cost;
            settings.clock = [&] { return 1000.0 + cost * double(count_samples(film).total); };
            const RenderStats stats =
                render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film);
            EXPECT_TRUE(stats.out_of_time);
            const double used = cost * double(count_samples(film).total) / settings.seconds;
            EXPECT_GT(used, 0.95) << samples;
            EXPECT_LT(used, 1.05) << samples;
            const auto [least, most] =
                std::ranges::minmax_element(film.pixel_states, {}, &FilmPixel::samples);
            EXPECT_LE(most->samples - least->samples, 1U) << samples;
        }
    });
}

// A checkpoint finds an even film in time, and the bits are those of whole passes.
TEST_F(Resume, SplitsPassesForWhoAsksBetweenThem) {
    tbb::task_arena one_thread(1);
    one_thread.execute([&] {
        for (const double target : {0.0, 0.02})
            for (const double samples : {0.25, 2.0, 9.0, 40.0}) { // between two calls, aimed at
                noise = target;
                const Film whole = uninterrupted_render(100);
                Film film = empty();
                RenderSettings settings;
                settings.samples = 100;
                settings.max_depth = 3;
                settings.noise_threshold = target;
                settings.clock = [&] { return double(count_samples(film).total); };
                RenderProgress progress;
                progress.seconds_between_passes = samples * double(film.pixel_states.size());
                double called = 0.0, longest = 0.0;
                progress.between_passes = [&](Film& now) {
                    EXPECT_EQ(progress_of(now).min, progress_of(now).max);
                    longest = std::max(longest, settings.clock() - std::exchange(called, settings.clock()));
                };
                render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film,
                       &progress);
                expect_same(film, whole);
                EXPECT_LE(longest, std::max(1.0, 0.5 * samples) * double(film.pixel_states.size()))
                    << samples;
                EXPECT_GT(longest, 0.0);
            }
    });
}

// Some pixels have finished the pass, others not: half of them have 16 samples, half 32 or the final 21.
TEST_F(Resume, WithinAPass) {
    for (const double target : {0.0, 0.02, 0.04})
        for (const uint32_t reached : {32U, 21U}) {
            noise = target;
            const Film before = uninterrupted_render(16), after = uninterrupted_render(reached);
            Film film = before;
            for (size_t i = 0; i < film.pixel_states.size(); ++i) {
                if (i % 2 == 0) { // as judged at 16
                    film.pixel_states[i].converged = after.pixel_states[i].converged;
                    film.pixel_states[i].luminance_stddev = after.pixel_states[i].luminance_stddev;
                    continue;
                }
                std::copy_n(after.sums.data() + i * film.stride, film.stride,
                            film.sums.data() + i * film.stride);
                std::copy_n(after.counts.data() + i * layers.size(), layers.size(),
                            film.counts.data() + i * layers.size());
                film.pixel_states[i] = after.pixel_states[i];
            }
            continue_render(film, 100);
            expect_same(film, uninterrupted_render(100));
        }
}

TEST_F(Resume, AfterManyCancels) {
    noise = 0.03;
    constexpr uint32_t samples = 130;
    Film film = empty();
    for (uint64_t part = 1; part < 20; ++part) {
        std::atomic<bool> cancel{false}, over{false};
        RenderProgress progress;
        progress.cancel = &cancel;
        std::thread watcher([&] {
            while (!over && progress.samples_done < part * samples * film.pixel_states.size() / 20)
                std::this_thread::yield();
            cancel = true;
        });
        continue_render(film, samples, &progress);
        over = true;
        watcher.join();
    }
    EXPECT_FALSE(continue_render(film, samples).cancelled);
    expect_same(film, uninterrupted_render(samples));
}

// Samples that are not finite are dropped, but counted.
TEST_F(Resume, DroppedSamplesCount) {
    SunLight blinding{Vec3d(1.0, 2.0, 1.0)};
    blinding.irradiance = Vec3f::Constant(std::numeric_limits<float>::infinity());
    blinding.visible = false;
    lights = {SkyLight{}, blinding};
    Film film = empty();
    const RenderStats first = continue_render(film, 10);
    const RenderStats second = continue_render(film, 50);
    Film whole = empty();
    const RenderStats all = continue_render(whole, 50);
    EXPECT_GT(first.nonfinite_samples, 0U);
    EXPECT_EQ(first.nonfinite_samples + second.nonfinite_samples, all.nonfinite_samples);
    EXPECT_EQ(second.mean_samples, 50.0);
    EXPECT_EQ(second.max_samples, 50U);
    expect_same(film, whole);
}

// Only films of worlds with a shadow catcher have memory for it.
TEST_F(Resume, ShadowCatchersHaveSumsOfTheirOwn) {
    EXPECT_EQ(sizeof(FilmPixel), 96U);
    EXPECT_EQ(empty().catchers.size(), 0U);
    builder_.world.meshes[0].shadow_catcher = true;
    Film film = empty();
    EXPECT_EQ(film.catchers.size(), film.pixel_states.size());
    for (const uint32_t samples : {3U, 5U, 22U, 40U}) {
        continue_render(film, samples);
        expect_same(film, uninterrupted_render(samples));
    }
    EXPECT_TRUE(
        std::ranges::any_of(film.catchers, [](const auto& c) { return c.full.value() > c.lit.value(); }));
    clear(film);
    EXPECT_TRUE(film.catchers == empty().catchers);
}

// A part of the picture has the samples of the whole, also when those depend on the noise of neighbours
// beyond its edges.
TEST_F(Resume, APartOfThePictureHasItsPixels) {
    RenderSettings settings;
    settings.samples = 20;
    settings.max_depth = 3;
    const Crop crop{7, 3, 36, 24};
    const auto trace = [&](Film& film) {
        render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film, nullptr);
    };
    Film whole = empty();
    trace(whole);
    Film part = make_film(20, 17, layers, builder_.world);
    settings.crop = crop;
    trace(part);
    for (uint32_t y = 0; y < part.height; ++y)
        for (uint32_t x = 0; x < part.width; ++x) {
            const size_t a = size_t(y) * part.width + x, b = size_t(y + crop.y) * whole.width + x + crop.x;
            for (uint32_t i = 0; i < part.stride; ++i)
                ASSERT_TRUE(part.sums[a * part.stride + i] == whole.sums[b * whole.stride + i])
                    << x << ", " << y;
        }
}

// Boxes of pixels and samples that fill the picture, cut at random.
void cut(std::mt19937& random, const FilmPart& part, int depth, std::vector<FilmPart>& parts) {
    const uint32_t sizes[] = {part.width(), part.height(), part.end_sample - part.first_sample};
    const uint32_t side = random() % 3;
    if (depth == 0 || sizes[side] < 2) return parts.push_back(part);
    FilmPart a = part, b = part;
    const uint32_t at = 1 + random() % (sizes[side] - 1);
    if (side == 0) a.x1 = b.x0 = part.x0 + at;
    if (side == 1) a.y1 = b.y0 = part.y0 + at;
    if (side == 2) a.end_sample = b.first_sample = part.first_sample + at;
    cut(random, a, depth - 1, parts);
    cut(random, b, depth - 1, parts);
}

// The picture is the sum of its parts: 1,000 random splits, in random order, on one thread or all.
TEST_F(Resume, PartsAddUpToTheWholeBitForBit) {
    builder_.world.meshes[0].shadow_catcher = true;
    const FilmPart picture{0, 0, 14, 10, 0, 23};
    const auto film_of = [&](const FilmPart& part) {
        return make_film(part.width(), part.height(), layers, builder_.world);
    };
    Film whole = film_of(picture);
    continue_render(whole, picture.end_sample);
    std::mt19937 random(5);
    for (int split = 0; split < 1000; ++split) {
        std::vector<FilmPart> parts;
        cut(random, picture, 1 + int(random() % 4), parts);
        std::ranges::shuffle(parts, random);
        Film sum = film_of(picture);
        tbb::task_arena arena(random() % 2 == 0 ? 1 : tbb::task_arena::automatic);
        for (const FilmPart& part : parts) {
            Film film = film_of(part);
            RenderSettings settings;
            settings.max_depth = 3;
            settings.first_sample = part.first_sample;
            settings.samples = part.end_sample;
            settings.crop = Crop{part.x0, part.y0, picture.x1, picture.y1};
            arena.execute([&] {
                render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film);
            });
            add_film(sum, film, part.x0, part.y0);
        }
        resolve(sum);
        for (FilmPixel& pixel : sum.pixel_states) // known from sample pilot_samples on
            if (pixel.luminance_stddev == 0.0F)
                pixel.luminance_stddev =
                    whole.pixel_states[size_t(&pixel - sum.pixel_states.data())].luminance_stddev;
        expect_same(sum, whole);
        ASSERT_FALSE(HasFailure()) << "split " << split << " in " << parts.size() << " parts";
    }
}

// Adaptive sampling goes on round by round from the sum of what is there, in parts of the picture.
TEST_F(Resume, RoundsOfPartsAddUpToTheWhole) {
    noise = 0.03;
    const Film whole = uninterrupted_render(75);
    EXPECT_LT(count_samples(whole).mean, 70.0) << "some converge";
    Film sum = empty();
    for (uint32_t first = 0; first < 75; first += samples_per_round) {
        Film before = sum;
        for (const uint32_t left : {0U, 13U}) {
            const uint32_t right = left == 0 ? 13 : 36;
            Film film = make_film(right - left, 24, layers, builder_.world);
            RenderSettings settings;
            settings.max_depth = 3;
            settings.noise_threshold = noise;
            settings.first_sample = first;
            settings.samples = std::min(first + samples_per_round, 75U);
            settings.crop = Crop{left, 0, 36, 24};
            if (first > 0) settings.before = &before;
            render(builder_.world, Lights(lights, builder_.world), grey, camera_, settings, film);
            add_film(sum, film, left, 0);
        }
    }
    resolve(sum);
    for (size_t i = 0; i < sum.layers.size(); ++i)
        EXPECT_EQ(sum.layers[i].values, whole.layers[i].values) << sum.layers[i].name;
    EXPECT_EQ(count_samples(sum).total, count_samples(whole).total);
}

TEST_F(Resume, AFilmIsShownBetweenPasses) {
    Film film = empty();
    std::vector<uint32_t> seen;
    RenderProgress progress;
    progress.between_passes = [&](Film& shown) {
        seen.push_back(count_samples(shown).max);
        resolve(shown);
        EXPECT_EQ(shown.layers[0].values, uninterrupted_render(seen.back()).layers[0].values);
    };
    continue_render(film, 40, &progress);
    EXPECT_EQ(seen, (std::vector<uint32_t>{1, 4, 16, 32})); // the last pass is the picture
    EXPECT_EQ(progress.samples_done, 40U * film.pixel_states.size());
    expect_same(film, uninterrupted_render(40));
}

} // namespace
} // namespace marram
