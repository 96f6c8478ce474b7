// SPDX-License-Identifier: Apache-2.0
// The chain of stages that a patch of strands runs through, in the talk's order.
//
// To add a stage: a function on Strands in a file of its own, its line in run_chain, its clock in StageClock, its parameters in
// a list of its own that wind_params() joins to the others.
#pragma once

#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <chrono>

namespace marram {

// Thread seconds spent in each stage.
struct StageClock {
    double expand = 0.0, shield = 0.0, bend = 0.0, collide = 0.0, write = 0.0;

    StageClock& operator+=(const StageClock& other) {
        expand += other.expand;
        shield += other.shield;
        bend += other.bend;
        collide += other.collide;
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

// What all patches of a frame share; made once a frame.
struct ChainFrame {
    const Wind* wind = nullptr;
    const Ramp* point_envelope = nullptr; // the groom's own, over u
    MarramFrame frame{};
    const MarramMesh* skin = nullptr;
    std::span<const float> radius_profile; // [cvs], of a strand 1 wide
    MarramBasis basis = MARRAM_BSPLINE;
    struct Instant {
        Colliders colliders;
        std::vector<double> obstacle_heights; // where shielding asks for them
    };
    std::vector<Instant> instants; // [motion sample]
};

ChainFrame make_chain_frame(const Wind& wind, const Ramp& point_envelope, const MarramFrame& frame,
                            const MarramMesh& skin, std::span<const float> radius_profile, MarramBasis basis);

// What a thread keeps from patch to patch.
struct ChainScratch {
    CollideScratch collide;
    CollisionCounts counts;
    StageClock clock;
};

// strands.rest, rest_normal, anchor, root_normal, width -> pose, pose_normal, envelope, shield at motion sample `time`.
// Where the wind has no strength the pose is the rest pose bit for bit, collision aside.
void run_chain(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch);

} // namespace marram
