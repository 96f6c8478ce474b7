// SPDX-License-Identifier: Apache-2.0
// Fields of the wind that are drawn from above: an image, or curves that it follows.
//
// Curves: with the weights w of air/guides.h, t the direction of the curves in plan, and V the horizontal
// part of the mean wind, the local wind is the weighted mean of V and of winds along the curves as fast as V:
//
//   (pi / reach V + |V| integral of t w) / (pi / reach + integral of w)
//
// A long straight curve weighs as much as the mean wind at the distance reach: there half of the angle
// between them is left, and on the curve a 25th part. Where two directions meet, the speed is that of their
// mean, so it is below |V| by the cosine of half the angle between them. The influence ends at 4 reach from
// the curves.
//
// The map has samples every reach / 24, or farther apart if that were more than 2^19 of them, at most reach /
// 2; between them it is bilinear.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "procedural/air/guides.h"
#include "procedural/wind/field/velocities.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

// Samples at the centres of nx times nz cells of a rectangle in plan.
struct PlanMap {
    int nx = 0, nz = 0;
    int channels = 0; // 2 of an image, 4 of curves
    Vec2d center = Vec2d::Zero(),
          half = Vec2d::Ones(); // of the rectangle: x and z, m; of an image: of the field itself
    std::vector<float>
        values; // [channels * (j * nx + i)]; along and across; or share s of the curves, x and z of their
                // direction times s, influence. s and direction are times the influence
    uint64_t digest = 0; // of what it was made from
    size_t bytes() const { return values.capacity() * sizeof(float); }
};

inline constexpr double guide_extent = 4.0; // influence ends at so many times reach

// `ramp`: influence over the distance from the curves, 1 at guide_extent times reach. Throws SceneFault with
// `place`.
PlanMap guide_map(std::span<const DrawnCurve> curves, double reach, const Ramp& ramp,
                  const std::string& place);

// PlanMap::digest of what guide_map() would make.
uint64_t guide_digest(std::span<const DrawnCurve> curves, double reach, const Ramp& ramp);

// The first two channels of an image, which is stretched over the rectangle: rows from its side at -z. Throws
// SceneFault.
PlanMap image_map(const MarramGrid& image, const std::string& place);

// All channels of eight places: x and z are -1 ... 1 over the rectangle.
template <int channels>
MARRAM_INLINE void plan_values(const PlanMap& map, const VDouble& x, const VDouble& z, VFloat* out) {
    const SamplePair i = sample_pair(x, map.nx, 0.0), j = sample_pair(z, map.nz, 0.0);
    alignas(32) float corners[4][channels][lanes];
    for (int lane = 0; lane < lanes; ++lane) {
        const ptrdiff_t row = ptrdiff_t(map.nx) * channels;
        const float* const base =
            map.values.data() + i.lower[lane] * ptrdiff_t(channels) + j.lower[lane] * row;
        const ptrdiff_t dx = i.step[lane] * ptrdiff_t(channels), dz = j.step[lane] * row;
        for (int corner = 0; corner < 4; ++corner)
            for (int c = 0; c < channels; ++c)
                corners[corner][c][lane] = base[(corner & 1 ? dx : 0) + (corner & 2 ? dz : 0) + c];
    }
    for (int c = 0; c < channels; ++c)
        out[c] = mixed(mixed(vload(corners[0][c]), vload(corners[1][c]), i.share),
                       mixed(vload(corners[2][c]), vload(corners[3][c]), i.share), j.share);
}

} // namespace marram
