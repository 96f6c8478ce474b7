// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/memory.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/image/atomic_file.h"
#include "core/image/run_files.h"
#include "core/math/clock.h"
#include "core/math/file_types.h"
#include "core/math/frame_name.h"
#include "core/shot/height_sequence.h"
#include "core/shot/stats.h"
#include "core/write/curve_export.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <functional>
#include <iterator>
#include <optional>
#include <set>

namespace marram {
namespace {

// A .usda holds all frames as time samples, unless its name has a #### for their numbers.
bool holds_all_frames(const BakeOptions& options) {
    return extension_of(options.output) == ".usda" && !has_frame_mark(options.output);
}

std::vector<double> frames_to_bake(const BakeOptions& options, const Vec2d& range) {
    if (!options.frames.given()) return {range.x()};
    if (!holds_all_frames(options)) return frames_to_make(options.frames, range, options.output);
    std::vector<double> frames = frames_to_make(options.frames, range, options.output + "#");
    std::ranges::sort(frames);
    return frames;
}

// Checks before anything is built that every file can be written and is not also read, or written as another
// file.
void check_outputs(const Shot& shot, const std::vector<double>& frames, const BakeOptions& options) {
    RunFiles files(files_read(shot, options.scene));
    std::set<std::string> stats;
    for (const double frame : frames) {
        const bool is_written = frame == frames.front() || !holds_all_frames(options);
        for (const std::string& file :
             {is_written ? numbered(options.output, frame) : "", numbered(options.colliders, frame)}) {
            files.write(file);
            if (!file.empty()) check_writable(file);
        }
        stats.insert(numbered(options.stats, frame));
    }
    for (const std::string& file : stats) {
        files.write(file);
        if (!file.empty()) check_writable(file);
    }
}

void print_new(const std::vector<Problem>& warnings, std::set<std::string>& printed) {
    for (const Problem& warning : warnings)
        if (printed.insert(to_string(warning)).second) print_warning(warning);
}

// What is done with the world of a frame. Returns warnings.
using WriteFrame = std::function<std::vector<Problem>(const World&)>;

// prefix: of the phases, "again, " or "".
void build_and_write(Shot& shot, const BakeOptions& options, RunProgress& run, const std::string& prefix,
                     std::set<std::string>& warnings, FrameStats& stats, const WriteFrame& write) {
    const double begin = wall_seconds();
    set_frame(shot, stats.frame);
    BuildSettings settings = build_settings_for_bake(shot, options, stats.frame);
    stats.memory_budget = settings.memory.limit = memory_of(options);
    tbb::task_arena arena(stats.threads);
    BuildProgress progress;
    stats.build = {};
    {
        World world;
        const RunProgress::Watch watch(run, [&] {
            return ProgressState{prefix + run.prefix() + progress.phase.load(), progress.fraction.load()};
        });
        arena.execute(
            [&] { world = build_world(shot.geometry, settings, interrupted(), progress, stats.build); });
        progress.phase = "writing";
        std::ranges::move(write(world), std::back_inserter(stats.build.warnings));
        write_colliders(world, numbered(options.colliders, stats.frame), settings.fps);
    }
    print_new(stats.build.warnings, warnings);
    stats.total += wall_seconds() - begin;
    release_free_memory();
}

void print_output(const std::string& output) {
    print_result("{}\n", output);
    flush_results();
}

// frames: their numbers and threads; their other statistics are filled in.
void bake_frames(Shot& shot, const BakeOptions& options, RunProgress& run, std::set<std::string>& warnings,
                 std::vector<FrameStats>& frames, StatsFile& stats_file) {
    std::optional<UsdaSequence> sequence; // the file of all frames
    if (frames.size() > 1 && holds_all_frames(options))
        sequence.emplace(options.output, shot.description.globals.number("fps"));
    for (size_t i = 0; i < frames.size(); ++i) {
        run.begin_part(i, frames.size());
        const std::string output = numbered(options.output, frames[i].frame);
        build_and_write(shot, options, run, "", warnings, frames[i], [&](const World& world) {
            if (!sequence) return write_baked(shot, world, options, output);
            sequence->add(world.curves, frames[i].frame);
            return std::vector<Problem>();
        });
        if (!sequence) print_output(output);
        stats_file.add(frames[i]);
    }
    if (!sequence) return;
    sequence->commit();
    print_result("{}\n", options.output);
}

// The same for .png files with the range of all frames.
void bake_height_pictures(Shot& shot, BakeOptions options, RunProgress& run, std::set<std::string>& warnings,
                          std::vector<FrameStats>& frames, StatsFile& stats_file) {
    constexpr double built = 0.9; // of the progress: most frames are built once
    HeightSequence heights;
    const size_t count = frames.size();
    for (size_t i = 0; i < count; ++i) {
        run.begin_part(i, count, 0.0, built);
        build_and_write(shot, options, run, "", warnings, frames[i], [&](const World& world) {
            heights.add(world, options.output);
            return std::vector<Problem>();
        });
    }
    options.range = heights.range();
    for (size_t i = 0; i < count; ++i) {
        if (interrupted()) throw Cancelled{};
        run.begin_part(i, count, built, 1.0);
        const double begin = wall_seconds();
        const std::string output = numbered(options.output, frames[i].frame);
        const auto write = [&](const World& world) { return write_baked(shot, world, options, output); };
        if (const std::optional<World> world = heights.take(i)) {
            write(*world);
            frames[i].total += wall_seconds() - begin;
        } else {
            build_and_write(shot, options, run, "again, ", warnings, frames[i], write);
        }
        print_output(output);
        stats_file.add(frames[i]);
    }
}

} // namespace

int bake_command(const BakeOptions& options) {
    check_baked_formats(options);
    RunProgress run(options.quiet, 1.0);
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    const double begin = wall_seconds();
    Shot shot = open_shot(options, false);
    const double load_seconds = wall_seconds() - begin;
    const Vec2d range = shot.description.globals.vec2("frames");
    std::vector<double> frames = frames_to_bake(options, range);
    if (const std::string skipped = skip_frames_outside(frames, options.frames, range); !skipped.empty())
        print_message("{}", skipped);
    check_outputs(shot, frames, options);
    check_baked_strands(shot, options);
    check_baked_attributes(shot, options.attributes);
    if (frames.empty()) { // skipped
        run.finish();
        return exit_done;
    }
    std::set<std::string> warnings; // already printed; each is printed once
    std::vector<FrameStats> stats(frames.size());
    for (size_t i = 0; i < frames.size(); ++i) {
        stats[i].frame = frames[i];
        stats[i].threads = threads;
    }
    stats[0].load = load_seconds;
    stats[0].total = wall_seconds() - begin;
    StatsFile stats_file(options.stats);
    if (frames.size() > 1 && extension_of(options.output) == ".png" && !options.range)
        bake_height_pictures(shot, options, run, warnings, stats, stats_file);
    else
        bake_frames(shot, options, run, warnings, stats, stats_file);
    stats_file.finish();
    run.finish();
    return 0;
}

} // namespace marram
