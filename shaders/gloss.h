// SPDX-License-Identifier: Apache-2.0
// The coat over a diffuse base: gloss of a rough dielectric interface, and the fraction of light that it
// transmits to the base and out again. Shared by the shaders with such a coat. gloss.cpp opens with the
// formulas.
#pragma once

#include "core/math/vec.h"

#include <array>

namespace marram {

// Directional albedo E(mu, roughness) of the gloss for one index of refraction: the fraction of light from
// the angle with cosine mu that is reflected. Built once per material in 20 ms; 5 kB. Linear interpolation,
// error below 2e-3.
class GlossTable {
  public:
    explicit GlossTable(float ior = 1.0F);

    struct Row { // for one roughness, between two rows of the table
        const float *low, *high;
        float between;
        float mean; // 2 integral of E mu dmu, with E as at() returns it
        float at(float cosine) const;
    };
    Row row(float roughness) const;

  private:
    static constexpr int cosines = 48, roughnesses = 24;
    std::array<std::array<float, cosines>, roughnesses> albedo_{};
    std::array<float, roughnesses> mean_{};
};

inline constexpr double min_roughness = 0.03; // below this, float half vectors are as coarse as the lobe

// The index of refraction with this reflectance at normal incidence, 0 <= share < 1.
float ior_of_specular(float share);

// A GGX microfacet distribution with alpha = roughness^2 around `normal`.
struct Microsurface {
    Vec3f normal, tangent, bitangent;
    float alpha;

    Microsurface() = default;
    Microsurface(const Vec3f& unit_normal, float roughness);
    float density(const Vec3f& half) const;                     // D(h), 1/sr; 0 below the surface
    float smith_g(float cosine) const;                          // Smith's G1
    float smith_g(float cosine_o, float cosine_i) const;        // height-correlated G2
    Vec3f sample_half(const Vec3f& wo, float a, float b) const; // samples the VNDF for wo
    float half_pdf(const Vec3f& wo,
                   const Vec3f& half) const; // pdf of wi = reflection of wo about such a half vector
};

} // namespace marram
