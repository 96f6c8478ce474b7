// SPDX-License-Identifier: Apache-2.0
// When a preview of a frame is written while it renders.
#pragma once

#include <functional>
#include <string>

namespace marram {

// Seconds from one preview to the next, after one that took `cost` seconds, `elapsed` after the frame began.
double preview_pause(double cost, double elapsed);

// Asks for a preview after the first pass and then at growing intervals. A preview that cannot be written is the last: it
// is not worth the frame.
class Preview {
  public:
    explicit Preview(std::function<void()> write);      // an empty one: never anything
    void between_passes();                              // writes where it is time
    void finish();                                      // writes once more, what the frame has become
    const std::string& fault() const { return fault_; } // one line; "" while all went well

  private:
    void write();

    std::function<void()> write_;
    double begin_;
    double next_ = 0.0; // when, on wall_seconds()
    std::string fault_;
};

} // namespace marram
