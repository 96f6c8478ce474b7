// SPDX-License-Identifier: Apache-2.0
// Compares the hair shader with rays traced through a smooth dielectric cylinder in double precision, which
// shares no formula with hair.cpp.
//
// The trace. Radius 1, axis y, vacuum outside. A ray enters at offset h with inclination theta. Each
// interface uses the true normal n (the radius) and the two true angles of incidence: Snell's law,
//   d_t = r d + (r cos_i - cos_t) n ,   r = n_1 / n_2, n against d,
// Fresnel's amplitudes r_s and r_p of the two cosines, unpolarised F = (r_s^2 + r_p^2) / 2, and exp(-sigma l)
// for the 3-D length l of each inner segment. The trace is deterministic: the ray splits in two at each
// interface. The outer part is an exit of order p = number of inner segments so far.
//
// What is compared, and where the model deviates from the cylinder:
//   A_p    The shader has F at the outer incidence and T of one chord. In a circle every inner angle of
//          incidence equals the refraction angle of the entering ray, F is the same from both sides, and all
//          chords are equal: A_p is exact for unpolarised interfaces up to the shader's float rounding. The
//          epsilon of a float is 6e-8; a dozen roundings of numbers up to 1 stay below 1e-6.
//   lobes  The same energies from evaluate() alone, at the minimum roughness, where lobes are separate: a
//          logistic of scale s has 1 - 2 exp(-k) of its mass within k s of its middle, 1 - 4e-6 at k = 13.
//   places Azimuths are exact: the logistic is symmetric about the traced azimuth. Inclinations: per solid
//          angle M ~ (c_i c_o)^-1/2 exp(-(theta_i + theta_o)^2 / 2v) for small v. Its peak is past the mirror
//          cone by v tan(theta_o) / 2, with a relative error of order v / cos^2.
//   p >= 3 The model's residual is uniform in azimuth; the cylinder has more lobes. The misplaced energy is
//          at most A_3.
//   fields Interfaces polarise the light that reaches the next interface. The trace carries two fields (flux
//          amplitudes sqrt(1 - r^2) of s and p; real, because light that entered from outside is never
//          totally reflected), whose planes rotate between interfaces. The model ignores polarisation: the
//          difference is printed and bounded by the measured value.
//   scales A surface of stacked cones, each widening from root to tip by tan(alpha), with steps much smaller
//          than the fibre: a cylinder with normals tilted by alpha towards the root. To first order in alpha,
//          at normal incidence and h = 0, R leaves at -2 alpha (towards the root), TT at 2 (eta - 1) alpha,
//          TRT at (4 eta - 2) alpha. The model has -2, 1, 4 for every eta, which is right for eta = 1.5.
#include "tests/unit/shaders/fibre_cases.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using namespace testing;

constexpr int order_count = 4; // R, TT, TRT, residual

// One ray in both polarisations: the remaining energy of unpolarised light, and two fields as flux
// amplitudes, initially perpendicular to each other.
struct Light {
    Vec3d at, direction;
    double energy = 1.0;
    std::array<Vec3d, 2> field;
};

struct Exit {
    int order;
    Vec3d direction;
    double energy, polarised_energy;
};

struct Interface {
    Vec3d normal; // against the ray
    double cos_in, cos_out, ratio, amplitude_s, amplitude_p;

    double reflectance() const { return 0.5 * (amplitude_s * amplitude_s + amplitude_p * amplitude_p); }
};

Interface interface_at(const Vec3d& direction, const Vec3d& normal, double from, double to) {
    Interface face{normal, -normal.dot(direction), 0.0, from / to, 0.0, 0.0};
    const double sine = face.ratio * normal.cross(direction).norm();
    face.cos_out = std::sqrt(std::max(0.0, 1.0 - sine * sine));
    face.amplitude_s = (from * face.cos_in - to * face.cos_out) / (from * face.cos_in + to * face.cos_out);
    face.amplitude_p = (to * face.cos_in - from * face.cos_out) / (to * face.cos_in + from * face.cos_out);
    return face;
}

// The part of the light that continues in `direction`, with the s and p components of its fields scaled.
Light continue_ray(const Light& light, const Vec3d& normal, const Vec3d& direction, double share,
                   double along_s, double along_p) {
    Vec3d s = light.direction.cross(normal);
    s = s.norm() > 1e-12 ? s.normalized() : light.direction.unitOrthogonal(); // head-on any s will do
    Light next{light.at, direction, light.energy * share, {}};
    for (int k = 0; k < 2; ++k)
        next.field[k] = along_s * s.dot(light.field[k]) * s +
                        along_p * light.direction.cross(s).dot(light.field[k]) * direction.cross(s);
    return next;
}

Light reflected(const Light& light, const Interface& face) {
    const Vec3d direction = (light.direction + 2.0 * face.cos_in * face.normal).normalized();
    return continue_ray(light, face.normal, direction, face.reflectance(), face.amplitude_s,
                        face.amplitude_p);
}

Light refracted(const Light& light, const Interface& face) {
    const Vec3d direction =
        (face.ratio * light.direction + (face.ratio * face.cos_in - face.cos_out) * face.normal).normalized();
    const auto rest = [](double amplitude) { return std::sqrt(std::max(0.0, 1.0 - amplitude * amplitude)); };
    return continue_ray(light, face.normal, direction, 1.0 - face.reflectance(), rest(face.amplitude_s),
                        rest(face.amplitude_p));
}

Exit left(int order, const Light& light) {
    return {order, light.direction, light.energy,
            0.5 * (light.field[0].squaredNorm() + light.field[1].squaredNorm())};
}

// Tilts the normal at a point of the cylinder by alpha towards -y, the root.
Vec3d outward(const Vec3d& at, double alpha) {
    return std::cos(alpha) * Vec3d(at.x(), 0.0, at.z()).normalized() - std::sin(alpha) * Vec3d::UnitY();
}

struct Cylinder {
    double ior, sigma = 0.0, alpha = 0.0;
};

// Traces the ray from far away against the view direction; intersections by the quadratic for |(x, z)| = 1.
std::vector<Exit> trace(const Cylinder& cylinder, double h, double theta) {
    const Vec3d direction = -fibre_direction(theta, 0.0);
    const Vec3d origin = h * Vec3d::UnitY().cross(Vec3d::UnitX()) - 10.0 * direction;
    const auto flat = [](const Vec3d& a, const Vec3d& b) { return a.x() * b.x() + a.z() * b.z(); };
    const double a = flat(direction, direction), b = flat(origin, direction), c = flat(origin, origin) - 1.0;
    Light light{origin + (-b - std::sqrt(b * b - a * c)) / a * direction, direction, 1.0, {}};
    light.field[0] = direction.unitOrthogonal();
    light.field[1] = direction.cross(light.field[0]);

    const Interface entry = interface_at(direction, outward(light.at, cylinder.alpha), 1.0, cylinder.ior);
    std::vector<Exit> exits = {left(0, reflected(light, entry))};
    light = refracted(light, entry);
    constexpr double negligible = 1e-14;
    constexpr int longest = 100000;
    for (int order = 1; order < longest && left(order, light).polarised_energy + light.energy > negligible;
         ++order) {
        const double length = -2.0 * flat(light.at, light.direction) / flat(light.direction, light.direction);
        light.at += length * light.direction;
        light.energy *= std::exp(-cylinder.sigma * length);
        for (Vec3d& field : light.field) field *= std::exp(-0.5 * cylinder.sigma * length);
        const Interface face =
            interface_at(light.direction, -outward(light.at, cylinder.alpha), cylinder.ior, 1.0);
        exits.push_back(left(order, refracted(light, face)));
        light = reflected(light, face);
    }
    return exits;
}

struct Energies {
    std::array<double, order_count> unpolarised{}, polarised{};
};

Energies energies_of(const std::vector<Exit>& exits) {
    Energies sum;
    for (const Exit& exit : exits) {
        const int order = std::min(exit.order, order_count - 1);
        sum.unpolarised[order] += exit.energy;
        sum.polarised[order] += exit.polarised_energy;
    }
    return sum;
}

// A fibre with a given absorption per channel, independent of its colour.
HairSettings fibre_of(double ior, const Vec3f& sigma, double roughness = 0.3) {
    HairCase hair;
    hair.ior = ior;
    hair.roughness = hair.azimuthal_roughness = roughness;
    HairSettings settings = hair_of(hair);
    settings.base_absorption = sigma;
    return settings;
}

void print_row(const char* what, const std::array<double, order_count>& worst) {
    std::printf("[ cylinder ] %s: R %.1e, TT %.1e, TRT %.1e, rest %.1e\n", what, worst[0], worst[1], worst[2],
                worst[3]);
}

double greatest(const std::array<double, order_count>& of) { return *std::max_element(of.begin(), of.end()); }

const std::array<double, 11> offsets = {-0.999, -0.9, -0.7, -0.4, -0.1, 0.0, 0.2, 0.5, 0.8, 0.95, 0.999};

// Tests the trace itself: energy is conserved, polarised or not.
TEST(HairCylinder, TheTraceKeepsEnergy) {
    double worst = 0.0;
    for (const double ior : {1.0, 1.3, 1.55, 3.0})
        for (const double h : offsets)
            for (double theta = 0.0; theta <= 85.0; theta += 17.0) {
                const Energies all = energies_of(trace({ior}, h, theta * degree));
                double plain = -1.0, polarised = -1.0;
                for (int p = 0; p < order_count; ++p) {
                    plain += all.unpolarised[p];
                    polarised += all.polarised[p];
                }
                worst = std::max({worst, std::abs(plain), std::abs(polarised)});
            }
    std::printf("[ cylinder ] energy of the trace: off by %.1e\n", worst);
    EXPECT_LT(worst, 1e-11);
}

// Rounds to float, so that inputs equal the shader's and only its own rounding is measured.
double as_given(double number) { return static_cast<double>(static_cast<float>(number)); }

void compare_attenuation(const std::vector<double>& iors, const std::vector<double>& thetas,
                         std::array<double, order_count>& worst,
                         std::array<double, order_count>& worst_polarised, double& max_residual) {
    const std::array<Vec3f, 2> sigmas = {Vec3f(0.0F, 0.1F, 0.3F), Vec3f(0.8F, 1.5F, 3.0F)};
    for (const double ior : iors)
        for (const double h : offsets)
            for (const double theta : thetas)
                for (const Vec3f& sigma : sigmas) {
                    const HairBsdf bsdf = hair_at(fibre_of(ior, sigma), fibre_point(theta * degree, h));
                    for (int c = 0; c < 3; ++c) {
                        const Energies traced =
                            energies_of(trace({as_given(ior), sigma[c]}, as_given(h), theta * degree));
                        for (int p = 0; p < order_count; ++p) {
                            const double model = bsdf.attenuation[p][c];
                            worst[p] = std::max(worst[p], std::abs(model - traced.unpolarised[p]));
                            worst_polarised[p] =
                                std::max(worst_polarised[p], std::abs(model - traced.polarised[p]));
                        }
                        max_residual = std::max(max_residual, traced.unpolarised[order_count - 1]);
                    }
                }
}

TEST(HairCylinder, AttenuationIsTheTracedEnergy) {
    std::array<double, order_count> worst{}, polarised{};
    double residual = 0.0;
    std::vector<double> thetas;
    for (double theta = 0.0; theta <= 80.0; theta += 8.0) thetas.push_back(theta);
    compare_attenuation({1.3, 1.4, 1.5, 1.55, 1.6, 1.7}, thetas, worst, polarised, residual);
    print_row("A_p, ior 1.3 ... 1.7, theta 0 ... 80, sigma 0 ... 3", worst);
    print_row("  the same against polarised light", polarised);
    std::printf("[ cylinder ] most energy in the rest, misplaced at most in azimuth: %.3f\n", residual);
    EXPECT_LT(greatest(worst), 1e-6);
    EXPECT_LT(greatest(polarised), 0.07); // measured: 0.062, of TRT
    EXPECT_LT(residual, 0.16);            // measured: 0.148
}

// Where floats cancel: no refraction, and nearly end-on.
TEST(HairCylinder, AttenuationHoldsAtTheEdges) {
    std::array<double, order_count> worst{}, polarised{};
    double residual = 0.0;
    compare_attenuation({1.0, 1.0001, 1.01, 1.3, 3.0}, {80.0, 88.0, 89.5, 89.9}, worst, polarised, residual);
    print_row("A_p, ior 1 ... 3, theta 80 ... 89.9", worst);
    EXPECT_LT(greatest(worst), 3e-6);
}

constexpr double sharpest = 0.02; // minimum roughness: lobes of different azimuths are separate

double turn_between(double a, double b) { return std::abs(std::remainder(a - b, 2.0 * pi)); }

// Integral over inclination of evaluate() at one azimuth. Midpoint steps of half the narrowest deviation: for
// lobes that end before the poles the error is exp(-2 pi^2 deviation^2 / step^2), which is negligible.
double along_meridian(const HairBsdf& bsdf, double theta, double phi) {
    const Float4& v = bsdf.variance;
    const std::array variances = {v[0], v[1], v[2], v[3]};
    const double narrow = std::sqrt(std::ranges::min(variances));
    const double wide = std::sqrt(std::ranges::max(variances));
    const double step = 0.5 * narrow, reach = 7.0 * wide;
    const double low = std::max(-0.5 * pi, -theta - reach), high = std::min(0.5 * pi, -theta + reach);
    const int count = static_cast<int>(std::ceil((high - low) / step));
    double sum = 0.0;
    for (int i = 0; i < count; ++i) {
        const double at = low + (i + 0.5) * (high - low) / count;
        sum += std::cos(at) * evaluate(bsdf, fibre_direction(at, phi).cast<float>()).value.x();
    }
    return sum * (high - low) / count;
}

// Lobe energies from evaluate() alone: each lobe is integrated in a window around the traced azimuth, minus
// the residual, which is uniform in azimuth. Empty if windows overlap.
std::vector<double> lobe_energies(const HairBsdf& bsdf, double theta, const std::vector<Exit>& exits) {
    const double half = 13.0 * bsdf.logistic_scale;
    std::array<double, order_count - 1> middle{};
    for (int p = 0; p < order_count - 1; ++p) {
        middle[p] = azimuth_of(exits[p].direction);
        for (int q = 0; q < p; ++q)
            if (turn_between(middle[p], middle[q]) < 2.0 * half) return {};
    }
    double empty = middle[0]; // an azimuth outside of all windows
    const auto nearest = [&](double phi) {
        double least = pi;
        for (const double other : middle) least = std::min(least, turn_between(phi, other));
        return least;
    };
    for (int k = 0; k < 16; ++k)
        if (nearest(pi * k / 8.0) > nearest(empty)) empty = pi * k / 8.0;
    const double background = along_meridian(bsdf, theta, empty);
    std::vector<double> energies;
    for (const double phi : middle) {
        constexpr int count = 52; // midpoint steps of half a scale
        double sum = 0.0;
        for (int i = 0; i < count; ++i)
            sum += along_meridian(bsdf, theta, phi + half * (2.0 * (i + 0.5) / count - 1.0)) - background;
        energies.push_back(sum * 2.0 * half / count);
    }
    energies.push_back(2.0 * pi * background);
    return energies;
}

TEST(HairCylinder, LobesOfEvaluateHoldTheTracedEnergy) {
    std::array<double, order_count> worst{};
    int compared = 0, touching = 0;
    for (const double ior : {1.3, 1.55, 1.7})
        for (const double h : {-0.9, -0.4, 0.2, 0.7, 0.97})
            for (const double theta : {-50.0, 0.0, 30.0, 65.0, 80.0})
                for (const double sigma : {0.0, 0.5, 3.0}) {
                    const std::vector<Exit> exits =
                        trace({as_given(ior), as_given(sigma)}, as_given(h), theta * degree);
                    const HairBsdf bsdf =
                        hair_at(fibre_of(ior, Vec3f::Constant(static_cast<float>(sigma)), sharpest),
                                fibre_point(theta * degree, h));
                    const std::vector<double> seen = lobe_energies(bsdf, theta * degree, exits);
                    ++(seen.empty() ? touching : compared);
                    const Energies traced = energies_of(exits);
                    for (size_t p = 0; p < seen.size(); ++p)
                        worst[p] = std::max(worst[p], std::abs(seen[p] - traced.unpolarised[p]));
                }
    print_row("lobes of evaluate() at roughness 0.02", worst);
    std::printf("[ cylinder ] %d compared, %d whose lobes touch\n", compared, touching);
    EXPECT_GT(compared, 4 * touching);
    EXPECT_LT(greatest(worst), 1e-4);
}

// Position of the maximum of f(x) within +- reach of middle: the best of a row of points, refined by a
// parabola.
template <typename F>
double peak(F f, double middle, double reach) {
    constexpr int half = 60;
    const double step = reach / half;
    int best = -half;
    for (int i = -half; i <= half; ++i)
        if (f(middle + i * step) > f(middle + best * step)) best = i;
    const double at = middle + best * step;
    const double before = f(at - step), here = f(at), after = f(at + step);
    const double bend = before - 2.0 * here + after;
    return bend < 0.0 ? at + 0.5 * step * (before - after) / bend : at;
}

struct Peaks {
    std::array<double, order_count> azimuth{}, inclination{},
        mirror{}; // mirror: without correction for the peak's shift
};

void compare_peaks(double ior, double h, double theta, Peaks& worst) {
    const std::vector<Exit> exits = trace({as_given(ior)}, as_given(h), theta);
    const HairBsdf bsdf = hair_at(fibre_of(ior, Vec3f::Zero(), sharpest), fibre_point(theta, h));
    if (lobe_energies(bsdf, theta, exits).empty()) return;
    for (int p = 0; p < order_count - 1; ++p) {
        const double phi = azimuth_of(exits[p].direction), up = std::asin(exits[p].direction.y());
        const auto seen = [&](double inclination, double azimuth) {
            return static_cast<double>(
                evaluate(bsdf, fibre_direction(inclination, azimuth).cast<float>()).value.x());
        };
        const double variance = bsdf.variance[p];
        const double azimuth = peak([&](double x) { return seen(up, x); }, phi, 4.0 * bsdf.logistic_scale);
        const double inclination =
            peak([&](double x) { return seen(x, phi); }, up, 2.0 * std::sqrt(variance));
        const double shift = 0.5 * variance * std::tan(up);
        worst.azimuth[p] = std::max(worst.azimuth[p], std::abs(azimuth - phi));
        worst.inclination[p] = std::max(worst.inclination[p], std::abs(inclination - up - shift));
        worst.mirror[p] = std::max(worst.mirror[p], std::abs(inclination - up));
    }
}

TEST(HairCylinder, LobesPeakWhereTheTraceLeaves) {
    Peaks worst;
    for (const double ior : {1.3, 1.55, 1.7})
        for (const double h : {-0.9, -0.4, 0.2, 0.7, 0.97})
            for (const double theta : {-50.0, 0.0, 30.0, 65.0, 80.0})
                compare_peaks(ior, h, theta * degree, worst);
    print_row("azimuth of the peaks at roughness 0.02, rad", worst.azimuth);
    print_row("inclination of the peaks, rad", worst.mirror);
    print_row("  the same less v tan(theta) / 2", worst.inclination);
    EXPECT_LT(greatest(worst.azimuth), 2e-4);     // 1/20 of the logistic's scale, 3.6e-3
    EXPECT_LT(greatest(worst.inclination), 3e-4); // 1/50 of the narrowest deviation, 7.4e-3
    EXPECT_LT(greatest(worst.mirror), 3e-3);      // 2 v tan(80 deg) = 2.5e-3 for TRT
}

// Scales that widen towards the tip, so that fur is smooth from root to tip, tilt R towards the root.
TEST(HairCylinder, ScalesTurnLobesTheWayTheConesDo) {
    constexpr double alpha_degrees = 0.5, alpha = alpha_degrees * degree;
    HairCase hair;
    hair.roughness = hair.azimuthal_roughness = sharpest;
    hair.tilt_degrees = alpha_degrees;
    for (const double ior : {1.45, 1.5, 1.55}) {
        hair.ior = ior;
        const std::vector<Exit> exits = trace({ior, 0.0, alpha}, 0.0, 0.0);
        const HairBsdf bsdf = hair_at(hair_of(hair), fibre_point(0.0, 0.0));
        const std::array<double, 3> first_order = {-2.0, 2.0 * (ior - 1.0), 4.0 * ior - 2.0};
        std::printf("[ cylinder ] scales, ior %.2f: exits over alpha", ior);
        for (int p = 0; p < order_count - 1; ++p) {
            const double traced = std::asin(exits[p].direction.y()) / alpha;
            const double model = -std::asin(static_cast<double>(bsdf.lobe_sin[p])) / alpha;
            std::printf("  %+.3f (model %+.3f)", traced, model);
            EXPECT_NEAR(traced, first_order[p], 0.01);
            EXPECT_NEAR(model, traced, 4.0 * std::abs(ior - 1.5) + 0.01);
        }
        std::printf("\n");
    }
}

} // namespace
} // namespace marram
