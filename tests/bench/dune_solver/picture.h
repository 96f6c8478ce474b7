// SPDX-License-Identifier: Apache-2.0
// A shaded picture of a height field, as a PGM.
#pragma once

#include "procedural/terrain/fields.h"

#include <cstdio>
#include <string>

namespace marram {

// Lit from the north-west, 30 degrees above the horizon; bare ground is darker.
inline bool write_dune_picture(const std::string& path, const Domain& domain,
                               const std::vector<SandUnits>& sand, double exaggeration = 1.0) {
    std::FILE* file = std::fopen(path.c_str(), "wb");
    if (!file) return false;
    std::fprintf(file, "P5\n%d %d\n255\n", domain.nx, domain.nz);
    const auto height = [&](int i, int j) {
        i = std::clamp(i, 0, domain.nx - 1), j = std::clamp(j, 0, domain.nz - 1);
        return exaggeration * sand_metres(sand[domain.index(i, j)]);
    };
    for (int j = 0; j < domain.nz; ++j)
        for (int i = 0; i < domain.nx; ++i) {
            const double gx = (height(i + 1, j) - height(i - 1, j)) / (2 * domain.cell);
            const double gz = (height(i, j + 1) - height(i, j - 1)) / (2 * domain.cell);
            const double light = (0.6124 * gx + 0.6124 * gz + 0.5) / std::sqrt(1.0 + gx * gx + gz * gz);
            const double bare = height(i, j) < 0.002 ? 0.6 : 1.0;
            std::fputc(int(std::clamp(light * bare * 1.2, 0.0, 1.0) * 255.0), file);
        }
    return std::fclose(file) == 0;
}

} // namespace marram
