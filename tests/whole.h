// SPDX-License-Identifier: Apache-2.0
// Sweeps over all scenes, seeds and faults take most of a run's time: a plain run takes a fixed part of each,
// and `MARRAM_WHOLE=1 tests/run` takes all.
#pragma once

#include <cstddef>
#include <cstdlib>

namespace marram::testing {

inline bool whole_run() { return std::getenv("MARRAM_WHOLE") != nullptr; }

// Whether this run includes case `index` of a sweep: one in `of`. Sweeps over the same cases differ in
// `first`, so that each case is in one of them.
inline bool in_this_run(size_t index, size_t of, size_t first = 0) {
    return whole_run() || index % of == first % of;
}

} // namespace marram::testing
