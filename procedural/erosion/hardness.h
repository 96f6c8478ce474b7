// SPDX-License-Identifier: Apache-2.0
// Hardness of rock at points: beds, noise, masks. The model is documented in hardness.cpp.
#pragma once

#include "core/math/vec.h"

#include <cstdint>
#include <span>
#include <vector>

namespace marram {

// Beds of sediment, alternately hard and soft.
struct RockStrata {
    double thickness = 0.0;     // m, mean thickness of a bed; 0: no beds
    double contrast = 4.0;      // ratio of the hardest to the softest bed, 1 or more
    double laminae = 0.0;       // 0 to 1: contrast of thin beds within the beds, as a power of `contrast`
    double dip = 0.0;           // rad, between the beds and the horizontal
    double dip_direction = 0.0; // rad about y from x towards z: direction of descent
    double fold = 0.0;          // m, amplitude of the folds
    double fold_length = 10.0;  // m, wavelength of the folds
};

// Ellipsoid of rock with a different hardness.
struct HardnessMask {
    Vec3d center = Vec3d::Zero(), radius = Vec3d::Ones(); // m
    double hardness = 1.0;                                // factor, above 0
    double edge = 0.2;                                    // width of the smooth edge, 0 to 1 of the radius
};

struct HardnessSettings {
    double hardness = 1.0; // overall factor, above 0
    RockStrata strata;
    double noise = 1.0;        // ratio of the extremes of the noise, 1 or more; 1: none
    double noise_length = 1.0; // m, of the coarsest octave
    int noise_octaves = 3;
    std::vector<HardnessMask> masks;
    uint32_t seed = 0;
};

// Hardness, which divides the wear, at points (xyz each, metres). 1 / hardness is averaged over `footprint`
// metres, so that detail finer than a voxel contributes its mean wear. A value depends only on its point, not
// on the batch.
void rock_hardness(const HardnessSettings& settings, std::span<const float> points, double footprint,
                   std::span<double> hardness);

} // namespace marram
