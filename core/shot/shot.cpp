// SPDX-License-Identifier: Apache-2.0
#include "core/shot/shot.h"
#include "core/shot/scene/light_image.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/scene/scene_files.h"
#include "core/shot/scene/scene_meshes.h"
#include "core/shot/scene/texture.h"

#include "core/host/geometry_graph.h"
#include "core/image/image_library.h"
#include "core/scene/keyed_values.h"
#include "core/scene/libraries.h"

#include <fmt/format.h>

#include <tbb/task_group.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>

namespace marram {
namespace {

namespace fs = std::filesystem;

void add_library(PluginSet& plugins, const std::string& key, const std::string& path, const Place& place) {
    auto library = std::make_shared<PluginLibrary>(path, place);
    for (ItemSchema& schema : procedural_schemas(*library)) {
        const auto same = [&](const ItemSchema& known) { return known.type == schema.type; };
        if (std::ranges::none_of(plugins.schema.procedurals, same))
            plugins.schema.procedurals.push_back(std::move(schema));
    }
    if (plugins.schema.wind.empty()) {
        plugins.schema.wind = wind_specs(*library);
        plugins.schema.wind_help = library->wind_help();
    }
    plugins.libraries[key] = std::move(library);
}

int index_of(const std::vector<Item>& items, const std::string& name) {
    for (size_t i = 0; i < items.size(); ++i)
        if (items[i].name == name) return int(i);
    return -1;
}

int material_of(const SceneDescription& description, const Item& item) {
    return item.params.has("material") ? index_of(description.materials, item.params.text("material")) : -1;
}

void apply(const Overrides& overrides, std::vector<std::string>& settings) {
    settings = overrides.settings;
    if (overrides.samples) settings.push_back("film.samples=" + std::to_string(*overrides.samples));
    if (overrides.size)
        settings.push_back("film.size=[" + std::to_string(overrides.size->first) + ", " +
                           std::to_string(overrides.size->second) + "]");
}

void attach_mesh_light(SceneMesh& mesh, const std::vector<Item>& lights, size_t by) {
    if (mesh.light >= 0)
        throw InputError(lights[by].params.at("mesh").place,
                         fmt::format("mesh \"{}\" is already used by light \"{}\"", mesh.name,
                                     lights[size_t(mesh.light)].name),
                         "add their radiances up in one light");
    mesh.light = int(by);
    // For MIS, light sampling and bsdf sampling must agree on visibility.
    if ((mesh.roles & MARRAM_CASTS_SHADOWS) == 0)
        throw InputError(lights[by].params.at("mesh").place,
                         fmt::format("mesh \"{}\" is a light but casts no shadows", mesh.name),
                         "leave its casts_shadows out");
    if (mesh.shadow_catcher)
        throw InputError(
            lights[by].params.at("mesh").place,
            fmt::format("mesh \"{}\" is a light, but its shadow_catcher shows only shadows", mesh.name),
            "use two meshes, or leave its shadow_catcher out");
}

// A light and, of daylight, its sun.
std::vector<LightDescription> make_light(const Item& item, std::vector<Problem>& warnings) {
    const auto type = std::ranges::find(light_types(), item.type, &LightType::name);
    std::vector<LightDescription> suns, parts;
    parts.push_back(type->make(item.params, light_image_reader(warnings), suns));
    std::ranges::move(suns, std::back_inserter(parts));
    return parts;
}

bool is_keyed(const Item& item) { return has_keys(item.params); }

// The item at the frame, without keys.
Item item_at(const Item& item, double frame) {
    Item now = item;
    now.params = values_at(item.params, frame);
    return now;
}

// Calls check(item at the key) for each key of the item, so that mistakes are found before frames are
// rendered.
void check_keys(const Item& item, const std::function<void(const Item&)>& check) {
    for (const ParamValue& value : item.params.all())
        for (size_t i = 1; value.keys && i < value.keys->count(); ++i)
            check(item_at(item, value.keys->frames[i]));
}

// Resolves the materials that blends name. Throws InputError for a blend that contains itself.
void resolve_blends(const std::vector<Item>& items, std::vector<Material>& materials) {
    for (size_t i = 0; i < items.size(); ++i)
        if (auto* blend = std::get_if<BlendSettings>(&materials[i].settings))
            for (int part = 0; part < 2; ++part) blend->materials[part] = index_of(items, blend->names[part]);
    std::vector<char> open(items.size(), false), done(items.size(), false);
    const std::function<void(size_t)> visit = [&](size_t i) {
        const auto* blend = std::get_if<BlendSettings>(&materials[i].settings);
        if (!blend || done[i]) return;
        if (open[i])
            throw InputError(items[i].place,
                             fmt::format("material \"{}\" is a blend of itself", items[i].name),
                             "let it blend other materials");
        open[i] = true;
        for (const int part : blend->materials) visit(size_t(part));
        done[i] = true;
    };
    for (size_t i = 0; i < items.size(); ++i) visit(i);
}

// Valid, but more likely a mistake of units: rays do not hit it.
void warn_of_size(const SceneMesh& mesh, const Item& item, double frame, std::vector<Problem>& warnings) {
    constexpr double smallest = 1e-6; // m
    Eigen::AlignedBox3d box;
    const Eigen::Affine3d placed = mesh.transform.at(frame);
    for (const Vec3f& p : mesh.mesh.positions) {
        box.extend(placed * p.cast<double>());
        if (box.sizes().maxCoeff() >= smallest) return; // after the second vertex, as a rule
    }
    if (!box.isEmpty())
        warnings.push_back({item.place,
                            fmt::format("mesh \"{}\" is {:.3g} m large", mesh.name, box.sizes().maxCoeff()),
                            "check its units, or give it a scale", "mesh.tiny"});
}

void load_meshes(Shot& shot, const std::atomic<bool>& cancel, ProblemCollector& collect_problems) {
    const SceneDescription& description = shot.description;
    for (const Item& item : description.meshes) {
        if (cancel.load()) throw Cancelled{};
        SceneMesh mesh{item.name, {}, {}, material_of(description, item), -1};
        mesh.roles = role_bits(item.params);
        mesh.shadow_catcher = item.params.boolean("shadow_catcher");
        if (mesh.shadow_catcher && (mesh.roles & MARRAM_SEEN_BY_CAMERA) == 0)
            collect_problems([&] {
                throw InputError(
                    item.params.at("shadow_catcher").place,
                    fmt::format("mesh \"{}\" is to catch shadows, but the camera does not see it", item.name),
                    "leave its seen_by_camera out");
            });
        const ParamValue& keys = item.params.at("transform");
        mesh.transform = KeyedTransform(keys.numbers, keys.text);
        collect_problems([&] {
            mesh.mesh = load_scene_mesh(item, shot.geometry_warnings);
            warn_of_size(mesh, item, description.globals.vec2("frames").x(), shot.geometry_warnings);
            if (item.type == "file") mesh.shapes = load_shapes(item, mesh.mesh, cancel);
        });
        for (size_t i = 0; i < description.lights.size(); ++i)
            if (description.lights[i].type == "mesh" &&
                description.lights[i].params.text("mesh") == item.name)
                collect_problems([&] { attach_mesh_light(mesh, description.lights, i); });
        shot.geometry.meshes.push_back(std::move(mesh));
    }
    collect_problems([&] { add_instances(shot.geometry.meshes, description.meshes); });
}

// Lights at infinity.
struct InfiniteLights {
    size_t seen = 0, hidden = 0; // by the camera
};

InfiniteLights infinite_lights(const Shot& shot) {
    InfiniteLights count;
    for (const LightDescription& description : shot.lights)
        std::visit(
            [&](const auto& light) {
                if constexpr (requires { light.visible; }) ++(light.visible ? count.seen : count.hidden);
            },
            description);
    return count;
}

// Computes the skies, which render() would wait for. Their errors appear when they are used.
void compute_skies(const Shot& shot, tbb::task_group& tasks) {
    for (const LightDescription& description : shot.lights)
        std::visit(
            [&](const auto& light) {
                if constexpr (requires { light.image.pixels; })
                    tasks.run([pixels = light.image.pixels] {
                        try {
                            pixels.get();
                        } catch (...) { // tried again where it is used
                        }
                    });
            },
            description);
}

// Suns of daylight come last, as meshes refer to lights by index.
void gather_lights(Shot& shot) {
    shot.lights.clear();
    for (const auto& parts : shot.light_parts) shot.lights.push_back(parts.front());
    for (const auto& parts : shot.light_parts)
        shot.lights.insert(shot.lights.end(), parts.begin() + 1, parts.end());
}

void set_keyed_lights(Shot& shot, double frame) {
    const std::vector<Item>& items = shot.description.lights;
    if (std::ranges::none_of(items, is_keyed)) return;
    std::vector<Problem> said;
    for (size_t i = 0; i < items.size(); ++i)
        if (is_keyed(items[i])) shot.light_parts[i] = make_light(item_at(items[i], frame), said);
    gather_lights(shot);
}

void set_keyed_materials(Shot& shot, double frame) {
    const std::vector<Item>& items = shot.description.materials;
    if (std::ranges::none_of(items, is_keyed)) return;
    for (size_t i = 0; i < items.size(); ++i)
        if (is_keyed(items[i]))
            shot.materials[i] = make_material(items[i].type, values_at(items[i].params, frame), open_texture);
    resolve_blends(items, shot.materials);
}

std::shared_ptr<PluginLibrary> library_for(const PluginSet& plugins, const Item& item) {
    const std::string key = item.params.has("library") ? item.params.text("library") : "";
    return plugins.libraries.at(key);
}

} // namespace

std::string default_library() {
    const std::string name = "libmarram_procedural.so";
    const std::vector<std::string> folders = plugin_folders();
    return library_path(folders.empty() ? "." : folders.front(), name);
}

PluginSet default_plugins() {
    PluginSet plugins;
    plugins.schema = scene_schema();
    for (const LightType& light : light_types())
        plugins.schema.lights.push_back({light.name, light.help, with_keyable_numbers(light.params)});
    for (const ShaderDescription& shader : shaders())
        plugins.schema.materials.push_back({shader.name, shader.help, with_keyable_numbers(shader.params)});
    add_library(plugins, "", default_library(), {default_library()});
    return plugins;
}

// Loads the libraries that the scene names and may load, then reads the scene with all that they declare. If
// a library is missing, its types are unknown too: this is not reported as another mistake.
SceneDescription describe_scene(const std::string& file, const std::vector<std::string>& settings,
                                PluginSet& plugins) {
    std::vector<LibraryName> missing;
    std::vector<Problem> problems;
    for (const LibraryName& library : scene_libraries(file, settings, plugins.allowed, plugins.paths)) {
        std::error_code error;
        if (!fs::is_regular_file(library.path, error)) // a pipe would be waited for
            missing.push_back(library);
        else if (library.allowed)
            add_library(plugins, library.path, library.path, library.place);
        else
            problems.push_back({library.place,
                                "the scene asks to run the code of the library \"" + library.path + "\"",
                                "if you trust it, add --allow-library " + library.path +
                                    ", or name its folder in MARRAM_PLUGIN_PATH"});
    }
    try {
        SceneDescription description = load_scene(file, settings, plugins.schema, plugins.paths);
        if (!problems.empty()) throw InputError({}); // its types may be those of another library
        return description;
    } catch (const InputError& error) {
        for (const LibraryName& library : missing) {
            const auto said = [&](const Problem& p) {
                return to_string(p.place) == to_string(library.place);
            };
            if (std::ranges::any_of(error.problems, said)) continue;
            std::error_code unknown;
            const bool other = fs::exists(library.path, unknown);
            problems.push_back(
                {library.place,
                 other ? "\"" + library.path + "\" is no file but a pipe or device"
                       : "there is no file \"" + library.path + "\"",
                 "build the library, correct its path, or name its folder in MARRAM_PLUGIN_PATH"});
        }
        const bool all_known = missing.empty() && problems.empty();
        for (const Problem& problem : error.problems)
            if (all_known || problem.id != "scene.unknown_procedural") problems.push_back(problem);
        throw InputError(std::move(problems));
    }
}

std::string default_state_folder(const std::string& scene) {
    return fs::path(scene).replace_extension(".states").string();
}

Shot load_shot(const std::string& file, const Overrides& overrides, const std::atomic<bool>& cancel) {
    Shot shot;
    shot.state_folder = overrides.state_folder.empty() ? default_state_folder(file) : overrides.state_folder;
    std::vector<std::string> settings;
    apply(overrides, settings);
    shot.plugins = std::make_unique<PluginSet>(default_plugins());
    shot.plugins->allowed = overrides.allowed_libraries;
    shot.plugins->paths = overrides.paths;
    shot.description = describe_scene(file, settings, *shot.plugins);
    const SceneDescription& description = shot.description;

    ProblemCollector collect_problems;
    for (const Item& item : description.materials)
        collect_problems([&] {
            shot.materials.push_back(make_material(item.type, item.params, open_texture));
            check_keys(item,
                       [](const Item& at_key) { make_material(at_key.type, at_key.params, open_texture); });
        });
    if (shot.materials.size() == description.materials.size())
        collect_problems([&] { resolve_blends(description.materials, shot.materials); });
    for (const Item& item : description.lights)
        collect_problems([&] {
            std::vector<Problem> said;
            shot.light_parts.push_back(make_light(item, shot.light_warnings.emplace_back()));
            check_keys(item, [&](const Item& at_key) { make_light(at_key, said); });
        });
    gather_lights(shot);
    // A sky takes 0.5 s of a processor, loading the library for images 0.4 s: on two threads they overlap.
    tbb::task_group tasks;
    if (overrides.makes_pictures) compute_skies(shot, tasks);
    load_meshes(shot, cancel, collect_problems);
    for (const Item& item : description.curves)
        collect_problems([&] {
            shot.geometry.curves.push_back(
                load_scene_curves(item, description.globals.number("fps"), cancel, shot.geometry_warnings));
        });
    for (const auto& [path, library] : shot.plugins->libraries) {
        const std::vector<MarramReportEntry>& entries = library->report_entries();
        shot.geometry.report_entries.insert(shot.geometry.report_entries.end(), entries.begin(),
                                            entries.end());
    }
    const auto carried = std::make_shared<const CurveAttributes>(attributes_of(shot.geometry.curves));
    for (const Item& item : description.procedurals)
        collect_problems([&] {
            auto procedural = std::make_unique<Procedural>(library_for(*shot.plugins, item), item,
                                                           description.wind, cancel, carried);
            procedural->material = material_of(description, item);
            procedural->roles = role_bits(item.params);
            shot.geometry.procedurals.push_back(std::move(procedural));
        });
    collect_problems([&] { camera_at(description, description.globals.vec2("frames").x()); });
    collect_problems.raise();
    if (overrides.makes_pictures) load_image_library();
    tasks.wait();
    if (shot.lights.empty()) shot.lights.push_back(SkyLight{});
    return shot;
}

std::vector<Problem> warnings_of(const Shot& shot) {
    std::vector<Problem> all = shot.geometry_warnings;
    for (const auto& procedural : shot.geometry.procedurals)
        std::ranges::copy(procedural->file_warnings(), std::back_inserter(all));
    if (has_shadow_catcher(shot) && infinite_lights(shot).seen > 0)
        all.push_back({{shot.description.file},
                       "a mesh is a shadow catcher, but the camera sees the sky, which adds its light to the "
                       "background",
                       "add seen_by_camera = false to the lights",
                       "light.behind_catcher"});
    return all;
}

std::vector<Problem> light_warnings_of(const Shot& shot) {
    std::vector<Problem> all;
    for (const auto& warnings : shot.light_warnings) std::ranges::copy(warnings, std::back_inserter(all));
    if (shot.light_parts.empty())
        all.push_back(
            {{shot.description.file}, "the scene has no light: it is lit by a plain sky", "", "light.none"});
    return all;
}

namespace {

// Whether two sets of values are the same, wherever they stand in the file.
bool same_values(const ParamSet& a, const ParamSet& b) {
    const auto same = [](const ParamValue& x, const ParamValue& y) {
        return x.name == y.name && x.numbers == y.numbers && x.text == y.text && x.texts == y.texts &&
               x.keys == y.keys;
    };
    return std::ranges::equal(a.all(), b.all(), same);
}

bool same_kinds(const std::vector<Item>& a, const std::vector<Item>& b) {
    return std::ranges::equal(a, b, [](const Item& x, const Item& y) {
        return x.name == y.name && x.type == y.type && x.table_name == y.table_name;
    });
}

bool same_items(const std::vector<Item>& a, const std::vector<Item>& b) {
    return same_kinds(a, b) && std::ranges::equal(a, b, [](const Item& x, const Item& y) {
               return same_values(x.params, y.params);
           });
}

// Whether the objects that load_shot() makes once are the same for both.
bool same_objects(const SceneDescription& a, const SceneDescription& b) {
    const auto library = [](const Item& item) {
        return item.params.has("library") ? item.params.text("library") : std::string();
    };
    const auto mesh_light = [](const Item& item) {
        return item.type == "mesh" ? item.params.text("mesh") : std::string();
    };
    const auto drawn = [](const Item& x, const Item& y) { // their points are taken anew
        return x.type == "points" || same_values(x.params, y.params);
    };
    return same_items(a.meshes, b.meshes) && same_kinds(a.curves, b.curves) &&
           std::ranges::equal(a.curves, b.curves, drawn) && same_kinds(a.materials, b.materials) &&
           same_kinds(a.lights, b.lights) && same_kinds(a.procedurals, b.procedurals) &&
           std::ranges::equal(a.procedurals, b.procedurals, {}, library, library) &&
           std::ranges::equal(a.lights, b.lights, {}, mesh_light, mesh_light) &&
           (a.curves.empty() || a.globals.number("fps") == b.globals.number("fps"));
}

} // namespace

bool update_shot(Shot& shot, SceneDescription changed) {
    const SceneDescription& before = shot.description;
    if (!same_objects(before, changed)) return false;
    Shot now; // lights and materials
    ProblemCollector collect_problems;
    for (size_t i = 0; i < changed.materials.size(); ++i)
        collect_problems([&] {
            const Item& item = changed.materials[i];
            const bool same = same_values(item.params, before.materials[i].params);
            now.materials.push_back(same ? shot.materials[i]
                                         : make_material(item.type, item.params, open_texture));
            if (!same)
                check_keys(item, [](const Item& at) { make_material(at.type, at.params, open_texture); });
        });
    for (size_t i = 0; i < changed.lights.size(); ++i)
        collect_problems([&] {
            const Item& item = changed.lights[i];
            const bool same = same_values(item.params, before.lights[i].params);
            auto& warnings = now.light_warnings.emplace_back();
            if (same) warnings = shot.light_warnings[i];
            now.light_parts.push_back(same ? shot.light_parts[i] : make_light(item, warnings));
            std::vector<Problem> said;
            if (!same) check_keys(item, [&](const Item& at) { make_light(at, said); });
        });
    GeometryChanges changes;
    static const std::atomic<bool> never{false};
    std::vector<std::pair<size_t, SceneCurves>> drawn;
    for (size_t i = 0; i < changed.curves.size(); ++i)
        collect_problems([&] {
            const Item& item = changed.curves[i];
            if (same_values(item.params, before.curves[i].params)) return;
            drawn.emplace_back(
                i, load_scene_curves(item, changed.globals.number("fps"), never, now.geometry_warnings));
            changes[item.name] = MARRAM_EVERYTHING;
        });
    collect_problems([&] { camera_at(changed, changed.globals.vec2("frames").x()); });
    collect_problems.raise();
    resolve_blends(changed.materials, now.materials);
    std::swap(now.description, shot.description);
    shot.description = std::move(changed);
    const auto swap_curves = [&] {
        for (auto& [index, curves] : drawn) std::swap(curves, shot.geometry.curves[index]);
    };
    swap_curves();
    const GeometryChanges of_curves = changes;
    try {
        update_procedurals(shot.geometry.procedurals, shot.description.procedurals, shot.description.wind,
                           changes);
    } catch (...) {
        std::swap(now.description, shot.description);
        swap_curves();
        GeometryChanges back = of_curves;
        update_procedurals(shot.geometry.procedurals, shot.description.procedurals, shot.description.wind,
                           back);
        throw;
    }
    for (size_t i = 0; i < shot.description.procedurals.size(); ++i)
        shot.geometry.procedurals[i]->material =
            material_of(shot.description, shot.description.procedurals[i]);
    shot.materials = std::move(now.materials);
    if (shot.light_parts.empty()) return true; // a plain sky stands in
    shot.light_parts = std::move(now.light_parts);
    shot.light_warnings = std::move(now.light_warnings);
    gather_lights(shot);
    return true;
}

void set_frame(Shot& shot, double frame) {
    set_keyed_lights(shot, frame);
    set_keyed_materials(shot, frame);
    GeometryChanges changes;
    for (SceneCurves& curves : shot.geometry.curves)
        if (curves.select_take(frame)) changes[curves.name] = MARRAM_EVERYTHING;
    if (changes.empty()) return;
    update_procedurals(shot.geometry.procedurals, shot.description.procedurals, shot.description.wind,
                       changes);
}

bool has_shadow_catcher(const Shot& shot) {
    return std::ranges::any_of(shot.geometry.meshes, &SceneMesh::shadow_catcher);
}

bool is_transparent(const Shot& shot) {
    const InfiniteLights lights = infinite_lights(shot);
    return (lights.seen == 0 && lights.hidden > 0) || has_shadow_catcher(shot);
}

std::vector<std::string> files_read(const Shot& shot, const std::string& file) {
    std::vector<std::string> files = {file};
    for (const NamedFiles& named : named_files(shot))
        files.insert(files.end(), named.files.begin(), named.files.end());
    return files;
}

} // namespace marram
