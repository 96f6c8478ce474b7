// SPDX-License-Identifier: Apache-2.0
// Ctrl-C and the signals of batch systems: the first asks the work to stop, a timeout or a second Ctrl-C ends
// the process.
#pragma once

#include <atomic>

namespace marram {

// Set by SIGINT, SIGTERM and SIGHUP, and by SIGUSR1, SIGUSR2 and SIGXCPU, by which batch systems tell that
// time is up. All long computations poll it.
const std::atomic<bool>& interrupted();

// Exit code of a run that was interrupted: 128 + the number of the first signal; exit_interrupted if none
// came.
int interrupt_exit_code();

// "SIGTERM", of the first signal; "" if none came.
const char* interrupt_name();

// From this call on, the signals set interrupted(). If the work has not ended 0.4 s later and no ExitBlocker
// lives, the process removes its temporary files and claims and exits with interrupt_exit_code(). So it does
// then if SIGINT has come again, more than 0.1 s after the first signal: somebody at a terminal cannot wait.
// Other signals may be repeated while a picture and its state are being saved: batch systems and timeout(1)
// send SIGTERM to a process and again to its group, the kernel sends SIGXCPU every second.
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
