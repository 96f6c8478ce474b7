// SPDX-License-Identifier: Apache-2.0
// What a scene file says, checked: every name known, every type and range right, every file there, every reference
// resolved. Nothing is loaded yet.
#pragma once

#include "core/math/params.h"

#include <string>
#include <vector>

namespace marram {

// One thing of a scene: a light, a material, a mesh, curves or a procedural.
struct Item {
    std::string type; // "sun", "diffuse", "plane", "groom", ...
    std::string name; // unique among things of its kind; lights may have none
    ParamSet params;
    Place place; // of its table in the file
    // Of one that is there once for each of several names: the name of its table. "fur" of "fur.body".
    std::string table_name{};
    const std::string& name_in_file() const { return table_name.empty() ? name : table_name; }
};

struct SceneDescription {
    std::string file; // as given on the command line
    ParamSet globals; // fps, frames, tolerance, ...: what stands before the first table
    ParamSet camera;
    ParamSet film;
    ParamSet wind;                 // checked against what the procedural library declares for [wind]
    std::vector<Item> lights;      // [[light]]
    std::vector<Item> materials;   // [[material]]
    std::vector<Item> meshes;      // [[mesh]]
    std::vector<Item> curves;      // [[curves]]: drawn, for procedurals to use; no camera sees them
    std::vector<Item> procedurals; // [[procedural]]
};

// What may stand in a scene file. core/scene declares its own tables; the types of materials come from shaders/, those of lights from
// core/render, those of procedurals and the wind from the procedural library, handed in by whoever has them.
struct ItemSchema;

// A list of tables within an item, whose elements each have a type of their own: [[procedural.layer]] type = "dune". The values of its
// element 2 are called "layer[2].type" and "layer[2].<parameter>".
struct ListSchema {
    std::string name;              // "layer"
    std::vector<ItemSchema> types; // of its elements
    ParamSpec type;                // the choice among them
};

struct ItemSchema {
    std::string type;
    std::string help;
    std::vector<ParamSpec> params; // without name and type, which every item has
    std::vector<ListSchema> lists{};
    std::string unusable{}; // why no scene can use it: "" where one can
};

struct Schema {
    std::vector<ParamSpec> globals, camera, film, wind;
    std::vector<ItemSchema> lights, materials, meshes, curves, procedurals;
};

// The tables that core/scene itself knows: globals, camera, film, meshes, curves. The rest is empty.
Schema scene_schema();

// What every mesh declares, be it the scene's or a procedural's: what it is there for.
std::vector<ParamSpec> role_params();

// Reads and checks a scene file. `settings` are "key=value" overrides, applied before checking, that reach any key:
// "film.samples=4", "wind.speed=4", "mesh.hill.file=x.obj", "procedural.grass.length=[0.2, 0.3]" (things are addressed by
// name). The description keeps pointers into `schema`, which must outlive it.
// Throws InputError with every mistake found. Cost: milliseconds.
SceneDescription load_scene(const std::string& file, const std::vector<std::string>& settings,
                            const Schema& schema);

} // namespace marram
