// SPDX-License-Identifier: Apache-2.0
#include "core/shot/bake.h"
#include "core/math/file_types.h"
#include "core/read/level_set_file.h"

#include "core/math/problem.h"
#include "core/shot/settings.h"
#include "core/write/curve_export.h"
#include "core/write/grid_export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <span>

namespace marram {
namespace {

MarramStage stage_of(const std::string& name) {
    return name == "rest" ? MARRAM_REST : name == "bent" ? MARRAM_BENT : MARRAM_FINAL;
}

bool holds_strands(const std::string& extension) { return is_one_of(extension, baked_strand_files); }
bool holds_surfaces(const std::string& extension) {
    return is_one_of(extension, baked_surface_files) || extension == ".vdb";
}
bool holds_grids(const std::string& extension) { return is_one_of(extension, baked_grid_files); }
bool holds_both(const std::string& extension) {
    return holds_strands(extension) && holds_surfaces(extension);
}

// The only mesh of those given. kind: "terrain", for messages. Throws InputError if there is none or more
// than one.
const MeshGeometry& only_one(const std::vector<const MeshGeometry*>& meshes, const std::string& output,
                             const std::string& kind) {
    if (meshes.empty()) throw InputError({output}, "the scene has no " + kind, "bake a scene with one");
    if (meshes.size() > 1)
        throw InputError({output},
                         fmt::format("the scene has more than one {}: '{}' and '{}'", kind, meshes[0]->name,
                                     meshes[1]->name),
                         "bake a scene with one of them");
    return *meshes[0];
}

std::vector<const MeshGeometry*> meshes_with_grids(const World& world) {
    std::vector<const MeshGeometry*> found;
    for (const MeshGeometry& mesh : world.meshes)
        if (!mesh.grids.empty()) found.push_back(&mesh);
    return found;
}

// The surface that a procedural has made: one with grids before others. closed: only those that enclose a
// volume.
const MeshGeometry& baked_surface(const Shot& shot, const World& world, const std::string& output,
                                  bool closed) {
    std::vector<const MeshGeometry*> found = meshes_with_grids(world);
    if (closed || found.empty()) {
        found.clear();
        for (const MeshGeometry& mesh : world.meshes)
            for (const auto& procedural : shot.geometry.procedurals)
                if (procedural->kind() == MARRAM_MESH && procedural->name() == mesh.name &&
                    (!closed || is_closed(mesh)))
                    found.push_back(&mesh);
    }
    return only_one(found, output, closed ? "rock with a closed surface" : "terrain or rock");
}

bool makes_strands(const Shot& shot) {
    return std::ranges::any_of(shot.geometry.procedurals,
                               [](const auto& p) { return p->kind() == MARRAM_CURVES; });
}

// A scene with strands and a surface, of which one is written because nobody has chosen.
std::optional<Problem> other_warning(const Shot& shot, const std::string& output, bool strands) {
    const auto made = [&](MarramOutputKind kind) {
        const auto found =
            std::ranges::find_if(shot.geometry.procedurals, [&](const auto& p) { return p->kind() == kind; });
        return found == shot.geometry.procedurals.end() ? std::string() : (*found)->name();
    };
    const std::string surface = made(MARRAM_MESH), curves = made(MARRAM_CURVES);
    if (surface.empty() || curves.empty()) return std::nullopt;
    return Problem{{output},
                   strands ? fmt::format("has the strands, not the surface of '{}'", surface)
                           : fmt::format("has the surface of '{}', not the strands of '{}'", surface, curves),
                   "choose with --what terrain or --what strands",
                   "bake.other"};
}

} // namespace

void check_baked_formats(const BakeSettings& settings) {
    const std::string extension = extension_of(settings.output);
    if (!holds_strands(extension) && !holds_surfaces(extension) && !holds_grids(extension))
        throw InputError(
            {settings.output}, "nothing is written in the format '" + extension + "'",
            fmt::format(
                "name it {} for strands, {} for the surface of a terrain or rock, .vdb for a rock as a "
                "level set, {} for grids",
                listed_files(baked_strand_files), listed_files(baked_surface_files),
                listed_files(baked_grid_files)));
    if (settings.what == "terrain" && !holds_surfaces(extension) && !holds_grids(extension))
        throw InputError({"--what terrain"}, "'" + extension + "' holds strands only",
                         "bake a surface to .obj or .ply, heights to .exr, .tif or .png");
    if (settings.what == "strands" && !holds_strands(extension))
        throw InputError({"--what strands"}, "'" + extension + "' holds no strands",
                         "bake strands to " + listed_files(baked_strand_files));
    if (settings.range && extension != ".png")
        throw InputError({"--range"}, "'" + extension + "' needs no range: it holds metres",
                         "leave it out, or bake heights to .png");
    if (settings.range && !(settings.range->x() < settings.range->y()))
        throw InputError({"--range"},
                         fmt::format("{:g} is not below {:g}", settings.range->x(), settings.range->y()),
                         "give the heights that are black and white, the lower one first");
    const std::string colliders = listed_files(baked_collider_files);
    if (!settings.colliders.empty() && !is_one_of(extension_of(settings.colliders), baked_collider_files))
        throw InputError({settings.colliders}, "colliders are written as " + colliders,
                         "name the file " + colliders);
    if (!settings.attributes.empty() && !is_one_of(extension, baked_attribute_files))
        throw InputError({"--attributes"}, "'" + extension + "' holds no attributes",
                         "bake strands to " + listed_files(baked_attribute_files));
}

void check_baked_strands(const Shot& shot, const BakeSettings& settings) {
    const std::string extension = extension_of(settings.output);
    const bool nothing_else = holds_strands(extension) && !holds_surfaces(extension);
    if ((nothing_else || settings.what == "strands") && !makes_strands(shot))
        throw InputError({settings.output}, "the scene has no strands",
                         "bake a scene with some, or the surface of its terrain or rock to .ply or .obj");
}

void check_baked_attributes(const Shot& shot, const std::vector<std::string>& names) {
    std::vector<std::string> known;
    for (const auto& procedural : shot.geometry.procedurals)
        if (procedural->kind() == MARRAM_CURVES)
            for (const MarramAttribute& attribute : procedural->attributes())
                known.emplace_back(attribute.name);
    for (const std::string& name : names)
        if (std::ranges::find(known, name) == known.end())
            throw InputError({"--attributes " + name}, "no curves of the scene have this attribute",
                             known.empty() ? std::string("leave it out: the scene has no curves")
                                           : fmt::format("choose among {}", fmt::join(known, ", ")));
}

BuildSettings build_settings_for_bake(const Shot& shot, const BakeSettings& settings, double frame) {
    BuildSettings build = build_settings(shot, frame);
    build.shutter_open = build.shutter_close = 0.0; // no motion samples
    build.stage = stage_of(settings.stage);
    build.trace_curves = false;
    build.camera.reset(); // all strands
    build.attributes = settings.attributes;
    build.attributes.emplace_back("id");
    return build;
}

const MeshGeometry& mesh_of_heights(const World& world, const std::string& file) {
    return only_one(meshes_with_grids(world), file, "terrain, or rock with map");
}

namespace {

std::vector<Problem> write_baked_grids(const World& world, const BakeSettings& settings,
                                       const std::string& output) {
    const MeshGeometry& mesh = mesh_of_heights(world, output);
    const size_t clamped = write_grids(output, mesh, settings.range);
    if (clamped == 0) return {};
    const Vec2d heights = height_range(mesh);
    return {
        {{output},
         fmt::format("{} of {} heights are outside the range and are clamped, they are {:.6g} to {:.6g} m",
                     clamped, mesh.grids[0].values.size(), heights.x(), heights.y()),
         fmt::format("give --range {:g},{:g}", std::floor(heights.x()), std::ceil(heights.y())),
         "bake.range"}};
}

} // namespace

std::vector<Problem> write_baked(const Shot& shot, const World& world, const BakeSettings& settings,
                                 const std::string& output) {
    const std::string extension = extension_of(settings.output);
    const bool prefers_strands =
        holds_both(extension)
            ? makes_strands(shot) && (extension == ".obj" || meshes_with_grids(world).empty())
            : holds_strands(extension);
    const bool strands = settings.what.empty() ? prefers_strands : settings.what == "strands";
    std::vector<Problem> warnings;
    if (settings.what.empty() && holds_both(extension))
        if (std::optional<Problem> warning = other_warning(shot, settings.output, strands))
            warnings.push_back(*std::move(warning));
    if (strands) {
        write_curves(output, world.curves, world.frame, shot.description.globals.number("fps"));
        return warnings;
    }
    if (holds_grids(extension)) return write_baked_grids(world, settings, output);
    const MeshGeometry& mesh = baked_surface(shot, world, output, extension == ".vdb");
    if (!settings.attributes.empty())
        throw InputError({"--attributes"}, "'" + output + "' is the surface of '" + mesh.name + "'",
                         "bake strands to .usda, or leave --attributes out");
    if (extension == ".ply")
        write_surface_ply(output, mesh);
    else if (extension == ".vdb")
        write_level_set(output, mesh);
    else
        write_colliders_obj(output, std::span(&mesh, 1));
    return warnings;
}

void write_colliders(const World& world, const std::string& file, double fps) {
    if (extension_of(file) == ".obj") write_colliders_obj(file, world.meshes);
    if (extension_of(file) == ".usda") write_colliders_usda(file, world.meshes, world.frame, fps);
}

} // namespace marram
