// SPDX-License-Identifier: Apache-2.0
// Statistics of a frame, as JSON for other programs.
#pragma once

#include "core/math/problem.h"
#include "core/render/integrator.h"
#include "core/world/build.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct FrameStats {
    double frame = 0.0;
    int threads = 1;
    uint64_t memory_budget = 0;                  // FrameOptions::memory
    uint32_t camera_poses = 1;                   // over the shutter
    double load = 0.0, trace = 0.0, total = 0.0; // wall seconds
    BuildStats build;
    RenderStats render;
};

// The file of --stats: one JSON object, or a list of objects for several frames. Stages that did not run are
// 0. With #### in the name each frame gets its own file. The file is rewritten while a sequence renders, for
// at most 5 % of the time, so that most of it survives if the process is killed.
class StatsFile {
  public:
    explicit StatsFile(std::string path); // "": no file
    void add(const FrameStats& frame);
    void
    finish(); // writes all frames added; throws InputError if a file could not be written, now or by add()

  private:
    void write_or_keep(const FrameStats& frame);
    void write(const std::string& path, const std::vector<std::string>& frames);

    std::string path_;
    std::vector<std::string> frames_; // as JSON
    std::optional<InputError> fault_; // of the first file of a frame that could not be written
    double cost_ = 0.0, written_ = 0.0;
};

} // namespace marram
