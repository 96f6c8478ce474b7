// SPDX-License-Identifier: Apache-2.0
#include "core/shot/checkpoint.h"

#include "core/math/clock.h"
#include "core/math/problem.h"

#include <utility>

namespace marram {

Checkpoint::Checkpoint(double seconds, std::function<void()> save)
    : seconds_(seconds), save_(std::move(save)), next_(wall_seconds() + seconds) {}

void Checkpoint::save_if_due() {
    if (seconds_ <= 0.0 || wall_seconds() < next_) return;
    try {
        save_();
        fault_.clear();
    } catch (const InputError& error) {
        fault_ = to_string(error.problems.front());
    }
    next_ = wall_seconds() + seconds_;
}

std::string Checkpoint::take_fault() { return std::exchange(fault_, ""); }

} // namespace marram
