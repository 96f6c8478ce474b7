// SPDX-License-Identifier: Apache-2.0
// A table of the scene file against the parameters its owner declares.
#pragma once

#include "core/scene/reading.h"

namespace marram {

struct TableToRead {
    const toml::table* table = nullptr; // none: the file lacks it, everything is default
    Place place;                        // of the table
    std::string address;                // as --set has it: "" for globals, "film", "mesh.hill"
    std::vector<const ParamSpec*> specs;
    std::span<const ListSchema> lists{}; // of elements with types of their own
    // Where the table is an element of a list: how declared names begin, "gusts.control[].", and what stands for that in
    // names of values, "gusts.control[1]."
    std::string declared_prefix, prefix;
    std::vector<std::string>
        others; // keys that are no parameters and somebody else's to check: name, type, film, ...
};

// Every declared parameter, given or default, for lists those of every element; what is wrong is reported and left out.
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
