// SPDX-License-Identifier: Apache-2.0
// Path mapping: the files that a scene names may lie elsewhere on this machine.
#pragma once

#include <string>
#include <vector>

namespace marram {

// Of the paths that a rule replaces. WINDOWS: letters of either case and both slashes are the same.
enum class PathFormat { posix, windows };

struct PathRule {
    PathFormat format = PathFormat::posix;
    std::string from, to; // folders or files
};

struct PathMap {
    std::vector<PathRule> rules;

    // The path with its beginning replaced by the rule that matches the most parts of it, the first of
    // equals; itself if none matches. A rule matches whole parts: "/show" is no beginning of "/shows/a.obj".
    // The rest gets the slashes of this system.
    std::string apply(const std::string& path) const;
};

// A rule "FROM=TO", split at the first "=". It is one of WINDOWS if FROM has a backslash or begins with a
// drive ("P:"). Throws InputError, which names it as --map.
PathRule parse_path_rule(const std::string& text);

// The rules of an OpenJD file, pathmapping-1.0 (JSON). Throws InputError with line and column if it is not
// one.
std::vector<PathRule> read_path_rules(const std::string& file);

} // namespace marram
