// SPDX-License-Identifier: Apache-2.0
// Named attributes of geometry, and grids. Procedurals write and read them; shading and image layers read
// them.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

struct AttributeValues {
    std::string name;
    uint32_t components = 1;
    MarramRate rate = MARRAM_PER_CURVE;
    std::vector<float> values;   // `components` for each curve, CV, vertex or face
    bool discrete = false;       // an id or class, not a quantity: never averaged
    bool animated = false;       // differs from frame to frame
    const float* lazy = nullptr; // of lazy curves, whose memory is reserved: in place of `values`

    const float* data() const { return lazy ? lazy : values.data(); }
};

// nullptr where there is no such attribute.
inline const AttributeValues* find_attribute(const std::vector<AttributeValues>& attributes,
                                             std::string_view name) {
    const auto found = std::ranges::find(attributes, name, &AttributeValues::name);
    return found == attributes.end() ? nullptr : &*found;
}

struct GridValues {
    std::string name;
    MarramGrid grid{}; // without name and values
    std::vector<float> values;
};

} // namespace marram
