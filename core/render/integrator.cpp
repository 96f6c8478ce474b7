// SPDX-License-Identifier: Apache-2.0
// The estimator. A path x0 (camera), x1, x2, ... carries the throughput beta = prod f cos / p of the
// directions sampled so far. Direct light at each vertex is the integral of f cos L over directions. It is
// estimated twice, with two sampling strategies weighted by the power heuristic (Veach, "Robust Monte Carlo
// Methods for Light Transport Simulation", 1997):
//
//   light sampling (next-event estimation), with pdf l:
//     beta f cos L / l . l^2 / (l^2 + p^2), if the shadow ray is not occluded;
//   BSDF sampling, with pdf p:
//     beta' L . p^2 / (l^2 + p^2), if the ray hits a light.
//
// Light that only one strategy can sample has weight 1: light seen directly by the camera, and delta lights.
// Russian roulette ends a path with probability 1 - max(beta); otherwise it divides beta by max(beta).
//
// Shadow rays are subject to roulette too. C is the luminance that an unoccluded light adds to a sample; S is
// the standard deviation of the pixel's samples, from earlier passes. The shadow ray is traced with
// probability q = min(1, C / (w S)), and the contribution is divided by q. This adds C (w S - C), at most
// (w S / 2)^2, to the sample's variance S^2: clean pixels stay clean, and noisy pixels spend their rays on
// bright lights. Time times variance is least for q proportional to C / S (Bolin and Meyer, "An error metric
// for Monte Carlo ray tracing", 1997; Rath et al., "EARS: Efficiency-Aware Russian Roulette and Splitting",
// 2022). The first vertex is well stratified, so S overestimates its noise: w is small there. The estimate is
// unbiased: its expected value does not depend on q.
//
// The clamp limits the indirect light of each sample. Direct light at the first surface is not clamped: it is
// well sampled, and its highlights must stay. The roulette threshold w S is kept far below the clamp, because
// otherwise the clamp would cut the contributions that survive.
//
// Textures are filtered over a ray cone. It is one pixel wide at the camera. After each vertex its width grows
// by at least 1 / sqrt(pi p) per metre: the radius of a disc of solid angle 1 / p, which the sampled direction
// represents (after Akenine-Moller et al., "Texture Level of Detail Strategies for Real-Time Ray Tracing",
// 2019). Surface curvature is ignored.
//
// Random numbers come in sets of four. Set 0: film and lens; set 1: time (set 0 if there is no lens). Then
// two sets per vertex: one for lights and roulette, one for the BSDF. The sets of a vertex do not depend on
// what other vertices use.
//
// The image is rendered in passes of 1, 3, 12, 16, 16, ... samples, so that a preview appears early. In each
// pass one task owns a pixel and adds its samples in order. The ends of passes are fixed, and adaptive
// decisions are made only there: a render that stopped within a pass resumes to the same bits.
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
// The weight w of the shadow-ray roulette (see above), at the first vertex and at later ones.
constexpr float nee_weight_first = 0.3F, nee_weight_indirect = 0.8F;

float luminance(const Vec3f& rgb) { return marram::luminance(rgb[0], rgb[1], rgb[2]); }

// Data shared by all samples.
struct RenderContext {
    const World& world;
    const Lights& lights;
    std::span<const Material> materials;
    const RenderSettings& settings;
    CameraRays camera;
    FilterSampler filter;
    Material fallback;
    std::vector<const AttributeValues*> tints; // [geometry ID]
    std::vector<const AttributeValues*> ids;   // [geometry ID] or nullptr: id of each strand
    std::vector<const AttributeValues*>
        root_uvs; // [geometry ID] or nullptr: surface uv at each strand's root
    std::vector<std::array<const AttributeValues*, 2>> ripples; // [geometry ID of meshes]: both or none
    std::vector<const AttributeValues*> layers;                 // [geometry ID * film layers + layer]
    bool moves;
    float pixel_angle; // radians
    bool wants_albedo = false;
};

// Ray cone: its width, and the growth of the width per metre.
struct Cone {
    float width = 0.0F, growth = 0.0F;
};

struct FirstHit {
    bool hit = false;
    SurfacePoint point;
    Vec3f albedo = Vec3f::Zero(), normal = Vec3f::Zero();
};

float power_heuristic(float mine, float other) {
    if (!(mine > 0.0F)) return 0.0F;
    const float ratio = other / mine; // squared pdfs would overflow for a small sun
    return 1.0F / (1.0F + ratio * ratio);
}

const Material& material_of(const RenderContext& context, int index) {
    const bool known = index >= 0 && static_cast<size_t>(index) < context.materials.size();
    return known ? context.materials[static_cast<size_t>(index)] : context.fallback;
}

void find_attributes(RenderContext& context, const Film& film) {
    for (const FilmLayer& layer : film.layers) context.wants_albedo |= layer.kind == LayerKind::albedo;
    const auto add = [&](const std::vector<AttributeValues>& attributes, int material) {
        context.tints.push_back(find_attribute(attributes, material_of(context, material).tint));
        const AttributeValues* ids = find_attribute(attributes, "id");
        context.ids.push_back(ids && ids->components == 1 && ids->rate == MARRAM_PER_CURVE ? ids : nullptr);
        const AttributeValues* uvs = find_attribute(attributes, "root_uv");
        context.root_uvs.push_back(uvs && uvs->components == 2 && uvs->rate == MARRAM_PER_CURVE ? uvs
                                                                                                : nullptr);
        for (const FilmLayer& layer : film.layers)
            context.layers.push_back(
                layer.kind == LayerKind::attribute ? find_attribute(attributes, layer.name) : nullptr);
    };
    for (const MeshGeometry& mesh : context.world.meshes) {
        add(mesh.attributes, mesh.material);
        context.ripples.push_back({find_attribute(mesh.attributes, ripple_attributes[0]),
                                   find_attribute(mesh.attributes, ripple_attributes[1])});
        for (const AttributeValues* attribute : context.ripples.back())
            if (!attribute || attribute->components != 4) context.ripples.back() = {};
    }
    for (const CurveGeometry& curves : context.world.curves) add(curves.attributes, curves.material);
}

// The value of an attribute at a ray hit; unused components are 0.
std::array<float, 4> value_at(const RenderContext& context, const AttributeValues& attribute,
                              const SurfacePoint& at) {
    std::array<float, 4> values{};
    const World& world = context.world;
    if (at.geometry < world.meshes.size())
        attribute_at(world.meshes[at.geometry], attribute, at, values.data());
    else
        attribute_at(world.curves[at.geometry - world.meshes.size()], attribute, at, values.data());
    return values;
}

const std::vector<AttributeValues>& attributes_of(const World& world, uint32_t geometry) {
    return geometry < world.meshes.size() ? world.meshes[geometry].attributes
                                          : world.curves[geometry - world.meshes.size()].attributes;
}

// The material at a point. A blend picks one of its two materials by a hash of the position and of the
// direction towards the ray's origin.
const Material& material_at(const RenderContext& context, const SurfacePoint& at, const Vec3f& wo) {
    const Material* material = &material_of(context, at.material);
    for (uint64_t depth = 0; const auto* blend = std::get_if<BlendSettings>(&material->settings); ++depth) {
        const AttributeValues* attribute =
            find_attribute(attributes_of(context.world, at.geometry), blend->attribute);
        const double value = attribute ? double(value_at(context, *attribute, at)[0]) : 0.0;
        uint64_t h = depth;
        for (int axis = 0; axis < 3; ++axis)
            h = hash(hash(h, std::bit_cast<uint64_t>(at.position[axis])), std::bit_cast<uint32_t>(wo[axis]));
        material = &material_of(context, select_material(*blend, value, unit_double(h)));
    }
    return *material;
}

// Ids are discrete: never average them. Hash the id to a tint in [0, 1].
float tint_at(const RenderContext& context, const Material& material, const SurfacePoint& at) {
    if (material.tint.empty()) return 0.0F;
    const bool is_base = &material == &material_of(context, at.material); // otherwise one side of a blend
    const AttributeValues* tint =
        is_base ? context.tints[at.geometry]
                : find_attribute(attributes_of(context.world, at.geometry), material.tint);
    if (!tint) return 0.0F;
    const float value = value_at(context, *tint, at)[0];
    return tint->discrete ? unit_float(mix32(std::bit_cast<uint32_t>(value))) : value;
}

SurfaceRipples ripples_at(const RenderContext& context, const SurfacePoint& at) {
    SurfaceRipples ripples;
    const auto& [own, wave] = context.ripples[at.geometry];
    if (!own) return ripples;
    const std::array<float, 4> a = value_at(context, *own, at), b = value_at(context, *wave, at);
    return {{a[0], a[1]}, a[2], a[3], b[0], b[1], b[2], b[3]};
}

// Converts a width along a triangle to uv space.
float uv_width(const RenderContext& context, const SurfacePoint& at, float width) {
    const MeshGeometry& mesh = context.world.meshes[at.geometry];
    float area = 0.5F; // of barycentrics, used if a mesh has no uvs
    if (!mesh.uvs.empty()) {
        const auto& corners = mesh.triangles[at.primitive];
        const Vec2f b = mesh.uvs[corners[1]] - mesh.uvs[corners[0]],
                    c = mesh.uvs[corners[2]] - mesh.uvs[corners[0]];
        area = 0.5F * std::abs(b.x() * c.y() - b.y() * c.x());
    }
    return at.area > 0.0F ? width * std::sqrt(area / at.area) : 0.0F;
}

ShadingPoint shading_point(const RenderContext& context, const Material& material, const SurfacePoint& at,
                           const Vec3f& wo, float width) {
    ShadingPoint point;
    point.wo = wo;
    point.side_normal = at.shape == PointShape::triangle ? at.side_normal : at.geometric_normal;
    point.normal = at.normal;
    point.tangent = at.tangent;
    point.uv = at.uv;
    point.fibre = at.shape != PointShape::triangle;
    point.position = at.position;
    point.footprint = width;
    point.tint = tint_at(context, material, at);
    if (!point.fibre) {
        if (std::holds_alternative<SandSettings>(material.settings)) point.ripples = ripples_at(context, at);
        // The footprint is stretched by 1 / cosine in one direction: use the square of equal area.
        const float cos_wo = std::max(std::abs(at.geometric_normal.dot(wo)), 0.01F);
        point.uv_width = uv_width(context, at, width / std::sqrt(cos_wo));
        return point;
    }
    if (const AttributeValues* uvs = context.root_uvs[at.geometry])
        point.uv = {uvs->values[2 * size_t(at.strand)], uvs->values[2 * size_t(at.strand) + 1]};
    point.flat = at.shape != PointShape::round;
    point.h = at.h;
    point.strand_u = at.strand_u;
    const uint32_t curves = at.geometry - static_cast<uint32_t>(context.world.meshes.size());
    // An id keeps the look of a strand when other strands are added or removed; an index does not.
    const AttributeValues* ids = context.ids[at.geometry];
    point.strand = static_cast<uint32_t>(
        hash(curves, ids ? std::bit_cast<uint32_t>(ids->values[at.strand]) : at.strand));
    return point;
}

// Next-event estimation: samples one light. If the luminance of the contribution is below `nee_threshold`,
// the shadow ray is traced with probability luminance / nee_threshold only, and its contribution is divided
// by that.
Vec3f direct_light(const RenderContext& context, const SurfacePoint& point, const Bsdf& bsdf, float time,
                   const Vec3f& throughput, float nee_threshold, const std::array<float, 3>& random,
                   RayCounts& counts) {
    const LightSample light = context.lights.sample(point.position, time, random);
    if (!(light.pdf > 0.0F)) return Vec3f::Zero();
    if (context.settings.strategy == Strategy::bsdf_sampling && !light.delta) return Vec3f::Zero();
    const Vec3f direction = light.at_infinity
                                ? light.direction
                                : Vec3f((light.target - point.position).normalized().cast<float>());
    const BsdfValue bsdf_value = evaluate(bsdf, direction);
    if (!(bsdf_value.value.maxCoeff() > 0.0F)) return Vec3f::Zero();
    const bool single_strategy = light.delta || context.settings.strategy == Strategy::light_sampling;
    const float weight = single_strategy ? 1.0F : power_heuristic(light.pdf, bsdf_value.pdf);
    Vec3f contribution =
        throughput.cwiseProduct(bsdf_value.value).cwiseProduct(light.radiance) * (weight / light.pdf);
    if (const float estimate = luminance(contribution); estimate < nee_threshold) {
        if (!(light.unused * nee_threshold < estimate)) return Vec3f::Zero();
        contribution *= nee_threshold / estimate;
    }
    Ray ray =
        light.at_infinity ? spawn(point, direction, time) : spawn_towards(point, light.target, 0.0, time);
    ray.mask = MARRAM_CASTS_SHADOWS;
    return occluded(context.world, ray, &counts) ? Vec3f::Zero() : contribution;
}

// MIS weight of light hit along a direction sampled from the BSDF; bsdf_pdf < 0: a camera ray.
float mis_weight(const RenderContext& context, float bsdf_pdf, float light_pdf) {
    if (bsdf_pdf < 0.0F || context.settings.strategy == Strategy::bsdf_sampling) return 1.0F;
    if (context.settings.strategy == Strategy::light_sampling && light_pdf > 0.0F) return 0.0F;
    return power_heuristic(bsdf_pdf, light_pdf);
}

// `deviation`: standard deviation of the luminance of the pixel's samples.
float nee_threshold(const RenderContext& context, float deviation, uint32_t depth) {
    if (depth == 0) return deviation * nee_weight_first;
    const float threshold = deviation * nee_weight_indirect;
    return context.settings.clamp > 0.0F ? std::min(threshold, 0.1F * context.settings.clamp) : threshold;
}

bool survives_roulette(Vec3f& throughput, float random) {
    const float chance = std::min(1.0F, throughput.maxCoeff());
    if (!(random < chance)) return false;
    throughput /= chance;
    return true;
}

// Radiance of a path: direct (at most one scattering) and indirect (more).
struct PathRadiance {
    Vec3f direct = Vec3f::Zero(), indirect = Vec3f::Zero();
    float cut_throughput = 0.0F; // luminance of the throughput of a path that max_depth ends
};

// `deviation`: standard deviation of the pixel's samples; 0: unknown.
PathRadiance trace(const RenderContext& context, Ray ray, float deviation, const Sampler& sampler,
                   FirstHit& first, RayCounts& counts) {
    PathRadiance light;
    Vec3f throughput = Vec3f::Ones();
    float bsdf_pdf = -1.0F;
    Cone cone{0.0F, context.pixel_angle};
    SurfacePoint next_point;
    for (uint32_t depth = 0;; ++depth) {
        SurfacePoint& point = depth == 0 ? first.point : next_point;
        Vec3f& radiance = depth <= 1 ? light.direct : light.indirect; // along the ray
        if (!intersect(context.world, ray, point, depth == 0, &counts)) {
            const auto weight = [&](float light_pdf) { return mis_weight(context, bsdf_pdf, light_pdf); };
            radiance += throughput.cwiseProduct(
                context.lights.environment_radiance(ray.direction, depth == 0, weight));
            return light;
        }
        if (point.light >= 0) {
            const LightRadiance lamp = context.lights.emitted(point, ray.direction);
            if (lamp.pdf >= 0.0F)
                radiance += mis_weight(context, bsdf_pdf, lamp.pdf) * throughput.cwiseProduct(lamp.radiance);
        }
        const bool last = depth >= context.settings.max_depth;
        if (depth == 0) {
            first.hit = true;
            first.normal =
                point.geometric_normal.dot(ray.direction) > 0.0F ? Vec3f(-point.normal) : point.normal;
        }
        if (last) light.cut_throughput = luminance(throughput);
        if (last && !(depth == 0 && context.wants_albedo)) return light;
        cone.width += cone.growth * point.distance;
        const Material& material = material_at(context, point, -ray.direction);
        const Bsdf bsdf =
            bsdf_at(material, shading_point(context, material, point, -ray.direction, cone.width));
        if (depth == 0 && context.wants_albedo) first.albedo = albedo(bsdf);
        if (last) return light;
        const uint32_t set = first_vertex_set + sets_per_vertex * depth;
        const auto [light_u, light_v, light_choice, rr_sample] = sampler.numbers(set);
        if (!context.lights.empty())
            (depth == 0 ? light.direct : light.indirect) += direct_light(
                context, point, bsdf, ray.time, throughput, nee_threshold(context, deviation, depth),
                {light_choice, light_u, light_v}, counts);
        BsdfSample next;
        if (!sample(bsdf, sampler.numbers(set + 1), next)) return light;
        throughput = throughput.cwiseProduct(next.value) / next.pdf;
        if (depth + 1 >= context.settings.roulette_depth && !survives_roulette(throughput, rr_sample))
            return light;
        bsdf_pdf = next.pdf;
        cone.growth = std::max(cone.growth, 1.0F / std::sqrt(static_cast<float>(pi) * next.pdf));
        ray = spawn(point, next.wi, ray.time);
        // BSDF-sampled rays use the mask of shadow rays: both MIS strategies must agree on visibility.
        ray.mask = MARRAM_CASTS_SHADOWS;
    }
}

// Returns the luminance that the clamp removes.
double clamp(Vec3f& indirect, float limit) {
    const float most = indirect.maxCoeff();
    if (!(limit > 0.0F && most > limit)) return 0.0;
    const float before = luminance(indirect);
    indirect *= limit / most;
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
                   size_t layer_count, const SurfacePoint& point, double* sums) {
    const AttributeValues* attribute = context.layers[point.geometry * layer_count + layer_index];
    if (!attribute) return;
    // Discrete values must not be averaged: a pixel keeps the first one.
    if (attribute->discrete && sums[layer.channels] > 0.0) return;
    const std::array<float, 4> values = value_at(context, *attribute, point);
    const std::array<double, 4> wide = {values[0], values[1], values[2], values[3]};
    add(wide.data(), layer.channels, sums);
}

void add_sample(const RenderContext& context, const Vec3f& radiance, const FirstHit& first, const Film& film,
                double* pixel) {
    const bool strand = first.hit && first.point.shape != PointShape::triangle;
    for (size_t i = 0; i < film.layers.size(); ++i) {
        const FilmLayer& layer = film.layers[i];
        double* sums = pixel + layer.sums_offset;
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
            add(first.hit ? 1.0F : 0.0F, sums);
            break;
        case LayerKind::albedo:
            add(first.albedo, sums);
            break;
        case LayerKind::normal:
            add(first.normal, sums);
            break;
        case LayerKind::depth:
            if (first.hit) add(first.point.distance, sums);
            break;
        case LayerKind::strand_u:
            if (strand) add(first.point.strand_u, sums);
            break;
        case LayerKind::attribute:
            if (first.hit) add_attribute(context, layer, i, film.layers.size(), first.point, sums);
            break;
        }
    }
}

Ray camera_ray(const RenderContext& context, const Film& film, uint32_t x, uint32_t y,
               const Sampler& sampler) {
    const auto [film_x, film_y, a, b] = sampler.numbers(0);
    const bool has_lens = context.camera.has_lens();
    const float time = !context.moves ? 0.0F : has_lens ? sampler.numbers(time_set)[0] : a;
    Ray ray = context.camera((x + 0.5 + context.filter(film_x)) / film.width,
                             (y + 0.5 + context.filter(film_y)) / film.height, {a, b}, time);
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
    std::optional<double> at; // time of the clock
    bool over() const { return at && clock() >= *at; }
};

// Renders the samples [begin, end) of a pixel.
void render_pixel(const RenderContext& context, uint32_t x, uint32_t y, uint32_t begin, uint32_t end,
                  Film& film, RenderStats& stats) {
    const size_t at = static_cast<size_t>(y) * film.width + x;
    FilmPixel& pixel = film.pixels[at];
    pixel.samples += end - begin;
    double* sums = film.sums.data() + at * film.stride;
    const uint64_t seed = pixel_seed(context.settings.seed, x, y);
    for (uint32_t s = begin; s < end; ++s) {
        const Sampler sampler(seed, s);
        FirstHit first;
        const Ray ray = camera_ray(context, film, x, y, sampler);
        PathRadiance path = trace(context, ray, pixel.luminance_stddev, sampler, first, stats.rays);
        if ((path.direct + path.indirect).allFinite()) {
            pixel.clamped += clamp(path.indirect, context.settings.clamp);
            const Vec3f radiance = path.direct + path.indirect;
            add_sample(context, radiance, first, film, sums);
            add_luminance(pixel, luminance(radiance));
        } else {
            ++stats.dropped_samples;
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
        uint64_t passed = 0;
        for (uint32_t x = tile.x0; x < tile.x1; ++x) {
            stopped = cancelled(progress) || deadline.over();
            if (stopped) break;
            FilmPixel& pixel = film.pixels[static_cast<size_t>(y) * film.width + x];
            const uint32_t begin = pixel.next_sample;
            if (begin >= end) continue; // done before this pass was interrupted
            pixel.next_sample = end;
            passed += end - begin;
            if (!pixel.converged) render_pixel(context, x, y, begin, end, film, stats);
        }
        if (progress) progress->samples_done.fetch_add(passed, std::memory_order_relaxed);
    }
}

void add_stats(const RenderStats& more, RenderStats& sum) {
    sum.rays.intersect += more.rays.intersect;
    sum.rays.occluded += more.rays.occluded;
    sum.rays.dropped += more.rays.dropped;
    sum.dropped_samples += more.dropped_samples;
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
            RenderStats mine;
            render_tile(context, {x, y, std::min(x + size, film.width), std::min(y + size, film.height)}, end,
                        film, mine, progress, deadline);
            const std::lock_guard lock(guard);
            add_stats(mine, stats);
        }
    };
    tbb::parallel_for(tbb::blocked_range<uint32_t>(0, columns * rows, 1), body, tbb::simple_partitioner());
}

// First end of a pass after `begin`. `begin` lies inside a pass if an earlier render asked for fewer samples.
uint32_t pass_end(uint32_t begin) {
    constexpr uint32_t longest = 16; // samples: a cancel waits for the current pixels to finish the pass
    if (begin >= longest) return (begin / longest + 1) * longest;
    uint32_t end = 1;
    while (end <= begin) end *= 4;
    return end;
}

// True if every pixel is exactly at the end of a pass. Adaptive decisions are made only here, so that a
// resumed render repeats them identically.
bool is_between_passes(uint32_t begin, const Film& film) {
    return begin > 0 && pass_end(begin - 1) == begin && progress_of(film).greatest == begin;
}

// End of the next partial pass. Sized for half of the remaining time: at least one sample, at most to the end
// of the pass. So the deadline interrupts only partial passes of one sample, unless samples become twice as
// slow.
uint32_t partial_pass_end(const Film& film, uint32_t end, double seconds_left, double seconds_per_sample) {
    const uint32_t begin = progress_of(film).least;
    if (!(seconds_per_sample > 0.0)) return std::min(begin + 1, end); // unknown: one sample measures it
    const double pixels =
        double(std::ranges::count(film.pixels, false, &FilmPixel::converged)); // not converged
    const double samples =
        std::max(1.0, std::floor(0.5 * seconds_left / (seconds_per_sample * std::max(pixels, 1.0))));
    return samples < double(end - begin) ? begin + uint32_t(samples) : end;
}

void render_passes(const RenderContext& context, Film& film, RenderStats& stats, RenderProgress* progress) {
    constexpr uint32_t min_adaptive_samples = 16; // samples for a usable variance of a pixel
    const RenderSettings& settings = context.settings;
    const std::function<double()> clock = settings.clock ? settings.clock : wall_seconds;
    const double start = clock();
    Deadline deadline{clock, std::nullopt};
    double seconds_per_sample = 0.0; // 0: not known yet
    for (uint32_t begin = progress_of(film).least; begin < settings.samples;) {
        const uint32_t end = std::min(pass_end(begin), settings.samples);
        if (is_between_passes(begin, film)) {
            if (begin > 1) estimate_deviation(film);
            if (settings.noise > 0.0 && begin >= min_adaptive_samples &&
                !update_convergence(film, settings.noise))
                return;
        }
        while (begin < end) { // partial passes: several only near the deadline
            if (settings.seconds > 0.0 && begin > 0) deadline.at = start + settings.seconds;
            stats.out_of_time = deadline.over();
            if (stats.out_of_time) return;
            const double left = deadline.at ? *deadline.at - clock() : 0.0;
            const uint32_t partial_end =
                deadline.at ? partial_pass_end(film, end, left, seconds_per_sample) : end;
            const uint64_t samples_before = count_samples(film).total;
            const double before = clock();
            render_pass(context, partial_end, film, stats, progress, deadline);
            stats.cancelled = cancelled(progress);
            if (stats.cancelled) return;
            stats.out_of_time = progress_of(film).least < partial_end;
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
                          .moves = world.times.size() > 1 || camera.poses.size() > 1,
                          .pixel_angle =
                              static_cast<float>(2.0 * std::tan(0.5 * camera.vertical_fov) / film.height)};
    find_attributes(context, film);
    RenderStats stats;
    const uint64_t samples_before = count_samples(film).total;
    if (progress) progress->samples_done = progress_of(film).sum;
    render_passes(context, film, stats, progress);
    const SampleCount count = count_samples(film);
    stats.most_samples = count.most;
    stats.mean_samples = count.mean;
    if (count.total > samples_before) stats.cut_throughput /= double(count.total - samples_before);
    stats.clamped = clamped_share(film);
    resolve(film);
    return stats;
}

} // namespace marram
