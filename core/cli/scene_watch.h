// SPDX-License-Identifier: Apache-2.0
// The scene of `marram render --watch`: read again when it, or a file that it names, has been saved.
#pragma once

#include "core/view/open_scene.h"

#include <atomic>
#include <mutex>
#include <string>
#include <thread>

namespace marram {

class SceneWatch {
  public:
    SceneWatch(std::string scene, Overrides overrides);

    // Reads all files again. Throws InputError with the mistakes, and Cancelled.
    Shot& load();

    // Set by an interrupt, and when a file of the scene has been saved since the last load(). Work on the
    // shot polls it.
    const std::atomic<bool>& stop() const { return stop_; }

    // Returns once stop() is set. False: by an interrupt.
    bool wait() const;

  private:
    void look(const std::stop_token& end);

    std::atomic<bool> stop_{false};
    OpenScene scene_;
    std::mutex guard_; // of scene_ while it loads, or its files are looked at
    std::jthread thread_;
};

} // namespace marram
