// SPDX-License-Identifier: Apache-2.0
// The parameter values that a renderer passes to create(), read by name, and the error type for faults in
// them.
#pragma once

#include "core/math/keyframes.h"
#include "core/math/known_part.h"
#include "core/math/ramp.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <unordered_map>

namespace marram {

inline constexpr double max_wind_input = 1e9; // m or m/s; a limit that keeps products finite

// An error in the scene that only the procedural can detect. guarded() catches it and sends it to the host.
struct SceneFault : std::runtime_error {
    SceneFault(std::string name, std::string where, const std::string& what_is_wrong, std::string what_to_do)
        : std::runtime_error(what_is_wrong), id(std::move(name)), place(std::move(where)),
          remedy(std::move(what_to_do)) {}
    std::string id, place, remedy; // as in MarramMessage
};

// Sends a message to the host.
inline void send(const MarramHost& host, MarramSeverity severity, const char* id, const std::string& place,
                 const std::string& what, const std::string& remedy) {
    const MarramMessage message{sizeof(MarramMessage), severity,     id,
                                place.c_str(),         what.c_str(), remedy.c_str()};
    host.message(host.user, &message);
}

class Values {
  public:
    // Borrows the values, which must have passed the checks of contract_checks.h.
    explicit Values(std::span<const MarramValue> values) {
        by_name_.reserve(values.size());
        for (const MarramValue& value : values) by_name_.emplace(value.name, &value);
    }

    const MarramValue* find(std::string_view name) const {
        const auto found = by_name_.find(name);
        return found == by_name_.end() ? nullptr : found->second;
    }
    // Throws SceneFault if the renderer left out a declared value, which breaks the contract.
    const MarramValue& at(std::string_view name) const {
        if (const MarramValue* value = find(name)) return *value;
        throw SceneFault("contract.missing_value", "",
                         "the parameter '" + std::string(name) + "' was not handed over",
                         "pass every declared value");
    }
    bool has(std::string_view name) const { return find(name) != nullptr; }
    double number(std::string_view name) const { return at(name).numbers[0]; }
    int integer(std::string_view name) const { return static_cast<int>(at(name).numbers[0]); }
    bool boolean(std::string_view name) const { return at(name).numbers[0] != 0.0; }
    Vec2d range(std::string_view name) const { return Vec2d(at(name).numbers); }
    Vec3d vec3(std::string_view name) const { return Vec3d(at(name).numbers); }
    std::string_view text(std::string_view name) const { return at(name).text; }
    Ramp ramp(std::string_view name) const {
        const MarramValue& value = at(name);
        return Ramp(std::span(value.numbers, value.number_count), value.text);
    }
    // Empty if the value is constant or absent.
    std::optional<Keyframes> keyframes(std::string_view name) const {
        const MarramValue* value = find(name);
        if (!value || !value->keyframes) return {};
        const MarramKeyframes keys = known_part(value->keyframes);
        return Keyframes{{keys.frames, keys.frames + keys.count},
                         {keys.numbers, keys.numbers + keys.count * value->number_count},
                         key_interpolation(keys.interpolation).value_or(KeyInterpolation::linear)};
    }

  private:
    std::unordered_map<std::string_view, const MarramValue*> by_name_;
};

// The value in radians of a parameter given in degrees.
inline double radians(const Values& values, std::string_view name) { return values.number(name) * degree; }

// A ramp that is 0 at 1 and jumps nowhere. jumps, ends: ids of the faults if it is not so.
inline Ramp falling_ramp(const Values& values, const std::string& name, const char* jumps, const char* ends) {
    const Ramp ramp = values.ramp(name);
    if (ramp.interpolation() == Ramp::Interpolation::constant)
        throw SceneFault(jumps, values.at(name).place,
                         name + " is constant between knots: strands would jump", "use linear or smooth");
    if (ramp(1.0) != 0.0)
        throw SceneFault(ends, values.at(name).place, name + " is not 0 at 1",
                         "end the ramp with the knot [1, 0]");
    return ramp;
}

// A ramp whose values must be within [0, 1]. `id`: of the fault if they are not.
inline Ramp unit_ramp(const Values& values, std::string_view name, const char* id) {
    Ramp ramp = values.ramp(name);
    for (const double value : ramp.values())
        if (value < 0.0 || value > 1.0)
            throw SceneFault(id, values.at(name).place, std::string(name) + " leaves 0 ... 1",
                             "keep its values inside");
    return ramp;
}

} // namespace marram
