// SPDX-License-Identifier: Apache-2.0
// Hardness of rock: the energy that wears a volume of it, relative to GrainSettings::energy_per_volume. Wear
// is divided by it.
//
//     hardness = settings.hardness / rate_beds(s) * contrast_n^(clamp(noise(p) / rms, -3, 3) / 4)
//                * product over masks of m.hardness^w
//
// Beds. s is the distance across the beds (m): s = (p + folds) . b, with b the upward normal of beds that dip
// by `dip` towards dip_direction. Folds move p along b by fold * noise(p / fold_length) / rms. Bed k covers
// (k + j_k, k + 1 + j_{k+1}) thickness, with j in -0.3 ... 0.3 from a hash. Odd beds are soft, even ones
// hard: rate = contrast^e, with e from a hash, in 0 to 1/2 for soft beds and in -1/2 to 0 for hard ones.
// Laminae are beds of a sixth of the thickness with the contrast contrast^laminae; their rates multiply those
// of the beds.
//
// Mean over a footprint. A voxel wears at the mean rate of its content, so rates are averaged: exactly, over
// an interval of s of the length of the footprint, bed by bed. Beds thinner than 1/16 of the footprint
// contribute their mean. Octaves of the noise shorter than two footprints are omitted.
//
// Masks: w = 1 inside the ellipsoid, 0 outside, with a smooth transition over `edge` of its radius. Where
// many overlap, the product is kept between 1e-30 and 1e30.
//
// Limits: the rates of beds and laminae are averaged separately, not their product. Cost: about 60 ns per
// point on one core with beds and noise.
#include "procedural/erosion/hardness.h"

#include "core/math/hash.h"
#include "procedural/abi/parallel.h"
#include "procedural/noise/noise.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace marram {
namespace {

constexpr double bed_jitter = 0.3, thinnest_bed = 1.0 / 16.0, laminae_a_bed = 6.0;
constexpr double farthest_bed = 0x1p40; // beds from the origin: bed numbers stay exact
constexpr int hardness_octaves = 8;
constexpr double softest = 1e-30, hardest = 1e30; // where many masks overlap: within what a float holds

struct BedRates {
    double thickness, log_contrast;
    uint64_t seed;

    double border(double k) const { // lower border of bed k, in units of the thickness
        return k + bed_jitter * (2.0 * unit_double(hash(seed, uint64_t(int64_t(k)))) - 1.0);
    }
    double rate(double k) const {
        const double u = 0.5 * unit_double(hash(seed ^ 0x5bd1e995U, uint64_t(int64_t(k))));
        return std::exp(log_contrast * (int64_t(k) & 1 ? u : -u));
    }
    // Mean over the interval of length `footprint` around s.
    double mean(double s, double footprint) const {
        if (log_contrast <= 0.0) return 1.0;
        const double at = std::clamp(s / thickness, -farthest_bed, farthest_bed);
        const double width = footprint / thickness;
        if (width * thinnest_bed > 1.0) {
            const double a = 0.5 * log_contrast; // mean of exp(+-a u) over u in 0 to 1 and both signs
            return std::sinh(a) / a;
        }
        const double low = at - 0.5 * width, high = at + 0.5 * width;
        double k = std::floor(low) - 1.0;
        while (border(k + 1.0) <= low) k += 1.0;
        if (width < 1e-9) return rate(k);
        double sum = 0.0, from = low;
        while (from < high) {
            const double to = std::min(border(k + 1.0), high);
            sum += rate(k) * (to - from);
            from = to, k += 1.0;
        }
        return sum / (high - low);
    }
};

struct HardnessBatch {
    std::array<Wide3d, 1> point;
    int count;
};

HardnessBatch hardness_batch(std::span<const float> points, size_t first) {
    HardnessBatch batch{};
    batch.count = int(std::min(size_t(lanes), points.size() / 3 - first));
    for (int lane = 0; lane < lanes; ++lane) {
        const float* const p = points.data() + 3 * (first + size_t(std::min(lane, batch.count - 1)));
        batch.point[0].x[lane] = double(p[0]);
        batch.point[0].y[lane] = double(p[1]);
        batch.point[0].z[lane] = double(p[2]);
    }
    return batch;
}

// First component of vector noise, normalised to an rms of 1.
VFloat hardness_noise(const HardnessBatch& batch, double length, int octaves, double footprint,
                      uint32_t seed) {
    FractalNoise noise;
    noise.frequency = 1.0 / length;
    noise.octaves = std::clamp(octaves, 1, hardness_octaves);
    noise.seed = seed;
    double shortest = length * std::exp2(1.0 - noise.octaves);
    while (noise.left_out + 1 < noise.octaves && shortest < 2.0 * footprint)
        shortest *= 2.0, ++noise.left_out;
    std::array<Wide3f, 1> out;
    vector_noise(noise, batch.point.data(), 1, false, 0.0, out.data());
    return out[0].x * float(1.0 / perlin_rms_3d);
}

double mask_factor(const HardnessMask& mask, const Vec3d& p) {
    const double q = (p - mask.center).cwiseQuotient(mask.radius).norm();
    const double edge = std::clamp(mask.edge, 1e-6, 1.0);
    const double t = std::clamp((1.0 - q) / edge, 0.0, 1.0);
    return std::pow(mask.hardness, t * t * (3.0 - 2.0 * t));
}

} // namespace

void rock_hardness(const HardnessSettings& settings, std::span<const float> points, double footprint,
                   std::span<double> hardness) {
    const RockStrata& strata = settings.strata;
    const bool beds = strata.thickness > 0.0 && strata.contrast > 1.0;
    const bool folds = beds && strata.fold > 0.0 && strata.fold_length > 0.0;
    const bool noisy = settings.noise > 1.0 && settings.noise_length > 0.0;
    const Vec3d across(std::sin(strata.dip) * std::cos(strata.dip_direction), std::cos(strata.dip),
                       std::sin(strata.dip) * std::sin(strata.dip_direction));
    const double contrast = std::log(std::max(strata.contrast, 1.0));
    const BedRates main{strata.thickness, contrast, hash(settings.seed, 1)};
    const BedRates fine{strata.thickness / laminae_a_bed, contrast * strata.laminae, hash(settings.seed, 2)};
    const double log_noise = std::log(std::max(settings.noise, 1.0)) / 4.0; // extremes: twice the rms
    const size_t batches = (hardness.size() + lanes - 1) / lanes;
    marram::parallel_for(
        tbb::blocked_range<size_t>(0, batches, 64), [&](const tbb::blocked_range<size_t>& range) {
            for (size_t b = range.begin(); b < range.end(); ++b) {
                const HardnessBatch batch = hardness_batch(points, b * lanes);
                VFloat fold{}, noise{};
                if (folds)
                    fold = hardness_noise(batch, strata.fold_length, 2, footprint, settings.seed + 0x31U);
                if (noisy)
                    noise = hardness_noise(batch, settings.noise_length, settings.noise_octaves, footprint,
                                           settings.seed + 0x17U);
                for (int lane = 0; lane < batch.count; ++lane) {
                    const Vec3d p(batch.point[0].x[lane], batch.point[0].y[lane], batch.point[0].z[lane]);
                    double value = settings.hardness;
                    if (beds) {
                        const double s = across.dot(p) + strata.fold * double(fold[lane]);
                        value /= main.mean(s, footprint) * fine.mean(s, footprint);
                    }
                    if (noisy) value *= std::exp(log_noise * std::clamp(double(noise[lane]), -3.0, 3.0));
                    for (const HardnessMask& mask : settings.masks) value *= mask_factor(mask, p);
                    hardness[b * lanes + size_t(lane)] = std::clamp(value, softest, hardest);
                }
            }
        });
}

} // namespace marram
