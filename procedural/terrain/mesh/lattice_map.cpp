// SPDX-License-Identifier: Apache-2.0
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
#include "procedural/terrain/mesh/lattice_map.h"

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

} // namespace marram
