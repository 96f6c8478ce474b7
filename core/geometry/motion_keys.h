// SPDX-License-Identifier: Apache-2.0
// Chooses the number of motion keys for each mesh and each procedural's curves. Embree interpolates linearly
// between keys that are equally spaced over the shutter. Each geometry has its own number: a wheel does not
// add keys to a meadow beside it.
#pragma once

#include "core/geometry/scene_mesh.h"
#include "core/geometry/view.h"

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace marram {

constexpr uint32_t max_motion_keys = 64;

// Strands are measured at few instants, and only some of them: the tolerance is divided by this.
constexpr double strand_motion_margin = 1.25; // fitted to the scenes

// Motion sample times in frames: `keys` equally spaced from `open` to `close`, both ends exact; one if open =
// close.
std::vector<double> motion_times(double open, double close, uint32_t keys);

// The smallest number of keys, `least` ... 64, at which a mesh that moves linearly between them stays within
// `tolerance` metres, enlarged by the view, of its exact position at any instant of the shutter. If no number
// does, the best one above 48. `least` if the mesh does not move while the shutter is open.
uint32_t motion_keys_for(const SceneMesh& mesh, double tolerance, const View& view, double open, double close,
                         uint32_t least = 2);

// Largest distance of a mesh from its exact position with so many keys, m, enlarged by the view. Measured at
// the corners of its box, unless it deforms, and at about a thousand vertices if it deforms or the tolerance
// is in pixels, including those whose path bends most. Stops once the error exceeds `enough`.
double motion_error(const SceneMesh& mesh, const View& view, uint32_t keys, double open, double close,
                    double enough = std::numeric_limits<double>::infinity());

// Distance of strands from linear motion between keys, measured from their CVs at 2^n + 1 instants of the
// shutter.
class StrandMotion {
  public:
    // Adds a strand: samples[i] holds x, y, z and one more float for each CV; 5 or more samples, as many for
    // all strands. Distances are stored enlarged by the view.
    void add(std::span<const float* const> samples, size_t cvs, const View& view);
    void add(const StrandMotion& other);

    // 99th percentile of the strands' distances with so many keys, metres: as measured for 2, 3, 5 ... keys
    // up to half of the samples; with more keys it falls with the square of keys - 1. Strands that jump are
    // excluded: those off by more than the tolerance for which twice as many keys leave more than half of the
    // distance.
    double residual_error(uint32_t keys, double tolerance) const;
    double jump_fraction(double tolerance) const; // the fraction of strands that jump
    // The smallest number of keys, 2 ... 64, that keeps residual_error() within the tolerance with the
    // margin; else 64.
    uint32_t keys_for(double tolerance) const;

  private:
    static constexpr size_t max_levels = 4;
    using Gap = std::array<float, max_levels>; // of one strand, with 2^level + 1 keys
    bool jumps(const Gap& gap, double tolerance) const;
    size_t levels_ = 2; // number measured
    std::vector<Gap> gaps_;
};

} // namespace marram
