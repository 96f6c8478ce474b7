// SPDX-License-Identifier: Apache-2.0
#include "core/measure/dial_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

namespace marram {
namespace {

std::vector<double> sweep_of(const ParamSpec& spec) {
    std::vector<double> values;
    std::istringstream text(spec.sweep);
    for (std::string value; std::getline(text, value, '|');) values.push_back(std::stod(value));
    return values;
}

} // namespace

bool declares(const Shot& shot, const Item& item, const std::string& key) {
    for (const ItemSchema& schema : shot.plugins->schema.procedurals)
        if (schema.type == item.type)
            return std::ranges::any_of(schema.params,
                                       [&](const ParamSpec& spec) { return spec.name == key; });
    return false;
}

const ParamValue* wind_value(const Shot& shot, const Item& groom, const std::string& name) {
    const ParamValue* own = groom.params.find("wind." + name);
    return own && own->given ? own : shot.description.wind.find(name);
}

const ParamSpec* declaration(const Shot& shot, const std::string& key) {
    for (const Item& item : shot.description.procedurals)
        for (const ItemSchema& schema : shot.plugins->schema.procedurals)
            if (schema.type == item.type)
                for (const ParamSpec& spec : schema.params)
                    if (spec.name == key) return &spec;
    return nullptr;
}

std::vector<double> sweep_of(const Shot& shot, const std::string& key) {
    const ParamSpec* spec = declaration(shot, key);
    return spec ? sweep_of(*spec) : std::vector<double>{};
}

std::vector<std::string> set_in_procedurals(const Shot& shot, const std::string& key,
                                            const std::string& value,
                                            const std::function<bool(const Item&)>& only) {
    std::vector<std::string> changes;
    for (const Item& item : shot.description.procedurals)
        if (declares(shot, item, key) && only(item))
            changes.push_back(fmt::format("procedural.{}.{}={}", item.name_in_file(), key, value));
    return changes;
}

void add_own(NumberedSettings& settings, double own, const std::string& label) {
    const auto at = std::ranges::find_if(settings, [&](const auto& setting) { return setting.first >= own; });
    if (at != settings.end() && at->first == own)
        at->second.own = true, at->second.changes.clear();
    else
        settings.insert(at, {own, {label, {}, true, 0}});
}

DialSetting tolerance_setting(bool own, std::vector<std::string> changes) {
    if (own) changes.clear();
    return {"by the tolerance", std::move(changes), own, 0, 0.0, true};
}

std::vector<DialSetting> settings_of(NumberedSettings numbered) {
    std::vector<DialSetting> settings;
    for (auto& [number, setting] : numbered) settings.emplace_back(std::move(setting)).number = number;
    return settings;
}

} // namespace marram
