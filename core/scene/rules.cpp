// SPDX-License-Identifier: Apache-2.0
#include "core/scene/rules.h"
#include "core/math/file_types.h"
#include "core/math/frame_name.h"
#include "core/scene/suggest.h"
#include "core/scene/table.h"
#include "core/scene/words.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <map>
#include <set>

namespace marram {
namespace {

// The squared length of shorter vectors is too small for a float.
constexpr double shortest_direction = 1e-6;

bool has_direction(const Vec3d& v) { return v.cwiseAbs().maxCoeff() >= shortest_direction; }

void check_whole(const ParamSet& params, const std::string& address, std::string_view name,
                 Reading& reading) {
    const ParamValue* value = params.find(name);
    if (!value) return;
    for (const double number : value->numbers) {
        if (number == std::floor(number)) continue;
        reading.report(value->place, fmt::format("{} has {}", join(address, name), number),
                       "give whole numbers");
        return;
    }
}

void check_camera(const ParamSet& camera, Reading& reading) {
    const ParamValue *position = camera.find("position"), *target = camera.find("target"),
                     *up = camera.find("up");
    if (up && !has_direction(Vec3d(up->numbers.data()))) {
        reading.report(up->place, "camera.up is (nearly) zero", "give a direction, for example [0, 1, 0]");
        up = nullptr;
    }
    if (const ParamValue* shutter = camera.find("shutter");
        shutter && shutter->numbers[0] > shutter->numbers[1])
        reading.report(
            shutter->place,
            fmt::format("camera.shutter runs from {} down to {}", shutter->numbers[0], shutter->numbers[1]),
            "give when it opens, then when it closes");
    if (!position || !target) return;
    const Vec3d p(position->numbers.data()), t(target->numbers.data());
    const double size = std::max(p.cwiseAbs().maxCoeff(), t.cwiseAbs().maxCoeff());
    // The rounding error is 1e-16 of their size; with 1e-12 the direction has four digits.
    if ((t - p).cwiseAbs().maxCoeff() <= 1e-12 * size) {
        reading.report(target->place, "camera.target is camera.position",
                       "let the camera look at another point");
        return;
    }
    if (!up) return;
    const Vec3d view = (t - p).stableNormalized(), upright = Vec3d(up->numbers.data()).stableNormalized();
    if (view.cross(upright).norm() < 1e-6)
        reading.report(up->given ? up->place : target->place, "camera.up points along the view",
                       "give another up, for example [0, 0, -1] for a view straight down");
}

// Keys of a direction: none is zero, and on the way to the next it does not pass through zero.
void check_direction_keys(const ParamValue& direction, Reading& reading) {
    if (!direction.keys) return;
    const Keyframes& keys = *direction.keys;
    const double opposed = 1.0 + std::cos(170.0 * degree); // between them the turn is uneven, as of the wind
    for (size_t i = 1; i < keys.count(); ++i) {
        const Vec3d before(keys.key(i - 1).data()), now(keys.key(i).data());
        if (!has_direction(now)) {
            reading.report(
                direction.place,
                fmt::format("the sun's direction is (nearly) zero at frame {}", limit(keys.frames[i])),
                "give the direction towards the sun");
            return;
        }
        if (1.0 + before.stableNormalized().dot(now.stableNormalized()) < opposed &&
            keys.interpolation != KeyInterpolation::constant)
            reading.report(direction.place,
                           fmt::format("the sun turns by more than 170 degrees between frames {} and {}",
                                       limit(keys.frames[i - 1]), limit(keys.frames[i])),
                           "add a key on the way");
    }
}

void check_lights(const std::vector<Item>& lights, Reading& reading) {
    for (const Item& light : lights) {
        const ParamValue* direction = light.params.find("direction");
        if (direction) check_direction_keys(*direction, reading);
        if (!direction || has_direction(Vec3d(direction->numbers.data()))) continue;
        reading.report(direction->place, "the sun's direction is (nearly) zero",
                       "give the direction towards the sun");
    }
}

constexpr int max_shapes = 10'000;

// Checks items of type "file" or "strands", which may have one file per frame. endings: readable formats.
void check_files(const std::vector<Item>& items, const char* kind, const char* type,
                 std::span<const std::string_view> endings, Reading& reading) {
    for (const Item& item : items) {
        const ParamValue* file = item.type == type ? item.params.find("file") : nullptr;
        if (!file) continue;
        const ParamValue* frames = item.params.find("file_frames");
        const std::string name = fmt::format("{}.{}", kind, clean(item.name));
        if (frames && !has_frame_mark(file->text))
            reading.report(file->place, fmt::format("{}.file is one file for all of file_frames", name),
                           "put a #### where the frame's number belongs, or leave file_frames out");
        if (frames && frames->numbers[1] - frames->numbers[0] >= max_shapes)
            reading.report(frames->place, fmt::format("{}.file_frames are more than {}", name, max_shapes),
                           "all are held in memory: give those that the shot sees");
        if (is_one_of(extension_of(file->text), endings)) continue;
        reading.report(file->place, fmt::format("{}.file is no {}", name, fmt::join(endings, " and no ")),
                       "convert it to one of them");
    }
}

using NamesByKind = std::map<std::string, std::vector<std::string>>;

void check_references(const ParamSet& params, const std::string& address, const NamesByKind& names,
                      Reading& reading) {
    for (const ParamValue& value : params.all()) {
        if (value.spec->type != ParamType::reference) continue;
        std::vector<std::string> known; // names of all allowed kinds
        for (const std::string& kind : split(value.spec->choices, '|'))
            if (const auto entry = names.find(kind); entry != names.end())
                known.insert(known.end(), entry->second.begin(), entry->second.end());
        if (std::find(known.begin(), known.end(), value.text) != known.end()) continue;
        const std::vector<std::string> kinds = split(value.spec->choices, '|');
        reading.report(value.place,
                       fmt::format("{}: there is no {} {}", join(address, value.name),
                                   fmt::join(kinds, " or "), in_quotes(value.text)),
                       known.empty() ? fmt::format("add a [[{}]] of this name", fmt::join(kinds, "]] or [["))
                                     : hint(value.text, known, ""));
    }
}

void check_all_references(const SceneDescription& scene, const std::vector<Name>& names, Reading& reading) {
    NamesByKind by_kind;
    for (const Name& name : names) by_kind[name.kind].push_back(name.name);
    check_references(scene.globals, "", by_kind, reading);
    check_references(scene.camera, "camera", by_kind, reading);
    check_references(scene.film, "film", by_kind, reading);
    check_references(scene.wind, "wind", by_kind, reading);
    auto check = [&](const char* kind, const std::vector<Item>& items) {
        for (const Item& item : items)
            check_references(item.params, item.name.empty() ? kind : join(kind, clean(item.name)), by_kind,
                             reading);
    };
    check("light", scene.lights);
    check("material", scene.materials);
    check("mesh", scene.meshes);
    check("curves", scene.curves);
    check("procedural", scene.procedurals);
}

} // namespace

void check_names(const std::vector<Name>& names, Reading& reading) {
    std::map<std::pair<std::string, std::string>, const Name*> first;
    for (const Name& name : names) {
        const bool geometry = name.kind == "procedural" || name.kind == "curves";
        const std::string space = geometry ? "mesh" : name.kind;
        const auto [entry, is_new] = first.try_emplace({space, name.name}, &name);
        if (is_new) continue;
        const Name& other = *entry->second;
        reading.report(name.place,
                       fmt::format("the name {} is taken by the {} at {}", in_quotes(name.name), other.kind,
                                   to_string(other.place)),
                       fmt::format("give this {} a name of its own", name.kind));
    }
}

void check_rules(const SceneDescription& scene, const std::vector<Name>& names, Reading& reading) {
    check_whole(scene.globals, "", "frames", reading);
    check_whole(scene.film, "film", "size", reading);
    const ParamValue *metres = scene.globals.find("tolerance"),
                     *pixels = scene.globals.find("tolerance_pixels");
    if (metres && pixels && metres->given && pixels->given)
        reading.report(pixels->place, "tolerance and tolerance_pixels are both given", "keep one of them");
    check_camera(scene.camera, reading);
    check_lights(scene.lights, reading);
    check_files(scene.meshes, "mesh", "file", mesh_files, reading);
    check_files(scene.curves, "curves", "strands", strand_files, reading);
    check_all_references(scene, names, reading);
}

} // namespace marram
