// SPDX-License-Identifier: Apache-2.0
// The chain of stages that processes a patch of strands, in the talk's order:
//
//     gusts, shielding (both set the envelope) -> bend -> jiggle -> collision
//
// To add a stage: <stage>.{h,cpp} with its settings, <stage>_params(), read_<stage>() and a function on
// Strands; its settings in Wind (wind.h); its parameters and its reader in wind_params() and read_wind()
// (wind.cpp); its call in run_chain(), or in bend_at() if jiggle needs it in the past, too; a member of
// StageClock and its row in stages() (chain.cpp), from which its statistics come; its words in
// wind_summary() (strands/wind_words.cpp).
#pragma once

#include "core/math/clock.h"
#include "procedural/wind/blade/blade.h"
#include "procedural/wind/canopy.h"
#include "procedural/wind/jiggle_filter.h"
#include "procedural/wind/past_wind.h"
#include "procedural/wind/strands.h"
#include "procedural/wind/wind.h"

#include <functional>
#include <memory>

namespace marram {

// Thread seconds spent in each stage.
struct StageClock {
    double expand = 0.0, gusts = 0.0, shield = 0.0, bend = 0.0, jiggle = 0.0, collide = 0.0;

    // How statistics name a stage.
    struct Stage {
        double StageClock::*seconds;
        const char *path, *help;
    };
    static std::span<const Stage> stages();
    StageClock& operator+=(const StageClock& other) {
        for (const Stage& stage : stages()) this->*stage.seconds += other.*stage.seconds;
        return *this;
    }
};

// Data shared by all patches of a frame; made once a frame. Holds pointers to data of the caller.
struct ChainFrame {
    const Wind* wind = nullptr;
    const Ramp* point_envelope = nullptr; // envelope of the groom, over u, unless the wind has it
    MarramFrame frame{};
    const MarramMesh* skin = nullptr;      // nullptr: strands grow on no mesh
    std::span<const float> radius_profile; // [cvs], of a strand of width 1; used if strands are not irregular
    MarramBasis basis = MARRAM_BSPLINE;
    struct Instant {
        Colliders colliders;
        std::vector<double> obstacle_heights; // if shielding uses wake_heights
        WindAt wind;
    };
    std::vector<Instant> instants;       // [motion sample]
    JiggleWindow window;                 // empty: strands do not jiggle
    std::shared_ptr<PastWind> past_wind; // nullptr: the same at all times
    std::shared_ptr<GroundAir> ground;   // of wind->over
    const Canopy* canopy = nullptr;      // that the strands stand in
    const Blade* blade = nullptr;        // that they bend as, instead of as the talk's strands

    size_t gust_bytes() const;
};

struct ChainInput {
    const Wind& wind;
    const Ramp& point_envelope;
    const MarramFrame& frame;
    const MarramMesh* skin; // nullptr: strands grow on no mesh
    std::span<const float> radius_profile;
    MarramBasis basis;
    JiggleWindow window{};
    Eigen::AlignedBox3d query_bounds =
        everywhere(); // contains every strand at every motion sample, in any wind
    Eigen::AlignedBox3d rest =
        everywhere(); // contains every rest CV at every motion sample and past sample of the window
    ColliderTrees* trees = nullptr;      // of the previous frame; reused if the colliders have not changed
    PastWind* past_wind = nullptr;       // of the previous frame; the new one takes over what it has made
    std::shared_ptr<GroundAir> ground{}; // of wind.over
    const Canopy* canopy = nullptr;
    const Blade* blade = nullptr;
};
ChainFrame make_chain_frame(const ChainInput& input);

// Per-thread buffers, kept from patch to patch.
struct ChainScratch {
    CollideScratch collide;
    JiggleFilter filter;
    Strands past;
    JiggleState state, later;                // used if the caller keeps none; after the first motion sample
    std::vector<WideVector<Wide3f>> jiggled; // [motion sample]
    CollisionCounts counts;
    uint64_t unsolved_blades = 0; // bent poses
    StageClock clock;
};

// Fills the rest strands (rest, rest_normal, noise_origin, root_normal, width) of the patch at a motion
// sample or at a past sample of the jiggle window.
struct RestStrandSource {
    std::function<void(uint32_t time, Strands&)> at_time;
    std::function<void(int64_t past_sample, Strands&)> at_past_sample;
    // The strands in the bind pose; only `u` is read. May be empty if strands are not irregular.
    std::function<void(Strands&)> at_bind{};
    // True: they are the same at both past samples. May be empty: never.
    std::function<bool(int64_t, int64_t)> same_at{};
    bool moves = true; // they differ between motion samples
    bool moved = true; // or at past samples
};

// Jiggle for one patch: computes its poses at all motion samples from past bent poses, into scratch.jiggled.
// Call run_chain() for each sample afterwards; unless they move, `strands` holds the rest strands then.
// `phase`: any number of the patch, the same in every frame. `kept`: its state from an earlier frame, which
// must have had the same wind, rest strands and runs (JiggleWindow::same_runs); it becomes that of this
// frame. nullptr: the whole window is run through. Both ways give the same bits. The sheltered fraction is
// that of the first motion sample for the whole window. This is exact if colliders are static. If the edge
// of a shelter moves, strands it passed within the last 1 / (damping omega) seconds, about the filter's
// memory, are wrong. For an obstacle that crosses the wind at 1 m/s, at 3 Hz and damping 0.3: a third of the
// strands behind it are off by more than 1 % of their length, the worst by their whole length, or by a
// quarter if a cone of 10 degrees softens the edge (tests/chain/shelter_test.cpp prints more).
void jiggle_patch(const ChainFrame& chain, const RestStrandSource& rest_strands, Strands& strands,
                  ChainScratch& scratch, uint32_t phase = 0, JiggleState* kept = nullptr);

// Expanded strands at motion sample `time` -> pose, pose_normal, envelope, gust, shield. If the wind has no
// strength, the pose is the rest pose bit for bit, except for collision.
void run_chain(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch);

// Runs only the last stage, pose -> pose, if the scene uses collision and the frame's stage is final.
void collide_pose(const ChainFrame& chain, uint32_t time, Strands& strands, ChainScratch& scratch);

} // namespace marram
