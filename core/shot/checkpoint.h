// SPDX-License-Identifier: Apache-2.0
// Saves a frame's state every so often while it is traced, so that a run that is killed loses little.
#pragma once

#include "core/math/problem.h"

#include <functional>
#include <optional>
#include <string>

namespace marram {

class Checkpoint {
  public:
    // seconds: largest age of the saved state; 0: none is saved. save: may throw InputError. clock: seconds;
    // empty: the steady clock.
    Checkpoint(double seconds, std::function<void()> save, std::function<double()> clock = {});

    // Between passes, when no thread writes to the film. Saves the state if it would be too old after another
    // pass as long as the last one, but spends at most half of the time on it. A state that cannot be written
    // is tried again when the next is due: the frame itself goes on.
    void save_if_due();

    // Why the last save has failed; nothing if it has not, or if it was taken.
    std::optional<Problem> take_fault();

  private:
    double seconds_;
    std::function<void()> save_;
    std::function<double()> clock_;
    double called_, next_; // times of the last call, and when the state will be too old
    std::optional<Problem> fault_;
};

} // namespace marram
