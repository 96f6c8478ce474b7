// SPDX-License-Identifier: Apache-2.0
// What a layer that needs its own past may use while the host prepares a frame: states of earlier frames, and a line of progress.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

// Outside prepare() there are no states: whoever asks begins anew.
struct Simulation {
    const MarramHost* host = nullptr;
    const MarramStates* states = nullptr; // NULL: none
    bool failed = false;                  // the host could not load or store; it knows why

    // The latest state at or before the frame; empty where there is none. `at`: its frame.
    std::vector<char> load(double frame, double& at);
    void store(double frame, std::span<const char> data);
    void progress(double share, const std::string& words) const; // 0 ... 1
};

} // namespace marram
