// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/bend.h"

#include "tests/oracle/turn.h"

#include <algorithm>

namespace marram::oracle {

std::vector<double> bend_factors(const std::vector<Vec3d>& rest, const Bend& bend) {
    const size_t segments = rest.size() - 1;
    double length = 0.0, before = 0.0, last = 0.0;
    for (size_t k = 0; k < segments; ++k) length += (rest[k + 1] - rest[k]).stableNorm();
    std::vector<double> factors(segments, 0.0);
    if (!(length > 0.0)) return factors;
    for (size_t k = 0; k < segments; ++k) {
        const double own = (rest[k + 1] - rest[k]).stableNorm();
        const double envelope = bend.envelope.empty() ? 1.0 : bend.envelope[k];
        const double f =
            std::clamp(bend.global_rotate * bend.ramp_rotate(before / length) * envelope, 0.0, 1.0);
        const double span = bend.own_spans ? own : 0.5 * (last + own);
        factors[k] = bend.reference_segments > 0.0
                         ? 1.0 - std::pow(1.0 - f, bend.reference_segments * span / length)
                         : f;
        before += own;
        last = own;
    }
    return factors;
}

std::vector<Vec3d> bend_curve(std::vector<Vec3d> cvs, const Bend& bend) {
    const std::vector<double> factors = bend_factors(cvs, bend);
    for (size_t k = 0; k + 1 < cvs.size(); ++k) {
        if (factors[k] == 0.0) continue; // keeps the rest pose bit for bit
        const Vec3d noise = bend.noise.empty() ? Vec3d::Zero() : bend.noise[k];
        const Vec3d tip = cvs.back() - cvs[k];
        const Turn turn = shortest_turn(tip, bend.wind + noise, cvs[k + 1] - cvs[k], tip, noise);
        if (turn.angle == 0.0) continue;
        for (size_t i = k + 1; i < cvs.size(); ++i)
            cvs[i] = cvs[k] + turned(cvs[i] - cvs[k], turn.axis, turn.angle * factors[k]);
    }
    return cvs;
}

} // namespace marram::oracle
