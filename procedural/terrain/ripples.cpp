// SPDX-License-Identifier: Apache-2.0
// ripples: wind ripples, crest by crest, where the grid is fine enough to hold them.
//
//     [[procedural.layer]]
//     type = "ripples"
//     wavelength = 0.11
//     height = 0.008
//
// Direction. On level sand crests stand across the wind. On an incline the grains that creep, which build
// ripples, are pulled downhill (A. Howard, "Effect of slope on the threshold of motion and its application
// to orientation of wind ripples", GSA Bulletin 88, 1977). At the threshold of motion the wind's drag and
// the part of a grain's weight along the surface, W sin(slope), add up to friction, W cos(slope)
// tan(repose), in the direction in which the grain goes. Across the wind only the weight counts, so that
//
//   sin(delta) = tan(slope) sin(beta) / tan(repose)
//
// beta: between the wind and the line of fall; delta: how far the grain's way, and with it what is at right
// angles to the crests, is turned from the wind towards the line of fall downhill. It is so for wind that
// blows up as for wind that blows down the slope. All angles are measured in the surface, and so is the
// wavelength. The wind follows the surface without being turned sideways. With unit vectors in the surface,
// w along the wind and f down the line of fall, the direction is
//
//   s = tan(slope) / tan(repose) (f - (f . w) w),  |s| = sin(delta),  d = sqrt(1 - s^2) w + s
//
// which needs no angle and is smooth on level ground. |s| is limited to 1, beyond repose, where there are
// no ripples.
//
// Phase. It must advance by one turn a wavelength along d whatever d does, which no function of position
// times d can do, and no noise that is added to one: it stretches. After Tricard et al., "Procedural Phasor
// Noise" (ACM Transactions on Graphics 38, 2019) the phase is that of a sum of wave packets with random
// places x_k and phases p_k:
//
//   G = sum (1 - q)^3 exp(2 pi i (a + p_k)), q = (a / 3.2)^2 + (b / 6.5)^2 < 1
//   a = d . (x - x_k) / wavelength, b the same along the crest, both in the surface
//
// one packet in each cell of a grid, anywhere in it. The zeros of G are points around which the phase makes
// a turn: there a crest ends or forks, a Y junction, as ripples have them, and nothing is stretched
// anywhere. The packets' size sets how often: the spectrum of (1 - q)^3 is about that of a Gaussian with
// s^2 = R^2 / 6, and a Gaussian field with such a spectrum has 1 / (4 pi s_a s_b) zeros to a wavelength
// squared (after S. Rice, "Mathematical Analysis of Random Noise", 1945, in two dimensions): one in 44.
// Longer packets have straighter crests. For crests to wander d is turned by noise, 9 degrees at most, 1.3
// on the average, over 8 wavelengths; with it one end of a crest in some 30 is counted. d is taken at x for all packets. The error of the phase's gradient is the
// mean of (x - x_k) times the change of d, and that mean is near 0: d must vary little over a packet's
// three wavelengths, or crests are bent at each zero.
//
// Profile: f = sin(phi + sin(phi) / 2) of shaders/sand.h, run backwards, so that the steep side is the lee
// and displacement near by has the shape of the shading far off. (Single crests of the shading stand
// elsewhere: its phase is another.) Its mean is 0. With unit phasor (c, s): sin(phi
// + s / 2) = s cos(s / 2) + c sin(s / 2), no angle is taken. The height is height / 2 |G| / sqrt(|G|^2 + (g
// / 3)^2), g^2 the mean of |G|^2: 0.87 of it on the average, and 0 at the zeros of G, so that the surface
// has no step there.
//
// Where. Full height up to 26 degrees, none from 30 degrees on (cosines, smooth step). In the lee none: the
// sand upwind seen under more than 15 degrees above the horizon (the shadow of Werner, "Eolian dunes:
// computer simulations and attractor interpretation", 1995) shelters wholly, below 10 degrees, five to six
// heights behind a crest, not at all. It is looked for at a distance of one wavelength, and each time an
// eighth further, up to shelter_reach; a sharp crest between two such places is seen up to 1.2 degrees too
// low. Where the sand is thinner than half the height, the trough, ripples are no higher than the sand is
// deep, so that it never goes below 0.
//
// The layer. The gradient is that of a uniform cubic B-spline whose knots are one wavelength apart, its
// points means of what is below over that length: ripples and grains of the ground do not turn ripples. At
// the terrain's edge the points go on linearly. On a slope the displacement along the normal d is d /
// cos(slope) upwards. What is added has the mean 0 but for its sampling: the volume of sand is kept to some
// thousandths of what the ripples move, not to the last unit. A cell above a sixth of the wavelength cannot
// hold the steep side: the layer then does nothing and says so; the material's shading has ripples in its
// place.
//
// Cost: about 10 to 14 vectors of 8 packets a point, and 50 places for the shelter.
#include "procedural/terrain/ripples.h"

#include "procedural/terrain/lattice.h"
#include "procedural/terrain/shape_layer.h"

#include "core/math/hash.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr double ripple_across = 3.2, ripple_along = 6.5; // half axes of a packet, wavelengths
constexpr double ripple_cell = 1.25;                      // side of a packet's cell, wavelengths
constexpr double ripple_wander = 9.0 * degree,
                 ripple_wide = ripple_cell / 8.0; // turns at most, and over 8 wavelengths

// In wavelengths along the surface: a = fx x + fz z across the crests, b = gx x + gz z along them.
struct RippleFrame {
    double fx, fz, gx, gz;
};

struct RippleDirection {
    double x, y, z; // unit vector in the surface; 0: no wind
};

MARRAM_INLINE RippleDirection ripple_way(double wx, double wz, double hx, double hz, double tan_repose) {
    constexpr double upright = 1e6; // nothing steeper differs, and squares stay finite
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

// d and, at right angles to it in the surface, c = n x d, as functions of x and z: d . (1, hx, 0) and so
// on.
MARRAM_INLINE RippleFrame ripple_frame(const RippleDirection& d, double hx, double hz) {
    const double up = 1.0 / std::sqrt(1.0 + hx * hx + hz * hz);
    const double nx = -hx * up, ny = up, nz = -hz * up;
    const double cx = ny * d.z - nz * d.y, cy = nz * d.x - nx * d.z, cz = nx * d.y - ny * d.x;
    return {d.x + d.y * hx, d.z + d.y * hz, cx + cy * hx, cz + cy * hz};
}

// 1 up to 26 degrees, 0 from 30 on.
MARRAM_INLINE double ripple_hold(double hx, double hz) {
    constexpr double steep = 0.86602540378443864676,
                     gentle = 0.89879404629916699278; // cosines of 30 and 26 degrees
    const double up = 1.0 / std::sqrt(1.0 + hx * hx + hz * hz);
    const double t = std::clamp((up - steep) / (gentle - steep), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// sin and cos of 2 pi t, |t| < 2^20: reduced to a quarter turn on either side of 0; error < 1e-6.
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

// Where a point lies in the grid of cells: its cell, and the place in it, both in cells.
struct RipplePlace {
    uint32_t column, row;
    double x, z;
};

MARRAM_INLINE RipplePlace ripple_place(double x, double z) {
    constexpr double most = 0x1p50; // cells: beyond it there are no places within one
    const double cx = std::clamp(x, -most, most), cz = std::clamp(z, -most, most);
    const double fx = std::floor(cx), fz = std::floor(cz);
    return {uint32_t(int64_t(fx)), uint32_t(int64_t(fz)), cx - fx, cz - fz};
}

// Gradient noise in the plane with gradients anywhere in a square; |value| <= 1, about 0.2 on the average.
// (K. Perlin, "Improving Noise", 2002: its fade.)
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

// Crests wander: the frame turned by a small angle, in the surface.
MARRAM_INLINE RippleFrame ripple_turned(const RippleFrame& f, double angle) {
    const double c = 1.0 - 0.5 * angle * angle, s = angle; // a unit vector but for 1e-4
    return {c * f.fx + s * f.gx, c * f.fz + s * f.gz, c * f.gx - s * f.fx, c * f.gz - s * f.fz};
}

// Adds the packets of eight cells of one row. dx, dz: of the point from the first cell's corner, in cells.
MARRAM_INLINE void ripple_packets(const RippleFrame& frame, uint32_t column, uint32_t row_hash, float dx,
                                  float dz, VFloat& real, VFloat& imaginary) {
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
    real += weight * cosine;
    imaginary += weight * sine;
}

MARRAM_INLINE VFloat ripple_clamp(VFloat x, VFloat low, VFloat high) {
    const VFloat above = x > low ? x : low;
    return above < high ? above : high;
}

// A - det z^2, not below 0.
MARRAM_INLINE VFloat ripple_rest(float A, float det, VFloat z) {
    const VFloat rest = A - z * z * det;
    return rest > 0.0F ? rest : VFloat{};
}

// The sum G of all packets around a point.
MARRAM_INLINE void ripple_phasor(const RipplePlace& place, const RippleFrame& frame, uint32_t seed,
                                 double& real, double& imaginary) {
    // q = A x^2 + 2 B x z + C z^2 in cells; its ellipse q = 1 bounds the columns of each row.
    constexpr double wa = ripple_cell * ripple_cell / (ripple_across * ripple_across),
                     wb = ripple_cell * ripple_cell / (ripple_along * ripple_along);
    const double A = wa * frame.fx * frame.fx + wb * frame.gx * frame.gx,
                 B = wa * frame.fx * frame.fz + wb * frame.gx * frame.gz,
                 C = wa * frame.fz * frame.fz + wb * frame.gz * frame.gz, det = A * C - B * B;
    const double by_A = 1.0 / A, z_most = std::sqrt(A / det), z_of_x_most = -B / (C * std::sqrt(det / C));
    VFloat re{}, im{};
    const int first = int(std::floor(place.z - z_most)), last = int(std::floor(place.z + z_most));
    for (int j0 = first; j0 <= last; j0 += lanes) {
        // The columns of eight rows at once. Packets of row j are at z - j - 1 ... z - j from the point:
        // the point less the packet.
        constexpr VFloat lane_float = {0, 1, 2, 3, 4, 5, 6, 7};
        const VFloat top = float(place.z - j0) - lane_float, bottom = top - 1.0F;
        const VFloat most = splat_float(float(z_most)), high = top < most ? top : most,
                     low = bottom > -most ? bottom : -most;
        const VFloat x_most = splat_float(float(z_of_x_most)), zr = ripple_clamp(x_most, low, high),
                     zl = ripple_clamp(-x_most, low, high);
        const VFloat right = (vsqrt(ripple_rest(float(A), float(det), zr)) - zr * float(B)) * float(by_A),
                     left = (vsqrt(ripple_rest(float(A), float(det), zl)) + zl * float(B)) * float(by_A);
        constexpr float margin = 1e-3F; // cells: above the rounding of some ten cells in floats
        const VFloat from_x = float(place.x) - right - margin + 1024.0F,
                     to_x = float(place.x) + left + margin + 1024.0F;
        const VInt from = __builtin_convertvector(from_x, VInt) - 1024,
                   to = __builtin_convertvector(to_x, VInt) - 1024;
        const int rows = std::min(last - j0 + 1, lanes);
        for (int k = 0; k < rows; ++k) {
            const uint32_t row_hash = mix32(place.row + uint32_t(j0 + k) + seed);
            for (int i = from[k]; i <= to[k]; i += lanes)
                ripple_packets(frame, place.column + uint32_t(i), row_hash, float(place.x - i),
                               float(place.z - (j0 + k)), re, im);
        }
    }
    float sums[2] = {0.0F, 0.0F};
    for (int k = 0; k < lanes; ++k) sums[0] += re[k], sums[1] += im[k];
    real = double(sums[0]), imaginary = double(sums[1]);
}

// The profile, -1 to 1, times the share of its height that the sum's size allows.
MARRAM_INLINE double ripple_profile(double real, double imaginary) {
    // Mean of |G|^2: the integral of (1 - q)^6 over the ellipse, pi R_a R_b / 7, over the area of a cell.
    constexpr double mean2 = pi * ripple_across * ripple_along / (7.0 * ripple_cell * ripple_cell);
    const double size2 = real * real + imaginary * imaginary;
    constexpr double none = 1e-12 * mean2; // floats sum to no better
    if (!(size2 > none)) return 0.0;
    const double scale = 1.0 / std::sqrt(size2), c = real * scale, s = imaginary * scale;
    // sin and cos of s / 2, |s / 2| <= 1/2: Taylor, error < 2e-7
    const double t = 0.5 * s, t2 = t * t;
    const double sine = t * (1.0 - t2 * (1.0 / 6.0 - t2 * (1.0 / 120.0 - t2 / 5040.0)));
    const double cosine = 1.0 - t2 * (0.5 - t2 * (1.0 / 24.0 - t2 * (1.0 / 720.0 - t2 / 40320.0)));
    return -(s * cosine + c * sine) * std::sqrt(size2 / (size2 + mean2 / 9.0));
}

struct RippleJob {
    const RipplePoint* points;
    double* metres;
    size_t count;
    double to_cells, half_height, tan_repose;
    uint32_t seed;
};

MARRAM_HOT void ripple_points(const RippleJob& job) {
    for (size_t k = 0; k < job.count; ++k) {
        const RipplePoint& p = job.points[k];
        const double hx = p.gradient[0], hz = p.gradient[1];
        const double height = job.half_height * p.strength * ripple_hold(hx, hz);
        job.metres[k] = 0.0;
        if (!(height > 0.0)) continue;
        const RippleDirection way = ripple_way(p.wind[0], p.wind[1], hx, hz, job.tan_repose);
        if (way.x == 0.0 && way.y == 0.0 && way.z == 0.0) continue;
        double real, imaginary;
        const double x = p.at[0] * job.to_cells, z = p.at[1] * job.to_cells;
        const double turn =
            ripple_wander * ripple_noise(ripple_place(x * ripple_wide, z * ripple_wide), ~job.seed);
        ripple_phasor(ripple_place(x, z), ripple_turned(ripple_frame(way, hx, hz), turn), job.seed, real,
                      imaginary);
        job.metres[k] = height * ripple_profile(real, imaginary);
    }
}

} // namespace

Vec2d ripple_direction(const Vec2d& wind, const Vec2d& gradient, double repose) {
    const RippleDirection d = ripple_way(wind.x(), wind.y(), gradient.x(), gradient.y(), std::tan(repose));
    return {d.x, d.z};
}

double ripples_on_slope(const Vec2d& gradient) { return ripple_hold(gradient.x(), gradient.y()); }

RippleField::RippleField(const RippleSettings& settings)
    : settings_(settings), seed_(uint32_t(hash(settings.seed, 0x726970706c6573))) {}

void RippleField::displacements(std::span<const RipplePoint> points, std::span<double> metres) const {
    ripple_points({points.data(), metres.data(), std::min(points.size(), metres.size()),
                   1.0 / (ripple_cell * settings_.wavelength), 0.5 * settings_.height,
                   std::tan(settings_.repose), seed_});
}

double RippleField::displacement(const RipplePoint& point) const {
    double metres;
    displacements({&point, 1}, {&metres, 1});
    return metres;
}

// ---- The layer ----------------------------------------------------------------------------------------------------------

namespace {

// One axis of the spline: knots beyond the last continue those within on a straight line.
struct RippleKnot {
    int at, from;
    double share, share_from;

    RippleKnot(int knot, int last) : at(knot), from(knot), share(1.0), share_from(0.0) {
        if (knot >= 0 && knot <= last) return;
        at = knot < 0 ? 0 : last;
        from = std::clamp(knot < 0 ? -knot : 2 * last - knot, 0, last);
        share = 2.0, share_from = -1.0;
    }
};

// Mean height of samples around a knot, nine by nine at most; at the border as many on either side, so that
// a plane stays one.
double ripple_mean(const Fields& below, const Domain& domain, int knot, int a, int b) {
    const int i = a * knot, j = b * knot, half = knot / 2, step = std::max(half / 4, 1);
    const int wide = std::min({half, i, domain.nx - 1 - i}) / step,
              deep = std::min({half, j, domain.nz - 1 - j}) / step;
    double sum = 0.0;
    for (int z = -deep; z <= deep; ++z)
        for (int x = -wide; x <= wide; ++x) sum += below.height(domain.index(i + x * step, j + z * step));
    return sum / ((2.0 * wide + 1.0) * (2.0 * deep + 1.0));
}

} // namespace

// The smooth surface over a rectangle.
struct RipplesLayer::Surface {
    int knot, a0, b0, columns, rows;
    double by_metre;
    std::vector<double> heights;

    Surface(const Rect& rect, const Fields& below, const Domain& domain, int samples)
        : knot(samples), a0(rect.i0 / knot - 1), b0(rect.j0 / knot - 1),
          columns((rect.i1 - 1) / knot + 3 - a0), rows((rect.j1 - 1) / knot + 3 - b0),
          by_metre(1.0 / (knot * domain.cell)) {
        const int last_a = (domain.nx - 1) / knot, last_b = (domain.nz - 1) / knot;
        heights.reserve(size_t(columns) * size_t(rows));
        for (int b = b0; b < b0 + rows; ++b)
            for (int a = a0; a < a0 + columns; ++a) {
                const RippleKnot x(a, last_a), z(b, last_b);
                double height = 0.0;
                for (const auto& [at, share] : {std::pair(z.at, z.share), std::pair(z.from, z.share_from)}) {
                    if (share == 0.0) continue;
                    double row = x.share * ripple_mean(below, domain, knot, x.at, at);
                    if (x.share_from != 0.0)
                        row += x.share_from * ripple_mean(below, domain, knot, x.from, at);
                    height += share * row;
                }
                heights.push_back(height);
            }
    }

    Vec2d gradient(int i, int j) const {
        double bu[4], su[4], bv[4], sv[4];
        cubic_bspline(double(i % knot) / knot, bu, su);
        cubic_bspline(double(j % knot) / knot, bv, sv);
        const double* first =
            heights.data() + size_t(j / knot - 1 - b0) * size_t(columns) + size_t(i / knot - 1 - a0);
        Vec2d sum = Vec2d::Zero();
        for (int l = 0; l < 4; ++l, first += columns) {
            double row = 0.0, slope = 0.0;
            for (int k = 0; k < 4; ++k) row += bu[k] * first[k], slope += su[k] * first[k];
            sum += Vec2d(bv[l] * slope, sv[l] * row);
        }
        return sum * by_metre;
    }
};

RipplesLayer::RipplesLayer(const Settings& settings, const Domain& domain)
    : settings_(settings), domain_(domain), field_(settings.ripples),
      knot_(int(std::clamp(std::round(settings.ripples.wavelength / domain.cell), 1.0, 0x1p24))) {}

bool RipplesLayer::resolved(const RippleSettings& ripples, const Domain& domain) {
    return domain.cell <= ripples.wavelength / 6.0;
}

double RipplesLayer::reach() const {
    if (!resolved(settings_.ripples, domain_)) return 0.0;
    // At the border a knot stands for others up to three knots away along each axis, half a knot of samples
    // around them.
    return std::max(5.0 * knot_ * domain_.cell, settings_.shelter_reach + 2.0 * domain_.cell);
}

// 1: free; 0: in the lee.
double RipplesLayer::shelter(const Fields& below, int i, int j) const {
    constexpr double low = 0.17632698070846498, high = 0.26794919243112270; // tangents of 10 and 15 degrees
    const double own = below.height(domain_.index(i, j));
    const double length = settings_.wind.norm();
    if (!(length > 0.0)) return 1.0;
    const Vec2d back = settings_.wind / (-length * domain_.cell); // samples a metre
    double steepest = 0.0;
    for (double d = settings_.ripples.wavelength; d <= settings_.shelter_reach && steepest < high;
         d *= 1.125) {
        // Beyond the border the ground goes on as high as it is there.
        const double x = std::clamp(i + d * back.x(), 0.0, domain_.nx - 1.0),
                     z = std::clamp(j + d * back.y(), 0.0, domain_.nz - 1.0);
        const int a = std::min(int(x), std::max(domain_.nx - 2, 0)),
                  b = std::min(int(z), std::max(domain_.nz - 2, 0));
        const size_t at = domain_.index(a, b), right = domain_.nx > 1 ? 1 : 0,
                     down = domain_.nz > 1 ? size_t(domain_.nx) : 0;
        const double near = below.height(at) + (x - a) * (below.height(at + right) - below.height(at));
        const double far =
            below.height(at + down) + (x - a) * (below.height(at + down + right) - below.height(at + down));
        steepest = std::max(steepest, (near + (z - b) * (far - near) - own) / d);
    }
    const double t = std::clamp((high - steepest) / (high - low), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

void RipplesLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    if (rect.empty()) return;
    const bool idle = !resolved(settings_.ripples, domain_) || !(settings_.ripples.height > 0.0);
    for (int j = rect.j0; idle && j < rect.j1; ++j)
        std::copy_n(below.sand + domain_.index(rect.i0, j), rect.i1 - rect.i0,
                    out.sand + domain_.index(rect.i0, j));
    if (idle) return;
    const Surface surface(rect, below, domain_, knot_);
    const float* mask = settings_.mask.empty() ? nullptr : find_mask(below, settings_.mask);
    const double half = 0.5 * settings_.ripples.height;
    std::array<RipplePoint, Tiles::side> points;
    std::array<double, Tiles::side> metres, upright; // upright: metres upwards for one along the normal
    for (int j = rect.j0; j < rect.j1; ++j)
        for (int i0 = rect.i0; i0 < rect.i1; i0 += Tiles::side) {
            const size_t count = size_t(std::min(rect.i1 - i0, Tiles::side)), row = domain_.index(i0, j);
            for (size_t k = 0; k < count; ++k) {
                const int i = i0 + int(k);
                const Vec2d gradient = surface.gradient(i, j);
                upright[k] = std::sqrt(1.0 + gradient.squaredNorm());
                const double depth = sand_metres(below.sand[row + k]) / (half * upright[k]);
                double strength = std::min(depth, 1.0);
                if (mask) strength *= double(mask[row + k]);
                if (strength > 0.0 && ripples_on_slope(gradient) > 0.0) strength *= shelter(below, i, j);
                points[k] = {{domain_.x(i), domain_.z(j)}, settings_.wind, gradient, strength};
            }
            field_.displacements({points.data(), count}, {metres.data(), count});
            for (size_t k = 0; k < count; ++k) {
                const SandUnits sand = below.sand[row + k];
                out.sand[row + k] = metres[k] == 0.0
                                        ? sand
                                        : std::max(sand + sand_units(metres[k] * upright[k]), SandUnits(0));
            }
        }
}

namespace {

constexpr std::array ripple_values = {
    MarramParam{"wavelength", MARRAM_NUMBER, "m", "0.11", 1e-4, 1e6, "",
                "from crest to crest, along the surface"},
    MarramParam{"height", MARRAM_NUMBER, "m", "0.008", 0, 1e5, "", "from trough to crest; 0: none"},
    MarramParam{"repose", MARRAM_NUMBER, "deg", "34", 5, 80, "",
                "angle of repose: how far ripples on a slope turn downhill"},
    MarramParam{"shelter_reach", MARRAM_NUMBER, "m", "30", 0, 1e6, "",
                "distance in which a crest upwind shelters; 0: no lee"},
    MarramParam{"mask", MARRAM_TEXT, "", "none", 0, 0, "", "name of a mask that the height is multiplied by"},
    MarramParam{"seed", MARRAM_INTEGER, "", "0", 0, 2147483647, "", "another draw of the same ripples"},
};

std::unique_ptr<Layer> make_ripples(const LayerContext& context) {
    const LayerValues& values = context.values;
    RipplesLayer::Settings settings;
    settings.ripples.wavelength = values.number("wavelength");
    settings.ripples.height = values.number("height");
    settings.ripples.repose = values.number("repose") * degree;
    settings.ripples.seed = hash(context.seed, uint64_t(values.number("seed")));
    settings.wind = context.wind;
    settings.shelter_reach = values.number("shelter_reach");
    if (values.has("mask")) settings.mask = mask_named(context, "mask");
    if (!RipplesLayer::resolved(settings.ripples, context.domain) && context.warn)
        context.warn(values.place("wavelength"),
                     "the terrain's cell of " + std::to_string(context.domain.cell) +
                         " m cannot hold ripples, which take a sixth of their wavelength: none are made",
                     "take a finer cell, or leave ripples to the material's ripple_height");
    return std::make_unique<RipplesLayer>(settings, context.domain);
}

} // namespace

LayerType ripples_layer_type() {
    return {"ripples", "wind ripples on the sand, crest by crest", ripple_values, make_ripples};
}

} // namespace marram
