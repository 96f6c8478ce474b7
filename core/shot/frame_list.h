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

// Whose lists these are: what A-B:N means, and whether a range may go backwards.
enum class FrameDialect {
    marram,  // neither
    opencue, // interleaved: every Nth frame first, then every (N/2)th of the others, and so on: 1-10:5 is
             // 1,6,2,4,8,10,3,5,7,9. Backwards: 10-1, 10-1x-3
    openjd,  // a step: 1-10:5 is 1,6. Backwards: 10-1:-3
    fileseq, // staggered: every Nth frame, then every (N-1)th of the others, and so on: 1-10:3 is
             // 1,4,7,10,3,5,9,2,6,8. Backwards as in opencue
};

// The options --frame and --frames, and how they are read.
struct FrameRequest {
    std::optional<double> frame;
    std::optional<std::string> list; // for parse_frames()
    FrameDialect dialect = FrameDialect::marram;
    bool skip_outside = false; // leave out frames that are not of the scene
    bool given() const { return frame || list; }
};

// Parses a list of frames separated by commas. Each part is a frame, a range A-B, a range with a step, A-BxS,
// or the frames of a range that the step leaves out, A-ByS: "1-100x5,120". Numbers may be negative, padded,
// and have up to six decimals: "-10--5", "0001-0010", "1-2x0.25". Returns the frames in the order of the
// list, each once. Throws InputError with the column of the mistake in the place "OPTION LIST", also for what
// the dialect does not have, and for more than a million frames.
std::vector<double> parse_frames(const std::string& list, const std::string& option = "--frames",
                                 FrameDialect dialect = FrameDialect::marram);

// The frames requested. If the request is empty: the scene's range if the output's name has a ####, else the
// scene's first frame. Throws InputError as parse_frames() does, and for several frames without a #### in the
// output's name.
std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output);

// If the request says so, leaves out frames that are not of the scene, and returns a line about them, else
// "".
std::string skip_frames_outside(std::vector<double>& frames, const FrameRequest& request,
                                const Vec2d& scene_range);

} // namespace marram
