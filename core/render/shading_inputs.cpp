// SPDX-License-Identifier: Apache-2.0
#include "core/render/shading_inputs.h"

#include "core/math/hash.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace marram {

namespace {

const Material& material_of(const RenderContext& context, int index) {
    const bool known = index >= 0 && static_cast<size_t>(index) < context.materials.size();
    return known ? context.materials[static_cast<size_t>(index)] : context.default_material;
}

} // namespace

void find_attributes(RenderContext& context, const Film& film) {
    for (const FilmLayer& layer : film.layers) context.wants_albedo |= layer.kind == LayerKind::albedo;
    const auto add = [&](const std::vector<AttributeValues>& attributes, int material) {
        context.tint_attributes.push_back(
            find_attribute(attributes, material_of(context, material).tint_attribute));
        const AttributeValues* ids = find_attribute(attributes, "id");
        context.ids.push_back(ids && ids->components == 1 && ids->rate == MARRAM_PER_CURVE ? ids : nullptr);
        const AttributeValues* uvs = find_attribute(attributes, "root_uv");
        context.root_uvs.push_back(uvs && uvs->components == 2 && uvs->rate == MARRAM_PER_CURVE ? uvs
                                                                                                : nullptr);
        for (const FilmLayer& layer : film.layers)
            context.layer_attributes.push_back(
                layer.kind == LayerKind::attribute ? find_attribute(attributes, layer.name) : nullptr);
    };
    const auto add_tiled = [&](std::span<const float> uvs) {
        constexpr float rounding = 1e-4F; // of exporters
        context.uv_tiled.push_back(
            std::ranges::any_of(uvs, [](float v) { return v < -rounding || v > 1.0F + rounding; }) ? 1 : 0);
    };
    for (const MeshGeometry& mesh : context.world.meshes) {
        add(mesh.attributes, mesh.material);
        add_tiled({mesh.uvs.empty() ? nullptr : mesh.uvs.front().data(), 2 * mesh.uvs.size()});
        context.ripples.push_back({find_attribute(mesh.attributes, ripple_attributes[0]),
                                   find_attribute(mesh.attributes, ripple_attributes[1])});
        for (const AttributeValues* attribute : context.ripples.back())
            if (!attribute || attribute->components != 4) context.ripples.back() = {};
    }
    for (const CurveGeometry& curves : context.world.curves) {
        add(curves.attributes, curves.material);
        const AttributeValues* uvs = context.root_uvs.back();
        add_tiled(uvs ? std::span<const float>(uvs->values) : std::span<const float>());
    }
}

std::array<float, 4> value_at(const RenderContext& context, const AttributeValues& attribute,
                              const SurfacePoint& hit) {
    std::array<float, 4> values{};
    const World& world = context.world;
    if (hit.geometry < world.meshes.size())
        attribute_at(world.meshes[hit.geometry], attribute, hit, values.data());
    else
        attribute_at(world.curves[hit.geometry - world.meshes.size()], attribute, hit, values.data());
    return values;
}

namespace {

const std::vector<AttributeValues>& attributes_of(const World& world, uint32_t geometry) {
    return geometry < world.meshes.size() ? world.meshes[geometry].attributes
                                          : world.curves[geometry - world.meshes.size()].attributes;
}

} // namespace

const Material& material_at(const RenderContext& context, const SurfacePoint& hit, const Vec3f& wo) {
    const Material* material = &material_of(context, hit.material);
    for (uint64_t level = 0; const auto* blend = std::get_if<BlendSettings>(&material->settings); ++level) {
        const AttributeValues* attribute =
            find_attribute(attributes_of(context.world, hit.geometry), blend->attribute);
        const double value = attribute ? double(value_at(context, *attribute, hit)[0]) : 0.0;
        uint64_t h = level;
        for (int axis = 0; axis < 3; ++axis)
            h = hash(hash(h, std::bit_cast<uint64_t>(hit.position[axis])), std::bit_cast<uint32_t>(wo[axis]));
        material = &material_of(context, select_material(*blend, value, unit_double(h)));
    }
    return *material;
}

namespace {

// The material's tint attribute at a hit; 0 without one. An id is discrete: it is hashed to [0, 1], which
// gives each id a random tint.
float tint_weight_at(const RenderContext& context, const Material& material, const SurfacePoint& hit) {
    if (material.tint_attribute.empty()) return 0.0F;
    const bool is_base = &material == &material_of(context, hit.material); // otherwise one side of a blend
    const AttributeValues* attribute =
        is_base ? context.tint_attributes[hit.geometry]
                : find_attribute(attributes_of(context.world, hit.geometry), material.tint_attribute);
    if (!attribute) return 0.0F;
    const float value = value_at(context, *attribute, hit)[0];
    return attribute->discrete ? unit_float(mix32(std::bit_cast<uint32_t>(value))) : value;
}

// Ripples from the attributes of a mesh. Components of the first attribute: gradient along x and z,
// shaded fraction, angle of repose; of the second: wavelength, height, wind heading, seed.
SurfaceRipples mesh_ripples(const RenderContext& context, const SurfacePoint& hit) {
    const auto& [slope_attribute, wave_attribute] = context.ripples[hit.geometry];
    if (!slope_attribute) return {};
    const std::array<float, 4> slope = value_at(context, *slope_attribute, hit),
                               wave = value_at(context, *wave_attribute, hit);
    return {.gradient = {slope[0], slope[1]},
            .shaded_fraction = slope[2],
            .repose_angle = slope[3],
            .wavelength = wave[0],
            .height = wave[1],
            .wind_heading = wave[2],
            .seed = wave[3]};
}

// Converts a width along a triangle to uv space.
float uv_width(const RenderContext& context, const SurfacePoint& hit, float width) {
    const MeshGeometry& mesh = context.world.meshes[hit.geometry];
    float area = 0.5F; // of barycentrics, used if a mesh has no uvs
    if (!mesh.uvs.empty()) {
        const auto& corners = mesh.triangles[hit.primitive];
        const Vec2f b = mesh.uvs[corners[1]] - mesh.uvs[corners[0]],
                    c = mesh.uvs[corners[2]] - mesh.uvs[corners[0]];
        area = 0.5F * std::abs(b.x() * c.y() - b.y() * c.x());
    }
    return hit.area > 0.0F ? width * std::sqrt(area / hit.area) : 0.0F;
}

} // namespace

ShadingPoint shading_point(const RenderContext& context, const Material& material, const SurfacePoint& hit,
                           const Vec3f& wo, float width) {
    ShadingPoint shading;
    shading.wo = wo;
    shading.sidedness_normal =
        hit.shape == PointShape::triangle ? hit.sidedness_normal : hit.geometric_normal;
    shading.normal = hit.normal;
    shading.tangent = hit.tangent;
    shading.uv = hit.uv;
    shading.uv_tiled = context.uv_tiled[hit.geometry] != 0;
    shading.fibre = hit.shape != PointShape::triangle;
    shading.position = hit.position;
    shading.footprint = width;
    shading.tint_weight = tint_weight_at(context, material, hit);
    if (!shading.fibre) {
        if (std::holds_alternative<SandSettings>(material.settings))
            shading.ripples = mesh_ripples(context, hit);
        // The footprint is stretched by 1 / cosine in one direction: use the square of equal area.
        const float cos_wo = std::max(std::abs(hit.geometric_normal.dot(wo)), 0.01F);
        shading.uv_width = uv_width(context, hit, width / std::sqrt(cos_wo));
        return shading;
    }
    if (const AttributeValues* uvs = context.root_uvs[hit.geometry])
        shading.uv = {uvs->data()[2 * size_t(hit.strand)], uvs->data()[2 * size_t(hit.strand) + 1]};
    shading.flat = hit.shape != PointShape::round;
    shading.h = hit.h;
    shading.strand_u = hit.strand_u;
    const uint32_t curve_set = hit.geometry - static_cast<uint32_t>(context.world.meshes.size());
    // An id keeps the look of a strand when other strands are added or removed; an index does not.
    const AttributeValues* ids = context.ids[hit.geometry];
    shading.strand_hash = static_cast<uint32_t>(
        hash(curve_set, ids ? std::bit_cast<uint32_t>(ids->data()[hit.strand]) : hit.strand));
    return shading;
}

} // namespace marram
