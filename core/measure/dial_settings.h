// SPDX-License-Identifier: Apache-2.0
// What functions that make dials share.
#pragma once

#include "core/measure/dials.h"

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace marram {

// Whether the procedural of an item declares a parameter.
bool declares(const Shot& shot, const Item& item, const std::string& key);

// The wind parameter of a groom: its own if given, else the scene's; nullptr if neither has it.
const ParamValue* wind_value(const Shot& shot, const Item& groom, const std::string& name);

// The declaration of a key by a procedural of the scene; nullptr if none has it.
const ParamSpec* declaration(const Shot& shot, const std::string& key);

// The values of a sweep as numbers; empty if no procedural of the scene has the key.
std::vector<double> sweep_of(const Shot& shot, const std::string& key);

// Changes that set a key in every procedural that declares it and for which `only` is true.
std::vector<std::string> set_in_procedurals(
    const Shot& shot, const std::string& key, const std::string& value,
    const std::function<bool(const Item&)>& only = [](const Item&) { return true; });

// Settings with their numbers, in ascending order.
using NumberedSettings = std::vector<std::pair<double, DialSetting>>;

// Marks the scene's own value among the settings, or inserts it in order if it is not one of them.
void add_own(NumberedSettings& settings, double own, const std::string& label);

std::vector<DialSetting> settings_of(NumberedSettings numbered);

// The setting that the tolerance chooses.
DialSetting tolerance_setting(bool own, std::vector<std::string> changes);

} // namespace marram
