// SPDX-License-Identifier: Apache-2.0
// Access to the host for simulated layers while a frame is prepared: states of earlier frames, and progress
// messages.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

// Outside prepare() there are no states: the simulation restarts.
struct Simulation {
    const MarramHost* host = nullptr;
    const MarramStates* states = nullptr; // may be NULL
    bool failed = false;                  // the host could not load or store; it has reported the reason

    // The latest state at or before the frame, or empty. `at`: the state's frame.
    std::vector<char> load(double frame, double& at);
    void store(double frame, std::span<const char> data);
    void progress(double share, const std::string& words) const; // share: 0 to 1
};

} // namespace marram
