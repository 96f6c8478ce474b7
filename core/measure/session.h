// SPDX-License-Identifier: Apache-2.0
// What the parts of a measurement share: the request, the time that is left, and a scene loaded with changes.
#pragma once

#include "core/measure/measure.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

namespace marram {

struct Session {
    const MeasureRequest& request;
    double frame;
    MeasureProgress& progress;
    const std::atomic<bool>& cancel;
    std::vector<std::string> thinned = {}; // changes that reduce the number of strands
};

// A time limit, at most what is left for all dials. Within 10 ms after it, or after the caller cancels,
// stop() becomes true, and work that polls it throws Cancelled.
class TimeLimit {
  public:
    TimeLimit(const Session& session, double seconds)
        : session_(session), left_after_(std::max(session.progress.left() - seconds, 0.0)),
          watch_([this](const std::stop_token& end) {
              while (!end.stop_requested() && !stop_.load()) {
                  if (session_.cancel.load() || left() <= 0.0) stop_ = true;
                  std::this_thread::sleep_for(std::chrono::milliseconds(10));
              }
          }) {}

    const std::atomic<bool>& stop() const { return stop_; }
    double left() const { return session_.progress.left() - left_after_; }

    // Does the work if there is time. Returns whether it ended. Throws Cancelled only if the caller cancels.
    template <typename Work>
    bool in_time(const Work& work) const {
        if (session_.cancel.load()) throw Cancelled{};
        if (left() <= 0.0) return false;
        try {
            work();
        } catch (const Cancelled&) {
            if (session_.cancel.load()) throw;
            return false;
        }
        return true;
    }

  private:
    const Session& session_;
    double left_after_; // seconds left for all dials when this limit is reached
    std::atomic<bool> stop_ = false;
    std::jthread watch_; // the last member: it reads the others
};

// `stop` is read by the scene's procedurals as long as they live.
inline Shot load_with(const MeasureRequest& request, const std::atomic<bool>& stop,
                      const std::vector<std::string>& changes) {
    Overrides overrides = request.overrides;
    overrides.settings.insert(overrides.settings.end(), changes.begin(), changes.end());
    return load_shot(request.scene, overrides, stop);
}

} // namespace marram
