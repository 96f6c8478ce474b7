// SPDX-License-Identifier: Apache-2.0
#include "core/view/inbox.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace marram {
namespace {

using nlohmann::json;

constexpr size_t frames_waiting = 2;   // of a client
constexpr size_t changes_waiting = 32; // of all
constexpr uint32_t max_budget = 4'000'000;
constexpr uint32_t max_side = 4096; // pixels
constexpr double latest = 1e6;      // frame

struct Malformed {};

double number(const json& message, const char* name, double low, double high) {
    const auto found = message.find(name);
    if (found == message.end() || !found->is_number()) throw Malformed{};
    const double value = found->get<double>();
    if (!std::isfinite(value)) throw Malformed{};
    return std::clamp(value, low, high);
}

Vec3d point(const json& message, const char* name) {
    const auto found = message.find(name);
    if (found == message.end() || !found->is_array() || found->size() != 3) throw Malformed{};
    Vec3d value;
    for (size_t i = 0; i < 3; ++i) {
        if (!(*found)[i].is_number()) throw Malformed{};
        value[int(i)] = (*found)[i].get<double>();
        if (!(std::abs(value[int(i)]) < 1e9)) throw Malformed{};
    }
    return value;
}

uint64_t seq_of(const json& message) { return uint64_t(number(message, "seq", 0.0, 0x1p53)); }

AirPlane air_plane(const json& from) {
    constexpr double max_points = 64.0; // along a side
    return {point(from, "center"), point(from, "u"), point(from, "v"),
            uint32_t(number(from, "columns", 1.0, max_points)),
            uint32_t(number(from, "rows", 1.0, max_points))};
}

RaysRequest rays_request(const json& message) {
    constexpr double max_index = 0x1p32 - 1.0;
    return {seq_of(message), uint64_t(number(message, "selection", 0.0, 0x1p53)),
            number(message, "frame", -latest, latest), uint32_t(number(message, "part", 0.0, max_index)),
            uint32_t(number(message, "vertex", 0.0, max_index))};
}

ViewFrameRequest frame_request(const json& message) {
    ViewFrameRequest request;
    request.seq = seq_of(message);
    request.frame = number(message, "frame", -latest, latest);
    request.budget = uint32_t(number(message, "budget", 1.0, max_budget));
    request.floats = message.value("encoding", "u16") == "f32";
    request.values = message.value("values", "");
    request.gusts = message.value("gusts", true);
    if (message.contains("air")) request.air = air_plane(message["air"]);
    return request;
}

// A part of a picture of these sizes, at least a pixel of it.
std::array<uint32_t, 4> crop_of(const json& part, uint32_t width, uint32_t height) {
    if (!part.is_array() || part.size() != 4) throw Malformed{};
    for (const json& one : part)
        if (!one.is_number()) throw Malformed{};
    const auto x = uint32_t(std::clamp(part[0].get<double>(), 0.0, width - 1.0));
    const auto y = uint32_t(std::clamp(part[1].get<double>(), 0.0, height - 1.0));
    return {x, y, uint32_t(std::clamp(part[2].get<double>(), 1.0, double(width - x))),
            uint32_t(std::clamp(part[3].get<double>(), 1.0, double(height - y)))};
}

PictureRequest picture_request(const json& message) {
    const json& camera = message.at("camera");
    const json& size = message.at("size");
    if (!size.is_array() || size.size() != 2 || !size[0].is_number() || !size[1].is_number())
        throw Malformed{};
    PictureRequest request;
    request.seq = seq_of(message);
    request.frame = number(message, "frame", -latest, latest);
    request.position = point(camera, "position");
    request.target = point(camera, "target");
    request.up = point(camera, "up");
    request.fov = number(camera, "fov", 0.1, 170.0);
    request.width = uint32_t(std::clamp(size[0].get<double>(), 1.0, double(max_side)));
    request.height = uint32_t(std::clamp(size[1].get<double>(), 1.0, double(max_side)));
    if (message.contains("crop")) request.crop = crop_of(message["crop"], request.width, request.height);
    request.layer = message.value("layer", "beauty");
    request.exposure = number(message, "exposure", -50.0, 50.0);
    request.samples = uint32_t(number(message, "samples", 1.0, 65536.0));
    if (message.contains("budget")) request.budget = uint32_t(number(message, "budget", 0.0, max_budget));
    const Vec3d back = request.position - request.target; // look_at() needs two directions
    if (!(back.cross(request.up).norm() > 1e-9 * back.norm() * request.up.norm())) throw Malformed{};
    return request;
}

SeriesRequest series_request(const json& message) {
    SeriesRequest request;
    request.seq = seq_of(message);
    request.folder = message.at("folder").get<std::string>();
    request.frames = message.at("frames").get<std::string>();
    request.format = message.value("format", "exr");
    if (request.format != "exr" && request.format != "png") throw Malformed{};
    request.replace = message.value("replace", false);
    if (!message.contains("camera") || message["camera"].is_null()) return request;
    const json& camera = message["camera"];
    request.camera = {point(camera, "position"), point(camera, "target"), point(camera, "up"),
                      number(camera, "fov", 0.01, 179.0)};
    return request;
}

std::optional<ChangeRequest> change_request(const std::string& type, const json& message) {
    using Kind = ChangeRequest::Kind;
    static const std::pair<const char*, Kind> kinds[] = {{"set", Kind::set},   {"undo", Kind::undo},
                                                         {"redo", Kind::redo}, {"reset", Kind::reset},
                                                         {"save", Kind::save}, {"reload", Kind::reload}};
    for (const auto& [name, kind] : kinds) {
        if (type != name) continue;
        ChangeRequest change{.kind = kind, .key = ""};
        if (kind == Kind::set) {
            change.key = message.at("key").get<std::string>();
            if (!message.at("value").is_null()) change.value = message.at("value").get<std::string>();
            if (message.contains("gesture"))
                change.gesture = uint64_t(number(message, "gesture", 0.0, 0x1p53));
        }
        return change;
    }
    return {};
}

} // namespace

void Inbox::arrived(bool is_change) {
    fresh_ = true;
    if (work_ == Work::picture || (work_ == Work::frame && is_change)) stop_work_ = true;
    something_.notify_one();
}

void Inbox::join(ViewClient client) {
    const std::lock_guard lock(mutex_);
    clients_[client] = {};
    arrived(false);
}

void Inbox::leave(ViewClient client) {
    const std::lock_guard lock(mutex_);
    clients_.erase(client);
    left_.push_back(client);
    arrived(false);
}

bool Inbox::receive(ViewClient client, std::string_view text, std::vector<uint64_t>& skipped) {
    const json message = json::parse(text, nullptr, false);
    if (!message.is_object()) return true; // nothing that is understood
    try {
        const auto type = message.at("type").get<std::string>();
        const std::lock_guard lock(mutex_);
        const auto found = clients_.find(client);
        if (found == clients_.end()) return false;
        Client& from = found->second;
        if (type == "frame") {
            from.picture.reset(); // the page plays or has changed
            from.frames.push_back(frame_request(message));
            if (work_ == Work::frame && client == works_for_ && from.frames.back().budget < works_on_budget_)
                stop_work_ = true;
            for (; from.frames.size() > frames_waiting; from.frames.pop_front())
                skipped.push_back(from.frames.front().seq);
            arrived(false);
        } else if (type == "render") {
            from.picture = picture_request(message);
            arrived(false);
        } else if (type == "stop") {
            from.picture.reset();
            arrived(false);
        } else if (type == "series") {
            from.series = series_request(message);
            arrived(false);
        } else if (type == "rays") {
            from.rays = rays_request(message);
            arrived(false);
        } else if (type == "stop_series") {
            from.series.reset();
            arrived(false);
        } else if (auto change = change_request(type, message)) {
            const bool again = !changes_.empty() && change->kind == ChangeRequest::Kind::set &&
                               changes_.back().kind == change->kind && changes_.back().key == change->key;
            if (again) changes_.pop_back();
            if (changes_.size() >= changes_waiting) return false;
            changes_.push_back(*std::move(change));
            arrived(true);
        }
    } catch (const json::exception&) { // not of the protocol
    } catch (const Malformed&) {
    }
    return true;
}

void Inbox::wait(double seconds) {
    std::unique_lock lock(mutex_);
    something_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return fresh_ || ended_; });
    fresh_ = false;
}

std::vector<ViewClient> Inbox::take_new_clients() {
    const std::lock_guard lock(mutex_);
    std::vector<ViewClient> list;
    for (auto& [client, state] : clients_)
        if (std::exchange(state.is_new, false)) list.push_back(client);
    return list;
}

std::vector<ViewClient> Inbox::take_left_clients() {
    const std::lock_guard lock(mutex_);
    return std::exchange(left_, {});
}

std::vector<ChangeRequest> Inbox::take_changes() {
    const std::lock_guard lock(mutex_);
    std::vector<ChangeRequest> list(changes_.begin(), changes_.end());
    changes_.clear();
    return list;
}

std::optional<std::pair<ViewClient, ViewFrameRequest>> Inbox::take_frame() {
    const std::lock_guard lock(mutex_);
    const auto asks = [](const auto& entry) { return !entry.second.frames.empty(); };
    auto found = std::find_if(clients_.upper_bound(last_served_), clients_.end(), asks);
    if (found == clients_.end()) found = std::find_if(clients_.begin(), clients_.end(), asks);
    if (found == clients_.end()) return {};
    last_served_ = found->first;
    const ViewFrameRequest request = found->second.frames.front();
    found->second.frames.pop_front();
    return std::pair(found->first, request);
}

std::optional<std::pair<ViewClient, RaysRequest>> Inbox::take_rays() {
    const std::lock_guard lock(mutex_);
    for (auto& [client, state] : clients_)
        if (state.rays) return std::pair(client, *std::exchange(state.rays, {}));
    return {};
}

std::optional<std::pair<ViewClient, PictureRequest>> Inbox::picture() {
    const std::lock_guard lock(mutex_);
    for (const auto& [client, state] : clients_)
        if (state.picture) return std::pair(client, *state.picture);
    return {};
}

void Inbox::end_picture(ViewClient client, uint64_t seq) {
    const std::lock_guard lock(mutex_);
    const auto found = clients_.find(client);
    if (found != clients_.end() && found->second.picture && found->second.picture->seq == seq)
        found->second.picture.reset();
}

std::optional<std::pair<ViewClient, SeriesRequest>> Inbox::series() {
    const std::lock_guard lock(mutex_);
    for (const auto& [client, state] : clients_)
        if (state.series) return std::pair(client, *state.series);
    return {};
}

void Inbox::end_series(ViewClient client, uint64_t seq) {
    const std::lock_guard lock(mutex_);
    const auto found = clients_.find(client);
    if (found != clients_.end() && found->second.series && found->second.series->seq == seq)
        found->second.series.reset();
}

void Inbox::end_pictures() {
    const std::lock_guard lock(mutex_);
    for (auto& [client, state] : clients_) state.picture.reset();
}

void Inbox::begin_change() { begin(Work::change, 0, 0); }

void Inbox::begin_frame(ViewClient client, uint32_t budget) { begin(Work::frame, client, budget); }

void Inbox::begin_picture() { begin(Work::picture, 0, 0); }

void Inbox::begin(Work work, ViewClient client, uint32_t budget) {
    const std::lock_guard lock(mutex_);
    work_ = work;
    works_for_ = client;
    works_on_budget_ = budget;
    const bool frames =
        std::ranges::any_of(clients_, [](const auto& entry) { return !entry.second.frames.empty(); });
    stop_work_ = ended_ || (work != Work::change && !changes_.empty()) || (work == Work::picture && frames);
}

std::vector<ViewClient> Inbox::clients() {
    const std::lock_guard lock(mutex_);
    std::vector<ViewClient> list;
    for (const auto& [client, state] : clients_) list.push_back(client);
    return list;
}

void Inbox::end_all() {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    stop_work_ = true;
    something_.notify_one();
}

} // namespace marram
