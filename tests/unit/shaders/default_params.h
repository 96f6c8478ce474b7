// SPDX-License-Identifier: Apache-2.0
// Shader parameters as a scene file passes them: defaults, plus values set by a test.
#pragma once

#include "shaders/shader.h"

#include <algorithm>
#include <map>
#include <sstream>
#include <stdexcept>

namespace marram::testing {

inline const ShaderDescription& shader_named(std::string_view name) {
    for (const ShaderDescription& shader : shaders())
        if (shader.name == name) return shader;
    throw std::logic_error("no such shader");
}

// settings: name -> value as in a scene file.
inline ParamSet params_of(std::string_view shader, const std::map<std::string, std::string>& settings = {}) {
    ParamSet params;
    for (const ParamSpec& spec : shader_named(shader).params) {
        const auto set = settings.find(spec.name);
        std::string text = set == settings.end() ? spec.initial : set->second;
        if (text == "none") continue;
        ParamValue value;
        value.spec = &spec;
        value.given = set != settings.end();
        value.place = {"test.toml", 1, 1};
        if (text.front() == '"') {
            value.text = text.substr(1, text.size() - 2);
        } else {
            std::replace_if(
                text.begin(), text.end(), [](char c) { return c == '[' || c == ']' || c == ','; }, ' ');
            std::istringstream stream(text);
            for (double number = 0.0; stream >> number;) value.numbers.push_back(number);
            if (spec.type == ParamType::color && value.numbers.size() == 1)
                value.numbers.resize(3, value.numbers[0]);
        }
        params.put(std::move(value));
    }
    return params;
}

inline Material material_of(std::string_view shader,
                            const std::map<std::string, std::string>& settings = {}) {
    return make_material(
        shader, params_of(shader, settings),
        [](const std::string& file, TextureContent, const Place& place) -> std::shared_ptr<const Texture> {
            throw InputError(place, file + " is not opened by tests", "leave it out");
        });
}

} // namespace marram::testing
