// SPDX-License-Identifier: Apache-2.0
// The BasisCurves of a USD layer (usda.h) in world space: metres, y up.
#pragma once

#include "core/geometry/usda_scene.h"
#include "core/math/vec.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

enum class UsdaCurveBasis { linear, bezier, bspline, catmull_rom };
enum class UsdaCurveWrap { nonperiodic, periodic, pinned };

struct UsdaCurveKind {
    UsdaCurveBasis basis = UsdaCurveBasis::bezier;
    UsdaCurveWrap wrap = UsdaCurveWrap::nonperiodic;

    // Number of cubics, or of straight pieces, of a curve with `count` vertices. 0: that count is not
    // allowed.
    uint32_t segments(uint32_t count) const;
};

// Basis and wrap of a BasisCurves prim.
UsdaCurveKind usda_curve_kind(const UsdaScene& scene, const UsdaPrim& prim);
// Number of vertices of each curve; they must add up to `points`. path: for messages.
std::vector<uint32_t> usda_curve_counts(const UsdaScene& scene, const UsdaPrim& prim, const std::string& path,
                                        const UsdaCurveKind& kind, size_t points);

// One prim. The vertices of its curves are in sequence; counts: the number of each curve.
struct UsdaCurves : UsdaCurveKind {
    std::string path; // "/world/hair"
    std::vector<uint32_t> counts;
    std::vector<Vec3d> points;
    std::vector<double>
        widths; // diameters in metres, scaled by the cube root of the volume scale; empty if there are none
    std::string width_interpolation; // "constant", "uniform", "varying", "vertex": gives their number

    // Points along a curve: `each` per cubic and the last one; for a linear curve its vertices. For a
    // periodic curve the last point is not the first again. A pinned or Bezier curve begins and ends exactly
    // in its first and last vertex.
    std::vector<Vec3d> polyline(size_t first, uint32_t count, int each) const;
};

// Every prim "def BasisCurves" that is not below an inactive one, an over or a class, regardless of
// visibility and purpose. Attributes are those for every time, else their earliest sample. Transforms follow
// xformOpOrder of the prim and its ancestors: translate, rotate, orient, scale, transform, !invert!,
// !resetXformStack!. If the layer does not say, metersPerUnit is 0.01 and upAxis is "Y", as in USD. Throws
// InputError with the place for counts, types and numbers that do not form curves.
std::vector<UsdaCurves> read_usda_curves(const std::string& path, std::string_view bytes);

} // namespace marram
