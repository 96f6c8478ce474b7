// SPDX-License-Identifier: Apache-2.0
// Turns a checked scene description into the objects that the renderer works with.
#pragma once

#include "core/render/lights/lights.h"
#include "core/scene/description.h"
#include "core/world/build.h"
#include "shaders/shader.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// The default procedural library: the first in plugin_folders() (core/scene/libraries.h).
std::string default_library();

// The libraries that a scene names, and the schema of scene files that results from them.
struct PluginSet {
    std::map<std::string, std::shared_ptr<PluginLibrary>> libraries; // by path; "" is the default
    Schema schema;
    std::vector<std::string> allowed; // libraries that may be loaded from outside plugin_folders()
    PathMap paths;                    // where files lie that the scene names
};
PluginSet default_plugins();

// Reads the scene file, but not the meshes and images that it names. Adds the libraries that it names to
// `plugins`, which must outlive the description. Throws InputError with all mistakes found, libraries that
// may not be loaded among them.
SceneDescription describe_scene(const std::string& file, const std::vector<std::string>& settings,
                                PluginSet& plugins);

// A loaded scene. The description has pointers into `plugins`.
struct Shot {
    std::unique_ptr<PluginSet> plugins;
    SceneDescription description;
    SceneGeometry geometry;
    std::vector<Material> materials;
    std::vector<LightDescription> lights;
    std::vector<std::vector<LightDescription>> light_parts; // [light of the description]: itself, its sun
    std::vector<Problem> geometry_warnings;                 // of meshes and curves
    std::vector<std::vector<Problem>> light_warnings;       // [light of the description]
    std::string state_folder;                               // where simulations keep their states
};

// What its files and values are warned of now, one line each. Lights apart: only pictures depend on them.
std::vector<Problem> warnings_of(const Shot& shot);
std::vector<Problem> light_warnings_of(const Shot& shot);

// Options of the command line that override the scene.
struct Overrides {
    std::vector<std::string> settings; // key=value
    std::optional<uint32_t> samples;
    std::optional<std::pair<uint32_t, uint32_t>> size;
    std::string state_folder;                   // "": default_state_folder()
    std::vector<std::string> allowed_libraries; // PluginSet::allowed
    PathMap paths;
    // Pictures will be made: skies are computed, and the library for images is loaded, while files are read.
    bool makes_pictures = false;
};

// Where simulations keep their states unless Overrides::state_folder names a folder: SCENE.states.
std::string default_state_folder(const std::string& scene);

// Reads the scene and all files that it names: meshes, images, procedural libraries. Throws InputError with
// all mistakes found.
Shot load_shot(const std::string& file, const Overrides& overrides, const std::atomic<bool>& cancel);

// Takes other values of the scene, such as those of changed settings, into an open shot. `changed`: of the
// same file, by describe_scene() with shot.plugins. What the change does not touch is kept; procedurals are
// updated (MarramProcedural::update). False, and the shot is as before, if only load_shot() can take it:
// items came, went or have another type, or a mesh or curves of files changed. Throws InputError with the
// mistakes; the shot is then as before.
bool update_shot(Shot& shot, SceneDescription changed);

// To be called before the world of a frame is built: lights and materials with keys become those of the
// frame; strands that change in number, too, and procedurals that use them are told. Throws InputError if
// one of these rejects them.
void set_frame(Shot& shot, double frame);

// True if pictures have transparent parts: no light at infinity is seen by the camera though there is one, or
// a mesh is a shadow catcher.
bool is_transparent(const Shot& shot);
bool has_shadow_catcher(const Shot& shot);

// Paths of the scene file and of all files that it names.
std::vector<std::string> files_read(const Shot& shot, const std::string& file);

} // namespace marram
