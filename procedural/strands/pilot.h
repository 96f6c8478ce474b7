// SPDX-License-Identifier: Apache-2.0
// Chooses settings for the frame's tolerance by blowing a sample of strands with several values. The error is
// the 99th percentile over these strands, times a safety factor of 1.25.
#pragma once

#include "procedural/strands/grown/groom_settings.h"
#include "procedural/strands/grown/roots.h"
#include "procedural/strands/grown/strand_shape.h"
#include "procedural/wind/chain.h"

#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace marram {

struct PilotGroom {
    const Groom& groom;
    const Wind& wind;
    const MarramFrame& frame;
    const MarramMesh& skin;
    std::span<const Root> roots;
    Surface bind;
    std::optional<Guided> guided{}; // with one blend per root
    double instance_scale = 1.0;    // of the sampled strands: max_instance_scale()
};

struct Choice {
    double value;
    bool enough; // false: no allowed value reaches the tolerance
};

// The smallest CV count, 3 to 1000, for which the polygons of strands in full wind without gusts, and of
// strands that jiggle in gusts, are within the tolerance of the limit of infinitely many CVs; likewise the
// widths. Measured with 2, 4, 8, 16 and 32 segments against 64. Between and beyond these, the error falls by
// the power of the segment count that was measured, at most the second. Shelter adds its own error, which
// falls with the number of CVs. With curls or frizz, the measurement starts at six segments per turn. Uses
// three moments that are fixed for the shot, so the result depends on the description and the tolerance, not
// on the frame. Cost: 512 strands of 132 CVs; with jiggle, also 600 of 132 CVs over its window; with
// shielding, 680 of 65.
Choice cvs_for(const PilotGroom& pilot);

// A sample of strands of one CV count that swing on a static skin.
struct JigglePilot {
    const Wind& wind;
    const MarramFrame& frame;
    const MarramMesh* skin; // nullptr: not bound to a mesh
    const Ramp& envelope;
    MarramBasis basis;
    double length;    // m; upper bound of strand lengths
    double tolerance; // m
    size_t count;
    int cvs;
    bool irregular;                                         // as Strands::irregular
    std::function<void(const Wind& wind, Strands&)> expand; // fills the rest strands
    const Blade* blade = nullptr;
};

JigglePilot jiggle_pilot(const PilotGroom& pilot, double tolerance, size_t strands);

// The moments at which the step of jiggle is chosen for a frame: the same for neighbours, which then have one
// step, need not choose it again, and go on from each other's states.
struct JiggleMoments {
    std::vector<double> frames;
    // The wind differs from time to time by chance alone: four moments in each block of 128 frames, and the
    // 99th percentile is that of their strands together. Else, if there are keys, fields that move, gusts by
    // hand, random ones that all start within 32 frames, or a start_frame of jiggle: five moments in each
    // block of 16 frames, and the greatest of their percentiles counts. What is over between two of these is
    // missed.
    bool stationary = true;
    size_t strands = 128; // of the sample, at each moment
};
JiggleMoments jiggle_moments(const Wind& wind, double frame);

// The step between samples of the past in frames: 1/64, 1/32, ... 2. Steps of 2, 1 and 1/2 are compared with
// 1/4; for finer ones the error is extrapolated with the square of the step, as where gusts begin (between,
// it falls faster). At most 1/2 if jiggle has a start_frame, which is rounded down to a multiple of the
// step. Not finer than a window of 2048 samples allows. On a moving skin always 1/2: its motion is usually
// keyed at whole frames, and each trial would need new poses from the host. Cost: at each moment the sample
// over about 200 past samples.
Choice jiggle_step_for(const JigglePilot& pilot, const JiggleMoments& moments, bool skin_moves);

inline constexpr double default_jiggle_step = 0.5; // frames

} // namespace marram
