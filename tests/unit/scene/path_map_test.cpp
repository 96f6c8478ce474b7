// SPDX-License-Identifier: Apache-2.0
// Path mapping: which rule matches, and what files of rules may contain.
#include "core/scene/path_map.h"
#include "scene_test.h"

#include <random>

namespace marram {
namespace {

PathMap map_of(const std::vector<std::string>& rules) {
    PathMap map;
    for (const std::string& rule : rules) map.rules.push_back(parse_path_rule(rule));
    return map;
}

TEST(PathMapping, ReplacesWholePartsAtTheBeginning) {
    const PathMap map = map_of({"/show=/mnt/show", "maps=/fast/maps"});
    EXPECT_EQ(map.apply("/show/hill.obj"), "/mnt/show/hill.obj");
    EXPECT_EQ(map.apply("/show"), "/mnt/show");
    EXPECT_EQ(map.apply("/show//a/./b.obj"), "/mnt/show/a/b.obj");
    EXPECT_EQ(map.apply("/shows/hill.obj"), "/shows/hill.obj");
    EXPECT_EQ(map.apply("show/hill.obj"), "show/hill.obj");
    EXPECT_EQ(map.apply("/a/show/hill.obj"), "/a/show/hill.obj");
    EXPECT_EQ(map.apply("/Show/hill.obj"), "/Show/hill.obj");
    EXPECT_EQ(map.apply("maps/a.png"), "/fast/maps/a.png");
    EXPECT_EQ(map.apply("./maps/a.png"), "/fast/maps/a.png");
    EXPECT_EQ(map.apply("/maps/a.png"), "/maps/a.png");
    EXPECT_EQ(map.apply("a.<UDIM>.png"), "a.<UDIM>.png");
}

TEST(PathMapping, TakesTheLongestRule) {
    const PathMap map = map_of({"/=/root", "/a=/one", "/a/b/=/two/", "/a=/late", "/a/bc=/three"});
    EXPECT_EQ(map.apply("/a/b/x"), "/two/x");
    EXPECT_EQ(map.apply("/a/x"), "/one/x");
    EXPECT_EQ(map.apply("/b"), "/root/b");
    EXPECT_EQ(map.apply("/a/bc"), "/three");
    EXPECT_EQ(map_of({"/a=/"}).apply("/a/x"), "/x");
}

TEST(PathMapping, OfWindowsKnowsDrivesSharesAndBothCases) {
    const PathMap map = map_of({R"(P:\Show=/mnt/show)", R"(\\Server\Share=/mnt/share)"});
    EXPECT_EQ(map.apply(R"(p:\SHOW\Maps\hill.PNG)"), "/mnt/show/Maps/hill.PNG");
    EXPECT_EQ(map.apply("P:/show/hill.png"), "/mnt/show/hill.png");
    EXPECT_EQ(map.apply(R"(P:\Shows\hill.png)"), R"(P:\Shows\hill.png)");
    EXPECT_EQ(map.apply(R"(\\server\share\a\b)"), "/mnt/share/a/b");
    EXPECT_EQ(map.apply(R"(\server\share\a)"), R"(\server\share\a)");
    EXPECT_EQ(map_of({"P:=/p"}).apply(R"(P:\x)"), "/p/x");
}

TEST(PathMapping, RefusesWhatIsNoRule) {
    for (const char* text : {"", "a", "=b", "a=", ".=b"})
        EXPECT_THROW(parse_path_rule(text), InputError) << text;
    EXPECT_EQ(parse_path_rule("a=b=c").to, "b=c");
}

class PathMapFile : public ::testing::Test {
  protected:
    std::string problems(const std::string& text) const {
        try {
            read_path_rules(folder.write("map.json", text));
        } catch (const InputError& error) {
            std::string all;
            for (const Problem& problem : error.problems) all += to_string(problem) + "\n";
            return all.substr(std::min(all.find("map.json"), all.size()));
        }
        return "";
    }
    Folder folder;
};

const std::string good_file = R"({
  "version": "pathmapping-1.0",
  "path_mapping_rules": [
    { "source_path_format": "POSIX", "source_path": "/show", "destination_path": "/mnt/show" },
    { "source_path_format": "WINDOWS", "source_path": "p:\\show", "destination_path": "/mnt/win" }
  ]
})";

TEST_F(PathMapFile, OfOpenJdIsRead) {
    const PathMap map{read_path_rules(folder.write("map.json", good_file))};
    ASSERT_EQ(map.rules.size(), 2U);
    EXPECT_EQ(map.apply("/show/a.obj"), "/mnt/show/a.obj");
    EXPECT_EQ(map.apply(R"(P:\Show\a.obj)"), "/mnt/win/a.obj");
    EXPECT_TRUE(
        read_path_rules(folder.write("b.json", R"({"version": "pathmapping-1.0", "path_mapping_rules": []})"))
            .empty());
}

TEST_F(PathMapFile, IsToldItsMistakesWithTheirPlaces) {
    const auto with = [](std::string text, const std::string& what, const std::string& by) {
        return text.replace(text.find(what), what.size(), by);
    };
    const auto at = [&](const std::string& text) {
        const std::string all = problems(text);
        return all.substr(0, all.find(": ", all.find(": ") + 2));
    };
    EXPECT_EQ(at("[]"), "map.json:1:1: is no object");
    EXPECT_EQ(at("{}"), "map.json:1:1: has no version");
    EXPECT_EQ(at(with(good_file, "-1.0", "-2.0")),
              "map.json:2:14: the version is \"pathmapping-2.0\", not \"pathmapping-1.0\"");
    EXPECT_EQ(at(with(good_file, "\"POSIX\"", "\"posit\"")),
              "map.json:4:29: source_path_format of rule 1 is \"posit\"");
    EXPECT_EQ(at(with(good_file, "\"destination_path\": \"/mnt/win\"", "\"destination\": 1")),
              "map.json:5:5: rule 2 has no destination_path");
    EXPECT_EQ(at(with(good_file, "\"/mnt/win\"", "[1, [2], {\"a\": 3}]")),
              "map.json:5:87: destination_path of rule 2 is a list");
    EXPECT_EQ(at(with(good_file, "\"/mnt/win\"", "1e3")),
              "map.json:5:87: destination_path of rule 2 is 1000.0");
    EXPECT_EQ(at(with(good_file, "\"/mnt/show\"", "/mnt")), "map.json:4:82: this is no JSON");
    EXPECT_EQ(at(good_file.substr(0, 40)), "map.json:3:7: the JSON ends in the middle");
    EXPECT_EQ(at(with(good_file, "[\n", "{\n")), "map.json:4:5: this is no JSON");
    EXPECT_NE(problems(""), "");
    EXPECT_THROW(read_path_rules(folder.write("x", "") + ".none"), InputError);
    EXPECT_THROW(read_path_rules(folder.path()), InputError);
}

// Whatever the bytes are: rules or mistakes.
TEST_F(PathMapFile, SurvivesDamage) {
    std::mt19937 random(7);
    for (int i = 0; i < 400; ++i) {
        std::string text = good_file;
        for (int n = int(random() % 4); n >= 0; --n) {
            const size_t at = random() % text.size();
            switch (random() % 3) {
            case 0:
                text.erase(at, random() % 9);
                break;
            case 1:
                text.insert(at, text.substr(random() % text.size(), random() % 30));
                break;
            default:
                text[at] = char(random() % 256);
            }
        }
        problems(text);
    }
    problems(std::string(100'000, '['));
    problems("{\"version\": " + std::string(100'000, '[') + std::string(100'000, ']') + "}");
}

} // namespace
} // namespace marram
