// SPDX-License-Identifier: Apache-2.0
#include "core/view/live_view.h"

#include "core/math/clock.h"
#include "core/math/own_library.h"
#include "core/scene/keyed_values.h"
#include "core/shot/settings.h"
#include "core/view/handles.h"
#include "core/view/looks.h"
#include "core/view/shown_wind.h"
#include "core/view/value_packing.h"

#include <fmt/format.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <iterator>
#include <random>
#include <thread>
#include <utility>

namespace marram {
namespace {

using nlohmann::json;

constexpr double file_check_pause = 0.25;        // s between checks of the scene's files
constexpr size_t max_mesh_triangles = 200'000;   // of a mesh on a page
constexpr size_t max_unread = size_t(256) << 20; // bytes that may wait before a frame is left out
constexpr size_t max_unsent = size_t(1)
                              << 20; // bytes that may wait before another state of a picture is sent

const ViewLibrary& library() {
    const char* const file = "libmarram_view.so";
    try {
        static const auto& loaded =
            load_own_library<ViewLibrary>(file, "marram_view_library", MARRAM_VERSION);
        return loaded;
    } catch (const std::runtime_error& error) {
        throw InputError({file},
                         std::string("the library of the live view cannot be loaded (") + error.what() + ")",
                         "build it with scenes/setup marram_view, or install Marram again");
    }
}

std::string new_token() {
    std::random_device random; // the system's
    std::string token;
    for (int i = 0; i < 4; ++i) token += fmt::format("{:08x}", random());
    return token;
}

std::shared_ptr<const std::string> text_of(const json& message) {
    return std::make_shared<std::string>(message.dump(-1, ' ', false, json::error_handler_t::replace));
}

// Strands as `marram bake` writes them: without motion, not traced, on growth surfaces; but those of a level of
// detail as the scene's camera sees them.
BuildSettings settings_to_play(const Shot& shot, double frame, double share, uint64_t memory,
                               const std::string& values = {}) {
    BuildSettings settings = build_settings(shot, frame);
    settings.memory.limit = memory;
    settings.share = share;
    settings.shutter_open = settings.shutter_close = 0.0;
    settings.trace_curves = false;
    settings.attributes = {"id"};
    if (!values.empty()) settings.attributes.push_back(values);
    return settings;
}

std::vector<Problem> scene_has_changed() {
    return InputError({"frames"}, "stopped, as the scene has changed", "render the rest again").problems;
}

} // namespace

LiveView::LiveView(ViewSettings settings)
    : settings_(std::move(settings)), token_(new_token()),
      scene_(settings_.scene, settings_.overrides, inbox_.stop_work()), problems_(problems_message({})) {
    ViewEvents events;
    events.joined = [this](ViewClient client) { inbox_.join(client); };
    events.left = [this](ViewClient client) { inbox_.leave(client); };
    events.message = [this](ViewClient client, const std::string& message) {
        std::vector<uint64_t> skipped;
        const bool good = inbox_.receive(client, message, skipped);
        for (const uint64_t seq : skipped)
            server_->send(client, text_of({{"type", "skipped"}, {"seq", seq}}), false);
        return good;
    };
    const ViewLibrary& found = library();
    try {
        server_ = found.start(settings_.port, token_, std::move(events));
    } catch (const std::runtime_error& error) {
        throw InputError({fmt::format("--port {}", settings_.port)},
                         std::string("cannot be listened to: ") + error.what(),
                         "choose another, or leave it out");
    }
}

LiveView::~LiveView() = default;

std::string LiveView::address() const {
    return fmt::format("http://127.0.0.1:{}/{}/", server_->port(), token_);
}

void LiveView::end() {
    ended_ = true;
    inbox_.end_all();
}

void LiveView::tell(ViewClient client, const json& message) {
    server_->send(client, text_of(message), false);
}

void LiveView::tell_all(const json& message) {
    const auto bytes = text_of(message);
    for (const auto& [client, sent] : sent_) server_->send(client, bytes, false);
}

bool LiveView::attempt(std::vector<Problem>& problems, const std::function<void()>& work) {
    const auto told = [&] {
        std::vector<Problem> all = change_problems_;
        all.insert(all.end(), frame_problems_.begin(), frame_problems_.end());
        return problems_message(all);
    };
    const json before = told();
    std::vector<Problem> found;
    try {
        work();
    } catch (const InputError& error) {
        found = error.problems;
    } catch (const Cancelled&) {
        return false;
    } catch (const std::exception& error) {
        Problem& problem = found.emplace_back();
        problem.place.file = settings_.scene;
        problem.what = error.what();
        problem.fix = "change the scene, or report it as a defect";
    }
    problems = std::move(found);
    problems_ = told();
    // The same mistake of another change is told again: its page waits for that.
    const bool again = !problems.empty() && &problems == &change_problems_;
    if (problems_ != before || again) tell_all(problems_);
    return problems.empty();
}

// The bounds of what a page shows, and the warnings of a frame.
void LiveView::evaluate_first_frame() {
    Shot& shot = *scene_.shot();
    const double first = shot.description.globals.vec2("frames").x();
    set_frame(shot, first);
    BuildStats stats;
    constexpr double some = 1e-3; // of the strands
    World world = build_world(shot.geometry, settings_to_play(shot, first, some, settings_.memory()),
                              inbox_.stop_work(), progress_, stats, std::exchange(kept_, {}));
    Box3f strands;
    for (const Box3f& box : stats.patch_bounds) strands.extend(box);
    const Box3f& box = strands.isEmpty() ? world.bounds : strands;
    bounds_ =
        box.isEmpty() ? json(nullptr) : json{{"lower", json_of(box.min())}, {"upper", json_of(box.max())}};
    build_warnings_ = stats.warnings;
    all_strands_ = all_strands(world);
    kept_ = kept_geometry(std::move(world));
}

json LiveView::scene_message() {
    const Shot& shot = *scene_.shot();
    const ParamSet& globals = shot.description.globals;
    const Vec2d frames = globals.vec2("frames");
    std::vector<std::string> warnings;
    for (const auto& some : {warnings_of(shot), light_warnings_of(shot), build_warnings_})
        for (const Problem& warning : some) warnings.push_back(to_string(warning));
    std::vector<std::string> layers;
    for (const BuiltInLayer& layer : built_in_layers()) layers.emplace_back(layer.name);
    json changes = json::array();
    for (const auto& [key, value] : scene_.changed()) changes.push_back(key + "=" + value);
    return {{"type", "scene"},
            {"revision", scene_.revision()},
            {"file", std::filesystem::absolute(scene_.file()).string()},
            {"fps", globals.number("fps")},
            {"frames", {frames.x(), frames.y()}},
            {"camera", camera_message(shot, frames.x())},
            {"exposure", values_at(shot.description.film, frames.x()).number("exposure")},
            {"light", light_of(shot)},
            {"layers", layers},
            {"bounds", bounds_},
            {"groups", parameter_groups(shot, scene_.changed())},
            {"handles", handles_of(shot)},
            {"values", drawable_values(shot)},
            {"changes", changes},
            {"undo", scene_.can_undo()},
            {"redo", scene_.can_redo()},
            {"warnings", warnings}};
}

void LiveView::welcome(ViewClient client) {
    sent_[client] = {};
    if (scene_.shot()) tell(client, scene_message());
    tell(client, problems_);
}

void LiveView::load() {
    kept_ = {};
    picture_.reset();
    if (!attempt(change_problems_, [&] { scene_.load(); })) return;
    end_series(scene_has_changed());
    bounds_are_due_ = !attempt(frame_problems_, [&] { evaluate_first_frame(); });
    tell_all(scene_message());
}

void LiveView::change(const ChangeRequest& change) {
    using Kind = ChangeRequest::Kind;
    switch (change.kind) {
    case Kind::set:
        return scene_.set(change.key, change.value, change.gesture);
    case Kind::undo:
        return scene_.undo();
    case Kind::redo:
        return scene_.redo();
    case Kind::reset:
        return scene_.reset();
    case Kind::reload:
        return scene_.load();
    case Kind::save:
        scene_.save();
        tell_all({{"type", "saved"}, {"file", scene_.file()}});
        return;
    }
}

void LiveView::handle(std::vector<ChangeRequest> changes) {
    if (changes.empty()) return;
    inbox_.end_pictures();
    free_picture();
    picture_.reset();
    const uint64_t before = scene_.revision(), loads = scene_.loads();
    for (const ChangeRequest& request : changes) attempt(change_problems_, [&] { change(request); });
    if (scene_.revision() == before) return;
    end_series(scene_has_changed());
    if (scene_.loads() != loads) {
        kept_ = {};
        bounds_are_due_ = true;
    }
    if (bounds_are_due_) bounds_are_due_ = !attempt(frame_problems_, [&] { evaluate_first_frame(); });
    tell_all(scene_message());
}

void LiveView::send_meshes(ViewClient client, SentState& sent, const World& world, WireMessage& frame) {
    const size_t count = world.meshes.size();
    drawn_.resize(count);
    std::vector<std::pair<uint64_t, uint64_t>> now(count);
    bool same_meshes = sent.meshes.size() == count && sent.revision == scene_.revision();
    for (size_t i = 0; i < count; ++i) {
        const MeshGeometry& mesh = world.meshes[i];
        if (drawn_[i].topology != topology_of(mesh)) drawn_[i] = drawn_mesh(mesh, max_mesh_triangles);
        now[i] = {drawn_[i].number, mesh.digest};
        same_meshes = same_meshes && sent.meshes[i].first == now[i].first;
    }
    frame.header["meshes"] = json::array();
    if (!same_meshes) {
        std::vector<Vec3f> colors;
        for (const MeshGeometry& mesh : world.meshes)
            colors.push_back(mesh_color(*scene_.shot(), mesh.material));
        WireMessage message = meshes_message(world.meshes, drawn_, colors);
        message.header["revision"] = scene_.revision();
        server_->send(client, to_bytes(message), true);
    } else {
        for (size_t i = 0; i < count; ++i) {
            if (now[i].second != 0 && now[i].second == sent.meshes[i].second) continue;
            json moved = add_mesh_positions(world.meshes[i], drawn_[i], frame);
            moved["index"] = i;
            frame.header["meshes"].push_back(std::move(moved));
        }
    }
    sent.meshes = std::move(now);
}

void LiveView::answer(ViewClient client, SentState& sent, const ViewFrameRequest& request, const World& world,
                      double chain_ms) {
    const double begin = wall_seconds();
    WireMessage frame;
    send_meshes(client, sent, world, frame);
    const uint64_t layout = layout_digest(world);
    if (!sent.strands || sent.strands->layout != layout || sent.strands->budget != request.budget ||
        sent.revision != scene_.revision()) {
        sent.strands = select_strands(world, request.budget, layout);
        sent.selection = ++last_selection_;
        std::vector<StrandColors> colors;
        for (const CurveGeometry& curves : world.curves)
            colors.push_back(strand_colors(*scene_.shot(), curves.material));
        server_->send(client, to_bytes(strands_message(world, *sent.strands, sent.selection, colors)), true);
    }
    sent.revision = scene_.revision();
    add_strand_positions(world, *sent.strands, request.floats, frame);
    if (!request.values.empty()) add_values(world, *sent.strands, drawn_, request.values, frame);
    if (request.air) add_air(*scene_.shot(), *request.air, frame);
    if (request.gusts) frame.header["gusts"] = gusts_message(*scene_.shot());
    frame.header["type"] = "frame";
    frame.header["seq"] = request.seq;
    frame.header["frame"] = request.frame;
    frame.header["revision"] = sent.revision;
    frame.header["selection"] = sent.selection;
    frame.header["chain_ms"] = chain_ms;
    frame.header["other_ms"] = 1e3 * (wall_seconds() - begin);
    server_->send(client, to_bytes(frame), true);
}

void LiveView::serve_frame(ViewClient client, const ViewFrameRequest& request) {
    const auto found = sent_.find(client);
    if (found == sent_.end()) return;
    bool answered = false;
    free_picture();
    const bool reads = server_->unsent_bytes(client) < max_unread; // else it asks faster than it takes
    if (scene_.shot() && reads)
        attempt(frame_problems_, [&] {
            Shot& shot = *scene_.shot();
            const double begin = wall_seconds();
            set_frame(shot, request.frame);
            BuildStats stats;
            const double share = share_for(request.budget, all_strands_);
            const BuildSettings settings =
                settings_to_play(shot, request.frame, share, settings_.memory(), request.values);
            World world = build_world(shot.geometry, settings, inbox_.stop_work(), progress_, stats,
                                      std::exchange(kept_, {}));
            all_strands_ = all_strands(world);
            answer(client, found->second, request, world, 1e3 * (wall_seconds() - begin));
            answered = true;
            kept_ = kept_geometry(std::move(world));
        });
    if (!answered) tell(client, {{"type", "skipped"}, {"seq", request.seq}});
}

// The strands at rest have the same order as those that the page was sent.
void LiveView::serve_rays(ViewClient client, const RaysRequest& request) {
    const auto found = sent_.find(client);
    if (found == sent_.end() || !scene_.shot() || found->second.selection != request.selection) return;
    const StrandSelection& strands = *found->second.strands;
    const std::optional<uint32_t> strand = strand_of(strands, request.part, request.vertex);
    if (!strand) return;
    free_picture();
    attempt(frame_problems_, [&] {
        Shot& shot = *scene_.shot();
        set_frame(shot, request.frame);
        BuildSettings settings = settings_to_play(
            shot, request.frame, share_for(strands.budget, all_strands_), settings_.memory(), "root_normal");
        settings.stage = MARRAM_REST;
        BuildStats stats;
        World world = build_world(shot.geometry, settings, inbox_.stop_work(), progress_, stats,
                                  std::exchange(kept_, {}));
        if (layout_digest(world) == strands.layout) {
            json message = rays_message(shot, world, request.part, *strand);
            message["seq"] = request.seq;
            tell(client, message);
        }
        kept_ = kept_geometry(std::move(world));
    });
}

void LiveView::free_picture() {
    if (!picture_) return;
    KeptGeometry geometry = picture_->take_geometry();
    if (geometry.device) kept_ = std::move(geometry);
}

// If the last one is not on its way yet, the line is slow: this one is left out.
void LiveView::send_picture() {
    if (server_->unsent_bytes(picture_->client()) < max_unsent)
        server_->send(picture_->client(), to_bytes(picture_->message()), true);
}

void LiveView::work_on_picture(ViewClient client, const PictureRequest& request) {
    if (!scene_.shot()) return inbox_.end_picture(client, request.seq);
    if (!picture_ || picture_->client() != client || picture_->request().seq != request.seq) {
        free_picture();
        picture_.emplace(client, request, request.budget > 0 ? share_for(request.budget, all_strands_) : 0.0);
    }
    bool done = false, stopped = false;
    const bool good = attempt(frame_problems_, [&] {
        done = picture_->work(*scene_.shot(), std::exchange(kept_, {}), settings_.memory(),
                              inbox_.stop_work(), progress_, [&] { send_picture(); });
        stopped = !done;
    });
    if (done)
        tell(client, {{"type", "render_done"},
                      {"seq", request.seq},
                      {"samples", picture_->samples()},
                      {"seconds", picture_->seconds()}});
    if (done || (!good && !inbox_.stop_work())) {
        inbox_.end_picture(client, request.seq);
        free_picture();
        picture_.reset();
    }
}

void LiveView::end_series(const std::vector<Problem>& problems) {
    if (!series_) return;
    json message = series_->end();
    message["problems"] = problems_message(problems)["problems"];
    tell(series_->client(), message);
    inbox_.end_series(series_->client(), series_->request().seq);
    series_.reset();
}

void LiveView::work_on_series(ViewClient client, const SeriesRequest& request) {
    const auto refuse = [&](const std::vector<Problem>& problems) {
        if (series_) return end_series(problems);
        tell(client, {{"type", "series_done"},
                      {"seq", request.seq},
                      {"pictures", 0},
                      {"problems", problems_message(problems)["problems"]}});
        inbox_.end_series(client, request.seq);
    };
    free_picture();
    try {
        if (!scene_.shot())
            throw InputError({scene_.file()}, "the scene is not loaded", "correct its mistakes first");
        if (!series_)
            series_.emplace(client, request, *scene_.shot(), scene_.file(), scene_.settings(),
                            inbox_.stop_work());
        const size_t before = series_->saved();
        series_->work(*scene_.shot(), kept_, settings_.threads, settings_.memory(),
                      [&] { tell(client, series_->progress()); });
        if (series_->saved() > before) server_->send(client, to_bytes(series_->last_picture()), true);
        if (series_->done()) end_series({});
    } catch (const Cancelled&) { // it goes on later
    } catch (const InputError& error) {
        refuse(error.problems);
    } catch (const std::exception& error) {
        refuse(
            InputError({scene_.file()}, error.what(), "change the scene, or report it as a defect").problems);
    }
}

// Tells pages what takes long.
void LiveView::show_progress(const std::stop_token& end) {
    constexpr double patience = 0.4; // s
    const auto tell_each = [&](const json& message) {
        const auto bytes = text_of(message);
        for (const ViewClient client : inbox_.clients()) server_->send(client, bytes, false);
    };
    bool shown = false;
    while (!end.stop_requested()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        const double since = busy_since_;
        const bool shows = since > 0.0 && wall_seconds() - since > patience;
        if (shows)
            tell_each({{"type", "progress"},
                       {"phase", progress_.phase.load()},
                       {"fraction", progress_.fraction.load()}});
        else if (shown)
            tell_each({{"type", "progress"}, {"phase", ""}, {"fraction", -1.0}});
        shown = shows;
    }
}

// One piece of work. False: there is none.
bool LiveView::work() {
    for (const ViewClient client : inbox_.take_left_clients()) sent_.erase(client);
    for (const ViewClient client : inbox_.take_new_clients()) welcome(client);
    if (std::vector<ChangeRequest> changes = inbox_.take_changes(); !changes.empty()) {
        inbox_.begin_change();
        handle(std::move(changes));
        return true;
    }
    if (wall_seconds() >= next_file_check_) {
        next_file_check_ = wall_seconds() + file_check_pause;
        if (scene_.files_changed()) {
            inbox_.begin_change();
            inbox_.end_pictures();
            load();
            return true;
        }
    }
    if (const auto frame = inbox_.take_frame()) {
        inbox_.begin_frame(frame->first, frame->second.budget);
        serve_frame(frame->first, frame->second);
        return true;
    }
    if (const auto rays = inbox_.take_rays()) {
        inbox_.begin_frame(rays->first, 0);
        serve_rays(rays->first, rays->second);
        return true;
    }
    const auto series = inbox_.series();
    if (series_ &&
        (!series || series->first != series_->client() || series->second.seq != series_->request().seq))
        series_.reset(); // its page has stopped it, or left
    if (const auto picture = inbox_.picture()) {
        inbox_.begin_picture();
        busy_since_ = 0.0; // its own samples show the progress
        work_on_picture(picture->first, picture->second);
        return true;
    }
    if (series) {
        inbox_.begin_picture();
        work_on_series(series->first, series->second);
        return true;
    }
    return false;
}

void LiveView::run() {
    const std::jthread progress([this](const std::stop_token& end) { show_progress(end); });
    tbb::task_arena arena(settings_.threads);
    arena.execute([&] {
        inbox_.begin_change();
        busy_since_ = wall_seconds();
        load();
        while (!ended_) {
            busy_since_ = wall_seconds();
            const bool worked = work();
            busy_since_ = 0.0;
            if (!worked) inbox_.wait(file_check_pause);
        }
    });
}

} // namespace marram
