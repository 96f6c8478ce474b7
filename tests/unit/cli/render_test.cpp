// SPDX-License-Identifier: Apache-2.0
// `marram render`: pictures depend only on scene and frame; their names, layers, metadata and statistics.
#include "program.h"

#include "core/math/frame_name.h"

#include <nlohmann/json.hpp>

#include <cmath>

namespace marram::testing {
namespace {

TEST(Render, GivesTheSamePictureEveryTime) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.film = "size = [24, 16]\nsamples = 4\nmotion_keys = 3\n"});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--frame", "7"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "b.exr", "--frame", "7"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "one.exr", "--frame", "7", "--threads", "1"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "two.exr", "--frame", "7", "--threads", "2"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "r.####.exr", "--frames", "5-7"}));
    for (const char* other : {"b.exr", "one.exr", "two.exr", "r.0007.exr"})
        EXPECT_TRUE(same_picture(folder / "a.exr", folder / other)) << other;
    EXPECT_FALSE(same_picture(folder / "a.exr", folder / "r.0006.exr"));
}

// The whole chain, on a mesh that moves and another in the way; strands that are made while rays are traced.
TEST(Render, GivesTheSamePictureOfLazyStrands) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml",
        SceneText{.film = "size = [48, 32]\nsamples = 17\nmax_depth = 4\ncurve_pieces = 0\naovs = [\"id\", "
                          "\"depth\"]\n",
                  .wind = "speed = 6\njiggle = { frequency = 3 }\ngusts = { num_gusts = 20 }\n",
                  .groom = "count = 6000\ncvs = 8\nlength = [0.3, 0.5]\nwidth = 0.01\n",
                  .more = "[[mesh]]\nname = \"stone\"\ntype = \"sphere\"\nradius = 0.3\ntransform = { keys = "
                          "[{ frame = 1, "
                          "translate = [-0.5, 0.2, 0] }, { frame = 9, translate = [0.5, 0.2, 0] }] }\n"});
    const std::vector<std::string> plain = {"render", scene, "--set", "camera.shutter=[-0.25, 0.25]",
                                            "--quiet"};
    const auto render = [&](const std::string& name, const std::vector<std::string>& more) {
        std::vector<std::string> all = plain;
        all.insert(all.end(), {"-o", folder / name});
        all.insert(all.end(), more.begin(), more.end());
        EXPECT_DONE(marram(all));
    };
    const std::string lazy = "film.geometry=lazy";
    render("e.####.exr", {"--frames", "6-7", "--stats", folder / "e.####.json"});
    render("l.####.exr", {"--frames", "6-7", "--set", lazy, "--stats", folder / "l.####.json"});
    render("one.exr", {"--frame", "7", "--set", lazy, "--threads", "1"});
    render("part.exr", {"--frame", "7", "--set", lazy, "--crop", "0,16,48,32"});
    render("part.exr", {"--frame", "7", "--set", lazy, "--crop", "0,0,48,16"});
    EXPECT_DONE(marram({"merge", "-o", folder / "merged.exr", folder / "part.exr.crop_0_0_48_16.state.tif",
                        folder / "part.exr.crop_0_16_48_32.state.tif"}));
    EXPECT_TRUE(same_picture(folder / "e.0006.exr", folder / "l.0006.exr"));
    for (const char* other : {"l.0007.exr", "one.exr", "merged.exr"})
        EXPECT_TRUE(same_picture(folder / "e.0007.exr", folder / other)) << other;
    const auto eager_stats = nlohmann::json::parse(read_file(folder / "e.0007.json")),
               lazy_stats = nlohmann::json::parse(read_file(folder / "l.0007.json"));
    EXPECT_FALSE(eager_stats.contains("lazy"));
    EXPECT_GE(int(lazy_stats["lazy"]["patches"]), 12);
    EXPECT_LE(int(lazy_stats["lazy"]["built"]), int(lazy_stats["lazy"]["patches"]));
    EXPECT_GT(int(lazy_stats["lazy"]["built"]), 0);
}

// Before the first pixel, and without a trace of it.
TEST(Render, IsRefusedWhereMemoryIsShort) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.film = "size = [48, 32]\nsamples = 1\n",
                                         .groom = "count = 300000\ncvs = 8\nlength = [0.1, 0.2]\nwidth = 0.01\n"});
    EXPECT_CONTAINS(marram({"info", scene}).out, "MB more while it is built");
    const std::vector<std::string> plain = {"render", scene, "-o", folder / "a.exr", "--memory"};
    const auto with = [&](std::vector<std::string> more) {
        more.insert(more.begin(), plain.begin(), plain.end());
        return marram(more);
    };
    const auto none = with({"1M"});
    EXPECT_EQ(none.code, 2);
    EXPECT_CONTAINS(none.err, "--memory: the frame needs more than ");
    EXPECT_CONTAINS(none.err, "for the picture and what is loaded, and the process may take 1M");
    const auto strands = with({"300M"});
    EXPECT_EQ(strands.code, 2);
    EXPECT_CONTAINS(strands.err, "for its strands, and the process may take 300M: allow more");
    EXPECT_FALSE(std::filesystem::exists(folder / "a.exr"));
    EXPECT_DONE(with({"2G", "--stats", folder / "a.json"}));
    const auto stats = nlohmann::json::parse(read_file(folder / "a.json"));
    EXPECT_EQ(uint64_t(stats["memory"]["budget_bytes"]), uint64_t(2) << 30);
    EXPECT_LE(uint64_t(stats["memory"]["peak_bytes"]), uint64_t(2) << 30);
}

TEST(Render, ShowsTheWindAndTheShutter) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "wind.exr"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "calm.exr", "--set", "wind.speed=0"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "blur.exr", "--set", "camera.shutter=[-0.5, 0.5]"}));
    EXPECT_FALSE(same_picture(folder / "wind.exr", folder / "calm.exr"));
    EXPECT_FALSE(same_picture(folder / "wind.exr", folder / "blur.exr"));
}

TEST(Render, NumbersFrames) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", SceneText{.globals = "frames = [-1, 2]\n", .film = "size = [4, 4]\nsamples = 1\n"});
    const ProgramResult all = marram({"render", scene, "-o", folder / "f.####.exr"});
    EXPECT_EQ(all.code, 0) << all.err;
    EXPECT_EQ(lines(all.out), (std::vector<std::string>{folder / "f.-0001.exr", folder / "f.0000.exr",
                                                        folder / "f.0001.exr", folder / "f.0002.exr"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "g_##_x.exr", "--frames", "8-12"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "h.####.exr", "--frame", "7.25"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "n.##.exr", "--frames", "-2--1"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "single.exr"}));
    EXPECT_EQ(folder.names(),
              (std::set<std::string>{"a.toml", "f.-0001.exr", "f.0000.exr", "f.0001.exr", "f.0002.exr",
                                     "g_08_x.exr", "g_09_x.exr", "g_10_x.exr", "g_11_x.exr", "g_12_x.exr",
                                     "h.0007.25.exr", "n.-02.exr", "n.-01.exr", "single.exr"}));
    EXPECT_EQ(read_metadata(folder / "single.exr", "marram:frame"), "-1");
}

TEST(Render, HoldsItsLayers) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.film = "size = [24, 16]\nsamples = 4\naovs = [\"depth\"]\n"});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--aov",
                        "albedo,normal,depth,strand_u,envelope,root_uv,id,root_normal", "--set",
                        "mesh.ground.transform={ rotate = [20, 0, 10] }"}));
    const Image image = read_image(folder / "a.exr");
    const std::set<std::string> names(image.channel_names.begin(), image.channel_names.end());
    for (const char* name : {"R", "G", "B", "A", "albedo.R", "albedo.G", "albedo.B", "normal.X", "normal.Y",
                             "normal.Z", "depth.Z", "strand_u.Y", "envelope.Y", "root_uv.U", "root_uv.V",
                             "id.Y", "root_normal.X", "root_normal.Y", "root_normal.Z"})
        EXPECT_TRUE(names.contains(name)) << name;
    EXPECT_EQ(names.size(), 19u);
    EXPECT_EQ(image.channel_names.size(), 19u);
    // No layer is zero everywhere.
    for (int c = 0; c < image.channels; ++c) {
        double sum = 0.0;
        for (size_t i = size_t(c); i < image.pixels.size(); i += size_t(image.channels))
            sum += std::abs(double(image.pixels[i]));
        EXPECT_GT(sum, 0.0) << image.channel_names[size_t(c)];
    }
}

TEST(Render, RefusesAnUnknownLayer) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    folder.write("a.exr", "old");
    for (const char* layers : {"no_such_layer", "depth,,normal", "depth,no_such_layer"}) {
        const ProgramResult outcome = marram({"render", scene, "-o", folder / "a.exr", "--aov", layers});
        EXPECT_EQ(outcome.code, 2) << layers;
        ASSERT_EQ(lines(outcome.err).size(), 1u) << outcome.err;
        EXPECT_CONTAINS(outcome.err, "layer");
        EXPECT_FALSE(outcome.err.starts_with(":")) << outcome.err;
    }
    EXPECT_EQ(read_file(folder / "a.exr"), "old");
    EXPECT_EQ(folder.names().size(), 2u);
}

TEST(Render, SaysWhatAPictureIs) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--frame", "2.5", "--spp", "3"}));
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:scene"), scene);
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:frame"), "2.5");
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:samples"), "3");
    for (const char* key : {"Software", "marram:seconds", "marram:version", "marram:digest"})
        EXPECT_TRUE(read_metadata(folder / "a.exr", key).has_value()) << key;
}

TEST(Render, WritesPng) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.png", "--size", "30x20", "--spp", "1"}));
    EXPECT_DONE(marram({"render", scene, "-o", folder / "bright.PNG", "--size", "30x20", "--spp", "1",
                        "--set", "film.exposure=1"}));
    EXPECT_TRUE(read_file(folder / "a.png").starts_with("\x89PNG"));
    const Image image = read_image(folder / "a.png"), bright = read_image(folder / "bright.PNG");
    EXPECT_EQ(image.width, 30);
    EXPECT_EQ(image.height, 20);
    EXPECT_EQ(image.channels, 3);
    double sum = 0.0, bright_sum = 0.0;
    for (const float p : image.pixels) sum += p;
    for (const float p : bright.pixels) bright_sum += p;
    EXPECT_GT(sum, 0.0);
    EXPECT_GT(bright_sum, sum);
}

TEST(Render, TakesSizeAndSamples) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--size", "10x6", "--spp", "5", "--stats",
                        folder / "a.json"}));
    const Image image = read_image(folder / "a.exr");
    EXPECT_EQ(image.width, 10);
    EXPECT_EQ(image.height, 6);
    EXPECT_EQ(read_metadata(folder / "a.exr", "marram:samples"), "5");
    const auto stats = nlohmann::json::parse(read_file(folder / "a.json"));
    EXPECT_GE(stats["rays"].get<uint64_t>(), 10u * 6u * 5u);
}

TEST(Render, SaysWhatAFrameCosts) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--stats", folder / "a.json", "--threads",
                        "2", "--frame", "3"}));
    const auto stats = nlohmann::json::parse(read_file(folder / "a.json"));
    for (const char* key : {"curves", "cvs", "segments", "triangles", "frame", "threads", "rays"})
        EXPECT_TRUE(stats[key].is_number()) << key;
    for (const char* key :
         {"load", "procedural_meshes", "colliders", "place_roots", "choose_settings", "choose_keys",
          "prepare_wind", "expand", "gusts", "shield", "bend", "jiggle", "collide", "bvh", "trace", "total"})
        EXPECT_TRUE(stats["seconds"][key].is_number() && stats["seconds"][key] >= 0.0) << key;
    for (const char* key : {"contacts", "pushed_out", "unresolved", "targets_not_raised", "dips", "reached"})
        EXPECT_TRUE(stats["collision"][key].is_number()) << key;
    for (const char* key : {"peak_bytes", "curve_bytes"})
        EXPECT_GT(stats["memory"][key].get<uint64_t>(), 0u) << key;
    EXPECT_EQ(stats["curves"], 300);
    EXPECT_EQ(stats["cvs"], 1500);
    EXPECT_EQ(stats["segments"], 1200);
    EXPECT_EQ(stats["triangles"], 2);
    EXPECT_EQ(stats["frame"], 3.0);
    EXPECT_EQ(stats["threads"], 2);
    EXPECT_DONE(marram(
        {"render", scene, "-o", folder / "a.##.exr", "--stats", folder / "b.json", "--frames", "3-4"}));
    const auto list = nlohmann::json::parse(read_file(folder / "b.json"));
    ASSERT_TRUE(list.is_array());
    ASSERT_EQ(list.size(), 2u);
    EXPECT_EQ(list[1]["frame"], 4.0);
}

// Motion of meshes and cameras is reported like that of strands, with a warning if no number of keys is
// enough.
TEST(Render, SaysHowWellMotionIsFollowed) {
    const Folder folder;
    double wheel = 0.0; // its motion keys
    const auto run = [&](double degrees, ProgramResult& done) {
        const std::string scene = folder.write(
            "a.toml",
            SceneText{.more = fmt::format(
                          "[[mesh]]\nname = \"wheel\"\ntype = \"box\"\nsize = [1, 1, 1]\ntransform.keys "
                          "= [{{frame = 0}}, {{frame = 10, rotate = [0, 0, {}]}}]\n",
                          degrees)});
        done = marram({"render", scene, "-o", folder / "a.exr", "--stats", folder / "a.json", "--quiet",
                       "--set", "camera.shutter=[-0.5, 0.5]", "--set", "tolerance=0.001", "--frame", "3",
                       "--set", "camera.transform={keys=[{frame=0}, {frame=10, rotate=[0, 300, 0]}]}"});
        EXPECT_EQ(done.code, 0) << done.err;
        const auto stats = nlohmann::json::parse(read_file(folder / "a.json"));
        wheel = stats["chosen"]["wheel.motion_keys"];
        return stats["motion"];
    };
    ProgramResult done;
    const auto slow = run(100.0, done);
    EXPECT_EQ(done.err, "");
    // A corner 0.707 m from the axis turns by 10 degrees. The error is the sagitta of one piece of its arc, a
    // quarter for half the angle.
    const double piece = 10.0 * 3.14159265358979323846 / 180.0 / (wheel - 1.0);
    EXPECT_NEAR(slow["mesh_error"].get<double>(), std::sqrt(0.5) * (1.0 - std::cos(0.5 * piece)), 1e-6);
    EXPECT_LE(slow["mesh_error"], 0.001);
    EXPECT_GT(slow["camera_poses"], 2);
    const auto fast = run(36000.0, done); // ten turns a frame
    EXPECT_EQ(fast["keys"], 64);
    EXPECT_GT(fast["mesh_error"], 0.01);
    EXPECT_CONTAINS(done.err, "'wheel' moves so fast that 64 motion keys are off by");
}

TEST(Render, SaysWhereATargetFarBehindMakesPixelsCoarse) {
    const Folder folder;
    const auto said = [&](const char* target) {
        const std::string scene =
            folder.write("a.toml", SceneText{.globals = "frames = [1, 10]\ntolerance_pixels = 0.5\n"});
        const ProgramResult done =
            marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--set", target});
        EXPECT_EQ(done.code, 0) << done.err;
        return done.err;
    };
    EXPECT_EQ(said("camera.target=[0, 0.2, 0]"), "");
    EXPECT_CONTAINS(said("camera.target=[0, -79, -396]"),
                    "a.toml:2:20: tolerance_pixels holds at camera.target, 408 m away");
}

TEST(Render, ResumesWhereAFrameIsMissing) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const auto render = [&](std::vector<std::string> more) {
        more.insert(more.begin(),
                    {"render", scene, "-o", folder / "f.#.exr", "--frames", "1-4", "--resume", "--quiet"});
        const ProgramResult outcome = marram(more);
        EXPECT_EQ(outcome.code, 0) << outcome.err;
        return lines(outcome.out);
    };
    const auto frame = [&](int n) { return folder / fmt::format("f.{}.exr", n); };
    EXPECT_EQ(render({}).size(), 4u);
    const auto time = fs::last_write_time(frame(1));
    const std::string whole = read_file(frame(3));
    EXPECT_TRUE(render({}).empty());
    fs::remove(frame(2));
    folder.write("f.3.exr", whole.substr(0, whole.size() / 2));
    folder.write("f.4.exr", "no picture");
    EXPECT_EQ(render({}), (std::vector<std::string>{frame(2), frame(3), frame(4)}));
    EXPECT_EQ(fs::last_write_time(frame(1)), time);
    EXPECT_TRUE(render({}).empty());
    EXPECT_EQ(render({"--set", "wind.speed=1"}).size(), 4u); // another picture
    EXPECT_EQ(render({"--spp", "1"}).size(), 4u);
    EXPECT_EQ(render({"--aov", "depth"}).size(), 4u);
    EXPECT_EQ(render({}).size(), 4u);
    folder.write("a.toml", SceneText{.wind = "speed = 3\n"});
    EXPECT_EQ(render({}).size(), 4u);
    EXPECT_TRUE(render({}).empty());
}

TEST(Render, ResumesWhereAMeshHasChanged) {
    const Folder folder;
    const std::string mesh = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n";
    folder.write("m.obj", mesh);
    const std::string scene = folder.write(
        "a.toml", SceneText{.more = "[[mesh]]\nname = \"rock\"\ntype = \"file\"\nfile = \"m.obj\"\n"});
    const std::vector<std::string> command = {"render", scene, "-o", folder / "a.exr", "--resume", "--quiet"};
    EXPECT_EQ(lines(marram(command).out).size(), 1u);
    EXPECT_EQ(lines(marram(command).out).size(), 0u);
    folder.write("m.obj", mesh + "v 5 5 5\n");
    EXPECT_EQ(lines(marram(command).out).size(), 1u);
}

// A mesh made by a foreign library, whose path is relative to the scene file, with grass on it.
TEST(Render, GrowsOnAForeignMesh) {
    const Folder folder;
    fs::create_directory(folder / "lib");
    fs::copy_file(MARRAM_BINARY_DIR "/libmesh_plugin.so", folder / "lib/libmesh_plugin.so");
    const std::string pyramid =
        "[[procedural]]\nname = \"tomb\"\ntype = \"pyramid\"\nheight = 1.5\nlibrary = ";
    const std::string hair = "[[procedural]]\nname = \"moss\"\ntype = \"groom\"\non = \"tomb\"\ncount = "
                             "200\nlength = 0.1\nwidth = 0.01\n";
    const ProgramResult bare = marram({"render", folder.write("bare.toml", SceneText{}), "-o",
                                       folder / "bare.exr", "--stats", folder / "bare.json"});
    EXPECT_EQ(bare.code, 0) << bare.err;
    int n = 0;
    for (const std::string& path :
         {std::string("lib/libmesh_plugin.so"), std::string("./lib/../lib/libmesh_plugin.so"),
          folder / "lib/libmesh_plugin.so"}) {
        const std::string scene =
            folder.write("a.toml", SceneText{.more = hair + pyramid + "\"" + path + "\"\n"});
        const std::string picture = folder / fmt::format("{}.exr", n++);
        const ProgramResult outcome = marram({"render", scene, "-o", picture, "--stats", folder / "a.json",
                                              "--allow-library", folder / "lib/libmesh_plugin.so"});
        ASSERT_EQ(outcome.code, 0) << path << ": " << outcome.err;
        EXPECT_CONTAINS(read_file(folder / "a.json"), "\"curves\": 500");
        EXPECT_CONTAINS(read_file(folder / "a.json"), "\"triangles\": 8");
        EXPECT_TRUE(same_picture(folder / "0.exr", picture)) << path;
        EXPECT_FALSE(same_picture(folder / "bare.exr", picture));
    }
}

TEST(Program, SaysWhatThereIs) {
    const ProgramResult info = marram({"info"});
    EXPECT_EQ(info.code, 0) << info.err;
    for (const char* word :
         {"groom", "density", "hair", "sun", "noise.frequency", "gusts.control[].shape",
          "gusts.control[] belongs to every table of a list: gusts.control = [{ ... }, ...]"})
        EXPECT_CONTAINS(info.out, word);
    EXPECT_EQ(marram({"--version"}).code, 0);
    EXPECT_EQ(marram({"--help"}).code, 0);
    EXPECT_EQ(marram({"render", "--help"}).code, 0);
    const Folder folder;
    const ProgramResult scene = marram({"info", folder.write("a.toml", SceneText{})});
    EXPECT_EQ(scene.code, 0) << scene.err;
    EXPECT_CONTAINS(scene.out, "300 curves of 5 CVs");
    EXPECT_CONTAINS(scene.out, " m around (0, ");
    const ProgramResult few = marram({"info", folder / "a.toml", "--set", "procedural.grass.count=7"});
    EXPECT_CONTAINS(few.out, "7 curves of 5 CVs");
    EXPECT_EQ(marram({"info", "groom", "--set", "wind.speed=1"}).code, 2);
    const ProgramResult bare =
        marram({"info", folder.write("bare.toml", "[camera]\nposition = [0, 1, 3]\ntarget = [0, 0, "
                                                  "0]\n[[curves]]\ntype = \"points\"\nname = \"c\"\n"
                                                  "points = [[0, 0, 0], [0, 1, 0]]\n")});
    EXPECT_EQ(bare.code, 0) << bare.err;
    EXPECT_EQ(bare.out.find("inf"), std::string::npos) << bare.out;
    for (const std::string& line : lines(marram({"info", "film"}).out)) EXPECT_LE(line.size(), 100U) << line;
    EXPECT_EQ(marram({"info", "no_such_thing"}).code, 2);
}

TEST(Program, DescribesFiles) {
    const Folder folder;
    folder.write("m.obj", "v 0 0 0\nv 2 0 0\nv 0 4 2\nf 1 2 3\n");
    folder.write("s.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n");
    folder.write("s.ply", "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                          "property float z\nproperty int strand_id\nend_header\n0 0 0 1\n0 1 0 1\n");
    const std::vector<float> depth = {1.0F, -2.5F, float(INFINITY), 4.0F};
    const Layer layer{"depth", {"Z"}, depth.data(), false};
    write_exr(folder / "p.exr", 2, 2, std::span(&layer, 1), std::vector<Metadata>{{"marram:frame", 3}});
    for (const auto& [file, what] :
         {std::pair(
              "m.obj",
              "mesh: 3 vertices, 1 triangles, no uvs, no normals\nbounds: 2 x 4 x 2 m around (1, 2, 1)\n"),
          {"s.obj",
           "strands: 1 polylines, 3 CVs in all, no widths\nbounds: 1 x 1 x 0 m around (0.5, 0.5, 0)\n"},
          {"s.ply", "strands: 1 polylines, 2 CVs in all"},
          {"p.exr", "picture: 2 x 2 pixels, 1 channel\nchannel depth.Z: -2.5 to 4, 1 not finite\n"}}) {
        const ProgramResult info = marram({"info", folder / file});
        EXPECT_EQ(info.code, 0) << info.err;
        EXPECT_CONTAINS(info.out, what);
    }
    EXPECT_CONTAINS(marram({"info", folder / "p.exr"}).out, "marram:frame: 3\n");
    EXPECT_EQ(marram({"info", folder / "none.obj"}).code, 2);
    folder.write("bad.obj", "v 0 0\n");
    EXPECT_CONTAINS(marram({"info", folder / "bad.obj"}).err, "bad.obj:1");
}

// Ids are discrete: the mean of two would be the id of a third strand.
TEST(Render, IdsAreNotAveraged) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--aov", "id", "--spp", "8"}));
    const Image image = read_image(folder / "a.exr");
    const auto channel = std::ranges::find(image.channel_names, "id.Y") - image.channel_names.begin();
    ASSERT_LT(size_t(channel), image.channel_names.size());
    int named = 0;
    for (size_t i = size_t(channel); i < image.pixels.size(); i += size_t(image.channels)) {
        EXPECT_EQ(image.pixels[i], std::floor(image.pixels[i]));
        named += image.pixels[i] > 0.0F;
    }
    EXPECT_GT(named, 10);
}

} // namespace
TEST(Render, NamesOfFilesTellEveryFrame) {
    EXPECT_EQ(numbered("a.####.exr", 1.0), "a.0001.exr");
    EXPECT_EQ(numbered("a.####.exr", -12.5), "a.-0012.5.exr");
    EXPECT_EQ(numbered("a.####.exr", 3.37), "a.0003.37.exr");
    EXPECT_EQ(numbered("a.####.exr", 1.00001), "a.0001.00001.exr");
    EXPECT_EQ(numbered("a.####.exr", 1000000.1), "a.1000000.1.exr");
    EXPECT_EQ(numbered("a.#.exr", 0.0), "a.0.exr");
    EXPECT_EQ(numbered("a.exr", 3.0), "a.exr");
    EXPECT_EQ(numbered("shot#3/a.##.exr", 7.0), "shot#3/a.07.exr"); // # of a folder's name stay
    EXPECT_EQ(numbered("/b##/shot#3/a.exr", 7.0), "/b##/shot#3/a.exr");
    EXPECT_FALSE(has_frame_mark("shot#3/a.exr"));
    EXPECT_TRUE(has_frame_mark("shot/a#.exr"));
}

// Lights that the camera does not see: RGB and alpha are 0 beside the strands, in PNG too; a shadow catcher
// adds alpha only.
TEST(Render, TransparentPictures) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText());
    std::string text = SceneText();
    text.insert(text.find("[[mesh]]"), "seen_by_camera = false\n");
    const std::string hidden_scene = folder.write("b.toml", text);
    const auto render = [&](const std::string& out, const std::string& file,
                            const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments = {"render", file, "-o", folder / out, "--quiet", "--spp", "16"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        EXPECT_DONE(marram(arguments));
        return read_image(folder / out);
    };
    EXPECT_EQ(render("seen.png", scene).channels, 3);
    const Image png = render("a.png", hidden_scene), whole = render("a.exr", hidden_scene),
                caught = render("c.exr", hidden_scene, {"--set", "mesh.ground.shadow_catcher=true"});
    EXPECT_EQ(png.channels, 4);
    const auto channel = [](const Image& image, const char* name, size_t pixel) {
        const auto c = std::ranges::find(image.channel_names, name) - image.channel_names.begin();
        return image.pixels[pixel * size_t(image.channels) + size_t(c)];
    };
    size_t clear = 0, full = 0, shadow = 0;
    for (size_t i = 0; i < 24 * 16; ++i) {
        const float alpha = channel(whole, "A", i), with = channel(caught, "A", i);
        const float green = channel(whole, "G", i);
        EXPECT_NEAR(channel(png, "A", i), alpha, 0.003F);
        EXPECT_TRUE(alpha > 0.0F || green == 0.0F);
        EXPECT_LE(with, alpha + 1e-5F);
        EXPECT_LE(channel(caught, "G", i), green + 0.05F);
        clear += alpha == 0.0F;
        full += alpha == 1.0F;
        shadow += with > 0.02F && with < alpha - 0.02F;
    }
    EXPECT_GT(clear, 50U);
    EXPECT_GT(full, 5U);
    EXPECT_GT(shadow, 20U);
}

// A run that time ends goes on with the sums of its shadow catchers.
TEST(Render, ShadowCatchersResume) {
    const Folder folder;
    std::string text = SceneText();
    text.insert(text.find("[[mesh]]"), "seen_by_camera = false\n");
    const std::string scene = folder.write("a.toml", text);
    const auto render = [&](const std::string& out, const std::vector<std::string>& more) {
        std::vector<std::string> arguments = {"render",     scene,   "-o",
                                              folder / out, "--set", "mesh.ground.shadow_catcher=true",
                                              "--quiet",    "--spp", "400"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        EXPECT_EQ(marram(arguments).code, 0);
    };
    render("a.exr", {"--seconds", "0.001"});
    ASSERT_TRUE(fs::exists(folder / "a.exr.state.tif"));
    render("a.exr", {"--resume"});
    render("b.exr", {});
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr"));
}

// Meshes that cannot catch a shadow.
TEST(Render, CatchersThatShineOrReflectNothingAreTold) {
    const Folder folder;
    const auto render = [&](const std::string& light, const std::string& material) {
        const std::string scene = folder.write(
            "a.toml",
            "[camera]\nposition = [0, 2, 4]\ntarget = [0, 0, 0]\n[film]\nsize = [8, 8]\nsamples = 1\n"
            "[[light]]\ntype = \"sun\"\nseen_by_camera = false\n" +
                light + material + "[[mesh]]\nname = \"ground\"\ntype = \"plane\"\nshadow_catcher = true\n" +
                (material.empty() ? "" : "material = \"m\"\n"));
        return marram({"render", scene, "-o", folder / "a.exr", "--quiet"});
    };
    const ProgramResult shines = render("[[light]]\ntype = \"mesh\"\nmesh = \"ground\"\n", "");
    EXPECT_EQ(shines.code, 2);
    EXPECT_CONTAINS(shines.err, "a.toml:12:");
    EXPECT_CONTAINS(shines.err,
                    "mesh \"ground\" is a light, but its shadow_catcher shows only shadows: use two "
                    "meshes, or leave its shadow_catcher out");
    const std::string material = "[[material]]\nname = \"m\"\n";
    for (const char* black : {"type = \"diffuse\"\ncolor = [0, 0, 0]\n",
                              "type = \"surface\"\ncolor = [0, 0, 0]\nspecular = 0\n"}) {
        const ProgramResult done = render("", material + black);
        EXPECT_EQ(done.code, 0);
        EXPECT_EQ(lines(done.err).size(), 1U) << done.err;
        EXPECT_CONTAINS(done.err, "'m' reflects nothing, so 'ground' catches no shadow: give it a color");
    }
    for (const char* grey : {"type = \"diffuse\"\n", "type = \"surface\"\ncolor = [0, 0, 0]\n"})
        EXPECT_EQ(render("", material + grey).err, "");
    EXPECT_EQ(render("", "").err, "");
}

} // namespace marram::testing
