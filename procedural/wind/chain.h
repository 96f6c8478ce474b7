// SPDX-License-Identifier: Apache-2.0
// The chain of stages that a patch of strands runs through, in the talk's order.
//
// To add a stage: a function on Strands in a file of its own, its line in run_chain, its clock in StageClock, its parameters in
// wind.cpp in place of the MARRAM_UNAVAILABLE entry.
#pragma once

#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <chrono>

namespace marram {

// Thread seconds spent in each stage.
struct StageClock {
    double expand = 0.0, bend = 0.0, write = 0.0;

    StageClock& operator+=(const StageClock& other) {
        expand += other.expand;
        bend += other.bend;
        write += other.write;
        return *this;
    }
};

// Adds the time between construction and destruction to a counter.
class StageTimer {
  public:
    explicit StageTimer(double& seconds) : seconds_(seconds), begin_(std::chrono::steady_clock::now()) {}
    ~StageTimer() {
        seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    }
    StageTimer(const StageTimer&) = delete;
    StageTimer& operator=(const StageTimer&) = delete;

  private:
    double& seconds_;
    std::chrono::steady_clock::time_point begin_;
};

// strands.rest, rest_normal, anchor -> pose, pose_normal, envelope at `frame`. `point_envelope` is the groom's own, over u.
// Where the wind has no strength the pose is the rest pose bit for bit.
void run_chain(const Wind& wind, const Ramp& point_envelope, double frame, double fps, MarramStage stage,
               Strands& strands, StageClock& clock);

} // namespace marram
