// SPDX-License-Identifier: Apache-2.0
// What a scene says of a groom. The page that explains every parameter is description.cpp's table, printed by
// `marram info groom`.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/groom/guides.h"
#include "procedural/groom/surface.h"
#include "procedural/values.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// An image lent by the renderer for create() only, so its pixels are kept: one channel.
struct Mask {
    uint32_t width = 0, height = 0;
    std::vector<float> values; // rows from the top
    std::string place{};       // in the scene file

    // Bilinear, repeating; v = 0 is the image's bottom edge.
    double operator()(double u, double v) const;
};

// A factor by a ramp over an attribute of the mesh.
struct AttributeFactor {
    std::string name, place;
    Ramp ramp;
    size_t index = 0; // among the mesh's attributes, as check_attributes() has found it

    double operator()(const Surface& surface, uint32_t triangle, const Vec3d& weights) const;
    // Least and greatest value of the attribute within a triangle.
    std::pair<double, double> range(const Surface& surface, uint32_t triangle) const;
};

// A factor in [0, 1] of density or length: image by uv, height by y, slope by the angle to the vertical, attributes by name.
struct Masks {
    std::optional<Mask> image;
    std::optional<Ramp> by_height; // over metres
    std::optional<Ramp> by_slope;  // over degrees from level ground
    std::vector<AttributeFactor> by_attribute;
    bool any() const { return image || by_height || by_slope || !by_attribute.empty(); }
    // At a place on a surface at its bind pose.
    double operator()(const Surface& bind, uint32_t triangle, const Vec3d& weights) const;
};

struct Groom {
    std::string mesh, mesh_place;
    double density = 0.0; // roots a square metre; 0 where count is given
    uint64_t count = 0;   // roots in all; 0 where density is given
    std::string count_place;
    Masks density_masks, length_masks;
    double spacing = 1.0; // 0 random, 1 as even as it gets

    std::optional<GuideSettings> guides; // what strands are children of
    Vec2d length;                        // metres; of children 0 to the longest, as guides_of() has found it
    bool combed = false;
    Vec3d comb;                              // where strands lean to
    double comb_variation = 0.0;             // radians
    double lean = 0.0, lean_variation = 0.0; // radians from the surface normal
    double arc = 0.0, arc_variation = 0.0;   // further lean from root to tip
    double curl_radius = 0.0, curl_turns = 0.0;
    double clump_size = 0.0, clump_amount = 0.0;
    Ramp clump_profile;
    double frizz_amplitude = 0.0, frizz_frequency = 0.0;

    double width = 0.0, width_variation = 0.0; // metres; 1
    Ramp width_profile;
    int cvs = 0; // 0: as many as the tolerance asks for
    MarramBasis basis = MARRAM_BSPLINE;
    MarramShape shape = MARRAM_ROUND;
    Ramp envelope;
    std::vector<AttributeFactor> wind_by_attribute; // of the envelope
    uint32_t seed = 0;
};

const std::vector<MarramParam>& groom_params(); // those of guides among them
Groom read_groom(const Values& values);

// Of all values that decide where strands stand: where it and the mesh stay the same the roots do.
uint64_t roots_digest(const Values& values);

// Finds the attributes that the groom asks for among those of its mesh. Throws SceneFault for one that is not there or not one number.
void find_attributes(Groom& groom, std::span<const MarramAttribute> attributes);

} // namespace marram
