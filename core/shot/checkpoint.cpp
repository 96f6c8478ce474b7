// SPDX-License-Identifier: Apache-2.0
#include "core/shot/checkpoint.h"

#include "core/math/clock.h"

#include <algorithm>
#include <utility>

namespace marram {

Checkpoint::Checkpoint(double seconds, std::function<void()> save, std::function<double()> clock)
    : seconds_(seconds), save_(std::move(save)), clock_(clock ? std::move(clock) : wall_seconds),
      called_(clock_()), next_(called_ + seconds) {}

void Checkpoint::save_if_due() {
    if (seconds_ <= 0.0) return;
    const double now = clock_(), pass = now - std::exchange(called_, now);
    if (now + pass < next_) return;
    try {
        save_();
        fault_.reset();
    } catch (const InputError& error) {
        fault_ = error.problems.front();
    }
    called_ = clock_();
    const double cost = called_ - now;
    next_ = now + std::max(seconds_, 2.0 * cost); // the state is of `now`
}

std::optional<Problem> Checkpoint::take_fault() { return std::exchange(fault_, std::nullopt); }

} // namespace marram
