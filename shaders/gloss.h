// SPDX-License-Identifier: Apache-2.0
// What lies on top of a matt body: the gloss of a rough dielectric boundary, and the share of light that it lets through to
// the body and out again. Shared by the shaders that have such a boundary. gloss.cpp opens with the formulas.
#pragma once

#include "core/math/vec.h"

#include <array>

namespace marram {

// Directional albedo E(mu, roughness) of the gloss of one index of refraction: the share of light from an angle of cosine mu
// that is reflected. Made once a material, in 20 ms; 5 kB. Linear between nodes, off by less than 2e-3.
class GlossTable {
  public:
    explicit GlossTable(float ior = 1.0F);

    struct Row { // at one roughness
        const float *low, *high;
        float between;
        float mean; // 2 integral of E mu dmu, of what at() gives
        float at(float cosine) const;
    };
    Row row(float roughness) const;

  private:
    static constexpr int cosines = 48, roughnesses = 24;
    std::array<std::array<float, cosines>, roughnesses> albedo_{};
    std::array<float, roughnesses> mean_{};
};

inline constexpr double least_roughness = 0.03; // below it half vectors in floats are as coarse as the lobe

// The index whose boundary reflects this share of what comes straight at it, 0 <= share < 1.
float ior_of_specular(float share);

// A GGX microsurface of width alpha = roughness^2 around `normal`.
struct Microsurface {
    Vec3f normal, tangent, bitangent;
    float alpha;

    Microsurface() = default;
    Microsurface(const Vec3f& unit_normal, float roughness);
    float density(const Vec3f& half) const;                     // D(h), 1/sr; 0 below
    float visible(float cosine) const;                          // Smith's G1
    float visible(float cosine_o, float cosine_i) const;        // height-correlated G2
    Vec3f sample_half(const Vec3f& wo, float a, float b) const; // of those that wo sees
    float half_pdf(const Vec3f& wo,
                   const Vec3f& half) const; // of wi, drawn by mirroring at such a half vector
};

} // namespace marram
