// SPDX-License-Identifier: Apache-2.0
// Wind ripples. The same ripple field displaces the mesh near the camera (procedural/terrain/sand/ripples.cpp) and
// shades it far away (shaders/sand.cpp), so that the transition does not show.
//
// Direction. On level sand the crests are normal to the wind. On a slope the creeping grains, which build the
// ripples, are deflected downhill (A. Howard, "Effect of slope on the threshold of motion and its application
// to orientation of wind ripples", GSA Bulletin 88, 1977). At the threshold of motion, the vector sum of the
// wind's drag and the weight of a grain along the surface, W sin(slope), equals the friction,
// W cos(slope) tan(repose), in the direction of the grain's motion. The component across the wind comes from
// the weight only, so
//
//   sin(delta) = tan(slope) sin(beta) / tan(repose)
//
// beta: angle between the wind and the line of steepest descent; delta: angle by which the grain's motion,
// and so the normal of the crests, is turned from the wind towards that line. This holds for wind up and
// down the slope. All angles, and the wavelength, are measured in the surface. The wind follows the surface
// without sideways deflection. With unit vectors in the surface, w along the wind and f along the steepest
// descent, the direction is
//
//   s = tan(slope) / tan(repose) (f - (f . w) w),  |s| = sin(delta),  d = sqrt(1 - s^2) w + s
//
// which needs no angle and is smooth on level ground. |s| is limited to 1; it exceeds 1 only on slopes
// steeper than repose, which have no ripples.
//
// Phase. It must advance by one turn per wavelength along d, also where d varies. A function of the product
// of position and d, with or without added noise, cannot do this: it stretches the ripples. We use the
// phase of a sum of wave packets with random positions x_k and phases p_k (Tricard et al., "Procedural
// Phasor Noise", ACM Transactions on Graphics 38, 2019):
//
//   G = sum (1 - q)^3 exp(2 pi i (a + p_k)), q = (a / 3.2)^2 + (b / 6.5)^2 < 1
//   a = d . (x - x_k) / wavelength, b the same along the crest, both in the surface
//
// Each cell of a grid has one packet at a random position. The phase makes a full turn around the zeros of
// G: there a crest ends or forks (a Y junction), as on real ripples, and nothing is stretched. The size of
// the packets sets the density of zeros: the spectrum of (1 - q)^3 is about that of a Gaussian with
// s^2 = R^2 / 6, and a Gaussian field with this spectrum has 1 / (4 pi s_a s_b) zeros per wavelength squared
// (after S. Rice, "Mathematical Analysis of Random Noise", 1945, in two dimensions): one in 44. Longer
// packets have straighter crests. Noise over 8 wavelengths turns d, by 9 degrees at most and 1.3 on
// average, so that crests wander; the count is then about one in 30. d is evaluated at x for all packets.
// The error of the phase gradient is the mean of (x - x_k) times the change of d. This mean is near 0, but
// d must vary little over the three wavelengths of a packet, or crests bend at each zero.
//
// Profile: -f(phi), f = sin(phi + sin(phi) / 2). The lee is the steep side: its maximum slope, 1.5, is 2.4
// times that of the windward side. The mean is 0. With the unit phasor (c, s) no angle is computed:
// sin(phi + s / 2) = s cos(s / 2) + c sin(s / 2). The amplitude is height / 2 |G| / sqrt(|G|^2 + (g / 3)^2),
// g^2 the mean of |G|^2: 0.87 of height / 2 on average, and 0 at the zeros of G, so that the surface is
// continuous there.
//
// Slope: the gradient of G in the same sum, with d constant. With q' = 2 (a f / 3.2^2 + b g / 6.5^2), f and g
// the axes of a and b,
//
//   grad G = sum (-3 (1 - q)^2 q' + 2 pi i (1 - q)^3 f) exp(2 pi i (a + p_k))
//
// The gradient of the phase is Im(conj(G) grad G) / |G|^2, that of |G| is Re(conj(G) grad G) / |G|.
//
// Slope variance: (height / 2)^2 |grad phi|^2 times 0.54, the mean of f'^2, times 0.79, the mean square of
// the amplitude's factor.
//
// Cost: about 10 to 14 vectors of 8 packets per point.
#include "core/math/ripples.h"

#include "core/math/hash.h"
#include "core/math/simd.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr double ripple_across = 3.2, ripple_along = 6.5; // half axes of a packet, wavelengths
constexpr double ripple_cell = 1.25;                      // side of a packet's cell, wavelengths
constexpr double ripple_wander = 9.0 * degree,
                 ripple_wander_frequency =
                     ripple_cell / 8.0; // maximum turn of d; frequency of its noise, per cell

// Surface coordinates in wavelengths: a = fx x + fz z normal to the crests, b = gx x + gz z along them.
struct RippleFrame {
    double fx, fz, gx, gz;
};

struct RippleDirection {
    double x, y, z; // unit vector in the surface; 0: no wind
};

MARRAM_INLINE RippleDirection ripple_crest_normal(double wx, double wz, double hx, double hz,
                                                  double tan_repose) {
    constexpr double upright = 1e6; // steeper gradients give the same result; keeps squares finite
    hx = std::clamp(hx, -upright, upright), hz = std::clamp(hz, -upright, upright);
    const double wy = wx * hx + wz * hz, length2 = wx * wx + wy * wy + wz * wz;
    if (!(length2 > 0.0 && length2 < infinity)) return {0.0, 0.0, 0.0};
    const double scale = 1.0 / std::sqrt(length2), ux = wx * scale, uy = wy * scale, uz = wz * scale;
    // f tan(slope) = -(hx, hx^2 + hz^2, hz) / sqrt(1 + hx^2 + hz^2)
    const double g2 = hx * hx + hz * hz, fall = -1.0 / (std::sqrt(1.0 + g2) * tan_repose);
    const double fx = fall * hx, fy = fall * g2, fz = fall * hz, along = fx * ux + fy * uy + fz * uz;
    double sx = fx - along * ux, sy = fy - along * uy, sz = fz - along * uz;
    const double s2 = sx * sx + sy * sy + sz * sz;
    const double limit = s2 > 1.0 ? 1.0 / std::sqrt(s2) : 1.0, stay = std::sqrt(std::max(1.0 - s2, 0.0));
    return {stay * ux + limit * sx, stay * uy + limit * sy, stay * uz + limit * sz};
}

// The axes d and, perpendicular to it in the surface, c = n x d, as linear functions of x and z:
// d . (1, hx, 0) and so on.
MARRAM_INLINE RippleFrame ripple_frame(const RippleDirection& d, double hx, double hz) {
    const double up = 1.0 / std::sqrt(1.0 + hx * hx + hz * hz);
    const double nx = -hx * up, ny = up, nz = -hz * up;
    const double cx = ny * d.z - nz * d.y, cy = nz * d.x - nx * d.z, cz = nx * d.y - ny * d.x;
    return {d.x + d.y * hx, d.z + d.y * hz, cx + cy * hx, cz + cy * hz};
}

// The factor of ripples_on_slope(): 1 up to 26 degrees, 0 from 30 on.
MARRAM_INLINE double ripple_slope_factor(double hx, double hz) {
    constexpr double steep = 0.86602540378443864676,
                     gentle = 0.89879404629916699278; // cosines of 30 and 26 degrees
    const double up = 1.0 / std::sqrt(1.0 + hx * hx + hz * hz);
    const double t = std::clamp((up - steep) / (gentle - steep), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// sin and cos of 2 pi t, |t| < 2^20: reduced to +- a quarter turn; error < 1e-6.
MARRAM_INLINE void ripple_sincos(VFloat t, VFloat& sine, VFloat& cosine) {
    constexpr float magic = 12582912.0F; // 1.5 * 2^23: adding it rounds to the nearest integer
    const VFloat halves = 2.0F * t + magic;
    const VInt odd = bits_as<VInt>(halves) & 1;
    const VFloat x = (t - 0.5F * (halves - magic)) * 6.28318530718F, z = x * x;
    const VFloat s =
        x + x * z *
                (-1.6666667e-1F +
                 z * (8.3333333e-3F + z * (-1.9841270e-4F + z * 2.7557319e-6F - z * z * 2.5052108e-8F)));
    const VFloat c =
        1.0F +
        z * (-0.5F + z * (4.1666667e-2F + z * (-1.3888889e-3F + z * (2.4801587e-5F - z * 2.7557319e-7F))));
    const VInt flip = odd << 31;
    sine = bits_as<VFloat>(bits_as<VInt>(s) ^ flip);
    cosine = bits_as<VFloat>(bits_as<VInt>(c) ^ flip);
}

// The cell of a point, and its position within the cell, in cells.
struct RipplePlace {
    uint32_t column, row;
    double x, z;
};

MARRAM_INLINE RipplePlace ripple_place(double x, double z) {
    constexpr double most = 0x1p50; // cells; doubles beyond it have no useful fraction
    const double cx = std::clamp(x, -most, most), cz = std::clamp(z, -most, most);
    const double fx = std::floor(cx), fz = std::floor(cz);
    return {uint32_t(int64_t(fx)), uint32_t(int64_t(fz)), cx - fx, cz - fz};
}

// 2D gradient noise, gradients uniform in a square. |value| <= 1, about 0.2 on average. Fade: K. Perlin,
// "Improving Noise", 2002.
MARRAM_INLINE double ripple_noise(const RipplePlace& p, uint32_t seed) {
    double corner[4];
    for (uint32_t k = 0; k < 4; ++k) {
        const uint32_t column = p.column + (k & 1U), row = p.row + (k >> 1);
        const uint32_t h = mix32(column * 0x9e3779b1U ^ mix32(row + seed));
        corner[k] = (double(h & 0xffffU) * 0x1p-15 - 1.0) * (p.x - (k & 1U)) +
                    (double(h >> 16) * 0x1p-15 - 1.0) * (p.z - (k >> 1));
    }
    const double u = p.x * p.x * p.x * (p.x * (6.0 * p.x - 15.0) + 10.0),
                 v = p.z * p.z * p.z * (p.z * (6.0 * p.z - 15.0) + 10.0);
    const double near = corner[0] + u * (corner[1] - corner[0]),
                 far = corner[2] + u * (corner[3] - corner[2]);
    return near + v * (far - near);
}

// The frame rotated by a small angle in the surface, which makes crests wander.
MARRAM_INLINE RippleFrame ripple_turned(const RippleFrame& f, double angle) {
    const double c = 1.0 - 0.5 * angle * angle, s = angle; // length 1 within 1e-4
    return {c * f.fx + s * f.gx, c * f.fz + s * f.gz, c * f.gx - s * f.fx, c * f.gz - s * f.fz};
}

// Sums over packets: G, and for its gradient the sums of a and of b times (1 - q)^2 exp(2 pi i (a + p_k)).
struct RippleSums {
    VFloat real{}, imaginary{};
    VFloat a_real{}, a_imaginary{}, b_real{}, b_imaginary{};
};

// Adds the packets of eight cells of one row. dx, dz: offset from the first cell's corner, in cells.
template <bool with_slope>
MARRAM_INLINE void ripple_packets(const RippleFrame& frame, uint32_t column, uint32_t row_hash, float dx,
                                  float dz, RippleSums& sums) {
    constexpr VUint lane = {0, 1, 2, 3, 4, 5, 6, 7};
    constexpr VFloat lane_float = {0, 1, 2, 3, 4, 5, 6, 7};
    const VUint h = mix32((lane + column) * 0x9e3779b1U ^ row_hash), g = mix32(h + 0x85ebca6bU);
    constexpr float unit16 = 0x1p-16F, unit24 = 0x1p-24F, side = float(ripple_cell);
    const VFloat jx = __builtin_convertvector(bits_as<VInt>(h & 0xffffU), VFloat) * unit16;
    const VFloat jz = __builtin_convertvector(bits_as<VInt>(h >> 16), VFloat) * unit16;
    const VFloat phase = __builtin_convertvector(bits_as<VInt>(g >> 8), VFloat) * unit24;
    const VFloat x = (dx - lane_float - jx) * side, z = (dz - jz) * side; // from the packet, wavelengths
    const VFloat a = x * float(frame.fx) + z * float(frame.fz), b = x * float(frame.gx) + z * float(frame.gz);
    constexpr float across = float(1.0 / (ripple_across * ripple_across)),
                    along = float(1.0 / (ripple_along * ripple_along));
    const VFloat left = 1.0F - (a * a * across + b * b * along);
    const VFloat inside = left > 0.0F ? left : VFloat{};
    const VFloat weight = inside * inside * inside;
    VFloat sine, cosine;
    ripple_sincos(a + phase, sine, cosine);
    sums.real += weight * cosine;
    sums.imaginary += weight * sine;
    if constexpr (with_slope) {
        const VFloat wa = inside * inside * a, wb = inside * inside * b;
        sums.a_real += wa * cosine;
        sums.a_imaginary += wa * sine;
        sums.b_real += wb * cosine;
        sums.b_imaginary += wb * sine;
    }
}

MARRAM_INLINE VFloat ripple_clamp(VFloat x, VFloat low, VFloat high) {
    const VFloat above = x > low ? x : low;
    return above < high ? above : high;
}

// max(A - det z^2, 0).
MARRAM_INLINE VFloat ripple_rest(float A, float det, VFloat z) {
    const VFloat rest = A - z * z * det;
    return rest > 0.0F ? rest : VFloat{};
}

MARRAM_INLINE double ripple_sum(VFloat x) {
    float sum = 0.0F;
    for (int k = 0; k < lanes; ++k) sum += x[k];
    return double(sum);
}

// The sum G of all packets around a point and, if computed, its gradient per wavelength.
struct RipplePhasor {
    double real, imaginary;
    double real_x, imaginary_x, real_z, imaginary_z;
};

template <bool with_slope>
MARRAM_INLINE RipplePhasor ripple_phasor(const RipplePlace& place, const RippleFrame& frame, uint32_t seed) {
    // q = A x^2 + 2 B x z + C z^2 in cells. The ellipse q = 1 bounds the columns of each row.
    constexpr double wa = ripple_cell * ripple_cell / (ripple_across * ripple_across),
                     wb = ripple_cell * ripple_cell / (ripple_along * ripple_along);
    const double A = wa * frame.fx * frame.fx + wb * frame.gx * frame.gx,
                 B = wa * frame.fx * frame.fz + wb * frame.gx * frame.gz,
                 C = wa * frame.fz * frame.fz + wb * frame.gz * frame.gz, det = A * C - B * B;
    const double by_A = 1.0 / A, z_most = std::sqrt(A / det), z_of_x_most = -B / (C * std::sqrt(det / C));
    RippleSums sums;
    const int first = int(std::floor(place.z - z_most)), last = int(std::floor(place.z + z_most));
    for (int j0 = first; j0 <= last; j0 += lanes) {
        // The columns of eight rows at once. For packets of row j, the point minus the packet is in
        // z - j - 1 ... z - j.
        constexpr VFloat lane_float = {0, 1, 2, 3, 4, 5, 6, 7};
        const VFloat top = float(place.z - j0) - lane_float, bottom = top - 1.0F;
        const VFloat most = splat_float(float(z_most)), high = top < most ? top : most,
                     low = bottom > -most ? bottom : -most;
        const VFloat x_most = splat_float(float(z_of_x_most)), zr = ripple_clamp(x_most, low, high),
                     zl = ripple_clamp(-x_most, low, high);
        const VFloat right = (vsqrt(ripple_rest(float(A), float(det), zr)) - zr * float(B)) * float(by_A),
                     left = (vsqrt(ripple_rest(float(A), float(det), zl)) + zl * float(B)) * float(by_A);
        constexpr float margin = 1e-3F; // cells; above the float rounding error of about ten cells
        const VFloat from_x = float(place.x) - right - margin + 1024.0F,
                     to_x = float(place.x) + left + margin + 1024.0F;
        const VInt from = __builtin_convertvector(from_x, VInt) - 1024,
                   to = __builtin_convertvector(to_x, VInt) - 1024;
        const int rows = std::min(last - j0 + 1, lanes);
        for (int k = 0; k < rows; ++k) {
            const uint32_t row_hash = mix32(place.row + uint32_t(j0 + k) + seed);
            for (int i = from[k]; i <= to[k]; i += lanes)
                ripple_packets<with_slope>(frame, place.column + uint32_t(i), row_hash, float(place.x - i),
                                           float(place.z - (j0 + k)), sums);
        }
    }
    RipplePhasor g{ripple_sum(sums.real), ripple_sum(sums.imaginary), 0.0, 0.0, 0.0, 0.0};
    if constexpr (with_slope) {
        const double ar = ripple_sum(sums.a_real), ai = ripple_sum(sums.a_imaginary),
                     br = ripple_sum(sums.b_real), bi = ripple_sum(sums.b_imaginary);
        constexpr double a6 = 6.0 / (ripple_across * ripple_across), b6 = 6.0 / (ripple_along * ripple_along);
        const double wx = 2.0 * pi * frame.fx, wz = 2.0 * pi * frame.fz;
        g.real_x = -a6 * frame.fx * ar - b6 * frame.gx * br - wx * g.imaginary;
        g.imaginary_x = -a6 * frame.fx * ai - b6 * frame.gx * bi + wx * g.real;
        g.real_z = -a6 * frame.fz * ar - b6 * frame.gz * br - wz * g.imaginary;
        g.imaginary_z = -a6 * frame.fz * ai - b6 * frame.gz * bi + wz * g.real;
    }
    return g;
}

struct RippleProfile {
    double height = 0.0;     // -1 to 1, times the amplitude's factor |G| / sqrt(|G|^2 + (g / 3)^2)
    double x = 0.0, z = 0.0; // its slope per wavelength
};

template <bool with_slope>
MARRAM_INLINE RippleProfile ripple_profile(const RipplePhasor& g) {
    // Mean of |G|^2: the integral of (1 - q)^6 over the ellipse, pi R_a R_b / 7, per area of a cell.
    constexpr double mean2 = pi * ripple_across * ripple_along / (7.0 * ripple_cell * ripple_cell);
    const double size2 = g.real * g.real + g.imaginary * g.imaginary;
    constexpr double none = 1e-12 * mean2; // below the precision of the float sums
    if (!(size2 > none)) return {};
    const double scale = 1.0 / std::sqrt(size2), c = g.real * scale, s = g.imaginary * scale;
    // sin and cos of s / 2, |s / 2| <= 1/2: Taylor series, error < 2e-7
    const double t = 0.5 * s, t2 = t * t;
    const double sine = t * (1.0 - t2 * (1.0 / 6.0 - t2 * (1.0 / 120.0 - t2 / 5040.0)));
    const double cosine = 1.0 - t2 * (0.5 - t2 * (1.0 / 24.0 - t2 * (1.0 / 720.0 - t2 / 40320.0)));
    const double f = -(s * cosine + c * sine), whole2 = size2 + mean2 / 9.0;
    RippleProfile profile;
    profile.height = f * std::sqrt(size2 / whole2);
    if constexpr (with_slope) {
        const double by_phase = -(c * cosine - s * sine) * (1.0 + 0.5 * c);
        const double share = std::sqrt(size2 / whole2),
                     share_by_size = mean2 / 9.0 / (whole2 * std::sqrt(whole2));
        const auto slope = [&](double real, double imaginary) MARRAM_ALWAYS_INLINE {
            const double turn = (c * imaginary - s * real) * scale, grow = c * real + s * imaginary;
            return by_phase * share * turn + f * share_by_size * grow;
        };
        profile.x = slope(g.real_x, g.imaginary_x);
        profile.z = slope(g.real_z, g.imaginary_z);
    }
    return profile;
}

struct RippleJob {
    const RipplePoint* points;
    double* metres;
    Vec2d* slopes;
    size_t count;
    double to_cells, half_height, tan_repose;
    uint32_t seed;
};

template <bool with_slope>
MARRAM_INLINE void evaluate_ripples(const RippleJob& job) {
    for (size_t k = 0; k < job.count; ++k) {
        const RipplePoint& p = job.points[k];
        const double hx = p.gradient[0], hz = p.gradient[1];
        const double height = job.half_height * p.strength * ripple_slope_factor(hx, hz);
        job.metres[k] = 0.0;
        if constexpr (with_slope) job.slopes[k] = Vec2d::Zero();
        if (!(height > 0.0)) continue;
        const RippleDirection way = ripple_crest_normal(p.wind[0], p.wind[1], hx, hz, job.tan_repose);
        if (way.x == 0.0 && way.y == 0.0 && way.z == 0.0) continue;
        const double x = p.at[0] * job.to_cells, z = p.at[1] * job.to_cells;
        const double turn =
            ripple_wander *
            ripple_noise(ripple_place(x * ripple_wander_frequency, z * ripple_wander_frequency), ~job.seed);
        const RippleProfile profile = ripple_profile<with_slope>(ripple_phasor<with_slope>(
            ripple_place(x, z), ripple_turned(ripple_frame(way, hx, hz), turn), job.seed));
        job.metres[k] = height * profile.height;
        if constexpr (with_slope) {
            const double by_metre = height * ripple_cell * job.to_cells;
            job.slopes[k] = {by_metre * profile.x, by_metre * profile.z};
        }
    }
}

MARRAM_HOT void ripple_heights(const RippleJob& job) { evaluate_ripples<false>(job); }
MARRAM_HOT void ripple_slopes(const RippleJob& job) { evaluate_ripples<true>(job); }

} // namespace

Vec2d ripple_direction(const Vec2d& wind, const Vec2d& gradient, double repose) {
    const RippleDirection d =
        ripple_crest_normal(wind.x(), wind.y(), gradient.x(), gradient.y(), std::tan(repose));
    return {d.x, d.z};
}

double ripples_on_slope(const Vec2d& gradient) { return ripple_slope_factor(gradient.x(), gradient.y()); }

RippleField::RippleField(const RippleSettings& settings)
    : settings_(settings), tan_repose_(std::tan(settings.repose)),
      seed_(uint32_t(hash(settings.seed, 0x726970706c6573))) {}

void RippleField::displacements(std::span<const RipplePoint> points, std::span<double> metres) const {
    ripple_heights({points.data(), metres.data(), nullptr, std::min(points.size(), metres.size()),
                    1.0 / (ripple_cell * settings_.wavelength), 0.5 * settings_.height, tan_repose_, seed_});
}

void RippleField::displacements(std::span<const RipplePoint> points, std::span<double> metres,
                                std::span<Vec2d> slopes) const {
    ripple_slopes({points.data(), metres.data(), slopes.data(),
                   std::min({points.size(), metres.size(), slopes.size()}),
                   1.0 / (ripple_cell * settings_.wavelength), 0.5 * settings_.height, tan_repose_, seed_});
}

double RippleField::displacement(const RipplePoint& point) const {
    double metres;
    displacements({&point, 1}, {&metres, 1});
    return metres;
}

Vec2d RippleField::wave(const RipplePoint& p) const {
    const RippleDirection way =
        ripple_crest_normal(p.wind[0], p.wind[1], p.gradient[0], p.gradient[1], tan_repose_);
    const RippleFrame frame = ripple_frame(way, p.gradient[0], p.gradient[1]);
    return 2.0 * pi / settings_.wavelength * Vec2d(frame.fx, frame.fz);
}

double RippleField::slope_variance(const RipplePoint& p) const {
    constexpr double profile = 0.536, share = 0.785;
    const double height =
        0.5 * settings_.height * p.strength * ripple_slope_factor(p.gradient[0], p.gradient[1]);
    return profile * share * height * height * wave(p).squaredNorm();
}

} // namespace marram
