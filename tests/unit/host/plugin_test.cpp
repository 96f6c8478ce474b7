// SPDX-License-Identifier: Apache-2.0
// Libraries that cannot be loaded and procedurals that break the contract: each gives an error with its
// cause, and none of its output reaches Embree.
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

#include <dlfcn.h>

namespace marram::testing {
namespace {

std::string loading_error(const std::string& path) {
    try {
        const PluginLibrary library(path, {"scene.toml", 3, 11});
    } catch (const InputError& error) {
        EXPECT_EQ(error.problems.size(), 1u);
        return to_string(error.problems.front());
    }
    return "";
}

#define EXPECT_CONTAINS(text, part) EXPECT_NE((text).find(part), std::string::npos) << (text)

TEST(PluginLibrary, SaysWhyItCannotBeLoaded) {
    const std::string missing = loading_error("nowhere/libnothing.so");
    EXPECT_CONTAINS(missing, "scene.toml:3:11: cannot load the procedural library");
    EXPECT_CONTAINS(missing, "libnothing.so");
    const std::string text = loading_error(MARRAM_SOURCE_DIR "/CMakeLists.txt");
    EXPECT_CONTAINS(text, "scene.toml:3:11: cannot load the procedural library");
    EXPECT_CONTAINS(text, "CMakeLists.txt");
    const std::string folder = loading_error(MARRAM_SOURCE_DIR);
    EXPECT_CONTAINS(folder, "scene.toml:3:11: cannot load the procedural library");
    const std::string no_entry = loading_error(MARRAM_BINARY_DIR "/libno_entry_plugin.so");
    EXPECT_CONTAINS(no_entry, "has no function marram_library");
    EXPECT_CONTAINS(no_entry, "core/plugin/marram_plugin.h");
    const std::string other = loading_error(MARRAM_BINARY_DIR "/libother_abi_plugin.so");
    EXPECT_CONTAINS(other, "speaks another version " + std::to_string(MARRAM_ABI_VERSION + 1));
    const std::string refuses = loading_error(MARRAM_BINARY_DIR "/librefusing_plugin.so");
    EXPECT_CONTAINS(refuses, "speaks another version of the contract");
    const std::string embree = loading_error(MARRAM_BINARY_DIR "/libother_embree_plugin.so");
    EXPECT_CONTAINS(embree, "was built with Embree " + std::to_string(MARRAM_EMBREE_MAJOR + 1));
}

TEST(PluginLibrary, LoadsAndFindsItsTypes) {
    const PluginLibrary library(mesh_library, {});
    EXPECT_EQ(library.version(), "1");
    ASSERT_NE(library.find("pyramid"), nullptr);
    EXPECT_EQ(library.find("pyramid")->calls.kind, MARRAM_MESH);
    EXPECT_EQ(library.find("groom"), nullptr);
    const std::vector<ItemSchema> schemas = procedural_schemas(library);
    ASSERT_EQ(schemas.size(), 1u);
    EXPECT_EQ(schemas[0].type, "pyramid");
    const auto& params = schemas[0].params;
    EXPECT_TRUE(std::any_of(params.begin(), params.end(),
                            [](const ParamSpec& p) { return p.name == "height" && p.unit == "m"; }));
    EXPECT_TRUE(wind_specs(library).empty());
}

// A worker thread of TBB may still return through a library's code when its last parallel loop has ended.
TEST(PluginLibrary, StaysMapped) {
    const std::string file = MARRAM_BINARY_DIR "/libprobe_plugin.so";
    const auto is_mapped = [&] { return dlopen(file.c_str(), RTLD_NOW | RTLD_NOLOAD) != nullptr; };
    ASSERT_FALSE(is_mapped());
    { const PluginLibrary library(file, {}); }
    EXPECT_TRUE(is_mapped());
}

TEST(PluginLibrary, OfAnotherTypeIsSaid) {
    const auto library = std::make_shared<PluginLibrary>(mesh_library, Place{});
    const std::atomic<bool> cancel{false};
    const Item item{"groom", "grass", {}, {"scene.toml", 7, 1}};
    try {
        const Procedural procedural(library, item, {}, cancel);
        ADD_FAILURE() << "a mesh library has made a groom";
    } catch (const InputError& error) {
        const std::string text = to_string(error.problems.front());
        EXPECT_CONTAINS(text, "scene.toml:7:1: the library '");
        EXPECT_CONTAINS(text, "has no procedural 'groom'");
    }
}

std::string faulty(const std::string& type, const std::string& fault) {
    return "\n[[procedural]]\ntype = \"" + type + "\"\nname = \"broken\"\nfault = \"" + fault + "\"\n";
}

struct Fault {
    const char *name, *message;
};

void PrintTo(const Fault& fault, std::ostream* out) { *out << fault.name; }

std::string name_of(const ::testing::TestParamInfo<Fault>& info) {
    std::string name = info.param.name;
    std::replace(name.begin(), name.end(), '-', '_'); // GoogleTest allows no other characters
    return name;
}

class CurveFault : public ::testing::TestWithParam<Fault> {};
TEST_P(CurveFault, IsRefused) {
    TestScene scene(mesh("ground", "plane") + faulty("faulty_curves", GetParam().name));
    const std::string text = scene.build_errors();
    EXPECT_CONTAINS(text, GetParam().message);
    EXPECT_CONTAINS(text, "broken");
    EXPECT_CONTAINS(text, ".toml:"); // the procedural's place
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
}
INSTANTIATE_TEST_SUITE_P(
    All, CurveFault,
    ::testing::Values(Fault{"silent-begin", "failed without saying why"},
                      Fault{"silent-tessellate", "failed without saying why"},
                      Fault{"nan", "a CV is not a finite number"},
                      Fault{"infinite", "a CV is not a finite number"}, Fault{"one-cv", "fewer than 2 CVs"},
                      Fault{"shape", "a shape or basis that the contract does not have"},
                      Fault{"times", "number of motion samples is not the requested one"},
                      Fault{"too-many", "its patches do not add up"},
                      Fault{"too-few", "its patches do not add up"},
                      Fault{"gap", "its patches do not follow each other"},
                      Fault{"mesh", "another kind of output than it declares"}),
    name_of);

class MeshFault : public ::testing::TestWithParam<Fault> {};
TEST_P(MeshFault, IsRefused) {
    TestScene scene(mesh("ground", "plane") + faulty("faulty_mesh", GetParam().name));
    const std::string text = scene.build_errors();
    EXPECT_CONTAINS(text, GetParam().message);
    EXPECT_CONTAINS(text, "broken");
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
}
INSTANTIATE_TEST_SUITE_P(All, MeshFault,
                         ::testing::Values(Fault{"silent-mesh", "failed without saying why"},
                                           Fault{"nan", "a vertex of its mesh is not a number"},
                                           Fault{"index",
                                                 "a triangle of its mesh names a vertex that is not there"},
                                           Fault{"curves", "another kind of output than it declares"}),
                         name_of);

TEST(FaultyPlugin, MayMakeAnEmptyMesh) {
    TestScene scene(mesh("ground", "plane") + faulty("faulty_mesh", "empty"));
    const World world = scene.build();
    ASSERT_EQ(world.meshes.size(), 2u);
    EXPECT_TRUE(world.meshes[1].triangles.empty());
    EXPECT_EQ(scene.stats.triangles, 2u);
}

TEST(FaultyPlugin, ThatFailsInCreateInSilenceIsNamed) {
    try {
        const TestScene scene(faulty("faulty_curves", "silent-create"));
        ADD_FAILURE() << "create has failed and nothing is said";
    } catch (const InputError& error) {
        EXPECT_CONTAINS(to_string(error.problems.front()),
                        "the procedural 'broken' failed without saying why");
    }
}

TEST(FaultyPlugin, WithoutFaultIsBuilt) {
    TestScene scene(faulty("faulty_mesh", "none") +
                    "[[procedural]]\ntype = \"faulty_curves\"\nname = \"good\"\n");
    const World world = scene.build();
    ASSERT_EQ(world.meshes.size(), 1u);
    ASSERT_EQ(world.curves.size(), 1u);
    EXPECT_EQ(world.curves[0].curve_count, 12u);
    EXPECT_TRUE(world.bounds.contains(Vec3f(11, 3, 0)));
}

// A procedural that never polls for cancellation is still stopped between its patches.
TEST(FaultyPlugin, ThatThrowsAwayCancelIsStopped) {
    TestScene scene(faulty("faulty_curves", "deaf"));
    std::atomic<bool> over{false};
    std::thread impatient([&] {
        while (scene.progress.fraction.load() <= 0.0 && !over) std::this_thread::yield();
        scene.cancel = true;
    });
    EXPECT_THROW(scene.build(), Cancelled);
    over = true;
    impatient.join();
    EXPECT_LT(scene.progress.fraction.load(), 1.0);
}

TEST(MeshPlugin, BecomesACollider) {
    TestScene scene(mesh("ground", "plane") +
                    "[[procedural]]\ntype = \"pyramid\"\nname = \"tomb\"\nheight = 3\n" +
                    groom("hair", "ground"));
    const World world = scene.build(); // throws if the lent host was destroyed
    ASSERT_EQ(world.meshes.size(), 2u);
    const MeshGeometry& tomb = world.meshes[1];
    EXPECT_EQ(tomb.name, "tomb");
    EXPECT_EQ(tomb.triangles.size(), 6u);
    EXPECT_EQ(tomb.uvs.size(), 5u);
    ASSERT_EQ(tomb.positions.size(), 1u);
    EXPECT_EQ(tomb.positions[0][4], Vec3f(0, 3, 0));
    ASSERT_EQ(tomb.normals.size(), 1u);
    EXPECT_GT(tomb.normals[0][4].y(), 0.5F);
    EXPECT_NE(rtcGetGeometry(world.colliders.get(), 1), nullptr);
    EXPECT_EQ(scene.stats.triangles, 2u + 6u);
}

TEST(MeshPlugin, CarriesAGroomWhateverStandsFirst) {
    const std::string tomb = "[[procedural]]\ntype = \"pyramid\"\nname = \"tomb\"\nheight = 3\n";
    const std::string ground = mesh("ground", "plane"), hair = groom("hair", "tomb", "cvs = 5\n");
    std::vector<float> first;
    for (const std::string& text : {ground + tomb + hair, hair + tomb + ground}) {
        TestScene scene(text);
        scene.settings.shutter_close = 0.5;
        const World world = scene.build();
        ASSERT_EQ(world.curves.size(), 1u);
        const CurveGeometry& curves = world.curves[0];
        ASSERT_EQ(curves.curve_count, 200u);
        // Roots lie on a side, where |x| or |z| and y / 3 add up to 1, or on the base.
        for (size_t c = 0; c < curves.curve_count; ++c) {
            const Vec3f root = cv(curves, 0, c, 0);
            const float out = std::max(std::abs(root.x()), std::abs(root.z()));
            const bool on_side = std::abs(out + root.y() / 3.0F - 1.0F) < 1e-5F;
            EXPECT_TRUE(on_side || std::abs(root.y()) < 1e-5F) << root.transpose();
        }
        const std::vector<float> now(curves.vertices[0], curves.vertices[0] + curves.curve_count * 7 * 4);
        if (first.empty()) first = now;
        EXPECT_EQ(now, first);
    }
}

} // namespace
} // namespace marram::testing
