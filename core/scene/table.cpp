// SPDX-License-Identifier: Apache-2.0
#include "core/scene/table.h"
#include "core/scene/param_types.h"
#include "core/scene/suggest.h"
#include "core/scene/values.h"
#include "core/scene/words.h"

#include <algorithm>
#include <fmt/format.h>

namespace marram {
namespace {

// The parameters that the file gives in a table (nullopt: given but wrong), and the elements of its lists.
struct Given {
    std::unordered_map<const ParamSpec*, std::optional<ParamValue>> values;
    ParamSet elements;
};

// Whether a parameter belongs to the table itself, not to a list within it.
bool is_own(const ParamSpec& spec, const TableToRead& job) {
    return spec.name.starts_with(job.declared_prefix) &&
           spec.name.find(list_mark, job.declared_prefix.size()) == std::string::npos;
}

// "gusts.control[].shape" -> "gusts.control[1].shape"
std::string value_name(const std::string& declared, const TableToRead& job) {
    return job.prefix + declared.substr(job.declared_prefix.size());
}

std::string label_of(const std::string& declared, const TableToRead& job) {
    return join(job.address, value_name(declared, job));
}

void add_once(std::vector<std::string>& words, std::string word) {
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(std::move(word));
}

// "known are a, b, c and 12 more: `marram info wind` lists all": the keys that can follow `prefix`.
std::string known_keys(const TableToRead& job, const std::string& prefix) {
    std::vector<std::string> here;
    for (const ParamSpec* spec : job.specs)
        if (spec->name.starts_with(prefix) && spec->type != ParamType::unavailable) {
            const std::string rest = spec->name.substr(prefix.size());
            add_once(here, rest.substr(0, rest.find_first_of(".[")));
        }
    if (prefix.empty()) {
        for (const ListSchema& list : job.lists) add_once(here, list.name);
        here.insert(here.end(), job.others.begin(), job.others.end());
    }
    const std::string known = hint("", here, "key to be given here");
    constexpr size_t shown = 8; // by listed()
    if (here.size() <= shown) return known;
    return fmt::format("{}: `marram info{}{}` lists all", known, job.subject.empty() ? "" : " ", job.subject);
}

// Where a key of this name belongs. The usual mistake is a global key below the first table header.
std::string suggest_table(const std::string& name, const TableToRead& job, const Reading& reading) {
    if (!reading.schema) return "";
    auto declares = [&](const std::vector<ParamSpec>& specs) {
        return std::any_of(specs.begin(), specs.end(),
                           [&](const ParamSpec& spec) { return spec.name == name; });
    };
    const Schema& schema = *reading.schema;
    // A key of another type of the same kind: it is not misplaced.
    for (const auto& [kind, items] : {std::pair{"light", &schema.lights},
                                      {"material", &schema.materials},
                                      {"mesh", &schema.meshes},
                                      {"curves", &schema.curves},
                                      {"procedural", &schema.procedurals}}) {
        if (job.address != kind && !job.address.starts_with(std::string(kind) + ".")) continue;
        std::vector<std::string> types;
        for (const ItemSchema& item : *items)
            if (declares(item.params)) types.push_back(item.type);
        if (!types.empty()) return fmt::format("it is a key of {}; {}", listed(types), known_keys(job, ""));
    }
    if (!job.address.empty() && declares(schema.globals))
        return "move it to the top, before the first [table]";
    for (const auto& [table, specs] :
         {std::pair{"camera", &schema.camera}, {"film", &schema.film}, {"wind", &schema.wind}})
        if (job.address != table && declares(*specs)) return fmt::format("move it to [{}]", table);
    if (!job.address.empty()) return "";
    // A table inside one of these: "gusts" for "wind.gusts".
    for (const auto& [table, specs] : {std::pair{"film", &schema.film}, {"wind", &schema.wind}})
        for (const ParamSpec& spec : *specs)
            if (spec.name.starts_with(name + "."))
                return fmt::format("did you mean {}?", in_quotes(fmt::format("{}.{}", table, name)));
    return "";
}

void report_unknown(const toml::key& key, const std::string& prefix, const TableToRead& job,
                    Reading& reading) {
    const std::string name = prefix + std::string(key.str());
    std::vector<std::string> all; // candidates for suggestions
    for (const ParamSpec* spec : job.specs) {
        if (!spec->name.starts_with(prefix)) continue;
        const std::string rest = spec->name.substr(prefix.size());
        const std::string first = rest.substr(0, rest.find_first_of(".["));
        add_once(all, first);
        if (is_own(*spec, job)) add_once(all, rest);
        // "frequency" where "noise.frequency" is meant
        if (const size_t dot = rest.rfind('.');
            dot != std::string::npos && rest.substr(dot + 1) == key.str()) {
            reading.report(place_of(key.source(), reading),
                           fmt::format("{} is unknown", clean(label_of(name, job))),
                           fmt::format("did you mean {}?", in_quotes(rest)));
            return;
        }
    }
    if (prefix.empty()) {
        for (const ListSchema& list : job.lists) add_once(all, list.name);
        all.insert(all.end(), job.others.begin(), job.others.end());
    }
    std::string fix = suggest_table(name, job, reading);
    if (fix.empty())
        fix = nearest(key.str(), all).empty() ? known_keys(job, prefix) : hint(key.str(), all, "");
    reading.report(place_of(key.source(), reading), fmt::format("{} is unknown", clean(label_of(name, job))),
                   fix);
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
    const std::string label = label_of(spec.name, job);
    const auto [entry, is_new] = given.values.try_emplace(&spec);
    if (is_new)
        entry->second = read_value(node, spec, label, reading);
    else // "noise.frequency" in quotes, and noise.frequency
        reading.report(place_of(key.source(), reading), fmt::format("{} is given twice", label),
                       "remove one of them");
}

// Reads the tables of a list, each like a single table.
void read_list(const toml::key& key, const toml::node& node, const std::string& name, const TableToRead& job,
               Given& given, Reading& reading) {
    const std::string label = label_of(name, job);
    if (given.elements.find_list(name))
        return reading.report(place_of(key.source(), reading), fmt::format("{} is given twice", label),
                              "remove one of them");
    const toml::array* list = node.as_array();
    if (!list)
        return reading.report(
            place_of(node, reading), fmt::format("{} is {}", label, found(node)),
            fmt::format("give a list of tables, {} = [{{ ... }}, ...] or in double brackets", key.str()));
    for (size_t i = 0; i < list->size(); ++i) {
        TableToRead element = job;
        element.table = list->get(i)->as_table();
        element.place = place_of(*list->get(i), reading);
        element.declared_prefix = name + std::string(list_mark);
        element.prefix = fmt::format("{}[{}].", value_name(name, job), i);
        element.others.clear();
        if (!element.table) {
            reading.report(element.place, fmt::format("{}[{}] is {}", label, i, found(*list->get(i))),
                           "give a table, { ... }");
            continue;
        }
        const ParamSet params = read_table(element, reading);
        for (const ParamValue& value : params.all()) given.elements.put(value);
    }
    given.elements.put_list({name, list->size()});
}

// Reads the tables of a list whose elements have types.
void read_typed_list(const toml::node& node, const ListSchema& schema, const TableToRead& job, Given& given,
                     Reading& reading) {
    const std::string label = label_of(schema.name, job);
    const toml::array* list = node.as_array();
    if (!list)
        return reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                              "give a list of tables, each with its type, in double brackets");
    for (size_t i = 0; i < list->size(); ++i) {
        const toml::node& entry = *list->get(i);
        const std::string name = fmt::format("{}[{}]", schema.name, i), shown = join(job.address, name);
        TableToRead element;
        element.table = entry.as_table();
        element.place = place_of(entry, reading);
        if (!element.table) {
            reading.report(element.place, fmt::format("{} is {}", shown, found(entry)),
                           "give a table with a type");
            continue;
        }
        const toml::node* type = element.table->get("type");
        if (!type) {
            const std::string misspelt = key_like_type(*element.table);
            reading.report(element.place, fmt::format("{} has no type", shown),
                           misspelt.empty() ? "add type = " + wanted(schema.type)
                                            : fmt::format("write type in place of {}", in_quotes(misspelt)));
            continue;
        }
        std::optional<ParamValue> value = read_value(*type, schema.type, shown + ".type", reading);
        if (!value) continue;
        const auto one = std::ranges::find(schema.types, value->text, &ItemSchema::type);
        value->name = name + ".type";
        given.elements.put(std::move(*value));
        element.address = job.address;
        element.subject = one->type;
        element.prefix = name + ".";
        element.specs = pointers(one->params);
        element.others = {"type"};
        const ParamSet params = read_table(element, reading);
        for (const ParamValue& inner : params.all()) given.elements.put(inner);
        for (const ParamList& inner : params.lists())
            given.elements.put_list({name + "." + inner.name, inner.size});
    }
    given.elements.put_list({schema.name, list->size()});
}

// Nested tables make dotted names: descends into tables as long as a declared name continues.
void walk(const toml::table& table, const std::string& prefix, const TableToRead& job, Given& given,
          Reading& reading) {
    for (const auto& [key, node] : table) {
        const std::string name = prefix + std::string(key.str());
        if (prefix.empty() && std::find(job.others.begin(), job.others.end(), name) != job.others.end())
            continue;
        if (const auto list = std::ranges::find(job.lists, name, &ListSchema::name);
            prefix.empty() && list != job.lists.end()) {
            read_typed_list(node, *list, job, given, reading);
            continue;
        }
        const std::string inner = name + ".", element = name + std::string(list_mark);
        const ParamSpec* exact = nullptr;
        bool nests = false, lists = false;
        for (const ParamSpec* spec : job.specs) {
            if (spec->name == name && is_own(*spec, job)) exact = spec;
            nests = nests || (spec->name.starts_with(inner) && !name.ends_with("[]"));
            lists = lists || spec->name.starts_with(element);
        }
        const std::string label = label_of(name, job);
        if (exact && !(nests && node.is_table()))
            take(key, node, *exact, job, given, reading);
        else if (lists)
            read_list(key, node, name, job, given, reading);
        else if (nests && node.is_table() && node.as_table()->empty() && place_of(node, reading).line > 0)
            // It reads as if it switched something on. With --set (no line) it removes what the file gives.
            reading.report(place_of(node, reading),
                           fmt::format("{} is an empty table, which changes nothing", label),
                           "give a key in it, or remove it");
        else if (nests && node.is_table())
            walk(*node.as_table(), inner, job, given, reading);
        else if (nests)
            reading.report(place_of(node, reading), fmt::format("{} is {}", label, found(node)),
                           fmt::format("give a table, [{}] or {} = {{ ... }}", label, key.str()));
        else
            report_unknown(key, prefix, job, reading);
    }
}

// A parameter that the file does not give: its default, or an error if it is required.
std::optional<ParamValue> default_or_missing(const ParamSpec& spec, const TableToRead& job,
                                             Reading& reading) {
    if (spec.type == ParamType::unavailable || spec.initial == "none") return {};
    const std::string label = label_of(spec.name, job);
    if (!spec.initial.empty()) return default_value(spec, label, job.place, reading);
    reading.report(job.place, fmt::format("{} is missing", label),
                   fmt::format("add {} = ... ({}; {})", spec.name.substr(job.declared_prefix.size()),
                               spec.help, wanted(spec)));
    return {};
}

} // namespace

std::string key_like_type(const toml::table& table) {
    std::vector<std::string> keys;
    for (const auto& [key, value] : table) keys.emplace_back(key.str());
    return nearest("type", keys);
}

ParamSet read_table(const TableToRead& job, Reading& reading) {
    Given given;
    if (job.table) walk(*job.table, job.declared_prefix, job, given, reading);
    ParamSet params = std::move(given.elements);
    for (const ParamSpec* spec : job.specs) {
        if (!is_own(*spec, job)) continue;
        const auto entry = given.values.find(spec);
        std::optional<ParamValue> value =
            entry != given.values.end() ? std::move(entry->second) : default_or_missing(*spec, job, reading);
        if (!value) continue;
        value->name = value_name(spec->name, job);
        params.put(std::move(*value));
    }
    return params;
}

} // namespace marram
