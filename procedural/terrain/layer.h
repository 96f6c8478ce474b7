// SPDX-License-Identifier: Apache-2.0
// A layer of a terrain: a function of the terrain below it.
//
// A layer is created from its parameters and never changes. Its result depends only on them and the fields
// below. So results are bit-identical at any thread count, and an edit re-evaluates only the tiles it
// affects.
//
// To add a layer type: add a file here with a head comment, parameters and a class; add a line to
// layer_types() (layers.cpp).
#pragma once

#include "procedural/terrain/fields.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace marram {

// Statistics and warnings of evaluate_whole().
struct LayerNotes {
    struct Warning {
        std::string place, what, remedy; // as in MarramMessage
    };
    std::vector<std::pair<std::string, double>> numbers; // added to those of report()
    std::vector<Warning> warnings;
};

// Output buffers of a layer. Those of fields that it does not write (Writes) are NULL.
struct LayerOutput {
    float* bedrock = nullptr;
    SandUnits* sand = nullptr;
    std::span<float* const> masks; // as many as TerrainLayer::mask_names()
    LayerNotes* notes = nullptr;   // of evaluate_whole(); may be NULL
};

class TerrainLayer {
  public:
    struct Writes {
        bool bedrock = false, sand = false;
    };

    virtual ~TerrainLayer() = default;

    // Which fields it writes; the others pass through from below.
    virtual Writes writes() const = 0;
    // Names of its output masks.
    virtual std::vector<std::string> mask_names() const { return {}; }

    // Radius in metres around a sample of the input that it depends on. Infinity: the layer must be evaluated
    // as a whole, by evaluate_whole().
    virtual double reach() const { return 0.0; }

    // Evaluates a rectangle; thread-safe. Writes every sample of it in each non-NULL buffer, copied from
    // below where the layer has no effect.
    virtual void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const = 0;

    // Evaluates all samples, for a layer with infinite reach. Returns false if cancelled.
    virtual bool evaluate_whole(const Fields& below, const LayerOutput& out,
                                const std::function<bool()>& cancelled) const {
        (void)below, (void)out, (void)cancelled;
        return true;
    }

    // Named statistics of the layer.
    virtual std::vector<std::pair<std::string, double>> report() const { return {}; }

    // What it generated, as scene text of layers and curves that give the same result. `index`: the layer's,
    // for names.
    virtual std::string described(size_t index, const Fields& below) const {
        (void)index, (void)below;
        return "";
    }

    // Tiles whose result may differ from that of `before`, a layer of the same type with other parameters,
    // over the same fields. `domain`: as at creation.
    virtual Tiles changed_since(const TerrainLayer& before, const Domain& domain) const {
        (void)before;
        return Tiles(domain, true);
    }
};

// Combine modes: how a layer's height or thickness `own` is combined with the one `below` (metres).
enum class Combine { add, maximum, replace, smooth_maximum };

// Smooth maximum with a continuous slope. Exact where a and b differ by at least `width`; else above the
// maximum by at most width / 4. (I. Quilez's polynomial smooth minimum, k = width.)
inline double smooth_maximum(double a, double b, double width) {
    if (!(width > 0.0)) return std::max(a, b);
    const double h = std::max(width - std::abs(a - b), 0.0) / width;
    return std::max(a, b) + 0.25 * h * h * width;
}

// Smooth maximum of two thicknesses (>= 0). If one is 0 it is the other, so a layer that thins out to 0 ends
// without a step. It is the smooth maximum over k, 1 / k = 1 / width + 1 / 2a + 1 / 2b.
inline double merged_thickness(double a, double b, double width) {
    if (!(a > 0.0)) return b;
    if (!(b > 0.0) || !(width > 0.0)) return std::max(a, b);
    const double least = 2.0 * a * b;
    return smooth_maximum(a, b, least * width / (least + width * (a + b)));
}

// Combines bedrock heights, or sand thicknesses if `thickness`.
inline double combine(Combine mode, double below, double own, double width, bool thickness) {
    switch (mode) {
    case Combine::add:
        return below + own;
    case Combine::maximum:
        return std::max(below, own);
    case Combine::replace:
        return own;
    case Combine::smooth_maximum:
        return thickness ? merged_thickness(below, own, width) : smooth_maximum(below, own, width);
    }
    return below;
}

} // namespace marram
