// SPDX-License-Identifier: Apache-2.0
#include "tests/golden/goldens.h"

#include "core/compare/flip.h"
#include "core/math/hash.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/settings.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <stdexcept>

namespace marram::golden {
namespace {

const std::string size = "film.size=[96, 72]";
const std::vector<std::string> small = {size, "film.samples=32"};
const std::string tiny = "film.size=[48, 36]";

Golden room(const std::string& name, const std::string& shows, std::vector<std::string> changes) {
    return {name, shows, "golden/room.toml", 8, std::move(changes)};
}

Golden fur(const std::string& name, const std::string& shows, std::vector<std::string> changes) {
    return {name, shows, "golden/fur.toml", 20, std::move(changes)};
}

// A gallery scene, smaller and with fewer strands.
Golden figure(const std::string& name, double frame, std::vector<std::string> changes) {
    changes.insert(changes.begin(), small.begin(), small.end());
    return {name, "the scene of that name, small", name + ".toml", frame, std::move(changes)};
}

// A desert scene, coarser and smaller still, to keep the folder of goldens small. Glints are so rare that
// renders with different seeds disagree about their brightness: fewer here.
Golden desert(const std::string& name, double frame, std::vector<std::string> changes) {
    changes.insert(changes.begin(), {"film.size=[72, 54]", "film.samples=64", "film.clamp=2"});
    return {name, "the scene of that name, small and coarse", name + ".toml", frame, std::move(changes)};
}

const std::string exact = "wind.collision={solver=\"exact\", offset_scale=0.3}";
const std::string no_sun = "light.sun.irradiance=[0, 0, 0]", no_sky = "light.sky.strength=0";

} // namespace

std::span<const Golden> goldens() {
    static const std::vector<Golden> all = {
        // The renderer.
        room("room", "meshes, ribbons, a wide sun and a gradient sky, transmission through blades", {}),
        room("sun", "the sun alone: shadows and one bounce", {no_sky, "film.max_depth=2"}),
        room("sky", "the sky alone, six bounces", {no_sun}),
        room("lamp", "a shining mesh alone", {no_sun, no_sky, "light.lamp.radiance=[12, 10, 7]"}),
        room("environment", "an image of a studio all around, turned, mirrored in a glossy ball; clamped",
             {"film.clamp=1", no_sun, "light.sky.type=\"environment\"",
              "light.sky.file=\"../textures/studio.exr\"", "light.sky.rotation=30",
              "mesh.ball.material=\"paint\"", "material.paint.roughness=0.1"}),
        room("lens", "a lens focused on the ball", {"camera.lens_radius=0.12", "camera.focus=3.9"}),
        room("moving", "a ball that rolls, blurred over half a frame",
             {"camera.shutter=[-0.5, 0.5]", "mesh.ball.transform={keys=[{frame=1, translate=[-1, 0.45, "
                                            "0.6]}, {frame=10, translate=[1.6, 0.45, 0.6]}]}"}),
        room("pan", "a camera that turns and walks while its shutter is open",
             {"camera.shutter=[-0.5, 0.5]",
              "camera.transform={keys=[{frame=1, rotate=[0, -14, 0]}, {frame=15, "
              "rotate=[0, 14, 0], translate=[0.6, 0, 0]}]}"}),
        {"deform",
         "a sheet that waves, blurred over a frame, and grass that rides on it",
         "golden/sheet.toml",
         2,
         {}},
        room("filter", "the box filter, a pixel wide", {"film.filter=\"box\"", "film.filter_radius=0.5"}),
        room("noise", "pixels that stop when they are good enough", {"film.noise=0.04", "film.samples=512"}),
        {"layers",
         "what a picture has beside its colours",
         "golden/fur.toml",
         20,
         {"film.size=[72, 54]", "wind.shielding={shield=1, spread=10, rays=16}",
          "wind.gusts.control=[{shape=\"sphere\", transform={translate=[-0.3, 0.3, 0.4], scale=0.45}}]"},
         {"alpha", "albedo", "normal", "depth", "strand_u", "id", "shield", "gust", "envelope", "root_uv"}},
        room("round", "round strands of Catmull-Rom curves, with clumps, curl and frizz",
             {"procedural.grass.shape=\"round\"", "procedural.grass.basis=\"catmull-rom\"",
              "procedural.grass.cvs=12", "procedural.grass.clump={size=0.3, amount=0.5}",
              "procedural.grass.curl={radius=0.02, turns=2}",
              "procedural.grass.frizz={amplitude=0.02, frequency=3}"}),
        room("oriented", "ribbons that face their own way", {"procedural.grass.shape=\"oriented-ribbon\""}),
        room("grass", "blades of grass against the light",
             {"procedural.grass.material=\"leaf\"", "light.sun.direction=[0.3, 0.8, -1]"}),
        room("sand", "rippled sand with glints, in a low sun",
             {"mesh.floor.material=\"dune\"", "light.sun.direction=[-1, 0.35, -0.4]",
              "procedural.grass.count=60"}),
        room("surface", "glossy things, painted with an image, clamped a little",
             {"film.clamp=1", "mesh.floor.material=\"paint\"", "mesh.ball.material=\"paint\"",
              "mesh.box.material=\"paint\"", "procedural.grass.count=60"}),
        room("clamp", "the same, clamped much on what comes by more than one surface",
             {"film.clamp=0.5", "mesh.floor.material=\"paint\"", "mesh.ball.material=\"paint\"",
              "mesh.box.material=\"paint\"", "procedural.grass.count=60"}),
        // The chain.
        fur("still", "strands at rest", {"wind.speed=0"}),
        fur("hair", "hair fibres by colour, clamped",
            {"film.samples=256", "film.clamp=4", "wind.speed=0", "film.max_depth=8",
             "procedural.fur.material=\"hair\""}),
        fur("melanin", "hair fibres by melanin, clamped",
            {"film.clamp=1", "wind.speed=0", "film.max_depth=8", "procedural.fur.material=\"melanin\""}),
        fur("bend", "bent by a steady wind", {}),
        fur("perlin", "Perlin noise of two octaves", {"wind.noise={amplitude=0.9, frequency=2, octaves=2}"}),
        fur("billow", "billow noise, evolving",
            {"wind.noise={type=\"billow\", amplitude=0.9, frequency=2, evolution=1}"}),
        fur("wavelet", "wavelet noise", {"wind.noise={type=\"wavelet\", amplitude=0.9, frequency=2}"}),
        fur("gusts", "gusts that pass, tinted by what they bring",
            {"wind.gusts={num_gusts=8, radius_range=[0.4, 0.6], speed_range=[1.5, 2.5], "
             "start_frame_range=[6, 18], life_range=[40, 60], decay_range=[8, 8], period=0, center=[0, 0, "
             "0], extent=[1, 1], distance=0.8, seed=2}",
             "material.fur.tint=\"gust\"", "material.fur.tint_color=[0.9, 0.2, 0.05]"}),
        fur("control", "one gust placed by hand",
            {"wind.gusts.control=[{shape=\"sphere\", transform={translate=[-0.3, 0.3, 0.4], scale=0.45}}]"}),
        fur("boxes", "an in/out box, placed and turned by hand, and the sphere in it that takes wind away",
            {"wind.gusts.control=[{shape=\"box\", inner=[0.6, 0.3, 0.6], transform={translate=[0, 0.3, 0.2], "
             "rotate=[0, "
             "30, 0], scale=[0.7, 0.4, 0.8]}}, {shape=\"sphere\", strength=-1, transform={translate=[0.2, "
             "0.4, 0.3], "
             "scale=0.3}}]"}),
        fur("anchor", "noise that stays with a body that moves",
            {"wind.noise={amplitude=0.9, frequency=2, anchor=\"rest\"}",
             "mesh.body.transform={keys=[{frame=1, translate=[0.6, 0, 0]}, {frame=20, translate=[0, 0, "
             "0]}]}"}),
        fur("shield", "shelter by the body, soft-edged, tinted",
            {"wind.shielding={shield=1, spread=10, rays=16}", "material.fur.tint=\"shield\""}),
        fur("shield_cv", "shelter of each CV, fading in its wake",
            {"wind.shielding={shield=1, shield_per=\"cv\", wake=0.5}", "material.fur.tint=\"shield\""}),
        fur("id", "each strand tinted by a share of its own",
            {"material.fur.tint=\"id\"", "material.fur.tint_color=[0.1, 0.3, 0.9]"}),
        fur("jiggle", "strands that swing behind a ball that moves",
            {"wind.speed=0", "wind.jiggle={frequency=2, damping=0.2}",
             "mesh.body.transform={keys=[{frame=1, translate=[0.6, 0, 0]}, {frame=20, translate=[0, 0, "
             "0]}]}"}),
        fur("collision", "exact collision with the skin, few strands in a strong wind from the camera",
            {exact, "film.samples=256", "wind.direction=[0.3, -0.1, -1]", "wind.global_rotate=1",
             "procedural.fur.count=900", "procedural.fur.width=0.03"}),
        {"leopard",
         "one groom on two meshes: colour, lie, length and frizz by images, clumps within clumps",
         "leopard.toml",
         8,
         {"film.size=[66, 44]", "film.samples=128", "film.clamp=2", "procedural.fur.density=5000",
          "procedural.fur.width=0.004"}},
        fur("steps", "the talk's sixteen steps", {"wind.collision={solver=\"steps\"}"}),
        fur("blur", "a moving ball's fur, blurred",
            {exact, "film.samples=128", "camera.shutter=[-0.5, 0.5]",
             "mesh.body.transform={keys=[{frame=1, translate=[2.4, 0, 0]}, {frame=20, translate=[0, 0, "
             "0]}]}"}),
        // The gallery.
        figure("default", 1, {"procedural.grass.density=300", "procedural.stalks.density=20"}),
        figure("strand", 1, {}),
        figure("talk", 24, {"film.samples=256", "film.clamp=1"}),
        figure("figure1a", 1,
               {"film.samples=128", "procedural.fur.count=20000", "procedural.fur.width=0.005"}),
        figure("figure1b", 1,
               {"film.samples=128", "procedural.fur.count=20000", "procedural.fur.width=0.005"}),
        figure("figure1c", 1,
               {"film.samples=128", "procedural.fur.count=20000", "procedural.fur.width=0.005"}),
        // Wet blades under a low sun glint so rarely that renders with different seeds disagree about their
        // brightness: rougher blades here.
        figure(
            "dune", 1,
            {"procedural.grass.density=300", "procedural.grass.width=0.02", "material.marram.roughness=0.8"}),
        figure("fur", 1, {"film.samples=256", "procedural.fur.count=20000", "procedural.fur.width=0.005"}),
        figure("figure2", 30, {}),
        // The desert.
        desert("marram", 30,
               {"procedural.dune.cell=0.4", "procedural.grass.density=120", "procedural.grass.width=0.02",
                "material.sand.sparkle=0", "material.marram.roughness=0.8"}),
        desert("coast", 30,
               {"procedural.ground.cell=8", "procedural.grass.count=20000000", "material.sand.sparkle=0",
                "material.marram.roughness=0.8"}),
        desert("dune_ridge", 1, {"procedural.desert.cell=1"}),
        desert("dune_letters", 1, {"procedural.desert.cell=0.5"}),
        desert("barchans", 1, {"procedural.desert.cell=1.5"}),
        desert("wind_barchans", 3, {"procedural.desert.cell=4", tiny}),
        desert("wind_bend", 2, {"procedural.desert.cell=2", tiny}),
        desert("wind_ridges", 3, {"procedural.desert.cell=4", tiny}),
        desert("wind_seifs", 2, {"procedural.desert.cell=6", tiny}),
        desert("wind_stars", 2, {"procedural.desert.cell=7.5", tiny}),
        desert("wind_nabkhas", 2,
               {"procedural.desert.cell=0.4", "procedural.marram.density=300",
                "procedural.marram.width=0.015", tiny}),
        desert("worn_rock", 1,
               {"procedural.near_rock.paths=100000", "procedural.far_rock.paths=100000", tiny}),
        desert("ventifact", 1,
               {"procedural.ventifact.levels=2", "procedural.ventifact.voxel=0.025",
                "procedural.ventifact.paths=15000", tiny}),
        desert("yardang", 1,
               {"procedural.yardang.levels=2", "procedural.yardang.voxel=0.15",
                "procedural.yardang.paths=8000", tiny}),
        desert("sand_sea", 1, {"procedural.desert.cell=2"}),
        desert("rock_and_sand", 1, {"procedural.desert.cell=0.8"}),
        desert("ruin", 1,
               {"procedural.desert.cell=0.25", "procedural.grass.density=100", "procedural.grass.width=0.02",
                "material.sand.sparkle=0", "material.marram.roughness=0.8"}),
        {"strands",
         "strands of a file, bound to a mesh and blown, and grass that is guided by them",
         "golden/strands.toml",
         6,
         {"film.size=[60, 45]"}},
        desert("tussocks", 30,
               {"film.size=[60, 45]", "procedural.tussock.count=60", "procedural.tussock.width=0.025"}),
        figure("gust_field", 24, {"procedural.near.density=30", "procedural.far.density=7"}),
        figure("whirl", 25, {"procedural.grass.density=60", "procedural.grass.width=0.035"}),
        figure("downwash", 25, {"procedural.grass.density=35", "procedural.grass.width=0.05"}),
        figure("storm", 97, {"procedural.grass.density=90", "procedural.grass.width=0.028"}),
        figure("wheat", 24, {"procedural.wheat.density=12", "procedural.wheat.width=0.05"}),
    };
    return all;
}

const Golden& golden_named(const std::string& name) {
    for (const Golden& golden : goldens())
        if (golden.name == name) return golden;
    throw std::invalid_argument("there is no golden " + name);
}

std::string path_of(const Golden& golden) {
    return MARRAM_SOURCE_DIR "/scenes/golden/" + golden.name + ".exr";
}

namespace {

std::vector<std::string> channels_of(uint32_t count) {
    if (count == 1) return {"Y"};
    const std::vector<std::string> all = {"X", "Y", "Z", "W"};
    return {all.begin(), all.begin() + count};
}

} // namespace

Stage::Stage(const Golden& golden, const std::vector<std::string>& faults) : frame_(golden.frame) {
    static const std::atomic<bool> never{false};
    Overrides overrides;
    overrides.settings = golden.changes;
    overrides.settings.insert(overrides.settings.end(), faults.begin(), faults.end());
    scene_ = load_shot(MARRAM_SOURCE_DIR "/scenes/" + golden.scene, overrides, never);
    BuildSettings settings = build_settings(scene_, frame_);
    settings.state_folder.clear(); // states of an earlier build must not be used
    layers_ = golden.layers;
    settings.attributes = wanted_attributes(scene_, layers_);
    BuildProgress progress;
    BuildStats stats;
    world_ = build_world(scene_.geometry, settings, never, progress, stats);
    lights_ = std::make_unique<Lights>(scene_.lights, world_);
}

Picture Stage::render(uint64_t seed, uint32_t samples) const {
    const auto [width, height] = film_size(scene_);
    RenderSettings settings = render_settings(scene_, frame_);
    std::vector<std::string> names = {"beauty"};
    names.insert(names.end(), layers_.begin(), layers_.end());
    if (settings.noise_threshold > 0.0) names.emplace_back("variance"); // adaptive sampling needs it
    Film film = make_film(width, height, names, world_);
    settings.seed = seed;
    if (samples > 0) settings.samples = samples;
    marram::render(world_, *lights_, scene_.materials, camera_at(scene_.description, frame_), settings, film);
    Picture picture;
    picture.width = int(width);
    picture.height = int(height);
    picture.samples = int(settings.samples);
    picture.layers.push_back({"", {"R", "G", "B"}, find_layer(film, "beauty")->values});
    for (const std::string& name : layers_) {
        const FilmLayer& layer = *find_layer(film, name);
        picture.layers.push_back({name, channels_of(layer.channels), layer.values});
    }
    return picture;
}

namespace {

// The fraction of pictures, of those that differ only in their seed, that may exceed the noise limits.
constexpr double alarms = 1e-4;

// For means and the largest of many squares: their tails fall off like a normal distribution's.
double limit_of(const std::vector<double>& values, double deviations) {
    double mean = 0.0, squares = 0.0;
    for (const double v : values) mean += v / double(values.size());
    for (const double v : values) squares += (v - mean) * (v - mean) / double(values.size() - 1);
    return mean + deviations * std::sqrt(squares);
}

constexpr double spread = 7.0; // standard deviations

// For single pixels and their next neighbours: their tails fall off with a power, since few paths carry much
// of the light. The upper half of the values gives the exponent (Hill, "A Simple General Approach to
// Inference About the Tail of a Distribution", 1975), within a fifth for 48 values.
double tail_limit(std::vector<double> values, double chance) {
    std::ranges::sort(values, std::greater<>());
    const size_t half = values.size() / 2;
    const double middle = values[half];
    if (!(middle > 0.0)) return 0.0; // no noise at all
    double exponent = 0.0;
    for (size_t i = 0; i < half; ++i) exponent += std::log(values[i] / middle) / double(half);
    return middle * std::pow(0.5 / chance, exponent);
}

// The value that even normally distributed noise of that variance exceeds with that probability. A few dozen
// renders cannot measure it, and some of the many measured limits would be lower.
double normal_limit(int width, int height, int size, double chance) {
    const auto across = [&](int whole) { return size > 0 ? (whole + size - 1) / size : 1; };
    return student_limit(chance / (3.0 * across(width) * across(height)), 1e9);
}

using Values = std::vector<float>;

// Over all renders but `without`: their mean, and the variance of one further render's difference from it.
void statistics(const std::vector<Values>& renders, size_t without, Values& mean, Values& variance) {
    const auto count = double(renders.size() - (without < renders.size() ? 1 : 0));
    mean.resize(renders[0].size());
    variance.resize(renders[0].size());
    for (size_t p = 0; p < mean.size(); ++p) {
        double sum = 0.0, squares = 0.0;
        for (size_t i = 0; i < renders.size(); ++i)
            if (i != without) sum += double(renders[i][p]);
        sum /= count;
        for (size_t i = 0; i < renders.size(); ++i)
            if (i != without) squares += (double(renders[i][p]) - sum) * (double(renders[i][p]) - sum);
        mean[p] = float(sum);
        variance[p] = float(squares / (count - 1.0) * (1.0 + 1.0 / count));
    }
}

} // namespace

Picture made(const Golden& golden) {
    const Stage stage(golden);
    std::vector<Values> renders;
    Picture picture;
    for (int i = 0; i < seeds; ++i) {
        picture = stage.render(hash(uint64_t(0x601d), uint64_t(i)));
        renders.push_back(picture.layers[0].pixels);
    }
    const int w = picture.width, h = picture.height;
    std::vector<std::vector<double>> worst; // [scale][render]
    Limits limits;
    std::vector<double> flip_means, flip_99s, ssims;
    Values mean, variance;
    for (size_t i = 0; i < renders.size(); ++i) {
        statistics(renders, i, mean, variance);
        const std::vector<ScaleResult> scales =
            deviations(renders[i], mean, variance, Halves::variance, w, h);
        worst.resize(scales.size());
        limits.deviations.resize(scales.size());
        for (size_t s = 0; s < scales.size(); ++s) {
            worst[s].push_back(scales[s].worst);
            limits.deviations[s].first = scales[s].size;
        }
        Values flip = flip_map(renders[i], mean, w, h);
        std::ranges::sort(flip);
        double sum = 0.0;
        for (const float f : flip) sum += double(f);
        flip_means.push_back(sum / double(flip.size()));
        flip_99s.push_back(double(flip[flip.size() * 99 / 100]));
        ssims.push_back(mean_ssim(renders[i], mean, w, h));
    }
    const double chance = alarms / double(worst.size());
    for (size_t s = 0; s < worst.size(); ++s) {
        const int size = limits.deviations[s].first;
        limits.deviations[s].second =
            std::max(size == 1 || size == 2 ? tail_limit(worst[s], chance) : limit_of(worst[s], spread),
                     normal_limit(w, h, size, chance));
    }
    limits.flip_mean = limit_of(flip_means, spread);
    limits.flip_99 = limit_of(flip_99s, spread);
    limits.ssim = limit_of(ssims, -spread);
    statistics(renders, renders.size(), mean, variance);
    picture.layers[0].pixels = mean;
    picture.layers.push_back({"variance", {"R", "G", "B"}, variance});
    picture.limits = to_text(limits);
    return picture;
}

void write(const Picture& picture, const std::string& path, const Golden& golden) {
    std::vector<Layer> layers;
    for (const Picture::Layer& layer : picture.layers) {
        const bool names = layer.name == "id"; // halfs cannot tell ids apart
        layers.push_back({layer.name, layer.channels, layer.pixels.data(), !layer.name.empty() && !names});
    }
    const Metadata metadata[] = {{"marram:shows", golden.shows}, {"marram:scene", golden.scene},
                                 {"marram:frame", golden.frame}, {"marram:samples", picture.samples},
                                 {"marram:seeds", seeds},        {"marram:limits", picture.limits}};
    write_exr(path, picture.width, picture.height, layers, metadata);
}

} // namespace marram::golden
