// SPDX-License-Identifier: Apache-2.0
// The procedural "rock" as used by the renderer. The wear itself is tested in tests/unit/erosion.
#include "tests/unit/world/build_scene.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace marram::testing {
namespace {

std::string rock(const std::string& more = "") {
    return "\n[[procedural]]\ntype = \"rock\"\nname = \"worn\"\nmesh = \"ball\"\npaths = 20000\n" + more +
           "\n";
}

const std::string ball = mesh("ball", "sphere", "radius = 1\ntransform = { translate = [0, 1, 0] }");
const std::string wall = mesh("wall", "box", "size = [0.2, 4, 6]\ntransform = { translate = [-3, 2, 0] }");

const MeshGeometry& mesh_of(const World& world, const std::string& name) {
    for (const MeshGeometry& mesh : world.meshes)
        if (mesh.name == name) return mesh;
    throw std::runtime_error("no mesh " + name);
}

double mean(const World& world, const std::string& name) {
    const AttributeValues* found = find_attribute(mesh_of(world, "worn").attributes, name);
    if (!found) throw std::runtime_error("no attribute " + name);
    double sum = 0.0;
    for (const float value : found->values) {
        EXPECT_TRUE(std::isfinite(value) && value >= 0.0F);
        sum += double(value);
    }
    return sum / double(found->values.size());
}

TEST(Rock, HandsOutTheMeshWithItsWear) {
    TestScene scene(ball + rock("sand_level = 0\nmap = 32\nspeed = 10"));
    const World world = scene.build();
    const MeshGeometry &source = mesh_of(world, "ball"), &worn = mesh_of(world, "worn");
    EXPECT_EQ(worn.positions[0], source.positions[0]);
    EXPECT_EQ(worn.triangles, source.triangles);
    EXPECT_EQ(worn.uvs, source.uvs);
    EXPECT_GT(mean(world, "wear"), 0.01);
    EXPECT_GT(mean(world, "wear_rate"), 0.0);
    const std::vector<float>& wear = find_attribute(worn.attributes, "wear")->values;
    double windward = 0.0, lee = 0.0;
    for (size_t v = 0; v < wear.size(); ++v) {
        EXPECT_LE(wear[v], 1.0F);
        const float x = worn.positions[0][v].x();
        if (std::abs(x) > 1e-3F)
            (x < 0.0F ? windward : lee) += double(wear[v]); // without the poles, whose vertices repeat
    }
    EXPECT_GT(windward, 5.0 * lee);
    ASSERT_EQ(worn.grids.size(), 2u);
    EXPECT_EQ(worn.grids[0].grid.nx, 32u);
}

TEST(Rock, IsShelteredByWhatItNamesAndByNothingElse) {
    const auto wear = [](const std::string& more) {
        TestScene scene(ball + wall + rock("sand_level = 0\nspeed = 10\nfull = 1\n" + more));
        return mean(scene.build(), "wear_rate");
    };
    const double open = wear(""), sheltered = wear("[[procedural.shelter]]\nmesh = \"wall\"");
    EXPECT_GT(open, 0.0);
    EXPECT_LT(sheltered, 0.2 * open);
}

TEST(Rock, AnEditOfTheLawChangesAttributesAlone) {
    TestScene scene(ball + rock("speed = 10"));
    scene.build();
    EXPECT_EQ(scene.update(ball + rock("speed = 10")).at("worn"), MARRAM_NOTHING);
    EXPECT_EQ(scene.update(ball + rock("speed = 10\nthreshold = 3")).at("worn"), MARRAM_ATTRIBUTES);
    EXPECT_GT(mean(scene.build(), "wear_rate"), 0.0);
}

TEST(Rock, IsErodedOverLevelsOfDetail) {
    const std::string eroded =
        "sand_level = 0\nspeed = 12\nheight = 1\nlevels = 2\nvoxel = 0.08\nyears = 2000\n"
        "strata = { thickness = 0.3 }\n[[procedural.winds]]\ndirection = [0, 0, 1]\n";
    TestScene scene(ball + rock(eroded));
    const World world = scene.build();
    const MeshGeometry& worn = mesh_of(world, "worn");
    EXPECT_EQ(worn.uvs.size(), 0u);
    float windward = 0.0F, lee = 0.0F;
    for (const auto& p : worn.positions[0]) windward = std::min(windward, p.z()), lee = std::max(lee, p.z());
    EXPECT_GT(windward, -0.99F);
    EXPECT_NEAR(lee, 1.0F, 0.03F);
    EXPECT_GT(mean(world, "hardness"), 0.3);
    EXPECT_GT(mean(world, "wear_rate"), 0.0);
    EXPECT_EQ(scene.update(ball + rock("level = 1\n" + eroded)).at("worn"), MARRAM_EVERYTHING);
    EXPECT_LT(mesh_of(scene.build(), "worn").positions[0].size(), worn.positions[0].size());
}

// A second build, also in another run, does not erode again, and its bits are the same.
TEST(Rock, IsErodedOnce) {
    const std::string text = ball + rock("sand_level = 0\nspeed = 12\nheight = 1\nlevels = 1\nvoxel = 0.1\n"
                                         "years = 500\n");
    namespace fs = std::filesystem;
    const fs::path folder = fs::temp_directory_path() / ("marram_rock_" + std::to_string(::getpid()));
    fs::remove_all(folder);
    std::vector<MeshGeometry> rocks;
    const auto seconds = [&](const std::string& scene_text, double frame) {
        TestScene scene(scene_text);
        scene.settings.state_folder = folder.string();
        scene.settings.frame = frame;
        const World world = scene.build();
        rocks.push_back(mesh_of(world, "worn"));
        return scene.stats.report("rock.erosion_seconds");
    };
    EXPECT_GT(seconds(text, 3.0), 0.0);
    EXPECT_EQ(seconds(text, 3.0), 0.0);
    EXPECT_EQ(seconds(text, 1.0), 0.0); // an earlier frame: nothing moves
    for (const MeshGeometry& other : rocks) {
        EXPECT_EQ(other.positions, rocks[0].positions);
        EXPECT_EQ(other.triangles, rocks[0].triangles);
        EXPECT_EQ(other.normals, rocks[0].normals);
        for (const char* name : {"wear", "wear_rate", "hardness"})
            EXPECT_EQ(find_attribute(other.attributes, name)->values,
                      find_attribute(rocks[0].attributes, name)->values);
    }
    EXPECT_GT(seconds(text + "hardness = 2\n", 3.0), 0.0);
    fs::remove_all(folder);
}

// A rock that comes from a state has nothing left of what the instance was before.
TEST(Rock, FromAStateHasNoMapsOfItsFormerSelf) {
    const std::string eroded =
        ball + rock("sand_level = 0\nspeed = 12\nheight = 1\nlevels = 1\nvoxel = 0.1\nyears = 500");
    const std::string flat = ball + rock("sand_level = 0\nspeed = 12\nheight = 1\nmap = 16");
    TestScene scene(eroded);
    EXPECT_EQ(mesh_of(scene.build(), "worn").grids.size(), 0u);
    scene.update(flat);
    EXPECT_EQ(mesh_of(scene.build(), "worn").grids.size(), 2u);
    scene.update(eroded);
    const World world = scene.build();
    EXPECT_EQ(scene.stats.report("rock.erosion_seconds"), 0.0);
    EXPECT_EQ(mesh_of(world, "worn").grids.size(), 0u);
    EXPECT_TRUE(mesh_of(world, "worn").uvs.empty());
}

// A rock whose mesh moves is eroded anew where it stands.
TEST(Rock, IsErodedAnewWhereItsMeshHasMoved) {
    const std::string moving = mesh("ball", "sphere",
                                    "radius = 1\ntransform = { keys = [{ frame = 1, translate = [0, 1, 0] }, "
                                    "{ frame = 9, translate = [0, 2, 0] }] }");
    const std::string text = moving + rock("sand_level = 0\nspeed = 12\nheight = 1\nlevels = 1\n"
                                           "voxel = 0.1\nyears = 500\n");
    TestScene scene(text);
    const auto lowest = [&](double frame) {
        scene.settings.frame = frame;
        const World world = scene.build();
        float least = 1e9F;
        for (const Vec3f& p : mesh_of(world, "worn").positions[0]) least = std::min(least, p.y());
        return least;
    };
    const float first = lowest(1.0);
    EXPECT_NEAR(lowest(9.0) - first, 1.0F, 0.02F);
    EXPECT_EQ(lowest(1.0), first);
}

bool warns(const TestScene& scene, const std::string& what) {
    return std::ranges::any_of(scene.stats.warnings, [&](const Problem& warning) {
        return to_string(warning).find(what) != std::string::npos;
    });
}

// What was given, less what is left. The first of four levels has few voxels across the ball: this is warned
// of.
TEST(Rock, ReportsWhatIsGone) {
    const std::string settings = "sand_level = 0\nspeed = 12\nheight = 1\nvoxel = 0.08\nyears = 500\n";
    double one = 0.0; // m^3, with one level
    for (const int levels : {1, 2, 4}) {
        TestScene scene(ball + rock(settings + "levels = " + std::to_string(levels) + "\n"));
        scene.build();
        const double removed = scene.stats.report("rock.erosion_removed");
        if (levels < 4) {
            EXPECT_NEAR(removed, one > 0.0 ? one : removed, 0.2 * removed) << levels;
        }
        EXPECT_GT(removed, 0.01) << levels;
        if (levels == 1) one = removed;
        EXPECT_EQ(warns(scene, "of 4 levels has voxels of 0.64 m"), levels == 4);
    }
}

TEST(Rock, SaysWhyNothingWears) {
    const auto said = [](const std::string& more, const std::string& what) {
        TestScene scene(ball + rock(more));
        scene.build();
        EXPECT_TRUE(warns(scene, what)) << what;
    };
    said("sand_level = 0\nspeed = 0", "grains have no speed");
    said("sand_level = 3\nspeed = 10", "all of the mesh 'ball' is below the sand");
    said("sand_level = 0\nspeed = 10\nbed_speed = 20", "20 m/s is more than the grains' speed, 10 m/s");
}

TEST(Rock, WearsAsMuchFarFromTheOrigin) {
    const auto volume = [](double x) {
        TestScene scene(
            mesh("ball", "sphere", fmt::format("radius = 1\ntransform = {{ translate = [{}, 1, 0] }}", x)) +
            rock("sand_level = 0\nspeed = 10\n"));
        scene.build();
        return scene.stats.report("rock.volume");
    };
    EXPECT_NEAR(volume(1e4) / volume(0.0), 1.0, 0.01);
}

TEST(Rock, FaultsNameTheirPlace) {
    try {
        TestScene scene(ball + rock("[[procedural.shelter]]\nmesh = \"ball\""));
        FAIL() << "no error";
    } catch (const InputError& error) {
        const std::string text = to_string(error.problems.at(0));
        EXPECT_NE(text.find(".toml:14:8: 'ball' is the mesh that wears: leave it out here"),
                  std::string::npos)
            << text;
    }
}

} // namespace
} // namespace marram::testing
