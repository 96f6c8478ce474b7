// SPDX-License-Identifier: Apache-2.0
// Wind ripples on the sand of a terrain. The layer is documented in ripples.cpp, the model in
// core/math/ripples.cpp.
#pragma once

#include "core/math/ripples.h"
#include "procedural/terrain/layer_types.h"

#include <cstdint>

namespace marram {

// Ripples on the sand. If the grid resolves them, they are part of its heights; otherwise the render mesh and
// shaders add them.
class RipplesLayer : public TerrainLayer {
  public:
    struct Settings {
        RippleSettings ripples;
        Vec2d wind = Vec2d::UnitX();
        double shelter_reach = 30.0; // metres: how far upwind crests can shelter a sample
        std::string mask;            // "": none
        double displaced = 2.0; // pixels: projected ripple height at which displacement ends; 0: shading only
    };
    RipplesLayer(const Settings& settings, const Domain& domain);

    // True if the grid has at least six samples a wavelength.
    static bool resolved(const RippleSettings& ripples, const Domain& domain);

    Writes writes() const override { return {false, true}; }
    double reach() const override;
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;

    // Inputs of the ripple model at a sample, for ripples that the grid does not resolve.
    struct RippleInputs {
        Vec2f gradient = Vec2f::Zero(); // of the smooth surface
        float strength = 0.0F;          // fraction of full height, from sand depth, mask and shelter
    };
    // Computes these for the given samples of the finished terrain. Empty `samples`: all samples.
    void carried(const Fields& terrain, std::span<const uint32_t> samples, std::span<RippleInputs> out) const;
    bool resolved() const { return resolved(settings_.ripples, domain_); }
    const Settings& settings() const { return settings_; }
    const RippleField& field() const { return field_; }

  private:
    struct Surface;
    double strength(const Fields& below, const float* mask, const Vec2d& gradient, int i, int j) const;
    double shelter(const Fields& below, const Vec2d& gradient, int i, int j) const;

    Settings settings_;
    Domain domain_;
    RippleField field_;
    int knot_; // knot spacing of the smooth surface, in samples
};

LayerType ripples_layer_type();

} // namespace marram
