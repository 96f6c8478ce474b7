// SPDX-License-Identifier: Apache-2.0
// Ctrl-C: asks once, and makes sure.
#pragma once

#include <atomic>

namespace marram {

// Set by SIGINT, SIGTERM and SIGHUP. Everything long looks at it.
const std::atomic<bool>& interrupted();

// From here on SIGINT sets interrupted(). Work that has not come to an end `grace` later, where nothing can be saved, is
// cut off: the process removes its temporary files and leaves with exit_interrupted. A second SIGINT cuts off at once.
void watch_interrupts();

// While one of these lives, an interrupt waits for the work to end by itself: a picture is being saved.
class NoExit {
  public:
    NoExit();
    ~NoExit();
    NoExit(const NoExit&) = delete;
    NoExit& operator=(const NoExit&) = delete;
};

} // namespace marram
