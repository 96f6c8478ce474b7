// SPDX-License-Identifier: Apache-2.0
// A stand of plants slows its own wind: less reaches its lower parts and its inside than its top and its
// edge.
//
// MODEL. Within a stand of height h the wind falls towards the ground as (R. Cionco, J. Appl. Meteorol. 4,
// 1965)
//
//     U(z) = U(h) exp(-a (1 - z / h)),     z <= h;     U(h) above
//
// The attenuation follows from the drag of the plants and the mixing length below their top (I. Harman and J.
// Finnigan, Boundary-Layer Meteorol. 123, 2007; c_d = 0.2 of leaves in a stand, u* / U(h) = beta = 0.3):
//
//     a = c_d P / (2 beta^2),  at most 6
//
// with P the plant area index: one-sided area of plants over the area of ground. Measured in giant reed, 75
// profiles: a = 4.4 +- 0.5 (O. Speck, Am. J. Bot. 90, 2003), P near 4. Where the wind enters a stand, P is
// the mean of what it has come through:
//
//     P(x) = integral from 0 of P_0(x - w s) exp(-s / l) ds / l,     l = 3 h_m / (c_d P_m)
//
// P_0: of the ground at a place; l: three times the length over which drag slows the air in a stand (S.
// Belcher, N. Jerram, J. Hunt, J. Fluid Mech. 488, 2003), with the mean height and index P_m of ground that
// bears plants. So a strand at the edge feels more wind than one inside, and what stands behind a gap feels
// some of it.
//
// If the artist gives an attenuation a_m, it is reached deep inside the stand: a = a_m P / P_m, at most a_m; and l is
// that of plants that have it, 3 h_m / (2 beta^2 a_m).
//
// P_0 and the mean height of strands are on a grid over x and z, from the strands themselves, in cells as
// wide as the stand is high, at least a 512th of its extent. The integral is taken along the grid, row by row downwind, once for each
// direction of the wind: for winds along an axis exactly, for a P_0 that is linear between samples; oblique ones
// mix neighbouring columns. COST: a pass over the grid
// for each direction, four samples of it a root, an exponential a CV; no ray.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "procedural/wind/strands.h"

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

namespace marram {

struct CanopyStrand {
    double x = 0.0, z = 0.0;         // of the root, m
    double height = 0.0, area = 0.0; // m above the ground; m^2 of one side
};

class Canopy {
  public:
    static constexpr double most_attenuation = 6.0;

    // `attenuation`: of the artist, if given.
    Canopy(const std::vector<CanopyStrand>& strands, std::optional<double> attenuation);

    double mean_index() const { return mean_index_; } // P_m
    double mean_height() const { return mean_height_; }
    double adjustment() const { return adjustment_; } // l, m
    size_t bytes() const;

    // Attenuation and height of the stand at a root, for a wind towards `direction`. Any thread.
    struct Stand {
        double attenuation = 0.0, height = 0.0;
    };
    Stand at(double x, double z, const Vec3d& direction) const;

    // strands.rest -> strands.canopy: U(z) / U(h) at each CV, z its height above the root along the skin's
    // normal.
    void attenuate(const Vec3d& direction, Strands& strands) const;

  private:
    using Indices = std::vector<float>; // P, per sample
    std::shared_ptr<const Indices> upwind_indices(const Vec3d& direction) const;
    Stand stand_at(double x, double z, const Indices& upwind) const;

    int nx_ = 0, nz_ = 0;
    double cell_ = 1.0, x0_ = 0.0, z0_ = 0.0;
    std::vector<float> indices_, heights_; // P_0; m
    std::optional<double> attenuation_;
    double mean_index_ = 0.0, mean_height_ = 0.0, adjustment_ = 1.0;
    mutable std::mutex mutex_;                                       // of known_
    mutable std::map<double, std::shared_ptr<const Indices>> known_; // by the angle of the direction
};

} // namespace marram
