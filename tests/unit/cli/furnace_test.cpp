// SPDX-License-Identifier: Apache-2.0
// White furnace: strands and a ball that absorb nothing under a uniform sky. The picture is as bright as the
// sky if neither the shaders nor the traced shapes of strands lose light.
#include "program.h"

#include "tests/whole.h"

#include <algorithm>

namespace marram::testing {
namespace {

struct Mean {
    double all = 0.0, least = 1e30; // of a channel; of a pixel
};

Mean mean_of(const std::string& path) {
    const Image image = read_image(path);
    const auto red = size_t(std::ranges::find(image.channel_names, "R") - image.channel_names.begin());
    Mean mean;
    const double pixels = double(image.width) * image.height;
    for (size_t i = red; i < image.pixels.size(); i += size_t(image.channels)) {
        mean.all += double(image.pixels[i]) / pixels;
        mean.least = std::min(mean.least, double(image.pixels[i]));
    }
    return mean;
}

const std::string white_sky = R"(
[[light]]
name = "sky"
type = "sky"
zenith = [1, 1, 1]
horizon = [1, 1, 1]
ground = [1, 1, 1]
[[material]]
name = "white"
type = "diffuse"
color = [1, 1, 1]
)";

const std::string furry_ball = R"(
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
fov = 35
[film]
size = [24, 24]
samples = 64
max_depth = 1000
[[mesh]]
name = "ball"
type = "sphere"
radius = 0.8
divisions = 64
material = "white"
[[procedural]]
name = "fur"
type = "groom"
on = "ball"
count = 1500
length = [0.2, 0.3]
width = 0.02
cvs = 5
lean = 30
arc = 40
)";

} // namespace

TEST(Furnace, WhiteStrandsAreNotSeen) {
    const std::vector<std::pair<const char*, const char*>> materials = {
        {"diffuse", "type = \"diffuse\"\ncolor = [1, 1, 1]"},
        {"diffuse, through", "type = \"diffuse\"\ncolor = [0.5, 0.5, 0.5]\ntransmission = [0.5, 0.5, 0.5]"},
        {"grass", "type = \"grass\"\ncolor = [1, 1, 1]\ntransmission_color = [1, 1, 1]"},
        {"surface", "type = \"surface\"\ncolor = [1, 1, 1]"},
        {"sand", "type = \"sand\"\ncolor = [1, 1, 1]\nripple_height = 0"},
        {"hair", "type = \"hair\"\npigment = \"melanin\"\nmelanin = 0"}};
    const Folder folder;
    size_t index = 0;
    for (const auto& [name, material] : materials)
        for (const char* shape : {"round", "ribbon", "oriented-ribbon"}) {
            if (!in_this_run(index++, 2)) continue; // one or two shapes of each material
            const std::string scene = folder.write(
                "a.toml", fmt::format("{}material = \"fibre\"\nshape = \"{}\"\n[[material]]\nname = "
                                      "\"fibre\"\n{}\n",
                                      furry_ball, shape, material) +
                              white_sky);
            EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--quiet"}));
            const Mean mean = mean_of(folder / "a.exr");
            std::printf("%-18s %-16s %.4f\n", name, shape, mean.all);
            EXPECT_NEAR(mean.all, 1.0, 4e-3) << name << ", " << shape; // strands cover half of the picture
        }
}

// A strand's straight pieces are capped by spheres at its ends; seen from its tip, a strand is mostly these.
TEST(Furnace, AWhiteStrandsEndsAreNotSeen) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", white_sky + R"(
[camera]
position = [0, 0.3, 3]
target = [0, 0, 0]
fov = 6
[film]
size = [24, 24]
samples = 256
max_depth = 1000
[[mesh]]
name = "ground"
type = "plane"
size = [0.01, 0.01]
material = "white"
[[procedural]]
name = "strand"
type = "groom"
on = "ground"
material = "white"
count = 1
length = [1, 1]
width = 0.1
width_profile = [[0, 1], [1, 0.1]]
cvs = 5
shape = "round"
arc = 20
)");
    EXPECT_DONE(marram({"render", scene, "-o", folder / "a.exr", "--quiet"}));
    const Mean mean = mean_of(folder / "a.exr");
    std::printf("a strand's root: %.4f, the darkest pixel %.3f\n", mean.all, mean.least);
    EXPECT_NEAR(mean.all, 1.0, 2e-3);
    EXPECT_GT(mean.least, 0.95);
}

} // namespace marram::testing
