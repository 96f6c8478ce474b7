// SPDX-License-Identifier: Apache-2.0
#include "core/shot/settings.h"

#include "core/math/hash.h"
#include "core/shot/scene/scene_camera.h"

#include <algorithm>
#include <bit>
#include <tuple>

namespace marram {
namespace {

constexpr uint32_t max_attribute_channels = 4; // film.h

} // namespace

std::pair<uint32_t, uint32_t> film_size(const Shot& shot) {
    const Vec2d size = shot.description.film.vec2("size");
    return {uint32_t(size.x()), uint32_t(size.y())};
}

uint64_t film_bytes(uint32_t width, uint32_t height, const std::vector<std::string>& layers, bool catchers) {
    uint64_t of_pixel = sizeof(FilmPixel) + (catchers ? sizeof(CatcherSums) : 0);
    for (const std::string& name : layers) {
        FilmLayer layer{.name = name, .kind = LayerKind::attribute, .channels = max_attribute_channels};
        const auto known = std::ranges::find(built_in_layers(), name, &BuiltInLayer::name);
        if (known != built_in_layers().end()) layer.kind = known->kind, layer.channels = known->channels;
        of_pixel += sum_count(layer) * sizeof(Int128) + sizeof(uint32_t); // and its count
        of_pixel += layer.channels * sizeof(float);
    }
    return of_pixel * width * height;
}

BuildSettings build_settings(const Shot& shot, double frame) {
    const SceneDescription& description = shot.description;
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
    const auto [width, height] = film_size(shot);
    const double half_height = std::tan(0.5 * camera.vertical_fov);
    const auto ahead = [](const CameraPose& pose) -> Vec3d { return pose.orientation * -Vec3d::UnitZ(); };
    settings.view = {.position = camera.poses.front().position,
                     .forward = ahead(camera.poses.front()),
                     .cosine = 1.0 / std::hypot(1.0, half_height, half_height * width / height),
                     .pixel_angle = 2.0 * half_height / height};
    // At most 8 later poses: geometry that enters the view between two poses is about as near in one of them.
    constexpr size_t enough = 8;
    const size_t last = camera.poses.size() - 1, looks = std::min(last, enough);
    for (size_t i = 1; i <= looks; ++i) {
        const CameraPose& pose = camera.poses[i * last / looks];
        settings.view.later.emplace_back(pose.position, ahead(pose));
    }
    settings.shot_frames = globals.vec2("frames");
    settings.state_folder = shot.state_folder;
    settings.tolerance = globals.number("tolerance");
    if (globals.has("tolerance_pixels")) {
        settings.view.reference_depth =
            (description.camera.vec3("target") - description.camera.vec3("position")).norm();
        settings.tolerance =
            globals.number("tolerance_pixels") * settings.view.pixel_angle * settings.view.reference_depth;
    }
    settings.motion_keys =
        description.film.has("motion_keys") ? uint32_t(description.film.integer("motion_keys")) : 0;
    if (description.film.has("curve_pieces"))
        settings.curve_pieces = description.film.integer("curve_pieces");
    settings.camera = camera_samples(shot, frame);
    settings.render_meshes = false;
    return settings;
}

CameraSamples camera_samples(const Shot& shot, double frame) {
    const Camera camera = camera_at(shot.description, frame);
    const Vec2d shutter = shot.description.camera.vec2("shutter");
    CameraSamples samples;
    const auto last = double(std::max<size_t>(camera.poses.size() - 1, 1));
    for (size_t i = 0; i < camera.poses.size(); ++i) {
        const CameraPose& pose = camera.poses[i];
        samples.times.push_back(frame + shutter.x() + (shutter.y() - shutter.x()) * double(i) / last);
        samples.positions.push_back(pose.position);
        samples.directions.emplace_back(pose.orientation * -Vec3d::UnitZ());
        samples.ups.emplace_back(pose.orientation * Vec3d::UnitY());
    }
    samples.fov = camera.vertical_fov;
    std::tie(samples.width, samples.height) = film_size(shot);
    return samples;
}

RenderSettings render_settings(const Shot& shot, double frame) {
    const ParamSet& film = shot.description.film;
    RenderSettings settings;
    settings.samples = uint32_t(film.integer("samples"));
    settings.max_depth = uint32_t(film.integer("max_depth"));
    settings.noise_threshold = film.number("noise");
    settings.indirect_clamp = float(film.number("clamp"));
    const std::string& filter = film.text("filter");
    settings.filter.kind = filter == "box"        ? FilterKind::box
                           : filter == "triangle" ? FilterKind::triangle
                           : filter == "gaussian" ? FilterKind::gaussian
                                                  : FilterKind::blackman_harris;
    settings.filter.radius = film.number("filter_radius");
    settings.seed = std::bit_cast<uint64_t>(frame); // the noise differs from frame to frame
    if (const int seed = film.integer("seed"); seed != 0) settings.seed = hash(settings.seed, uint64_t(seed));
    return settings;
}

std::vector<std::string> wanted_attributes(const Shot& shot, const std::vector<std::string>& layers) {
    std::vector<std::string> names = layers;
    for (const Material& material : shot.materials) {
        if (!material.tint_attribute.empty()) names.push_back(material.tint_attribute);
        if (material.mapped) names.emplace_back("root_uv");
        if (const auto* blend = std::get_if<BlendSettings>(&material.settings))
            names.push_back(blend->attribute);
        if (std::holds_alternative<SandSettings>(material.settings))
            names.insert(names.end(), ripple_attributes.begin(), ripple_attributes.end());
    }
    names.emplace_back("id"); // per-strand variation is hashed from it
    std::ranges::sort(names);
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
}

} // namespace marram
