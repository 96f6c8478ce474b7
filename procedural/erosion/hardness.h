// SPDX-License-Identifier: Apache-2.0
// Hardness of rock at any place: beds, noise, masks. The page is in hardness.cpp.
#pragma once

#include "core/math/vec.h"

#include <cstdint>
#include <span>
#include <vector>

namespace marram {

// Beds of sediment, hard and soft ones in turn.
struct RockStrata {
    double thickness = 0.0; // m, mean of a bed; 0: no beds
    double contrast = 4.0;  // of the hardest and the softest bed, 1 or more
    double laminae = 0.0; // 0 to 1: how much thinner beds within the beds differ, as a power of the contrast
    double dip = 0.0;     // rad, between the beds and level
    double dip_direction = 0.0; // rad about y from x towards z: where the beds go down
    double fold = 0.0;          // m, amplitude of their folds
    double fold_length = 10.0;  // m
};

// Rock of another hardness within an ellipsoid.
struct HardnessMask {
    Vec3d center = Vec3d::Zero(), radius = Vec3d::Ones(); // m
    double hardness = 1.0;                                // factor, above 0
    double edge = 0.2;                                    // share of the radius over which it begins, 0 to 1
};

struct HardnessSettings {
    double hardness = 1.0; // factor of it all, above 0
    RockStrata strata;
    double noise = 1.0;        // contrast of the noise's extremes, 1 or more; 1: none
    double noise_length = 1.0; // m
    int noise_octaves = 3;
    std::vector<HardnessMask> masks;
    uint32_t seed = 0;
};

// Hardness (what divides the wear) at points, xyz each, in metres. `footprint`: metres over which 1 / hardness is a mean, so that what
// is finer than a voxel counts by its mean wear. A value depends on its point alone, not on the batch.
void rock_hardness(const HardnessSettings& settings, std::span<const float> points, double footprint,
                   std::span<double> hardness);

} // namespace marram
