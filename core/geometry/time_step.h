// SPDX-License-Identifier: Apache-2.0
// Motion keys are equally spaced over a ray's time 0 ... 1; motion is linear in between.
#pragma once

#include <algorithm>
#include <cstddef>

namespace marram {

// The first of two keys, and the position between them.
struct Step {
    size_t first;
    double within;
};

inline Step step_of(size_t keys, double time) {
    if (keys < 2) return {0, 0.0};
    const double at = time * static_cast<double>(keys - 1);
    const size_t first = std::min(static_cast<size_t>(at), keys - 2);
    return {first, at - static_cast<double>(first)};
}

// The two keys around a time. Without keys in between (`end_keys_only`) these are the first and the last.
struct KeyPair {
    size_t before, after;
    double within;
};

inline KeyPair keys_around(size_t keys, double time, bool end_keys_only) {
    if (end_keys_only && keys > 1) return {0, keys - 1, time};
    const Step step = step_of(keys, time);
    return {step.first, std::min(step.first + 1, keys - 1), step.within};
}

} // namespace marram
