// SPDX-License-Identifier: Apache-2.0
// Values of a scene's own tables that have keys, at a frame. (Procedurals get the keys themselves.)
#pragma once

#include "core/math/params.h"

namespace marram {

bool has_keys(const ParamSet& params);
// The same values without keys: those at the frame.
ParamSet values_at(const ParamSet& params, double frame);

// The same parameter, whose numbers may have keys.
inline ParamSpec keyable(ParamSpec spec) {
    spec.keyable = true;
    return spec;
}
// Marks numbers, vectors and colours as keyable.
std::vector<ParamSpec> with_keyable_numbers(std::vector<ParamSpec> params);

} // namespace marram
