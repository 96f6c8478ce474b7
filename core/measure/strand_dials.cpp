// SPDX-License-Identifier: Apache-2.0
#include "core/measure/strand_dials.h"

#include "core/measure/dial_settings.h"
#include "core/shot/settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

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

// Changes that set a key in every groom that declares it and, if given, has the wind's parameter `only_with`.
std::vector<std::string> set_in_grooms(const Shot& shot, const std::string& key, const std::string& value,
                                       const std::string& only_with = "") {
    return set_in_procedurals(shot, key, value, [&](const Item& groom) {
        return only_with.empty() || wind_value(shot, groom, only_with) != nullptr;
    });
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
    // Without collision no root is covered by other meshes: keep the same strands in all settings.
    const std::vector<std::string> same_strands = set_in_grooms(shot, "clear_of", "\"none\"");
    DialSetting& first = dial.settings.emplace_back(
        DialSetting{"exact", set_in_grooms(shot, "wind.collision.solver", "\"exact\""), exact, 0});
    if (exact) first.changes.clear();
    dial.settings.push_back(
        {"none", set_in_grooms(shot, "wind.collision.solver", "\"none\""), solver == "none", 0});
    double own = 16.0;
    common_wind_value(shot, "collision.rotation_steps", own);
    NumberedSettings steps;
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
    for (DialSetting& setting : dial.settings)
        setting.changes.insert(setting.changes.end(), same_strands.begin(), same_strands.end());
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
    NumberedSettings settings;
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
              "polygon of the finest. Other numbers than the scene's own are set with "
              "wind.reference_segments, so that they show the same pose.",
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
    NumberedSettings settings;
    std::vector<double> counts = sweep_of(shot, "cvs");
    counts.push_back(2.0 * (counts.back() - 1.0) +
                     1.0); // the reference is finer than what is compared with it
    for (const double n : counts) {
        std::vector<std::string> changes = set_in_grooms(shot, "cvs", fmt::format("{}", n));
        changes.insert(changes.end(), authored.begin(), authored.end());
        settings.emplace_back(n, DialSetting{fmt::format("{}", n), changes, false, 0});
    }
    if (own > 0) add_own(settings, own, std::to_string(own));
    dial.settings = settings_of(std::move(settings));
    dial.reference = dial.settings.size() - 1;
    dial.law = [](double n) { return 1.0 / ((n - 1.0) * (n - 1.0)); };
    dial.law_words = "falls with the square of the number of segments";
    dial.settings.push_back(tolerance_setting(own == 0, set_in_grooms(shot, "cvs", "0")));
    dial.settings.back().changes.insert(dial.settings.back().changes.end(), authored.begin(), authored.end());
    dial.weight = 4.0;
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
    NumberedSettings settings;
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
    Dial dial{"tolerance",
              "What each approximation may be off by, for 99 strands in 100: jiggle's window and step, "
              "octaves, rays "
              "and CVs that are left to it; and how far drawn curves may dip into meshes. Error against a "
              "sixty-fourth of it.",
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

} // namespace

namespace {

bool collides(const Shot& shot) {
    return std::ranges::any_of(shot.description.procedurals, [&](const Item& groom) {
        const ParamValue* solver = wind_value(shot, groom, "collision.solver");
        return solver && solver->text != "none";
    });
}

} // namespace

void add_strand_dials(const Shot& shot, DialList& list) {
    const size_t first = list.dials.size();
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
    if (!collides(shot)) return;
    for (size_t i = first; i < list.dials.size(); ++i)
        if (Dial& dial = list.dials[i]; dial.error == DialError::pose && dial.name != "contact") {
            dial.without_contact = set_in_grooms(shot, "wind.collision.solver", "\"none\"");
            dial.explain += " Errors are those before contact.";
        }
}

} // namespace marram
