// SPDX-License-Identifier: Apache-2.0
// Layers that have a height of their own and combine it with what is below: flat, noise, image, dune, mass desert.
//
//   below   the bedrock's height, or the sand's thickness: the field that `target` names
//   own     what the layer would put there, metres. Target "level": the thickness that makes the surface as high as that
//   share   how much of that counts: the layer's own, times its mask, 0 to 1
//   result  below + share * (combine(below, own) - below)
//
// Sand is never negative. Where the share is 0 the sample keeps its bits.
#pragma once

#include "procedural/terrain/layer_types.h"

#include <array>

namespace marram {

struct ShapeSettings {
    bool bedrock = false; // target: bedrock; else sand
    bool level = false;   // of sand: own heights are those of the surface that sand fills up to
    Combine mode = Combine::add;
    double smooth = 1.0; // metres over which a smooth maximum blends
    std::string mask;    // "": none
    bool operator==(const ShapeSettings&) const = default;
};

class ShapeLayer : public Layer {
  public:
    explicit ShapeLayer(ShapeSettings settings) : settings_(std::move(settings)) {}

    Writes writes() const override { return {settings_.bedrock, !settings_.bedrock}; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;

  protected:
    // own and share of the samples [i0, i1) of row j, at most Tiles::side of them. Both arrive as 0.
    virtual void shape(int i0, int i1, int j, double* own, double* share) const = 0;
    // False: the share is 0 in all of the rectangle.
    virtual bool touches(const Rect& rect) const {
        (void)rect;
        return true;
    }
    const ShapeSettings& settings() const { return settings_; }
    Domain domain_; // set by the layer

  private:
    ShapeSettings settings_;
};

// The parameters target, combine, smooth and mask. target: what it is when the scene does not say.
std::array<MarramParam, 4> shape_params(const char* target);
ShapeSettings read_shape(const LayerContext& context);

// The mask of that name, the one handed out last. It is there: read_shape() and whoever else takes a name has looked.
const float* find_mask(const Fields& below, std::string_view name);
// A SceneFault where no layer below hands out a mask of the name that `parameter` gives.
std::string mask_named(const LayerContext& context, std::string_view parameter);

} // namespace marram
