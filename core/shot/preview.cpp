// SPDX-License-Identifier: Apache-2.0
#include "core/shot/preview.h"

#include "core/math/clock.h"

#include <algorithm>

namespace marram {
namespace {

constexpr double min_pause = 1.0;        // seconds; more frequent updates look like flicker
constexpr double max_write_share = 0.02; // of the render time, for writing previews
// Minimum pause as a share of the elapsed time: 5 % more samples reduce the noise by only 2.5 %.
constexpr double growth = 0.05;

} // namespace

double preview_pause(double cost, double elapsed) {
    return std::max({min_pause, cost / max_write_share, growth * elapsed});
}

Preview::Preview(std::function<void()> write) : write_(std::move(write)), begin_(wall_seconds()) {}

void Preview::show_if_due() {
    if (wall_seconds() >= next_) write();
}

void Preview::finish() { write(); }

void Preview::write() {
    if (!write_ || fault_) return;
    const double before = wall_seconds();
    try {
        write_();
    } catch (const InputError& error) {
        fault_ = error.problems.front();
    }
    const double now = wall_seconds();
    next_ = now + preview_pause(now - before, now - begin_);
}

} // namespace marram
