// SPDX-License-Identifier: Apache-2.0
// Curves from files: .obj, .ply of three kinds in three formats, .usda with every basis and wrap; and
// truncated or inconsistent files.
#include "core/read/polylines.h"
#include "core/read/usda/usda.h"
#include "core/read/usda/usda_curves.h"
#include "core/write/curve_export.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct Polylines : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_polylines_test_" + std::to_string(::getpid()));
    Polylines() { fs::create_directories(folder); }
    ~Polylines() override { fs::remove_all(folder); }

    std::string write(const std::string& name, const std::string& bytes) const {
        std::ofstream(folder / name, std::ios::binary) << bytes;
        return (folder / name).string();
    }
    std::vector<Polyline> load(const std::string& name, const std::string& bytes) const {
        return load_polylines(write(name, bytes));
    }
    // The error for a refused file; "" if it is read.
    std::string refusal(const std::string& name, const std::string& bytes) const {
        try {
            load(name, bytes);
        } catch (const InputError& error) {
            EXPECT_EQ(error.problems.size(), 1u);
            const Problem& problem = error.problems.at(0);
            EXPECT_TRUE(problem.place.file.ends_with(name) && !problem.what.empty() && !problem.fix.empty());
            return to_string(problem);
        }
        return "";
    }
    void expect_refusal(const std::string& name, const std::string& bytes, const std::string& what) const {
        const std::string said = refusal(name, bytes);
        EXPECT_NE(said.find(what), std::string::npos) << said << "\n" << bytes.substr(0, 400);
    }
    // Every prefix of the file is read or refused in one line; at most `whole` of them are read.
    void expect_cuts(const std::string& name, const std::string& bytes, int whole) const {
        int read = 0;
        for (size_t size = 0; size < bytes.size(); ++size)
            read += refusal(name, bytes.substr(0, size)).empty();
        EXPECT_LE(read, whole) << name;
    }
};

std::vector<std::vector<Vec3d>> points_of(const std::vector<Polyline>& lines) {
    std::vector<std::vector<Vec3d>> all;
    for (const Polyline& line : lines) all.push_back(line.points);
    return all;
}

// ---- PLY

// A number of a PLY type in a format.
std::string ply_number(const std::string& format, const std::string& type, double value) {
    if (format == "ascii") return fmt::format("{} ", value);
    std::string bytes;
    const auto put = [&](auto number) {
        bytes.assign(reinterpret_cast<const char*>(&number), sizeof number);
        if (format == "binary_big_endian") std::ranges::reverse(bytes);
    };
    if (type == "float") put(float(value));
    if (type == "double") put(value);
    if (type == "int") put(int32_t(value));
    if (type == "ushort") put(uint16_t(value));
    return bytes;
}

struct PlyTable {
    std::string name;
    std::vector<std::pair<std::string, std::string>> properties; // type, name
    std::vector<std::vector<double>> rows;
};

std::string ply(const std::string& format, const std::vector<PlyTable>& tables) {
    std::string text = "ply\nformat " + format + " 1.0\n", body;
    for (const PlyTable& table : tables) {
        text += fmt::format("element {} {}\n", table.name, table.rows.size());
        for (const auto& [type, name] : table.properties) text += fmt::format("property {} {}\n", type, name);
        for (const std::vector<double>& row : table.rows) {
            for (size_t i = 0; i < row.size(); ++i)
                body += ply_number(format, table.properties[i].first, row[i]);
            if (format == "ascii") body += "\n";
        }
    }
    return text + "end_header\n" + body;
}

constexpr const char* ply_formats[] = {"ascii", "binary_little_endian", "binary_big_endian"};

const PlyTable six_vertices = {
    "vertex",
    {{"double", "x"}, {"float", "shade"}, {"double", "y"}, {"float", "z"}},
    {{0.1, 9, 0, 0}, {1, 9, 0.5, 0}, {2, 9, 0, 3}, {3, 9, 0, 1}, {4, 9, 0, 0}, {5, 9, 0, 0.25}}};
const std::vector<Vec3d> six_points = {{0.1, 0, 0}, {1, 0.5, 0}, {2, 0, 3},
                                       {3, 0, 1},   {4, 0, 0},   {5, 0, 0.25}};

TEST_F(Polylines, PlyIsOneCurveWithoutMore) {
    for (const char* format : ply_formats) {
        const auto lines = load("a.ply", ply(format, {six_vertices}));
        ASSERT_EQ(lines.size(), 1u) << format;
        EXPECT_EQ(lines[0].points, six_points);
        EXPECT_FALSE(lines[0].closed);
    }
}

TEST_F(Polylines, PlyFollowsEdges) {
    // The edges make the line 2 - 0 - 4, given out of order, and the ring 3 - 5 - 6; vertex 1 has no edge.
    PlyTable vertices = six_vertices;
    vertices.rows.push_back({6, 0, 0, 7});
    const PlyTable edges = {
        "edge", {{"int", "vertex1"}, {"ushort", "vertex2"}}, {{0, 4}, {3, 5}, {2, 0}, {5, 6}, {6, 3}}};
    for (const char* format : ply_formats) {
        const auto lines = load("a.PLY", ply(format, {vertices, edges}));
        ASSERT_EQ(lines.size(), 2u);
        EXPECT_EQ(lines[0].points, (std::vector<Vec3d>{six_points[2], six_points[0], six_points[4]}));
        EXPECT_FALSE(lines[0].closed);
        EXPECT_EQ(lines[1].points, (std::vector<Vec3d>{six_points[3], six_points[5], {6, 0, 7}}));
        EXPECT_TRUE(lines[1].closed);
    }
}

TEST_F(Polylines, PlyGroupsByStrandId) {
    for (const char* name : {"strand_id", "curve_id"})
        for (const char* format : ply_formats) {
            PlyTable vertices = six_vertices;
            vertices.properties.insert(vertices.properties.begin(), {"int", name});
            const double ids[] = {7, -2, 7, -2, 7, 100};
            for (size_t v = 0; v < 6; ++v) vertices.rows[v].insert(vertices.rows[v].begin(), ids[v]);
            const auto lines = load("a.ply", ply(format, {vertices}));
            ASSERT_EQ(lines.size(), 3u);
            EXPECT_EQ(lines[0].points, (std::vector<Vec3d>{six_points[0], six_points[2], six_points[4]}));
            EXPECT_EQ(lines[1].points, (std::vector<Vec3d>{six_points[1], six_points[3]}));
            EXPECT_EQ(lines[2].points.size(), 1u);
        }
}

TEST_F(Polylines, PlyRefusesWhatIsNoCurve) {
    const auto with_edges = [&](std::vector<std::vector<double>> rows) {
        return ply("ascii",
                   {six_vertices, {"edge", {{"int", "vertex1"}, {"int", "vertex2"}}, std::move(rows)}});
    };
    expect_refusal("a.ply", with_edges({{0, 1}, {0, 2}, {3, 0}}), "vertex 0 has three edges");
    expect_refusal("a.ply", with_edges({{0, 6}}), "a.ply:18:3: edge 0: vertex index 6 is out of range");
    expect_refusal("a.ply", with_edges({{0, -1}}), "out of range");
    expect_refusal("a.ply", with_edges({{1, 1}}), "joins a vertex to itself");
    expect_refusal("a.ply", with_edges({{0, 1}, {1, 0}}), "joins a vertex to itself");
    PlyTable ids = six_vertices;
    ids.properties[1] = {"float", "strand_id"};
    expect_refusal("a.ply", ply("ascii", {ids}), "\"strand_id\" is no whole number");
    ids.properties[1] = {"int", "strand_id"};
    ids.rows[3][1] = 1.5;
    expect_refusal("a.ply", ply("ascii", {ids}), "\"strand_id\" is 1.5");
    PlyTable far = six_vertices;
    far.rows[2][0] = 1.0001e8;
    expect_refusal("a.ply", ply("ascii", {far}), "beyond 1e8");
    far.rows[2][0] = 1e8;
    EXPECT_EQ(refusal("a.ply", ply("ascii", {far})), "");
    for (const double value : {double(INFINITY), double(NAN)}) {
        far.rows[2][0] = value;
        expect_refusal("a.ply", ply("binary_big_endian", {far}), "vertex 2: \"x\" is not a finite number");
    }
    const PlyTable face = {"face", {{"int", "a"}}, {{0}}};
    expect_refusal("a.ply", ply("ascii", {six_vertices, face}), "is a mesh");
    expect_refusal("a.ply",
                   ply("ascii", {{"edge", {{"int", "vertex1"}, {"int", "vertex2"}}, {{0, 1}}}, six_vertices}),
                   "the edges stand before the vertices");
    expect_refusal("a.ply", ply("ascii", {face}), "no element \"vertex\"");
    const std::string head =
        "ply\nformat binary_little_endian 1.0\nelement vertex 4294967290\nproperty float x\n"
        "property float y\nproperty float z\n";
    expect_refusal("a.ply", head + "end_header\n", "do not fit");
    expect_refusal(
        "a.ply",
        "ply\nformat ascii 1.0\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nelement vertex "
        "4294967290\nproperty int x\nproperty int y\nproperty int z\nend_header\n0 1\n",
        "the edges stand before the vertices");
    for (const char* format : ply_formats)
        expect_cuts(
            "a.ply",
            ply(format, {six_vertices, {"edge", {{"int", "vertex1"}, {"int", "vertex2"}}, {{0, 1}, {1, 2}}}}),
            2); // without the last blank, and without the last line end
}

// ---- USD

const std::string usda_head = "#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n";

std::string usda_curves(const std::string& more, const std::string& points, const std::string& counts) {
    return "def BasisCurves \"c\" {\n" + more + "\nint[] curveVertexCounts = " + counts +
           "\npoint3f[] points = " + points + "\n}\n";
}

std::string basis_text(const char* type, const char* basis, const char* wrap) {
    return fmt::format(
        "uniform token type = \"{}\"\nuniform token basis = \"{}\"\nuniform token wrap = \"{}\"", type, basis,
        wrap);
}

// The recursions of De Casteljau, de Boor, and Barry and Goldman, independent of the reader's matrices.
Vec3d blend(const Vec3d& a, const Vec3d& b, double t) { return a + t * (b - a); }
Vec3d cubic_at(const std::string& basis, const std::array<Vec3d, 4>& p, double t) {
    if (basis == "bezier") {
        const Vec3d a = blend(p[0], p[1], t), b = blend(p[1], p[2], t), c = blend(p[2], p[3], t);
        return blend(blend(a, b, t), blend(b, c, t), t);
    }
    // Knots -2 ... 3 of a uniform B-spline; knots -1 ... 2 of a Catmull-Rom spline.
    const auto between = [&](double from, double to) { return (t - from) / (to - from); };
    if (basis == "bspline") {
        const Vec3d a = blend(p[0], p[1], between(-2, 1)), b = blend(p[1], p[2], between(-1, 2)),
                    c = blend(p[2], p[3], between(0, 3));
        return blend(blend(a, b, between(-1, 1)), blend(b, c, between(0, 2)), t);
    }
    const Vec3d a = blend(p[0], p[1], between(-1, 0)), b = blend(p[1], p[2], t),
                c = blend(p[2], p[3], between(1, 2));
    return blend(blend(a, b, between(-1, 1)), blend(b, c, between(0, 2)), t);
}

const std::vector<Vec3d> seven = {{0, 0, 0},  {1, 2, 0},  {3, 2, 1}, {4, 0, 1},
                                  {5, -2, 0}, {7, -1, 2}, {8, 0, 0}};
std::string text_of(std::span<const Vec3d> points) {
    std::string text = "[";
    for (const Vec3d& p : points) text += fmt::format("({}, {}, {}), ", p.x(), p.y(), p.z());
    return text + "]";
}

TEST_F(Polylines, UsdaEveryBasisAndWrap) {
    for (const std::string basis : {"bezier", "bspline", "catmullRom"})
        for (const std::string wrap : {"nonperiodic", "periodic", "pinned"}) {
            const bool is_bezier = basis == "bezier", ring = wrap == "periodic",
                       pinned = wrap == "pinned" && !is_bezier;
            const int n = is_bezier && ring ? 6 : 7;
            const std::span points(seven.data(), size_t(n));
            const auto lines =
                load("a.usda", usda_head + usda_curves(basis_text("cubic", basis.c_str(), wrap.c_str()),
                                                       text_of(points), fmt::format("[{}]", n)));
            ASSERT_EQ(lines.size(), 1u);
            const int cubics = is_bezier ? 2 : ring ? 7 : pinned ? 6 : 4;
            ASSERT_EQ(lines[0].points.size(), size_t(cubics * usda_points_a_segment + !ring))
                << basis << wrap;
            EXPECT_EQ(lines[0].closed, ring);
            for (size_t i = 0; i < lines[0].points.size(); ++i) {
                const int cubic = std::min(int(i) / usda_points_a_segment, cubics - 1);
                std::array<Vec3d, 4> p;
                for (int k = 0; k < 4; ++k) {
                    const int v = cubic * (is_bezier ? 3 : 1) + k - pinned;
                    p[size_t(k)] = v < 0    ? Vec3d(2.0 * seven[0] - seven[1])
                                   : v == n ? ring ? seven[0] : Vec3d(2.0 * seven[6] - seven[5])
                                            : seven[size_t(v % n)];
                }
                const double t = double(i) / usda_points_a_segment - cubic;
                ASSERT_LT((lines[0].points[i] - cubic_at(basis, p, t)).norm(), 1e-14) << basis << wrap << i;
            }
            if (pinned || (is_bezier && !ring)) {
                EXPECT_EQ(lines[0].points.front(), seven.front());
                EXPECT_EQ(lines[0].points.back(), seven.back());
            }
        }
    for (const std::string wrap : {"nonperiodic", "periodic", "pinned"}) {
        const auto lines =
            load("a.usda", usda_head + usda_curves(basis_text("linear", "bezier", wrap.c_str()),
                                                   text_of(seven), "[3, 4]"));
        ASSERT_EQ(lines.size(), 2u);
        EXPECT_EQ(lines[0].points, std::vector<Vec3d>(seven.begin(), seven.begin() + 3));
        EXPECT_EQ(lines[1].points, std::vector<Vec3d>(seven.begin() + 3, seven.end()));
        EXPECT_EQ(lines[0].closed, wrap == "periodic");
    }
    // USD's defaults: cubic, bezier, nonperiodic.
    EXPECT_EQ(load("a.usda", usda_head + usda_curves("", text_of(seven), "[7]"))[0].points.size(), 17u);
}

std::string prim(const std::string& name, const std::string& ops, const std::string& inside,
                 const std::string& type = "Xform") {
    return "def " + type + " \"" + name + "\" {\n" + ops + "\n" + inside + "}\n";
}

const std::string one_line = usda_curves("uniform token type = \"linear\"", "[(1, 2, 3), (0, 0, 0)]", "[2]");

TEST_F(Polylines, UsdaHonoursTransforms) {
    const auto first = [&](const std::string& text) { return load("a.usda", usda_head + text)[0].points[0]; };
    const auto near = [](const Vec3d& a, const Vec3d& b) { return (a - b).norm() < 1e-12; };
    // Translate is outermost of the three: scale, then rotate, then translate.
    const std::string all =
        "double3 xformOp:translate = (10, 0, 0)\nfloat xformOp:rotateY = 90\n"
        "float3 xformOp:scale = (2, 2, 2)\nuniform token[] xformOpOrder = [\"xformOp:translate\", "
        "\"xformOp:rotateY\", \"xformOp:scale\"]";
    EXPECT_TRUE(near(first(prim("a", all, one_line)), {16, 4, -2}));
    // The parent's transform is applied after its child's.
    EXPECT_TRUE(near(
        first(prim("p",
                   "float3 xformOp:scale = (1, 10, 1)\nuniform token[] xformOpOrder = [\"xformOp:scale\"]",
                   prim("a", all, one_line))),
        {16, 40, -2}));
    EXPECT_TRUE(near(
        first(prim("p", all, prim("a", "uniform token[] xformOpOrder = [\"!resetXformStack!\"]", one_line))),
        {1, 2, 3}));
    // X first, then Y, then Z: (1, 2, 3) -> (1, -3, 2) -> (2, -3, -1) -> (3, 2, -1).
    EXPECT_TRUE(near(first(prim("a",
                                "float3 xformOp:rotateXYZ = (90, 90, 90)\nuniform token[] xformOpOrder = "
                                "[\"xformOp:rotateXYZ\"]",
                                one_line)),
                     {3, 2, -1}));
    // Z first: (1, 2, 3) -> (-2, 1, 3) -> (3, 1, 2) -> (3, -2, 1).
    EXPECT_TRUE(
        near(first(prim("a",
                        "float3 xformOp:rotateZYX:named = (90, 90, 90)\nuniform token[] xformOpOrder = "
                        "[\"xformOp:rotateZYX:named\"]",
                        one_line)),
             {3, -2, 1}));
    // A matrix for row vectors: its last row translates.
    EXPECT_TRUE(
        near(first(prim(
                 "a",
                 "matrix4d xformOp:transform = ( (0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, 1) )\n"
                 "uniform token[] xformOpOrder = [\"xformOp:transform\"]",
                 one_line)),
             {3, 7, 10}));
    EXPECT_TRUE(near(first(prim("a",
                                "quatf xformOp:orient = (0.70710678118654752, 0, 0, 0.70710678118654752)\n"
                                "uniform token[] xformOpOrder = [\"xformOp:orient\"]",
                                one_line)),
                     {-2, 1, 3}));
    // A pivot: translate, rotate, translate back.
    EXPECT_TRUE(
        near(first(prim(
                 "a",
                 "double3 xformOp:translate:pivot = (1, 0, 0)\ndouble xformOp:rotateZ = 90\nuniform token[] "
                 "xformOpOrder = [\"xformOp:translate:pivot\", \"xformOp:rotateZ\", "
                 "\"!invert!xformOp:translate:pivot\"]",
                 one_line)),
             {-1, 0, 3}));
    // The earliest time sample is used. Ops that the order does not name are ignored.
    EXPECT_TRUE(near(first(prim("a",
                                "double3 xformOp:translate.timeSamples = { 1: (1, 1, 1), 2: (9, 9, 9), }\n"
                                "double3 xformOp:scale = (7, 7, 7)\n"
                                "uniform token[] xformOpOrder = [\"xformOp:translate\"]",
                                one_line)),
                     {2, 3, 4}));
    const auto refused = [&](const std::string& ops, const std::string& what) {
        expect_refusal("a.usda", usda_head + prim("a", ops, one_line), what);
    };
    refused("uniform token[] xformOpOrder = [\"xformOp:gone\"]", "\"xformOp:gone\", which is not there");
    refused("double3 xformOp:skew = (1, 1, 1)\nuniform token[] xformOpOrder = [\"xformOp:skew\"]",
            "is not read");
    refused("double3 xformOp:scale = (0, 1, 1)\nuniform token[] xformOpOrder = [\"!invert!xformOp:scale\"]",
            "has no inverse");
    refused("double3 xformOp:scale = (nan, 1, 1)\nuniform token[] xformOpOrder = [\"xformOp:scale\"]",
            "not finite");
    refused("matrix4d xformOp:transform = ((1,0,0,1), (0,1,0,0), (0,0,1,0), (0,0,0,1))\n"
            "uniform token[] xformOpOrder = [\"xformOp:transform\"]",
            "is a perspective");
}

TEST_F(Polylines, UsdaHonoursTheLayersUnitAndAxis) {
    const auto first = [&](const std::string& metadata) {
        return load("a.usda", "#usda 1.0\n(" + metadata + ")\n" + one_line)[0].points[0];
    };
    EXPECT_LT((first("metersPerUnit = 0.5; upAxis = \"Z\"") - Vec3d(0.5, 1.5, -1)).norm(), 1e-15);
    EXPECT_LT((first("upAxis = \"Y\"") - Vec3d(0.01, 0.02, 0.03)).norm(), 1e-15)
        << "centimetres: USD's own default";
    expect_refusal("a.usda", "#usda 1.0\n(upAxis = \"X\")\n" + one_line, "the upAxis is \"X\"");
    for (const char* unit : {"0", "-1", "nan", "many"})
        expect_refusal("a.usda", std::string("#usda 1.0\n(metersPerUnit = ") + unit + ")\n" + one_line,
                       "metersPerUnit is");
}

TEST_F(Polylines, UsdaReadsWhatOthersWrite) {
    // Comments, strings with brackets and quotes, references, variants, relationships, dictionaries,
    // primvars, connections.
    const std::string text = R"usd(#usda 1.0
(
    """A long comment: def "x" { ( [ """
    customLayerData = { string a = "}" ; dictionary b = { int c = 1 } }
    defaultPrim = "world"
    metersPerUnit = 1
    subLayers = [ @./a.usda@ (offset = 1; scale = 2), @@@b@c.usda@@@ ]
    upAxis = "Y"
) # a comment with { brackets

reorder rootPrims = ["world"]
over "materials" { def BasisCurves "not_there" { point3f[] points = [(0,0,0)] } }
class "_hidden" { }
def Xform "world" (
    prepend apiSchemas = ["A", "B"]
    references = @c.usda@</a/b> (offset = 3)
    variants = { string look = "x" }
    prepend variantSets = "look"
    kind = 'group'
)
{
    custom rel target = [</a>, </b>]
    prepend rel other = </a> (doc = "it's \"here\"")
    rel empty
    custom string note = "semi; \" colon"
    asset file = @a/b.png@
    bool on = true; float[] nothing = []
    token outputs:surface.connect = </a.outputs:surface>
    variantSet "look" = { "x" { def "y" { } } "z" ( a = 1 ) { } }
    double3 xformOp:scale.timeSamples = { }
    float[] empty.timeSamples = { 0: None, 1: [1, 2] }

    def Scope "inner"
    {
        def BasisCurves "hair" ( active = true )
        {
            float3[] extent = [(inf, inf, inf), (-inf, -inf, -inf)]
            int[] curveVertexCounts = [2, 3]
            point3f[] points.timeSamples = {
                1: [(0,0,0), (1,0,0), (2,0,0), (3,0,0), (4,0,1)],
                2.5: [(9,0,0), (1,0,0), (2,0,0), (3,0,0), (4,0,0)],
            }
            int64[] primvars:id = [9223372036854775807, -3] ( interpolation = "uniform" )
            texCoord2f[] primvars:st = [(0, 1), (0.5, .5)] ( interpolation = "uniform" )
            uniform token type = "linear"
            float[] widths = [0.5] ( interpolation = "constant" )
        }
        def BasisCurves "off" ( active = false ) { }
    }
}
def BasisCurves "second" { int[] curveVertexCounts = [2] point3d[] points = [(0,1,0), (1,1e0,-0.5E+1)] uniform token type = "linear" }
)usd";
    const auto lines = load("a.usda", text);
    ASSERT_EQ(lines.size(), 3u);
    EXPECT_EQ(lines[0].points, (std::vector<Vec3d>{{0, 0, 0}, {1, 0, 0}}));
    EXPECT_EQ(lines[1].points, (std::vector<Vec3d>{{2, 0, 0}, {3, 0, 0}, {4, 0, 1}}));
    EXPECT_EQ(lines[2].points, (std::vector<Vec3d>{{0, 1, 0}, {1, 1, -5}}));
    const auto curves = read_usda_curves("a.usda", text);
    ASSERT_EQ(curves.size(), 2u);
    EXPECT_EQ(curves[0].path, "/world/inner/hair");
    EXPECT_EQ(curves[0].widths, std::vector<double>{0.5});
    EXPECT_EQ(curves[0].width_interpolation, "constant");
    // The tree keeps what a reader of grooms needs.
    const UsdaLayer layer = read_usda("a.usda", text);
    const UsdaPrim& hair = layer.prims.at(2).children.at(0).children.at(0);
    const UsdaAttribute* of = nullptr;
    EXPECT_EQ(std::get<std::vector<int64_t>>(*hair.find("primvars:id", &of)),
              (std::vector<int64_t>{INT64_MAX, -3}));
    EXPECT_EQ(find_metadata(of->metadata, "interpolation"), "uniform");
    EXPECT_EQ(std::get<std::vector<double>>(*hair.find("primvars:st")),
              (std::vector<double>{0, 1, 0.5, 0.5}));
    hair.find("points", &of);
    ASSERT_EQ(of->samples.size(), 2u);
    EXPECT_EQ(of->samples[1].first, 2.5);
    EXPECT_EQ(std::get<std::vector<double>>(of->samples[1].second)[0], 9.0);
    // Without the last prim, cut before or after the line end; and the whole without its line end.
    expect_cuts("a.usda", text, 3);
}

TEST_F(Polylines, UsdaReadsOurOwnBakes) {
    std::vector<float> vertices;
    constexpr uint32_t cvs = 5;
    for (int i = 0; i < 2 * int(cvs + 2); ++i)
        for (const float v : {0.1f * float(i), std::sin(float(i)), 1.0f / float(i + 3), 0.01f})
            vertices.push_back(v);
    CurveGeometry geometry;
    geometry.name = "grass";
    geometry.curve_count = 2;
    geometry.cvs_per_curve = cvs;
    geometry.vertices = {vertices.data()};
    for (const MarramBasis basis : {MARRAM_BSPLINE, MARRAM_CATMULL_ROM}) {
        geometry.basis = basis;
        const std::string file = (folder / "bake.usda").string();
        write_usda(file, std::span(&geometry, 1), 1.0, 24.0);
        const auto lines = load_polylines(file);
        ASSERT_EQ(lines.size(), 2u);
        for (size_t c = 0; c < 2; ++c) {
            const auto cv = [&](size_t i) {
                const float* v = vertices.data() + (c * (cvs + 2) + 1 + i) * 4;
                return Vec3d(double(v[0]), double(v[1]), double(v[2]));
            };
            ASSERT_EQ(lines[c].points.size(), (cvs - 1) * size_t(usda_points_a_segment) + 1);
            EXPECT_EQ(lines[c].points.front(), cv(0));
            EXPECT_EQ(lines[c].points.back(), cv(cvs - 1));
            for (size_t i = 1; i + 1 < cvs; ++i) {
                const Vec3d on_curve =
                    basis == MARRAM_CATMULL_ROM ? cv(i) : Vec3d((cv(i - 1) + 4.0 * cv(i) + cv(i + 1)) / 6.0);
                EXPECT_LT((lines[c].points[i * usda_points_a_segment] - on_curve).norm(), 1e-14);
            }
        }
        std::ifstream text(file);
        expect_cuts("cut.usda", std::string(std::istreambuf_iterator<char>(text), {}), 1);
    }
}

TEST_F(Polylines, UsdaRefusesInOneLine) {
    const auto curves = [&](const std::string& more, const std::string& points, const std::string& counts,
                            const std::string& what) {
        expect_refusal("a.usda", usda_head + usda_curves(more, points, counts), what);
    };
    const std::string linear = "uniform token type = \"linear\"";
    curves(linear, "[(0,0,0), (1,0,0)]", "[3]", "add up to 3, there are 2 points");
    curves(linear, "[(0,0,0), (1,0,0)]", "[2147483647, 2147483647]", "add up to 4294967294");
    curves(linear, "[(0,0,0), (1,0,0)]", "[4294967299]", "8:28: 4294967299 is beyond the range of its type");
    curves(linear, "[(0,0,0), (1,0,0)]", "[99999999999999999999]", "beyond the range of its type");
    curves(linear, "[(0,0,0), (1,0,0)]", "[3, -1]", "has -1 vertices");
    curves(linear, "[(0,0,nan), (1,0,0)]", "[2]",
           "a.usda:9:1: point 0 of \"/c\" is not three finite numbers");
    curves(linear, "[(0,0,1e999), (1,0,0)]", "[2]", "not three finite numbers");
    curves(linear, "[(0,0,1.01e8), (1,0,0)]", "[2]", "beyond 1e8");
    curves(linear, "[(0,0), (1,0)]", "[2]", "an element of 2 numbers stands where 3");
    curves(linear, "[0, 0, 0]", "[1]", "an element of 1 numbers");
    curves(linear, "[(0 0 0)]", "[1]", "expected ',' or ')'");
    curves(linear, "None", "[2]", "have no points");
    curves("", "[(0,0,0), (1,0,0)]", "[2]", "curve 0 of \"/c\" has 2 vertices");
    curves(basis_text("cubic", "hermite", "pinned"), "[(0,0,0), (1,0,0)]", "[2]",
           "the basis \"hermite\" of curves");
    curves(linear + "\nfloat[] widths = [1, 2, 3]", "[(0,0,0), (1,0,0)]", "[2]", "has 3 widths but");
    curves(linear + "\nfloat[] widths = [1, -2]", "[(0,0,0), (1,0,0)]", "[2]", "width 1 of");
    curves("string type = \"linear\" string type2 =", "[(0,0,0), (1,0,0)]", "[2]", "");
    expect_refusal("a.usda", usda_head + "def Xform \"a\" { }\n", "has no BasisCurves of its own");
    expect_refusal("a.usda", "PXR-USDC\0\0", "is a binary USD file");
    expect_refusal("a.usda", "#usda 1.01\n", "another version");
    expect_refusal("a.usda", "v 0 0 0\n", "does not begin with");
    expect_refusal("a.usda", usda_head + "def Xform \"a\" { float x = }", "expected a number");
    expect_refusal("a.usda", usda_head + "def Xform \"a\" { float x.timeSamples = { 2: 1, 1: 2 } }",
                   "does not come after");
    expect_refusal("a.usda", usda_head + "def Xform \"a\" { string x = \"never ends }",
                   "this text does not end");
    std::string deep = usda_head;
    for (int i = 0; i < 100000; ++i) deep += "def\"a\"{";
    expect_refusal("a.usda", deep, "nested more than 256 deep");
    const std::string brackets(1000000, '(');
    expect_refusal("a.usda", usda_head + "def\"a\"{ dictionary d = " + brackets, "is not closed");
    expect_refusal("a.usda", usda_head + "def\"a\"{ float d = " + brackets, "expected ");
    std::string allowed = usda_head, end;
    for (int i = 0; i < 255; ++i) allowed += "def\"a\"{", end += "}";
    EXPECT_EQ(refusal("a.usda", allowed + one_line + end), "");
}

TEST_F(Polylines, UsdaTakesNoMoreRoomThanItNeeds) {
    std::string text = usda_head + "def \"a\" { float[] x = [";
    constexpr size_t count = 100001; // not a power of two
    for (size_t i = 0; i < count; ++i) text += "7,";
    text += "] }";
    const UsdaLayer layer = read_usda("a.usda", text);
    const auto& x = std::get<std::vector<double>>(*layer.prims.at(0).find("x"));
    ASSERT_EQ(x.size(), count);
    EXPECT_LE(x.capacity(), count + 1);
}

// ---- Other formats

TEST_F(Polylines, RefusesOtherFiles) {
    expect_refusal("a.abc", "Ogawa", "are not known");
    expect_refusal("a.obj", "v 0 0 0\n", "has no lines");
    expect_refusal("a.obj", "v 0 0 nan\nv 1 0 0\nl 1 2\n",
                   "a.obj:1:7: this vertex is not three finite numbers");
    EXPECT_THROW(load_polylines((folder / "gone.usda").string()), InputError);
    EXPECT_EQ(points_of(load("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nl 1 2 3\nl 3 1\n")),
              (std::vector<std::vector<Vec3d>>{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{2, 0, 0}, {0, 0, 0}}}));
}

} // namespace
} // namespace marram
