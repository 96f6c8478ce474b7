// SPDX-License-Identifier: Apache-2.0
// Lists of frames as users write them, and which frames a run makes.
#pragma once

#include "core/math/vec.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

// Largest absolute frame number: beyond it rounding would lose the decimals.
inline constexpr double latest_frame = 1e9;

// The options --frame and --frames.
struct FrameRequest {
    std::optional<double> frame;
    std::optional<std::string> list; // for parse_frames()
    bool given() const { return frame || list; }
};

// Parses a list of frames separated by commas. Each part is a frame, a range A-B, or a range with a step,
// A-BxS: "1-100x5,120". Numbers may be negative and have up to six decimals: "-10--5", "1-2x0.25". Returns
// the frames in the order of the list, each once. Throws InputError with the column of the mistake in the
// place "OPTION LIST", also for a range that goes backwards and for more than a million frames.
std::vector<double> parse_frames(const std::string& list, const std::string& option = "--frames");

// The frames requested. If the request is empty: the scene's range if the output's name has a ####, else the
// scene's first frame. Throws InputError as parse_frames() does, and for several frames without a #### in the
// output's name.
std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output);

} // namespace marram
