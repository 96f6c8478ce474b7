// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/simulation.h"

namespace marram {

std::vector<char> Simulation::load(double frame, double& at) {
    if (!states || failed) return {};
    MarramState state{};
    state.size = sizeof state;
    failed = states->load(states->user, frame, &state) != MARRAM_OK;
    if (failed || !state.data) return {};
    at = state.frame;
    const char* first = static_cast<const char*>(state.data);
    return {first, first + state.byte_count};
}

void Simulation::store(double frame, std::span<const char> data) {
    if (!states || failed) return;
    const MarramState state{sizeof(MarramState), frame, data.data(), data.size()};
    failed = states->store(states->user, &state) != MARRAM_OK;
}

void Simulation::progress(double share, const std::string& words) const {
    if (host && MARRAM_HAS(host, progress) && host->progress)
        host->progress(host->user, share, words.c_str());
}

} // namespace marram
