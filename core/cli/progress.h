// SPDX-License-Identifier: Apache-2.0
// A progress line on a terminal.
#pragma once

#include <functional>
#include <string>
#include <thread>

namespace marram {

struct ProgressState {
    std::string phase;
    double fraction = 0.0;    // of the phase
    bool of_the_rest = false; // the phase takes what the build leaves of a frame
};

// Redraws one line on stderr ten times a second with bar, percentage and time left, until it is destroyed.
// Does nothing if stderr is not a terminal or `quiet` is set.
class ProgressLine {
  public:
    ProgressLine(bool quiet, std::function<ProgressState()> ask);
    ~ProgressLine();
    ProgressLine(const ProgressLine&) = delete;
    ProgressLine& operator=(const ProgressLine&) = delete;

  private:
    std::function<ProgressState()> ask_;
    std::jthread thread_;
};

} // namespace marram
