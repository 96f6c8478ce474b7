// SPDX-License-Identifier: Apache-2.0
// Layers that combine their own height with the terrain below: flat, noise, image, dune, mass desert.
//
//   below   the field that `target` names: bedrock height, or sand thickness
//   own     the layer's height or thickness, metres. Target "level": the thickness up to that height
//   share   blend weight, 0 to 1: the layer's own share times its mask
//   result  below + share * (combine(below, own) - below)
//
// Sand is never negative. Where the share is 0 the sample stays bit-identical.
#pragma once

#include "procedural/terrain/layer_types.h"

#include <array>

namespace marram {

struct ShapeSettings {
    bool bedrock = false; // target: bedrock; else sand
    bool level = false;   // sand: own heights are surface heights up to which sand is filled
    Combine mode = Combine::add;
    double smooth = 1.0; // metres over which a smooth maximum blends
    std::string mask;    // "": none
    bool operator==(const ShapeSettings&) const = default;
};

class ShapeLayer : public TerrainLayer {
  public:
    explicit ShapeLayer(ShapeSettings settings) : settings_(std::move(settings)) {}

    Writes writes() const override { return {settings_.bedrock, !settings_.bedrock}; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;

  protected:
    // Computes own and share of the samples [i0, i1) of row j, at most Tiles::side. Both are initialized to
    // 0.
    virtual void shape(int i0, int i1, int j, double* own, double* share) const = 0;
    // Returns false only if the share is 0 in the whole rectangle.
    virtual bool touches(const Rect& rect) const {
        (void)rect;
        return true;
    }
    const ShapeSettings& settings() const { return settings_; }
    Domain domain_; // set by the derived class

  private:
    ShapeSettings settings_;
};

// The parameters target, combine, smooth and mask. `target`: its default.
std::array<MarramParam, 4> shape_params(const char* target);
ShapeSettings read_shape(const LayerContext& context);

// The topmost mask with that name; NULL if there is none. Names from required_mask_name() always exist.
const float* find_mask(const Fields& below, std::string_view name);
// The mask name given by `parameter`. Throws SceneFault if no layer below outputs such a mask.
std::string required_mask_name(const LayerContext& context, std::string_view parameter);

} // namespace marram
