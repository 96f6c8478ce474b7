// SPDX-License-Identifier: Apache-2.0
// lattice: free-form deformation of the layers below by a drawn control net.
//
// An artist draws the same net twice as curves: once at rest and once bent. Each curve is a row of nu points,
// and all nv rows have the same number of points. The net at rest is an even grid: seen from above, point
// (i, j) lies at o + i a + j b within a hundredth of a step (this allows for rounding in files; the deviation
// is ignored). The net may be rotated and skewed and may lie at any height. Offset (i, j) is the bent point
// minus the rest point.
//
//     [[procedural.layer]]
//     type = "lattice"
//     rest = "net"                    # [[curves]] of the scene, from an .obj of polylines or inline
//     bent = "net bent"
//
// Model: free-form deformation (Sederberg and Parry, "Free-Form Deformation of Solid Geometric Models",
// 1986) of the ground plane, with uniform cubic B-splines instead of Bernstein polynomials (as Lee,
// Wolberg and Shin, "Scattered Data Interpolation with Multilevel B-Splines", 1997). With (u, v) = [a b]^-1
// ((x, z) - o), i = floor(u), s = u - i and likewise for v:
//
//   d(u, v) = sum B_k(s) B_l(t) offset(i + k - 1, j + l - 1), k and l from 0 to 3
//   B_0 = (1 - s)^3 / 6, B_1 = (3 s^3 - 6 s^2 + 4) / 6, B_2 = (-3 s^3 + 3 s^2 + 3 s + 1) / 6, B_3 = s^3 / 6
//
// Control points beyond the net have zero offset. So d is twice continuously differentiable everywhere and
// exactly 0 from two steps outside the net on. Offsets that are linear in i and j are reproduced exactly
// where all 16 points belong to the net. A single control point moved by 1 moves the ground below it by 4/9:
// the spline approximates its control points and does not interpolate them.
//
// Effect on the terrain. The ground at (x, z) moves to (x + dx, z + dz) and up by dy, all evaluated at
// (x, z). The new height at a sample q is the old height at p plus dy(p), where p + d(p) = q. If the net only
// lifts, p = q: nothing is interpolated, and the result is exact up to float rounding. Where d(q) = 0, the
// bits from below are kept. Elsewhere bedrock and sand are read at p by bicubic interpolation (R. Keys,
// "Cubic Convolution Interpolation for Digital Image Processing", 1981, a = -1/2: third order, once
// differentiable, so stretched terrain shows no facets), with sand clamped to 0 or more. Masks use bilinear
// interpolation, which stays within 0 and 1. If p is beyond the terrain's edge, the edge value is used.
//
// target = "bedrock": the bedrock is deformed and the sand moves with it. "sand": only the sand is deformed;
// its thickness changes by dy and is clamped to 0 or more.
//
// Sand volume: the thickness is preserved, so the volume changes with the area, by the Jacobian. Dividing by
// the Jacobian would preserve the volume, but a dune stretched sideways would become lower: each edit would
// change the drawn heights and slopes. This layer is a modelling tool, not sand transport. Layers that must
// conserve sand belong above it in the list.
//
// Folds: a folded surface is not a height field. The Jacobian J = det(1 + grad d) must be above 1e-3
// everywhere; below that a thousand samples collapse into one. The test runs once, when the layer is made,
// and covers every point of a cell, not only samples: in each cell J is a polynomial of degree 5 in s and t,
// bounded by its Bernstein coefficients; if these do not decide, the cell is halved. A cell that is still
// undecided after seven halvings per axis counts as a fold. The fault names the cell.
//
// Inverse: p is found by Newton's method starting at p = q; each step is halved until |p + d(p) - q|
// decreases. J > 0 everywhere and d = 0 far away make the map bijective (Hadamard), and the squared residual
// has no stationary point except its zero, so this converges from any start. Each sample starts from itself
// and depends neither on its neighbours nor on the tiling of the terrain. Iteration stops at 1e-9 of a
// terrain cell, or at the rounding limit (eight units in the last place of u and v).
//
// Cost: 3 to 5 spline evaluations a sample where the ground shifts sideways, one where it is only lifted.
// Reach: the largest sideways offset, which bounds |d| because B-splines are positive and sum to 1, plus 2
// samples along each axis for the interpolation.
#include "procedural/terrain/mesh/lattice.h"

#include "procedural/abi/param.h"
#include "procedural/terrain/shape_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace marram {
namespace {

constexpr int lattice_border = 3; // control points with zero offset on each side

// The offset at (u, v) and its derivatives with respect to u and v. Components: u, v, y.
struct LatticeValue {
    double d[4], by_u[4], by_v[4];

    MARRAM_INLINE double jacobian() const { return (1.0 + by_u[0]) * (1.0 + by_v[1]) - by_v[0] * by_u[1]; }
};

struct LatticeSpline {
    const LatticeControl* controls;
    int nu, nv, stride;

    MARRAM_INLINE bool moves(double u, double v) const {
        return u > -2.0 && v > -2.0 && u < nu + 1.0 && v < nv + 1.0;
    }

    MARRAM_INLINE LatticeValue at(double u, double v) const {
        LatticeValue value{};
        if (!moves(u, v)) return value;
        const int i = int(std::floor(u)), j = int(std::floor(v));
        double bu[4], su[4], bv[4], sv[4];
        cubic_bspline(u - i, bu, su);
        cubic_bspline(v - j, bv, sv);
        Double4 d{}, by_u{}, by_v{};
        const LatticeControl* first =
            controls + size_t(j + lattice_border - 1) * size_t(stride) + size_t(i + lattice_border - 1);
        for (int l = 0; l < 4; ++l, first += stride) {
            Double4 row{}, slope{};
            for (int k = 0; k < 4; ++k) {
                Double4 c;
                std::memcpy(&c, first[k].values, sizeof c);
                row += bu[k] * c;
                slope += su[k] * c;
            }
            d += bv[l] * row;
            by_u += bv[l] * slope;
            by_v += sv[l] * row;
        }
        std::memcpy(value.d, &d, sizeof d);
        std::memcpy(value.by_u, &by_u, sizeof d);
        std::memcpy(value.by_v, &by_v, sizeof d);
        return value;
    }

    // Finds (u, v) with (u, v) + d(u, v) = (at_u, at_v). Returns the spline's value there.
    MARRAM_INLINE LatticeValue inverse(double at_u, double at_v, double tolerance, double& u,
                                       double& v) const {
        constexpr int most = 64; // Newton steps; a dozen suffice for J = 1e-3
        u = at_u, v = at_v;
        LatticeValue value = at(u, v);
        double fu = value.d[0], fv = value.d[1], size = fu * fu + fv * fv;
        for (int n = 0; n < most && size > tolerance * tolerance; ++n) {
            const double j = value.jacobian();
            const double step_u = ((1.0 + value.by_v[1]) * fu - value.by_v[0] * fv) / j;
            const double step_v = ((1.0 + value.by_u[0]) * fv - value.by_u[1] * fu) / j;
            double part = 1.0;
            bool closer = false;
            for (int halving = 0; halving < 40 && !closer; ++halving, part *= 0.5) {
                const double next_u = u - part * step_u, next_v = v - part * step_v;
                const LatticeValue next = at(next_u, next_v);
                const double gu = (next_u - at_u) + next.d[0], gv = (next_v - at_v) + next.d[1];
                const double next_size = gu * gu + gv * gv;
                if (!(next_size < size)) continue;
                closer = true;
                u = next_u, v = next_v, value = next, fu = gu, fv = gv, size = next_size;
            }
            if (!closer) break; // rounding limit reached
        }
        return value;
    }
};

struct LatticeRow {
    double u, v, step_u, step_v; // of the first sample, and from one to the next
    double to_world[4];          // x by u, x by v, z by u, z by v
    double tolerance, rounding;  // rounding: relative rounding error of u and v
    int count;
    double *to_rest_x, *to_rest_z, *lift;
};

MARRAM_HOT void lattice_row(const LatticeSpline& spline, const LatticeRow& row) {
    for (int i = 0; i < row.count; ++i) {
        const double at_u = row.u + i * row.step_u, at_v = row.v + i * row.step_v;
        row.to_rest_x[i] = row.to_rest_z[i] = row.lift[i] = 0.0;
        if (!spline.moves(at_u, at_v)) continue;
        const double least = row.rounding * std::max(std::abs(at_u), std::abs(at_v));
        double u, v;
        const LatticeValue value = spline.inverse(at_u, at_v, std::max(row.tolerance, least), u, v);
        const double du = u - at_u, dv = v - at_v;
        row.to_rest_x[i] = row.to_world[0] * du + row.to_world[1] * dv;
        row.to_rest_z[i] = row.to_world[2] * du + row.to_world[3] * dv;
        row.lift[i] = value.d[2];
    }
}

constexpr double lattice_rounding = 8.0 * std::numeric_limits<double>::epsilon();

// ---- Folds: the Jacobian in Bernstein form ------------------------------------------------------------------------------

using LatticePatch = std::array<std::array<double, 4>, 4>;   // [v][u], cubic
using LatticeQuintic = std::array<std::array<double, 6>, 6>; // [v][u]

// Bezier control points of one segment of a uniform cubic B-spline.
std::array<double, 4> lattice_bezier(double a, double b, double c, double d) {
    return {(a + 4.0 * b + c) / 6.0, (2.0 * b + c) / 3.0, (b + 2.0 * c) / 3.0, (b + 4.0 * c + d) / 6.0};
}

LatticePatch lattice_bezier(const LatticePatch& spline) {
    LatticePatch rows, patch;
    for (size_t l = 0; l < 4; ++l)
        rows[l] = lattice_bezier(spline[l][0], spline[l][1], spline[l][2], spline[l][3]);
    for (size_t k = 0; k < 4; ++k) {
        const auto column = lattice_bezier(rows[0][k], rows[1][k], rows[2][k], rows[3][k]);
        for (size_t l = 0; l < 4; ++l) patch[l][k] = column[l];
    }
    return patch;
}

// quintic += sign (da/du) (db/dv). The Bernstein coefficients of a product are weighted sums of products of
// coefficients (Farin).
void lattice_add_product(const LatticePatch& a, const LatticePatch& b, double sign, LatticeQuintic& quintic) {
    constexpr double two[3] = {1, 2, 1}, three[4] = {1, 3, 3, 1}, five[6] = {1, 5, 10, 10, 5, 1};
    for (size_t al = 0; al < 4; ++al)
        for (size_t ak = 0; ak < 3; ++ak)
            for (size_t bl = 0; bl < 3; ++bl)
                for (size_t bk = 0; bk < 4; ++bk) {
                    const double by_u = 3.0 * (a[al][ak + 1] - a[al][ak]),
                                 by_v = 3.0 * (b[bl + 1][bk] - b[bl][bk]);
                    const double share =
                        two[ak] * three[bk] / five[ak + bk] * three[al] * two[bl] / five[al + bl];
                    quintic[al + bl][ak + bk] += sign * share * by_u * by_v;
                }
}

// Splits a quintic into two halves (de Casteljau).
void lattice_halve(const std::array<double, 6>& whole, std::array<double, 6>& low,
                   std::array<double, 6>& high) {
    std::array<double, 6> p = whole;
    for (size_t n = 0; n < 6; ++n) {
        low[n] = p[0];
        high[5 - n] = p[5 - n];
        for (size_t k = 0; k + n < 5; ++k) p[k] = 0.5 * (p[k] + p[k + 1]);
    }
}

void lattice_halve_rows(const LatticeQuintic& whole, LatticeQuintic& low, LatticeQuintic& high) {
    for (size_t l = 0; l < 6; ++l) lattice_halve(whole[l], low[l], high[l]);
}

LatticeQuintic lattice_transposed(const LatticeQuintic& q) {
    LatticeQuintic t;
    for (size_t l = 0; l < 6; ++l)
        for (size_t k = 0; k < 6; ++k) t[k][l] = q[l][k];
    return t;
}

// True if the polynomial is above `least` on its whole square. Otherwise sets `found` to a value, or a lower
// bound, that is not.
bool lattice_above(const LatticeQuintic& q, double least, int halvings, double& found) {
    double bound = q[0][0];
    for (const auto& row : q) bound = std::min(bound, *std::min_element(row.begin(), row.end()));
    if (bound > least) return true;
    const double corner = std::min({q[0][0], q[0][5], q[5][0], q[5][5]});
    if (!(corner > least) || halvings == 0) {
        found = corner > least ? bound : corner;
        return false;
    }
    LatticeQuintic low, high;
    lattice_halve_rows(q, low, high);
    // Transposing alternates the axis of the halvings.
    return lattice_above(lattice_transposed(low), least, halvings - 1, found) &&
           lattice_above(lattice_transposed(high), least, halvings - 1, found);
}

} // namespace

// ---- The map ------------------------------------------------------------------------------------------------------------

LatticeMap::LatticeMap(const LatticeNet& net, double accuracy)
    : nu_(net.nu), nv_(net.nv), stride_(net.nu + 2 * lattice_border), origin_(net.origin),
      controls_(size_t(stride_) * size_t(nv_ + 2 * lattice_border)) {
    to_world_ << net.along_row.x(), net.across_rows.x(), net.along_row.y(), net.across_rows.y();
    to_net_ = to_world_.inverse();
    // |metres| <= norm |steps|: the Frobenius norm bounds the largest singular value.
    tolerance_ = accuracy / to_world_.norm();
    for (int j = 0; j < nv_; ++j)
        for (int i = 0; i < nu_; ++i) {
            const Vec3d& offset = net.offsets[size_t(j) * size_t(nu_) + size_t(i)];
            const Vec2d sideways(offset.x(), offset.z()), steps = to_net_ * sideways;
            const size_t at = size_t(j + lattice_border) * size_t(stride_) + size_t(i + lattice_border);
            controls_[at] = {{steps.x(), steps.y(), offset.y(), 0.0}};
            max_shift_ = std::max(max_shift_, sideways.norm());
            only_lifts_ = only_lifts_ && steps == Vec2d::Zero();
        }
}

std::optional<LatticeCell> LatticeMap::fold() const {
    if (only_lifts_) return {};
    constexpr int halvings = 14; // seven along each axis
    for (int j = -2; j <= nv_; ++j)
        for (int i = -2; i <= nu_; ++i) {
            LatticePatch u, v;
            double bend = 0.0; // largest difference between neighbouring offsets, net steps
            for (int l = 0; l < 4; ++l)
                for (int k = 0; k < 4; ++k) {
                    const size_t at = size_t(j + l - 1 + lattice_border) * size_t(stride_) +
                                      size_t(i + k - 1 + lattice_border);
                    const double* c = controls_[at].values;
                    u[size_t(l)][size_t(k)] = k + c[0];
                    v[size_t(l)][size_t(k)] = l + c[1];
                    for (size_t n = 0; n < 2; ++n) {
                        if (k > 0) bend = std::max(bend, std::abs(c[n] - controls_[at - 1].values[n]));
                        if (l > 0)
                            bend = std::max(bend, std::abs(c[n] - controls_[at - size_t(stride_)].values[n]));
                    }
                }
            if (bend < 0.49) continue; // J >= (1 - bend)^2 - bend^2 = 1 - 2 bend
            const LatticePatch x = lattice_bezier(u), z = lattice_bezier(v);
            LatticeQuintic jacobian{};
            lattice_add_product(x, z, 1.0, jacobian);
            lattice_add_product(z, x, -1.0, jacobian);
            double found = 0.0;
            if (!lattice_above(jacobian, min_jacobian, halvings, found)) return LatticeCell{i, j, found};
        }
    return {};
}

Vec3d LatticeMap::offset(const Vec2d& rest) const {
    const Vec2d p = to_net(rest);
    const LatticeValue value = LatticeSpline{controls_.data(), nu_, nv_, stride_}.at(p.x(), p.y());
    const Vec2d sideways = to_world_ * Vec2d(value.d[0], value.d[1]);
    return {sideways.x(), value.d[2], sideways.y()};
}

Vec2d LatticeMap::forward(const Vec2d& rest) const {
    const Vec3d d = offset(rest);
    return {rest.x() + d.x(), rest.y() + d.z()};
}

double LatticeMap::jacobian(const Vec2d& rest) const {
    const Vec2d p = to_net(rest);
    return LatticeSpline{controls_.data(), nu_, nv_, stride_}.at(p.x(), p.y()).jacobian();
}

Vec2d LatticeMap::inverse(const Vec2d& at) const {
    double x, z, lift;
    row(at.x(), at.y(), 0.0, 1, &x, &z, &lift);
    return {at.x() + x, at.y() + z};
}

void LatticeMap::row(double x, double z, double cell, int count, double* to_rest_x, double* to_rest_z,
                     double* lift) const {
    const Vec2d first = to_net({x, z}), step = to_net_.col(0) * cell;
    const LatticeRow row{first.x(),
                         first.y(),
                         step.x(),
                         step.y(),
                         {to_world_(0, 0), to_world_(0, 1), to_world_(1, 0), to_world_(1, 1)},
                         tolerance_,
                         lattice_rounding,
                         count,
                         to_rest_x,
                         to_rest_z,
                         lift};
    lattice_row({controls_.data(), nu_, nv_, stride_}, row);
}

void LatticeMap::box(const Vec2d& low, const Vec2d& high, Vec2d& lower, Vec2d& upper) const {
    lower = Vec2d::Constant(infinity), upper = Vec2d::Constant(-infinity);
    for (int corner = 0; corner < 4; ++corner) {
        const Vec2d at(corner & 1 ? high.x() : low.x(), corner & 2 ? high.y() : low.y());
        const Vec2d world = origin_ + to_world_ * at;
        lower = lower.cwiseMin(world);
        upper = upper.cwiseMax(world);
    }
}

void LatticeMap::support(Vec2d& lower, Vec2d& upper) const {
    box({-2.0, -2.0}, {nu_ + 1.0, nv_ + 1.0}, lower, upper);
}

void LatticeMap::support(int i, int j, Vec2d& lower, Vec2d& upper) const {
    box({i - 2.0, j - 2.0}, {i + 2.0, j + 2.0}, lower, upper);
}

// ---- The layer ----------------------------------------------------------------------------------------------------------

namespace {

// Interpolation along one axis: four samples and their weights.
struct LatticeTaps {
    int at[4];
    double share[4], linear; // linear: weight of at[2] between at[1] and at[2]

    LatticeTaps(double sample, int count) {
        const double inside = std::clamp(sample, 0.0, double(count - 1));
        const int whole = int(inside);
        const double t = inside - whole, r = 1.0 - t;
        for (int k = 0; k < 4; ++k) at[k] = std::clamp(whole + k - 1, 0, count - 1);
        share[0] = -0.5 * t * r * r;
        share[1] = 1.0 + t * t * (1.5 * t - 2.5);
        share[2] = 1.0 + r * r * (1.5 * r - 2.5);
        share[3] = -0.5 * r * t * t;
        linear = t;
    }
};

template <typename Value, typename Metres>
double lattice_cubic(const Value* values, const Domain& domain, const LatticeTaps& x, const LatticeTaps& z,
                     const Metres& metres) {
    double sum = 0.0;
    for (int l = 0; l < 4; ++l) {
        const Value* row = values + domain.index(0, z.at[l]);
        double across = 0.0;
        for (int k = 0; k < 4; ++k) across += x.share[k] * metres(row[x.at[k]]);
        sum += z.share[l] * across;
    }
    return sum;
}

// Clamped to the range of SandUnits (fields.h).
SandUnits lattice_sand(double metres) { return sand_units(std::clamp(metres, 0.0, 0x1p29)); }

float lattice_linear(const float* values, const Domain& domain, const LatticeTaps& x, const LatticeTaps& z) {
    const float *near = values + domain.index(0, z.at[1]), *far = values + domain.index(0, z.at[2]);
    const double a = near[x.at[1]] + x.linear * (double(near[x.at[2]]) - near[x.at[1]]);
    const double b = far[x.at[1]] + x.linear * (double(far[x.at[2]]) - far[x.at[1]]);
    return float(a + z.linear * (b - a));
}

} // namespace

struct LatticeLayer::Span {
    int i0, count, j;
    double to_rest_x[Tiles::side], to_rest_z[Tiles::side], lift[Tiles::side];
};

LatticeLayer::LatticeLayer(const LatticeNet& net, const Domain& domain, Target target,
                           std::vector<std::string> masks)
    : net_(net), domain_(domain), target_(target), masks_(std::move(masks)), map_(net, 1e-9 * domain.cell) {}

double LatticeLayer::reach() const {
    return map_.is_vertical_only() ? 0.0 : map_.max_shift() + 3.0 * domain_.cell; // 3 > 2 sqrt 2
}

void LatticeLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    Span span;
    for (int j = rect.j0; j < rect.j1; ++j)
        for (int i = rect.i0; i < rect.i1; i += span.count) {
            // A span never crosses a multiple of Tiles::side, so results do not depend on the rectangle.
            const int start = i / Tiles::side * Tiles::side;
            double x[Tiles::side], z[Tiles::side], lift[Tiles::side];
            span.i0 = i, span.j = j;
            span.count = std::min(rect.i1, start + Tiles::side) - i;
            map_.row(domain_.x(start), domain_.z(j), domain_.cell, i - start + span.count, x, z, lift);
            std::copy_n(x + (i - start), span.count, span.to_rest_x);
            std::copy_n(z + (i - start), span.count, span.to_rest_z);
            std::copy_n(lift + (i - start), span.count, span.lift);
            evaluate_row(span, below, out);
        }
}

void LatticeLayer::evaluate_row(const Span& span, const Fields& below, const LayerOutput& out) const {
    const bool bedrock_moves = target_ == Target::bedrock;
    for (int n = 0; n < span.count; ++n) {
        const size_t at = domain_.index(span.i0 + n, span.j);
        const double lift = span.lift[n];
        if (span.to_rest_x[n] == 0.0 && span.to_rest_z[n] == 0.0) {
            if (out.bedrock)
                out.bedrock[at] = bedrock_moves ? float(below.bedrock[at] + lift) : below.bedrock[at];
            if (out.sand)
                out.sand[at] = bedrock_moves || lift == 0.0
                                   ? below.sand[at]
                                   : lattice_sand(sand_metres(below.sand[at]) + lift);
            for (size_t m = 0; m < out.masks.size(); ++m) {
                const float* mask = find_mask(below, masks_[m]);
                out.masks[m][at] = mask ? mask[at] : 0.0F;
            }
            continue;
        }
        const LatticeTaps x(span.i0 + n + span.to_rest_x[n] / domain_.cell, domain_.nx);
        const LatticeTaps z(span.j + span.to_rest_z[n] / domain_.cell, domain_.nz);
        const auto same = [](float v) { return double(v); };
        if (out.bedrock)
            out.bedrock[at] = bedrock_moves ? float(lattice_cubic(below.bedrock, domain_, x, z, same) + lift)
                                            : below.bedrock[at];
        if (out.sand) {
            const double sand = lattice_cubic(below.sand, domain_, x, z, sand_metres);
            out.sand[at] = lattice_sand(sand + (bedrock_moves ? 0.0 : lift));
        }
        for (size_t m = 0; m < out.masks.size(); ++m) {
            const float* mask = find_mask(below, masks_[m]);
            out.masks[m][at] = mask ? lattice_linear(mask, domain_, x, z) : 0.0F;
        }
    }
}

Tiles LatticeLayer::changed_since(const TerrainLayer& before, const Domain& domain) const {
    const auto* other = dynamic_cast<const LatticeLayer*>(&before);
    if (!other || other->masks_ != masks_) return Tiles(domain, true);
    Tiles tiles(domain);
    Vec2d lower, upper;
    const LatticeNet &a = net_, &b = other->net_;
    const bool same_rest = a.nu == b.nu && a.nv == b.nv && a.origin == b.origin &&
                           a.along_row == b.along_row && a.across_rows == b.across_rows &&
                           target_ == other->target_;
    if (!same_rest) {
        // The map is the identity outside its support, so only samples in the support change.
        for (const LatticeMap* map : {&map_, &other->map_}) {
            map->support(lower, upper);
            tiles.add_box(lower, upper);
        }
        return tiles;
    }
    const Vec2d shift = Vec2d::Constant(std::max(map_.max_shift(), other->map_.max_shift()));
    for (int j = 0; j < a.nv; ++j)
        for (int i = 0; i < a.nu; ++i) {
            const size_t at = size_t(j) * size_t(a.nu) + size_t(i);
            if (a.offsets[at] == b.offsets[at]) continue;
            map_.support(i, j, lower, upper);
            tiles.add_box(lower - shift, upper + shift);
        }
    return tiles;
}

// ---- From a scene -------------------------------------------------------------------------------------------------------

namespace {

[[noreturn]] void lattice_fault(const char* id, const std::string& place, const std::string& what,
                                const std::string& remedy) {
    throw SceneFault(std::string("lattice.") + id, place, what, remedy);
}

void check_lattice_rows(std::span<const DrawnCurve> rest, std::span<const DrawnCurve> bent,
                        const std::string& place) {
    if (rest.size() < 2 || rest[0].points.size() < 2)
        lattice_fault("too_few", place, "a lattice needs two rows of two points at least",
                      "draw every row of the lattice as a curve of its own");
    if (bent.size() != rest.size())
        lattice_fault("rows_differ", place,
                      "the lattice has " + std::to_string(rest.size()) + " rows at rest and " +
                          std::to_string(bent.size()) + " bent",
                      "move the points of the lattice, but add none and remove none");
    for (size_t j = 0; j < rest.size(); ++j)
        for (const DrawnCurve* row : {&rest[j], &bent[j]}) {
            if (row->points.size() != rest[0].points.size())
                lattice_fault("rows_differ", place,
                              "row " + std::to_string(j) + " of the lattice has " +
                                  std::to_string(row->points.size()) + " points, the first " +
                                  std::to_string(rest[0].points.size()),
                              "give every row as many points");
            for (const Vec3d& p : row->points)
                if (!p.allFinite() || p.cwiseAbs().maxCoeff() > max_wind_input)
                    lattice_fault("too_far", place, "a point of the lattice is more than 1e9 m away",
                                  "draw it near the terrain");
        }
}

} // namespace

LatticeNet lattice_net(std::span<const DrawnCurve> rest, std::span<const DrawnCurve> bent,
                       const std::string& place) {
    check_lattice_rows(rest, bent, place);
    const auto ground = [](const Vec3d& p) { return Vec2d(p.x(), p.z()); };
    LatticeNet net;
    net.nu = int(rest[0].points.size()), net.nv = int(rest.size());
    net.origin = ground(rest[0].points[0]);
    net.along_row = (ground(rest[0].points.back()) - net.origin) / (net.nu - 1);
    net.across_rows = (ground(rest.back().points[0]) - net.origin) / (net.nv - 1);
    const double a = net.along_row.norm(), b = net.across_rows.norm();
    const double area =
        std::abs(net.along_row.x() * net.across_rows.y() - net.along_row.y() * net.across_rows.x());
    // Reject nets whose two directions differ by less than half a degree.
    if (!(std::min(a, b) > 1e-6 && area > 0.01 * a * b))
        lattice_fault("no_area", place, "the lattice at rest covers no area",
                      "draw its rows side by side, seen from above");
    for (int j = 0; j < net.nv; ++j)
        for (int i = 0; i < net.nu; ++i) {
            const Vec3d &from = rest[size_t(j)].points[size_t(i)], &to = bent[size_t(j)].points[size_t(i)];
            const Vec2d even = net.origin + i * net.along_row + j * net.across_rows;
            if ((ground(from) - even).norm() > 0.01 * std::min(a, b))
                lattice_fault("uneven", place,
                              "point " + std::to_string(i) + " of row " + std::to_string(j) +
                                  " of the lattice at rest is off the even grid",
                              "space the points of the resting lattice evenly, and bend the other one");
            net.offsets.push_back(to - from);
        }
    return net;
}

namespace {

constexpr std::array lattice_values = {
    param::curves("rest", "",
                  "curves: the rows of the lattice before it was bent, an even grid seen from above"),
    param::curves("bent", "", "curves: the same rows, bent"),
    param::choice("target", "\"bedrock\"", "bedrock|sand",
                  "bedrock: it is bent and the sand goes with it; sand: only the sand"),
    param::text("masks", "none", "names of masks that are bent along, separated by commas"),
};

std::vector<std::string> lattice_names(const std::string& list) {
    std::vector<std::string> names;
    for (size_t begin = 0; begin <= list.size();) {
        const size_t end = std::min(list.find(',', begin), list.size());
        const size_t first = list.find_first_not_of(' ', begin);
        if (first < end) names.push_back(list.substr(first, list.find_last_not_of(' ', end - 1) + 1 - first));
        begin = end + 1;
    }
    return names;
}

std::vector<std::string> lattice_masks(const LayerValues& values) {
    return values.has("masks") ? lattice_names(values.text("masks")) : std::vector<std::string>();
}

std::unique_ptr<TerrainLayer> make_lattice(const LayerContext& context) {
    const LayerValues& values = context.values;
    const auto rest = context.curves(values.text("rest")), bent = context.curves(values.text("bent"));
    const std::string place = values.place("bent");
    const LatticeNet net = lattice_net(rest, bent, place);
    const auto target =
        values.text("target") == "sand" ? LatticeLayer::Target::sand : LatticeLayer::Target::bedrock;
    const std::vector<std::string> masks = lattice_masks(values);
    if (values.has("masks") && masks.empty())
        throw SceneFault("terrain.no_mask", values.place("masks"), "masks names none",
                         "name masks of earlier layers, separated by commas, or leave it out");
    for (const std::string& name : masks)
        if (std::find(context.masks.begin(), context.masks.end(), name) == context.masks.end())
            throw SceneFault("terrain.no_mask", values.place("masks"),
                             "no layer below outputs a mask '" + name + "'", "name masks of earlier layers");
    auto layer = std::make_unique<LatticeLayer>(net, context.domain, target, masks);
    if (const auto fold = layer->map().fold()) {
        const Vec2d at = net.origin + (fold->i + 0.5) * net.along_row + (fold->j + 0.5) * net.across_rows;
        lattice_fault(
            "fold", place,
            fmt::format("the lattice folds the ground in its cell ({}, {}), which rests around x = {:.6g}, "
                        "z = {:.6g}",
                        fold->i, fold->j, at.x(), at.y()),
            "move the points around that cell apart, or spread the shift over more points");
    }
    double lift = 0.0;
    for (const Vec3d& offset : net.offsets) lift = std::max(lift, std::abs(offset.y()));
    const double side = context.domain.cell * std::max(context.domain.nx, context.domain.nz);
    if (lift > side && context.warn)
        context.warn(
            place,
            fmt::format("the lattice moves the ground up or down by as much as {:.3g} m, more than the "
                        "terrain's side of {:.3g} m",
                        lift, side),
            "check that its curves are drawn in metres");
    return layer;
}

} // namespace

LayerType lattice_layer_type() {
    return {"lattice", "a drawn lattice bends what is below", lattice_values, make_lattice, lattice_masks};
}

} // namespace marram
