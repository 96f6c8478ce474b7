// SPDX-License-Identifier: Apache-2.0
// Wind ripples on the sand of a terrain. The page of the layer is in ripples.cpp, that of the model in core/math/ripples.cpp.
#pragma once

#include "core/math/ripples.h"
#include "procedural/terrain/layer_types.h"

#include <cstdint>

namespace marram {

// Ripples on the sand: of a grid that resolves them in its heights, else carried by the render mesh and by shaders.
class RipplesLayer : public Layer {
  public:
    struct Settings {
        RippleSettings ripples;
        Vec2d wind = Vec2d::UnitX();
        double shelter_reach = 30.0; // metres upwind in which crests shelter
        std::string mask;            // "": none
        double displaced =
            2.0; // pixels: how high on the film ripples are where displacement ends; 0: shading only
    };
    RipplesLayer(const Settings& settings, const Domain& domain);

    // Six samples a wavelength.
    static bool resolved(const RippleSettings& ripples, const Domain& domain);

    Writes writes() const override { return {false, true}; }
    double reach() const override;
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;

    // What ripples need to know of a sample where the grid does not hold them.
    struct Carried {
        Vec2f gradient = Vec2f::Zero(); // of the smooth surface
        float strength = 0.0F;          // share of their height: sand, mask, shelter
    };
    // For each of `samples`, of all where there are none of them, on a finished terrain.
    void carried(const Fields& terrain, std::span<const uint32_t> samples, std::span<Carried> out) const;
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
    int knot_; // samples between the knots of the smooth surface
};

LayerType ripples_layer_type();

} // namespace marram
