// SPDX-License-Identifier: Apache-2.0
// Bad input of every kind through the whole program, each in its own process: exit code 2, one line a mistake
// on stderr, and no file is changed.
#include "core/image/atomic_file.h"
#include "core/image/run_files.h"
#include "core/shot/frame_list.h"
#include "program.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <regex>
#include <sstream>

namespace marram::testing {
namespace {

const fs::path corpus = MARRAM_SOURCE_DIR "/tests/broken";

// "place: what is wrong: what to do". The place is a file with or without line and column.
bool is_explanation(const std::string& line) {
    static const std::regex form("\\S.*: \\S.*: \\S.*");
    return std::regex_match(line, form);
}

// Runs the command beside an old picture. Returns the lines of stderr. The folder must not change.
std::vector<std::string> refused(const Folder& folder, std::vector<std::string> command) {
    folder.write("old.exr", "an old picture");
    const auto before = folder.contents();
    const ProgramResult outcome = marram(command, run_copy);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_TRUE(folder.contents() == before)
        << fmt::format("there are now {}", fmt::join(folder.names(), ", "));
    const std::vector<std::string> said = lines(outcome.err);
    EXPECT_FALSE(said.empty());
    for (const std::string& line : said) EXPECT_TRUE(is_explanation(line)) << line;
    return said;
}

std::vector<std::string> refused_scene(const Folder& folder, const std::string& scene,
                                       std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"render", scene, "-o", folder / "old.exr"});
    return refused(folder, more);
}

// Expects exactly one mistake, with this message.
void expect_refused(const std::string& text, const std::string& message, std::vector<std::string> more = {}) {
    SCOPED_TRACE(message);
    const Folder folder;
    const std::vector<std::string> said =
        refused_scene(folder, folder.write("a.toml", text), std::move(more));
    ASSERT_EQ(said.size(), 1u) << fmt::format("{}", fmt::join(said, "\n"));
    EXPECT_CONTAINS(said[0], message);
}

std::vector<fs::path> files_in(const fs::path& folder) {
    std::vector<fs::path> files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    return files;
}

// Grooms of the corpus may lack a width; this adds one.
std::vector<std::string> with_width(const std::string& scene) {
    static const std::regex groom("\\[\\[procedural\\]\\]\nname = \"(\\w+)\"[^\n]*\ntype = \"groom\"");
    std::smatch match;
    if (!std::regex_search(scene, match, groom) || scene.find("\nwidth") != std::string::npos) return {};
    return {"--set", "procedural." + match[1].str() + ".width=0.01"};
}

// Files that begin with "# expect: LINE:COLUMN: part of the message".
TEST(BadInput, ScenesOfTheCorpus) {
    const Folder folder;
    for (const fs::path& scene : files_in(corpus / "scenes")) {
        SCOPED_TRACE(scene.filename().string());
        std::vector<std::string> expected;
        for (const std::string& line : lines(read_file(scene)))
            if (line.starts_with("# expect: ")) expected.push_back(line.substr(10));
        const std::vector<std::string> said =
            refused_scene(folder, scene.string(), with_width(read_file(scene)));
        EXPECT_EQ(said.size(), expected.size()) << fmt::format("{}", fmt::join(said, "\n"));
        for (size_t i = 0; i < std::min(said.size(), expected.size()); ++i) {
            const size_t space = expected[i].find(' ');
            EXPECT_TRUE(said[i].starts_with(scene.string() + ":" + expected[i].substr(0, space + 1)))
                << said[i] << "\nexpected " << expected[i];
            EXPECT_CONTAINS(said[i], expected[i].substr(space + 1));
        }
    }
}

// expected.txt: file, a tab, part of the message. `table` is the scene's table, with {} in place of the file.
void refuse_files(const std::string& kind, const std::string& table) {
    if (!fs::exists(corpus / kind / "expected.txt")) GTEST_SKIP() << "no tests/broken/" << kind;
    const Folder folder;
    for (const std::string& line : lines(read_file(corpus / kind / "expected.txt"))) {
        const size_t tab = line.find('\t');
        if (line.starts_with('#') || tab == std::string::npos) continue;
        if (line.substr(0, tab).ends_with(".stl")) continue; // the scene is checked before the file is read
        SCOPED_TRACE(line);
        const std::string file = (corpus / kind / line.substr(0, tab)).string();
        const std::string scene =
            folder.write("a.toml", SceneText{.more = fmt::format(fmt::runtime(table), file)});
        const std::vector<std::string> said = refused_scene(folder, scene);
        ASSERT_GE(said.size(), 1u);
        EXPECT_CONTAINS(said[0], line.substr(line.find_first_not_of('\t', tab)));
        EXPECT_CONTAINS(said[0], file.substr(file.rfind('/') + 1));
    }
}

TEST(BadInput, MeshesOfTheCorpus) {
    refuse_files("meshes", "[[mesh]]\nname = \"bad\"\ntype = \"file\"\nfile = \"{}\"\n");
}
TEST(BadInput, HeightfieldsOfTheCorpus) {
    refuse_files("images", "[[mesh]]\nname = \"bad\"\ntype = \"heightfield\"\nimage = \"{}\"\n");
}
TEST(BadInput, EnvironmentsOfTheCorpus) {
    refuse_files("images", "[[light]]\ntype = \"environment\"\nfile = \"{}\"\n");
}
TEST(BadInput, MasksOfTheCorpus) {
    refuse_files("images", "[[procedural]]\nname = \"g\"\ntype = \"groom\"\non = \"ground\"\ncount = "
                           "9\nlength = 1\nwidth = 0.1\n"
                           "density_mask = \"{}\"\n");
}

const std::string groom = "count = 300\nlength = 0.3\nwidth = 0.02\n";

// Mistakes that only the procedural finds, reported at the line of the wrong value.
TEST(BadInput, GroomsThatCannotGrow) {
    const auto with_groom = [](const std::string& text) { return SceneText{.groom = text}; };
    expect_refused(with_groom(groom + "density = 5\n"), "both density and count are given: keep one of them");
    expect_refused(with_groom("length = 0.3\nwidth = 0.02\n"),
                   "neither density nor count is given: add density");
    expect_refused(with_groom(groom + "comb = [0, 0, 0]\n"), "comb is zero: give a direction");
    expect_refused(with_groom(groom + "width_profile = [[0, 1], [1, -1]]\n"), "width_profile goes below 0");
    expect_refused(with_groom(groom + "density_by_height = [[0, 0]]\n"), "leave");
    expect_refused(with_groom(groom + "density_by_slope = [[0, 0], [10, 0]]\n"), "a.toml:");
    expect_refused(with_groom(groom + "cvs = 1\n"), "cvs is 1");
    expect_refused(with_groom(groom + "length = 0.2\n"), "length");
    expect_refused(with_groom("count = 300\nwidth = 0.02\n"), "length");
}

TEST(BadInput, PlacesOfProceduralMistakesAreTheValues) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{.wind = "", .groom = groom + "density = 5\n"});
    const std::vector<std::string> said = refused_scene(folder, scene);
    const std::vector<std::string> text = lines(read_file(scene));
    const auto line = std::find(text.begin(), text.end(), "count = 300") - text.begin() + 1;
    ASSERT_EQ(said.size(), 1u);
    EXPECT_TRUE(said[0].starts_with(fmt::format("{}:{}:9: both density", scene, line))) << said[0];
}

TEST(BadInput, WindsThatCannotBlow) {
    const auto with_wind = [](const std::string& text) { return SceneText{.wind = text}; };
    expect_refused(with_wind("direction = [0, 0, 0]\n"), "the wind's direction is zero: give a vector");
    expect_refused(with_wind("response = [[0, 0.5], [10, 1]]\n"), "wind.response is not 0 at speed 0");
    expect_refused(with_wind("response = [[0, 0], [10, 2]]\n"), "wind.response has values outside 0 ... 1");
    expect_refused(with_wind("noise.type = \"simplex\"\n"), "simplex");
    expect_refused(with_wind("noise.loop = [5, 5]\n"), "noise.loop has no length: give two different frames");
    expect_refused(with_wind("speed = 1e12\n"), "speed");
    expect_refused(with_wind("ramp_rotate = [[0, -1], [1, 1]]\n"), "wind.ramp_rotate goes below 0");
    expect_refused(with_wind("[wind.gusts]\nnum_gusts = 5\nramp = [[0, 1]]\n"),
                   "wind.gusts.ramp is not 0 at 1");
    expect_refused(with_wind("[wind.gusts]\nnum_gusts = 5\nperiod = 0\n"),
                   "wind.gusts.start_frame_range is missing");
    expect_refused(with_wind("gusts.control = [{}, { inner = [1, 1, 1] }]\n"),
                   "wind.gusts.control[1].inner applies to boxes only");
    expect_refused(SceneText{.groom = groom + "wind.direction = [0, 0, 0]\n"},
                   "the wind's direction is zero");
    expect_refused(SceneText{.groom = groom + "wind.jiggle = { damping = 1 }\n"},
                   "jiggle.damping has no effect without jiggle.frequency");
    expect_refused(
        with_wind("[wind.shielding]\noffset = 3\n"),
        "wind.shielding.offset has no effect without shielding.shield: add wind.shielding.shield = 1");
    expect_refused(with_wind("[wind.shielding]\nshield = 1\nwake = 2\nwake_heights = 2\n"),
                   "both wake and wake_heights");
    expect_refused(with_wind("[wind.shielding]\nshield = 1\nrays = 4\n"), "shielding.rays needs a cone");
    expect_refused(
        with_wind("[wind.collision]\noffset_root = 0.1\n"),
        "wind.collision.offset_root has no effect without a solver: add wind.collision.solver = \"exact\"");
    expect_refused(with_wind("[wind.collision]\nsolver = \"exact\"\nrotation_steps = 4\n"),
                   "rotation_steps belongs to solver");
    expect_refused(with_wind("[wind.jiggle]\nfrequency = 2\ndamping = 0\n"), "give jiggle.start_frame");
    expect_refused(with_wind("[wind.jiggle]\nfrequency = 2\nstiffness = [[0, 4], [1, 0]]\n"),
                   "jiggle.stiffness is not above 0 everywhere");
}

// Settings without effect are refused, not ignored.
TEST(BadInput, WhatWouldBeIgnored) {
    const std::string fibre = "material = \"m\"\n[[material]]\nname = \"m\"\ntype = \"hair\"\n";
    const auto with_material = [&](const std::string& text) {
        return SceneText{.groom = groom + fibre + text};
    };
    expect_refused(with_material("tint = \"envelop\"\n"),
                   "'grass' has no attribute 'envelop' of one number to tint by");
    expect_refused(with_material("tint = \"root_normal\"\n"), "of one number to tint by");
    expect_refused(with_material("melanin = 8\n"), "'melanin' is not used with pigment = \"color\"");
    expect_refused(with_material("pigment = \"melanin\"\nroot_color = [1, 0, 0]\n"),
                   "'root_color' is not used with pigment = \"melanin\"");
    expect_refused(
        SceneText{.groom = groom + "lean_by = [{}]\n"},
        "lean_by: neither attribute nor image is given: name an attribute of the mesh, or an image");
    expect_refused(SceneText{.groom = groom + "arc_by = [{ attribute = \"moist\" }]\n"},
                   "has no attribute 'moist'");
    expect_refused(
        SceneText{.groom = groom + "frizz_by = [{ attribute = \"a\", ramp = [[0, 0], [1, 2]] }]\n"},
        "frizz_by[0].ramp leaves 0 ... 1");
    expect_refused(SceneText{.groom = groom + "envelope = [[0, 0], [1, 7]]\n"}, "envelope leaves 0 ... 1");
    expect_refused(SceneText{.groom = groom + "density_by_slope = [[0, -5], [1, 1]]\n"},
                   "density_by_slope leaves 0 ... 1");
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const auto only_line = [&](const std::vector<std::string>& arguments) {
        const std::vector<std::string> said = refused(folder, arguments);
        return said.size() == 1 ? said[0] : "";
    };
    EXPECT_CONTAINS(only_line({"render", scene, "-o", folder / "a.png", "--aov", "depth"}),
                    "a PNG holds the picture alone");
    EXPECT_CONTAINS(only_line({"render", scene, "-o", folder / "a.png", "--stats", folder / "a.png"}),
                    "this would overwrite");
    EXPECT_CONTAINS(only_line({"bake", scene, "-o", folder / "a.obj", "--colliders", folder / "a.obj"}),
                    "this would overwrite");
    EXPECT_CONTAINS(only_line({"render", scene, "--threads", "0"}), "--threads");
}

// A run must not write what it reads, under any name, nor a user's file that has the name of an unfinished
// picture.
TEST(BadInput, OutputsThatWouldDestroyInputs) {
    const Folder folder;
    const std::vector<float> grey(64 * 32 * 3, 0.5F);
    write_png(folder / "map.png", 64, 32, 3, grey.data(), 0.0);
    write_png(folder / "a.partial.png", 64, 32, 3, grey.data(), 0.0);
    folder.write("triangle.obj", "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n");
    fs::create_symlink(folder / "map.png", folder / "link.png");
    const std::string scene = folder.write(
        "a.toml", SceneText{.more = "[[light]]\ntype = \"environment\"\nfile = \"map.png\"\n"
                                    "[[mesh]]\nname = \"t\"\ntype = \"file\"\nfile = \"triangle.obj\"\n"});
    const auto expect = [&](const std::vector<std::string>& more, const char* message) {
        std::vector<std::string> arguments = {"render", scene};
        arguments.insert(arguments.end(), more.begin(), more.end());
        const std::vector<std::string> said = refused(folder, arguments);
        ASSERT_EQ(said.size(), 1u) << fmt::format("{}", fmt::join(said, "\n"));
        EXPECT_CONTAINS(said[0], message);
    };
    expect({"-o", folder / "map.png"}, "this would overwrite");
    expect({"-o", folder / "link.png"}, "this would overwrite");
    expect({"-o", folder / "b.exr", "--preview", folder / "map.png"}, "this would overwrite");
    expect({"-o", folder / "b.exr", "--stats", folder / "triangle.obj"}, "this would overwrite");
    expect({"-o", folder / "b.exr", "--stats", folder / "b.exr.state.tif"}, "this would overwrite");
    expect({"-o", folder / "b.#.exr", "--frames", "1-2", "--stats", folder / "b.2.exr"},
           "this would overwrite");
    expect({"-o", folder / "a.png"}, "this file would be overwritten by an unfinished picture");
    const std::vector<std::string> said =
        refused(folder, {"bake", scene, "-o", folder / "s.obj", "--colliders", folder / "triangle.obj"});
    ASSERT_EQ(said.size(), 1u);
    EXPECT_CONTAINS(said[0], "this would overwrite");
}

// Two spellings of one path are the same file, whether it exists or not.
TEST(BadInput, OneFileUnderTwoNames) {
    const Folder folder;
    fs::create_symlink("picture.exr", folder / "one.exr"); // to a missing file, relative
    fs::create_symlink("picture.exr", folder / "two.exr");
    const std::string absent = "no-such-file-" + std::to_string(::getpid()) + ".exr";
    for (const auto& [a, b] : {std::pair(absent, "./" + absent), std::pair("./" + absent, absent),
                               std::pair(absent, (fs::current_path() / absent).string()),
                               std::pair(folder / "one.exr", folder / "two.exr"),
                               std::pair(folder / "one.exr", folder / "picture.exr")}) {
        RunFiles files({});
        files.write(a);
        EXPECT_THROW(files.write(b), InputError) << a << " and " << b;
        EXPECT_THROW(RunFiles({a}).write(b), InputError) << a << " and " << b;
    }
    RunFiles files({});
    files.write(folder / "one.exr");
    EXPECT_NO_THROW(files.write(folder / "other.exr"));
    AtomicFile writer(folder / "one.exr");
    writer.write("text");
    writer.commit();
    EXPECT_TRUE(fs::is_symlink(folder / "one.exr"));
    EXPECT_EQ(read_file(folder / "picture.exr"), "text");
}

TEST(BadInput, MaterialsWhereTheyMeanNothing) {
    const std::string ball = "[[mesh]]\nname = \"ball\"\ntype = \"sphere\"\nradius = 1\nmaterial = \"m\"\n";
    const auto material = [](const std::string& text) {
        return "[[material]]\nname = \"m\"\n" + text + "\n";
    };
    expect_refused(SceneText{.more = material("type = \"hair\"") + ball},
                   "'m' of type hair works on strands only, but 'ball' is a mesh");
    expect_refused(SceneText{.more = material("type = \"diffuse\"\ntint = \"gust\"") + ball},
                   "'m' reads an attribute, but the mesh 'ball' has none");
    expect_refused(SceneText{.more = material("type = \"diffuse\"\ntint = \"\"")}, "tint is empty");
}

TEST(BadInput, EnvironmentsThatAreNotAllAround) {
    const Folder folder;
    const std::vector<float> grey(64 * 64 * 3, 0.5F);
    for (const auto& [width, height] : {std::pair(64, 64), {64, 16}, {16, 64}, {63, 30}}) {
        write_png(folder / "map.png", width, height, 3, grey.data(), 0.0);
        const std::vector<std::string> said = refused_scene(
            folder,
            folder.write("a.toml",
                         SceneText{.more = "[[light]]\ntype = \"environment\"\nfile = \"map.png\"\n"}));
        ASSERT_EQ(said.size(), 1u);
        EXPECT_CONTAINS(said[0], "a.toml:");
        EXPECT_CONTAINS(said[0], "twice as wide as high");
    }
}

TEST(BadInput, ImageMasksWithoutUvs) {
    const Folder folder;
    folder.write("triangle.obj", "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n");
    const float white[] = {1.0F, 1.0F, 1.0F};
    write_png(folder / "mask.png", 1, 1, 3, white, 0.0);
    const std::string bare = "[[mesh]]\nname = \"bare\"\ntype = \"file\"\nfile = \"triangle.obj\"\n"
                             "[[procedural]]\nname = \"fur\"\ntype = \"groom\"\non = \"bare\"\n" +
                             groom;
    for (const char* mask : {"density_mask", "length_mask"}) {
        const std::string scene =
            folder.write("a.toml", SceneText{.more = bare + mask + " = \"mask.png\"\n"});
        const std::vector<std::string> said = refused(folder, {"render", scene, "-o", folder / "old.exr"});
        ASSERT_EQ(said.size(), 1u);
        EXPECT_CONTAINS(said[0], "the mesh 'bare' has no uvs for this image");
    }
}

TEST(BadInput, LibrariesThatCannotBeUsed) {
    const auto with_library = [](const std::string& path, const std::string& type = "groom") {
        return SceneText{
            .more = fmt::format(
                "[[procedural]]\nname = \"other\"\ntype = \"{}\"\non = \"ground\"\n{}library = \"{}\"\n",
                type, groom, path)};
    };
    const std::string build = MARRAM_BINARY_DIR;
    expect_refused(with_library("no_such_library.so"), "no_such_library.so");
    expect_refused(with_library("a.toml"), "the scene asks to run the code of the library");
    expect_refused(with_library(build), "library");
    expect_refused(with_library(build + "/libno_entry_plugin.so"), "has no function marram_library");
    expect_refused(with_library(build + "/libother_abi_plugin.so"), "speaks another version");
    expect_refused(with_library(build + "/librefusing_plugin.so"), "speaks another version");
    expect_refused(with_library(build + "/libmesh_plugin.so"), "has no procedural 'groom'");
    expect_refused(with_library("no_such_library.so", "pyramid"), "no_such_library.so");
}

// A scene from elsewhere is data: what lies beside it is not run unless the user says so.
TEST(BadInput, LibrariesFromElsewhere) {
    const Folder folder;
    fs::copy_file(MARRAM_BINARY_DIR "/libmesh_plugin.so", folder / "x.so");
    const std::string scene = folder.write(
        "a.toml",
        SceneText{.more = "[[procedural]]\nname = \"tomb\"\ntype = \"pyramid\"\nlibrary = \"x.so\"\n"});
    for (const std::vector<std::string>& command :
         {std::vector<std::string>{"render", scene, "-o", folder / "old.exr"},
          {"info", scene},
          {"info", "--keys", scene},
          {"bake", scene, "-o", folder / "old.exr", "--allow-library", folder / "other.so"}}) {
        const std::vector<std::string> said = refused(folder, command);
        ASSERT_EQ(said.size(), 1u) << fmt::format("{}", fmt::join(said, "\n"));
        EXPECT_CONTAINS(said[0], "a.toml:28:11: the scene asks to run the code of the library");
        EXPECT_CONTAINS(said[0], "--allow-library " + folder / "x.so");
        EXPECT_CONTAINS(said[0], "MARRAM_PLUGIN_PATH");
    }
    const auto allowed = marram({"info", "--keys", scene, "--allow-library", folder / "x.so"}, run_copy);
    EXPECT_EQ(allowed.code, 0) << allowed.err;
    EXPECT_CONTAINS(allowed.out, "procedural.tomb.height");
    fs::create_directory(folder / "in");
    fs::create_symlink(folder / "x.so", folder / "in/x.so"); // as the owner of the folder wants it
    folder.write("a.toml", SceneText{.more = "[[procedural]]\nname = \"tomb\"\ntype = \"pyramid\"\nlibrary = "
                                             "\"in/x.so\"\n"});
    EXPECT_EQ(refused(folder, {"info", scene}).size(), 1u);
    ASSERT_EQ(::setenv("MARRAM_PLUGIN_PATH", (folder / "in").c_str(), 1), 0);
    EXPECT_EQ(marram({"info", "--keys", scene}, run_copy).code, 0);
    ASSERT_EQ(::unsetenv("MARRAM_PLUGIN_PATH"), 0);
    fs::remove(folder / "x.so");
    ASSERT_EQ(::mkfifo((folder / "x.so").c_str(), 0600), 0); // opening it would wait
    const std::string pipe = folder.write(
        "b.toml",
        SceneText{.more = "[[procedural]]\nname = \"tomb\"\ntype = \"pyramid\"\nlibrary = \"x.so\"\n"});
    const ProgramResult waited = marram({"info", pipe, "--allow-library", folder / "x.so"}, run_copy);
    EXPECT_EQ(waited.code, 2);
    EXPECT_CONTAINS(waited.err, "is no file but a pipe or device");
}

// The plug-in alone, as it is built for the default scene or in a host that wants no rock.
TEST(BadInput, ARockWithoutItsLibrary) {
    const Folder folder;
    fs::copy_file(MARRAM_BINARY_DIR "/libmarram_procedural.so", folder / "libmarram_procedural.so");
    const std::string scene = folder.write(
        "a.toml", SceneText{.more = "[[procedural]]\ntype = \"rock\"\nname = \"worn\"\nmesh = \"ground\"\n"});
    const auto said = [&](const char* command) {
        return output_of(fmt::format("MARRAM_PLUGIN_PATH={} {}/marram {} {} 2>&1; true", folder / "",
                                     MARRAM_BINARY_DIR, command, scene));
    };
    EXPECT_CONTAINS(said("render --spp 1"),
                    "a.toml:25:1: the library of rocks cannot be loaded (libmarram_rock.so");
    EXPECT_CONTAINS(said("info --keys"), "procedural.worn.energy_per_volume"); // declared without it
}

TEST(BadInput, LibrariesThatFail) {
    const auto with_fault = [](const std::string& type, const std::string& fault) {
        return SceneText{.more = fmt::format("[[procedural]]\nname = \"bad\"\ntype = \"{}\"\nfault = "
                                             "\"{}\"\nlibrary = \"{}/libfaulty_plugin.so\"\n",
                                             type, fault, MARRAM_BINARY_DIR)};
    };
    expect_refused(with_fault("faulty_curves", "silent-create"), "'bad' failed without saying why");
    expect_refused(with_fault("faulty_curves", "nan"), "a CV is not a finite number");
    expect_refused(with_fault("faulty_curves", "gap"), "its patches do not follow each other");
    expect_refused(with_fault("faulty_mesh", "index"), "names a vertex that is not there");
    expect_refused(with_fault("faulty_mesh", "no such fault"), "no such fault");
}

TEST(BadInput, SettingsThatFitNothing) {
    const auto with_setting = [](const std::string& setting, const std::string& message) {
        expect_refused(SceneText{}, message, {"--set", setting});
    };
    with_setting("film.samples=0", "film.samples is 0");
    with_setting("film.sampels=4", "film.sampels is unknown");
    with_setting("film.samples", "--set film.samples");
    with_setting("camera.shutter=0.5", "camera.shutter"); // half a frame, or the instant half a frame later?
    with_setting("=4", "--set =4");
    with_setting("wind.speed=fast", "speed");
    with_setting("procedural.grass.count=-1", "count");
    with_setting("procedural.moss.count=1", "moss");
    with_setting("mesh.ground.size=[1, 2, 3]", "size");
    with_setting("wind.direction=[0, 0, 0]", "direction is zero");
    with_setting("procedural.grass.library=no_such.so", "no_such.so");
}

// Names with the signs of the syntax, types that several share: their elements are listed by number only.
TEST(BadInput, ListedKeysAreNotRefused) {
    const Folder folder;
    std::string terrain = "[[procedural]]\nname = \"d\"\ntype = \"terrain\"\nsize = [10, 10]\n";
    for (const char* layer :
         {"noise\"\nname = \"a=b", "noise\"\nname = \"x[0]", "noise", "noise\"\nname = \"noise",
          "noise\"\nname = \"a.amplitude", "noise\"\nname = \"a", "flat\"\nname = \"sp ace", "flat", "flat",
          "flat\"\nname = \"", "noise\"\nname = \"crest"})
        terrain += fmt::format("[[procedural.layer]]\ntype = \"{}\"\n", layer);
    const std::string scene = folder.write("a.toml", SceneText{.more = terrain});
    const ProgramResult listed = marram({"info", "--keys", scene});
    ASSERT_EQ(listed.code, 0) << listed.err;
    EXPECT_CONTAINS(listed.out, "procedural.d.layer[0].amplitude\n");
    EXPECT_CONTAINS(listed.out, "procedural.d.layer.crest.amplitude\n");
    EXPECT_CONTAINS(listed.out, "procedural.d.layer.noise.amplitude\n");
    std::vector<std::string> command = {"info", "--keys", scene};
    std::istringstream lines(listed.out);
    for (std::string key; std::getline(lines, key);)
        if (key.starts_with("procedural.d.layer")) command.insert(command.end(), {"--set", key + "=0"});
    ASSERT_GT(command.size(), 40u);
    const ProgramResult set = marram(command); // refuses the values of some
    for (const char* refusal :
         {"is no key", "no element", "elements of", "add one of its keys", "is unknown"})
        EXPECT_EQ(set.err.find(refusal), std::string::npos) << refusal << ": " << set.err;
}

TEST(BadInput, LightsThatCannotShine) {
    const auto lamp = [](const char* name) {
        return fmt::format("[[light]]\nname = \"{}\"\ntype = \"mesh\"\nmesh = \"ground\"\n", name);
    };
    expect_refused(SceneText{.more = lamp("a") + lamp("b")},
                   "mesh \"ground\" is already used by light \"a\"");
    const Folder folder;
    // OpenImageIO would start threads, and a child process would wait for them in vain.
    const auto write_map = [&](float odd) {
        std::vector<float> pixels(3 * 8 * 4, 0.5F);
        pixels[4] = odd;
        folder.write("hot.pfm", "PF\n8 4\n-1.0\n" + std::string(reinterpret_cast<const char*>(pixels.data()),
                                                                pixels.size() * sizeof(float)));
    };
    const std::string environment =
        fmt::format("[[light]]\nname = \"e\"\ntype = \"environment\"\nfile = \"{}\"\nstrength = 10\n",
                    folder / "hot.pfm");
    write_map(3e38F);
    expect_refused(SceneText{.more = environment}, "times strength, the limit is 1e+15");
    write_map(-1.0F);
    const std::string scene = folder.write("a.toml", SceneText{.more = environment});
    const ProgramResult outcome = marram({"render", scene, "-o", folder / "a.exr", "--quiet"});
    EXPECT_EQ(outcome.code, 0);
    EXPECT_CONTAINS(outcome.err, "has 1 pixels that are below 0: they give no light");
}

TEST(BadInput, OutputThatCannotBeWritten) {
    const std::string command = program + " info > /dev/full 2> /dev/null";
    const int status = std::system(command.c_str());
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 2) << status;
}

TEST(BadInput, CommandLines) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const auto refuse = [&](const std::vector<std::string>& command, const std::string& message) {
        SCOPED_TRACE(fmt::format("{}", fmt::join(command, " ")));
        const auto before = folder.contents();
        const ProgramResult outcome = marram(command);
        EXPECT_EQ(outcome.code, 2);
        EXPECT_CONTAINS(outcome.err, message);
        EXPECT_TRUE(folder.contents() == before)
            << fmt::format("there are now {}", fmt::join(folder.names(), ", "));
    };
    refuse({"render", scene, "-o", folder / "a.jpg"},
           "cannot be written in the format '.jpg': name it .exr or .png");
    refuse({"render", scene, "-o", folder / "a"}, "name it .exr or .png");
    refuse({"render", scene, "-o", folder / "missing/a.exr"},
           "does not exist: make it, or choose another output");
    refuse({"render", scene, "-o", folder / "missing/a.##.exr", "--frames", "1-2"}, "does not exist");
    refuse({"render", scene, "-o", folder / "a.exr", "--stats", folder / "missing/a.json"}, "does not exist");
    refuse({"render", scene, "-o", folder / "a.exr", "--frames", "3-1"}, "3-1 goes backwards: write 1-3");
    refuse({"render", scene, "-o", folder / "a.exr", "--frames", "1-x"},
           "--frames 1-x: 'x' is no last frame of the range (character 3)");
    refuse({"render", scene, "-o", folder / "a.exr", "--frames", "1-3", "--frame", "1"}, "--frame");
    refuse({"render", scene, "-o", folder / "a.exr", "--frames", "1-3"}, "all frames would go to one file");
    refuse({"bake", scene, "-o", folder / "a.hair", "--frames", "1,3"}, "all frames would go to one file");
    refuse({"bake", scene, "-o", folder / "a.#.hair", "--frames", "1,3", "--colliders", folder / "c.obj"},
           "this would overwrite");
    refuse({"render", scene, "-o", folder / "a.exr", "--frame", "nan"}, "frame");
    refuse({"render", scene, "-o", folder / "a.exr", "--frame", "inf"}, "frame");
    refuse({"render", scene, "-o", folder / "a.exr", "--frame", "1e300"}, "frame");
    refuse({"render", scene, "-o", folder / "a.exr", "--frame", "x"}, "frame");
    refuse({"render", scene, "-o", folder / "a.exr", "--frame", ""}, "frame");
    for (const char* seconds : {"nan", "", "0", "-1", "inf"})
        refuse({"render", scene, "-o", folder / "a.exr", "--seconds", seconds}, "seconds");
    refuse({"render", scene, "-o", folder / "a.exr", "--size", "10"}, "this is no size");
    refuse({"render", scene, "-o", folder / "a.exr", "--size", "0x10"}, "film.size");
    refuse({"render", scene, "-o", folder / "a.exr", "--size", "10x"}, "this is no size");
    refuse({"render", scene, "-o", folder / "a.exr", "--spp", "0"}, "--spp");
    refuse({"render", scene, "-o", folder / "a.exr", "--threads", "0"}, "--threads");
    const std::string size = ": give a number of bytes, or one with K, M, G or T, such as 8G or 500M";
    for (const auto& [text, what] : std::vector<std::pair<std::string, std::string>>{
             {"0", "0: is less than 1M"},
             {"-1", "-1: is less than 1M"},
             {"1023K", "1023K: is less than 1M"},
             {"8Gb", "8Gb: is no size"}, // gigabits?
             {"8X", "8X: is no size"},
             {"8G8", "8G8: is no size"},
             {"8 G", "8 G: is no size"},
             {"G", "G: is no size"},
             {"0x10G", "0x10G: is no size"},
             {"1e30", "1e30: is no size"},
             {"nan", "nan: is no size"},
             {"inf", "inf: is no size"},
             {"", "\"\": is no size"},
             {"8\nG", "8?G: is no size"},
             {"99999999T", "99999999T: is more than any machine has"},
             {std::string(30, '9'), "9: is more than any machine has"},
             {std::string(400, '9'), "is no size"}}) {
        refuse({"render", scene, "-o", folder / "a.exr", "--memory", text}, what);
        refuse({"bake", scene, "-o", folder / "a.hair", "--memory", text}, size);
    }
    refuse({"view", scene, "--memory", "8X"}, "--memory 8X: is no size");
    refuse({"render", scene, "-o", folder / "a.exr", "--memory"}, "--memory");
    refuse({"measure", scene, "--memory", "8G"}, "--memory"); // has no such option
    refuse({"render", scene, "-o", folder / "a.exr", "--no-such-option"}, "--no-such-option");
    refuse({"render", folder / "none.toml", "-o", folder / "a.exr"}, "none.toml");
    refuse({"render", "-o", folder / "a.exr"}, "scene");
    refuse({"bake", scene, "-o", folder / "a.hair", "--frame", "nan"}, "frame");
    refuse({"compare", "a.exr", "b.exr"}, "a.exr: there is no such file");
    refuse({"measure", scene, "--out", scene}, "the folder for the report cannot be made");
    refuse({"info", ""}, "it is empty: leave it out to list everything");
    refuse({"no_such_command"}, "there is no command \"no_such_command\": known are ");
    refuse({"rendre"}, "there is no command \"rendre\": did you mean \"render\"?");
    refuse({"help", "rendre"}, "there is no command \"rendre\"");
    refuse({}, "subcommand");
}

} // namespace
} // namespace marram::testing
