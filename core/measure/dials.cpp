// SPDX-License-Identifier: Apache-2.0
#include "core/measure/dials.h"

#include "core/measure/dial_settings.h"
#include "core/measure/strand_dials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>

namespace marram {
namespace {

constexpr std::string_view procedural_meshes = "procedural_meshes"; // seconds.procedural_meshes of the report

// The end of a sweep "1..name", which are all integers up to that parameter of the item. 0: another sweep.
long end_of_sweep(const ParamSpec& spec, const Item& item) {
    const size_t dots = spec.sweep.find("..");
    const ParamValue* last =
        dots != std::string::npos ? item.params.find(spec.sweep.substr(dots + 2)) : nullptr;
    return last && !last->numbers.empty() ? std::lround(last->numbers[0]) : 0;
}

// The values of a sweep as TOML, for an item that declares it.
std::vector<std::string> texts_of_sweep(const ParamSpec& spec, const Item& item) {
    std::vector<std::string> values;
    if (spec.sweep.find("..") != std::string::npos) {
        for (long k = std::stol(spec.sweep); k <= end_of_sweep(spec, item); ++k)
            values.push_back(std::to_string(k));
        return values;
    }
    std::istringstream text(spec.sweep);
    for (std::string value; std::getline(text, value, '|');)
        values.push_back(spec.type == ParamType::choice ? fmt::format("\"{}\"", value) : value);
    return values;
}

// Whether an item gives any parameter of the same table, such as "guides" of "guides.wind". Always true for
// "wind." and for parameters that are not in a table.
bool gives_any_of_table(const Item& item, const std::string& name) {
    const size_t dot = name.rfind('.');
    if (dot == std::string::npos || name.starts_with("wind.")) return true;
    return std::ranges::any_of(item.params.all(), [&](const ParamValue& value) {
        return value.given && value.name.starts_with(name.substr(0, dot + 1));
    });
}

// How closely the render mesh of a terrain follows its growth surface.
Dial view_detail(const Shot& shot) {
    Dial dial{
        "view_detail",
        "What the scene allows the mesh that the camera sees of a terrain to be off by. Error against a "
        "sixteenth of a pixel.",
        "view",
        DialError::view,
        false,
        {},
        0};
    const double own = shot.description.globals.has("tolerance_pixels")
                           ? shot.description.globals.number("tolerance_pixels")
                           : 0.0;
    NumberedSettings settings;
    for (const double pixels : {0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0})
        settings.emplace_back(pixels, DialSetting{fmt::format("{} px", pixels),
                                                  {fmt::format("tolerance_pixels={}", pixels)},
                                                  false,
                                                  0});
    if (own > 0.0) add_own(settings, own, fmt::format("{} px", own));
    std::ranges::reverse(settings);
    dial.settings = settings_of(std::move(settings));
    dial.reference = dial.settings.size() - 1;
    if (!(own > 0.0)) dial.settings.push_back({"as it is", {}, true, 0});
    return dial;
}

Dial samples(const Shot& shot) {
    Dial dial{
        "samples",
        "Paths a pixel. Error: root mean square over the pixels of a small picture, relative to its mean, "
        "against four times as many of other seeds.",
        "trace",
        DialError::image,
        false,
        {},
        0};
    const auto own = uint32_t(shot.description.film.integer("samples"));
    for (uint32_t n = 1; n < own; n *= 4) dial.settings.push_back({std::to_string(n), {}, false, n});
    dial.settings.push_back({std::to_string(own), {}, true, own});
    dial.settings.push_back({std::to_string(4 * own), {}, false, 4 * own});
    dial.reference = dial.settings.size() - 1;
    dial.weight = 3.0;
    return dial;
}

// Any other parameter with a sweep. The reference is the last of its values. change: returns the changes that
// set a value.
Dial declared(const ParamSpec& spec, const std::string& name, const std::vector<std::string>& values,
              const std::function<std::vector<std::string>(const std::string& value)>& change) {
    constexpr std::string_view seconds = "seconds.";
    Dial dial{name, spec.help + ". Error against the last.", "strands", DialError::pose, false, {}, 0};
    if (spec.sweep_time.starts_with(seconds)) dial.time = spec.sweep_time.substr(seconds.size());
    if (dial.time == procedural_meshes) dial.error = DialError::surface;
    if (dial.time == "view") dial.error = DialError::view;
    for (const std::string& value : values) dial.settings.push_back({value, change(value), false, 0});
    dial.reference = dial.settings.size() - 1;
    dial.settings.push_back({"as it is", {}, true, 0});
    return dial;
}

// Adds the sweeps of list elements, such as layers: "layer[].search_accuracy" of all layers of one type.
void add_declared_of_lists(const Shot& shot, const ItemSchema& schema, std::vector<std::string>& done,
                           DialList& list) {
    for (const ListSchema& elements : schema.lists)
        for (const ItemSchema& type : elements.types)
            for (const ParamSpec& spec : type.params) {
                const std::string name = fmt::format("{}.{}", type.type, spec.name);
                if (spec.sweep.empty() || std::ranges::find(done, name) != done.end()) continue;
                const auto change = [&](const std::string& value) {
                    std::vector<std::string> changes;
                    for (const Item& item : shot.description.procedurals) {
                        const ParamList* found = item.params.find_list(elements.name);
                        for (size_t k = 0; item.type == schema.type && found && k < found->size; ++k) {
                            const std::string element = fmt::format("{}[{}].", elements.name, k);
                            if (item.params.text(element + "type") == type.type)
                                changes.push_back(fmt::format("procedural.{}.{}{}={}", item.name_in_file(),
                                                              element, spec.name, value));
                        }
                    }
                    return changes;
                };
                if (change("0").empty()) continue;
                list.dials.push_back(declared(spec, name, texts_of_sweep(spec, {}), change));
                done.push_back(name);
            }
}

void add_declared(const Shot& shot, DialList& list) {
    std::vector<std::string> done(sweeps_of_strand_dials.begin(), sweeps_of_strand_dials.end());
    for (const Item& item : shot.description.procedurals)
        for (const ItemSchema& schema : shot.plugins->schema.procedurals) {
            if (schema.type != item.type) continue;
            for (const ParamSpec& spec : schema.params) {
                if (spec.sweep.empty() || !gives_any_of_table(item, spec.name) ||
                    std::ranges::find(done, spec.name) != done.end())
                    continue;
                const std::vector<std::string> values = texts_of_sweep(spec, item);
                if (values.size() < 2) continue;
                list.dials.push_back(declared(spec, spec.name, values, [&](const std::string& value) {
                    return set_in_procedurals(shot, spec.name, value, [&](const Item& other) {
                        const long end = end_of_sweep(spec, other);
                        return end == 0 || std::stol(value) <= end;
                    });
                }));
                done.push_back(spec.name);
            }
            add_declared_of_lists(shot, schema, done, list);
        }
}

} // namespace

double seconds_of(const Dial& dial, const FrameStats& stats) {
    if (dial.time == "trace") return stats.trace;
    if (dial.time == procedural_meshes || dial.time == "view") return stats.build.procedural_meshes;
    const double strands = strand_seconds(stats.build.report);
    if (dial.time == "strands") return strands;
    if (dial.time == "strands and BVH") return strands + stats.build.bvh;
    return stats.build.report("seconds." + dial.time);
}

DialList dials_of(const Shot& shot) {
    DialList list;
    add_strand_dials(shot, list);
    add_declared(shot, list);
    if (std::ranges::any_of(shot.geometry.procedurals,
                            [](const auto& procedural) { return procedural->has_view(); }))
        list.dials.push_back(view_detail(shot));
    list.dials.push_back(samples(shot));
    return list;
}

std::vector<std::string> thinned(const Shot& shot, double share) {
    std::vector<std::string> changes;
    for (const Item& item : shot.description.procedurals) {
        const ParamValue *count = item.params.find("count"), *density = item.params.find("density");
        if (count && count->given)
            changes.push_back(fmt::format("procedural.{}.count={:.0f}", item.name_in_file(),
                                          std::max(1.0, std::round(count->numbers[0] * share))));
        else if (density && density->given)
            changes.push_back(
                fmt::format("procedural.{}.density={}", item.name_in_file(), density->numbers[0] * share));
    }
    return changes;
}

} // namespace marram
