// SPDX-License-Identifier: Apache-2.0
// The BasisCurves of a USD layer (usda.h), in the world: metres, y up.
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

    // Of a curve of so many vertices: how many cubics, or straight pieces. 0: it cannot have so many.
    uint32_t segments(uint32_t count) const;
};

// Of a prim BasisCurves.
UsdaCurveKind usda_curve_kind(const UsdaScene& scene, const UsdaPrim& prim);
// How many vertices each curve has; `points` in all. path: for messages.
std::vector<uint32_t> usda_curve_counts(const UsdaScene& scene, const UsdaPrim& prim, const std::string& path,
                                        const UsdaCurveKind& kind, size_t points);

// One prim. A curve's vertices follow each other; counts holds how many each has.
struct UsdaCurves : UsdaCurveKind {
    std::string path; // "/world/hair"
    std::vector<uint32_t> counts;
    std::vector<Vec3d> points;
    std::vector<double>
        widths; // diameters in metres: scaled as the cube root of what volumes are; empty where there are none
    std::string width_interpolation; // "constant", "uniform", "varying", "vertex": how many there are

    // Where the curve goes through, `each` points a cubic and the last one; those of a linear one themselves. Of a periodic one the last
    // is not the first again. A pinned or Bezier curve begins and ends exactly in its first and last vertex.
    std::vector<Vec3d> polyline(size_t first, uint32_t count, int each) const;
};

// Every prim "def BasisCurves" that is not below one that is inactive, an over or a class, whatever its visibility and purpose. Attributes
// are those for every time, else their earliest sample. Transforms are those of xformOpOrder, of the prim and of all above it: translate,
// rotate, orient, scale, transform, !invert!, !resetXformStack!. metersPerUnit is 0.01 where the layer does not say, upAxis "Y": so USD
// has it. Throws InputError with the place for counts, types and numbers that do not make curves.
std::vector<UsdaCurves> read_usda_curves(const std::string& path, std::string_view bytes);

} // namespace marram
