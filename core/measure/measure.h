// SPDX-License-Identifier: Apache-2.0
// Measures time and error of every setting of every dial of a scene.
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
    double seconds = 110.0;  // time budget
    int rounds = 7;          // at most so many measurements of each setting; the median counts
    int threads = 1;         // only for the report: the caller's arena sets the number
    double bend_speed = 0.0; // m/s: the largest at which blades are measured; 0: the largest of the scene
};

// What is being measured, and the share of the time used; may be read while measuring.
class MeasureProgress {
  public:
    explicit MeasureProgress(double seconds);
    virtual ~MeasureProgress() = default;
    void now(std::string phase);
    std::pair<std::string, double> state() const; // phase, share of the time used
    // Seconds left; called from other threads too. When there are none, measuring ends. A test can override
    // it.
    virtual double left() const;

  private:
    mutable std::mutex mutex_;
    std::string phase_ = "loading";
    double begin_, seconds_;
};

// Measures the dials one by one and adds them to `measurement`. `shot` is the request's scene. Settings for
// which progress.left() is too little are refused: their work is stopped, as by `cancel`. Throws Cancelled if
// `cancel` is set, and InputError if the scene cannot be built; the dials already measured stay.
void measure(const Shot& shot, const MeasureRequest& request, MeasureProgress& progress,
             const std::atomic<bool>& cancel, Measurement& measurement);

} // namespace marram
