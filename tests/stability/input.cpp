// SPDX-License-Identifier: Apache-2.0
// NaN and infinity anywhere in the input: the program reports the place, exits with 2 and writes nothing. The
// parameters are queried from the procedural, so new ones are covered automatically.
#include "procedural/strands/grown/groom_settings.h"
#include "procedural/wind/wind.h"
#include "tests/stability/table.h"
#include "tests/unit/cli/program.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <map>

namespace marram::stability {
namespace {

using testing::Folder;
using testing::ProgramResult;

const char* const bad_numbers[] = {"nan", "inf", "-inf"};

// The value of a parameter with every number bad; "" if the type has no numbers.
std::string bad_value(MarramParamType type, const std::string& bad) {
    switch (type) {
    case MARRAM_INTEGER:
    case MARRAM_NUMBER:
        return bad;
    case MARRAM_VEC2:
        return "[1, " + bad + "]";
    case MARRAM_RANGE:
        return "[0, " + bad + "]";
    case MARRAM_VEC3:
    case MARRAM_COLOR:
        return "[0, " + bad + ", 1]";
    case MARRAM_RAMP:
        return "[[0, 0], [0.5, " + bad + "], [1, 1]]";
    case MARRAM_KEYS:
        return "[{frame = 1, translate = [0, " + bad + ", 0]}]";
    default:
        return "";
    }
}

struct Line {
    std::string key, text;
};

// The scene with these lines, one parameter each, in [wind], the groom, or a table of a list.
struct Bad {
    std::string text;
    std::vector<std::pair<int, std::string>> lines; // number, key
};
Bad scene_of(const std::string& head, const std::vector<Line>& lines, const std::string& tail) {
    Bad bad{head, {}};
    int number = 1 + int(std::count(head.begin(), head.end(), '\n'));
    for (const Line& line : lines) {
        bad.text += line.text + "\n";
        bad.lines.emplace_back(number++, line.key);
    }
    bad.text += tail;
    return bad;
}

// Number of bad lines that are not reported by line with exit code 2; also counts a run that writes
// something.
int count_unreported(const Bad& bad, const std::string& what) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", bad.text);
    folder.write("old.exr", "an old picture");
    const auto before = folder.contents();
    const ProgramResult outcome = testing::marram({"render", scene, "-o", folder / "old.exr"});
    int count = 0;
    if (outcome.code != 2 || folder.contents() != before || !outcome.out.empty()) {
        ADD_FAILURE() << what << ": exit code " << outcome.code << "\n" << outcome.err;
        ++count;
    }
    for (const auto& [line, key] : bad.lines)
        if (outcome.err.find("a.toml:" + std::to_string(line) + ":") == std::string::npos) {
            std::printf("  %s: line %d is passed over: %s\n", what.c_str(), line, key.c_str());
            ++count;
        }
    return count;
}

// The same in scenes of so few bad lines that each is reported: a scene's list of mistakes ends.
int count_unreported(const std::string& head, const std::vector<Line>& lines, const std::string& tail,
                     const std::string& what) {
    constexpr size_t at_once = 40;
    int count = 0;
    for (size_t i = 0; i < lines.size(); i += at_once) {
        const std::vector<Line> part(lines.begin() + long(i),
                                     lines.begin() + long(std::min(i + at_once, lines.size())));
        count += count_unreported(scene_of(head, part, tail), what);
    }
    return count;
}

const std::string head =
    "frames = [1, 10]\n[camera]\nposition = [0, 1, 4]\ntarget = [0, 0.2, 0]\n[film]\n"
    "size = [24, 16]\nsamples = 2\n[[light]]\ntype = \"sky\"\n[[mesh]]\nname = \"ground\"\n"
    "type = \"plane\"\nsize = [2, 2]\n";
const std::string groom_head = "[[procedural]]\nname = \"grass\"\ntype = \"groom\"\non = \"ground\"\n";
const std::string groom_rest = "count = 300\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n";
const std::string plain_wind = "[wind]\nspeed = 6\n";

TEST(Input, NotANumberInAnyParameterOfTheWind) {
    int tried = 0, passed = 0;
    for (const std::string bad : bad_numbers) {
        std::vector<Line> lines, keyed;
        std::map<std::string, std::vector<Line>> lists; // "gusts.control": lines of one of its tables
        for (const MarramParam& param : wind_params()) {
            const std::string value = bad_value(param.type, bad), name = param.name;
            if (value.empty()) continue;
            const size_t list = name.find("[].");
            if (list == std::string::npos)
                lines.push_back({name, name + " = " + value});
            else
                lists[name.substr(0, list)].push_back({name, name.substr(list + 3) + " = " + value});
            if (list == std::string::npos && param.keyable)
                keyed.push_back({name, name + " = { keys = [[1, " + value + "]] }"});
        }
        tried += int(lines.size() + keyed.size());
        passed += count_unreported(head + "[wind]\n", lines, groom_head + groom_rest, "wind, " + bad);
        passed += count_unreported(head + "[wind]\n", keyed, groom_head + groom_rest, "keys, " + bad);
        for (const auto& [list, of_one] : lists) {
            tried += int(of_one.size());
            passed += count_unreported(
                scene_of(head + plain_wind + "[[wind." + list + "]]\n", of_one, groom_head + groom_rest),
                list + ", " + bad);
        }
    }
    std::printf("  %d values in the wind\n", tried);
    EXPECT_GT(tried, 100);
    none("NaN and infinity in the wind: not refused", passed, "values");
}

TEST(Input, NotANumberInAnyParameterOfAGroom) {
    int tried = 0, passed = 0;
    for (const std::string bad : bad_numbers) {
        std::vector<Line> lines;
        std::map<std::string, std::vector<Line>> lists; // one element per parameter, each on its own line
        for (const MarramParam& param : groom_params()) {
            const std::string value = bad_value(param.type, bad), name = param.name;
            const size_t list = name.find("[].");
            if (value.empty()) continue;
            if (list == std::string::npos)
                lines.push_back({name, name + " = " + value});
            else
                lists[name.substr(0, list)].push_back(
                    {name, "{ " + name.substr(list + 3) + " = " + value + " },"});
        }
        passed += count_unreported(head + plain_wind + groom_head, lines, "", "groom, " + bad);
        tried += int(lines.size());
        std::vector<Line> of_lists;
        for (const auto& [list, elements] : lists)
            for (size_t i = 0; i < elements.size(); ++i)
                of_lists.push_back({elements[i].key, (i == 0 ? list + " = [" : "") + elements[i].text +
                                                         (i + 1 == elements.size() ? "]" : "")});
        tried += int(of_lists.size());
        passed += count_unreported(scene_of(head + plain_wind + groom_head, of_lists, ""), "groom, " + bad);
    }
    std::printf("  %d values in the groom\n", tried);
    EXPECT_GT(tried, 60);
    none("NaN and infinity in a groom: not refused", passed, "values");
}

// The key that makes a parameter take effect.
std::string companion(const std::string& name) {
    if (name.starts_with("collision.") && name != "collision.solver") return "collision.solver = \"exact\"\n";
    if (name.starts_with("shielding.") && name != "shielding.shield") return "shielding.shield = 1\n";
    if (name.starts_with("jiggle.") && name != "jiggle.frequency") return "jiggle.frequency = 2\n";
    if (name.starts_with("gusts.") && name != "gusts.num_gusts") return "gusts.num_gusts = 3\n";
    return "";
}

TEST(Input, OneBadNumberAloneIsRefused) {
    // In the tests above, one error could hide that another is only its consequence.
    std::vector<Bad> scenes;
    for (const MarramParam& param : wind_params()) {
        const std::string value = bad_value(param.type, "nan"), name = param.name;
        if (!value.empty() && name.find("[].") == std::string::npos)
            scenes.push_back(scene_of(head + "[wind]\n" + companion(name), {{name, name + " = " + value}},
                                      groom_head + groom_rest));
    }
    EXPECT_GT(scenes.size(), 30u);
    std::atomic<int> passed = 0;
    tbb::parallel_for(size_t(0), scenes.size(),
                      [&](size_t i) { passed += count_unreported(scenes[i], "alone"); });
    none("one NaN alone in the wind: not refused", passed, "values");
}

TEST(Input, NotANumberElsewhere) {
    int passed = 0;
    for (const std::string bad : bad_numbers) {
        passed +=
            count_unreported(scene_of("frames = [1, 10]\n[camera]\n",
                                      {{"position", "position = [0, " + bad + ", 4]"},
                                       {"target", "target = [" + bad + ", 0, 0]"},
                                       {"fov", "fov = " + bad},
                                       {"focus", "focus = " + bad}},
                                      "[film]\nsize = [24, 16]\n" + groom_head + groom_rest +
                                          "[[mesh]]\nname = \"ground\"\ntype = \"plane\"\nsize = [2, 2]\n"),
                             "camera, " + bad);
        for (const Line& line : {Line{"size", "size = [1, 1, " + bad + "]"},
                                 Line{"translate", "transform = { translate = [0, " + bad + ", 0] }"},
                                 Line{"rotate", "transform = { rotate = [" + bad + ", 0, 0] }"},
                                 Line{"scale", "transform = { scale = [1, 1, " + bad + "] }"},
                                 Line{"frame", "transform = { keys = [{ frame = " + bad + " }] }"}})
            passed += count_unreported(
                scene_of(head + "[[mesh]]\nname = \"box\"\ntype = \"box\"\n", {line}, ""), "mesh, " + bad);
    }
    none("NaN and infinity in camera and meshes: not refused", passed, "values");
}

TEST(Input, NotANumberInTheCornersOfAMesh) {
    int passed = 0;
    for (const std::string bad : {"nan", "inf", "-inf", "1e39"}) {
        const Folder folder;
        folder.write("m.obj", "v 0 0 0\nv 1 0 0\nv 0 " + bad + " 1\nf 1 2 3\n");
        folder.write(
            "m.ply",
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 " +
                bad + " 1\n3 0 1 2\n");
        for (const std::string file : {"m.obj", "m.ply"}) {
            const std::string scene = folder.write(
                "a.toml", head + "[[mesh]]\nname = \"bad\"\ntype = \"file\"\nfile = \"" + file + "\"\n");
            const auto before = folder.contents();
            const ProgramResult outcome = testing::marram({"render", scene, "-o", folder / "new.exr"});
            const bool refused = outcome.code == 2 && folder.contents() == before &&
                                 outcome.err.find(file + ":") != std::string::npos;
            if (!refused)
                std::printf("  %s with %s: exit code %d, %s\n", file.c_str(), bad.c_str(), outcome.code,
                            outcome.err.c_str());
            passed += !refused;
        }
    }
    none("NaN and infinity in a mesh file: not refused", passed, "files");
}

} // namespace
} // namespace marram::stability
