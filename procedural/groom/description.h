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

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// One channel of an image. Those of one image share their pixels.
class ScalarImage {
  public:
    // values: rows from the top, width * height.
    ScalarImage(uint32_t width, uint32_t height, std::vector<float> values, std::string place = "");
    ScalarImage at_place(std::string place) const; // the same, asked for elsewhere

    // Bilinear, repeating; v = 0 is the image's bottom edge.
    double operator()(double u, double v) const;
    double low() const { return pixels_->low; } // over the whole image
    double high() const { return pixels_->high; }
    const std::string& place() const { return place_; } // in the scene file

  private:
    struct Pixels {
        uint32_t width, height;
        std::vector<float> values;
        double low, high;
    };
    std::shared_ptr<const Pixels> pixels_;
    std::string place_;
};

// A factor in [0, 1] by a ramp over an attribute of the mesh, or over an image by uv.
struct Factor {
    std::string attribute, place; // "" where there is an image
    std::optional<ScalarImage> image;
    Ramp ramp;
    size_t index = 0; // among the mesh's attributes, as find_attributes() has found it

    double operator()(const Surface& surface, uint32_t triangle, const Vec3d& weights) const;
    // Bounds of the attribute's or the image's value within a triangle; an image's are those of the whole.
    std::pair<double, double> input_range(const Surface& surface, uint32_t triangle) const;
};
using Factors = std::vector<Factor>;

// Their product at a place on a surface at its bind pose; 1 where there are none.
double product(const Factors& factors, const Surface& bind, uint32_t triangle, const Vec3d& weights);

// What factors scale besides density and length.
enum FactorOf { of_wind, of_width, of_lean, of_arc, of_curl, of_clump, of_frizz, factor_count };

// A factor in [0, 1] of density or length: image by uv, height by y, slope by the angle to the vertical, and the factors that all
// parameters have.
struct Masks {
    std::optional<ScalarImage> image;
    std::optional<Ramp> by_height; // over metres
    std::optional<Ramp> by_slope;  // over degrees from level ground
    Factors factors;
    bool any() const { return image || by_height || by_slope || !factors.empty(); }
    // At a place on a surface at its bind pose.
    double operator()(const Surface& bind, uint32_t triangle, const Vec3d& weights) const;
};

// Strands drawn together in tufts. Of several the coarsest comes first, and draws the middles of the next finer tufts together.
struct Clump {
    double size = 0.0, amount = 0.0; // metres between tufts; 1
    Ramp profile;                    // of the amount, from root to tip
};
constexpr size_t most_clumps = 4;

struct Groom {
    std::string mesh, mesh_place;
    double density = 0.0; // roots a square metre; 0 where count is given
    uint64_t count = 0;   // roots in all; 0 where density is given
    std::string count_place;
    Masks density_masks, length_masks;
    double spacing = 1.0; // 0 random, 1 as even as it gets

    std::optional<GuideSettings> guides; // what strands are children of
    Vec2d length; // metres; of children from 0 to their longest, filled in by guides_of()
    bool combed = false;
    Vec3d comb; // where strands lean to
    std::optional<std::array<ScalarImage, 2>>
        comb_map; // the same along u and v, 0 ... 1 for -1 ... 1; overrides comb where it is not (0.5, 0.5)
    double comb_variation = 0.0;             // radians
    double lean = 0.0, lean_variation = 0.0; // radians from the surface normal
    double arc = 0.0, arc_variation = 0.0;   // further lean from root to tip
    double curl_radius = 0.0, curl_turns = 0.0;
    std::vector<Clump> clumps; // at most most_clumps
    double frizz_amplitude = 0.0, frizz_frequency = 0.0;

    double width = 0.0, width_variation = 0.0; // metres; 1
    Ramp width_profile;
    int cvs = 0; // 0: as many as the tolerance asks for
    MarramBasis basis = MARRAM_BSPLINE;
    MarramShape shape = MARRAM_ROUND;
    Ramp envelope;
    std::array<Factors, factor_count> factors; // of_wind: of the envelope
    uint32_t seed = 0;
};

const std::vector<MarramParam>& groom_params(); // those of guides among them
Groom read_groom(const Values& values);

// Of all values that decide where strands stand: where it and the mesh stay the same the roots do.
uint64_t roots_digest(const Values& values);

// Every list of factors that the groom has, density and length among them.
std::vector<Factors*> factors_of(Groom& groom);

// Finds the attributes that the groom asks for among those of its mesh. Throws SceneFault for one that is not there or not one number.
void find_attributes(Groom& groom, std::span<const MarramAttribute> attributes);

} // namespace marram
