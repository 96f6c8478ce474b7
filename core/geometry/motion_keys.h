// SPDX-License-Identifier: Apache-2.0
// How many motion keys each mesh and each procedural's curves are drawn with. Embree draws straight lines between keys that are
// equally spaced over the shutter; how many those are is each geometry's own: a wheel beside it costs a meadow nothing.
#pragma once

#include "core/geometry/scene_mesh.h"
#include "core/geometry/view.h"

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace marram {

constexpr uint32_t most_motion_keys = 64;

// Motion sample times in frames: `keys` equally spaced from `open` to `close`, both ends exact; one where open = close.
std::vector<double> motion_times(double open, double close, uint32_t keys);

// The smallest number of keys, `least` ... 64, at which a mesh, drawn along straight lines between them, stays within `tolerance` metres,
// enlarged by the view, of where it belongs at any instant of the shutter; where none does, that of those above 48 which does best. A
// mesh that rests while the shutter is open has `least`.
uint32_t motion_keys_for(const SceneMesh& mesh, double tolerance, const View& view, double open, double close,
                         uint32_t least = 2);

// How far a mesh is from where it belongs, m, enlarged, with so many keys: of the corners of its box, and of about a thousand vertices
// where the view enlarges or it deforms, among them those that bend most where its way does. What exceeds `enough` is not measured
// further.
double motion_error(const SceneMesh& mesh, const View& view, uint32_t keys, double open, double close,
                    double enough = std::numeric_limits<double>::infinity());

// How far strands leave the straight lines between motion keys, from their CVs at 2^n + 1 instants of the shutter.
class StrandMotion {
  public:
    // A strand's CVs: samples[i] holds x, y, z and one more float for each; 5 or more samples, for all strands as many. Their distances
    // are kept enlarged by the view.
    void add(std::span<const float* const> samples, size_t cvs, const View& view);
    void add(const StrandMotion& other);

    // What 99 strands in 100 stay below with so many keys, metres: as measured for 2, 3, 5 ... keys up to half of the samples, beyond
    // that it falls with the square of their number less one. Strands that jump are left out: those that more keys hold to the
    // tolerance hardly better than fewer.
    double left(uint32_t keys, double tolerance) const;
    double jumps(double tolerance) const; // their share
    // The smallest number of keys, 2 ... 64, that leaves no more than the tolerance.
    uint32_t keys_for(double tolerance) const;

  private:
    static constexpr size_t most_levels = 4;
    using Gap = std::array<float, most_levels>; // of one strand, with 2^level + 1 keys
    bool jumps(const Gap& gap, double tolerance) const;
    size_t levels_ = 2; // that are measured
    std::vector<Gap> gaps_;
};

} // namespace marram
