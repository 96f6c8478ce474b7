// SPDX-License-Identifier: Apache-2.0
#include "core/view/scene_message.h"

#include "core/scene/param_types.h"
#include "core/scene/value_text.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/settings.h"
#include "core/view/wire.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

namespace marram {
namespace {

using nlohmann::json;

json bound(double limit) { return std::isfinite(limit) ? json(limit) : json(nullptr); }

std::vector<std::string> choices_of(const ParamSpec& spec) {
    std::vector<std::string> choices;
    if (spec.type != ParamType::choice) return choices;
    std::istringstream text(spec.choices);
    for (std::string choice; std::getline(text, choice, '|');) choices.push_back(choice);
    return choices;
}

// The key of the change that a value is part of: its own or that of a list or table that it is in; "": none.
std::string change_of(const std::string& key, const ChangedValues& changed) {
    for (const auto& [other, value] : changed)
        if (key.starts_with(other) &&
            (key.size() == other.size() || key[other.size()] == '.' || key[other.size()] == '['))
            return other;
    return "";
}

// value: nullptr if it is not given and has no default.
json parameter(const std::string& key, const std::string& label, const ParamSpec& spec,
               const ParamValue* value, const std::string& scene, const ChangedValues& changed) {
    return {{"key", key},
            {"label", label},
            {"type", row_of(spec.type).contract_name.empty() ? "text" : row_of(spec.type).contract_name},
            {"unit", spec.unit},
            {"min", bound(spec.minimum)},
            {"max", bound(spec.maximum)},
            {"choices", choices_of(spec)},
            {"help", spec.help},
            {"value", value ? value_text(*value, scene) : ""},
            {"initial", spec.initial},
            {"given", value && value->given},
            {"changed", !change_of(key, changed).empty()},
            {"changed_by", change_of(key, changed)},
            {"keyable", spec.keyable},
            {"keyed", value && value->keys.has_value()}};
}

// The declared parameters in their order, those of a list once for each of its elements.
json parameters(const std::string& prefix, const std::vector<ParamSpec>& specs, const ParamSet& values,
                const std::string& scene, const ChangedValues& changed) {
    json list = json::array();
    for (const ParamSpec& spec : specs) {
        if (spec.type == ParamType::unavailable) continue;
        if (list_of(spec.name).empty()) {
            list.push_back(
                parameter(prefix + spec.name, spec.name, spec, values.find(spec.name), scene, changed));
            continue;
        }
        for (const ParamValue& value : values.all())
            if (value.spec == &spec)
                list.push_back(parameter(prefix + value.name, value.name, spec, &value, scene, changed));
    }
    for (const ParamValue& value : values.all()) { // of the tables of lists with types of their own
        const auto declared = [&](const ParamSpec& spec) { return &spec == value.spec; };
        if (std::ranges::none_of(specs, declared))
            list.push_back(parameter(prefix + value.name, value.name, *value.spec, &value, scene, changed));
    }
    return list;
}

} // namespace

json parameter_groups(const Shot& shot, const ChangedValues& changed) {
    const SceneDescription& scene = shot.description;
    const Schema& schema = shot.plugins->schema;
    json groups = json::array();
    const auto add = [&](const std::string& title, const std::string& prefix,
                         const std::vector<ParamSpec>& specs, const ParamSet& values) {
        groups.push_back(
            {{"title", title}, {"params", parameters(prefix, specs, values, scene.file, changed)}});
    };
    const auto add_items = [&](const std::string& kind, const std::vector<Item>& items,
                               const std::vector<ItemSchema>& types) {
        std::vector<std::string> done; // one table may make several items
        for (const Item& item : items) {
            const std::string& name = item.name_in_file();
            if (name.empty() || std::ranges::find(done, name) != done.end()) continue;
            done.push_back(name);
            const auto type = std::ranges::find(types, item.type, &ItemSchema::type);
            if (type != types.end())
                add(fmt::format("{} {} ({})", kind, name, item.type), kind + "." + name + ".", type->params,
                    item.params);
        }
    };
    add("wind", "wind.", schema.wind, scene.wind);
    add_items("procedural", scene.procedurals, schema.procedurals);
    add_items("light", scene.lights, schema.lights);
    add_items("material", scene.materials, schema.materials);
    add("camera", "camera.", schema.camera, scene.camera);
    add("film", "film.", schema.film, scene.film);
    add("scene", "", schema.globals, scene.globals);
    add_items("mesh", scene.meshes, schema.meshes);
    add_items("curves", scene.curves, schema.curves);
    return groups;
}

json camera_message(const Shot& shot, double frame) {
    const Camera camera = camera_at(shot.description, frame);
    const CameraPose& pose = camera.poses.front();
    const double distance =
        (shot.description.camera.vec3("target") - shot.description.camera.vec3("position")).norm();
    const auto [width, height] = film_size(shot);
    return {{"position", json_of(pose.position)},
            {"target", json_of(pose.position + pose.orientation * Vec3d(0.0, 0.0, -distance))},
            {"up", json_of(pose.orientation * Vec3d::UnitY())},
            {"fov", camera.vertical_fov / degree},
            {"size", {width, height}}};
}

json problems_message(const std::vector<Problem>& problems) {
    json list = json::array();
    constexpr size_t max_problems = 50;
    for (size_t i = 0; i < std::min(problems.size(), max_problems); ++i)
        list.push_back(
            {{"place", to_string(problems[i].place)}, {"what", problems[i].what}, {"fix", problems[i].fix}});
    return {{"type", "problems"}, {"problems", list}};
}

} // namespace marram
