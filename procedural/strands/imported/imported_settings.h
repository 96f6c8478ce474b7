// SPDX-License-Identifier: Apache-2.0
// The settings of imported strands.
#pragma once

#include "core/math/ramp.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/abi/values.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// A factor of the wind: a ramp over an attribute of the curves.
struct CurveFactor {
    std::string name, place;
    Ramp ramp;
};

// An attribute of the file that is passed on.
struct PassedAttribute {
    std::string name;
    uint32_t components;
    MarramRate rate;
    uint32_t discrete;
};

struct ImportSettings {
    std::string curves, curves_place;
    std::string mesh, mesh_place; // "": not bound
    std::optional<double> width;  // diameter, m; absent: the file's
    Ramp width_profile;
    double width_scale = 1.0;
    std::optional<MarramBasis> basis; // absent: the file's, or Catmull-Rom if it has none
    MarramShape shape = MARRAM_ROUND;
    Ramp envelope;
    std::vector<CurveFactor> wind_by;
    uint32_t seed = 0;
    std::vector<PassedAttribute> passed_attributes;
};

std::span<const MarramParam> import_params();
ImportSettings read_import(const Values& values);

// Digest of the settings that determine the binding. Strands stay bound as long as it, the curves and the
// mesh do not change.
uint64_t binding_digest(const ImportSettings& settings);

} // namespace marram
