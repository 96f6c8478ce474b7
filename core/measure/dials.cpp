// SPDX-License-Identifier: Apache-2.0
#include "core/measure/dials.h"

#include "core/shot/settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <sstream>

namespace marram {
namespace {

// The wind parameter of a groom: its own if given, else the scene's; nullptr if neither has it.
const ParamValue* wind_value(const Shot& shot, const Item& groom, const std::string& name) {
    const ParamValue* own = groom.params.find("wind." + name);
    return own && own->given ? own : shot.description.wind.find(name);
}

bool any_groom_has(const Shot& shot, const std::string& name) {
    return std::ranges::any_of(shot.description.procedurals,
                               [&](const Item& groom) { return wind_value(shot, groom, name) != nullptr; });
}

// Whether all grooms that have the parameter have the same value, returned in `out`.
bool common_wind_value(const Shot& shot, const std::string& name, double& out) {
    bool found = false;
    for (const Item& groom : shot.description.procedurals) {
        const ParamValue* value = wind_value(shot, groom, name);
        if (!value || value->numbers.empty()) continue;
        if (found && value->numbers[0] != out) return false;
        out = value->numbers[0];
        found = true;
    }
    return found;
}

bool declares(const Shot& shot, const Item& item, const std::string& key) {
    for (const ItemSchema& schema : shot.plugins->schema.procedurals)
        if (schema.type == item.type)
            return std::ranges::any_of(schema.params,
                                       [&](const ParamSpec& spec) { return spec.name == key; });
    return false;
}

// The declaration of a key by a procedural of the scene; nullptr if none has it.
const ParamSpec* declaration(const Shot& shot, const std::string& key) {
    for (const Item& item : shot.description.procedurals)
        for (const ItemSchema& schema : shot.plugins->schema.procedurals)
            if (schema.type == item.type)
                for (const ParamSpec& spec : schema.params)
                    if (spec.name == key) return &spec;
    return nullptr;
}

// The values of a sweep as TOML.
std::vector<std::string> texts_of_sweep(const ParamSpec& spec) {
    std::vector<std::string> values;
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

// The values of a sweep as numbers.
std::vector<double> sweep_of(const ParamSpec& spec) {
    std::vector<double> values;
    std::istringstream text(spec.sweep);
    for (std::string value; std::getline(text, value, '|');) values.push_back(std::stod(value));
    return values;
}

std::vector<double> sweep_of(const Shot& shot, const std::string& key) {
    const ParamSpec* spec = declaration(shot, key);
    return spec ? sweep_of(*spec) : std::vector<double>{};
}

// Changes that set a key in every procedural that declares it and, if given, has the parameter `only_with`.
std::vector<std::string> set_in_grooms(const Shot& shot, const std::string& key, const std::string& value,
                                       const std::string& only_with = "") {
    std::vector<std::string> changes;
    for (const Item& groom : shot.description.procedurals)
        if (declares(shot, groom, key) && (only_with.empty() || wind_value(shot, groom, only_with)))
            changes.push_back(fmt::format("procedural.{}.{}={}", groom.name_in_file(), key, value));
    return changes;
}

// Marks the scene's own value among the settings, or inserts it in order if it is not one of them.
void add_own(std::vector<std::pair<double, DialSetting>>& settings, double own, const std::string& label) {
    const auto at = std::ranges::find_if(settings, [&](const auto& setting) { return setting.first >= own; });
    if (at != settings.end() && at->first == own)
        at->second.own = true;
    else
        settings.insert(at, {own, {label, {}, true, 0}});
}

// The setting that the tolerance chooses.
DialSetting tolerance_setting(bool own, std::vector<std::string> changes) {
    if (own) changes.clear();
    return {"by the tolerance", std::move(changes), own, 0, 0.0, true};
}

std::vector<DialSetting> settings_of(std::vector<std::pair<double, DialSetting>> numbered) {
    std::vector<DialSetting> settings;
    for (auto& [number, setting] : numbered) settings.emplace_back(std::move(setting)).number = number;
    return settings;
}

Dial contact(const Shot& shot) {
    Dial dial{
        "contact", "How far a segment turns before it touches: by steps of a fixed number, or exactly. ",
        "collide", DialError::pose,
        true,      {},
        0};
    const std::string solver = [&] {
        for (const Item& groom : shot.description.procedurals)
            if (const ParamValue* value = wind_value(shot, groom, "collision.solver")) return value->text;
        return std::string("none");
    }();
    const bool exact = solver == "exact";
    DialSetting& first = dial.settings.emplace_back(
        DialSetting{"exact", set_in_grooms(shot, "wind.collision.solver", "\"exact\""), exact, 0});
    if (exact) first.changes.clear();
    dial.settings.push_back(
        {"none", set_in_grooms(shot, "wind.collision.solver", "\"none\""), solver == "none", 0});
    double own = 16.0;
    common_wind_value(shot, "collision.rotation_steps", own);
    std::vector<std::pair<double, DialSetting>> steps;
    for (const double n : sweep_of(shot, "wind.collision.rotation_steps")) {
        std::vector<std::string> changes = set_in_grooms(shot, "wind.collision.solver", "\"steps\"");
        for (std::string& more : set_in_grooms(shot, "wind.collision.rotation_steps", fmt::format("{}", n)))
            changes.push_back(std::move(more));
        steps.emplace_back(n, DialSetting{fmt::format("{} steps", n), changes, false, 0});
    }
    if (solver == "steps") add_own(steps, own, fmt::format("{} steps", own));
    for (DialSetting& setting : settings_of(std::move(steps))) dial.settings.push_back(std::move(setting));
    if (any_groom_has(shot, "collision.rotation_steps")) { // exact contact rejects this parameter
        dial.reference = dial.settings.size() - 1;
        dial.explain +=
            "Error against the most steps: remove rotation_steps to measure against exact contact.";
    } else {
        dial.explain +=
            "Error against exact contact, which the tests hold against an independent oracle to 1e-10 rad; "
            "steps keep no clearance, so their error has a floor.";
    }
    dial.weight = 3.0;
    return dial;
}

Dial shield_per(const Shot& shot) {
    Dial dial{"shield_per",
              "Whether the shelter of a strand is one number or one for each CV. Error against one for each.",
              "shield",
              DialError::pose,
              false,
              {},
              0};
    for (const std::string value : {"cv", "curve"})
        dial.settings.push_back(
            {value, set_in_grooms(shot, "wind.shielding.shield_per", '"' + value + '"', "shielding.shield"),
             false, 0});
    bool per_cv = false;
    for (const Item& groom : shot.description.procedurals)
        if (const ParamValue* value = wind_value(shot, groom, "shielding.shield_per"))
            per_cv |= value->text == "cv";
    dial.settings[per_cv ? 0 : 1].own = true;
    return dial;
}

// A dial over numbers, with the finest first or last. If the scene leaves the number to the tolerance, or its
// grooms differ, the scene's own state is one more setting.
Dial numeric_dial(const Shot& shot, Dial dial, const std::string& key, const std::string& parameter,
                  const std::string& only_with, bool finest_first) {
    std::vector<std::pair<double, DialSetting>> settings;
    for (const double value : sweep_of(shot, key))
        settings.emplace_back(
            value, DialSetting{fmt::format("{}", value),
                               set_in_grooms(shot, key, fmt::format("{}", value), only_with), false, 0});
    double own = 0.0;
    const bool one = common_wind_value(shot, parameter, own);
    if (one) add_own(settings, own, fmt::format("{}", own));
    dial.settings = settings_of(std::move(settings));
    dial.reference = finest_first ? 0 : dial.settings.size() - 1;
    if (!one) {
        dial.settings.push_back(any_groom_has(shot, parameter) ? DialSetting{"as it is", {}, true, 0}
                                                               : tolerance_setting(true, {}));
    }
    return dial;
}

Dial cvs(const Shot& shot) {
    Dial dial{"cvs",
              "Control vertices a strand. Error against the most: the largest distance of a CV from the "
              "polygon of the "
              "finest.",
              "strands and BVH",
              DialError::pose,
              false,
              {},
              0};
    std::vector<int> each;
    for (const Item& groom : shot.description.procedurals)
        if (declares(shot, groom, "cvs")) each.push_back(groom.params.integer("cvs"));
    const int own = each.front(); // all grooms are set to the same
    // Fix the segments that bending is authored for, so that more CVs only sample the same pose more finely.
    std::vector<std::string> authored;
    double segments = 0.0;
    if (!common_wind_value(shot, "reference_segments", segments) || segments == 0.0)
        authored = set_in_grooms(shot, "wind.reference_segments",
                                 std::to_string(own > 0 ? own - 1 : 7)); // 7: the groom's default
    std::vector<std::pair<double, DialSetting>> settings;
    for (const double n : sweep_of(shot, "cvs")) {
        std::vector<std::string> changes = set_in_grooms(shot, "cvs", fmt::format("{}", n));
        changes.insert(changes.end(), authored.begin(), authored.end());
        settings.emplace_back(n, DialSetting{fmt::format("{}", n), changes, false, 0});
    }
    if (own > 0) add_own(settings, own, std::to_string(own));
    dial.settings = settings_of(std::move(settings));
    dial.reference = dial.settings.size() - 1;
    dial.law = [](double n) { return 1.0 / (n - 1.0); };
    dial.law_words = "falls with the number of segments";
    dial.settings.push_back(tolerance_setting(own == 0, set_in_grooms(shot, "cvs", "0")));
    dial.settings.back().changes.insert(dial.settings.back().changes.end(), authored.begin(), authored.end());
    dial.weight = 4.0;
    return dial;
}

Dial motion_keys(uint32_t own) { // 0: chosen by the tolerance
    Dial dial{
        "motion_keys",
        "Motion samples over the shutter, between which strands and meshes move along straight lines. Error "
        "against 64, at all of their times, in pixels: what 99 strands in 100 stay below.",
        "strands and BVH",
        DialError::motion,
        false,
        {},
        0};
    std::vector<std::pair<double, DialSetting>> settings;
    for (const int n : {2, 3, 5, 9, 17, 64})
        settings.emplace_back(
            n, DialSetting{std::to_string(n), {fmt::format("film.motion_keys={}", n)}, false, 0});
    if (own > 0) add_own(settings, own, std::to_string(own));
    dial.settings = settings_of(std::move(settings));
    dial.reference = dial.settings.size() - 1;
    if (own == 0) dial.settings.push_back(tolerance_setting(true, {}));
    dial.weight = 4.0;
    return dial;
}

Dial tolerance(const Shot& shot) {
    Dial dial{
        "tolerance",
        "What the scene allows approximations to be off by: jiggle's window and step, octaves, rays and CVs "
        "that are left to it, how far drawn curves "
        "may dip "
        "into meshes. Error against a sixty-fourth of it.",
        "strands",
        DialError::pose,
        false,
        {},
        0};
    const bool pixels = shot.description.globals.has("tolerance_pixels");
    const std::string key = pixels ? "tolerance_pixels" : "tolerance";
    const double own = shot.description.globals.number(key);
    for (const double factor : {64.0, 16.0, 4.0, 1.0, 1.0 / 4.0, 1.0 / 16.0, 1.0 / 64.0})
        dial.settings.push_back({fmt::format("{:.3g} {}", own * factor, pixels ? "pixels" : "m"),
                                 {fmt::format("{}={}", key, own * factor)},
                                 factor == 1.0,
                                 0});
    dial.reference = dial.settings.size() - 1;
    dial.weight = 2.0;
    return dial;
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
    std::vector<std::pair<double, DialSetting>> settings;
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

Dial octaves(const Shot& shot, int own) {
    Dial dial{"octaves",
              "Octaves of the wind's noise. Error against what the scene has: what fewer would leave out.",
              "bend",
              DialError::pose,
              false,
              {},
              0};
    for (int n = 1; n <= own; ++n)
        dial.settings.push_back(
            {std::to_string(n), set_in_grooms(shot, "wind.noise.octaves", std::to_string(n)), n == own, 0});
    dial.reference = dial.settings.size() - 1;
    return dial;
}

// Any other parameter with a sweep. The reference is the last of its values. change: returns the changes that
// set a value.
Dial declared(const ParamSpec& spec, const std::string& name,
              const std::function<std::vector<std::string>(const std::string& value)>& change) {
    constexpr std::string_view seconds = "seconds.";
    Dial dial{name, spec.help + ". Error against the last.", "strands", DialError::pose, false, {}, 0};
    if (spec.sweep_time.starts_with(seconds)) dial.time = spec.sweep_time.substr(seconds.size());
    if (dial.time == "terrain") dial.error = DialError::surface;
    if (dial.time == "view") dial.error = DialError::view;
    for (const std::string& value : texts_of_sweep(spec))
        dial.settings.push_back({value, change(value), false, 0});
    dial.reference = dial.settings.size() - 1;
    dial.settings.push_back({"as it is", {}, true, 0});
    return dial;
}

// Sweeps that have their own function above.
constexpr std::array known_sweeps = {"wind.collision.rotation_steps", "wind.shielding.rays",
                                     "wind.jiggle.step", "cvs"};

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
                list.dials.push_back(declared(spec, name, change));
                done.push_back(name);
            }
}

void add_declared(const Shot& shot, DialList& list) {
    std::vector<std::string> done(known_sweeps.begin(), known_sweeps.end());
    for (const Item& item : shot.description.procedurals)
        for (const ItemSchema& schema : shot.plugins->schema.procedurals) {
            if (schema.type != item.type) continue;
            for (const ParamSpec& spec : schema.params) {
                if (spec.sweep.empty() || !gives_any_of_table(item, spec.name) ||
                    std::ranges::find(done, spec.name) != done.end())
                    continue;
                list.dials.push_back(declared(spec, spec.name, [&](const std::string& value) {
                    return set_in_grooms(shot, spec.name, value);
                }));
                done.push_back(spec.name);
            }
            add_declared_of_lists(shot, schema, done, list);
        }
}

} // namespace

double seconds_of(const Dial& dial, const FrameStats& stats) {
    if (dial.time == "trace") return stats.trace;
    if (dial.time == "terrain" || dial.time == "view") return stats.build.terrain;
    const double strands = strand_seconds(stats.build.report);
    if (dial.time == "strands") return strands;
    if (dial.time == "strands and BVH") return strands + stats.build.curves_bvh;
    return stats.build.report("seconds." + dial.time);
}

DialList dials_of(const Shot& shot) {
    DialList list;
    const SceneDescription& description = shot.description;
    const auto leave_out = [&](const std::string& why) { list.left_out.push_back(why); };
    const auto grows = [&](const Item& item) { return declares(shot, item, "wind.collision.solver"); };
    const bool strands = std::ranges::any_of(description.procedurals, grows);
    if (!strands)
        leave_out(
            "contact, shielding, jiggle, motion keys, CVs, octaves, tolerance: the scene has no strands");
    if (strands && !description.meshes.empty()) list.dials.push_back(contact(shot));
    if (strands && any_groom_has(shot, "shielding.shield")) {
        list.dials.push_back(shield_per(shot));
        if (any_groom_has(shot, "shielding.spread")) {
            Dial dial{"shield_rays",
                      "Rays a CV in the cone that wind comes from. Error against the most.",
                      "shield",
                      DialError::pose,
                      false,
                      {},
                      0};
            dial = numeric_dial(shot, std::move(dial), "wind.shielding.rays", "shielding.rays",
                                "shielding.spread", false);
            dial.weight = 3.0;
            dial.law = [](double rays) { return std::pow(rays, -0.8); };
            dial.law_words = "falls with the number of rays to the power 0.8";
            list.dials.push_back(std::move(dial));
        } else {
            leave_out("shield_rays: without shielding.spread each CV asks one ray");
        }
    } else if (strands) {
        leave_out("shield_per, shield_rays: nothing is shielded (wind.shielding)");
    }
    if (strands && any_groom_has(shot, "jiggle.frequency")) {
        Dial dial{"jiggle_step",
                  "Frames between the samples of the past that jiggle follows. Error against the shortest.",
                  "jiggle",
                  DialError::pose,
                  false,
                  {},
                  0};
        dial =
            numeric_dial(shot, std::move(dial), "wind.jiggle.step", "jiggle.step", "jiggle.frequency", true);
        dial.law = [](double step) { return step * step; };
        dial.law_words = "grows with the square of the step";
        list.dials.push_back(std::move(dial));
    } else if (strands) {
        leave_out("jiggle_step: nothing jiggles (wind.jiggle)");
    }
    if (strands && (any_groom_has(shot, "collision.solver") || any_groom_has(shot, "jiggle.frequency"))) {
        if (description.globals.number("tolerance") > 0.0 || description.globals.has("tolerance_pixels"))
            list.dials.push_back(tolerance(shot));
    } else if (strands) {
        leave_out("tolerance: neither collision nor jiggle, which follow it");
    }
    const BuildSettings build = build_settings(shot, description.globals.vec2("frames").x());
    if (strands && build.shutter_open < build.shutter_close)
        list.dials.push_back(motion_keys(build.motion_keys));
    else if (strands)
        leave_out("motion_keys: the shutter does not open (camera.shutter)");
    if (declaration(shot, "cvs")) list.dials.push_back(cvs(shot));
    double own = 0.0;
    if (strands && common_wind_value(shot, "noise.octaves", own) && own > 1.0)
        list.dials.push_back(octaves(shot, int(own)));
    else if (strands)
        leave_out("octaves: the noise has one octave, or not the same number in all grooms");
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
