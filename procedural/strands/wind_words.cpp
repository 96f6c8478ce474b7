// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/wind_words.h"

#include "procedural/wind/keyed_wind.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string_view>

namespace marram {
namespace {

std::string_view place_of_value(const Values& values, const std::string& name) {
    const MarramValue* value = values.find(name);
    return value && value->place ? value->place : "";
}

// A scene that gives one of these wants wind.
bool asks_for_wind(const Values& given, const Wind& wind) {
    return wind.gusts || wind.jiggle || wind.shielding || is_given(given, "wind.direction") ||
           is_given(given, "wind.noise.amplitude") || is_given(given, "wind.global_rotate");
}

// The frames of the shot, with the one that is built; empty if the host does not tell them.
std::optional<Vec2d> shot_frames(const MarramFrame& frame) {
    if (!(frame.shot_first < frame.shot_last)) return {};
    return Vec2d(std::min(frame.shot_first, frame.frame), std::max(frame.shot_last, frame.frame));
}

std::string direction_text(const Vec3d& direction) {
    static constexpr const char* names[3][2] = {{"-x", "+x"}, {"-y", "+y"}, {"-z", "+z"}};
    for (int axis = 0; axis < 3; ++axis)
        if (std::abs(direction[axis]) == 1.0) return names[axis][direction[axis] > 0.0 ? 1 : 0];
    return fmt::format("[{:.3g}, {:.3g}, {:.3g}]", direction.x(), direction.y(), direction.z());
}

std::string gust_text(const Wind& wind, const MarramFrame& frame, const Eigen::AlignedBox3d& strands) {
    const Gusts& gusts = *wind.gusts;
    const Vec2d frames = shot_frames(frame).value_or(Vec2d::Constant(frame.frame));
    const GustContacts contacts = gusts_touching(gusts, gust_carrier(wind), frames, frame.fps, strands);
    std::string text = "  gusts: ";
    if (gusts.num_gusts > 0) {
        text += fmt::format("{}{}", gusts.num_gusts,
                            gusts.period > 0.0 ? fmt::format(" in each {:g} frames", gusts.period) : "");
        text += contacts.counted ? fmt::format(", {} of the {} in the shot touch strands", contacts.touching,
                                               contacts.passing)
                                 : ", too many to count those that touch strands";
    }
    if (!gusts.controls.empty())
        text += fmt::format("{}{} placed by hand, {} of them touch strands", gusts.num_gusts > 0 ? "; " : "",
                            gusts.controls.size(), std::ranges::count(contacts.controls, true));
    return text + (frames.x() < frames.y() ? fmt::format(" (frames {:g} to {:g})\n", frames.x(), frames.y())
                                           : fmt::format(" (frame {:g})\n", frames.x()));
}

} // namespace

std::vector<std::string> keyed_names(const Wind& wind) {
    std::vector<std::string> names;
    for (const KeyedWind::Track& track : wind.keys->tracks) {
        const std::string name = track.name.substr(track.name.find('.') + 1); // "wind." is said
        names.push_back(name);
    }
    return names;
}

void warn_of_idle_wind(const MarramHost& host, const Values& given, const Wind& wind) {
    const auto warn = [&](const char* name, const std::string& what, const std::string& remedy) {
        send(host, MARRAM_WARNING, "wind.idle", std::string(place_of_value(given, name)), what, remedy);
    };
    const std::span<const double> speeds = wind.response.positions();
    const auto blows_alone = [](const PlacedField& field) { // where the mean wind does not
        return field.shape != FieldShape::curves && field.shape != FieldShape::image;
    };
    if (std::ranges::any_of(wind.fields, blows_alone)) return;
    if (wind.speed == 0.0) {
        if (!is_given(given, "wind.speed") && asks_for_wind(given, wind)) // else 0 on purpose
            warn("wind.direction", "wind.speed is not given, and without it the wind does nothing",
                 "give wind.speed, in m/s");
    } else if (wind_response(wind) == 0.0) {
        warn("wind.response",
             fmt::format("wind.response is 0 at wind.speed = {:g} m/s: the wind does nothing", wind.speed),
             "raise its values");
    } else if (wind.global_rotate == 0.0) {
        warn("wind.global_rotate", "wind.global_rotate is 0: the wind does nothing", "raise it, up to 1");
    } else if (wind.calm == 0.0 && !wind.gusts) {
        warn("wind.calm", "wind.calm is 0 and there are no gusts: the wind does nothing, whatever its speed",
             "leave wind.calm out, or add gusts");
    } else if (wind.speed > speeds.back() && !wind.bends_blades) {
        warn("wind.speed",
             fmt::format(
                 "wind.speed = {:g} m/s is beyond the end of wind.response: strands bend as at {:g} m/s",
                 wind.speed, speeds.back()),
             fmt::format("extend it: response = [[0, 0], [{:g}, 1]]", std::ceil(1.25 * wind.speed)));
    }
}

void warn_of_untouching_gusts(const MarramHost& host, const Wind& wind, const MarramFrame& frame,
                              const Eigen::AlignedBox3d& strands) {
    const std::optional<Vec2d> frames = shot_frames(frame);
    for (size_t i = 0; frames && !strands.isEmpty() && i < wind.fields.size(); ++i)
        if (!field_touches(wind.fields[i], *frames, strands))
            send(host, MARRAM_COMMON_WARNING, "field.no_contact", fmt::format("wind.field[{}]", i),
                 fmt::format("this field touches no strand in frames {:g} to {:g}", frames->x(), frames->y()),
                 wind.fields[i].shape == FieldShape::grid
                     ? "check its transform: its box is that of the file's active voxels, in metres"
                 : wind.fields[i].shape == FieldShape::curves
                     ? "check its curves, or raise its reach: their influence ends at 4 times it"
                     : "check its transform: it reaches to 1 m from its centre, times its scale");
    if (!wind.gusts || !frames || !wind_bends(wind) || strands.isEmpty()) return;
    const Gusts& gusts = *wind.gusts;
    const GustContacts contacts = gusts_touching(gusts, gust_carrier(wind), *frames, frame.fps, strands);
    const std::string still =
        wind.calm == 0.0 ? ", and wind.calm is 0: without them strands do not move" : "";
    if (gusts.num_gusts > 0 && contacts.counted && contacts.touching == 0)
        send(host, MARRAM_COMMON_WARNING, "gusts.no_contact", "wind.gusts",
             fmt::format("none of the {} gusts of frames {:g} to {:g} touches a strand{}", contacts.passing,
                         frames->x(), frames->y(), still),
             "give center, extent and distance near the strands (by default gusts start upwind of all meshes "
             "that collide or shelter), or check num_gusts, radius_range, start_frame_range and life_range");
    const auto first = std::ranges::find(contacts.controls, false);
    if (first == contacts.controls.end()) return;
    const auto missing = std::ranges::count(contacts.controls, false);
    send(host, MARRAM_COMMON_WARNING, "gusts.no_contact",
         fmt::format("wind.gusts.control[{}]", first - contacts.controls.begin()),
         fmt::format("this gust{} no strand in frames {:g} to {:g}",
                     missing > 1
                         ? fmt::format(" and {} more of {} touch", missing - 1, contacts.controls.size())
                         : std::string(" touches"),
                     frames->x(), frames->y()),
         "check the transforms");
}

std::string wind_summary(const Wind& wind, const MarramFrame& frame, const Eigen::AlignedBox3d& strands) {
    const double response = wind_response(wind);
    const Wind now = wind_at(wind, frame.frame);
    std::string text =
        wind.keys ? fmt::format("wind: in frame {:g} towards {}, {:g} m/s, {}, {} keyed\n", frame.frame,
                                direction_text(now.direction), now.speed,
                                wind.bends_blades
                                    ? "bends blades"
                                    : fmt::format("strength {:.3g} of 1 by response", wind_response(now)),
                                fmt::join(keyed_names(wind), ", "))
        : wind.bends_blades ? fmt::format("wind: towards {}, {:g} m/s, bends blades\n",
                                          direction_text(wind.direction), wind.speed)
                            : fmt::format("wind: towards {}, {:g} m/s, strength {:.3g} of 1 by response\n",
                                          direction_text(wind.direction), wind.speed, response);
    text += wind.gusts       ? fmt::format("  between gusts: {:.3g} of that (calm)\n", now.calm)
            : now.calm < 1.0 ? fmt::format("  calm: {:.3g} of that\n", now.calm)
                             : "";
    if (wind.gusts) text += gust_text(wind, frame, strands);
    if (wind.over) text += fmt::format("  over: {}\n", wind.over->mesh);
    if (!wind.fields.empty()) {
        std::vector<std::string> fields;
        for (const PlacedField& field : wind.fields) fields.push_back(field_text(field));
        text += fmt::format("  fields: {}, {}\n", wind.fields.size(), fmt::join(fields, ", "));
    }
    std::string stages;
    const auto add = [&](bool runs, const char* stage) {
        if (runs) stages += (stages.empty() ? "" : ", ") + std::string(stage);
    };
    const bool bends = wind_bends(wind);
    add(bends && wind.gusts, "gusts");
    add(bends && wind.shielding, "shielding");
    add(bends, "bend");
    add(wind.jiggle.has_value(), "jiggle");
    add(wind.collision.has_value(), "collision");
    return text + fmt::format("  stages: {}\n", stages.empty() ? "none, strands stay at rest" : stages);
}

void warn_of_heavy_blade(const MarramHost& host, const Blade& blade) {
    constexpr double greenhill = 7.84; // of a uniform blade
    const double number = weight_number(blade);
    if (number > greenhill)
        send(host, MARRAM_INFO, "blade.heavy", blade.place,
             fmt::format("a blade of mean length cannot carry itself upright: mass g length^3 / stiffness is "
                         "{:.3g}, above 7.84, so "
                         "the least wind lays it down",
                         number),
             "raise its stiffness or lower its mass, unless it hangs");
}

void warn_of_unsolved_blades(const MarramHost& host, const std::string& place, uint64_t unsolved) {
    if (unsolved > 0)
        send(host, MARRAM_WARNING, "blade.unsolved", place,
             fmt::format(
                 "the poses of {} blades are not solved to the tolerance: they have the nearest pose found",
                 unsolved),
             "raise blade.stiffness, or lower the wind: blades that point against it, or cannot carry "
             "themselves, may have no "
             "stable pose");
}

} // namespace marram
