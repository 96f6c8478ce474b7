// SPDX-License-Identifier: Apache-2.0
// From a checked description to what the renderer works with: the one place that knows both.
#pragma once

#include "core/geometry/build.h"
#include "core/render/integrator.h"
#include "core/scene/description.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// The default procedural library: beside the program.
std::string default_library();

// Everything a scene file may say, given the libraries that it names. The first library is the default one.
struct Dialect {
    std::map<std::string, std::shared_ptr<PluginLibrary>> libraries; // by path; "" is the default
    Schema schema;
};
Dialect default_dialect();

// A scene, loaded. Pointers within point into the dialect, which lives as long.
struct LoadedScene {
    std::unique_ptr<Dialect> dialect;
    SceneDescription description;
    SceneGeometry geometry;
    std::vector<Material> materials;
    std::vector<LightDescription> lights;
};

// What the command line says instead of the scene.
struct Overrides {
    std::vector<std::string> settings; // key=value
    std::optional<uint32_t> samples;
    std::optional<std::pair<uint32_t, uint32_t>> size;
};

// Reads everything a scene names: meshes, images, procedurals. Throws InputError with all mistakes found.
LoadedScene load(const std::string& file, const Overrides& overrides, const std::atomic<bool>& cancel);

BuildSettings build_settings(const LoadedScene& scene, double frame);
RenderSettings render_settings(const LoadedScene& scene, double frame);
// The scene's own file and all that it names, as they can be opened.
std::vector<std::string> files_read(const LoadedScene& scene, const std::string& file);

std::pair<uint32_t, uint32_t> film_size(const LoadedScene& scene);

// Curve attributes that materials and layers need.
std::vector<std::string> wanted_attributes(const LoadedScene& scene, const std::vector<std::string>& layers);

} // namespace marram
