// SPDX-License-Identifier: Apache-2.0
// Imported strands: at rest they equal their file's curves, on a skin they follow it, and in the wind they
// behave like grown ones.
#include "tests/unit/world/build_scene.h"

#include "core/math/hash.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

namespace marram::testing {
namespace {

// The name and one curve; tests replace it by the content of a file.
const std::string drawn =
    "\n[[curves]]\nname = \"file\"\ntype = \"points\"\npoints = [[0, 0, 0], [0, 1, 0]]\n";

std::string strands(const std::string& more) {
    return "\n[[procedural]]\ntype = \"strands\"\nname = \"hair\"\ncurves = \"file\"\n" + more + "\n";
}

double draw(uint64_t i, uint64_t which) { return unit_double(mix64(i * 977 + which)); }

// Adds a curve of 2 to 9 CVs with segments of different lengths and its own widths.
void add_curve(SceneCurves& curves, const std::vector<Vec3f>& points, const std::vector<float>& radii) {
    const auto put = [&](const Vec3f& p, float radius) {
        curves.vertices.insert(curves.vertices.end(), {p.x(), p.y(), p.z(), radius});
    };
    const size_t n = points.size();
    put(2.0F * points[0] - points[1], 2.0F * radii[0] - radii[1]);
    for (size_t k = 0; k < n; ++k) put(points[k], radii[k]);
    put(2.0F * points[n - 1] - points[n - 2], 2.0F * radii[n - 1] - radii[n - 2]);
    curves.offsets.push_back(curves.offsets.back() + n);
    curves.closed.push_back(0);
}

SceneCurves irregular_curves(size_t count, const std::function<std::pair<Vec3d, Vec3d>(size_t)>& root) {
    SceneCurves curves;
    curves.name = "file";
    curves.basis = MARRAM_BSPLINE;
    for (size_t c = 0; c < count; ++c) {
        const auto [p, normal] = root(c);
        const size_t cvs = 2 + size_t(8.0 * draw(c, 1));
        std::vector<Vec3f> points;
        std::vector<float> radii;
        Vec3d at = p, direction = normal;
        for (size_t k = 0; k < cvs; ++k) {
            points.push_back(at.cast<float>());
            radii.push_back(float(0.001 + 0.002 * draw(c, 20 + k)));
            direction += 0.3 * Vec3d(draw(c, 40 + k) - 0.5, draw(c, 60 + k) - 0.5, draw(c, 80 + k) - 0.5);
            at += direction.normalized() * (0.01 + 0.04 * draw(c, 100 + k));
        }
        add_curve(curves, points, radii);
    }
    return curves;
}

std::pair<Vec3d, Vec3d> on_ground(size_t c) {
    return {Vec3d(2.0 * draw(c, 2) - 1.0, 0.0, 2.0 * draw(c, 3) - 1.0), Vec3d::UnitY()};
}

Vec3d point(const float* v) { return {double(v[0]), double(v[1]), double(v[2])}; }

// The largest difference between two sets of vertices.
double max_difference(const float* a, const std::vector<float>& b) {
    double most = 0.0;
    for (size_t i = 0; i < b.size(); ++i) most = std::max(most, std::abs(double(a[i]) - double(b[i])));
    return most;
}

TEST(Strands, AtRestAreTheFilesCurvesToTheBit) {
    for (const std::string on : {"", "on = \"ground\"\n"}) {
        TestScene scene(mesh("ground", "plane", "size = [4, 4]\ndivisions = 7\n") + drawn + strands(on));
        scene.geometry.curves[0] = irregular_curves(1000, on_ground);
        const SceneCurves& file = scene.geometry.curves[0];
        const World world = scene.build();
        const CurveGeometry& made = world.curves[0];
        EXPECT_EQ(made.basis, MARRAM_BSPLINE);
        EXPECT_EQ(made.offsets, file.offsets);
        ASSERT_EQ(made.vertices.size(), 1u);
        EXPECT_EQ(std::memcmp(made.vertices[0], file.vertices.data(), file.vertices.size() * sizeof(float)),
                  0)
            << on;
    }
}

// Distances between the vertices of curves [first, first + file.count()) and those of the file moved by
// `placed`, the greatest over all motion samples; radii scale, too.
double farthest(const CurveGeometry& made, size_t first, const std::vector<float>& expected,
                const Eigen::Affine3d& placed, uint32_t time) {
    const double scale = std::cbrt(placed.linear().determinant());
    const float* v = made.vertices[time] + 4 * (made.offsets[first] + 2 * first);
    double most = 0.0;
    for (size_t i = 0; i < expected.size(); i += 4) {
        most = std::max(most, (point(v + i) - placed * point(expected.data() + i)).norm());
        most = std::max(most, std::abs(double(v[i + 3]) - scale * double(expected[i + 3])));
    }
    return most;
}

Eigen::Affine3d there() { // the transform of the instance below
    Eigen::Affine3d placed = Eigen::Affine3d::Identity();
    placed.translate(Vec3d(5, 1, -3));
    placed.rotate(Eigen::AngleAxisd(0.5 * pi, Vec3d::UnitY()));
    placed.scale(2.0);
    return placed;
}
const std::string with_instance = "instances = [{ transform = { rotate = [0, 90, 0], scale = [2, 2, 2], "
                                  "translate = [5, 1, -3] } }]\n";

TEST(Strands, GrowOnInstancesOfTheirMesh) {
    TestScene scene(mesh("ground", "plane", "size = [4, 4]\ndivisions = 7\n" + with_instance) + drawn +
                    strands("on = \"ground\"\n"));
    scene.geometry.curves[0] = irregular_curves(1000, on_ground);
    const SceneCurves& file = scene.geometry.curves[0];
    scene.settings.attributes = {"id", "root_normal"};
    const World world = scene.build();
    const CurveGeometry& made = world.curves[0];
    ASSERT_EQ(made.curve_count, 2000u);
    EXPECT_EQ(std::memcmp(made.vertices[0], file.vertices.data(), file.vertices.size() * sizeof(float)), 0);
    EXPECT_LT(farthest(made, 1000, file.vertices, there(), 0), 2e-6);
    const std::vector<float>& id = attribute(made, "id")->values;
    for (size_t c = 0; c < 1000; ++c) ASSERT_EQ(id[c], id[1000 + c]);
    EXPECT_EQ(scene.stats.report("instances.count"), 1.0);
    EXPECT_GT(scene.stats.report("instances.shared_bytes"), 1000.0);
}

// As strands of another file, bound to a mesh that stands there itself: blown, sheltered, swung and collided,
// on an instance that moves within the shutter, too.
TEST(Strands, OnInstancesStandInTheWindOfTheirPlace) {
    const std::string wind =
        "\n[wind]\nspeed = 8\ncalm = 1\nnoise = { frequency = 1 }\nshielding = { shield = 1, spread = 10, "
        "rays = 8 }\n"
        "collision = { solver = \"exact\", offset_scale = 0.2 }\njiggle = { frequency = 3, step = 0.25 }\n"
        "gusts = { num_gusts = 20, radius_range = [1, 2] }\n";
    for (const char* moving :
         {"translate = [5, 0, 0]", "keys = [{ frame = 1, translate = [4, 0, 0] }, { frame = "
                                   "12, translate = [5, 0, 0] }, { frame = 14, translate "
                                   "= [5.4, 0, 0] }]"}) {
        const std::string ground = "size = [2, 2]\ndivisions = 7\n",
                          transform = "transform = { " + std::string(moving) + " }";
        const auto build = [&](TestScene& scene, const SceneCurves& curves) {
            scene.geometry.curves[0] = curves;
            scene.settings.frame = 12;
            scene.settings.bind_frame = 12;
            scene.settings.shutter_close = 0.5;
            return scene.build();
        };
        SceneCurves curves = irregular_curves(300, on_ground);
        TestScene with(wind + mesh("ground", "plane", ground + "instances = [{ " + transform + " }]\n") +
                       drawn + strands("on = \"ground\"\n"));
        const World world = build(with, curves);
        ASSERT_EQ(world.curves[0].curve_count, 600u);
        for (size_t i = 0; i < curves.vertices.size(); i += 4) curves.vertices[i] += 5.0F; // at bind_frame
        TestScene alone(wind + mesh("other", "plane", ground) +
                        mesh("ground", "plane", ground + transform + "\n") + drawn +
                        strands("on = \"ground\"\n"));
        const World other = build(alone, curves);
        const CurveGeometry &made = world.curves[0], &expected = other.curves[0];
        ASSERT_EQ(made.vertices.size(), expected.vertices.size());
        ASSERT_GT(made.vertices.size(), 1u);
        for (uint32_t t = 0; t < made.vertices.size(); ++t) {
            const std::vector<float> one(expected.vertices[t], expected.vertices[t] + curves.vertices.size());
            EXPECT_LT(farthest(made, 300, one, Eigen::Affine3d::Identity(), t), 3e-4)
                << moving << " at " << t;
            EXPECT_GT(farthest(made, 0, one, Eigen::Affine3d(Eigen::Translation3d(-5, 0, 0)), t), 0.01)
                << "it is the wind of another place";
        }
        EXPECT_EQ(with.stats.report("collision.unresolved"), 0.0);
    }
}

// What is asked for in metres on the mesh, the height of roots, grows with an instance; the tolerance does
// not.
TEST(Strands, OnLargeInstancesAreBoundedAndChosenFor) {
    struct Swung : TestScene {
        Swung(const std::string& wind, const std::string& transform)
            : TestScene(
                  "\n[wind]\nspeed = 6\ncalm = 1\nglobal_rotate = 0.5\n" + wind +
                  mesh("ground", "plane",
                       "size = [4, 4]\ndivisions = 7\n" +
                           (transform.empty() ? "" : "instances = [{ transform = " + transform + " }]\n")) +
                  drawn + strands("on = \"ground\"\n")) {
            geometry.curves[0] = irregular_curves(200, on_ground);
            settings.frame = 12;
            settings.tolerance = 1e-3;
        }
    };
    const std::string large = "{ scale = [50, 50, 50], translate = [0, 200, 0] }";
    Swung raised("collision = { solver = \"exact\", offset_root = 0.5 }\n", large);
    const World world = raised.build();
    const CurveGeometry& made = world.curves[0];
    ASSERT_EQ(raised.stats.patch_bounds.size(), 2u);
    for (size_t c = 200; c < 400; ++c)
        for (uint64_t v = made.offsets[c] + 2 * c + 1; v < made.offsets[c + 1] + 2 * c + 1; ++v)
            ASSERT_TRUE(raised.stats.patch_bounds[1].contains(
                Vec3f(Eigen::Map<const Vec3f>(made.vertices[0] + 4 * v))));

    const auto step = [&](const std::string& transform) {
        Swung swung("jiggle = { frequency = 2 }\nnoise = { frequency = 1 }\n", transform);
        swung.build();
        for (const auto& [path, value] : swung.geometry.procedurals[0]->report())
            if (path == "chosen.jiggle_step") return value;
        return 0.0;
    };
    const double on_mesh = step("");
    EXPECT_GT(on_mesh, 0.0);
    EXPECT_EQ(step("{ translate = [9, 0, 0] }"), on_mesh);
    EXPECT_LE(step(large), 0.5 * on_mesh);
}

// The same strands, grown and imported: equal motion, except that roots stored as floats change the noise
// slightly.
TEST(Strands, AreBlownLikeGrownOnes) {
    const std::string wind =
        "[wind]\ndirection = [1, 0, 0.3]\nspeed = 6\ncalm = 0.5\nnoise.amplitude = 0.5\nnoise.frequency = 3\n"
        "jiggle.frequency = 3\njiggle.step = 0.5\njiggle.stiffness = [[0, 3], [1, 1]]\n"
        "gusts.num_gusts = 20\ngusts.extent = [3, 3]\ngusts.distance = 2\n";
    const std::string ground = mesh("ground", "plane", "size = [2, 2]\n");
    const std::string shape = "count = 300\ncvs = 7\nenvelope = [[0, 0.5], [1, 1]]\n";
    TestScene grown(ground + groom("hair", "ground", shape) + wind);
    grown.settings.stage = MARRAM_REST;
    const World rest = grown.build();
    grown.settings.stage = MARRAM_FINAL;
    grown.settings.frame = 9.0;
    const World blown = grown.build();

    TestScene imported(ground + drawn + strands("on = \"ground\"\nenvelope = [[0, 0.5], [1, 1]]\n") + wind);
    SceneCurves& file = imported.geometry.curves[0];
    file = {};
    file.name = "file";
    file.basis = MARRAM_BSPLINE;
    for (size_t c = 0; c < rest.curves[0].curve_count; ++c) {
        std::vector<Vec3f> points;
        std::vector<float> radii;
        for (uint32_t k = 0; k < 7; ++k) {
            points.push_back(cv(rest.curves[0], 0, c, k));
            radii.push_back((rest.curves[0].vertices[0] + 4 * (c * 9 + k + 1))[3]);
        }
        add_curve(file, points, radii);
    }
    imported.settings.frame = 9.0;
    const World made = imported.build();
    EXPECT_EQ(made.curves[0].cvs_per_curve, 7u) << "equal counts are handed over as such";
    const std::vector<float> expected(blown.curves[0].vertices[0],
                                      blown.curves[0].vertices[0] +
                                          blown.curves[0].layout().vertex_count() * 4);
    EXPECT_LT(max_difference(made.curves[0].vertices[0], expected), 2e-6);
    EXPECT_GT(max_difference(rest.curves[0].vertices[0], expected), 0.02) << "there is wind";
}

// ---- A deforming skin

constexpr int rings = 24, sides = 16;

Vec3d bent_and_twisted(const Vec3d& p, double frame) {
    const double bend = 0.8 * std::sin(frame * 0.05), twist = 1.5 * std::sin(frame * 0.031);
    const double a = twist * p.y(), c = std::cos(a), s = std::sin(a);
    const Vec3d turned(c * p.x() + s * p.z(), p.y(), c * p.z() - s * p.x());
    const double angle = bend * turned.y(), radius = 1.0 / std::max(std::abs(bend), 1e-9);
    if (std::abs(bend) < 1e-6) return turned;
    const double sign = bend > 0.0 ? 1.0 : -1.0, r = radius - sign * turned.x();
    return {sign * (radius - r * std::cos(angle)),
            r * std::sin(std::abs(angle)) * (turned.y() < 0 ? -1.0 : 1.0), turned.z()};
}

SceneMesh cylinder() {
    SceneMesh mesh;
    mesh.name = "tube";
    std::vector<Vec3d> rest;
    for (int i = 0; i <= rings; ++i)
        for (int j = 0; j < sides; ++j) {
            const double a = 2.0 * pi * j / sides;
            rest.emplace_back(0.2 * std::cos(a), double(i) / rings, 0.2 * std::sin(a));
        }
    for (uint32_t i = 0; i < rings; ++i)
        for (uint32_t j = 0; j < sides; ++j) {
            const uint32_t a = i * sides + j, b = i * sides + (j + 1) % sides;
            mesh.mesh.triangles.push_back({a, a + sides, b});
            mesh.mesh.triangles.push_back({b, a + sides, b + sides});
        }
    for (int frame = 1; frame <= 200; ++frame) {
        std::vector<Vec3f> positions;
        for (const Vec3d& p : rest) positions.push_back(bent_and_twisted(p, frame).cast<float>());
        mesh.shapes.push_back({double(frame), positions, vertex_normals(positions, mesh.mesh.triangles)});
    }
    mesh.mesh.positions = mesh.shapes[0].positions;
    mesh.mesh.normals = mesh.shapes[0].normals;
    return mesh;
}

// A point on triangle t of the skin.
Vec3d place_of(const std::vector<Vec3f>& positions, const std::array<uint32_t, 3>& t, const Vec3d& weights) {
    Vec3d sum = Vec3d::Zero();
    for (int i = 0; i < 3; ++i) sum += weights[i] * positions[t[size_t(i)]].cast<double>();
    return sum;
}

struct Fur {
    std::vector<uint32_t> triangles;
    std::vector<Vec3d> weights;
};

Fur furnish(TestScene& scene, size_t count) {
    scene.geometry.meshes[0] = cylinder();
    const SceneMesh& tube = scene.geometry.meshes[0];
    Fur fur;
    for (size_t c = 0; c < count; ++c) {
        fur.triangles.push_back(uint32_t(draw(c, 4) * double(tube.mesh.triangles.size())));
        const double s = std::sqrt(draw(c, 5)), t = draw(c, 6);
        fur.weights.emplace_back(1.0 - s, s * (1.0 - t), s * t);
    }
    scene.geometry.curves[0] = irregular_curves(count, [&](size_t c) {
        const auto& t = tube.mesh.triangles[fur.triangles[c]];
        const Vec3d a = tube.mesh.positions[t[0]].cast<double>(),
                    b = tube.mesh.positions[t[1]].cast<double>(),
                    d = tube.mesh.positions[t[2]].cast<double>();
        return std::pair(place_of(tube.mesh.positions, t, fur.weights[c]),
                         Vec3d((b - a).cross(d - a).normalized()));
    });
    return fur;
}

TEST(Strands, FollowASkinThatBendsAndTwists) {
    TestScene scene(mesh("tube", "sphere", "divisions = 2\n") + drawn + strands("on = \"tube\"\n"));
    const Fur fur = furnish(scene, 300);
    const SceneCurves& file = scene.geometry.curves[0];
    const SceneMesh& tube = scene.geometry.meshes[0];
    scene.settings.trace_curves = false;
    double root_off = 0.0, stretch = 0.0;
    for (int i = 0; i < 1000; ++i) {
        scene.settings.frame = 1.0 + 199.0 * draw(uint64_t(i), 7);
        const World world = scene.build();
        const std::vector<Vec3f> skin = tube.positions_at(scene.settings.frame);
        const CurveLayout layout = file.layout();
        for (size_t c = 0; c < 300; c += 1 + size_t(i) % 3) {
            const float* now = world.curves[0].vertices[0] + 4 * (layout.first_vertex(c) + 1);
            const float* then = file.vertices.data() + 4 * (layout.first_vertex(c) + 1);
            const Vec3d root = point(now);
            root_off = std::max(
                root_off,
                (root - place_of(skin, tube.mesh.triangles[fur.triangles[c]], fur.weights[c])).norm());
            for (uint32_t k = 4; k < 4 * layout.cvs(c); k += 4) {
                const auto segment = [&](const float* v) { return (point(v + k) - point(v + k - 4)).norm(); };
                stretch = std::max(stretch, std::abs(segment(now) - segment(then)));
            }
        }
    }
    EXPECT_LT(root_off, 1e-6) << "m, of roots from their places on the skin";
    EXPECT_LT(stretch, 1e-6) << "m, of segments";
}

// Between instants a tip moves no farther than its root's triangle would move a rod of its length.
TEST(Strands, DoNotJumpOnASkinThatDoesNot) {
    TestScene scene(mesh("tube", "sphere", "divisions = 2\n") + drawn + strands("on = \"tube\"\n"));
    furnish(scene, 300);
    const SceneMesh& tube = scene.geometry.meshes[0];
    const CurveLayout layout = scene.geometry.curves[0].layout();
    scene.settings.trace_curves = false;
    std::vector<float> before;
    double max_tip = 0.0, max_skin = 0.0;
    std::vector<Vec3f> skin_before;
    for (int i = 0; i < 400; ++i) {
        scene.settings.frame = 60.0 + 0.1 * i;
        const World world = scene.build();
        const float* now = world.curves[0].vertices[0];
        const std::vector<Vec3f> skin = tube.positions_at(scene.settings.frame);
        for (size_t c = 0; i > 0 && c < 300; ++c) {
            const size_t tip = 4 * (layout.first_vertex(c) + layout.cvs(c));
            max_tip = std::max(max_tip, std::hypot(double(now[tip] - before[tip]),
                                                   double(now[tip + 1] - before[tip + 1]),
                                                   double(now[tip + 2] - before[tip + 2])));
        }
        for (size_t v = 0; i > 0 && v < skin.size(); ++v)
            max_skin = std::max(max_skin, double((skin[v] - skin_before[v]).norm()));
        before.assign(now, now + 4 * layout.vertex_count());
        skin_before = skin;
    }
    // A rod of 0.3 m on a rotating tube of 0.2 m: less than 2.5 times as far; twice that is no jump.
    EXPECT_LT(max_tip, 5.0 * max_skin);
    EXPECT_GT(max_tip, 0.0);
}

// ---- Curves with their own animation

TEST(Strands, StandWhereAFileThatAnimatesSays) {
    TestScene scene(drawn + strands("wind.jiggle.frequency = 0\n"));
    SceneCurves& file = scene.geometry.curves[0];
    file = irregular_curves(200, on_ground);
    std::vector<float> moved = file.vertices;
    for (size_t i = 0; i < moved.size(); i += 4) moved[i] += 0.5F;
    file.samples = {{1.0, file.vertices}, {3.0, moved}};
    scene.settings.frame = 2.0;
    scene.settings.shutter_open = -0.5;
    scene.settings.shutter_close = 0.5;
    scene.settings.motion_keys = 3;
    const World world = scene.build();
    ASSERT_EQ(world.curves[0].vertices.size(), 3u);
    for (size_t t = 0; t < 3; ++t)
        EXPECT_LT(max_difference(world.curves[0].vertices[t], file.vertices_at(1.5 + 0.5 * double(t))), 5e-7);
    // They jiggle behind their own motion, and are still long after it.
    TestScene swinging(drawn + strands("wind.jiggle.frequency = 2\nwind.jiggle.damping = 0.5\n"));
    swinging.geometry.curves[0] = file;
    swinging.settings.frame = 2.5;
    EXPECT_GT(max_difference(swinging.build().curves[0].vertices[0], file.vertices_at(2.5)), 1e-3);
    swinging.settings.frame = 400.0;
    EXPECT_LT(max_difference(swinging.build().curves[0].vertices[0], file.vertices_at(400.0)), 1e-6);
}

// With the anchor "rest", moving curves have the noise of static curves at their positions of bind_frame.
TEST(Strands, RestAnchorsStayWhereCurvesMove) {
    const auto blown = [](const std::string& anchor, bool moves) {
        TestScene scene(drawn + strands("") +
                        "[wind]\nspeed = 4\nnoise.amplitude = 0.8\nnoise.frequency = 2\nnoise.anchor = \"" +
                        anchor + "\"\n");
        SceneCurves& file = scene.geometry.curves[0];
        file = irregular_curves(100, on_ground);
        std::vector<float> moved = file.vertices;
        for (size_t i = 0; i < moved.size(); i += 4) moved[i] += 0.5F;
        if (moves) file.samples = {{1.0, file.vertices}, {3.0, moved}};
        scene.settings.frame = 3.0;
        const World world = scene.build();
        std::vector<float> vertices(world.curves[0].vertices[0],
                                    world.curves[0].vertices[0] + file.vertices.size());
        if (moves)
            for (size_t i = 0; i < vertices.size(); i += 4) vertices[i] -= 0.5F;
        return vertices;
    };
    const std::vector<float> still = blown("rest", false);
    EXPECT_LT(max_difference(still.data(), blown("rest", true)), 1e-6);
    EXPECT_GT(max_difference(still.data(), blown("world", true)), 1e-3);
}

// Errors for data that an update removes, and for curves that a host changes after strands were bound.
TEST(Strands, MissWhatWasThereBefore) {
    TestScene scene(drawn + strands("width = 0.01\n"));
    scene.build();
    scene.update(drawn + strands(""));
    EXPECT_NE(scene.build_errors().find("the curves 'file' have no widths"), std::string::npos)
        << scene.build_errors();

    TestScene other(drawn + strands("width = 0.01\n"));
    SceneCurves& file = other.geometry.curves[0];
    const auto fill = [&](size_t first, size_t second) {
        file = {};
        file.name = "file";
        for (const size_t n : {first, second}) {
            std::vector<Vec3f> points;
            for (size_t k = 0; k < n; ++k) points.emplace_back(0.0F, 0.1F * float(k), 0.0F);
            add_curve(file, points, std::vector<float>(n, 0.01F));
        }
    };
    fill(3, 5);
    other.build();
    fill(5, 3); // the same total
    EXPECT_NE(other.build_errors().find("have changed since the strands were bound"), std::string::npos)
        << other.build_errors();
}

TEST(Strands, GoWithTheTransformOfTheirCurves) {
    TestScene scene(drawn + strands(""));
    SceneCurves& file = scene.geometry.curves[0];
    file = irregular_curves(50, on_ground);
    const std::array key = {1.0, 1.0, 2.0, 3.0, 0.0, 90.0, 0.0, 2.0, 2.0, 2.0};
    file.transform = KeyedTransform(key, "linear");
    const World world = scene.build();
    const float *made = world.curves[0].vertices[0] + 4, *given = file.vertices.data() + 4;
    EXPECT_NEAR(made[0], 1.0F + 2.0F * given[2], 1e-6F);
    EXPECT_NEAR(made[1], 2.0F + 2.0F * given[1], 1e-6F);
    EXPECT_NEAR(made[2], 3.0F - 2.0F * given[0], 1e-6F);
    EXPECT_NEAR(made[3], 2.0F * given[3], 1e-8F);
}

// ---- Attributes of the file

TEST(Strands, CarryAttributesAndAreScaledByThem) {
    const std::string text = drawn + strands("wind_by = [{ attribute = \"wet\" }]\n") + "[wind]\nspeed = 5\n";
    TestScene scene(text);
    SceneCurves& file = scene.geometry.curves[0];
    file = irregular_curves(64, on_ground);
    AttributeValues wet{"wet", 1, MARRAM_PER_CURVE, {}, false, false},
        color{"color", 3, MARRAM_PER_CV, {}, false, false}, id{"id", 1, MARRAM_PER_CURVE, {}, true, false};
    for (size_t c = 0; c < 64; ++c) {
        wet.values.push_back(c % 2 == 0 ? 0.0F : 1.0F);
        id.values.push_back(float(1000 + c));
    }
    for (size_t i = 0; i < 3 * file.offsets.back(); ++i) color.values.push_back(float(i) * 0.001F);
    file.attributes = {wet, color, id};
    scene.tell_attributes(text);
    scene.settings.attributes = {"color", "id", "envelope"};
    const World world = scene.build();
    const CurveGeometry& made = world.curves[0];
    ASSERT_EQ(made.attributes.size(), 3u);
    EXPECT_EQ(attribute(made, "color")->values, color.values);
    EXPECT_EQ(attribute(made, "id")->values, id.values);
    const std::vector<float>& envelope = attribute(made, "envelope")->values;
    const CurveLayout layout = file.layout();
    for (size_t c = 0; c < 64; ++c)
        for (uint64_t k = layout.first_cv(c); k < layout.first_cv(c + 1); ++k)
            EXPECT_EQ(envelope[k] > 0.0F, c % 2 == 1) << c;
}

TEST(Strands, ObjectionsSayWhatToDo) {
    const auto build_errors = [](const std::string& more, bool widths) {
        TestScene scene(mesh("ground", "plane") + drawn + strands(more));
        if (widths) scene.geometry.curves[0] = irregular_curves(3, on_ground);
        return scene.build_errors();
    };
    EXPECT_NE(build_errors("", false).find("have no widths: give width"), std::string::npos);
    EXPECT_EQ(build_errors("width = 0.01\n", false), "");
    EXPECT_NE(build_errors("wind_by = [{ attribute = \"wet\" }]\n", true).find("no attribute 'wet'"),
              std::string::npos);
    TestScene no_curves(mesh("ground", "plane") + drawn + strands(""));
    no_curves.geometry.curves.clear();
    EXPECT_NE(no_curves.build_errors().find("there are no curves 'file'"), std::string::npos);
    EXPECT_THROW(TestScene(drawn + strands("width = 0.01\nwind.collision.solver = \"exact\"\n"
                                           "wind.collision.offset_scale = 1\n")),
                 InputError);
}

// ---- Collision

// Roots above, on and under the skin: those too low are raised to the same height, with a warning.
TEST(Strands, RootsUnderTheSkinAreLiftedAndTold) {
    TestScene scene(
        mesh("ground", "plane", "size = [4, 4]\n") + drawn +
        strands("on = \"ground\"\nwind.collision.solver = \"exact\"\nwind.collision.offset_root = 0.004\n"));
    scene.geometry.curves[0] = irregular_curves(90, [](size_t c) {
        auto [p, normal] = on_ground(c);
        p.y() = 0.01 * (double(c % 3) - 1.0);
        return std::pair(p, normal);
    });
    const World world = scene.build();
    const CurveLayout layout = scene.geometry.curves[0].layout();
    for (size_t c = 0; c < 90; ++c) {
        const float height = world.curves[0].vertices[0][4 * (layout.first_vertex(c) + 1) + 1];
        EXPECT_NEAR(height, c % 3 == 2 ? 0.01F : 0.004F, 1e-6F);
    }
    ASSERT_EQ(scene.stats.warnings.size(), 2u); // one for far roots, one for these
    EXPECT_NE((to_string(scene.stats.warnings[0]) + to_string(scene.stats.warnings[1]))
                  .find("30 of 90 strands begin inside 'ground', up to 0.01 m deep"),
              std::string::npos)
        << to_string(scene.stats.warnings[0]) << to_string(scene.stats.warnings[1]);
}

// Far beside an open surface and below its plane by less than the rounding error: neither inside nor raised.
TEST(Strands, BesideTheBorderOfAnOpenSkinStayWhereTheyAre) {
    TestScene scene(mesh("card", "plane", "size = [2, 2]\n") + drawn +
                    strands("on = \"card\"\nwind.collision.solver = \"exact\"\n"));
    SceneCurves& file = scene.geometry.curves[0];
    file = irregular_curves(60, [](size_t c) {
        return std::pair(Vec3d(1.2 + 0.3 * draw(c, 2), -1e-8 * double(c % 3), draw(c, 3) - 0.5),
                         Vec3d(Vec3d::UnitY()));
    });
    const World world = scene.build();
    EXPECT_LT(max_difference(world.curves[0].vertices[0], file.vertices), 1e-6);
    ASSERT_EQ(scene.stats.warnings.size(), 1u);
    EXPECT_NE(to_string(scene.stats.warnings[0]).find("60 of 60 strands begin farther from 'card'"),
              std::string::npos)
        << to_string(scene.stats.warnings[0]);
}

// From tip to root: they end on the skin, and that is what the warning says.
TEST(Strands, ThatEndOnTheSkinAreSeenAsReversed) {
    TestScene scene(mesh("ground", "plane", "size = [4, 4]\n") + drawn + strands("on = \"ground\"\n"));
    scene.geometry.curves[0] = SceneCurves{};
    scene.geometry.curves[0].name = "file";
    for (size_t c = 0; c < 10; ++c) {
        const Vec3d root = on_ground(c).first;
        std::vector<Vec3d> points = {root + Vec3d(0, 1, 0), root + Vec3d(0, 0.5, 0), root};
        if (c == 0) std::ranges::reverse(points); // as it should be
        scene.geometry.curves[0].add(points, false);
        for (size_t v = scene.geometry.curves[0].vertices.size() - 20;
             v < scene.geometry.curves[0].vertices.size(); v += 4)
            scene.geometry.curves[0].vertices[v + 3] = 0.01F;
    }
    scene.build();
    ASSERT_EQ(scene.stats.warnings.size(), 1u);
    EXPECT_NE(to_string(scene.stats.warnings[0])
                  .find("9 of 10 strands end on 'ground' and begin up to 1 m away from it: they run from "
                        "tip to root: give their curves reverse = true"),
              std::string::npos)
        << to_string(scene.stats.warnings[0]);
}

// Curves that change in number: each frame has its take, bound anew, and the same frame is the same again.
TEST(Strands, ChangeInNumberFromTakeToTake) {
    TestScene scene(mesh("ground", "plane", "size = [4, 4]\n") + drawn + strands("on = \"ground\"\n"));
    SceneCurves& file = scene.geometry.curves[0];
    file = irregular_curves(3, on_ground);
    const auto take = [](double frame, size_t count) {
        SceneCurves curves = irregular_curves(count, on_ground);
        return CurvesTake{frame, curves.offsets, curves.vertices, {}};
    };
    file.takes = {take(1.0, 3), take(2.0, 0), take(3.0, 5)};
    const auto count_at = [&](double frame) {
        if (file.select_take(frame)) scene.update({{"file", MARRAM_EVERYTHING}});
        scene.settings.frame = frame;
        scene.settings.shutter_close = 0.5;
        const World world = scene.build();
        EXPECT_EQ(world.curves[0].offsets.empty() ? 0 : world.curves[0].offsets.back(), file.offsets.back());
        return world.curves[0].curve_count;
    };
    EXPECT_EQ(count_at(0.0), 3u);
    EXPECT_EQ(count_at(2.5), 0u);
    EXPECT_EQ(count_at(7.0), 5u);
    EXPECT_EQ(count_at(1.0), 3u);
}

// Lodging: wind blows down onto the ground, which no CV may enter.
TEST(Strands, DoNotEnterTheSkin) {
    TestScene scene(mesh("ground", "plane", "size = [4, 4]\n") + drawn +
                    strands("on = \"ground\"\nwind.collision.solver = \"exact\"\n") +
                    "[wind]\ndirection = [0.3, -1, 0]\nspeed = 30\n");
    scene.geometry.curves[0] = irregular_curves(500, on_ground);
    const World world = scene.build();
    const CurveLayout layout = scene.geometry.curves[0].layout();
    float lowest = 1.0F;
    for (uint64_t c = 0; c < 500; ++c)
        for (uint32_t k = 0; k < layout.cvs(c); ++k)
            lowest = std::min(lowest, world.curves[0].vertices[0][4 * (layout.first_vertex(c) + 1 + k) + 1]);
    EXPECT_GT(lowest, 0.0F);
    EXPECT_GT(max_difference(world.curves[0].vertices[0], scene.geometry.curves[0].vertices), 0.01)
        << "the wind bends them";
}

// ---- Guides

const std::string children =
    "\n[[procedural]]\ntype = \"groom\"\nname = \"hair\"\non = \"ground\"\ncount = 2000\n"
    "width = 0.002\ncvs = 7\nguides.curves = \"file\"\n";

// Guides of equal shape on a lattice over the ground.
void fill_with_guides(SceneCurves& file) {
    file = {};
    file.name = "file";
    for (int i = 0; i < 100; ++i) {
        const Vec3f root(float(i % 10) * 0.4F - 1.8F, 0.0F, float(i / 10) * 0.4F - 1.8F);
        std::vector<Vec3f> points;
        for (int k = 0; k < 5; ++k)
            points.push_back(root + Vec3f(0.02F * float(k * k) / 4.0F, 0.06F * float(k), 0.0F));
        add_curve(file, points, std::vector<float>(5, 0.001F));
    }
}

// If the wind varies only over distances larger than the guides' spacing, interpolated children match blown
// ones.
TEST(Guides, ChildrenThatFollowThemAreBlownAsTheyWouldBe) {
    const std::string wind = "[wind]\nspeed = 6\nglobal_rotate = 0.7\nnoise.amplitude = 0\n"
                             "jiggle.frequency = 2\njiggle.step = 0.5\n";
    const std::string ground = mesh("ground", "plane", "size = [4, 4]\n");
    std::vector<std::vector<float>> poses;
    for (const char* how : {"strands", "guides"}) {
        TestScene scene(ground + drawn + children + "guides.wind = \"" + how + "\"\n" + wind);
        fill_with_guides(scene.geometry.curves[0]);
        scene.settings.attributes = {"envelope"};
        const World world = scene.build();
        const CurveGeometry& made = world.curves[0];
        ASSERT_EQ(made.curve_count, 2000u);
        poses.emplace_back(made.vertices[0], made.vertices[0] + 4 * made.layout().vertex_count());
        for (const float share : attribute(made, "envelope")->values) EXPECT_NEAR(share, 0.6F, 1e-6F);
    }
    EXPECT_LT(max_difference(poses[0].data(), poses[1]), 2e-5);
    TestScene calm(ground + drawn + children);
    fill_with_guides(calm.geometry.curves[0]);
    EXPECT_GT(max_difference(calm.build().curves[0].vertices[0], poses[1]), 0.05) << "there is wind";
}

TEST(Guides, FarFromTheirMeshAreTold) {
    const std::pair<const char*, const char*> cases[] = {
        {"3", "100 of 100 guides begin farther from 'ground' than a tenth of their length, up to 3 m"},
        {"0.24", "100 of 100 guides end on 'ground' and begin up to 0.24 m away from it"}};
    for (const auto& [height, said] : cases) {
        TestScene scene(
            mesh("ground", "plane",
                 fmt::format("size = [4, 4]\ntransform = {{ translate = [0, {}, 0] }}\n", height)) +
            drawn + children);
        fill_with_guides(scene.geometry.curves[0]);
        scene.build();
        ASSERT_EQ(scene.stats.warnings.size(), 1u);
        EXPECT_NE(to_string(scene.stats.warnings[0]).find(said), std::string::npos)
            << to_string(scene.stats.warnings[0]);
    }
}

// Advice that repeats what is set, or a reach far below the spacing, helps nobody.
TEST(Guides, AReachOfAlmostNothingIsAdvisedBySpacing) {
    for (const char* reach : {"0", "1e-9"}) {
        TestScene scene(mesh("ground", "plane", "size = [4, 4]\n") + drawn + children +
                        "guides.reach = " + reach + "\n");
        fill_with_guides(scene.geometry.curves[0]);
        scene.build();
        std::string said;
        for (const Problem& warning : scene.stats.warnings) said += to_string(warning) + "\n";
        EXPECT_NE(said.find(" 100 % of the strands (2000 of 2000) are left out"), std::string::npos) << said;
        EXPECT_NE(said.find("give guides.reach = 0."), std::string::npos) << said;
    }
}

TEST(Guides, ObjectionsSayWhatToDo) {
    const std::string ground = mesh("ground", "plane", "size = [4, 4]\n");
    EXPECT_THROW(TestScene(ground + drawn + children + "length = [1, 2]\n"), InputError);
    TestScene none(ground + drawn + children);
    for (float& x : none.geometry.curves[0].vertices) x = 0.0F;
    EXPECT_NE(none.build_errors().find("have no guide with a length"), std::string::npos)
        << none.build_errors();
}

} // namespace
} // namespace marram::testing
