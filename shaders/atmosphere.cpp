// SPDX-License-Identifier: Apache-2.0
// Composition of the air
//
// Molecules: vertical optical depth by Bodhaine et al., "On Rayleigh Optical Depth Calculations", 1999,
// equation 30,
//   which falls about as wavelength^-4; density exp(-h / 8.45 km), 8.45 km being that paper's column of molecules over
//   its density at sea level. Phase 3 (1 + c^2) / (16 pi): the 3 % of depolarisation are neglected.
// Aerosol: depth falls as wavelength^-1.3 (Angstrom, "The Parameters of Atmospheric Turbidity", 1964);
// density
//   exp(-h / 1.2 km). Hess et al., "Optical Properties of Aerosols and Clouds: The Software Package OPAC",
//   1998, give continental air a single scattering albedo of 0.925 and a mean cosine of 0.703. The phase
//   function has that mean cosine: two lobes of Henyey and Greenstein, 1941; the narrow one is for coarse
//   dust. Its weight of 0.1 and mean cosine of 0.9 are our choice: they give an aureole of about 5 degrees.
// Ozone: only absorbs. Cross-sections of the Chappuis band at 223 K, means over our bands, after Gorshelev et
// al.,
//   "High Spectral Resolution Ozone Absorption Cross-Sections", 2014; density is a tent from 10 to 40 km.
// There is no refraction: a sun at the horizon is half a degree lower here than on earth.
//
// Light transport
//
// With extinction s per metre, T the transmittance to the viewer, p the phase function, b = s albedo, u the
// sunlight at the point,
//   L(view) = int T (b p(c) u + b S(view)) dt + T_ground albedo_ground / pi E
// S is the scattering of light that was scattered before or reflected by the ground; E the irradiance of the
// ground. S is computed from the light's mean over the sphere, J, its mean times its direction, F, and its
// mean times the products of the direction's components, Q. With x_l the mean Legendre polynomials of the
// phase function, the Legendre expansion up to l = 2 is
//   S(w) = J + 3 x_1 F.w + 5 x_2 (3 w.Q.w - J) / 2 .
// This is exact for molecules (x_1 = 0, x_2 = 0.1) and a blurred lobe for aerosol, where negative values are
// clamped to 0. Light is symmetric about the sun's vertical plane, so that F has 2 and Q, whose trace is J, 3
// independent components.
// J and E are sums of scattering orders. Order n + 1 follows from order n by the same equation, with S = J:
//   L_1 = int T b p u + T_ground a/pi E_0,  L_(n+1) = int T b J_n + T_ground a/pi E_n,
//   J_n = mean of L_n,  E_0 = direct sun,  E_n = flux of L_n,
// in tables over height and sun cosine. The remaining orders are a geometric series, with the ratio of the
// last two tables. (Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering Technique", 2020,
// uses one such isotropic series per point for all orders. Propagating J between points keeps twilight
// correct. F and Q keep the sky overhead correct, which isotropic scattering makes up to 16 % too bright with
// aerosol.)
//
// Paths are segmented by the change of the air: they are split at their lowest point, and segments grow with
// the square of the distance from it. Extinction and source are constant in a segment, those of its middle,
// and the integral of the exponential is exact: int_0^d exp(-s t) dt = (1 - exp(-s d)) / s, so that a thick
// segment gives at most source / s.
//
// Sun: air columns are tabulated over height and over the cosine above the horizon, both by their square
// root. Logarithms are interpolated, which is exact for exponential air. The penumbra of the planet is as
// wide as the sun: the fraction of a disc above a line at x radii from its centre is
// (acos(-x) + x sqrt(1 - x^2)) / pi.
#include "shaders/atmosphere.h"

#include <algorithm>

namespace marram {

namespace {

constexpr double air_scale = 8450.0, aerosol_scale = 1200.0;         // m
constexpr double ozone_middle = 25000.0, ozone_half_width = 15000.0; // m
constexpr double dobson_unit = 2.6867e20;                            // molecules / m2
constexpr double angstrom_exponent = 1.3;
constexpr double mean_cosine = 0.703, coarse_share = 0.1, coarse_cosine = 0.9;
constexpr double fine_cosine = (mean_cosine - coarse_share * coarse_cosine) / (1.0 - coarse_share);
// Phase functions: mean Legendre polynomials of degree 1 and 2. A Henyey-Greenstein lobe has g and g^2.
constexpr float air_second = 0.1F, aerosol_first = static_cast<float>(mean_cosine);
constexpr float aerosol_second = static_cast<float>((1.0 - coarse_share) * fine_cosine * fine_cosine +
                                                    coarse_share * coarse_cosine * coarse_cosine);
constexpr std::array<double, band_count> ozone_cross_section = { // 1e-25 m2
    0.005, 0.021, 0.070, 0.195, 0.430, 0.838, 1.54, 2.45, 3.30, 4.47, 4.55, 4.66, 3.48, 2.45, 1.66, 1.08};

// Table sizes: the error of each is below that of the angular approximation of higher orders, measured by
// doubling.
constexpr size_t column_heights = 64, column_cosines = 160;
constexpr int column_segments = 96;
constexpr size_t field_heights = 24, field_suns = 40;
constexpr double lowest_sun = -0.4; // cosine; air below 100 km is in full shadow below -0.18
// For a sun below the horizon tables hold light over exp(cosine / dusk), which is smooth: light falls about
// as fast.
constexpr double dusk = 0.024;
constexpr size_t polar_cells = 8, azimuth_cells = 3; // on each side of the horizon; per half turn
constexpr int field_segments = 24;
constexpr int polar_samples = 4, azimuth_samples = 8; // of the phase functions in a cell
constexpr int max_orders = 10;
constexpr float last_order = 1e-3F; // fraction of the sum; stops below it
constexpr float max_series_ratio = 0.98F;
constexpr double min_column = 1e-3; // m at maximum density: negligible, keeps logarithms finite

double square(double x) { return x * x; }

double horizon_cosine(double height) {
    return -std::sqrt(height * (2.0 * planet_radius + height)) / (planet_radius + height);
}

double henyey_greenstein(double cosine, double mean) {
    const double d = 1.0 + mean * mean - 2.0 * mean * cosine;
    return (1.0 - mean * mean) / (4.0 * pi * d * std::sqrt(d));
}

// Densities of air, aerosol and ozone, relative to their maxima.
std::array<double, 3> densities(double height) {
    return {std::exp(-height / air_scale), std::exp(-height / aerosol_scale),
            std::max(0.0, 1.0 - std::abs(height - ozone_middle) / ozone_half_width)};
}

struct PathExtent {
    double length;
    bool meets_ground;
};

PathExtent reach(double height, double cosine) {
    const double radius = planet_radius + height, along = radius * cosine;
    const double above = height * (2.0 * planet_radius + height), square_along = along * along;
    if (cosine < 0.0 && square_along >= above)
        return {above / (std::sqrt(square_along - above) - along), true};
    const double missing =
        std::max(0.0, (atmosphere_height - height) * (2.0 * planet_radius + atmosphere_height + height));
    const double root = std::sqrt(square_along + missing);
    return {along > 0.0 ? missing / (root + along) : root - along, false};
}

// Calls use(distance, length of the segment, height of its middle) for each segment, starting at the viewer.
template <typename Use>
void for_segments(double height, double cosine, double length, int count, Use&& use) {
    const double radius = planet_radius + height, start = radius * cosine, end = start + length;
    const double lowest = radius * radius * (1.0 - cosine * cosine);
    const double down = std::max(0.0, std::min(0.0, end) - start), up = length - down;
    const double share = std::sqrt(down) / std::max(std::sqrt(down) + std::sqrt(up), 1e-300);
    const int falling = down > 0.0 ? std::max(1, static_cast<int>(std::lround(share * count))) : 0;
    const int rising = up > 0.0 ? std::max(1, count - falling) : 0;
    const auto segment = [&](double from, double to) {
        const double middle = 0.5 * (from + to), at = start + middle;
        use(middle, to - from, std::max(0.0, std::sqrt(lowest + at * at) - planet_radius));
    };
    for (int i = 0; i < falling; ++i)
        segment(down * (1.0 - square(1.0 - static_cast<double>(i) / falling)),
                down * (1.0 - square(1.0 - static_cast<double>(i + 1) / falling)));
    for (int i = 0; i < rising; ++i)
        segment(down + up * square(static_cast<double>(i) / rising),
                down + up * square(static_cast<double>(i + 1) / rising));
}

// (1 - exp(-x)) / x, given exp(-x); a series for small x, where the difference would cancel.
Spectrum mean_transmittance(const Spectrum& x, const Spectrum& transmittance) {
    const Spectrum series = 1.0F - x * (0.5F - x * (1.0F / 6.0F));
    return (x < 0.01F).select(series, (1.0F - transmittance) / x.max(0.01F));
}

// Position in a table for linear interpolation.
struct TablePosition {
    size_t cell;
    float part;
};

TablePosition between(double position, size_t size) {
    const double at = std::clamp(position, 0.0, 1.0) * static_cast<double>(size - 1);
    const size_t cell = std::min(static_cast<size_t>(at), size - 2);
    return {cell, static_cast<float>(at - static_cast<double>(cell))};
}

double height_position(double height) { return std::sqrt(std::max(0.0, height) / atmosphere_height); }
double height_of(size_t row, size_t rows) {
    return atmosphere_height * square(static_cast<double>(row) / static_cast<double>(rows - 1));
}

// Signed square root of the cosine, so that samples are dense at dusk.
double sun_position(double cosine) {
    const double lowest = -std::sqrt(-lowest_sun);
    return (std::copysign(std::sqrt(std::abs(cosine)), cosine) - lowest) / (1.0 - lowest);
}
double sun_of(size_t column) {
    const double lowest = -std::sqrt(-lowest_sun);
    const double root = lowest + (1.0 - lowest) * static_cast<double>(column) / (field_suns - 1);
    return std::copysign(root * root, root);
}

float dusk_scale(double sun_cosine) {
    if (sun_cosine >= 0.0) return 1.0F;
    return static_cast<float>(std::exp(std::max(sun_cosine, lowest_sun) / dusk));
}

double sine_of(double cosine) { return std::sqrt(std::max(0.0, 1.0 - cosine * cosine)); }

// Cosine between two directions, given their cosines with the vertical and the azimuth between them.
double angle_cosine(double a, double b, double azimuth) {
    return std::clamp(a * b + sine_of(a) * sine_of(b) * std::cos(azimuth), -1.0, 1.0);
}

} // namespace

// A cell of the sphere of directions at a point, together with its mirror image about the sun's vertical
// plane.
struct Atmosphere::Cell {
    double low = 0.0, high = 0.0; // cosines with the vertical
    double azimuth_from = 0.0, azimuth_to = 0.0;
    double view_sun = 0.0;                 // cosine between its centre and the sun's direction
    double by_air = 0.0, by_aerosol = 0.0; // mean phase functions
    double middle() const { return 0.5 * (low + high); }
    double solid_angle() const { return 2.0 * (azimuth_to - azimuth_from) * (high - low); }
};

void serial_loop(size_t count, const std::function<void(size_t)>& body) {
    for (size_t i = 0; i < count; ++i) body(i);
}

double rayleigh_depth(double wavelength) {
    const double l2 = square(1e-3 * wavelength); // in micrometres
    return 0.0021520 * (1.0455996 - 341.29061 / l2 - 0.90230850 * l2) /
           (1.0 + 0.0027059889 / l2 - 85.968563 * l2);
}

double rayleigh_phase(double cosine) { return 3.0 / (16.0 * pi) * (1.0 + cosine * cosine); }

double aerosol_phase(double cosine) {
    return (1.0 - coarse_share) * henyey_greenstein(cosine, fine_cosine) +
           coarse_share * henyey_greenstein(cosine, coarse_cosine);
}

Atmosphere::Atmosphere(const AirSettings& settings, const Loop& loop, bool scatters) : settings_(settings) {
    for (int band = 0; band < band_count; ++band) {
        const double wavelength = wavelength_of(band);
        const double haze = std::pow(wavelength / zenith_wavelength, -angstrom_exponent);
        const double molecules =
            settings.ozone * dobson_unit / ozone_half_width; // per m^3, at the peak of the tent
        air_[band] = static_cast<float>(settings.air * rayleigh_depth(wavelength) / air_scale);
        aerosol_[band] = static_cast<float>(settings.aerosol * haze / aerosol_scale);
        ozone_[band] = static_cast<float>(1e-25 * ozone_cross_section[static_cast<size_t>(band)] * molecules);
    }
    make_columns(loop);
    if (scatters) make_field(loop);
}

void Atmosphere::make_columns(const Loop& loop) {
    columns_.resize(column_heights * column_cosines);
    loop(column_heights, [&](size_t row) {
        const double height = height_of(row, column_heights), horizon = horizon_cosine(height);
        for (size_t column = 0; column < column_cosines; ++column) {
            const double root = static_cast<double>(column) / (column_cosines - 1);
            const double cosine = horizon + (1.0 - horizon) * root * root;
            const double radius = planet_radius + height, along = radius * cosine;
            // Always to space, even if rounding makes a tangent path touch the ground.
            const double missing =
                (atmosphere_height - height) * (2.0 * planet_radius + atmosphere_height + height);
            const double length = std::sqrt(along * along + std::max(0.0, missing)) - along;
            std::array<double, 3> sum{};
            for_segments(height, cosine, length, column_segments, [&](double, double part, double at) {
                const std::array<double, 3> density = densities(at);
                for (size_t i = 0; i < 3; ++i) sum[i] += part * density[i];
            });
            for (size_t i = 0; i < 3; ++i)
                columns_[row * column_cosines + column][i] =
                    static_cast<float>(std::log(sum[i] + min_column));
        }
    });
}

std::array<double, 3> Atmosphere::columns(double height, double cosine) const {
    const double horizon = horizon_cosine(height);
    const TablePosition y = between(height_position(height), column_heights);
    const TablePosition x =
        between(std::sqrt(std::max(0.0, cosine - horizon) / (1.0 - horizon)), column_cosines);
    const std::array<float, 3>* at = &columns_[y.cell * column_cosines + x.cell];
    std::array<double, 3> result{};
    for (size_t i = 0; i < 3; ++i) {
        const float top = at[0][i] + x.part * (at[1][i] - at[0][i]);
        const float bottom =
            at[column_cosines][i] + x.part * (at[column_cosines + 1][i] - at[column_cosines][i]);
        result[i] = static_cast<double>(std::exp(top + y.part * (bottom - top)));
    }
    return result;
}

Spectrum Atmosphere::transmittance(double height, double cosine) const {
    if (cosine < horizon_cosine(height)) return Spectrum::Zero();
    const std::array<double, 3> column = columns(height, cosine);
    return (-(static_cast<float>(column[0]) * air_ + static_cast<float>(column[1]) * aerosol_ +
              static_cast<float>(column[2]) * ozone_))
        .exp();
}

Spectrum Atmosphere::sunlight(double height, double sun_cosine) const {
    const double horizon = horizon_cosine(height);
    // Near the horizon an angle is the difference of cosines over the sine.
    const double radius = std::max(settings_.sun_radius, 1e-6) * sine_of(horizon);
    const double above = (sun_cosine - horizon) / radius;
    if (above <= -1.0) return Spectrum::Zero();
    const Spectrum light = transmittance(height, std::max(sun_cosine, horizon));
    if (above >= 1.0) return light;
    return light * static_cast<float>((std::acos(-above) + above * sine_of(above)) / pi);
}

Atmosphere::Coefficients Atmosphere::coefficients(double height) const {
    const std::array<double, 3> density = densities(height);
    const Spectrum air = static_cast<float>(density[0]) * air_;
    const Spectrum aerosol = static_cast<float>(density[1]) * aerosol_;
    return {air, static_cast<float>(settings_.aerosol_albedo) * aerosol,
            air + aerosol + static_cast<float>(density[2]) * ozone_};
}

Path Atmosphere::path(double height, double cosine, int segments) const {
    Path path;
    path.radius = planet_radius + height;
    path.cosine = cosine;
    const PathExtent to = reach(height, cosine);
    path.length = to.length;
    path.meets_ground = to.meets_ground;
    path.steps.reserve(static_cast<size_t>(segments) + 1);
    for_segments(height, cosine, to.length, segments, [&](double distance, double length, double at) {
        const Coefficients air = coefficients(at);
        const Spectrum depth = air.extinction * static_cast<float>(length), left = (-depth).exp();
        const Spectrum seen =
            path.transmittance * mean_transmittance(depth, left) * static_cast<float>(length);
        path.steps.push_back({distance, at, seen * air.by_air, seen * air.by_aerosol});
        path.transmittance *= left;
    });
    return path;
}

Spectrum Atmosphere::mean_at(const Field& field, double height, double sun_cosine) {
    const TablePosition y = between(height_position(height), field_heights);
    const TablePosition x = between(sun_position(sun_cosine), field_suns);
    const Spectrum* at = &field.mean[y.cell * field_suns + x.cell];
    const float scale = dusk_scale(sun_cosine), top = scale * (1.0F - y.part), bottom = scale * y.part;
    return top * (1.0F - x.part) * at[0] + top * x.part * at[1] + bottom * (1.0F - x.part) * at[field_suns] +
           bottom * x.part * at[field_suns + 1];
}

Spectrum Atmosphere::ground_at(const Field& field, double sun_cosine) {
    const TablePosition x = between(sun_position(sun_cosine), field_suns);
    const float scale = dusk_scale(sun_cosine);
    return scale * (1.0F - x.part) * field.ground[x.cell] + scale * x.part * field.ground[x.cell + 1];
}

// Multiple scattering of a segment towards the viewer. view_cosine: of the path with the vertical at the
// segment.
Spectrum Atmosphere::multiple_scattering(const PathStep& step, double sun_cosine, double view_cosine,
                                         double view_sun) const {
    const TablePosition y = between(height_position(step.height), field_heights);
    const TablePosition x = between(sun_position(sun_cosine), field_suns);
    const size_t cell = y.cell * field_suns + x.cell;
    const double up = std::clamp(view_cosine, -1.0, 1.0), sine = sine_of(up);
    const double sun_sine = std::max(sine_of(sun_cosine), 1e-4); // at the zenith level moments vanish
    const double level = std::clamp((view_sun - up * sun_cosine) / sun_sine, -sine, sine);
    const double side2 = std::max(0.0, 1.0 - up * up - level * level);
    Spectrum mean = Spectrum::Zero(), first = mean, second = mean;
    const auto add = [&](size_t at, float weight) {
        const Moments& m = field_.moments[at];
        const Spectrum& all = field_.mean[at];
        mean += weight * all;
        first += weight * (static_cast<float>(up) * m.up + static_cast<float>(level) * m.level);
        second +=
            weight * (static_cast<float>(up * up - side2) * m.up_up +
                      static_cast<float>(level * level - side2) * m.level_level +
                      static_cast<float>(2.0 * up * level) * m.up_level + static_cast<float>(side2) * all);
    };
    add(cell, (1.0F - y.part) * (1.0F - x.part));
    add(cell + 1, (1.0F - y.part) * x.part);
    add(cell + field_suns, y.part * (1.0F - x.part));
    add(cell + field_suns + 1, y.part * x.part);
    const Spectrum bent = 1.5F * second - 0.5F * mean;
    const Spectrum aerosol = mean + 3.0F * aerosol_first * first + 5.0F * aerosol_second * bent;
    return dusk_scale(sun_cosine) *
           (step.by_air * (mean + 5.0F * air_second * bent) + step.by_aerosol * aerosol.max(0.0F));
}

Scattered Atmosphere::scattered(const Path& path, double sun_cosine, double view_sun) const {
    Scattered sum;
    const auto sun_at = [&](double distance, double radius) {
        return (path.radius * sun_cosine + distance * view_sun) / radius;
    };
    for (const PathStep& step : path.steps) {
        const double sun = sun_at(step.distance, planet_radius + step.height);
        const Spectrum light = sunlight(step.height, sun);
        sum.by_air += step.by_air * light;
        sum.by_aerosol += step.by_aerosol * light;
        const double up = (path.radius * path.cosine + step.distance) / (planet_radius + step.height);
        sum.rest += multiple_scattering(step, sun, up, view_sun);
    }
    if (path.meets_ground) {
        const double sun = sun_at(path.length, planet_radius);
        const Spectrum light =
            ground_at(field_, sun) + static_cast<float>(std::max(0.0, sun)) * sunlight(0.0, sun);
        sum.rest += path.transmittance * light * static_cast<float>(settings_.ground_albedo / pi);
        sum.white_ground = path.transmittance * light * static_cast<float>(1.0 / pi);
    }
    return sum;
}

void Atmosphere::make_field(const Loop& loop) {
    Field order = next_order(nullptr, loop), before;
    field_ = order;
    const auto add = [](const std::vector<Spectrum>& more, std::vector<Spectrum>& sum) {
        float share = 0.0F;
        for (size_t i = 0; i < sum.size(); ++i) {
            sum[i] += more[i];
            share = std::max(share, (more[i] / sum[i].max(1e-6F)).maxCoeff());
        }
        return share;
    };
    const auto add_moments = [&](const Spectrum& factor, size_t i) {
        for (Spectrum Moments::*moment : all_moments)
            field_.moments[i].*moment += factor * (order.moments[i].*moment);
    };
    for (int i = 1; i < max_orders; ++i) {
        before = std::move(order);
        order = next_order(&before, loop);
        for (size_t k = 0; k < order.moments.size(); ++k) add_moments(Spectrum::Ones(), k);
        const float share = std::max(add(order.mean, field_.mean), add(order.ground, field_.ground));
        if (share < last_order) return;
    }
    const auto series = [](const Spectrum& first, const Spectrum& second) -> Spectrum {
        const Spectrum ratio = (second / first.max(1e-30F)).min(max_series_ratio);
        return ratio / (1.0F - ratio);
    };
    for (size_t i = 0; i < field_.mean.size(); ++i) {
        const Spectrum more = series(before.mean[i], order.mean[i]);
        field_.mean[i] += more * order.mean[i];
        add_moments(more, i);
    }
    for (size_t i = 0; i < field_.ground.size(); ++i)
        field_.ground[i] += series(before.ground[i], order.ground[i]) * order.ground[i];
}

Atmosphere::Field Atmosphere::next_order(const Field* before, const Loop& loop) const {
    Field order;
    order.mean.assign(field_heights * field_suns, Spectrum::Zero());
    order.moments.resize(field_heights * field_suns);
    order.ground.assign(field_suns, Spectrum::Zero());
    loop(field_heights, [&](size_t row) { compute_table_row(row, before, order); });
    return order;
}

// Radiance that arrives along a path, averaged over a cell of directions: light of the order `before`,
// scattered once more. nullptr: sunlight.
Spectrum Atmosphere::incident_radiance(const Path& path, double sun_cosine, const Cell& cell,
                                       const Field* before) const {
    Spectrum sum = Spectrum::Zero();
    const auto sun_at = [&](double distance, double radius) {
        return (path.radius * sun_cosine + distance * cell.view_sun) / radius;
    };
    const float by_air = static_cast<float>(cell.by_air), by_aerosol = static_cast<float>(cell.by_aerosol);
    for (const PathStep& step : path.steps) {
        const double sun = sun_at(step.distance, planet_radius + step.height);
        if (before)
            sum += (step.by_air + step.by_aerosol) * mean_at(*before, step.height, sun);
        else
            sum += (by_air * step.by_air + by_aerosol * step.by_aerosol) * sunlight(step.height, sun);
    }
    if (!path.meets_ground) return sum;
    const double sun = sun_at(path.length, planet_radius);
    const Spectrum light = before ? ground_at(*before, sun)
                                  : Spectrum(static_cast<float>(std::max(0.0, sun)) * sunlight(0.0, sun));
    return sum + path.transmittance * light * static_cast<float>(settings_.ground_albedo / pi);
}

// Cells on both sides of the horizon, narrow near it, where the gradient of the sky is steep.
std::vector<Atmosphere::Cell> Atmosphere::cells_around(double horizon) {
    const auto edge = [&](size_t at) {
        const double t = static_cast<double>(at) / polar_cells - 1.0;
        return horizon + (t < 0.0 ? -(1.0 + horizon) : 1.0 - horizon) * t * t;
    };
    std::vector<Cell> cells;
    for (size_t i = 0; i < 2 * polar_cells; ++i)
        for (size_t j = 0; j < azimuth_cells; ++j)
            cells.push_back({.low = edge(i),
                             .high = edge(i + 1),
                             .azimuth_from = pi * static_cast<double>(j) / azimuth_cells,
                             .azimuth_to = pi * static_cast<double>(j + 1) / azimuth_cells});
    return cells;
}

// Mean phase functions of each cell, normalised so that the sampling loses no light.
void Atmosphere::average_phases(std::vector<Cell>& cells, double sun) {
    double air = 0.0, aerosol = 0.0;
    for (Cell& cell : cells) {
        cell.by_air = cell.by_aerosol = 0.0;
        for (int i = 0; i < polar_samples * azimuth_samples; ++i) {
            const double x = (i % azimuth_samples + 0.5) / azimuth_samples;
            const double y = (i / azimuth_samples + 0.5) / polar_samples; // integer division: the row
            const double cosine = angle_cosine(cell.low + y * (cell.high - cell.low), sun,
                                               cell.azimuth_from + x * (cell.azimuth_to - cell.azimuth_from));
            cell.by_air += rayleigh_phase(cosine);
            cell.by_aerosol += aerosol_phase(cosine);
        }
        air += cell.by_air * cell.solid_angle();
        aerosol += cell.by_aerosol * cell.solid_angle();
    }
    for (Cell& cell : cells) {
        cell.by_air /= air;
        cell.by_aerosol /= aerosol;
    }
}

// Computes one row of the tables. All sun positions share the paths; only the lighting differs.
void Atmosphere::compute_table_row(size_t row, const Field* before, Field& order) const {
    const double height = height_of(row, field_heights);
    std::vector<Cell> cells = cells_around(horizon_cosine(height));
    std::vector<Path> paths;
    for (size_t i = 0; i < cells.size(); i += azimuth_cells)
        paths.push_back(path(height, cells[i].middle(), field_segments));
    for (size_t column = 0; column < field_suns; ++column) {
        const double sun = sun_of(column);
        if (!before) average_phases(cells, sun);
        Spectrum mean = Spectrum::Zero(), down = mean;
        Moments moments{mean, mean, mean, mean, mean};
        for (size_t i = 0; i < cells.size(); ++i) {
            Cell& cell = cells[i];
            cell.view_sun = angle_cosine(cell.middle(), sun, 0.5 * (cell.azimuth_from + cell.azimuth_to));
            const Spectrum light = incident_radiance(paths[i / azimuth_cells], sun, cell, before);
            const Spectrum part = light * static_cast<float>(cell.solid_angle() / (4.0 * pi));
            mean += part;
            const double middle = 0.5 * (cell.azimuth_from + cell.azimuth_to);
            const float up = static_cast<float>(cell.middle());
            const float level = static_cast<float>(sine_of(cell.middle()) * std::cos(middle));
            moments.up += up * part;
            moments.level += level * part;
            moments.up_up += up * up * part;
            moments.level_level += level * level * part;
            moments.up_level += up * level * part;
            down += light * static_cast<float>(cell.solid_angle() * std::max(0.0, cell.middle()));
        }
        const size_t at = row * field_suns + column;
        order.mean[at] = mean / dusk_scale(sun);
        for (Spectrum Moments::*moment : all_moments)
            order.moments[at].*moment = moments.*moment / dusk_scale(sun);
        if (row == 0)
            order.ground[column] = down / dusk_scale(sun); // at sea level the horizon is at cosine 0
    }
}

} // namespace marram
