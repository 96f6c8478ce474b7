// SPDX-License-Identifier: Apache-2.0
#include "core/cli/progress.h"
#include "core/cli/output.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include <unistd.h>

namespace marram {
namespace {

constexpr int bar_width = 30;
constexpr auto interval = std::chrono::milliseconds(100);

// `fraction_done`: the fraction done during `elapsed`. It is less than `fraction` if a phase was resumed from
// a file.
std::string time_left(double elapsed, double fraction_done, double fraction) {
    // No estimate before enough is done.
    if (fraction_done < 0.01 || elapsed < 0.5) return "";
    const int seconds = int(elapsed * (1.0 - fraction) / fraction_done + 0.5);
    return fmt::format("{}:{:02} left", seconds / 60, seconds % 60);
}

} // namespace

ProgressLine::ProgressLine(bool quiet, std::function<ProgressState()> ask) : ask_(std::move(ask)) {
    if (quiet || log_format() == LogFormat::json || !isatty(STDERR_FILENO)) return;
    thread_ = std::jthread([this](const std::stop_token& stop) {
        using Clock = std::chrono::steady_clock;
        std::string phase;
        auto begin = Clock::now();
        double first = 0.0;
        while (!stop.stop_requested()) {
            const ProgressState state = ask_();
            if (state.phase != phase) {
                phase = state.phase;
                begin = Clock::now();
                first = std::clamp(state.fraction, 0.0, 1.0);
            }
            const double fraction = std::clamp(state.fraction, 0.0, 1.0);
            const int full = int(fraction * bar_width);
            const double elapsed = std::chrono::duration<double>(Clock::now() - begin).count();
            draw(fmt::format("\r\033[K{:<20} [{:#<{}}{:.<{}}] {:3.0f} %  {}", phase, "", full, "",
                             bar_width - full, 100.0 * fraction,
                             time_left(elapsed, fraction - first, fraction)));
            std::this_thread::sleep_for(interval);
        }
        draw("\r\033[K");
    });
}

ProgressLine::~ProgressLine() {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    thread_.join();
}

} // namespace marram
