// SPDX-License-Identifier: Apache-2.0
#include "core/cli/progress.h"

#include "core/cli/interrupt.h"
#include "core/cli/output.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <utility>

#include <unistd.h>

namespace marram {
namespace {

constexpr int bar_width = 30;
constexpr auto redraw_interval = std::chrono::milliseconds(100);

// `fraction_done`: the fraction done during `elapsed`. It is less than `fraction` if a phase was resumed from
// a file.
std::string time_left(double elapsed, double fraction_done, double fraction) {
    // No estimate before enough is done.
    if (fraction_done < 0.01 || elapsed < 0.5) return "";
    const int seconds = int(elapsed * (1.0 - fraction) / fraction_done + 0.5);
    return fmt::format("{}:{:02} left", seconds / 60, seconds % 60);
}

std::atomic<ProgressStyle> style_of_run{ProgressStyle::automatic};

constexpr double shortest_pause = 1.0, longest_pause = 8.0; // seconds; 10 s are promised
constexpr auto poll_interval = std::chrono::milliseconds(100);

bool is_printed(ProgressStyle style) {
    return style != ProgressStyle::automatic && style != ProgressStyle::none;
}

std::string on_one_line(std::string_view text) {
    std::string line(text);
    std::ranges::replace_if(
        line, [](unsigned char c) { return c < 32; }, ' ');
    return line;
}

void print_now(const std::string& lines) {
    if (lines.empty()) return;
    write_result(lines);
    flush_results();
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
            std::this_thread::sleep_for(redraw_interval);
        }
        draw("\r\033[K");
    });
}

ProgressLine::~ProgressLine() {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    thread_.join();
}

void set_progress_style(ProgressStyle style) { style_of_run = style; }

void ProgressText::begin_part(double begin, double end) {
    begin_ = begin;
    end_ = end;
    unbuilt_ = 1.0;
    phase_.clear();
    fraction_ = std::max(fraction_, begin);
}

void ProgressText::take(const ProgressState& state) {
    if (state.phase != phase_) {
        if (!phase_.empty()) unbuilt_ *= 0.5;
        phase_ = state.phase;
    }
    const double of_phase = std::clamp(state.fraction, 0.0, 1.0);
    const double of_part = state.after_build ? build_share_ + (1.0 - build_share_) * of_phase
                                             : build_share_ * (1.0 - unbuilt_ * (1.0 - 0.5 * of_phase));
    fraction_ = std::max(fraction_, begin_ + (end_ - begin_) * of_part);
}

std::string ProgressText::due_lines(double seconds, const ProgressState& state) {
    take(state);
    const double below_all = std::min(fraction_, 0.999);
    const int percent = int(100.0 * below_all);
    const bool names_phases = style_ == ProgressStyle::openjd || style_ == ProgressStyle::json;
    const bool new_phase = names_phases && phase_ != printed_phase_;
    const double pause = seconds - printed_at_;
    const bool first = printed_percent_ < 0;
    const bool due = first || pause >= longest_pause ||
                     (pause >= shortest_pause && (new_phase || percent != printed_percent_));
    if (!due) return "";
    printed_percent_ = percent;
    printed_at_ = seconds;
    printed_phase_ = phase_;
    return lines(below_all, new_phase);
}

std::string ProgressText::done() {
    phase_ = "done";
    return lines(1.0, true);
}

std::string ProgressText::stopped(std::string_view reason) const {
    if (style_ != ProgressStyle::openjd) return "";
    return fmt::format("openjd_status: {}\n", reason);
}

std::string ProgressText::lines(double fraction, bool new_phase) const {
    const double percent = 100.0 * fraction;
    const int whole = int(percent);
    switch (style_) {
    case ProgressStyle::plain:
        return fmt::format("{}%\n", whole);
    case ProgressStyle::alf:
        return fmt::format("ALF_PROGRESS {}%\n", whole);
    case ProgressStyle::openjd:
        return (new_phase ? fmt::format("openjd_status: {}\n", phase_) : "") +
               fmt::format("openjd_progress: {:.1f}\n", percent);
    case ProgressStyle::json: {
        // Tenths, cut off as the whole percentages are.
        const nlohmann::ordered_json object = {
            {"time", time_text()}, {"progress", double(int(10.0 * percent)) / 10.0}, {"status", phase_}};
        return object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    }
    case ProgressStyle::automatic:
    case ProgressStyle::none:
        break;
    }
    return "";
}

RunProgress::RunProgress(bool quiet, double build_share)
    : quiet_(quiet), text_(style_of_run, build_share), state_{"loading", 0.0} {
    if (!is_printed(style_of_run)) return;
    thread_ = std::jthread([this](const std::stop_token& stop) {
        const auto begin = std::chrono::steady_clock::now();
        std::unique_lock lock(mutex_);
        while (!stop.stop_requested()) {
            const double seconds =
                std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
            print_now(text_.due_lines(seconds, ask_ ? ask_() : state_));
            wake_.wait_for(lock, stop, poll_interval, [] { return false; });
        }
    });
}

void RunProgress::stop() {
    thread_.request_stop();
    thread_.join();
}

RunProgress::~RunProgress() {
    if (!prints()) return;
    stop();
    if (interrupted()) print_now(text_.stopped(std::string("interrupted by ") + interrupt_name()));
}

void RunProgress::begin_part(size_t index, size_t count, double begin, double end) {
    const double part = (end - begin) / double(count);
    const std::scoped_lock lock(mutex_);
    prefix_ = count > 1 ? fmt::format("{} of {}: ", index + 1, count) : "";
    text_.begin_part(begin + part * double(index), begin + part * double(index + 1));
}

void RunProgress::phase(const std::string& name) {
    const std::scoped_lock lock(mutex_);
    state_ = {prefix_ + name, 0.0};
}

void RunProgress::finish() {
    if (!prints()) return;
    stop();
    print_now(text_.done());
}

RunProgress::Watch::Watch(RunProgress& run, std::function<ProgressState()> ask) : run_(run) {
    if (style_of_run == ProgressStyle::automatic) line_.emplace(run.quiet_, ask);
    const std::scoped_lock lock(run.mutex_);
    run.ask_ = std::move(ask);
}

RunProgress::Watch::~Watch() {
    const std::scoped_lock lock(run_.mutex_);
    if (run_.ask_) run_.state_ = {run_.ask_().phase, 0.0};
    run_.ask_ = nullptr;
}

void report_failure(std::string_view message) {
    if (style_of_run == ProgressStyle::openjd) print_now("openjd_fail: " + on_one_line(message) + "\n");
}

} // namespace marram
