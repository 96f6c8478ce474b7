// SPDX-License-Identifier: Apache-2.0
#include "core/manual/scene_reference.h"

#include "core/host/plugin_library.h"
#include "core/render/film.h"
#include "core/scene/param_types.h"
#include "core/shot/picture_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <span>
#include <string_view>

namespace marram {
namespace {

std::string kind_of(const ParamSpec& spec) {
    if (spec.type == ParamType::choice) return spec.choices;
    std::string kind(row_of(spec.type).kind);
    if (spec.type == ParamType::reference) kind += " " + spec.choices;
    return kind;
}

std::string default_of(const ParamSpec& spec) {
    if (spec.type == ParamType::unavailable) return "-";
    if (spec.initial.empty()) return "required";
    return spec.initial == "none" ? "-" : spec.initial;
}

// A help text behind `row`, wrapped at 100 columns below its beginning; where the row leaves little room,
// below the row.
std::string with_help(std::string row, std::string_view help) {
    constexpr size_t columns = 100, min_width = 36, indent = 8;
    size_t begin = row.size();
    if (columns < begin + min_width && begin + help.size() > columns) {
        row.erase(row.find_last_not_of(' ') + 1);
        row += "\n" + std::string(indent, ' ');
        begin = indent;
    }
    size_t at = begin;
    for (size_t word = 0; word < help.size();) {
        const size_t end = std::min(help.find(' ', word), help.size());
        if (at > begin && at + 1 + (end - word) > columns) {
            row += "\n" + std::string(begin, ' ');
            at = begin;
        } else if (at > begin) {
            row += ' ';
            ++at;
        }
        row += help.substr(word, end - word);
        at += end - word;
        word = end + 1;
    }
    row.erase(row.find_last_not_of(' ') + 1);
    return row + "\n";
}

// The width of a column: of its longest cell that is not so long that it would push all others aside.
void widen(size_t& column, const std::string& cell) {
    constexpr size_t max_column = 28;
    if (cell.size() <= max_column) column = std::max(column, cell.size());
}

std::string params_text(std::span<const ParamSpec> params) {
    size_t name = 0, kind = 0, initial = 0, unit = 0;
    for (const ParamSpec& spec : params) {
        widen(name, spec.name);
        widen(kind, kind_of(spec));
        widen(initial, default_of(spec));
        widen(unit, spec.unit);
    }
    std::string text;
    for (const ParamSpec& spec : params)
        text += with_help(fmt::format("    {:{}}  {:{}}  {:{}}  {:{}}  ", spec.name, name, kind_of(spec),
                                      kind, default_of(spec), initial, spec.unit, unit),
                          spec.help + (spec.keyable ? " (keys)" : ""));
    if (std::ranges::any_of(params, &ParamSpec::keyable))
        text +=
            "    (keys): may change in time, { keys = [[frame, value], ...], interpolation = \"linear\" }\n"
            "        or \"smooth\", or \"constant\"\n";
    std::string_view last; // the list explained last
    for (const ParamSpec& spec : params) {
        const std::string_view list = list_of(spec.name);
        if (list.empty() || list == last) continue;
        text += fmt::format("    {0}[] belongs to every table of a list: {0} = [{{ ... }}, ...]\n", list);
        last = list;
    }
    return text;
}

// One table of the scene language. name: the subject that names it.
struct Topic {
    std::string name, title, help;
    std::span<const ParamSpec> params;
    std::string table;  // that has types: "light"; "": it has none
    std::string text{}; // lines below the title
};

std::vector<Topic> topics(const Schema& schema) {
    std::vector<Topic> list = {{"globals", "before the first table", "", schema.globals},
                               {"camera", "[camera]", "", schema.camera},
                               {"film", "[film]", "", schema.film},
                               {"wind", "[wind]", "", schema.wind, "", schema.wind_help}};
    const auto add = [&](const std::vector<ItemSchema>& items, const std::string& table) {
        for (const ItemSchema& item : items) {
            const std::string title = fmt::format("[[{}]] type = \"{}\"", table, item.type);
            const std::string why = item.unusable.empty() ? "" : " (cannot be used: " + item.unusable + ")";
            list.push_back({item.type, title, item.help + why, item.params, table});
            for (const ListSchema& inner : item.lists)
                for (const ItemSchema& one : inner.types)
                    list.push_back({one.type,
                                    fmt::format("[[{}.{}]] type = \"{}\", of a {}", table, inner.name,
                                                one.type, item.type),
                                    one.help, one.params, inner.name});
        }
    };
    add(schema.lights, "light");
    add(schema.materials, "material");
    add(schema.meshes, "mesh");
    add(schema.curves, "curves");
    add(schema.procedurals, "procedural");
    return list;
}

// Each line behind four spaces.
std::string indented(const std::string& text) {
    std::string out;
    for (size_t begin = 0; begin < text.size();) {
        const size_t end = std::min(text.find('\n', begin), text.size());
        out += "    " + text.substr(begin, end - begin) + "\n";
        begin = end + 1;
    }
    return out.empty() ? out : out + "\n";
}

std::string topic_text(const Topic& topic) {
    std::string text = fmt::format("{}{}{}\n{}{}\n", topic.title, topic.help.empty() ? "" : ": ", topic.help,
                                   indented(topic.text), params_text(topic.params));
    if (topic.title.starts_with("[[procedural]]"))
        text += "    library (file; default: libmarram_procedural.so; without a folder it is looked for "
                "beside the "
                "scene, in MARRAM_PLUGIN_PATH and where the program is installed): the shared library that "
                "has the "
                "type\n\n";
    return text;
}

// The image layers for film.aovs and --aov, each with its channels in an EXR; the list that check_layers()
// accepts.
std::string layers_text(const PluginSet& plugins) {
    std::string text = "image layers (film.aovs, --aov, --png), in an EXR as LAYER.CHANNEL; beauty and alpha "
                       "are R, G, B, A\n";
    const auto add = [&](std::string_view name, std::string_view channels, std::string_view help) {
        text += fmt::format("    {:<14} {:<8} {}\n", name, channels, help);
    };
    for (const BuiltInLayer& layer : built_in_layers()) add(layer.name, layer.channel_names, layer.help);
    std::set<std::string> told; // attributes of several procedurals may have the same name
    for (const auto& [path, library] : plugins.libraries)
        for (const ProceduralType& type : library->types())
            for (const MarramAttribute& attribute : type.attributes)
                if (told.insert(attribute.name).second)
                    add(attribute.name,
                        fmt::format("{}", fmt::join(attribute_channels(attribute.components), " ")),
                        fmt::format("of a {}: {}", type.calls.name, attribute.help));
    return text + "\n";
}

// The parameters of this name, or of the table of this name, wherever they occur: "gusts", "aovs".
std::string params_named(const Schema& schema, const std::string& name) {
    std::string text;
    for (const Topic& topic : topics(schema)) {
        std::vector<ParamSpec> found;
        std::ranges::copy_if(topic.params, std::back_inserter(found), [&](const ParamSpec& spec) {
            return spec.name == name || spec.name.starts_with(name + ".") ||
                   spec.name.starts_with(name + "[");
        });
        if (!found.empty()) text += fmt::format("in {}\n{}\n", topic.title, params_text(found));
    }
    return text;
}

// The types of a table: of "light" or "lights".
std::string types_of(const Schema& schema, const std::string& subject) {
    std::string text;
    for (const Topic& topic : topics(schema)) {
        if (topic.table.empty() ||
            (subject != topic.table && subject != topic.table + "s" && subject != topic.table + "es"))
            continue;
        if (text.empty())
            text = fmt::format("types of {}; marram info TYPE lists the parameters of one\n",
                               topic.title.substr(0, topic.title.find(' ')));
        text += fmt::format("    {:<14} {}\n", topic.name, topic.help);
    }
    return text.empty() ? text : text + "\n";
}

} // namespace

std::vector<std::string> reference_subjects(const PluginSet& plugins) {
    std::vector<std::string> subjects = {"layers", "light", "material"};
    for (const Topic& topic : topics(plugins.schema)) // strands are curves and a procedural
        if (std::ranges::find(subjects, topic.name) == subjects.end()) subjects.push_back(topic.name);
    return subjects;
}

std::string reference_text(const PluginSet& plugins, const std::string& subject) {
    std::string text;
    for (const Topic& topic : topics(plugins.schema))
        if (subject.empty() || subject == topic.name) text += topic_text(topic);
    if (subject.empty() || subject == "layers") text += layers_text(plugins);
    if (text.empty()) text = types_of(plugins.schema, subject);
    return text.empty() ? params_named(plugins.schema, subject) : text;
}

CompletionWords completion_words(const PluginSet& plugins) {
    CompletionWords words{reference_subjects(plugins), {}};
    for (const BuiltInLayer& layer : built_in_layers()) words.layers.emplace_back(layer.name);
    for (const auto& [path, library] : plugins.libraries)
        for (const ProceduralType& type : library->types())
            for (const MarramAttribute& attribute : type.attributes)
                if (std::ranges::find(words.layers, attribute.name) == words.layers.end())
                    words.layers.emplace_back(attribute.name);
    return words;
}

} // namespace marram
