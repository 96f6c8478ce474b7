// SPDX-License-Identifier: Apache-2.0
// Measures how far the hair shader is from reciprocity.
//
// Definition. A piece of fibre of length l and radius 1 in a beam of irradiance E from wi scatters the
// intensity sigma(wo, wi) E to wo. Seen from wo the fibre has an area of 2 l cos theta_o. Its points, uniform
// in h, have radiance S E, where S(wo, wi, h) = f cos is the value of evaluate() (normalised so that at each
// h a white fibre has the radiance of a white furnace). So
//   sigma = l cos theta_o integral_-1^1 S(wo, wi, h) dh = 2 l K(wo, wi) ,
// and reciprocity is K(wo, wi) = K(wi, wo). A smooth cylinder is reciprocal: S has deltas in theta_o +
// theta_i.
//
// The model does not define where light from wi enters for one h, but a smooth cylinder does: by the mirror
// symmetry of each lobe's path, it is at -h seen from wi. The near-field pair is
//   cos theta_o S(wo, wi, h)  and  cos theta_i S(wi, wo, -h) .
//
// Why the model is not reciprocal. Without tilt M_p is symmetric, and so is N_p about a given Phi_p; but A_p,
// Phi_p and the factor cos theta depend on wo alone. Both directions agree at theta_i = -theta_o and deviate
// by the spread of M_p, so the error grows with the roughness. At roughness 1 S is nearly uniform and mainly
// the cosine is left; a column shows the error of S without the cosine. In the near field, narrow azimuthal
// lobes are at a different Phi_p and do not overlap. Tilts: with the tilted angle theta_o', M_p is
// proportional to
//   exp(cos(theta_i + theta_o') / v) / sqrt(c_i c_o') :
// the peak is symmetric, but there c_i = c_o' and not c_o, so that K(wo, wi) / K(wi, wo) = (c_o / c_o')^2.
//
// Statistics. Pairs: wo uniform over the sphere, wi sampled with the shader's density at a uniformly sampled
// h. Each pair has the weight K(wo, wi) + K(wi, wo), divided by the sum of the densities of both orders, so
// results are means over all pairs weighted by the exchanged energy. The error of a pair is |K - K'| / max(K,
// K').
#include "tests/unit/shaders/fibre_cases.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using namespace testing;

// wo and wi as inclinations and the azimuth from one to the other.
struct Pair {
    double theta_o, theta_i, turn;

    Pair exchanged() const { return {theta_i, theta_o, -turn}; }
};

struct Exchange {
    double value = 0.0, pdf = 0.0; // cos theta_o S, and the pdf of wi
};

Exchange near_field(const HairSettings& hair, const Pair& pair, double h) {
    const HairBsdf bsdf = hair_at(hair, fibre_point(pair.theta_o, h));
    const BsdfValue at = evaluate(bsdf, fibre_direction(pair.theta_i, pair.turn).cast<float>());
    return {std::cos(pair.theta_o) * static_cast<double>(mean(at.value)), at.pdf};
}

// Mean over h = sin(gamma), by midpoints in gamma. d Phi / d gamma is at most 2, so a step is 1.6 of the
// smallest tested logistic scale, 0.024. The error of a midpoint sum of logistics is 2 x exp(-x), x = 2 pi^2
// scale / step: 1e-4.
Exchange far_field(const HairSettings& hair, const Pair& pair) {
    constexpr int count = 160;
    Exchange sum;
    for (int i = 0; i < count; ++i) {
        const double gamma = pi * ((i + 0.5) / count - 0.5);
        const double weight = 0.5 * std::cos(gamma) * pi / count;
        const Exchange at = near_field(hair, pair, std::sin(gamma));
        sum.value += weight * at.value;
        sum.pdf += weight * at.pdf;
    }
    return sum;
}

struct Asymmetry {
    double mean = 0.0, high = 0.0; // mean over pairs; 95th percentile
};

// errors: (error, weight) of each pair.
Asymmetry summary(std::vector<std::pair<double, double>> errors) {
    std::sort(errors.begin(), errors.end());
    double all = 0.0, below = 0.0;
    Asymmetry result;
    for (const auto& [error, weight] : errors) {
        all += weight;
        result.mean += weight * error;
    }
    result.mean /= all;
    for (const auto& [error, weight] : errors) {
        if ((below += weight) > 0.95 * all) break;
        result.high = error;
    }
    return result;
}

double lacking(double a, double b) { return std::abs(a - b) / std::max({a, b, 1e-300}); }

struct Asymmetries {
    Asymmetry far, near, without_cosine; // without_cosine: far-field error of S
};

Asymmetries asymmetries_of(const HairSettings& hair, uint64_t seed, int count) {
    Random random{seed};
    std::vector<std::pair<double, double>> near, far, bare;
    for (int k = 0; k < count; ++k) {
        const double theta_o = std::asin(2.0 * random() - 1.0), h = 2.0 * random() - 1.0;
        BsdfSample next;
        if (!sample(hair_at(hair, fibre_point(theta_o, h)), random.four(), next)) continue;
        const Vec3d wi = next.wi.cast<double>();
        const Pair pair{theta_o, std::atan2(wi.y(), std::hypot(wi.x(), wi.z())), azimuth_of(wi)};
        const Exchange here = near_field(hair, pair, h), there = near_field(hair, pair.exchanged(), -h);
        near.push_back(
            {lacking(here.value, there.value), (here.value + there.value) / (here.pdf + there.pdf)});
        const Exchange out = far_field(hair, pair), back = far_field(hair, pair.exchanged());
        const double weight = (out.value + back.value) / (out.pdf + back.pdf);
        far.push_back({lacking(out.value, back.value), weight});
        bare.push_back({lacking(out.value / std::cos(theta_o), back.value / std::cos(pair.theta_i)), weight});
    }
    return {summary(far), summary(near), summary(bare)};
}

struct Row {
    HairCase hair;
    Asymmetry far, near; // measured values
};

const std::array<Row, 15> rows = {{
    {{0.03, 0.1, 0, 1.55, "1"}, {0.012, 0.044}, {0.047, 0.196}},
    {{0.1, 0.1, 0, 1.55, "1"}, {0.039, 0.148}, {0.122, 0.569}},
    {{0.1, 0.3, 0, 1.55, "1"}, {0.030, 0.111}, {0.045, 0.190}},
    {{0.3, 0.1, 0, 1.55, "1"}, {0.104, 0.420}, {0.269, 0.974}},
    {{0.3, 0.3, 0, 1.55, "1"}, {0.089, 0.323}, {0.121, 0.526}},
    {{0.6, 0.3, 0, 1.55, "1"}, {0.172, 0.583}, {0.216, 0.807}},
    {{0.6, 0.6, 0, 1.55, "1"}, {0.144, 0.530}, {0.160, 0.584}},
    {{1, 1, 0, 1.55, "1"}, {0.236, 0.689}, {0.236, 0.689}},
    {{0.3, 0.3, 0, 1.55, "[0.6, 0.45, 0.3]"}, {0.088, 0.321}, {0.121, 0.526}},
    {{0.3, 0.3, 0, 1.55, "0.05"}, {0.086, 0.305}, {0.110, 0.440}},
    {{0.1, 0.1, 2, 1.55, "1"}, {0.061, 0.219}, {0.160, 0.706}},
    {{0.3, 0.3, 2, 1.55, "1"}, {0.095, 0.346}, {0.129, 0.532}},
    {{0.3, 0.3, 2, 1.55, "[0.6, 0.45, 0.3]"}, {0.095, 0.345}, {0.129, 0.529}},
    {{0.3, 0.3, 10, 1.55, "1"}, {0.192, 0.593}, {0.227, 0.769}},
    {{0.3, 0.3, 20, 1.55, "1"}, {0.340, 0.839}, {0.368, 0.955}},
}};

// Other seeds differ by less than 10 %, or by less than 0.01 for values near zero.
void expect_as_measured(const Asymmetry& found, const Asymmetry& measured, const Row& row) {
    const auto bound = [](double figure) { return 1.15 * figure + 0.01; };
    EXPECT_LT(found.mean, bound(measured.mean)) << row.hair.roughness << " " << row.hair.azimuthal_roughness;
    EXPECT_LT(found.high, bound(measured.high)) << row.hair.roughness << " " << row.hair.azimuthal_roughness;
}

TEST(HairReciprocity, IsOffByNoMoreThanMeasured) {
    constexpr int count = 3000;
    constexpr uint64_t seed = 17;
    std::printf("[ exchange ] %d pairs, seed %d: the lesser of K(wo, wi), K(wi, wo) falls short by\n", count,
                static_cast<int>(seed));
    std::printf(
        "[ exchange ] roughness azimuthal tilt  colour            far field, 95 %%  near field, 95 %%  "
        "without cosine\n");
    for (const Row& row : rows) {
        const Asymmetries all = asymmetries_of(hair_of(row.hair), seed, count);
        std::printf("[ exchange ] %9.2f %9.2f %4.0f  %-18s  %.3f %.3f       %.3f %.3f        %.3f\n",
                    row.hair.roughness, row.hair.azimuthal_roughness, row.hair.tilt_degrees,
                    row.hair.color.c_str(), all.far.mean, all.far.high, all.near.mean, all.near.high,
                    all.without_cosine.mean);
        expect_as_measured(all.far, row.far, row);
        expect_as_measured(all.near, row.near, row);
    }
}

} // namespace
} // namespace marram
