// SPDX-License-Identifier: Apache-2.0
// Filters the strands of one patch: they follow their bent pose as damped oscillators (jiggle.h, jiggle_step.h).
//
//     filter.begin(jiggle, window, fps, cvs, blocks);
//     for (each time of the frame) {
//         filter.advance(state, phase, time, bent);
//         filter.emit(state, time, strands at that time, bent, pose);
//     }
//
// Where frequency or damping have keys, a step has those at its middle: the error falls with the square of
// the step. (A spring whose stiffness changes keeps its velocity.)
//
// What it costs: a bent pose for each past sample that the state has not passed yet, and about 4 ns a CV for
// it.
#pragma once

#include "procedural/wind/jiggle.h"
#include "procedural/wind/jiggle_step.h"
#include "procedural/wind/strands.h"

#include <array>
#include <functional>

namespace marram {

// The state of the strands of one patch at a past sample. If it is kept until the next frame, that goes on from
// it; if not, the frame has the same bits, later. 100 bytes a CV.
struct JiggleState {
    struct Target {
        int64_t sample = 0;
        bool known = false;      // `pose` is that of `sample`
        WideVector<Wide3f> pose; // [blocks * cvs]
    };
    bool kept = false, in_use = false; // for the owner, who keeps it from frame to frame
    bool begun = false;
    JiggleRun run;
    int64_t sample = 0;               // of lag and velocity
    double frequency = 0.0;           // Hz, that velocities refer to, if it has keys
    WideVector<Wide3d> lag, velocity; // [blocks * cvs]
    std::array<Target, 4> targets;    // those read last
    WideVector<VFloat> shield;        // [blocks * cvs]: the shelter that they were bent in

    void forget() { // its memory is kept
        begun = false;
        shield.clear();
        for (Target& target : targets) target.known = false;
    }
    size_t bytes() const;
};

// Sets `pose` [blocks * cvs] to the bent pose at a past sample.
using BentPoseAt = std::function<void(int64_t past_sample, WideVector<Wide3f>& pose)>;

// One for each thread, and a state for each patch; `bent` is called by the calling thread. Frames may come
// in any order: one before the state's sample begins the run again. Reusable: buffers are kept between
// patches.
class JiggleFilter {
  public:
    // u: [blocks * cvs] if the segments of a strand differ in length, else empty.
    void begin(const Jiggle& jiggle, const JiggleWindow& window, double fps, int cvs, int blocks,
               std::span<const VDouble> u = {});

    // Moves the state on to the past sample before `frame`, which begins a run if need be.
    void advance(JiggleState& state, uint32_t phase, double frame, const BentPoseAt& bent);

    // The pose at `frame`, which is within one past sample of the state's. From the root, offsets are those
    // of the cubic plus the lag; each segment takes its direction from them, its length and the root from
    // now.rest. Positions are rounded once. A strand whose target has not moved and that is at rest is
    // copied from the target bit for bit. Before jiggle.start_frame the pose is now.pose.
    void emit(JiggleState& state, double frame, const Strands& now, const BentPoseAt& bent,
              WideVector<Wide3f>& pose);

  private:
    using Four = std::array<const WideVector<Wide3f>*, 4>;
    Four targets(JiggleState& state, int64_t sample, int64_t size, const BentPoseAt& bent) const;
    void advance_by_one_step(JiggleState& state, const BentPoseAt& bent);
    void begin_step(JiggleState& state, int64_t size);
    void set_steps(size_t level, double samples);
    double radians_at(double u, double samples) const;
    VDouble radians_at(const VDouble& u, double samples) const;

    Jiggle jiggle_;
    JiggleWindow window_;
    double frequency_ = 0.0, damping_ = 0.0; // Hz and ratio; with keys, of the current step
    double fps_ = 24.0;
    int cvs_ = 0, blocks_ = 0;
    size_t levels_ = 1;
    std::vector<JiggleStep<double>> steps_,
        part_;              // [level * cvs + k]; [k]: for the part of a step at `frame`
    WideVector<VDouble> u_; // if the stiffness at CV k differs between strands, else empty
    WideVector<JiggleStep<VDouble>> wide_steps_,
        wide_part_; // used instead in that case: [(level * blocks + b) * cvs + k]
};

// Normals of jiggled oriented strands: now.pose_normal, rotated segment by segment by the shortest arc from
// now.pose (both bent, at the time of the pose) to `pose`. A segment that has not moved keeps its normal bit
// for bit.
void jiggle_normals(const Strands& now, const WideVector<Wide3f>& pose, WideVector<Wide3f>& normals);

} // namespace marram
