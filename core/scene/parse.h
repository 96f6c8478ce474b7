// SPDX-License-Identifier: Apache-2.0
// Parses a scene file into a TOML tree, and applies the --set overrides to it. The meaning of keys is not
// known here.
#pragma once

#include "core/scene/reading.h"

namespace marram {

// Reads and parses reading.file. Throws InputError if the file does not exist, is a directory, unreadable,
// larger than 64 MB, or not TOML.
toml::table parse_scene(Reading& reading);

constexpr size_t max_parts = 17; // of a dotted key; the deepest valid key has 4

// The place where a dotted key exceeds max_parts parts, or nullopt. toml++ limits the nesting of values but
// not of dotted keys (a.a.a.a ...), and destroys its tree recursively: tens of thousands of dots overflow the
// stack. So the parts are counted before parsing, by a scan that understands strings and comments.
std::optional<Place> deep_key(std::string_view text);

// Parses `value = <text>`, with `source` as the path of its nodes. Returns an empty table if <text> is not a
// single value.
toml::table parse_value(std::string_view text, const std::string& source);

// Applies "key=value" settings to the tree. Mistakes are reported, and the other settings still applied.
//   film.samples=4            a key, dotted where tables nest; missing tables are added
//   mesh.hill.file="x.obj"    light, material, mesh and procedural are addressed by name
// The value is TOML (4, [1, 2], "x", { a = 1 }). A value that is not TOML is taken as text, so quotes may be
// left out. Paths are relative to the scene file.
void apply_settings(toml::table& root, const std::vector<std::string>& settings, Reading& reading);

} // namespace marram
