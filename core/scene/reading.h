// SPDX-License-Identifier: Apache-2.0
// State shared by the steps of reading a scene: the file, its schema, the problems found so far.
#pragma once

#include "core/math/params.h"
#include "core/scene/description.h"
#include "core/scene/path_map.h"

#include <optional>
#include <string>
#include <toml++/toml.h>
#include <unordered_map>
#include <vector>

namespace marram {

struct Reading {
    std::string file; // as given on the command line
    const Schema* schema = nullptr;
    PathMap paths; // applied to each file that the scene names
    std::vector<Problem> problems;
    // Defaults are TOML texts. Each is parsed once and cached.
    std::unordered_map<const ParamSpec*, std::optional<ParamValue>> defaults;

    void report(Place place, std::string what, std::string fix, std::string id = "") {
        problems.push_back({std::move(place), std::move(what), std::move(fix), std::move(id)});
    }
};

// The source path of a node is the scene file, or "--set key=value", for which no line is given.
inline Place place_of(const toml::source_region& source, const Reading& reading) {
    if (source.path && *source.path != reading.file) return {*source.path, 0, 0};
    return {reading.file, static_cast<int>(source.begin.line), static_cast<int>(source.begin.column)};
}
inline Place place_of(const toml::node& node, const Reading& reading) {
    return place_of(node.source(), reading);
}

// Throws the reported problems, if any: those of the file by line and column, then those of settings.
void throw_problems(Reading& reading);

} // namespace marram
