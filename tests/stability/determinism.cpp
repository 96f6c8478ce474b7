// SPDX-License-Identifier: Apache-2.0
// Identical bits after any history, on any number of threads, in any batches: for the chain and for the
// program.
#include "tests/stability/coat.h"
#include "tests/stability/table.h"
#include "tests/unit/cli/program.h"

#include <gtest/gtest.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
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
