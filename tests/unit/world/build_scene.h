// SPDX-License-Identifier: Apache-2.0
// Test worlds, built by the renderer's own two phases from a few lines of scene file.
#pragma once

#include "core/host/geometry_graph.h"
#include "core/scene/description.h"
#include "core/world/build.h"

#include <filesystem>
#include <fstream>
#include <map>

#include <unistd.h>

namespace marram::testing {

inline const std::string default_library = MARRAM_BINARY_DIR "/libmarram_procedural.so";
inline const std::string mesh_library = MARRAM_BINARY_DIR "/libmesh_plugin.so";
inline const std::string faulty_library = MARRAM_BINARY_DIR "/libfaulty_plugin.so";
inline const std::string terrain_library = MARRAM_BINARY_DIR "/libterrain_plugin.so";
inline const std::string grown_terrain_library = MARRAM_BINARY_DIR "/libgrown_terrain_plugin.so";

inline Mesh builtin_mesh(const Item& item) {
    const ParamSet& params = item.params;
    if (item.type == "plane")
        return plane_mesh(params.vec2("size").cast<float>(), params.integer("divisions"));
    if (item.type == "box") return box_mesh(params.vec3("size").cast<float>());
    return sphere_mesh(float(params.number("radius")), params.integer("divisions"),
                       float(params.number("bumps")), float(params.number("frequency")));
}

// Writes a scene file from its text, which lacks a camera. It is removed when the test ends.
inline std::string write_scene(const std::string& text) {
    const std::filesystem::path file =
        std::filesystem::temp_directory_path() / ("marram_build_" + std::to_string(::getpid()) + ".toml");
    static const struct Gone {
        std::filesystem::path file;
        ~Gone() {
            std::error_code ignored;
            std::filesystem::remove(file, ignored);
        }
    } gone{file};
    std::ofstream(file) << text << "\n[camera]\nposition = [0, 1, 5]\ntarget = [0, 0, 0]\n";
    return file.string();
}

// A scene from its text, without a camera: planes, boxes, spheres, curves through points, and procedurals of
// the libraries above.
class TestScene {
  public:
    explicit TestScene(const std::string& text, const std::string& terrain = terrain_library) {
        schema_ = scene_schema();
        for (const std::string& path : {default_library, mesh_library, faulty_library, terrain}) {
            const auto library = std::make_shared<PluginLibrary>(path, Place{});
            for (ItemSchema& item : procedural_schemas(*library)) {
                libraries_[item.type] = library;
                schema_.procedurals.push_back(std::move(item));
            }
        }
        schema_.wind = wind_specs(*libraries_.at("groom"));
        description_ = load_scene(write_scene(text), {}, schema_);
        for (const Item& item : description_.meshes) {
            const ParamValue& keys = item.params.at("transform");
            geometry.meshes.push_back(
                {item.name, builtin_mesh(item), KeyedTransform(keys.numbers, keys.text)});
            geometry.meshes.back().roles = role_bits(item.params);
        }
        add_instances(geometry.meshes, description_.meshes);
        for (const Item& item : description_.curves) {
            SceneCurves& curves = geometry.curves.emplace_back();
            curves.name = item.name;
            std::vector<Vec3d> points;
            const std::vector<double>& numbers = item.params.at("points").numbers;
            for (size_t i = 0; i < numbers.size(); i += 3) points.emplace_back(numbers.data() + i);
            curves.add(points, false);
        }
        for (const Item& item : description_.procedurals) {
            geometry.procedurals.push_back(
                std::make_unique<Procedural>(libraries_.at(item.type), item, description_.wind, cancel));
            geometry.procedurals.back()->roles = role_bits(item.params);
        }
    }

    // Replaces the procedurals' settings by those in `text`. Returns the changes that each reports.
    GeometryChanges update(const std::string& text) {
        description_ = load_scene(write_scene(text), {}, schema_);
        GeometryChanges changes;
        update_procedurals(geometry.procedurals, description_.procedurals, description_.wind, changes);
        return changes;
    }
    // Tells the procedurals that curves or meshes have changed.
    void update(GeometryChanges changes) {
        update_procedurals(geometry.procedurals, description_.procedurals, description_.wind, changes);
    }
    // Makes the procedurals of `text` anew, with the attributes that geometry.curves carry now.
    void tell_attributes(const std::string& text) {
        description_ = load_scene(write_scene(text), {}, schema_);
        const auto carried = std::make_shared<const CurveAttributes>(attributes_of(geometry.curves));
        geometry.procedurals.clear();
        for (const Item& item : description_.procedurals)
            geometry.procedurals.push_back(std::make_unique<Procedural>(libraries_.at(item.type), item,
                                                                        description_.wind, cancel, carried));
    }
    // The same, without notifying the procedurals that depend on it.
    void update_alone(const std::string& text, size_t procedural) {
        description_ = load_scene(write_scene(text), {}, schema_);
        geometry.procedurals[procedural]->update(description_.procedurals[procedural], description_.wind,
                                                 MARRAM_NOTHING);
    }

    World build() { return build_world(geometry, settings, cancel, progress, stats = {}); }

    // All errors of the build, as the user reads them.
    std::string build_errors() {
        try {
            build();
        } catch (const InputError& error) {
            std::string all;
            for (const Problem& problem : error.problems) all += to_string(problem) + "\n";
            return all;
        }
        return "";
    }

    std::atomic<bool> cancel{false};
    SceneGeometry geometry;
    BuildSettings settings;
    BuildProgress progress;
    BuildStats stats;

  private:
    Schema schema_;
    std::map<std::string, std::shared_ptr<PluginLibrary>> libraries_; // by procedural type
    SceneDescription description_;
};

// The minimum settings of a groom, plus those of the test.
inline std::string groom(const std::string& name, const std::string& on, const std::string& more = "") {
    return "\n[[procedural]]\ntype = \"groom\"\nname = \"" + name + "\"\non = \"" + on +
           "\"\nlength = [0.1, 0.2]\nwidth = 0.01\n" +
           (more.find("count") == std::string::npos && more.find("density") == std::string::npos
                ? "count = 200\n"
                : "") +
           more + "\n";
}

inline std::string mesh(const std::string& name, const std::string& type, const std::string& more = "") {
    return "\n[[mesh]]\nname = \"" + name + "\"\ntype = \"" + type + "\"\n" + more + "\n";
}

// CV k of curve c at a motion sample.
inline Vec3f cv(const CurveGeometry& curves, size_t time, size_t c, uint32_t k) {
    return Vec3f(curves.vertices[time] + 4 * (c * (curves.cvs_per_curve + 2) + k + 1));
}

inline const AttributeValues* attribute(const CurveGeometry& curves, const std::string& name) {
    return find_attribute(curves.attributes, name);
}

} // namespace marram::testing
