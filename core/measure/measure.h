// SPDX-License-Identifier: Apache-2.0
// Speed against error: every dial of a scene through its settings.
#pragma once

#include "core/measure/report.h"
#include "core/shot/shot.h"

#include <atomic>
#include <mutex>
#include <string>
#include <utility>

namespace marram {

struct MeasureRequest {
    std::string scene; // file
    Overrides overrides;
    double frame = 0.0;
    double seconds = 110.0; // that it may take
    int threads = 1;        // for the report: the caller's arena has them
};

// What is being measured, and how much of the time has gone; read while it is measured.
class MeasureProgress {
  public:
    explicit MeasureProgress(double seconds);
    void now(std::string phase);
    std::pair<std::string, double> state() const; // phase, share of the time that has gone
    double left() const;                          // seconds

  private:
    mutable std::mutex mutex_;
    std::string phase_ = "loading";
    double begin_, seconds_;
};

// Adds one dial after the other to `measurement`. Throws Cancelled, and InputError where the scene cannot be built: what has been
// measured by then stays. `shot` is the request's scene.
void measure(Shot& shot, const MeasureRequest& request, MeasureProgress& progress,
             const std::atomic<bool>& cancel, Measurement& measurement);

} // namespace marram
