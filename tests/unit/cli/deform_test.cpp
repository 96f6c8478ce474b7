// SPDX-License-Identifier: Apache-2.0
// A deforming mesh, from its files to blurred pixels, and strands that follow it.
#include "program.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

namespace marram::testing {
namespace {

// A square in the plane z = 0, of two triangles, that widens from 1 m at frame 1 to 3 m at frame 2.
void write_square(const Folder& folder, const std::string& name, double half_width, bool other = false) {
    folder.write(name, fmt::format("v -{0} 0 0\nv {0} 0 0\nv {0} 1 0\nv -{0} 1 0\n{1}", half_width,
                                   other ? "f 1 2 3\n" : "f 1 2 3 4\n"));
}

const std::string square =
    "[[mesh]]\nname = \"square\"\ntype = \"file\"\nfile = \"square.####.obj\"\nfile_frames = [1, 2]\n";
const std::string scene_text = "frames = [1, 2]\n[camera]\nposition = [0, 0.5, 4]\ntarget = [0, 0.5, 0]\n"
                               "[film]\nsize = [64, 32]\nsamples = 64\nmax_depth = 1\n[wind]\nspeed = 0\n"
                               "[[light]]\ntype = \"sky\"\n" +
                               square;
const std::string grass = "[[procedural]]\nname = \"grass\"\ntype = \"groom\"\non = \"square\"\ncount = "
                          "400\ncvs = 4\nlength = 0.05\nwidth = 0.002\n";

std::vector<float> alpha_of(const std::string& path) {
    const Image image = read_image(path);
    const auto at = size_t(std::ranges::find(image.channel_names, "A") - image.channel_names.begin());
    std::vector<float> alpha;
    for (size_t i = at; i < image.pixels.size(); i += size_t(image.channels))
        alpha.push_back(image.pixels[i]);
    return alpha;
}

} // namespace

TEST(Deform, IsBlurredAsTheMeanOfItsInstants) {
    const Folder folder;
    write_square(folder, "square.0001.obj", 0.5);
    write_square(folder, "square.0002.obj", 1.5);
    const std::string scene = folder.write("a.toml", scene_text);
    EXPECT_DONE(marram({"render", scene, "-o", folder / "blurred.exr", "--frame", "1", "--quiet", "--spp",
                        "256", "--set", "camera.shutter=[0, 1]", "--stats", folder / "s.json"}));
    const std::vector<float> blurred = alpha_of(folder / "blurred.exr");
    std::vector<double> mean(blurred.size());
    constexpr int instants = 16;
    for (int i = 0; i < instants; ++i) {
        EXPECT_DONE(marram({"render", scene, "-o", folder / "still.exr", "--quiet", "--frame",
                            fmt::format("{}", 1.0 + (i + 0.5) / instants)}));
        const std::vector<float> still = alpha_of(folder / "still.exr");
        for (size_t p = 0; p < mean.size(); ++p) mean[p] += double(still[p]) / instants;
    }
    double worst = 0.0, sum = 0.0, partly = 0.0;
    for (size_t p = 0; p < mean.size(); ++p) {
        worst = std::max(worst, std::abs(mean[p] - double(blurred[p])));
        sum += double(blurred[p]) - mean[p];
        partly += mean[p] > 0.1 && mean[p] < 0.9;
    }
    std::printf("blurred against %d instants: at most %.3f of a pixel, %.5f in the mean\n", instants, worst,
                sum / double(mean.size()));
    EXPECT_GT(partly, 100.0);
    EXPECT_LT(worst, 0.1);
    EXPECT_LT(std::abs(sum) / double(mean.size()), 1e-3);
    EXPECT_CONTAINS(read_file(folder / "s.json"), "\"keys\": 2");
}

// Implausible sides of a mesh are one line each, with count, place and remedy; strands then grow outwards.
TEST(Deform, SidesThatCannotBeMeantAreWarnings) {
    const Folder folder;
    const std::string corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n";
    folder.write("inwards.obj",
                 corners + "f 1 2 3 4\nf 8 7 6 5\nf 1 4 8 5\nf 6 7 3 2\nf 5 6 2 1\nf 4 3 7 8\n");
    folder.write("mixed.obj", corners + "f 1 2 3 4\nf 5 6 7 8\nf 5 8 4 1\nf 2 3 7 6\nf 1 2 6 5\nf 8 7 3 4\n");
    const auto scene = [&](const std::string& mesh) {
        return folder.write("a.toml",
                            "[camera]\nposition = [3, 3, 4]\ntarget = [0, 0, 0]\n[film]\nsize = [8, 8]\n"
                            "samples = 1\n[[light]]\ntype = \"sky\"\n[[mesh]]\nname = \"body\"\ntype = "
                            "\"file\"\nfile = \"" +
                                mesh +
                                "\n[[procedural]]\nname = \"fur\"\ntype = \"groom\"\non = "
                                "\"body\"\ncount = 200\nlength = 0.2\nwidth = 0.01\ncvs = 4\n");
    };
    const auto bake = [&](const std::string& mesh) {
        ProgramResult done = marram({"bake", scene(mesh), "-o", folder / "s.obj", "--quiet"});
        EXPECT_EQ(done.code, 0) << done.err;
        std::istringstream in(read_file(folder / "s.obj"));
        size_t outside = 0; // CVs
        double x = 0.0, y = 0.0, z = 0.0;
        for (std::string line; std::getline(in, line);)
            if (std::sscanf(line.c_str(), "v %lf %lf %lf", &x, &y, &z) == 3)
                outside += std::min({x, y, z}) < -0.01 || std::max({x, y, z}) > 1.01;
        return std::pair(done.err, outside);
    };
    const auto [inwards, none] = bake("inwards.obj\"");
    EXPECT_CONTAINS(inwards, "mesh \"body\" is inside out");
    EXPECT_CONTAINS(inwards, "flip = true");
    EXPECT_EQ(none, 0U);
    const auto [silent, all] = bake("inwards.obj\"\nflip = true");
    EXPECT_EQ(silent, "");
    EXPECT_GT(all, 400U);
    const auto [mixed, most] = bake("mixed.obj\"");
    EXPECT_CONTAINS(mixed, "2 of 12 triangles are wound against their neighbours");
    EXPECT_CONTAINS(mixed, "the first at (");
    EXPECT_EQ(lines(mixed).size(), 1U);
    EXPECT_GT(most, 400U);
    folder.write("named.obj", corners + "f 1//1 4//1 3//1 2//1\nf 5//2 6//2 7//2 8//2\n"); // and no vn
    const auto [named, grown] = bake("named.obj\"");
    EXPECT_CONTAINS(named,
                    folder / "named.obj:9:6: 2 faces refer to normals (vn) that the file does not have");
    EXPECT_EQ(lines(named).size(), 1U);
    EXPECT_CONTAINS(marram({"info", folder / "named.obj"}).out, "note: " + folder / "named.obj:9:6: 2 faces");
}

// Polygons that a later frame winds the other way, or that are concave in it, are those of the first frame.
TEST(Deform, TrianglesWoundBadlyInALaterFrameAreMended) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_text);
    const auto square_with = [](const std::string& faces) {
        return "v -0.5 0 0\nv 0.5 0 0\nv 0.5 1 0\nv -0.5 1 0\n" + faces;
    };
    folder.write("square.0001.obj", square_with("f 1 2 3\nf 1 3 4\n"));
    for (const char* faces :
         {"f 3 2 1\nf 1 3 4\n", "f 2 1 3\nf 4 1 3\n", "f 2 3 1\nf 3 4 1\n", "f 1 4 3 2\n"}) {
        folder.write("square.0002.obj", square_with(faces));
        EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--spp", "1"}));
    }
    folder.write("square.0001.obj", square_with("f 1 2 3 4\n"));
    folder.write("square.0002.obj",
                 "v -0.5 0 0\nv -0.2 0.6 0\nv 0.5 1 0\nv -0.5 1 0\nf 1 2 3 4\n"); // concave
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--spp", "1"}));
    folder.write("square.0002.obj", square_with("f 1 2 3\nf 1 2 4\n"));
    const ProgramResult other = marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--spp", "1"});
    EXPECT_EQ(other.code, 2);
    EXPECT_CONTAINS(other.err, "square.0002.obj: its triangles join other vertices than those of '");
}

TEST(Deform, CarriesItsStrands) {
    const Folder folder;
    write_square(folder, "square.0001.obj", 0.5);
    write_square(folder, "square.0002.obj", 1.5);
    const std::string scene = folder.write("a.toml", scene_text + grass);
    for (const auto& [frame, half] : {std::pair("1", 0.5), std::pair("1.5", 1.0), std::pair("2", 1.5)}) {
        EXPECT_DONE(marram(
            {"bake", scene, "-o", folder / "s.obj", "--frame", frame, "--colliders", folder / "c.obj"}));
        const auto farthest = [&](const char* file) { // of vertices on the plane
            std::istringstream in(read_file(folder / file));
            double most = 0.0;
            for (std::string line; std::getline(in, line);) {
                double x = 0.0, y = 0.0, z = 0.0;
                if (std::sscanf(line.c_str(), "v %lf %lf %lf", &x, &y, &z) == 3 && std::abs(z) < 1e-6)
                    most = std::max(most, std::abs(x));
            }
            return most;
        };
        EXPECT_NEAR(farthest("c.obj"), half, 1e-6) << frame;
        EXPECT_LE(farthest("s.obj"), half + 1e-6) << frame;
        EXPECT_GT(farthest("s.obj"), 0.98 * half) << frame;
    }
}

TEST(Deform, FilesThatDoNotFitAreRefused) {
    const Folder folder;
    write_square(folder, "square.0001.obj", 0.5);
    const std::string scene = folder.write("a.toml", scene_text);
    const auto said = [&](const std::string& of) {
        const ProgramResult done = marram({"render", of, "-o", folder / "a.exr", "--quiet"});
        EXPECT_EQ(done.code, 2);
        EXPECT_EQ(lines(done.err).size(), 1U) << done.err;
        return done.err;
    };
    EXPECT_CONTAINS(said(scene), "square.0002.obj: there is no such file");
    write_square(folder, "square.0002.obj", 1.5, true);
    EXPECT_CONTAINS(said(scene), "square.0002.obj: has 1 triangles");
    write_square(folder, "square.0002.obj", 1.5);
    const ProgramResult over =
        marram({"render", scene, "-o", folder / "a.exr", "--quiet", "--stats", folder / "square.0002.obj"});
    EXPECT_EQ(over.code, 2);
    EXPECT_CONTAINS(over.err, "this would overwrite");
    std::string one = scene_text;
    one.replace(one.find("####"), 4, "0001");
    EXPECT_CONTAINS(said(folder.write("b.toml", one)), "put a #### where the frame's number belongs");
}

} // namespace marram::testing
