// SPDX-License-Identifier: Apache-2.0
#include "core/shot/scene_keys.h"

#include <algorithm>
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

// Elements of lists that have a name, or a type, are listed by it too: layer.crest.max_height.
void add_values(Keys& keys, const std::string& prefix, const ParamSet& params) {
    for (const ParamValue& value : params.all()) {
        keys.insert(prefix + value.name);
        const size_t open = value.name.find('['), close = value.name.find("].");
        if (open == std::string::npos || close == std::string::npos ||
            value.name.find('[', close) != std::string::npos)
            continue;
        const std::string element = value.name.substr(0, close + 2);
        const ParamValue* name = params.find(element + "name");
        if (!name) name = params.find(element + "type");
        if (name && !name->text.empty() && name != &value)
            keys.insert(prefix + value.name.substr(0, open) + "." + name->text +
                        value.name.substr(close + 1));
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
