// SPDX-License-Identifier: Apache-2.0
// Helpers for the tests of core/scene: a schema of their own similar to the real one, and temporary scene
// files.
#pragma once

#include "core/scene/description.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <unistd.h>
#include <vector>

namespace marram {

inline std::vector<ParamSpec> test_wind() {
    constexpr double any = std::numeric_limits<double>::infinity();
    std::vector<ParamSpec> specs = {
        {"direction", ParamType::vec3, "", "[1, 0, 0]", -any, any, "", "where the air goes to"},
        {"speed", ParamType::number, "m/s", "3", 0, 100, "", "speed of the air"},
        {"noise.frequency", ParamType::number, "1/m", "1", 0, 1000, "", "frequency of the noise"},
        {"noise.octaves", ParamType::integer, "", "3", 1, 16, "", "octaves of the noise"},
        {"ramp_rotate", ParamType::ramp, "", "[[0, 0], [1, 1]]", 0, 1, "", "turn along the strand"},
    };
    for (const ParamSpec& spec : std::vector<ParamSpec>{
             {"num_gusts", ParamType::integer, "", "0", 0, 1e6, "", "spheres"},
             {"radius_range", ParamType::range, "m", "[2, 4]", 0, 1e8, "", "of a sphere"},
             {"control[].shape", ParamType::choice, "", "sphere", -any, any, "sphere|box", "what it is"},
             {"control[].transform", ParamType::keys, "", "{}", -any, any, "", "where it is"},
             {"control[].inner", ParamType::vec3, "", "none", 0, 1, "", "of a box"},
             {"control[].strength", ParamType::number, "", "1", -10, 10, "", "factor"}}) {
        specs.push_back(spec);
        specs.back().name = "gusts." + spec.name;
    }
    for (const char* name : {"shielding", "jiggle", "collision"})
        specs.push_back({name, ParamType::unavailable, "", "none", -any, any, "", "comes later"});
    return specs;
}

inline Schema test_schema() {
    constexpr double any = std::numeric_limits<double>::infinity();
    Schema schema = scene_schema();
    schema.wind = test_wind();
    const ParamSpec direction = {"direction", ParamType::vec3, "", "[1, 2, 1]", -1e8, 1e8, "", "towards it"};
    schema.lights = {{"sun",
                      "a disc",
                      {direction,
                       {"angle", ParamType::number, "deg", "0.53", 0, 180, "", "its diameter"},
                       {"irradiance", ParamType::color, "W/m^2", "3", 0, 1e9, "", "on what faces it"}}},
                     {"daylight",
                      "sun and sky",
                      {direction, {"turbidity", ParamType::number, "", "2.5", 1, 20, "", "haze"}}},
                     {"sky", "all around", {{"zenith", ParamType::color, "", "1", 0, 1e9, "", "above"}}},
                     {"environment",
                      "an image",
                      {{"file", ParamType::image, "", "", -any, any, "", "the image"},
                       {"strength", ParamType::number, "", "1", 0, 1e9, "", "factor"}}},
                     {"mesh", "a mesh", {{"mesh", ParamType::reference, "", "", -any, any, "mesh", "it"}}}};
    schema.materials = {
        {"diffuse", "plain", {{"base", ParamType::color, "", "0.5", 0, 1, "", "albedo"}}},
        {"hair", "fibres", {{"melanin", ParamType::number, "", "1", 0, 10, "", "pigment"}}},
    };
    ItemSchema groom = {"groom",
                        "strands",
                        {{"on", ParamType::reference, "", "", -any, any, "mesh", "growth surface"},
                         {"material", ParamType::reference, "", "none", -any, any, "material", "material"},
                         {"count", ParamType::integer, "", "1000", 1, 1e8, "", "strands"},
                         {"length", ParamType::range, "m", "[0.1, 0.2]", 0, 1000, "", "length of a strand"},
                         {"label", ParamType::text, "", "a 'bare' word", -any, any, "", "any text"}}};
    for (ParamSpec spec : test_wind()) {
        spec.name = "wind." + spec.name;
        if (list_of(spec.name).empty()) spec.initial = "none";
        groom.params.push_back(spec);
    }
    schema.procedurals = {groom};
    return schema;
}

// A temporary folder, removed in the destructor.
class Folder {
  public:
    Folder() {
        std::string pattern = (std::filesystem::temp_directory_path() / "marram_scene_XXXXXX").string();
        path_ = mkdtemp(pattern.data());
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;

    std::string write(const std::string& name, const std::string& text) const {
        const std::string file = path_ + "/" + name;
        std::ofstream(file, std::ios::binary) << text;
        return file;
    }
    const std::string& path() const { return path_; }

  private:
    std::string path_;
};

// The mistakes in a scene, one per line; empty if it is valid.
inline std::vector<std::string> mistakes(const std::string& file, const std::vector<std::string>& settings,
                                         const Schema& schema) {
    std::vector<std::string> lines;
    try {
        load_scene(file, settings, schema);
    } catch (const InputError& error) {
        for (const Problem& problem : error.problems) lines.push_back(to_string(problem));
    }
    return lines;
}

inline const std::string small_scene = "[camera]\nposition = [0, 1, 5]\ntarget = [0, 0, 0]\n";

// All keys of a scene file; mesh.obj and sky.exr must exist next to it.
inline const std::string full_scene = R"(fps = 25
frames = [1, 100]
tolerance_pixels = 0.25
bind_frame = -2.5

[camera]
position = [0, 1, 5]
target = [0, 0.5, 0]
fov = 35
focus = 4
shutter = [-0.25, 0.25]

[film]
size = [320, 180]
samples = 16
filter = "gaussian"
aovs = ["depth", "normal"]
motion_keys = 4

[wind]
direction = [1, 0, 0.5]
noise.frequency = 2
ramp_rotate = { knots = [[0, 0], [0.5, 0.2], [1, 1]], interpolation = "smooth" }

[[light]]
type = "sun"
name = "sun"
irradiance = 4

[[light]]
type = "sky"
zenith = [0.1, 0.2, 0.3]

[[light]]
type = "environment"
file = "sky.exr"

[[light]]
type = "mesh"
mesh = "lamp.001"

[[material]]
name = "soil"
type = "diffuse"
base = [0.3, 0.2, 0.1]

[[material]]
name = "blade"
type = "hair"

[[mesh]]
name = "hill"
type = "file"
file = "mesh.obj"
smooth = false
material = "soil"
transform = { translate = [1, 2, 3], scale = 2 }

[[mesh]]
name = "lamp.001"
type = "sphere"
radius = 0.25
transform = { keys = [{ frame = 1, rotate = [0, 90, 0] }, { frame = 2.5, scale = [1, -1, 1] }], interpolation = "smooth" }

[[procedural]]
name = "grass"
type = "groom"
on = "hill"
material = "blade"
length = 0.3

[procedural.wind]
speed = 7
noise = { octaves = 2 }
)";

} // namespace marram
