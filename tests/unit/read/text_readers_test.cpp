// SPDX-License-Identifier: Apache-2.0
// What all readers of text have in common: the encoding, strict numbers; and what real files of each format
// do.
#include "core/math/text.h"
#include "core/read/mesh_file.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"
#include "core/read/table_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include <unistd.h>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct TextReaders : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_text_test_" + std::to_string(::getpid()));
    TextReaders() { fs::create_directories(folder); }
    ~TextReaders() override { fs::remove_all(folder); }

    std::string write(const std::string& name, const std::string& bytes) const {
        std::ofstream(folder / name, std::ios::binary) << bytes;
        return (folder / name).string();
    }
    // What is wrong with a file; "" if it is read.
    std::string refusal(const std::string& name, const std::string& bytes,
                        const std::function<void(const std::string&)>& read) const {
        try {
            read(write(name, bytes));
        } catch (const InputError& error) {
            return to_string(error.problems.at(0)).substr(folder.string().size() + 1);
        }
        return "";
    }
};

template <typename Points>
std::string points_text(const Points& points) {
    std::string text;
    for (const auto& p : points) text += fmt::format("({} {} {})", p.x(), p.y(), p.z());
    return text;
}
std::string mesh_text(const std::string& path) {
    const Mesh mesh = load_mesh(path, false);
    return fmt::format("{} {}", points_text(mesh.positions), fmt::join(mesh.triangles[0], " "));
}
std::string strands_text(const std::string& path) {
    const StrandFile strands = load_strand_file(path, {});
    return fmt::format("{} {}", points_text(strands.samples[0].points), fmt::join(strands.counts, " "));
}
std::string polylines_text(const std::string& path) {
    std::string text;
    for (const Polyline& line : load_polylines(path)) text += points_text(line.points) + ";";
    return text;
}
std::string table_text(const std::string& path) {
    const TableFile table = read_table_file(path);
    return fmt::format("{}|{}", fmt::join(table.columns, "|"), fmt::join(table.values, " "));
}

struct TextReader {
    std::string name, text;
    std::function<std::string(const std::string&)> read;
};

const std::string ply_points = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
                               "y\nproperty float z\n";
const std::string usda_metres = "#usda 1.0\n( metersPerUnit = 1 )\n";
std::string usda_prim(const std::string& name, const std::string& more = "") {
    return "def BasisCurves \"" + name +
           "\"\n{\nuniform token type = \"linear\"\nint[] curveVertexCounts = [2]\n"
           "point3f[] points = [(0, 0, 0), (0, 1, 0)]\n" +
           more + "}\n";
}

const std::vector<TextReader> text_readers = {
    {"m.obj", "v 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n", mesh_text},
    {"m.ply",
     ply_points +
         "element face 1\nproperty list uchar int vertex_indices\nend_header\n1 0 0\n0 1 0\n0 0 1\n3 "
         "0 1 2\n",
     mesh_text},
    {"s.obj", "v 1 0 0\nv 0 1 0\nv 0 0 1\nl 1 2 3\n", strands_text},
    {"s.ply", ply_points + "property int strand_id\nend_header\n1 0 0 7\n0 1 0 7\n0 0 1 7\n", strands_text},
    {"s.usda", usda_metres + usda_prim("a"), strands_text},
    {"p.obj", "v 1 0 0\nv 0 1 0\nv 0 0 1\nl 1 2 3\n", polylines_text},
    {"p.ply", ply_points + "end_header\n1 0 0\n0 1 0\n0 0 1\n", polylines_text},
    {"p.usda", usda_metres + usda_prim("a"), polylines_text},
    {"t.csv", "time,speed\n0,5\n1,6\n", table_text},
};

TEST_F(TextReaders, SkipAByteOrderMark) {
    for (const TextReader& reader : text_readers) {
        const std::string plain = reader.read(write(reader.name, reader.text));
        EXPECT_EQ(reader.read(write(reader.name, "\xef\xbb\xbf" + reader.text)), plain) << reader.name;
        for (const char* mark : {"\xff\xfe", "\xfe\xff"})
            EXPECT_NE(
                refusal(reader.name, mark + reader.text, reader.read).find("1:1: is text in UTF-16: save it"),
                std::string::npos)
                << reader.name;
    }
}

TEST_F(TextReaders, NumbersAreWholeTokens) {
    double number = 0.0;
    for (const char* good : {"1", "+1.5", "-2e3", "1e-999", ".5", "0.0000001"})
        EXPECT_EQ(parse_number(good, number), NumberFault::none) << good;
    for (const char* bad : {"", "+", "+-1", "1x", "1,5", "0x10", "1e", "1 "})
        EXPECT_EQ(parse_number(bad, number), NumberFault::not_a_number) << bad;
    for (const char* vast : {"1e999", "-1e999", "inf", "nan"})
        EXPECT_EQ(parse_number(vast, number), NumberFault::not_finite) << vast;
    EXPECT_EQ(parse_number("0." + std::string(400, '0') + "1", number), NumberFault::none);
    EXPECT_EQ(number, 0.0);
    int64_t whole = 5;
    EXPECT_EQ(parse_whole("+7", 0, 9, whole), WholeFault::none);
    EXPECT_EQ(whole, 7);
    for (const char* bad : {"", "3abc", "2.9", "1e1", "+-1"})
        EXPECT_EQ(parse_whole(bad, -9, 9, whole), WholeFault::not_whole) << bad;
    for (const char* vast : {"10", "-10", "99999999999999999999"})
        EXPECT_EQ(parse_whole(vast, -9, 9, whole), WholeFault::out_of_range) << vast;
    EXPECT_EQ(whole, 7);
}

// Each reader's indices, ids and counts, with @ in the place of one.
TEST_F(TextReaders, RefuseNumbersWithATailOrOutOfRange) {
    const std::vector<TextReader> indices = {
        {"m.obj", "v 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 @\n", mesh_text},
        {"m.ply",
         ply_points + "element face 1\nproperty list uchar int vertex_indices\nend_header\n1 0 0\n0 1 0\n0 0 "
                      "1\n3 0 1 @\n",
         mesh_text},
        {"s.obj", "v 1 0 0\nv 0 1 0\nv 0 0 1\nl 1 2 @\n", strands_text},
        {"p.obj", "v 1 0 0\nv 0 1 0\nv 0 0 1\nl 1 2 @\n", polylines_text},
        {"u.obj", "v 1 0 0\nv 0 1 0\nvt 0 0\nl 1/1 2/@\n", polylines_text},
        {"s.ply", ply_points + "property int strand_id\nend_header\n1 0 0 @\n0 1 0 7\n0 0 1 7\n",
         strands_text},
        {"e.ply",
         ply_points + "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n1 0 0\n0 1 "
                      "0\n0 0 1\n0 @\n",
         strands_text},
        {"c.ply", ply_points + "property uchar red\nend_header\n1 0 0 @\n0 1 0 7\n0 0 1 7\n", strands_text},
        {"h.ply",
         "ply\nformat ascii 1.0\nelement vertex @\nproperty float x\nproperty float y\nproperty float "
         "z\nend_header\n1 0 0\n0 1 0\n0 0 1\n",
         polylines_text},
        {"s.usda",
         usda_metres + "def BasisCurves \"a\"\n{\nuniform token type = \"linear\"\nint[] curveVertexCounts = "
                       "[@]\npoint3f[] points = [(0, 0, 0), (0, 1, 0), (0, 2, 0)]\n}\n",
         strands_text},
        {"i.usda", usda_metres + usda_prim("a", "int primvars:n = @\n"), strands_text},
    };
    for (const TextReader& reader : indices)
        for (const std::string bad : {"4294967299", "3abc", "2.9", "99999999999999999999", "0x2"}) {
            std::string text = reader.text;
            text.replace(text.find('@'), 1, bad);
            EXPECT_NE(refusal(reader.name, text, reader.read), "") << reader.name << " " << bad;
        }
    for (const TextReader& reader :
         text_readers) // the first number with a decimal digit of each is a coordinate
        for (const std::string bad : {"1abc", "1e999", "0x1", "+-1"}) {
            std::string text = reader.text;
            const char* number = reader.name.ends_with(".obj")    ? "0 0"
                                 : reader.name.ends_with(".ply")  ? "\n0 1"
                                 : reader.name.ends_with(".usda") ? "0, 1"
                                                                  : "\n0,5";
            const size_t at = text.find(number) + std::string_view(number).find('0');
            text.replace(at, 1, bad);
            EXPECT_NE(refusal(reader.name, text, reader.read), "") << reader.name << " " << bad;
        }
}

TEST_F(TextReaders, ObjFacesMayNameNormalsAndUvsThatTheFileLacks) {
    const std::string vertices = "v -1 0 1\nv 1 0 1\nv 1 0 -1\n";
    const Mesh plain = load_mesh(write("m.obj", vertices + "f 1 2 3\n"), true);
    for (const char* face :
         {"f 1//1 2//2 3//3\n", "f 1/1 2/2 3/3\n", "f 1/1/1 2/2/2 3/3/3\n", "f 1//-1 2//-2 3//-3\n"}) {
        const Mesh mesh = load_mesh(write("m.obj", vertices + face), true);
        EXPECT_EQ(mesh.positions, plain.positions) << face;
        EXPECT_EQ(mesh.triangles, plain.triangles) << face;
        EXPECT_EQ(mesh.normals, plain.normals) << face;
        EXPECT_TRUE(mesh.uvs.empty()) << face;
    }
    const auto warning = [&](const std::string& text) { // of one line, without the folder
        std::vector<Problem> warnings;
        load_mesh(write("m.obj", text), {.warnings = &warnings});
        EXPECT_LE(warnings.size(), 1U);
        return warnings.empty() ? "" : to_string(warnings[0]).substr(folder.string().size() + 1);
    };
    const std::string rest = " that the file does not have, read without them: export the mesh with them, or "
                             "without these indices";
    EXPECT_EQ(warning(vertices + "f 1 2 3\n"), "");
    EXPECT_EQ(warning(vertices + "vn 0 1 0\nf 1//1 2//1 3//1\n"), "");
    EXPECT_EQ(warning("\n" + vertices + "f 1 2 3\nf 1 2//1 3\n"),
              "m.obj:6:8: a face refers to normals (vn)" + rest);
    EXPECT_EQ(warning(vertices + "f 1/-1 \\\n 2 3\nf 1/2/3 2 3/1\nf 3 1 2\nf 1/1 2 3\n"),
              "m.obj:4:5: 3 faces refer to uvs (vt) and normals (vn)" + rest);
    EXPECT_EQ(warning(vertices + "vt 0 0\n\nf 1/1/7 2/1 \\\n 3//8\nf 3//9 2 1\n"),
              "m.obj:6:7: 2 faces refer to normals (vn)" + rest);
    // Some, but not those: something is missing.
    EXPECT_EQ(
        refusal("m.obj", vertices + "vn 0 1 0\nf 1//1 2//2 3//1\n", mesh_text),
        "m.obj:5:11: normal index 2 is out of range, the file defines 1: check that the file is complete");
    EXPECT_EQ(refusal("m.obj", vertices + "f 1//-1 2//-1 3//-1\nvn 0 1 0\n", mesh_text),
              "m.obj:4:6: a normal index counts back beyond the first: check that the file is complete");
}

TEST_F(TextReaders, PlyEntriesMayTakeSeveralLines) {
    const std::string head =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
        "y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    const std::string whole = mesh_text(write("m.ply", head + "1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n"));
    EXPECT_EQ(mesh_text(write("m.ply", head + "1\n0\n0\n0\n1\n0\n0\n0\n1\n3\n0\n1\n2\n")), whole);
    EXPECT_EQ(mesh_text(write("m.ply", head + "1 0\n0\n\n0 1\r\n 0\n0 0 1\n3\n0 1 2")), whole);
    // A value too few or too many in a line is found all the same.
    EXPECT_EQ(refusal("m.ply", head + "1 0 0\n0 1\n0 0 1\n3 0 1 2\n", mesh_text),
              "m.ply:11:4: vertex 1: the line ends before \"z\": check the header against the lines");
    EXPECT_EQ(refusal("m.ply", head + "1 0 0\n0 1 0\n0 0\n3 0 1 2\n", mesh_text),
              "m.ply:12:4: vertex 2: the line ends before \"z\": check the header against the lines");
    EXPECT_NE(refusal("m.ply", head + "1 0 0\n0 1 0 0\n0 0 1\n3 0 1 2\n", mesh_text)
                  .find("11:7: vertex 1: the line holds"),
              std::string::npos);
    EXPECT_NE(refusal("m.ply", head + "1\n0\n0\n0\n1\n0\n0\n0\n3\n0\n1\n2\n", mesh_text), "");
}

TEST_F(TextReaders, TablesMayHaveOtherSeparators) {
    const std::string plain = table_text(write("t.csv", "time,speed (m/s)\n0,5.5\n1,6\n"));
    EXPECT_EQ(plain, "time|speed (m/s)|0 5.5 1 6");
    EXPECT_EQ(table_text(write("t.csv", "time;speed (m/s)\r\n0;5.5\r\n\r\n1; 6")), plain);
    EXPECT_EQ(table_text(write("t.csv", "time\tspeed (m/s)\n0\t5.5\n1\t6\n")), plain);
    EXPECT_EQ(refusal("t.csv", "time;speed\n0;5,5\n", table_text),
              "t.csv:2: column 2 is \"5,5\": write decimals with a point, as 3.5");
}

// ---- Points without edges or ids, and strands the wrong way round

const std::string ply_cloud =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty "
    "float z\nproperty float width\nproperty float wet\nend_header\n"
    "0 0 0 1 5\n0 1 0 2 6\n1 0 0 3 7\n1 1 0 4 8\n";

TEST_F(TextReaders, PointsAloneAreStrandsOfEqualCounts) {
    const std::string file = write("c.ply", ply_cloud);
    const StrandFile one = load_strand_file(file, {});
    EXPECT_EQ(one.counts, std::vector<uint32_t>{4});
    ASSERT_EQ(one.warnings.size(), 1u);
    EXPECT_NE(one.warnings[0].find("its 4 points are read as one strand; they look like "
                                   "strands of 2: give cvs_per_strand = 2"),
              std::string::npos);
    const StrandFile two = load_strand_file(file, {.cvs_per_strand = 2});
    EXPECT_EQ(two.counts, (std::vector<uint32_t>{2, 2}));
    EXPECT_EQ(two.samples[0].points, one.samples[0].points);
    EXPECT_TRUE(two.warnings.empty());
    const auto of_three = [](const std::string& path) { load_strand_file(path, {.cvs_per_strand = 3}); };
    EXPECT_EQ(refusal("c.ply", ply_cloud, of_three),
              "c.ply: its 4 points are not strands of 3 each: give another cvs_per_strand");
    for (const TextReader& reader : text_readers) {
        if (!reader.name.starts_with("s.")) continue;
        EXPECT_NE(refusal(reader.name, reader.text, of_three).find("leave cvs_per_strand out"),
                  std::string::npos)
            << reader.name;
    }
}

TEST_F(TextReaders, StrandsAreReversedWithTheirValues) {
    const StrandFile strands =
        load_strand_file(write("c.ply", ply_cloud), {.cvs_per_strand = 2, .reverse = true});
    EXPECT_EQ(strands.samples[0].points, (std::vector<Vec3f>{{0, 1, 0}, {0, 0, 0}, {1, 1, 0}, {1, 0, 0}}));
    EXPECT_EQ(strands.samples[0].widths, (std::vector<float>{2, 1, 4, 3}));
    EXPECT_EQ(find_attribute(strands.attributes, "wet")->values, (std::vector<float>{6, 5, 8, 7}));
    const StrandFile tinted = load_strand_file(
        write("t.usda",
              usda_metres + usda_prim("a", "color3f[] primvars:c = [(1, 2, 3), (4, 5, 6)] ( interpolation = "
                                           "\"vertex\" )\nfloat primvars:one = 7\n")),
        {.reverse = true});
    EXPECT_EQ(find_attribute(tinted.attributes, "c")->values, (std::vector<float>{4, 5, 6, 1, 2, 3}));
    EXPECT_EQ(find_attribute(tinted.attributes, "one")->values, std::vector<float>{7});
}

} // namespace
} // namespace marram
