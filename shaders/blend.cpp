// SPDX-License-Identifier: Apache-2.0
#include "shaders/blend.h"

namespace marram {

std::vector<ParamSpec> blend_params() {
    return {
        {"first", ParamType::reference, "", "", 0.0, 0.0, "material", "material where the ramp is 0"},
        {"second", ParamType::reference, "", "", 0.0, 0.0, "material",
         "material where the ramp is 1; either may be a blend itself"},
        {"attribute", ParamType::text, "", "", 0.0, 0.0, "",
         "attribute of the mesh or groom, with one component"},
        {"ramp", ParamType::ramp, "", "[[0, 0], [1, 1]]", 0.0, 1.0, "",
         "share of the second material over the attribute"},
    };
}

BlendSettings read_blend(const ParamSet& params) {
    BlendSettings settings;
    settings.names[0] = params.text("first");
    settings.names[1] = params.text("second");
    settings.attribute = params.text("attribute");
    const ParamValue& ramp = params.at("ramp");
    settings.ramp = Ramp(ramp.numbers, ramp.text);
    return settings;
}

} // namespace marram
