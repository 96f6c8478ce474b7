// SPDX-License-Identifier: Apache-2.0
// Colour along strands and between strands.
//
// Variation multiplies channel c by 1 + v (0.8 b + 0.2 g_c), with b and g_c uniform in [-1, 1] from the hash
// of the strand. Natural strands differ mostly in brightness, which all channels share; the rest is a slight
// shift in hue.
#include "shaders/shading_point.h"

#include "core/math/hash.h"

#include <limits>

namespace marram {

namespace {

constexpr float brightness_share = 0.8F;

float signed_unit(uint32_t h) { return 2.0F * unit_float(h) - 1.0F; }

} // namespace

std::vector<ParamSpec> strand_color_params() {
    constexpr double any = std::numeric_limits<double>::infinity();
    return {
        {"color_map", ParamType::image, "", "none", -any, any, "uv",
         "image whose colour multiplies color, by uv; of a strand by that at its root"},
        {"map_scale", ParamType::vec2, "", "[1, 1]", -1e6, 1e6, "",
         "how often an image repeats over the unit square of uv"},
        {"map_wrap", ParamType::choice, "", "auto", -any, any, "auto|clamp|repeat",
         "beyond the border of an image: its last pixels, or the image again; auto: repeat if map_scale is "
         "given or the "
         "mesh has uvs outside 0 ... 1"},
        {"root_color", ParamType::color, "", "none", 0.0, 1.0, "",
         "colour at a strand's root, instead of color"},
        {"tip_color", ParamType::color, "", "none", 0.0, 1.0, "",
         "colour at a strand's tip, instead of color"},
        {"variation", ParamType::number, "", "0", 0.0, 1.0, "",
         "how much strands differ in brightness and hue"},
        {"tint", ParamType::text, "", "\"none\"", 0.0, 0.0, "",
         "attribute, 0 ... 1, that blends towards tint_color; ids are hashed to [0, 1]; or none"},
        {"tint_color", ParamType::color, "", "[0.35, 0.2, 0.08]", 0.0, 1.0, "", "what tint blends towards"},
    };
}

std::shared_ptr<const Texture> map_of(const ParamSet& params, const char* name, TextureContent content,
                                      const TextureOpener& open) {
    if (!params.has(name)) return nullptr;
    return open(params.text(name), content, params.at(name).place);
}

StrandColor read_strand_color(const ParamSet& params, const TextureOpener& open) {
    StrandColor color;
    color.map = map_of(params, "color_map", TextureContent::color, open);
    color.map_scale = params.vec2("map_scale").cast<float>();
    if (params.text("map_wrap") != "auto")
        color.map_wrap = params.text("map_wrap") == "clamp" ? Wrap::clamp : Wrap::repeat;
    color.color = params.vec3("color").cast<float>();
    color.has_root = params.has("root_color");
    color.has_tip = params.has("tip_color");
    color.root = color.has_root ? Vec3f(params.vec3("root_color").cast<float>()) : color.color;
    color.tip = color.has_tip ? Vec3f(params.vec3("tip_color").cast<float>()) : color.color;
    color.variation = static_cast<float>(params.number("variation"));
    color.tint_color = params.vec3("tint_color").cast<float>();
    return color;
}

Vec3f color_at(const StrandColor& color, const ShadingPoint& point) {
    Vec3f result = color.color;
    if (point.fibre && (color.has_root || color.has_tip))
        result = color.root + point.strand_u * (color.tip - color.root);
    if (color.map) {
        const MapPlace place = map_place(color, point);
        result = result.cwiseProduct(color.map->at(place.uv, place.width, place.wrap));
    }
    const float weight = std::isfinite(point.tint_weight) ? std::clamp(point.tint_weight, 0.0F, 1.0F) : 0.0F;
    return result + weight * (color.tint_color - result);
}

Vec3f variation_factor(const StrandColor& color, const ShadingPoint& point, const Vec3f& full) {
    if (!point.fibre || color.variation == 0.0F) return Vec3f::Ones();
    const float brightness = brightness_share * signed_unit(mix32(point.strand_hash));
    Vec3f factor;
    for (uint32_t c = 0; c < 3; ++c) {
        const float hue =
            (1.0F - brightness_share) * signed_unit(mix32(point.strand_hash + 0x9e3779b9U * (c + 1)));
        factor[c] = 1.0F + color.variation * (brightness + hue);
        if (full[c] * factor[c] > 1.0F) factor[c] = 1.0F / full[c];
    }
    return factor;
}

} // namespace marram
