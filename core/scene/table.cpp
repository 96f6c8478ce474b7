// SPDX-License-Identifier: Apache-2.0
#include "core/scene/table.h"
#include "core/scene/suggest.h"
#include "core/scene/values.h"
#include "core/scene/words.h"

#include <algorithm>
#include <fmt/format.h>

namespace marram {
namespace {

using Given = std::unordered_map<const ParamSpec*, std::optional<ParamValue>>; // empty: given and wrong

void add_once(std::vector<std::string>& words, std::string word) {
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(std::move(word));
}

// Where else a key of this name may stand: the usual slip is a global below the first table header.
std::string home_of(const std::string& name, const TableToRead& job, const Reading& reading) {
    if (!reading.schema) return "";
    auto declares = [&](const std::vector<ParamSpec>& specs) {
        return std::any_of(specs.begin(), specs.end(),
                           [&](const ParamSpec& spec) { return spec.name == name; });
    };
    const Schema& schema = *reading.schema;
    if (!job.address.empty() && declares(schema.globals))
        return "move it to the top, before the first [table]";
    for (const auto& [table, specs] :
         {std::pair{"camera", &schema.camera}, {"film", &schema.film}, {"wind", &schema.wind}})
        if (job.address != table && declares(*specs)) return fmt::format("move it to [{}]", table);
    return "";
}

void report_unknown(const toml::key& key, const std::string& prefix, const TableToRead& job,
                    Reading& reading) {
    const std::string name = prefix + std::string(key.str());
    std::vector<std::string> here, all; // what may stand at this level; and what a near miss is looked for in
    for (const ParamSpec* spec : job.specs) {
        if (!spec->name.starts_with(prefix)) continue;
        const std::string rest = spec->name.substr(prefix.size());
        add_once(all, rest.substr(0, rest.find('.')));
        add_once(all, rest);
        if (spec->type != ParamType::unavailable) add_once(here, rest.substr(0, rest.find('.')));
        // "frequency" where "noise.frequency" is meant
        if (const size_t dot = rest.rfind('.');
            dot != std::string::npos && rest.substr(dot + 1) == key.str()) {
            reading.report(place_of(key.source(), reading),
                           fmt::format("{} is unknown", clean(join(job.address, name))),
                           fmt::format("did you mean {}?", in_quotes(rest)));
            return;
        }
    }
    if (prefix.empty()) {
        all.insert(all.end(), job.others.begin(), job.others.end());
        here.insert(here.end(), job.others.begin(), job.others.end());
    }
    std::string fix = home_of(name, job, reading);
    if (fix.empty())
        fix = nearest(key.str(), all).empty() ? hint("", here, "key to be given here")
                                              : hint(key.str(), all, "");
    reading.report(place_of(key.source(), reading),
                   fmt::format("{} is unknown", clean(join(job.address, name))), fix);
}

void report_unavailable(const toml::key& key, const ParamSpec& spec, const TableToRead& job,
                        Reading& reading) {
    const std::string help = spec.help.empty() ? "" : " (" + spec.help + ")";
    const std::string owner = job.address.empty() ? "" : job.address + ": ";
    reading.report(place_of(key.source(), reading),
                   fmt::format("{}{} is not available in this build", owner, spec.name), "remove it" + help);
}

void take(const toml::key& key, const toml::node& node, const ParamSpec& spec, const TableToRead& job,
          Given& given, Reading& reading) {
    if (spec.type == ParamType::unavailable) return report_unavailable(key, spec, job, reading);
    const std::string label = join(job.address, spec.name);
    const auto [entry, is_new] = given.try_emplace(&spec);
    if (is_new)
        entry->second = read_value(node, spec, label, reading);
    else // "noise.frequency" in quotes, and noise.frequency
        reading.report(place_of(key.source(), reading), fmt::format("{} is given twice", label),
                       "remove one of them");
}

// Nested tables make dotted names: the walk goes down as long as a declared name goes on.
void walk(const toml::table& table, const std::string& prefix, const TableToRead& job, Given& given,
          Reading& reading) {
    for (const auto& [key, node] : table) {
        const std::string name = prefix + std::string(key.str());
        if (prefix.empty() && std::find(job.others.begin(), job.others.end(), name) != job.others.end())
            continue;
        const std::string inner = name + ".";
        const ParamSpec* exact = nullptr;
        bool nests = false;
        for (const ParamSpec* spec : job.specs) {
            if (spec->name == name) exact = spec;
            nests = nests || spec->name.starts_with(inner);
        }
        if (exact && !(nests && node.is_table()))
            take(key, node, *exact, job, given, reading);
        else if (nests && node.is_table())
            walk(*node.as_table(), inner, job, given, reading);
        else if (nests)
            reading.report(
                place_of(node, reading), fmt::format("{} is {}", join(job.address, name), found(node)),
                fmt::format("give a table, [{}] or {} = {{ ... }}", join(job.address, name), key.str()));
        else
            report_unknown(key, prefix, job, reading);
    }
}

} // namespace

ParamSet read_table(const TableToRead& job, Reading& reading) {
    Given given;
    if (job.table) walk(*job.table, "", job, given, reading);
    ParamSet params;
    for (const ParamSpec* spec : job.specs) {
        if (const auto entry = given.find(spec); entry != given.end()) {
            if (entry->second) params.put(std::move(*entry->second));
            continue;
        }
        if (spec->type == ParamType::unavailable || spec->initial == "none") continue;
        const std::string label = join(job.address, spec->name);
        if (spec->initial.empty()) {
            reading.report(job.place, fmt::format("{} is missing", label),
                           fmt::format("add {} = ... ({}; {})", spec->name, spec->help, wanted(*spec)));
        } else if (auto value = default_value(*spec, label, job.place, reading)) {
            params.put(std::move(*value));
        }
    }
    return params;
}

} // namespace marram
