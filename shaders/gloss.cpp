// SPDX-License-Identifier: Apache-2.0
// The coat is a surface of GGX microfacets (Walter et al., "Microfacet Models for Refraction through Rough
// Surfaces", 2007), alpha = roughness^2, with Smith's height-correlated shadowing (Heitz, "Understanding the
// Masking-Shadowing Function in Microfacet-Based BRDFs", 2014). In the basis of its normal, h = (x, y, z),
// t^2 = (x^2 + y^2) / z^2:
//
//   D(h) = 1 / (pi alpha^2 z^4 (1 + t^2 / alpha^2)^2)
//   Lambda(mu) = (sqrt(1 + alpha^2 (1 - mu^2) / mu^2) - 1) / 2
//   G1 = 1 / (1 + Lambda),   G2 = 1 / (1 + Lambda_o + Lambda_i)
//   f |cos_i| = F(wo . h) D G2 / (4 cos_o)
//
// D uses x^2 + y^2, which stays accurate for narrow lobes; 1 - z^2 would cancel. Half vectors are sampled
// from the VNDF (Heitz 2018; as spherical caps: Dupuy and Benyoub, "Sampling Visible GGX Normals with
// Spherical Caps", 2023): wi has the pdf G1 D / (4 cos_o) and the weight F G2 / G1.
//
// Light that the coat does not reflect reaches the base, is scattered diffusely and leaves again. With E the
// directional albedo of the gloss and <E> = 2 integral E mu dmu its mean, the term of the base
//
//   c / pi (1 - E(mu_o)) (1 - E(mu_i)) / (1 - <E>)
//
// is reciprocal and has the albedo (1 - E(mu_o)) c, so that a white base loses no energy under any coat
// (Kelemen and Szirmay-Kalos, "A Microfacet Based Coupled Specular-Matte BRDF Model", 2001). E is tabulated
// over sqrt(mu), as it rises steeply at grazing angles. <E> integrates the interpolated table exactly, so
// that the table loses no energy.
#include "shaders/gloss.h"

#include "shaders/fresnel.h"

#include <algorithm>
#include <cmath>

namespace marram {

namespace {

// Position of a value between the nodes 0 ... count - 1, for linear interpolation.
struct Node {
    int below;
    float between;
};
Node node_of(float at, int count) {
    const float clamped = std::clamp(at, 0.0F, static_cast<float>(count - 1));
    const int below = std::min(static_cast<int>(clamped), count - 2);
    return {below, clamped - static_cast<float>(below)};
}

// Maps table positions 0 ... 1 to roughness; nodes are dense at low roughness.
constexpr float least = static_cast<float>(min_roughness);
float roughness_of(float place) { return least + (1.0F - least) * place * place; }
float place_of(float roughness) { return std::sqrt(std::max(0.0F, (roughness - least) / (1.0F - least))); }

// E by VNDF sampling, on a regular grid of 24^2 half vectors; error below 1e-3.
float albedo_of(float cosine, float roughness, float ior) {
    const Microsurface surface(Vec3f::UnitZ(), roughness);
    const Vec3f wo(std::sqrt(1.0F - cosine * cosine), 0.0F, cosine);
    constexpr int side = 24;
    double sum = 0.0;
    for (int i = 0; i < side; ++i)
        for (int j = 0; j < side; ++j) {
            const Vec3f half = surface.sample_half(wo, (static_cast<float>(i) + 0.5F) / side,
                                                   (static_cast<float>(j) + 0.5F) / side);
            const float onto = wo.dot(half), down = 2.0F * onto * half.z() - wo.z();
            if (down <= 0.0F) continue;
            sum += static_cast<double>(fresnel(onto, ior) * surface.smith_g(cosine, down) /
                                       surface.smith_g(cosine));
        }
    return static_cast<float>(sum / (side * side));
}

} // namespace

float ior_of_specular(float share) {
    const float root = std::sqrt(share);
    return (1.0F + root) / (1.0F - root);
}

Microsurface::Microsurface(const Vec3f& unit_normal, float roughness)
    : normal(unit_normal), alpha(roughness * roughness) {
    orthonormal_basis(normal, tangent, bitangent);
}

float Microsurface::density(const Vec3f& half) const {
    const float x = half.dot(tangent), y = half.dot(bitangent), z = half.dot(normal);
    if (!(z > 0.0F)) return 0.0F;
    const float away = z * z + (x * x + y * y) / (alpha * alpha);
    return 1.0F / (pi_f * alpha * alpha * away * away);
}

float Microsurface::smith_g(float cosine) const {
    const float tan2 = (1.0F - cosine * cosine) / (cosine * cosine);
    return 2.0F / (1.0F + std::sqrt(1.0F + alpha * alpha * tan2));
}

float Microsurface::smith_g(float cosine_o, float cosine_i) const {
    const float a2 = alpha * alpha;
    const float o = std::sqrt(1.0F + a2 * (1.0F - cosine_o * cosine_o) / (cosine_o * cosine_o));
    const float i = std::sqrt(1.0F + a2 * (1.0F - cosine_i * cosine_i) / (cosine_i * cosine_i));
    return 2.0F / (o + i);
}

Vec3f Microsurface::sample_half(const Vec3f& wo, float a, float b) const {
    const Vec3f stretched =
        Vec3f(alpha * wo.dot(tangent), alpha * wo.dot(bitangent), wo.dot(normal)).normalized();
    const float phi = 2.0F * pi_f * a, z = (1.0F - b) * (1.0F + stretched.z()) - stretched.z();
    const float r = std::sqrt(std::max(0.0F, (1.0F - z) * (1.0F + z)));
    const Vec3f cap = Vec3f(r * std::cos(phi), r * std::sin(phi), z) + stretched;
    const Vec3f half(alpha * cap.x(), alpha * cap.y(), std::max(cap.z(), 0.0F));
    const float length = half.norm();
    if (!(length > 0.0F)) return normal;
    return (half.x() * tangent + half.y() * bitangent + half.z() * normal) / length;
}

float Microsurface::half_pdf(const Vec3f& wo, const Vec3f& half) const {
    const float cosine = wo.dot(normal);
    return cosine > 0.0F ? smith_g(cosine) * density(half) / (4.0F * cosine) : 0.0F;
}

GlossTable::GlossTable(float ior) {
    if (!(ior > 1.0F)) return; // no interface: nothing is reflected
    for (int r = 0; r < roughnesses; ++r) {
        const float roughness = roughness_of(static_cast<float>(r) / (roughnesses - 1));
        auto& row = albedo_[static_cast<size_t>(r)];
        for (int i = 0; i < cosines; ++i) {
            const float x =
                std::max(static_cast<float>(i) / (cosines - 1), 1e-3F); // approximates the limit at 0
            row[static_cast<size_t>(i)] = albedo_of(x * x, roughness, ior);
        }
        // Exact integral of 2 E mu dmu = 4 E x^3 dx, with mu = x^2 and E linear over [x0, x0 + d].
        double sum = 0.0;
        for (int i = 0; i + 1 < cosines; ++i) {
            const double d = 1.0 / (cosines - 1), x0 = i * d, x1 = x0 + d;
            const double e0 = static_cast<double>(row[static_cast<size_t>(i)]),
                         slope = (static_cast<double>(row[static_cast<size_t>(i) + 1]) - e0) / d;
            const auto power = [&](int n) { return (std::pow(x1, n) - std::pow(x0, n)) / n; };
            sum += 4.0 * ((e0 - slope * x0) * power(4) + slope * power(5));
        }
        mean_[static_cast<size_t>(r)] = static_cast<float>(sum);
    }
}

GlossTable::Row GlossTable::row(float roughness) const {
    const Node at = node_of(place_of(roughness) * (roughnesses - 1), roughnesses);
    const auto below = static_cast<size_t>(at.below);
    return {albedo_[below].data(), albedo_[below + 1].data(), at.between,
            mean_[below] + at.between * (mean_[below + 1] - mean_[below])};
}

float GlossTable::Row::at(float cosine) const {
    const Node node = node_of(std::sqrt(std::max(cosine, 0.0F)) * (cosines - 1), cosines);
    const auto lerp = [&](const float* row) {
        return row[node.below] + node.between * (row[node.below + 1] - row[node.below]);
    };
    const float a = lerp(low);
    return a + between * (lerp(high) - a);
}

} // namespace marram
