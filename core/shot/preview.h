// SPDX-License-Identifier: Apache-2.0
// Decides when a preview of the frame is written during rendering.
#pragma once

#include "core/math/problem.h"

#include <functional>
#include <optional>
#include <string>

namespace marram {

// Seconds until the next preview. cost: seconds that the last one took; elapsed: seconds since the frame
// began.
double preview_pause(double cost, double elapsed);

// Writes a preview after the first pass and then at growing intervals. If a preview cannot be written, no
// more are attempted: the frame itself goes on.
class Preview {
  public:
    explicit Preview(std::function<void()> write);                 // empty function: no previews
    void show_if_due();                                            // writes a preview if it is due
    void finish();                                                 // writes the finished frame
    const std::optional<Problem>& fault() const { return fault_; } // why writing failed

  private:
    void write();

    std::function<void()> write_;
    double begin_;
    double next_ = 0.0; // time of the next preview, on the clock of wall_seconds()
    std::optional<Problem> fault_;
};

} // namespace marram
