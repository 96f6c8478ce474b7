// SPDX-License-Identifier: Apache-2.0
#include "core/scene/parse.h"
#include "core/scene/suggest.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <optional>

namespace marram {
namespace {

// The text as a TOML basic string, with escapes.
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

// One step into the tree: a key of a table or, with a number, an element of a list.
struct Step {
    std::string key;
    std::optional<size_t> element;
};

// Splits "layer[2].mask" into steps: layer, [2], mask. Empty if the syntax is wrong.
std::vector<Step> steps_of(const std::string& address) {
    std::vector<Step> steps;
    for (const std::string& part : split(address, '.')) {
        const size_t bracket = std::min(part.find('['), part.size());
        if (bracket == 0) return {};
        steps.push_back({part.substr(0, bracket), {}});
        for (size_t at = bracket; at < part.size();) {
            const size_t end = part.find(']', at);
            size_t number = 0;
            const char *first = part.data() + at + 1, *last = part.data() + std::min(end, part.size());
            const auto [stop, error] = std::from_chars(first, last, number);
            if (part[at] != '[' || end == std::string::npos || error != std::errc() || stop != last)
                return {};
            steps.push_back({{}, number});
            at = end + 1;
        }
    }
    return steps;
}

// The element of a list; reports and returns nullptr if it does not exist.
toml::node* element_of(toml::node& node, size_t element, const std::string& source,
                       const std::string& address, Reading& reading) {
    toml::array* list = node.as_array();
    if (!list)
        reading.report({source, 0, 0}, fmt::format("{} is no list", clean(address)),
                       "leave out the number in brackets");
    else if (element >= list->size())
        reading.report(
            {source, 0, 0},
            fmt::format("{} has {} elements, there is no [{}]", clean(address), list->size(), element),
            list->empty() ? "set the list as a whole" : fmt::format("give 0 to {}", list->size() - 1));
    else
        return list->get(element);
    return nullptr;
}

// Adds an empty table. The parser makes it, so that it has a source place for messages.
toml::node* make_table(toml::table& in, const std::string& key, const std::string& source) {
    toml::table made = parse_value("{}", source);
    toml::table& empty = *made.get("value")->as_table();
    return &in.insert_or_assign(toml::key(key, empty.source()), std::move(empty)).first->second;
}

// A text of a list's element, "name" or "type"; nullptr: none.
const std::string* text_of_element(const toml::node& element, const char* key) {
    const toml::table* table = element.as_table();
    const toml::node* text = table ? table->get(key) : nullptr;
    return text && text->is_string() ? &text->as_string()->get() : nullptr;
}

// The element that the steps from `i` on name, as in layer.field.edit: by its name or, without one, by its
// type. Names win over types. Both may contain dots: the longest match is taken. Sets `used` to the number of
// steps of its name. Reports and returns nullptr if there is none or several.
toml::node* named_element(toml::array& list, std::span<const Step> steps, size_t& used,
                          const std::string& source, const std::string& address, Reading& reading) {
    std::vector<std::string> names;
    for (const char* key : {"name", "type"}) {
        std::vector<size_t> found;
        std::string name, longest;
        for (size_t k = 0; k < steps.size() && !steps[k].element; ++k) {
            name += (k > 0 ? "." : "") + steps[k].key;
            for (size_t e = 0; e < list.size(); ++e) {
                const bool named = text_of_element(list[e], "name") != nullptr;
                const std::string* own = text_of_element(list[e], key);
                if (!own || (named && key != std::string_view("name"))) continue;
                if (k == 0) names.push_back(*own);
                if (*own != name) continue;
                if (name != longest) found.clear();
                longest = name;
                found.push_back(e);
                used = k + 1;
            }
        }
        if (found.size() == 1) return list.get(found[0]);
        if (found.size() > 1) {
            reading.report({source, 0, 0},
                           fmt::format("{} elements of {} have the {} {}", found.size(), clean(address), key,
                                       in_quotes(longest)),
                           fmt::format("write {0}[{1}] or {0}[{2}]", clean(address), found[0], found[1]));
            return nullptr;
        }
    }
    reading.report({source, 0, 0},
                   fmt::format("no element of {} is named {}", clean(address), in_quotes(steps[0].key)),
                   (names.empty() ? std::string() : hint(steps[0].key, names, "") + ", or ") +
                       fmt::format("write {}[0] for its first element", clean(address)));
    return nullptr;
}

// Follows the steps through tables and lists, adds missing tables, and stores the value at the last step.
void put(toml::table& root, std::span<const Step> steps, toml::node&& value, const std::string& source,
         std::string address, Reading& reading) {
    toml::node* node = &root;
    for (size_t i = 0; i < steps.size(); ++i) {
        const Step& step = steps[i];
        const bool last = i + 1 == steps.size();
        if (step.element) {
            toml::node* element = element_of(*node, *step.element, source, address, reading);
            if (!element) return;
            address += fmt::format("[{}]", *step.element);
            if (last) {
                toml::array& list = *node->as_array();
                const auto at = list.begin() + std::ptrdiff_t(*step.element);
                std::move(value).visit([&](auto&& own) {
                    using Node = std::remove_cvref_t<decltype(own)>;
                    list.insert(list.erase(at), Node(std::move(own)));
                });
            }
            node = element;
            continue;
        }
        if (toml::array* list = node->as_array();
            list && !last && std::ranges::any_of(*list, [](const toml::node& e) { return e.is_table(); })) {
            size_t used = 0;
            node = named_element(*list, steps.subspan(i), used, source, address, reading);
            if (!node) return;
            for (size_t k = i; k < i + used; ++k) address += "." + steps[k].key;
            i += used - 1;
            if (i + 1 == steps.size())
                return reading.report({source, 0, 0},
                                      fmt::format("{} is an element of a list", clean(address)),
                                      "add one of its keys");
            continue;
        }
        toml::table* table = node->as_table();
        if (!table) {
            reading.report(
                {source, 0, 0}, fmt::format("{} is no table", clean(address)),
                node->is_array()
                    ? fmt::format("write {}[0] for its first element, or set it as a whole", clean(address))
                    : "set it as a whole");
            return;
        }
        address += (address.empty() ? "" : ".") + step.key;
        if (last) {
            const toml::key key(step.key, value.source());
            table->erase(step.key); // else the key would keep its place in the file
            std::move(value).visit([&](auto&& own) {
                using Node = std::remove_cvref_t<decltype(own)>;
                table->insert_or_assign(key, Node(std::move(own)));
            });
            return;
        }
        node = table->get(step.key);
        if (!node && steps[i + 1].element)
            return reading.report({source, 0, 0}, fmt::format("{} has no elements here", clean(address)),
                                  fmt::format("set it as a whole: {}=[{{ ... }}]", clean(address)));
        if (!node) node = make_table(*table, step.key, source);
    }
}

// The item whose name `rest` ("hill.file") begins with. Names may contain dots: the longest match is taken.
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

// The target of a setting: a table of the tree, its address (owner), and the rest of the address (key).
struct Target {
    toml::table* table = nullptr;
    std::string owner, key;
};

// Reports and returns no table if the address does not name an item of the scene.
Target find_target(toml::table& root, const std::string& address, const std::string& source,
                   Reading& reading) {
    const std::string kind = address.substr(0, address.find('.'));
    if (kind != "light" && kind != "material" && kind != "mesh" && kind != "curves" && kind != "procedural")
        return {&root, "", address};
    const std::string rest = address.substr(std::min(kind.size() + 1, address.size()));
    std::vector<std::string> names;
    size_t name_size = 0;
    toml::table* table = find_item(root, kind, rest, name_size, names);
    if (table) return {table, address.substr(0, kind.size() + 1 + name_size), rest.substr(name_size + 1)};
    const std::string name = rest.substr(0, rest.find('.'));
    if (name.size() == rest.size())
        reading.report({source, 0, 0}, fmt::format("{} has no name and key", in_quotes(address)),
                       fmt::format("write {}.NAME.KEY=value", kind));
    else
        reading.report({source, 0, 0}, fmt::format("no {} is named {}", kind, in_quotes(name)),
                       hint(name, names, fmt::format("{} with a name in the scene", kind)));
    return {};
}

// Position of the = between key and value. Names of items may contain one as well.
size_t equals_of(toml::table& root, const std::string& setting) {
    const size_t begin = std::min(setting.find_first_not_of(" \t"), setting.size());
    const size_t dot = std::min(setting.find('.', begin), setting.size());
    const size_t rest = std::min(dot + 1, setting.size());
    size_t name_size = 0;
    std::vector<std::string> names;
    if (find_item(root, setting.substr(begin, dot - begin), std::string_view(setting).substr(rest), name_size,
                  names))
        if (const size_t equals = setting.find('=', rest + name_size); equals != std::string::npos)
            return equals;
    return setting.find('=');
}

void apply(toml::table& root, const std::string& setting, Reading& reading) {
    const std::string source = "--set " + clean(setting);
    const std::string example = "write key=value, for example film.samples=4";
    const size_t equals = equals_of(root, setting);
    if (equals == std::string::npos) return reading.report({source, 0, 0}, "there is no value", example);
    const std::string text = trim(setting.substr(equals + 1));
    toml::table value = parse_value(text, source);
    if (value.empty()) value = parse_value(as_string(text), source);
    if (value.empty()) return reading.report({source, 0, 0}, "the value is no UTF-8", "write it as UTF-8");

    const Target target = find_target(root, trim(setting.substr(0, equals)), source, reading);
    if (!target.table) return;
    const std::vector<Step> steps = steps_of(target.key);
    const bool gap = std::any_of(steps.begin(), steps.end(),
                                 [](const Step& step) { return step.key.empty() && !step.element; });
    if (steps.empty() || gap || steps.size() > max_parts)
        return reading.report({source, 0, 0},
                              fmt::format("{} is no key", in_quotes(setting.substr(0, equals))), example);
    put(*target.table, steps, std::move(*value.get("value")), source, target.owner, reading);
}

} // namespace

void apply_settings(toml::table& root, const std::vector<std::string>& settings, Reading& reading) {
    for (const std::string& setting : settings) apply(root, setting, reading);
}

} // namespace marram
