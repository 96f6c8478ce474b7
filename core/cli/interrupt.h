// SPDX-License-Identifier: Apache-2.0
// Ctrl-C: the first asks the work to stop, a second or a timeout ends the process.
#pragma once

#include <atomic>

namespace marram {

// Set by SIGINT, SIGTERM and SIGHUP, and by SIGUSR1, SIGUSR2 and SIGXCPU, by which batch systems tell that
// time is up. All long computations poll it.
const std::atomic<bool>& interrupted();

// From this call on, the signals set interrupted(). If the work has not ended 0.4 s later and no ExitBlocker
// lives, the process removes its temporary files and exits with exit_interrupted. A second SIGINT, SIGTERM or
// SIGHUP does so at once; the others may be repeated (the kernel sends SIGXCPU every second).
void watch_interrupts();

// While one of these lives, an interrupt waits until the work ends by itself, as a picture is being saved.
class ExitBlocker {
  public:
    ExitBlocker();
    ~ExitBlocker();
    ExitBlocker(const ExitBlocker&) = delete;
    ExitBlocker& operator=(const ExitBlocker&) = delete;
};

} // namespace marram
