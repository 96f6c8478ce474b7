// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene/scene_keys.h"

#include <algorithm>
#include <map>
#include <set>

namespace marram {
namespace {

using Keys = std::set<std::string>;

// Skips list elements: their number depends on the scene.
void add_declared(Keys& keys, const std::string& prefix, const std::vector<ParamSpec>& params) {
    for (const ParamSpec& spec : params)
        if (spec.type != ParamType::unavailable && list_of(spec.name).empty())
            keys.insert(prefix + spec.name);
}

void add_tables(Keys& keys, const Schema& schema) {
    add_declared(keys, "", schema.globals);
    add_declared(keys, "camera.", schema.camera);
    add_declared(keys, "film.", schema.film);
    add_declared(keys, "wind.", schema.wind);
}

// The first list of a key and its element: "layer[2]." of layer[2].mask. Empty: none, or a list within a
// list.
std::string element_of(const std::string& key) {
    const size_t open = key.find('['), close = key.find("].");
    const bool nested = close != std::string::npos && key.find('[', close) != std::string::npos;
    return open == std::string::npos || close == std::string::npos || nested ? std::string()
                                                                             : key.substr(0, close + 2);
}

// What --set calls the elements of lists: "layer[2]." is "layer.crest.". Those that it cannot call so have
// only their number: names with the signs of its syntax, equal ones, and those that another name goes on
// from.
std::map<std::string, std::string> named_elements(const ParamSet& params) {
    struct Name {
        std::string list, text;
        bool is_type = false;
    };
    std::map<std::string, Name> elements;
    for (const ParamValue& value : params.all()) {
        const std::string element = element_of(value.name);
        if (element.empty() || elements.contains(element)) continue;
        const ParamValue* name = params.find(element + "name");
        const bool is_type = !name;
        if (is_type) name = params.find(element + "type");
        if (name) elements[element] = {element.substr(0, element.find('[')), name->text, is_type};
    }
    std::map<std::string, std::string> called;
    for (const auto& [element, name] : elements) {
        const bool clashes = std::ranges::any_of(elements, [&](const auto& entry) {
            const Name& other = entry.second;
            return entry.first != element && other.list == name.list &&
                   ((other.text == name.text && (name.is_type || !other.is_type)) ||
                    other.text.starts_with(name.text + "."));
        });
        if (!clashes && !name.text.empty() && name.text.find_first_of("=[]. \t") == std::string::npos)
            called[element] = name.list + "." + name.text + ".";
    }
    return called;
}

// Elements of lists that have a name, or a type, are listed by it too: layer.crest.max_height.
void add_values(Keys& keys, const std::string& prefix, const ParamSet& params) {
    const std::map<std::string, std::string> called = named_elements(params);
    for (const ParamValue& value : params.all()) {
        keys.insert(prefix + value.name);
        const std::string element = element_of(value.name);
        const auto name = called.find(element);
        if (name == called.end() || value.name == element + "name" || value.name == element + "type")
            continue;
        keys.insert(prefix + name->second + value.name.substr(element.size()));
    }
}

// Items without a name cannot be addressed by a key.
void add_items(Keys& keys, const std::string& kind, const std::vector<Item>& items,
               const std::vector<ItemSchema>& types) {
    for (const Item& item : items) {
        if (item.name.empty()) continue;
        const std::string prefix = kind + "." + item.name_in_file() + ".";
        const auto type = std::ranges::find(types, item.type, &ItemSchema::type);
        if (type != types.end()) add_declared(keys, prefix, type->params);
        add_values(keys, prefix, item.params);
    }
}

} // namespace

std::vector<std::string> keys_of_tables(const Schema& schema) {
    Keys keys;
    add_tables(keys, schema);
    return {keys.begin(), keys.end()};
}

std::vector<std::string> keys_of_scene(const SceneDescription& description, const Schema& schema) {
    Keys keys;
    add_tables(keys, schema);
    add_values(keys, "", description.globals);
    add_values(keys, "camera.", description.camera);
    add_values(keys, "film.", description.film);
    add_values(keys, "wind.", description.wind);
    add_items(keys, "light", description.lights, schema.lights);
    add_items(keys, "material", description.materials, schema.materials);
    add_items(keys, "mesh", description.meshes, schema.meshes);
    add_items(keys, "curves", description.curves, schema.curves);
    add_items(keys, "procedural", description.procedurals, schema.procedurals);
    return {keys.begin(), keys.end()};
}

} // namespace marram
