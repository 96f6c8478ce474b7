// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/wind.h"

#include "procedural/abi/param.h"
#include "procedural/noise/wavelet_noise.h"
#include "procedural/wind/keyed_wind.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

namespace marram {
namespace {

constexpr std::array own_params = {
    param::keyable(param::vec3("direction", "", "[1, 0, 0]", -max_wind_input, max_wind_input,
                               "where the air moves to; any length but 0")),
    param::keyable(
        param::number("speed", "m/s", "0", 0, max_wind_input,
                      "moves the noise field and, through response, sets the strength of the bend")),
    param::keyable(param::number(
        "calm", "", "none", 0, 1,
        "background wind, 0 to 1; default: 0 (still air between gusts) if there are gusts, else 1")),
    param::keyable(param::ramp("response", "m/s", "[[0, 0], [10, 1]]", -max_wind_input, max_wind_input,
                               "strength of the wind, 0 to 1, over its speed; 0 at speed 0")),
    param::table(
        "record", "none", "time|speed|direction",
        "CSV of a measured wind in place of speed and direction: columns time (h), speed (m/s), direction "
        "(deg from north, -z, from which); needs record_frames"),
    param::mesh("over", "none", "",
                "a mesh, such as a terrain, that the air flows over: faster over crests, calm in the lee"),
    param::number(
        "over_height", "m", "0", 0, 1e4,
        "height above that mesh at which speed is meant, as by a weather station: slower below, by the "
        "logarithmic law; 0: it is that at the strands"),
    param::number("over_roughness", "m", "0.001", 1e-6, 100,
                  "roughness length of that mesh, for over_height"),
    param::choice("fields_at", "root", "root|cv",
                  "root: a strand feels the fields at its root; cv: each CV where it is at rest"),
    param::number("air_density", "kg/m^3", "1.225", 0, 1e4, "of the air that bends blades"),
    param::range("record_frames", "frames", "none", -1e6, 1e6, "frames of the record's first and last row"),
    param::keyable(
        param::number("global_rotate", "", "0.6", 0, 1, "scale of each segment's turn towards the wind")),
    param::keyable(param::ramp("ramp_rotate", "", "[[0, 0.2], [1, 1]]", -max_wind_input, max_wind_input,
                               "scale of the turn from root (0) to tip (1)")),
    param::keyable(param::number(
        "waviness", "", "1", -1e6, 1e6,
        "advance of the noise sample point along the wind per length of strand; larger: more ripples "
        "on a strand")),
    param::integer(
        "reference_segments", "", "4", 0, 100000,
        "number of segments for which the turn is defined, so that the pose does not depend on cvs: it "
        "converges with their square; 4: the talk's strands; 0: those of the strand, the talk to the letter "
        "(7 if cvs = 0)"),
    param::choice("noise.type", "perlin", "perlin|billow|wavelet", "kind of noise field"),
    param::keyable(param::number("noise.amplitude", "", "0.5", 0, 1e6,
                                 "strength of the noise, relative to the unit wind direction")),
    param::number("noise.frequency", "1/m", "1", 0, 1e9, "cells a metre"),
    param::integer("noise.octaves", "", "1", 1, 16, "layers of noise, each finer and weaker"),
    param::number("noise.lacunarity", "", "2", 1, 16, "frequency of an octave over that of the one before"),
    param::number("noise.gain", "", "0.5", 0, 1, "strength of an octave over that of the one before"),
    param::keyable(param::number("noise.evolution", "1/s", "0", -1e6, 1e6,
                                 "rate of change of the field in place, cells a second")),
    param::choice("noise.anchor", "world", "world|rest",
                  "world: sampled where the strand is; rest: where its root is at bind_frame, so that the "
                  "field moves with the surface"),
    param::integer("noise.seed", "", "0", 0, 2147483647, "seed of the field"),
    param::range("noise.loop", "frames", "none", -1e7, 1e7, "first and last frame of a cycle without a seam"),
};

NoiseType noise_type(std::string_view name) {
    return name == "billow" ? NoiseType::billow : name == "wavelet" ? NoiseType::wavelet : NoiseType::perlin;
}

std::optional<Over> read_over(const Values& values) {
    if (values.has("wind.over")) {
        if (is_given(values, "wind.over_roughness") && values.number("wind.over_height") == 0.0)
            throw SceneFault("wind.no_over", values.at("wind.over_roughness").place,
                             "wind.over_roughness has no effect without wind.over_height",
                             "give the height at which speed is meant, or remove this");
        return Over{std::string(values.text("wind.over")),
                    values.at("wind.over").place,
                    {values.number("wind.over_height"), values.number("wind.over_roughness")}};
    }
    for (const char* name : {"wind.over_height", "wind.over_roughness"})
        if (is_given(values, name))
            throw SceneFault("wind.no_over", values.at(name).place,
                             std::string(name) + " is given, and wind.over is not",
                             "name the mesh that the wind blows over, or remove this");
    return {};
}

} // namespace

const char* const wind_help =
    R"(With bend = "talk" each segment of a strand, from root to tip, turns towards the wind and takes all
beyond it along: by f times the angle between the direction to the tip and b, with
    b = direction + noise.amplitude * noise(root + direction * waviness * s)
    f = 1 - (1 - global_rotate * ramp_rotate(s / L) * e) ^ (reference_segments * span / L)
    e = (calm + gusts) * (1 - shield * sheltered) * response(speed) * the groom's envelope(s / L)
at arc length s of L. The segment stands for the length span. Factors are clamped to 0 ... 1.
With reference_segments = 0 f is global_rotate * ramp_rotate(s / L) * e, as in the talk.
With bend = "blade" drag and weight bend the strands instead: see marram info groom.)";

std::span<const MarramParam> wind_params() {
    static const std::vector<MarramParam> all = [] {
        std::vector<MarramParam> list(own_params.begin(), own_params.end());
        for (const auto stage :
             {gust_params(), field_params(), shielding_params(), jiggle_params(), collision_params()})
            list.insert(list.end(), stage.begin(), stage.end());
        return list;
    }();
    return all;
}

void add_constant_wind(std::vector<MarramParam>& list) {
    for (const auto& [name, full] :
         {std::pair("direction", "wind.direction"), std::pair("speed", "wind.speed")}) {
        MarramParam param = *std::ranges::find(wind_params(), std::string_view(name), &MarramParam::name);
        param.name = full;
        param.keyable = 0;
        list.push_back(param);
    }
}

bool is_given(const Values& values, const std::string& name) {
    const auto place_of = [&](const std::string& other) -> std::string_view {
        const MarramValue* value = values.find(other);
        return value && value->place ? value->place : "";
    };
    const std::string_view place = place_of(name);
    return !place.empty() && std::ranges::none_of(wind_params(), [&](const MarramParam& param) {
        const std::string other = std::string("wind.") + param.name;
        return other != name && place_of(other) == place;
    });
}

void set_blade_wind(Wind& wind) {
    wind.response = Ramp(std::array{0.0, 0.0, blade_response_speed, 1.0}, "linear");
    wind.global_rotate = 1.0;
    wind.bends_blades = true;
}

Wind read_wind(const Values& values, std::optional<double> blade_frequency) {
    Wind wind;
    const Vec3d direction = values.vec3("wind.direction");
    const double length = direction.stableNorm();
    if (!(length > 0.0))
        throw SceneFault("wind.no_direction", values.at("wind.direction").place,
                         "the wind's direction is zero", "give a vector, such as [1, 0, 0]");
    wind.direction = direction / length;
    wind.speed = values.number("wind.speed");
    wind.gusts = read_gusts(values);
    wind.calm = values.has("wind.calm") ? values.number("wind.calm") : wind.gusts ? 0.0 : 1.0;
    wind.response = values.ramp("wind.response");
    if (wind.response(0.0) != 0.0)
        throw SceneFault("wind.response_at_rest", values.at("wind.response").place,
                         "wind.response is not 0 at speed 0", "start the ramp with the knot [0, 0]");
    for (const double value : wind.response.values())
        if (value < 0.0 || value > 1.0)
            throw SceneFault("wind.response_range", values.at("wind.response").place,
                             "wind.response has values outside 0 ... 1", "keep its values inside");
    wind.global_rotate = values.number("wind.global_rotate");
    wind.ramp_rotate = values.ramp("wind.ramp_rotate");
    for (const double share : wind.ramp_rotate.values())
        if (share < 0.0)
            throw SceneFault("wind.ramp_rotate_range", values.at("wind.ramp_rotate").place,
                             "wind.ramp_rotate goes below 0",
                             "use values of at least 0: strands cannot turn away from the wind");
    wind.waviness = values.number("wind.waviness");
    wind.reference_segments = values.integer("wind.reference_segments");
    wind.noise.type = noise_type(values.text("wind.noise.type"));
    if (wind.noise.type == NoiseType::wavelet)
        wavelet_tile(); // build it here, not inside the time of the first patch
    wind.noise_amplitude = values.number("wind.noise.amplitude");
    wind.noise.frequency = values.number("wind.noise.frequency");
    wind.noise.octaves = values.integer("wind.noise.octaves");
    wind.noise.lacunarity = values.number("wind.noise.lacunarity");
    wind.noise.gain = values.number("wind.noise.gain");
    wind.noise.seed = static_cast<uint32_t>(values.integer("wind.noise.seed"));
    wind.evolution = values.number("wind.noise.evolution");
    wind.noise_at_bind_frame = values.text("wind.noise.anchor") == "rest";
    if (values.has("wind.noise.loop")) {
        wind.loops = true;
        wind.loop_begin = values.range("wind.noise.loop").x();
        wind.loop_end = values.range("wind.noise.loop").y();
        if (!(wind.loop_begin < wind.loop_end))
            throw SceneFault("noise.empty_loop", values.at("wind.noise.loop").place,
                             "noise.loop has no length", "give two different frames");
    }
    wind.fields = read_fields(values);
    wind.fields_at_cvs = values.text("wind.fields_at") == "cv";
    if (wind.fields.empty() && is_given(values, "wind.fields_at"))
        throw SceneFault("wind.no_fields", values.at("wind.fields_at").place,
                         "wind.fields_at is given, and the wind has no fields",
                         "add a [[wind.field]], or remove this");
    wind.over = read_over(values);
    wind.air_density = values.number("wind.air_density");
    wind.shielding = read_shielding(values);
    wind.jiggle = read_jiggle(values, blade_frequency);
    wind.collision = read_collision(values);
    if (blade_frequency) set_blade_wind(wind);
    read_keys(values, wind);
    return wind;
}

double wind_response(const Wind& wind) { return std::clamp(wind.response(wind.speed), 0.0, 1.0); }

double max_response(const Wind& wind) {
    if (wind.fields.empty() && !wind.over) return wind_response(wind);
    constexpr double over_crests = 2.0; // roughly: linear theory at slopes of 30 degrees
    double fastest = wind.over ? over_crests * wind.speed : wind.speed;
    for (const PlacedField& field : wind.fields) fastest += max_added_speed(field, wind.speed);
    double most = std::max(wind.response(wind.speed), wind.response(fastest));
    for (const double knot : wind.response.positions())
        if (knot > 0.0 && knot < fastest) most = std::max(most, wind.response(knot));
    return std::clamp(most, 0.0, 1.0);
}

double max_turn_fraction(const Wind& wind) {
    double most = 0.0;
    for (const double share : wind.ramp_rotate.values()) most = std::max(most, share);
    return std::min(1.0, wind.global_rotate * most);
}

int negligible_octaves(const Wind& wind, double length, double tolerance) {
    const FractalNoise& noise = wind.noise;
    double squares = 0.0, weight = 1.0;
    for (int i = 0; i < noise.octaves; ++i, weight *= noise.gain) squares += weight * weight;
    double resonance = 1.0; // peak gain of a driven oscillator: 1 / (2 zeta sqrt(1 - zeta^2))
    double damping = wind.jiggle ? wind.jiggle->damping : 1.0;
    if (wind.jiggle && wind.jiggle->dampings) damping = std::ranges::min(wind.jiggle->dampings->numbers);
    if (damping < std::sqrt(0.5)) resonance = 1.0 / (2.0 * damping * std::sqrt(1.0 - damping * damping));
    const double strength = 0.9 * wind.noise_amplitude * length * resonance / std::sqrt(squares);
    double left_out = 0.0;
    int count = 0;
    while (count + 1 < noise.octaves) {
        weight /= noise.gain; // of the finest octave not left out yet
        left_out += strength * weight;
        if (!(left_out <= tolerance)) break;
        ++count;
    }
    return count;
}

bool wind_bends(const Wind& wind) {
    return max_response(wind) > 0.0 && wind.global_rotate > 0.0 && (wind.calm > 0.0 || wind.gusts);
}

bool wind_moves(const Wind& wind) {
    const bool raises = wind.keys && wind.collision && wind.collision->offset_scale; // may have keys
    if (wind.keys || std::ranges::any_of(wind.fields, field_moves)) return wind_bends(wind) || raises;
    const bool travels = wind.speed > 0.0 && wind.noise.frequency > 0.0;
    const bool ripples = wind.noise_amplitude > 0.0 && (travels || wind.evolution != 0.0);
    return wind_bends(wind) && (ripples || (wind.gusts && gusts_move(*wind.gusts)));
}

} // namespace marram
