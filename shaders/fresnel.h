// SPDX-License-Identifier: Apache-2.0
// Unpolarised reflection at a smooth interface between air and a dielectric (A. Fresnel, 1823).
#pragma once

#include <cmath>

namespace marram {

// ior^2 - sin^2 of an angle, from its cosine. No cancellation, even at grazing angles and ior = 1.
inline float ior_cos_t_squared(float cosine, float ior) {
    return (ior - 1.0F) * (ior + 1.0F) + cosine * cosine;
}

// Fresnel reflectance for light from outside: cosine >= 0, ior >= 1.
inline float fresnel(float cosine, float ior) {
    const float inside = std::sqrt(ior_cos_t_squared(cosine, ior)) / ior;
    if (inside <= 0.0F) return 1.0F; // grazing incidence at ior = 1
    const float parallel = (ior * cosine - inside) / (ior * cosine + inside);
    const float perpendicular = (cosine - ior * inside) / (cosine + ior * inside);
    return 0.5F * (parallel * parallel + perpendicular * perpendicular);
}

} // namespace marram
