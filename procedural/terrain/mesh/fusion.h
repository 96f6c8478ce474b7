// SPDX-License-Identifier: Apache-2.0
// The fusion layer: sand drapes over rock, and loose sand relaxes to its angle of repose. See fusion.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"

#include <functional>
#include <memory>
#include <string>

namespace marram {

struct FusionSettings {
    double repose = 34.0 * degree; // radians; clamped to 1 ... 80 degrees
    double drape = 0.0;            // metres; 0: off. See drape.cpp
    int cycles = 160; // maximum of multigrid cycles, each with 12 or more sweeps of the finest grid
    bool operator==(const FusionSettings&) const = default;
};

struct FusionResult {
    int64_t sweeps = 0;    // of the finest grid
    double steepest = 0.0; // radians: final slope of the steepest triangle with loose sand at all corners
    double moved = 0.0;    // sand that moved to other samples, metres times samples
    bool settled = true;   // false: stopped at the maximum of cycles, or the input is out of range
    bool in_range = true;  // false: the input is out of range, the sand unchanged
    bool cancelled = false;
};

// Relaxes `sand` in place. mask: fraction of the sand that is loose, 0 to 1; NULL: all. The sand is unchanged
// if the call is cancelled or the input is out of range.
FusionResult relax_sand(const Domain& domain, const float* bedrock, SandUnits* sand,
                        const FusionSettings& settings, const std::function<bool()>& cancelled,
                        const float* mask = nullptr);

class FusionLayer : public TerrainLayer {
  public:
    // mask: name of a mask from below; "": none. place: scene location for warnings.
    FusionLayer(const Domain& domain, const FusionSettings& settings, std::string mask = "",
                std::string place = "")
        : domain_(domain), settings_(settings), mask_(std::move(mask)), place_(std::move(place)) {}

    Writes writes() const override { return {.bedrock = false, .sand = true}; }
    double reach() const override { return infinity; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    bool evaluate_whole(const Fields& below, const LayerOutput& out,
                        const std::function<bool()>& cancelled) const override;
    Tiles changed_since(const TerrainLayer& before, const Domain& domain) const override;

  private:
    Domain domain_;
    FusionSettings settings_;
    std::string mask_, place_;
};

LayerType fusion_layer_type();

} // namespace marram
