// SPDX-License-Identifier: Apache-2.0
// Declarations of parameters, a function for each type: param::number("width", "m", "0.01", 0, 1, "diameter").
//
// initial: the default, in TOML as in a scene file; "": must be given; "none": may be absent. Numbers have
// bounds, inclusive. sweep, sweep_time: what `marram measure` tries (MarramParam).
#pragma once

#include "core/plugin/marram_plugin.h"

namespace marram::param {

// Of types without numbers.
constexpr MarramParam without_bounds(const char* name, MarramParamType type, const char* initial,
                                     const char* choices, const char* help, const char* sweep,
                                     const char* sweep_time) {
    return {name, type, "", initial, 0.0, 0.0, choices, help, sweep, sweep_time, 0};
}

#define MARRAM_NUMERIC_PARAM(function, type)                                                                 \
    constexpr MarramParam function(const char* name, const char* unit, const char* initial, double minimum,  \
                                   double maximum, const char* help, const char* sweep = "",                 \
                                   const char* sweep_time = "") {                                            \
        return {name, type, unit, initial, minimum, maximum, "", help, sweep, sweep_time, 0};                \
    }
MARRAM_NUMERIC_PARAM(number, MARRAM_NUMBER)
MARRAM_NUMERIC_PARAM(integer, MARRAM_INTEGER)
MARRAM_NUMERIC_PARAM(vec2, MARRAM_VEC2)
MARRAM_NUMERIC_PARAM(vec3, MARRAM_VEC3)
MARRAM_NUMERIC_PARAM(range, MARRAM_RANGE)
MARRAM_NUMERIC_PARAM(ramp, MARRAM_RAMP) // bounds: of its values
#undef MARRAM_NUMERIC_PARAM

#define MARRAM_PLAIN_PARAM(function, type)                                                                   \
    constexpr MarramParam function(const char* name, const char* initial, const char* help,                  \
                                   const char* sweep = "", const char* sweep_time = "") {                    \
        return without_bounds(name, type, initial, "", help, sweep, sweep_time);                             \
    }
MARRAM_PLAIN_PARAM(boolean, MARRAM_BOOLEAN)
MARRAM_PLAIN_PARAM(text, MARRAM_TEXT)
MARRAM_PLAIN_PARAM(curves, MARRAM_CURVES_NAME) // the name of curves
MARRAM_PLAIN_PARAM(keys, MARRAM_KEYS)
MARRAM_PLAIN_PARAM(volume, MARRAM_VOLUME)
#undef MARRAM_PLAIN_PARAM

// choices: what MarramParam.choices means for the type.
#define MARRAM_PARAM_WITH(choices, function, type)                                                           \
    constexpr MarramParam function(const char* name, const char* initial, const char* choices,               \
                                   const char* help, const char* sweep = "", const char* sweep_time = "") {  \
        return without_bounds(name, type, initial, choices, help, sweep, sweep_time);                        \
    }
MARRAM_PARAM_WITH(choices, choice, MARRAM_CHOICE) // "a|b|c"
MARRAM_PARAM_WITH(each, mesh, MARRAM_MESH_NAME)   // "each": or a list of names, an instance for each
MARRAM_PARAM_WITH(uv, image, MARRAM_IMAGE)        // "uv": may be in UDIM tiles
MARRAM_PARAM_WITH(columns, table, MARRAM_TABLE)   // "time|speed"
#undef MARRAM_PARAM_WITH

// The same parameter, whose numbers may have keys.
constexpr MarramParam keyable(MarramParam param) {
    param.keyable = 1;
    return param;
}

} // namespace marram::param
