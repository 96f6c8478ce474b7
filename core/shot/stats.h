// SPDX-License-Identifier: Apache-2.0
// What a frame cost, as JSON for other programs.
#pragma once

#include "core/geometry/build.h"
#include "core/render/integrator.h"

#include <string>
#include <vector>

namespace marram {

struct FrameStats {
    double frame = 0.0;
    int threads = 1;
    uint32_t camera_poses = 1;                   // that the shutter sees it at
    double load = 0.0, trace = 0.0, total = 0.0; // wall seconds
    BuildStats build;
    RenderStats render;
};

// The file of --stats: one object, or for several frames a list of them. Keys as the design fixes them; stages that did not run
// are 0. With #### in its name each frame has a file of its own. Written while a sequence renders, for at most 5 % of the
// time, so that a run that is killed has told most of it.
class StatsFile {
  public:
    explicit StatsFile(std::string path); // "": no file
    void add(const FrameStats& frame);    // throws InputError where the file cannot be written
    void finish();                        // writes what was added

  private:
    void write(const std::string& path, const std::vector<std::string>& frames);

    std::string path_;
    std::vector<std::string> frames_; // as JSON
    double cost_ = 0.0, written_ = 0.0;
};

} // namespace marram
