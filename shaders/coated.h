// SPDX-License-Identifier: Apache-2.0
// A diffuse base that reflects and transmits, under a rough dielectric coat on both sides. Used by grass and
// surface. The formulas are in gloss.cpp. With E the directional albedo of the coat and <E> its mean:
//
//   f |cos| = (1 - E(mu_o)) (1 - E(mu_i)) / (1 - <E>) * c / pi |cos_i|     c: reflectance or transmittance
//             + F D G2 / (4 cos_o)                                         on wo's side
//
// Sampling selects gloss, reflection or transmission in proportion to the light that each returns.
#pragma once

#include "shaders/gloss.h"
#include "shaders/shading_point.h"

namespace marram {

struct CoatedBsdf {
    Vec3f wo, normal, sidedness_normal; // both normals on wo's side
    Vec3f reflectance, transmittance;   // of the base
    Microsurface surface;
    GlossTable::Row gloss; // row of a table that must outlive the closure
    float ior;
    float base_scale;                             // (1 - E(mu_o)) / (1 - <E>)
    float gloss_probability, reflect_probability; // the rest is transmission
};

struct Coat {
    const GlossTable* table;
    float ior, roughness;
};
// `normal`: the shading normal, on either side.
CoatedBsdf coated(const ShadingPoint& point, const Vec3f& normal, const Vec3f& reflectance,
                  const Vec3f& transmittance, const Coat& coat);
BsdfValue evaluate(const CoatedBsdf& bsdf, const Vec3f& wi);
bool sample(const CoatedBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const CoatedBsdf& bsdf);

} // namespace marram
