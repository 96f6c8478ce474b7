// SPDX-License-Identifier: Apache-2.0
// Progress: for people a line on a terminal, of the present phase; for programs lines on stdout, of the whole
// run.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

namespace marram {

struct ProgressState {
    std::string phase;
    double fraction = 0.0;    // of the phase
    bool after_build = false; // the phase takes what the build leaves of a frame
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

enum class ProgressStyle { automatic, plain, openjd, alf, json, none };

// Of the run, from this call on.
void set_progress_style(ProgressStyle style);

// The lines of one style, and when they are due. Knows no clock and prints nothing.
//
// A run has parts, such as frames. Within a part, what is built takes the share build_share, and is counted
// by its phases, whose number is not known: each takes half of what is left of the share. Then follows the
// phase with ProgressState::after_build. The fraction never decreases, and stays below 1 until done().
class ProgressText {
  public:
    ProgressText(ProgressStyle style, double build_share) : style_(style), build_share_(build_share) {}

    // What follows goes from `begin` to `end` of the run, 0 to 1.
    void begin_part(double begin, double end);

    // The lines that are due, "" if none are. A line is due when the whole percentage (of openjd and
    // json: or the phase) has changed, at most once a second, and after 8 s in any case.
    std::string due_lines(double seconds, const ProgressState& state);
    std::string done();                                 // the last line, 100 %
    std::string stopped(std::string_view reason) const; // instead of it; "" in most styles

  private:
    void take(const ProgressState& state);
    std::string lines(double fraction, bool new_phase) const;

    ProgressStyle style_;
    double build_share_;
    double begin_ = 0.0, end_ = 0.0, fraction_ = 0.0, unbuilt_ = 1.0; // unbuilt: share when the phase began
    std::string phase_, printed_phase_;
    int printed_percent_ = -1;
    double printed_at_ = 0.0;
};

class RunProgress {
  public:
    // quiet: nothing is printed unless a style was asked for.
    explicit RunProgress(bool quiet, double build_share = 0.1);
    // Stops. Of a run that is not finished, says no more than that it was interrupted.
    ~RunProgress();
    RunProgress(const RunProgress&) = delete;
    RunProgress& operator=(const RunProgress&) = delete;

    // What follows is one of `count` equal parts of what goes from `begin` to `end` of the run, 0 to 1. Its
    // phases are called "2 of 5: ...".
    void begin_part(size_t index, size_t count, double begin = 0.0, double end = 1.0);
    const std::string& prefix() const { return prefix_; } // "2 of 5: ", or ""

    // What is done between the lives of watches, such as saving.
    void phase(const std::string& name);

    // All files are closed.
    void finish();

    // While it lives, `ask` is called by another thread for the state. Draws the line on a terminal.
    class Watch {
      public:
        Watch(RunProgress& run, std::function<ProgressState()> ask);
        ~Watch();
        Watch(const Watch&) = delete;
        Watch& operator=(const Watch&) = delete;

      private:
        RunProgress& run_;
        std::optional<ProgressLine> line_;
    };

  private:
    bool prints() const { return thread_.joinable(); }
    void stop();

    bool quiet_;
    std::mutex mutex_; // of what follows
    std::condition_variable_any wake_;
    ProgressText text_;
    std::string prefix_;
    ProgressState state_;                  // while there is no watch
    std::function<ProgressState()> ask_{}; // of the watch
    std::jthread thread_;
};

// Tells programs that read the progress that the run has ended with an error: one line, no line end.
void report_failure(std::string_view message);

} // namespace marram
