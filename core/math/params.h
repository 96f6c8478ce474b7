// SPDX-License-Identifier: Apache-2.0
// Parameters. One declaration gives the default, the check, the error message and the manual (`marram info`
// prints it). Cameras, films, lights, shaders, meshes and, through the plug-in contract, procedurals declare
// their parameters this way.
//
// To add a parameter: add one ParamSpec to the owner's list and read it by name.
#pragma once

#include "core/math/keyframes.h"
#include "core/math/problem.h"
#include "core/math/vec.h"

#include <cassert>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

enum class ParamType {
    boolean,   // true | false
    integer,   // whole number
    number,    // real number
    vec2,      // [a, b]
    vec3,      // [x, y, z]
    range,     // [low, high] with low <= high; a single number stands for both
    color,     // [r, g, b] linear, each >= 0; a single number stands for a grey
    text,      // free string
    choice,    // one of `choices`
    ramp,      // [[position, value], ...] or { knots = [[...]], interpolation = "linear|smooth|constant" }
    file,      // path of an existing file, relative to the scene file
    image,     // path of an existing image, relative to the scene file
    reference, // name of another item of the scene; kinds in `choices`: "mesh", "material", "mesh|procedural"
    texts,     // ["a", "b", ...]
    keys,      // keyed transform: see core/math/transform.h
    points,    // [[x, y, z], ...]
    table,     // path of an existing CSV file, relative to the scene file
    volume,    // path of an OpenVDB file, or { file = "a.####.vdb", frames = [1, 48], grid = "vel" }
    unavailable, // planned but not in this build: using it is an error
};

struct ParamSpec {
    std::string name; // dotted for nested tables, "noise.octaves"; in lists "gusts.control[].shape"
    ParamType type = ParamType::number;
    std::string unit;    // "m", "deg", "m/s", "frames", "1/m"; "": no unit
    std::string initial; // default as written in a scene file; "": must be given; "none": may be absent
    double minimum = -std::numeric_limits<double>::infinity(); // of every component, both ends allowed
    double maximum = std::numeric_limits<double>::infinity();
    // "a|b|c" of a choice; kind of a reference; "numbered": a file with ####; "uv": an image with <UDIM>.
    std::string choices;
    std::string help;         // one line
    std::string sweep{};      // values that `marram measure` tries, as in a scene: "1|4|16"
    std::string sweep_time{}; // the report entry whose seconds it affects: "seconds.shield"; "": all stages
    bool each = false;        // a reference that may be a list of names: makes one item for each of them
    bool keyable = false;     // its numbers may change in time: { keys = [[frame, value], ...] }
};

// A value with its place. Each type fills in exactly:
//   boolean, integer, number   numbers[0]            vec2, range   numbers[0..1]       vec3, color   numbers[0..2]
//   reference                  text; texts = all names, if a list of names was given
//   text, choice               text                  file, image, table   text = path to open
//   ramp                       numbers = p0 v0 p1 v1 ..., positions ascending; text = interpolation
//   texts                      texts                 points        numbers = x0 y0 z0 x1 ...
//   volume                     text = path to open; numbers = first and last frame if it has a # for them, else none;
//                              texts = the grid's name, if given
//   keys                       numbers = 10 a key: frame, translate xyz, rotate xyz (degrees), scale xyz; frames
//                              ascending; text = interpolation "linear|smooth"
struct ParamValue {
    const ParamSpec* spec = nullptr;
    std::string name; // the declared name, with the index in lists: "gusts.control[1].shape"
    std::vector<double> numbers;
    std::string text;
    std::vector<std::string> texts;
    Place place;                     // of the value in the file; of the owning table for a default
    bool given = false;              // false: default
    std::optional<Keyframes> keys{}; // of a keyable value that changes; `numbers` are those of the first key
};

// A list of tables in the file; may be empty.
struct ParamList {
    std::string name; // "gusts.control"
    size_t size = 0;
};

// Separates the name of a list from the name of a parameter of its tables.
inline constexpr std::string_view list_mark = "[].";

// "gusts.control" of "gusts.control[].shape"; empty for a parameter that is not in a list.
inline std::string_view list_of(std::string_view name) {
    const size_t mark = name.find(list_mark);
    return mark == std::string_view::npos ? std::string_view() : name.substr(0, mark);
}

// The checked values of one table. Every declared parameter is present, except those with the default "none"
// that were not given. Parameters of a list are present once for each of its elements.
class ParamSet {
  public:
    void put(ParamValue value) {
        if (value.name.empty()) value.name = value.spec->name;
        values_.push_back(std::move(value));
    }
    void put_list(ParamList list) { lists_.push_back(std::move(list)); }

    // nullptr if the file does not have the list.
    const ParamList* find_list(std::string_view name) const {
        for (const ParamList& list : lists_)
            if (list.name == name) return &list;
        return nullptr;
    }

    ParamValue* find(std::string_view name) {
        for (ParamValue& value : values_)
            if (value.name == name) return &value;
        return nullptr;
    }
    const ParamValue* find(std::string_view name) const {
        for (const ParamValue& value : values_)
            if (value.name == name) return &value;
        return nullptr;
    }
    bool has(std::string_view name) const { return find(name) != nullptr; }
    const ParamValue& at(std::string_view name) const {
        const ParamValue* value = find(name);
        assert(value && "a parameter is read that its owner does not declare");
        return *value;
    }
    bool boolean(std::string_view name) const { return at(name).numbers[0] != 0.0; }
    int integer(std::string_view name) const { return static_cast<int>(at(name).numbers[0]); }
    double number(std::string_view name) const { return at(name).numbers[0]; }
    const std::string& text(std::string_view name) const { return at(name).text; }
    Vec2d vec2(std::string_view name) const { return Vec2d(at(name).numbers.data()); }
    Vec3d vec3(std::string_view name) const { return Vec3d(at(name).numbers.data()); }
    std::span<const ParamValue> all() const { return values_; }
    std::span<const ParamList> lists() const { return lists_; }

  private:
    std::vector<ParamValue> values_;
    std::vector<ParamList> lists_;
};

} // namespace marram
