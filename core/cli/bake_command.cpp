// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/memory.h"
#include "core/cli/output.h"
#include "core/cli/progress.h"
#include "core/geometry/curve_export.h"
#include "core/image/atomic_file.h"
#include "core/image/run_files.h"
#include "core/math/clock.h"
#include "core/math/frame_name.h"
#include "core/shot/stats.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>
#include <set>

namespace marram {
namespace {

// A .usda holds all frames as time samples, unless its name has a #### for their numbers.
bool holds_all_frames(const BakeOptions& options) {
    return options.output.ends_with(".usda") && !has_frame_mark(options.output);
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

void print_new(const std::vector<std::string>& warnings, std::set<std::string>& printed) {
    for (const std::string& warning : warnings)
        if (printed.insert(warning).second) print_message("{}\n", warning);
}

// prefix: of the progress line, "2 of 5: ". sequence: the file of all frames, or nullptr.
void bake_frame(Shot& shot, const BakeOptions& options, const std::string& prefix, UsdaSequence* sequence,
                std::set<std::string>& warnings, FrameStats& stats) {
    const std::string output = numbered(options.output, stats.frame);
    const std::string colliders = numbered(options.colliders, stats.frame);
    select_takes(shot, stats.frame);
    const BuildSettings settings = build_settings_for_bake(shot, options, stats.frame);
    tbb::task_arena arena(stats.threads);
    BuildProgress progress;
    World world;
    {
        const ProgressLine line(options.quiet, [&] {
            return ProgressState{prefix + progress.phase.load(), progress.fraction.load()};
        });
        arena.execute(
            [&] { world = build_world(shot.geometry, settings, interrupted(), progress, stats.build); });
        progress.phase = "writing";
        if (sequence)
            sequence->add(world.curves, stats.frame);
        else
            std::ranges::move(write_baked(shot, world, options, output),
                              std::back_inserter(stats.build.warnings));
        write_colliders(world, colliders, settings.fps);
    }
    print_new(stats.build.warnings, warnings);
    if (sequence) return;
    print_result("{}\n", output);
    flush_results();
}

// The heights of all frames: a range for each would make a sequence flicker. Builds the frames, which are built again
// to be written; simulated terrains then find their states.
Vec2d heights_of_frames(Shot& shot, const std::vector<double>& frames, const BakeOptions& options,
                        int threads, std::set<std::string>& warnings) {
    Vec2d range(std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity());
    for (size_t i = 0; i < frames.size(); ++i) {
        select_takes(shot, frames[i]);
        const BuildSettings settings = build_settings_for_bake(shot, options, frames[i]);
        tbb::task_arena arena(threads);
        BuildProgress progress;
        BuildStats stats;
        World world;
        const ProgressLine line(options.quiet, [&] {
            return ProgressState{
                fmt::format("heights of {} of {}: {}", i + 1, frames.size(), progress.phase.load()),
                progress.fraction.load()};
        });
        arena.execute([&] { world = build_world(shot.geometry, settings, interrupted(), progress, stats); });
        const Vec2d heights = baked_heights(world, options.output);
        print_new(stats.warnings, warnings);
        range = {std::min(range.x(), heights.x()), std::max(range.y(), heights.y())};
    }
    return range;
}

} // namespace

int bake_command(const BakeOptions& given) {
    BakeOptions options = given;
    check_baked_formats(options);
    const double begin = wall_seconds();
    Shot shot = open_shot(options, false);
    const double load_seconds = wall_seconds() - begin;
    const Vec2d range = shot.description.globals.vec2("frames");
    const std::vector<double> frames = frames_to_bake(options, range);
    check_outputs(shot, frames, options);
    check_baked_strands(shot, options);
    check_baked_attributes(shot, options.attributes);
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    std::set<std::string> warnings; // already printed; each is printed once
    if (frames.size() > 1 && options.output.ends_with(".png") && !options.range)
        options.range = heights_of_frames(shot, frames, options, threads, warnings);
    StatsFile stats_file(options.stats);
    std::optional<UsdaSequence> sequence;
    if (frames.size() > 1 && holds_all_frames(options))
        sequence.emplace(options.output, shot.description.globals.number("fps"));
    for (size_t i = 0; i < frames.size(); ++i) {
        const double frame_begin = i == 0 ? begin : wall_seconds();
        FrameStats stats;
        stats.frame = frames[i];
        stats.threads = threads;
        stats.load = i == 0 ? load_seconds : 0.0;
        bake_frame(shot, options, frames.size() > 1 ? fmt::format("{} of {}: ", i + 1, frames.size()) : "",
                   sequence ? &*sequence : nullptr, warnings, stats);
        stats.total = wall_seconds() - frame_begin;
        stats_file.add(stats);
        release_free_memory();
    }
    if (sequence) {
        sequence->commit();
        print_result("{}\n", options.output);
    }
    stats_file.finish();
    return 0;
}

} // namespace marram
