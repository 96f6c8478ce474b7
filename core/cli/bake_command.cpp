// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/cli/memory.h"
#include "core/cli/progress.h"
#include "core/geometry/curve_export.h"
#include "core/geometry/grid_export.h"
#include "core/image/atomic_file.h"
#include "core/math/clock.h"
#include "core/shot/frame_name.h"
#include "core/shot/settings.h"
#include "core/shot/stats.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <set>

namespace marram {
namespace {

MarramStage stage_of(const std::string& name) {
    return name == "rest" ? MARRAM_REST : name == "bent" ? MARRAM_BENT : MARRAM_FINAL;
}

// What a file format can hold.
enum class Baked { strands, strands_or_surface, surface_or_strands, grids };

struct BakedFormat {
    const char* extension;
    Baked what;
};
constexpr BakedFormat baked_formats[] = {{".hair", Baked::strands},
                                         {".usda", Baked::strands},
                                         {".obj", Baked::strands_or_surface},
                                         {".ply", Baked::surface_or_strands},
                                         {".exr", Baked::grids},
                                         {".png", Baked::grids},
                                         {".tif", Baked::grids},
                                         {".tiff", Baked::grids}};

std::string extension_of_output(const BakeOptions& options) {
    return std::filesystem::path(options.output).extension().string();
}

const BakedFormat* baked_format(const std::string& extension) {
    const auto found =
        std::ranges::find_if(baked_formats, [&](const BakedFormat& f) { return extension == f.extension; });
    return found == std::end(baked_formats) ? nullptr : found;
}

void check_formats(const BakeOptions& options) {
    const std::string extension = extension_of_output(options);
    if (!baked_format(extension))
        throw InputError({options.output}, "nothing is written in the format '" + extension + "'",
                         "name it .hair, .usda, .ply or .obj for strands, .obj or .ply for the surface of a "
                         "terrain, .exr, "
                         ".tif, .tiff or .png for its grids");
    const std::string meshes = std::filesystem::path(options.colliders).extension().string();
    if (!options.colliders.empty() && meshes != ".obj" && meshes != ".usda")
        throw InputError({options.colliders}, "colliders are written as .obj or .usda",
                         "name the file .obj or .usda");
    if (!options.attributes.empty() && extension != ".usda" && extension != ".ply")
        throw InputError({"--attributes"}, "'" + extension + "' holds no attributes",
                         "bake strands to .usda or .ply");
}

// The only mesh with grids. Throws InputError if there is none or more than one.
const MeshGeometry& mesh_with_grids(const World& world, const std::string& output) {
    const MeshGeometry* found = nullptr;
    for (const MeshGeometry& mesh : world.meshes) {
        if (mesh.grids.empty()) continue;
        if (found)
            throw InputError({output}, "'" + found->name + "' and '" + mesh.name + "' both hand out grids",
                             "bake a scene with one of them");
        found = &mesh;
    }
    if (!found) throw InputError({output}, "no mesh of the scene has grids", "bake a scene with a terrain");
    return *found;
}

bool makes_strands(const Shot& shot) {
    return std::ranges::any_of(shot.geometry.procedurals,
                               [](const auto& p) { return p->kind() == MARRAM_CURVES; });
}

bool has_grids(const World& world) {
    return std::ranges::any_of(world.meshes, [](const MeshGeometry& mesh) { return !mesh.grids.empty(); });
}

void write_baked(Baked what, const std::string& output, const Shot& shot, const World& world,
                 const BakeOptions& options) {
    const bool strands = what == Baked::strands ||
                         (what == Baked::strands_or_surface && makes_strands(shot)) ||
                         (what == Baked::surface_or_strands && makes_strands(shot) && !has_grids(world));
    if (strands)
        return write_curves(output, world.curves, world.frame, shot.description.globals.number("fps"));
    const MeshGeometry& mesh = mesh_with_grids(world, output);
    if (what == Baked::grids) return write_grids(output, mesh);
    if (!options.attributes.empty())
        throw InputError({"--attributes"}, "'" + output + "' is the surface of '" + mesh.name + "'",
                         "bake strands to .usda, or leave --attributes out");
    if (output.ends_with(".ply")) return write_surface_ply(output, mesh);
    write_colliders_obj(output, std::span(&mesh, 1));
}

// Throws InputError for a name that is not an attribute of any curves of the scene.
void check_attributes(const Shot& shot, const std::vector<std::string>& names) {
    std::vector<std::string> known;
    for (const auto& procedural : shot.geometry.procedurals)
        if (procedural->kind() == MARRAM_CURVES)
            for (const MarramAttribute& attribute : procedural->attributes())
                known.emplace_back(attribute.name);
    for (const std::string& name : names)
        if (std::ranges::find(known, name) == known.end())
            throw InputError({"--attributes " + name}, "no curves of the scene have this attribute",
                             fmt::format("choose among {}", fmt::join(known, ", ")));
}

// The settings that every frame is built with.
BuildSettings settings_of(const Shot& shot, const BakeOptions& options, double frame) {
    BuildSettings settings = build_settings(shot, frame);
    settings.shutter_open = settings.shutter_close = 0.0; // no motion samples
    settings.stage = stage_of(options.stage);
    settings.curves_bvh = false;
    settings.camera.reset(); // growth surfaces, not render meshes
    settings.attributes = options.attributes;
    settings.attributes.emplace_back("id");
    return settings;
}

// A .usda holds all frames as time samples, unless its name has a #### for their numbers.
bool holds_all_frames(const BakeOptions& options) {
    return extension_of_output(options) == ".usda" && options.output.find('#') == std::string::npos;
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

// prefix: of the progress line, "2 of 5: ". sequence: the file of all frames, or nullptr.
void bake_frame(Shot& shot, const BakeOptions& options, const std::string& prefix, UsdaSequence* sequence,
                std::set<std::string>& warnings, FrameStats& stats) {
    const std::string output = numbered(options.output, stats.frame);
    const std::string colliders = numbered(options.colliders, stats.frame);
    const BuildSettings settings = settings_of(shot, options, stats.frame);
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
            write_baked(baked_format(extension_of_output(options))->what, output, shot, world, options);
        if (colliders.ends_with(".obj")) write_colliders_obj(colliders, world.meshes);
        if (colliders.ends_with(".usda"))
            write_colliders_usda(colliders, world.meshes, stats.frame, settings.fps);
    }
    for (const std::string& warning : stats.build.warnings)
        if (warnings.insert(warning).second) fmt::print(stderr, "{}\n", warning);
    if (sequence) return;
    fmt::print("{}\n", output);
    std::fflush(stdout); // an interrupt may end the process before a later flush
}

} // namespace

int bake_command(const BakeOptions& options) {
    check_formats(options);
    const double begin = wall_seconds();
    Shot shot = open_shot(options);
    const double load_seconds = wall_seconds() - begin;
    const Vec2d range = shot.description.globals.vec2("frames");
    const std::vector<double> frames = frames_to_bake(options, range);
    check_outputs(shot, frames, options);
    check_attributes(shot, options.attributes);
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    StatsFile stats_file(options.stats);
    std::set<std::string> warnings; // already printed; each is printed once
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
        fmt::print("{}\n", options.output);
    }
    stats_file.finish();
    return 0;
}

} // namespace marram
