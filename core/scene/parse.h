// SPDX-License-Identifier: Apache-2.0
// Scene file -> TOML tree, and the --set overrides laid over that tree. Nothing here knows what a key means.
#pragma once

#include "core/scene/reading.h"

namespace marram {

// Reads and parses reading.file. Throws InputError when there is no file, it is a directory, unreadable,
// larger than 64 MB or no TOML.
toml::table parse_scene(Reading& reading);

constexpr size_t most_parts = 17; // of a dotted key; the deepest that means anything has 4

// Where a dotted key begins to have more parts than that. toml++ limits the nesting of values but not of
// dotted keys (a.a.a.a ...), and takes its tree down recursively: ten thousands of dots end the process. So
// keys are counted before it sees a text, by a scan that knows strings and comments.
std::optional<Place> deep_key(std::string_view text);

// Lays "key=value" settings over the tree; mistakes are reported, the rest is applied all the same.
//   film.samples=4            a key, dotted where tables nest; tables that the file lacks are added
//   mesh.hill.file="x.obj"    light, material, mesh and procedural are addressed by name
// The value is TOML (4, [1, 2], "x", { a = 1 }); what is no TOML is taken as a text, so quotes may be left
// out. Paths are relative to the scene file, as everywhere.
void apply_settings(toml::table& root, const std::vector<std::string>& settings, Reading& reading);

} // namespace marram
