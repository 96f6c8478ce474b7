// SPDX-License-Identifier: Apache-2.0
// Shaders as functions: densities integrate to one, samples follow them, white loses nothing, nothing is
// created.
#include "tests/unit/shaders/default_params.h"

#include "core/math/hash.h"
#include "core/math/problem.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using testing::material_of;

struct Random {
    uint64_t seed, at = 0;
    float operator()() { return unit_float(static_cast<uint32_t>(hash(seed, at++))); }
    std::array<float, 4> four() { return {(*this)(), (*this)(), (*this)(), (*this)()}; }
};

Vec3f unit_vector(double z, double phi) {
    const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
    return Vec3d(r * std::cos(phi), z, r * std::sin(phi)).cast<float>();
}

// A fibre along y, seen at elevation theta above its normal plane, h off its middle.
ShadingPoint fibre_point(double theta, float h) {
    ShadingPoint point;
    point.tangent = Vec3f::UnitY();
    point.wo = unit_vector(std::sin(theta), 0.0);
    const Vec3f side = point.tangent.cross(unit_vector(0.0, 0.0));
    point.normal = point.geometric_normal =
        (std::sqrt(1.0F - h * h) * unit_vector(0.0, 0.0) + h * side).normalized();
    point.fibre = true;
    point.h = h;
    point.strand = 12345;
    return point;
}

// Integrals over the sphere of density and value: even steps in both angles, dense where lobes around the
// axis are narrow.
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

TEST(Hair, DensityIntegratesToOneAndWhiteLosesNothing) {
    double worst_density = 0.0, worst_white = 0.0;
    for (const char* roughness : {"0.1", "0.3", "0.6", "1"})
        for (const char* azimuthal : {"0.1", "0.3", "0.6", "1"})
            for (const double theta : {-1.2, 0.0, 0.4, 1.5})
                for (const float h : {-0.95F, 0.0F, 0.5F}) {
                    const Material hair = material_of(
                        "hair",
                        {{"color", "1"}, {"roughness", roughness}, {"azimuthal_roughness", azimuthal}});
                    const Integral sum = integrate(bsdf_at(hair, fibre_point(theta, h)), 360, 180);
                    worst_density = std::max(worst_density, std::abs(sum.pdf - 1.0));
                    worst_white = std::max(worst_white, (sum.value - Vec3d::Ones()).cwiseAbs().maxCoeff());
                }
    std::printf("[ furnace ] hair by quadrature: density off by %.1e, white by %.1e\n", worst_density,
                worst_white);
    EXPECT_LT(worst_density, 1e-3);
    EXPECT_LT(worst_white, 1e-3);
}

// At every roughness, the sharpest included: a white fibre's samples return what came.
TEST(Hair, WhiteFurnaceBySampling) {
    double worst = 0.0;
    for (const char* roughness : {"0.02", "0.05", "0.2", "0.5", "1"})
        for (const char* azimuthal : {"0.02", "0.05", "0.2", "0.5", "1"}) {
            const Material hair = material_of(
                "hair", {{"color", "1"}, {"roughness", roughness}, {"azimuthal_roughness", azimuthal}});
            Random random{11};
            double sum = 0.0;
            constexpr int count = 3000;
            for (int i = 0; i < count; ++i) {
                const Bsdf bsdf = bsdf_at(hair, fibre_point(3.0 * (random() - 0.5), 2.0F * random() - 1.0F));
                BsdfSample next;
                if (sample(bsdf, random.four(), next)) sum += next.value.x() / next.pdf;
            }
            worst = std::max(worst, std::abs(sum / count - 1.0));
        }
    std::printf("[ furnace ] hair by sampling, roughness 0.02 ... 1: off by %.1e\n", worst);
    EXPECT_LT(worst, 1e-2);
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

TEST(Hair, SamplesFollowTheDensity) {
    for (const char* roughness : {"0.2", "0.5", "1"})
        for (const double theta : {-0.9, 0.3, 1.3})
            for (const float h : {-0.8F, 0.1F}) {
                const Material hair =
                    material_of("hair", {{"roughness", roughness}, {"azimuthal_roughness", "0.4"}});
                EXPECT_LT(chi_square_excess(bsdf_at(hair, fibre_point(theta, h))), 5.0)
                    << roughness << " " << theta << " " << h;
            }
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

// R leaves where a mirror would send it: gamma_o turned towards the side on which the ray met the fibre.
TEST(Hair, ReflectsLikeAMirrorTiltedByTheOffset) {
    const Material hair = material_of(
        "hair", {{"color", "0"}, {"roughness", "0.05"}, {"azimuthal_roughness", "0.05"}, {"tilt", "0"}});
    for (const float h : {-0.6F, 0.0F, 0.4F}) {
        const ShadingPoint point = fibre_point(0.3, h);
        const Vec3f mirror = 2.0F * point.normal.dot(point.wo) * point.normal - point.wo;
        Random random{3};
        double nearest = 0.0;
        for (int i = 0; i < 200; ++i) {
            BsdfSample next;
            if (sample(bsdf_at(hair, point), random.four(), next)) nearest += next.wi.dot(mirror) / 200.0;
        }
        EXPECT_GT(nearest, 0.99) << h;
    }
}

TEST(Hair, DarkerPigmentAbsorbsMore) {
    double last = 2.0;
    for (const char* melanin : {"0", "0.3", "1.3", "8"}) {
        const Material hair = material_of("hair", {{"pigment", "\"melanin\""}, {"melanin", melanin}});
        const double back = integrate(bsdf_at(hair, fibre_point(0.2, 0.3F)), 300, 200).value.sum() / 3.0;
        EXPECT_LT(back, last);
        last = back;
    }
    EXPECT_LT(last, 0.3);
}

TEST(Hair, IsFiniteInEveryDirection) {
    const Material hair =
        material_of("hair", {{"roughness", "0.02"}, {"azimuthal_roughness", "0.02"}, {"ior", "1"}});
    for (const double theta : {-0.5 * pi, 0.0, 0.5 * pi, 1.5707})
        for (const float h : {-1.0F, 0.0F, 1.0F}) {
            const Bsdf bsdf = bsdf_at(hair, fibre_point(theta, h));
            Random random{9};
            for (int i = 0; i < 1000; ++i) {
                BsdfSample next;
                if (!sample(bsdf, random.four(), next)) continue;
                EXPECT_TRUE(next.value.allFinite() && std::isfinite(next.pdf) && next.wi.allFinite());
            }
        }
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
