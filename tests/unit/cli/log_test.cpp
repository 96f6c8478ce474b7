// SPDX-License-Identifier: Apache-2.0
// --log: every message as text, with its time, or as a JSON object.
#include "program.h"

#include <nlohmann/json.hpp>

#include <regex>

namespace marram::testing {
namespace {

std::vector<nlohmann::json> objects(const std::string& text) {
    static const std::regex time(R"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z)");
    std::vector<nlohmann::json> all;
    for (const std::string& line : lines(text)) {
        all.push_back(nlohmann::json::parse(line));
        EXPECT_NE(all.back()["id"], "") << line;
        for (const char* key : {"level", "id", "file", "line", "column"})
            EXPECT_TRUE(all.back().contains(key)) << line;
        EXPECT_TRUE(std::regex_match(all.back().at("time").get<std::string>(), time)) << line;
        EXPECT_NE(all.back().contains("text"), all.back().contains("what") && all.back().contains("fix"))
            << line;
    }
    return all;
}

TEST(Log, HasMistakesWithTheirPlaces) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", std::string(SceneText{}) + "[films]\n[cameras]\n");
    const ProgramResult text = marram({"render", scene}), json = marram({"render", scene, "--log", "json"});
    EXPECT_EQ(json.code, 2);
    EXPECT_EQ(json.out, "");
    const std::vector<nlohmann::json> all = objects(json.err);
    const std::vector<std::string> expected = lines(text.err);
    ASSERT_EQ(all.size(), expected.size());
    ASSERT_GE(all.size(), 2u);
    for (size_t i = 0; i < all.size(); ++i) {
        EXPECT_EQ(all[i]["level"], "error");
        EXPECT_EQ(all[i]["file"], scene);
        EXPECT_EQ(fmt::format("{}:{}:{}: {}: {}", scene, all[i]["line"].get<int>(),
                              all[i]["column"].get<int>(), all[i]["what"].get<std::string>(),
                              all[i]["fix"].get<std::string>()),
                  expected[i]);
    }
}

TEST(Log, HasWarningsAndInformation) {
    const Folder folder;
    SceneText dark;
    dark.film = "size = [4, 4]\nsamples = 1\naovs = [\"depth\"]\n";
    const std::string scene = folder.write("a.toml", dark);
    const std::vector<std::string> command = {"render", scene, "-o", folder / "a.png", "--log=json"};
    const ProgramResult first = marram(command);
    EXPECT_EQ(first.code, 0) << first.err;
    EXPECT_EQ(first.out, folder / "a.png" + "\n") << "results stay as they are";
    const std::vector<nlohmann::json> warnings = objects(first.err);
    ASSERT_EQ(warnings.size(), 1u) << first.err;
    EXPECT_EQ(warnings[0]["level"], "warning");
    EXPECT_EQ(warnings[0]["file"], scene);
    EXPECT_GT(warnings[0]["line"], 0);
    EXPECT_EQ(warnings[0]["id"], "film.unwritten_layers");
    EXPECT_EQ(warnings[0]["what"], "film.aovs: not written: depth: a PNG holds the picture alone");
    EXPECT_CONTAINS(warnings[0]["fix"].get<std::string>(), "write an .exr");
    std::vector<std::string> again = command;
    again.emplace_back("--resume");
    const ProgramResult second = marram(again);
    const std::vector<nlohmann::json> both = objects(second.err);
    ASSERT_EQ(both.size(), 2u) << second.err;
    EXPECT_EQ(both[1]["level"], "info");
    EXPECT_EQ(both[1]["file"], folder / "a.png");
    EXPECT_EQ(both[1]["text"], folder / "a.png" + ": is there already");
}

// Their ids, and places apart from their lines; notes, too, which are shown at once.
TEST(Log, HasWhatProceduralsSay) {
    const Folder folder;
    SceneText text;
    text.wind += "collision = { solver = \"exact\" }\n";
    text.more = "[[mesh]]\nname = \"house\"\ntype = \"box\"\nsize = [1, 1, 1]\n";
    const std::string scene = folder.write("a.toml", text);
    const ProgramResult done = marram({"render", scene, "-o", folder / "a.png", "--log", "json"});
    const std::vector<nlohmann::json> all = objects(done.err);
    ASSERT_FALSE(all.empty());
    for (const nlohmann::json& one : all) {
        EXPECT_EQ(one["file"], scene) << one;
        EXPECT_GT(one["line"], 0) << one;
        EXPECT_NE(one["id"], "") << one;
        EXPECT_TRUE(one.contains("what")) << one;
    }
}

TEST(Log, HasMistakesOfTheCommandLine) {
    for (const std::vector<std::string>& command :
         std::vector<std::vector<std::string>>{{"render", "a.toml", "--unknown", "--log", "json"},
                                               {"render", "--log=json"},
                                               {"rendr", "--log", "json"},
                                               {"render", "a.toml", "--frames", "3-1", "--log", "json"},
                                               {"compare", "none.exr", "none.exr", "--log", "json"},
                                               {"info", "nothing", "--log", "json"}}) {
        const ProgramResult done = marram(command);
        EXPECT_EQ(done.code, 2);
        const std::vector<nlohmann::json> all = objects(done.err);
        ASSERT_FALSE(all.empty()) << command.front();
        EXPECT_EQ(all[0]["level"], "error");
    }
    EXPECT_EQ(marram({"rendr"}).err, "marram: there is no command \"rendr\": did you mean \"render\"?\n");
    EXPECT_CONTAINS(marram({"render", "a.toml", "--log", "xml"}).err, "xml not in {text,time,json}");
}

// Bytes that are no UTF-8 and characters that would end a line.
TEST(Log, IsValidJsonWhateverIsQuoted) {
    const Folder folder;
    const std::string scene = folder.write("a\n\"\xff\\.toml", "frames = \"\xc3\n");
    const ProgramResult done = marram({"render", scene, "--log", "json"});
    EXPECT_EQ(done.code, 2);
    EXPECT_FALSE(objects(done.err).empty());
}

TEST(Log, HasTheTimeBeforeEachLine) {
    const ProgramResult done = marram({"rendr", "--log", "time"});
    EXPECT_TRUE(std::regex_match(
        done.err,
        std::regex(R"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z marram: there is no command "rendr": .*\n)")))
        << done.err;
}

} // namespace
} // namespace marram::testing
