// SPDX-License-Identifier: Apache-2.0
// The fibre scattering function, Chiang et al. 2016 (after Marschner 2003, d'Eon 2011). A fibre's axis is t;
// a direction w has sin theta = w . t and an azimuth phi about t, measured from wo's. With h = sin gamma_o
// the offset at which wo meets the unit circle of the cross-section, and p internal path segments,
//
//   f cos = sum_p M_p(theta_o, theta_i) A_p(h, theta_o) N_p(phi_i)
//
// A_p: dielectric Fresnel F at the incidence cos theta_o cos gamma_o, and absorption along one chord,
//   T = exp(-2 sigma cos gamma_t / cos theta_t):
//   A_0 = F, A_1 = (1-F)^2 T, A_p+1 = A_p F T; the residual p >= 3 is the rest of the series,
//   A_2 F T / (1 - F T). With T = 1 they sum to 1: white fibres lose no energy. The chord is refracted with
//   Bravais' index eta' = sqrt(eta^2 - sin^2 theta_o) / cos theta_o: sin gamma_t = h / eta'.
// N_p: a logistic of scale s about Phi_p = 2 gamma_o - 2 p gamma_t + p pi (reflection turns by 2 gamma_o,
//   each refraction by gamma_o - gamma_t), truncated to [-pi, pi]; 1 / (2 pi) for the residual.
// M_p: d'Eon's, exactly normalised over cos theta dtheta. With v the variance,
//   M = I0(c_i c_o / v) exp(-s_i s_o / v) / (2 v sinh(1/v)) ,     c, s = cos, sin of theta
//     = I0e(c_i c_o / v) exp(-((c_i - c_o)^2 + (s_i + s_o)^2) / (2 v)) / (v (1 - exp(-2/v))) ,
//   I0e(x) = exp(-x) I0(x). The second form neither overflows nor cancels.
//   Sampling (d'Eon 2013) about the specular cone: cos a = 1 + v log(u + (1 - u) exp(-2/v)), azimuth 2 pi u'.
// The scales tilt the cuticle's normals by alpha towards the root: theta_o is shifted by +2 alpha for R,
//   -alpha for TT, -4 alpha for TRT. The lobes then leave at -theta_o - 2 alpha (R, towards the root),
//   + alpha and + 4 alpha. To first order this matches a cone that widens towards the tip, at eta = 1.5. A
//   cone that is tilted past the axis comes out on the other side; |cos| keeps the integral of M_p at 1 there.
//
// Fits of Chiang et al.: v from roughness, s from azimuthal roughness, sigma from the multiple-scattering
// colour. sigma of melanin: d'Eon et al. 2011, for a unit radius. I0: Abramowitz and Stegun 9.8.1 and 9.8.2,
// error below 2e-7.
//
// Sampling is exact: select a lobe with probability mean(A_p), then invert the CDFs of M_p and N_p. The pdf
// is the sum over all lobes.
#include "shaders/hair.h"

#include "shaders/fresnel.h"

#include <algorithm>

namespace marram {

namespace {

constexpr int lobe_count = 4;

// M_p of all lobes. For small arguments x of I0, the factor exp(-x) of I0e moves to the other exponential.
Float4 longitudinal(const HairBsdf& bsdf, float cos_i, float sin_i) {
    constexpr float small = 3.75F;
    const Float4 x = cos_i * bsdf.lobe_cos * bsdf.precision;
    const Float4 t = x * (1.0F / small) * (x * (1.0F / small));
    Float4 i0 = t * 0.0045813F + 0.0360768F;
    i0 = i0 * t + 0.2659732F;
    i0 = i0 * t + 1.2067492F;
    i0 = i0 * t + 3.0899424F;
    i0 = i0 * t + 3.5156229F;
    i0 = i0 * t + 1.0F;
    const Float4 large = max(x, Float4{} + small), r = small / large;
    Float4 i0e = r * 0.00392377F - 0.01647633F;
    i0e = i0e * r + 0.02635537F;
    i0e = i0e * r - 0.02057706F;
    i0e = i0e * r + 0.00916281F;
    i0e = i0e * r - 0.00157565F;
    i0e = i0e * r + 0.00225319F;
    i0e = i0e * r + 0.01328592F;
    i0e = i0e * r + 0.39894228F;
    i0e /= sqrt(large);
    const Float4 c = cos_i - bsdf.lobe_cos, s = sin_i + bsdf.lobe_sin;
    const Float4 away = -0.5F * (c * c + s * s) * bsdf.precision;
    return exp_of_negative(x < small ? away - x : away) * (x < small ? i0 : i0e) * bsdf.scale;
}

// N_p of all lobes.
Float4 azimuthal(const HairBsdf& bsdf, float phi) {
    Float4 x = abs(phi - bsdf.lobe_azimuth); // at most 2 pi, as both are in [-pi, pi]
    x = min(x, 2.0F * pi_f - x);
    const Float4 e = exp_of_negative(x * (-1.0F / bsdf.logistic_scale));
    Float4 n = e / (bsdf.logistic_scale * bsdf.logistic_norm * (1.0F + e) * (1.0F + e));
    n[lobe_count - 1] = 0.5F / pi_f;
    return n;
}

// Samples the logistic truncated to [-pi, pi]; norm is its integral there.
float sample_logistic(float random, float scale, float norm) {
    const float below = 0.5F * (1.0F - norm);
    const float u = std::clamp(below + random * norm, 0x1p-24F, 1.0F - 0x1p-24F);
    return std::clamp(-scale * std::log(1.0F / u - 1.0F), -pi_f, pi_f);
}

// Phi_p of all lobes.
Float4 exit_azimuths(float gamma_o, float gamma_t) {
    return 2.0F * gamma_o + Float4{0.0F, 1.0F, 2.0F, 3.0F} * (pi_f - 2.0F * gamma_t);
}

// Wraps angles of up to ten turns to -pi ... pi.
Float4 wrap(Float4 angle) { return angle - 2.0F * pi_f * round(angle * (0.5F / pi_f)); }

Vec3f absorption_of_color(const Vec3f& color, float azimuthal_roughness) {
    const float b = azimuthal_roughness;
    const float scale = 5.969F + b * (-0.215F + b * (2.532F + b * (-10.73F + b * (5.574F + b * 0.245F))));
    Vec3f sigma;
    for (int c = 0; c < 3; ++c) {
        constexpr float darkest = 1e-8F; // transmits less than 1e-6; log needs an argument above 0
        const float root = std::log(std::clamp(color[c], darkest, 1.0F)) / scale;
        sigma[c] = root * root;
    }
    return sigma;
}

Vec3f absorption_of_melanin(float melanin, float redness) {
    return melanin * ((1.0F - redness) * Vec3f(0.419F, 0.697F, 1.37F) + redness * Vec3f(0.187F, 0.4F, 1.05F));
}

// Multiple-scattering colour of many such fibres; the inverse of absorption_of_color.
Vec3f color_of_absorption(const Vec3f& sigma, float azimuthal_roughness) {
    const float b = azimuthal_roughness;
    const float scale = 5.969F + b * (-0.215F + b * (2.532F + b * (-10.73F + b * (5.574F + b * 0.245F))));
    return (-scale * sigma.array().sqrt()).exp();
}

void set_attenuation(HairBsdf& bsdf, const Vec3f& sigma, float fresnel_reflectance, float chord) {
    const Float4 left = exp_of_negative(-chord * Float4{sigma[0], sigma[1], sigma[2]});
    const Vec3f transmitted(left[0], left[1], left[2]);
    const float f = fresnel_reflectance;
    bsdf.attenuation[0] = Vec3f::Constant(f);
    bsdf.attenuation[1] = (1.0F - f) * (1.0F - f) * transmitted;
    bsdf.attenuation[2] = bsdf.attenuation[1].cwiseProduct(f * transmitted);
    for (int c = 0; c < 3; ++c) { // f = 1: no light enters, 0 / 0 is set to 0
        const float again = f * transmitted[c];
        bsdf.attenuation[3][c] = again < 1.0F ? bsdf.attenuation[2][c] * again / (1.0F - again) : 0.0F;
    }
    for (int p = 0; p < lobe_count; ++p) bsdf.probability[p] = mean(bsdf.attenuation[p]);
    const float all = sum(bsdf.probability);
    if (all > 0.0F) bsdf.probability /= all; // else black with ior = 1: no lobe is sampled
}

// Melanin is converted to a colour, so that tint and variation work the same for both; it has no gradient.
void set_pigment(HairSettings& settings, const ParamSet& params) {
    StrandColor& color = settings.color;
    if (params.text("pigment") == "melanin") {
        const Vec3f sigma = absorption_of_melanin(static_cast<float>(params.number("melanin")),
                                                  static_cast<float>(params.number("melanin_redness")));
        color.color = color_of_absorption(sigma, settings.azimuthal_roughness);
        color.has_root = color.has_tip = false;
    }
    settings.same_everywhere = !color.has_root && !color.has_tip && color.variation == 0.0F && !color.map &&
                               params.text("tint") == "none";
    settings.base_color = color.color;
    settings.base_absorption = absorption_of_color(color.color, settings.azimuthal_roughness);
}

void set_lobe_cones(HairBsdf& bsdf, const HairSettings& settings) {
    const float s = bsdf.sin_theta_o, c = bsdf.cos_theta_o;
    const auto& st = settings.sin_tilt;
    const auto& ct = settings.cos_tilt;
    bsdf.lobe_sin = Float4{s * ct[1] + c * st[1], s * ct[0] - c * st[0], s * ct[2] - c * st[2], s};
    bsdf.lobe_cos = abs(Float4{c * ct[1] - s * st[1], c * ct[0] + s * st[0], c * ct[2] + s * st[2],
                               c}); // abs: tilted past the axis
}

} // namespace

std::vector<ParamSpec> hair_params() {
    std::vector<ParamSpec> params = {
        {"pigment", ParamType::choice, "", "\"color\"", 0.0, 0.0, "color|melanin",
         "what sets the absorption"},
        {"color", ParamType::color, "", "[0.6, 0.45, 0.3]", 0.0, 1.0, "",
         "multiple-scattering colour of many such fibres"},
        {"melanin", ParamType::number, "", "1.3", 0.0, 100.0, "",
         "pigment: 0 white, 0.3 blond, 1.3 brown, 8 black"},
        {"melanin_redness", ParamType::number, "", "0", 0.0, 1.0, "", "share of the pigment that is red"},
        {"roughness", ParamType::number, "", "0.3", 0.02, 1.0, "", "along the fibre, 1 = even"},
        {"azimuthal_roughness", ParamType::number, "", "0.3", 0.02, 1.0, "", "around the fibre, 1 = even"},
        {"tilt", ParamType::number, "deg", "2", -20.0, 20.0, "",
         "slope of the scales, which open to the tip"},
        {"ior", ParamType::number, "", "1.55", 1.0, 3.0, "", "index of refraction"},
    };
    for (ParamSpec& spec : strand_color_params()) params.push_back(std::move(spec));
    return params;
}

namespace {

// Parameters that the chosen pigment does not read are errors: they would be ignored silently.
void reject_unused_pigment_params(const ParamSet& params) {
    const bool melanin = params.text("pigment") == "melanin";
    const std::vector<std::string_view> unread =
        melanin ? std::vector<std::string_view>{"color", "root_color", "tip_color", "color_map"}
                : std::vector<std::string_view>{"melanin", "melanin_redness"};
    for (const std::string_view name : unread)
        if (const ParamValue* value = params.find(name); value && value->given)
            throw InputError(value->place,
                             "'" + std::string(name) + "' is not used with pigment = \"" +
                                 params.text("pigment") + "\"",
                             melanin ? "leave it out, or leave out pigment"
                                     : "add pigment = \"melanin\", or leave it out");
}

} // namespace

HairSettings read_hair(const ParamSet& params, const TextureOpener& open) {
    reject_unused_pigment_params(params);
    HairSettings settings;
    settings.color = read_strand_color(params, open);
    settings.roughness = static_cast<float>(params.number("roughness"));
    settings.azimuthal_roughness = static_cast<float>(params.number("azimuthal_roughness"));
    settings.tilt = static_cast<float>(params.number("tilt") * degree);
    settings.ior = static_cast<float>(params.number("ior"));

    const double m = settings.roughness, n = settings.azimuthal_roughness;
    const float v = static_cast<float>(std::pow(0.726 * m + 0.812 * m * m + 3.7 * std::pow(m, 20.0), 2.0));
    settings.variance = Float4{v, 0.25F * v, 4.0F * v, 4.0F * v};
    settings.precision = 1.0F / settings.variance;
    for (int p = 0; p < lobe_count; ++p) {
        settings.scale[p] = -1.0F / (settings.variance[p] * std::expm1(-2.0F / settings.variance[p]));
        settings.exp_neg_2_over_v[p] = std::exp(-2.0F / settings.variance[p]);
    }
    settings.logistic_scale =
        static_cast<float>(std::sqrt(pi / 8.0) * (0.265 * n + 1.194 * n * n + 5.372 * std::pow(n, 22.0)));
    settings.logistic_norm = std::tanh(0.5F * pi_f / settings.logistic_scale);
    set_pigment(settings, params);
    for (int k = 0; k < 3; ++k) {
        settings.sin_tilt[k] = std::sin(static_cast<float>(1 << k) * settings.tilt);
        settings.cos_tilt[k] = std::cos(static_cast<float>(1 << k) * settings.tilt);
    }
    return settings;
}

HairBsdf hair_at(const HairSettings& settings, const ShadingPoint& point) {
    HairBsdf bsdf;
    bsdf.axis = point.tangent;
    bsdf.sin_theta_o = std::clamp(point.wo.dot(point.tangent), -1.0F, 1.0F);
    bsdf.front = point.wo - bsdf.sin_theta_o * point.tangent;
    bsdf.cos_theta_o = bsdf.front.norm();
    if (bsdf.cos_theta_o > 1e-6F) // rounding of unit vectors; below it the azimuth is arbitrary
        bsdf.front /= bsdf.cos_theta_o;
    else
        orthonormal_basis(bsdf.axis, bsdf.front, bsdf.side);
    bsdf.side = bsdf.axis.cross(bsdf.front);

    const float h = std::clamp(point.h, -1.0F, 1.0F), eta = settings.ior;
    constexpr float end_on = 1e-30F; // replaces 0, at ior = 1 and wo along the axis: avoids 0 / 0
    const float bravais =
        std::max(std::sqrt(ior_cos_t_squared(bsdf.cos_theta_o, eta)), end_on); // eta cos theta_t
    const float sin_gamma_t = std::clamp(h * bsdf.cos_theta_o / bravais, -1.0F, 1.0F);
    const Float4 sines{h, sin_gamma_t}, cosines = sqrt((1.0F - sines) * (1.0F + sines));
    const Float4 gammas = fast_atan2(sines, cosines);
    bsdf.gamma_o = gammas[0];
    bsdf.gamma_t = gammas[1];
    const float chord = 2.0F * cosines[1] * eta / bravais;

    Vec3f sigma = settings.base_absorption;
    bsdf.color = settings.base_color;
    if (!settings.same_everywhere) {
        bsdf.color = color_at(settings.color, point);
        bsdf.color = bsdf.color.cwiseProduct(variation_factor(settings.color, point, bsdf.color));
        sigma = absorption_of_color(bsdf.color, settings.azimuthal_roughness);
    }
    bsdf.variance = settings.variance;
    bsdf.precision = settings.precision;
    bsdf.scale = settings.scale;
    bsdf.exp_neg_2_over_v = settings.exp_neg_2_over_v;
    bsdf.logistic_scale = settings.logistic_scale;
    bsdf.logistic_norm = settings.logistic_norm;
    bsdf.lobe_azimuth = wrap(exit_azimuths(bsdf.gamma_o, bsdf.gamma_t));
    set_attenuation(bsdf, sigma, fresnel(bsdf.cos_theta_o * cosines[0], eta), chord);
    set_lobe_cones(bsdf, settings);
    return bsdf;
}

namespace {

// phi: -pi ... pi.
BsdfValue evaluate(const HairBsdf& bsdf, float sin_i, float cos_i, float phi) {
    const Float4 lobes = longitudinal(bsdf, cos_i, sin_i) * azimuthal(bsdf, phi);
    BsdfValue result;
    for (int p = 0; p < lobe_count; ++p) result.value += lobes[p] * bsdf.attenuation[p];
    result.pdf = sum(lobes * bsdf.probability);
    return result;
}

} // namespace

BsdfValue evaluate(const HairBsdf& bsdf, const Vec3f& wi) {
    const float sin_i = std::clamp(wi.dot(bsdf.axis), -1.0F, 1.0F);
    const float across = wi.dot(bsdf.front), aside = wi.dot(bsdf.side);
    return evaluate(bsdf, sin_i, std::sqrt(across * across + aside * aside), fast_atan2(aside, across));
}

bool sample(const HairBsdf& bsdf, const std::array<float, 4>& random, BsdfSample& result) {
    int p = 0;
    float below = 0.0F;
    while (p < lobe_count - 1 && random[2] >= below + bsdf.probability[p]) below += bsdf.probability[p++];

    // The angle from the lobe's specular cone, as 1 - cos, which is accurate for small angles. u is never 0.
    const float v = bsdf.variance[p], u = 1.0F - random[0];
    const float away = std::clamp(-v * std::log(u + (1.0F - u) * bsdf.exp_neg_2_over_v[p]), 0.0F, 2.0F);
    const float phi = p == lobe_count - 1
                          ? 2.0F * pi_f * random[1] - pi_f
                          : wrap(Float4{} + bsdf.lobe_azimuth[p] +
                                 sample_logistic(random[1], bsdf.logistic_scale, bsdf.logistic_norm))[0];
    Float4 sines, cosines;
    fast_sin_cos(Float4{phi, 2.0F * pi_f * random[3]}, sines, cosines);
    const float turn = std::sqrt(away * (2.0F - away)) * cosines[1];
    const float sin_i = std::clamp((away - 1.0F) * bsdf.lobe_sin[p] + turn * bsdf.lobe_cos[p], -1.0F, 1.0F);
    const float cos_i = std::sqrt((1.0F - sin_i) * (1.0F + sin_i));
    result.wi = (sin_i * bsdf.axis + cos_i * (cosines[0] * bsdf.front + sines[0] * bsdf.side)).normalized();
    const BsdfValue at = evaluate(bsdf, sin_i, cos_i, phi);
    result.value = at.value;
    result.pdf = at.pdf;
    return at.pdf > 0.0F && std::isfinite(at.pdf);
}

Vec3f albedo(const HairBsdf& bsdf) { return bsdf.color; }

} // namespace marram
