// SPDX-License-Identifier: Apache-2.0
// `marram sheet`: its output and errors. The contents of a sheet: tests/unit/image/sheet_test.cpp.
#include "program.h"

namespace marram::testing {
namespace {

TEST(SheetCommand, MakesAPictureOfASequence) {
    const Folder folder;
    const std::string scene =
        folder.write("a.toml", SceneText{.film = "size = [24, 16]\nsamples = 1\nmax_depth = 1\n"});
    EXPECT_DONE(marram({"render", scene, "-o", folder / "f.##.exr", "--frames", "1-9x4"}));
    const std::vector<std::string> command = {
        "sheet", folder / "f.01.exr", folder / "f.05.exr", folder / "f.09.exr", "--width", "320", "--quiet"};
    const auto with = [&](std::vector<std::string> more) {
        more.insert(more.begin(), command.begin(), command.end());
        return marram(more);
    };
    const ProgramResult done = with({"-o", folder / "s.png"});
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.out, folder / "s.png" + "\n");
    EXPECT_EQ(done.err, "");
    EXPECT_DONE(with({"-o", folder / "frames.png", "--captions", "frame"}));
    EXPECT_DONE(with({"-o", folder / "names.png", "--captions", "name", "--columns", "3"}));
    EXPECT_DONE(with({"-o", folder / "plain.png", "--captions", "none"}));
    EXPECT_TRUE(same_picture(folder / "s.png", folder / "frames.png"));
    EXPECT_EQ(read_image(folder / "s.png").width, 320);
    EXPECT_GT(read_image(folder / "s.png").height, read_image(folder / "plain.png").height);
    EXPECT_LT(read_image(folder / "names.png").height, read_image(folder / "plain.png").height);
}

TEST(SheetCommand, RefusesWithoutTouchingAFile) {
    const Folder folder;
    const float grey[] = {0.5F, 0.5F, 0.5F};
    write_png(folder / "a.png", 1, 1, 3, grey, 0.0);
    folder.write("text.png", "no picture");
    folder.write("s.png", "what stood there before");
    const auto before = folder.contents();
    const auto refuse = [&](std::vector<std::string> more, const std::string& message) {
        more.insert(more.begin(), "sheet");
        const ProgramResult refused = marram(more, run_copy);
        EXPECT_EQ(refused.code, 2);
        EXPECT_EQ(lines(refused.err).size(), 1u) << refused.err;
        EXPECT_CONTAINS(refused.err, message);
        EXPECT_TRUE(folder.contents() == before);
    };
    refuse({"-o", folder / "s.png"}, "pictures");
    refuse({folder / "a.png", "-o", folder / "s.exr"}, "a sheet is written as PNG");
    refuse({folder / "a.png", "-o", folder / "a.png"}, "this would overwrite");
    refuse({folder / "a.png", folder / "none.png", "-o", folder / "s.png"}, "none.png");
    refuse({folder / "a.png", folder / "text.png", "-o", folder / "s.png"}, "text.png");
    refuse({folder / "a.png", "-o", folder / "no/s.png"}, "does not exist");
    refuse({folder / "a.png", "-o", folder / "s.png", "--columns", "0"}, "--columns");
    refuse({folder / "a.png", "-o", folder / "s.png", "--captions", "all"}, "--captions");
    refuse({folder / "a.png", "-o", folder / "s.png", "--font", "none.ttf"}, "this font cannot be read");
    refuse({folder / "a.png", folder / "a.png", "-o", folder / "s.png", "--columns", "2", "--width", "60"},
           "too narrow: give fewer --columns, or a --width of 88 or more");
}

} // namespace
} // namespace marram::testing
