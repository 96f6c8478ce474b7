// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/frame_state.h"
#include "core/cli/interrupt.h"
#include "core/cli/material_checks.h"
#include "core/cli/memory.h"
#include "core/cli/picture.h"
#include "core/cli/preview.h"
#include "core/cli/progress.h"
#include "core/cli/scene_camera.h"
#include "core/cli/stats.h"
#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/math/hash.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_invoke.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <utility>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr const char* digest_key = "marram:digest";
constexpr const char* frame_key = "marram:frame";
constexpr const char* unfinished = "partial"; // in its place

uint64_t hash_text(uint64_t h, std::string_view text) {
    for (const char c : text) h = hash(h, static_cast<unsigned char>(c));
    return hash(h, text.size());
}

// What all frames depend on: the scene file, what the command line changes, the files that the scene names (by size and
// time), the version. Not the number of samples. Asked for once, before frames are rendered: a scene file that is edited
// meanwhile is not what they were made of.
uint64_t digest_of_scene(const LoadedScene& scene, const RenderOptions& options) {
    std::ifstream file(options.scene, std::ios::binary);
    uint64_t h = hash_text(0, std::string(std::istreambuf_iterator<char>(file), {}));
    h = hash_text(h, MARRAM_VERSION);
    for (const std::string& setting : options.overrides.settings) h = hash_text(h, setting);
    for (const std::string& layer : options.layers) h = hash_text(h, layer);
    const auto [width, height] = film_size(scene);
    h = hash(hash(h, width), height);
    const std::vector<std::string> files = files_read(scene, options.scene);
    for (const std::string& name : std::span(files).subspan(1)) {
        std::error_code error;
        h = hash_text(h, name);
        h = hash(h, uint64_t(fs::file_size(name, error)));
        h = hash(h, uint64_t(fs::last_write_time(name, error).time_since_epoch().count()));
    }
    return h;
}

// A frame's file names and digests.
struct FrameFiles {
    double frame = 0.0;
    std::string picture, preview, state; // preview: "" for none
    std::string digest;                  // two pictures of one frame with one digest are the same picture
    std::string samples_digest; // of two films with one, that with fewer samples can become the other
};

FrameFiles files_of(double frame, const LoadedScene& scene, const RenderOptions& options, uint64_t of_scene) {
    FrameFiles files;
    files.frame = frame;
    files.picture = numbered(options.output, frame);
    if (!options.preview.empty()) files.preview = numbered(options.preview, frame);
    files.state = state_name(files.picture);
    files.samples_digest = fmt::format("{:016x}", hash(of_scene, std::bit_cast<uint64_t>(frame)));
    // Without the frame: OpenImageIO keeps every distinct text of metadata for ever, 8 KB each.
    files.digest =
        fmt::format("{:016x}", hash(of_scene, uint64_t(scene.description.film.integer("samples"))));
    return files;
}

// Whether an earlier run has left the whole picture.
bool is_there(const FrameFiles& files) {
    return read_metadata(files.picture, frame_key) == fmt::format("{}", files.frame) &&
           whole_metadata(files.picture, digest_key) == files.digest;
}

// What stands in the place of an unfinished picture must be one.
void check_partial(const std::string& partial) {
    std::error_code error;
    if (fs::exists(partial, error) && read_metadata(partial, digest_key) != unfinished)
        throw InputError({partial}, "this file stands where an unfinished picture would be written",
                         "move it, or choose another output");
}

// Before hours of rendering: every file can be written, and is none that is read or written as something else. A preview may be
// of any frame when another is saved.
void check_outputs(const LoadedScene& scene, const std::vector<FrameFiles>& frames,
                   const RenderOptions& options) {
    RunFiles files(files_read(scene, options.scene));
    std::set<std::string> previews, stats;
    for (const FrameFiles& frame : frames) {
        const std::string partial = partial_name(frame.picture);
        for (const std::string& name : {frame.picture, partial, frame.state}) {
            check_name_length(name);
            files.write(name);
        }
        check_writable(frame.picture);
        check_partial(partial);
        check_state_name(frame.state);
        previews.insert(frame.preview);
        stats.insert(numbered(options.stats, frame.frame));
    }
    for (const auto* names : {&previews, &stats})
        for (const std::string& name : *names) {
            files.write(name);
            if (!name.empty()) check_writable(name);
        }
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

// Every layer must be one that this scene can fill; known before anything is built.
void check_layers(const LoadedScene& scene, const RenderOptions& options) {
    std::vector<std::string> known;
    for (const LayerHelp& layer : built_in_layers()) known.emplace_back(layer.name);
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
    check_materials(scene);
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

// What a picture says of itself.
std::vector<Metadata> metadata_of(const RenderOptions& options, double frame, const SampleCount& samples,
                                  double seconds, const std::string& digest) {
    return {{"Software", std::string("marram " MARRAM_VERSION)},
            {"marram:scene", options.scene},
            {frame_key, frame},
            {"marram:samples", int(samples.most)},
            {"marram:mean_samples", samples.mean},
            {"marram:seconds", seconds},
            {"marram:version", std::string(MARRAM_VERSION)},
            {digest_key, digest}};
}

// One frame on its way to its files.
struct FrameJob {
    LoadedScene& scene;
    const RenderOptions& options;
    const FrameFiles& files;
    std::string prefix; // of the progress line
    FrameStats& stats;
    double begin = wall_seconds();
    RenderSettings render{};
    Film film{};
    Watched watched{};
};

void save(const FrameJob& job, const std::string& path, const std::string& digest, bool preview = false) {
    std::vector<Metadata> metadata = metadata_of(job.options, job.files.frame, count_samples(job.film),
                                                 job.stats.load + wall_seconds() - job.begin, digest);
    if (preview) metadata.emplace_back("marram:preview", std::string("yes"));
    save_picture(path, job.film, job.scene.description.film.number("exposure"), metadata);
}

// Pixels are as large as they are at the camera's target: a target far behind the strands makes all of them coarse.
void check_target(FrameJob& job) {
    const SceneDescription& scene = job.scene.description;
    if (!scene.globals.has("tolerance_pixels")) return;
    const double target = (scene.camera.vec3("target") - scene.camera.vec3("position")).norm(),
                 strands = median_distance(scene, job.files.frame, job.stats.build.patch_bounds);
    if (strands < 0.5 * target)
        job.stats.build.warnings.push_back(fmt::format(
            "{}: tolerance_pixels holds at camera.target, {:.3g} m away; half of the strands in view are "
            "nearer than "
            "{:.3g} m, where it is {:.2g} times as many pixels: put the target among them, or give tolerance "
            "in metres",
            to_string(scene.globals.at("tolerance_pixels").place), target, strands, target / strands));
}

World build(FrameJob& job, const std::vector<std::string>& layers) {
    BuildSettings settings = build_settings(job.scene, job.files.frame);
    settings.attributes = wanted_attributes(job.scene, layers);
    const ProgressLine line(job.options.quiet, [&] { return state_of(job.watched, job.prefix); });
    return build_world(job.scene.geometry, settings, interrupted(), job.watched.build, job.stats.build);
}

// Fills the film with what an earlier run has left of this frame, and says so, or why it cannot.
void go_on(FrameJob& job) {
    const FrameFiles& files = job.files;
    std::error_code error;
    if (!job.options.resume || !fs::exists(files.state, error)) return;
    const std::string reason = load_state(files.state, files.samples_digest, job.render.samples, job.film);
    if (!reason.empty())
        fmt::print(stderr, "{}: {}: the frame begins anew\n", files.state, reason);
    else if (!job.options.quiet)
        fmt::print(stderr, "{}: goes on after {:.4g} samples a pixel\n", files.picture,
                   count_samples(job.film).mean);
}

void trace(FrameJob& job, const World& world, Preview& preview) {
    const auto [width, height] = film_size(job.scene);
    const double begin = wall_seconds();
    job.watched.render.cancel = &interrupted();
    job.watched.render.between_passes = [&](Film&) { preview.between_passes(); };
    job.watched.render.samples_done = // before it is asked how far it is
        std::accumulate(job.film.reached.begin(), job.film.reached.end(), uint64_t(0));
    job.watched.samples = uint64_t(width) * height * job.render.samples;
    const ProgressLine line(job.options.quiet, [&] { return state_of(job.watched, job.prefix); });
    const Lights lights(job.scene.lights, world);
    double off = 0.0;
    const Camera camera = camera_at(job.scene.description, job.files.frame, &off);
    job.stats.camera_poses = uint32_t(camera.poses.size());
    if (off > 1.0)
        job.stats.build.warnings.push_back(fmt::format(
            "the camera turns so fast that {} poses are off by {:.3g} pixels: shorten camera.shutter",
            camera.poses.size(), off));
    job.stats.render =
        render(world, lights, job.scene.materials, camera, job.render, job.film, &job.watched.render);
    job.stats.trace = wall_seconds() - begin;
}

// What an earlier run that did not come to the end has left of a frame that is whole now.
void remove_leavings(const FrameFiles& files) {
    std::error_code error;
    if (!fs::remove(files.state, error)) return;
    const std::string partial = partial_name(files.picture);
    if (read_metadata(partial, digest_key) == unfinished) fs::remove(partial, error);
}

// Writes the picture under the name it deserves, and the film's state for as long as the frame is not whole.
void save_frame(FrameJob& job, Preview& preview) {
    const FrameFiles& files = job.files;
    const RenderStats& render = job.stats.render;
    if (render.out_of_time)
        fmt::print(stderr,
                   "{}: time was up after {} of {} samples a pixel: give more --seconds for less noise, or "
                   "go on with --resume\n",
                   files.picture, render.most_samples, job.render.samples);
    for (const std::string& warning : job.stats.build.warnings) fmt::print(stderr, "{}\n", warning);
    if (render.clamped > 0.0 && !job.options.quiet)
        fmt::print(stderr, "{}: film.clamp took {:.2g} % of the light\n", files.picture,
                   100.0 * render.clamped);
    constexpr double dark = 0.05; // of the light: a darkening that is seen
    const int depth = job.scene.description.film.integer("max_depth");
    if (depth > 1 && render.cut_throughput > dark) // 0 and 1 are asked for on purpose
        fmt::print(stderr,
                   "{}: film.max_depth = {} ends paths that carry up to {:.2g} % of the light, the picture "
                   "is too dark: "
                   "raise film.max_depth\n",
                   files.picture, depth, 100.0 * render.cut_throughput);
    job.stats.total = job.stats.load + wall_seconds() - job.begin;
    const bool whole = !render.cancelled && !render.out_of_time;
    const std::string target = render.cancelled ? partial_name(files.picture) : files.picture;
    const auto save_it = [&] { save(job, target, whole ? files.digest : unfinished); };
    std::string lost; // why there is no state: a fault of its own, the picture is not lost with it
    const auto keep_state = [&] {
        try {
            save_state(files.state, job.film, files.samples_digest);
        } catch (const InputError& error) {
            lost = error.what();
        }
    };
    if (whole) {
        try {
            save_it();
        } catch (
            const InputError&) { // the samples may be hours of work: --resume saves them once there is room
            keep_state();
            if (lost.empty()) fmt::print(stderr, "{}: kept: --resume saves the picture\n", files.state);
            throw;
        }
    } else { // at once: whoever pressed Ctrl-C waits
        tbb::parallel_invoke(save_it, keep_state);
    }
    fmt::print("{}\n", target);
    std::fflush(stdout); // an interrupt may cut off what comes later
    if (!lost.empty()) fmt::print(stderr, "{}\n{}: --resume will begin anew\n", lost, files.picture);
    if (render.dropped_samples > 0)
        fmt::print(stderr,
                   "{}: {} samples were left out, as their light was no finite number: look for huge values "
                   "in lights and materials\n",
                   files.picture, render.dropped_samples);
    if (whole) remove_leavings(files);
    if (!render.cancelled) preview.finish();
    if (!preview.fault().empty()) fmt::print(stderr, "{}\n", preview.fault());
}

// Renders one frame to its file; false where it was interrupted (what is there is saved under another name). `uncut` is for as long as
// there is something to save or to tell.
bool render_frame(LoadedScene& scene, const RenderOptions& options, const FrameFiles& files,
                  const std::string& prefix, FrameStats& stats, std::optional<Uncut>& uncut) {
    FrameJob job{scene, options, files, prefix, stats};
    job.render = render_settings(scene, files.frame);
    job.render.seconds = options.seconds;
    const std::vector<std::string> layers = layer_names(scene, options);
    Preview preview(files.preview.empty() ? std::function<void()>() : [&job] {
        resolve(job.film);
        save(job, job.files.preview, "preview", true);
    });
    std::optional<World> world = build(job, layers);
    const auto [width, height] = film_size(scene);
    check_target(job);
    job.film = make_film(width, height, layers, *world);
    go_on(job);
    uncut.emplace(); // from here on there is something to save
    trace(job, *world, preview);
    world.reset(); // the picture may need the room
    save_frame(job, preview);
    return !stats.render.cancelled;
}

} // namespace

int render_command(const RenderOptions& options) {
    check_picture_name(options.output);
    if (!options.preview.empty()) check_picture_name(options.preview);
    const int threads = options.threads > 0 ? options.threads : tbb::this_task_arena::max_concurrency();
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    const double begin = wall_seconds();
    LoadedScene scene = load(options.scene, options.overrides, interrupted());
    const double load_seconds = wall_seconds() - begin;
    check_layers(scene, options);
    const std::vector<double> frames =
        frames_to_make(options.frames, scene.description.globals.vec2("frames"), options.output);
    std::vector<FrameFiles> all_files;
    const uint64_t of_scene = digest_of_scene(scene, options);
    for (const double frame : frames) all_files.push_back(files_of(frame, scene, options, of_scene));
    check_outputs(scene, all_files, options);

    tbb::task_arena arena(threads);
    StatsFile stats_file(options.stats);
    bool first = true;
    for (const FrameFiles& files : all_files) {
        if (options.resume && is_there(files)) {
            if (!options.quiet) fmt::print(stderr, "{}: is there already\n", files.picture);
            continue;
        }
        const auto number = &files - all_files.data() + 1;
        const std::string prefix = frames.size() > 1 ? fmt::format("{} of {}: ", number, frames.size()) : "";
        FrameStats stats;
        stats.frame = files.frame;
        stats.threads = threads;
        stats.load = std::exchange(first, false) ? load_seconds : 0.0;
        bool whole = false;
        std::optional<Uncut> uncut;
        arena.execute([&] { whole = render_frame(scene, options, files, prefix, stats, uncut); });
        stats_file.add(stats);
        if (!whole) {
            stats_file.finish();
            return exit_interrupted;
        }
        release_free_memory();
    }
    stats_file.finish();
    return 0;
}

} // namespace marram
