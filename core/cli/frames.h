// SPDX-License-Identifier: Apache-2.0
// Which frames to make, and what their files are called.
#pragma once

#include "core/math/vec.h"

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace marram {

// What --frame and --frames say; neither given: the scene's range where the output has a place for a number, else its first frame.
struct FrameRequest {
    std::optional<double> frame;
    std::optional<std::string> range; // "A-B"
};

// The files of one run: what it writes must be none of what it reads, and nothing twice.
class RunFiles {
  public:
    explicit RunFiles(const std::vector<std::string>& read);
    void
    write(const std::string& file); // "" for none; throws InputError where writing it would destroy another

  private:
    std::map<std::filesystem::path, std::string> known_; // by what they really are: links followed
};

// Throws InputError for a range that is none, and for several frames without a #### in the output's name.
std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output);

} // namespace marram
