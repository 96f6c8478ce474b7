// SPDX-License-Identifier: Apache-2.0
#include "core/math/problem.h"
#include "core/read/mesh_file.h"
#include "core/write/curve_export.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

namespace marram {
namespace {

namespace fs = std::filesystem;

// Curves with their vertices, including phantoms. Coordinates have no short decimal form.
struct Curves {
    std::vector<float> vertices, normals;
    CurveGeometry geometry;

    Curves(std::string name, uint64_t count, uint32_t cvs, MarramBasis basis = MARRAM_BSPLINE) {
        for (uint64_t i = 0; i < count * (cvs + 2); ++i)
            for (float scale : {0.1f, 1.0f / 3.0f, -1e-7f, 0.001f}) vertices.push_back(float(i + 1) * scale);
        geometry.name = std::move(name);
        geometry.basis = basis;
        geometry.curve_count = count;
        geometry.cvs_per_curve = cvs;
        geometry.vertices = {vertices.data()};
    }
    const float* cv(uint64_t curve, uint32_t i) const {
        return vertices.data() + (curve * (geometry.cvs_per_curve + 2) + 1 + i) * 4;
    }
};

struct ExportFiles : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_export_test_" + std::to_string(::getpid()));
    ExportFiles() { fs::create_directories(folder); }
    ~ExportFiles() override { fs::remove_all(folder); }
    std::string path(const char* name) const { return (folder / name).string(); }
    std::string get(const char* name) const {
        std::ostringstream text;
        text << std::ifstream(folder / name, std::ios::binary).rdbuf();
        return text.str();
    }
};

// ---- HAIR: a reader written from the format's description
// --------------------------------------------------

struct Hair {
    uint32_t strands, points, flags, default_segments;
    std::vector<uint32_t> segments;
    std::vector<float> positions, thickness;
};

template <typename Value>
Value take(const std::string& bytes, size_t& at) {
    Value value;
    if (at + sizeof(Value) > bytes.size()) throw std::runtime_error("file too short");
    std::memcpy(&value, bytes.data() + at, sizeof(Value));
    at += sizeof(Value);
    return value;
}

Hair read_hair(const std::string& bytes) {
    EXPECT_EQ(bytes.substr(0, 4), "HAIR");
    size_t at = 4;
    Hair hair{};
    hair.strands = take<uint32_t>(bytes, at);
    hair.points = take<uint32_t>(bytes, at);
    hair.flags = take<uint32_t>(bytes, at);
    hair.default_segments = take<uint32_t>(bytes, at);
    at = 128;
    uint32_t sum = 0;
    for (uint32_t s = 0; s < hair.strands; ++s) {
        hair.segments.push_back(hair.flags & 1 ? take<uint16_t>(bytes, at) : hair.default_segments);
        sum += hair.segments.back() + 1;
    }
    EXPECT_EQ(sum, hair.points);
    for (uint32_t i = 0; i < 3 * hair.points; ++i) hair.positions.push_back(take<float>(bytes, at));
    for (uint32_t i = 0; hair.flags & 4 && i < hair.points; ++i)
        hair.thickness.push_back(take<float>(bytes, at));
    EXPECT_EQ(at, bytes.size());
    return hair;
}

TEST_F(ExportFiles, HairReadsBackExactly) {
    const Curves a("a", 3, 5), b("b", 2, 8), longest("c", 1, 1000);
    const CurveGeometry all[] = {a.geometry, b.geometry, longest.geometry};
    write_curves(path("x.hair"), all, 1.0, 24.0);
    const Hair hair = read_hair(get("x.hair"));
    EXPECT_EQ(hair.segments, (std::vector<uint32_t>{4, 4, 4, 7, 7, 999}));
    EXPECT_EQ(hair.flags, 7u);
    size_t point = 0;
    for (const Curves* curves : {&a, &b, &longest})
        for (uint64_t c = 0; c < curves->geometry.curve_count; ++c)
            for (uint32_t i = 0; i < curves->geometry.cvs_per_curve; ++i, ++point) {
                ASSERT_EQ(std::memcmp(&hair.positions[point * 3], curves->cv(c, i), 12), 0);
                ASSERT_EQ(hair.thickness[point], 2.0f * curves->cv(c, i)[3]);
            }
    write_hair(path("same.hair"), std::span(all, 1));
    EXPECT_EQ(read_hair(get("same.hair")).flags, 6u); // equal lengths need no array
    write_hair(path("none.hair"), {});
    EXPECT_EQ(read_hair(get("none.hair")).strands, 0u);
}

TEST_F(ExportFiles, RefusesWhatAFormatCannotHold) {
    Curves a("a", 1, 5);
    std::ofstream(folder / "x.hair") << "old";
    a.geometry.cvs_per_curve = 1;
    EXPECT_THROW(write_hair(path("x.hair"), std::span(&a.geometry, 1)), InputError);
    const Curves segments("long", 1, 65537);
    EXPECT_THROW(write_hair(path("x.hair"), std::span(&segments.geometry, 1)), InputError);
    Curves broken("nan", 1, 5);
    broken.vertices[4] = NAN;
    EXPECT_THROW(write_hair(path("x.hair"), std::span(&broken.geometry, 1)), InputError);
    EXPECT_THROW(write_curves(path("x.abc"), {}, 1.0, 24.0), InputError);
    EXPECT_THROW(write_curves(path("none/x.usda"), {}, 1.0, 24.0), InputError);
    EXPECT_EQ(get("x.hair"), "old");
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1);
}

// ---- USD: the part of the text grammar that is used -------------------------------------------------------

struct UsdAttribute {
    std::string type, interpolation;
    bool uniform = false;
    std::vector<std::string> values; // scalars in a row
    size_t tuples = 0;               // of an array
};
using UsdPrim = std::map<std::string, UsdAttribute>;

class UsdParser {
  public:
    explicit UsdParser(std::string text) : text_(std::move(text)) {}

    std::map<std::string, std::string> metadata;
    std::map<std::string, UsdPrim> prims; // BasisCurves by name

    void parse() {
        const std::string magic = "#usda 1.0\n";
        ASSERT_EQ(text_.substr(0, magic.size()), magic);
        at_ = magic.size();
        metadata = dictionary();
        prim();
        ASSERT_EQ(next(), "");
    }

  private:
    std::string next() {
        while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
        if (at_ == text_.size()) return "";
        const size_t begin = at_++;
        if (std::strchr("()[]{},=", text_[begin])) return text_.substr(begin, 1);
        if (text_[begin] == '"') {
            at_ = text_.find('"', at_) + 1;
            return text_.substr(begin, at_ - begin);
        }
        while (at_ < text_.size() && !std::strchr("()[]{},= \n\"", text_[at_])) ++at_;
        const std::string word = text_.substr(begin, at_ - begin);
        if (word.ends_with("[") || text_.substr(at_, 2) != "[]") return word;
        at_ += 2;
        return word + "[]";
    }
    std::string peek() {
        const size_t begin = at_;
        std::string token = next();
        at_ = begin;
        return token;
    }
    void expect(const std::string& token) {
        const std::string found = next();
        if (found != token)
            throw std::runtime_error("expected " + token + ", found " + found + " at " + std::to_string(at_));
    }
    std::map<std::string, std::string> dictionary() {
        std::map<std::string, std::string> entries;
        expect("(");
        while (peek() != ")") {
            const std::string key = next();
            expect("=");
            entries[key] = next();
        }
        expect(")");
        return entries;
    }
    static void check_identifier(const std::string& name) {
        if (name.empty() || std::isdigit(static_cast<unsigned char>(name[0])))
            throw std::runtime_error("name " + name);
        for (char c : name)
            if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_')
                throw std::runtime_error("name " + name);
    }
    void prim() {
        expect("def");
        const std::string type = next(), quoted = next(), name = quoted.substr(1, quoted.size() - 2);
        check_identifier(name);
        UsdPrim attributes;
        expect("{");
        while (peek() != "}")
            if (peek() == "def")
                prim();
            else
                attribute(attributes);
        expect("}");
        if (type != "BasisCurves") return;
        if (!prims.insert({name, attributes}).second) throw std::runtime_error("two prims " + name);
    }
    void attribute(UsdPrim& attributes) {
        UsdAttribute a;
        a.uniform = peek() == "uniform";
        if (a.uniform) next();
        a.type = next();
        const std::string name = next();
        expect("=");
        if (a.type.ends_with("[]"))
            array(a);
        else
            a.values.push_back(next());
        if (peek() == "(") a.interpolation = dictionary()["interpolation"];
        if (!attributes.insert({name, a}).second) throw std::runtime_error("two attributes " + name);
    }
    void array(UsdAttribute& a) {
        const bool tuple = a.type == "point3f[]" || a.type == "float3[]" || a.type == "normal3f[]";
        expect("[");
        while (peek() != "]") {
            if (a.tuples++ > 0) expect(",");
            if (tuple) expect("(");
            for (int i = 0; i < (tuple ? 3 : 1); ++i) {
                if (i > 0) expect(",");
                a.values.push_back(next());
            }
            if (tuple) expect(")");
        }
        expect("]");
    }

    std::string text_;
    size_t at_ = 0;
};

float to_float(const std::string& text) {
    float value = NAN;
    const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    EXPECT_TRUE(error == std::errc() && stop == text.data() + text.size()) << text;
    return value;
}

TEST_F(ExportFiles, UsdFollowsItsGrammarAndReadsBackExactly) {
    Curves a("grass 1", 3, 5), b("grass-1", 2, 2, MARRAM_CATMULL_ROM), c("7", 0, 4);
    a.geometry.attributes = {{"id", 1, MARRAM_PER_CURVE, {4.0f, 16777215.0f, 0.0f}}};
    b.normals.assign(2 * 4 * 3, 0.5f);
    b.geometry.normals = {b.normals.data()};
    c.geometry.vertices.clear();
    const CurveGeometry all[] = {a.geometry, b.geometry, c.geometry};
    write_curves(path("x.usda"), all, 12.5, 24.0);
    UsdParser usd(get("x.usda"));
    ASSERT_NO_THROW(usd.parse());
    EXPECT_EQ(usd.metadata["metersPerUnit"], "1");
    EXPECT_EQ(usd.metadata["upAxis"], "\"Y\"");
    EXPECT_EQ(usd.metadata["startTimeCode"], "12.5");
    EXPECT_EQ(usd.metadata["timeCodesPerSecond"], "24");
    ASSERT_EQ(usd.prims.size(), 3u);
    for (const auto& [name, curves] : {std::pair{"grass_1", &a}, {"grass_1_1", &b}, {"_7", &c}}) {
        UsdPrim& prim = usd.prims.at(name);
        const size_t count = curves->geometry.curve_count, cvs = curves->geometry.cvs_per_curve;
        EXPECT_EQ(prim["type"].values[0], "\"cubic\"");
        EXPECT_EQ(prim["wrap"].values[0], "\"pinned\"");
        EXPECT_EQ(prim["basis"].values[0], curves == &b ? "\"catmullRom\"" : "\"bspline\"");
        EXPECT_TRUE(prim["type"].uniform && prim["wrap"].uniform && prim["basis"].uniform);
        EXPECT_EQ(prim["curveVertexCounts"].values, std::vector<std::string>(count, std::to_string(cvs)));
        EXPECT_EQ(prim["widths"].interpolation, "\"vertex\"");
        ASSERT_EQ(prim["points"].tuples, count * cvs);
        ASSERT_EQ(prim["widths"].tuples, count * cvs);
        for (size_t i = 0; i < count * cvs; ++i) {
            const float* cv = curves->cv(i / cvs, uint32_t(i % cvs));
            for (size_t k = 0; k < 3; ++k) ASSERT_EQ(to_float(prim["points"].values[i * 3 + k]), cv[k]);
            ASSERT_EQ(to_float(prim["widths"].values[i]), 2.0f * cv[3]);
        }
        EXPECT_EQ(prim.count("extent"), count > 0 ? 1u : 0u);
    }
    EXPECT_EQ(usd.prims["grass_1"]["primvars:id"].values, (std::vector<std::string>{"4", "16777215", "0"}));
    EXPECT_EQ(usd.prims["grass_1"]["primvars:id"].interpolation, "\"uniform\"");
    EXPECT_EQ(usd.prims["grass_1_1"]["normals"].tuples, 4u);
}

// ---- OBJ --------------------------------------------------------------------------------------------------

TEST_F(ExportFiles, ObjLinesReadBackExactly) {
    const Curves a("a", 2, 4), b("b", 1, 3);
    const CurveGeometry all[] = {a.geometry, b.geometry};
    write_curves(path("x.obj"), all, 1.0, 24.0);
    std::istringstream text(get("x.obj"));
    std::vector<std::string> numbers;
    std::vector<std::vector<size_t>> lines;
    for (std::string row; std::getline(text, row);) {
        std::istringstream words(row);
        std::string keyword, word;
        words >> keyword;
        if (keyword == "l") lines.emplace_back();
        while (words >> word)
            if (keyword == "v")
                numbers.push_back(word);
            else if (keyword == "l")
                lines.back().push_back(std::stoul(word));
    }
    EXPECT_EQ(lines, (std::vector<std::vector<size_t>>{{1, 2, 3, 4}, {5, 6, 7, 8}, {9, 10, 11}}));
    ASSERT_EQ(numbers.size(), 33u);
    for (size_t i = 0; i < 11; ++i)
        for (size_t k = 0; k < 3; ++k)
            EXPECT_EQ(to_float(numbers[i * 3 + k]),
                      i < 8 ? a.cv(i / 4, uint32_t(i % 4))[k] : b.cv(0, uint32_t(i - 8))[k]);
}

TEST_F(ExportFiles, CollidersReadBackAsMeshes) {
    std::vector<MeshGeometry> meshes(3);
    const Mesh shapes[] = {sphere_mesh(1.0f, 6, 0.1f, 5.0f), box_mesh({1, 2, 3}), plane_mesh({1, 1}, 2)};
    size_t triangles = 0;
    for (size_t i = 0; i < 3; ++i) {
        meshes[i].name = "mesh";
        meshes[i].triangles = shapes[i].triangles;
        meshes[i].positions = {shapes[i].positions};
        if (i != 2) meshes[i].uvs = shapes[i].uvs;
        if (!shapes[i].normals.empty()) meshes[i].normals = {shapes[i].normals};
        triangles += shapes[i].triangles.size();
    }
    write_colliders_obj(path("c.obj"), meshes);
    EXPECT_EQ(load_mesh(path("c.obj"), false).triangles.size(), triangles);
    write_colliders_obj(path("s.obj"), std::span(meshes.data(), 1));
    const Mesh sphere = load_mesh(path("s.obj"), false);
    ASSERT_EQ(sphere.triangles, shapes[0].triangles);
    for (size_t v = 0; v < sphere.positions.size(); ++v) {
        ASSERT_EQ(sphere.positions[v], shapes[0].positions[v]);
        ASSERT_EQ(sphere.uvs[v], shapes[0].uvs[v]);
        ASSERT_LT((sphere.normals[v] - shapes[0].normals[v]).norm(), 1e-6f);
    }
}

} // namespace
} // namespace marram
