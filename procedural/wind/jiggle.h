// SPDX-License-Identifier: Apache-2.0
// Curve jiggle: its settings, and which past samples a pose needs. The oscillator is in jiggle_step.h, the filter
// in jiggle_filter.h.
//
// A pose at a time depends on nothing but that time and the scene. Yet frames share work: time is divided
// into periods that begin at epochs. Within a period a run advances in whole samples, so that a frame goes
// on from the state that an earlier one has reached. The run is defined by its epoch alone: it starts from
// rest one window before, in steps that halve on the way to the epoch, because an error made long ago has
// decayed as much. (Rest: no lag and no velocity, in the bent pose.) With a start_frame within that window, the
// run begins there instead, in single samples, and is the only one until the window has left it behind.
//
// "Period" and "phase" are of these restarts, never of the oscillation.
//
//     window        8     8     8     8    4  4  4  4   2 2 2 2  1111|1111111111111111|
//                 start from rest                                  epoch     next epoch: another run
//
// The tolerance sets the window: longer than the memory of the oscillator.
#pragma once

#include "core/math/keyframes.h"
#include "core/math/ramp.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

struct Jiggle {
    double frequency = 2.0; // Hz, of a CV with stiffness 1
    double damping = 0.3;   // ratio to critical damping
    Ramp stiffness;         // over u, root to tip: scales the frequency, > 0
    double step = 0.5;      // frames between past samples; 0: to be derived from the tolerance
    // Of keyed ones. frequency and damping are then those of the keys with the longest memory.
    std::optional<Keyframes> frequencies, dampings;
    std::optional<double> start_frame;
    double memory = 1024.0; // MB of states that a procedural keeps from frame to frame
    std::string place;      // location of jiggle.frequency in the scene, for error messages

    bool is_keyed() const { return frequencies || dampings; }
    double frame_of(int64_t past_sample) const { return double(past_sample) * step; }
    int64_t sample_before(double frame) const; // the last past sample at or before the frame
};

// Parameters of [wind], each named "jiggle.<name>". All are optional; without jiggle.frequency the others are
// errors.
std::span<const MarramParam> jiggle_params();

// Reads values named "wind.jiggle.<name>"; empty if the scene gives no frequency. Throws SceneFault.
std::optional<Jiggle> read_jiggle(const Values& values, std::optional<double> swing = {});

// The steps of one run: from rest at sample `first`, by powers of two of samples to `epoch`, then one by one.
struct JiggleRun {
    int64_t first = 0, epoch = 0;
    bool operator==(const JiggleRun&) const = default;
};

struct JiggleWindow {
    static constexpr int64_t endless = int64_t{1} << 60;

    std::vector<int64_t> steps;   // [level]: number of steps of 2^level samples before an epoch
    int64_t length = 0;           // of these steps together, in samples; endless: all runs begin at `start`
    int64_t period = 1;           // samples from epoch to epoch
    std::optional<int64_t> start; // strands are in their bent pose until this sample
    int64_t first = 0, last = -1; // all samples that poses at the times can need

    bool empty() const { return first > last; } // all times lie before `start`
    int64_t count() const { return last - first + 1; }
    int64_t most_samples() const; // that one patch needs for a frame without an earlier one
    // The run that the pose of a patch within [sample, sample + 1) belongs to. `phase`: any number of the
    // patch; it shifts the epochs, so that not all patches begin a run in the same frame.
    JiggleRun run_at(int64_t sample, uint32_t phase) const;
    int level_at(const JiggleRun& run, int64_t sample) const; // of the step that begins at the sample
    // True: poses of both belong to the same runs.
    bool same_runs(const JiggleWindow& other) const {
        return steps == other.steps && length == other.length && period == other.period &&
               start == other.start;
    }
};

// The past samples that poses at `times` (frames, ascending) need. `reach` in metres bounds the distance
// of a CV's past targets from its target at a run's first sample: 2 L for the bend, plus the distance a
// root travels. Motion before the window moves a filtered CV by at most `tolerance` metres (0: 1e-6 of the
// reach). Restoring segment lengths afterwards can magnify this if a filtered strand is shorter than its
// rest; jiggle_test measures by how much. The bound is rounded down to a power of 4 of the reach, so that
// neighbouring frames agree. Throws SceneFault if more than 100,000 past samples would be needed.
JiggleWindow jiggle_window(const Jiggle& jiggle, std::span<const double> times, double fps, double reach,
                           double tolerance);

// Throws SceneFault if that many are too many.
void check_past_samples(const Jiggle& jiggle, double samples);

} // namespace marram
