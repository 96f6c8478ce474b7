// SPDX-License-Identifier: Apache-2.0
// Writes changed values into the text of a scene file, as a person would: everything else keeps its bytes.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// The text of a scene file with changed values. Comments, order and formatting of everything else stay.
//   text      of the file, with or without a byte order mark; lines end in \n or \r\n
//   file      its path, for messages
//   settings  "key=value" as of --set; the last one counts
// A value in the file is replaced in place. A list that keeps its size is changed element by element, so that
// the comments in it stay. A new key follows the last key of its table, a new [table] the one before it in
// camera, film, wind. "key={}" takes the key out, with its table if that is left empty. A new list of several
// tables has each of them on a line of its own.
// The result parses to the tree that --set gives: this is checked. An unchanged value keeps its text (0.5 or
// 0.50).
// Throws InputError for a text that is not TOML, with all mistakes in settings that --set would report, and
// for the few values that have no place in the text. Keys and values are not checked against a schema:
// load_scene does.
std::string edited_scene(const std::string& text, const std::string& file,
                         std::span<const std::string> settings);

// The value that a key has in the text, with settings: as of --set, on one line. None: it has none there, or
// the key names nothing.
std::optional<std::string> value_in_scene(const std::string& text, const std::string& file,
                                          const std::vector<std::string>& settings, const std::string& key);

} // namespace marram
