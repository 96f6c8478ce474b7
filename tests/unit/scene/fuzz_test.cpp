// SPDX-License-Identifier: Apache-2.0
// Loading any file ends with a description or with an InputError that has printable lines.
#include "scene_test.h"

#include <gtest/gtest.h>
#include <random>

namespace marram {
namespace {

// Bytes, lines and words with a meaning in TOML or in a scene.
const std::vector<std::string> pieces = {"[",
                                         "]",
                                         "[[",
                                         "]]",
                                         "{",
                                         "}",
                                         "=",
                                         ".",
                                         ",",
                                         "\"",
                                         "\"\"\"",
                                         "'",
                                         "#",
                                         "\n",
                                         "\r",
                                         "nan",
                                         "-inf",
                                         "1e308",
                                         "-1",
                                         "0",
                                         "true",
                                         "\\u",
                                         "\\",
                                         "\xFF",
                                         "\xC3",
                                         "name",
                                         "type",
                                         "mesh",
                                         "wind",
                                         "noise",
                                         "[1, 2]",
                                         "{ }",
                                         "1e-320",
                                         "''",
                                         "keys",
                                         "frame",
                                         "\xEF\xBB\xBF",
                                         "[[mesh]]\n",
                                         "[wind]\n",
                                         "9223372036854775807",
                                         std::string(1, '\0'),
                                         "[[1, 2], 3]"};

std::string mutated(std::string text, std::mt19937& random) {
    auto below = [&](size_t n) { return std::uniform_int_distribution<size_t>(0, n - 1)(random); };
    for (size_t count = 1 + below(4); count > 0 && !text.empty(); --count) {
        const size_t at = below(text.size());
        switch (below(5)) {
        case 0:
            text[at] = static_cast<char>(below(256));
            break;
        case 1:
            text.erase(at, 1 + below(12));
            break;
        case 2:
            text.insert(at, pieces[below(pieces.size())]);
            break;
        case 3:
            text.insert(at, text.substr(below(text.size()), below(200)));
            break;
        case 4:
            text.resize(at);
            break;
        }
    }
    return text;
}

TEST(Fuzz, MutatedScenesEndInADescriptionOrAnInputError) {
    const Schema schema = test_schema();
    const Folder folder;
    folder.write("mesh.obj", "");
    folder.write("sky.exr", "");
    std::mt19937 random(1);
    int good = 0, bad = 0;
    for (int i = 0; i < 600; ++i) {
        const std::string text = mutated(full_scene, random);
        std::vector<std::string> settings;
        if (i % 3 == 0)
            settings = {mutated("procedural.grass.wind.speed=3", random),
                        mutated("film.size=[3, 4]", random)};
        try {
            load_scene(folder.write("a.toml", text), settings, schema);
            ++good;
        } catch (const InputError& error) {
            ++bad;
            ASSERT_FALSE(error.problems.empty());
            for (const Problem& problem : error.problems) {
                EXPECT_FALSE(problem.what.empty() || problem.fix.empty());
                EXPECT_EQ(to_string(problem).find('\n'), std::string::npos);
            }
        }
    }
    EXPECT_GT(good, 0); // most mutations fail in the parser; the test below gets past it
    EXPECT_GT(bad, 300);
}

// Replaces every value of a good scene by every kind of value. All variants parse, so this tests the checks
// after the parser.
TEST(Fuzz, SwappedValuesEndInADescriptionOrAnInputError) {
    const Schema schema = test_schema();
    const Folder folder;
    folder.write("mesh.obj", "");
    folder.write("sky.exr", "");
    const std::vector<std::string> values = {"nan",
                                             "-inf",
                                             "1e308",
                                             "-1",
                                             "9223372036854775807",
                                             "true",
                                             "''",
                                             "'x'",
                                             "[]",
                                             "{}",
                                             "[[]]",
                                             "[1, 2, 3]",
                                             "[{}]",
                                             "[[1, nan]]",
                                             "1979-05-27",
                                             "{ keys = [{ frame = 1e9 }] }"};
    int loads = 0;
    for (size_t line = 0; line < full_scene.size();) {
        const size_t end = full_scene.find('\n', line), equals = full_scene.find(" = ", line);
        if (equals < end) {
            for (const std::string& value : values) {
                const std::string text = full_scene.substr(0, equals + 3) + value + full_scene.substr(end);
                for (const std::string& mistake : mistakes(folder.write("a.toml", text), {}, schema))
                    EXPECT_EQ(mistake.find("mistake in the"), std::string::npos) << mistake;
                ++loads;
            }
        }
        line = end + 1;
    }
    EXPECT_GT(loads, 500);
}

} // namespace
} // namespace marram
