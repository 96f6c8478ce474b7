// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/scene_summary.h"

#include "core/shot/file_summary.h"
#include "core/shot/settings.h"
#include "core/world/curve_memory.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string>

namespace marram {
namespace {

// The report entries of procedurals that make meshes: those that begin with the procedural's type,
// "terrain.sand".
std::string mesh_reports(const Shot& shot, const Report& report) {
    std::string text;
    std::set<std::string> types;
    for (const auto& procedural : shot.geometry.procedurals)
        if (procedural->kind() == MARRAM_MESH) types.insert(std::string(procedural->calls().name) + ".");
    for (const auto& [path, entry] : report.entries())
        for (const std::string& type : types)
            if (path.starts_with(type))
                text += fmt::format("{}: {:.6g}{}{}\n", path, report(path),
                                    entry.declared.unit && *entry.declared.unit ? " " : "",
                                    entry.declared.unit ? entry.declared.unit : "");
    return text;
}

} // namespace

std::string summaries_of_procedurals(const Shot& shot) {
    std::vector<std::pair<std::string, std::string>> texts; // text, names
    for (const auto& procedural : shot.geometry.procedurals) {
        const std::string text = procedural->summarize();
        if (text.empty()) continue;
        const auto same = std::ranges::find(texts, text, &std::pair<std::string, std::string>::first);
        if (same == texts.end())
            texts.emplace_back(text, procedural->name());
        else
            same->second += ", " + procedural->name();
    }
    std::string all;
    for (const auto& [text, names] : texts) all += fmt::format("# {}\n{}", names, text);
    return all;
}

std::string scene_summary(Shot& shot, const std::atomic<bool>& cancel) {
    std::string text;
    uint64_t triangles = 0;
    for (const SceneMesh& mesh : shot.geometry.meshes) {
        triangles += mesh.object().mesh.triangles.size();
        if (mesh.instance_of) continue;
        const auto instances = std::ranges::count(shot.geometry.meshes, &mesh, &SceneMesh::instance_of);
        text += fmt::format(
            "mesh {}: {} vertices, {} triangles{}{}{}\n", mesh.name, mesh.mesh.positions.size(),
            mesh.mesh.triangles.size(), mesh.mesh.uvs.empty() ? ", no uvs" : "",
            !mesh.shapes.empty() ? fmt::format(", {} shapes", mesh.shapes.size())
            : mesh.moves()       ? ", moves"
                                 : "",
            instances > 0 ? fmt::format(", {} instance{}", instances, instances > 1 ? "s" : "") : "");
    }
    set_frame(shot, shot.description.globals.vec2("frames").x());
    for (const SceneCurves& curves : shot.geometry.curves) {
        static constexpr const char* drawn[] = {"B-splines", "Catmull-Rom curves", "polylines"};
        text += fmt::format("curves {}: {} {}, {} CVs in all{}{}\n", curves.name, curves.closed.size(),
                            drawn[curves.basis], curves.offsets.back(),
                            !curves.samples.empty() ? fmt::format(", {} samples", curves.samples.size())
                            : !curves.takes.empty() ? fmt::format(", one of {} takes", curves.takes.size())
                            : curves.moves()        ? ", moves"
                                                    : "",
                            curves.attributes.empty() ? "" : ", with");
        for (const AttributeValues& attribute : curves.attributes)
            text += fmt::format("    {}: {} a {}{}\n", attribute.name, attribute.components,
                                attribute.rate == MARRAM_PER_CURVE ? "curve" : "CV",
                                attribute.discrete ? ", discrete" : "");
    }
    const BuildSettings settings = build_settings(shot, shot.description.globals.vec2("frames").x());
    BuildSettings still = settings; // no motion: only counts are needed
    still.trace_curves = false;
    still.shutter_open = still.shutter_close = 0.0;
    BuildProgress progress;
    BuildStats stats;
    const World world = build_world(shot.geometry, still, cancel, progress, stats);
    for (const CurveGeometry& curves : world.curves)
        text += fmt::format("procedural {}: {} curves of {} CVs\n", curves.name, curves.curve_count,
                            curves.offsets.empty() ? std::to_string(curves.cvs_per_curve)
                                                   : fmt::format("{} in all", curves.offsets.back()));
    text += mesh_reports(shot, stats.report);
    text += summaries_of_procedurals(shot);
    const double keys = chosen_motion_keys(shot.geometry, settings, cancel, progress);
    // Embree's BVH over cubic segments, medium quality: thread seconds per segment and motion step.
    constexpr double bvh_seconds = 2e-6;
    double bvh = 0.0, building = 0.0; // bytes
    for (const CurveGeometry& curves : world.curves) {
        const BvhCost cost = bvh_of_cubics(curves.shape, keys);
        bvh += cost.bvh * double(curves.layout().segment_count());
        building += cost.building * double(curves.layout().segment_count());
    }
    const double segments = double(stats.segments);
    const auto [width, height] = film_size(shot);
    text += fmt::format("triangles: {}\ncurves: {}\nsegments: {}\n", triangles, stats.curves, stats.segments);
    text += fmt::format("memory: about {:.0f} MB for curves and their BVH at {} motion keys, {:.0f} MB more "
                        "while it is built\n",
                        1e-6 * (double(stats.curve_bytes) * keys + double(stats.attribute_bytes) +
                                stats.report("memory.curve_extra_bytes") + bvh),
                        keys, 1e-6 * building);
    if (stats.volume_bytes > 0)
        text += fmt::format("velocities: {:.3g} MB\n", 1e-6 * double(stats.volume_bytes));
    text += fmt::format(
        "build: about {:.1f} s of one processor for the BVH, {:.2f} s of all of them for the strands\n",
        segments * bvh_seconds * (1.0 + 0.3 * (keys - 1.0)), strand_seconds(stats.report));
    text += fmt::format("film: {} x {}, {:.3g} paths\n", width, height,
                        double(width) * height * shot.description.film.integer("samples"));
    if (!world.bounds.isEmpty()) text += fmt::format("bounds of the meshes: {}\n", box_text(world.bounds));
    for (const auto& procedural : shot.geometry.procedurals)
        if (const std::string tables = procedural->describe(); !tables.empty())
            text += fmt::format("\n# What '{}' has generated, to be edited by hand:\n{}", procedural->name(),
                                tables);
    return text;
}

} // namespace marram
