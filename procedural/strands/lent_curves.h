// SPDX-License-Identifier: Apache-2.0
// Access to curves that the host lends, in the layout of the contract.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

struct LentCurves {
    MarramCurves curves{};
    uint32_t index = 0; // in MarramFrame.curves
    std::vector<MarramAttribute> attributes{};

    uint64_t count() const { return curves.curve_count; }
    uint64_t first_cv(uint64_t c) const {
        return curves.offsets ? curves.offsets[c] : c * curves.cvs_per_curve;
    }
    uint32_t cvs(uint64_t c) const {
        return curves.offsets ? uint32_t(curves.offsets[c + 1] - curves.offsets[c]) : curves.cvs_per_curve;
    }
    uint64_t first_vertex(uint64_t c) const { return first_cv(c) + 2 * c; } // the phantom CV before the root
    uint64_t cv_count() const { return first_cv(count()); }
    const MarramAttribute* find(std::string_view name) const {
        for (const MarramAttribute& a : attributes)
            if (name == a.name) return &a;
        return nullptr;
    }
};

// The position of a vertex of four floats.
inline Vec3d cv_at(const float* vertex) { return {double(vertex[0]), double(vertex[1]), double(vertex[2])}; }

// Finds the curves of that name in a frame. Throws SceneFault if there are none, or if counts, pointers or
// numbers are invalid. Reads every number once.
LentCurves find_curves(const MarramFrame& frame, std::string_view name, const std::string& place);

} // namespace marram
