// SPDX-License-Identifier: Apache-2.0
// `marram bake`: files depend only on scene and frame, and strands keep their lengths in any wind.
#include "program.h"

#include "core/image/picture.h"
#include "core/read/strand_file.h"
#include "core/shot/height_sequence.h"
#include "tests/whole.h"

#include <algorithm>
#include <cmath>

namespace marram::testing {
namespace {

struct Hair {
    std::vector<uint32_t> sizes; // points per curve
    std::vector<std::array<float, 3>> points;
};

// Cem Yuksel's HAIR: a header of 128 bytes, then the arrays that its flags select: 1 segments of each strand,
// 2 points, 4 thickness.
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

// The worst error of a segment's length, relative to what accuracy.md allows: 1e-5 of the length and two
// units in the last place of the largest coordinate.
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
        SceneText{.wind = "speed = 1\nresponse = [[0, 0], [10, 1], [1e5, 1]]\nglobal_rotate = 1\nramp_rotate "
                          "= [[0, 1], [1, 1]]\nnoise = { amplitude = 1e3, "
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

// A terrain's grids are written by name, and its heights, read back as a layer, are the same.
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

// The heights in an EXR.
std::vector<float> heights_of(const std::string& exr) {
    std::vector<float> values;
    for (const Picture::Layer& layer : read_picture(exr).layers)
        for (size_t c = 0; c < layer.channels.size(); ++c)
            if (layer.name + "." + layer.channels[c] == "grid.height")
                for (size_t k = c; k < layer.pixels.size(); k += layer.channels.size())
                    values.push_back(layer.pixels[k]);
    return values;
}

std::string terrain_scene(const std::string& layers) {
    return "[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[[light]]\ntype = \"sky\"\n"
           "[[procedural]]\ntype = \"terrain\"\nname = \"desert\"\nsize = [31, 20]\ncenter = [3.3, "
           "-2.1]\ncell = 0.1\n" +
           layers;
}

const std::string hills =
    "[[procedural.layer]]\ntype = \"noise\"\namplitude = 20\nwavelength = 9\noffset = 300\n"
    "[[procedural.layer]]\ntype = \"mask\"\nname = \"x\"\nby = \"slope\"\n";

// Baked heights can be a base again without settings for their place: EXR and TIFF to the bit, PNG to half of
// one of its steps.
TEST(Bake, HeightsReadBackWhereTheyWere) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", terrain_scene(hills));
    bake(scene, folder / "a.exr");
    const std::vector<float> before = heights_of(folder / "a.exr");
    ASSERT_EQ(before.size(), 311u * 201u);
    const auto [low, high] = std::ranges::minmax(before);
    for (const char* extension : {"exr", "tif", "tiff", "png"}) {
        const std::string image = folder / fmt::format("heights.{}", extension);
        bake(scene, image, {"--threads", "1"});
        const std::string back = folder.write(
            "b.toml", terrain_scene("[[procedural.layer]]\ntype = \"image\"\nfile = \"" + image + "\"\n"));
        bake(back, folder / "b.exr");
        const std::vector<float> after = heights_of(folder / "b.exr");
        ASSERT_EQ(after.size(), before.size());
        // Half a step, two roundings of a height to a float, and one of a pixel.
        const double bound =
            std::string(extension) != "png"
                ? 0.0
                : (0.5 / 65535.0 + 0x1p-24) * (double(high) - double(low)) + 0x1p-23 * double(high);
        double worst = 0.0;
        for (size_t k = 0; k < before.size(); ++k)
            worst = std::max(worst, std::abs(double(after[k]) - double(before[k])));
        EXPECT_LE(worst, bound) << extension;
        if (bound > 0.0) {
            EXPECT_GT(worst, 0.25 / 65535.0 * (double(high) - double(low))) << "the bound is close";
        }
    }
    const Image tiff = read_image(folder / "heights.tif", ColorSpace::linear_data);
    EXPECT_EQ(tiff.channels, 1);
    EXPECT_EQ(tiff.pixels, before);
    const Image png = read_image(folder / "heights.png", ColorSpace::linear_data);
    EXPECT_EQ(std::ranges::minmax(png.pixels).min, 0.0F);
    EXPECT_EQ(std::ranges::minmax(png.pixels).max, 1.0F);
    EXPECT_EQ(read_metadata(folder / "heights.png", "marram:range_low"), fmt::format("{}", double(low)));
    EXPECT_EQ(read_metadata(folder / "heights.png", "marram:cell"), "0.1");
}

// Each setting of the scene overrides the file's metadata.
TEST(Bake, ASceneMovesBakedHeights) {
    const Folder folder;
    bake(folder.write("a.toml", terrain_scene(hills)), folder / "a.png");
    const auto heights = [&](const std::string& more) {
        const std::string scene = folder.write(
            "b.toml", terrain_scene("[[procedural.layer]]\ntype = \"image\"\nfile = \"a.png\"\n" + more));
        bake(scene, folder / "b.exr");
        return heights_of(folder / "b.exr");
    };
    const std::vector<float> from_file = heights(""), scaled = heights("range = [0, 1]"),
                             moved = heights("center = [4.3, -2.1]"), small = heights("size = [10, 10]");
    EXPECT_EQ(std::ranges::minmax(scaled).max, 1.0F);
    EXPECT_EQ(moved[100 * 311 + 110], from_file[100 * 311 + 100]) << "ten cells along x";
    EXPECT_EQ(small[0], 0.0F) << "outside";
    EXPECT_GT(small[100 * 311 + 155], 200.0F) << "the file's centre and range";
    // A terrain elsewhere reads the file at the place where it was baked.
    const std::string other = folder.write(
        "c.toml",
        "[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[[light]]\ntype = \"sky\"\n[[procedural]]\n"
        "type = \"terrain\"\nname = \"desert\"\nsize = [2, 2]\ncenter = [3.3, -2.1]\ncell = 0.1\n"
        "[[procedural.layer]]\ntype = \"image\"\nfile = \"a.png\"\n");
    bake(other, folder / "c.exr");
    const std::vector<float> part = heights_of(folder / "c.exr");
    ASSERT_EQ(part.size(), 21u * 21u);
    EXPECT_EQ(part[10 * 21 + 10], from_file[100 * 311 + 155]);
}

TEST(Bake, RefusesMetadataThatCannotBe) {
    const Folder folder;
    const std::vector<float> pixels(4, 1.0F);
    const Layer layers[] = {{"", {"Y"}, pixels.data(), false}};
    const std::string scene =
        folder.write("a.toml", terrain_scene("[[procedural.layer]]\ntype = \"image\"\nfile = \"a.exr\"\n"));
    const auto outcome = [&](const std::vector<Metadata>& metadata) {
        write_exr(folder / "a.exr", 2, 2, layers, metadata);
        return marram({"bake", scene, "-o", folder / "b.exr"});
    };
    EXPECT_CONTAINS(outcome({{"marram:size_x", 5.0}}).err,
                    "its metadata have one of marram:size_x and marram:size_z");
    for (const auto& [size, what] : {std::pair(0.0, "marram:size_z 0"),
                                     {-1.0, "marram:size_z -1"},
                                     {double(INFINITY), "marram:size_z inf"},
                                     {double(NAN), "marram:size_z"},
                                     {1e9, "size or center is out of range"}}) {
        const ProgramResult result = outcome({{"marram:size_x", 5.0}, {"marram:size_z", size}});
        EXPECT_EQ(result.code, 2);
        EXPECT_EQ(lines(result.err).size(), 1u) << result.err;
        EXPECT_CONTAINS(result.err, what);
    }
    EXPECT_EQ(outcome({{"marram:range_low", std::string("low")}, {"marram:range_high", 1.0}}).code, 2);
}

// The bytes depend only on the scene, not on time or threads.
TEST(Bake, TerrainFilesAreTheSameBytes) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", terrain_scene(hills));
    std::map<std::string, std::string> first;
    const auto name = [&](const std::string& extension) { return folder / ("t." + extension); };
    const std::vector<std::string> extensions = {"exr", "tif", "png", "obj", "ply"};
    for (const std::string& extension : extensions) {
        bake(scene, name(extension), {"--threads", "1"});
        first[extension] = read_file(name(extension));
    }
    ::sleep(1); // so that any stored time of day differs
    for (const std::string& extension : extensions) {
        bake(scene, name(extension), {"--threads", "2"});
        EXPECT_TRUE(read_file(name(extension)) == first[extension]) << extension;
    }
}

// The growth surface as a mesh: its vertices are the samples. A scene with strands writes these as .obj.
TEST(Bake, WritesATerrainsSurface) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", terrain_scene(hills));
    bake(scene, folder / "a.exr");
    const std::vector<float> heights = heights_of(folder / "a.exr");
    for (const char* extension : {"obj", "ply"}) {
        bake(scene, folder / fmt::format("a.{}", extension));
        const std::string grown = folder.write(
            "b.toml",
            fmt::format("[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[[light]]\ntype = \"sky\"\n"
                        "[[mesh]]\ntype = \"file\"\nname = \"m\"\nfile = \"a.{}\"\n",
                        extension));
        const ProgramResult info = marram({"info", grown});
        EXPECT_CONTAINS(info.out,
                        fmt::format("mesh m: {} vertices, {} triangles\n", heights.size(), 2 * 310 * 200));
    }
    const std::string ply = read_file(folder / "a.ply");
    const std::string head = ply.substr(0, ply.find("end_header\n"));
    EXPECT_CONTAINS(
        head,
        "property float nz\nproperty float s\nproperty float t\nproperty float sand\nproperty float slope\n"
        "property float x_1\nelement face");
    float first[11];
    std::memcpy(first, ply.data() + head.size() + std::strlen("end_header\n"), sizeof first);
    EXPECT_EQ(first[0], float(3.3 - 15.5));
    EXPECT_EQ(first[1], heights[0]);
    EXPECT_EQ(first[6], 0.0F);
    EXPECT_EQ(first[7], 1.0F);
    EXPECT_CONTAINS(read_file(folder / "a.obj"), "\no desert\n");
    const std::string furred = folder.write(
        "c.toml", terrain_scene(hills) +
                      "[[procedural]]\ntype = \"groom\"\nname = \"grass\"\non = \"desert\"\ncount = 5\n"
                      "length = 0.2\nwidth = 0.01\n");
    const ProgramResult strands = marram({"bake", furred, "-o", folder / "c.obj"});
    EXPECT_CONTAINS(read_file(folder / "c.obj"), "\nl 1 2");
    EXPECT_CONTAINS(strands.err,
                    "c.obj: has the strands, not the surface of 'desert': choose with --what terrain or");
    const ProgramResult chosen = marram({"bake", furred, "-o", folder / "c.obj", "--what", "terrain"});
    EXPECT_EQ(chosen.err.find("--what"), std::string::npos) << chosen.err;
    EXPECT_TRUE(read_file(folder / "c.obj") == read_file(folder / "a.obj"));
    for (const auto& [option, file] : {std::pair("--what=terrain", "e.hair"),
                                       {"--what=strands", "e.exr"},
                                       {"--range=0,1", "e.tif"},
                                       {"--range=1,0", "e.png"},
                                       {"--range=1", "e.png"}})
        EXPECT_EQ(marram({"bake", furred, "-o", folder / file, option}).code, 2) << option;
    bake(furred, folder / "c.ply", {"--what", "terrain"});
    EXPECT_TRUE(read_file(folder / "c.ply") == ply);
    EXPECT_EQ(marram({"bake", furred, "-o", folder / "e.ply", "--attributes", "root_uv"}).code, 2);
    EXPECT_FALSE(folder.names().contains("e.ply"));
    const std::string bare =
        folder.write("d.toml", "[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[[mesh]]\n"
                               "type = \"plane\"\nname = \"m\"\n");
    for (const char* output : {"d.obj", "d.ply", "d.png", "d.tif"}) {
        EXPECT_EQ(marram({"bake", bare, "-o", folder / output}).code, 2) << output;
        EXPECT_FALSE(folder.names().contains(output));
    }
}

// Heights of all frames have one range, or that of --range.
TEST(Bake, HeightsOfASequenceHaveOneRange) {
    const Folder folder;
    const std::string scene = folder.write(
        "a.toml", "[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[wind]\ndirection = [1, 0, 0]\nspeed "
                  "= 12\n[[light]]\ntype = \"sky\"\n"
                  "[[procedural]]\ntype = \"terrain\"\nname = \"desert\"\nsize = [20, 8]\ncell = 1\n"
                  "[[procedural.layer]]\ntype = \"noise\"\ntarget = \"sand\"\namplitude = 2\noffset = 2\n"
                  "wavelength = 10\n[[procedural.layer]]\ntype = \"dune_solver\"\ndays_per_frame = 2\n");
    const auto range_of = [&](const std::string& name, const char* end) {
        return read_metadata(folder / name, fmt::format("marram:range_{}", end)).value_or("none");
    };
    bake(scene, folder / "one.####.png", {"--frame", "3"});
    bake(scene, folder / "all.####.png", {"--frames", "1,3"});
    bake(scene, folder / "set.####.png", {"--frames", "1,3", "--range", "-5,12.5"});
    for (const char* end : {"low", "high"})
        EXPECT_EQ(range_of("all.0001.png", end), range_of("all.0003.png", end)) << end;
    EXPECT_NE(range_of("one.0003.png", "high"), range_of("all.0003.png", "high"));
    const std::string range = range_of("all.0001.png", "low") + "," + range_of("all.0001.png", "high");
    bake(scene, folder / "same.####.png", {"--frames", "1,3", "--range", range});
    for (const char* frame : {"0001.png", "0003.png"})
        EXPECT_TRUE(read_file(folder / "all." + frame) == read_file(folder / "same." + frame)) << range;
    EXPECT_EQ(range_of("set.0003.png", "low"), "-5");
    EXPECT_EQ(range_of("set.0001.png", "high"), "12.5");
    const ProgramResult clamped = marram({"bake", scene, "-o", folder / "low.png", "--range", "0,1"});
    EXPECT_CONTAINS(clamped.err, "heights are outside the range and are clamped, they are ");
    EXPECT_CONTAINS(clamped.err, " m: give --range 0,");
}

// Heights are kept within the budget, with the range of all frames.
TEST(Bake, HeightsWaitForTheRangeOfAllFrames) {
    const auto world_of = [](float low, float high) {
        MeshGeometry mesh;
        mesh.name = "desert";
        mesh.grids.resize(2);
        mesh.grids[0].values = {low, high, low, low};
        mesh.grids[1].values = {-99.0F, 99.0F};
        World world;
        world.meshes = {mesh};
        return world;
    };
    HeightSequence heights(2 * 4 * sizeof(float));
    heights.add(world_of(1.0F, 3.0F), "a.png");
    EXPECT_EQ(heights.range(), Vec2d(1.0, 3.0));
    heights.add(world_of(-2.0F, 0.0F), "a.png");
    heights.add(world_of(0.0F, 5.0F), "a.png");
    EXPECT_EQ(heights.range(), Vec2d(-2.0, 5.0));
    for (size_t i = 0; i < 3; ++i) {
        const std::optional<World> kept = heights.take(i);
        ASSERT_EQ(kept.has_value(), i < 2) << "the last is beyond the budget";
        if (!kept) continue;
        const std::vector<GridValues>& grids = kept->meshes.at(0).grids;
        ASSERT_EQ(grids.size(), 1U) << "only heights";
        EXPECT_EQ(grids[0].values[0], i == 0 ? 1.0F : -2.0F);
        EXPECT_FALSE(heights.take(i).has_value()) << "forgotten";
    }
    EXPECT_THROW(heights.add(World(), "a.png"), InputError);
}

// A dune along a file's curve equals one along the same points in the scene.
TEST(Bake, DunesFollowCurvesOfFiles) {
    const Folder folder;
    folder.write(
        "a.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n-8 0 -3\n2 0 2\n12 0 -4\n");
    folder.write(
        "a.usda",
        "#usda 1.0\n(metersPerUnit = 1)\ndef BasisCurves \"c\" { int[] curveVertexCounts = [3]\n"
        "uniform token type = \"linear\"\npoint3f[] points = [(-8, 0, -3), (2, 0, 2), (12, 0, -4)] }\n");
    folder.write("a.obj", "v -8 0 -3\nv 2 0 2\nv 12 0 -4\nl 1 2 3\n");
    const std::string dune = "[[procedural.layer]]\ntype = \"dune\"\nalong = \"crest\"\nslope_width = 5\n";
    const auto heights = [&](const std::string& curves) {
        bake(folder.write("a.toml", terrain_scene(dune) + "[[curves]]\nname = \"crest\"\n" + curves),
             folder / "a.exr");
        return heights_of(folder / "a.exr");
    };
    const std::vector<float> drawn =
        heights("type = \"points\"\npoints = [[-8, 0, -3], [2, 0, 2], [12, 0, -4]]\n");
    EXPECT_GT(std::ranges::minmax(drawn).max, 2.0F);
    for (const char* file : {"a.ply", "a.usda", "a.obj"})
        EXPECT_TRUE(heights(fmt::format("type = \"file\"\nfile = \"{}\"\n", file)) == drawn) << file;
}

const std::string tuft =
    "frames = [1, 4]\n[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[wind]\nspeed = 5\n"
    "direction = [1, 0, 0]\n[[light]]\ntype = \"sky\"\n[[mesh]]\nname = \"m\"\ntype = \"plane\"\n"
    "size = [1, 1]\n[[procedural]]\ntype = \"groom\"\nname = \"grass\"\non = \"m\"\ncount = 20\n"
    "length = 0.3\nwidth = 0.01\ncvs = 5\n";

// A range of frames in one .usda equals the single frames in any format, and is read back to the bit.
TEST(Bake, ARangeOfFramesComesBack) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", tuft);
    bake(scene, folder / "all.usda", {"--frames", "3,1-2", "--attributes", "root_uv"});
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.toml", "all.usda"}));
    for (const char* extension : {"hair", "ply", "usda", "obj"})
        bake(scene, folder / fmt::format("f.##.{}", extension), {"--frames", "1-3"});
    const StrandFile all = load_strand_file(folder / "all.usda", {24.0});
    ASSERT_EQ(all.samples.size(), 3u);
    ASSERT_TRUE(find_attribute(all.attributes, "root_uv"));
    ASSERT_TRUE(find_attribute(all.attributes, "id")->discrete);
    EXPECT_NE(all.samples[0].points, all.samples[1].points);
    for (size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(all.samples[i].frame, double(i + 1));
        for (const char* extension : {"hair", "ply", "usda", "obj"}) {
            const StrandFile one =
                load_strand_file(folder / fmt::format("f.{:02}.{}", i + 1, extension), {24.0});
            EXPECT_EQ(one.counts, all.counts) << extension;
            EXPECT_EQ(one.samples.at(0).points, all.samples[i].points) << extension;
            if (std::string(extension) != "obj") {
                EXPECT_EQ(one.samples[0].widths, all.samples[i].widths) << extension;
            }
        }
    }
    EXPECT_EQ(marram({"bake", scene, "-o", folder / "x.ply", "--frames", "1-2"}).code, 2);
    EXPECT_EQ(
        marram({"bake", scene, "-o", folder / "x.usda", "--frames", "1-2", "--colliders", folder / "c.obj"})
            .code,
        2);
    EXPECT_FALSE(folder.names().contains("x.usda"));
}

// Scenes read strand files: an animated one, and one per frame. Unsupported content is reported once.
TEST(Bake, ScenesReadStrands) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", tuft);
    bake(scene, folder / "all.usda", {"--frames", "1-3"});
    bake(scene, folder / "f.##.obj", {"--frames", "1-3"});
    const auto info = [&](const std::string& curves) {
        return marram(
            {"info",
             folder.write("b.toml", tuft + "[[curves]]\nname = \"c\"\ntype = \"strands\"\n" + curves)});
    };
    ProgramResult result = info("file = \"all.usda\"\ntransform = { translate = [0, 1, 0] }\n");
    EXPECT_EQ(result.code, 0);
    EXPECT_CONTAINS(result.out,
                    "curves c: 20 B-splines, 100 CVs in all, 3 samples, with\n    id: 1 a curve, discrete\n");
    result = info("file = \"f.##.obj\"\nfile_frames = [1, 3]\n");
    EXPECT_CONTAINS(result.out, "curves c: 20 polylines, 100 CVs in all, 3 samples\n");
    EXPECT_EQ(result.err, "");
    const auto refused = [&](const std::string& curves, const std::string& what) {
        const ProgramResult outcome = info(curves);
        EXPECT_EQ(outcome.code, 2);
        EXPECT_EQ(lines(outcome.err).size(), 1u) << outcome.err;
        EXPECT_CONTAINS(outcome.err, what);
    };
    refused("file = \"f.##.obj\"\nfile_frames = [1, 4]\n", "f.04.obj: there is no such file");
    refused("file = \"all.usda\"\nfile_frames = [1, 4]\n",
            "curves.c.file is one file for all of file_frames");
    refused("file = \"a.toml\"\n", "curves.c.file is no .hair and no .usda and no .ply and no .obj");
    folder.write("f.02.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n");
    result = info("file = \"f.##.obj\"\nfile_frames = [1, 3]\n");
    EXPECT_CONTAINS(result.out, "curves c: 20 polylines, 100 CVs in all, one of 3 takes\n");
    EXPECT_EQ(lines(result.err).size(), 1u) << result.err;
    EXPECT_CONTAINS(result.err,
                    "f.01.obj: its strands or CVs change over time: each frame has those of its time");
    for (int i = 1; i <= 3; ++i) folder.write(fmt::format("g.{}.obj", i), "v 0 0 0\nv 1 0 0\nl 1 2\nl 2\n");
    result = info("file = \"g.#.obj\"\nfile_frames = [1, 3]\n");
    EXPECT_EQ(lines(result.err).size(), 1u) << result.err;
    EXPECT_CONTAINS(result.err, "g.1.obj: 1 of 2 strands have fewer than two points");
    // A run does not write a file that it reads.
    EXPECT_EQ(marram({"bake", folder / "b.toml", "-o", folder / "g.2.obj"}).code, 2);
}

// A field's dunes, as listed by info, replace the field as layers.
TEST(Bake, AFieldsDunesReadBackAsDrawnOnes) {
    const Folder folder;
    const std::string head =
        "[camera]\nposition = [0, 9, 30]\ntarget = [0, 0, 0]\n[[light]]\ntype = \"sky\"\n"
        "[[procedural]]\ntype = \"terrain\"\nname = \"desert\"\nsize = [300, 300]\ncell = 1\nseed = 3\n";
    size_t index = 0;
    for (const char* kind : {"barchan", "star", "seif", "dome", "parabolic", "barchanoid"}) {
        if (!testing::in_this_run(index++, 2)) continue;
        const std::string scene = folder.write(
            "a.toml",
            head + fmt::format("[[procedural.layer]]\ntype = \"mass_desert\"\nkind = \"{}\"\nlist = true\n"
                               "spacing = [60, 80]\nboundary_noise = 1\n",
                               kind));
        bake(scene, folder / "a.exr");
        const ProgramResult info = marram({"info", scene});
        const size_t begin = info.out.find("# What 'desert' has generated");
        ASSERT_NE(begin, std::string::npos) << info.err;
        bake(folder.write("b.toml", head + info.out.substr(begin)), folder / "b.exr");
        const std::vector<float> field = heights_of(folder / "a.exr"), drawn = heights_of(folder / "b.exr");
        ASSERT_EQ(field.size(), drawn.size());
        double worst = 0.0;
        for (size_t k = 0; k < field.size(); ++k)
            worst = std::max(worst, std::abs(double(field[k]) - double(drawn[k])));
        fmt::print("{}: drawn dunes within {:.2g} m of the field's\n", kind, worst);
        EXPECT_GT(std::ranges::minmax(field).max, 2.0F);
        EXPECT_LT(worst, 1e-4 * 6.0) << kind;
    }
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

TEST(Bake, LeavesAFileOfStrandsIfThereAreNone) {
    const Folder folder;
    const std::string file = folder.write("a.hair", "strands"),
                      scene = folder.write("a.toml", "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n"
                                                     "[[mesh]]\nname = \"ground\"\ntype = \"plane\"\n");
    const ProgramResult outcome = marram({"bake", scene, "-o", file});
    EXPECT_EQ(outcome.code, 2);
    EXPECT_CONTAINS(outcome.err, "the scene has no strands");
    EXPECT_EQ(read_file(file), "strands");
    const std::string frames = folder.write("a.usda", "frames");
    EXPECT_EQ(marram({"bake", scene, "-o", frames, "--frames", "1-2"}).code, 2);
    EXPECT_EQ(read_file(frames), "frames");
}

// The errors' text of baking a rock of a mesh.
std::string baked_rock(const Folder& folder, const std::string& obj, const std::string& rock,
                       const std::string& output) {
    folder.write("rock.obj", obj);
    const std::string scene = folder.write(
        "rock.toml", "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[wind]\nspeed = 12\n"
                     "[[mesh]]\nname = \"given\"\ntype = \"file\"\nfile = \"rock.obj\"\nsmooth = false\n"
                     "[[procedural]]\nname = \"worn\"\ntype = \"rock\"\nmesh = \"given\"\n" +
                         rock);
    const ProgramResult outcome =
        marram({"bake", scene, "-o", output, "--quiet", "--state", folder / "states"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return outcome.err;
}

// Two boxes that voxels of the first level join.
TEST(Bake, SaysThatARockHasFallenApart) {
    const Folder folder;
    std::string obj;
    for (const double low : {-1.0, 0.03})
        for (int corner = 0; corner < 8; ++corner)
            obj += fmt::format("v {} {} {}\n", low + (corner & 1) * 0.97, (corner >> 1 & 1) * 0.8,
                               (corner >> 2) * 0.9);
    for (const int first : {1, 9})
        for (const auto& face :
             {std::array{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}})
            obj += fmt::format("f {} {} {} {}\n", first + face[0], first + face[1], first + face[2],
                               first + face[3]);
    const std::string said = baked_rock(
        folder, obj, "sand_level = 0\nlevels = 3\nvoxel = 0.02\nyears = 1\npaths = 2000\n", folder / "a.ply");
    EXPECT_CONTAINS(said, "fallen apart");
}

// Uvs outside 0 to 1 leave a black map, and triangles that overlap on it are told of.
TEST(Bake, SaysWhatAMapOfARockLacks) {
    const Folder folder;
    const auto map = [&](const std::string& uvs) {
        return baked_rock(folder,
                          "v -1 0 -1\nv -1 0 1\nv -1 2 0\nv 1 0 0\n" + uvs +
                              "f 1/1 2/2 3/3\nf 4/1 3/3 2/2\nf 4/1 1/2 3/3\nf 4/1 2/2 1/3\n",
                          "sand_level = -1\nmap = 16\npaths = 20000\n", folder / "map.exr");
    };
    const auto most = [&] { return std::ranges::max(read_image(folder / "map.exr").pixels); };
    const std::string overlapping = map("vt 0 0\nvt 1 0\nvt 0 1\n");
    EXPECT_CONTAINS(overlapping, "of the map lies in several triangles");
    EXPECT_EQ(overlapping.find("is not on the map"), std::string::npos) << overlapping;
    EXPECT_GT(most(), 0.5F);
    EXPECT_CONTAINS(map("vt 5 5\nvt 6 5\nvt 5 6\n"), "100 % of the surface is not on the map");
    EXPECT_EQ(most(), 0.0F);
    EXPECT_CONTAINS(map("vt 0.5 0.5\nvt 0.5 0.5\nvt 0.5 0.5\n"), "is not on the map");
}

} // namespace
} // namespace marram::testing
