// SPDX-License-Identifier: Apache-2.0
// The estimator. A path leaves the camera and has vertices 0 (the first hit), 1, 2, ... (`depth`). Its
// throughput beta (`throughput`) is the product of f cos / p over the directions sampled so far; beta'
// includes the direction sampled at this vertex. Direct light at each vertex is the integral of f cos L over
// directions. It is estimated twice, with two sampling strategies weighted by the power heuristic (Veach,
// "Robust Monte Carlo Methods for Light Transport Simulation", 1997):
//
//   light sampling (next-event estimation), with pdf l (LightSample::pdf, LightRadiance::pdf):
//     (beta f cos L / l) * l^2 / (l^2 + p^2), if the shadow ray is not occluded;
//   BSDF sampling, with pdf p (`bsdf_pdf`):
//     (beta' L) * p^2 / (l^2 + p^2), if the ray hits a light.
//
// Light that only one strategy can sample has weight 1: light seen directly by the camera, and delta lights.
// Russian roulette (apply_russian_roulette): a path continues with probability q = min(1, largest channel of
// beta); beta is divided by q.
//
// Shadow rays are subject to roulette too (direct_light). C (`estimate`) is the luminance that an unoccluded
// light adds to a sample. S (`luminance_stddev`) is the standard deviation of one sample's luminance, from
// the variance averaged over the 5x5 neighbourhood after the last complete pass; 0: not yet known. w is
// `shadow_rr_scale_first` or `_later`. The shadow ray is traced with probability q = min(1, C / (w S)), and
// the contribution is divided by q. This adds C (w S - C) to the sample's variance S^2. The added variance is
// at most (w / 2)^2 of what the pixel already has; noisy pixels skip shadow rays to dim lights. A q
// proportional to C / S maximises efficiency, 1 / (time * variance) (Bolin and Meyer, "An error metric for
// Monte Carlo ray tracing", 1997; Rath et al., "EARS: Efficiency-Aware Russian Roulette and Splitting",
// 2022). Vertex 0 is well stratified, so S overestimates its noise: w is smaller there. The estimate is
// unbiased: its expected value does not depend on q.
//
// The clamp (RenderSettings::indirect_clamp) limits the indirect light of each sample. Direct light at vertex
// 0 is not clamped: it is well sampled, and clamping it would darken highlights. At later vertices
// `nee_threshold`, which is w S, is at most a tenth of the clamp: a survivor is scaled up to luminance w S;
// if that exceeded the clamp, the clamp would bias it.
//
// Textures are filtered over a ray cone (after Akenine-Moller et al., "Texture Level of Detail Strategies for
// Real-Time Ray Tracing", 2019). The cone has width 0 at the camera and spreads by one pixel per unit
// distance. From each vertex on it spreads by at least 1 / sqrt(pi p): the radius, half the width, of a disc
// of solid angle 1 / p, which the sampled direction represents. Surface curvature is ignored.
//
// Random numbers come in sets of four (Sampler::get_4d). Set 0: film and lens; set 1: time (without a lens,
// the first of the lens numbers is the time). Then two sets per vertex: the first for lights and roulette,
// the second for the BSDF. Each vertex has fixed sets, whatever earlier vertices consumed.
//
// The image is rendered in passes of 1, 3, 12, 16, 16, ... samples, so that a preview appears early. In each
// pass one task owns a pixel and adds its samples in order. The ends of passes are fixed, and adaptive
// decisions are made only there: a render that stopped within a pass gives a bit-identical result when
// resumed.
#include "core/render/integrator.h"

#include "core/math/clock.h"
#include "core/math/color.h"
#include "core/math/hash.h"
#include "core/render/adaptive.h"
#include "core/render/sampler.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

namespace marram {

namespace {

constexpr uint32_t time_set = 1, first_vertex_set = 2, sets_per_vertex = 2;
// w of the shadow-ray roulette (see above), at vertex 0 and at later vertices.
constexpr float shadow_rr_scale_first = 0.3F, shadow_rr_scale_later = 0.8F;

float luminance(const Vec3f& rgb) { return marram::luminance(rgb[0], rgb[1], rgb[2]); }

// Data shared by all samples.
struct RenderContext {
    const World& world;
    const Lights& lights;
    std::span<const Material> materials;
    const RenderSettings& settings;
    CameraRays camera;
    FilterSampler filter;
    Material default_material;                           // of hits without a material
    std::vector<const AttributeValues*> tint_attributes; // [geometry ID] or nullptr
    std::vector<const AttributeValues*> ids;             // [geometry ID] or nullptr: id of each strand
    std::vector<const AttributeValues*>
        root_uvs; // [geometry ID] or nullptr: surface uv at each strand's root
    std::vector<char>
        uv_tiled; // [geometry ID] true: uvs of a mesh, or at the roots of strands, outside the unit square
    std::vector<std::array<const AttributeValues*, 2>>
        ripples; // [mesh]: both ripple attributes, or nullptr twice
    std::vector<const AttributeValues*>
        layer_attributes; // [geometry ID * film layers + layer] or nullptr: attribute of this layer (AOV)
    bool has_motion_blur;
    float pixel_spread; // width of a pixel per metre, at the image centre
    bool wants_albedo = false;
};

// Ray cone: its width in metres, and the increase of the width per metre.
struct Cone {
    float width = 0.0F, spread = 0.0F;
};

// Vertex 0, for the layers.
struct FirstHit {
    bool found = false;
    SurfacePoint point;
    Vec3f albedo = Vec3f::Zero(), normal = Vec3f::Zero();
};

// Weight of a sample from the strategy with `pdf`; other_pdf: of the other strategy for the same direction.
float power_heuristic(float pdf, float other_pdf) {
    if (!(pdf > 0.0F)) return 0.0F;
    const float ratio = other_pdf / pdf; // squared pdfs would overflow for a small sun
    return 1.0F / (1.0F + ratio * ratio);
}

const Material& material_of(const RenderContext& context, int index) {
    const bool known = index >= 0 && static_cast<size_t>(index) < context.materials.size();
    return known ? context.materials[static_cast<size_t>(index)] : context.default_material;
}

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

// The value of an attribute at a ray hit; unused components are 0.
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

const std::vector<AttributeValues>& attributes_of(const World& world, uint32_t geometry) {
    return geometry < world.meshes.size() ? world.meshes[geometry].attributes
                                          : world.curves[geometry - world.meshes.size()].attributes;
}

// The material at a point. A blend picks one of its two materials by a hash of the position and of the
// direction towards the ray's origin.
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

// width: of the ray cone.
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
        shading.uv = {uvs->values[2 * size_t(hit.strand)], uvs->values[2 * size_t(hit.strand) + 1]};
    shading.flat = hit.shape != PointShape::round;
    shading.h = hit.h;
    shading.strand_u = hit.strand_u;
    const uint32_t curve_set = hit.geometry - static_cast<uint32_t>(context.world.meshes.size());
    // An id keeps the look of a strand when other strands are added or removed; an index does not.
    const AttributeValues* ids = context.ids[hit.geometry];
    shading.strand_hash = static_cast<uint32_t>(
        hash(curve_set, ids ? std::bit_cast<uint32_t>(ids->values[hit.strand]) : hit.strand));
    return shading;
}

// Next-event estimation: samples one light. If the luminance of the contribution is below `nee_threshold`,
// the shadow ray is traced with probability luminance / nee_threshold only, and its contribution is divided
// by that. light_numbers: as for Lights::sample.
Vec3f direct_light(const RenderContext& context, const SurfacePoint& hit, const Bsdf& bsdf, float time,
                   const Vec3f& throughput, float nee_threshold, const std::array<float, 3>& light_numbers,
                   RayCounts& counts) {
    const LightSample light_sample = context.lights.sample(hit.position, time, light_numbers);
    if (!(light_sample.pdf > 0.0F)) return Vec3f::Zero();
    if (context.settings.strategy == Strategy::bsdf_sampling && !light_sample.delta) return Vec3f::Zero();
    const Vec3f direction = light_sample.at_infinity
                                ? light_sample.direction
                                : Vec3f((light_sample.target - hit.position).normalized().cast<float>());
    const auto [f_cos, bsdf_pdf] = evaluate(bsdf, direction);
    if (!(f_cos.maxCoeff() > 0.0F)) return Vec3f::Zero();
    const bool single_strategy = light_sample.delta || context.settings.strategy == Strategy::light_sampling;
    const float weight = single_strategy ? 1.0F : power_heuristic(light_sample.pdf, bsdf_pdf);
    Vec3f contribution =
        throughput.cwiseProduct(f_cos).cwiseProduct(light_sample.radiance) * (weight / light_sample.pdf);
    if (const float estimate = luminance(contribution); estimate < nee_threshold) {
        if (!(light_sample.rr_u * nee_threshold < estimate)) return Vec3f::Zero();
        contribution *= nee_threshold / estimate;
    }
    constexpr double target_error = 0.0; // the target is already offset by its error
    Ray shadow_ray = light_sample.at_infinity ? spawn(hit, direction, time)
                                              : spawn_towards(hit, light_sample.target, target_error, time);
    shadow_ray.mask = MARRAM_CASTS_SHADOWS;
    return occluded(context.world, shadow_ray, &counts) ? Vec3f::Zero() : contribution;
}

// MIS weight of light hit along a direction sampled from the BSDF; bsdf_pdf < 0: a camera ray.
float mis_weight(const RenderContext& context, float bsdf_pdf, float light_pdf) {
    if (bsdf_pdf < 0.0F || context.settings.strategy == Strategy::bsdf_sampling) return 1.0F;
    if (context.settings.strategy == Strategy::light_sampling && light_pdf > 0.0F) return 0.0F;
    return power_heuristic(bsdf_pdf, light_pdf);
}

// w S of the shadow-ray roulette (see above). 0: every shadow ray is traced.
float nee_threshold(const RenderContext& context, float luminance_stddev, uint32_t depth) {
    if (depth == 0) return luminance_stddev * shadow_rr_scale_first;
    const float threshold = luminance_stddev * shadow_rr_scale_later;
    return context.settings.indirect_clamp > 0.0F
               ? std::min(threshold, 0.1F * context.settings.indirect_clamp)
               : threshold;
}

// False ends the path. Divides the throughput of a survivor by its probability.
bool apply_russian_roulette(Vec3f& throughput, float rr_sample) {
    const float survival = std::min(1.0F, throughput.maxCoeff());
    if (!(rr_sample < survival)) return false;
    throughput /= survival;
    return true;
}

// Light at a point on a shadow catcher, by sampling one light: luminance of what it scatters to the camera,
// and of what it would without shadows. Not weighted with BSDF sampling: the ratio of the sums is wanted, and
// only where light sampling finds light.
struct CaughtLight {
    float lit = 0.0F, full = 0.0F;
};

CaughtLight caught_light(const RenderContext& context, const SurfacePoint& hit, const Bsdf& bsdf, float time,
                         const std::array<float, 3>& light_numbers, RayCounts& counts) {
    const LightSample light_sample = context.lights.sample(hit.position, time, light_numbers);
    if (!(light_sample.pdf > 0.0F)) return {};
    const Vec3f direction = light_sample.at_infinity
                                ? light_sample.direction
                                : Vec3f((light_sample.target - hit.position).normalized().cast<float>());
    const float full =
        luminance(evaluate(bsdf, direction).value.cwiseProduct(light_sample.radiance)) / light_sample.pdf;
    if (!(full > 0.0F) || !std::isfinite(full)) return {};
    Ray shadow_ray = light_sample.at_infinity ? spawn(hit, direction, time)
                                              : spawn_towards(hit, light_sample.target, 0.0, time);
    shadow_ray.mask = darkens_catchers;
    return {occluded(context.world, shadow_ray, &counts) ? 0.0F : full, full};
}

// Radiance of a path: direct (scattered at one vertex or none) and indirect (at more).
struct PathRadiance {
    Vec3f direct = Vec3f::Zero(), indirect = Vec3f::Zero();
    float cut_throughput = 0.0F; // luminance of the throughput of a path that max_depth ends
    std::optional<CaughtLight> caught; // the camera ray hit a shadow catcher
};

// luminance_stddev: see FilmPixel.
PathRadiance trace(const RenderContext& context, Ray ray, float luminance_stddev, const Sampler& sampler,
                   FirstHit& first, RayCounts& counts) {
    PathRadiance path;
    Vec3f throughput = Vec3f::Ones();
    float bsdf_pdf = -1.0F; // of the ray's direction; < 0: a camera ray
    Cone cone{0.0F, context.pixel_spread};
    SurfacePoint later_hit;
    for (uint32_t depth = 0;; ++depth) { // of the vertex that the ray hits
        const bool is_camera_ray = depth == 0, coherent = is_camera_ray;
        SurfacePoint& hit = is_camera_ray ? first.point : later_hit;
        // Emission seen by this ray is direct light of the previous vertex, so depth 1 still counts as
        // direct.
        Vec3f& emission_sum = depth <= 1 ? path.direct : path.indirect;
        if (!intersect(context.world, ray, hit, coherent, &counts)) {
            const auto weight = [&](float light_pdf) { return mis_weight(context, bsdf_pdf, light_pdf); };
            emission_sum += throughput.cwiseProduct(
                context.lights.environment_radiance(ray.direction, is_camera_ray, weight));
            return path;
        }
        if (hit.light >= 0) {
            const LightRadiance emitted = context.lights.emitted(hit, ray.direction);
            if (emitted.pdf >= 0.0F) // the emitting side
                emission_sum +=
                    mis_weight(context, bsdf_pdf, emitted.pdf) * throughput.cwiseProduct(emitted.radiance);
        }
        const bool is_catcher = is_camera_ray && hit.geometry < context.world.meshes.size() &&
                                context.world.meshes[hit.geometry].shadow_catcher;
        if (is_catcher) {
            const Material& material = material_at(context, hit, -ray.direction);
            const Bsdf bsdf = bsdf_at(
                material, shading_point(context, material, hit, -ray.direction, cone.spread * hit.distance));
            const auto [light_u, light_v, light_choice, unused] = sampler.get_4d(first_vertex_set);
            path.caught.emplace();
            if (!context.lights.empty())
                path.caught =
                    caught_light(context, hit, bsdf, ray.time, {light_choice, light_u, light_v}, counts);
            return path;
        }
        const bool last = depth >= context.settings.max_depth;
        if (is_camera_ray) {
            first.found = true;
            first.normal = hit.geometric_normal.dot(ray.direction) > 0.0F ? Vec3f(-hit.normal) : hit.normal;
        }
        if (last) path.cut_throughput = luminance(throughput);
        if (last && !(is_camera_ray && context.wants_albedo)) return path;
        cone.width += cone.spread * hit.distance;
        const Material& material = material_at(context, hit, -ray.direction);
        const Bsdf bsdf =
            bsdf_at(material, shading_point(context, material, hit, -ray.direction, cone.width));
        if (is_camera_ray && context.wants_albedo) first.albedo = albedo(bsdf);
        if (last) return path;
        const uint32_t set = first_vertex_set + sets_per_vertex * depth;
        // The best stratified numbers, the first two, choose the point on the light.
        const auto [light_u, light_v, light_choice, rr_sample] = sampler.get_4d(set);
        Vec3f& direct_light_sum = depth == 0 ? path.direct : path.indirect;
        if (!context.lights.empty())
            direct_light_sum += direct_light(context, hit, bsdf, ray.time, throughput,
                                             nee_threshold(context, luminance_stddev, depth),
                                             {light_choice, light_u, light_v}, counts);
        BsdfSample next;
        if (!sample(bsdf, sampler.get_4d(set + 1), next)) return path;
        throughput = throughput.cwiseProduct(next.value) / next.pdf;
        if (depth + 1 >= context.settings.roulette_depth && !apply_russian_roulette(throughput, rr_sample))
            return path;
        bsdf_pdf = next.pdf;
        cone.spread = std::max(cone.spread, 1.0F / std::sqrt(static_cast<float>(pi) * next.pdf));
        ray = spawn(hit, next.wi, ray.time);
        // BSDF-sampled rays use the mask of shadow rays: both MIS strategies must agree on visibility.
        ray.mask = MARRAM_CASTS_SHADOWS;
    }
}

// Returns the luminance that the clamp removes.
double clamp_indirect(Vec3f& indirect, float limit) {
    const float max_channel = indirect.maxCoeff();
    if (!(limit > 0.0F && max_channel > limit)) return 0.0;
    const float before = luminance(indirect);
    indirect *= limit / max_channel;
    return before - luminance(indirect);
}

void add(const double* values, uint32_t channels, double* sums) {
    for (uint32_t c = 0; c < channels; ++c) sums[c] += values[c];
    sums[channels] += 1.0;
}

void add(const Vec3f& color, double* sums) {
    for (int c = 0; c < 3; ++c) sums[c] += static_cast<double>(color[c]);
    sums[3] += 1.0;
}

void add(float value, double* sums) {
    sums[0] += static_cast<double>(value);
    sums[1] += 1.0;
}

void add_attribute(const RenderContext& context, const FilmLayer& layer, size_t layer_index,
                   size_t layer_count, const SurfacePoint& hit, double* sums) {
    const AttributeValues* attribute = context.layer_attributes[hit.geometry * layer_count + layer_index];
    if (!attribute) return;
    // Discrete values must not be averaged: a pixel keeps the first one.
    if (attribute->discrete && sums[layer.channels] > 0.0) return;
    const std::array<float, 4> values = value_at(context, *attribute, hit);
    const std::array<double, 4> wide = {values[0], values[1], values[2], values[3]};
    add(wide.data(), layer.channels, sums);
}

void add_sample(const RenderContext& context, const Vec3f& radiance, const FirstHit& first, const Film& film,
                double* pixel_sums) {
    const bool on_strand = first.found && first.point.shape != PointShape::triangle;
    for (size_t i = 0; i < film.layers.size(); ++i) {
        const FilmLayer& layer = film.layers[i];
        double* sums = pixel_sums + layer.sums_offset;
        switch (layer.kind) {
        case LayerKind::beauty:
            add(radiance, sums);
            break;
        case LayerKind::variance:
            for (int c = 0; c < 3; ++c) {
                const auto value = static_cast<double>(radiance[c]);
                sums[c] += value;
                sums[c + 3] += value * value;
            }
            sums[6] += 1.0;
            break;
        case LayerKind::alpha:
            add(first.found ? 1.0F : 0.0F, sums);
            break;
        case LayerKind::albedo:
            add(first.albedo, sums);
            break;
        case LayerKind::normal:
            add(first.normal, sums);
            break;
        case LayerKind::depth:
            if (first.found) add(first.point.distance, sums);
            break;
        case LayerKind::strand_u:
            if (on_strand) add(first.point.strand_u, sums);
            break;
        case LayerKind::attribute:
            if (first.found) add_attribute(context, layer, i, film.layers.size(), first.point, sums);
            break;
        }
    }
}

Ray camera_ray(const RenderContext& context, const Film& film, uint32_t x, uint32_t y,
               const Sampler& sampler) {
    const auto [film_x, film_y, lens_u, lens_v] = sampler.get_4d(0);
    const bool has_lens = context.camera.has_lens();
    const float time = !context.has_motion_blur ? 0.0F : has_lens ? sampler.get_4d(time_set)[0] : lens_u;
    Ray ray = context.camera((x + 0.5 + context.filter(film_x)) / film.width,
                             (y + 0.5 + context.filter(film_y)) / film.height, {lens_u, lens_v}, time);
    ray.mask = MARRAM_SEEN_BY_CAMERA;
    return ray;
}

struct Tile {
    uint32_t x0, y0, x1, y1;
};

bool cancelled(const RenderProgress* progress) {
    return progress && progress->cancel && progress->cancel->load(std::memory_order_relaxed);
}

struct Deadline {
    const std::function<double()>& clock;
    std::optional<double> time; // of the clock
    bool passed() const { return time && clock() >= *time; }
};

// Renders the samples [begin, end) of a pixel.
void render_pixel(const RenderContext& context, uint32_t x, uint32_t y, uint32_t begin, uint32_t end,
                  Film& film, RenderStats& stats) {
    const size_t pixel_index = static_cast<size_t>(y) * film.width + x;
    FilmPixel& pixel = film.pixel_states[pixel_index];
    pixel.samples += end - begin;
    double* sums = film.sums.data() + pixel_index * film.stride;
    const uint64_t seed = pixel_seed(context.settings.seed, x, y);
    for (uint32_t s = begin; s < end; ++s) {
        const Sampler sampler(seed, s);
        FirstHit first;
        const Ray ray = camera_ray(context, film, x, y, sampler);
        PathRadiance path = trace(context, ray, pixel.luminance_stddev, sampler, first, stats.rays);
        if ((path.direct + path.indirect).allFinite()) {
            pixel.clamped_luminance_sum += clamp_indirect(path.indirect, context.settings.indirect_clamp);
            const Vec3f radiance = path.direct + path.indirect;
            add_sample(context, radiance, first, film, sums);
            float noise = luminance(radiance);
            if (path.caught) { // its noise is the shadow's
                CatcherSums& caught = film.catchers[pixel_index];
                caught.samples += 1.0;
                caught.lit += double(path.caught->lit);
                caught.full += double(path.caught->full);
                noise += path.caught->lit;
            }
            add_luminance(pixel, noise);
        } else {
            ++stats.nonfinite_samples;
        }
        stats.cut_throughput += double(path.cut_throughput);
        if ((s + 1) % samples_per_block == 0) end_block(pixel);
    }
}

// Renders the samples up to `end` of the pixels of a tile; each pixel continues at its next sample.
void render_tile(const RenderContext& context, const Tile& tile, uint32_t end, Film& film, RenderStats& stats,
                 RenderProgress* progress, const Deadline& deadline) {
    bool stopped = false;
    for (uint32_t y = tile.y0; y < tile.y1 && !stopped; ++y) {
        uint64_t advanced = 0; // samples
        for (uint32_t x = tile.x0; x < tile.x1; ++x) {
            stopped = cancelled(progress) || deadline.passed();
            if (stopped) break;
            FilmPixel& pixel = film.pixel_states[static_cast<size_t>(y) * film.width + x];
            const uint32_t begin = pixel.next_sample;
            if (begin >= end) continue; // completed by an earlier render() that stopped within this pass
            pixel.next_sample = end;
            advanced += end - begin;
            if (!pixel.converged) render_pixel(context, x, y, begin, end, film, stats);
        }
        if (progress) progress->samples_done.fetch_add(advanced, std::memory_order_relaxed);
    }
}

void add_stats(const RenderStats& more, RenderStats& sum) {
    sum.rays.intersect += more.rays.intersect;
    sum.rays.occluded += more.rays.occluded;
    sum.rays.invalid += more.rays.invalid;
    sum.nonfinite_samples += more.nonfinite_samples;
    sum.cut_throughput += more.cut_throughput;
}

void render_pass(const RenderContext& context, uint32_t end, Film& film, RenderStats& stats,
                 RenderProgress* progress, const Deadline& deadline) {
    const uint32_t size = std::max(context.settings.tile, 1U);
    const uint32_t columns = (film.width + size - 1) / size, rows = (film.height + size - 1) / size;
    std::mutex guard;
    const auto body = [&](const tbb::blocked_range<uint32_t>& range) {
        for (uint32_t i = range.begin(); i < range.end(); ++i) {
            const uint32_t x = i % columns * size, y = i / columns * size;
            RenderStats tile_stats;
            render_tile(context, {x, y, std::min(x + size, film.width), std::min(y + size, film.height)}, end,
                        film, tile_stats, progress, deadline);
            const std::lock_guard lock(guard);
            add_stats(tile_stats, stats);
        }
    };
    tbb::parallel_for(tbb::blocked_range<uint32_t>(0, columns * rows, 1), body, tbb::simple_partitioner());
}

// First end of a pass after `begin`. `begin` lies inside a pass if an earlier render asked for fewer samples.
uint32_t pass_end(uint32_t begin) {
    constexpr uint32_t max_length = 16; // max pass length in samples; bounds how long a cancel waits
    if (begin >= max_length) return (begin / max_length + 1) * max_length;
    uint32_t end = 1;
    while (end <= begin) end *= 4;
    return end;
}

// True if every pixel is exactly at the end of a pass. Adaptive decisions are made only here, so that a
// resumed render repeats them identically.
bool is_between_passes(uint32_t begin, const Film& film) {
    return begin > 0 && pass_end(begin - 1) == begin && progress_of(film).max == begin;
}

// End of the next partial pass, at most `end`. A partial pass is planned to use half the time left. It
// overruns only if samples become twice as slow, or if it is already down to one sample.
uint32_t partial_pass_end(const Film& film, uint32_t end, double seconds_left, double seconds_per_sample) {
    const uint32_t begin = progress_of(film).min;
    if (!(seconds_per_sample > 0.0))
        return std::min(begin + 1, end); // cost unknown: take one sample to measure it
    const double unconverged_pixels =
        double(std::ranges::count(film.pixel_states, false, &FilmPixel::converged));
    const double samples = std::max(
        1.0, std::floor(0.5 * seconds_left / (seconds_per_sample * std::max(unconverged_pixels, 1.0))));
    return samples < double(end - begin) ? begin + uint32_t(samples) : end;
}

void render_passes(const RenderContext& context, Film& film, RenderStats& stats, RenderProgress* progress) {
    constexpr uint32_t min_adaptive_samples = 16; // samples for a usable variance of a pixel
    const RenderSettings& settings = context.settings;
    const std::function<double()> clock = settings.clock ? settings.clock : wall_seconds;
    const double start = clock();
    Deadline deadline{clock, std::nullopt};
    double seconds_per_sample = 0.0; // 0: not known yet
    for (uint32_t begin = progress_of(film).min; begin < settings.samples;) {
        const uint32_t end = std::min(pass_end(begin), settings.samples);
        if (is_between_passes(begin, film)) {
            if (begin > 1) update_luminance_stddev(film);
            if (settings.noise_threshold > 0.0 && begin >= min_adaptive_samples &&
                mark_converged_pixels(film, settings.noise_threshold) == 0)
                return;
        }
        while (begin < end) { // partial passes: several near the deadline, or to measure the cost
            // The first sample is always completed.
            if (settings.seconds > 0.0 && begin > 0) deadline.time = start + settings.seconds;
            stats.out_of_time = deadline.passed();
            if (stats.out_of_time) return;
            const double left = deadline.time ? *deadline.time - clock() : 0.0;
            const uint32_t partial_end =
                deadline.time ? partial_pass_end(film, end, left, seconds_per_sample) : end;
            const uint64_t samples_before = count_samples(film).total;
            const double before = clock();
            render_pass(context, partial_end, film, stats, progress, deadline);
            stats.cancelled = cancelled(progress);
            if (stats.cancelled) return;
            stats.out_of_time = progress_of(film).min < partial_end;
            if (stats.out_of_time) return;
            const uint64_t samples_taken = count_samples(film).total - samples_before;
            if (samples_taken > 0) seconds_per_sample = (clock() - before) / double(samples_taken);
            begin = partial_end;
        }
        if (begin < settings.samples && progress && progress->between_passes) progress->between_passes(film);
    }
}

} // namespace

RenderStats render(const World& world, const Lights& lights, std::span<const Material> materials,
                   const Camera& camera, const RenderSettings& settings, Film& film,
                   RenderProgress* progress) {
    RenderContext context{.world = world,
                          .lights = lights,
                          .materials = materials,
                          .settings = settings,
                          .camera = CameraRays(camera, film.width, film.height),
                          .filter = FilterSampler(settings.filter),
                          .has_motion_blur = world.times.size() > 1 || camera.poses.size() > 1,
                          .pixel_spread =
                              static_cast<float>(2.0 * std::tan(0.5 * camera.vertical_fov) / film.height)};
    find_attributes(context, film);
    RenderStats stats;
    const uint64_t samples_before = count_samples(film).total;
    if (progress) progress->samples_done = progress_of(film).sum;
    render_passes(context, film, stats, progress);
    const SampleCount count = count_samples(film);
    stats.max_samples = count.max;
    stats.mean_samples = count.mean;
    if (count.total > samples_before) stats.cut_throughput /= double(count.total - samples_before);
    stats.clamped_fraction = clamped_fraction(film);
    resolve(film);
    return stats;
}

} // namespace marram
