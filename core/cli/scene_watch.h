// SPDX-License-Identifier: Apache-2.0
// The scene of `marram render --watch`: read again when it, or a file that it names, has been saved. A thread
// looks at the files; the functions are called from one other thread.
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

    // Reads all files again, after which the last Shot is gone. Clears stop(). Throws InputError, which lists
    // all mistakes, and Cancelled, if an interrupt comes.
    Shot& load();

    // Set by an interrupt, and when a file of the scene has been saved since the last load(). Work on the
    // shot polls it.
    const std::atomic<bool>& stop() const { return stop_; }

    // Returns once stop() is set. True: a file was saved; false: an interrupt.
    bool wait() const;

  private:
    void look(const std::stop_token& end);

    std::atomic<bool> stop_{false};
    OpenScene scene_;
    std::mutex guard_;    // of scene_ while it loads, or its files are looked at
    std::jthread thread_; // of look(); last, so that it ends before the rest
};

} // namespace marram
