// SPDX-License-Identifier: Apache-2.0
// Poses of a scene's first strands, and what tests of winds ask of them.
#pragma once

#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

namespace marram::testing {

using Pose = std::vector<float>; // vertices: x, y, z and radius, with a phantom at either end of each strand

inline Pose pose_of(TestScene& scene, double frame) {
    scene.settings.frame = frame;
    const World world = scene.build();
    const CurveGeometry& curves = world.curves.front();
    return {curves.vertices[0], curves.vertices[0] + 4 * curves.curve_count * (curves.cvs_per_curve + 2)};
}
inline Pose pose_of_scene(const std::string& text, double frame = 1.0) {
    TestScene scene(text);
    return pose_of(scene, frame);
}

inline double largest_difference(const Pose& a, const Pose& b) {
    double most = 0.0;
    for (size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(double(a[i]) - double(b[i])));
    return most;
}

// Frames one after the other have the bits of each alone, in one thread; and so has a scene that is updated to
// this one from `other`.
inline void expect_independent_frames(const std::string& text, const std::vector<double>& frames,
                                      const std::string& other) {
    TestScene one_after_the_other(text);
    std::map<double, Pose> alone;
    for (const double frame : frames) {
        const Pose pose = pose_of(one_after_the_other, frame);
        if (!alone.contains(frame)) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
            alone[frame] = pose_of_scene(text, frame);
        }
        EXPECT_EQ(pose, alone.at(frame)) << frame;
    }
    TestScene updated(other);
    pose_of(updated, frames.back());
    updated.update(text);
    EXPECT_EQ(pose_of(updated, frames.back()), alone.at(frames.back()));
}

// Errors of reading and building a scene, as the user reads them.
inline std::string problems_of_scene(const std::string& text) {
    try {
        TestScene scene(text);
        return scene.build_errors();
    } catch (const InputError& error) {
        std::string all;
        for (const Problem& problem : error.problems) all += to_string(problem) + "\n";
        return all;
    }
}

} // namespace marram::testing
