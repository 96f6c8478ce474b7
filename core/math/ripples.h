// SPDX-License-Identifier: Apache-2.0
// Wind ripples as heights and slopes of a surface. The model is described in ripples.cpp.
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

// The direction normal to the crests, downwind, on a surface with the given gradient (dh/dx, dh/dz): x and z
// of a unit vector that lies in the surface. The wind (x, z; any length) is deflected downhill, towards the
// line of steepest descent. Zero if there is no wind.
Vec2d ripple_direction(const Vec2d& wind, const Vec2d& gradient, double repose);

// Factor on the height of ripples on a slope: 1 up to 26 degrees, 0 from 30 degrees on.
double ripples_on_slope(const Vec2d& gradient);

// Input at a point of the surface.
struct RipplePoint {
    Vec2d at = Vec2d::Zero();       // x, z
    Vec2d wind = Vec2d::UnitX();    // direction it blows to; any length, 0: no ripples
    Vec2d gradient = Vec2d::Zero(); // of the surface without ripples, smooth over three wavelengths
    double strength = 1.0;          // factor on the height, for shelter and masks
};

class RippleField {
  public:
    explicit RippleField(const RippleSettings& settings);

    const RippleSettings& settings() const { return settings_; }
    // Displacement along the surface normal in metres, within +- half the height.
    double displacement(const RipplePoint& point) const;
    // The same to the bit, for many points. Allocates nothing.
    void displacements(std::span<const RipplePoint> points, std::span<double> metres) const;
    // Also the derivatives along x and z (dimensionless), computed as if the direction were constant: the
    // error is 3 % (root mean square).
    void displacements(std::span<const RipplePoint> points, std::span<double> metres,
                       std::span<Vec2d> slopes) const;
    // Gradient of the phase along x and z in radians per metre, without the singularities where crests end.
    Vec2d wave(const RipplePoint& point) const;
    // Mean square slope of displacements() around the point.
    double slope_variance(const RipplePoint& point) const;

  private:
    RippleSettings settings_;
    double tan_repose_;
    uint32_t seed_;
};

} // namespace marram
