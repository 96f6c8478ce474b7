// SPDX-License-Identifier: Apache-2.0
// A body that scatters evenly, back and through, under a glossy boundary on both sides: what grass and plain surfaces are
// made of. See gloss.h for the formulas.
//
//   f |cos| = share_through(mu_o) share_through(mu_i) / mean share * c / pi |cos_i|     c: reflectance or transmittance
//             + F D G2 / (4 cos_o)                                                      on wo's side
//
// Sampled by choosing gloss, reflection or transmission in the proportion of what each returns.
#pragma once

#include "shaders/gloss.h"
#include "shaders/shading_point.h"

namespace marram {

struct CoatedBsdf {
    Vec3f wo, normal, geometric_normal; // both normals on wo's side
    Vec3f reflectance, transmittance;   // of the body
    Microsurface surface;
    GlossTable::Row gloss; // of a table that outlives the closure
    float ior;
    float into;                                   // (1 - E(mu_o)) / (1 - <E>)
    float gloss_probability, reflect_probability; // the rest is transmission
};

struct Coat {
    const GlossTable* table;
    float ior, roughness;
};
// `normal`: for shading; either side.
CoatedBsdf coated(const ShadingPoint& point, const Vec3f& normal, const Vec3f& reflectance,
                  const Vec3f& transmittance, const Coat& coat);
BsdfValue evaluate(const CoatedBsdf& bsdf, const Vec3f& wi);
bool sample(const CoatedBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result);
Vec3f albedo(const CoatedBsdf& bsdf);

} // namespace marram
