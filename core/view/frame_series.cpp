// SPDX-License-Identifier: Apache-2.0
#include "core/view/frame_series.h"

#include "core/image/atomic_file.h"
#include "core/image/image_library.h"
#include "core/image/run_files.h"
#include "core/math/frame_name.h"
#include "core/scene/keyed_values.h"
#include "core/shot/frame_list.h"
#include "core/view/live_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

namespace marram {
namespace {

namespace fs = std::filesystem;

constexpr double shown_pixels = 1e6; // of a picture that is sent to the page

std::string vector_setting(const char* name, const Vec3d& v) {
    return fmt::format("camera.{}=[{}, {}, {}]", name, v.x(), v.y(), v.z());
}

// The view's camera stands still.
std::vector<std::string> settings_of_camera(const SeriesCamera& camera) {
    return {vector_setting("position", camera.position), vector_setting("target", camera.target),
            vector_setting("up", camera.up), fmt::format("camera.fov={}", camera.fov), "camera.transform={}"};
}

// Made if it is missing, in a folder that is there.
fs::path folder_of(const SeriesRequest& request, const std::string& scene) {
    if (request.folder.empty()) throw InputError({"folder"}, "none is given", "name one for the pictures");
    const fs::path folder = fs::absolute(fs::path(scene)).parent_path() / request.folder;
    std::error_code error;
    if (fs::create_directory(folder, error); error)
        throw InputError({folder.string()}, "this folder cannot be made (" + error.message() + ")",
                         "choose another, or make the one that it is in");
    return folder;
}

void check_pictures(const Shot& shot, const std::vector<FrameFiles>& files, const std::string& scene,
                    bool replace) {
    load_image_library();
    const auto is_there = [](const FrameFiles& one) {
        std::error_code error;
        return fs::exists(fs::symlink_status(one.picture, error));
    };
    const auto there = std::ranges::find_if(files, is_there);
    if (there != files.end() && !replace)
        throw InputError({there->picture},
                         fmt::format("exists already, one of {}", std::ranges::count_if(files, is_there)),
                         "choose another folder, or allow that pictures are replaced");
    RunFiles known(files_read(shot, scene));
    for (const FrameFiles& one : files) {
        check_name_length(one.picture);
        known.write(one.picture);
        check_writable(one.picture);
    }
}

} // namespace

FrameSeries::FrameSeries(ViewClient client, SeriesRequest request, const Shot& shot, const std::string& scene,
                         std::vector<std::string> settings, const std::atomic<bool>& stop)
    : client_(client), request_(std::move(request)), options_{.scene = scene, .layers = {}},
      camera_(shot.description.camera), stop_(stop) {
    if (request_.camera) {
        for (std::string& one : settings_of_camera(*request_.camera)) settings.push_back(std::move(one));
        camera_ = describe_scene(scene, settings, *shot.plugins).camera;
    }
    const std::vector<double> frames = parse_frames(request_.frames, "frames");
    folder_ = folder_of(request_, scene).string();
    const std::string name =
        (fs::path(folder_) / fs::path(scene).stem()).string() + ".####." + request_.format;
    const uint64_t digest = shot_digest(shot, options_, settings);
    for (const double frame : frames) files_.push_back(frame_files(frame, shot, digest, name, ""));
    check_pictures(shot, files_, scene, request_.replace);
}

void FrameSeries::trace(KeptGeometry& kept, const std::function<void()>& show) {
    World world = build_frame(*frame_, std::exchange(kept, {}));
    if (paused_film_.width > 0) frame_->film = std::exchange(paused_film_, {});
    show();
    Preview none({});
    frame_->between_passes = show;
    trace_frame(*frame_, world, none);
    if (stats_.render.cancelled) paused_film_ = std::exchange(frame_->film, {});
    kept = kept_geometry(std::move(world)); // free the rest: saving may need the memory
}

void FrameSeries::work(Shot& shot, KeptGeometry& kept, int threads, uint64_t memory,
                       const std::function<void()>& show) {
    if (!frame_ || frame_saved_) {
        stats_ = {};
        stats_.frame = files_[next_].frame;
        stats_.threads = threads;
        frame_.reset(
            new Frame{shot, options_, files_[next_], layer_names(shot, options_.layers), stop_, stats_});
        frame_saved_ = false;
    }
    options_.memory = memory;
    std::swap(shot.description.camera, camera_);
    try {
        trace(kept, show);
    } catch (...) {
        std::swap(shot.description.camera, camera_);
        throw;
    }
    std::swap(shot.description.camera, camera_);
    if (stats_.render.cancelled) return;
    for (const Problem& warning : render_warnings(*frame_)) warnings_.insert(to_string(warning));
    save_frame(*frame_);
    frame_saved_ = true;
    ++next_;
}

nlohmann::json FrameSeries::progress() const {
    const size_t at = std::min(next_, files_.size() - 1);
    const bool traced = frame_ && !frame_saved_ && frame_->film.width > 0;
    return {{"type", "series"},
            {"seq", request_.seq},
            {"frame", files_[at].frame},
            {"index", next_},
            {"of", files_.size()},
            {"samples", traced ? progress_of(frame_->film).min : 0},
            {"of_samples", frame_ ? frame_->settings.samples : 0}};
}

WireMessage FrameSeries::last_picture() const {
    const Film& film = frame_->film;
    const double pixels = double(film.width) * film.height;
    const auto step = uint32_t(std::ceil(std::sqrt(std::max(pixels / shown_pixels, 1.0))));
    WireMessage message;
    message.header = {{"type", "series_picture"}, {"seq", request_.seq}, {"frame", frame_->files.frame}};
    const double exposure = values_at(frame_->shot.description.film, frame_->files.frame).number("exposure");
    add_pixels(film, "beauty", exposure, step, message);
    return message;
}

nlohmann::json FrameSeries::end() const {
    return {{"type", "series_done"},
            {"seq", request_.seq},
            {"folder", folder_},
            {"pictures", next_},
            {"of", files_.size()},
            {"warnings", warnings_},
            {"problems", nlohmann::json::array()}};
}

} // namespace marram
