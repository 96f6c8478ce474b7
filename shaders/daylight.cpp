// SPDX-License-Identifier: Apache-2.0
// From spectra to colours
//
// A band's spectrum f is relative to the sun's, a black body of 5772 K (nominal solar temperature, IAU 2015
// resolution B3). The sun's own spectrum matters only up to the white point, as it is mapped to white. With
// x, y, z the CIE 1931 functions in the fit of Wyman et al. 2013, sums over the bands give XYZ; Bradford's
// transform maps the XYZ of f = 1 to the white of sRGB; the matrix of IEC 61966-2-1 gives linear sRGB.
// Together they are one matrix of 3 x 16.
//
// Image rows
//
// radiance = A p_air(c) + B p_aerosol(c) + C. In a row of the image the colours A, B and C depend on the
// azimuth only through the height of the sun over distant air. This function is even and smooth: it is
// interpolated by Catmull-Rom through 17 values per half turn. The phase functions do not depend on
// wavelength, so that A, B and C can be converted to colours first.
#include "shaders/daylight.h"

#include <algorithm>

namespace marram {

namespace {

using ColorMatrix = Eigen::Matrix<float, 3, band_count>;

constexpr double sun_temperature = 5772.0;               // K
constexpr double second_radiation_constant = 1.438777e7; // nm K
constexpr int view_segments = 64;
constexpr size_t azimuths = 17;
constexpr int sun_strips = 16;

// A bell with different widths on its two sides (Wyman et al. 2013).
double bell(double wavelength, double middle, double below, double above) {
    const double t = (wavelength - middle) / (wavelength < middle ? below : above);
    return std::exp(-0.5 * t * t);
}

Vec3d cie_xyz(double l) {
    return {1.056 * bell(l, 599.8, 37.9, 31.0) + 0.362 * bell(l, 442.0, 16.0, 26.7) -
                0.065 * bell(l, 501.1, 20.4, 26.2),
            0.821 * bell(l, 568.8, 46.9, 40.5) + 0.286 * bell(l, 530.9, 16.3, 31.1),
            1.217 * bell(l, 437.0, 11.8, 36.0) + 0.681 * bell(l, 459.0, 26.0, 13.8)};
}

double black_body(double wavelength) {
    const double scaled = wavelength / zenith_wavelength; // the scale cancels
    return std::pow(scaled, -5.0) / std::expm1(second_radiation_constant / (wavelength * sun_temperature));
}

ColorMatrix make_color_matrix() {
    Eigen::Matrix<double, 3, band_count> xyz;
    for (int band = 0; band < band_count; ++band)
        xyz.col(band) = black_body(wavelength_of(band)) * cie_xyz(wavelength_of(band));
    Eigen::Matrix3d bradford, srgb;
    bradford << 0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296;
    srgb << 3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570;
    const Vec3d cones = bradford * xyz.rowwise().sum();
    const Vec3d white = bradford * srgb.inverse() * Vec3d::Ones();
    const Eigen::Matrix3d adapt = white.cwiseQuotient(cones).asDiagonal();
    return (srgb * bradford.inverse() * adapt * bradford * xyz).cast<float>();
}

// A, B and C as colours, smooth functions of the azimuth in a row.
struct Parts {
    Vec3f by_air, by_aerosol, rest;
    Vec3f radiance(double view_sun) const {
        const Vec3f sum = static_cast<float>(rayleigh_phase(view_sun)) * by_air +
                          static_cast<float>(aerosol_phase(view_sun)) * by_aerosol + rest;
        return sun_above_air * sum.cwiseMax(0.0F);
    }
};

// The grey ground that lights the air: of the same luminance.
double grey_of(const Vec3d& albedo) {
    const bool grey = albedo.x() == albedo.y() && albedo.y() == albedo.z();
    return grey ? albedo.x() : Vec3d(0.2126, 0.7152, 0.0722).dot(albedo);
}

// `tint`: the ground's albedo above that of its grey.
Parts parts_of(const Scattered& light, const Vec3f& tint) {
    return {color_of(light.by_air), color_of(light.by_aerosol),
            color_of(light.rest) + tint.cwiseProduct(color_of(light.white_ground))};
}

Vec3f cubic(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Vec3f& d, float t) {
    return b + 0.5F * t * (c - a + t * (2.0F * a - 5.0F * b + 4.0F * c - d + t * (3.0F * (b - c) + d - a)));
}

// Interpolates at an azimuth of 0 ... pi; the function is even about both ends.
Parts between_azimuths(std::span<const Parts> parts, double azimuth) {
    const double at = azimuth / pi * static_cast<double>(azimuths - 1);
    const size_t i = std::min(static_cast<size_t>(at), azimuths - 2);
    const float t = static_cast<float>(at - static_cast<double>(i));
    const Parts &a = parts[i == 0 ? 1 : i - 1], &b = parts[i], &c = parts[i + 1];
    const Parts& d = parts[i + 2 < azimuths ? i + 2 : azimuths - 2];
    return {cubic(a.by_air, b.by_air, c.by_air, d.by_air, t),
            cubic(a.by_aerosol, b.by_aerosol, c.by_aerosol, d.by_aerosol, t),
            cubic(a.rest, b.rest, c.rest, d.rest, t)};
}

} // namespace

AirSettings air_of(const DaylightSettings& settings) {
    AirSettings air;
    air.aerosol = (settings.turbidity - 1.0) * rayleigh_depth(zenith_wavelength);
    air.ozone = settings.ozone;
    air.ground_albedo = grey_of(settings.ground_albedo);
    air.sun_radius = 0.5 * settings.angle;
    return air;
}

Vec3f color_of(const Spectrum& spectrum) {
    static const ColorMatrix matrix = make_color_matrix();
    return matrix * spectrum.matrix();
}

Daylight::Daylight(const DaylightSettings& settings, const Loop& loop)
    : settings_(settings), atmosphere_(air_of(settings), loop),
      sun_cosine_(settings.direction.normalized().y()),
      ground_tint_((settings.ground_albedo.array() - grey_of(settings.ground_albedo)).cast<float>()) {}

Vec3f Daylight::radiance(const Vec3d& direction) const {
    const Vec3d view = direction.normalized();
    const double view_sun = std::clamp(view.dot(settings_.direction.normalized()), -1.0, 1.0);
    const Path path = atmosphere_.path(settings_.altitude, view.y(), view_segments);
    return parts_of(atmosphere_.scattered(path, sun_cosine_, view_sun), ground_tint_).radiance(view_sun);
}

Vec3f sun_irradiance(const DaylightSettings& settings, const Atmosphere& air) {
    const double elevation = std::asin(settings.direction.normalized().y()), radius = 0.5 * settings.angle;
    Spectrum sum = Spectrum::Zero();
    for (int i = 0; i < sun_strips; ++i) { // horizontal strips: transmittance is steep at the horizon
        const double low = -1.0 + 2.0 * i / sun_strips, high = low + 2.0 / sun_strips;
        const auto below = [](double x) { return (std::acos(-x) + x * std::sqrt(1.0 - x * x)) / pi; };
        const double share = below(std::min(high, 1.0)) - below(low);
        const double at = std::sin(elevation + 0.5 * (low + high) * radius);
        sum += air.transmittance(settings.altitude, at) * static_cast<float>(share);
    }
    return sun_above_air * color_of(sum).cwiseMax(0.0F);
}

void Daylight::image_row(size_t row, size_t height, std::span<Vec3f> pixels) const {
    const double zenith = pi * (static_cast<double>(row) + 0.5) / static_cast<double>(height);
    const double up = std::cos(zenith), level = std::sin(zenith);
    const double sun_level = std::sqrt(1.0 - sun_cosine_ * sun_cosine_);
    const auto view_sun = [&](double azimuth) {
        return std::clamp(up * sun_cosine_ + level * sun_level * std::cos(azimuth), -1.0, 1.0);
    };
    const Path path = atmosphere_.path(settings_.altitude, up, view_segments);
    std::vector<Parts> parts;
    for (size_t i = 0; i < azimuths; ++i) {
        const double azimuth = pi * static_cast<double>(i) / static_cast<double>(azimuths - 1);
        parts.push_back(parts_of(atmosphere_.scattered(path, sun_cosine_, view_sun(azimuth)), ground_tint_));
    }
    const size_t width = pixels.size();
    for (size_t column = 0; column < width; ++column) {
        const double turn = 2.0 * (static_cast<double>(column) + 0.5) / static_cast<double>(width) - 1.0;
        const double azimuth = pi * std::abs(turn);
        pixels[column] = between_azimuths(parts, azimuth).radiance(view_sun(azimuth));
    }
}

} // namespace marram
