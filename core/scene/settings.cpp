// SPDX-License-Identifier: Apache-2.0
#include "core/scene/parse.h"
#include "core/scene/suggest.h"

#include <algorithm>
#include <fmt/format.h>

namespace marram {
namespace {

// TOML's basic string; what cannot stand in one is escaped.
std::string as_string(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\')
            out += fmt::format("\\{}", c);
        else if (static_cast<unsigned char>(c) < 32 || c == 127)
            out += fmt::format("\\u{:04X}", static_cast<int>(c));
        else
            out += c;
    }
    return out + "\"";
}

// `value = <text>` as a table, so that the value knows where it comes from; empty when <text> is no single
// value.
toml::table parse_value(std::string_view text, const std::string& source) {
    if (deep_key(text)) return {};
    try {
        toml::table table = toml::parse(fmt::format("value = {}", text), std::string_view(source));
        if (table.size() == 1) return table;
    } catch (const toml::parse_error&) {
    }
    return {};
}

// The tables on the way to the last part are found, or made where there are none; then the value is put in.
void put(toml::table& root, std::span<const std::string> path, toml::node&& value, const std::string& source,
         std::string address, Reading& reading) {
    toml::table* table = &root;
    for (size_t i = 0; i + 1 < path.size(); ++i) {
        address += (address.empty() ? "" : ".") + path[i];
        toml::node* next = table->get(path[i]);
        if (!next) {
            // Made by the parser rather than by hand, so that it has a place to be named in messages.
            toml::table made = parse_value("{}", source);
            toml::table& empty = *made.get("value")->as_table();
            next =
                &table->insert_or_assign(toml::key(path[i], empty.source()), std::move(empty)).first->second;
        }
        if (!next->is_table()) {
            reading.report({source, 0, 0}, fmt::format("{} is no table", clean(address)),
                           "set it as a whole");
            return;
        }
        table = next->as_table();
    }
    const toml::key key(path.back(), value.source());
    table->erase(path.back()); // so that the key's place is the setting as well
    std::move(value).visit([&](auto&& node) {
        using Node = std::remove_cvref_t<decltype(node)>;
        table->insert_or_assign(key, Node(std::move(node)));
    });
}

// The named thing that `rest` ("hill.file") begins with; names may hold dots, the longest that fits is meant.
toml::table* find_item(toml::table& root, const std::string& kind, std::string_view rest, size_t& name_size,
                       std::vector<std::string>& names) {
    toml::table* found = nullptr;
    toml::array* items = root.get(kind) ? root.get(kind)->as_array() : nullptr;
    for (size_t i = 0; items && i < items->size(); ++i) {
        toml::table* item = items->get(i)->as_table();
        const toml::node* node = item ? item->get("name") : nullptr;
        if (!node || !node->is_string()) continue;
        const std::string& name = node->as_string()->get();
        names.push_back(name);
        const bool fits = rest.size() > name.size() && rest.starts_with(name) && rest[name.size()] == '.';
        if (!fits || (found && name.size() <= name_size)) continue;
        found = item;
        name_size = name.size();
    }
    return found;
}

std::string trim(std::string text) {
    text.erase(0, text.find_first_not_of(" \t"));
    text.erase(text.find_last_not_of(" \t") + 1);
    return text;
}

// Where a setting goes: a table of the tree, and the address as far as it and behind it.
struct Target {
    toml::table* table = nullptr;
    std::string owner, key;
};

// Nothing when the address names no thing of the scene, which is reported.
Target find_target(toml::table& root, const std::string& address, const std::string& source,
                   Reading& reading) {
    const std::string kind = address.substr(0, address.find('.'));
    if (kind != "light" && kind != "material" && kind != "mesh" && kind != "procedural")
        return {&root, "", address};
    const std::string rest = address.substr(std::min(kind.size() + 1, address.size()));
    std::vector<std::string> names;
    size_t name_size = 0;
    toml::table* table = find_item(root, kind, rest, name_size, names);
    if (table) return {table, address.substr(0, kind.size() + 1 + name_size), rest.substr(name_size + 1)};
    const std::string name = rest.substr(0, rest.find('.'));
    if (name.size() == rest.size())
        reading.report({source, 0, 0}, fmt::format("{} says no name and key", in_quotes(address)),
                       fmt::format("write {}.NAME.KEY=value", kind));
    else
        reading.report({source, 0, 0}, fmt::format("no {} is named {}", kind, in_quotes(name)),
                       hint(name, names, fmt::format("{} with a name in the scene", kind)));
    return {};
}

void apply(toml::table& root, const std::string& setting, Reading& reading) {
    const std::string source = "--set " + clean(setting);
    const std::string example = "write key=value, for example film.samples=4";
    const size_t equals = setting.find('=');
    if (equals == std::string::npos) return reading.report({source, 0, 0}, "there is no value", example);
    const std::string text = trim(setting.substr(equals + 1));
    toml::table value = parse_value(text, source);
    if (value.empty()) value = parse_value(as_string(text), source);
    if (value.empty()) return reading.report({source, 0, 0}, "the value is no UTF-8", "write it as UTF-8");

    const Target target = find_target(root, trim(setting.substr(0, equals)), source, reading);
    if (!target.table) return;
    const std::vector<std::string> path = split(target.key, '.');
    const bool gap =
        std::any_of(path.begin(), path.end(), [](const std::string& part) { return part.empty(); });
    if (path.empty() || gap || path.size() > most_parts)
        return reading.report({source, 0, 0},
                              fmt::format("{} is no key", in_quotes(setting.substr(0, equals))), example);
    put(*target.table, path, std::move(*value.get("value")), source, target.owner, reading);
}

} // namespace

void apply_settings(toml::table& root, const std::vector<std::string>& settings, Reading& reading) {
    for (const std::string& setting : settings) apply(root, setting, reading);
}

} // namespace marram
