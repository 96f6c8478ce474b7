// SPDX-License-Identifier: Apache-2.0
// The types of parameters in scenes. To add one: a ParamType in core/math/params.h, a row in param_types.cpp
// and a test file in tests/broken; and, for procedurals to declare it, an enumerator and a row
// with the same name in core/plugin/marram_types.h.
#pragma once

#include "core/scene/reading.h"

#include <optional>
#include <string>
#include <string_view>

namespace marram {

struct ParamTypeRow {
    ParamType type;
    std::string_view contract_name; // MarramTypeForm::name; "": only the host has this type
    std::string_view kind;          // in `marram info`
    bool is_text;                   // written in quotes, which a default may leave out
    // Reads the node into `value`. False: it is wrong, which has been reported.
    bool (*read)(const toml::node& node, const ParamSpec& spec, const std::string& label, ParamValue& value,
                 Reading& reading);
    std::string (*wanted)(const ParamSpec& spec);
};

const ParamTypeRow& row_of(ParamType type);

// Empty if no type of the host has this name in the contract.
std::optional<ParamType> param_type_of(std::string_view contract_name);

// For messages, after "give": `a whole number from 1 to 64`, `[x, y, z], three numbers in m`.
std::string wanted(const ParamSpec& spec);

} // namespace marram
