// SPDX-License-Identifier: Apache-2.0
// The air over ground: faster over crests, slower before them, calm and returning in the lee.
//
// MODEL. What the dune solver uses for its sand (shear.cpp, separation.cpp), for strands. Ground h and the
// streamlines over its bubbles make a surface; over that, the stress of a wind along d is tau_0 (d + tau'),
// tau' from linear theory. Near the ground, in the inner layer, the wind is in the direction of the local
// stress and its speed follows the logarithmic law of the local shear velocity sqrt(tau), so relative to
// the wind over level ground it is, at all heights alike,
//
//     f = (d + tau') / sqrt(|d + tau'|)          |f| = sqrt(|tau| / tau_0); the part of d + tau' along d is at least 0
//
// At height z above the ground, in a bubble whose streamline is e above it:
//
//     f <- s f - (1 - s) return_flow d,          s = y^2 (3 - 2 y), y = min(z / e, 1);  s = 1 without a bubble
//
// so the air returns at the ground and joins the flow above at the streamline. The velocity of wind v (m/s,
// its horizontal part v_h, along d) at a point at height z is |v_h| f, turned parallel to the slope of the
// ground there without change of speed, plus v's vertical part. With a reference height H above 0, v_h is
// meant at that height, and is multiplied by ln(1 + z / z0) / ln(1 + H / z0), z0 the roughness of the ground.
//
// Outside the grid the wind is v, by the same logarithmic law at the point's own height above its root.
// Heights beyond the inner layer, some tenth of the length of a hill, take the wind of the ground too:
// there the speed-up is too high.
//
// A wind that turns in time uses directions 15 degrees apart, and between two of them the weighted mean of
// their tau' and e; a steady one its own direction.
//
// ERROR of tau' against the linear solution over a Gaussian ridge: ground_air_test.cpp prints it. COST: the
// transforms of shear.cpp once a direction, 16 bytes a sample and direction, 20 for the ground; at strands
// about 45 ns a root (marram_bench, "ground").
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"
#include "procedural/air/height_grid.h"

#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

namespace marram {

// Speed of the air that returns at the ground of a bubble, over that of the wind over level ground. Chosen:
// in a wind tunnel, the greatest behind two-dimensional transverse dunes was 0.17 of the free stream.
inline constexpr double return_flow = 0.15;

class GroundAir {
  public:
    explicit GroundAir(HeightGrid ground);
    // Of a mesh; empty ground if it has no area seen from above. The same one for all callers, as long as one
    // of them keeps it.
    static std::shared_ptr<GroundAir> over(const MarramMesh& mesh);

    const HeightGrid& ground() const { return ground_; }
    // Four floats, loaded and interpolated at once; the last is not used.
    using Sample = float __attribute__((vector_size(16)));
    // The height of the ground in metres, and its slopes along x and z by central differences.
    std::span<const Sample> shape() const { return shape_; }

    // Air of one direction, per sample: tau' along and across the wind, towards (-d_z, d_x), and e in metres.
    using Table = std::vector<Sample>;
    struct At {                         // a time
        const GroundAir* air = nullptr; // nullptr: no ground
        std::shared_ptr<const Table> first, second;
        double part = 0.0;                // share of `second`
        Vec2d direction = Vec2d::UnitX(); // x and z, unit
    };
    // `turns`: its direction changes in time. Vertical winds and empty ground: air is nullptr. Computes what
    // it has not yet; call it before parallel work on strands. Thread-safe. The result lives as long as the
    // GroundAir.
    At at(const Vec3d& direction, bool turns);

    size_t bytes() const;

  private:
    std::shared_ptr<const Table> table(double angle); // radians, from +x to +z

    HeightGrid ground_;
    std::vector<Sample> shape_;
    mutable std::mutex mutex_;                              // of tables_
    std::map<double, std::shared_ptr<const Table>> tables_; // by angle
};

// The reference height of a wind's speed and the roughness of the ground, metres; height 0: no logarithmic
// law, the speed is the same at all heights.
struct SpeedHeight {
    double height = 0.0, roughness = 1e-3;
};

// The wind at eight points that are `above` metres above roots p on the ground or on a mesh above it;
// `velocity`: of the wind over level ground.
Wide3d wind_over_ground(const GroundAir::At& at, const SpeedHeight& reference, const Wide3d& p,
                        const VDouble& above, const Vec3d& velocity);

// The part of f along d at eight x and z, `above` metres over the ground: how fast the air is, over level
// ground 1.
// Below 0: it returns. Outside the grid 1.
VDouble speed_over_ground(const GroundAir::At& at, const VDouble& x, const VDouble& z, double above);

} // namespace marram
