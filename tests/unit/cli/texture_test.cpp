// SPDX-License-Identifier: Apache-2.0
// Images on surfaces: their averages, their orientation, and what is refused.
#include "core/shot/scene/texture.h"

#include "core/math/udim.h"
#include "tests/unit/cli/program.h"

namespace marram::testing {
namespace {

// A checkerboard of black and white squares, `side` pixels each, 8 bits.
std::string checkerboard(const Folder& folder, int side) {
    constexpr int size = 256;
    std::vector<float> pixels;
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x)
            for (int c = 0; c < 3; ++c) pixels.push_back((x / side + y / side) % 2 == 0 ? 0.0F : 1.0F);
    const std::string path = folder / "checker.png";
    write_png(path, size, size, 3, pixels.data(), 0.0);
    return path;
}

// Four fields of uniform colour; the first row is the top.
std::string fields(const Folder& folder) {
    constexpr int size = 64;
    std::vector<float> pixels;
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const bool right = x >= size / 2, low = y >= size / 2;
            for (const float v : {right ? 0.5F : 0.1F, low ? 0.7F : 0.2F, 0.25F}) pixels.push_back(v);
        }
    const std::string path = folder / "fields.exr";
    const Layer layer{"", {"R", "G", "B"}, pixels.data(), true};
    write_exr(path, size, size, std::span(&layer, 1), {});
    return path;
}

} // namespace

// The mean of black and white is half of the light; half of the 8-bit codes would be 0.21.
TEST(Texture, FromAfarIsTheMeanOfItsLight) {
    const Folder folder;
    const auto texture = open_texture(checkerboard(folder, 1), TextureContent::color, {});
    for (const float width : {0.1F, 0.5F, 1.0F, 30.0F})
        EXPECT_NEAR(texture->at({0.3F, 0.6F}, width, Wrap::repeat).x(), 0.5, 2e-3) << width;
    const auto near = open_texture(checkerboard(folder, 64), TextureContent::color, {});
    EXPECT_NEAR(near->at({0.125F, 0.875F}, 0.0F, Wrap::repeat).x(), 0.0, 1e-3); // the top left square
    EXPECT_NEAR(near->at({0.375F, 0.875F}, 0.0F, Wrap::repeat).x(), 1.0, 1e-3);
    EXPECT_NEAR(near->at({1.375F, -7.125F}, 0.0F, Wrap::repeat).x(), 1.0, 1e-3); // the image repeats
    // At the border, half a pixel inside: clamped, the far side has no share. Beyond, the pixel at the border
    // stays.
    for (const auto& [u, v] : {std::pair(0.0005F, 0.875F), {0.125F, 0.9995F}, {-3.0F, 0.875F}}) {
        EXPECT_NEAR(near->at({u, v}, 0.0F, Wrap::clamp).x(), 0.0, 1e-3);
        EXPECT_TRUE(u < 0.0F || near->at({u, v}, 0.0F, Wrap::repeat).x() > 0.2F);
    }
}

// Each square of uv has its own file, which ends at its border; a square without a file is black.
TEST(Texture, TilesCoverTheirSquares) {
    const Folder folder;
    const auto write = [&](const char* name, float value) {
        const std::vector<float> pixels(size_t(8 * 8 * 3), linear_from_srgb(value));
        write_png(folder / name, 8, 8, 3, pixels.data(), 0.0);
    };
    write("t.1001.png", 0.25F);
    write("t.1002.png", 0.5F);
    write("t.1012.png", 0.75F); // u 1, v 1
    write("t.1000.png", 1.0F);  // no tile
    const auto texture = open_texture(folder / "t.<UDIM>.png", TextureContent::data, {});
    const auto at = [&](float u, float v) { return texture->at({u, v}, 0.0F, Wrap::repeat).x(); };
    EXPECT_NEAR(at(0.999F, 0.5F), 0.25F, 3e-3F);
    EXPECT_NEAR(at(1.001F, 0.5F), 0.5F, 3e-3F);
    EXPECT_NEAR(at(2.0F, 0.5F), 0.5F, 3e-3F) << "its border";
    EXPECT_NEAR(at(1.5F, 1.001F), 0.75F, 3e-3F);
    EXPECT_EQ(at(0.5F, 1.5F), 0.0F);
    EXPECT_EQ(at(-0.5F, 0.5F), 0.0F);
    EXPECT_THROW(open_texture(folder / "u.<UDIM>.png", TextureContent::data, {}), InputError);
    EXPECT_EQ(udim_pattern("a.1002/fur_1011.png"), "a.1002/fur_<UDIM>.png");
    EXPECT_EQ(udim_pattern("a.1002/fur_0999.png"), "");
    EXPECT_EQ(udim_pattern("fur1001.png"), "");
}

// A groom and a material with images in tiles, on a mesh with uvs in two squares.
TEST(Texture, TilesOfGroomsAndWarnings) {
    const Folder folder;
    const std::vector<float> white(size_t(4 * 4 * 3), 1.0F), black(size_t(4 * 4 * 3), 0.0F);
    write_png(folder / "fur.1001.png", 4, 4, 3, black.data(), 0.0);
    write_png(folder / "fur.1002.png", 4, 4, 3, white.data(), 0.0);
    folder.write("two.obj",
                 "v -1 0 1\nv 0 0 1\nv 0 0 0\nv -1 0 0\nv 1 0 1\nv 1 0 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
                 "vt 2 0\nvt 2 1\nf 1/1 2/2 3/3 4/4\nf 2/2 5/5 6/6 3/3\n");
    const auto bake = [&](const std::string& mask, const std::string& map) {
        const std::string scene = folder.write(
            "a.toml",
            "[camera]\nposition = [0, 2, 2]\ntarget = [0, 0, 0]\n[film]\nsize = [8, 8]\nsamples = 1\n"
            "[[light]]\ntype = \"sky\"\n[[material]]\nname = \"m\"\ntype = \"hair\"\ncolor_map = \"" +
                map +
                "\"\n[[mesh]]\nname = \"b\"\ntype = \"file\"\nfile = \"two.obj\"\n[[procedural]]\nname = "
                "\"g\"\ntype = \"groom\"\non = \"b\"\nmaterial = \"m\"\ncount = 100\ncvs = 4\nlength = "
                "0.01\nwidth = 0.001\ndensity_by = [{ image = \"" +
                mask + "\" }]\n");
        return marram({"render", scene, "-o", folder / "a.exr", "--quiet"});
    };
    EXPECT_DONE(bake("fur.<UDIM>.png", "fur.<UDIM>.png"));
    const ProgramResult single = bake("fur.1002.png", "fur.1002.png");
    EXPECT_EQ(lines(single.err).size(), 2U) << single.err;
    EXPECT_CONTAINS(single.err, "is named as one tile, and repeats over the other squares of the uv of 'b'");
    EXPECT_CONTAINS(single.err, "fur.<UDIM>.png\" for all tiles");
    fs::remove(folder / "fur.1001.png");
    const ProgramResult less = bake("fur.<UDIM>.png", "fur.<UDIM>.png");
    EXPECT_EQ(less.code, 0);
    EXPECT_CONTAINS(less.err, "has no tile 1001, where 'b' has triangles");
    fs::remove(folder / "fur.1002.png");
    const ProgramResult gone = bake("fur.<UDIM>.png", "fur.<UDIM>.png");
    EXPECT_EQ(gone.code, 2);
    EXPECT_CONTAINS(gone.err, "there is no tile of \"fur.<UDIM>.png\"");
}

// map_scale moves uvs to other tiles.
TEST(Texture, WarningsOfTilesCountTheScale) {
    const Folder folder;
    const std::vector<float> white(size_t(4 * 4 * 3), 1.0F);
    for (const char* name : {"fur.1001.png", "fur.1002.png", "one.1001.png"})
        write_png(folder / name, 4, 4, 3, white.data(), 0.0);
    folder.write("quad.obj", "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
                             "f 1/1 2/2 3/3 4/4\n");
    const auto warned = [&](const std::string& map, const std::string& scale) {
        const std::string scene = folder.write(
            "a.toml",
            "[camera]\nposition = [0, 2, 2]\ntarget = [0, 0, 0]\n[film]\nsize = [8, 8]\nsamples = 1\n"
            "[[light]]\ntype = \"sky\"\n[[material]]\nname = \"m\"\ntype = \"surface\"\ncolor_map = \"" +
                map + "\"\nmap_scale = " + scale +
                "\n[[mesh]]\nname = \"b\"\ntype = \"file\"\nfile = \"quad.obj\"\nmaterial = \"m\"\n");
        const ProgramResult done = marram({"render", scene, "-o", folder / "a.exr", "--quiet"});
        EXPECT_EQ(done.code, 0) << done.err;
        return done.err;
    };
    EXPECT_EQ(warned("fur.<UDIM>.png", "[1, 1]"), "");
    EXPECT_EQ(warned("fur.<UDIM>.png", "[2, 1]"), "");
    EXPECT_EQ(warned("fur.<UDIM>.png", "[0.5, 0.5]"), "");
    EXPECT_CONTAINS(warned("fur.<UDIM>.png", "[2, 2]"), "has no tile 1011, 1012, which 'b' uses");
    EXPECT_CONTAINS(warned("fur.<UDIM>.png", "[5, 1]"), "has no tile 1003, 1004, 1005, which 'b' uses");
    EXPECT_CONTAINS(warned("fur.<UDIM>.png", "[-2, 1]"),
                    "has no tile uv (-2, 0), uv (-1, 0), which 'b' uses");
    EXPECT_EQ(warned("one.1001.png", "[3, 1]"), "") << "asked for";
}

TEST(Texture, StandsUprightAndKeepsItsValues) {
    const Folder folder;
    const auto texture = open_texture(fields(folder), TextureContent::color, {});
    EXPECT_LT((texture->at({0.25F, 0.25F}, 0.0F, Wrap::repeat) - Vec3f(0.1F, 0.7F, 0.25F)).norm(), 1e-3F);
    EXPECT_LT((texture->at({0.75F, 0.25F}, 0.0F, Wrap::repeat) - Vec3f(0.5F, 0.7F, 0.25F)).norm(), 1e-3F);
    EXPECT_LT((texture->at({0.25F, 0.75F}, 0.0F, Wrap::repeat) - Vec3f(0.1F, 0.2F, 0.25F)).norm(), 1e-3F);
}

TEST(Texture, DataIsNotTakenForColor) {
    const Folder folder;
    std::vector<float> grey(64 * 64 * 3, linear_from_srgb(0.5F)); // written as half of the full scale
    const std::string path = folder / "rough.png";
    write_png(path, 64, 64, 3, grey.data(), 0.0);
    EXPECT_NEAR(open_texture(path, TextureContent::data, {})->at({0.5F, 0.5F}, 0.0F, Wrap::repeat).x(), 0.5,
                3e-3);
    EXPECT_NEAR(open_texture(path, TextureContent::color, {})->at({0.5F, 0.5F}, 0.0F, Wrap::repeat).x(),
                0.214, 3e-3);
}

TEST(Texture, PaintsAPictureAndFaultsHaveALine) {
    const Folder folder;
    checkerboard(folder, 64);
    const auto scene = [&](const std::string& map) {
        return "[camera]\nposition = [0, 4, 0.01]\ntarget = [0, 0, 0]\nfov = 28.07\n"
               "[film]\nsize = [64, 64]\nsamples = 64\nmax_depth = 1\nfilter = \"box\"\nfilter_radius = 0.5\n"
               "[[light]]\ntype = \"sky\"\nzenith = 1\nhorizon = 1\nground = 1\n"
               "[[material]]\nname = \"m\"\ntype = \"surface\"\ncolor = 1\nspecular = 0\ncolor_map = \"" +
               map + "\"\n[[mesh]]\nname = \"floor\"\ntype = \"plane\"\nsize = [2, 2]\nmaterial = \"m\"\n";
    };
    const std::string file = folder.write("scene.toml", scene("checker.png"));
    const ProgramResult whole = marram({"render", file, "-o", folder / "out.exr", "--quiet"});
    ASSERT_EQ(whole.code, 0) << whole.err;
    const Image image = read_image(folder / "out.exr");
    const auto at = [&](int x, int y) { return image.pixels[size_t((y * 64 + x) * image.channels)]; };
    int bright = 0, dark = 0;
    for (int y = 8; y < 64; y += 16)
        for (int x = 8; x < 64; x += 16) {
            const bool white = ((x / 16) + (y / 16)) % 2 == 1;
            (white ? bright : dark) += white ? at(x, y) > 0.8F : at(x, y) < 0.05F;
        }
    EXPECT_EQ(bright, 8);
    EXPECT_EQ(dark, 8);

    const std::string png = read_file(folder / "checker.png");
    folder.write("cut.png", png.substr(0, png.size() / 2));
    folder.write("text.png", "no image");
    std::vector<float> holed(64 * 64 * 3, 0.5F);
    holed[3000] = std::numeric_limits<float>::quiet_NaN();
    const Layer layer{"", {"R", "G", "B"}, holed.data(), false};
    write_exr(folder / "holed.exr", 64, 64, std::span(&layer, 1), {});
    for (const char* map : {"cut.png", "text.png", "missing.png", "holed.exr"}) {
        const ProgramResult refused =
            marram({"render", folder.write("bad.toml", scene(map)), "-o", folder / "bad.exr"});
        EXPECT_EQ(refused.code, 2) << map;
        EXPECT_TRUE(refused.err.find(map) != std::string::npos) << refused.err;
        EXPECT_FALSE(fs::exists(folder / "bad.exr"));
    }
}

// Strands take the image's colour at their roots, with any shader, from root to tip.
TEST(Texture, ColorsStrandsByTheUvAtTheirRoots) {
    const Folder folder;
    checkerboard(folder, 64);
    const auto scene = [&](const std::string& shader, const std::string& mesh) {
        return "[camera]\nposition = [0, 4, 0.01]\ntarget = [0, 0, 0]\nfov = 28.07\n"
               "[film]\nsize = [64, 64]\nsamples = 16\nmax_depth = 1\nfilter = \"box\"\nfilter_radius = 0.5\n"
               "[[light]]\ntype = \"sky\"\nzenith = 1\nhorizon = 1\nground = 1\n"
               "[[material]]\nname = \"black\"\ntype = \"diffuse\"\ncolor = 0\n"
               "[[material]]\nname = \"m\"\ncolor = 1\ncolor_map = \"checker.png\"\n" +
               shader + "[[mesh]]\nname = \"floor\"\nmaterial = \"black\"\n" + mesh +
               "[[procedural]]\ntype = \"groom\"\nname = \"fur\"\non = \"floor\"\nmaterial = \"m\"\n"
               "density = 40000\nlength = [0.02, 0.03]\nlean = 45\narc = 30\nwidth = 0.008\n"
               "width_profile = [[0, 1]]\ncvs = 4\nshape = \"ribbon\"\n";
    };
    const std::string plane = "type = \"plane\"\nsize = [2, 2]\n";
    for (const std::string shader : {"type = \"diffuse\"\n", "type = \"grass\"\ntransmission = 0\n",
                                     "type = \"hair\"\n", "type = \"surface\"\nspecular = 0\n"}) {
        SCOPED_TRACE(shader);
        const ProgramResult done = marram(
            {"render", folder.write("s.toml", scene(shader, plane)), "-o", folder / "out.exr", "--quiet"});
        ASSERT_EQ(done.code, 0) << done.err;
        const Image image = read_image(folder / "out.exr");
        double bright = 0.0, dark = 0.0;
        for (int y = 8; y < 64; y += 16)
            for (int x = 8; x < 64; x += 16) {
                const bool white = ((x / 16) + (y / 16)) % 2 == 1;
                double sum = 0.0; // of 4 x 4 pixels in a square's middle
                for (int i = 0; i < 16; ++i)
                    sum +=
                        double(image.pixels[size_t(((y - 2 + i / 4) * 64 + x - 2 + i % 4) * image.channels)]);
                (white ? bright : dark) += sum / 16.0 / 8.0;
            }
        // With one scattering event, hair returns little light, and some of that is white gloss.
        EXPECT_GT(bright, 0.05);
        EXPECT_LT(dark, 0.35 * bright);
    }
    // Without a uv at the roots all strands would have the same colour.
    folder.write("bare.obj", "v -1 0 -1\nv 1 0 -1\nv 0 0 1\nf 3 2 1\n");
    const ProgramResult refused =
        marram({"render",
                folder.write("b.toml", scene("type = \"hair\"\n", "type = \"file\"\nfile = \"bare.obj\"\n")),
                "-o", folder / "b.exr", "--quiet"});
    EXPECT_EQ(refused.code, 2);
    EXPECT_NE(refused.err.find("the strands of 'fur' have no uv at their roots"), std::string::npos)
        << refused.err;
    // The same if a procedural makes the mesh, which is known only after it is made.
    std::string grown = scene("type = \"hair\"\n", "type = \"file\"\nfile = \"bare.obj\"\n");
    grown.replace(grown.find("on = \"floor\""), 12, "on = \"stone\"");
    grown += "[[procedural]]\nname = \"stone\"\ntype = \"rock\"\nmesh = \"floor\"\npaths = 1000\n";
    const ProgramResult bare =
        marram({"render", folder.write("p.toml", grown), "-o", folder / "p.exr", "--quiet"});
    EXPECT_EQ(bare.code, 2);
    EXPECT_NE(bare.err.find("the strands of 'fur' have no uv at their roots"), std::string::npos) << bare.err;
}

// A missing temporary folder is reported. Temporary files are removed afterwards.
TEST(Texture, LeavesNothingBehindAndNeedsAFolder) {
    const Folder folder, temporary;
    ::setenv("TMPDIR", (temporary / "").c_str(), 1);
    const auto files = [&] {
        return std::distance(fs::directory_iterator(temporary / ""), fs::directory_iterator());
    };
    auto texture = open_texture(checkerboard(folder, 8), TextureContent::color, {});
    EXPECT_EQ(files(), 1);
    texture.reset();
    EXPECT_EQ(files(), 0);
    ::setenv("TMPDIR", (temporary / "nowhere").c_str(), 1);
    EXPECT_THROW(open_texture(folder / "checker.png", TextureContent::color, {"scene.toml", 3, 1}),
                 InputError);
    ::unsetenv("TMPDIR");
}

} // namespace marram::testing
