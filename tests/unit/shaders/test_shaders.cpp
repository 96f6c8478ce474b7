// SPDX-License-Identifier: Apache-2.0
// Tests common to all shaders: colours, errors, the registry. Scattering is tested in surface_test.cpp,
// hair_test.cpp, hair_cylinder_test.cpp and hair_reciprocity_test.cpp.
#include "tests/unit/shaders/fibre_cases.h"

#include "core/math/problem.h"

#include <gtest/gtest.h>

namespace marram {
namespace {

using namespace testing;

TEST(Diffuse, RefusesToCreateLight) {
    EXPECT_THROW(material_of("diffuse", {{"color", "0.7"}, {"transmission", "0.4"}}), InputError);
    EXPECT_THROW(material_of("diffuse", {{"tip_color", "0.9"}, {"transmission", "0.2"}}), InputError);
    EXPECT_NO_THROW(material_of("diffuse", {{"color", "0.7"}, {"transmission", "0.3"}}));
}

TEST(Color, RunsFromRootToTipAndTakesTheTint) {
    const Material blade = material_of("diffuse", {{"root_color", "[1, 0, 0]"},
                                                   {"tip_color", "[0, 1, 0]"},
                                                   {"tint", "\"shield\""},
                                                   {"tint_color", "[0, 0, 1]"}});
    EXPECT_EQ(blade.tint_attribute, "shield");
    ShadingPoint point = fibre_point(0.0, 0.0F);
    point.strand_u = 0.25F;
    EXPECT_TRUE(albedo(bsdf_at(blade, point)).isApprox(Vec3f(0.75F, 0.25F, 0.0F)));
    point.tint_weight = 1.0F;
    EXPECT_TRUE(albedo(bsdf_at(blade, point)).isApprox(Vec3f(0.0F, 0.0F, 1.0F)));
}

TEST(Color, VariesFromStrandToStrandWithoutCreatingLight) {
    const Material blade =
        material_of("diffuse", {{"color", "0.7"}, {"transmission", "0.2"}, {"variation", "1"}});
    double sum = 0.0, low = 1.0;
    for (uint32_t strand = 0; strand < 1000; ++strand) {
        ShadingPoint point = fibre_point(0.0, 0.0F);
        point.strand_hash = static_cast<uint32_t>(hash(1, strand));
        const Vec3f all = albedo(bsdf_at(blade, point));
        EXPECT_LE(all.maxCoeff(), 1.0F + 1e-6F);
        EXPECT_EQ(all, albedo(bsdf_at(blade, point)));
        sum += all.x() / 1000.0;
        low = std::min(low, static_cast<double>(all.x()));
    }
    EXPECT_LT(low, 0.4);
    EXPECT_GT(sum, 0.6);
}

TEST(Registry, EveryShaderHasHelpAndCanBeMadeFromItsDefaults) {
    for (const ShaderDescription& shader : shaders()) {
        EXPECT_FALSE(shader.help.empty());
        for (const ParamSpec& spec : shader.params)
            EXPECT_FALSE(spec.help.empty()) << shader.name << "." << spec.name;
        EXPECT_EQ(material_of(shader.name).tint_attribute, "");
    }
}

} // namespace
} // namespace marram
