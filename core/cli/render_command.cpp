// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/progress.h"
#include "core/cli/stats.h"
#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/math/hash.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr const char* digest_key = "marram:digest";

std::string lower_extension(const std::string& path) {
    std::string extension = fs::path(path).extension().string();
    std::ranges::transform(extension, extension.begin(),
                           [](unsigned char c) { return char(std::tolower(c)); });
    return extension;
}

void check_output(const std::string& output) {
    const std::string extension = lower_extension(output);
    if (extension != ".exr" && extension != ".png")
        throw InputError({output}, "a picture cannot be written in the format '" + extension + "'",
                         "name it .exr or .png");
}

uint64_t hash_text(uint64_t h, std::string_view text) {
    for (const char c : text) h = hash(h, static_cast<unsigned char>(c));
    return hash(h, text.size());
}

// What a frame depends on: the scene file, what the command line changes, the files that the scene names (by size and
// time), the version. Two pictures with one digest are the same picture.
std::string digest(const LoadedScene& scene, const RenderOptions& options, double frame) {
    std::ifstream file(options.scene, std::ios::binary);
    uint64_t h = hash_text(0, std::string(std::istreambuf_iterator<char>(file), {}));
    h = hash_text(h, MARRAM_VERSION);
    for (const std::string& setting : options.overrides.settings) h = hash_text(h, setting);
    for (const std::string& layer : options.layers) h = hash_text(h, layer);
    const auto [width, height] = film_size(scene);
    h = hash(hash(hash(h, width), height), uint64_t(scene.description.film.integer("samples")));
    const auto add_files = [&](const std::vector<Item>& items) {
        for (const Item& item : items)
            for (const ParamValue& value : item.params.all()) {
                if (value.spec->type != ParamType::file && value.spec->type != ParamType::image) continue;
                std::error_code error;
                h = hash_text(h, value.text);
                h = hash(h, uint64_t(fs::file_size(value.text, error)));
                h = hash(h, uint64_t(fs::last_write_time(value.text, error).time_since_epoch().count()));
            }
    };
    add_files(scene.description.materials);
    add_files(scene.description.meshes);
    add_files(scene.description.lights);
    add_files(scene.description.procedurals);
    return fmt::format("{:016x}", hash(h, std::bit_cast<uint64_t>(frame)));
}

std::vector<std::string> layer_names(const LoadedScene& scene, const RenderOptions& options) {
    std::vector<std::string> names = {"beauty", "alpha"};
    for (const auto* list : {&scene.description.film.at("aovs").texts, &options.layers})
        for (const std::string& name : *list)
            if (std::ranges::find(names, name) == names.end()) names.push_back(name);
    if (scene.description.film.number("noise") > 0.0 && std::ranges::find(names, "variance") == names.end())
        names.emplace_back("variance"); // by which pixels know when they are done
    return names;
}

// A material tints by an attribute that the curves it is on carry, of one number.
void check_tints(const LoadedScene& scene) {
    for (const auto& procedural : scene.geometry.procedurals) {
        if (procedural->material < 0) continue;
        const std::string& tint = scene.materials[size_t(procedural->material)].tint;
        if (tint.empty()) continue;
        const Item& material = scene.description.materials[size_t(procedural->material)];
        const MarramProcedural& type = procedural->type();
        std::vector<std::string> known;
        for (uint32_t i = 0; i < type.attribute_count; ++i)
            if (type.attributes[i].components == 1) known.emplace_back(type.attributes[i].name);
        if (std::ranges::find(known, tint) == known.end())
            throw InputError(
                material.params.at("tint").place,
                fmt::format("'{}' has no attribute '{}' of one number to tint by", procedural->name(), tint),
                fmt::format("choose among {}", fmt::join(known, ", ")));
    }
}

// Every layer must be one that this scene can fill; known before anything is built.
void check_layers(const LoadedScene& scene, const RenderOptions& options) {
    std::vector<std::string> known = {"beauty", "variance", "alpha", "albedo", "normal", "depth", "strand_u"};
    for (const auto& procedural : scene.geometry.procedurals)
        for (uint32_t i = 0; i < procedural->type().attribute_count; ++i)
            known.emplace_back(procedural->type().attributes[i].name);
    std::ranges::sort(known);
    known.erase(std::unique(known.begin(), known.end()), known.end());
    const auto check = [&](const std::vector<std::string>& names, const Place& place) {
        for (const std::string& name : names)
            if (std::ranges::find(known, name) == known.end())
                throw InputError(place, "this scene has no image layer '" + name + "'",
                                 fmt::format("choose among {}", fmt::join(known, ", ")));
    };
    const ParamValue& aovs = scene.description.film.at("aovs");
    check(aovs.texts, aovs.place);
    for (const std::string& name : options.layers) check({name}, {"--aov " + name});
    if (!options.layers.empty() && lower_extension(options.output) == ".png")
        throw InputError({"--aov " + options.layers.front()}, "a PNG holds the picture alone",
                         "write an .exr");
    check_tints(scene);
}

std::vector<std::string> channel_names(const FilmLayer& layer) {
    if (layer.name == "depth") return {"Z"};
    if (layer.name == "normal") return {"X", "Y", "Z"};
    switch (layer.channels) {
    case 1:
        return {"Y"};
    case 2:
        return {"U", "V"};
    case 3:
        return layer.kind == LayerKind::attribute ? std::vector<std::string>{"X", "Y", "Z"}
                                                  : std::vector<std::string>{"R", "G", "B"};
    default:
        return {"R", "G", "B", "A"};
    }
}

// Beauty and alpha side by side, as every viewer expects them.
std::vector<float> rgba_of(const Film& film) {
    const FilmLayer *beauty = find_layer(film, "beauty"), *alpha = find_layer(film, "alpha");
    std::vector<float> rgba(size_t(film.width) * film.height * 4);
    for (size_t i = 0; i < size_t(film.width) * film.height; ++i) {
        std::copy_n(beauty->pixels.data() + 3 * i, 3, rgba.data() + 4 * i);
        rgba[4 * i + 3] = alpha->pixels[i];
    }
    return rgba;
}

void save(const std::string& path, const LoadedScene& scene, const Film& film,
          const std::vector<Metadata>& metadata) {
    const Uncut uncut;
    const int width = int(film.width), height = int(film.height);
    if (lower_extension(path) == ".png") {
        write_png(path, width, height, 3, find_layer(film, "beauty")->pixels.data(),
                  scene.description.film.number("exposure"), metadata);
        return;
    }
    const std::vector<float> rgba = rgba_of(film);
    std::vector<Layer> layers = {{"", {"R", "G", "B", "A"}, rgba.data(), true}};
    for (const FilmLayer& layer : film.layers)
        if (layer.kind != LayerKind::beauty && layer.kind != LayerKind::alpha)
            layers.push_back({layer.name, channel_names(layer), layer.pixels.data(),
                              layer.kind == LayerKind::albedo || layer.kind == LayerKind::normal});
    write_exr(path, width, height, layers, metadata);
}

std::string partial_name(const std::string& path) {
    const fs::path p(path);
    return (p.parent_path() / (p.stem().string() + ".partial" + p.extension().string())).string();
}

struct Watched {
    BuildProgress build;
    RenderProgress render;
    std::atomic<uint64_t> samples{0}; // 0: not rendering yet
};

ProgressState state_of(const Watched& watched, const std::string& prefix) {
    const uint64_t samples = watched.samples.load();
    if (samples > 0)
        return {prefix + "rendering", double(watched.render.samples_done.load()) / double(samples)};
    return {prefix + watched.build.phase.load(), watched.build.fraction.load()};
}

// Renders one frame to its file; false where it was interrupted (what is there is saved under another name).
bool render_frame(LoadedScene& scene, const RenderOptions& options, double frame, const std::string& path,
                  const std::string& prefix, FrameStats& stats) {
    const double begin = wall_seconds();
    Watched watched;
    watched.render.cancel = &interrupted();
    const std::vector<std::string> names = layer_names(scene, options);
    BuildSettings build = build_settings(scene, frame);
    build.attributes = wanted_attributes(scene, names);
    RenderSettings render_with = render_settings(scene, frame);
    render_with.seconds = options.seconds;
    const auto [width, height] = film_size(scene);
    Film film;
    {
        const ProgressLine line(options.quiet, [&] { return state_of(watched, prefix); });
        const World world = build_world(scene.geometry, build, interrupted(), watched.build, stats.build);
        film = make_film(width, height, names, world);
        const Uncut uncut; // from here on there is something to save
        const double traced = wall_seconds();
        watched.samples = uint64_t(width) * height * render_with.samples;
        const Lights lights(scene.lights, world);
        stats.render =
            render(world, lights, scene.materials, scene.camera, render_with, film, &watched.render);
        stats.trace = wall_seconds() - traced;
    }
    if (stats.render.out_of_time)
        fmt::print(stderr,
                   "{}: time was up after {} of {} samples a pixel: give more --seconds for less noise\n",
                   path, stats.render.most_samples, render_with.samples);
    for (const std::string& warning : stats.build.warnings) fmt::print(stderr, "{}\n", warning);
    stats.total = stats.load + wall_seconds() - begin;
    const std::string target = stats.render.cancelled ? partial_name(path) : path;
    save(target, scene, film,
         {{"Software", std::string("marram " MARRAM_VERSION)},
          {"marram:scene", options.scene},
          {"marram:frame", frame},
          {"marram:samples", int(stats.render.most_samples)},
          {"marram:mean_samples", stats.render.mean_samples},
          {"marram:seconds", stats.total},
          {"marram:version", std::string(MARRAM_VERSION)},
          {digest_key, stats.render.cancelled || stats.render.out_of_time ? std::string("partial")
                                                                          : digest(scene, options, frame)}});
    fmt::print("{}\n", target);
    return !stats.render.cancelled;
}

} // namespace

int render_command(const RenderOptions& options) {
    check_output(options.output);
    check_distinct({options.scene, options.output, options.stats});
    const double begin = wall_seconds();
    LoadedScene scene = load(options.scene, options.overrides, interrupted());
    const double load_seconds = wall_seconds() - begin;
    check_layers(scene, options);
    const std::vector<double> frames =
        frames_to_make(options.frames, scene.description.globals.vec2("frames"), options.output);
    for (const double frame : frames) check_writable(numbered(options.output, frame));
    if (!options.stats.empty()) check_writable(options.stats);

    const int threads = options.threads > 0 ? options.threads : tbb::this_task_arena::max_concurrency();
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    tbb::task_arena arena(threads);
    std::vector<FrameStats> all;
    for (size_t i = 0; i < frames.size(); ++i) {
        const std::string path = numbered(options.output, frames[i]);
        if (options.resume && read_metadata(path, digest_key) == digest(scene, options, frames[i])) {
            if (!options.quiet) fmt::print(stderr, "{}: is there already\n", path);
            continue;
        }
        const std::string prefix = frames.size() > 1 ? fmt::format("{} of {}: ", i + 1, frames.size()) : "";
        FrameStats& stats = all.emplace_back();
        stats.frame = frames[i];
        stats.threads = threads;
        stats.load = all.size() == 1 ? load_seconds : 0.0;
        bool whole = false;
        arena.execute([&] { whole = render_frame(scene, options, frames[i], path, prefix, stats); });
        if (!options.stats.empty()) write_stats(options.stats, all);
        if (!whole) return exit_interrupted;
    }
    return 0;
}

} // namespace marram
