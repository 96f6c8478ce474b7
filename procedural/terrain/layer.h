// SPDX-License-Identifier: Apache-2.0
// A layer of a terrain: a function of the terrain below it.
//
// A layer is made once from its parameters and never changes; what it computes depends on nothing but them and the fields
// below, so that the same scene gives the same bits on any number of threads, and so that an edit has to evaluate only what it touches.
//
// To add a kind of layer: a file here with its page, its parameters and a class; a line in layer_types() (layers.cpp).
#pragma once

#include "procedural/terrain/fields.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace marram {

// What a layer has to say of an evaluation as a whole.
struct LayerNotes {
    struct Warning {
        std::string place, what, remedy; // as in MarramMessage
    };
    std::vector<std::pair<std::string, double>> numbers; // reported beside those of report()
    std::vector<Warning> warnings;
};

// What a layer writes. A buffer is there only for what the layer says it writes (Writes); the others are NULL.
struct LayerOutput {
    float* bedrock = nullptr;
    SandUnits* sand = nullptr;
    std::span<float* const> masks; // as many as Layer::mask_names()
    LayerNotes* notes = nullptr;   // of evaluate_whole(); may be NULL
};

class Layer {
  public:
    struct Writes {
        bool bedrock = false, sand = false;
    };

    virtual ~Layer() = default;

    // Which fields it writes; all others are those below.
    virtual Writes writes() const = 0;
    // Names of the masks that it hands out, as others name them.
    virtual std::vector<std::string> mask_names() const { return {}; }

    // How far a sample reads beyond itself: a change below changes nothing that is further away, metres. Infinity: it has to be
    // evaluated as a whole, by evaluate_whole().
    virtual double reach() const { return 0.0; }

    // The samples of a rectangle, from any thread. Writes every sample of it in each buffer that is there; what the layer does not
    // touch it copies from below.
    virtual void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const = 0;

    // All samples at once, for a layer whose reach is infinite. false: cancelled.
    virtual bool evaluate_whole(const Fields& below, const LayerOutput& out,
                                const std::function<bool()>& cancelled) const {
        (void)below, (void)out, (void)cancelled;
        return true;
    }

    // Numbers that the layer reports of itself, each with its name.
    virtual std::vector<std::pair<std::string, double>> report() const { return {}; }

    // What it has generated, as text of layers and curves that draw the same by hand. `index`: of the layer, for names.
    virtual std::string described(size_t index, const Fields& below) const {
        (void)index, (void)below;
        return "";
    }

    // Tiles that may come out differently from those of `before`, a layer of the same type with other parameters, over the same
    // fields. `domain` as at creation.
    virtual Tiles changed_since(const Layer& before, const Domain& domain) const {
        (void)before;
        return Tiles(domain, true);
    }
};

// The combine modes: how a layer's own height or thickness `own` meets what is there, `below` (metres).
enum class Combine { add, maximum, replace, smooth_maximum };

// A maximum without a crease: exact where the two differ by `width` or more, above it by at most width / 4. Continuous with its
// slope. (I. Quilez's polynomial smooth minimum, k = width.)
inline double smooth_maximum(double a, double b, double width) {
    if (!(width > 0.0)) return std::max(a, b);
    const double h = std::max(width - std::abs(a - b), 0.0) / width;
    return std::max(a, b) + 0.25 * h * h * width;
}

// The same of two thicknesses (>= 0), which merges them: of one that is 0 it is the other, so that what runs out to 0 leaves no step
// where it ends. With 1 / k = 1 / width + 1 / 2a + 1 / 2b, the smooth maximum over k.
inline double merged_thickness(double a, double b, double width) {
    if (!(a > 0.0)) return b;
    if (!(b > 0.0) || !(width > 0.0)) return std::max(a, b);
    const double least = 2.0 * a * b;
    return smooth_maximum(a, b, least * width / (least + width * (a + b)));
}

// Of heights of bedrock, or (thickness) of sand.
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
