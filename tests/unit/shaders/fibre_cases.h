// SPDX-License-Identifier: Apache-2.0
// Points, directions and random numbers for tests of shaders.
//
// Fibres lie along y and are viewed from the half-plane y, x > 0. A direction has an inclination theta
// towards y and an azimuth phi from x towards tangent x wo = -z, the convention of the hair shader.
#pragma once

#include "tests/unit/shaders/default_params.h"

#include "core/math/hash.h"

#include <cmath>

namespace marram::testing {

struct Random {
    uint64_t seed, at = 0;
    float operator()() { return unit_float(static_cast<uint32_t>(hash(seed, at++))); }
    std::array<float, 4> four() { return {(*this)(), (*this)(), (*this)(), (*this)()}; }
};

inline Vec3d fibre_direction(double theta, double phi) {
    return {std::cos(theta) * std::cos(phi), std::sin(theta), -std::cos(theta) * std::sin(phi)};
}

inline double azimuth_of(const Vec3d& direction) { return std::atan2(-direction.z(), direction.x()); }

// A fibre viewed at inclination theta above its normal plane, at offset h.
inline ShadingPoint fibre_point(double theta, double h) {
    ShadingPoint point;
    point.tangent = Vec3f::UnitY();
    point.wo = fibre_direction(theta, 0.0).cast<float>();
    point.normal = point.sidedness_normal = fibre_direction(0.0, std::asin(h)).cast<float>();
    point.fibre = true;
    point.h = static_cast<float>(h);
    point.strand_hash = 12345;
    return point;
}

// A number as text in a scene file.
inline std::string text_of(double number) {
    std::ostringstream text;
    text << number;
    return text.str();
}

struct HairCase {
    double roughness = 0.3, azimuthal_roughness = 0.3, tilt_degrees = 0.0, ior = 1.55;
    std::string color = "1"; // "1": no absorption
};

inline HairSettings hair_of(const HairCase& hair) {
    return read_hair(params_of("hair", {{"roughness", text_of(hair.roughness)},
                                        {"azimuthal_roughness", text_of(hair.azimuthal_roughness)},
                                        {"tilt", text_of(hair.tilt_degrees)},
                                        {"ior", text_of(hair.ior)},
                                        {"color", hair.color}}),
                     {});
}

} // namespace marram::testing
