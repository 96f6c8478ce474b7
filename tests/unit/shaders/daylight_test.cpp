// SPDX-License-Identifier: Apache-2.0
// Compares daylight with closed forms, fine integration, a random walk with all orders of scattering, and the
// energy balance.
#include "shaders/daylight.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

constexpr int green = 8; // the band around 550 nm
constexpr double air_scale = 8450.0, aerosol_scale = 1200.0;

Vec3d towards(double elevation, double azimuth) { // degrees; azimuth from -z towards +x
    const double e = elevation * degree, a = azimuth * degree;
    return {std::cos(e) * std::sin(a), std::sin(e), -std::cos(e) * std::cos(a)};
}

Daylight at_sun(double elevation, double turbidity = 2.5) {
    DaylightSettings settings;
    settings.direction = towards(elevation, 0.0);
    settings.turbidity = turbidity;
    return Daylight(settings);
}

AirSettings nothing() {
    AirSettings air;
    air.air = air.aerosol = air.ozone = 0.0;
    return air;
}

TEST(Daylight, MoleculesHaveTheDepthAndTheAirMassOfTheStandardAtmosphere) {
    EXPECT_NEAR(rayleigh_depth(550.0), 0.0971, 0.0003); // Bodhaine et al. 1999
    EXPECT_NEAR(rayleigh_depth(400.0), 0.360, 0.004);
    AirSettings settings = nothing();
    settings.air = 1.0;
    settings.ground_albedo = 0.0;
    const Atmosphere air(settings);
    const double depth = rayleigh_depth(wavelength_of(green));
    EXPECT_NEAR(air.transmittance(0.0, 1.0)[green], std::exp(-depth), 1e-4);
    EXPECT_NEAR(air.transmittance(air_scale, 1.0)[green], std::exp(-depth / std::exp(1.0)), 1e-3);
    // At horizontal incidence an exponential atmosphere has sqrt(pi R / 2 H) air masses (Chapman 1931): 34.4.
    const double masses = -std::log(static_cast<double>(air.transmittance(0.0, 0.0)[green])) / depth;
    EXPECT_NEAR(masses, std::sqrt(0.5 * pi * planet_radius / air_scale), 0.2);
}

TEST(Daylight, PhasesScatterAllLightAndHaveTheirMeanCosine) {
    double air = 0.0, aerosol = 0.0, forward = 0.0;
    constexpr int steps = 20000;
    for (int i = 0; i < steps; ++i) {
        const double c = -1.0 + 2.0 * (i + 0.5) / steps, part = 2.0 * pi * 2.0 / steps;
        air += part * rayleigh_phase(c);
        aerosol += part * aerosol_phase(c);
        forward += part * c * aerosol_phase(c);
    }
    EXPECT_NEAR(air, 1.0, 1e-6);
    EXPECT_NEAR(aerosol, 1.0, 1e-4);
    EXPECT_NEAR(forward, 0.703, 1e-3); // Hess et al. 1998, continental average
}

TEST(Daylight, WithoutAirTheSkyIsBlackAndTheSunWhole) {
    const Atmosphere none(nothing());
    for (const double cosine : {1.0, 0.3, 0.001}) {
        const Scattered light = none.scattered(none.path(100.0, cosine, 32), 0.5, 0.2);
        EXPECT_EQ((light.by_air + light.by_aerosol + light.rest).maxCoeff(), 0.0F);
        EXPECT_EQ(none.transmittance(100.0, cosine).minCoeff(), 1.0F);
    }
    EXPECT_TRUE(color_of(Spectrum::Ones()).isApprox(Vec3f::Ones(), 1e-3F));
    // Then the ground is lit by the sun only, like a white card.
    const Scattered ground = none.scattered(none.path(100.0, -1.0, 32), 0.5, -0.5);
    EXPECT_NEAR(ground.rest[green], 0.2 / pi * 0.5, 1e-5);
}

// Column densities along a ray, by an independent sum: molecules, aerosol and ozone relative to their maximum
// density.
Vec3d column_by_sum(const Vec3d& from, const Vec3d& direction, double length, int steps) {
    Vec3d sum = Vec3d::Zero();
    for (int i = 0; i < steps; ++i) {
        const double t = (i + 0.5) / steps, at = length * t * t;
        const double h = (from + at * direction).norm() - planet_radius;
        sum += 2.0 * t * length / steps *
               Vec3d(std::exp(-h / air_scale), std::exp(-h / aerosol_scale),
                     std::max(0.0, 1.0 - std::abs(h - 25000.0) / 15000.0));
    }
    return sum;
}

double to_space(const Vec3d& from, const Vec3d& direction) {
    const double along = from.dot(direction), top = planet_radius + atmosphere_height;
    return -along + std::sqrt(along * along - from.squaredNorm() + top * top);
}

TEST(Daylight, SingleScatteringIsTheFineIntegral) {
    AirSettings settings;
    settings.aerosol = 0.15;
    const Atmosphere air(settings);
    const double ozone = 300.0 * 2.6867e20 / 15000.0 * 3.30e-25; // 550 nm
    const Vec3d extinction(rayleigh_depth(550.0) / air_scale, 0.15 / aerosol_scale, ozone);
    const Vec3d eye(0.0, planet_radius + 100.0, 0.0);
    double worst = 0.0;
    for (const double sun_elevation : {60.0, 10.0, 2.0})
        for (const double elevation : {90.0, 20.0, 3.0, 0.5}) {
            const Vec3d view = towards(elevation, 50.0), sun = towards(sun_elevation, 0.0);
            const double length = to_space(eye, view);
            constexpr int steps = 500;
            Vec3d before = Vec3d::Zero(), sum = Vec3d::Zero();
            for (int i = 0; i < steps; ++i) {
                const double t = (i + 0.5) / steps, part = 2.0 * t * length / steps;
                const Vec3d at = eye + length * t * t * view;
                const double h = at.norm() - planet_radius;
                const Vec3d here(std::exp(-h / air_scale), std::exp(-h / aerosol_scale),
                                 std::max(0.0, 1.0 - std::abs(h - 25000.0) / 15000.0));
                const Vec3d column =
                    before + 0.5 * part * here + column_by_sum(at, sun, to_space(at, sun), 300);
                sum += part * std::exp(-column.dot(extinction)) * here.cwiseProduct(extinction);
                before += part * here;
            }
            const Scattered light = air.scattered(air.path(100.0, view.y(), 64), sun.y(), view.dot(sun));
            const double by_air = light.by_air[green] / sum.x() - 1.0;
            const double by_aerosol = light.by_aerosol[green] / (0.925 * sum.y()) - 1.0;
            worst = std::max({worst, std::abs(by_air), std::abs(by_aerosol)});
        }
    std::printf("[ daylight ] single scattering against fine integration: off by at most %.2f %%\n",
                100.0 * worst);
    EXPECT_LT(worst, 0.02); // with the sun and the view both low
}

struct RandomDouble {
    uint64_t seed, at = 0;
    double operator()() { return unit_float(static_cast<uint32_t>(hash(seed, at++))); }
};

Vec3d turned(const Vec3d& axis, double cosine, double azimuth) {
    Vec3d x, y;
    orthonormal_basis(axis, x, y);
    const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
    return (sine * (std::cos(azimuth) * x + std::sin(azimuth) * y) + cosine * axis).normalized();
}

// Samples the phase function by rejection. Proposals: half uniform, half Henyey-Greenstein; `bound` times the
// proposal density is above both phase functions.
template <typename Phase>
Vec3d scatter(const Vec3d& direction, RandomDouble& random, Phase phase) {
    constexpr double g = 0.8, bound = 3.6;
    for (;;) {
        const double s = (1.0 - g * g) / (1.0 - g + 2.0 * g * random());
        const double lobe = std::clamp((1.0 + g * g - s * s) / (2.0 * g), -1.0, 1.0);
        const double cosine = random() < 0.5 ? lobe : 2.0 * random() - 1.0;
        const double proposed =
            (0.5 + 0.5 * (1.0 - g * g) / std::pow(1.0 + g * g - 2.0 * g * cosine, 1.5)) / (4.0 * pi);
        EXPECT_LE(phase(cosine), bound * proposed);
        if (random() * bound * proposed < phase(cosine))
            return turned(direction, cosine, 2.0 * pi * random());
    }
}

// One random walk from the eye with Woodcock tracking: all orders of scattering with the exact phase
// functions.
double walk(const Atmosphere& air, const AirSettings& settings, Vec3d at, Vec3d direction, const Vec3d& sun,
            RandomDouble& random) {
    const double most = air.coefficients(0.0).extinction[green];
    double light = 0.0, weight = 1.0;
    for (int events = 0; events < 200;) {
        const Vec3d from = at;
        at += -std::log(1.0 - random()) / most * direction;
        const double nearest = std::clamp(-from.dot(direction), 0.0, (at - from).norm());
        if ((from + nearest * direction).norm() < planet_radius) {
            const double along = from.dot(direction);
            const double gap = along * along - from.squaredNorm() + planet_radius * planet_radius;
            at = (from + (-along - std::sqrt(std::max(0.0, gap))) * direction).normalized() * planet_radius;
            const Vec3d up = at.normalized();
            weight *= settings.ground_albedo;
            light += weight / pi * std::max(0.0, up.dot(sun)) * air.sunlight(0.0, up.dot(sun))[green];
            direction = turned(up, std::sqrt(random()), 2.0 * pi * random());
            at += 1e-3 * up;
            ++events;
            continue;
        }
        const double height = at.norm() - planet_radius;
        if (height > atmosphere_height) return light;
        const Atmosphere::Coefficients here = air.coefficients(std::max(0.0, height));
        if (random() * most >= here.extinction[green]) continue;
        const double by_air = here.by_air[green] / here.extinction[green];
        const double by_aerosol = here.by_aerosol[green] / here.extinction[green];
        const double cosine = std::clamp(direction.dot(sun), -1.0, 1.0);
        light += weight * (by_air * rayleigh_phase(cosine) + by_aerosol * aerosol_phase(cosine)) *
                 air.sunlight(height, at.normalized().dot(sun))[green];
        weight *= by_air + by_aerosol;
        direction = random() * (by_air + by_aerosol) < by_air ? scatter(direction, random, rayleigh_phase)
                                                              : scatter(direction, random, aerosol_phase);
        ++events;
    }
    return light;
}

TEST(Daylight, AgreesWithARandomWalkOfAllScattering) {
    double worst_air = 0.0, worst_haze = 0.0;
    for (const double aerosol : {0.0, 0.15}) {
        AirSettings settings;
        settings.aerosol = aerosol;
        settings.ground_albedo = 0.3;
        const Atmosphere air(settings);
        for (const double sun_elevation : {50.0, 8.0})
            for (const double elevation : {90.0, 30.0, 2.0, -20.0}) {
                const Vec3d view = towards(elevation, 120.0), sun = towards(sun_elevation, 0.0);
                RandomDouble random{static_cast<uint64_t>(1000.0 + elevation)};
                double sum = 0.0;
                constexpr int walks = 60000;
                for (int i = 0; i < walks; ++i)
                    sum += walk(air, settings, Vec3d(0.0, planet_radius + 100.0, 0.0), view, sun, random) /
                           walks;
                const double cosine = view.dot(sun);
                const Scattered light = air.scattered(air.path(100.0, view.y(), 64), sun.y(), cosine);
                const double ours = light.by_air[green] * rayleigh_phase(cosine) +
                                    light.by_aerosol[green] * aerosol_phase(cosine) + light.rest[green];
                double& worst = aerosol > 0.0 ? worst_haze : worst_air;
                worst = std::max(worst, std::abs(ours / sum - 1.0));
            }
    }
    std::printf("[ daylight ] against a random walk: off by at most %.1f %% in pure air, %.1f %% in haze\n",
                100.0 * worst_air, 100.0 * worst_haze);
    EXPECT_LT(worst_air, 0.03); // including 1 to 2 % noise of the walk
    EXPECT_LT(worst_haze, 0.06);
}

// A colour tints the land that is seen, and not the air; on the land itself it is the reflectance.
TEST(Daylight, TheLandHasItsColour) {
    DaylightSettings grey, brown;
    grey.altitude = brown.altitude = 0.0;
    brown.ground_albedo = {0.3, 0.2, 0.1};
    grey.ground_albedo = Vec3d::Constant(Vec3d(0.2126, 0.7152, 0.0722).dot(brown.ground_albedo));
    const Daylight under_grey(grey), under_brown(brown);
    const Vec3f down = under_brown.radiance(-Vec3d::UnitY()), plain = under_grey.radiance(-Vec3d::UnitY());
    EXPECT_TRUE(down.isApprox(
        plain.cwiseProduct((brown.ground_albedo / grey.ground_albedo.x()).cast<float>()), 1e-5F));
    const Vec3d up = Vec3d(1.0, 0.2, 0.3).normalized();
    EXPECT_EQ(under_brown.radiance(up), under_grey.radiance(up));
    brown.altitude = 100.0;
    const Vec3f far = Daylight(brown).radiance(Vec3d(1.0, -2e-3, 0.0)); // 30 km of air
    EXPECT_GT(far.z() / far.x(), 2.0F * down.z() / down.x());
}

// Light that leaves the top of a planet without absorption, relative to the light that its disc receives.
// Integrates over all sun elevations, which represent all places.
TEST(Daylight, AWhitePlanetSendsBackWhatItReceives) {
    AirSettings settings;
    settings.aerosol_albedo = 1.0;
    settings.ozone = 0.0;
    settings.ground_albedo = 1.0;
    const Atmosphere air(settings);
    constexpr int suns = 120, views = 48, turns = 8;
    const double top = planet_radius + atmosphere_height, rim = planet_radius / top;
    const double horizon = -std::sqrt(1.0 - rim * rim);
    double out = 0.0;
    const auto add = [&](double cosine, double part) { // part: of the cosine's range
        const Path path = air.path(atmosphere_height, cosine, 64);
        for (int i = 0; i < suns; ++i)
            for (int k = 0; k < turns; ++k) {
                const double sun = -0.3 + 1.3 * (i + 0.5) / suns, azimuth = pi * (k + 0.5) / turns;
                const double view_sun = cosine * sun + std::sqrt(1.0 - cosine * cosine) *
                                                           std::sqrt(1.0 - sun * sun) * std::cos(azimuth);
                const Scattered light = air.scattered(path, sun, view_sun);
                const double radiance = light.by_air[green] * rayleigh_phase(view_sun) +
                                        light.by_aerosol[green] * aerosol_phase(view_sun) + light.rest[green];
                // A band of the sphere has area 2 pi R^2 d(sun), its disc pi R^2.
                out += radiance * -cosine * part * 2.0 * pi / turns * 2.0 * 1.3 / suns;
            }
    };
    for (int i = 0; i < views; ++i) {
        const double t = (i + 0.5) / views;
        add(horizon - (1.0 + horizon) * t * t, (1.0 + horizon) * 2.0 * t / views);
        add(horizon * (1.0 - t * t), -horizon * 2.0 * t / views);
        // Sunlight through the rim: a sun at this cosine is seen through the whole atmosphere.
        const Path through = air.path(atmosphere_height, horizon * (1.0 - t * t), 64);
        out += 2.0 * t / views * -horizon * through.transmittance[green] * 2.0 * -horizon * (1.0 - t * t);
    }
    std::printf("[ daylight ] a white planet sends back %.4f of what it receives\n", out);
    EXPECT_NEAR(out, 1.0, 0.04); // multiple scattering is approximated as isotropic
}

TEST(Daylight, IsBlueByDayAndRedWhereTheSunIsLow) {
    const Daylight noon = at_sun(60.0), low = at_sun(3.0), set = at_sun(-3.0);
    const Vec3f overhead = at_sun(30.0).radiance({0.0, 1.0, 0.0});
    EXPECT_GT(overhead.z(), 1.5F * overhead.y());
    EXPECT_GT(overhead.y(), 1.2F * overhead.x());
    const Vec3f glow = low.radiance(towards(1.0, 2.0));
    EXPECT_GT(glow.x(), 1.5F * glow.y());
    EXPECT_GT(glow.y(), 1.5F * glow.z());
    const Vec3f dusk = set.radiance({0.0, 1.0, 0.0}); // blue overhead because of ozone
    EXPECT_GT(dusk.z(), 1.3F * dusk.x());
    EXPECT_LT(dusk.y(), 0.05F * noon.radiance({0.0, 1.0, 0.0}).y());
    EXPECT_LT(dusk.y(), set.radiance(towards(2.0, 0.0)).y()); // darker than where the sun has set
    const Vec3f high = noon.sun_irradiance(), red = low.sun_irradiance();
    EXPECT_GT(high.y() / sun_above_air, 0.7F); // clear air transmits 70 to 90 % of green
    EXPECT_LT(high.y() / sun_above_air, 0.9F);
    EXPECT_GT(red.x(), 2.0F * red.y());
    EXPECT_EQ(set.sun_irradiance().maxCoeff(), 0.0F);
}

TEST(Daylight, DiffuseLightHasItsUsualShare) {
    // On level ground under a clear sky, with the sun at 45 degrees, 10 to 25 % of the light is from the sky
    // (Iqbal, "An Introduction to Solar Radiation", 1983).
    const Daylight day = at_sun(45.0, 2.0);
    Vec3f sky = Vec3f::Zero();
    std::vector<Vec3f> row(256);
    for (size_t i = 0; i < 64; ++i) {
        day.image_row(i, 128, row);
        const double top = pi * static_cast<double>(i) / 128.0, bottom = top + pi / 128.0;
        const double weight = 0.5 * (std::cos(2.0 * top) - std::cos(2.0 * bottom)) * pi / 256.0;
        for (const Vec3f& pixel : row) sky += static_cast<float>(weight) * pixel;
    }
    const double sun = day.sun_irradiance().y() * std::sin(45.0 * degree);
    const double share = sky.y() / (sky.y() + sun);
    std::printf("[ daylight ] the sky gives %.0f %% of the light at 45 degrees\n", 100.0 * share);
    EXPECT_GT(share, 0.10);
    EXPECT_LT(share, 0.25);
}

TEST(Daylight, TheHorizonIsNoEdgeInHaze) {
    const Daylight day = at_sun(30.0, 4.0);
    const double dip = std::acos(planet_radius / (planet_radius + 100.0)) / degree;
    for (const double azimuth : {0.0, 90.0, 180.0}) {
        const Vec3f above = day.radiance(towards(-dip + 0.001, azimuth));
        const Vec3f below = day.radiance(towards(-dip - 0.001, azimuth));
        EXPECT_LT((above - below).cwiseAbs().maxCoeff(), 0.02F * above.maxCoeff()) << azimuth;
    }
}

TEST(Daylight, IsFiniteAndNeverNegative) {
    constexpr std::array<double, 7> elevations = {-90.0, -18.0, -5.0, 0.0, 0.2, 45.0, 90.0};
    constexpr std::array<int, 7> corners = {0, 5, 10, 5, 15, 10, 5}; // of the ranges: one bit per parameter
    for (size_t k = 0; k < elevations.size(); ++k) {
        const double elevation = elevations[k];
        const int corner = corners[k];
        DaylightSettings settings;
        settings.direction = towards(elevation, 70.0);
        settings.turbidity = (corner & 1) != 0 ? 20.0 : 1.0;
        settings.ozone = (corner & 2) != 0 ? 1000.0 : 0.0;
        settings.altitude = (corner & 4) != 0 ? 50000.0 : 0.0;
        settings.ground_albedo.setConstant((corner & 8) != 0 ? 1.0 : 0.0);
        settings.angle = (corner & 1) != 0 ? 10.0 * degree : 0.0;
        const Daylight day(settings);
        std::vector<Vec3f> row(64);
        for (size_t i = 0; i < 64; ++i) {
            day.image_row(i, 64, row);
            for (const Vec3f& pixel : row)
                ASSERT_TRUE(pixel.allFinite() && pixel.minCoeff() >= 0.0F && pixel.maxCoeff() < 100.0F)
                    << elevation << " " << corner << " " << i;
            EXPECT_LT(row[0].maxCoeff(), elevation <= -18.0 ? 1e-5F : 100.0F);
        }
        const Vec3f sun = day.sun_irradiance();
        EXPECT_TRUE(sun.allFinite() && sun.minCoeff() >= 0.0F && sun.maxCoeff() < 1.01F * sun_above_air);
    }
}

} // namespace
} // namespace marram
