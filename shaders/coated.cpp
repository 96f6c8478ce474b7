// SPDX-License-Identifier: Apache-2.0
#include "shaders/coated.h"

#include "shaders/fresnel.h"

namespace marram {

CoatedBsdf coated(const ShadingPoint& point, const Vec3f& normal, const Vec3f& reflectance,
                  const Vec3f& transmittance, const Coat& coat) {
    CoatedBsdf bsdf;
    const float side = point.sidedness_normal.dot(point.wo) < 0.0F ? -1.0F : 1.0F;
    bsdf.wo = point.wo;
    bsdf.normal = side * normal;
    bsdf.sidedness_normal = side * point.sidedness_normal;
    bsdf.reflectance = reflectance;
    bsdf.transmittance = transmittance;
    bsdf.surface = Microsurface(bsdf.normal, coat.roughness);
    bsdf.gloss = coat.table->row(coat.roughness);
    bsdf.ior = coat.ior;
    // The shading normal may face away from wo. Then E is that of grazing incidence, and there is no gloss.
    const float through = 1.0F - bsdf.gloss.at(bsdf.normal.dot(point.wo));
    bsdf.base_scale = through / (1.0F - bsdf.gloss.mean);
    const float back = through * mean(reflectance), on = through * mean(transmittance);
    const float shine = bsdf.normal.dot(point.wo) > 0.0F && coat.ior > 1.0F ? 1.0F - through : 0.0F;
    const float sum = back + on + shine;
    bsdf.gloss_probability = sum > 0.0F ? shine / sum : 0.0F;
    bsdf.reflect_probability = sum > 0.0F ? back / sum : 1.0F;
    return bsdf;
}

BsdfValue evaluate(const CoatedBsdf& bsdf, const Vec3f& wi) {
    const float cosine = bsdf.normal.dot(wi);
    const bool above = cosine > 0.0F, seen = (bsdf.sidedness_normal.dot(wi) > 0.0F) == above;
    BsdfValue result;
    const float density = std::abs(cosine) / pi_f;
    const float rest = std::max(0.0F, 1.0F - bsdf.gloss_probability - bsdf.reflect_probability);
    result.pdf = density * (above ? bsdf.reflect_probability : rest);
    if (seen)
        result.value = density * bsdf.base_scale * (1.0F - bsdf.gloss.at(std::abs(cosine))) *
                       (above ? bsdf.reflectance : bsdf.transmittance);
    const float cosine_o = bsdf.normal.dot(bsdf.wo);
    if (!above || !(cosine_o > 0.0F) || bsdf.gloss_probability == 0.0F) return result;
    const Vec3f sum = bsdf.wo + wi;
    const float length = sum.norm();
    if (!(length > 0.0F)) return result;
    const Vec3f half = sum / length;
    result.pdf += bsdf.gloss_probability * bsdf.surface.half_pdf(bsdf.wo, half);
    if (seen)
        result.value += Vec3f::Constant(fresnel(bsdf.wo.dot(half), bsdf.ior) * bsdf.surface.density(half) *
                                        bsdf.surface.smith_g(cosine_o, cosine) / (4.0F * cosine_o));
    return result;
}

bool sample(const CoatedBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result) {
    if (random[2] < bsdf.gloss_probability) {
        const Vec3f half = bsdf.surface.sample_half(bsdf.wo, random[0], random[1]);
        result.wi = (2.0F * bsdf.wo.dot(half) * half - bsdf.wo).normalized();
        if (!(result.wi.dot(bsdf.normal) > 0.0F)) return false; // below the surface: shadowed
    } else {
        const float side = random[2] < bsdf.gloss_probability + bsdf.reflect_probability ? 1.0F : -1.0F;
        result.wi = cosine_direction(side * bsdf.normal, random[0], random[1]);
    }
    const BsdfValue at = evaluate(bsdf, result.wi);
    result.value = at.value;
    result.pdf = at.pdf;
    return at.pdf > 0.0F && std::isfinite(at.pdf) && at.value.maxCoeff() > 0.0F;
}

Vec3f albedo(const CoatedBsdf& bsdf) {
    const float through = bsdf.base_scale * (1.0F - bsdf.gloss.mean);
    return through * (bsdf.reflectance + bsdf.transmittance) + Vec3f::Constant(1.0F - through);
}

} // namespace marram
