// SPDX-License-Identifier: Apache-2.0
// Strands from files: .hair with every flag, .usda with every basis, wrap and interpolation, .ply and .obj;
// written files are read back to the bit; truncated or inconsistent files are refused.
#include "core/geometry/cubic.h"
#include "core/read/hair_format.h"
#include "core/read/strand_file.h"
#include "core/read/usda/usda.h"
#include "core/read/usda/usda_curves.h"
#include "core/write/curve_export.h"
#include "tests/unit/files.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct StrandFiles : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_strand_test_" + std::to_string(::getpid()));
    StrandFiles() { fs::create_directories(folder); }
    ~StrandFiles() override { fs::remove_all(folder); }

    std::string path(const std::string& name) const { return (folder / name).string(); }
    std::string write(const std::string& name, const std::string& bytes) const {
        std::ofstream(folder / name, std::ios::binary) << bytes;
        return path(name);
    }
    std::string get(const std::string& name) const { return marram::read_file(folder / name); }
    StrandFile load(const std::string& name, const std::string& bytes) const {
        return load_strand_file(write(name, bytes), {24.0});
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
        for (size_t size = 0; size < bytes.size(); ++size) {
            const std::string cut = bytes.substr(0, size);
            try {
                if (name.ends_with(".usda"))
                    read_usda_strands(name, cut, {24.0});
                else if (name.ends_with(".ply"))
                    read_ply_strands(name, cut);
                else if (name.ends_with(".obj"))
                    read_obj_strands(name, cut);
                else
                    load(name, cut);
                ++read;
            } catch (const InputError& error) {
                ASSERT_EQ(error.problems.size(), 1u) << size;
            }
        }
        EXPECT_LE(read, whole) << name;
    }
};

const AttributeValues& attribute(const StrandFile& strands, std::string_view name) {
    const AttributeValues* found = find_attribute(strands.attributes, name);
    if (!found) throw std::runtime_error("no attribute " + std::string(name));
    return *found;
}

bool told(const StrandFile& strands, std::string_view what) {
    return std::ranges::any_of(strands.warnings, [&](const std::string& warning) {
        return warning.find(what) != std::string::npos;
    });
}

// Curves of 5, 2 and 3 CVs with widths, attributes of every kind, and numbers without a short decimal form.
struct Groom {
    std::vector<uint32_t> counts = {5, 2, 3};
    std::vector<float> vertices;
    CurveGeometry geometry;

    explicit Groom(MarramBasis basis = MARRAM_BSPLINE, float shift = 0.0F) {
        geometry.name = "fur";
        geometry.basis = basis;
        geometry.curve_count = counts.size();
        geometry.offsets = {0, 5, 7, 10};
        for (const uint32_t count : counts)
            for (uint32_t i = 0; i < count + 2; ++i) {
                const auto k = float(vertices.size() + 1);
                vertices.insert(vertices.end(), {k / 3.0F + shift, -0.1F * k, std::sin(k), 0.001F * k});
            }
        std::vector<float> twist, tint;
        for (int i = 0; i < 10; ++i) twist.push_back(0.7F / float(i + 1));
        for (int i = 0; i < 30; ++i) tint.push_back(std::cos(float(i)));
        geometry.attributes = {{"id", 1, MARRAM_PER_CURVE, {16777215.0F, 0.0F, 7.0F}, true},
                               {"root_uv", 2, MARRAM_PER_CURVE, {0.1F, 0.2F, 0.3F, 0.4F, 0.5F, 0.6F}},
                               {"twist", 1, MARRAM_PER_CV, twist},
                               {"tint", 3, MARRAM_PER_CV, tint}};
        geometry.vertices = {vertices.data()};
    }
    std::vector<float> cvs() const { // x, y, z, width
        std::vector<float> all;
        for (size_t c = 0; c < counts.size(); ++c)
            for (uint32_t i = 0; i < counts[c]; ++i) {
                const float* v = vertices.data() + 4 * (geometry.offsets[c] + 2 * c + 1 + i);
                all.insert(all.end(), {v[0], v[1], v[2], 2.0F * v[3]});
            }
        return all;
    }
};

std::vector<float> cvs_of(const StrandSample& sample) {
    std::vector<float> all;
    for (size_t i = 0; i < sample.points.size(); ++i) {
        const Vec3f& p = sample.points[i];
        all.insert(all.end(), {p.x(), p.y(), p.z(), sample.widths.empty() ? -1.0F : sample.widths[i]});
    }
    return all;
}

void expect_same_attributes(const std::vector<AttributeValues>& read,
                            const std::vector<AttributeValues>& written) {
    ASSERT_EQ(read.size(), written.size());
    for (const AttributeValues& one : written) {
        const AttributeValues* same = find_attribute(read, one.name);
        ASSERT_TRUE(same) << one.name;
        EXPECT_EQ(same->components, one.components) << one.name;
        EXPECT_EQ(same->rate, one.rate) << one.name;
        EXPECT_EQ(same->discrete, one.discrete) << one.name;
        EXPECT_EQ(same->values, one.values) << one.name;
    }
}

// ---- HAIR

template <typename Value>
void put(std::string& bytes, std::initializer_list<Value> values) {
    for (const Value value : values) bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::string hair(const HairHeader& header) { return {reinterpret_cast<const char*>(&header), sizeof header}; }

// Strands of 2 and 3 points, with all arrays.
std::string full_hair() {
    HairHeader header;
    header.strands = 2;
    header.points = 5;
    header.flags = 31;
    std::string bytes = hair(header);
    put<uint16_t>(bytes, {1, 2});
    for (int i = 0; i < 15; ++i) put<float>(bytes, {0.1F * float(i)});
    for (int i = 0; i < 5; ++i) put<float>(bytes, {0.01F * float(i)});
    for (int i = 0; i < 5; ++i) put<float>(bytes, {0.2F * float(i)});
    for (int i = 0; i < 15; ++i) put<float>(bytes, {1.0F / float(i + 1)});
    return bytes;
}

TEST_F(StrandFiles, HairWithEveryArray) {
    const StrandFile strands = load("a.hair", full_hair());
    EXPECT_EQ(strands.counts, (std::vector<uint32_t>{2, 3}));
    EXPECT_EQ(strands.basis, MARRAM_LINEAR);
    ASSERT_EQ(strands.samples.size(), 1u);
    EXPECT_EQ(strands.samples[0].points[4], Vec3f(0.1F * 12.0F, 0.1F * 13.0F, 0.1F * 14.0F));
    EXPECT_EQ(strands.samples[0].widths[3], 0.01F * 3.0F);
    EXPECT_EQ(attribute(strands, "transparency").values[2], 0.2F * 2.0F);
    EXPECT_EQ(attribute(strands, "color").components, 3u);
    EXPECT_EQ(attribute(strands, "color").rate, MARRAM_PER_CV);
    EXPECT_EQ(attribute(strands, "color").values[14], 1.0F / 15.0F);
    EXPECT_TRUE(strands.warnings.empty());
    expect_cuts("cut.hair", full_hair(), 0);
    expect_refusal("a.hair", full_hair() + "x", "bytes, the file has");
}

TEST_F(StrandFiles, HairWithDefaults) {
    HairHeader header;
    header.strands = 2;
    header.points = 6;
    header.flags = hair_points;
    header.default_segments = 2;
    std::string points;
    for (int i = 0; i < 18; ++i) put<float>(points, {float(i)});
    const StrandFile plain = load("a.hair", hair(header) + points);
    EXPECT_EQ(plain.counts, (std::vector<uint32_t>{3, 3}));
    EXPECT_TRUE(plain.samples[0].widths.empty() && plain.attributes.empty() && plain.warnings.empty());
    header.default_thickness = 1.0F;
    const StrandFile one = load("a.hair", hair(header) + points); // as writers leave it: no width
    EXPECT_TRUE(one.samples[0].widths.empty() && one.warnings.empty());
    header.default_thickness = 0.25F;
    header.default_transparency = 0.5F;
    header.default_color[1] = 0.25F;
    const StrandFile given = load("a.hair", hair(header) + points);
    EXPECT_EQ(given.samples[0].widths, std::vector<float>(6, 0.25F));
    EXPECT_EQ(attribute(given, "transparency").values, (std::vector<float>{0.5F, 0.5F}));
    EXPECT_EQ(attribute(given, "color").rate, MARRAM_PER_CURVE);
    EXPECT_EQ(attribute(given, "color").values, (std::vector<float>{1, 0.25F, 1, 1, 0.25F, 1}));
}

TEST_F(StrandFiles, HairLeavesSinglePointsOut) {
    HairHeader header;
    header.strands = 3;
    header.points = 5;
    header.flags = hair_segments | hair_points | hair_transparency;
    std::string bytes = hair(header);
    put<uint16_t>(bytes, {1, 0, 1});
    for (int i = 0; i < 20; ++i) put<float>(bytes, {float(i)});
    const StrandFile strands = load("a.hair", bytes);
    EXPECT_EQ(strands.counts, (std::vector<uint32_t>{2, 2}));
    EXPECT_EQ(strands.samples[0].points[2], Vec3f(9, 10, 11));
    EXPECT_EQ(attribute(strands, "transparency").values, (std::vector<float>{15, 16, 18, 19}));
    EXPECT_TRUE(told(strands, "1 of 3 strands"));
    header.strands = header.points = 1;
    header.flags = hair_points;
    bytes = hair(header);
    put<float>(bytes, {1, 2, 3});
    expect_refusal("a.hair", bytes, "has no strand of two points");
}

TEST_F(StrandFiles, HairRefusesInOneLine) {
    const auto with = [](auto change) {
        std::string bytes = full_hair();
        HairHeader header;
        std::memcpy(&header, bytes.data(), sizeof header);
        change(header);
        return hair(header) + bytes.substr(sizeof header);
    };
    const auto number = [](size_t index, float value) { // index counts from the first point
        std::string bytes = full_hair();
        std::memcpy(bytes.data() + sizeof(HairHeader) + 4 + index * 4, &value, 4);
        return bytes;
    };
    expect_refusal("a.hair", "", "has no header");
    expect_refusal("a.hair", std::string(200, 'x'), "has no header");
    expect_refusal("a.hair", with([](HairHeader& h) { h.strands = 0; }), "has no strands");
    expect_refusal("a.hair", with([](HairHeader& h) { h.points = 0; }), "has no strands");
    expect_refusal("a.hair", with([](HairHeader& h) { h.flags = 29; }), "it has no points");
    expect_refusal("a.hair", with([](HairHeader& h) { h.flags |= 32; }), "are not all known");
    expect_refusal("a.hair", with([](HairHeader& h) { h.strands = ~0U; }), "bytes, the file has");
    expect_refusal("a.hair", with([](HairHeader& h) { h.points = ~0U; }), "bytes, the file has");
    expect_refusal("a.hair", with([](HairHeader& h) { h.default_color[2] = NAN; }), "");
    for (const float value : {NAN, INFINITY, -INFINITY, 2e8F}) {
        expect_refusal("a.hair", number(7, value), "point 2 ");
        expect_refusal("a.hair", number(16, value), "the thickness of point 1");
    }
    expect_refusal("a.hair", number(16, -1.0F), "the thickness of point 1");
    expect_refusal("a.hair", number(22, NAN), "the transparency of point 2");
    expect_refusal("a.hair", number(39, INFINITY), "the color of point 4");
    std::string wrong = full_hair();
    wrong[sizeof(HairHeader)] = 9;
    expect_refusal("a.hair", wrong, "have 13 points together, the header says 5");
    HairHeader huge; // the sum of its points overflows 32 bits
    huge.strands = 4;
    huge.points = 4;
    huge.flags = hair_points;
    huge.default_segments = 0x40000000U;
    expect_refusal("a.hair", hair(huge) + std::string(48, '\0'), "points together");
    huge.flags = hair_points;
    huge.default_segments = 1;
    huge.points = 8;
    huge.default_thickness = INFINITY;
    expect_refusal("a.hair", hair(huge) + std::string(96, '\0'), "thickness is not finite");
    EXPECT_THROW(load_strand_file(folder.string() + "/none.hair", {24.0}), InputError);
    fs::create_directories(folder / "folder.hair");
    EXPECT_THROW(load_strand_file(path("folder.hair"), {24.0}), InputError);
    expect_refusal("a.abc", "Ogawa", "are not known");
}

TEST_F(StrandFiles, HairReadsOurOwnBakes) {
    const Groom groom;
    write_hair(path("a.hair"), std::span(&groom.geometry, 1));
    const StrandFile strands = load_strand_file(path("a.hair"), {24.0});
    EXPECT_EQ(strands.counts, groom.counts);
    EXPECT_EQ(cvs_of(strands.samples.at(0)), groom.cvs());
}

TEST(RealStrands, Load) {
    const fs::path data = fs::path(MARRAM_SOURCE_DIR) / ".." / "shared/data";
    if (!fs::exists(data)) GTEST_SKIP() << "no ../shared/data";
    const StrandFile strands = load_strand_file((data / "Bangs_100.hair").string(), {24.0});
    EXPECT_EQ(strands.counts.size(), 100u);
    EXPECT_EQ(strands.samples.at(0).points.size(), 1165u);
    EXPECT_TRUE(strands.samples[0].widths.empty());
    EXPECT_TRUE(strands.warnings.empty());
}

// ---- USD

std::string usda(const std::string& curves, const std::string& head = "metersPerUnit = 1") {
    return "#usda 1.0\n(\n    " + head + "\n)\ndef BasisCurves \"c\"\n{\n" + curves + "}\n";
}

std::string kind(const std::string& basis, const std::string& wrap) {
    if (basis == "linear") return "uniform token type = \"linear\"\nuniform token wrap = \"" + wrap + "\"\n";
    return "uniform token type = \"cubic\"\nuniform token basis = \"" + basis +
           "\"\nuniform token wrap = \"" + wrap + "\"\n";
}

TEST_F(StrandFiles, UsdaReadsOurOwnBakes) {
    for (const MarramBasis basis : {MARRAM_BSPLINE, MARRAM_CATMULL_ROM}) {
        const Groom groom(basis);
        write_usda(path("a.usda"), std::span(&groom.geometry, 1), 1.0, 24.0);
        const StrandFile strands = load_strand_file(path("a.usda"), {24.0});
        EXPECT_EQ(strands.counts, groom.counts);
        EXPECT_EQ(strands.basis, basis);
        EXPECT_EQ(strands.deviation, 0.0);
        ASSERT_EQ(strands.samples.size(), 1u);
        EXPECT_EQ(cvs_of(strands.samples[0]), groom.cvs());
        expect_same_attributes(strands.attributes, groom.geometry.attributes);
        EXPECT_TRUE(strands.warnings.empty());
        expect_cuts("cut.usda", get("a.usda"), 1);
    }
}

// A wavy curve of n vertices. Every third vertex of a Bezier curve lies on it; the others make it smooth.
std::string wave(int n, bool is_bezier, float shift = 0.0F) {
    std::string points;
    for (int i = 0; i < n; ++i) {
        const int joint = is_bezier ? (i + 1) / 3 : i;
        const double t = 0.7 * joint, handle = is_bezier ? 0.7 * (i - 3 * joint) / 3.0 : 0.0;
        points += fmt::format("{}({}, {}, {})", i > 0 ? ", " : "", t + handle,
                              std::sin(t) + handle * std::cos(t) + double(shift),
                              std::cos(1.3 * t) - handle * 1.3 * std::sin(1.3 * t));
    }
    return points;
}

double distance(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d way = b - a;
    const double t = std::clamp((p - a).dot(way) / way.squaredNorm(), 0.0, 1.0);
    return (p - a - t * way).norm();
}

// For every basis and wrap the imported curve stays near the file's curve, which is evaluated as polylines
// elsewhere.
TEST_F(StrandFiles, UsdaDrawsWhatTheFileDraws) {
    struct Case {
        const char *basis, *wrap;
        int vertices;
        MarramBasis drawn;
    };
    for (const Case& one : {Case{"linear", "nonperiodic", 6, MARRAM_LINEAR},
                            {"linear", "periodic", 6, MARRAM_LINEAR},
                            {"linear", "pinned", 6, MARRAM_LINEAR},
                            {"bezier", "nonperiodic", 7, MARRAM_CATMULL_ROM},
                            {"bezier", "periodic", 6, MARRAM_CATMULL_ROM},
                            {"bezier", "pinned", 7, MARRAM_CATMULL_ROM},
                            {"bspline", "nonperiodic", 7, MARRAM_CATMULL_ROM},
                            {"bspline", "periodic", 6, MARRAM_CATMULL_ROM},
                            {"bspline", "pinned", 6, MARRAM_BSPLINE},
                            {"catmullRom", "nonperiodic", 7, MARRAM_CATMULL_ROM},
                            {"catmullRom", "periodic", 6, MARRAM_CATMULL_ROM},
                            {"catmullRom", "pinned", 6, MARRAM_CATMULL_ROM}}) {
        const std::string what = std::string(one.basis) + " " + one.wrap;
        const bool is_bezier = std::strcmp(one.basis, "bezier") == 0;
        const std::string text = usda(
            kind(one.basis, one.wrap) +
            fmt::format("int[] curveVertexCounts = [{0}, {0}]\npoint3f[] points = [{1}, {2}]\n", one.vertices,
                        wave(one.vertices, is_bezier), wave(one.vertices, is_bezier, 3.0F)));
        const StrandFile strands = load("a.usda", text);
        ASSERT_EQ(strands.basis, one.drawn) << what;
        ASSERT_EQ(strands.counts.size(), 2u) << what;
        const bool periodic = std::strcmp(one.wrap, "periodic") == 0;
        EXPECT_EQ(told(strands, "closed"), periodic) << what;
        const auto file = read_usda_curves("a.usda", text);
        size_t first = 0;
        double worst = 0.0, length = 0.0;
        for (size_t c = 0; c < 2; ++c) {
            auto line = file.at(0).polyline(c * size_t(one.vertices), uint32_t(one.vertices), 256);
            if (periodic) line.push_back(line.front());
            const auto cv = [&](int64_t i) -> Vec3d {
                const auto last = int64_t(strands.counts[c]) - 1;
                const auto at = [&](int64_t k) {
                    return Vec3d(strands.samples[0].points[first + size_t(k)].cast<double>());
                };
                if (i < 0) return 2.0 * at(0) - at(1);
                return i > last ? Vec3d(2.0 * at(last) - at(last - 1)) : at(i);
            };
            if (periodic) {
                EXPECT_EQ(cv(0), cv(strands.counts[c] - 1)) << what;
            }
            for (int64_t j = 0; j + 1 < strands.counts[c]; ++j)
                for (double u = 0.0; u <= 1.0; u += 1.0 / 16.0) {
                    Vec3d drawn = (1.0 - u) * cv(j) + u * cv(j + 1);
                    if (one.drawn != MARRAM_LINEAR) {
                        const auto weights = cubic_basis(one.drawn, u).value;
                        drawn = Vec3d::Zero();
                        for (int k = 0; k < 4; ++k) drawn += weights[size_t(k)] * cv(j + k - 1);
                    }
                    double nearest = 1e9;
                    for (size_t i = 0; i + 1 < line.size(); ++i)
                        nearest = std::min(nearest, distance(drawn, line[i], line[i + 1]));
                    worst = std::max(worst, nearest);
                }
            length = 0.0;
            for (size_t i = 0; i + 1 < line.size(); ++i) length += (line[i + 1] - line[i]).norm();
            first += strands.counts[c];
        }
        EXPECT_LE(worst, 1.02 * strands.deviation + 1e-5 * length) << what;
        EXPECT_LE(strands.deviation, 1e-3 * length * 1.01) << what;
        EXPECT_FALSE(told(strands, "differ from the file's")) << what;
        const bool exact = one.drawn != MARRAM_CATMULL_ROM || std::strcmp(one.wrap, "pinned") == 0;
        if (exact && !is_bezier) {
            EXPECT_EQ(strands.deviation, 0.0) << what;
        }
    }
}

// Cubics equal to Catmull-Rom curves keep one CV a joint. Sharp bends are subdivided, and the remaining error
// is reported.
TEST_F(StrandFiles, UsdaCutsAsFarAsNeeded) {
    const auto counts = [&](const std::string& points, int vertices) {
        return load("a.usda", usda(kind("bezier", "nonperiodic") +
                                   fmt::format("int[] curveVertexCounts = [{}]\npoint3f[] points = [{}]\n",
                                               vertices, points)));
    };
    EXPECT_EQ(counts("(0,0,0), (1,0,0), (2,0,0), (3,0,0), (4,0,0), (5,0,0), (6,0,0)", 7).counts[0], 3u);
    const StrandFile bent = counts("(0,0,0), (0,1,0), (1,1,0), (1,0,0)", 4);
    EXPECT_GT(bent.counts[0], 3u);
    EXPECT_LE(bent.counts[0], 9u);
    const StrandFile cusp = counts("(0,0,0), (3,1,0), (-2,1,0), (1,0,0)", 4);
    EXPECT_EQ(cusp.counts[0], 9u);
    EXPECT_TRUE(told(cusp, "differ from the file's"));
    EXPECT_GT(cusp.deviation, 0.0);
}

// Each prim has few primvars, but filling their gaps over all prims would exceed the memory limit.
TEST_F(StrandFiles, UsdaPrimvarsAreCountedOverAllPrims) {
    std::string text = "#usda 1.0\n";
    for (int p = 0; p < 70; ++p)
        text += fmt::format("def BasisCurves \"c{0}\"\n{{\nuniform token type = \"linear\"\n"
                            "int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n"
                            "float primvars:p{0} = 1\n}}\n",
                            p);
    try {
        load("many.usda", text);
        ADD_FAILURE() << "taken";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("more than 64 primvars in all"), std::string::npos)
            << error.what();
    }
}

TEST_F(StrandFiles, UsdaSpreadsWidthsAndPrimvars) {
    // Two Bezier curves of one and two cubics (all straight): 2 and 3 joints, 4 and 7 vertices.
    std::string text =
        kind("bezier", "nonperiodic") + "int[] curveVertexCounts = [4, 7]\npoint3f[] points = [";
    for (int i = 0; i < 11; ++i) text += fmt::format("{}({}, 0, 0)", i > 0 ? ", " : "", i < 4 ? i : i - 4);
    text += "]\n";
    const auto with = [&](const std::string& more) { return load("a.usda", usda(text + more)); };
    const auto widths = [&](const std::string& values, const std::string& interpolation) {
        return with("float[] widths = " + values + " ( interpolation = \"" + interpolation + "\" )\n")
            .samples.at(0)
            .widths;
    };
    const std::string vertices = "[0, 0, 0, 1, 2, 2, 2, 3, 3, 3, 4]";
    EXPECT_EQ(with("").counts, (std::vector<uint32_t>{2, 3}));
    EXPECT_EQ(widths("[0.5]", "constant"), std::vector<float>(5, 0.5F));
    EXPECT_EQ(widths("[1, 2]", "uniform"), (std::vector<float>{1, 1, 2, 2, 2}));
    EXPECT_EQ(widths("[1, 2, 3, 4, 5]", "varying"), (std::vector<float>{1, 2, 3, 4, 5}));
    EXPECT_EQ(widths(vertices, "vertex"), (std::vector<float>{0, 1, 2, 3, 4}));
    EXPECT_EQ(with("float[] widths = " + vertices + "\n").samples.at(0).widths,
              (std::vector<float>{0, 1, 2, 3, 4}));
    EXPECT_EQ(with("float[] primvars:widths = [7] ( interpolation = \"constant\" )\nfloat[] widths = " +
                   vertices + "\n")
                  .samples.at(0)
                  .widths,
              std::vector<float>(5, 7.0F));
    const StrandFile all =
        with("float primvars:one = 0.1\n"
             "color3f[] primvars:tint = [(1, 0, 0), (0, 0.5, 0)] ( interpolation = \"uniform\" )\n"
             "texCoord2f[] primvars:st = [(0.25, 0.5), (0.75, 1)] ( interpolation = \"uniform\" )\n"
             "half[] primvars:h = [1, 2, 3, 4, 5] ( interpolation = \"varying\" )\n"
             "double[] primvars:d = " +
             vertices +
             " ( interpolation = \"vertex\" )\n"
             "int[] primvars:clump = [3, 3, 3, 3, 9, 9, 9, 9, 9, 9, 9] ( interpolation = \"vertex\" )\n"
             "float4[] primvars:quad = [(1, 2, 3, 4)] ( interpolation = \"constant\" )\n"
             "float[] primvars:indexed = [0.5, 0.75] ( interpolation = \"uniform\" )\n"
             "int[] primvars:indexed:indices = [1, 1]\n"
             "string[] primvars:label = [\"a\", \"b\"] ( interpolation = \"uniform\" )\n"
             "matrix4d primvars:frame = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))\n"
             "float[] primvars:array = [1, 2, 3]\n"
             "int64[] ids = [16777216, 900000000000]\n"
             "normal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, "
             "0), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)]\n"
             "vector3f[] velocities = []\n");
    const auto expect = [&](const char* name, uint32_t components, MarramRate rate,
                            const std::vector<float>& values, bool discrete = false) {
        const AttributeValues& a = attribute(all, name);
        EXPECT_EQ(a.components, components) << name;
        EXPECT_EQ(a.rate, rate) << name;
        EXPECT_EQ(a.values, values) << name;
        EXPECT_EQ(a.discrete, discrete) << name;
    };
    expect("one", 1, MARRAM_PER_CURVE, {0.1F, 0.1F});
    expect("tint", 3, MARRAM_PER_CURVE, {1, 0, 0, 0, 0.5F, 0});
    expect("root_uv", 2, MARRAM_PER_CURVE, {0.25F, 0.5F, 0.75F, 1});
    expect("h", 1, MARRAM_PER_CV, {1, 2, 3, 4, 5});
    expect("d", 1, MARRAM_PER_CV, {0, 1, 2, 3, 4});
    expect("clump", 1, MARRAM_PER_CV, {3, 3, 9, 9, 9}, true);
    expect("quad", 4, MARRAM_PER_CURVE, {1, 2, 3, 4, 1, 2, 3, 4});
    expect("indexed", 1, MARRAM_PER_CURVE, {0.75F, 0.75F});
    expect("normal", 3, MARRAM_PER_CV, {0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0});
    const AttributeValues& id = attribute(all, "id");
    EXPECT_TRUE(id.discrete);
    EXPECT_EQ(id.values[0], 16777216.0F);
    EXPECT_GE(id.values[1], 0.0F);
    EXPECT_LT(id.values[1], 16777216.0F);
    for (const char* what : {"label", "frame", "array", "beyond 2^24", "velocities"})
        EXPECT_TRUE(told(all, what)) << what;
    EXPECT_EQ(all.warnings.size(), 5u);
    EXPECT_EQ(all.attributes.size(), 10u);
}

// Values are interpolated between joints where cubics are subdivided.
TEST_F(StrandFiles, UsdaSpreadsOverCuts) {
    const StrandFile cut =
        load("a.usda",
             usda(kind("bezier", "nonperiodic") +
                  "int[] curveVertexCounts = [4]\npoint3f[] points = [(0,0,0), (3,1,0), (-2,1,0), (1,0,0)]\n"
                  "float[] widths = [0, 8] ( interpolation = \"varying\" )\n"
                  "int[] primvars:n = [1, 2] ( interpolation = \"varying\" )\n"
                  "float[] primvars:v = [0, 0, 8, 8] ( interpolation = \"vertex\" )\n"));
    ASSERT_EQ(cut.counts[0], 9u);
    EXPECT_EQ(cut.samples[0].widths, (std::vector<float>{0, 1, 2, 3, 4, 5, 6, 7, 8}));
    EXPECT_EQ(attribute(cut, "n").values, (std::vector<float>{1, 1, 1, 1, 2, 2, 2, 2, 2}));
    EXPECT_EQ(attribute(cut, "v").values[4], 4.0F);
    EXPECT_EQ(attribute(cut, "v").values[2], 8.0F * (3.0F * 0.75F * 0.0625F + 0.015625F));
}

TEST_F(StrandFiles, UsdaAnimates) {
    const std::string text =
        "#usda 1.0\n(\n    metersPerUnit = 1\n    timeCodesPerSecond = 48\n)\ndef Xform \"a\"\n{\n"
        "    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 8: (0, 0, 4) }\n"
        "    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n    def BasisCurves \"c\"\n    {\n" +
        kind("linear", "nonperiodic") +
        "int[] curveVertexCounts = [2]\npoint3f[] points.timeSamples = { 2: [(0, 0, 0), (1, 0, 0)], 4: [(0, "
        "1, 0), (1, 1, 0)] }\n"
        "float[] widths = [0.1] ( interpolation = \"constant\" )\n"
        "float[] primvars:wet ( interpolation = \"uniform\" )\n"
        "float[] primvars:wet.timeSamples = { 2: [0.5], 4: [0.75] }\n    }\n}\n";
    const StrandFile strands = load("a.usda", text);
    ASSERT_EQ(strands.samples.size(), 4u); // time codes 0, 2, 4 and 8 at 48 a second
    const double frames[] = {0.0, 1.0, 2.0, 4.0};
    const Vec3f begins[] = {{0, 0, 0}, {0, 0, 1}, {0, 1, 2}, {0, 1, 4}};
    for (size_t i = 0; i < 4; ++i) {
        EXPECT_EQ(strands.samples[i].frame, frames[i]);
        EXPECT_EQ(strands.samples[i].points[0], begins[i]);
        EXPECT_EQ(strands.samples[i].widths, (std::vector<float>{0.1F, 0.1F}));
    }
    EXPECT_EQ(attribute(strands, "wet").values, std::vector<float>{0.5F});
    EXPECT_TRUE(told(strands, "animates"));
    expect_cuts("cut.usda", text, 2);
    const std::string still =
        "point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0)], 2: [(0, 0, 0), (1, 0, 0)] }\n";
    EXPECT_EQ(load("a.usda", usda(kind("linear", "nonperiodic") + "int[] curveVertexCounts = [2]\n" + still))
                  .samples.size(),
              1u);
}

// Rotations between two samples of a transform are resampled, including whole turns.
TEST_F(StrandFiles, UsdaFollowsTurns) {
    const StrandFile strands =
        load("a.usda",
             "#usda 1.0\n( metersPerUnit = 1 )\ndef Xform \"a\"\n{\n"
             "    float xformOp:rotateZ.timeSamples = { 0: 0, 24: 360 }\n"
             "    uniform token[] xformOpOrder = [\"xformOp:rotateZ\"]\n    def BasisCurves \"c\"\n    {\n" +
                 kind("linear", "nonperiodic") +
                 "int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n    }\n}\n");
    ASSERT_GT(strands.samples.size(), 30u);
    double worst = 0.0;
    for (double frame = 0.0; frame <= 24.0; frame += 0.01) {
        size_t i = 0;
        while (i + 2 < strands.samples.size() && strands.samples[i + 1].frame < frame) ++i;
        const StrandSample &a = strands.samples[i], &b = strands.samples[i + 1];
        const double share = (frame - a.frame) / (b.frame - a.frame);
        const Vec3d p = (1.0 - share) * a.points[1].cast<double>() + share * b.points[1].cast<double>();
        const double angle = frame / 24.0 * 2.0 * pi;
        worst = std::max(worst, (p - Vec3d(std::cos(angle), std::sin(angle), 0.0)).norm());
    }
    EXPECT_LT(worst, 1.5e-3);
    // Transform samples times many points would need memory for their product: refused beforehand.
    std::string samples, points;
    for (int i = 0; i < 20000; ++i) samples += fmt::format("{}: ({}, 0, 0), ", i, i % 7);
    for (int i = 0; i < 2000; ++i) points += fmt::format("{}({}, 0, 0)", i > 0 ? ", " : "", i);
    expect_refusal("a.usda",
                   usda("double3 xformOp:translate.timeSamples = { " + samples +
                        " }\nuniform token[] xformOpOrder = [\"xformOp:translate\"]\n" +
                        kind("linear", "nonperiodic") +
                        "int[] curveVertexCounts = [2000]\npoint3f[] points = [" + points + "]\n"),
                   "at each of 20000 times would take");
}

TEST_F(StrandFiles, UsdaPlacesAndScales) {
    const StrandFile strands =
        load("a.usda",
             "#usda 1.0\n(\n    metersPerUnit = 0.01\n    upAxis = \"Z\"\n)\ndef BasisCurves \"c\"\n{\n" +
                 kind("linear", "nonperiodic") +
                 "double3 xformOp:scale = (2, 2, 2)\nuniform token[] xformOpOrder = [\"xformOp:scale\"]\n"
                 "int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (100, 0, 50)]\n"
                 "float[] widths = [1] ( interpolation = \"constant\" )\n"
                 "point3f[] primvars:rest = [(0, 0, 0), (100, 0, 50)] ( interpolation = \"vertex\" )\n"
                 "vector3f primvars:v = (0, 0, 1)\nnormal3f primvars:n = (0, 0, 1)\nfloat3 primvars:f = (0, "
                 "0, 1)\n}\n");
    EXPECT_LT((strands.samples.at(0).points[1] - Vec3f(2, 1, 0)).norm(), 1e-6F);
    EXPECT_NEAR(strands.samples[0].widths[0], 0.02, 1e-8);
    const auto close = [&](const char* name, const Vec3f& to, size_t at) {
        EXPECT_LT((Vec3f(attribute(strands, name).values.data() + 3 * at) - to).norm(), 1e-6F) << name;
    };
    close("rest", {2, 1, 0}, 1);
    close("v", {0, 0.02F, 0}, 0);
    close("n", {0, 1, 0}, 0);
    close("f", {0, 0, 1}, 0);
}

TEST_F(StrandFiles, UsdaJoinsPrims) {
    const auto prim = [](const char* name, const std::string& what) {
        return fmt::format("def BasisCurves \"{}\"\n{{\n{}}}\n", name, what);
    };
    const std::string head = "#usda 1.0\n( metersPerUnit = 1 )\n",
                      two = "int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n";
    const std::string pinned = kind("bspline", "pinned") + two;
    const StrandFile strands = load(
        "a.usda",
        head + prim("a", pinned + "float[] widths = [1, 2]\nfloat primvars:x = 1\nfloat primvars:z = 5\n") +
            prim("b",
                 pinned +
                     "float[] primvars:x = [3, 4] ( interpolation = \"vertex\" )\nfloat primvars:y = 2\n"));
    EXPECT_EQ(strands.counts, (std::vector<uint32_t>{2, 2}));
    EXPECT_EQ(strands.samples.at(0).widths, (std::vector<float>{1, 2, 0, 0}));
    EXPECT_EQ(attribute(strands, "x").values, (std::vector<float>{1, 1, 3, 4}));
    EXPECT_EQ(attribute(strands, "y").values, (std::vector<float>{0, 2}));
    EXPECT_EQ(attribute(strands, "z").values, (std::vector<float>{5, 0}));
    for (const char* what : {"\"widths\"", "\"y\"", "\"z\""}) EXPECT_TRUE(told(strands, what)) << what;
    EXPECT_EQ(strands.warnings.size(), 3u);
    expect_refusal("a.usda",
                   head + prim("a", pinned + "float primvars:x = 1\n") +
                       prim("b", pinned + "float2 primvars:x = (1, 2)\n"),
                   "has 2 numbers in");
}

TEST_F(StrandFiles, UsdaRefusesInOneLine) {
    const std::string line = kind("linear", "nonperiodic");
    const auto curves = [&](const std::string& more, const std::string& what) {
        expect_refusal(
            "a.usda",
            usda(line + "int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n" + more),
            what);
    };
    const auto bare = [&](const std::string& text, const std::string& what) {
        expect_refusal("a.usda", usda(line + text), what);
    };
    bare("int[] curveVertexCounts = []\npoint3f[] points = []\n", "have no curves");
    bare("int[] curveVertexCounts = [2]\n", "have no points");
    bare("int[] curveVertexCounts = [3]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n", "add up to 3");
    bare("int[] curveVertexCounts = [9223372036854775807]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n",
         "beyond the range of its type");
    bare("int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, nan), (1, 0, 0)]\n",
         "not three finite numbers");
    bare("int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 2e8), (1, 0, 0)]\n", "beyond 1e8");
    bare("int[] curveVertexCounts = [1, 1]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n",
         "has no strand of two points");
    curves("float[] widths = [1, 2, 3]\n", "has 3 widths");
    curves("float[] widths = [1, nan]\n", "width 1 of");
    curves("float[] widths = [1, -1]\n", "width 1 of");
    curves("float[] primvars:x = [1, 2, 3] ( interpolation = \"vertex\" )\n",
           "has 3 values but its interpolation needs 2");
    curves("float primvars:x = nan\n", "is not finite");
    curves("double primvars:x = 1e300\n", "is not finite");
    curves("float[] primvars:x = [1] ( interpolation = \"spiral\" )\n", "is not known");
    curves("float[] primvars:x = [1] ( interpolation = \"uniform\" )\nint[] primvars:x:indices = [1]\n",
           "names none of its 1 values");
    curves("float[] primvars:x = [1] ( interpolation = \"uniform\" )\nint[] primvars:x:indices = [-1]\n",
           "names none of its 1 values");
    curves("int64[] ids = [1, 2]\n", "has 2 values");
    curves("normal3f[] normals = [(0, 1, 0)]\n", "has 1 values");
    std::string many;
    for (int i = 0; i < 65; ++i) many += fmt::format("float primvars:p{} = 1\n", i);
    curves(many, "more than 64 primvars");
    expect_refusal("a.usda", usda(line, "timeCodesPerSecond = 0"), "timeCodesPerSecond is");
    expect_refusal("a.usda", "#usda 1.0\ndef Xform \"a\" { }\n", "has no BasisCurves of its own");
    EXPECT_EQ(load("a.usda",
                   usda(line + "int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\n") +
                       "def NurbsCurves \"n\" { }\n")
                  .warnings.size(),
              1u);
}

// ---- PLY

std::string ply(const std::string& header, const std::string& body) {
    return "ply\nformat ascii 1.0\n" + header + "end_header\n" + body;
}

const std::string ply_vertex = "property float x\nproperty float y\nproperty float z\n";

TEST_F(StrandFiles, PlyTakesWhatVerticesAndStrandsHave) {
    const StrandFile strands =
        load("a.ply", ply("element vertex 5\n" + ply_vertex +
                              "property int strand_id\nproperty float radius\nproperty uchar red\nproperty "
                              "uchar green\nproperty uchar blue\n"
                              "property float nx\nproperty float ny\nproperty float nz\nproperty float "
                              "u\nproperty float v\nproperty float wet\n"
                              "property short kind\nproperty float w_0\nproperty float w_1\nelement curve "
                              "2\nproperty int curve_id\nproperty float s\nproperty float t\n"
                              "property uint big\n",
                          "0 0 0 8 0.5 255 0 51 0 1 0 0.1 0.2 7 -3 1 2\n1 0 0 4 1 0 0 0 1 0 0 0.3 0.4 8 1 3 "
                          "4\n2 0 0 8 1 0 0 0 1 0 0 0.3 0.4 8 1 5 6\n"
                          "3 0 0 4 1 0 0 0 1 0 0 0.3 0.4 8 1 7 8\n4 0 0 8 1 0 0 0 1 0 0 0.3 0.4 8 2 9 10\n4 "
                          "0.25 0.5 5\n8 0.75 1 4000000000\n"));
    EXPECT_EQ(strands.counts, (std::vector<uint32_t>{3, 2}));
    EXPECT_EQ(strands.samples.at(0).points[2], Vec3f(4, 0, 0));
    EXPECT_EQ(strands.samples[0].widths, (std::vector<float>{1, 2, 2, 2, 2}));
    EXPECT_EQ(attribute(strands, "color").values[2], 0.2F);
    EXPECT_FALSE(attribute(strands, "color").discrete);
    EXPECT_EQ(attribute(strands, "normal").values[1], 1.0F);
    EXPECT_EQ(attribute(strands, "uv").values[1], 0.2F);
    EXPECT_EQ(attribute(strands, "wet").values, (std::vector<float>{7, 8, 8, 8, 8}));
    EXPECT_EQ(attribute(strands, "kind").values, (std::vector<float>{-3, 1, 2, 1, 1}));
    EXPECT_TRUE(attribute(strands, "kind").discrete);
    EXPECT_EQ(attribute(strands, "w").values, (std::vector<float>{1, 2, 5, 6, 9, 10, 3, 4, 7, 8}));
    EXPECT_EQ(attribute(strands, "root_uv").values, (std::vector<float>{0.75F, 1, 0.25F, 0.5F}));
    EXPECT_EQ(attribute(strands, "root_uv").rate, MARRAM_PER_CURVE);
    EXPECT_EQ(attribute(strands, "big").values[1], 5.0F);
    EXPECT_LT(attribute(strands, "big").values[0], 16777216.0F);
    EXPECT_EQ(strands.warnings.size(), 1u);
}

TEST_F(StrandFiles, PlyOpensRingsAndLeavesPointsOut) {
    const StrandFile ring =
        load("a.ply", ply("element vertex 3\n" + ply_vertex +
                              "element edge 3\nproperty int vertex1\nproperty int vertex2\n",
                          "0 0 0\n1 0 0\n0 1 0\n0 1\n1 2\n2 0\n"));
    EXPECT_EQ(ring.counts, std::vector<uint32_t>{4});
    EXPECT_EQ(ring.samples.at(0).points[3], Vec3f(0, 0, 0));
    EXPECT_TRUE(told(ring, "closed"));
    const StrandFile short_one =
        load("a.ply", ply("element vertex 3\n" + ply_vertex +
                              "property int strand_id\nelement strand 2\nproperty float a\n",
                          "0 0 0 1\n1 0 0 2\n0 1 0 2\n5\n6\n"));
    EXPECT_EQ(short_one.counts, std::vector<uint32_t>{2});
    EXPECT_EQ(attribute(short_one, "a").values, std::vector<float>{6});
    EXPECT_TRUE(told(short_one, "1 of 2 strands"));
}

TEST_F(StrandFiles, PlyRefusesInOneLine) {
    const std::string two = "element vertex 2\n" + ply_vertex + "property int strand_id\n";
    const std::string rows = "0 0 0 1\n1 0 0 1\n";
    expect_refusal("a.ply", ply(two + "element strand 2\nproperty float a\n", rows + "1\n2\n"),
                   "has 1 strands, but 2 entries");
    expect_refusal("a.ply", ply(two + "element strand 4000000000\n", rows),
                   "has 1 strands, but 4000000000 entries");
    expect_refusal("a.ply", ply(two + "element strand 4000000000\nproperty float a\n", rows + "1\n"),
                   "do not fit");
    expect_refusal("a.ply", ply(two + "element strand 1\nproperty int strand_id\n", rows + "3\n"),
                   "no entry about the strand 1");
    expect_refusal("a.ply",
                   ply("element vertex 2\n" + ply_vertex + "property float a\n", "0 0 0 nan\n1 0 0 1\n"),
                   "not a finite number");
    expect_refusal("a.ply",
                   ply("element vertex 2\n" + ply_vertex + "property double a\n", "0 0 0 1e300\n1 0 0 1\n"),
                   "not a finite number");
    expect_refusal("a.ply",
                   ply("element vertex 2\n" + ply_vertex + "property float width\n", "0 0 0 -1\n1 0 0 1\n"),
                   "the width of entry 0 is -1");
    expect_refusal("a.ply",
                   ply("element vertex 2\n" + ply_vertex + "property float a\nproperty float a\n",
                       "0 0 0 1 1\n1 0 0 1 1\n"),
                   "two attributes are called");
    expect_refusal("a.ply", ply("element vertex 1\n" + ply_vertex, "0 0 0\n"), "has no strand of two points");
    expect_cuts(
        "cut.ply",
        ply(two + "property float width\nelement strand 1\nproperty float a\n", "0 0 0 1 1\n1 0 0 1 1\n7\n"),
        1);
}

// ---- OBJ

TEST_F(StrandFiles, ObjLines) {
    const StrandFile strands =
        load("a.obj", "# c\r\nv 0.1 0 0 1 1 1\r\no x\r\nv 1 0 0 # c\r\nvt 0 0\r\nv 2 3e-1 0\r\nl 1/1 2/1 "
                      "3/1\r\nl -1 -2 # back\r\nl 2\r\nl 3 4\r\nv 4 4 4\r\n");
    EXPECT_EQ(strands.counts, (std::vector<uint32_t>{3, 2, 2}));
    EXPECT_EQ(strands.basis, MARRAM_LINEAR);
    EXPECT_EQ(strands.samples.at(0).points,
              (std::vector<Vec3f>{
                  {0.1F, 0, 0}, {1, 0, 0}, {2, 0.3F, 0}, {2, 0.3F, 0}, {1, 0, 0}, {2, 0.3F, 0}, {4, 4, 4}}));
    EXPECT_TRUE(strands.samples[0].widths.empty());
    EXPECT_TRUE(told(strands, "1 of 4 strands"));
    expect_refusal("a.obj", "v 0 0 0\n", "has no lines");
    expect_refusal("a.obj", "v 0 0 nan\nv 1 0 0\nl 1 2\n",
                   "a.obj:1:7: this vertex is not three finite numbers");
    expect_refusal("a.obj", "v 0 0\nv 1 0 0\nl 1 2\n", "not three finite numbers");
    expect_refusal("a.obj", "v 0 0 2e8\nv 1 0 0\nl 1 2\n", "beyond 1e8");
    for (const char* index : {"0", "x", "1.5", "99999999999999999999", "4294967296", "-3", "/1"})
        expect_refusal("a.obj", fmt::format("v 0 0 0\nv 1 0 0\nl 1 {}\n", index), "a.obj:3:5: ");
    expect_refusal("a.obj", "v 0 0 0\nv 1 0 0\nl 1 3\n", "names vertex 3, there are 2");
    expect_refusal("a.obj", "v 0 0 0\nv 1 0 0\nl 1 \\\n2\n", "a.obj:3:5: this line goes on");
    expect_refusal("a.obj", std::string("v 0 0 0\n\0", 9), "binary");
    expect_refusal("a.obj", "v 0 0 0\nl 1\n", "has no strand of two points");
    expect_cuts("cut.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nl 1 2 3\n", 4);
}

TEST_F(StrandFiles, ObjReadsOurOwnBakes) {
    const Groom groom;
    write_curves_obj(path("a.obj"), std::span(&groom.geometry, 1));
    const StrandFile strands = load_strand_file(path("a.obj"), {24.0});
    EXPECT_EQ(strands.counts, groom.counts);
    std::vector<float> expected = groom.cvs();
    for (size_t i = 3; i < expected.size(); i += 4) expected[i] = -1.0F; // widths are lost
    EXPECT_EQ(cvs_of(strands.samples.at(0)), expected);
}

// ---- Written files

TEST_F(StrandFiles, PlyReadsOurOwnBakes) {
    Groom groom, other(MARRAM_BSPLINE, 5.0F);
    std::vector<float> normals;
    for (int i = 0; i < 16 * 3; ++i) normals.push_back(std::sin(float(i)));
    groom.geometry.normals = {normals.data()};
    other.geometry.attributes.erase(other.geometry.attributes.begin() + 2); // twist
    const CurveGeometry both[] = {groom.geometry, other.geometry};
    write_curves(path("a.ply"), both, 1.0, 24.0);
    const StrandFile strands = load_strand_file(path("a.ply"), {24.0});
    EXPECT_EQ(strands.counts, (std::vector<uint32_t>{5, 2, 3, 5, 2, 3}));
    std::vector<float> cvs = groom.cvs(), more = other.cvs();
    cvs.insert(cvs.end(), more.begin(), more.end());
    EXPECT_EQ(cvs_of(strands.samples.at(0)), cvs);
    EXPECT_TRUE(strands.warnings.empty());
    EXPECT_EQ(strands.attributes.size(), 5u);
    for (const AttributeValues& one : groom.geometry.attributes) {
        std::vector<float> values = one.values;
        if (one.name == "twist")
            values.resize(20, 0.0F);
        else
            values.insert(values.end(), one.values.begin(), one.values.end());
        const AttributeValues& same = attribute(strands, one.name);
        EXPECT_EQ(same.values, values) << one.name;
        EXPECT_EQ(same.components, one.components) << one.name;
        EXPECT_EQ(same.rate, one.rate) << one.name;
        EXPECT_EQ(same.discrete, one.discrete) << one.name;
    }
    const AttributeValues& normal = attribute(strands, "normal");
    EXPECT_EQ(normal.values[0], normals[3]); // after the first phantom vertex
    EXPECT_EQ(normal.values[3 * 5], normals[3 * 8]);
    EXPECT_EQ(normal.values[3 * 10], 0.0F);
    groom.geometry.attributes[3].components = 2;
    const CurveGeometry unlike[] = {other.geometry, groom.geometry};
    EXPECT_THROW(write_curves_ply(path("b.ply"), unlike), InputError);
    groom.vertices[4] = NAN;
    EXPECT_THROW(write_curves_ply(path("b.ply"), std::span(&groom.geometry, 1)), InputError);
    EXPECT_FALSE(fs::exists(path("b.ply")));
}

const std::vector<double>& numbers(const UsdaValue& value) { return std::get<std::vector<double>>(value); }

// Points follow parabolas over time; widths change once; the rest is constant.
TEST_F(StrandFiles, UsdaReadsOurOwnSequences) {
    const std::vector<double> frames = {1.0, 2.0, 3.0, 5.5};
    std::vector<std::vector<float>> written;
    {
        UsdaSequence sequence(path("a.usda"), 25.0);
        for (const double frame : frames) {
            Groom groom;
            for (size_t v = 0; v < groom.vertices.size(); v += 4) {
                groom.vertices[v] = float(double(v) + 3.0 * frame - 0.5 * frame * frame);
                if (frame > 2.5) groom.vertices[v + 3] *= 2.0F;
            }
            sequence.add(std::span(&groom.geometry, 1), frame);
            written.push_back(groom.cvs());
        }
        EXPECT_FALSE(fs::exists(path("a.usda")));
        sequence.commit();
    }
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1);
    const StrandFile strands = load_strand_file(path("a.usda"), {50.0});
    ASSERT_EQ(strands.samples.size(), frames.size());
    for (size_t i = 0; i < frames.size(); ++i) {
        EXPECT_EQ(strands.samples[i].frame, 2.0 * frames[i]); // 25 time codes a second in the file
        EXPECT_EQ(cvs_of(strands.samples[i]), written[i]) << i;
    }
    expect_same_attributes(strands.attributes, Groom().geometry.attributes);
    EXPECT_TRUE(strands.warnings.empty());

    const std::string text = get("a.usda");
    const UsdaLayer layer = read_usda("a.usda", text);
    EXPECT_EQ(find_metadata(layer.metadata, "startTimeCode"), "1");
    EXPECT_EQ(find_metadata(layer.metadata, "endTimeCode"), "5.5");
    const UsdaPrim& fur = layer.prims.at(0).children.at(0);
    EXPECT_EQ(fur.samples("points").size(), 4u);
    EXPECT_EQ(fur.samples("widths").size(), 4u);
    EXPECT_EQ(fur.metadata_of("widths", "interpolation"), "vertex");
    EXPECT_EQ(fur.samples("extent").size(), 4u);
    for (const char* still : {"ids", "primvars:id", "primvars:tint", "curveVertexCounts"}) {
        EXPECT_TRUE(fur.samples(still).empty()) << still;
        EXPECT_TRUE(fur.find(still)) << still;
    }
    EXPECT_EQ(std::get<std::vector<int64_t>>(*fur.find("ids")), (std::vector<int64_t>{16777215, 0, 7}));
    const auto velocities = fur.samples("velocities");
    ASSERT_EQ(velocities.size(), 4u);
    const double expected[] = {3.0 - 1.5, 3.0 - 2.0, 3.0 - 3.0, 3.0 - 0.5 * (3.0 + 5.5)}; // per frame
    for (size_t i = 0; i < 4; ++i) {
        EXPECT_EQ(velocities[i].first, frames[i]);
        EXPECT_NEAR(numbers(*velocities[i].second)[3], 25.0 * expected[i], 1e-3) << i;
        EXPECT_EQ(numbers(*velocities[i].second)[4], 0.0);
    }
    int read = 0; // prefixes: at most the whole without its last line end is read
    for (size_t size = 0; size < text.size(); size += 1 + size % 7) {
        try {
            read_usda_strands("cut.usda", std::string_view(text).substr(0, size), {24.0});
            ++read;
        } catch (const InputError&) {
        }
    }
    EXPECT_LE(read, 1);
}

TEST_F(StrandFiles, UsdaSequencesThatRestOrChange) {
    const Groom groom, shorter(MARRAM_CATMULL_ROM);
    {
        UsdaSequence sequence(path("rest.usda"), 24.0);
        for (const double frame : {1.0, 2.0}) sequence.add(std::span(&groom.geometry, 1), frame);
        sequence.commit();
    }
    const std::string text = get("rest.usda");
    EXPECT_EQ(text.find("timeSamples"), std::string::npos);
    EXPECT_EQ(text.find("velocities"), std::string::npos);
    EXPECT_EQ(cvs_of(load_strand_file(path("rest.usda"), {24.0}).samples.at(0)), groom.cvs());
    // A sequence of one frame equals the output of write_usda().
    write_usda(path("one.usda"), std::span(&groom.geometry, 1), 3.0, 24.0);
    {
        UsdaSequence sequence(path("sequence.usda"), 24.0);
        sequence.add(std::span(&groom.geometry, 1), 3.0);
        sequence.commit();
    }
    EXPECT_TRUE(get("one.usda") == get("sequence.usda"));

    Groom fewer;
    fewer.geometry.curve_count = 2;
    for (AttributeValues& one : fewer.geometry.attributes)
        one.values.resize(one.components * (one.rate == MARRAM_PER_CURVE ? 2 : 7));
    Groom bare;
    bare.geometry.attributes.pop_back();
    const CurveGeometry two[] = {groom.geometry, groom.geometry};
    using List = std::span<const CurveGeometry>;
    for (const List later :
         {List(&fewer.geometry, 1), List(&shorter.geometry, 1), List(&bare.geometry, 1), List(two)}) {
        UsdaSequence sequence(path("changes.usda"), 24.0);
        sequence.add(std::span(&groom.geometry, 1), 1.0);
        EXPECT_THROW(sequence.add(later, 2.0), InputError);
    }
    EXPECT_FALSE(fs::exists(path("changes.usda")));
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 3);
}

} // namespace
} // namespace marram
