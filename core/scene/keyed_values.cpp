// SPDX-License-Identifier: Apache-2.0
#include "core/scene/keyed_values.h"

#include <algorithm>

namespace marram {

bool has_keys(const ParamSet& params) {
    return std::ranges::any_of(params.all(), [](const ParamValue& value) { return value.keys.has_value(); });
}

ParamSet values_at(const ParamSet& params, double frame) {
    if (!has_keys(params)) return params;
    ParamSet now;
    for (ParamValue value : params.all()) {
        if (value.keys) value.keys->at(frame, value.numbers);
        value.keys.reset();
        now.put(std::move(value));
    }
    for (const ParamList& list : params.lists()) now.put_list(list);
    return now;
}

std::vector<ParamSpec> with_keyable_numbers(std::vector<ParamSpec> params) {
    for (ParamSpec& spec : params)
        spec.keyable =
            spec.type == ParamType::number || spec.type == ParamType::vec3 || spec.type == ParamType::color;
    return params;
}

} // namespace marram
