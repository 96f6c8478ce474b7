// SPDX-License-Identifier: Apache-2.0
// The chain of stages that a patch of strands runs through, in the talk's order:
//
//     gusts, shielding (both set the envelope) -> bend -> jiggle -> collision
//
// To add a stage: a function on Strands in a file of its own, its line in run_chain, its clock in StageClock, its parameters in
// a list of its own that wind_params() joins to the others.
#pragma once

#include "core/math/clock.h"
#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <functional>

namespace marram {

// Thread seconds spent in each stage.
struct StageClock {
    double expand = 0.0, gusts = 0.0, shield = 0.0, bend = 0.0, jiggle = 0.0, collide = 0.0, write = 0.0;

    StageClock& operator+=(const StageClock& other);
};

// Adds the time between construction and destruction to a counter.
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

// What all patches of a frame share; made once a frame. Borrows what it points to.
struct ChainFrame {
    const Wind* wind = nullptr;
    const Ramp* point_envelope = nullptr; // the groom's own, over u
    MarramFrame frame{};
    const MarramMesh* skin = nullptr;      // nullptr: strands grow on nothing
    std::span<const float> radius_profile; // [cvs], of a strand 1 wide, where strands are not irregular
    MarramBasis basis = MARRAM_BSPLINE;
    struct Instant {
        Colliders colliders;
        std::vector<double> obstacle_heights; // where shielding asks for them
        GustField gusts;
    };
    std::vector<Instant> instants;     // [motion sample]
    JiggleWindow window;               // empty: strands do not jiggle
    std::vector<GustField> past_gusts; // [knot of the window]

    size_t gust_bytes() const;
};

struct ChainInput {
    const Wind& wind;
    const Ramp& point_envelope;
    const MarramFrame& frame;
    const MarramMesh* skin; // nullptr: strands grow on nothing
    std::span<const float> radius_profile;
    MarramBasis basis;
    JiggleWindow window{};
    Eigen::AlignedBox3d reach =
        everywhere(); // holds every strand at every motion sample, whatever the wind does
    Eigen::AlignedBox3d rest =
        everywhere();               // holds every rest CV at every motion sample and knot of the window
    ColliderTrees* trees = nullptr; // of the frame before, to go on with where colliders rest
};
ChainFrame make_chain_frame(const ChainInput& input);

// What a thread keeps from patch to patch.
struct ChainScratch {
    CollideScratch collide;
    JiggleFilter filter;
    Strands past;
    std::vector<WideVector<Wide3f>> jiggled; // [motion sample]
    CollisionCounts counts;
    StageClock clock;
};

// Fills the rest strands (rest, rest_normal, anchor, root_normal, width) of the patch at a motion sample, or at a knot of the
// jiggle's window.
struct Expand {
    std::function<void(uint32_t time, Strands&)> at_time;
    std::function<void(int64_t knot, Strands&)> at_knot;
    // Whether they are at a knot what they were at the one before, as on a skin that rests. May be empty: never.
    std::function<bool(int64_t knot)> as_before{};
};

// Where the chain jiggles: the patch's poses at all motion samples, from the bends of the past, into scratch.jiggled. What
// shelters a strand is taken as it is at the first motion sample: exact where the colliders rest. Where the edge of a shelter
// moves, the strands that it has passed while they still remember, some 1 / (damping omega) seconds, are off: for an obstacle
// that crosses the wind at 1 m/s, at 3 Hz and damping 0.3, a third of the strands behind it by more than 1 % of their length, the
// worst by all of it, by a quarter where a cone of 10 degrees softens the edge (tests/chain/shelter_test.cpp prints more). Then
// run_chain() is called for each sample.
void jiggle_patch(const ChainFrame& chain, const Expand& expand, Strands& strands, ChainScratch& scratch);

// strands as expanded at motion sample `time` -> pose, pose_normal, envelope, gust, shield. Where the wind has no strength the
// pose is the rest pose bit for bit, collision aside.
void run_chain(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch);

// Its last stage alone: pose -> pose, where the scene asks for collision and the frame for its final stage.
void collide_pose(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch);

} // namespace marram
