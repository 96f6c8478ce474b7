// SPDX-License-Identifier: Apache-2.0
// Wall time.
#pragma once

#include <chrono>

namespace marram {

// Seconds on a monotonic clock.
inline double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Adds the time from its construction to its destruction to a sum.
class StageTimer {
  public:
    explicit StageTimer(double& seconds) : seconds_(seconds), begin_(wall_seconds()) {}
    ~StageTimer() { seconds_ += wall_seconds() - begin_; }
    StageTimer(const StageTimer&) = delete;
    StageTimer& operator=(const StageTimer&) = delete;

  private:
    double& seconds_;
    double begin_;
};

} // namespace marram
