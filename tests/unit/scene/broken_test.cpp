// SPDX-License-Identifier: Apache-2.0
// Every file in tests/broken/scenes begins with the list of its mistakes, one per line, and contains no
// others:
//   # expect: LINE:COLUMN: part of the message
#include "scene_test.h"

#include <algorithm>
#include <gtest/gtest.h>

namespace marram {
namespace {

std::vector<std::filesystem::path> corpus() {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(MARRAM_SOURCE_DIR "/tests/broken/scenes"))
        if (entry.path().extension() == ".toml") files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    return files;
}

// "LINE:COLUMN: part of the message"
std::vector<std::string> expectations(const std::filesystem::path& file) {
    const std::string mark = "# expect: ";
    std::vector<std::string> lines;
    std::ifstream in(file);
    for (std::string line; std::getline(in, line) && line.starts_with(mark);)
        lines.push_back(line.substr(mark.size()));
    return lines;
}

TEST(BrokenScenes, AreExplained) {
    const Schema schema = test_schema();
    const auto files = corpus();
    EXPECT_GE(files.size(), 45u);
    for (const std::filesystem::path& file : files) {
        SCOPED_TRACE(file.filename().string());
        const auto expected = expectations(file);
        const auto found = mistakes(file.string(), {}, schema);
        std::string all;
        for (const std::string& line : found) all += line + "\n";
        EXPECT_FALSE(expected.empty());
        ASSERT_EQ(found.size(), expected.size()) << all;
        for (size_t i = 0; i < found.size(); ++i) {
            const size_t space = expected[i].find(' ');
            const std::string place = file.string() + ":" + expected[i].substr(0, space + 1);
            EXPECT_TRUE(found[i].starts_with(place)) << found[i] << "\n  expected at " << expected[i];
            EXPECT_NE(found[i].find(expected[i].substr(space + 1)), std::string::npos)
                << found[i] << "\n  expected " << expected[i];
        }
    }
}

} // namespace
} // namespace marram
