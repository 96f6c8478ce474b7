// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/imported/imported_settings.h"

#include "core/math/digest.h"
#include "core/math/known_part.h"
#include "procedural/abi/param.h"

#include <array>

namespace marram {
namespace {

constexpr std::array import_values = {
    param::curves("curves", "", "the strands: a [[curves]] of type \"strands\""),
    param::mesh("on", "none", "", "mesh that they are bound to and follow; absent: they stand in the world"),
    param::number("width", "m", "none", 0, embree_limit,
                  "diameter, of a ribbon its width; default: the file's"),
    param::ramp("width_profile", "", "[[0, 1], [1, 0.1]]", -embree_limit, embree_limit,
                "scale of `width` from root to tip; the file's widths are taken as they are"),
    param::number("width_scale", "", "1", 0, embree_limit, "scale of all widths"),
    param::choice("basis", "file", "file|bspline|catmull-rom",
                  "file: as the file says, else catmull-rom, which passes through the CVs"),
    param::choice("shape", "round", "round|ribbon|oriented-ribbon",
                  "tube; flat, facing the camera; or flat, with an orientation of its own"),
    param::keyable(param::ramp("envelope", "", "[[0, 1]]", -embree_limit, embree_limit,
                "share of the wind from root to tip")),
    param::text("wind_by[].attribute", "",
                "attribute of the strands, one number a curve, that scales the wind"),
    param::ramp("wind_by[].ramp", "", "[[0, 0], [1, 1]]", -embree_limit, embree_limit,
                "share of the wind over the attribute"),
    param::integer("seed", "", "0", 0, 2147483647, "seed of the ids of strands that have none in the file"),
};

constexpr const char* import_ramp_fault = "strands.share_range";

std::vector<PassedAttribute> passed_attributes_of(const MarramValue& curves) {
    std::vector<PassedAttribute> list;
    for (const MarramAttribute& a :
         known_parts(curves.attributes, curves.attribute_count, curves.attribute_stride))
        if (a.name && a.components >= 1 && a.components <= 4 &&
            (a.rate == MARRAM_PER_CURVE || a.rate == MARRAM_PER_CV))
            list.push_back({a.name, a.components, a.rate, a.discrete});
    return list;
}

} // namespace

std::span<const MarramParam> import_params() { return import_values; }

ImportSettings read_import(const Values& values) {
    ImportSettings settings;
    settings.curves = values.text("curves");
    settings.curves_place = values.at("curves").place;
    if (values.has("on")) {
        settings.mesh = values.text("on");
        settings.mesh_place = values.at("on").place;
    }
    if (values.has("width")) settings.width = values.number("width");
    settings.width_profile = values.ramp("width_profile");
    for (const double share : settings.width_profile.values())
        if (share < 0.0)
            throw SceneFault("strands.negative_width", values.at("width_profile").place,
                             "width_profile goes below 0", "a width cannot be negative");
    settings.width_scale = values.number("width_scale");
    if (values.text("basis") != "file")
        settings.basis = values.text("basis") == "bspline" ? MARRAM_BSPLINE : MARRAM_CATMULL_ROM;
    settings.shape = values.text("shape") == "round"    ? MARRAM_ROUND
                     : values.text("shape") == "ribbon" ? MARRAM_RIBBON
                                                        : MARRAM_ORIENTED_RIBBON;
    settings.envelope = unit_ramp(values, "envelope", import_ramp_fault);
    for (size_t i = 0;; ++i) {
        const std::string element = "wind_by[" + std::to_string(i) + "].";
        if (!values.has(element + "attribute")) break;
        settings.wind_by.push_back({std::string(values.text(element + "attribute")),
                                    values.at(element + "attribute").place,
                                    unit_ramp(values, element + "ramp", import_ramp_fault)});
    }
    settings.seed = uint32_t(values.integer("seed"));
    settings.passed_attributes = passed_attributes_of(values.at("curves"));
    return settings;
}

uint64_t binding_digest(const ImportSettings& settings) {
    return Digest().add(settings.curves).add(settings.mesh).value();
}

} // namespace marram
