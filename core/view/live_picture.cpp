// SPDX-License-Identifier: Apache-2.0
#include "core/view/live_picture.h"

#include "core/image/image.h"
#include "core/math/clock.h"
#include "core/shot/frame.h"
#include "core/shot/layer_picture.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/settings.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace marram {
namespace {

constexpr double draft_widening = 0.6; // less than by as much as is left out: leaves are no grass

// The page's camera with the lens of the scene's.
Camera camera_of(const PictureRequest& request, const Shot& shot) {
    Camera camera = camera_at(shot.description, request.frame);
    camera.poses = {look_at(request.position, request.target, request.up)};
    camera.vertical_fov = request.fov * degree;
    return camera;
}

// Growth surfaces and tolerances in pixels depend on the camera.
BuildSettings settings_for(const PictureRequest& request, const Shot& shot, const Camera& camera) {
    BuildSettings settings = build_settings(shot, request.frame);
    const CameraPose& pose = camera.poses.front();
    const double half_height = std::tan(0.5 * camera.vertical_fov),
                 aspect = double(request.width) / request.height;
    View& view = settings.view;
    view.position = pose.position;
    view.forward = pose.orientation * -Vec3d::UnitZ();
    view.later.clear();
    view.cosine = 1.0 / std::hypot(1.0, half_height, half_height * aspect);
    view.pixel_angle = 2.0 * half_height / request.height;
    settings.render_meshes = true;
    settings.camera->times = {settings.camera->times.front()};
    settings.camera->positions = {pose.position};
    settings.camera->directions = {view.forward};
    settings.camera->ups = {pose.orientation * Vec3d::UnitY()};
    settings.camera->fov = camera.vertical_fov;
    settings.camera->width = request.width, settings.camera->height = request.height;
    return settings;
}

// How values of a layer become grey levels 0 ... 1 (of colours: linear).
class Levels {
  public:
    Levels(const FilmLayer& layer, double exposure)
        : is_color_(layer.kind == LayerKind::beauty || layer.kind == LayerKind::albedo) {
        if (is_color_) {
            scale_ = layer.kind == LayerKind::beauty ? std::exp2(exposure) : 1.0;
            return;
        }
        double low = std::numeric_limits<double>::infinity(), high = -low;
        for (const float value : layer.values)
            if (std::isfinite(value))
                low = std::min(low, double(value)), high = std::max(high, double(value));
        if (const auto natural = natural_range(layer.name)) low = natural->black, high = natural->white;
        offset_ = std::isfinite(low) ? low : 0.0;
        scale_ = high > low ? 1.0 / (high - low) : 1.0;
    }
    uint8_t operator()(float value) const {
        const double level = std::clamp((double(value) - offset_) * scale_, 0.0, 1.0);
        const double shown = is_color_ ? double(srgb_from_linear(float(level))) : level;
        return std::isfinite(shown) ? uint8_t(std::lround(255.0 * shown)) : uint8_t(0);
    }

  private:
    bool is_color_;
    double offset_ = 0.0, scale_ = 1.0;
};

} // namespace

void add_pixels(const Film& film, const std::string& name, double exposure, uint32_t step,
                WireMessage& message) {
    const FilmLayer& layer = *find_layer(film, name);
    const Levels levels(layer, exposure);
    const uint32_t width = (film.width + step - 1) / step, height = (film.height + step - 1) / step,
                   channels = layer.channels;
    message.header["width"] = width;
    message.header["height"] = height;
    auto* const out = reinterpret_cast<uint8_t*>(message.at(message.add(4 * size_t(width) * height)));
    tbb::parallel_for(0U, height, [&](uint32_t row) {
        for (uint32_t column = 0; column < width; ++column) {
            const size_t pixel = size_t(row) * step * film.width + size_t(column) * step,
                         to = 4 * (size_t(row) * width + column);
            for (uint32_t c = 0; c < 3; ++c)
                out[to + c] = c < channels || channels == 1
                                  ? levels(layer.values[pixel * channels + std::min(c, channels - 1)])
                                  : uint8_t(0);
            out[to + 3] = 255;
        }
    });
}

LivePicture::LivePicture(ViewClient client, const PictureRequest& request, double share)
    : client_(client), request_(request),
      part_(request.crop.value_or(std::array<uint32_t, 4>{0, 0, request.width, request.height})),
      share_(share), begin_(wall_seconds()) {}

void LivePicture::build(Shot& shot, KeptGeometry kept, uint64_t memory, const std::atomic<bool>& stop,
                        BuildProgress& progress) {
    check_layers(shot, {request_.layer}, "layer");
    set_frame(shot, request_.frame);
    camera_ = camera_of(request_, shot);
    settings_ = render_settings(shot, request_.frame);
    settings_.samples = request_.samples;
    settings_.crop = Crop{part_[0], part_[1], request_.width, request_.height};
    BuildSettings settings = settings_for(request_, shot, camera_);
    settings.share = share_;
    settings.widening = draft_widening;
    std::vector<std::string> layers = {"beauty"};
    for (const std::string& layer :
         {request_.layer, std::string(settings_.noise_threshold > 0.0 ? "variance" : "")})
        if (!layer.empty() && std::ranges::find(layers, layer) == layers.end()) layers.push_back(layer);
    settings.attributes = wanted_attributes(shot, layers);
    settings.memory = {.limit = memory,
                       .reserved =
                           film_ ? 0 : film_bytes(part_[2], part_[3], layers, has_shadow_catcher(shot))};
    BuildStats stats;
    World world = build_world(shot.geometry, settings, stop, progress, stats, std::move(kept));
    if (!film_) film_ = make_film(part_[2], part_[3], layers, world);
    world_ = std::move(world);
}

bool LivePicture::work(Shot& shot, KeptGeometry kept, uint64_t memory, const std::atomic<bool>& stop,
                       BuildProgress& progress, const std::function<void()>& show) {
    if (!world_) build(shot, std::move(kept), memory, stop, progress);
    const Lights lights(shot.lights, *world_);
    RenderProgress passes;
    passes.cancel = &stop;
    passes.between_passes = [&](Film& film) {
        resolve(film);
        show();
    };
    const RenderStats stats = render(*world_, lights, shot.materials, camera_, settings_, *film_, &passes);
    if (!stats.cancelled) show();
    return !stats.cancelled;
}

WireMessage LivePicture::message() const {
    WireMessage message;
    message.header = {{"type", "image"},      {"seq", request_.seq},        {"x", part_[0]},
                      {"y", part_[1]},        {"of_width", request_.width}, {"of_height", request_.height},
                      {"samples", samples()}, {"of", request_.samples},     {"seconds", seconds()}};
    add_pixels(*film_, request_.layer, request_.exposure, 1, message);
    return message;
}

double LivePicture::seconds() const { return wall_seconds() - begin_; }

uint32_t LivePicture::samples() const { return film_ ? progress_of(*film_).min : 0; }

KeptGeometry LivePicture::take_geometry() {
    if (!world_) return {};
    World world = *std::move(world_);
    world_.reset();
    return kept_geometry(std::move(world));
}

} // namespace marram
