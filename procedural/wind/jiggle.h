// SPDX-License-Identifier: Apache-2.0
// Curve jiggle: strands follow their wind-bent pose like damped springs. See jiggle.cpp for the derivation.
//
// No state is kept between frames: each frame filters a window of past samples, at absolute multiples of
// jiggle.step. The tolerance sets the length of the window:
//
//     const JiggleWindow window = jiggle_window(jiggle, times, fps, reach, tolerance);
//     filter.begin(jiggle, fps, cvs, blocks);
//     for (s = window.first; s <= window.last; ++s) {
//         filter.feed(s, bent at jiggle.frame_of(s));
//         while (i < times.size() && times[i] <= jiggle.frame_of(s)) filter.emit(times[i], now, pose of key i++);
//     }
//     while (i < times.size()) filter.emit(...) // if the window is empty
#pragma once

#include "core/math/ramp.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"
#include "procedural/wind/strands.h"

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
    std::optional<double> start_frame;
    std::string place; // location of jiggle.frequency in the scene, for error messages

    double frame_of(int64_t past_sample) const { return double(past_sample) * step; }
};

// Parameters of [wind], each named "jiggle.<name>". All are optional; without jiggle.frequency the others are
// errors.
std::span<const MarramParam> jiggle_params();

// Reads values named "wind.jiggle.<name>"; empty if the scene gives no frequency. Throws SceneFault.
std::optional<Jiggle> read_jiggle(const Values& values);

struct JiggleWindow {
    int64_t first = 0,
            last = -1; // past samples; empty where first > last: all times lie before jiggle.start_frame
    int64_t count() const { return last - first + 1; }
};

// The past samples that the poses at `times` (frames, ascending) need. `reach` in metres bounds the distance
// of a CV's past targets from its target at the window's first sample: 2 L for the bend, plus the distance a
// root travels. Motion before the window moves a filtered CV by at most `tolerance` metres (0: 1e-6 of the
// reach). Restoring segment lengths afterwards can magnify this if a filtered strand is shorter than its
// rest; jiggle_test measures by how much. Throws SceneFault if more than 100,000 past samples would be
// needed.
JiggleWindow jiggle_window(const Jiggle& jiggle, std::span<const double> times, double fps, double reach,
                           double tolerance);

// One step of the oscillator. The target moves linearly by D over the step; lag e and velocity w (metres a
// radian):
//     e' = c e + s w - f D          w' = -s e + d w + g D
struct JiggleStep {
    double c, s, d, f, g;
};

// Eight steps.
struct alignas(64) WideJiggleStep {
    VDouble c, s, d, f, g;
};

// Coefficients for a step of `radians` = omega h >= 0. Error < 1e-14 (1 + radians sqrt(1 - damping^2) for
// damping < 1, due to the rounding of the argument itself).
JiggleStep jiggle_step(double damping, double radians);

// Upper bound on the error of the filtered position if all targets more than `radians` in the past are off by
// at most 1. Exact for damping >= 1, otherwise at most pi / 2 times too large; decreases with `radians`.
// Infinite for damping 0.
double jiggle_tail(double damping, double radians);

// Filters the strands of one patch. Reusable: memory is kept between patches. Cost: about 2 ns a CV for each
// past sample, 10 ns a CV for each pose, 576 bytes for eight CVs.
class JiggleFilter {
  public:
    // u: [blocks * cvs] if the segments of a strand differ in length, else empty.
    void begin(const Jiggle& jiggle, double fps, int cvs, int blocks, std::span<const VDouble> u = {});

    // Takes bent.pose at the past sample; past samples are consecutive.
    void feed(int64_t past_sample, const Strands& bent);

    // The pose at `frame`, between the last two samples fed. Root and segment lengths are those of now.rest;
    // positions are rounded once. A strand whose target has never moved is copied from the target bit for
    // bit. Before the first sample, or if none was fed, the pose is now.pose.
    void emit(double frame, const Strands& now, WideVector<Wide3f>& pose);

  private:
    void fill_steps(double frames, std::vector<JiggleStep>& steps) const;
    void fill_steps(double frames, WideVector<WideJiggleStep>& steps) const;

    Jiggle jiggle_;
    double fps_ = 24.0;
    int cvs_ = 0, blocks_ = 0;
    int64_t last_ = 0, first_ = 0;         // the last and the first past sample fed
    int fed_ = 0;                          // number of past samples fed: 0, 1, or 2 for two and more
    std::vector<JiggleStep> whole_, part_; // [cvs]: steps from sample to sample, and from sample to `frame`
    WideVector<VDouble> u_;                // if the stiffness at CV k differs between strands, else empty
    WideVector<WideJiggleStep> strand_full_steps_,
        strand_partial_steps_;          // [blocks * cvs], used instead in that case
    WideVector<Wide3d> lag_, velocity_; // [blocks * cvs] at the sample before the last
    WideVector<Wide3f> from_, to_;      // [blocks * cvs] targets at the last two samples
};

// Normals of jiggled oriented strands: now.pose_normal, rotated segment by segment by the shortest arc from
// now.pose (both bent, at the time of the pose) to `pose`. A segment that has not moved keeps its normal bit
// for bit.
void jiggle_normals(const Strands& now, const WideVector<Wide3f>& pose, WideVector<Wide3f>& normals);

} // namespace marram
