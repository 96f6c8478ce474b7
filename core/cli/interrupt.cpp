// SPDX-License-Identifier: Apache-2.0
#include "core/cli/interrupt.h"
#include "core/cli/exit_codes.h"

#include "core/image/atomic_file.h"
#include "core/shot/farm/claim.h"

#include <csignal>
#include <ctime>
#include <thread>

#include <pthread.h>
#include <unistd.h>

namespace marram {
namespace {

std::atomic<bool> stop{false};
std::atomic<int> first_signal{0};
std::atomic<int> exit_blockers{0};

// The documentation promises an exit within a second. Sorting roots, for example, takes up to this time
// before it polls interrupted().
constexpr double grace_seconds = 0.4;
constexpr double same_signal_seconds = 0.1; // timeout(1) sends its signal twice at once

[[noreturn]] void exit_now() {
    remove_temporary_files();
    remove_claims();
    _exit(interrupt_exit_code());
}

void watch(sigset_t signals) {
    int signal = 0;
    while (sigwait(&signals, &signal) != 0) {
    }
    first_signal.store(signal); // before stop: who sees stop may ask for the exit code
    stop.store(true);
    const timespec pause{0, 20'000'000};
    bool again = false;
    for (double waited = 0.0;; waited += 0.02) {
        timespec none{0, 0};
        const bool next = sigtimedwait(&signals, nullptr, &none) == SIGINT;
        again = again || (next && waited > same_signal_seconds);
        if (waited > grace_seconds && (again || exit_blockers.load() == 0)) exit_now();
        nanosleep(&pause, nullptr);
    }
}

} // namespace

const std::atomic<bool>& interrupted() { return stop; }

int interrupt_exit_code() {
    const int signal = first_signal.load();
    return signal == 0 ? exit_interrupted : 128 + signal;
}

const char* interrupt_name() {
    switch (first_signal.load()) {
    case SIGINT:
        return "SIGINT";
    case SIGTERM:
        return "SIGTERM";
    case SIGHUP:
        return "SIGHUP";
    case SIGUSR1:
        return "SIGUSR1";
    case SIGUSR2:
        return "SIGUSR2";
    case SIGXCPU:
        return "SIGXCPU";
    default:
        return "";
    }
}

void watch_interrupts() {
    // One thread waits for the signals. All threads created later inherit the mask that blocks them.
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    for (const int signal : {SIGHUP, SIGUSR1, SIGUSR2, SIGXCPU}) {
        struct sigaction action {};
        if (sigaction(signal, nullptr, &action) == 0 && action.sa_handler != SIG_IGN) // keep nohup's SIG_IGN
            sigaddset(&signals, signal);
    }
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);
    std::thread(watch, signals).detach();
}

ExitBlocker::ExitBlocker() { ++exit_blockers; }
ExitBlocker::~ExitBlocker() { --exit_blockers; }

} // namespace marram
