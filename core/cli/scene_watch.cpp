// SPDX-License-Identifier: Apache-2.0
#include "core/cli/scene_watch.h"

#include "core/cli/interrupt.h"
#include "core/math/clock.h"

#include <chrono>
#include <utility>

namespace marram {
namespace {

constexpr double between_looks = 0.25; // s between two looks at the scene's files
constexpr auto between_polls = std::chrono::milliseconds(20);

// A render keeps the states of simulations beside the scene, with and without --watch.
Overrides with_state_folder(Overrides overrides, const std::string& scene) {
    if (overrides.state_folder.empty()) overrides.state_folder = default_state_folder(scene);
    return overrides;
}

} // namespace

SceneWatch::SceneWatch(std::string scene, Overrides overrides)
    : scene_(scene, with_state_folder(std::move(overrides), scene), stop_),
      thread_([this](const std::stop_token& end) { look(end); }) {}

Shot& SceneWatch::load() {
    const std::lock_guard lock(guard_);
    stop_ = false; // look() sets it again after an interrupt
    scene_.load();
    return *scene_.shot();
}

bool SceneWatch::wait() const {
    while (!stop_) std::this_thread::sleep_for(between_polls);
    return !interrupted();
}

void SceneWatch::look(const std::stop_token& end) {
    for (double next = 0.0; !end.stop_requested(); std::this_thread::sleep_for(between_polls)) {
        if (interrupted()) stop_ = true;
        if (wall_seconds() < next) continue;
        const std::unique_lock lock(guard_, std::try_to_lock); // interrupts are passed on during a load, too
        if (!lock) continue;
        next = wall_seconds() + between_looks;
        if (scene_.files_changed()) stop_ = true;
    }
}

} // namespace marram
