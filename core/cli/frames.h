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

// Frames beyond are refused: one more would be lost in the number's rounding.
inline constexpr double latest_frame = 1e9;

// What --frame and --frames say.
struct FrameRequest {
    std::optional<double> frame;
    std::optional<std::string> list; // as parse_frames() takes it
    bool given() const { return frame || list; }
};

// The frames of a list: pieces between commas, each a frame, a range A-B, or a range with a step, A-BxS: "1-100x5,120". Numbers may be
// negative and have up to six decimals: "-10--5", "1-2x0.25". In the order of the list, each once. Throws InputError with the column
// of what is wrong in the place "OPTION LIST": also for a range that goes backwards, and for more than a million frames.
std::vector<double> parse_frames(const std::string& list, const std::string& option = "--frames");

// The files of one run: what it writes must be none of what it reads, and nothing twice.
class RunFiles {
  public:
    explicit RunFiles(const std::vector<std::string>& read);
    void
    write(const std::string& file); // "" for none; throws InputError where writing it would destroy another

  private:
    std::map<std::filesystem::path, std::string> known_; // by what they really are: links followed
};

// What was asked for; neither given: the scene's range where the output has a place for a number, else its first frame. Throws
// InputError as parse_frames() does, and for several frames without a #### in the output's name.
std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output);

} // namespace marram
