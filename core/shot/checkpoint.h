// SPDX-License-Identifier: Apache-2.0
// Saves a frame's state every so often while it is traced, so that a run that is killed loses little.
#pragma once

#include <functional>
#include <string>

namespace marram {

class Checkpoint {
  public:
    // seconds: from the end of one save to the next; 0: none. save: may throw InputError.
    Checkpoint(double seconds, std::function<void()> save);

    // Between passes, when no thread writes to the film. A state that cannot be written is tried again when the
    // next is due: the frame itself goes on.
    void save_if_due();

    // Why the last save has failed, one line; "" if it has not, or if it was taken.
    std::string take_fault();

  private:
    double seconds_;
    std::function<void()> save_;
    double next_; // on the clock of wall_seconds()
    std::string fault_;
};

} // namespace marram
