// SPDX-License-Identifier: Apache-2.0
// Many dunes from a few numbers: each one a description (crest curves and settings) with an id that stays, so that every single one
// can be edited. The page of the model is in mass_desert.cpp.
#pragma once

#include "procedural/terrain/dune_shape.h"
#include "procedural/terrain/shape_layer.h"

#include <memory>
#include <optional>
#include <string_view>

namespace marram {

enum class MassKind { barchan, barchanoid, transverse, seif, star, dome, parabolic, nabkha };
enum class MassArrangement { random, along, across, cells };

std::string_view mass_kind_name(MassKind kind);

// A change of one dune. `move` in x and z; `rotate` in radians, from x to z; `scale` of everything, `height_factor` of the height alone.
struct DuneEdit {
    uint64_t id = 0;
    Vec2d move = Vec2d::Zero();
    double rotate = 0.0, scale = 1.0, height_factor = 1.0;
    bool remove = false;
};

// Lengths in metres, angles in radians; ranges are low and high.
struct MassSettings {
    MassArrangement arrangement = MassArrangement::random;
    std::optional<MassKind> kind;  // nothing: by the regime chart
    double sand_cover = 0.2;       // 0: bare ground; 1: sand everywhere
    double wind_variability = 0.1; // 1 - RDP / DP: 0 one direction, 1 from all round
    double plants = 0.0;           // share of the ground that plants cover
    double kind_mixing = 0.05;     // how far cover and variability differ from dune to dune, at most
    Vec2d height = Vec2d(2.0, 6.0);
    Vec2d spacing = Vec2d(80.0, 140.0);
    Vec2d ridge_length = Vec2d(150.0, 300.0); // of transverse, barchanoid and seif crests
    double density = 1.0;                     // share of the places that hold a dune
    double dispersion = 8.0 * degree;         // standard deviation of the orientation
    double slip_angle = 33.0 * degree;
    double windward_angle = 12.0 * degree; // steepest part of the windward side, as far as the profile can
    double horn_length = 0.3;              // of a barchan, share of its width
    double sinuosity = 0.08;               // amplitude of a ridge's waves, share of their length
    double crest_radius = 0.0;             // metres over which crests are rounded
    double boundary_noise = 0.0, boundary_noise_length = 20.0;
    Vec2d wind = Vec2d(1.0, 0.0); // unit: where the resultant wind goes to, x and z
    uint64_t seed = 0;
    uint64_t terrain_seed = 0;              // boundary noise comes from it, as that of a drawn dune does
    std::vector<std::vector<Vec2d>> curves; // arrangement along: x and z
    bool follow =
        false; // along: dunes lie across the curve, on the side that the wind goes to; else as the wind has it
    std::vector<DuneEdit> edits;
};

struct MassDune {
    uint64_t id = 0;
    MassKind kind = MassKind::barchan;
    std::vector<std::vector<Vec2d>> crests; // 9 to 33 points each
    DuneSettings settings;                  // of all its crests
    uint64_t noise_seed = 0;                // what settings.seed is made from: the seed of a drawn dune
    Vec2d at = Vec2d::Zero();               // middle of the crest; of a star and a nabkha the peak
    double angle = 0.0;                     // downwind axis, from x to z
    double height = 0.0, width = 0.0, length = 0.0; // metres, as the page defines them
};

// The kind of the regime chart. All three between 0 and 1.
MassKind regime_kind(double sand_cover, double wind_variability, double plants);

// The most dunes that an area may ask for; more is a SceneFault.
inline constexpr double most_mass_dunes = 100'000;

// All dunes whose place before edits is in [lower, upper), by ascending id. Depends on settings and area only.
std::vector<MassDune> generate_dunes(const MassSettings& settings, const Vec2d& lower, const Vec2d& upper);

// How far a dune without edits may extend from its place.
double mass_reach(const MassSettings& settings);

class MassLayer : public ShapeLayer {
  public:
    // Dunes by ascending id. `merge`: metres over which two of them blend. `before`: a layer whose dunes are taken over where they are the
    // same; may be NULL.
    MassLayer(const ShapeSettings& shape, const Domain& domain, std::vector<MassDune> dunes, double merge,
              const MassLayer* before = nullptr);

    // What it was made from: to be shown, edited and baked out.
    const std::vector<MassDune>& dunes() const { return dunes_; }
    Tiles changed_since(const Layer& before, const Domain& domain) const override;
    // Of each dune x, z and height by its id, where the layer is asked to list them.
    std::vector<std::pair<std::string, double>> report() const override;
    // Their crests as curves and layers of type dune. The page says how near the heights come.
    std::string described(size_t index, const Fields& below) const override;
    void list_dunes(bool list) { lists_ = list; }

  private:
    struct Placed {
        uint64_t id = 0, digest = 0;
        std::shared_ptr<const std::vector<DuneShape>> arms; // one for each crest
        Vec2d lower = Vec2d::Zero(), upper = Vec2d::Zero();
    };

    static Placed placed(const MassDune& dune);
    const Placed* same_as(const MassDune& dune) const; // NULL: none
    void bin();
    void shape(int i0, int i1, int j, double* own, double* share) const override;
    bool touches(const Rect& rect) const override;
    void add_row(const DuneShape& dune, int begin, int i0, int i1, int j, double* own) const;

    double merge_;
    bool lists_ = false;
    std::vector<MassDune> dunes_;
    std::vector<Placed> placed_; // those that reach into the domain
    std::vector<uint32_t> tile_begin_,
        in_tile_; // dunes of tile t: in_tile_[tile_begin_[t] ... tile_begin_[t + 1])
};

LayerType mass_desert_layer_type();

} // namespace marram
