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
// The map is tested for folds, and inverted, in lattice_map.cpp.
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
