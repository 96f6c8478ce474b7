// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/shield.h"

#include <algorithm>

namespace marram::oracle {

Shielding shield_curve(const std::vector<Vec3d>& cvs, const Vec3d& wind, double offset, double margin,
                       const TriangleSet& set) {
    Shielding result;
    const double reach = shield_grazing * offset;
    for (const Vec3d& p : cvs) {
        const Vec3d begin = p - wind * offset, end = p - wind * (offset * margin);
        bool hit = false, grazing = false;
        for (int i : set.within(begin, end, reach)) {
            const Crossing c = crossing(begin, end, set.triangles()[size_t(i)]);
            hit = hit || c.crosses;
            grazing = grazing || c.margin <= reach;
        }
        result.hit.push_back(hit);
        result.grazing.push_back(grazing);
        result.alpha += hit ? 1.0 / double(cvs.size()) : 0.0;
    }
    return result;
}

double shield_envelope(double shield, double alpha) { return std::clamp(1.0 - shield * alpha, 0.0, 1.0); }

} // namespace marram::oracle
