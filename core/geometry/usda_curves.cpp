// SPDX-License-Identifier: Apache-2.0
// Curves of USD. With P the vertices of a curve, n of them, cubic k is
//
//     bezier        P[3k] ... P[3k + 3]       n = 3 m + 1 for m cubics; periodic: n = 3 m, the last one ends in P[0]
//     bspline       P[k] ... P[k + 3]         n - 3 cubics; periodic: n, indices wrap around
//     catmullRom    the same                  it runs from P[k + 1] to P[k + 2]
//     pinned        as if the curve had one vertex more at both ends, 2 P[0] - P[1] and 2 P[n - 1] - P[n - 2]: n - 1 cubics from P[0] to
//                   P[n - 1]. Bezier and linear curves go through their ends anyway
//
// Linear: P itself. (OpenUSD, UsdGeomBasisCurves.)
#include "core/geometry/usda_curves.h"

#include "core/geometry/mesh_reader.h"
#include "core/geometry/polylines.h"
#include "core/geometry/usda.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <cmath>

namespace marram {

namespace {

// Columns are images of the axes: p' = M p. USD writes matrices for rows, p' = p M.
using Placing = Eigen::Matrix4d;

std::array<double, 4> usda_weights(UsdaCurveBasis basis, double t) {
    const double r = 1.0 - t, t2 = t * t, t3 = t2 * t;
    if (basis == UsdaCurveBasis::bezier) return {r * r * r, 3.0 * r * r * t, 3.0 * r * t2, t3};
    if (basis == UsdaCurveBasis::bspline)
        return {r * r * r / 6.0, (3.0 * t3 - 6.0 * t2 + 4.0) / 6.0,
                (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) / 6.0, t3 / 6.0};
    return {0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t),
            0.5 * (t3 - t2)};
}

class UsdaCurvesReader {
  public:
    UsdaCurvesReader(const std::string& path, std::string_view bytes) : path_(path), bytes_(bytes) {}
    std::vector<UsdaCurves> read();

  private:
    void visit(const UsdaPrim& prim, const std::string& parent, const Placing& above);
    Placing layer_placing(const UsdaLayer& layer) const;
    Placing placing_of(const UsdaPrim& prim, const Placing& above) const;
    Placing op_of(const UsdaPrim& prim, std::string_view op) const;
    void read_curves(const UsdaPrim& prim, const std::string& path, const Placing& placing);
    void read_counts(const UsdaPrim& prim, UsdaCurves& curves) const;
    void read_points(const UsdaPrim& prim, const Placing& placing, UsdaCurves& curves) const;
    void read_widths(const UsdaPrim& prim, const Placing& placing, UsdaCurves& curves) const;
    template <typename Elements>
    const Elements* elements(const UsdaPrim& prim, std::string_view name, size_t* at = nullptr,
                             std::string_view* interpolation = nullptr) const;
    std::string_view choice(const UsdaPrim& prim, std::string_view name, std::string_view otherwise,
                            std::initializer_list<std::string_view> known) const;

    [[noreturn]] void fail(size_t at, const std::string& what, const std::string& fix) const {
        throw InputError(place_of(path_, bytes_, at), what, fix);
    }

    const std::string& path_;
    std::string_view bytes_;
    Placing root_ = Placing::Identity(); // of the layer
    std::vector<UsdaCurves> all_;
};

// nullptr where the prim does not say; a fault where what it says is of another kind.
template <typename Elements>
const Elements* UsdaCurvesReader::elements(const UsdaPrim& prim, std::string_view name, size_t* at,
                                           std::string_view* interpolation) const {
    const UsdaAttribute* of = nullptr;
    const UsdaValue* value = prim.find(name, &of);
    if (!value) return nullptr;
    if (at) *at = of->at;
    if (interpolation) *interpolation = find_metadata(of->metadata, "interpolation");
    const Elements* found = std::get_if<Elements>(value);
    if (!found) fail(of->at, fmt::format("\"{}\" has the type {}", name, of->type), "export the curves anew");
    return found;
}

std::string_view UsdaCurvesReader::choice(const UsdaPrim& prim, std::string_view name,
                                          std::string_view otherwise,
                                          std::initializer_list<std::string_view> known) const {
    size_t at = 0;
    const auto* texts = elements<std::vector<std::string_view>>(prim, name, &at);
    if (!texts) return otherwise;
    if (texts->size() == 1)
        for (const std::string_view one : known)
            if (one == (*texts)[0]) return one;
    fail(at,
         fmt::format("the {} \"{}\" of curves is not read", name,
                     texts->empty() ? "" : (*texts)[0].substr(0, 32)),
         fmt::format("export them with one of {}", fmt::join(known, ", ")));
}

// ---- Transforms

Placing UsdaCurvesReader::layer_placing(const UsdaLayer& layer) const {
    Placing placing = Placing::Identity();
    const std::string_view up = find_metadata(layer.metadata, "upAxis"),
                           unit = find_metadata(layer.metadata, "metersPerUnit");
    if (up == "Z") {
        placing.row(1) << 0.0, 0.0, 1.0, 0.0;
        placing.row(2) << 0.0, -1.0, 0.0, 0.0;
    } else if (!up.empty() && up != "Y") {
        throw InputError({path_}, fmt::format("the upAxis is \"{}\"", up.substr(0, 32)),
                         "export it with Y or Z up");
    }
    double metres = 0.01; // what USD says of a layer that does not
    if (!unit.empty() && (parse_number(unit, metres) != NumberFault::none || !(metres > 0.0)))
        throw InputError({path_}, fmt::format("metersPerUnit is \"{}\"", unit.substr(0, 32)),
                         "give a number above 0, such as 1");
    placing.topRows<3>() *= metres;
    return placing;
}

Eigen::Matrix3d turned_about(char axis, double degrees) {
    return Eigen::AngleAxisd(degrees * degree, Vec3d::Unit(axis - 'X')).toRotationMatrix();
}

// "xformOp:rotateXYZ:name".
Placing UsdaCurvesReader::op_of(const UsdaPrim& prim, std::string_view op) const {
    constexpr std::string_view head = "xformOp:";
    size_t at = prim.at;
    const auto* numbers = op.starts_with(head) ? elements<std::vector<double>>(prim, op, &at) : nullptr;
    if (!numbers)
        fail(at, fmt::format("xformOpOrder names \"{}\", which is not there", op.substr(0, 64)),
             "export the transforms anew");
    for (const double number : *numbers)
        if (!std::isfinite(number))
            fail(at, fmt::format("\"{}\" is not finite", op.substr(0, 64)), "write finite numbers");
    const std::string_view kind = op.substr(head.size(), op.find(':', head.size()) - head.size());
    const size_t count = numbers->size();
    const double* n = numbers->data();
    Placing placing = Placing::Identity();
    if (kind == "translate" && count == 3) {
        placing.topRightCorner<3, 1>() = Vec3d(n);
    } else if (kind == "scale" && count == 3) {
        placing.topLeftCorner<3, 3>() = Vec3d(n).asDiagonal();
    } else if (kind == "orient" && count == 4 && Eigen::Map<const Vec4d>(n).stableNorm() > 0.0) {
        placing.topLeftCorner<3, 3>() =
            Eigen::Quaterniond(n[0], n[1], n[2], n[3]).normalized().toRotationMatrix();
    } else if (kind == "transform" && count == 16) {
        placing = Eigen::Map<const Placing>(n); // its rows are our columns, as Eigen stores them
        if (placing.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0))
            fail(at, fmt::format("\"{}\" is a perspective", op.substr(0, 64)),
                 "let its last column be 0, 0, 0, 1");
    } else if (kind.starts_with("rotate") && (kind.size() == 7 || kind.size() == 9) &&
               count == kind.size() - 6 && kind.find_first_not_of("XYZ", 6) == std::string_view::npos) {
        Eigen::Matrix3d turn = Eigen::Matrix3d::Identity(); // the first axis turns first
        for (size_t i = 0; i < count; ++i) turn = turned_about(kind[6 + i], n[i]) * turn;
        placing.topLeftCorner<3, 3>() = turn;
    } else {
        fail(at, fmt::format("the transform \"{}\" is not read", op.substr(0, 64)),
             "use translate, rotate, orient, scale or transform");
    }
    return placing;
}

Placing UsdaCurvesReader::placing_of(const UsdaPrim& prim, const Placing& above) const {
    Placing placing = above;
    size_t at = prim.at;
    const auto* order = elements<std::vector<std::string_view>>(prim, "xformOpOrder", &at);
    if (!order) return placing;
    for (std::string_view op : *order) {
        constexpr std::string_view invert = "!invert!";
        if (op == "!resetXformStack!") {
            placing = root_;
            continue;
        }
        const bool inverse = op.starts_with(invert);
        if (inverse) op.remove_prefix(invert.size());
        Placing one = op_of(prim, op);
        if (inverse) {
            if (!(std::abs(one.determinant()) > 0.0))
                fail(at, fmt::format("\"{}\" has no inverse", op.substr(0, 64)), "do not scale by 0");
            one = one.inverse().eval();
        }
        placing = (placing * one).eval();
    }
    return placing;
}

// ---- Curves

void UsdaCurvesReader::read_counts(const UsdaPrim& prim, UsdaCurves& curves) const {
    size_t at = prim.at;
    const auto* counts = elements<std::vector<int64_t>>(prim, "curveVertexCounts", &at);
    if (!counts)
        fail(at, fmt::format("the curves \"{}\" have no curveVertexCounts", curves.path),
             "write them into this file: references are not followed");
    curves.counts.reserve(counts->size());
    uint64_t sum = 0;
    for (const int64_t count : *counts) {
        if (count < 0 || uint64_t(count) > greatest_count || curves.segments(uint32_t(count)) == 0)
            fail(at,
                 fmt::format("curve {} of \"{}\" has {} vertices", curves.counts.size(), curves.path, count),
                 "see USD's BasisCurves for how many its type, basis and wrap allow");
        curves.counts.push_back(uint32_t(count));
        sum += uint64_t(count);
    }
    if (sum != curves.points.size())
        fail(at,
             fmt::format("curveVertexCounts of \"{}\" add up to {}, there are {} points", curves.path, sum,
                         curves.points.size()),
             "export the curves anew");
}

void UsdaCurvesReader::read_points(const UsdaPrim& prim, const Placing& placing, UsdaCurves& curves) const {
    size_t at = prim.at;
    const auto* numbers = elements<std::vector<double>>(prim, "points", &at);
    if (!numbers || numbers->size() % 3 != 0)
        fail(at, fmt::format("the curves \"{}\" have no points", curves.path),
             "write them into this file: references are not followed");
    curves.points.reserve(numbers->size() / 3);
    for (size_t i = 0; i < numbers->size(); i += 3) {
        const Vec3d p =
            placing.topLeftCorner<3, 3>() * Vec3d(numbers->data() + i) + placing.topRightCorner<3, 1>();
        if (!(p.cwiseAbs().maxCoeff() <= greatest_curve_coordinate))
            fail(at,
                 fmt::format("point {} of \"{}\" {}", i / 3, curves.path,
                             p.allFinite() ? "is beyond 1e8 m" : "is not three finite numbers"),
                 "write finite numbers, and scale the curves down");
        curves.points.push_back(p);
    }
}

void UsdaCurvesReader::read_widths(const UsdaPrim& prim, const Placing& placing, UsdaCurves& curves) const {
    size_t at = prim.at;
    std::string_view interpolation;
    const auto* widths = elements<std::vector<double>>(prim, "widths", &at, &interpolation);
    if (!widths || widths->empty()) return;
    curves.width_interpolation = interpolation.empty() ? "vertex" : interpolation; // as USD has it
    const bool closed = curves.wrap == UsdaCurveWrap::periodic;
    size_t expected = curves.points.size();
    if (interpolation == "constant") expected = 1;
    if (interpolation == "uniform") expected = curves.counts.size();
    if (interpolation == "varying") {
        expected = 0;
        for (const uint32_t count : curves.counts) expected += curves.segments(count) + (closed ? 0 : 1);
    }
    if (widths->size() != expected)
        fail(at,
             fmt::format("\"{}\" has {} widths where its interpolation wants {}", curves.path, widths->size(),
                         expected),
             "export the curves anew");
    const double scale = std::cbrt(std::abs(placing.topLeftCorner<3, 3>().determinant()));
    curves.widths.reserve(widths->size());
    for (const double width : *widths) {
        if (!(width >= 0.0) || !std::isfinite(width * scale))
            fail(at,
                 fmt::format("width {} of \"{}\" is not a finite number above 0", curves.widths.size(),
                             curves.path),
                 "write diameters");
        curves.widths.push_back(width * scale);
    }
}

void UsdaCurvesReader::read_curves(const UsdaPrim& prim, const std::string& path, const Placing& placing) {
    UsdaCurves curves;
    curves.path = path;
    const std::string_view wrap = choice(prim, "wrap", "nonperiodic", {"nonperiodic", "periodic", "pinned"});
    curves.wrap = wrap == "periodic" ? UsdaCurveWrap::periodic
                  : wrap == "pinned" ? UsdaCurveWrap::pinned
                                     : UsdaCurveWrap::nonperiodic;
    if (choice(prim, "type", "cubic", {"linear", "cubic"}) == "linear") {
        curves.basis = UsdaCurveBasis::linear;
    } else {
        const std::string_view basis = choice(prim, "basis", "bezier", {"bezier", "bspline", "catmullRom"});
        curves.basis = basis == "bspline"      ? UsdaCurveBasis::bspline
                       : basis == "catmullRom" ? UsdaCurveBasis::catmull_rom
                                               : UsdaCurveBasis::bezier;
    }
    read_points(prim, placing, curves);
    read_counts(prim, curves);
    read_widths(prim, placing, curves);
    all_.push_back(std::move(curves));
}

void UsdaCurvesReader::visit(const UsdaPrim& prim, const std::string& parent, const Placing& above) {
    if (prim.specifier != "def" || find_metadata(prim.metadata, "active") == "false" ||
        find_metadata(prim.metadata, "active") == "0")
        return;
    const std::string path = fmt::format("{}/{}", parent, prim.name);
    const Placing placing = placing_of(prim, above);
    if (prim.type == "BasisCurves") read_curves(prim, path, placing);
    for (const UsdaPrim& child : prim.children) visit(child, path, placing);
}

std::vector<UsdaCurves> UsdaCurvesReader::read() {
    const UsdaLayer layer = read_usda(path_, bytes_);
    root_ = layer_placing(layer);
    for (const UsdaPrim& prim : layer.prims) visit(prim, "", root_);
    return std::move(all_);
}

} // namespace

uint32_t UsdaCurves::segments(uint32_t count) const {
    const bool periodic = wrap == UsdaCurveWrap::periodic, pinned = wrap == UsdaCurveWrap::pinned;
    if (basis == UsdaCurveBasis::linear) return periodic ? (count < 3 ? 0 : count) : std::max(count, 1u) - 1;
    if (basis == UsdaCurveBasis::bezier) {
        const bool whole = count % 3 == (periodic ? 0 : 1);
        return whole ? count / 3 : 0; // one vertex makes none
    }
    if (pinned) return std::max(count, 1u) - 1;
    if (periodic) return count < 3 ? 0 : count;
    return std::max(count, 3u) - 3;
}

std::vector<Vec3d> UsdaCurves::polyline(size_t first, uint32_t count, int each) const {
    const Vec3d* p = points.data() + first;
    if (basis == UsdaCurveBasis::linear) return {p, p + count};
    const bool is_bezier = basis == UsdaCurveBasis::bezier, periodic = wrap == UsdaCurveWrap::periodic;
    const bool pinned = wrap == UsdaCurveWrap::pinned && !is_bezier;
    const auto vertex = [&](int64_t i) -> Vec3d {
        if (periodic) return p[size_t(i) % count];
        if (!pinned) return p[i];
        if (i == 0) return 2.0 * p[0] - p[1]; // the vertices are one further
        if (i == int64_t(count) + 1) return 2.0 * p[count - 1] - p[count - 2];
        return p[i - 1];
    };
    const uint32_t cubics = segments(count);
    std::vector<Vec3d> line;
    line.reserve(size_t(cubics) * size_t(each) + 1);
    const auto add = [&](uint32_t cubic, double t) {
        const std::array<double, 4> weights = usda_weights(basis, t);
        Vec3d sum = Vec3d::Zero();
        for (int64_t k = 0; k < 4; ++k)
            sum += weights[size_t(k)] * vertex(int64_t(cubic) * (is_bezier ? 3 : 1) + k);
        line.push_back(sum);
    };
    for (uint32_t cubic = 0; cubic < cubics; ++cubic)
        for (int k = 0; k < each; ++k) add(cubic, double(k) / each);
    if (!periodic) add(cubics - 1, 1.0);
    if (pinned || (is_bezier && !periodic)) { // where the sum of the weights may round
        line.front() = p[0];
        line.back() = p[count - 1];
    }
    return line;
}

std::vector<UsdaCurves> read_usda_curves(const std::string& path, std::string_view bytes) {
    return UsdaCurvesReader(path, bytes).read();
}

std::vector<Polyline> read_usda_polylines(const std::string& file, std::string_view bytes) {
    std::vector<Polyline> lines;
    for (const UsdaCurves& curves : read_usda_curves(file, bytes)) {
        size_t first = 0;
        for (const uint32_t count : curves.counts) {
            lines.push_back({curves.polyline(first, count, usda_points_a_segment),
                             curves.wrap == UsdaCurveWrap::periodic});
            first += count;
        }
    }
    if (lines.empty())
        throw InputError({file}, "has no BasisCurves of its own",
                         "export curves into this file: references and variants are not followed");
    return lines;
}

} // namespace marram
