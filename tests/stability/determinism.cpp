// SPDX-License-Identifier: Apache-2.0
// Identical bits after any history, on any number of threads, in any batches: for the chain and for the
// program.
#include "tests/stability/coat.h"
#include "tests/stability/table.h"
#include "tests/unit/cli/program.h"

#include <gtest/gtest.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace marram::stability {
namespace {

using testing::Folder;
using testing::ProgramResult; // for EXPECT_DONE

// A light coat, because jiggle evaluates about fifty knots of history.
const CoatSpec everything{.frame = 240.0, .times = {240.0, 240.25, 240.5}, .jiggle = true};

std::vector<size_t> shuffled(size_t count, uint64_t seed) {
    std::vector<size_t> order(count);
    std::iota(order.begin(), order.end(), size_t(0));
    for (size_t i = count; i > 1; --i) std::swap(order[i - 1], order[size_t(hash(seed, i) % i)]);
    return order;
}

TEST(Determinism, PatchesCutAndOrderedInAnyWay) {
    const Coat coat(everything);
    ChainScratch scratch;
    const auto whole = coat.poses(coat.roots(), 512, scratch);
    std::printf("  %zu strands, %d contacts, %d pushed out, %d skipped pushes, %.3g of %.3g rad\n",
                coat.roots().size(), int(scratch.counts.contacts), int(scratch.counts.pushed_out),
                int(scratch.counts.targets_not_raised), scratch.counts.turned_angle,
                scratch.counts.goal_angle);
    EXPECT_GT(scratch.counts.contacts, 1000u);
    long long differ = 0, again = 0;
    for (const size_t batch : {1, 7, 8, 100}) {
        ChainScratch other;
        // For each batch size, enough strands to fill some batches.
        const size_t count = std::min(coat.roots().size(), std::max<size_t>(40, 4 * batch));
        const auto cut = coat.poses(coat.roots().first(count), batch, other);
        for (size_t t = 0; t < whole.size(); ++t)
            for (size_t i = 0; i < count; ++i) differ += cut[t][i] != whole[t][i];
    }
    none("strands in batches of 1, 7, 8, 100 and 512: other bits", differ, "strands");
    differ = 0;
    const std::vector<size_t> order = shuffled(coat.roots().size(), 7);
    std::vector<Root> roots;
    for (const size_t i : order) roots.push_back(coat.roots()[i]);
    const auto mixed = coat.poses(roots, 512, scratch);
    for (size_t t = 0; t < whole.size(); ++t)
        for (size_t i = 0; i < order.size(); ++i) differ += mixed[t][i] != whole[t][order[i]];
    none("strands in another order, beside others: other bits", differ, "strands");
    const auto repeated = coat.poses(coat.roots(), 512, scratch);
    for (size_t t = 0; t < whole.size(); ++t)
        for (size_t i = 0; i < roots.size(); ++i) again += repeated[t][i] != whole[t][i];
    none("tessellated twice: other bits", again, "strands");
}

TEST(Determinism, AfterOtherFramesAndInAChainMadeAnew) {
    ChainScratch fresh, used;
    const Coat coat(everything);
    const auto alone = coat.poses(coat.roots(), 512, fresh);
    for (const double frame : {1.0, 17.5, 239.0}) {
        CoatSpec earlier = everything;
        earlier.frame = frame;
        earlier.times = {frame, frame + 0.5};
        const Coat before(earlier);
        before.poses(before.roots().first(200), 64, used);
    }
    const Coat anew(everything);
    const auto after = anew.poses(anew.roots(), 512, used);
    long long differ = 0;
    for (size_t t = 0; t < alone.size(); ++t)
        for (size_t i = 0; i < alone[t].size(); ++i) differ += after[t][i] != alone[t][i];
    none("frame 240 after others: other bits", differ, "strands");
}

TEST(Determinism, OnAnyNumberOfThreads) {
    const Coat coat(everything);
    ChainScratch scratch;
    constexpr size_t batch = 32;
    const auto whole = coat.poses(coat.roots(), batch, scratch);
    const size_t batches = (coat.roots().size() + batch - 1) / batch;
    tbb::enumerable_thread_specific<ChainScratch> scratches;
    std::vector<long long> differ(batches, 0);
    tbb::parallel_for(size_t(0), batches, [&](size_t i) {
        const size_t first = i * batch, count = std::min(batch, coat.roots().size() - first);
        const auto part = coat.poses(coat.roots().subspan(first, count), batch, scratches.local());
        for (size_t t = 0; t < part.size(); ++t)
            for (size_t k = 0; k < count; ++k) differ[i] += part[t][k] != whole[t][first + k];
    });
    none("strands on all threads: other bits", std::accumulate(differ.begin(), differ.end(), 0LL), "strands");
}

// All stages, on a ball.
const std::string scene_text =
    "frames = [1, 240]\n[camera]\nposition = [0, 1, 4]\ntarget = [0, 0.2, 0]\n"
    "[film]\nsize = [32, 24]\nsamples = 1\nmax_depth = 1\n"
    "[wind]\nspeed = 6\nnoise = { amplitude = 0.5, frequency = 2, evolution = 1.3 }\n"
    "jiggle.frequency = 3\ngusts.num_gusts = 12\ngusts.period = 60\nshielding.shield = 0.6\ncollision.solver "
    "= \"exact\"\n"
    "collision.offset_scale = 0.5\n"
    "[[light]]\ntype = \"sky\"\n[[mesh]]\nname = \"ball\"\ntype = \"sphere\"\ndivisions = 12\n"
    "transform = { keys = [{ frame = 1, translate = [0, 0, 0] }, { frame = 240, translate = [0.5, 0.3, 0] }] "
    "}\n"
    "[[procedural]]\nname = \"fur\"\ntype = \"groom\"\non = \"ball\"\ncount = 150\ncvs = 6\nlength = [0.3, "
    "0.5]\n"
    "width = 0.02\n";

TEST(Determinism, TheProgramOnOneThreadAndOnMany) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_text);
    long long differ = 0;
    const auto bake = [&](const std::string& name, std::vector<std::string> more) {
        more.insert(more.begin(), {"bake", scene, "--quiet", "-o", folder / name});
        EXPECT_DONE(testing::marram(more));
        return read_file(folder / name);
    };
    for (const std::string frame : {"1", "17.3", "240"}) {
        const std::string one = bake("one.hair", {"--frame", frame, "--threads", "1"});
        EXPECT_GT(one.size(), 150u * 6u * 12u);
        for (const std::string threads : {"2", "7"})
            differ += bake("n.hair", {"--frame", frame, "--threads", threads}) != one;
        EXPECT_NE(bake("rest.hair", {"--frame", frame, "--stage", "bent"}), one)
            << "collision and jiggle do nothing";
    }
    none("baked on 1, 2 and 7 threads: other bytes", differ, "files");
}

// A ball at rest, strands that are kept from frame to frame: grown ones, guided ones, and those of a file.
TEST(Determinism, WhatIsKeptFromFrameToFrameChangesNoBit) {
    const Folder folder;
    std::string points;
    for (int i = 0; i < 40; ++i) { // lines of 4 to 7 points on the ball
        const double angle = 0.15 * i;
        std::string line = "l";
        for (int k = 0; k < 4 + i % 4; ++k) {
            const double r = 1.0 + 0.1 * k;
            points += fmt::format("v {:.6f} {:.6f} {:.6f}\n", 0.8 * r * std::cos(angle), r * 0.6,
                                  0.8 * r * std::sin(angle));
            line += fmt::format(" {}", k - (4 + i % 4));
        }
        points += line + "\n";
    }
    folder.write("lines.obj", points);
    std::string text = scene_text;
    const size_t keys = text.find("transform = {"), end = text.find("[[procedural]]");
    text.erase(keys, end - keys);
    text += "[[curves]]\nname = \"lines\"\ntype = \"strands\"\nfile = \"lines.obj\"\n"
            "[[procedural]]\nname = \"hair\"\ntype = \"strands\"\ncurves = \"lines\"\non = \"ball\"\nwidth = "
            "0.01\n"
            "[[procedural]]\nname = \"led\"\ntype = \"groom\"\non = \"ball\"\ncount = 100\ncvs = 5\nwidth = "
            "0.01\n"
            "guides = { curves = \"lines\", wind = \"guides\", reach = 3 }\n";
    const std::string scene = folder.write("a.toml", text);
    const auto bake = [&](const std::string& name, std::vector<std::string> more) {
        more.insert(more.begin(), {"bake", scene, "--quiet", "-o", folder / name});
        EXPECT_DONE(testing::marram(more));
    };
    bake("sequence.####.usda", {"--frames", "1-60"});
    bake("halves.####.usda", {"--frames", "40-52x0.5", "--threads", "1"});
    bake("mixed.####.usda", {"--frames", "44,12,50,51,45,46,13"});
    long long differ = 0, compared = 0;
    const auto compare = [&](const std::string& name, int frame) {
        const std::string alone = fmt::format("alone.{}.usda", frame);
        bake(alone, {"--frame", std::to_string(frame), "--set", "wind.jiggle.memory=0"});
        differ += read_file(folder / alone) != read_file(folder / fmt::format("{}.{:04}.usda", name, frame));
        ++compared;
    };
    for (const int frame : {7, 24, 33, 60}) compare("sequence", frame);
    for (const int frame : {44, 51}) compare("halves", frame);
    for (const int frame : {12, 50, 51, 46, 13}) compare("mixed", frame);
    std::printf("  %lld frames compared\n", compared);
    none("frames of a sequence, of halves and mixed, and alone: other bytes", differ, "files");
}

TEST(Determinism, Frame240AloneAndAfter1To239) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_text);
    EXPECT_DONE(
        testing::marram({"render", scene, "--quiet", "--frames", "1-240", "-o", folder / "s####.exr"}));
    EXPECT_DONE(testing::marram(
        {"render", scene, "--quiet", "--frame", "240", "--threads", "1", "-o", folder / "a.exr"}));
    EXPECT_DONE(testing::marram({"render", scene, "--quiet", "--frame", "240", "-o", folder / "b.exr"}));
    EXPECT_DONE(testing::marram({"render", scene, "--quiet", "--frame", "239", "-o", folder / "c.exr"}));
    none("frame 240 alone and after 1 ... 239: other pixels",
         !testing::same_picture(folder / "s0240.exr", folder / "a.exr") +
             !testing::same_picture(folder / "s0240.exr", folder / "b.exr"),
         "pictures");
    EXPECT_FALSE(testing::same_picture(folder / "a.exr", folder / "c.exr")) << "nothing moves";
}

} // namespace
} // namespace marram::stability
