// SPDX-License-Identifier: Apache-2.0
// The shapes of scour, echo dunes and drifts around the faces, before they are limited by slope and sand. The
// model is documented in ruin.cpp.
#pragma once

#include "procedural/terrain/ruin/ruin.h"
#include "procedural/terrain/ruin/ruin_faces.h"

#include <algorithm>
#include <cmath>

namespace marram {

inline constexpr double ruin_echo_reach = 2.0;            // in H, upwind of a face
inline const double ruin_slope = std::tan(32.0 * degree); // limit for scour and deposits, m/m

// 0 to 1 as u goes from 0 to 1, with zero slope at both ends.
inline double ruin_smooth(double u) {
    const double v = std::clamp(u, 0.0, 1.0);
    return v * v * (3.0 - 2.0 * v);
}

struct RuinShape {
    double scour = 0.0, deposit = 0.0; // m: to remove, to add
};

// The zones of the faces on one line. `settings` must outlive it.
class RuinZones {
  public:
    RuinZones(const RuinSettings& settings, double cell) : settings_(settings), pad_(1.5 * cell) {}
    // The shape on the line at s, in metres. Cost: linear in the number of faces.
    RuinShape at(const RuinLine& line, double s) const;

  private:
    // d, x: metres upwind of the face and behind it.
    double echo(double d, const RuinFace& face) const;
    double scour(double d, const RuinFace& face) const;
    double drift(double x, const RuinFace& face) const;
    double pad(const RuinFace& face) const { return std::min(pad_, 0.5 * face.thickness); }

    const RuinSettings& settings_;
    double pad_; // m: how far zones extend into the mesh
};

// The shape at (s, t), metres in the wind frame: linear between the two nearest lines, 0 from one step beyond
// the outermost lines.
RuinShape ruin_between_lines(const RuinLines& lines, const RuinZones& zones, double s, double t);

} // namespace marram
