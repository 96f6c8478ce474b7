// SPDX-License-Identifier: Apache-2.0
// Uniform cubic curve segments, as Embree evaluates them.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <array>

namespace marram {

// Weights of the four vertices for the value, first and second derivative at u, 0 ... 1.
struct CubicBasis {
    std::array<double, 4> value, first, second;
};

inline CubicBasis cubic_basis(MarramBasis kind, double u) {
    const double s = 1.0 - u, u2 = u * u, u3 = u2 * u;
    if (kind == MARRAM_BSPLINE)
        return {{s * s * s / 6.0, (3.0 * u3 - 6.0 * u2 + 4.0) / 6.0,
                 (-3.0 * u3 + 3.0 * u2 + 3.0 * u + 1.0) / 6.0, u3 / 6.0},
                {-0.5 * s * s, 1.5 * u2 - 2.0 * u, -1.5 * u2 + u + 0.5, 0.5 * u2},
                {s, 3.0 * u - 2.0, 1.0 - 3.0 * u, u}};
    return {{0.5 * (-u3 + 2.0 * u2 - u), 0.5 * (3.0 * u3 - 5.0 * u2 + 2.0), 0.5 * (-3.0 * u3 + 4.0 * u2 + u),
             0.5 * (u3 - u2)},
            {0.5 * (-3.0 * u2 + 4.0 * u - 1.0), 0.5 * (9.0 * u2 - 10.0 * u),
             0.5 * (-9.0 * u2 + 8.0 * u + 1.0), 0.5 * (3.0 * u2 - 2.0 * u)},
            {0.5 * (4.0 - 6.0 * u), 0.5 * (18.0 * u - 10.0), 0.5 * (8.0 - 18.0 * u), 0.5 * (6.0 * u - 2.0)}};
}

} // namespace marram
