// SPDX-License-Identifier: Apache-2.0
// From a checked description to what the renderer works with: the one place that knows both.
#pragma once

#include "core/geometry/build.h"
#include "core/render/lights.h"
#include "core/scene/description.h"
#include "shaders/shader.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// The default procedural library: the first in plugin_folders() (core/scene/libraries.h).
std::string default_library();

// Everything a scene file may say, given the libraries that it names. The first library is the default one.
struct PluginSet {
    std::map<std::string, std::shared_ptr<PluginLibrary>> libraries; // by path; "" is the default
    Schema schema;
};
PluginSet default_plugins();

// Reads a scene file alone, and adds the libraries that it names to `plugins`, which must outlive the description. Throws
// InputError with all mistakes found.
SceneDescription describe_scene(const std::string& file, const std::vector<std::string>& settings,
                                PluginSet& plugins);

// A scene, loaded. Pointers within point into the dialect, which lives as long.
struct Shot {
    std::unique_ptr<PluginSet> plugins;
    SceneDescription description;
    SceneGeometry geometry;
    std::vector<Material> materials;
    std::vector<LightDescription> lights;
    std::vector<std::string> warnings; // one line each, for people
    std::string state_folder;          // where simulations keep their states
};

// What the command line says instead of the scene.
struct Overrides {
    std::vector<std::string> settings; // key=value
    std::optional<uint32_t> samples;
    std::optional<std::pair<uint32_t, uint32_t>> size;
    std::string state_folder; // "": beside the scene, SCENE.states
};

// Reads everything a scene names: meshes, images, procedurals. Throws InputError with all mistakes found.
Shot load_shot(const std::string& file, const Overrides& overrides, const std::atomic<bool>& cancel);

// The scene's own file and all that it names, as they can be opened.
std::vector<std::string> files_read(const Shot& shot, const std::string& file);

} // namespace marram
