// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/promise.h"

#include <algorithm>

namespace marram::oracle {

int crossed_segments(const std::vector<Vec3d>& cvs, const TriangleSet& set) {
    int crossed = 0;
    for (size_t k = 0; k + 1 < cvs.size(); ++k) crossed += set.any_crossing(cvs[k], cvs[k + 1]);
    return crossed;
}

Vec3d spline_point(const std::vector<Vec3d>& cvs, Spline spline, size_t segment, double t) {
    const size_t last = cvs.size() - 1;
    const Vec3d& b = cvs[segment];
    const Vec3d& c = cvs[segment + 1];
    const Vec3d a = segment == 0 ? Vec3d(2.0 * b - c) : cvs[segment - 1];
    const Vec3d d = segment + 1 == last ? Vec3d(2.0 * c - b) : cvs[segment + 2];
    const double t2 = t * t, t3 = t2 * t, s = 1.0 - t;
    if (spline == Spline::b_spline)
        return (s * s * s * a + (3.0 * t3 - 6.0 * t2 + 4.0) * b + (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) * c +
                t3 * d) /
               6.0;
    return ((-t3 + 2.0 * t2 - t) * a + (3.0 * t3 - 5.0 * t2 + 2.0) * b + (-3.0 * t3 + 4.0 * t2 + t) * c +
            (t3 - t2) * d) /
           2.0;
}

std::vector<double> deepest_penetrations(const std::vector<Vec3d>& cvs, const std::vector<double>& radius,
                                         Spline spline, int samples, double reach, const TriangleSet& set) {
    std::vector<double> dips(cvs.size() - 1, -reach);
    for (size_t k = 0; k + 1 < cvs.size(); ++k) {
        double away = 0.0; // greatest distance of the curve from the polygon's segment
        for (int i = 0; i <= samples; ++i) {
            const double t = double(i) / samples;
            const Vec3d polygon = cvs[k] + t * (cvs[k + 1] - cvs[k]);
            away = std::max(away, (spline_point(cvs, spline, k, t) - polygon).norm());
        }
        const double widest = std::max(radius[k], radius[k + 1]);
        const double far =
            (widest + reach + away) * (1.0 + 1e-9); // nothing this close: no sample can find a triangle
        if (set.nearest(cvs[k], cvs[k + 1], far).triangle < 0) continue;
        for (int i = 0; i <= samples; ++i) {
            const double t = double(i) / samples;
            const Vec3d point = spline_point(cvs, spline, k, t), polygon = cvs[k] + t * (cvs[k + 1] - cvs[k]);
            const double r = radius[k] + t * (radius[k + 1] - radius[k]);
            const bool inside = set.any_crossing(polygon, point);
            const double limit = inside ? TriangleSet::no_limit : r + reach;
            const double distance = set.nearest(point, point, limit).closest.distance;
            dips[k] = std::max(dips[k], r - (inside ? -distance : distance));
        }
    }
    return dips;
}

} // namespace marram::oracle
