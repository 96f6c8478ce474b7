// SPDX-License-Identifier: Apache-2.0
// Wind ripples as heights and slopes of a surface. The page of the model is in ripples.cpp.
#pragma once

#include "core/math/vec.h"

#include <cstdint>
#include <span>

namespace marram {

struct RippleSettings {
    double wavelength = 0.11;      // metres from crest to crest, along the surface
    double height = 0.008;         // metres from trough to crest, at right angles to the surface
    double repose = 34.0 * degree; // radians, between 0 and pi / 2
    uint64_t seed = 0;
};

// Across the crests and downwind, on a surface of that gradient (dh/dx, dh/dz): x and z of a unit vector
// that lies in the surface. The wind (x, z; any length) is deflected towards the line of fall. 0 where
// there is no wind.
Vec2d ripple_direction(const Vec2d& wind, const Vec2d& gradient, double repose);

// Share of their height that ripples have on a slope: 1 up to 26 degrees, 0 from 30 degrees on.
double ripples_on_slope(const Vec2d& gradient);

// What is known of a point of the surface.
struct RipplePoint {
    Vec2d at = Vec2d::Zero();       // x, z
    Vec2d wind = Vec2d::UnitX();    // where it goes to; any length, 0: no ripples
    Vec2d gradient = Vec2d::Zero(); // of the surface without ripples, smooth over three wavelengths
    double strength = 1.0;          // share of the height: shelter, masks
};

class RippleField {
  public:
    explicit RippleField(const RippleSettings& settings);

    const RippleSettings& settings() const { return settings_; }
    // Metres along the surface's normal, within half the height up and down.
    double displacement(const RipplePoint& point) const;
    // The same bits, for many. Nothing is allocated.
    void displacements(std::span<const RipplePoint> points, std::span<double> metres) const;
    // And how fast they change along x and z, metres a metre, the direction held: off by 3 % on the average (root mean square).
    void displacements(std::span<const RipplePoint> points, std::span<double> metres,
                       std::span<Vec2d> slopes) const;
    // Radians a metre by which the phase advances along x and z, ends of crests left out.
    Vec2d wave(const RipplePoint& point) const;
    // Mean square of the slope around the point, of what `displacements` says.
    double slope_variance(const RipplePoint& point) const;

  private:
    RippleSettings settings_;
    double tan_repose_;
    uint32_t seed_;
};

} // namespace marram
