// SPDX-License-Identifier: Apache-2.0
// The BasisCurves of a USD layer (usda.h) in world space: metres, y up.
#pragma once

#include "core/math/vec.h"
#include "core/read/usda/usda_scene.h"

#include <cstdint>
#include <span>
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
    // allowed, or is below 2.
    uint32_t segments(uint32_t count) const;
};

// A BasisCurves prim with its ancestors.
struct UsdaCurvesPrim {
    std::string path;                       // "/world/hair"
    std::vector<const UsdaPrim*> ancestors; // from the root down to itself
    const UsdaPrim& self() const { return *ancestors.back(); }
};

struct UsdaCurvesFound {
    std::vector<UsdaCurvesPrim> prims;
    std::vector<std::string> warnings; // one line for each reason why curves of the layer are not among them
};

// Every prim "def BasisCurves" that is not below an inactive one, an over or a class, and is meant to be
// seen: its purpose is not guide or proxy, and it is not invisible, by itself or by a parent's (USD's rules
// of inheritance; a visibility that animates counts as visible). chosen: paths or names of prims; only these
// and what is below them are read, and their own flags and those above them do not count. Throws InputError
// if no prim is left, and for a choice that finds none.
UsdaCurvesFound find_usda_curves(const std::string& path, const UsdaScene& scene,
                                 std::span<const std::string> chosen);

// Basis and wrap of a BasisCurves prim.
UsdaCurveKind usda_curve_kind(const UsdaScene& scene, const UsdaPrim& prim);
// Number of vertices of each curve; they must add up to `points`. path: for messages. Curves of fewer than
// two vertices are among them, as in files of USD's makers: they have no segments. value: of
// curveVertexCounts at some time; nullptr: there is none.
std::vector<uint32_t> usda_curve_counts(const UsdaScene& scene, const UsdaPrim& prim, const std::string& path,
                                        const UsdaCurveKind& kind, size_t points, const UsdaValue* value);

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

// The prims of find_usda_curves(). Attributes are those for every time, else their earliest sample.
// Transforms follow xformOpOrder of the prim and its ancestors: translate, rotate, orient, scale, transform,
// !invert!, !resetXformStack!. If the layer does not say, metersPerUnit is 0.01 and upAxis is "Y", as in USD.
// Throws InputError with the place for counts, types and numbers that do not form curves.
std::vector<UsdaCurves> read_usda_curves(const std::string& path, std::string_view bytes,
                                         std::span<const std::string> chosen = {},
                                         std::vector<std::string>* warnings = nullptr);

} // namespace marram
