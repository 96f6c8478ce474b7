// SPDX-License-Identifier: Apache-2.0
#include "core/scene/suggest.h"

#include <gtest/gtest.h>

namespace marram {
namespace {

TEST(Suggest, FindsTheNearest) {
    const std::vector<std::string> names = {"speed", "direction", "fov", "up"};
    EXPECT_EQ(nearest("sped", names), "speed");
    const std::vector<std::string> film = {"size", "samples", "max_depth"};
    EXPECT_EQ(nearest("spp", film), "samples"); // as other renderers say
    EXPECT_EQ(nearest("bounces", film), "max_depth");
    EXPECT_EQ(nearest("spp", names), "");
    EXPECT_EQ(nearest("SPEED", names), "speed");
    EXPECT_EQ(nearest("psede", names), "speed"); // two transpositions
    EXPECT_EQ(nearest("dierction", names), "direction");
    EXPECT_EQ(nearest("fob", names), "fov");
    EXPECT_EQ(nearest("abc", names), "");
    EXPECT_EQ(nearest("x", names), ""); // every short word is one edit away from another
    EXPECT_EQ(nearest("", names), "");
    EXPECT_EQ(nearest(std::string(1 << 24, 'x'), names), "");
}

TEST(Suggest, ListsWhatIsKnown) {
    const std::vector<std::string> names = {"a1", "b2", "c3", "d4", "e5", "f6", "g7", "h8", "i9"};
    EXPECT_EQ(hint("zzzz", names, "x"), "known are a1, b2, c3, d4, e5, f6, g7, h8 and 1 more");
    EXPECT_EQ(hint("zzzz", {}, "mesh in the scene"), "there is no mesh in the scene");
}

TEST(Suggest, MakesTextFitToPrint) {
    EXPECT_EQ(clean("a\n\x1B[31mb"), "a??[31mb");
    EXPECT_EQ(clean(std::string(59, 'a') + "\xC3\xA9t\xC3\xA9"), std::string(59, 'a') + "...");
    EXPECT_EQ(split("a|b||c", '|'), (std::vector<std::string>{"a", "b", "", "c"}));
    EXPECT_TRUE(split("", '|').empty());
}

} // namespace
} // namespace marram
