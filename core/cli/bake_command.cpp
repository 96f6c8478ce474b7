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
#include <set>

namespace marram {
namespace {

MarramStage stage_of(const std::string& name) {
    return name == "rest" ? MARRAM_REST : name == "bent" ? MARRAM_BENT : MARRAM_FINAL;
}

// What a file is written of.
enum class Baked { strands, strands_or_surface, surface, grids };

struct BakedFormat {
    const char* extension;
    Baked what;
};
constexpr BakedFormat baked_formats[] = {
    {".hair", Baked::strands}, {".usda", Baked::strands}, {".obj", Baked::strands_or_surface},
    {".ply", Baked::surface},  {".exr", Baked::grids},    {".png", Baked::grids},
    {".tif", Baked::grids},    {".tiff", Baked::grids}};

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
        throw InputError(
            {options.output}, "nothing is written in the format '" + extension + "'",
            "name it .hair, .usda or .obj for strands, .obj or .ply for the surface of a terrain, .exr, .tif "
            "or .png for its grids");
    const std::string meshes = std::filesystem::path(options.colliders).extension().string();
    if (!options.colliders.empty() && meshes != ".obj" && meshes != ".usda")
        throw InputError({options.colliders}, "colliders are written as .obj or .usda",
                         "name the file .obj or .usda");
    if (!options.attributes.empty() && extension != ".usda")
        throw InputError({"--attributes"}, "'" + extension + "' holds no attributes",
                         "bake strands to .usda");
}

// The one mesh that hands out grids.
const MeshGeometry& mesh_with_grids(const World& world, const std::string& output) {
    const MeshGeometry* found = nullptr;
    for (const MeshGeometry& mesh : world.meshes) {
        if (mesh.grids.empty()) continue;
        if (found)
            throw InputError({output}, "'" + found->name + "' and '" + mesh.name + "' both hand out grids",
                             "bake a scene with one of them");
        found = &mesh;
    }
    if (!found)
        throw InputError({output}, "no mesh of the scene hands out grids", "bake a scene with a terrain");
    return *found;
}

bool makes_strands(const Shot& shot) {
    return std::ranges::any_of(shot.geometry.procedurals,
                               [](const auto& p) { return p->kind() == MARRAM_CURVES; });
}

void write_baked(Baked what, const std::string& output, const Shot& shot, const World& world, double frame) {
    if (what == Baked::strands_or_surface) what = makes_strands(shot) ? Baked::strands : Baked::surface;
    if (what == Baked::strands)
        return write_curves(output, world.curves, frame, shot.description.globals.number("fps"));
    const MeshGeometry& mesh = mesh_with_grids(world, output);
    if (what == Baked::grids) return write_grids(output, mesh);
    if (output.ends_with(".ply")) return write_surface_ply(output, mesh);
    write_colliders_obj(output, std::span(&mesh, 1));
}

// Throws InputError for a name that no curves of the scene carry.
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

// What every frame is built with.
BuildSettings settings_of(const Shot& shot, const BakeOptions& options, double frame) {
    BuildSettings settings = build_settings(shot, frame);
    settings.shutter_open = settings.shutter_close = 0.0; // the frame itself, not what the shutter sees of it
    settings.stage = stage_of(options.stage);
    settings.curves_bvh = false;
    settings.camera.reset(); // growth surfaces, not what the camera sees of them
    settings.attributes = options.attributes;
    settings.attributes.emplace_back("id");
    return settings;
}

// Before anything is built: every file can be written, and is none that is read or written as something else.
void check_outputs(const Shot& shot, const std::vector<double>& frames, const BakeOptions& options) {
    RunFiles files(files_read(shot, options.scene));
    std::set<std::string> stats;
    for (const double frame : frames) {
        for (const std::string& file :
             {numbered(options.output, frame), numbered(options.colliders, frame)}) {
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

// `prefix` of the progress line: "2 of 5: ".
void bake_frame(Shot& shot, const BakeOptions& options, const std::string& prefix, FrameStats& stats) {
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
        write_baked(baked_format(extension_of_output(options))->what, output, shot, world, stats.frame);
        if (colliders.ends_with(".obj")) write_colliders_obj(colliders, world.meshes);
        if (colliders.ends_with(".usda"))
            write_colliders_usda(colliders, world.meshes, stats.frame, settings.fps);
    }
    for (const std::string& warning : stats.build.warnings) fmt::print(stderr, "{}\n", warning);
    fmt::print("{}\n", output);
    std::fflush(stdout); // an interrupt may cut off what comes later
}

} // namespace

int bake_command(const BakeOptions& options) {
    check_formats(options);
    const double begin = wall_seconds();
    Shot shot = open_shot(options);
    const double load_seconds = wall_seconds() - begin;
    const Vec2d range = shot.description.globals.vec2("frames");
    const std::vector<double> frames = options.frames.given()
                                           ? frames_to_make(options.frames, range, options.output)
                                           : std::vector{range.x()};
    check_outputs(shot, frames, options);
    check_attributes(shot, options.attributes);
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    StatsFile stats_file(options.stats);
    for (size_t i = 0; i < frames.size(); ++i) {
        const double frame_begin = i == 0 ? begin : wall_seconds();
        FrameStats stats;
        stats.frame = frames[i];
        stats.threads = threads;
        stats.load = i == 0 ? load_seconds : 0.0;
        bake_frame(shot, options, frames.size() > 1 ? fmt::format("{} of {}: ", i + 1, frames.size()) : "",
                   stats);
        stats.total = wall_seconds() - frame_begin;
        stats_file.add(stats);
        release_free_memory();
    }
    stats_file.finish();
    return 0;
}

} // namespace marram
