// SPDX-License-Identifier: Apache-2.0
// Free-form deformation of the terrain by a drawn control net. The model is documented in lattice.cpp.
#pragma once

#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/mesh/lattice_map.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

class LatticeLayer : public TerrainLayer {
  public:
    enum class Target { bedrock, sand };
    LatticeLayer(const LatticeNet& net, const Domain& domain, Target target, std::vector<std::string> masks);

    Writes writes() const override { return {target_ == Target::bedrock, true}; }
    std::vector<std::string> mask_names() const override { return masks_; }
    double reach() const override;
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    Tiles changed_since(const TerrainLayer& before, const Domain& domain) const override;

    const LatticeMap& map() const { return map_; }

  private:
    struct Span; // samples of a row
    void evaluate_row(const Span& span, const Fields& below, const LayerOutput& out) const;

    LatticeNet net_;
    Domain domain_;
    Target target_;
    std::vector<std::string> masks_;
    LatticeMap map_;
};

// Builds the net from the rest curves and the bent curves. Throws SceneFault at `place` if they do not match.
LatticeNet lattice_net(std::span<const DrawnCurve> rest, std::span<const DrawnCurve> bent,
                       const std::string& place);

LayerType lattice_layer_type();

} // namespace marram
