// SPDX-License-Identifier: Apache-2.0
// A field of many dunes from a few parameters. Each dune is a description (crest curves and settings) with a
// stable id, so that it can be edited individually. The model is documented in mass_desert.cpp and the files
// that it lists.
#pragma once

#include "procedural/terrain/dune/dune_shape.h"
#include "procedural/terrain/shape_layer.h"

#include <memory>
#include <optional>
#include <string_view>

namespace marram {

enum class MassKind { barchan, barchanoid, transverse, seif, star, dome, parabolic, nabkha };
enum class MassArrangement { random, along, across, cells };

std::string_view mass_kind_name(MassKind kind);

// An edit of one dune. `move`: x and z; `rotate`: radians, from x to z; `scale`: all lengths;
// `height_factor`: the height alone.
struct DuneEdit {
    uint64_t id = 0;
    Vec2d move = Vec2d::Zero();
    double rotate = 0.0, scale = 1.0, height_factor = 1.0;
    bool remove = false;
};

// Lengths in metres, angles in radians; ranges are low and high.
struct MassSettings {
    MassArrangement arrangement = MassArrangement::random;
    std::optional<MassKind> kind;  // none: from the regime chart
    double sand_cover = 0.2;       // 0: bare ground; 1: sand everywhere
    double wind_variability = 0.1; // 1 - RDP / DP: 0: one direction; 1: all directions
    double plants = 0.0;           // fraction of the ground covered by plants
    double kind_mixing = 0.05;     // largest deviation of a dune's cover and variability
    Vec2d height = Vec2d(2.0, 6.0);
    Vec2d spacing = Vec2d(80.0, 140.0);
    Vec2d ridge_length = Vec2d(150.0, 300.0); // of transverse, barchanoid and seif crests
    double density = 1.0;                     // fraction of the places that have a dune
    double dispersion = 8.0 * degree;         // standard deviation of the orientation
    double slip_angle = 33.0 * degree;
    double windward_angle = 12.0 * degree; // steepest part of the windward side, within the profile's limits
    double horn_length = 0.3;  // of a barchan or a barchanoid's crescent, as a fraction of its width
    double sinuosity = 0.08;   // amplitude of a ridge's waves, as a fraction of their wavelength
    double crest_radius = 0.0; // metres over which crests are rounded
    double boundary_noise = 0.0, boundary_noise_length = 20.0;
    Vec2d wind = Vec2d(1.0, 0.0); // unit: where the resultant wind goes to, x and z
    uint64_t seed = 0;
    uint64_t terrain_seed = 0;              // for boundary noise, as for a drawn dune
    std::vector<std::vector<Vec2d>> curves; // arrangement along: x and z
    bool follow =
        false; // along: the downwind axis is the curve's normal on the lee side; else the wind direction
    std::vector<DuneEdit> edits;
};

struct MassDune {
    uint64_t id = 0;
    MassKind kind = MassKind::barchan;
    std::vector<std::vector<Vec2d>> crests;         // 9 to 33 points each
    DuneSettings settings;                          // shared by all its crests
    uint64_t noise_seed = 0;                        // seed of the equivalent drawn dune; gives settings.seed
    Vec2d at = Vec2d::Zero();                       // middle of the crest; for stars and nabkhas the peak
    double angle = 0.0;                             // downwind axis, from x to z
    double height = 0.0, width = 0.0, length = 0.0; // metres, as defined in mass_shapes.cpp
};

// The kind given by the regime chart. All arguments are between 0 and 1.
MassKind regime_kind(double sand_cover, double wind_variability, double plants);

// Maximum number of dunes in an area; more is a SceneFault.
inline constexpr double max_mass_dunes = 100'000;

// All dunes whose place before edits is in [lower, upper), sorted by id. Depends only on settings and area.
std::vector<MassDune> generate_dunes(const MassSettings& settings, const Vec2d& lower, const Vec2d& upper);

// Upper bound, in metres, of how far an unedited dune extends from its place.
double mass_reach(const MassSettings& settings);

class MassLayer : public ShapeLayer {
  public:
    // `dunes`: sorted by id. `merge`: metres over which two dunes blend. `before`: a layer whose unchanged
    // dunes are reused; may be NULL.
    MassLayer(const ShapeSettings& shape, const Domain& domain, std::vector<MassDune> dunes, double merge,
              const MassLayer* before = nullptr);

    // The dunes of the layer, for display, editing and baking.
    const std::vector<MassDune>& dunes() const { return dunes_; }
    Tiles changed_since(const TerrainLayer& before, const Domain& domain) const override;
    // x, z and height of each dune, by id, if listing is on.
    std::vector<std::pair<std::string, double>> report() const override;
    // The dunes as [[curves]] and layers of type dune, if listing is on. mass_layer.cpp gives the accuracy.
    std::string described(size_t index, const Fields& below) const override;
    void list_dunes(bool list) { lists_ = list; }

  private:
    struct Placed {
        uint64_t id = 0, digest = 0;
        std::shared_ptr<const std::vector<DuneShape>> arms; // one for each non-empty crest
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
    std::vector<Placed> placed_; // the dunes that overlap the domain
    std::vector<uint32_t> tile_begin_,
        in_tile_; // dunes of tile t: in_tile_[tile_begin_[t] ... tile_begin_[t + 1])
};

LayerType mass_desert_layer_type();

} // namespace marram
