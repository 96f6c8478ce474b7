// SPDX-License-Identifier: Apache-2.0
// Partly buried stones and bedrock outcrops. The model is documented in stones.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

#include <string>
#include <vector>

namespace marram {

enum class StoneKind { stone, outcrop };

// Lengths in metres, angles in radians; ranges are low and high.
struct StoneSettings {
    StoneKind kind = StoneKind::stone;
    double density = 0.05;            // stones of all sizes per square metre
    Vec2d size = Vec2d(0.5, 4.0);     // longest axis
    double size_power = 2.0;          // N(> size) ~ size^-size_power
    double flatness = 0.4;            // 0: as high as wide; 1: a slab
    Vec2d burial = Vec2d(0.35, 0.65); // fraction of the height below the surface
    double tilt = 20.0 * degree;      // maximum
    double roundness = 0.06;          // radius of edges, in half heights
    double roughness = 0.06;          // displacement, as a fraction of the size
    double bed = 0.5;                 // outcrop: mean thickness of a bed
    double dip = 8.0 * degree;        // outcrop: dip angle of the beds
    Vec2d dip_direction = {1.0, 0.0}; // outcrop: unit, dip direction of the beds in x and z
    std::string mask;                 // "": none
    uint64_t seed = 0;
    bool operator==(const StoneSettings&) const = default;
};

struct Stone {
    uint64_t id = 0;
    Vec2d at = Vec2d::Zero(); // centre
    double size = 0.0;
    bool operator==(const Stone&) const = default;
};

struct Stones {
    std::vector<Stone> list; // sorted by id
    size_t too_small = 0;    // number of omitted stones
};

// Maximum number of places in an area; more is a SceneFault.
inline constexpr double max_stones = 1e7;

// All stones of at least `smallest` metres whose centre is in [lower, upper). Depends only on settings and
// area. Throws SceneFault at `place` if there are too many.
Stones place_stones(const StoneSettings& settings, double smallest, const Vec2d& lower, const Vec2d& upper,
                    const std::string& place = "");

class StonesLayer : public TerrainLayer {
  public:
    // Minimum size in cells; smaller stones are omitted.
    static constexpr double min_cells = 4.0;

    StonesLayer(const StoneSettings& settings, const Domain& domain, const std::string& place = "");

    const Stones& stones() const { return stones_; }
    Writes writes() const override { return {true, true}; }
    double reach() const override { return reach_; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    Tiles changed_since(const TerrainLayer& before, const Domain& domain) const override;
    std::vector<std::pair<std::string, double>> report() const override;

  private:
    void bin();
    void raise(const Rect& rect, const Fields& below, const float* mask, uint32_t stone,
               float* bedrock) const;

    StoneSettings settings_;
    Domain domain_;
    Stones stones_;
    double reach_ = 0.0;
    // Stones of tile t: in_tile_[tile_begin_[t] ... tile_begin_[t + 1])
    std::vector<uint32_t> tile_begin_, in_tile_;
};

LayerType stones_layer_type();

} // namespace marram
