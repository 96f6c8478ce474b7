// SPDX-License-Identifier: Apache-2.0
// Which curves of a USD layer are read, what is said of the rest, and layers that are valid but unusual.
#include "core/geometry/cubic.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace marram {
namespace {

constexpr const char* linear_kind = "uniform token type = \"linear\"\n";

// A curve of two points at x.
std::string curves_prim(const std::string& name, int x, const std::string& more = "",
                        const std::string& inside = "") {
    return fmt::format(
        "def BasisCurves \"{}\"\n{{\n{}int[] curveVertexCounts = [2]\npoint3f[] points = [({}, 0, 0), "
        "({}, 1, 0)]\n{}{}}}\n",
        name, linear_kind, x, x, more, inside);
}
std::string xform_prim(const std::string& name, const std::string& more) {
    return fmt::format("def Xform \"{}\"\n{{\n{}}}\n", name, more);
}
std::string usda_layer(const std::string& prims, const std::string& metadata = "") {
    return "#usda 1.0\n( metersPerUnit = 1\n" + metadata + ")\n" + prims;
}

StrandFile strands_of(const std::string& text, std::vector<std::string> prims = {}) {
    StrandReading reading;
    reading.prims = std::move(prims);
    return read_usda_strands("a.usda", text, reading);
}

// Where the curves are, as strands and as drawn curves; both must agree.
std::vector<int> read_curves(const std::string& text, const std::vector<std::string>& prims = {},
                             std::vector<std::string>* warnings = nullptr) {
    std::vector<int> at;
    const StrandFile strands = strands_of(text, prims);
    for (size_t i = 0; i < strands.samples[0].points.size(); i += 2)
        at.push_back(int(strands.samples[0].points[i].x()));
    std::vector<std::string> same;
    const std::vector<Polyline> lines = read_usda_polylines("a.usda", text, prims, &same);
    EXPECT_EQ(lines.size(), at.size());
    for (size_t i = 0; i < std::min(lines.size(), at.size()); ++i)
        EXPECT_EQ(int(lines[i].points[0].x()), at[i]);
    EXPECT_EQ(same, strands.warnings);
    if (warnings) *warnings = strands.warnings;
    return at;
}

std::string refused_with(const std::string& text, const std::vector<std::string>& prims = {}) {
    try {
        strands_of(text, prims);
    } catch (const InputError& error) {
        return to_string(error.problems.at(0));
    }
    return "";
}

bool says(const std::vector<std::string>& warnings, std::string_view what) {
    return std::ranges::any_of(warnings,
                               [&](const std::string& one) { return one.find(what) != std::string::npos; });
}

TEST(UsdaCurves, OnlyThoseMeantToBeSeen) {
    const std::string guide = "uniform token purpose = \"guide\"\n",
                      proxy = "uniform token purpose = \"proxy\"\n",
                      render = "uniform token purpose = \"render\"\n",
                      hidden = "token visibility = \"invisible\"\n";
    const std::string text = usda_layer(xform_prim(
        "G", curves_prim("hair", 1) + curves_prim("guides", 2, guide) + curves_prim("proxy", 3, proxy) +
                 curves_prim("old", 4, hidden) +
                 curves_prim("shown", 5, render + "token visibility = \"inherited\"\n") +
                 xform_prim("hidden", hidden + curves_prim("below", 6, "token visibility = \"inherited\"\n") +
                                          xform_prim("deep", curves_prim("deeper", 7))) +
                 xform_prim("grid", guide + curves_prim("guides2", 8) + curves_prim("own", 9, render)) +
                 curves_prim("blinks", 10,
                             "token visibility.timeSamples = { 1: \"invisible\", 2: \"inherited\" }\n") +
                 curves_prim("never", 11,
                             "token visibility.timeSamples = { 1: \"invisible\", 2: \"invisible\" }\n")));
    std::vector<std::string> warnings;
    EXPECT_EQ(read_curves(text, {}, &warnings), (std::vector<int>{1, 5, 9, 10}));
    EXPECT_EQ(warnings.size(), 4u);
    EXPECT_TRUE(says(
        warnings, "the curves /G/guides, /G/grid/guides2 are left out, as they have the purpose guide; prims "
                  "= [\"/G/guides\"] reads them"));
    EXPECT_TRUE(says(warnings, "/G/proxy are left out"));
    EXPECT_TRUE(says(
        warnings, "the curves /G/old, /G/hidden/below, /G/hidden/deep/deeper, /G/never are left out, as they "
                  "are invisible"));
    EXPECT_TRUE(says(warnings,
                     "1 prim of curves changes its visibility over time, which is not followed, and "
                     "is read at all times: /G/blinks: prims = [\"/G/blinks\"] reads it without this "
                     "line"));
    // By path, by name, and all below a parent, whatever flags it or they have or inherit.
    EXPECT_EQ(read_curves(text, {"/G/guides"}, &warnings), std::vector<int>{2});
    EXPECT_TRUE(warnings.empty());
    EXPECT_EQ(read_curves(text, {"proxy", "hair"}), (std::vector<int>{1, 3}));
    EXPECT_EQ(read_curves(text, {"/G/hidden"}), (std::vector<int>{6, 7}));
    EXPECT_EQ(read_curves(text, {"grid"}), (std::vector<int>{8, 9}));
    for (const char* all : {"/G", "G", "/G/", "/"}) {
        EXPECT_EQ(read_curves(text, {all}, &warnings), (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}));
        EXPECT_TRUE(warnings.empty()) << all;
    }
    EXPECT_EQ(read_curves(text, {"/G/hidden/", "hair//"}), (std::vector<int>{1, 6, 7}));
    EXPECT_EQ(refused_with(text, {"G/hair"}),
              "a.usda: prims has \"G/hair\", which is a path without its first slash: write \"/G/hair\"");
    EXPECT_EQ(refused_with(text, {"/G/hair", "G/grid/"}),
              "a.usda: prims has \"G/grid/\", which is a path without its first slash: write \"/G/grid\"");
    EXPECT_EQ(
        refused_with(text, {"hair", "/G/gone"}),
        "a.usda: prims has \"/G/gone\", which is or holds no BasisCurves: choose among /G/hair, /G/guides, "
        "/G/proxy, /G/old and 7 more");
    EXPECT_EQ(refused_with(usda_layer(curves_prim("g", 1, guide))),
              "a.usda: the curves /g are left out, as they have the "
              "purpose guide: name those to read: prims = [\"/g\"]");
}

TEST(UsdaCurves, VisibilityThatChangesIsOneLine) {
    const auto timed = [](const char* samples) {
        return fmt::format("token visibility.timeSamples = {{ {} }}\n", samples);
    };
    const std::string text =
        usda_layer(xform_prim("A", timed("1: \"inherited\", 5: \"invisible\"") + curves_prim("a", 1) +
                                       curves_prim("b", 2) +
                                       curves_prim("never", 3, "token visibility = \"invisible\"\n")) +
                   xform_prim("B", timed("1: \"inherited\", 5: \"inherited\"") + curves_prim("c", 4)));
    std::vector<std::string> warnings;
    EXPECT_EQ(read_curves(text, {}, &warnings), (std::vector<int>{1, 2, 4}));
    ASSERT_EQ(warnings.size(), 2u);
    EXPECT_TRUE(says(warnings,
                     "2 prims of curves change their visibility over time, which is not followed, and "
                     "are read at all times: /A/a, /A/b: prims = [\"/A/a\", \"/A/b\"] reads them "
                     "without this line"))
        << warnings[0];
    EXPECT_EQ(read_curves(text, {"a"}, &warnings), std::vector<int>{1});
    EXPECT_TRUE(warnings.empty());
}

TEST(UsdaCurves, ContentFromElsewhereIsOneLineEach) {
    const std::string text = usda_layer(
        "def Xform \"a\" (\n    prepend references = @b.usda@</b>\n    payload = @c.usda@\n)\n{\n" +
            curves_prim("hair", 1) + "variantSet \"cut\" = {\n\"long\" {\n" + curves_prim("more", 2) +
            "}\n}\n" +
            "}\ndef Xform \"b\" ( references = @b.usda@ )\n{\n}\ndef Xform \"c\" ( references = None\n "
            "delete "
            "payload = @x.usda@\n inherits = [] )\n{\n}\n" +
            curves_prim("d", 3, "float[] widths.connect = </a.w>\n") +
            "def Material \"m\"\n{\ntoken outputs:surface.connect = </m/s.out>\n}\n",
        "subLayers = [ @more.usda@ ]\n");
    std::vector<std::string> warnings;
    EXPECT_EQ(read_curves(text, {}, &warnings), (std::vector<int>{1, 3}));
    EXPECT_EQ(warnings.size(), 5u);
    for (const char* what :
         {"\"subLayers\" (line 3) is not followed: what it brings is missing",
          "\"references\" (2 times, first in line 6) is not followed", "\"payload\" (line 7)",
          "\"variantSet\" (line 16)", "\"connect\" (line 40) is not followed: attributes have"})
        EXPECT_TRUE(says(warnings, what)) << what << "\n" << fmt::format("{}", fmt::join(warnings, "\n"));
}

TEST(UsdaCurves, ShortCurvesAndPlainWidthsAreRead) {
    const auto curves = [&](const std::string& kind, const std::string& counts, int points,
                            const std::string& more) {
        std::string text = "def BasisCurves \"c\"\n{\n" + kind + "int[] curveVertexCounts = [" + counts +
                           "]\npoint3f[] points = [";
        for (int i = 0; i < points; ++i) text += fmt::format("{}({}, 0, 0)", i > 0 ? ", " : "", i);
        return usda_layer(text + "]\n" + more + "}\n");
    };
    const std::string bezier = "uniform token type = \"cubic\"\n",
                      pinned =
                          bezier + "uniform token basis = \"catmullRom\"\nuniform token wrap = \"pinned\"\n",
                      spline = bezier + "uniform token basis = \"bspline\"\n",
                      values =
                          "float[] primvars:v = [0, 1, 2, 3, 4, 5, 6, 7, 8] ( interpolation = \"vertex\" )\n"
                          "int[] primvars:u = [0, 1, 2] ( interpolation = \"uniform\" )\n";
    for (const std::string& kind : {std::string(linear_kind), bezier, pinned, spline}) {
        const StrandFile strands = strands_of(curves(kind, "4, 1, 4", 9, values));
        ASSERT_EQ(strands.counts.size(), 2u) << kind;
        EXPECT_TRUE(says(strands.warnings, "1 of 3 strands have fewer than two points: they are left out"))
            << kind;
        const std::vector<float>& v = find_attribute(strands.attributes, "v")->values;
        EXPECT_EQ(strands.samples[0].points.size(), v.size());
        for (size_t i = 0; i < v.size(); ++i) EXPECT_EQ(strands.samples[0].points[i].x(), v[i]) << kind;
        EXPECT_EQ(find_attribute(strands.attributes, "u")->values, (std::vector<float>{0, 2})) << kind;
    }
    EXPECT_EQ(strands_of(curves(linear_kind, "0, 3", 3, "")).counts, std::vector<uint32_t>{3});
    EXPECT_NE(refused_with(curves(linear_kind, "1, 1", 2, "")).find("has no strand of two points"),
              std::string::npos);
    EXPECT_NE(refused_with(curves(bezier, "3, 4", 7, "")).find("has 3 vertices"), std::string::npos);
    // Widths without an interpolation: per vertex, one for all, one for each curve.
    const auto widths = [&](const std::string& list) {
        return strands_of(curves(linear_kind, "3, 3", 6, "float[] widths = [" + list + "]\n"))
            .samples[0]
            .widths;
    };
    EXPECT_EQ(widths("1, 2, 3, 4, 5, 6"), (std::vector<float>{1, 2, 3, 4, 5, 6}));
    EXPECT_EQ(widths("7"), std::vector<float>(6, 7.0F));
    EXPECT_EQ(widths("1, 2"), (std::vector<float>{1, 1, 1, 2, 2, 2}));
    EXPECT_NE(
        refused_with(curves(linear_kind, "3, 3", 6, "float[] widths = [1, 2, 3]\n")).find("has 3 widths"),
        std::string::npos);
    EXPECT_NE(
        refused_with(curves(linear_kind, "3, 3", 6, "float[] widths = [1] ( interpolation = \"vertex\" )\n"))
            .find("has 1 widths"),
        std::string::npos);
}

Vec3d strand_cv(const StrandFile& strands, int64_t i) { // with phantom ones at both ends, of the first curve
    const auto at = [&](int64_t k) { return Vec3d(strands.samples[0].points[size_t(k)].cast<double>()); };
    const auto last = int64_t(strands.counts[0]) - 1;
    if (i < 0) return 2.0 * at(0) - at(1);
    return i > last ? Vec3d(2.0 * at(last) - at(last - 1)) : at(i);
}

// Calls visit(point) along the Catmull-Rom curve through the first strand.
template <typename Visit>
void along_first(const StrandFile& strands, Visit&& visit) {
    for (int64_t j = 0; j + 1 < int64_t(strands.counts[0]); ++j)
        for (double u = 0.0; u <= 1.0; u += 1.0 / 32.0) {
            const auto weights = cubic_basis(MARRAM_CATMULL_ROM, u).value;
            Vec3d p = Vec3d::Zero();
            for (int64_t k = 0; k < 4; ++k) p += weights[size_t(k)] * strand_cv(strands, j + k - 1);
            visit(p);
        }
}

TEST(UsdaCurves, PrimsOfDifferentBasesAreJoined) {
    const std::string spline = "def BasisCurves \"s\"\n{\nuniform token type = \"cubic\"\nuniform token "
                               "basis = \"bspline\"\nuniform token wrap "
                               "= \"pinned\"\nint[] curveVertexCounts = [4]\npoint3f[] points = [(0, 0, 0), "
                               "(0, 1, 0), (1, 1, 0), (1, 2, 0)]\n"
                               "float[] widths = [1, 2, 3, 4] ( interpolation = \"vertex\" )\n}\n";
    const StrandFile alone = strands_of(usda_layer(spline));
    EXPECT_EQ(alone.basis, MARRAM_BSPLINE);
    EXPECT_TRUE(alone.warnings.empty());
    const StrandFile both = strands_of(usda_layer(spline + curves_prim("brows", 5)));
    EXPECT_EQ(both.basis, MARRAM_CATMULL_ROM);
    ASSERT_EQ(both.counts.size(), 2u);
    EXPECT_EQ(both.counts[1], 2u);
    EXPECT_TRUE(says(both.warnings, "the B-splines become Catmull-Rom curves"));
    EXPECT_LE(both.deviation, 3e-3);               // a thousandth of the length, which is below 3
    EXPECT_EQ(strand_cv(both, 0), Vec3d(0, 0, 0)); // pinned: begins and ends in its vertices
    EXPECT_EQ(strand_cv(both, int64_t(both.counts[0]) - 1), Vec3d(1, 2, 0));
    EXPECT_EQ(both.samples[0].widths.front(), 1.0F);
    double worst = 0.0;
    along_first(both, [&](const Vec3d& p) { // against the B-spline itself
        double nearest = 1e9;
        for (int64_t j = 0; j < 3; ++j)
            for (double u = 0.0; u <= 1.0; u += 1.0 / 128.0) {
                const auto weights = cubic_basis(MARRAM_BSPLINE, u).value;
                Vec3d q = Vec3d::Zero();
                for (int64_t k = 0; k < 4; ++k) q += weights[size_t(k)] * strand_cv(alone, j + k - 1);
                nearest = std::min(nearest, (p - q).norm());
            }
        worst = std::max(worst, nearest);
    });
    EXPECT_LT(worst, both.deviation + 1e-3);
    // Polylines are drawn as Catmull-Rom curves: nothing changes but the name.
    const std::string through =
        "def BasisCurves \"t\"\n{\nuniform token type = \"cubic\"\nuniform token basis = "
        "\"catmullRom\"\nuniform token wrap = \"pinned\"\nint[] curveVertexCounts = [2]\n"
        "point3f[] points = [(0, 0, 0), (0, 1, 0)]\n}\n";
    const StrandFile same = strands_of(usda_layer(curves_prim("brows", 5) + through));
    EXPECT_EQ(same.basis, MARRAM_CATMULL_ROM);
    EXPECT_EQ(same.counts, (std::vector<uint32_t>{2, 2}));
    EXPECT_TRUE(same.warnings.empty());
}

TEST(UsdaCurves, CornersOfBeziersAreKept) {
    const StrandFile strands =
        strands_of(usda_layer("def BasisCurves \"twig\"\n{\nuniform token type = "
                              "\"cubic\"\nuniform token basis = \"bezier\"\nint[] "
                              "curveVertexCounts = [7]\npoint3f[] points = [(0, 0, 0), (0, "
                              "0.2, 0), (0, 0.4, 0), (0, 0.5, 0), (0.2, 0.5, 0), "
                              "(0.4, 0.5, 0), (0.5, 0.5, 0)]\nfloat[] primvars:t = [0, 1, "
                              "2] ( interpolation = \"varying\" )\n}\n"));
    EXPECT_TRUE(strands.warnings.empty());
    EXPECT_LE(strands.counts[0], 9u); // equal pieces would need more than 17
    EXPECT_EQ(std::ranges::count(strands.samples[0].points, Vec3f(0, 0.5F, 0)), 1);
    double worst = 0.0;
    along_first(strands, [&](const Vec3d& p) {
        const double up = (p - Vec3d(0, std::clamp(p.y(), 0.0, 0.5), 0)).norm(),
                     across = (p - Vec3d(std::clamp(p.x(), 0.0, 0.5), 0.5, 0)).norm();
        worst = std::max(worst, std::min(up, across));
    });
    EXPECT_LT(worst, 1e-3); // of a length of 1
    EXPECT_LE(worst, 1.02 * strands.deviation);
    const std::vector<float>& t = find_attribute(strands.attributes, "t")->values;
    EXPECT_TRUE(std::ranges::is_sorted(t));
    EXPECT_EQ(t.back(), 2.0F);
}

TEST(UsdaCurves, CountsMayChangeOverTime) {
    const std::string text = usda_layer(
        std::string("def BasisCurves \"c\"\n{\n") + linear_kind +
            "int[] curveVertexCounts.timeSamples = { 1: [], 2: [2], 3: [2, 1, 2] }\npoint3f[] "
            "points.timeSamples = { 1: "
            "[], 2: [(0, 0, 0), (0, 1, 0)], 3: [(0, 0, 1), (0, 1, 1), (9, 9, 9), (2, 0, 1), (2, 1, 1)] }\n"
            "float[] widths = [0.5] ( interpolation = \"constant\" )\nfloat[] primvars:n.timeSamples = { 1: "
            "[], 2: [4], 3: "
            "[5, 6, 7] } ( interpolation = \"uniform\" )\n}\n",
        "timeCodesPerSecond = 12\n");
    const StrandFile strands = strands_of(text);
    ASSERT_EQ(strands.takes.size(), 3u);
    const std::vector<std::vector<uint32_t>> counts = {{}, {2}, {2, 2}};
    for (size_t i = 0; i < 3; ++i) {
        const StrandFile& take = strands.takes[i];
        EXPECT_EQ(take.counts, counts[i]);
        ASSERT_EQ(take.samples.size(), 1u);
        EXPECT_EQ(take.samples[0].frame, 2.0 * double(i + 1)); // 12 time codes a second, 24 frames
        ASSERT_EQ(take.attributes.size(), 1u);
    }
    EXPECT_EQ(strands.takes[2].samples[0].points,
              (std::vector<Vec3f>{{0, 0, 1}, {0, 1, 1}, {2, 0, 1}, {2, 1, 1}}));
    EXPECT_EQ(strands.takes[2].attributes[0].values, (std::vector<float>{5, 7}));
    EXPECT_EQ(strands.takes[1].samples[0].widths, (std::vector<float>{0.5F, 0.5F}));
    EXPECT_TRUE(says(strands.warnings, "1 of 3 strands"));
    // Another prim that has no curves at first, and a primvar of its own: 0 where it lacks.
    const StrandFile two =
        strands_of(text + "def BasisCurves \"d\"\n{\n" + linear_kind +
                   "int[] curveVertexCounts.timeSamples = { 2: [], 3: [2] }\npoint3f[] "
                   "points.timeSamples = { 2: [], 3: [(5, 0, 0), (5, 1, 0)] }\nfloat primvars:y = 8\n}\n");
    ASSERT_EQ(two.takes.size(), 3u);
    const std::vector<std::vector<float>> y = {{}, {0}, {0, 0, 8}};
    for (size_t i = 0; i < 3; ++i) EXPECT_EQ(find_attribute(two.takes[i].attributes, "y")->values, y[i]) << i;
}

} // namespace
} // namespace marram
