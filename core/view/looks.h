// SPDX-License-Identifier: Apache-2.0
// Colours and light as a page draws them: the albedo of materials, the sun, and the mean light of the sky.
#pragma once

#include "core/shot/shot.h"
#include "core/view/strand_packing.h"

#include <nlohmann/json.hpp>

namespace marram {

StrandColors strand_colors(const Shot& shot, int material); // albedo at the root and at the tip
Vec3f mesh_color(const Shot& shot, int material);           // albedo; images count with their middle

// { sun: { direction, color } or null, sky, ground }: radiance, linear. color: what a white surface that
// faces the sun scatters. Of several suns the strongest; meshes that emit are left out.
nlohmann::json light_of(const Shot& shot);

} // namespace marram
