// SPDX-License-Identifier: Apache-2.0
// Mutates inputs and checks that the program handles them: bad input is refused with exit code 2 and messages
// that say where and what; nothing crashes, no output is left behind, no input is modified.
//
//     build/marram_fuzz --seconds 3600 --seed 7           for an hour; each seed gives other cases
//     build/marram_fuzz --seed 7 --kind mesh --case 123   repeats one case and keeps its folder
//
// All randomness comes from seed, kind and case, so a case is the same on every run and machine.
#include "core/cli/cli.h"
#include "core/image/image.h"
#include "core/image/image_library.h"
#include "core/math/hash.h"
#include "core/math/problem.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <thread>

namespace marram {
namespace {

namespace fs = std::filesystem;

struct Random {
    uint64_t state;
    uint64_t next() { return state = hash(state, 0x9e3779b97f4a7c15ULL); }
    size_t below(size_t n) { return n > 0 ? size_t(next() % n) : 0; }
    bool one_in(size_t n) { return below(n) == 0; }
    template <class List>
    const auto& pick(const List& list) {
        return list[below(std::size(list))];
    }
};

std::string read_file(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

void write_file(const fs::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
}

// ---- Mutations ---------------------------------------------------------------------------------------------------

const std::vector<std::string> extremes = {"0",
                                           "-1",
                                           "1",
                                           "1e308",
                                           "-1e308",
                                           "1e-308",
                                           "nan",
                                           "inf",
                                           "-inf",
                                           "2147483648",
                                           "-2147483649",
                                           "0.5",
                                           "1e18",
                                           "1e-18",
                                           "4294967296",
                                           "1000000000",
                                           "[]",
                                           "{}",
                                           "true",
                                           "\"\"",
                                           "[1, 2]",
                                           "[1, 2, 3]",
                                           "-0.0",
                                           "9223372036854775807",
                                           "99999999999999999999",
                                           "\"x\"",
                                           "[[0, 1], [1, 0]]",
                                           "[[1, 0], [0, 1]]",
                                           "1e5"};

// The first number at or after `at`: its position and size.
std::pair<size_t, size_t> number_at(const std::string& text, size_t at) {
    constexpr const char* digits = "0123456789.-+e";
    const size_t begin = text.find_first_of("0123456789", at);
    if (begin == std::string::npos) return {0, 0};
    return {begin, std::min(text.find_first_not_of(digits, begin), text.size()) - begin};
}

void mutate_once(std::string& bytes, bool text, Random& random) {
    if (bytes.empty()) return;
    const size_t at = random.below(bytes.size()), count = std::min(bytes.size() - at, 1 + random.below(16));
    switch (random.below(text ? 9 : 6)) {
    case 0:
        bytes[at] = char(bytes[at] ^ (1 << random.below(8)));
        break;
    case 1:
        bytes[at] = char(random.next());
        break;
    case 2:
        bytes.erase(at, count);
        break;
    case 3:
        bytes.insert(random.below(bytes.size()), bytes.substr(at, count));
        break;
    case 4:
        if (random.one_in(4)) bytes.resize(at);
        break;
    case 5: { // four bytes of a binary number
        constexpr uint32_t values[] = {0,          1,          0x7fffffff, 0x80000000,
                                       0xffffffff, 0x7fc00000, 0x7f800000, 0x00010000};
        const uint32_t value = random.pick(values);
        for (size_t i = 0; i < 4 && at + i < bytes.size() && !text; ++i)
            bytes[at + i] = char(value >> (8 * i));
        break;
    }
    case 6: { // replace a number
        const auto [begin, size] = number_at(bytes, at);
        if (size > 0) bytes.replace(begin, size, random.pick(extremes));
        break;
    }
    case 7: { // double or delete a line
        const size_t begin = bytes.rfind('\n', at) == std::string::npos ? 0 : bytes.rfind('\n', at) + 1;
        const size_t end = std::min(bytes.find('\n', at), bytes.size() - 1) + 1;
        const std::string line = bytes.substr(begin, end > begin ? end - begin : 0);
        if (random.one_in(2))
            bytes.insert(begin, line);
        else
            bytes.erase(begin, line.size());
        break;
    }
    default: { // swap two characters
        const size_t other = random.below(bytes.size());
        std::swap(bytes[at], bytes[other]);
    }
    }
}

std::string mutated(std::string bytes, bool text, Random& random) {
    for (size_t n = 1 + random.below(4); n > 0; --n) mutate_once(bytes, text, random);
    return bytes;
}

// Corrects the checksums of a PNG's chunks, so that the decoder reads on.
void fix_checksums(std::string& png) {
    const auto byte = [&](size_t i) { return uint32_t(static_cast<unsigned char>(png[i])); };
    for (size_t at = 8; at + 12 <= png.size();) {
        const size_t length = byte(at) << 24 | byte(at + 1) << 16 | byte(at + 2) << 8 | byte(at + 3);
        if (length > png.size() || at + 12 + length > png.size()) return;
        uint32_t crc = ~0U;
        for (size_t i = at + 4; i < at + 8 + length; ++i) {
            crc ^= byte(i);
            for (int bit = 0; bit < 8; ++bit) crc = crc & 1U ? 0xedb88320U ^ (crc >> 1) : crc >> 1;
        }
        for (size_t i = 0; i < 4; ++i) png[at + 8 + length + i] = char(~crc >> (24 - 8 * i));
        at += 12 + length;
    }
}

// ---- Inputs ------------------------------------------------------------------------------------------------------

const std::string scene_text = R"(frames = [1, 4]
tolerance = 0.002
[camera]
position = [0, 1, 4]
target = [0, 0.2, 0]
shutter = [-0.25, 0.25]
[film]
size = [12, 8]
samples = 1
max_depth = 2
motion_keys = 2
[wind]
direction = [1, 0, 0.2]
speed = 6
global_rotate = 0.7
ramp_rotate = [[0, 0.2], [1, 1]]
noise = { amplitude = 0.5, frequency = 1, octaves = 2, type = "perlin" }
shielding = { shield = 0.5, offset = 2 }
jiggle = { frequency = 2, damping = 0.4 }
collision = { solver = "exact", offset_scale = 0.3 }
gusts = { num_gusts = 5, radius_range = [0.3, 1] }
[[light]]
type = "sun"
direction = [-1, 2, 1]
[[light]]
type = "sky"
[[material]]
name = "blade"
type = "grass"
[[material]]
name = "soil"
type = "sand"
[[mesh]]
name = "ground"
type = "plane"
size = [2, 2]
divisions = 2
material = "soil"
[[mesh]]
name = "ball"
type = "sphere"
radius = 0.3
divisions = 8
[[procedural]]
type = "groom"
name = "grass"
on = "ground"
material = "blade"
count = 60
length = [0.3, 0.5]
width = 0.02
cvs = 5
shape = "ribbon"
clump = { size = 0.2 }
envelope = [[0, 0.5], [1, 1]]
)";

// One layer of each kind, and a groom on the result.
const std::string terrain_text = R"([camera]
position = [0, 6, 14]
target = [0, 0, 0]
[film]
size = [12, 8]
samples = 1
max_depth = 2
[wind]
direction = [1, 0, 0.2]
[[light]]
type = "sky"
[[material]]
name = "soil"
type = "sand"
[[mesh]]
name = "wall"
type = "box"
size = [0.6, 2, 3]
[[curves]]
name = "ridge"
type = "points"
points = [[-8, 0, -3], [0, 0, 2], [8, 0, -2]]
[[curves]]
name = "ring"
type = "points"
points = [[-3, 0, -3], [3, 0, -3], [0, 0, 3]]
closed = true
[[procedural]]
type = "terrain"
name = "desert"
material = "soil"
size = [20, 16]
center = [1, -1]
cell = 0.5
seed = 3
[[procedural.layer]]
type = "flat"
target = "sand"
height = 0.5
[[procedural.layer]]
type = "noise"
kind = "ridged"
amplitude = 1
wavelength = 8
octaves = 3
[[procedural.layer]]
type = "mask"
name = "steep"
by = "slope"
ramp = [[5, 0], [20, 1]]
[[procedural.layer]]
type = "dune"
name = "drawn"
along = "ridge"
max_height = 2
slope_width = 6
attributes = true
combine = "smooth_maximum"
smooth = 0.3
[[procedural.layer]]
type = "mass_desert"
kind = "barchan"
height = [0.5, 1]
spacing = [4, 8]
[[procedural.layer]]
type = "ruin"
mesh = "wall"
[[procedural.layer]]
type = "fusion"
[[procedural.layer]]
type = "mask"
name = "near"
by = "distance"
along = "ring"
ramp = [[0, 1], [3, 0]]
mask = "steep"
[[procedural.layer]]
type = "ripples"
wavelength = 0.2
height = 0.02
[[procedural]]
type = "groom"
name = "grass"
on = "desert"
count = 40
density_by = [{ attribute = "near" }]
length = 0.4
width = 0.02
cvs = 4
)";

const std::string plain_scene = R"([camera]
position = [0, 1, 4]
target = [0, 0, 0]
[film]
size = [12, 8]
samples = 2
max_depth = 2
[[light]]
type = "sky"
)";

const std::string obj_text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
                             "f 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/3/1 4/4/1\n";
const std::string ply_header =
    "property float x\nproperty float y\nproperty float z\nelement face 2\nproperty list uchar "
    "int vertex_indices\nend_header\n";
const std::string ply_text = "ply\nformat ascii 1.0\nelement vertex 4\n" + ply_header +
                             "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";

std::string ply_binary() {
    std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex 4\n" + ply_header;
    const float corners[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    bytes.append(reinterpret_cast<const char*>(corners), sizeof corners);
    for (const int third : {2, 3}) {
        const int triangle[3] = {0, third - 1, third};
        bytes.push_back(3);
        bytes.append(reinterpret_cast<const char*>(triangle), sizeof triangle);
    }
    return bytes;
}

// The files to mutate, made once.
struct Seeds {
    std::string exr, png, state, state_scene;
};

struct Command {
    std::vector<std::string> arguments;
    std::string output; // picture that must exist after exit code 0; "" for none
};

using Maker = Command (*)(const Seeds&, const fs::path&, Random&);

Command render(const fs::path& folder, std::vector<std::string> more = {}) {
    Command command{{"render", folder / "a.toml", "-o", folder / "out.exr", "--quiet"}, folder / "out.exr"};
    command.arguments.insert(command.arguments.end(), more.begin(), more.end());
    return command;
}

Command make_scene(const Seeds&, const fs::path& folder, Random& random) {
    write_file(folder / "a.toml", mutated(scene_text, true, random));
    return render(folder);
}

Command make_terrain(const Seeds&, const fs::path& folder, Random& random) {
    write_file(folder / "a.toml", mutated(terrain_text, true, random));
    return render(folder);
}

Command make_mesh(const Seeds&, const fs::path& folder, Random& random) {
    const size_t which = random.below(3);
    const std::string name = which == 0 ? "m.obj" : "m.ply";
    const std::string bytes = which == 0 ? obj_text : which == 1 ? ply_text : ply_binary();
    write_file(folder / name, mutated(bytes, which != 2, random));
    write_file(folder / "a.toml", plain_scene + "[[mesh]]\nname = \"m\"\ntype = \"file\"\nfile = \"" + name +
                                      "\"\n[[procedural]]\ntype = \"groom\"\nname = \"g\"\non = \"m\"\ncount "
                                      "= 20\nlength = 0.2\nwidth = "
                                      "0.01\ncvs = 4\n");
    return render(folder);
}

const std::string usda_text =
    "#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\ndef Xform \"a\" ( kind = \"group\" )\n{\n   "
    " double3 "
    "xformOp:translate.timeSamples = { 1: (0, 1, 0), 2: (1, 1, 0) }\n    uniform token[] xformOpOrder = "
    "[\"xformOp:translate\"]\n    def BasisCurves \"c\"\n    {\n        uniform token basis = \"bspline\"\n  "
    "      int[] "
    "curveVertexCounts = [2, 4]\n        point3f[] points = [(0, 0, 0), (1, 0.5, 0), (-1, 0, 0), (0, 2, 0), "
    "(1, 0, 1), "
    "(2, -1, 1e-1)]\n        uniform token type = \"cubic\"\n        float[] widths = [1] ( interpolation = "
    "\"constant\" )\n"
    "        uniform token wrap = \"pinned\"\n    }\n}\n";
const std::string lines_ply =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float "
    "z\nproperty int strand_id\nelement edge 3\nproperty int vertex1\nproperty int vertex2\n"
    "end_header\n0 0 0 1\n1 0 0 1\n1 1 0 2\n0 1 1 2\n0 1\n1 2\n2 3\n";

std::string hair_binary() {
    std::string bytes = "HAIR";
    const auto put = [&](auto number) {
        bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
    };
    for (const uint32_t word : {2U, 5U, 31U, 0U}) put(word);
    for (const float value : {0.1F, 0.0F, 1.0F, 0.5F, 1.0F}) put(value);
    bytes.resize(128);
    for (const uint16_t segments : {1, 2}) put(segments);
    for (int i = 0; i < 5 * (3 + 1 + 1 + 3); ++i) put(0.1F * float(i));
    return bytes;
}

const std::string strands_usda =
    "#usda 1.0\n(\n    metersPerUnit = 1\n    timeCodesPerSecond = 12\n)\ndef Xform \"a\"\n{\n    float "
    "xformOp:rotateY.timeSamples = { 1: 0, 2: 90 }\n    uniform token[] xformOpOrder = "
    "[\"xformOp:rotateY\"]\n    def BasisCurves \"c\"\n    {\n        uniform token basis = \"bezier\"\n    "
    "    int[] curveVertexCounts = [4, 4]\n        point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0.5, "
    "0), (-1, 0, 0), (0, 2, 0), (1, 0, 1), (2, -1, 1e-1), (3, 0, 0), (4, 1, 0)], 3: [(0, 0, 0), (1, 0.5, 0), "
    "(-1, 0, 0), (0, 2, 0), (1, 0, 1), (2, -1, 1e-1), (3, 0, 0), (4, 2, 0)] }\n        int64[] ids = [7, "
    "99999999999]\n        float[] widths = [0.1, 0.2] ( interpolation = \"uniform\" )\n        color3f[] "
    "primvars:tint = [(0, 1, 0), (1, 0, 0)] ( interpolation = \"vertex\" )\n        int[] "
    "primvars:tint:indices = [0, 1, 0, 1, 0, 1, 0, 1]\n        float primvars:wet = 1\n        float[] "
    "primvars:v = [1, 2, 3, 4] ( interpolation = \"varying\" )\n    }\n}\n";
const std::string strands_ply =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float "
    "z\nproperty float width\nproperty int strand_id\nproperty uchar red\nproperty uchar green\nproperty "
    "uchar blue\nproperty float a_0\nproperty float a_1\nelement strand 2\nproperty int "
    "strand_id\nproperty float length\nend_header\n0 0 0 1 1 9 8 7 1 2\n1 0 0 1 1 9 8 7 3 4\n1 1 0 1 2 9 8 7 "
    "5 6\n0 1 1 1 2 9 8 7 7 8\n2 0.5\n1 0.25\n";

// Strand files. They are read although nothing uses them.
Command make_strands(const fs::path& folder, Random& random) {
    static const std::pair<const char*, std::string> files[] = {
        {"c.hair", hair_binary()},
        {"c.usda", strands_usda},
        {"c.ply", strands_ply},
        {"c.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nl 1 2 3\nl -1 -2\nl 4/1 1/2\n"}};
    const auto& [name, bytes] = random.pick(files);
    write_file(folder / name, mutated(bytes, std::string(name) != "c.hair", random));
    write_file(folder / "a.toml",
               plain_scene + "[[curves]]\nname = \"c\"\ntype = \"strands\"\nfile = \"" + name + "\"\n");
    return render(folder);
}

Command make_curves(const Seeds&, const fs::path& folder, Random& random) {
    if (random.one_in(2)) return make_strands(folder, random);
    const bool usda = random.one_in(2);
    const std::string name = usda ? "c.usda" : "c.ply";
    write_file(folder / name, mutated(usda ? usda_text : lines_ply, true, random));
    write_file(folder / "a.toml", plain_scene + "[[curves]]\nname = \"c\"\ntype = \"file\"\nfile = \"" +
                                      name +
                                      "\"\n[[procedural]]\ntype = \"terrain\"\nname = \"t\"\nsize = [4, "
                                      "4]\n[[procedural.layer]]\ntype = "
                                      "\"mask\"\nname = \"m\"\nby = \"distance\"\nalong = \"c\"\n");
    return render(folder);
}

Command make_image(const Seeds& seeds, const fs::path& folder, Random& random) {
    const bool png = random.one_in(2);
    const std::string name = png ? "i.png" : "i.exr";
    std::string bytes = mutated(png ? seeds.png : seeds.exr, false, random);
    if (png && random.one_in(2)) fix_checksums(bytes);
    write_file(folder / name, bytes);
    switch (random.below(4)) {
    case 0:
        write_file(folder / "b.exr", seeds.exr);
        return {{"compare", folder / name, folder / "b.exr"}, ""};
    case 1:
        write_file(folder / "a.toml",
                   plain_scene + "[[light]]\ntype = \"environment\"\nfile = \"" + name + "\"\n");
        break;
    case 2:
        write_file(folder / "a.toml", plain_scene +
                                          "[[mesh]]\nname = \"h\"\ntype = \"heightfield\"\nimage = \"" +
                                          name + "\"\nsize = [2, 2]\nheight = 1\n");
        break;
    default:
        write_file(folder / "a.toml",
                   plain_scene + "[[material]]\nname = \"m\"\ntype = \"surface\"\ncolor_map = \"" + name +
                       "\"\n[[mesh]]\nname = \"p\"\ntype = \"plane\"\nsize = [2, 2]\nmaterial = "
                       "\"m\"\n");
    }
    return render(folder);
}

Command make_state(const Seeds& seeds, const fs::path& folder, Random& random) {
    write_file(folder / "a.toml", seeds.state_scene);
    write_file(folder / "out.exr.state.tif", mutated(seeds.state, false, random));
    return render(folder, {"--resume"});
}

Command make_set(const Seeds&, const fs::path& folder, Random& random) {
    static const std::vector<std::string> keys = {"fps",
                                                  "frames",
                                                  "tolerance",
                                                  "tolerance_pixels",
                                                  "bind_frame",
                                                  "camera.fov",
                                                  "camera.shutter",
                                                  "camera.target",
                                                  "camera.up",
                                                  "camera.focus",
                                                  "film.max_depth",
                                                  "film.filter",
                                                  "film.filter_radius",
                                                  "film.noise",
                                                  "film.clamp",
                                                  "film.exposure",
                                                  "film.aovs",
                                                  "film.curve_pieces",
                                                  "film.motion_keys",
                                                  "wind.direction",
                                                  "wind.speed",
                                                  "wind.calm",
                                                  "wind.response",
                                                  "wind.waviness",
                                                  "wind.noise.type",
                                                  "wind.noise.frequency",
                                                  "wind.noise.octaves",
                                                  "wind.noise.loop",
                                                  "wind.gusts.period",
                                                  "wind.gusts.radius_range",
                                                  "wind.gusts.life_range",
                                                  "wind.gusts.control",
                                                  "wind.shielding.spread",
                                                  "wind.shielding.offset",
                                                  "wind.jiggle.frequency",
                                                  "wind.jiggle.damping",
                                                  "wind.collision.solver",
                                                  "wind.collision.clearance",
                                                  "mesh.ball.radius",
                                                  "mesh.ball.transform",
                                                  "mesh.ball.bumps",
                                                  "mesh.ground.size",
                                                  "procedural.grass.length",
                                                  "procedural.grass.width",
                                                  "procedural.grass.lean",
                                                  "procedural.grass.arc",
                                                  "procedural.grass.clump.size",
                                                  "procedural.grass.curl.radius",
                                                  "procedural.grass.basis",
                                                  "procedural.grass.shape",
                                                  "procedural.grass.envelope",
                                                  "procedural.grass.width_profile",
                                                  "procedural.grass.on",
                                                  "procedural.grass.spacing",
                                                  "procedural.grass.density",
                                                  "procedural.gras.count",
                                                  "light.sun",
                                                  "",
                                                  ".",
                                                  "a..b"};
    write_file(folder / "a.toml", scene_text);
    std::vector<std::string> more;
    for (size_t n = 1 + random.below(2); n > 0; --n) {
        std::string key = random.pick(keys);
        if (random.one_in(10)) mutate_once(key, true, random);
        std::string value = random.pick(extremes);
        if (random.one_in(10)) value = mutated(value, true, random);
        if (random.one_in(40)) value = std::string(5000, 'x');
        std::string setting = key + "=" + value;
        std::erase(setting, '\0'); // a NUL would end the argument
        more.insert(more.end(), {"--set", setting});
    }
    return render(folder, more);
}

Command make_options(const Seeds&, const fs::path& folder, Random& random) {
    static const std::vector<std::string> options = {
        "--frame", "--frames", "--spp",    "--size",  "--threads", "--aov",     "--seconds", "--preview",
        "--stats", "-o",       "--resume", "--quiet", "--set",     "--nothing", "--png",     "--memory"};
    static const std::vector<std::string> values = {"depth:0-1",   "normal=/dev/null",
                                                    "depth:1-x=d", "1",
                                                    "0",           "-1",
                                                    "1-3",         "3-1",
                                                    "8x8",         "0x8",
                                                    "x",           "",
                                                    "1e99",        "nan",
                                                    "depth,id",    "depth,",
                                                    "a.png",       "a.exr",
                                                    "/",           "/dev/null",
                                                    "\xff",        "2.5",
                                                    "##",          "4",
                                                    "8x",          "-5-4",
                                                    "beauty",      "p.##.exr",
                                                    "1-9x4,2",     "1-2x",
                                                    "8G",          "8Gb"};
    write_file(folder / "a.toml", scene_text);
    Command command = render(folder, {"--size", "8x6"});
    for (size_t n = 1 + random.below(3); n > 0; --n) {
        command.arguments.push_back(random.pick(options));
        std::string value = random.pick(values);
        if (value.ends_with(".png") || value.ends_with(".exr")) value = folder / value;
        if (!random.one_in(5)) command.arguments.push_back(value);
    }
    command.output = "";
    return command;
}

struct Kind {
    const char* name;
    Maker make;
};
constexpr Kind kinds[] = {{"scene", make_scene},     {"mesh", make_mesh},    {"image", make_image},
                          {"state", make_state},     {"set", make_set},      {"options", make_options},
                          {"terrain", make_terrain}, {"curves", make_curves}};

// ---- One case ----------------------------------------------------------------------------------------------------

struct Settings {
    uint64_t seed = 1;
    size_t cases = 200; // of each kind
    double seconds = 0.0;
    std::string kind;
    long only = -1;
    std::string folder;
    unsigned cpu = 20; // seconds
};

// Runs body in a child process. A library's threads would be missing in later children, which would wait for
// them.
int in_child_process(const std::function<int()>& body) {
    std::fflush(nullptr);
    const pid_t child = ::fork();
    if (child == 0) {
        const int code = body();
        std::fflush(nullptr);
        ::_exit(code);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

int run_child(const std::vector<std::string>& arguments, const fs::path& streams, unsigned cpu) {
    return in_child_process([&] {
        const auto limit = [](int resource, rlim_t most) {
            const rlimit both{most, most};
            ::setrlimit(resource, &both);
        };
        limit(RLIMIT_CORE, 0);
        limit(RLIMIT_CPU, cpu);
#ifndef __SANITIZE_ADDRESS__ // it reserves terabytes
        limit(RLIMIT_AS, rlim_t(3) << 30);
#endif
        ::close(STDIN_FILENO);
        ::dup2(::open((streams / "out").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDOUT_FILENO);
        ::dup2(::open((streams / "err").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDERR_FILENO);
        if (::chdir(streams.c_str()) != 0) return 120;
        std::vector<std::string> all = {"marram"};
        all.insert(all.end(), arguments.begin(), arguments.end());
        std::vector<char*> argv;
        for (std::string& argument : all) argv.push_back(argument.data());
        argv.push_back(nullptr);
        return run(int(all.size()), argv.data());
    });
}

// The fault of a message; "" if it has none.
std::string message_fault(const std::string& err) {
    constexpr size_t longest = 2200;
    if (err.empty()) return "exit code 2 and not a word";
    for (size_t begin = 0; begin < err.size();) {
        const size_t end = std::min(err.find('\n', begin), err.size());
        if (end - begin > longest) return "a line of more than 2200 bytes";
        size_t parts = 0;
        for (size_t at = err.find(": ", begin); at < end; at = err.find(": ", at + 1)) ++parts;
        if (parts < 2) return "a line that does not say place, what is wrong and what to do";
        for (size_t i = begin; i < end; ++i)
            if (static_cast<unsigned char>(err[i]) < 32) return "a control character in a message";
        begin = end + 1;
    }
    return "";
}

std::string fault_of(const Command& command, int code, const fs::path& folder,
                     const std::map<std::string, std::string>& before, const std::string& err) {
    if (code == 128 + SIGXCPU || code == 128 + SIGKILL) return "too slow";
    if (code > 127) return fmt::format("ended by signal {}", code - 128);
    const bool compares = command.arguments[0] == "compare";
    if (code != 0 && code != 2 && !(code == 1 && compares)) return fmt::format("exit code {}", code);
    for (const auto& [name, bytes] : before)
        if (!name.ends_with(".state.tif") && read_file(folder / name) != bytes) return name + " was changed";
    for (const auto& entry : fs::directory_iterator(folder)) {
        const std::string name = entry.path().filename();
        if (name.find(".marram-writing-") != std::string::npos) return name + " was left";
        if (code == 2 && (name.ends_with(".exr") || name.ends_with(".png")) && !before.contains(name))
            return name + " was written and yet the exit code is 2";
    }
    if (code == 2) return message_fault(err);
    const auto reads = [&] {
        try {
            read_image(command.output);
            return 0;
        } catch (const InputError&) {
            return 1;
        }
    };
    return command.output.empty() || in_child_process(reads) == 0 ? "" : "the picture cannot be read";
}

// Returns whether the case passes.
bool run_case(const Seeds& seeds, const Settings& settings, size_t kind, uint64_t number) {
    const fs::path base =
        fs::path(settings.folder) / fmt::format("{}-{}-{}", kinds[kind].name, settings.seed, number);
    const fs::path folder = base / "in", streams = base / "streams";
    fs::create_directories(folder);
    fs::create_directories(streams);
    Random random{hash(hash(hash(settings.seed, kind), number), 1)};
    const Command command = kinds[kind].make(seeds, folder, random);
    std::map<std::string, std::string> before;
    for (const auto& entry : fs::directory_iterator(folder))
        before[entry.path().filename()] = read_file(entry.path());
    const int code = run_child(command.arguments, streams, settings.cpu);
    const std::string err = read_file(streams / "err"), fault = fault_of(command, code, folder, before, err);
    if (fault.empty() && settings.only < 0) {
        fs::remove_all(base);
        return true;
    }
    fmt::print("{} {}: {}\n  again: marram_fuzz --seed {} --kind {} --case {}\n  files: {}\n  stderr: {}\n",
               kinds[kind].name, number, fault.empty() ? "holds" : fault, settings.seed, kinds[kind].name,
               number, base.string(), err.substr(0, 300));
    std::fflush(stdout);
    return fault.empty();
}

Seeds make_seeds(const Settings& settings) {
    const fs::path folder = fs::path(settings.folder) / "seeds";
    fs::create_directories(folder);
    Seeds seeds;
    in_child_process([&] {
        std::vector<float> pixels;
        for (int i = 0; i < 3 * 16 * 8; ++i) pixels.push_back(float(i % 17) / 17.0F);
        const Layer layers[] = {{"", {"R", "G", "B"}, pixels.data(), true}};
        write_exr(folder / "a.exr", 16, 8, layers, {});
        write_png(folder / "a.png", 16, 8, 3, pixels.data(), 0.0);
        return 0;
    });
    seeds.exr = read_file(folder / "a.exr");
    seeds.png = read_file(folder / "a.png");
    seeds.state_scene = scene_text;
    write_file(folder / "a.toml", seeds.state_scene);
    Command command = render(folder, {"--seconds", "0.001", "--spp", "64"});
    run_child(command.arguments, folder, settings.cpu);
    seeds.state = read_file(folder / "out.exr.state.tif");
    if (seeds.state.empty())
        fmt::print(stderr, "there is no state to mutate: {}\n", read_file(folder / "err"));
    return seeds;
}

// Runs every `workers`-th case. Returns the number of failures.
int run_share(const Seeds& seeds, const Settings& settings, unsigned worker, unsigned workers) {
    using Clock = std::chrono::steady_clock;
    const auto end = Clock::now() + std::chrono::duration<double>(settings.seconds);
    int findings = 0;
    for (uint64_t number = worker; settings.seconds > 0.0 ? Clock::now() < end : number < settings.cases;
         number += workers)
        for (size_t kind = 0; kind < std::size(kinds); ++kind)
            if (settings.kind.empty() || settings.kind == kinds[kind].name)
                findings += !run_case(seeds, settings, kind, number);
    return std::min(findings, 100);
}

int fuzz(Settings settings) {
    const bool temporary = settings.folder.empty();
    if (temporary) {
        std::string name = (fs::temp_directory_path() / "marram_fuzz_XXXXXX").string();
        settings.folder = ::mkdtemp(name.data());
    }
    const Seeds seeds = make_seeds(settings);
    int findings = 0;
    if (settings.only >= 0) {
        for (size_t kind = 0; kind < std::size(kinds); ++kind)
            if (settings.kind == kinds[kind].name)
                findings = !run_case(seeds, settings, kind, uint64_t(settings.only));
        return findings;
    }
    const unsigned workers = std::max(1U, std::thread::hardware_concurrency());
    load_image_library(); // once, or each child would load it again
    std::vector<pid_t> children;
    for (unsigned w = 0; w < workers; ++w) {
        std::fflush(nullptr);
        children.push_back(::fork());
        if (children.back() == 0) ::_exit(run_share(seeds, settings, w, workers));
    }
    for (const pid_t child : children) {
        int status = 0;
        ::waitpid(child, &status, 0);
        findings += WIFEXITED(status) ? WEXITSTATUS(status) : 1;
    }
    fmt::print("{} findings\n", findings);
    if (temporary && findings == 0) fs::remove_all(settings.folder);
    return findings > 0;
}

} // namespace
} // namespace marram

int main(int argc, char** argv) {
    marram::Settings settings;
    CLI::App app("Mutated inputs through the whole program: what is not taken gracefully is printed.");
    app.add_option("--seed", settings.seed, "other cases for each");
    app.add_option("--cases", settings.cases, "of each kind");
    app.add_option("--seconds", settings.seconds, "run that long instead");
    app.add_option("--kind", settings.kind, "scene, mesh, image, state, set or options; default: all");
    app.add_option("--case", settings.only, "only this one; needs --kind");
    app.add_option("--folder", settings.folder,
                   "for its files; default: a temporary one, removed where nothing was found");
    app.add_option("--cpu", settings.cpu, "seconds of processor time that a case may take");
    CLI11_PARSE(app, argc, argv);
    return marram::fuzz(settings);
}
