// SPDX-License-Identifier: Apache-2.0
// Loads a scene in this order: parse, apply the settings, read every table against its declaration, check the
// rules between them, throw all mistakes at once.
#include "core/math/hash.h"
#include "core/scene/parse.h"
#include "core/scene/rules.h"
#include "core/scene/suggest.h"
#include "core/scene/table.h"
#include "core/scene/words.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace marram {
namespace {

const std::vector<std::string> table_names = {"camera",   "film", "wind",   "light",
                                              "material", "mesh", "curves", "procedural"};

// Every procedural has this parameter, whether or not its library declares it.
const ParamSpec library_spec = {
    "library", ParamType::file, "", "none", {}, {}, "library", "shared library it comes from"};

// The table of this name, or nullptr. A list or value of this name is reported.
const toml::table* single_table(const toml::table& root, const std::string& name, Reading& reading) {
    const toml::node* node = root.get(name);
    if (!node || node->is_table()) return node ? node->as_table() : nullptr;
    if (node->is_array_of_tables())
        reading.report(place_of(*node, reading), fmt::format("there is only one {}", name),
                       fmt::format("write [{}] in single brackets, once", name));
    else
        reading.report(place_of(*node, reading), fmt::format("{} is {}", name, found(*node)),
                       fmt::format("write a table [{}]", name));
    return nullptr;
}

ParamSet read_single(const toml::table& root, const std::string& name, std::span<const ParamSpec> specs,
                     Reading& reading) {
    TableToRead job;
    job.table = single_table(root, name, reading);
    job.place = job.table ? place_of(*job.table, reading) : Place{reading.file, 1, 1};
    job.address = job.subject = name;
    job.specs = pointers(specs);
    // If the node is not a table, this has been reported: do not report its missing keys as well.
    if (!job.table && root.contains(name)) return {};
    return read_table(job, reading);
}

// Reads the text of a key that every item has: `name` or `type`. Reports an empty text and other types.
std::optional<std::string> read_text_key(const toml::table& table, const char* key, const std::string& label,
                                         Reading& reading) {
    const toml::node* node = table.get(key);
    if (!node) return {};
    if (node->is_string() && !node->as_string()->get().empty()) return node->as_string()->get();
    reading.report(place_of(*node, reading), fmt::format("{}.{} is {}", label, key, found(*node)),
                   "give a text of at least one letter, in quotes");
    return {};
}

// What to do with a type of another table, such as a [[mesh]] of type "terrain"; "" if no table has it.
std::string table_of_type(const std::string& type, const Schema& schema) {
    for (const auto& [kind, schemas] : {std::pair{"light", &schema.lights},
                                        {"material", &schema.materials},
                                        {"mesh", &schema.meshes},
                                        {"curves", &schema.curves},
                                        {"procedural", &schema.procedurals}})
        if (std::ranges::any_of(*schemas, [&](const ItemSchema& one) { return one.type == type; }))
            return fmt::format("write it as a [[{}]]", kind);
    return "";
}

const ItemSchema* read_type(const toml::table& table, const std::string& kind, const std::string& label,
                            std::span<const ItemSchema> schemas, Reading& reading) {
    std::vector<std::string> types;
    for (const ItemSchema& schema : schemas) types.push_back(schema.type);
    if (!table.contains("type")) {
        const std::string misspelt = key_like_type(table);
        reading.report(place_of(table, reading), fmt::format("{} has no type", label),
                       types.empty() ? hint("", types, "type of " + kind + " in this build")
                       : !misspelt.empty()
                           ? fmt::format("write type in place of {}", in_quotes(misspelt))
                           : fmt::format("add type = \"...\", known are {}", listed(types, all_words)));
    }
    const std::optional<std::string> type = read_text_key(table, "type", label, reading);
    if (!type) return nullptr;
    for (const ItemSchema& schema : schemas)
        if (schema.type == *type) return &schema;
    std::string fix = nearest(*type, types).empty() ? table_of_type(*type, *reading.schema) : "";
    if (fix.empty()) fix = hint(*type, types, fmt::format("type of {} in this build", kind), all_words);
    reading.report(place_of(*table.get("type"), reading),
                   fmt::format("{} is no type of {}", in_quotes(*type), kind), fix, "scene.unknown_" + kind);
    return nullptr;
}

// If a parameter with ParamSpec::each lists several names, makes one item for each: "fur" on "body" and
// "tail" becomes "fur.body" and "fur.tail". The seed of each is hashed from the name, so that equal meshes
// get different strands.
std::vector<Item> expand_each(Item item) {
    std::vector<Item> items;
    const auto of_each = std::ranges::find_if(item.params.all(), [](const ParamValue& value) {
        return value.spec->each && value.texts.size() > 1;
    });
    if (of_each == item.params.all().end()) return {std::move(item)};
    for (const std::string& name : of_each->texts) {
        Item& one = items.emplace_back(item);
        one.table_name = item.name;
        one.name = item.name + "." + name;
        one.params.find(of_each->name)->text = name;
        if (ParamValue* seed = one.params.find("seed"); seed && seed->spec->type == ParamType::integer) {
            uint64_t h = uint64_t(seed->numbers[0]);
            for (const char c : name) h = hash(h, uint64_t(static_cast<unsigned char>(c)));
            // Map the hash to the declared range of the seed; 31 bits are exact in a double.
            const double low = std::max(seed->spec->minimum, 0.0),
                         high = std::min(seed->spec->maximum, 0x7fffffff.0p0);
            seed->numbers[0] = high > low ? low + std::fmod(double(h & 0x7fffffffU), high - low + 1.0) : low;
        }
    }
    return items;
}

void read_item(const toml::table& table, const std::string& kind, std::span<const ItemSchema> schemas,
               std::vector<Item>& items, std::vector<Name>& names, Reading& reading) {
    Item item;
    item.place = place_of(table, reading);
    std::string label = kind;
    if (const std::optional<std::string> name = read_text_key(table, "name", kind, reading)) {
        item.name = *name;
        label = join(kind, clean(*name));
        names.push_back({kind, *name, place_of(*table.get("name"), reading)});
    } else if (kind != "light" && !table.contains("name")) {
        reading.report(item.place, fmt::format("this {} has no name", kind), "add name = \"...\"");
    }
    const ItemSchema* schema = read_type(table, kind, label, schemas, reading);
    if (!schema) return;
    if (!schema->unusable.empty())
        return reading.report(place_of(*table.get("type"), reading),
                              fmt::format("{} cannot be used: {}", in_quotes(schema->type), schema->unusable),
                              "use a library and a program of the same version");
    item.type = schema->type;
    TableToRead job;
    job.table = &table;
    job.place = item.place;
    job.address = label;
    job.subject = item.type;
    job.specs = pointers(schema->params);
    job.lists = schema->lists;
    job.others = {"name", "type"};
    bool has_library = kind != "procedural";
    for (const ParamSpec& spec : schema->params) has_library = has_library || spec.name == library_spec.name;
    if (!has_library) job.specs.push_back(&library_spec);
    item.params = read_table(job, reading);
    std::vector<Item> read = expand_each(std::move(item));
    if (read.size() > 1 && !read.front().table_name.empty()) {
        const Name written = names.back();
        names.pop_back();
        for (const Item& one : read) names.push_back({kind, one.name, written.place});
    }
    items.insert(items.end(), std::make_move_iterator(read.begin()), std::make_move_iterator(read.end()));
}

void read_items(const toml::table& root, const std::string& kind, std::span<const ItemSchema> schemas,
                std::vector<Item>& items, std::vector<Name>& names, Reading& reading) {
    const toml::node* node = root.get(kind);
    if (!node) return;
    const toml::array* list = node->as_array();
    if (!list) {
        reading.report(place_of(*node, reading),
                       fmt::format("{} is {}, there may be several", kind, found(*node)),
                       fmt::format("write [[{}]] in double brackets", kind));
        return;
    }
    for (const toml::node& entry : *list) {
        if (const toml::table* table = entry.as_table())
            read_item(*table, kind, schemas, items, names, reading);
        else
            reading.report(place_of(entry, reading),
                           fmt::format("the list of {}s contains {}", kind, found(entry)),
                           fmt::format("write a table [[{}]]", kind));
    }
}

} // namespace

SceneDescription load_scene(const std::string& file, const std::vector<std::string>& settings,
                            const Schema& schema, const PathMap& paths) {
    Reading reading;
    reading.file = file;
    reading.schema = &schema;
    reading.paths = paths;
    toml::table root = parse_scene(reading);
    apply_settings(root, settings, reading);

    SceneDescription scene;
    scene.file = file;
    TableToRead globals;
    globals.table = &root;
    globals.place = {file, 1, 1};
    globals.specs = pointers(schema.globals);
    globals.others = table_names;
    scene.globals = read_table(globals, reading);
    if (root.contains("camera"))
        scene.camera = read_single(root, "camera", schema.camera, reading);
    else
        reading.report({file, 1, 1}, "the scene has no camera",
                       "add a table [camera] with position and target");
    scene.film = read_single(root, "film", schema.film, reading);
    scene.wind = read_single(root, "wind", schema.wind, reading);
    std::vector<Name> names;
    read_items(root, "light", schema.lights, scene.lights, names, reading);
    read_items(root, "material", schema.materials, scene.materials, names, reading);
    read_items(root, "mesh", schema.meshes, scene.meshes, names, reading);
    read_items(root, "curves", schema.curves, scene.curves, names, reading);
    read_items(root, "procedural", schema.procedurals, scene.procedurals, names, reading);
    check_names(names, reading);
    check_rules(scene, names, reading);
    throw_problems(reading);
    return scene;
}

} // namespace marram
