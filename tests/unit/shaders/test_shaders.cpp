// SPDX-License-Identifier: Apache-2.0
// Shaders as functions: densities integrate to one, samples follow them, nothing is created. Hair has tests
// of its own: hair_test.cpp, hair_cylinder_test.cpp, hair_reciprocity_test.cpp.
#include "tests/unit/shaders/fibre_cases.h"

#include "core/math/problem.h"

#include <gtest/gtest.h>

namespace marram {
namespace {

using namespace testing;

Vec3f unit_vector(double z, double phi) {
    const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
    return Vec3d(r * std::cos(phi), z, r * std::sin(phi)).cast<float>();
}

// Integrals over the sphere of density and value: even steps in both angles.
struct Integral {
    double pdf = 0.0;
    Vec3d value = Vec3d::Zero();
};

Integral integrate(const Bsdf& bsdf, int rows, int columns) {
    Integral sum;
    for (int i = 0; i < rows; ++i)
        for (int j = 0; j < columns; ++j) {
            const double top = std::cos(pi * i / rows), bottom = std::cos(pi * (i + 1) / rows);
            const double cell = (top - bottom) * 2.0 * pi / columns;
            const BsdfValue at =
                evaluate(bsdf, unit_vector(0.5 * (top + bottom), 2.0 * pi * (j + 0.5) / columns));
            sum.pdf += cell * at.pdf;
            sum.value += cell * at.value.cast<double>();
        }
    return sum;
}

// Pearson's statistic of samples in cells of the sphere against the density's integral over them, in standard
// deviations.
double chi_square_excess(const Bsdf& bsdf) {
    constexpr int rows = 16, columns = 16, fine = 24, count = 100000;
    std::vector<double> expected(rows * columns, 0.0), seen(rows * columns, 0.0);
    for (int i = 0; i < rows * fine; ++i)
        for (int j = 0; j < columns * fine; ++j)
            expected[static_cast<size_t>(i / fine * columns + j / fine)] +=
                count * 4.0 * pi / (rows * fine * columns * fine) *
                evaluate(bsdf, unit_vector(-1.0 + 2.0 * (i + 0.5) / (rows * fine),
                                           2.0 * pi * (j + 0.5) / (columns * fine)))
                    .pdf;
    Random random{5};
    for (int k = 0; k < count; ++k) {
        BsdfSample next;
        if (!sample(bsdf, random.four(), next)) continue;
        const BsdfValue again = evaluate(bsdf, next.wi);
        EXPECT_EQ(again.pdf, next.pdf);
        double phi = std::atan2(next.wi.z(), next.wi.x());
        if (phi < 0.0) phi += 2.0 * pi;
        const int i = std::clamp(static_cast<int>(0.5 * (next.wi.y() + 1.0) * rows), 0, rows - 1);
        const int j = std::clamp(static_cast<int>(phi / (2.0 * pi) * columns), 0, columns - 1);
        seen[static_cast<size_t>(i * columns + j)] += 1.0;
    }
    double statistic = 0.0, pooled_seen = 0.0, pooled_expected = 0.0;
    int cells = 0;
    for (size_t c = 0; c < expected.size(); ++c) {
        if (expected[c] < 10.0) { // too few for the statistic: taken together
            pooled_seen += seen[c];
            pooled_expected += expected[c];
            continue;
        }
        statistic += (seen[c] - expected[c]) * (seen[c] - expected[c]) / expected[c];
        ++cells;
    }
    if (pooled_expected >= 10.0) {
        statistic += (pooled_seen - pooled_expected) * (pooled_seen - pooled_expected) / pooled_expected;
        ++cells;
    }
    return (statistic - cells) / std::sqrt(2.0 * cells);
}

TEST(Diffuse, SamplesFollowTheDensity) {
    const Material leaf =
        material_of("diffuse", {{"color", "[0.3, 0.5, 0.1]"}, {"transmission", "[0.2, 0.3, 0.1]"}});
    ShadingPoint point;
    point.normal = point.geometric_normal = unit_vector(0.3, 1.0);
    point.wo = unit_vector(0.5, 0.2);
    EXPECT_LT(chi_square_excess(bsdf_at(leaf, point)), 5.0);
    const Integral sum = integrate(bsdf_at(leaf, point), 400, 400);
    EXPECT_NEAR(sum.pdf, 1.0, 1e-3);
    EXPECT_LT((sum.value - Vec3d(0.5, 0.8, 0.2)).norm(), 1e-3);
}

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
    EXPECT_EQ(blade.tint, "shield");
    ShadingPoint point = fibre_point(0.0, 0.0F);
    point.strand_u = 0.25F;
    EXPECT_TRUE(albedo(bsdf_at(blade, point)).isApprox(Vec3f(0.75F, 0.25F, 0.0F)));
    point.tint = 1.0F;
    EXPECT_TRUE(albedo(bsdf_at(blade, point)).isApprox(Vec3f(0.0F, 0.0F, 1.0F)));
}

TEST(Color, VariesFromStrandToStrandWithoutCreatingLight) {
    const Material blade =
        material_of("diffuse", {{"color", "0.7"}, {"transmission", "0.2"}, {"variation", "1"}});
    double sum = 0.0, low = 1.0;
    for (uint32_t strand = 0; strand < 1000; ++strand) {
        ShadingPoint point = fibre_point(0.0, 0.0F);
        point.strand = static_cast<uint32_t>(hash(1, strand));
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
        EXPECT_EQ(material_of(shader.name).tint, "");
    }
}

} // namespace
} // namespace marram
