// SPDX-License-Identifier: Apache-2.0
// Reads a table of the scene file against the parameters that its owner declares.
#pragma once

#include "core/scene/reading.h"

namespace marram {

struct TableToRead {
    const toml::table* table = nullptr; // nullptr: not in the file, use defaults
    Place place;                        // of the table
    std::string address;                // as in --set: "" for globals, "film", "mesh.hill"
    std::vector<const ParamSpec*> specs;
    std::span<const ListSchema> lists{}; // lists whose elements have types
    // For an element of a list: the prefix of its declared names, "gusts.control[].", and the prefix that
    // replaces it in the names of values, "gusts.control[1]."
    std::string declared_prefix, prefix;
    std::string subject;             // of `marram info` that lists all keys: "wind", "groom"; "": no subject
    std::vector<std::string> others; // keys that are not parameters, checked elsewhere: name, type, film, ...
};

// The key of a table without a type that may be a misspelt "type"; "" if there is none.
std::string key_like_type(const toml::table& table);

// Returns every declared parameter, given or default, and for lists those of every element. Values that are
// wrong are reported and left out.
ParamSet read_table(const TableToRead& job, Reading& reading);

inline std::vector<const ParamSpec*> pointers(std::span<const ParamSpec> specs) {
    std::vector<const ParamSpec*> all;
    for (const ParamSpec& spec : specs) all.push_back(&spec);
    return all;
}

// "film" + "size" -> "film.size"
inline std::string join(const std::string& address, std::string_view name) {
    return address.empty() ? std::string(name) : address + "." + std::string(name);
}

} // namespace marram
