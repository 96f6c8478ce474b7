// SPDX-License-Identifier: Apache-2.0
// A scene asks for one tolerance. That what follows from it holds is measured here on every scene that there is, with fewer strands.
#include "core/cli/measure_dials.h"
#include "core/geometry/curve_compare.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>

namespace marram::testing {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> scenes() {
    std::vector<std::string> files;
    for (const fs::directory_entry& entry : fs::directory_iterator(MARRAM_SOURCE_DIR "/scenes"))
        if (entry.path().extension() == ".toml") files.push_back(entry.path().string());
    std::sort(files.begin(), files.end());
    return files;
}

World built(LoadedScene& scene, BuildSettings settings, BuildStats& stats) {
    static const std::atomic<bool> never{false};
    settings.curves_bvh = false;
    BuildProgress progress;
    return build_world(scene.geometry, settings, never, progress, stats);
}

LoadedScene loaded(const std::string& file, const std::vector<std::string>& changes) {
    static const std::atomic<bool> never{false};
    Overrides overrides;
    overrides.settings = changes;
    return load(file, overrides, never);
}

} // namespace

// Between motion keys 99 strands in 100 are no farther from where they belong than the tolerance: with the keys that the scene gets by
// itself, against eight times as many. Where colliders let strands go these jump, and no number of keys follows: they are
// foreseen, too. Shutters that are closed are opened for half a frame.
TEST(Tolerance, holds_between_the_motion_keys_of_every_scene) {
    std::printf("%-18s%13s%8s%13s%13s%13s\n", "scene", "tolerance", "keys", "foreseen", "99 in 100", "worst");
    for (const std::string& file : scenes()) {
        LoadedScene whole = loaded(file, {});
        BuildSettings settings = build_settings(whole, whole.description.globals.vec2("frames").x());
        settings.shutter_open = settings.shutter_close = 0.0;
        BuildStats stats;
        built(whole, settings, stats);
        constexpr double enough = 8000.0;
        LoadedScene scene =
            loaded(file, thinned(whole, std::min(1.0, enough / double(std::max<uint64_t>(stats.curves, 1)))));
        settings = build_settings(scene, whole.description.globals.vec2("frames").x());
        if (!(settings.shutter_open < settings.shutter_close))
            settings.shutter_open = -0.25, settings.shutter_close = 0.25;
        settings.motion_keys = 0;
        const World mine = built(scene, settings, stats = {});
        const double foreseen = stats.motion_error, jumps = stats.motion_jumps;
        settings.motion_keys = std::min(8 * (stats.motion_keys - 1) + 1, 64U);
        const World reference = built(scene, settings, stats = {});
        const CurveGap gap = gap_in_motion(mine, reference, settings.tolerance);
        std::printf("%-18s%11.3g m%8zu%11.3g m%11.3g m%11.3g m%8.2f%%%8.2f%%\n",
                    fs::path(file).filename().c_str(), settings.tolerance, mine.times.size(), foreseen,
                    gap.most, gap.worst, 100.0 * gap.beyond, 100.0 * jumps);
        EXPECT_LE(gap.beyond, 0.01 + 1.5 * jumps) << file;
        if (jumps < 0.001) {
            EXPECT_LE(gap.most, settings.tolerance) << file;
        }
    }
}

} // namespace marram::testing
