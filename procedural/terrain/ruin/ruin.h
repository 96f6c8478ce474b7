// SPDX-License-Identifier: Apache-2.0
// The ruin layer: scour and deposition of wind-blown sand around a mesh. The model is documented in ruin.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/ruin/ruin_mesh.h"

#include <functional>

namespace marram {

// H is the height of a wall above the sand at its foot. Values are clamped to the ranges given in ruin.cpp.
struct RuinSettings {
    double scour = 1.0;        // strength of scour and echo dune
    double scour_depth = 0.25; // at the wall, / H
    double drift = 1.0;        // strength of lee drifts and of sand in rooms
    double drift_length = 4.0; // / H
    double drift_height = 0.3; // at the wall, / H
    double inside = 0.2;       // rise of the sand in a room, / height of its walls
    double supply = 1.0;       // fraction of the missing deposit sand added from outside; 0: closed system
    bool operator==(const RuinSettings&) const = default;
};

// Result statistics. Sand after = sand before + supplied, and given = taken + supplied, both exactly.
struct RuinResult {
    SandUnits taken = 0, given = 0, supplied = 0;
    int windward = 0, lee = 0; // number of faces, counted on each line along the wind
    int rooms = 0;
    bool cancelled = false;
};

class RuinLayer : public TerrainLayer {
  public:
    // Only the device of `scene` is used; NULL: creates its own device.
    RuinLayer(const Domain& domain, const Vec2d& wind, const MarramMesh& mesh, RTCScene scene,
              const RuinSettings& settings);

    Writes writes() const override { return {.bedrock = false, .sand = true}; }
    double reach() const override { return infinity; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    bool evaluate_whole(const Fields& below, const LayerOutput& out,
                        const std::function<bool()>& cancelled) const override;
    Tiles changed_since(const TerrainLayer& before, const Domain& domain) const override;

    // evaluate_whole() with statistics. If cancelled, `sand` is a copy of the sand below.
    RuinResult move_sand(const Fields& below, SandUnits* sand, const std::function<bool()>& cancelled) const;
    // The samples that may change.
    Rect touched() const { return touched_; }

  private:
    Domain domain_;
    RuinSettings settings_; // clamped to their ranges
    RuinMesh mesh_;
    Rect touched_;
};

LayerType ruin_layer_type();

} // namespace marram
