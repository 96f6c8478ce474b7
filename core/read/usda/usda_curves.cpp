// SPDX-License-Identifier: Apache-2.0
// Reads curves from USD. With P the vertices of a curve, n of them, cubic k is
//
//     bezier        P[3k] ... P[3k + 3]       n = 3 m + 1 for m cubics; periodic: n = 3 m, ending in P[0]
//     bspline       P[k] ... P[k + 3]         n - 3 cubics; periodic: n, indices wrap around
//     catmullRom    the same                  it runs from P[k + 1] to P[k + 2]
//     pinned        as if the curve had one more vertex at each end, 2 P[0] - P[1] and 2 P[n - 1] - P[n - 2]:
//                   n - 1 cubics from P[0] to P[n - 1]. Bezier and linear curves have these ends anyway
//
// Linear: P itself. (OpenUSD, UsdGeomBasisCurves.)
#include "core/read/usda/usda_curves.h"

#include "core/read/mesh_reader.h"
#include "core/read/polylines.h"
#include "core/read/usda/usda_scene.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace marram {

namespace {

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
    UsdaCurvesReader(const std::string& path, std::string_view bytes) : path_(path), scene_(path, bytes) {}
    std::vector<UsdaCurves> read(std::span<const std::string> chosen, std::vector<std::string>* warnings);

  private:
    void read_curves(const UsdaPrim& prim, const std::string& path, const UsdaTransform& placing);
    void read_points(const UsdaPrim& prim, const UsdaTransform& placing, UsdaCurves& curves) const;
    void read_widths(const UsdaPrim& prim, const UsdaTransform& placing, UsdaCurves& curves) const;

    const std::string& path_;
    UsdaScene scene_;
    std::vector<UsdaCurves> all_;
};

// ---- Curves

void UsdaCurvesReader::read_points(const UsdaPrim& prim, const UsdaTransform& placing,
                                   UsdaCurves& curves) const {
    size_t at = prim.at;
    const auto* numbers = scene_.elements<std::vector<double>>(prim, "points", &at);
    if (!numbers || numbers->size() % 3 != 0)
        scene_.fail(at, fmt::format("the curves \"{}\" have no points", curves.path),
                    "write them into this file: references are not followed");
    curves.points.reserve(numbers->size() / 3);
    for (size_t i = 0; i < numbers->size(); i += 3) {
        const Vec3d p =
            placing.topLeftCorner<3, 3>() * Vec3d(numbers->data() + i) + placing.topRightCorner<3, 1>();
        if (!(p.cwiseAbs().maxCoeff() <= max_curve_coordinate))
            scene_.fail(at,
                        fmt::format("point {} of \"{}\" {}", i / 3, curves.path,
                                    p.allFinite() ? "is beyond 1e8 m" : "is not three finite numbers"),
                        "write finite numbers, and scale the curves down");
        curves.points.push_back(p);
    }
}

void UsdaCurvesReader::read_widths(const UsdaPrim& prim, const UsdaTransform& placing,
                                   UsdaCurves& curves) const {
    size_t at = prim.at;
    std::string_view interpolation;
    const auto* widths = scene_.elements<std::vector<double>>(prim, "widths", &at, &interpolation);
    if (!widths || widths->empty()) return;
    const bool closed = curves.wrap == UsdaCurveWrap::periodic;
    // One width without an interpolation, or one per curve, can only be meant as that.
    if (interpolation.empty() && widths->size() != curves.points.size())
        interpolation = widths->size() == curves.counts.size() ? "uniform" : "constant";
    curves.width_interpolation = interpolation.empty() ? "vertex" : interpolation; // USD's default
    size_t expected = curves.points.size();
    if (interpolation == "constant") expected = 1;
    if (interpolation == "uniform") expected = curves.counts.size();
    if (interpolation == "varying") {
        expected = 0;
        for (const uint32_t count : curves.counts) expected += curves.segments(count) + (closed ? 0 : 1);
    }
    if (widths->size() != expected)
        scene_.fail(at,
                    fmt::format("\"{}\" has {} widths but its interpolation needs {}", curves.path,
                                widths->size(), expected),
                    "export the curves anew");
    const double scale = std::cbrt(std::abs(placing.topLeftCorner<3, 3>().determinant()));
    curves.widths.reserve(widths->size());
    for (const double width : *widths) {
        if (!(width >= 0.0) || !std::isfinite(width * scale))
            scene_.fail(at,
                        fmt::format("width {} of \"{}\" is not a finite number of at least 0",
                                    curves.widths.size(), curves.path),
                        "write diameters");
        curves.widths.push_back(width * scale);
    }
}

void UsdaCurvesReader::read_curves(const UsdaPrim& prim, const std::string& path,
                                   const UsdaTransform& placing) {
    UsdaCurves curves;
    curves.path = path;
    static_cast<UsdaCurveKind&>(curves) = usda_curve_kind(scene_, prim);
    read_points(prim, placing, curves);
    curves.counts =
        usda_curve_counts(scene_, prim, path, curves, curves.points.size(), prim.find("curveVertexCounts"));
    read_widths(prim, placing, curves);
    all_.push_back(std::move(curves));
}

std::vector<UsdaCurves> UsdaCurvesReader::read(std::span<const std::string> chosen,
                                               std::vector<std::string>* warnings) {
    UsdaCurvesFound found = find_usda_curves(path_, scene_, chosen);
    for (const UsdaCurvesPrim& prim : found.prims) {
        UsdaTransform placing = scene_.root();
        for (const UsdaPrim* one : prim.ancestors) placing = scene_.transform_of(*one, placing);
        read_curves(prim.self(), prim.path, placing);
    }
    if (warnings) *warnings = std::move(found.warnings);
    return std::move(all_);
}

} // namespace

UsdaCurveKind usda_curve_kind(const UsdaScene& scene, const UsdaPrim& prim) {
    UsdaCurveKind kind;
    const std::string_view wrap =
        scene.choice(prim, "wrap", "nonperiodic", {"nonperiodic", "periodic", "pinned"});
    kind.wrap = wrap == "periodic" ? UsdaCurveWrap::periodic
                : wrap == "pinned" ? UsdaCurveWrap::pinned
                                   : UsdaCurveWrap::nonperiodic;
    if (scene.choice(prim, "type", "cubic", {"linear", "cubic"}) == "linear") {
        kind.basis = UsdaCurveBasis::linear;
    } else {
        const std::string_view basis =
            scene.choice(prim, "basis", "bezier", {"bezier", "bspline", "catmullRom"});
        kind.basis = basis == "bspline"      ? UsdaCurveBasis::bspline
                     : basis == "catmullRom" ? UsdaCurveBasis::catmull_rom
                                             : UsdaCurveBasis::bezier;
    }
    return kind;
}

std::vector<uint32_t> usda_curve_counts(const UsdaScene& scene, const UsdaPrim& prim, const std::string& path,
                                        const UsdaCurveKind& kind, size_t points, const UsdaValue* value) {
    size_t at = prim.at;
    scene.elements<std::vector<int64_t>>(prim, "curveVertexCounts", &at); // checks the type
    const auto* numbers = value ? std::get_if<std::vector<int64_t>>(value) : nullptr;
    if (!numbers)
        scene.fail(at, fmt::format("the curves \"{}\" have no curveVertexCounts", path),
                   "write them into this file: references are not followed");
    std::vector<uint32_t> counts;
    counts.reserve(numbers->size());
    uint64_t sum = 0;
    for (const int64_t count : *numbers) {
        if (count < 0 || uint64_t(count) > max_count || (count > 1 && kind.segments(uint32_t(count)) == 0))
            scene.fail(at, fmt::format("curve {} of \"{}\" has {} vertices", counts.size(), path, count),
                       "see USD's BasisCurves for how many its type, basis and wrap allow");
        counts.push_back(uint32_t(count));
        sum += uint64_t(count);
    }
    if (sum != points)
        scene.fail(
            at,
            fmt::format("curveVertexCounts of \"{}\" add up to {}, there are {} points", path, sum, points),
            "export the curves anew");
    return counts;
}

uint32_t UsdaCurveKind::segments(uint32_t count) const {
    const bool periodic = wrap == UsdaCurveWrap::periodic, pinned = wrap == UsdaCurveWrap::pinned;
    if (basis == UsdaCurveBasis::linear) return periodic ? (count < 3 ? 0 : count) : std::max(count, 1u) - 1;
    if (basis == UsdaCurveBasis::bezier) {
        const bool whole = count % 3 == (periodic ? 0 : 1);
        return whole ? count / 3 : 0; // 0 for one vertex
    }
    if (pinned) return std::max(count, 1u) - 1;
    if (periodic) return count < 3 ? 0 : count;
    return std::max(count, 3u) - 3;
}

std::vector<Vec3d> UsdaCurves::polyline(size_t first, uint32_t count, int each) const {
    const Vec3d* p = points.data() + first;
    if (basis == UsdaCurveBasis::linear || count < 2) return {p, p + count};
    const bool is_bezier = basis == UsdaCurveBasis::bezier, periodic = wrap == UsdaCurveWrap::periodic;
    const bool pinned = wrap == UsdaCurveWrap::pinned && !is_bezier;
    const auto vertex = [&](int64_t i) -> Vec3d {
        if (periodic) return p[size_t(i) % count];
        if (!pinned) return p[i];
        if (i == 0) return 2.0 * p[0] - p[1]; // indices are shifted by one
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
    if (pinned || (is_bezier && !periodic)) { // exact: the sum of the weights may round
        line.front() = p[0];
        line.back() = p[count - 1];
    }
    return line;
}

std::vector<UsdaCurves> read_usda_curves(const std::string& path, std::string_view bytes,
                                         std::span<const std::string> chosen,
                                         std::vector<std::string>* warnings) {
    return UsdaCurvesReader(path, bytes).read(chosen, warnings);
}

std::vector<Polyline> read_usda_polylines(const std::string& file, std::string_view bytes,
                                          std::span<const std::string> prims,
                                          std::vector<std::string>* warnings) {
    std::vector<Polyline> lines;
    for (const UsdaCurves& curves : read_usda_curves(file, bytes, prims, warnings)) {
        size_t first = 0;
        for (const uint32_t count : curves.counts) {
            lines.push_back({curves.polyline(first, count, usda_points_a_segment),
                             curves.wrap == UsdaCurveWrap::periodic});
            first += count;
        }
    }
    return lines;
}

} // namespace marram
