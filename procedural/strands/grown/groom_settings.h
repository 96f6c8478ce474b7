// SPDX-License-Identifier: Apache-2.0
// The settings of a groom. The parameters are documented in the table of groom_settings.cpp, which `marram
// info groom` prints.
#pragma once

#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"
#include "procedural/strands/grown/guides.h"
#include "procedural/strands/surface.h"
#include "procedural/wind/blade/blade.h"

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// One channel of an image. Copies share their pixels.
class ScalarImage {
  public:
    // values: rows from the top, width * height.
    ScalarImage(uint32_t width, uint32_t height, std::vector<float> values, std::string place = "");
    // A channel of an image of the host. missing: value of tiles that are missing.
    ScalarImage(const MarramGrid& grid, uint32_t channel, float missing, std::string place);
    ScalarImage at_place(std::string place) const; // the same image, referenced at another place of the scene

    // Beyond the unit square of uv: the image again, or the pixels at its border.
    void set_repeats(bool repeats) { repeats_ = repeats; }

    // Bilinear; v = 0 is the image's bottom edge.
    double operator()(double u, double v) const;
    double low() const { return pixels_->low; } // over the whole image
    double high() const { return pixels_->high; }
    const std::string& file() const { return pixels_->file; }
    // Of an image in UDIM tiles: whether it has one there.
    bool tiled() const { return !pixels_->has_tile.empty(); }
    bool has_tile(int64_t u, int64_t v) const;
    const std::string& place() const { return place_; } // in the scene file

  private:
    struct Pixels {
        uint32_t width, height;
        std::vector<float> values;
        double low, high;
        double missing = 0.0; // value where a tile is missing
        std::string file{};
        int64_t u = 0, v = 0, columns = 1, rows = 1; // tiles: the lowest, and their number
        std::vector<char> has_tile{};                // [row from below * columns + column]; empty: one image
    };
    std::shared_ptr<const Pixels> pixels_;
    std::string place_;
    bool repeats_ = false;
};

// A factor in [0, 1]: a ramp over an attribute of the mesh, or over an image by uv.
struct Factor {
    std::string attribute, place; // attribute: "" if there is an image
    std::optional<ScalarImage> image;
    Ramp ramp;
    size_t index = 0; // among the mesh's attributes; set by resolve_attributes()

    double operator()(const Surface& surface, uint32_t triangle, const Vec3d& weights) const;
    // Bounds of the ramp's input within a triangle. For an image: over the whole image.
    std::pair<double, double> input_range(const Surface& surface, uint32_t triangle) const;
};
using Factors = std::vector<Factor>;

// Product of the factors at a point of the bind pose; 1 if there are none.
double product(const Factors& factors, const Surface& bind, uint32_t triangle, const Vec3d& weights);

// Parameters that factors scale, besides density and length.
enum FactorOf { of_wind, of_width, of_lean, of_arc, of_curl, of_clump, of_frizz, factor_count };

// A factor in [0, 1] of density or length: the product of an image by uv, a ramp over height (y), a ramp over
// slope (angle of the normal to the vertical), and the factors that every parameter has.
struct Masks {
    std::optional<ScalarImage> image;
    std::optional<Ramp> by_height; // over metres
    std::optional<Ramp> by_slope;  // over degrees from level ground
    Factors factors;
    bool any() const { return image || by_height || by_slope || !factors.empty(); }
    // At a point of the bind pose.
    double operator()(const Surface& bind, uint32_t triangle, const Vec3d& weights) const;
};

// Pulls strands together into clumps. Levels are ordered from coarse to fine; a coarse level pulls the
// centres of the next finer clumps together.
struct Clump {
    double size = 0.0, amount = 0.0; // mean distance between clumps, m; 0 to 1
    Ramp profile;                    // of the amount, from root to tip
};
constexpr size_t max_clumps = 4;

// A scene's defaults are in groom_settings.cpp; these initial values are for tests that set a few.
struct Groom {
    std::string mesh, mesh_place;
    double density = 0.0; // roots per square metre; 0 if count is given
    uint64_t count = 0;   // total number of roots; 0 if density is given
    std::string count_place;
    std::optional<bool> images_repeat; // none: if the mesh has uvs outside the unit square
    Masks density_masks, length_masks;
    double spacing = 1.0; // 0: random; 1: as even as a Poisson disc set

    std::optional<GuideSettings> guides; // if given, strands are children of these
    Vec2d length;                        // m; with guides, begin() sets it from 0 to the longest child
    bool combed = false;
    Vec3d comb; // direction that strands lean to
    std::optional<std::array<ScalarImage, 2>>
        comb_map; // the same along u and v, 0 ... 1 for -1 ... 1; overrides comb where it is not (0.5, 0.5)
    double comb_variation = 0.0;             // radians
    double lean = 0.0, lean_variation = 0.0; // radians from the surface normal
    double arc = 0.0, arc_variation = 0.0;   // radians; additional lean from root to tip
    double curl_radius = 0.0, curl_turns = 0.0;
    std::vector<Clump> clumps; // at most max_clumps
    double frizz_amplitude = 0.0, frizz_frequency = 0.0;

    double width = 0.0, width_variation = 0.0; // m; fraction
    bool level_of_detail = false;              // level_of_detail.h
    Ramp width_profile;
    int cvs = 0; // 0: chosen by the tolerance
    MarramBasis basis = MARRAM_BSPLINE;
    MarramShape shape = MARRAM_ROUND;
    Ramp envelope;
    std::array<Factors, factor_count> factors; // of_wind scales the envelope
    uint32_t seed = 0;
    std::optional<Blade> blade;               // else strands bend as the talk's
    bool canopy = false;                      // the stand slows its wind (wind/canopy.h)
    std::optional<double> canopy_attenuation; // default: from its plants
    std::string canopy_place;
    bool clear_of_meshes = true; // roots that colliding meshes cover are left out (covered_roots.h)
};

const std::vector<MarramParam>& groom_params(); // including guide_params()
Groom read_groom(const Values& values);

// Digest of all values that determine the roots. The roots stay the same as long as it and the mesh do.
uint64_t roots_digest(const Values& values);

// All lists of factors of the groom, including those of density and length.
std::vector<Factors*> factors_of(Groom& groom);

// All images of the groom, each with the place of the parameter that names it.
std::vector<ScalarImage*> images_of(Groom& groom);

// Sets Factor::index of the factors that use an attribute of the mesh. Throws SceneFault if an attribute is
// missing, does not have one component, or is animated.
void resolve_attributes(Groom& groom, std::span<const MarramAttribute> attributes);

} // namespace marram
