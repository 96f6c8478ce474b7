// SPDX-License-Identifier: Apache-2.0
// The graph of geometry: a procedural is built after the items that it names, and its output reaches all
// items that name it.
#include "tests/unit/world/build_scene.h"

#include "core/trace/hit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

namespace marram::testing {
namespace {

namespace fs = std::filesystem;

std::string hill(const std::string& name, const std::string& more = "") {
    return "\n[[procedural]]\ntype = \"hill\"\nname = \"" + name + "\"\n" + more + "\n";
}

std::string reeds(const std::string& name, const std::string& more = "") {
    return "\n[[procedural]]\ntype = \"reeds\"\nname = \"" + name + "\"\n" + more + "\n";
}

std::string line(const std::string& name, const std::string& points) {
    return "\n[[curves]]\ntype = \"points\"\nname = \"" + name + "\"\npoints = " + points + "\n";
}

const MeshGeometry& mesh_named(const World& world, const std::string& name) {
    const auto found = std::ranges::find(world.meshes, name, &MeshGeometry::name);
    if (found == world.meshes.end()) throw std::runtime_error("there is no mesh " + name);
    return *found;
}

float highest(const MeshGeometry& mesh, size_t time = 0) {
    float most = -1e9F;
    for (const Vec3f& p : mesh.positions[time]) most = std::max(most, p.y());
    return most;
}

std::vector<float> vertices_of(const CurveGeometry& curves) {
    return {curves.vertices[0], curves.vertices[0] + 4 * curves.layout().vertex_count()};
}

// ---- order

// A hill on a pyramid of 3 m with a slab of 0.5 m, and hair on the hill, in every order in the file.
TEST(Graph, OrderInTheFileDoesNotMatter) {
    const std::string tomb = "[[procedural]]\ntype = \"pyramid\"\nname = \"tomb\"\nheight = 3\n",
                      dune = hill("dune", "on = \"tomb\"\nlayer = [{ type = \"slab\" }]"),
                      hair = groom("hair", "dune");
    std::vector<std::string> parts = {dune, hair, tomb};
    std::ranges::sort(parts);
    std::vector<float> first;
    do {
        TestScene scene(mesh("ground", "plane") + parts[0] + parts[1] + parts[2]);
        const World world = scene.build();
        EXPECT_NEAR(highest(mesh_named(world, "dune")), 3.5F, 1e-4F);
        ASSERT_EQ(world.curves.size(), 1u);
        const std::vector<float> now = vertices_of(world.curves[0]);
        if (first.empty()) first = now;
        EXPECT_EQ(now, first);
    } while (std::ranges::next_permutation(parts).found);
}

TEST(Graph, ARingIsNamed) {
    TestScene scene(hill("a", "on = \"b\"") + hill("c") + hill("b", "on = \"a\""));
    const std::string text = scene.build_errors();
    EXPECT_NE(text.find("in a ring: a -> b -> a"), std::string::npos) << text;
    TestScene itself(hill("a", "on = \"a\""));
    EXPECT_NE(itself.build_errors().find("in a ring: a -> a"), std::string::npos);
    // Reeds trace the hill, as all curves do, and the hill rises beside the reeds.
    TestScene hidden(hill("dune", "along = \"reed\"") + reeds("reed"));
    EXPECT_NE(hidden.build_errors().find("dune -> reed -> dune"), std::string::npos);
    TestScene fixed(hill("dune", "along = \"reed\"\ncollides = false\nshelters = false") + reeds("reed"));
    EXPECT_EQ(fixed.build_errors(), "");
}

// The hill refuses a frame with more meshes than it names; grooms see all colliders.
TEST(Graph, AMeshTracesWhatItNamesAndNothingElse) {
    TestScene scene(mesh("ground", "plane") + mesh("roof", "plane", "transform = { translate = [0, 9, 0] }") +
                    hill("dune", "on = \"ground\"") + hill("free"));
    const World world = scene.build();
    EXPECT_NEAR(highest(mesh_named(world, "dune")), 0.0F, 1e-6F);
    TestScene roofed(mesh("ground", "plane") +
                     mesh("roof", "plane", "transform = { translate = [0, 9, 0] }") +
                     hill("dune", "on = \"roof\""));
    EXPECT_NEAR(highest(mesh_named(roofed.build(), "dune")), 9.0F, 1e-4F);
}

// ---- one groom on several meshes

std::string fur_on(const std::string& on, const std::string& more = "") {
    return "[[procedural]]\ntype = \"groom\"\nname = \"fur\"\non = " + on +
           "\ncount = 100\nlength = 0.2\nwidth = 0.01\n" + more;
}

TEST(SeveralMeshes, EachCarriesTheGroom) {
    const std::string meshes = mesh("low", "plane") +
                               mesh("high", "plane", "transform = { translate = [0, 9, 0] }") +
                               hill("dune", "size = 8\ndivisions = 32");
    TestScene scene(meshes + fur_on("[\"low\", \"high\", \"dune\"]"));
    const World world = scene.build();
    ASSERT_EQ(world.curves.size(), 3u);
    const std::vector<std::string> names = {"fur.low", "fur.high", "fur.dune"};
    for (size_t i = 0; i < names.size(); ++i) {
        EXPECT_EQ(world.curves[i].name, names[i]);
        EXPECT_EQ(world.curves[i].curve_count, 100u);
    }
    int alike = 0;
    for (size_t c = 0; c < 100; ++c) {
        EXPECT_NEAR(cv(world.curves[0], 0, c, 0).y(), 0.0F, 0.02F);
        EXPECT_NEAR(cv(world.curves[1], 0, c, 0).y(), 9.0F, 0.02F);
        alike +=
            (cv(world.curves[1], 0, c, 0) - cv(world.curves[0], 0, c, 0) - Vec3f(0, 9, 0)).norm() < 1e-3F;
    }
    EXPECT_LT(alike, 5); // equal meshes get different strands
    // Strands on one mesh do not depend on the other meshes or on their order.
    TestScene other(meshes + fur_on("[\"high\", \"low\"]"));
    const World again = other.build();
    EXPECT_EQ(vertices_of(again.curves[0]), vertices_of(world.curves[1]));
    // A list of one name equals that name.
    TestScene bracket(meshes + fur_on("[\"low\"]")), plain(meshes + fur_on("\"low\""));
    const World a = bracket.build(), b = plain.build();
    EXPECT_EQ(a.curves[0].name, "fur");
    EXPECT_EQ(vertices_of(a.curves[0]), vertices_of(b.curves[0]));
}

TEST(SeveralMeshes, MistakesAreTold) {
    const auto mistake = [](const std::string& on, const std::string& more = "") -> std::string {
        try {
            TestScene scene(mesh("low", "plane") + mesh("high", "plane") + fur_on(on) + more);
        } catch (const InputError& error) {
            return to_string(error.problems.at(0));
        }
        return "";
    };
    EXPECT_EQ(mistake("[\"low\", \"high\"]"), "");
    EXPECT_NE(mistake("[]").find("or a list of such names"), std::string::npos) << mistake("[]");
    EXPECT_NE(mistake("[\"low\", \"low\"]").find("names \"low\" twice: name each once"), std::string::npos)
        << mistake("[\"low\", \"low\"]");
    EXPECT_NE(mistake("[\"low\", \"hihg\"]").find("there is no mesh or procedural \"hihg\""),
              std::string::npos)
        << mistake("[\"low\", \"hihg\"]");
    EXPECT_NE(mistake("[\"low\", 3]").find("a part of procedural.fur.on"), std::string::npos);
    const std::string two = mistake("[\"low\", \"high\"]", "\n" + fur_on("[\"low\", \"high\"]"));
    EXPECT_NE(two.find("the name \"fur.low\" is taken"), std::string::npos) << two;
    // Curves that others name must be those of one mesh.
    const std::string guided =
        mistake("[\"low\", \"high\"]", "\n[[procedural]]\ntype = \"groom\"\nname = \"child\"\non = \"low\"\n"
                                       "count = 9\nwidth = 0.01\nguides.curves = \"fur\"\n");
    EXPECT_NE(guided.find("guides.curves: there is no curves or procedural \"fur\""), std::string::npos)
        << guided;
    // Imported strands need exactly one mesh.
    const std::string imported =
        mistake("\"low\"", "\n[[procedural]]\ntype = \"strands\"\nname = \"s\"\ncurves = \"fur\"\n"
                           "on = [\"low\", \"high\"]\n");
    EXPECT_NE(imported.find("procedural.s.on is "), std::string::npos) << imported;
}

// ---- what meshes carry

TEST(Attributes, OfAMeshReachTheWorldAndTheGroom) {
    const std::string dune =
        hill("dune", "size = 8\ndivisions = 32\nlayer = [{ type = \"bump\", height = 1 }]");
    TestScene scene(dune + groom("hair", "dune",
                                 "count = 400\ndensity_by = [{ attribute = \"sand\", ramp = "
                                 "{ knots = [[0, 0], [0.5, 1]], interpolation = \"constant\" } }]"));
    const World world = scene.build();
    const MeshGeometry& mesh = mesh_named(world, "dune");
    ASSERT_EQ(mesh.attributes.size(), 3u);
    const AttributeValues* sand = find_attribute(mesh.attributes, "sand");
    ASSERT_NE(sand, nullptr);
    EXPECT_EQ(sand->rate, MARRAM_PER_VERTEX);
    for (size_t v = 0; v < sand->values.size(); ++v)
        EXPECT_EQ(sand->values[v], std::clamp(mesh.positions[0][v].y(), 0.0F, 1.0F));
    EXPECT_TRUE(find_attribute(mesh.attributes, "square")->discrete);
    ASSERT_EQ(mesh.grids.size(), 1u);
    EXPECT_EQ(mesh.grids[0].name, "height");
    EXPECT_EQ(mesh.grids[0].values.size(), 33u * 33u);
    // The height falls to half at 0.83 m from the middle.
    for (size_t c = 0; c < world.curves[0].curve_count; ++c) {
        const Vec3f root = cv(world.curves[0], 0, c, 0);
        EXPECT_LT(std::hypot(root.x(), root.z()), 0.9F);
    }
}

TEST(Attributes, ScaleLengthAndWind) {
    const std::string dune =
                          hill("dune", "size = 8\ndivisions = 32\nlayer = [{ type = \"bump\", height = 1 }]"),
                      wind = "[wind]\nspeed = 8\nglobal_rotate = 0.6\n";
    const auto plain = [&](const std::string& more) {
        TestScene scene(wind + dune + groom("hair", "dune", "count = 300\n" + more));
        const World world = scene.build();
        const CurveGeometry& curves = world.curves[0];
        std::vector<std::pair<float, float>> found; // the root's distance from the middle; length
        for (size_t c = 0; c < curves.curve_count; ++c) {
            float length = 0.0F;
            for (uint32_t k = 0; k + 1 < curves.cvs_per_curve; ++k)
                length += (cv(curves, 0, c, k + 1) - cv(curves, 0, c, k)).norm();
            const Vec3f root = cv(curves, 0, c, 0);
            found.emplace_back(std::hypot(root.x(), root.z()), length);
        }
        return found;
    };
    const auto scaled = plain("length_by = [{ attribute = \"sand\" }]"), whole = plain("");
    ASSERT_EQ(scaled.size(), whole.size());
    for (size_t c = 0; c < scaled.size(); ++c) {
        EXPECT_EQ(scaled[c].first, whole[c].first);
        // Roughly: it is linear over triangles.
        const float sand = std::exp(-scaled[c].first * scaled[c].first);
        EXPECT_NEAR(scaled[c].second, whole[c].second * sand, 0.03F * whole[c].second);
    }
    TestScene calm(
        wind + dune +
        groom("hair", "dune", "count = 300\nwind_by = [{ attribute = \"sand\", ramp = [[0, 0], [1, 0]] }]"));
    TestScene rest(dune + groom("hair", "dune", "count = 300"));
    rest.settings.stage = MARRAM_REST;
    EXPECT_EQ(vertices_of(calm.build().curves[0]), vertices_of(rest.build().curves[0]));
}

TEST(Attributes, ThatAreNotThereAreNamed) {
    const auto asks = [](const std::string& name, const std::string& on) {
        TestScene scene(mesh("ground", "plane") + hill("dune") +
                        groom("hair", on, "count = 50\ndensity_by = [{ attribute = \"" + name + "\" }]"));
        return scene.build_errors();
    };
    EXPECT_NE(asks("snow", "dune").find("has no attribute 'snow': choose among sand, square, age"),
              std::string::npos);
    EXPECT_NE(asks("sand", "ground").find("has no attribute 'sand'"), std::string::npos);
    EXPECT_NE(asks("age", "dune").find("differs from frame to frame"), std::string::npos);
}

// ---- the render mesh

TEST(RenderMesh, IsMadeForTheCameraAndMovesNoStrand) {
    TestScene scene(hill("dune", "layer = [{ type = \"bump\" }]") +
                    groom("hair", "dune", "wind.collision.solver = \"exact\""));
    const World plain = scene.build();
    EXPECT_TRUE(plain.growth_surfaces.empty());
    const std::vector<float> strands = vertices_of(plain.curves[0]);
    const size_t growth = plain.meshes[0].triangles.size();
    size_t before = 0;
    for (const double distance : {40.0, 4.0, 1.0}) {
        CameraSamples& camera = scene.settings.camera.emplace();
        camera.times = {1.0};
        camera.positions = {Vec3d(0.0, 0.0, distance)};
        camera.directions = {-Vec3d::UnitZ()};
        camera.ups = {Vec3d::UnitY()};
        const World world = scene.build();
        EXPECT_GT(world.meshes[0].triangles.size(), before) << distance;
        before = world.meshes[0].triangles.size();
        EXPECT_EQ(world.growth_surface(0).triangles.size(), growth);
        EXPECT_EQ(vertices_of(world.curves[0]), strands);
        EXPECT_EQ(scene.stats.triangles, before);
        // In the middle: camera rays hit a triangle of the render mesh, strands see one of the growth
        // surface.
        SurfacePoint point;
        Ray ray{Vec3f(0.01F, 5.0F, 0.02F), -Vec3f::UnitY()};
        ray.tnear = 3.99F; // past the hair: the hill is 4 m away
        ASSERT_TRUE(intersect(world, ray, point, false));
        RTCRayHit collider{};
        collider.ray = {0.01F, 5.0F, 0.02F, 0.0F, 0.0F, -1.0F, 0.0F, 0.0F, 10.0F, ~0U, 0, 0};
        collider.hit.geomID = collider.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        marram_intersect1(world.colliders.get(), &collider, 0);
        ASSERT_EQ(collider.hit.geomID, 0u);
        EXPECT_LT(collider.hit.primID, growth);
        ASSERT_EQ(point.geometry, 0u);
        EXPECT_EQ(point.primitive >= growth, distance == 1.0)
            << point.primitive; // of 2, 200, 3,200 triangles
    }
}

// ---- motion

TEST(Motion, OfAMeshThatAProceduralMakesIsFollowed) {
    TestScene scene(hill("dune", "swell = 1") + groom("hair", "dune"));
    scene.settings.shutter_close = 1.0;
    scene.settings.motion_keys = 0;
    scene.settings.tolerance = 1e-3;
    const World world = scene.build();
    const MeshGeometry& dune = world.meshes[0];
    const size_t keys = dune.positions.size();
    EXPECT_GT(keys, 5u);
    EXPECT_LT(scene.stats.mesh_motion_error, 1e-3);
    for (size_t t = 0; t < keys; ++t)
        EXPECT_NEAR(double(highest(dune, t)), std::sin(1.0 + double(t) / double(keys - 1)), 1e-6);
    ASSERT_GE(world.curves[0].vertices.size(), keys);
    const size_t last = world.curves[0].vertices.size() - 1;
    EXPECT_NEAR(double(cv(world.curves[0], last, 0, 0).y() - cv(world.curves[0], 0, 0, 0).y()),
                std::sin(2.0) - std::sin(1.0), 1e-5);
    scene.settings.motion_keys = 2;
    EXPECT_EQ(scene.build().meshes[0].positions.size(), 2u);
}

// The past of such a mesh is asked for, whatever the shutter.
TEST(Motion, OfAMeshThatAProceduralMakesDragsStrandsWithAClosedShutterToo) {
    const std::string wind = "\n[wind]\nspeed = 0\n", swings = "jiggle = { frequency = 2, step = 0.5 }\n",
                      scene = hill("dune", "swell = 1") + groom("hair", "dune", "lean = 40\n");
    TestScene closed(wind + swings + scene), open(wind + swings + scene), stiff(wind + scene);
    closed.settings.shutter_close = stiff.settings.shutter_close = 0.0;
    open.settings.shutter_close = 1.0;
    open.settings.motion_keys = 3;
    const World a = closed.build(), b = open.build(), c = stiff.build();
    const CurveGeometry &at_once = a.curves[0], &blurred = b.curves[0], &rigid = c.curves[0];
    ASSERT_EQ(at_once.vertices.size(), 1u);
    ASSERT_EQ(blurred.vertices.size(), 3u);
    double differ = 0.0, lag = 0.0;
    for (size_t i = 0; i < at_once.curve_count; ++i) {
        const uint32_t tip = at_once.cvs_per_curve - 1;
        differ = std::max(differ, double((cv(at_once, 0, i, tip) - cv(blurred, 0, i, tip)).norm()));
        lag = std::max(lag, double((cv(at_once, 0, i, tip) - cv(rigid, 0, i, tip)).norm()));
    }
    EXPECT_LT(differ, 1e-5);
    EXPECT_GT(lag, 1e-3);
}

// ---- simulation

// Simulated frames are stored and not simulated again: from frame to frame, and from run to run.
TEST(States, AreKept) {
    const fs::path folder = fs::temp_directory_path() / ("marram_states_" + std::to_string(::getpid()));
    fs::remove_all(folder);
    const auto run = [&](double frame, const std::string& more = "grow = 0.25",
                         const std::string& at = "disk") {
        TestScene scene(hill("dune", more));
        scene.settings.frame = frame;
        scene.settings.state_folder = at == "disk" ? folder.string() : "";
        const World world = scene.build();
        EXPECT_NEAR(highest(world.meshes[0]), 0.25F * float(frame - 1.0), 1e-6F) << more;
        return scene.stats.report("hill.simulated");
    };
    EXPECT_EQ(run(9.0), 8.0);
    EXPECT_EQ(run(9.0), 0.0);
    EXPECT_EQ(run(12.0), 3.0);
    EXPECT_EQ(run(4.0), 0.0);
    EXPECT_EQ(run(4.0, "grow = 0.25", "memory"), 3.0);
    EXPECT_EQ(run(4.0, "grow = 0.25\ntone = 2"), 3.0); // other values: a different folder
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 2);
    // Damaged files are ignored.
    for (const fs::directory_entry& states : fs::directory_iterator(folder))
        for (const char* name : {"11.state", "12.state"})
            if (fs::exists(states.path() / name)) fs::resize_file(states.path() / name, 41);
    TestScene scene(hill("dune", "grow = 0.25"));
    scene.settings.frame = 12.0;
    scene.settings.state_folder = folder.string();
    scene.build();
    EXPECT_EQ(scene.stats.report("hill.simulated"), 2.0);
    ASSERT_EQ(scene.stats.warnings.size(), 2u);
    EXPECT_NE(to_string(scene.stats.warnings[0]).find("is damaged"), std::string::npos);
    fs::remove_all(folder);
}

TEST(States, FollowTheInputs) {
    const fs::path folder = fs::temp_directory_path() / ("marram_inputs_" + std::to_string(::getpid()));
    fs::remove_all(folder);
    const auto run = [&](const std::string& ground, const std::string& camera) {
        TestScene scene(ground + hill("dune", "grow = 0.25\non = \"ground\""));
        scene.settings.frame = 5.0;
        scene.settings.state_folder = folder.string();
        scene.settings.view.pixel_angle = camera.empty() ? 1e-3 : 1e-4;
        scene.build();
        return scene.stats.report("hill.simulated");
    };
    EXPECT_EQ(run(mesh("ground", "plane"), ""), 4.0);
    EXPECT_EQ(run(mesh("ground", "plane"), "another"), 0.0); // the camera does not matter
    EXPECT_EQ(run(mesh("ground", "plane", "divisions = 2"), ""), 4.0);
    fs::remove_all(folder);
}

TEST(States, ThatCannotBeWrittenAreAnError) {
    TestScene scene(hill("dune", "grow = 0.25"));
    scene.settings.frame = 3.0;
    scene.settings.state_folder = "/proc/no/such/folder";
    EXPECT_NE(scene.build_errors().find("--state"), std::string::npos);
}

// The disk may be full after hours of simulation.
TEST(States, ThatCannotBeWrittenLaterAreAWarning) {
    const fs::path folder = fs::temp_directory_path() / ("marram_full_" + std::to_string(::getpid()));
    fs::remove_all(folder);
    const auto run = [&](double frame) {
        TestScene scene(hill("dune", "grow = 0.25"));
        scene.settings.frame = frame;
        scene.settings.state_folder = folder.string();
        EXPECT_NEAR(highest(scene.build().meshes[0]), 0.25F * float(frame - 1.0), 1e-6F);
        return scene.stats.warnings;
    };
    EXPECT_TRUE(run(4.0).empty());
    const fs::path states = *fs::directory_iterator(folder);
    for (const char* name : {"5.state", "6.state"}) fs::create_directories(states / name / "in the way");
    const std::vector<Problem> warnings = run(6.0);
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_NE(to_string(warnings[0]).find("only the newest state is kept, in memory"), std::string::npos)
        << to_string(warnings[0]);
    fs::remove_all(folder);
}

TEST(States, CanBeCancelled) {
    TestScene scene(hill("dune", "grow = 0.25") + groom("hair", "dune"));
    scene.settings.frame = 1e6;
    std::thread impatient([&] {
        while (scene.progress.fraction.load() <= 0.0) std::this_thread::yield();
        scene.cancel = true;
    });
    EXPECT_THROW(scene.build(), Cancelled);
    impatient.join();
}

// ---- updates

// A scene updated with a change equals the scene loaded with it.
TEST(Update, IsAsGoodAsNew) {
    const std::string first = hill("dune", "layer = [{ type = \"bump\" }]") + groom("hair", "dune"),
                      tone =
                          hill("dune", "tone = 0.5\nlayer = [{ type = \"bump\" }]") + groom("hair", "dune"),
                      higher =
                          hill("dune", "layer = [{ type = \"bump\", height = 2 }]") + groom("hair", "dune"),
                      finer = hill("dune", "divisions = 16\nlayer = [{ type = \"bump\" }]") +
                              groom("hair", "dune"),
                      longer =
                          hill("dune", "layer = [{ type = \"bump\" }]") + groom("hair", "dune", "arc = 40");
    TestScene told(first);
    told.build();
    const auto changes = [](uint32_t dune, uint32_t hair) {
        return GeometryChanges{{"dune", dune}, {"hair", hair}};
    };
    constexpr uint32_t moved = MARRAM_POSITIONS | MARRAM_ATTRIBUTES;
    EXPECT_EQ(told.update(first), changes(MARRAM_NOTHING, MARRAM_NOTHING));
    EXPECT_EQ(told.update(tone), changes(MARRAM_ATTRIBUTES, moved));
    EXPECT_EQ(told.update(higher), changes(moved, MARRAM_EVERYTHING));
    EXPECT_EQ(told.update(finer), changes(MARRAM_EVERYTHING, MARRAM_EVERYTHING));
    EXPECT_EQ(told.update(longer), changes(MARRAM_EVERYTHING, MARRAM_EVERYTHING));
    EXPECT_EQ(told.update(first), changes(MARRAM_NOTHING, moved));
    for (const std::string& text : {tone, higher, finer, longer, first, finer, finer, longer}) {
        told.update(text);
        TestScene fresh(text);
        const World a = told.build(), b = fresh.build();
        EXPECT_EQ(vertices_of(a.curves[0]), vertices_of(b.curves[0]));
        EXPECT_EQ(a.meshes[0].positions[0], b.meshes[0].positions[0]);
        EXPECT_EQ(a.meshes[0].attributes[0].values, b.meshes[0].attributes[0].values);
    }
}

// The groom was not notified that its mesh changed: it reports an error and reads nothing out of bounds.
TEST(Update, ThatIsNotPassedOnIsAnError) {
    TestScene scene(hill("dune") + groom("hair", "dune"));
    scene.build();
    scene.update_alone(hill("dune", "divisions = 3") + groom("hair", "dune"), 0);
    EXPECT_NE(scene.build_errors().find("has other triangles than when its strands were placed"),
              std::string::npos);
}

// A change that a failed update did not deliver to a groom arrives with the next update.
TEST(Update, IsNotLostWhereAnotherObjects) {
    TestScene scene(hill("dune", "layer = [{ type = \"bump\" }]") + groom("hair", "dune"));
    scene.build();
    const std::string higher = hill("dune", "layer = [{ type = \"bump\", height = 2 }]");
    EXPECT_THROW(scene.update(higher + groom("hair", "dune", "count = 200\ndensity = 3")), InputError);
    scene.update(higher + groom("hair", "dune"));
    TestScene fresh(higher + groom("hair", "dune"));
    EXPECT_EQ(vertices_of(scene.build().curves[0]), vertices_of(fresh.build().curves[0]));
    // This includes roles and changed names.
    const std::string second = hill("second"), through = hill("dune", "collides = false");
    TestScene roles(hill("dune") + second + groom("hair", "second", "wind.collision.solver = \"exact\""));
    roles.build();
    const GeometryChanges changes =
        roles.update(through + second + groom("hair", "dune", "wind.collision.solver = \"exact\""));
    EXPECT_EQ(changes.at("dune"), uint32_t(MARRAM_EVERYTHING));
    TestScene anew(through + second + groom("hair", "dune", "wind.collision.solver = \"exact\""));
    EXPECT_EQ(vertices_of(roles.build().curves[0]), vertices_of(anew.build().curves[0]));
}

TEST(Update, ThatFailsChangesNothing) {
    TestScene scene(hill("dune", "size = 4"));
    const World before = scene.build();
    EXPECT_THROW(scene.update(hill("dune", "size = 200000")), InputError);
    EXPECT_EQ(scene.build().meshes[0].positions[0], before.meshes[0].positions[0]);
}

// ---- curves

TEST(Curves, AreLentLikeMeshes) {
    const std::string drawn = line("crest", "[[1, 2, 3], [2, 2, 3], [3, 2, 4]]");
    TestScene scene(drawn + reeds("reed", "along = \"crest\"") +
                    hill("dune", "along = \"reed\"\ncollides = false\nshelters = false"));
    const World world = scene.build();
    ASSERT_EQ(world.curves.size(), 1u);
    EXPECT_EQ(cv(world.curves[0], 0, 0, 0), Vec3f(1, 2, 3));
    // The hill's ridge is at the first reed, at x = 1.
    const MeshGeometry& dune = world.meshes[0];
    for (const Vec3f& p : dune.positions[0])
        EXPECT_NEAR(p.y(), std::exp(-(p.x() - 1.0F) * (p.x() - 1.0F)), 1e-6F);
    // A procedural that makes no curves cannot lend any.
    TestScene none(reeds("reed", "along = \"dune\"") + hill("dune"));
    EXPECT_NE(none.build_errors().find("reed: 'dune' makes no curves"), std::string::npos)
        << none.build_errors();
    TestScene no_mesh(reeds("reed") + hill("dune", "on = \"reed\""));
    EXPECT_NE(no_mesh.build_errors().find("dune: 'reed' makes no mesh"), std::string::npos)
        << no_mesh.build_errors();
}

// Curves of 2, 3, 4, 5 CVs: rays hit each at its place, and each carries its own attributes.
TEST(Curves, MayHaveDifferentCounts) {
    TestScene scene(reeds("reed"));
    scene.settings.attributes = {"count", "number"};
    const World world = scene.build();
    const CurveGeometry& curves = world.curves[0];
    EXPECT_EQ(curves.offsets, (std::vector<uint64_t>{0, 2, 5, 9, 14}));
    EXPECT_EQ(scene.stats.cvs, 14u);
    EXPECT_EQ(scene.stats.segments, 10u);
    for (uint32_t c = 0; c < 4; ++c) {
        const float top = 0.5F * float(c + 1);
        for (float y = 0.1F; y < top; y += 0.2F) {
            SurfacePoint point;
            ASSERT_TRUE(intersect(world, {Vec3f(float(c), y, 5.0F), -Vec3f::UnitZ()}, point, false))
                << c << " " << y;
            EXPECT_EQ(point.strand, c);
            EXPECT_NEAR(point.segment_position, 2.0F * y, 0.05F);
            EXPECT_NEAR(point.strand_u, y / top, 0.05F);
            float count = 0.0F, number = 0.0F;
            attribute_at(curves, *attribute(curves, "count"), point, &count);
            attribute_at(curves, *attribute(curves, "number"), point, &number);
            EXPECT_EQ(count, float(c + 2));
            EXPECT_NEAR(number, 2.0F * y, 0.05F);
        }
        SurfacePoint point;
        EXPECT_FALSE(intersect(world, {Vec3f(float(c), top + 0.2F, 5.0F), -Vec3f::UnitZ()}, point, false));
    }
}

// ---- parameters

TEST(Layers, HaveParametersOfTheirOwn) {
    TestScene scene(hill("dune", "") + "[[procedural.layer]]\ntype = \"slab\"\nheight = 2\n" +
                    "[[procedural.layer]]\ntype = \"bump\"\nat = [2, 2]\n");
    const MeshGeometry dune = scene.build().meshes[0];
    for (const Vec3f& p : dune.positions[0])
        EXPECT_NEAR(p.y(),
                    2.0F + std::exp(-(p.x() - 2.0F) * (p.x() - 2.0F) - (p.z() - 2.0F) * (p.z() - 2.0F)),
                    1e-5F);
}

TEST(Layers, ThatAreWrongAreNamedByTheirPlaces) {
    const auto mistake = [](const std::string& layers) {
        try {
            TestScene scene(hill("dune", layers));
        } catch (const InputError& error) {
            return to_string(error.problems.front());
        }
        return std::string();
    };
    EXPECT_NE(mistake("layer = [{ height = 2 }]").find(":5:10: procedural.dune.layer[0] has no type"),
              std::string::npos)
        << mistake("layer = [{ height = 2 }]");
    EXPECT_NE(mistake("layer = [{ typ = \"slab\" }]").find("write type in place of \"typ\""),
              std::string::npos);
    EXPECT_NE(mistake("layer = [{ type = \"slab\" }, { type = \"bumb\" }]").find("did you mean"),
              std::string::npos);
    EXPECT_NE(
        mistake("layer = [{ type = \"slab\", at = [1, 1] }]").find("procedural.dune.layer[0].at is unknown"),
        std::string::npos)
        << mistake("layer = [{ type = \"slab\", at = [1, 1] }]");
    EXPECT_NE(mistake("layer = [{ type = \"slab\", height = 2000 }]").find("layer[0].height is 2000"),
              std::string::npos);
    EXPECT_NE(mistake("layer = 3").find("procedural.dune.layer is 3"), std::string::npos);
    EXPECT_NE(mistake("lajer = []").find("did you mean \"layer\"?"), std::string::npos)
        << mistake("lajer = []");
}

TEST(Tables, AreReadByTheHost) {
    const fs::path file = fs::temp_directory_path() / ("marram_table_" + std::to_string(::getpid()) + ".csv");
    const auto height = [&](const std::string& text) {
        std::ofstream(file) << text;
        TestScene scene(hill("dune", "record = \"" + file.filename().string() + "\""));
        return highest(scene.build().meshes[0]);
    };
    const auto mistake = [&](const std::string& text) {
        try {
            height(text);
        } catch (const InputError& error) {
            return to_string(error.problems.front());
        }
        return std::string();
    };
    EXPECT_EQ(height("metres,\"wind, m/s\"\n0.5,3\n1.25,4\n"), 1.75F);
    EXPECT_EQ(height("metres\r\n0.5\r\n"), 0.5F);
    EXPECT_EQ(height("\xef\xbb\xbfmetres\n0.5\n"), 0.5F); // marked as UTF-8
    EXPECT_NE(mistake("metres,metres\n1,2\n").find(".csv:1: has two columns \"metres\""), std::string::npos)
        << mistake("metres,metres\n1,2\n");
    EXPECT_NE(mistake("metres,wind\n0.5,3\n1.25\n").find(".csv:3: has 1 columns, the first line 2"),
              std::string::npos)
        << mistake("metres,wind\n0.5,3\n1.25\n");
    EXPECT_NE(mistake("metres\nmuch\n").find(".csv:2: column 1 is \"much\": give a number"),
              std::string::npos);
    EXPECT_NE(mistake("metres\nnan\n").find("give a number"), std::string::npos);
    EXPECT_NE(mistake("metres\n\n\n1\nx\n").find(".csv:5: column 1 is \"x\""), std::string::npos);
    EXPECT_NE(mistake("metres\n").find("has no numbers"), std::string::npos);
    EXPECT_NE(mistake("").find("has no numbers"), std::string::npos);
    EXPECT_NE(mistake("a\n1\"2\n").find("is not valid CSV"), std::string::npos);
    fs::remove(file);
}

// A layer's parameter is distinct from the hill's of the same name; another column name makes another table.
TEST(Values, AreToldApart) {
    const fs::path file =
        fs::temp_directory_path() / ("marram_columns_" + std::to_string(::getpid()) + ".csv");
    const auto digest = [&](const std::string& header) {
        std::ofstream(file) << header << "\n1,2\n";
        TestScene scene(hill("dune", "record = \"" + file.filename().string() + "\""));
        return scene.geometry.procedurals[0]->digest();
    };
    EXPECT_NE(digest("a,b"), digest("b,a"));
    EXPECT_EQ(digest("a,b"), digest("a,b"));
    fs::remove(file);
}

// ---- roles

TEST(Roles, SayWhatMeetsAMesh) {
    const std::string wind =
        "[wind]\nspeed = 8\nglobal_rotate = 0.8\nshielding.shield = 1\ncollision.solver = \"exact\"\n";
    const auto scene_text = [&](const std::string& roles) {
        return wind + mesh("ground", "plane", "size = [2, 2]") +
               mesh("wall", "box", "size = [0.2, 4, 4]\ntransform = { translate = [0.5, 0, 0] }\n" + roles) +
               groom("hair", "ground");
    };
    TestScene all(scene_text("")), ghost(scene_text("collides = false\nshelters = false")),
        soft(scene_text("collides = false")),
        none(wind + mesh("ground", "plane", "size = [2, 2]") + groom("hair", "ground"));
    const std::vector<float> free = vertices_of(none.build().curves[0]);
    EXPECT_EQ(vertices_of(ghost.build().curves[0]), free);
    EXPECT_NE(vertices_of(soft.build().curves[0]), free); // it shelters
    EXPECT_NE(vertices_of(all.build().curves[0]), vertices_of(soft.build().curves[0]));
    TestScene unseen(mesh("wall", "box", "seen_by_camera = false"));
    const World world = unseen.build();
    SurfacePoint point;
    Ray ray{Vec3f(0, 0, 5), -Vec3f::UnitZ()};
    ray.mask = MARRAM_SEEN_BY_CAMERA;
    EXPECT_FALSE(intersect(world, ray, point, true));
    ray.mask = MARRAM_CASTS_SHADOWS;
    EXPECT_TRUE(intersect(world, ray, point, false));
    EXPECT_TRUE(occluded(world, ray));
}

// A strand of zero width at the root is as thick above it as one whose root is nearly zero.
TEST(Collision, ThicknessCountsWhereTheRootIsAPoint) {
    const auto built = [](const std::string& root) {
        TestScene scene("[wind]\nspeed = 9\nglobal_rotate = 1\ncollision.solver = \"exact\"\n" +
                        mesh("ground", "plane", "size = [2, 2]") +
                        mesh("wall", "box", "size = [0.2, 4, 4]\ntransform = { translate = [0.6, 0, 0] }") +
                        groom("hair", "ground", "width_profile = [[0, " + root + "], [0.2, 1], [1, 1]]"));
        return vertices_of(scene.build().curves[0]);
    };
    const std::vector<float> point = built("0"), nearly = built("1e-6");
    ASSERT_EQ(point.size(), nearly.size());
    for (size_t i = 0; i < point.size(); ++i) EXPECT_NEAR(point[i], nearly[i], 1e-4F) << i;
}

// ---- reports and warnings

TEST(Report, OfMeshesArrivesAndSoDoWarnings) {
    TestScene scene(hill("low", "layer = [{ type = \"slab\", height = 1 }]") +
                    hill("high", "size = 2\nlayer = [{ type = \"slab\", height = 3 }]") +
                    hill("wild", "swell = 200"));
    scene.build();
    const Report& report = scene.stats.report;
    EXPECT_NEAR(report("hill.highest"), 200.0 * std::sin(1.0), 1e-6);
    EXPECT_EQ(report("hill.size"), 4.0);
    EXPECT_NEAR(report("hill.steepness"), 50.0 * std::sin(1.0), 1e-6);
    ASSERT_EQ(scene.stats.warnings.size(), 1u); // once, although the hill is made for several motion keys
    EXPECT_NE(to_string(scene.stats.warnings[0]).find("the hill swells by more than 100 m: lower swell"),
              std::string::npos);
}

// ---- growing

// A plug-in built with a longer, future contract behaves as with today's, except for features unknown today.
TEST(Growing, APluginOfTheFutureWorks) {
    const std::string text =
        mesh("ground", "plane") + line("crest", "[[1, 2, 3], [2, 2, 3]]") +
        hill("dune", "on = \"ground\"\nalong = \"crest\"\ngrow = 0.5\nlayer = [{ type = \"bump\" }]") +
        reeds("reed") + groom("hair", "dune", "length_by = [{ attribute = \"sand\" }]");
    TestScene today(text), future(text, grown_terrain_library);
    for (TestScene* scene : {&today, &future}) {
        scene->settings.frame = 4.0;
        scene->settings.attributes = {"number"};
    }
    const World a = today.build(), b = future.build();
    EXPECT_EQ(mesh_named(a, "dune").positions[0], mesh_named(b, "dune").positions[0]);
    EXPECT_EQ(mesh_named(a, "dune").grids[0].values, mesh_named(b, "dune").grids[0].values);
    for (size_t i = 0; i < 2; ++i) EXPECT_EQ(vertices_of(a.curves[i]), vertices_of(b.curves[i]));
    EXPECT_EQ(future.stats.report("hill.simulated"), 3.0);
    for (const auto& [name, change] : future.update(text))
        EXPECT_EQ(change, uint32_t(MARRAM_NOTHING)) << name;
    try {
        TestScene scene("[[procedural]]\ntype = \"wisher\"\nname = \"w\"\n", grown_terrain_library);
        ADD_FAILURE() << "a parameter of an unknown type is taken";
    } catch (const InputError& error) {
        EXPECT_NE(to_string(error.problems.front()).find("its parameter wish has a type that this version"),
                  std::string::npos)
            << to_string(error.problems.front());
    }
}

TEST(Growing, WhatLacksAFunctionCannotBeUsed) {
    try {
        TestScene scene("[[procedural]]\ntype = \"no_destroy\"\nname = \"w\"\n");
        ADD_FAILURE() << "a procedural without destroy is taken";
    } catch (const InputError& error) {
        EXPECT_NE(to_string(error.problems.front()).find("it lacks a function that the contract asks for"),
                  std::string::npos);
    }
}

} // namespace
} // namespace marram::testing
