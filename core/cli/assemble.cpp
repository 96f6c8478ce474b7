// SPDX-License-Identifier: Apache-2.0
#include "core/cli/assemble.h"
#include "core/cli/frames.h"
#include "core/cli/scene_camera.h"
#include "core/cli/texture.h"

#include "core/image/image.h"
#include "core/math/hash.h"
#include "core/render/daylight_lights.h"
#include "core/scene/libraries.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <functional>
#include <iterator>

namespace marram {
namespace {

namespace fs = std::filesystem;

void add_library(Dialect& dialect, const std::string& key, const std::string& path, const Place& place) {
    auto library = std::make_shared<PluginLibrary>(path, place);
    for (ItemSchema& schema : procedural_schemas(library->table())) {
        const auto same = [&](const ItemSchema& known) { return known.type == schema.type; };
        if (std::ranges::none_of(dialect.schema.procedurals, same))
            dialect.schema.procedurals.push_back(std::move(schema));
    }
    if (dialect.schema.wind.empty()) dialect.schema.wind = wind_specs(library->table());
    dialect.libraries[key] = std::move(library);
}

// Runs a step and keeps what it objects to, so that all mistakes of a scene are reported together.
class Objections {
  public:
    void operator()(const std::function<void()>& step) {
        try {
            step();
        } catch (const InputError& error) {
            problems_.insert(problems_.end(), error.problems.begin(), error.problems.end());
        }
    }
    void raise() const {
        if (!problems_.empty()) throw InputError(problems_);
    }

  private:
    std::vector<Problem> problems_;
};

Vec2f vec2f(const ParamSet& params, std::string_view name) { return params.vec2(name).cast<float>(); }
Vec3f vec3f(const ParamSet& params, std::string_view name) { return params.vec3(name).cast<float>(); }

int index_of(const std::vector<Item>& items, const std::string& name) {
    for (size_t i = 0; i < items.size(); ++i)
        if (items[i].name == name) return int(i);
    return -1;
}

int material_of(const SceneDescription& description, const Item& item) {
    return item.params.has("material") ? index_of(description.materials, item.params.text("material")) : -1;
}

// Heights of an image's first channel, resampled to (squares + 1)^2 where the scene says how many.
Mesh load_heightfield(const ParamSet& params) {
    const Image image = read_image(params.text("image"), ColorSpace::linear_data);
    const bool resample = params.has("divisions");
    const int width = resample ? params.integer("divisions") + 1 : image.width;
    const int height = resample ? params.integer("divisions") + 1 : image.height;
    const auto pixel = [&](int x, int y) {
        return double(image.pixels[(size_t(y) * size_t(image.width) + size_t(x)) * size_t(image.channels)]);
    };
    std::vector<float> heights(size_t(width) * size_t(height));
    for (int j = 0; j < height; ++j)
        for (int i = 0; i < width; ++i) {
            const double x = width > 1 ? double(i) * (image.width - 1) / (width - 1) : 0.0;
            const double y = height > 1 ? double(j) * (image.height - 1) / (height - 1) : 0.0;
            const int x0 = std::min(int(x), image.width - 1), y0 = std::min(int(y), image.height - 1);
            const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
            const double fx = x - x0, fy = y - y0;
            heights[size_t(j) * size_t(width) + size_t(i)] =
                float((1 - fy) * ((1 - fx) * pixel(x0, y0) + fx * pixel(x1, y0)) +
                      fy * ((1 - fx) * pixel(x0, y1) + fx * pixel(x1, y1)));
        }
    return heightfield_mesh(heights, width, height, vec2f(params, "size"), float(params.number("height")));
}

// Files of a mesh, one a frame where it deforms.
std::vector<std::pair<double, std::string>> mesh_files(const Item& item) {
    const ParamSet& params = item.params;
    std::vector<std::pair<double, std::string>> files;
    if (!params.has("file_frames")) return {{0.0, params.text("file")}};
    const Vec2d range = params.vec2("file_frames");
    for (double frame = range.x(); frame <= range.y(); frame += 1.0)
        files.emplace_back(frame, numbered(params.text("file"), frame));
    return files;
}

Mesh load_mesh_item(const Item& item) {
    const ParamSet& params = item.params;
    if (item.type == "file") return load_mesh(mesh_files(item).front().second, params.boolean("smooth"));
    if (item.type == "plane") return plane_mesh(vec2f(params, "size"), params.integer("divisions"));
    if (item.type == "box") return box_mesh(vec3f(params, "size"));
    if (item.type == "sphere")
        return sphere_mesh(float(params.number("radius")), params.integer("divisions"),
                           float(params.number("bumps")), float(params.number("frequency")));
    return load_heightfield(params);
}

// What the built-in shapes object to stands at the scene's own line.
Mesh load_mesh_at(const Item& item) {
    try {
        return load_mesh_item(item);
    } catch (const InputError& error) {
        std::vector<Problem> problems = error.problems;
        for (Problem& problem : problems)
            if (problem.place.file.empty()) problem.place = item.place;
        throw InputError(std::move(problems));
    }
}

// The shapes of a mesh that deforms; `first` is of the first of its files.
std::vector<MeshShape> load_shapes(const Item& item, const Mesh& first, const std::atomic<bool>& cancel) {
    const auto files = mesh_files(item);
    std::vector<MeshShape> shapes;
    if (files.size() < 2) return shapes;
    shapes.push_back({files[0].first, first.positions, first.normals});
    for (size_t i = 1; i < files.size(); ++i) {
        if (cancel.load()) throw Cancelled{};
        const auto& [frame, file] = files[i];
        Mesh mesh = load_mesh(file, item.params.boolean("smooth"));
        if (mesh.triangles != first.triangles || mesh.positions.size() != first.positions.size() ||
            mesh.normals.size() != first.normals.size())
            throw InputError(
                {file},
                fmt::format("has {} triangles of {} vertices that are not those of '{}', {} of {}",
                            mesh.triangles.size(), mesh.positions.size(), files[0].second,
                            first.triangles.size(), first.positions.size()),
                "a mesh that deforms keeps its triangles: export every frame from the same mesh");
        shapes.push_back({frame, std::move(mesh.positions), std::move(mesh.normals)});
    }
    return shapes;
}

// The sky is returned, its sun goes to `suns`.
LightDescription daylight_of(const ParamSet& params, std::vector<LightDescription>& suns) {
    DaylightSettings settings;
    settings.direction = params.vec3("direction").stableNormalized();
    settings.angle = params.number("angle") * degree;
    settings.turbidity = params.number("turbidity");
    settings.ozone = params.number("ozone");
    settings.altitude = params.number("altitude");
    settings.ground_albedo = params.number("ground_albedo");
    DaylightLights lights = daylight_lights(settings, float(params.number("strength")));
    if (params.boolean("sun") && lights.sun.irradiance.maxCoeff() > 0.0F) suns.emplace_back(lights.sun);
    return std::move(lights.sky);
}

LightDescription light_of(const Item& item, std::vector<LightDescription>& suns) {
    const ParamSet& params = item.params;
    if (item.type == "daylight") return daylight_of(params, suns);
    if (item.type == "sun") {
        SunLight sun;
        sun.direction = params.vec3("direction");
        sun.angle = params.number("angle") * degree;
        sun.irradiance = vec3f(params, "irradiance");
        return sun;
    }
    if (item.type == "sky") {
        SkyLight sky;
        sky.zenith = vec3f(params, "zenith");
        sky.horizon = vec3f(params, "horizon");
        sky.ground = vec3f(params, "ground");
        sky.strength = float(params.number("strength"));
        return sky;
    }
    if (item.type == "environment") {
        const std::string& file = params.text("file");
        const Image image = read_image(file);
        if (image.width / 2 != image.height && (image.width + 1) / 2 != image.height)
            throw InputError(params.at("file").place,
                             fmt::format("\"{}\" is {} x {} pixels: all directions by longitude and latitude "
                                         "are twice as wide as high",
                                         file, image.width, image.height),
                             "convert it to a latitude-longitude map");
        EnvironmentLight light;
        light.width = uint32_t(image.width);
        light.height = uint32_t(image.height);
        size_t negative = 0;
        float brightest = 0.0F;
        for (size_t i = 0; i < size_t(image.width) * size_t(image.height); ++i) {
            const float* p = image.pixels.data() + i * size_t(image.channels);
            const Vec3f color = image.channels >= 3 ? Vec3f(p[0], p[1], p[2]) : Vec3f::Constant(p[0]);
            negative += color.minCoeff() < 0.0F;
            light.pixels.push_back(color.cwiseMax(0.0F));
            brightest = std::max(brightest, light.pixels.back().maxCoeff());
        }
        if (negative > 0)
            fmt::print(stderr, "{}: \"{}\" has {} pixels that are below 0: they give no light\n",
                       to_string(params.at("file").place), file, negative);
        constexpr float most = 1e15F; // its square is a float
        if (!(brightest * float(params.number("strength")) <= most))
            throw InputError(params.at("file").place,
                             fmt::format("\"{}\" is as bright as {:.3g} times strength, {:.0e} is allowed",
                                         file, brightest, most),
                             "mend its hot pixels, or use less strength");
        light.rotation = params.number("rotation") * degree;
        light.strength = float(params.number("strength"));
        return light;
    }
    MeshLight light;
    light.radiance = vec3f(params, "radiance");
    return light;
}

void apply(const Overrides& overrides, std::vector<std::string>& settings) {
    settings = overrides.settings;
    if (overrides.samples) settings.push_back("film.samples=" + std::to_string(*overrides.samples));
    if (overrides.size)
        settings.push_back("film.size=[" + std::to_string(overrides.size->first) + ", " +
                           std::to_string(overrides.size->second) + "]");
}

void shine(SceneMesh& mesh, const std::vector<Item>& lights, size_t by) {
    if (mesh.light >= 0)
        throw InputError(lights[by].params.at("mesh").place,
                         fmt::format("mesh \"{}\" shines already by light \"{}\"", mesh.name,
                                     lights[size_t(mesh.light)].name),
                         "add their radiances up in one light");
    mesh.light = int(by);
}

void load_meshes(LoadedScene& scene, const std::atomic<bool>& cancel, Objections& objections) {
    const SceneDescription& description = scene.description;
    for (const Item& item : description.meshes) {
        if (cancel.load()) throw Cancelled{};
        SceneMesh mesh{item.name, {}, {}, material_of(description, item), -1};
        const ParamValue& keys = item.params.at("transform");
        mesh.transform = KeyedTransform(keys.numbers, keys.text);
        objections([&] {
            mesh.mesh = load_mesh_at(item);
            if (item.type == "file") mesh.shapes = load_shapes(item, mesh.mesh, cancel);
        });
        for (size_t i = 0; i < description.lights.size(); ++i)
            if (description.lights[i].type == "mesh" &&
                description.lights[i].params.text("mesh") == item.name)
                objections([&] { shine(mesh, description.lights, i); });
        scene.geometry.meshes.push_back(std::move(mesh));
    }
}

std::shared_ptr<PluginLibrary> library_for(const Dialect& dialect, const Item& item) {
    const std::string key = item.params.has("library") ? item.params.text("library") : "";
    return dialect.libraries.at(key);
}

} // namespace

std::string default_library() {
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    return ((error ? fs::path(".") : program.parent_path()) / "libmarram_procedural.so").string();
}

Dialect default_dialect() {
    Dialect dialect;
    dialect.schema = scene_schema();
    for (const ShaderDescription& shader : shaders())
        dialect.schema.materials.push_back({shader.name, shader.help, shader.params});
    add_library(dialect, "", default_library(), {default_library()});
    return dialect;
}

namespace {

// Loads the libraries that the scene names, then reads the scene with all that they declare. Where a library is not there
// its types are unknown too: that is no second mistake.
SceneDescription describe(const std::string& file, const std::vector<std::string>& settings,
                          Dialect& dialect) {
    std::vector<LibraryName> missing;
    for (const LibraryName& library : scene_libraries(file, settings)) {
        if (fs::exists(library.path))
            add_library(dialect, library.path, library.path, library.place);
        else
            missing.push_back(library);
    }
    try {
        return load_scene(file, settings, dialect.schema);
    } catch (const InputError& error) {
        std::vector<Problem> problems;
        for (const LibraryName& library : missing) {
            const auto said = [&](const Problem& p) {
                return to_string(p.place) == to_string(library.place);
            };
            if (std::ranges::none_of(error.problems, said))
                problems.push_back({library.place, "there is no file \"" + library.path + "\"",
                                    "build the library, or mend its path"});
        }
        for (const Problem& problem : error.problems)
            if (missing.empty() || problem.what.find("is no type of procedural") == std::string::npos)
                problems.push_back(problem);
        throw InputError(std::move(problems));
    }
}

} // namespace

LoadedScene load(const std::string& file, const Overrides& overrides, const std::atomic<bool>& cancel) {
    LoadedScene scene;
    std::vector<std::string> settings;
    apply(overrides, settings);
    scene.dialect = std::make_unique<Dialect>(default_dialect());
    scene.description = describe(file, settings, *scene.dialect);
    const SceneDescription& description = scene.description;

    Objections objections;
    for (const Item& item : description.materials)
        objections([&] { scene.materials.push_back(make_material(item.type, item.params, open_texture)); });
    std::vector<LightDescription> suns; // of daylight: last, so that meshes find their lights by place
    for (const Item& item : description.lights)
        objections([&] { scene.lights.push_back(light_of(item, suns)); });
    std::ranges::move(suns, std::back_inserter(scene.lights));
    load_meshes(scene, cancel, objections);
    for (const Item& item : description.procedurals)
        objections([&] {
            auto procedural = std::make_unique<Procedural>(library_for(*scene.dialect, item), item,
                                                           description.wind, cancel);
            procedural->material = material_of(description, item);
            scene.geometry.procedurals.push_back(std::move(procedural));
        });
    objections([&] { camera_at(description, description.globals.vec2("frames").x()); });
    objections.raise();
    if (scene.lights.empty()) {
        fmt::print(stderr, "{}: the scene has no light: it is lit by a plain sky\n", file);
        scene.lights.push_back(SkyLight{});
    }
    return scene;
}

std::vector<std::string> files_read(const LoadedScene& scene, const std::string& file) {
    std::vector<std::string> files = {file};
    const SceneDescription& description = scene.description;
    for (const auto* items :
         {&description.materials, &description.meshes, &description.lights, &description.procedurals})
        for (const Item& item : *items)
            for (const ParamValue& value : item.params.all())
                if (value.spec->type == ParamType::file || value.spec->type == ParamType::image)
                    files.push_back(value.text);
    for (const Item& mesh : description.meshes)
        if (mesh.params.has("file_frames"))
            for (const auto& [frame, shape] : mesh_files(mesh)) files.push_back(shape);
    return files;
}

std::pair<uint32_t, uint32_t> film_size(const LoadedScene& scene) {
    const Vec2d size = scene.description.film.vec2("size");
    return {uint32_t(size.x()), uint32_t(size.y())};
}

BuildSettings build_settings(const LoadedScene& scene, double frame) {
    const SceneDescription& description = scene.description;
    const ParamSet& globals = description.globals;
    BuildSettings settings;
    settings.frame = frame;
    settings.fps = globals.number("fps");
    const Vec2d shutter = description.camera.vec2("shutter");
    settings.shutter_open = shutter.x();
    settings.shutter_close = shutter.y();
    settings.bind_frame =
        globals.has("bind_frame") ? globals.number("bind_frame") : globals.vec2("frames").x();
    const Camera camera = camera_at(description, frame);
    const auto [width, height] = film_size(scene);
    const double half_height = std::tan(0.5 * camera.vertical_fov);
    const auto ahead = [](const CameraPose& pose) -> Vec3d { return pose.orientation * -Vec3d::UnitZ(); };
    settings.view = {.position = camera.poses.front().position,
                     .forward = ahead(camera.poses.front()),
                     .cosine = 1.0 / std::hypot(1.0, half_height, half_height * width / height),
                     .pixel_angle = 2.0 * half_height / height};
    constexpr size_t enough = 8; // of its poses: what comes into view between two is about as near in one
    const size_t last = camera.poses.size() - 1, looks = std::min(last, enough);
    for (size_t i = 1; i <= looks; ++i) {
        const CameraPose& pose = camera.poses[i * last / looks];
        settings.view.later.emplace_back(pose.position, ahead(pose));
    }
    settings.tolerance = globals.number("tolerance");
    if (globals.has("tolerance_pixels")) {
        settings.view.pixels_at =
            (description.camera.vec3("target") - description.camera.vec3("position")).norm();
        settings.tolerance =
            globals.number("tolerance_pixels") * settings.view.pixel_angle * settings.view.pixels_at;
    }
    settings.motion_keys =
        description.film.has("motion_keys") ? uint32_t(description.film.integer("motion_keys")) : 0;
    if (description.film.has("curve_pieces"))
        settings.curve_pieces = description.film.integer("curve_pieces");
    return settings;
}

RenderSettings render_settings(const LoadedScene& scene, double frame) {
    const ParamSet& film = scene.description.film;
    RenderSettings settings;
    settings.samples = uint32_t(film.integer("samples"));
    settings.max_depth = uint32_t(film.integer("max_depth"));
    settings.noise = film.number("noise");
    settings.clamp = float(film.number("clamp"));
    const std::string& filter = film.text("filter");
    settings.filter.kind = filter == "box"        ? FilterKind::box
                           : filter == "triangle" ? FilterKind::triangle
                           : filter == "gaussian" ? FilterKind::gaussian
                                                  : FilterKind::blackman_harris;
    settings.filter.radius = film.number("filter_radius");
    settings.seed = std::bit_cast<uint64_t>(frame); // another pattern of noise each frame
    if (const int seed = film.integer("seed"); seed != 0) settings.seed = hash(settings.seed, uint64_t(seed));
    return settings;
}

std::vector<std::string> wanted_attributes(const LoadedScene& scene, const std::vector<std::string>& layers) {
    std::vector<std::string> names = layers;
    for (const Material& material : scene.materials)
        if (!material.tint.empty()) names.push_back(material.tint);
    names.emplace_back("id"); // strands differ by it, whatever grows beside them
    std::ranges::sort(names);
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
}

} // namespace marram
