// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/shape_layer.h"

#include "procedural/abi/param.h"

#include <fmt/format.h>

namespace marram {

namespace {

constexpr double widest = 1e6; // metres

Combine combine_mode(std::string_view name) {
    if (name == "maximum") return Combine::maximum;
    if (name == "replace") return Combine::replace;
    if (name == "smooth_maximum") return Combine::smooth_maximum;
    return Combine::add;
}

void copy_rows(const Rect& rect, int nx, const auto* from, auto* to) {
    for (int j = rect.j0; j < rect.j1; ++j) {
        const size_t begin = size_t(j) * size_t(nx) + size_t(rect.i0);
        std::copy_n(from + begin, rect.i1 - rect.i0, to + begin);
    }
}

} // namespace

void ShapeLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    if (!touches(rect)) {
        if (settings_.bedrock) copy_rows(rect, domain_.nx, below.bedrock, out.bedrock);
        if (!settings_.bedrock) copy_rows(rect, domain_.nx, below.sand, out.sand);
        return;
    }
    const float* mask = settings_.mask.empty() ? nullptr : find_mask(below, settings_.mask);
    std::array<double, Tiles::side> own, share;
    for (int j = rect.j0; j < rect.j1; ++j) {
        own.fill(0.0);
        share.fill(0.0);
        shape(rect.i0, rect.i1, j, own.data(), share.data());
        const size_t row = domain_.index(rect.i0, j);
        const size_t count = size_t(rect.i1 - rect.i0);
        for (size_t k = 0; k < count; ++k) {
            const size_t sample = row + k;
            const double s = mask ? share[k] * double(mask[sample]) : share[k];
            if (settings_.bedrock) {
                const double b = double(below.bedrock[sample]);
                out.bedrock[sample] =
                    s == 0.0
                        ? below.bedrock[sample]
                        : float(b + s * (combine(settings_.mode, b, own[k], settings_.smooth, false) - b));
            } else {
                const SandUnits b = below.sand[sample];
                const double metres = sand_metres(b);
                const double rock = settings_.level ? double(below.bedrock[sample]) : 0.0;
                const double thickness = std::max(own[k] - rock, 0.0);
                const double more = combine(settings_.mode, metres, settings_.level ? thickness : own[k],
                                            settings_.smooth, true) -
                                    metres;
                out.sand[sample] = s == 0.0 ? b : std::max(b + sand_units(s * more), SandUnits(0));
            }
        }
    }
}

std::array<MarramParam, 4> shape_params(const char* target) {
    return {param::choice("target", target, "sand|level|bedrock",
                          "field that the layer changes; level: fills sand up to its height"),
            param::choice("combine", "\"add\"", "add|maximum|replace|smooth_maximum",
                          "how its height meets what is there"),
            param::number("smooth", "m", "1", 0, widest,
                          "difference in height below which a smooth maximum blends"),
            param::text("mask", "none", "name of a mask that it is multiplied by")};
}

std::string required_mask_name(const LayerContext& context, std::string_view parameter) {
    const std::string name = context.values.text(parameter);
    if (std::find(context.masks.begin(), context.masks.end(), name) == context.masks.end())
        throw SceneFault("terrain.no_mask", context.values.place(parameter),
                         fmt::format("no layer below outputs a mask '{}'", name),
                         "name the mask of an earlier layer");
    return name;
}

ShapeSettings read_shape(const LayerContext& context) {
    ShapeSettings settings;
    settings.bedrock = context.values.text("target") == "bedrock";
    settings.level = context.values.text("target") == "level";
    settings.mode = combine_mode(context.values.text("combine"));
    settings.smooth = context.values.number("smooth");
    if (context.values.has("mask")) settings.mask = required_mask_name(context, "mask");
    return settings;
}

const float* find_mask(const Fields& below, std::string_view name) {
    for (size_t m = below.masks.size(); m-- > 0;)
        if (below.masks[m].name == name) return below.masks[m].values;
    return nullptr;
}

} // namespace marram
