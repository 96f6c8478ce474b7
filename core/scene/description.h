// SPDX-License-Identifier: Apache-2.0
// A checked scene description: all names are known, all types and ranges valid, all files exist, all
// references are resolved. Nothing is loaded yet.
#pragma once

#include "core/math/params.h"
#include "core/scene/path_map.h"

#include <string>
#include <vector>

namespace marram {

// An item of a scene: a light, a material, a mesh, curves or a procedural.
struct Item {
    std::string type; // "sun", "diffuse", "plane", "groom", ...
    std::string name; // unique among items of its kind; lights may have none
    ParamSet params;
    Place place; // of its table in the file
    // If one table makes several items, one for each name of a list: the name of the table, "fur" of
    // "fur.body".
    std::string table_name{};
    const std::string& name_in_file() const { return table_name.empty() ? name : table_name; }
};

struct SceneDescription {
    std::string file; // as given on the command line
    ParamSet globals; // fps, frames, tolerance, ...: the keys before the first table
    ParamSet camera;
    ParamSet film;
    ParamSet wind;                 // checked against the library's declaration of [wind]
    std::vector<Item> lights;      // [[light]]
    std::vector<Item> materials;   // [[material]]
    std::vector<Item> meshes;      // [[mesh]]
    std::vector<Item> curves;      // [[curves]]: input of procedurals, not rendered
    std::vector<Item> procedurals; // [[procedural]]
};

// The schema of scene files. core/scene declares its own tables. The caller adds the types of materials (from
// shaders/), of lights (from core/render), and of procedurals and the wind (from the procedural library).
struct ItemSchema;

// A list of tables within an item, each with its own type: [[procedural.layer]] type = "dune". The values of
// element 2 are called "layer[2].type" and "layer[2].<parameter>".
struct ListSchema {
    std::string name;              // "layer"
    std::vector<ItemSchema> types; // of its elements
    ParamSpec type;                // declaration of the key `type`, a choice of them
};

struct ItemSchema {
    std::string type;
    std::string help;
    std::vector<ParamSpec> params; // without name and type, which every item has
    std::vector<ListSchema> lists{};
    std::string unusable{}; // why it cannot be used; "" if it can
};

struct Schema {
    std::vector<ParamSpec> globals, camera, film, wind;
    std::vector<ItemSchema> lights, materials, meshes, curves, procedurals;
    std::string wind_help{}; // what the wind's parameters do together, in lines; "": nothing
};

// The schema of the tables that core/scene declares: globals, camera, film, meshes, curves. The rest is
// empty.
Schema scene_schema();

// The roles (MarramRole), declared by every mesh of the scene and every procedural that makes a mesh.
std::vector<ParamSpec> role_params();

// Reads and checks a scene file. `settings` are "key=value" overrides of any key, applied before checking:
// "film.samples=4", "wind.speed=4", "mesh.hill.file=x.obj", "procedural.grass.length=[0.2, 0.3]" (items are
// addressed by name). `paths` is applied to each file name as it is written, before it is taken as relative
// to the scene file's folder. The description keeps pointers into `schema`, which must outlive it.
// Throws InputError with every mistake found. Cost: milliseconds.
SceneDescription load_scene(const std::string& file, const std::vector<std::string>& settings,
                            const Schema& schema, const PathMap& paths = {});

} // namespace marram
