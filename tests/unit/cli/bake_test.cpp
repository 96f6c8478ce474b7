// SPDX-License-Identifier: Apache-2.0
// `marram bake`: files that depend on scene and frame alone, and strands that keep their lengths in any wind.
#include "program.h"

#include "core/image/picture.h"

#include <algorithm>
#include <cmath>

namespace marram::testing {
namespace {

struct Hair {
    std::vector<uint32_t> sizes; // points a curve
    std::vector<std::array<float, 3>> points;
};

// Cem Yuksel's HAIR: a header of 128 bytes, then what its flags say: 1 segments of each strand, 2 points, 4
// thickness.
Hair read_hair(const std::string& path) {
    const std::string bytes = read_file(path);
    const auto word = [&](size_t at) {
        uint32_t value = 0;
        std::memcpy(&value, bytes.data() + at, 4);
        return value;
    };
    Hair hair;
    if (bytes.size() < 128 || !bytes.starts_with("HAIR")) {
        ADD_FAILURE() << path << " is no HAIR file";
        return hair;
    }
    const uint32_t strands = word(4), points = word(8), flags = word(12);
    size_t at = 128;
    hair.sizes.assign(strands, word(16) + 1);
    for (uint32_t i = 0; (flags & 1) && i < strands; ++i, at += 2) {
        uint16_t segments = 0;
        std::memcpy(&segments, bytes.data() + at, 2);
        hair.sizes[i] = segments + 1u;
    }
    hair.points.resize(points);
    EXPECT_TRUE(flags & 2);
    EXPECT_EQ(bytes.size(), at + size_t(points) * ((flags & 4) ? 16 : 12));
    std::memcpy(hair.points.data(), bytes.data() + at, size_t(points) * 12);
    return hair;
}

double length(const std::array<float, 3>& a, const std::array<float, 3>& b) {
    return std::hypot(double(b[0]) - a[0], double(b[1]) - a[1], double(b[2]) - a[2]);
}

// The worst segment: how far its length is off, as a share of what accuracy.md allows: 1e-5 of the length and
// two units in the last place of the largest coordinate.
double worst_length(const Hair& bent, const Hair& rest) {
    double worst = 0.0;
    size_t first = 0;
    for (const uint32_t size : rest.sizes) {
        for (size_t i = first; i + 1 < first + size; ++i) {
            float largest = 0.0F;
            for (const Hair* hair : {&bent, &rest})
                for (const size_t k : {i, i + 1})
                    for (const float x : hair->points[k]) largest = std::max(largest, std::abs(x));
            const double ulp = double(std::nextafter(largest, INFINITY)) - double(largest);
            const double a = length(bent.points[i], bent.points[i + 1]),
                         b = length(rest.points[i], rest.points[i + 1]);
            worst = std::max(worst, std::abs(a - b) / (1e-5 * b + 2.0 * ulp));
        }
        first += size;
    }
    return worst;
}

void bake(const std::string& scene, const std::string& output, std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"bake", scene, "-o", output});
    EXPECT_DONE(marram(more));
}

TEST(Bake, GivesTheSameBytesOnAnyThreads) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.groom = "count = 3000\nlength = [0.1, 0.3]\nwidth = 0.01\n"});
    for (const char* extension : {"hair", "usda", "obj"}) {
        const std::string one = folder / fmt::format("one.{}", extension),
                          two = folder / fmt::format("two.{}", extension);
        bake(scene, one, {"--threads", "1", "--frame", "3"});
        bake(scene, two, {"--threads", "2", "--frame", "3"});
        EXPECT_GT(read_file(one).size(), 3000u * 8u * 3u);
        EXPECT_TRUE(read_file(one) == read_file(two)) << extension;
    }
}

TEST(Bake, StopsAtAStage) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    for (const char* stage : {"rest", "bent", "final"})
        bake(scene, folder / (std::string(stage) + ".hair"), {"--stage", stage});
    EXPECT_NE(read_file(folder / "rest.hair"), read_file(folder / "bent.hair"));
    EXPECT_EQ(read_file(folder / "bent.hair"), read_file(folder / "final.hair"));
    bake(scene, folder / "frame.hair", {"--frame", "1"});
    EXPECT_EQ(read_file(folder / "frame.hair"), read_file(folder / "final.hair")); // the scene's first frame
    const ProgramResult outcome = marram({"bake", scene, "-o", folder / "x.hair", "--stage", "blown"});
    EXPECT_EQ(outcome.code, 2);
    EXPECT_FALSE(fs::exists(folder / "x.hair"));
}

TEST(Bake, WritesColliders) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.more = "[[mesh]]\nname = \"rock\"\ntype = \"box\"\n"});
    bake(scene, folder / "a.hair", {"--colliders", folder / "c.obj"});
    const std::string text = read_file(folder / "c.obj");
    size_t vertices = 0, faces = 0;
    for (const std::string& line : lines(text)) {
        vertices += line.starts_with("v ");
        faces += line.starts_with("f ");
    }
    EXPECT_GE(vertices, 4u + 8u);
    EXPECT_EQ(faces, 2u + 12u);
    EXPECT_CONTAINS(text, "ground");
    EXPECT_CONTAINS(text, "rock");
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.hair", "a.toml", "c.obj"}));
}

struct Case {
    int cvs, count;
};

void PrintTo(const Case& given, std::ostream* out) { *out << given.cvs << " CVs"; }

class StrandSize : public ::testing::TestWithParam<Case> {};
TEST_P(StrandSize, KeepsLengthsInAnyWind) {
    const auto [cvs, count] = GetParam();
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml",
        SceneText{.wind = "global_rotate = 1\nramp_rotate = [[0, 1], [1, 1]]\nnoise = { amplitude = 1e3, "
                          "frequency = 3, octaves = 3 }\n",
                  .groom = fmt::format("count = {}\ncvs = {}\nlength = [0.1, 0.6]\nwidth = 0.01\narc = 90\n",
                                       count, cvs)});
    bake(scene, folder / "rest.hair", {"--stage", "rest"});
    const Hair rest = read_hair(folder / "rest.hair");
    ASSERT_EQ(rest.sizes, std::vector<uint32_t>(size_t(count), uint32_t(cvs)));
    double worst = 0.0;
    for (const char* speed : {"0.5", "10", "1e4"}) {
        bake(scene, folder / "bent.hair",
             {"--stage", "bent", "--frame", "5.5", "--set", std::string("wind.speed=") + speed});
        const Hair bent = read_hair(folder / "bent.hair");
        ASSERT_EQ(bent.sizes, rest.sizes);
        EXPECT_NE(read_file(folder / "bent.hair"), read_file(folder / "rest.hair")) << speed;
        for (const auto& point : bent.points)
            for (const float x : point) ASSERT_TRUE(std::isfinite(x));
        worst = std::max(worst, worst_length(bent, rest));
    }
    EXPECT_LT(worst, 1.0);
    fmt::print("{} CVs: worst length at {:.2f} of what is allowed\n", cvs, worst);
    bake(scene, folder / "still.hair", {"--stage", "bent", "--set", "wind.speed=0"});
    EXPECT_TRUE(read_file(folder / "still.hair") == read_file(folder / "rest.hair"));
}
INSTANTIATE_TEST_SUITE_P(All, StrandSize,
                         ::testing::Values(Case{2, 2000}, Case{3, 2000}, Case{8, 2000}, Case{1000, 40}),
                         [](const auto& info) { return fmt::format("{}_cvs", info.param.cvs); });

// A terrain's grids by name; and the heights, read back as a layer, are the same.
TEST(Bake, WritesATerrainThatReadsBack) {
    const Folder folder;
    const std::string head =
        "[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[[light]]\ntype = \"sky\"\n"
        "[[procedural]]\ntype = \"terrain\"\nname = \"desert\"\nsize = [30, 20]\n"
        "center = [3, -2]\ncell = 0.5\n[[procedural.layer]]\n";
    const std::string scene = folder.write(
        "a.toml",
        head + "type = \"noise\"\namplitude = 2\nwavelength = 9\n[[procedural.layer]]\ntype = \"flat\"\n"
               "target = \"sand\"\nheight = 0.25\n[[procedural.layer]]\ntype = \"mask\"\nname = \"Low\"\n"
               "by = \"height\"\n");
    bake(scene, folder / "a.exr", {});
    const Picture grids = read_picture(folder / "a.exr");
    EXPECT_EQ(grids.width, 61);
    EXPECT_EQ(grids.height, 41);
    std::set<std::string> names;
    for (const Picture::Layer& layer : grids.layers)
        for (const std::string& channel : layer.channels) names.insert(layer.name + "." + channel);
    std::string all;
    for (const std::string& n : names) all += n + " ";
    for (const char* name : {"grid.height", "grid.bedrock", "grid.sand", "grid.Low"})
        EXPECT_TRUE(names.contains(name)) << name << " in " << all;
    const std::string back = folder.write(
        "b.toml", head + "type = \"image\"\nfile = \"a.exr\"\nsize = [30.5, 20.5]\ncenter = [3, -2]\n");
    bake(back, folder / "b.exr", {});
    const Picture again = read_picture(folder / "b.exr");
    const auto heights = [](const Picture& picture) {
        std::vector<float> values;
        for (const Picture::Layer& layer : picture.layers)
            for (size_t c = 0; c < layer.channels.size(); ++c)
                if (layer.name + "." + layer.channels[c] == "grid.height")
                    for (size_t k = c; k < layer.pixels.size(); k += layer.channels.size())
                        values.push_back(layer.pixels[k]);
        return values;
    };
    const std::vector<float> first = heights(grids), second = heights(again);
    ASSERT_EQ(first.size(), 61u * 41u);
    ASSERT_EQ(second.size(), first.size());
    for (size_t k = 0; k < first.size(); ++k) ASSERT_NEAR(first[k], second[k], 1e-6);
    const std::string plain = folder.write("c.toml", SceneText{});
    EXPECT_EQ(marram({"bake", plain, "-o", folder / "c.exr"}).code, 2) << "no terrain";
    EXPECT_FALSE(folder.names().contains("c.exr"));
}

TEST(Bake, RefusesWhatItCannotWrite) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    for (const std::vector<std::string>& more :
         {std::vector<std::string>{"-o", folder / "a.abc"},
          {"-o", folder / "a"},
          {"-o", folder / "a.hair", "--colliders", folder / "c.ply"},
          {"-o", folder / "no/a.hair"},
          {"-o", folder / "a.hair", "--colliders", folder / "no/c.obj"},
          {"-o", folder / "a.hair", "--stats", folder / "no/s.json"}}) {
        std::vector<std::string> command = {"bake", scene};
        command.insert(command.end(), more.begin(), more.end());
        const ProgramResult outcome = marram(command);
        EXPECT_EQ(outcome.code, 2) << more[1];
        EXPECT_EQ(lines(outcome.err).size(), 1u) << outcome.err;
    }
    EXPECT_EQ(folder.names(), std::set<std::string>{"a.toml"});
}

} // namespace
} // namespace marram::testing
