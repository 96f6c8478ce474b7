// SPDX-License-Identifier: Apache-2.0
// A path leaves the camera and has vertices 0 (the first hit), 1, 2, ... (`depth`). Its
// throughput beta (`throughput`) is the product of f cos / p over the directions sampled so far; beta'
// includes the direction sampled at this vertex. Direct light at each vertex is the integral of f cos L over
// directions. Its estimate is the sum of two, by two sampling strategies weighted by the power heuristic
// (Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997):
//
//   light sampling (next-event estimation), with pdf l (LightSample::pdf, LightRadiance::pdf):
//     (beta f cos L / l) * l^2 / (l^2 + p^2), if the shadow ray is not occluded;
//   BSDF sampling, with pdf p (`bsdf_pdf`):
//     (beta' L) * p^2 / (l^2 + p^2), if the ray hits a light.
//
// Light that only one strategy can sample has weight 1: light seen directly by the camera, and delta lights.
// Russian roulette (apply_russian_roulette), from vertex RenderSettings::roulette_depth on: a path continues
// with probability q = min(1, largest channel of beta); beta is divided by q.
//
// Shadow rays are subject to roulette too (direct_light). C (`estimate`) is the luminance that an unoccluded
// light adds to a sample. S (`luminance_stddev`) is the standard deviation of one sample's luminance, from
// the variance of the first pilot_samples averaged over the 5x5 neighbourhood; 0: not yet known. w is
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
// A camera ray that hits a shadow catcher ends there: the light that arrives with and without shadows
// (PathRadiance::caught) gives the picture's alpha (film.cpp).
//
// Random numbers come in sets of four (Sampler::get_4d). Set 0: film and lens; set 1: time (without a lens,
// the first of the lens numbers is the time). Then two sets per vertex: the first for lights and roulette,
// the second for the BSDF. Each vertex has fixed sets, whatever earlier vertices consumed.
#include "core/render/path.h"

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

constexpr uint32_t first_vertex_set = 2, sets_per_vertex = 2;
// w of the shadow-ray roulette (see above), at vertex 0 and at later vertices.
constexpr float shadow_rr_scale_first = 0.3F, shadow_rr_scale_later = 0.8F;

// Ray cone: its width in metres, and the increase of the width per metre.
struct Cone {
    float width = 0.0F, spread = 0.0F;
};

// Weight of a sample from the strategy with `pdf`; other_pdf: of the other strategy for the same direction.
float power_heuristic(float pdf, float other_pdf) {
    if (!(pdf > 0.0F)) return 0.0F;
    const float ratio = other_pdf / pdf; // squared pdfs would overflow for a small sun
    return 1.0F / (1.0F + ratio * ratio);
}

Vec3f direction_to(const LightSample& light, const SurfacePoint& hit) {
    return light.at_infinity ? light.direction
                             : Vec3f((light.target - hit.position).normalized().cast<float>());
}

Ray shadow_ray(const LightSample& light, const SurfacePoint& hit, const Vec3f& direction, float time,
               uint32_t mask) {
    constexpr double target_error = 0.0; // the target is already offset by its error
    Ray ray = light.at_infinity ? spawn(hit, direction, time)
                                : spawn_towards(hit, light.target, target_error, time);
    ray.mask = mask;
    return ray;
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
    const Vec3f direction = direction_to(light_sample, hit);
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
    const Ray ray = shadow_ray(light_sample, hit, direction, time, MARRAM_CASTS_SHADOWS);
    return occluded(context.world, ray, &counts) ? Vec3f::Zero() : contribution;
}

// MIS weight of light hit along a direction sampled from the BSDF; bsdf_pdf < 0: a camera ray.
float mis_weight(const RenderContext& context, float bsdf_pdf, float light_pdf) {
    if (bsdf_pdf < 0.0F || context.settings.strategy == Strategy::bsdf_sampling) return 1.0F;
    if (context.settings.strategy == Strategy::light_sampling && light_pdf > 0.0F) return 0.0F;
    return power_heuristic(bsdf_pdf, light_pdf);
}

// w S of the shadow-ray roulette (see above). 0: every shadow ray is traced.
float shadow_rr_threshold(const RenderContext& context, float luminance_stddev, uint32_t depth) {
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

CaughtLight caught_light(const RenderContext& context, const SurfacePoint& hit, const Bsdf& bsdf, float time,
                         const std::array<float, 3>& light_numbers, RayCounts& counts) {
    const LightSample light_sample = context.lights.sample(hit.position, time, light_numbers);
    if (!(light_sample.pdf > 0.0F)) return {};
    const Vec3f direction = direction_to(light_sample, hit);
    const float full =
        luminance(evaluate(bsdf, direction).value.cwiseProduct(light_sample.radiance)) / light_sample.pdf;
    if (!(full > 0.0F) || !std::isfinite(full)) return {};
    const Ray ray = shadow_ray(light_sample, hit, direction, time, darkens_catchers);
    return {occluded(context.world, ray, &counts) ? 0.0F : full, full};
}

} // namespace

PathRadiance trace_path(const RenderContext& context, Ray ray, float luminance_stddev, const Sampler& sampler,
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
                                             shadow_rr_threshold(context, luminance_stddev, depth),
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

} // namespace marram
