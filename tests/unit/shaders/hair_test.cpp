// SPDX-License-Identifier: Apache-2.0
// Tests hair as a pdf: it integrates to one, samples follow it, white fibres conserve energy, weights are
// bounded. hair_cylinder_test.cpp tests the contents of its lobes.
//
// Quadrature. A lobe is a peak in inclination with deviation d = sqrt(v), times a peak in azimuth with scale
// s. Both may cover 1/100 of the sphere or all of it. The angles are cut around the middle of each lobe at 0,
// +-1, +-2, +-4, ... widths, without cuts that are closer than half the minimum width to another. Each
// interval gets four-point Gauss quadrature: its width is at most its distance from a lobe's middle, so the
// lobe is smooth in it. If an interval contains the slope of a second lobe, the cuts of that lobe are there
// too. The middles come from the shader but only place the nodes: the sum is of the values of evaluate().
#include "tests/unit/shaders/fibre_cases.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using namespace testing;

struct Hill {
    double middle, width;
};

// Cuts of [low, high], ascending, including both ends. On a circle peaks repeat after a full turn.
std::vector<double> cuts(double low, double high, const std::vector<Hill>& hills) {
    std::vector<double> all = {high};
    double least = high - low;
    for (const Hill& hill : hills) {
        least = std::min(least, hill.width);
        all.push_back(hill.middle);
        for (double away = hill.width; away < high - low; away *= 2.0) {
            all.push_back(hill.middle - away);
            all.push_back(hill.middle + away);
        }
    }
    std::sort(all.begin(), all.end());
    std::vector<double> kept = {low};
    for (const double cut : all)
        if (cut > kept.back() + 0.5 * least && cut < high - 0.5 * least) kept.push_back(cut);
    kept.push_back(high);
    return kept;
}

struct SphereCuts {
    std::vector<double> theta, phi;
};

SphereCuts cuts_of(const HairBsdf& bsdf) {
    std::vector<Hill> along, around;
    for (int p = 0; p < 4; ++p)
        along.push_back({-std::atan2(bsdf.lobe_sin[p], bsdf.lobe_cos[p]), std::sqrt(bsdf.variance[p])});
    for (int p = 0; p < 3; ++p) {
        const double middle = std::remainder(2.0 * bsdf.gamma_o + p * (pi - 2.0 * bsdf.gamma_t), 2.0 * pi);
        for (const double turn : {-2.0 * pi, 0.0, 2.0 * pi})
            around.push_back({middle + turn, bsdf.logistic_scale});
        around.push_back({middle + (middle < 0.0 ? pi : -pi), 1.0}); // end of the logistic: a crease
    }
    return {cuts(-0.5 * pi, 0.5 * pi, along), cuts(-pi, pi, around)};
}

struct Integral {
    double pdf = 0.0;
    Vec3d value = Vec3d::Zero();
};

// Nodes and weights of four-point Gauss quadrature on [-1, 1]: Abramowitz and Stegun, table 25.4.
constexpr std::array<double, 4> gauss_node = {-0.861136311594053, -0.339981043584856, 0.339981043584856,
                                              0.861136311594053};
constexpr std::array<double, 4> gauss_weight = {0.347854845137454, 0.652145154862546, 0.652145154862546,
                                                0.347854845137454};

Integral cell_integral(const HairBsdf& bsdf, const SphereCuts& at, size_t row, size_t column) {
    const double half_theta = 0.5 * (at.theta[row + 1] - at.theta[row]);
    const double half_phi = 0.5 * (at.phi[column + 1] - at.phi[column]);
    Integral sum;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
            const double theta = at.theta[row] + half_theta * (1.0 + gauss_node[i]);
            const double phi = at.phi[column] + half_phi * (1.0 + gauss_node[j]);
            const double weight = half_theta * half_phi * gauss_weight[i] * gauss_weight[j] * std::cos(theta);
            const BsdfValue here = evaluate(bsdf, fibre_direction(theta, phi).cast<float>());
            sum.pdf += weight * here.pdf;
            sum.value += weight * here.value.cast<double>();
        }
    return sum;
}

Integral integrate(const HairBsdf& bsdf) {
    const SphereCuts at = cuts_of(bsdf);
    Integral sum;
    for (size_t row = 0; row + 1 < at.theta.size(); ++row)
        for (size_t column = 0; column + 1 < at.phi.size(); ++column) {
            const Integral cell = cell_integral(bsdf, at, row, column);
            sum.pdf += cell.pdf;
            sum.value += cell.value;
        }
    return sum;
}

std::string name_of(const HairCase& hair, double theta, double h) {
    std::ostringstream name;
    name << "roughness " << hair.roughness << ", azimuthal " << hair.azimuthal_roughness << ", tilt "
         << hair.tilt_degrees << ", ior " << hair.ior << ", theta " << theta << ", h " << h;
    return name.str();
}

const std::array<double, 5> every_roughness = {0.02, 0.07, 0.25, 0.6, 1.0}; // both ends, and values between

struct Worst {
    double error = 0.0;
    std::string where = "anywhere";

    void see(double found, const std::string& here) {
        if (!(found > error)) return;
        error = found;
        where = here;
    }
};

// All roughnesses and tilts. h, theta and ior cycle with counters of coprime lengths, so all pairs occur.
TEST(Hair, DensityIntegratesToOneAndWhiteLosesNothing) {
    const std::array<double, 5> iors = {1.0, 1.3, 1.55, 2.0, 3.0};
    const std::array<double, 7> thetas = {-90.0, -72.0, -30.0, 0.0, 15.0, 55.0, 89.0};
    const std::array<double, 6> offsets = {-1.0, -0.85, -0.3, 0.0, 0.6, 0.99};
    Worst density, white;
    size_t count = 0;
    for (const double roughness : every_roughness)
        for (const double azimuthal : every_roughness)
            for (const double tilt : {-20.0, -5.0, 0.0, 2.0, 20.0})
                for (int draw = 0; draw < 12; ++draw, ++count) {
                    const HairCase hair{roughness, azimuthal, tilt, iors[count % 5], "1"};
                    const double theta = thetas[count % 7], h = offsets[count % 6];
                    const Integral sum = integrate(hair_at(hair_of(hair), fibre_point(theta * degree, h)));
                    const std::string here = name_of(hair, theta, h);
                    density.see(std::abs(sum.pdf - 1.0), here);
                    white.see((sum.value - Vec3d::Ones()).cwiseAbs().maxCoeff(), here);
                }
    std::printf("[ furnace ] hair, %zu cases by quadrature: density off by at most %.1e (%s)\n", count,
                density.error, density.where.c_str());
    std::printf("[ furnace ] white off by at most %.1e (%s)\n", white.error, white.where.c_str());
    EXPECT_LT(density.error,
              1e-3); // measured 1.5e-4, an error of the quadrature: 1.5e-5 with cuts half as far apart
    EXPECT_LT(white.error, 1e-3);
}

// p-value of Pearson's chi-square test of samples in the cells of the quadrature against the integrals of the
// pdf. Cells with small expected counts are pooled. Wilson-Hilferty approximation: the cube root of the
// statistic is nearly normal for a hundred cells.
double chance_of(const HairBsdf& density, const HairBsdf& sampled, uint64_t seed, int count) {
    const SphereCuts at = cuts_of(density);
    const size_t rows = at.theta.size() - 1, columns = at.phi.size() - 1;
    std::vector<double> expected, seen(rows * columns, 0.0);
    for (size_t row = 0; row < rows; ++row)
        for (size_t column = 0; column < columns; ++column)
            expected.push_back(count * cell_integral(density, at, row, column).pdf);
    const auto cell_of = [](const std::vector<double>& cuts, double angle) {
        return static_cast<size_t>(std::upper_bound(cuts.begin() + 1, cuts.end() - 1, angle) - cuts.begin() -
                                   1);
    };
    Random random{seed};
    for (int k = 0; k < count; ++k) {
        BsdfSample next;
        if (!sample(sampled, random.four(), next)) continue;
        const Vec3d wi = next.wi.cast<double>();
        const double theta = std::atan2(wi.y(), std::hypot(wi.x(), wi.z()));
        seen[cell_of(at.theta, theta) * columns + cell_of(at.phi, azimuth_of(wi))] += 1.0;
    }
    constexpr double enough = 10.0; // cells with fewer would skew the statistic
    double statistic = 0.0, pooled_expected = 0.0, pooled_seen = 0.0;
    int cells = 0;
    for (size_t c = 0; c < expected.size(); ++c) {
        if (expected[c] < enough) {
            pooled_expected += expected[c];
            pooled_seen += seen[c];
            continue;
        }
        statistic += (seen[c] - expected[c]) * (seen[c] - expected[c]) / expected[c];
        ++cells;
    }
    if (pooled_expected >= enough) {
        statistic += (pooled_seen - pooled_expected) * (pooled_seen - pooled_expected) / pooled_expected;
        ++cells;
    }
    const double freedom = cells - 1.0, part = 2.0 / (9.0 * freedom);
    const double z = (std::cbrt(statistic / freedom) - (1.0 - part)) / std::sqrt(part);
    return 0.5 * std::erfc(z / std::sqrt(2.0));
}

const char* const brown = "[0.6, 0.45, 0.3]";

// A correct sampler fails for one seed in 1000: the significance is divided among all draws (Bonferroni).
TEST(Hair, SamplesFollowTheDensity) {
    struct View {
        double tilt, theta, h, ior;
    };
    const std::array<View, 4> views = {View{0.0, 17.0, 0.1, 1.55},
                                       {20.0, -52.0, -0.8, 1.3},
                                       {-20.0, 75.0, 0.95, 2.0},
                                       {2.0, 88.0, 0.5, 1.0}};
    const std::array<uint64_t, 3> seeds = {1, 20, 300};
    constexpr int count = 40000;
    const double draws =
        static_cast<double>(every_roughness.size() * every_roughness.size() * views.size() * seeds.size());
    const double significance = 1e-3 / draws;
    double least = 1.0;
    std::string where;
    for (const double roughness : every_roughness)
        for (const double azimuthal : every_roughness)
            for (const View& view : views)
                for (const uint64_t seed : seeds) {
                    const HairCase hair{roughness, azimuthal, view.tilt, view.ior, brown};
                    const HairBsdf bsdf = hair_at(hair_of(hair), fibre_point(view.theta * degree, view.h));
                    const double chance = chance_of(bsdf, bsdf, seed, count);
                    const std::string here =
                        name_of(hair, view.theta, view.h) + ", seed " + text_of(static_cast<double>(seed));
                    EXPECT_GT(chance, significance) << here;
                    if (chance < least) where = here;
                    least = std::min(least, chance);
                }
    std::printf(
        "[ density ] hair, %.0f draws of %d samples, seeds 1, 20, 300: least chance %.1e, fails below %.1e "
        "(%s)\n",
        draws, count, least, significance, where.c_str());
}

// Shows that the test above can fail: it detects lobes 5 % wider than their pdf.
TEST(Hair, SamplesOfAnotherDensityAreSeen) {
    const HairBsdf bsdf = hair_at(hair_of({0.1, 0.1, 0.0, 1.55, brown}), fibre_point(0.3, 0.1));
    HairBsdf wide = bsdf;
    wide.variance *= 1.05F * 1.05F;
    wide.precision /= 1.05F * 1.05F;
    EXPECT_LT(chance_of(bsdf, wide, 1, 40000), 1e-6);
    wide = bsdf;
    wide.logistic_scale *= 1.05F;
    EXPECT_LT(chance_of(bsdf, wide, 1, 40000), 1e-6);
}

// Statistics of value / pdf over the fibre and view directions.
struct Weights {
    double most = 0.0, mean = 0.0, off_energy = 0.0, beyond = 0.0, rounding = 0.0;
};

Weights weights_of(const HairSettings& settings, uint64_t seed) {
    constexpr int count = 4000;
    Random random{seed};
    Weights all;
    for (int k = 0; k < count; ++k) {
        const HairBsdf bsdf = hair_at(settings, fibre_point(3.1 * (random() - 0.5), 2.0 * random() - 1.0));
        BsdfSample next;
        if (!sample(bsdf, random.four(), next)) continue;
        // evaluate() returns the pdf that was sampled, except for the rounding of wi.
        all.rounding = std::max(all.rounding, std::abs(double(evaluate(bsdf, next.wi).pdf / next.pdf) - 1.0));
        Vec3f energy = Vec3f::Zero();
        for (const Vec3f& lobe : bsdf.attenuation) energy += lobe;
        const Vec3f weight = next.value / next.pdf;
        all.most = std::max(all.most, static_cast<double>(weight.maxCoeff()));
        all.mean += static_cast<double>(mean(weight)) / count;
        all.off_energy = std::max(all.off_energy, std::abs(static_cast<double>(mean(weight) - mean(energy))));
        all.beyond = std::max(all.beyond, static_cast<double>(weight.maxCoeff() / (3.0F * mean(energy))));
    }
    return all;
}

// Lobes are chosen by their mean energy E_p, so the mean weight of a sample is sum E_p in any direction, and
// that of a channel is at most three times as much. No sample can be a firefly.
TEST(Hair, WeightsAreTheEnergy) {
    for (const char* color : {"1", brown, "[0.9, 0.1, 0]", "0"}) {
        Weights worst;
        double mean_weight = 0.0;
        for (const double roughness : every_roughness)
            for (const double azimuthal : every_roughness) {
                const Weights all = weights_of(hair_of({roughness, azimuthal, 2.0, 1.55, color}), 7);
                worst.most = std::max(worst.most, all.most);
                worst.off_energy = std::max(worst.off_energy, all.off_energy);
                worst.beyond = std::max(worst.beyond, all.beyond);
                worst.rounding = std::max(worst.rounding, all.rounding);
                mean_weight +=
                    all.mean / static_cast<double>(every_roughness.size() * every_roughness.size());
            }
        std::printf(
            "[ weights ] hair, colour %s, seed 7: greatest channel %.4f, mean %.4f, mean of a sample off its "
            "energy by %.1e, density asked for again by %.1e\n",
            color, worst.most, mean_weight, worst.off_energy, worst.rounding);
        EXPECT_LT(worst.rounding, 3e-4);
        EXPECT_LT(worst.off_energy, 1e-5);
        EXPECT_LT(worst.beyond, 1.0 + 1e-5);
    }
}

// R leaves in the mirror direction: gamma_o is on the side where the ray met the fibre.
TEST(Hair, ReflectsLikeAMirrorTiltedByTheOffset) {
    const HairSettings hair = hair_of({0.05, 0.05, 0.0, 1.55, "0"});
    for (const double h : {-0.6, 0.0, 0.4}) {
        const ShadingPoint point = fibre_point(0.3, h);
        const Vec3f mirror = 2.0F * point.normal.dot(point.wo) * point.normal - point.wo;
        Random random{3};
        double nearest = 0.0;
        for (int i = 0; i < 200; ++i) {
            BsdfSample next;
            if (sample(hair_at(hair, point), random.four(), next)) nearest += next.wi.dot(mirror) / 200.0;
        }
        EXPECT_GT(nearest, 0.99) << h;
    }
}

TEST(Hair, DarkerPigmentAbsorbsMore) {
    double last = 2.0;
    for (const char* melanin : {"0", "0.3", "1.3", "8"}) {
        const HairSettings hair =
            read_hair(params_of("hair", {{"pigment", "\"melanin\""}, {"melanin", melanin}}), {});
        const double back = integrate(hair_at(hair, fibre_point(0.2, 0.3))).value.sum() / 3.0;
        EXPECT_LT(back, last);
        last = back;
    }
    EXPECT_LT(last, 0.3);
}

// End-on, at the fibre's edge, and without refraction; a black fibre without refraction returns nothing.
TEST(Hair, IsFiniteInEveryDirection) {
    for (const char* color : {brown, "0"})
        for (const double theta : {-90.0, 0.0, 90.0, 89.99, 85.0})
            for (const double h : {-1.0, 0.0, 1.0}) {
                const HairBsdf bsdf =
                    hair_at(hair_of({0.02, 0.02, 0.0, 1.0, color}), fibre_point(theta * degree, h));
                Random random{9};
                int faults = 0;
                for (int i = 0; i < 1000; ++i) {
                    const double up = pi * (random() - 0.5), around = 2.0 * pi * random();
                    const BsdfValue seen = evaluate(bsdf, fibre_direction(up, around).cast<float>());
                    if (!seen.value.allFinite() || !std::isfinite(seen.pdf)) ++faults;
                    BsdfSample next;
                    if (!sample(bsdf, random.four(), next)) continue;
                    if (!next.value.allFinite() || !std::isfinite(next.pdf) || !next.wi.allFinite()) ++faults;
                }
                EXPECT_EQ(faults, 0) << color << ", theta " << theta << ", h " << h;
            }
}

} // namespace
} // namespace marram
