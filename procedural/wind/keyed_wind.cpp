// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/keyed_wind.h"

#include "procedural/wind/measured_wind.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {

using Numbers = std::span<const double>;

struct KeyableParam {
    // The value at one time.
    struct Now {
        size_t element; // of a list: which of its tables
        Numbers numbers;
        std::string_view text; // interpolation of a ramp
    };
    std::string_view name;
    void (*set)(Wind& wind, const Now& value);
    // Of a key: the wind's own number is that of the key with the greatest weight. nullptr: the first.
    double (*weight)(const Wind& wind, Numbers numbers);
};

namespace {

using ValueNow = KeyableParam::Now;

double value(const Wind&, Numbers numbers) { return numbers[0]; }
double magnitude(const Wind&, Numbers numbers) { return std::abs(numbers[0]); }
double length(const Wind&, Numbers numbers) { return Vec3d(numbers.data()).norm(); }
double smallness(const Wind&, Numbers numbers) { return -numbers[0]; }
// Minus the rate at which an oscillator of damping zeta forgets, over its frequency: zeta, or of an
// overdamped one zeta - sqrt(zeta^2 - 1). Between two keys the rate is not below both.
double memory(const Wind&, Numbers numbers) {
    const double zeta = numbers[0];
    return zeta < 1.0 ? -zeta : -1.0 / (zeta + std::sqrt(zeta * zeta - 1.0));
}
double largest_of_ramp(const Wind&, Numbers numbers) {
    double most = 0.0;
    for (size_t i = 1; i < numbers.size(); i += 2) most = std::max(most, numbers[i]);
    return most;
}
double strength(const Wind& wind, Numbers numbers) { return wind.response(numbers[0]); }

template <auto member>
void set_number(Wind& wind, const ValueNow& value) {
    wind.*member = value.numbers[0];
}
// Optional stages may have been removed from a copy of the wind.
template <auto stage, auto member>
void set_number_of(Wind& wind, const ValueNow& value) {
    if (wind.*stage) (*(wind.*stage)).*member = value.numbers[0];
}
template <auto member>
void set_number_of_field(Wind& wind, const ValueNow& value) {
    wind.fields[value.element].*member = value.numbers[0];
}
void set_direction(Wind& wind, const ValueNow& value) {
    wind.direction = renormalised(Vec3d(value.numbers.data()));
}
void set_ramp_rotate(Wind& wind, const ValueNow& value) {
    wind.ramp_rotate = Ramp(value.numbers, value.text);
}
void set_response(Wind& wind, const ValueNow& value) { wind.response = Ramp(value.numbers, value.text); }
void set_envelope_of_groom(Wind& wind, const ValueNow& value) {
    wind.point_envelope = Ramp(value.numbers, value.text);
}
void set_control_strength(Wind& wind, const ValueNow& value) {
    if (wind.gusts) wind.gusts->controls[value.element].strength = value.numbers[0];
}
void set_field_velocity(Wind& wind, const ValueNow& value) {
    wind.fields[value.element].velocity = Vec3d(value.numbers.data());
}

constexpr std::array keyable_params = {
    KeyableParam{"wind.response", set_response, nullptr}, // before the speed, whose weight depends on it
    KeyableParam{"wind.direction", set_direction, nullptr},
    KeyableParam{"wind.speed", set_number<&Wind::speed>, strength},
    KeyableParam{"wind.calm", set_number<&Wind::calm>, value},
    KeyableParam{"wind.global_rotate", set_number<&Wind::global_rotate>, value},
    KeyableParam{"wind.ramp_rotate", set_ramp_rotate, largest_of_ramp},
    KeyableParam{"wind.waviness", set_number<&Wind::waviness>, magnitude},
    KeyableParam{"wind.noise.amplitude", set_number<&Wind::noise_amplitude>, value},
    KeyableParam{"wind.noise.evolution", set_number<&Wind::evolution>, magnitude},
    KeyableParam{"wind.gusts.strength", set_number_of<&Wind::gusts, &Gusts::strength>, value},
    KeyableParam{"wind.gusts.control[].strength", set_control_strength, magnitude},
    KeyableParam{"wind.field[].velocity", set_field_velocity, length},
    KeyableParam{"wind.field[].swirl", set_number_of_field<&PlacedField::swirl>, magnitude},
    KeyableParam{"wind.field[].pull", set_number_of_field<&PlacedField::pull>, magnitude},
    KeyableParam{"wind.field[].weight", set_number_of_field<&PlacedField::weight>, value},
    KeyableParam{"wind.shielding.shield", set_number_of<&Wind::shielding, &Shielding::shield>, value},
    KeyableParam{"wind.jiggle.frequency", set_number_of<&Wind::jiggle, &Jiggle::frequency>, smallness},
    KeyableParam{"wind.jiggle.damping", set_number_of<&Wind::jiggle, &Jiggle::damping>, memory},
    KeyableParam{"wind.collision.offset_scale", set_number_of<&Wind::collision, &Collision::offset_scale>,
                 value},
    KeyableParam{"envelope", set_envelope_of_groom, largest_of_ramp},
};

// Makes the directions unit.
void normalise(const Values& values, Keyframes& directions) {
    const std::string place = values.at("wind.direction").place;
    // Half way, the interpolated direction turns 2 tan(angle / 2) / angle times as fast as on average: 7.7
    // times at this angle, and without bound beyond.
    const double opposed = 1.0 + std::cos(170.0 * degree);
    Vec3d before = Vec3d::Zero();
    for (size_t i = 0; i < directions.count(); ++i) {
        const Vec3d given(directions.key(i).data());
        if (!(given.stableNorm() > 0.0))
            throw SceneFault("wind.no_direction", place,
                             fmt::format("the wind's direction is zero at frame {:g}", directions.frames[i]),
                             "give a vector, such as [1, 0, 0]");
        const Vec3d unit = given / given.stableNorm();
        if (1.0 + before.dot(unit) < opposed && directions.interpolation != KeyInterpolation::constant)
            throw SceneFault(
                "wind.reversal", place,
                fmt::format("the wind turns by more than 170 degrees between frames {:g} and {:g}",
                            directions.frames[i - 1], directions.frames[i]),
                "add a key on the way, such as a direction across it");
        std::ranges::copy(unit, directions.numbers.begin() + std::ptrdiff_t(3 * i));
        before = unit;
    }
}

// What the readers of ramps check of the first key.
void check_ramp(const Values& values, const std::string& name, const Keyframes& keys) {
    const bool share = name == "envelope" || name == "wind.response";
    if (!share && name != "wind.ramp_rotate") return;
    for (size_t i = 1; i < keys.numbers.size(); i += 2)
        if (keys.numbers[i] < 0.0 || (share && keys.numbers[i] > 1.0))
            throw SceneFault("wind.ramp_range", values.at(name).place,
                             fmt::format("{} leaves {} at a key", name, share ? "0 ... 1" : "0 and more"),
                             "keep its values inside");
    // Knots move between keys: what holds at each key must hold on the way.
    for (size_t i = 0; i < keys.count() && name == "wind.response"; ++i)
        if (keys.key(i)[0] < 0.0 || keys.key(i)[1] != 0.0)
            throw SceneFault(
                "wind.response_at_rest", values.at(name).place,
                fmt::format("wind.response may not be 0 at speed 0 around frame {:g}", keys.frames[i]),
                "start the ramp of each key with the knot [0, 0]");
}

// A response that no key exceeds, nor any ramp between two of them: the largest at each knot, or where
// knots move, the largest of all from the lowest speed on that any has.
void take_strongest_response(const Keyframes& ramps, std::string_view interpolation, Wind& wind) {
    std::vector<double> knots(ramps.key(0).begin(), ramps.key(0).end());
    bool moves = false;
    double lowest = INFINITY, most = 0.0;
    for (size_t k = 0; k < ramps.count(); ++k)
        for (size_t i = 0; i < knots.size(); i += 2) {
            const double speed = ramps.key(k)[i], response = ramps.key(k)[i + 1];
            moves |= speed != knots[i];
            knots[i + 1] = std::max(knots[i + 1], response);
            if (speed > 0.0) lowest = std::min(lowest, speed);
            most = std::max(most, response);
        }
    if (moves) knots = {0.0, 0.0, lowest, most};
    wind.response = Ramp(knots, interpolation);
}

void add_track(const KeyableParam& param, const std::string& name, size_t element, Keyframes keys,
               std::string text, Wind& wind, std::vector<KeyedWind::Track>& tracks) {
    KeyedWind::Track& track =
        tracks.emplace_back(KeyedWind::Track{name, &param, element, std::move(keys), std::move(text)});
    size_t best = 0;
    for (size_t i = 1; i < track.keys.count() && param.weight; ++i)
        if (param.weight(wind, track.keys.key(i)) > param.weight(wind, track.keys.key(best))) best = i;
    param.set(wind, {element, track.keys.key(best), track.ramp_interpolation});
}

void add_given(const Values& values, const KeyableParam& param, const std::string& name, size_t element,
               Wind& wind, std::vector<KeyedWind::Track>& tracks) {
    std::optional<Keyframes> keys = values.keyframes(name);
    if (!keys) return;
    if (name == "wind.direction") normalise(values, *keys);
    check_ramp(values, name, *keys);
    // Blades have no such dials (set_blade_wind()).
    if (wind.bends_blades && (name == "wind.response" || name == "wind.global_rotate")) return;
    add_track(param, name, element, std::move(*keys), values.at(name).text, wind, tracks);
    if (name == "wind.response") take_strongest_response(tracks.back().keys, values.at(name).text, wind);
}

// Between keys the response may be above that at the keys: at its own knots.
void take_strongest_speed(const Keyframes& speeds, Wind& wind) {
    const auto [low, high] = std::ranges::minmax_element(speeds.numbers);
    for (const double knot : wind.response.positions())
        if (knot > *low && knot < *high && wind.response(knot) > wind.response(wind.speed)) wind.speed = knot;
}

// At its keys; read_jiggle() knows the first.
void check_jiggle(const Values& values, const Wind& wind) {
    if (!(wind.jiggle->frequency > 0.0))
        throw SceneFault("jiggle.setting", values.at("wind.jiggle.frequency").place,
                         "jiggle.frequency is 0 at a key: strands would come loose",
                         "keep it above 0, or fade the wind instead");
    if (wind.jiggle->damping == 0.0 && !wind.jiggle->start_frame)
        throw SceneFault("jiggle.setting", values.at("wind.jiggle.damping").place,
                         "jiggle.damping is 0 at a key: the oscillation would never decay",
                         "give jiggle.start_frame, or some damping at all keys");
}

// The measured wind, as tracks of speed and direction.
void add_record(const Values& values, Wind& wind, std::vector<KeyedWind::Track>& tracks) {
    constexpr const char *name = "wind.record", *frames = "wind.record_frames", *id = "wind.record";
    if (!values.has(name)) {
        if (values.has(frames))
            throw SceneFault(id, values.at(frames).place,
                             "wind.record_frames has no effect without wind.record",
                             "give record = \"FILE.csv\"");
        return;
    }
    const std::string place = values.at(name).place;
    for (const char* other : {"wind.speed", "wind.direction"})
        if (is_given(values, other) || (wind.speed != 0.0 && std::string_view(other) == "wind.speed"))
            throw SceneFault(id, values.at(other).place,
                             fmt::format("{} is given, and so is wind.record, at {}", other, place),
                             "keep one of them");
    if (!values.has(frames))
        throw SceneFault(id, place, "wind.record needs the frames at which it begins and ends",
                         "add record_frames = [first, last]");
    const Vec2d range = values.range(frames);
    if (!(range.x() < range.y()))
        throw SceneFault(id, values.at(frames).place, "wind.record_frames has no length",
                         "give two different frames");
    MeasuredKeys keys = keys_of(read_measured_wind(values.at(name), id, place), range.x(), range.y());
    const auto add = [&](std::string_view param, Keyframes& of) {
        const auto row = std::ranges::find(keyable_params, param, &KeyableParam::name);
        add_track(*row, std::string(row->name), 0, std::move(of), "", wind, tracks);
    };
    add("wind.direction", keys.directions);
    add("wind.speed", keys.speeds);
}

} // namespace

void read_keys(const Values& values, Wind& wind) {
    const double speed = wind.speed, evolution = wind.evolution;
    const Vec3d direction = wind.direction;
    std::vector<KeyedWind::Track> tracks;
    for (const KeyableParam& param : keyable_params) {
        std::string name(param.name);
        const size_t list = name.find("[].");
        if (list == std::string::npos) {
            add_given(values, param, name, 0, wind, tracks);
            continue;
        }
        for (size_t i = 0;; ++i) {
            const std::string element =
                fmt::format("{}[{}].{}", name.substr(0, list), i, name.substr(list + 3));
            if (!values.has(element)) break;
            add_given(values, param, element, i, wind, tracks);
        }
    }
    add_record(values, wind, tracks);
    if (tracks.empty()) return;
    const auto keys_of = [&](std::string_view name) -> std::optional<Keyframes> {
        for (const KeyedWind::Track& track : tracks)
            if (name == track.param->name) return track.keys;
        return {};
    };
    if (wind.jiggle) check_jiggle(values, wind);
    const std::optional<Keyframes> speeds = keys_of("wind.speed"), directions = keys_of("wind.direction"),
                                   evolutions = keys_of("wind.noise.evolution");
    if (wind.loops && (speeds || directions || evolutions))
        throw SceneFault("noise.keyed_loop", values.at("wind.noise.loop").place,
                         "wind.noise.loop repeats the noise, and the air that carries it has keys",
                         "remove noise.loop, or the keys of speed, direction and evolution");
    if (speeds) take_strongest_speed(*speeds, wind);
    if (wind.jiggle) {
        wind.jiggle->frequencies = keys_of("wind.jiggle.frequency");
        wind.jiggle->dampings = keys_of("wind.jiggle.damping");
    }
    wind.keys = std::make_shared<const KeyedWind>(KeyedWind{
        std::move(tracks), AirPath(speed, direction, speeds, directions),
        AirPath(1.0, direction, {}, directions), AirPath(evolution, Vec3d::UnitX(), evolutions, {})});
}

GustCarrier gust_carrier(const Wind& wind) {
    if (!wind.keys) return {wind.direction, wind.speed};
    const bool relative = !wind.gusts || wind.gusts->speed_is_relative;
    return {wind.direction, wind.speed, relative ? &wind.keys->air : &wind.keys->at_unit_speed};
}

Wind wind_at(const Wind& wind, double frame) {
    Wind now = wind;
    if (!wind.keys) return now;
    std::vector<double> numbers;
    for (const KeyedWind::Track& track : wind.keys->tracks) {
        numbers.resize(track.keys.numbers_per_key());
        track.keys.at(frame, numbers);
        track.param->set(now, {track.element, numbers, track.ramp_interpolation});
    }
    return now;
}

} // namespace marram
