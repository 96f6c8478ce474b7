// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/mesh_sides.h"
#include "core/math/problem.h"
#include "core/read/mesh_file.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <random>
#include <sstream>

namespace marram {
namespace {

namespace fs = std::filesystem;
using Triangle = std::array<uint32_t, 3>;
using Key = std::array<float, 3>;

// This test's own folder, removed with it.
struct MeshFiles : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / ("marram_mesh_test_" + std::to_string(::getpid()));
    MeshFiles() { fs::create_directories(folder); }
    ~MeshFiles() override { fs::remove_all(folder); }

    Mesh load(const std::string& name, const std::string& bytes, bool smooth = false) const {
        const fs::path path = folder / name;
        std::ofstream(path, std::ios::binary) << bytes;
        return load_mesh(path.string(), smooth);
    }
};

Key key(const Vec3f& p) { return {p.x() + 0.0f, p.y() + 0.0f, p.z() + 0.0f}; }

Vec3d cross(const Mesh& mesh, const Triangle& t) {
    const Vec3d a = mesh.positions[t[0]].cast<double>();
    return (mesh.positions[t[1]].cast<double>() - a).cross(mesh.positions[t[2]].cast<double>() - a);
}
double area(const Mesh& mesh) {
    double sum = 0.0;
    for (const Triangle& t : mesh.triangles) sum += cross(mesh, t).norm() / 2.0;
    return sum;
}
double volume(const Mesh& mesh) {
    double sum = 0.0;
    for (const Triangle& t : mesh.triangles)
        sum += cross(mesh, t).dot(mesh.positions[t[0]].cast<double>()) / 6.0;
    return sum;
}
// Whether every directed edge between positions has exactly one opposite edge.
bool is_closed(const Mesh& mesh) {
    std::map<std::pair<Key, Key>, int> edges;
    for (const Triangle& t : mesh.triangles)
        for (int k = 0; k < 3; ++k)
            ++edges[{key(mesh.positions[t[size_t(k)]]), key(mesh.positions[t[size_t((k + 1) % 3)]])}];
    for (const auto& [edge, count] : edges) {
        const auto other = edges.find({edge.second, edge.first});
        if (count != 1 || other == edges.end()) return false;
    }
    return true;
}
void expect_sound(const Mesh& mesh) {
    for (const Triangle& t : mesh.triangles) {
        for (uint32_t v : t) ASSERT_LT(v, mesh.positions.size());
        ASSERT_GT(cross(mesh, t).norm(), 0.0);
        if (mesh.normals.empty()) continue;
        for (uint32_t v : t) ASSERT_GT(cross(mesh, t).normalized().dot(mesh.normals[v].cast<double>()), 0.5);
    }
    for (const Vec3f& n : mesh.normals) ASSERT_NEAR(n.norm(), 1.0f, 1e-5f);
    ASSERT_TRUE(mesh.uvs.empty() || mesh.uvs.size() == mesh.positions.size());
    for (const Vec2f& uv : mesh.uvs) ASSERT_TRUE(uv.minCoeff() >= 0.0f && uv.maxCoeff() <= 1.0f);
    ASSERT_GE(mesh.positions.capacity() * sizeof(Vec3f), mesh.positions.size() * sizeof(Vec3f) + 16);
    ASSERT_GE(mesh.triangles.capacity() * sizeof(Triangle), mesh.triangles.size() * sizeof(Triangle) + 16);
}

// ---- Built-in meshes --------------------------------------------------------------------------------------

TEST(MeshShapes, PlaneFacesUp) {
    const Mesh mesh = plane_mesh({4.0f, 3.0f}, 5);
    expect_sound(mesh);
    EXPECT_EQ(mesh.triangles.size(), 50u);
    EXPECT_EQ(mesh.positions.size(), 36u);
    EXPECT_NEAR(area(mesh), 12.0, 1e-5);
    for (const Triangle& t : mesh.triangles) EXPECT_GT(cross(mesh, t).y(), 0.0);
}

TEST(MeshShapes, BoxIsClosedAndOutward) {
    const Mesh mesh = box_mesh({1.0f, 2.0f, 3.0f});
    expect_sound(mesh);
    EXPECT_EQ(mesh.positions.size(), 24u);
    EXPECT_TRUE(mesh.normals.empty());
    EXPECT_TRUE(is_closed(mesh));
    EXPECT_NEAR(volume(mesh), 6.0, 1e-6);
    EXPECT_NEAR(area(mesh), 22.0, 1e-6);
}

TEST(MeshShapes, SphereIsClosedOutwardAndEven) {
    for (int divisions : {1, 2, 3, 40}) {
        const Mesh mesh = sphere_mesh(2.0f, divisions, 0.0f, 0.0f);
        EXPECT_EQ(mesh.triangles.size(), size_t(8 * divisions * divisions));
        EXPECT_TRUE(is_closed(mesh));
        EXPECT_GT(volume(mesh), 0.0);
        if (divisions < 40) continue;
        expect_sound(mesh);
        EXPECT_NEAR(volume(mesh), 4.0 / 3.0 * pi * 8.0, 0.1);
        EXPECT_NEAR(area(mesh), 16.0 * pi, 0.1);
        double least = 1e9, most = 0.0;
        for (const Triangle& t : mesh.triangles) {
            least = std::min(least, cross(mesh, t).norm());
            most = std::max(most, cross(mesh, t).norm());
            double lowest = 1.0, highest = 0.0; // no triangle spans the seam
            for (uint32_t v : t)
                lowest = std::min(lowest, double(mesh.uvs[v].x())),
                highest = std::max(highest, double(mesh.uvs[v].x()));
            EXPECT_LT(highest - lowest, 0.26);
        }
        EXPECT_LT(most / least, 2.0);
    }
    EXPECT_EQ(sphere_mesh(1.0f, 71, 0.0f, 0.0f).triangles.size(), 40328u);
}

TEST(MeshShapes, BumpsHaveTheNormalsOfTheirSurface) {
    const Mesh mesh = sphere_mesh(1.0f, 120, 0.1f, 9.0f);
    expect_sound(mesh);
    EXPECT_TRUE(is_closed(mesh));
    const std::vector<Vec3f> computed = vertex_normals(mesh.positions, mesh.triangles);
    double worst = 1.0;
    for (size_t v = 0; v < computed.size(); ++v)
        worst = std::min(worst, double(computed[v].dot(mesh.normals[v])));
    EXPECT_GT(worst, 0.999);
}

TEST(MeshShapes, HeightfieldStandsOnItsSamples) {
    std::vector<float> heights(20 * 10);
    for (size_t i = 0; i < heights.size(); ++i) heights[i] = float(i % 20) * 0.1f;
    const Mesh mesh = heightfield_mesh(heights, 20, 10, {19.0f, 9.0f}, 2.0f);
    expect_sound(mesh);
    EXPECT_EQ(mesh.triangles.size(), 2u * 19 * 9);
    EXPECT_NEAR(mesh.positions[19].y(), 3.8f, 1e-5f);
    EXPECT_FLOAT_EQ(mesh.positions[0].z(), -4.5f);
    EXPECT_FLOAT_EQ(mesh.uvs[0].y(), 1.0f);
    for (const Vec3f& n : mesh.normals) EXPECT_LT((n - Vec3f(-0.2f, 1.0f, 0.0f).normalized()).norm(), 1e-5f);
    heights[7] = NAN;
    EXPECT_THROW(heightfield_mesh(heights, 20, 10, {1.0f, 1.0f}, 1.0f), InputError);
}

TEST(MeshShapes, RefuseSenselessSizes) {
    EXPECT_THROW(plane_mesh({0.0f, 1.0f}, 1), InputError);
    EXPECT_THROW(plane_mesh({1.0f, 1.0f}, 0), InputError);
    EXPECT_THROW(plane_mesh({1.0f, 1.0f}, 2000000000), InputError);
    EXPECT_THROW(box_mesh({1.0f, NAN, 1.0f}), InputError);
    EXPECT_THROW(sphere_mesh(1.0f, 4, 1.5f, 1.0f), InputError);
}

// ---- Normals ----------------------------------------------------------------------------------------------

TEST(VertexNormals, WeighByAngleAndShareByPosition) {
    Mesh box = box_mesh({2.0f, 2.0f, 2.0f});
    const std::vector<Vec3f> normals = vertex_normals(box.positions, box.triangles);
    // For any triangulation, the normal at a cube's corner is its diagonal.
    for (size_t v = 0; v < normals.size(); ++v)
        EXPECT_LT((normals[v] - box.positions[v].normalized()).norm(), 1e-6f);
}

TEST(VertexNormals, SurviveDegenerateAndOppositeTriangles) {
    const std::vector<Vec3f> p = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0},
                                  {9, 9, 9}, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    const std::vector<Triangle> t = {{0, 1, 2}, {0, 1, 3}, {0, 0, 0}, {5, 7, 6}};
    const std::vector<Vec3f> n = vertex_normals(p, t);
    EXPECT_EQ(n[0], Vec3f(0, 0, 1)); // two sheets back to back keep separate normals
    EXPECT_EQ(n[5], Vec3f(0, 0, -1));
    for (const Vec3f& normal : n) EXPECT_NEAR(normal.norm(), 1.0f, 1e-6f);
}

TEST(VertexNormals, KeepTheirBitsAtAnyScaleOfThreads) {
    const Mesh mesh = sphere_mesh(1.0f, 60, 0.2f, 7.0f);
    const std::vector<Vec3f> many = vertex_normals(mesh.positions, mesh.triangles);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const std::vector<Vec3f> single = vertex_normals(mesh.positions, mesh.triangles);
    EXPECT_EQ(std::memcmp(many.data(), single.data(), many.size() * sizeof(Vec3f)), 0);
    for (float scale : {1e-30f, 1e15f}) {
        std::vector<Vec3f> scaled = mesh.positions;
        for (Vec3f& p : scaled) p *= scale;
        const std::vector<Vec3f> normals = vertex_normals(scaled, mesh.triangles);
        for (size_t v = 0; v < many.size(); ++v) ASSERT_LT((normals[v] - many[v]).norm(), 1e-4f);
    }
}

// ---- OBJ --------------------------------------------------------------------------------------------------

const std::string quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST_F(MeshFiles, ObjReadsIndicesOfAllForms) {
    for (const char* face :
         {"f 1 2 3 4", "f -4 -3 -2 -1", "f 1/ 2/ 3/ 4/", "f\t1 2 3 4 # comment", "f 1 2 \\\n 3 4"}) {
        const Mesh mesh = load("a.obj", quad + face + "\n");
        EXPECT_EQ(mesh.triangles.size(), 2u) << face;
        EXPECT_EQ(mesh.positions.size(), 4u);
        EXPECT_TRUE(mesh.normals.empty() && mesh.uvs.empty());
        EXPECT_NEAR(area(mesh), 1.0, 1e-7);
        EXPECT_GT(cross(mesh, mesh.triangles[0]).z(), 0.0);
    }
    EXPECT_EQ(load("late.obj", "f 1 2 3\n" + quad).triangles.size(), 1u); // vertices after the faces
    std::string carriage = quad + "f 1 2 3 4";
    std::replace(carriage.begin(), carriage.end(), '\n', '\r');
    EXPECT_EQ(load("mac.obj", carriage).triangles.size(), 2u);
    EXPECT_EQ(load("path.obj", "# from C:\\models\\\n" + quad + "f 1 2 3\n").positions.size(), 4u);
}

TEST_F(MeshFiles, ObjSplitsVerticesAndSeamsStaySmooth) {
    const std::string text =
        "v 0 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 0.5 0.5\n"
        "f 1/1 2/2 3/3\nf 1/4 3/3 4/1\nf 1/2 4/3 5/1\n";
    const Mesh mesh = load("seam.obj", text, true);
    EXPECT_EQ(mesh.positions.size(), 8u); // vertex 1 appears three times, vertex 4 twice
    ASSERT_EQ(mesh.normals.size(), 8u);
    std::map<Key, Vec3f> seen;
    for (size_t v = 0; v < mesh.positions.size(); ++v) {
        const auto [at, fresh] = seen.insert({key(mesh.positions[v]), mesh.normals[v]});
        EXPECT_EQ(at->second, mesh.normals[v]);
    }
    EXPECT_TRUE(load("flat.obj", text, false).normals.empty());
}

TEST_F(MeshFiles, ObjKeepsNormalsAndFillsMissingOnes) {
    const Mesh mesh = load("n.obj", quad + "vn 0 0 -5\nvn 0 0 0\nf 1//1 2//1 3//2\nf 1//1 3//2 4\n");
    ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
    EXPECT_EQ(mesh.normals[0], Vec3f(0, 0, -1)); // the file's, normalised
    EXPECT_EQ(mesh.normals[2], Vec3f(0, 0, -1)); // zero in the file: on the side of the others
    EXPECT_EQ(mesh.normals[3], Vec3f(0, 0, -1)); // none in the file
}

TEST_F(MeshFiles, PolygonsAreCutWithinThemselves) {
    const struct {
        const char *vertices, *face;
        double area;
    } cases[] = {
        {"v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.5 0\n", "f 1 2 3 4", 1.5},        // an arrowhead
        {"v 0 0 0\nv 1 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\n", "f 1 2 3 4 5", 2}, // one corner on an edge
        {"v 0 0 0\nv 3 0 0\nv 3 3 0\nv 2 3 0\nv 2 1 0\nv 1 1 0\nv 1 3 0\nv 0 3 0\n", "f 1 2 3 4 5 6 7 8",
         7}, // a U
        {"v 0 0 0\nv 0 0 3\nv 3 0 3\nv 3 0 0\nv 1 0 1\nv 2 0 1\nv 2 0 2\nv 1 0 2\n", "f 1 2 3 4 1 5 6 7 8 5",
         8}, // a square with a hole, by a slit
    };
    for (const auto& c : cases) {
        const Mesh mesh = load("p.obj", std::string(c.vertices) + c.face + "\n");
        EXPECT_NEAR(area(mesh), c.area, 1e-6) << c.face;
        Vec3d sum = Vec3d::Zero(); // all have the same winding: signed areas add up, too
        for (const Triangle& t : mesh.triangles) sum += cross(mesh, t) / 2.0;
        EXPECT_NEAR(sum.norm(), c.area, 1e-6) << c.face;
    }
}

// ---- PLY --------------------------------------------------------------------------------------------------

struct PlyBytes {
    std::string format, bytes;
    template <typename Value>
    void add(Value value) {
        if (format == "ascii") {
            bytes += std::to_string(value) + " ";
            return;
        }
        char raw[sizeof(Value)];
        std::memcpy(raw, &value, sizeof(Value));
        if (format == "binary_big_endian") std::reverse(raw, raw + sizeof(Value));
        bytes.append(raw, sizeof(Value));
    }
    void end_line() {
        if (format == "ascii") bytes += "\n";
    }
};

std::string ply_quad(const std::string& format, const std::string& newline = "\n") {
    PlyBytes out{format, ""};
    for (const char* line :
         {"ply", "format %", "comment made by hand", "element camera 1", "property list short double pose",
          "element vertex 4", "property double x", "property float y", "property uchar red",
          "property short z", "property float u", "property double v", "element face 1",
          "property uchar flags", "property list uint ushort vertex_index", "element tail 1",
          "property int last", "end_header"}) {
        const std::string text = line;
        out.bytes += (text == "format %" ? "format " + format + " 1.0" : text) + newline;
    }
    out.add<int16_t>(2), out.add(1.5), out.add(2.5), out.end_line();
    for (int v = 0; v < 4; ++v) {
        out.add(double(v == 1 || v == 2)), out.add(float(v >= 2)), out.add<uint8_t>(200),
            out.add<int16_t>(-3);
        out.add(0.25f), out.add(0.5), out.end_line();
    }
    out.add<uint8_t>(7), out.add<uint32_t>(4);
    for (uint16_t v = 0; v < 4; ++v) out.add(v);
    out.end_line(), out.add<int32_t>(1), out.end_line();
    return out.bytes;
}

TEST_F(MeshFiles, PlyReadsAllEncodings) {
    for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"})
        for (const char* newline : {"\n", "\r\n", "\r"}) {
            const Mesh mesh = load("q.ply", ply_quad(format, newline), true);
            EXPECT_EQ(mesh.triangles.size(), 2u);
            ASSERT_EQ(mesh.positions.size(), 4u);
            EXPECT_EQ(mesh.positions[2], Vec3f(1, 1, -3));
            EXPECT_EQ(mesh.uvs[3], Vec2f(0.25f, 0.5f));
            EXPECT_EQ(mesh.normals[1], Vec3f(0, 0, 1));
        }
}

// Line endings of an editor that changes some lines only.
TEST_F(MeshFiles, PlyReadsMixedLineEndings) {
    for (const char* format : {"ascii", "binary_little_endian"})
        for (const char* from : {"\n", "\r\n"}) {
            std::string text = ply_quad(format, from);
            const size_t first = text.find(from), end = std::string(from).size();
            text.replace(first, end, *from == '\n' ? "\r\n" : "\n"); // behind "ply"
            EXPECT_EQ(load("q.ply", text, true).triangles.size(), 2u) << format;
        }
}

TEST_F(MeshFiles, PlyKeepsNormalsAndFloats) {
    const Mesh mesh =
        load("n.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                      "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
                      "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                      "0.1 0 1e-50 0 0 -1\n+1 0 0 0 2 0\n0 1 0 0 0 0\n\n3 0 1 2\n");
    EXPECT_EQ(mesh.positions[0], Vec3f(0.1f, 0.0f, 0.0f));
    EXPECT_EQ(mesh.normals[1], Vec3f(0, 1, 0));
    EXPECT_EQ(mesh.normals[2], Vec3f(0, 0, -1)); // on the side of the others
}

// ---- Sides ------------------------------------------------------------------------------------------------

// An .obj of `n` x `n` squares in the plane y = 0, facing up; those for which reversed(square) holds face
// down. vn: "" or lines.
std::string squares(int n, const std::function<bool(int)>& reversed, const std::string& normal = "") {
    std::string text = normal;
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) text += "v " + std::to_string(i) + " 0 " + std::to_string(-j) + "\n";
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const int a = j * (n + 1) + i + 1;
            std::array<int, 4> corners = {a, a + 1, a + n + 2, a + n + 1};
            if (reversed(j * n + i)) std::swap(corners[1], corners[3]);
            text += "f";
            for (const int v : corners) text += " " + std::to_string(v) + (normal.empty() ? "" : "//1");
            text += "\n";
        }
    return text;
}

// A cube of half-width h; inwards: wound the wrong way. first: number of vertices before it.
std::string cube(double h, bool inwards, int first = 0) {
    std::ostringstream text;
    for (int v = 0; v < 8; ++v)
        text << "v " << (v & 1 ? h : -h) << ' ' << (v & 2 ? h : -h) << ' ' << (v & 4 ? h : -h) << "\n";
    for (const std::array<int, 4> f :
         {std::array{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
        text << "f";
        for (int k = 0; k < 4; ++k) text << ' ' << first + f[size_t(inwards ? 3 - k : k)] + 1;
        text << "\n";
    }
    return text.str();
}

// A prism over an anticlockwise polygon in x and y, between two z. Other parameters: as for cube().
std::string prism(const std::vector<Vec2d>& polygon, double low, double high, bool inwards, int first = 0) {
    const int n = int(polygon.size());
    std::ostringstream text;
    for (const double z : {low, high})
        for (const Vec2d& p : polygon) text << "v " << p.x() << ' ' << p.y() << ' ' << z << "\n";
    std::vector<std::vector<int>> faces(2);
    for (int i = 0; i < n; ++i) {
        faces[0].push_back(n - 1 - i);
        faces[1].push_back(n + i);
        faces.push_back({i, (i + 1) % n, n + (i + 1) % n, n + i});
    }
    for (std::vector<int>& f : faces) {
        if (inwards) std::ranges::reverse(f);
        text << "f";
        for (const int v : f) text << ' ' << first + v + 1;
        text << "\n";
    }
    return text.str();
}
std::vector<Vec2d> square(double x, double y, double half) {
    return {{x - half, y - half}, {x + half, y - half}, {x + half, y + half}, {x - half, y + half}};
}

struct MeshSidesTest : MeshFiles {
    MeshSides sides;
    Mesh settled(const std::string& bytes, bool smooth = true, bool flip = false) {
        const fs::path path = folder / "sides.obj";
        std::ofstream(path, std::ios::binary) << bytes;
        return load_mesh(path.string(), {.smooth = smooth, .flip = flip, .sides = &sides});
    }
    static double up(const Mesh& mesh) { // least height of a triangle's normal
        double least = 1.0;
        for (const Triangle& t : mesh.triangles) least = std::min(least, cross(mesh, t).normalized().y());
        return least;
    }
};

TEST_F(MeshSidesTest, NeighboursAgreeWithTheMajority) {
    const Mesh right = settled(squares(4, [](int) { return false; }));
    EXPECT_EQ(sides.turned, 0U);
    const auto some = [](int i) { return i == 5 || i == 10; };
    Mesh mesh = settled(squares(4, some));
    EXPECT_EQ(sides.turned, 4U);
    EXPECT_LT((sides.first_turned - Vec3f(1.5F, 0.0F, -1.5F)).norm(), 0.3F);
    EXPECT_GT(up(mesh), 0.99);
    EXPECT_EQ(mesh.normals, right.normals) << "also where neighbours met that faced each other";
    mesh = settled(squares(4, [&](int i) { return !some(i); })); // the majority looks down
    EXPECT_EQ(sides.turned, 4U);
    EXPECT_LT(up(mesh), -0.99);
    mesh = settled(squares(4, some, "vn 0 1 0\n"));
    EXPECT_EQ(sides.turned, 4U);
    EXPECT_GT(up(mesh), 0.99);
    mesh = settled(squares(
        2, [](int) { return true; }, "vn 0 1 0\n")); // all are wound against their normals
    EXPECT_EQ(sides.turned, 8U);
    EXPECT_GT(up(mesh), 0.99);
    settled(squares(2, some, "vn 0 1 0\n"), true, true); // flip: the other side, normals too
    EXPECT_EQ(sides.turned, 0U);
    mesh = settled(squares(2, some, "vn 0 1 0\n"), true, true);
    EXPECT_LT(up(mesh), -0.99);
    EXPECT_EQ(mesh.normals[0], Vec3f(0, -1, 0));
}

TEST_F(MeshSidesTest, ClosedPartsFaceOutwards) {
    EXPECT_GT(volume(settled(cube(1, false))), 7.9);
    EXPECT_EQ(sides.closed_parts, 1U);
    EXPECT_EQ(sides.inside_out, 0U);
    EXPECT_LT(volume(settled(cube(1, true))), -7.9) << "reported, not changed";
    EXPECT_EQ(sides.inside_out, 1U);
    EXPECT_EQ(sides.turned, 0U);
    const Mesh flipped = settled(cube(1, true), true, true);
    EXPECT_GT(volume(flipped), 7.9);
    expect_sound(flipped);                      // normals of the right side
    settled(cube(2, false) + cube(1, true, 8)); // a cavity
    EXPECT_EQ(sides.closed_parts, 2U);
    EXPECT_EQ(sides.inside_out, 0U);
    settled(cube(1, false) + cube(2, true, 8));
    EXPECT_EQ(sides.inside_out, 1U);
    std::string one = cube(1, false); // one side of it is wound inwards
    one.replace(one.find("f 1 3 4 2"), 9, "f 2 4 3 1");
    EXPECT_GT(volume(settled(one)), 7.9);
    EXPECT_EQ(sides.turned, 2U);
    EXPECT_EQ(sides.inside_out, 0U);
}

// A part is a cavity if it lies in another part, not in its bounds only.
TEST_F(MeshSidesTest, CavitiesLieInOtherParts) {
    const std::vector<Vec2d> corner = {{0, 0}, {4, 0}, {4, 1}, {1, 1}, {1, 4}, {0, 4}}; // an L
    const std::string body = prism(corner, 0, 1, false);
    const auto inside_out = [&](const std::string& text, size_t parts) {
        settled(text);
        EXPECT_EQ(sides.closed_parts, parts);
        return sides.inside_out;
    };
    EXPECT_EQ(inside_out(body, 1), 0U);
    EXPECT_EQ(inside_out(body + prism(square(3, 3, 0.5), 0.2, 0.8, true, 12), 2), 1U) << "in its notch";
    EXPECT_GT(sides.first_inside_out.x(), 2.0F);
    EXPECT_EQ(inside_out(body + prism(square(3, 3, 0.5), 0.2, 0.8, false, 12), 2), 0U);
    EXPECT_EQ(inside_out(body + prism(square(3, 0.5, 0.3), 0.2, 0.8, true, 12), 2), 0U) << "a cavity";
    EXPECT_EQ(inside_out(body + prism(square(0.5, 3, 0.3), 0.2, 0.8, true, 12), 2), 0U) << "a cavity";
    EXPECT_EQ(inside_out(body + prism(square(0.5, 3, 0.9), 0.2, 0.8, true, 12), 2), 1U)
        << "it crosses the body";
    // Rays along the axes run through edges of these.
    EXPECT_EQ(inside_out(cube(2, false) + cube(1, true, 8) + cube(0.5, false, 16), 3), 0U)
        << "a body in a cavity";
    EXPECT_EQ(inside_out(cube(2, false) + cube(1, true, 8) + cube(0.5, true, 16), 3), 1U)
        << "a body in a cavity";
    EXPECT_LT(sides.first_inside_out.norm(), 1.0F);
    // Their triangles agree after some have been turned.
    std::string turned = cube(2, false);
    turned.replace(turned.find("f 1 3 4 2"), 9, "f 2 4 3 1");
    EXPECT_EQ(inside_out(turned + cube(1, true, 8), 2), 0U);
    EXPECT_EQ(sides.turned, 2U);
}

TEST_F(MeshSidesTest, AStripWithOneSideIsLeftAlone) {
    std::string text;
    constexpr int n = 12;
    for (int i = 0; i < n; ++i)
        for (const double w : {-0.3, 0.3}) {
            const double along = 2.0 * pi * i / n, turn = 0.5 * along, r = 1.0 + w * std::cos(turn);
            std::ostringstream line;
            line << "v " << r * std::cos(along) << ' ' << w * std::sin(turn) << ' ' << r * std::sin(along)
                 << "\n";
            text += line.str();
        }
    for (int i = 0; i < n; ++i) { // the last square joins edges of opposite direction
        std::array<int, 4> f = {2 * i + 1, 2 * i + 2, 2 * i + 4, 2 * i + 3};
        if (i == n - 1) f[2] = 1, f[3] = 2;
        text += "f";
        for (const int v : f) text += " " + std::to_string(v);
        text += "\n";
    }
    const Mesh mesh = settled(text);
    EXPECT_EQ(mesh.triangles.size(), size_t(2 * n));
    EXPECT_EQ(sides.turned, 0U);
    EXPECT_EQ(sides.closed_parts, 0U);
}

// A shape of a deforming mesh takes the sides of the first, even if its vertices meet.
TEST_F(MeshSidesTest, ShapesTakeTheSidesOfTheFirst) {
    const auto some = [](int i) { return i == 1; };
    const Mesh first = settled(squares(2, some));
    std::string point = squares(2, some);
    for (size_t at = 0; (at = point.find("v ", at)) != std::string::npos; ++at)
        point.replace(at, point.find('\n', at) - at, "v 1 0 1");
    std::ofstream(folder / "point.obj") << point;
    const Mesh shape = load_mesh((folder / "point.obj").string(), {.first_shape = &first});
    EXPECT_EQ(shape.triangles, first.triangles);
}

// ---- Faults -----------------------------------------------------------------------------------------------

TEST(BrokenMeshes, AreRefusedWithTheirPlace) {
    const fs::path folder = fs::path(MARRAM_SOURCE_DIR) / "tests/broken/meshes";
    std::ifstream table(folder / "expected.txt");
    int count = 0;
    for (std::string row; std::getline(table, row); ++count) {
        const std::string name = row.substr(0, row.find('\t')), expected = row.substr(row.find('\t') + 1);
        ASSERT_TRUE(fs::exists(folder / name)) << name;
        try {
            load_mesh((folder / name).string(), true);
            ADD_FAILURE() << name << " was read";
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find(expected), std::string::npos)
                << error.what() << "\n  expected " << expected;
        }
    }
    EXPECT_GE(count, 18);
    EXPECT_THROW(load_mesh("no/such/file.obj", false), InputError);
    EXPECT_THROW(load_mesh(folder.string(), false), InputError);
}

TEST_F(MeshFiles, MutationsNeverDoWorseThanAnInputError) {
    const std::string obj = quad + "vt 0 0\nvt 1 0.5\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1 4/2/1\nf -1 -2 -3\n";
    const std::pair<std::string, std::string> seeds[] = {{"m.obj", obj},
                                                         {"a.ply", ply_quad("ascii")},
                                                         {"l.ply", ply_quad("binary_little_endian")},
                                                         {"b.ply", ply_quad("binary_big_endian")}};
    std::mt19937 random(7);
    const char spice[] = "0123456789-+.eE/# \n\r\\vtnf\xff";
    for (const auto& [name, seed] : seeds)
        for (int round = 0; round < 400; ++round) {
            std::string bytes = seed;
            for (unsigned edits = 1 + random() % 4; edits-- > 0 && !bytes.empty();) {
                const size_t at = random() % bytes.size();
                if (random() % 4 == 0)
                    bytes.erase(at, random() % 8);
                else if (random() % 4 == 0)
                    bytes.resize(at);
                else if (random() % 2)
                    bytes[at] = char(random());
                else
                    bytes.insert(at, 1, spice[random() % (sizeof(spice) - 1)]);
            }
            try {
                const Mesh mesh = load(name, bytes, true);
                for (const Triangle& t : mesh.triangles)
                    for (uint32_t v : t) ASSERT_LT(v, mesh.positions.size());
                for (const Vec3f& p : mesh.positions) ASSERT_TRUE(p.allFinite());
                for (const Vec3f& n : mesh.normals) ASSERT_NEAR(n.norm(), 1.0f, 1e-4f);
            } catch (const InputError& error) {
                EXPECT_NE(std::string(error.what()).find(name), std::string::npos);
            }
        }
}

// Ten times the lines: 10 times the time if it is linear, 100 times if a step is quadratic. Each time is the
// least of three, for whatever else runs only adds.
TEST_F(MeshFiles, LongFilesTakeLinearTime) {
    const auto min_seconds = [&](int vertices) {
        std::ostringstream text;
        for (int i = 0; i < vertices; ++i) text << "v " << i << " " << i % 7 << " 0\n";
        for (int i = 1; i + 2 < vertices; ++i) text << "f " << i << " " << i + 1 << " " << i + 2 << "\n";
        double least = INFINITY;
        for (int run = 0; run < 3; ++run) {
            const std::clock_t begin = std::clock(); // processor time: the same on a busy machine
            EXPECT_EQ(load("long.obj", text.str(), true).triangles.size(), size_t(vertices - 3));
            least = std::min(least, double(std::clock() - begin) / CLOCKS_PER_SEC);
        }
        return least;
    };
    const double few = min_seconds(10000), many = min_seconds(100000);
    std::printf("%.3f s and %.3f s: %.1f times\n", few, many, many / few);
    EXPECT_LT(many / few, 32.0);
}

TEST(RealMeshes, Load) {
    const fs::path data = fs::path(MARRAM_SOURCE_DIR) / ".." / "shared/data";
    if (!fs::exists(data)) GTEST_SKIP() << "no ../shared/data";
    EXPECT_EQ(load_mesh((data / "spot.obj").string(), true).triangles.size(), 5856u);
    EXPECT_GT(volume(load_mesh((data / "spot.obj").string(), true)), 0.0);
    EXPECT_FALSE(load_mesh((data / "beetle.obj").string(), true).triangles.empty());
    EXPECT_EQ(load_mesh((data / "Bangs_head.ply").string(), false).triangles.size(), 7694u);
}

} // namespace
} // namespace marram
