// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/blade/blade.h"

#include "procedural/abi/param.h"
#include "procedural/abi/ramp_table.h"
#include "procedural/wind/blade/elastica.h"
#include "procedural/wind/noise_along.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace marram {
namespace {

constexpr double gravity = 9.81; // m/s^2
constexpr double least_taper = 1e-3;

constexpr std::array params = {
    param::choice(
        "bend", "talk", "talk|blade",
        "talk: turned towards the wind by its dials; blade: bent as an elastic blade by drag and weight"),
    param::choice(
        "blade.species", "none", "hair",
        "numbers of a measured material where none are given: hair: modulus 3.9e9, density 1310, thickness "
        "7e-5, drag 2"),
    param::number("blade.stiffness", "N m^2", "none", 1e-15, 1e9, "flexural rigidity EI at the root"),
    param::number("blade.modulus", "Pa", "none", 1, 1e13, "Young's modulus, in place of stiffness"),
    param::number("blade.thickness", "m", "none", 1e-9, 10, "of a ribbon, with modulus or density"),
    param::number("blade.frequency", "Hz", "none", 1e-3, 1e5,
                  "first natural frequency of a strand of mean length, in place of stiffness"),
    param::number("blade.mass", "kg/m", "none", 1e-12, 1e6, "mass per length at the root"),
    param::number("blade.density", "kg/m^3", "none", 1e-3, 1e5, "of the material, in place of mass"),
    param::number("blade.drag", "", "none", 0, 10,
                  "drag coefficient across the wind; default: 1.2 of a ribbon, 1.0 of a round strand"),
    param::ramp(
        "blade.taper", "", "none", 0, 1e3,
        "scale of the rigidity from root to tip; default: width_profile, of a round strand its 4th power"),
    param::boolean(
        "blade.sags", "false",
        "true: the groomed shape is that without weight; false: it already hangs as it was groomed"),
};

double power(double x, int n) { return n == 0 ? 1.0 : x * power(x, n - 1); }

// A ramp's power, as a table over u.
Ramp ramp_to_power(const Ramp& ramp, int n, double least) {
    constexpr int intervals = 64;
    const double root = ramp(0.0);
    std::vector<double> knots;
    for (int k = 0; k <= intervals; ++k) {
        const double u = double(k) / intervals;
        knots.insert(knots.end(), {u, std::max(power(ramp(u) / root, n), least)});
    }
    return Ramp(knots, "linear");
}

[[noreturn]] void refuse_blade(const Values& values, const char* name, const std::string& what,
                               const std::string& remedy) {
    throw SceneFault("groom.blade", values.at(name).place, what, remedy);
}

// Of a strand at its root.
double root_width(const BladeShape& shape) { return shape.width * shape.width_profile(0.0); }

double second_moment(const BladeShape& shape, double thickness) {
    return shape.flat ? root_width(shape) * power(thickness, 3) / 12.0
                      : pi * power(root_width(shape), 4) / 64.0;
}
double section(const BladeShape& shape, double thickness) {
    return shape.flat ? root_width(shape) * thickness : 0.25 * pi * power(root_width(shape), 2);
}

// Measured materials. A row is a choice of blade.species, its sources are in scenes/README.md.
struct Species {
    std::string_view name;
    double modulus, density, thickness, drag; // Pa, kg/m^3, m, coefficient
};
constexpr std::array all_species = {Species{"hair", 3.9e9, 1310.0, 70e-6, 2.0}};

// The numbers of a scene; those that it leaves out are the species', if it names one.
struct BladeNumbers {
    std::optional<double> stiffness, modulus, frequency, mass, density, thickness, drag;
};

BladeNumbers read_numbers(const Values& values) {
    BladeNumbers numbers;
    for (const auto& [name, member] :
         {std::pair("blade.stiffness", &BladeNumbers::stiffness),
          std::pair("blade.modulus", &BladeNumbers::modulus),
          std::pair("blade.frequency", &BladeNumbers::frequency),
          std::pair("blade.mass", &BladeNumbers::mass), std::pair("blade.density", &BladeNumbers::density),
          std::pair("blade.thickness", &BladeNumbers::thickness),
          std::pair("blade.drag", &BladeNumbers::drag)})
        if (values.has(name)) numbers.*member = values.number(name);
    if (!values.has("blade.species")) return numbers;
    const Species& species =
        *std::ranges::find(all_species, values.text("blade.species"), &Species::name); // checked: a choice
    if (!numbers.stiffness && !numbers.frequency && !numbers.modulus) numbers.modulus = species.modulus;
    if (!numbers.mass && !numbers.density) numbers.density = species.density;
    if (!numbers.thickness) numbers.thickness = species.thickness;
    if (!numbers.drag) numbers.drag = species.drag;
    return numbers;
}

double thickness_for(const Values& values, const BladeNumbers& numbers, const BladeShape& shape,
                     const char* name) {
    if (!shape.flat) return 0.0;
    if (!numbers.thickness)
        refuse_blade(values, name, fmt::format("{} of a ribbon needs its thickness", name),
                     "add blade.thickness, in metres");
    return *numbers.thickness;
}

void check_blade(const Values& values, const BladeShape& shape, const BladeNumbers& numbers) {
    if (!(shape.width > 0.0) || !(shape.mean_length > 0.0))
        refuse_blade(values, "bend",
                     "a blade needs a width and a length above 0 of its own, and strands with guides have no "
                     "such length",
                     "give length and width, and no guides");
    if (!(shape.width_profile(0.0) > 0.0))
        refuse_blade(values, "bend", "width_profile is 0 at the root: such a blade is a hinge",
                     "raise its first value");
    const int given = int(numbers.stiffness.has_value()) + int(numbers.modulus.has_value()) +
                      int(numbers.frequency.has_value());
    if (given != 1)
        refuse_blade(
            values, "bend", "a blade's rigidity is given by one of stiffness, modulus and frequency",
            fmt::format(
                "{} are given: give one of blade.stiffness, blade.modulus, blade.frequency, or blade.species",
                given));
    if (numbers.mass.has_value() == numbers.density.has_value())
        refuse_blade(values, "bend", "a blade's mass is given by one of mass and density",
                     "give either blade.mass, in kg/m, or blade.density, in kg/m^3");
    if (values.has("blade.taper") && !(values.ramp("blade.taper")(0.0) > 0.0))
        refuse_blade(values, "blade.taper", "blade.taper is 0 at the root: such a blade is a hinge",
                     "raise its first value");
    const bool needs_thickness = shape.flat && (numbers.modulus || numbers.density);
    if (values.has("blade.thickness") && !needs_thickness)
        refuse_blade(values, "blade.thickness",
                     "blade.thickness has no effect without modulus or density of a ribbon",
                     "remove it, or give those in place of stiffness and mass");
}

} // namespace

std::span<const MarramParam> blade_params() { return params; }

std::optional<Blade> read_blade(const Values& values, const BladeShape& shape) {
    const bool bends = values.text("bend") == "blade";
    for (const MarramParam& param : params) {
        const std::string_view name = param.name;
        const bool given =
            name == "blade.sags" ? values.boolean(param.name) : name != "bend" && values.has(param.name);
        if (!bends && given)
            refuse_blade(values, param.name, fmt::format("{} is given, and bend is not \"blade\"", name),
                         "add bend = \"blade\", or remove this");
    }
    if (!bends) return {};
    const BladeNumbers numbers = read_numbers(values);
    check_blade(values, shape, numbers);
    Blade blade;
    blade.flat = shape.flat;
    blade.width = shape.width;
    blade.mean_length = shape.mean_length;
    blade.width_profile = shape.width_profile;
    blade.place = values.at("bend").place;
    blade.mass = numbers.mass ? *numbers.mass
                              : *numbers.density *
                                    section(shape, thickness_for(values, numbers, shape, "blade.density"));
    blade.drag = numbers.drag.value_or(shape.flat ? 1.2 : 1.0);
    blade.air_density = values.number("wind.air_density");
    blade.taper = values.has("blade.taper")
                      ? ramp_to_power(values.ramp("blade.taper"), 1, least_taper)
                      : ramp_to_power(shape.width_profile, shape.flat ? 1 : 4, least_taper);
    blade.mass_taper = ramp_to_power(shape.width_profile, shape.flat ? 1 : 2, 0.0);
    blade.sags = values.boolean("blade.sags");
    blade.rigidity = 1.0;
    if (numbers.frequency)
        blade.rigidity = power(*numbers.frequency / natural_frequency(blade, blade.mean_length), 2);
    else
        blade.rigidity = numbers.stiffness
                             ? *numbers.stiffness
                             : *numbers.modulus * second_moment(shape, thickness_for(values, numbers, shape,
                                                                                     "blade.modulus"));
    return blade;
}

// Power iteration with the flexibility of the cantilever: the deflection under the inertia of the last
// deflection.
double natural_frequency(const Blade& blade, double length) {
    constexpr int nodes = 256;
    constexpr int iterations = 12;
    const double h = length / nodes;
    std::array<double, nodes + 1> shape{}, moment{}, mass{};
    for (int k = 0; k <= nodes; ++k) {
        const double u = double(k) / nodes;
        shape[size_t(k)] = u * u;
        mass[size_t(k)] = blade.mass * std::max(blade.mass_taper(u), 0.0);
    }
    double squared = 0.0;
    for (int i = 0; i < iterations; ++i) {
        double shear = 0.0;
        moment[nodes] = 0.0;
        for (size_t k = nodes; k-- > 0;) {
            const double load = 0.5 * (mass[k] * shape[k] + mass[k + 1] * shape[k + 1]);
            moment[k] = moment[k + 1] + h * (shear + 0.5 * h * load);
            shear += h * load;
        }
        double slope = 0.0, y = 0.0, before = 0.0, over = 0.0, under = 0.0;
        std::array<double, nodes + 1> next{};
        for (size_t k = 0; k <= nodes; ++k) {
            const double curvature = moment[k] / (blade.rigidity * blade.taper(double(k) / nodes));
            if (k > 0) {
                const double turned = slope + 0.5 * h * (before + curvature);
                y += 0.5 * h * (slope + turned);
                slope = turned;
            }
            before = curvature;
            next[k] = y;
            over += mass[k] * shape[k] * y; // Rayleigh's quotient of the two deflections
            under += mass[k] * y * y;
        }
        squared = under > 0.0 ? over / under : 0.0;
        for (size_t k = 0; k <= nodes; ++k) shape[k] = next[k] / y;
    }
    return std::sqrt(squared) / (2.0 * pi);
}

double weight_number(const Blade& blade) {
    return blade.mass * gravity * power(blade.mean_length, 3) / blade.rigidity;
}

namespace {

// What the elastica needs of one block, along its strands.
struct BladeLoads {
    WideVector<VFloat> rigidity, drag, weight; // [cvs], [cvs - 1], [cvs - 1]
    WideVector<Wide3f> wind;                   // [cvs - 1]
    WideVector<VDouble> arc, middle;           // [cvs], [cvs - 1]: arc length at CVs, at middles of segments
};

MARRAM_HOT void blade_loads(const Blade& blade, const VFloat* envelope, const Wide3f* noise, double amplitude,
                            const Wide3d* direction, bool at_cvs, const VDouble& width, int cvs,
                            BladeLoads& loads) {
    const VDouble length = loads.arc[size_t(cvs) - 1];
    const VDouble per_length = select(length > 0.0, 1.0 / select(length > 0.0, length, 1.0), 0.0);
    const VDouble relative = width * (1.0 / blade.width);
    const VDouble square = relative * relative;
    const VDouble rigidity = (blade.flat ? relative : square * square) * blade.rigidity;
    const VDouble mass = (blade.flat ? relative : square) * (blade.mass * gravity);
    const VDouble half_drag = width * (0.5 * blade.air_density * blade.drag);
    for (int k = 0; k < cvs; ++k)
        loads.rigidity[size_t(k)] =
            to_float(rigidity * evaluate(blade.taper, loads.arc[size_t(k)] * per_length));
    for (int k = 0; k + 1 < cvs; ++k) {
        const VDouble middle = loads.middle[size_t(k)] * per_length;
        loads.drag[size_t(k)] = to_float(half_drag * evaluate(blade.width_profile, middle));
        loads.weight[size_t(k)] = to_float(mass * evaluate(blade.mass_taper, middle));
        const VDouble speed =
            (to_double(envelope[k]) + to_double(envelope[k + 1])) * (0.5 * blade_response_speed);
        Wide3d w = direction[0] * speed;
        if (at_cvs)
            w = (direction[k] * to_double(envelope[k]) + direction[k + 1] * to_double(envelope[k + 1])) *
                splat(0.5 * blade_response_speed);
        if (noise) w = w + to_double(noise[k]) * splat(amplitude) * speed;
        loads.wind[size_t(k)] = to_float(w);
    }
}

MARRAM_HOT void blade_arc(const Wide3f* rest, int cvs, VDouble* arc, VDouble* middle) {
    arc[0] = VDouble{};
    for (int k = 0; k + 1 < cvs; ++k) {
        const Wide3d d = to_double(rest[k + 1]) - to_double(rest[k]);
        const VDouble length = vsqrt(dot(d, d));
        middle[k] = arc[k] + length * 0.5;
        arc[k + 1] = arc[k] + length;
    }
}

} // namespace

// The strongest wind: gusts do not raise it above its speed (envelopes end at 1).
void resolve_blades(const Wind& wind, int cvs, double longest, double tolerance, Blade& blade) {
    constexpr double default_share = 1e-3; // of the length
    const double speed = max_response(wind) * blade_response_speed * (1.0 + wind.noise_amplitude);
    const double widest = blade.width * std::ranges::max(blade.width_profile.values());
    const double drag = 0.5 * blade.air_density * blade.drag * widest * speed * speed;
    const double bend = power(longest, 3) / blade.rigidity;
    // A power of two, so that neighbouring frames have the same, and with it the past that jiggle keeps.
    const double asked = tolerance > 0.0 ? tolerance : default_share * longest;
    blade.tolerance = asked > 0.0 ? std::exp2(std::floor(std::log2(asked))) : default_share;
    blade.pieces = elastica_pieces(cvs, drag * bend, blade.mass * gravity * bend,
                                   longest > 0.0 ? blade.tolerance / longest : default_share);
}

uint64_t bend_blades(const Wind& wind, const Blade& blade, double frame, double fps, Strands& strands) {
    const int cvs = strands.cvs;
    static thread_local BladeLoads loads;
    static thread_local ElasticaScratch scratch;
    loads.rigidity.resize(size_t(cvs));
    loads.drag.resize(size_t(cvs));
    loads.weight.resize(size_t(cvs));
    loads.wind.resize(size_t(cvs));
    loads.arc.resize(size_t(cvs));
    loads.middle.resize(size_t(cvs));
    const bool noisy = wind.noise_amplitude > 0.0;
    const NoiseTimes times = noise_times(wind, frame, fps);
    const Wide3d mean = splat3(wind.direction.data());
    uint64_t unsolved = 0;
    for (int i = 0; i < strands.blocks; ++i) {
        const size_t first = size_t(i) * size_t(cvs);
        blade_arc(strands.rest.data() + first, cvs, loads.arc.data(), loads.middle.data());
        if (noisy)
            noise_along(wind, times, strands.noise_origin[size_t(i)], loads.middle.data(), cvs - 1, strands);
        blade_loads(blade, strands.envelope.data() + first, noisy ? strands.values.data() : nullptr,
                    wind.noise_amplitude,
                    strands.wind_direction.empty() ? &mean : &strands.wind_direction[strands.wind_at(i, 0)],
                    strands.wind_at_cvs, strands.width[size_t(i)], cvs, loads);
        ElasticaBlock block;
        block.cvs = cvs;
        block.rest = strands.rest.data() + first;
        block.rest_normal = strands.oriented ? strands.rest_normal.data() + first : nullptr;
        block.pose = strands.pose.data() + first;
        block.pose_normal = strands.oriented ? strands.pose_normal.data() + first : nullptr;
        block.rigidity = loads.rigidity.data();
        block.drag = loads.drag.data();
        block.weight = loads.weight.data();
        block.wind = loads.wind.data();
        block.pieces = blade.pieces;
        block.tolerance = blade.tolerance;
        block.hangs = !blade.sags;
        const unsigned lanes_left = elastica(block, scratch);
        const int used = std::min(strands.count - i * lanes, lanes);
        unsolved += uint64_t(std::popcount(lanes_left & ((1U << used) - 1U)));
    }
    return unsolved;
}

} // namespace marram
