// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/exit_codes.h"
#include "core/cli/frames_to_render.h"
#include "core/cli/interrupt.h"
#include "core/cli/memory.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/cli/scene_watch.h"
#include "core/image/atomic_file.h"
#include "core/image/image_library.h"
#include "core/image/run_files.h"
#include "core/math/file_types.h"
#include "core/math/frame_name.h"
#include "core/shot/checkpoint.h"
#include "core/shot/film_display.h"
#include "core/shot/film_state.h"
#include "core/shot/frame.h"
#include "core/shot/picture_file.h"
#include "core/shot/scene/material_checks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

namespace marram {
namespace {

// Checks before rendering that every file can be written and is not also read, or written as another file.
// Preview and statistics files may be shared by several frames. --list writes none.
void check_outputs(const Shot& shot, const std::vector<FrameFiles>& frames, const RenderOptions& options) {
    load_image_library();
    std::vector<std::string> read = files_read(shot, options.scene);
    for (const FrameFiles& frame : frames)
        if (!options.after.empty()) read.push_back(numbered(options.after, frame.frame));
    RunFiles files(read);
    const auto check_file = [&](const std::string& name) {
        if (!options.list) check_writable(name);
    };
    std::set<std::string> previews, stats;
    for (const FrameFiles& frame : frames) {
        const std::string partial = partial_name(frame.picture);
        std::vector<std::string> names = {frame.state};
        if (!frame.is_part) names.insert(names.end(), {frame.picture, partial});
        for (const std::string& name : names) {
            check_name_length(name);
            files.write(name);
        }
        check_file(output_of(frame));
        for (const LayerPicture& layer : frame.layers) {
            files.write(layer.file);
            check_file(layer.file);
        }
        if (!frame.is_part) check_partial_name(partial);
        if (!options.list) check_state_overwrite(frame.state);
        previews.insert(frame.preview);
        stats.insert(numbered(options.stats, frame.frame));
    }
    for (const auto* names : {&previews, &stats})
        for (const std::string& name : *names) {
            files.write(name);
            if (!name.empty()) check_file(name);
        }
}

void check_layer_pictures(const Shot& shot, const RenderOptions& options, size_t frames) {
    for (const LayerPicture& picture : options.pictures) {
        check_layers(shot, {picture.layer}, "--png");
        if (!picture.range && !natural_range(picture.layer))
            throw InputError({"--png " + picture.layer}, "this layer has no range of its own",
                             "say which values are black and white, such as " + picture.layer +
                                 ":0-20=" + picture.file);
        if (extension_of(picture.file) != ".png")
            throw InputError({picture.file}, "--png writes no other format", "name it .png");
        if (frames > 1 && !has_frame_mark(picture.file))
            throw InputError({"--png " + picture.layer},
                             "all frames would go to one file, '" + picture.file + "'",
                             "put a #### where the frame's number belongs");
    }
}

// The same scene may be rendered to EXR and, for a look, to PNG: layers that a PNG leaves out are no error.
void warn_of_unwritten_layers(const Shot& shot, const RenderOptions& options) {
    const ParamValue* aovs = shot.description.film.find("aovs");
    if (!aovs || extension_of(options.output) != ".png") return;
    std::vector<std::string> unwritten;
    for (const std::string& layer : aovs->texts)
        if (std::ranges::find(options.pictures, layer, &LayerPicture::layer) == options.pictures.end())
            unwritten.push_back(layer);
    if (unwritten.empty()) return;
    print_warning(
        {aovs->place,
         fmt::format("film.aovs: not written: {}: a PNG holds the picture alone", fmt::join(unwritten, ", ")),
         "write an .exr, or a layer to a file of its own with --png", "film.unwritten_layers"});
}

// Checks layers and materials before anything is built.
void check_contents(const Shot& shot, const RenderOptions& options, size_t frames) {
    check_layers(shot, options.layers);
    check_layer_pictures(shot, options, frames);
    if (!options.layers.empty() && extension_of(options.output) == ".png")
        throw InputError({"--aov " + options.layers.front()}, "a PNG holds the picture alone",
                         "write an .exr, or the layer to a file of its own with --png");
    warn_of_unwritten_layers(shot, options);
    for (const Problem& warning : check_materials(shot)) print_warning(warning);
}

// The layers that the film needs besides the scene's.
std::vector<std::string> more_layers(const Shot& shot, const RenderOptions& options) {
    std::vector<std::string> more = options.layers;
    for (const LayerPicture& picture : options.pictures) {
        const std::vector<std::string> there = layer_names(shot, more);
        if (std::ranges::find(there, picture.layer) == there.end()) more.push_back(picture.layer);
    }
    return more;
}

ProgressState state_of(const FrameProgress& progress, const std::string& prefix) {
    const uint64_t samples = progress.samples.load();
    if (samples > 0)
        return {prefix + "rendering", double(progress.render.samples_done.load()) / double(samples), true};
    return {prefix + progress.build.phase.load(), progress.build.fraction.load()};
}

void save(Frame& frame, Preview& preview, const RenderOptions& options) {
    const RenderStats& render = frame.stats.render;
    for (const Problem& warning : render_warnings(frame)) print_warning(warning);
    if (render.clamped_fraction > 0.0 && !options.quiet)
        print_message("{}: film.clamp took {:.2g} % of the light\n", frame.files.picture,
                      100.0 * render.clamped_fraction);
    const SavedFrame saved = save_frame(frame);
    for (const std::string& layer : saved.layers) print_result("{}\n", layer);
    if (!options.watch || render.cancelled) print_result("{}\n", saved.picture);
    flush_results();
    if (saved.state_error) {
        print_warning(*saved.state_error);
        print_warning({{frame.files.picture}, "--resume will start this frame again", "", "state.unwritten"});
    }
    if (saved.whole) remove_unfinished(frame.files, options.keep_state);
    if (!render.cancelled) preview.finish();
    if (preview.fault()) print_warning(*preview.fault());
}

void print_fault(Display& display) {
    if (const std::optional<Problem> fault = display.take_fault()) print_warning(*fault);
}

// Waits for what the viewer has not taken yet of the last picture.
void finish(std::optional<Display>& display) {
    if (!display) return;
    display->finish(interrupted());
    print_fault(*display);
}

// Asked before anything is saved: of a frame that another process has taken over, nothing is.
struct SavePermission {
    std::function<bool()> holds = [] { return true; };
    std::function<bool()> ask = [] { return true; }; // says so, too, if not
};

// Renders one frame to its files. kept: geometry kept from frame to frame. exit_blocker: set from the start
// of tracing, so that an interrupt does not prevent saving. What a saved scene, or the loss of a claim, has
// stopped is left.
void render_frame(Frame& frame, KeptGeometry& kept, RunProgress& run, const RenderOptions& options,
                  std::optional<ExitBlocker>& exit_blocker, std::optional<Display>& display,
                  const SavePermission& permission) {
    Preview preview(frame.files.preview.empty() ? std::function<void()>() : [&] { save_preview(frame); });
    const auto state = [&] { return state_of(frame.progress, run.prefix()); };
    std::optional<FilmDisplay> shown;
    if (display) shown.emplace(*display, options.output); // all frames in one image
    std::optional<World> world;
    {
        const RunProgress::Watch watch(run, state);
        world = build_frame(frame, std::exchange(kept, {}));
    }
    const ResumedFrame resumed = resume_frame(frame);
    if (resumed.refused)
        print_warning(*resumed.refused);
    else if (!resumed.message.empty() && !options.quiet)
        print_message("{}", resumed.message);
    if (display) print_fault(*display);
    exit_blocker.emplace();
    Checkpoint checkpoint(options.checkpoint, [&] {
        if (permission.holds()) save_checkpoint(frame);
    });
    frame.progress.render.seconds_between_passes = options.checkpoint;
    bool warned = false;
    frame.between_passes = [&] {
        if (shown) shown->show_if_due(frame.film);
        checkpoint.save_if_due();
        std::optional<Problem> fault = checkpoint.take_fault();
        if (!fault || std::exchange(warned, true)) return;
        fault->fix += ": no checkpoint is saved";
        print_warning(*fault);
    };
    {
        const RunProgress::Watch watch(run, state);
        trace_frame(frame, *world, preview);
    }
    kept = kept_geometry(*std::move(world)); // free the rest: saving may need the memory
    world.reset();
    const bool cancelled = frame.stats.render.cancelled;
    if ((cancelled && !interrupted()) || !permission.ask()) return;
    run.phase("saving");
    save(frame, preview, options); // first: it needs less memory
    if (shown && !cancelled) shown->show(frame.film);
    if (display) print_fault(*display);
}

// What a run renders, once all that can be checked before has been.
struct Plan {
    FrameOptions options;
    std::vector<FrameFiles> frames;
};

// Those of each frame.
std::vector<PartRequest> parts_of(const Shot& shot, const RenderOptions& options, size_t frames) {
    if (options.samples_per_task == 0) return {options.part};
    const Place place{fmt::format("--samples-per-task {}", options.samples_per_task)};
    if (shot.description.film.number("noise") > 0.0)
        throw InputError(place, "film.noise takes as many samples as each pixel needs",
                         "leave it out, or add --set film.noise=0");
    std::vector<PartRequest> parts = split_samples(
        options.part, uint32_t(shot.description.film.integer("samples")), options.samples_per_task);
    constexpr size_t max_parts = 1'000'000;
    if (parts.size() > max_parts / std::max<size_t>(frames, 1))
        throw InputError(place, fmt::format("these are more than {} parts", max_parts),
                         "give more samples a task, or fewer frames");
    return parts;
}

Plan plan_of(const Shot& shot, const RenderOptions& options) {
    const Vec2d range = shot.description.globals.vec2("frames");
    std::vector<double> frames = frames_to_make(options.frames, range, options.output);
    if (const std::string skipped = skip_frames_outside(frames, options.frames, range); !skipped.empty())
        print_message("{}", skipped);
    if (options.watch && frames.size() != 1)
        throw InputError({"--watch"}, fmt::format("it renders one frame, and these are {}", frames.size()),
                         "say which with --frame");
    check_contents(shot, options, frames.size());
    Plan plan{{.scene = options.scene,
               .layers = more_layers(shot, options),
               .seconds = options.seconds,
               .resume = options.resume,
               .keep_state = options.keep_state,
               .after = options.after},
              {}};
    const uint64_t digest = shot_digest(shot, plan.options, options.overrides.settings);
    const std::vector<PartRequest> parts = parts_of(shot, options, frames.size());
    for (const double frame : frames)
        for (const PartRequest& part : parts)
            plan.frames.push_back(
                frame_files(frame, shot, digest, options.output, options.preview, options.pictures, part));
    check_parts(shot, plan.options, plan.frames);
    check_outputs(shot, plan.frames, options);
    return plan;
}

constexpr const char* waits = "waiting for the scene or a file of it to be saved";

// Reads the scene and renders its frame. False: an interrupt stopped it.
bool render_watched(SceneWatch& watch, const RenderOptions& options, int threads) {
    RunProgress run(options.quiet);
    const double begin = wall_seconds();
    Shot& shot = watch.load();
    print_warnings(shot);
    FrameStats stats;
    stats.load = wall_seconds() - begin;
    Plan plan = plan_of(shot, options);
    const FrameFiles& files = plan.frames.front();
    stats.frame = files.frame;
    stats.threads = threads;
    stats.memory_budget = plan.options.memory = memory_of(options);
    StatsFile stats_file(options.stats);
    KeptGeometry kept;
    std::optional<Display> display;
    if (options.display) display.emplace(*options.display);
    run.begin_part(0, 1);
    std::optional<ExitBlocker> exit_blocker;
    tbb::task_arena(threads).execute([&] {
        Frame frame{shot, plan.options, files, layer_names(shot, plan.options.layers), watch.stop(), stats};
        render_frame(frame, kept, run, options, exit_blocker, display, {});
    });
    const bool cancelled = stats.render.cancelled;
    if (cancelled && !interrupted()) return true;
    stats_file.add(stats);
    stats_file.finish();
    if (cancelled) return false;
    finish(display);
    print_result("{}: written, {:.2f} s; {}\n", files.picture, stats.total, waits);
    flush_results();
    run.finish();
    return true;
}

// Mistakes that are there from the start end it, as they end a render without --watch.
int watch_scene(const RenderOptions& options, int threads) {
    std::optional<ExitBlocker> until_it_ends;
    SceneWatch watch(options.scene, options.overrides);
    for (bool begun = false;; release_free_memory()) {
        try {
            if (!render_watched(watch, options, threads)) return interrupt_exit_code();
        } catch (const InputError& error) {
            if (!begun) throw;
            print_problems(error.problems);
            print_message("{}: {}\n", options.output, waits);
        } catch (const Cancelled&) {
            if (interrupted()) throw;
        }
        begun = true;
        until_it_ends.emplace();
        if (!watch.wait()) return exit_done;
        until_it_ends.reset();
    }
}

} // namespace

int render_command(const RenderOptions& options) {
    check_picture_name(options.output);
    if (!options.preview.empty()) check_picture_name(options.preview);
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    if (options.watch) return watch_scene(options, threads);
    if (options.list) { // no progress: what is on stdout is the list
        const Shot shot = open_shot(options);
        print_list(plan_of(shot, options).frames);
        return exit_done;
    }
    RunProgress run(options.quiet);
    const double begin = wall_seconds();
    Shot shot = open_shot(options);
    const double load_seconds = wall_seconds() - begin;
    Plan plan = plan_of(shot, options);

    tbb::task_arena arena(threads);
    StatsFile stats_file(options.stats);
    KeptGeometry kept;
    std::optional<Display> display;
    if (options.display) display.emplace(*options.display);
    bool first = true;
    FramesToRender frames(plan.frames, {options.resume, options.lease, options.quiet});
    while (const FrameFiles* next = frames.next()) {
        const FrameFiles& files = *next;
        run.begin_part(size_t(next - plan.frames.data()), plan.frames.size());
        FrameStats stats;
        stats.frame = files.frame;
        stats.threads = threads;
        stats.memory_budget = plan.options.memory = memory_of(options);
        stats.load = std::exchange(first, false) ? load_seconds : 0.0;
        std::optional<ExitBlocker> exit_blocker;
        bool saved = false;
        const SavePermission permission{[&] { return frames.holds(); },
                                        [&] { return saved = frames.may_save(); }};
        try {
            arena.execute([&] {
                Frame frame{shot,          plan.options, files, layer_names(shot, plan.options.layers),
                            frames.stop(), stats};
                render_frame(frame, kept, run, options, exit_blocker, display, permission);
            });
        } catch (const Cancelled&) {
            if (!frames.is_lost() || interrupted()) throw;
        }
        if (!saved && frames.is_lost() && !interrupted()) continue;
        frames.saved();
        stats_file.add(stats);
        if (stats.render.cancelled) {
            stats_file.finish();
            return interrupt_exit_code();
        }
        release_free_memory();
    }
    stats_file.finish();
    finish(display);
    run.finish();
    return 0;
}

} // namespace marram
