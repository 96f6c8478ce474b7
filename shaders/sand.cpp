// SPDX-License-Identifier: Apache-2.0
// Grains: Oren-Nayar in a form with a closed-form albedo, with energy compensation (Portsmouth, Kutz and
// Hill, "EON: A Practical Energy-Preserving Rough Diffuse BRDF", JCGT 2025). With r the roughness, s = wo .
// wi - cos_o cos_i, t = max(cos_o, cos_i) where s > 0, else 1,
//
//   f = color / pi (A + B s / t) + color' / pi (1 - E_o) (1 - E_i) / (1 - <E>)
//   A = 1 / (1 + (1/2 - 2/(3 pi)) r),  B = r A
//   E(theta) = A + B / pi (sin (theta - sin cos - 2/3) + 2/3 tan (1 - sin^3))
//   <E> = A (1 + (2/3 - 28/(15 pi)) r),  color' = color^2 <E> / (1 - color (1 - <E>))
//
// tan (1 - sin^3) = sin cos (1 + sin + sin^2) / (1 + sin), which has no pole.
//
// Facets: the fraction `sparkle` of the surface is quartz facets, GGX of roughness 0.6 (gloss.h). The grains
// below receive what the facets transmit.
//
// Glints: each of the N facets in a pixel footprint reflects from wo to wi with probability p = D(h) (n . h)
// pi g^2, with g the half-angle of the facet's blur. The number of reflecting facets is Poisson-distributed
// with mean N p; the gloss is scaled by this number over N p. The random number is a hash of a cell of space
// and a cell of h. The cell of space has about the size of the footprint: a grain times a power of two, and
// two sizes are blended to avoid popping when the camera moves. Four cells of h are blended, so that glints
// appear and fade smoothly as the sun moves. For large N p the factor is 1. After Deliot and Belcour,
// "Real-Time Rendering of Glinty Appearances using Distributed Binomial Laws on Anisotropic Grids", 2023,
// whose counts are sampled similarly.
//
// Ripples: crests and slopes are from core/math/ripples.cpp. A pixel with footprint axes a and b on the
// ground sees the slope times exp(-s^2 / 2), s^2 = (k . a / 2)^2 + (k . b / 2)^2, k the wave vector. So
// crests that run away from the camera stay sharp at grazing angles. The remaining variance of slope is added
// to the roughness of the grains. If the factor is below 1/256, the slope is not computed.
#include "shaders/sand.h"

#include "shaders/fresnel.h"

#include "core/math/hash.h"

#include <algorithm>
#include <optional>

namespace marram {

namespace {

constexpr float quartz = 1.54F;
constexpr float facet_roughness = 0.6F;
constexpr float blur =
    static_cast<float>(1.5 * degree); // of a facet: its curvature and the angular radius of the sun
constexpr float many = 4096.0F;       // reflecting facets: the factor is 1 +- 1/64 at most

float oren_nayar_albedo(float single, float bend, float cosine) {
    const float c = std::clamp(cosine, 0.0F, 1.0F), s = std::sqrt((1.0F - c) * (1.0F + c));
    const float g =
        s * (std::acos(c) - s * c - 2.0F / 3.0F) + 2.0F / 3.0F * s * c * (1.0F + s + s * s) / (1.0F + s);
    // tan (1 - s^3) = s (1 - s)(1 + s + s^2) / c, and (1 - s) / c = c / (1 + s)
    return std::min(single + bend / pi_f * g, 1.0F);
}

// Samples a Poisson distribution from one uniform number. For large means: uniform with the same mean and
// variance.
float poisson(float mean_count, float u) {
    constexpr float large = 24.0F;
    if (mean_count > large) return mean_count + std::sqrt(3.0F * mean_count) * (2.0F * u - 1.0F);
    float chance = std::exp(-mean_count), below = chance, count = 0.0F;
    constexpr float most = 96.0F; // more than ten standard deviations above `large`
    while (u >= below && count < most) {
        count += 1.0F;
        chance *= mean_count / count;
        below += chance;
    }
    return count;
}

// Octahedral map of a direction to [-1, 1]^2 (Cigolle et al., "A Survey of Efficient Representations for
// Independent Unit Vectors", JCGT 2014). The solid angles of equal cells agree within a factor of two.
Vec2f octahedral_map(const Vec3f& d) {
    const float sum = std::abs(d.x()) + std::abs(d.y()) + std::abs(d.z());
    const Vec2f p(d.x() / sum, d.z() / sum);
    if (d.y() >= 0.0F) return p;
    return {(1.0F - std::abs(p.y())) * (p.x() < 0.0F ? -1.0F : 1.0F),
            (1.0F - std::abs(p.x())) * (p.y() < 0.0F ? -1.0F : 1.0F)};
}

// onto: cosine between wo and the ground's normal.
Footprint footprint_of(const ShadingPoint& point, float onto) {
    const Vec3f& n = point.sidedness_normal;
    const Vec3f away = point.wo - point.wo.dot(n) * n;
    const float sine = away.norm();
    const auto on_ground = [](const Vec3f& v) { return Vec2f(v.x(), v.z()); };
    if (!(sine > 0.0F)) return {{point.footprint, 0.0F}, {0.0F, point.footprint}}; // seen from above
    return {point.footprint * on_ground(n.cross(away / sine)),
            point.footprint / onto * on_ground(away / sine)};
}

} // namespace

std::vector<ParamSpec> sand_params() {
    std::vector<ParamSpec> params = {
        {"color", ParamType::color, "", "[0.56, 0.42, 0.28]", 0.0, 1.0, "",
         "share of light that dry sand returns"},
        {"roughness", ParamType::number, "", "0.8", 0.0, 1.0, "",
         "of the grains: 0 even (Lambert), 1 as flat as the full moon"},
        {"ripple_height", ParamType::number, "m", "0.008", 0.0, 1000.0, "", "from trough to crest; 0: none"},
        {"ripple_length", ParamType::number, "m", "0.11", 1e-6, 1e6, "", "from crest to crest"},
        {"ripple_direction", ParamType::number, "deg", "0", -36000.0, 36000.0, "",
         "heading of the wind that made them: 0 towards +x, 90 towards +z"},
        {"sparkle", ParamType::number, "", "0.05", 0.0, 1.0, "",
         "fraction of the surface that is glassy facets; 0: none"},
        {"grain", ParamType::number, "m", "0.0004", 1e-9, 1000.0, "", "from grain to grain"},
    };
    for (ParamSpec& spec : strand_color_params()) params.push_back(std::move(spec));
    return params;
}

SandSettings read_sand(const ParamSet& params, const TextureOpener& open) {
    SandSettings settings;
    settings.color = read_strand_color(params, open);
    settings.roughness = static_cast<float>(params.number("roughness"));
    settings.ripple_height = static_cast<float>(params.number("ripple_height"));
    settings.ripple_length = static_cast<float>(params.number("ripple_length"));
    const double heading = params.number("ripple_direction") * degree;
    settings.ripple_direction = {std::cos(heading), std::sin(heading)};
    RippleSettings ripples;
    ripples.wavelength = static_cast<double>(settings.ripple_length);
    ripples.height = static_cast<double>(settings.ripple_height);
    settings.ripples = RippleField(ripples);
    settings.sparkle = static_cast<float>(params.number("sparkle"));
    settings.grain = static_cast<float>(params.number("grain"));
    settings.ior = quartz;
    settings.gloss = GlossTable(quartz);
    return settings;
}

Ripple ripple_at(const SandSettings& settings, const ShadingPoint& at, const Footprint& pixel_axes) {
    Ripple ripple;
    RipplePoint point;
    point.at = {at.position.x(), at.position.z()};
    std::optional<RippleField> given;
    if (const SurfaceRipples& own = at.ripples; own.wavelength > 0.0F) {
        point.gradient = own.gradient.cast<double>();
        point.strength = double(own.shaded_fraction);
        const double heading = double(own.wind_heading);
        point.wind = {std::cos(heading), std::sin(heading)};
        if (point.strength > 0.0)
            given.emplace(RippleSettings{double(own.wavelength), double(own.height), double(own.repose_angle),
                                         uint64_t(own.seed)});
    } else {
        const Vec3f up = at.normal.y() < 0.0F ? Vec3f(-at.normal) : at.normal; // flipped on the underside
        const Vec2f rise(-up.x(), -up.z());
        if (!(up.y() > 0.0F)) return ripple;
        point.gradient = (rise / up.y()).cast<double>();
        point.wind = settings.ripple_direction;
        point.strength = settings.ripple_height > 0.0F ? 1.0 : 0.0;
    }
    point.strength *= ripples_on_slope(point.gradient);
    if (!(point.strength > 0.0)) return ripple;
    const RippleField& field = given ? *given : settings.ripples;
    const Vec2d wave = field.wave(point);
    const double a_half = 0.5 * wave.dot(pixel_axes.across.cast<double>()),
                 b_half = 0.5 * wave.dot(pixel_axes.away.cast<double>());
    const double seen = std::exp(-0.5 * (a_half * a_half + b_half * b_half));
    ripple.unresolved_variance = static_cast<float>(field.slope_variance(point) * (1.0 - seen * seen));
    constexpr double none = 1.0 / 256.0; // the slope is below 0.4, so this is negligible
    if (!(seen > none)) return ripple;
    double metres = 0.0;
    Vec2d slope = Vec2d::Zero();
    field.displacements({&point, 1}, {&metres, 1}, {&slope, 1});
    ripple.slope = (seen * slope).cast<float>();
    return ripple;
}

float glint(const SandSettings& settings, const Vec3d& position, float width, const Vec3f& half,
            float chance) {
    const float smallest = settings.grain; // closer to the camera single grains are resolved
    const float level = std::max(0.0F, std::log2(std::max(width, smallest) / smallest));
    if (!std::isfinite(level)) return 1.0F;
    const float whole = std::floor(level);
    const Vec2f at = octahedral_map(half) / (2.0F * blur);
    const Vec2f low = at.array().floor();
    float sum = 0.0F;
    for (int size = 0; size < 2; ++size) {
        const float share = size == 0 ? 1.0F - (level - whole) : level - whole;
        const double side = static_cast<double>(smallest) * std::exp2(static_cast<double>(whole) + size);
        const double facets =
            side * side / (static_cast<double>(settings.grain) * static_cast<double>(settings.grain));
        const float expected = static_cast<float>(facets) * chance;
        if (share == 0.0F) continue;
        if (!(expected > 0.0F) || expected > many) {
            sum += share;
            continue;
        }
        uint64_t cell = static_cast<uint64_t>(whole) + static_cast<uint64_t>(size);
        for (int axis = 0; axis < 3; ++axis) {
            const double i = std::floor(position[axis] / side);
            cell = hash(cell, static_cast<uint64_t>(static_cast<int64_t>(std::clamp(i, -1e15, 1e15))));
        }
        for (int corner = 0; corner < 4; ++corner) {
            const Vec2f of(static_cast<float>(corner & 1), static_cast<float>(corner >> 1));
            const Vec2f near = Vec2f::Ones() - (at - low - of).cwiseAbs();
            const auto column = static_cast<uint64_t>(static_cast<int64_t>(low.x() + of.x())),
                       row = static_cast<uint64_t>(static_cast<int64_t>(low.y() + of.y()));
            const float u = unit_float(static_cast<uint32_t>(hash(hash(cell, column), row)));
            sum += share * near.x() * near.y() * poisson(expected, u) / expected;
        }
    }
    return sum;
}

SandBsdf sand_at(const SandSettings& settings, const ShadingPoint& point) {
    SandBsdf bsdf;
    bsdf.settings = &settings;
    const float side = point.sidedness_normal.dot(point.wo) < 0.0F ? -1.0F : 1.0F;
    bsdf.wo = point.wo;
    bsdf.sidedness_normal = side * point.sidedness_normal;
    bsdf.position = point.position;
    // The footprint is stretched by 1 / cosine on the ground; width is that of a circle with the same area.
    const float onto = std::max(std::abs(point.sidedness_normal.dot(point.wo)), 0.01F);
    bsdf.width = point.footprint / std::sqrt(onto);

    Vec3f normal = side * point.normal;
    const Ripple ripple = ripple_at(settings, point, footprint_of(point, onto));
    // Displacement along the normal (-g, 1) / sqrt(1 + g^2) adds slope / normal.y to the gradient g of the
    // height along y. Up to normalisation this subtracts the slope from the normal.
    const float up = normal.y() < 0.0F ? -1.0F : 1.0F;
    normal = (normal - up * Vec3f(ripple.slope.x(), 0.0F, ripple.slope.y())).normalized();
    bsdf.normal = normal;

    const float r =
        std::min(1.0F, std::sqrt(settings.roughness * settings.roughness + ripple.unresolved_variance));
    bsdf.single = 1.0F / (1.0F + (0.5F - 2.0F / (3.0F * pi_f)) * r);
    bsdf.bend = r * bsdf.single;
    bsdf.mean_albedo = bsdf.single * (1.0F + (2.0F / 3.0F - 28.0F / (15.0F * pi_f)) * r);
    const float cosine = std::max(normal.dot(point.wo), 0.0F);
    bsdf.albedo_o = oren_nayar_albedo(bsdf.single, bsdf.bend, cosine);
    bsdf.color = color_at(settings.color, point);
    bsdf.color = bsdf.color.cwiseProduct(variation_factor(settings.color, point, bsdf.color));
    for (int c = 0; c < 3; ++c)
        bsdf.multiple_color[c] = bsdf.color[c] * bsdf.color[c] * bsdf.mean_albedo /
                                 (1.0F - bsdf.color[c] * (1.0F - bsdf.mean_albedo));

    bsdf.facets = Microsurface(normal, facet_roughness);
    bsdf.gloss = settings.gloss.row(facet_roughness);
    const float lost = settings.sparkle * bsdf.gloss.at(cosine);
    bsdf.through = 1.0F - lost;
    const float body = bsdf.through * mean(bsdf.color), shine = cosine > 0.0F ? lost : 0.0F;
    bsdf.gloss_probability = shine > 0.0F ? shine / (shine + body) : 0.0F;
    return bsdf;
}

BsdfValue evaluate(const SandBsdf& bsdf, const Vec3f& wi) {
    BsdfValue result;
    const float cosine = bsdf.normal.dot(wi), cosine_o = bsdf.normal.dot(bsdf.wo);
    if (!(cosine > 0.0F)) return result;
    const bool seen = bsdf.sidedness_normal.dot(wi) > 0.0F;
    result.pdf = (1.0F - bsdf.gloss_probability) * cosine / pi_f;
    if (seen) {
        const float o = std::max(cosine_o, 0.0F), s = bsdf.wo.dot(wi) - o * cosine;
        const float t = s > 0.0F ? std::max({o, cosine, 1e-6F}) : 1.0F; // o = cosine = 0: f cos is 0
        const float missing = 1.0F - bsdf.mean_albedo;
        const float again = missing > 0.0F
                                ? (1.0F - bsdf.albedo_o) *
                                      (1.0F - oren_nayar_albedo(bsdf.single, bsdf.bend, cosine)) / missing
                                : 0.0F;
        const float share = bsdf.settings->sparkle;
        const float under =
            bsdf.through * (1.0F - share * bsdf.gloss.at(cosine)) / (1.0F - share * bsdf.gloss.mean);
        const float single = std::max(bsdf.single + bsdf.bend * s / t, 0.0F);
        result.value = under * cosine / pi_f * (single * bsdf.color + again * bsdf.multiple_color);
    }
    const Vec3f sum = bsdf.wo + wi;
    const float length = sum.norm();
    if (bsdf.gloss_probability == 0.0F || !(length > 0.0F)) return result;
    const Vec3f half = sum / length;
    result.pdf += bsdf.gloss_probability * bsdf.facets.half_pdf(bsdf.wo, half);
    if (!seen) return result;
    const float density = bsdf.facets.density(half);
    const float chance = std::min(1.0F, density * bsdf.normal.dot(half) * pi_f * blur * blur);
    const float facets = bsdf.settings->sparkle * fresnel(bsdf.wo.dot(half), bsdf.settings->ior) * density *
                         bsdf.facets.smith_g(cosine_o, cosine) / (4.0F * cosine_o);
    if (facets > 0.0F)
        result.value +=
            Vec3f::Constant(facets * glint(*bsdf.settings, bsdf.position, bsdf.width, half, chance));
    return result;
}

bool sample(const SandBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result) {
    if (random[2] < bsdf.gloss_probability) {
        const Vec3f half = bsdf.facets.sample_half(bsdf.wo, random[0], random[1]);
        result.wi = (2.0F * bsdf.wo.dot(half) * half - bsdf.wo).normalized();
    } else {
        result.wi = cosine_direction(bsdf.normal, random[0], random[1]);
    }
    const BsdfValue at = evaluate(bsdf, result.wi);
    result.value = at.value;
    result.pdf = at.pdf;
    return at.pdf > 0.0F && std::isfinite(at.pdf) && at.value.maxCoeff() > 0.0F;
}

Vec3f albedo(const SandBsdf& bsdf) {
    return bsdf.through * (bsdf.mean_albedo * bsdf.color + (1.0F - bsdf.mean_albedo) * bsdf.multiple_color) +
           Vec3f::Constant(1.0F - bsdf.through);
}

} // namespace marram
