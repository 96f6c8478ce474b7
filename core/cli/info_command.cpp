// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/interrupt.h"
#include "core/shot/picture_file.h"
#include "core/shot/scene_keys.h"
#include "core/shot/settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include <filesystem>

namespace marram {
namespace {

constexpr const char* type_names[] = {"boolean",   "integer",      "number",    "[a, b]",
                                      "[x, y, z]", "range",        "color",     "text",
                                      "choice",    "ramp",         "file",      "image",
                                      "name of a", "list of text", "transform", "list of [x, y, z]",
                                      "table",     "unavailable"};

std::string kind_of(const ParamSpec& spec) {
    if (spec.type == ParamType::choice) return spec.choices;
    std::string kind = type_names[int(spec.type)];
    if (spec.type == ParamType::reference) kind += " " + spec.choices;
    return kind;
}

std::string default_of(const ParamSpec& spec) {
    if (spec.type == ParamType::unavailable) return "-";
    if (spec.initial.empty()) return "required";
    return spec.initial == "none" ? "-" : spec.initial;
}

void print_params(std::span<const ParamSpec> params) {
    size_t name = 0, kind = 0, initial = 0, unit = 0;
    for (const ParamSpec& spec : params) {
        name = std::max(name, spec.name.size());
        kind = std::max(kind, kind_of(spec).size());
        initial = std::max(initial, default_of(spec).size());
        unit = std::max(unit, spec.unit.size());
    }
    for (const ParamSpec& spec : params)
        fmt::print("    {:{}}  {:{}}  {:{}}  {:{}}  {}\n", spec.name, name, kind_of(spec), kind,
                   default_of(spec), initial, spec.unit, unit, spec.help);
    std::string_view last; // the list explained last
    for (const ParamSpec& spec : params) {
        const std::string_view list = list_of(spec.name);
        if (list.empty() || list == last) continue;
        fmt::print("    {0}[] belongs to every table of a list: {0} = [{{ ... }}, ...]\n", list);
        last = list;
    }
}

void print_table(const std::string& title, const std::string& help, std::span<const ParamSpec> params) {
    fmt::print("{}{}{}\n", title, help.empty() ? "" : ": ", help);
    print_params(params);
    fmt::print("\n");
}

// One table of the scene language. name: the subject of `marram info` that prints it.
struct Topic {
    std::string name, title, help;
    std::span<const ParamSpec> params;
};

std::vector<Topic> topics(const Schema& schema) {
    std::vector<Topic> list = {{"globals", "before the first table", "", schema.globals},
                               {"camera", "[camera]", "", schema.camera},
                               {"film", "[film]", "", schema.film},
                               {"wind", "[wind]", "", schema.wind}};
    const auto add = [&](const std::vector<ItemSchema>& items, const std::string& table) {
        for (const ItemSchema& item : items) {
            const std::string title = fmt::format("[[{}]] type = \"{}\"", table, item.type);
            const std::string why = item.unusable.empty() ? "" : " (cannot be used: " + item.unusable + ")";
            list.push_back({item.type, title, item.help + why, item.params});
            for (const ListSchema& inner : item.lists)
                for (const ItemSchema& one : inner.types)
                    list.push_back({one.type,
                                    fmt::format("[[{}.{}]] type = \"{}\", of a {}", table, inner.name,
                                                one.type, item.type),
                                    one.help, one.params});
        }
    };
    add(schema.lights, "light");
    add(schema.materials, "material");
    add(schema.meshes, "mesh");
    add(schema.curves, "curves");
    add(schema.procedurals, "procedural");
    return list;
}

// Prints the image layers for film.aovs and --aov, each with its channels in an EXR; the list that
// check_layers() accepts.
void print_layers(const PluginSet& plugins) {
    fmt::print("image layers (film.aovs, --aov, --png), in an EXR as LAYER.CHANNEL; beauty and alpha are R, "
               "G, B, A\n");
    const auto print = [](std::string_view name, std::string_view channels, std::string_view help) {
        fmt::print("    {:<14} {:<8} {}\n", name, channels, help);
    };
    for (const BuiltInLayer& layer : built_in_layers()) print(layer.name, layer.channel_names, layer.help);
    std::set<std::string> told; // attributes of several procedurals may have the same name
    for (const auto& [path, library] : plugins.libraries)
        for (const ProceduralType& type : library->types())
            for (const MarramAttribute& attribute : type.attributes)
                if (told.insert(attribute.name).second)
                    print(attribute.name,
                          fmt::format("{}", fmt::join(attribute_channels(attribute.components), " ")),
                          fmt::format("of a {}: {}", type.calls.name, attribute.help));
    fmt::print("\n");
}

// Prints the report entries of procedurals that make meshes: those that begin with the procedural's type,
// "terrain.sand".
void print_mesh_reports(const Shot& shot, const Report& report) {
    std::set<std::string> types;
    for (const auto& procedural : shot.geometry.procedurals)
        if (procedural->kind() == MARRAM_MESH) types.insert(std::string(procedural->calls().name) + ".");
    for (const auto& [path, entry] : report.entries())
        for (const std::string& type : types)
            if (path.starts_with(type))
                fmt::print("{}: {:.6g} {}\n", path, report(path),
                           entry.declared.unit ? entry.declared.unit : "");
}

// Prints what a scene contains, and its estimated cost.
void print_scene(const std::string& file) {
    CommonOptions options;
    options.scene = file;
    Shot shot = open_shot(options);
    uint64_t triangles = 0;
    for (const SceneMesh& mesh : shot.geometry.meshes) {
        triangles += mesh.object().mesh.triangles.size();
        if (mesh.instance_of) continue;
        const auto instances = std::ranges::count(shot.geometry.meshes, &mesh, &SceneMesh::instance_of);
        fmt::print("mesh {}: {} vertices, {} triangles{}{}{}\n", mesh.name, mesh.mesh.positions.size(),
                   mesh.mesh.triangles.size(), mesh.mesh.uvs.empty() ? ", no uvs" : "",
                   !mesh.shapes.empty() ? fmt::format(", {} shapes", mesh.shapes.size())
                   : mesh.moves()       ? ", moves"
                                        : "",
                   instances > 0 ? fmt::format(", {} instance{}", instances, instances > 1 ? "s" : "") : "");
    }
    for (const SceneCurves& curves : shot.geometry.curves) {
        static constexpr const char* drawn[] = {"B-splines", "Catmull-Rom curves", "polylines"};
        fmt::print("curves {}: {} {}, {} CVs in all{}{}\n", curves.name, curves.closed.size(),
                   drawn[curves.basis], curves.offsets.back(),
                   !curves.samples.empty() ? fmt::format(", {} samples", curves.samples.size())
                   : curves.moves()        ? ", moves"
                                           : "",
                   curves.attributes.empty() ? "" : ", with");
        for (const AttributeValues& attribute : curves.attributes)
            fmt::print("    {}: {} a {}{}\n", attribute.name, attribute.components,
                       attribute.rate == MARRAM_PER_CURVE ? "curve" : "CV",
                       attribute.discrete ? ", discrete" : "");
    }
    const BuildSettings settings = build_settings(shot, shot.description.globals.vec2("frames").x());
    BuildSettings still = settings; // no motion: only counts are needed
    still.curves_bvh = false;
    still.shutter_open = still.shutter_close = 0.0;
    BuildProgress progress;
    BuildStats stats;
    const World world = build_world(shot.geometry, still, interrupted(), progress, stats);
    for (const CurveGeometry& curves : world.curves)
        fmt::print("procedural {}: {} curves of {} CVs\n", curves.name, curves.curve_count,
                   curves.offsets.empty() ? std::to_string(curves.cvs_per_curve)
                                          : fmt::format("{} in all", curves.offsets.back()));
    print_mesh_reports(shot, stats.report);
    const double keys = chosen_motion_keys(shot.geometry, settings, interrupted(), progress);
    // Embree's BVH over cubic segments, medium quality: bytes and thread seconds per segment and motion step.
    constexpr double bvh_bytes = 122.0, bvh_seconds = 2e-6;
    const double segments = double(stats.segments);
    const auto [width, height] = film_size(shot);
    fmt::print("triangles: {}\ncurves: {}\nsegments: {}\n", triangles, stats.curves, stats.segments);
    fmt::print("memory: about {:.0f} MB for curves and their BVH at {} motion keys\n",
               1e-6 * (double(stats.curve_bytes) * keys + double(stats.attribute_bytes) +
                       stats.report("memory.curve_extra_bytes") + segments * bvh_bytes * keys),
               keys);
    fmt::print(
        "build: about {:.1f} s of one processor for the BVH, {:.2f} s of all of them for the strands\n",
        segments * bvh_seconds * (1.0 + 0.3 * (keys - 1.0)), strand_seconds(stats.report));
    fmt::print("film: {} x {}, {:.3g} paths\n", width, height,
               double(width) * height * shot.description.film.integer("samples"));
    const Vec3f size = world.bounds.sizes();
    fmt::print("bounds of the meshes: {:.4g} x {:.4g} x {:.4g} m\n", size.x(), size.y(), size.z());
    for (const auto& procedural : shot.geometry.procedurals)
        if (const std::string text = procedural->describe(); !text.empty())
            fmt::print("\n# What '{}' has generated, to be edited by hand:\n{}", procedural->name(), text);
}

// Reads only the scene file, not the files that it names.
void print_keys(const std::string& scene) {
    PluginSet plugins = default_plugins();
    const std::vector<std::string> keys =
        scene.empty() ? keys_of_tables(plugins.schema)
                      : keys_of_scene(describe_scene(scene, {}, plugins), plugins.schema);
    for (const std::string& key : keys) fmt::print("{}\n", key);
}

bool is_scene(const std::string& subject) { return std::filesystem::path(subject).extension() == ".toml"; }

} // namespace

CompletionWords completion_words() {
    const PluginSet plugins = default_plugins();
    CompletionWords words{{"layers"}, {}};
    for (const Topic& topic : topics(plugins.schema))
        if (std::ranges::find(words.subjects, topic.name) == words.subjects.end())
            words.subjects.push_back(topic.name);
    for (const BuiltInLayer& layer : built_in_layers()) words.layers.emplace_back(layer.name);
    for (const auto& [path, library] : plugins.libraries)
        for (const ProceduralType& type : library->types())
            for (const MarramAttribute& attribute : type.attributes)
                if (std::ranges::find(words.layers, attribute.name) == words.layers.end())
                    words.layers.emplace_back(attribute.name);
    return words;
}

int info_command(const InfoOptions& options) {
    const std::string& subject = options.subject;
    if (options.keys) {
        if (!subject.empty() && !is_scene(subject))
            throw InputError({"marram info --keys " + subject}, "this is no scene",
                             "name a scene file (.toml), or none");
        print_keys(subject);
        return 0;
    }
    if (is_scene(subject)) {
        print_scene(subject);
        return 0;
    }
    const PluginSet plugins = default_plugins();
    bool found = false;
    for (const Topic& topic : topics(plugins.schema)) {
        if (!subject.empty() && subject != topic.name) continue;
        print_table(topic.title, topic.help, topic.params);
        if (topic.title.starts_with("[[procedural]]"))
            fmt::print("    library (file; default: libmarram_procedural.so; without a folder it is looked "
                       "for beside the "
                       "scene, in MARRAM_PLUGIN_PATH and where the program is installed): the shared "
                       "library that has the type\n\n");
        found = true;
    }
    if (subject.empty() || subject == "layers") {
        print_layers(plugins);
        found = true;
    }
    if (found) return 0;
    std::string known = "layers";
    std::set<std::string> listed; // strands are curves and a procedural
    for (const Topic& topic : topics(plugins.schema))
        if (listed.insert(topic.name).second) known += ", " + topic.name;
    throw InputError({"marram info " + subject}, "there is no such subject",
                     "ask for a scene file (.toml) or one of: " + known);
}

} // namespace marram
