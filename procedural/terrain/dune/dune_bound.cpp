// SPDX-License-Identifier: Apache-2.0
// Where a dune is 0: a bound on lines, a box outside which it is 0, and stretches of rows that miss it. The
// model and its symbols are in dune_shape.cpp.
//
// Bound of the support. With w(t) a width along the curve, w_bar^4 <= mean of w^4 (power means), so
//     F = 3/4 integral of w(t)^4 (|P - C(t)|^2 + eps^2)^(-5/2) dt <= 1     gives     w_bar <= D.
// With ((w + r)^2 + eps^2)^2 in place of w^4 it gives (w_bar + r)^2 <= d^2, which is beyond the foot:
// sqrt(w^2 + 2 w r) <= w + r. w is the greatest of the outer and inner width, max_dist and eps; with a
// stretched plane, that plane uses the outer width alone and the plain one omits it. Over a stretch of a row
// the sum is bounded by discs about the segments (radius half their length), so each width counts only near
// its segment. Samples with F <= 1 are not evaluated. Outside the curve F has no local maximum, by the
// maximum principle (its Laplacian is at least 0 for distances above 0.63 eps). So a line beyond the curve on
// which F <= 1 bounds the dune: the box is four such lines, found by bisection. F ignores sides: it uses the
// outer width on the inner side too, so the box of a barchan is 1.5 to 2 times larger than needed.
#include "procedural/terrain/dune/dune_construction.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

struct DuneBound {
    // Upper bound of 4/3 F (file head) on the line from (x0, z0) to (x1, z1). Stops early once it exceeds
    // `enough`.
    MARRAM_HOT static double sum(const DuneField& field, double x0, double z0, double x1, double z1,
                                 double enough);
};

MARRAM_HOT double DuneBound::sum(const DuneField& field, double x0, double z0, double x1, double z1,
                                 double enough) {
    const double ax = field.xx * x0 + field.xz * z0, az = field.xz * x0 + field.zz * z0;
    const double wx = field.xx * (x1 - x0) + field.xz * (z1 - z0),
                 wz = field.xz * (x1 - x0) + field.zz * (z1 - z0);
    const double way2 = wx * wx + wz * wz, inverse = way2 > 0.0 ? 1.0 / way2 : 0.0;
    double total = 0.0;
    for (size_t k = 0; k < field.chunks.size() && total <= enough; ++k) {
        const DuneChunk& c = field.chunks[k];
        const double t = std::min(std::max(((c.x - ax) * wx + (c.z - az) * wz) * inverse, 0.0), 1.0);
        const double dx = c.x - ax - t * wx, dz = c.z - az - t * wz, r2 = dx * dx + dz * dz;
        constexpr double far = 8.0; // radii: one disc for the whole run overestimates by less than (8/7)^5
        if (r2 > far * far * c.radius * c.radius) {
            const double r = std::sqrt(r2) - c.radius, s2 = r * r + field.softening2;
            total += c.cover / (s2 * s2 * std::sqrt(s2));
            continue;
        }
        const VDouble x = vload(field.covers[k].x), z = vload(field.covers[k].z);
        const VDouble half = vload(field.covers[k].half), weight = vload(field.covers[k].weight);
        const VDouble u = vmin(vmax(((x - ax) * wx + (z - az) * wz) * inverse, VDouble{}), 1.0);
        const VDouble ex = x - ax - u * wx, ez = z - az - u * wz;
        const VDouble r = vmax(vsqrt(ex * ex + ez * ez) - half, VDouble{}), s2 = r * r + field.softening2;
        const VDouble share = weight / (s2 * s2 * vsqrt(s2));
        for (int i = 0; i < lanes; ++i) total += share[i];
    }
    return total;
}

// The dune is 0 where the sum is at most this. 1e-9 covers the rounding of the sum.
constexpr double dune_zero_limit = (1.0 - 1e-9) * 4.0 / 3.0;

bool dune_is_zero(const DuneParts& parts, double x0, double z0, double x1, double z1) {
    return DuneBound::sum(parts.plain, x0, z0, x1, z1, dune_zero_limit) <= dune_zero_limit &&
           (parts.stretched.chunks.empty() ||
            DuneBound::sum(parts.stretched, x0, z0, x1, z1, dune_zero_limit) <= dune_zero_limit);
}

// The dune is 0 beyond this distance from the curve. A stretched distance is at least the plain one.
double dune_max_distance(const DuneField& field) {
    double total = 0.0;
    for (const DuneChunk& c : field.chunks) total += c.cover;
    return std::pow(total / dune_zero_limit, 0.2) * (1.0 + 1e-9);
}

// How far the dune extends beyond the curve's box on one side. Bisects for a line on which the dune is 0; the
// sum is no greater beyond it (see the file head).
double dune_margin(const DuneParts& parts, const double box[2][2], double farthest, int axis, int side) {
    const int other = 1 - axis;
    const double from = box[0][other] - farthest, extent = box[1][other] + farthest - from;
    const int stretches = int(std::clamp(std::ceil(4.0 * extent / farthest), 8.0, 32.0));
    double low = 0.0, high = farthest;
    for (int step = 0; step < 7; ++step) {
        const double middle = 0.5 * (low + high);
        double a[2], b[2];
        a[axis] = b[axis] = side ? box[1][axis] + middle : box[0][axis] - middle;
        bool clear = true;
        for (int i = 0; i < stretches && clear; ++i) {
            a[other] = from + extent * i / stretches, b[other] = from + extent * (i + 1) / stretches;
            clear = dune_is_zero(parts, a[0], a[1], b[0], b[1]);
        }
        (clear ? high : low) = middle;
    }
    return high;
}

} // namespace

double dune_cover_weight(const DuneSegment& s, const DuneBoundedWidths& what, double softening2) {
    const double l = s.length, least = std::max(std::sqrt(softening2), what.max_dist);
    double begin = least, end = least;
    if (what.outer) begin = std::max(begin, s.outer[0]), end = std::max(end, s.outer[0] + l * s.outer[1]);
    if (what.inner && what.cotangent > 0.0) {
        const double* c = s.height; // the greatest Bezier control point bounds the cubic
        const double linear = l * c[1], square = l * l * c[2], cube = l * l * l * c[3];
        const double most = std::max(
            {c[0], c[0] + linear / 3.0, c[0] + (2.0 * linear + square) / 3.0, c[0] + linear + square + cube});
        const bool straight = c[2] == 0.0 && c[3] == 0.0;
        begin = std::max(begin, what.cotangent * (straight ? c[0] : most));
        end = std::max(end, what.cotangent * (straight ? c[0] + linear : most));
    } else if (what.inner)
        begin = std::max(begin, s.inner[0]), end = std::max(end, s.inner[0] + l * s.inner[1]);
    const auto power = [&](double w) {
        const double square = (w + what.crest_radius) * (w + what.crest_radius) + softening2;
        return square * square;
    };
    return 0.5 * l * (power(begin) + power(end));
}

void dune_box(const DuneParts& parts, Vec2d& lower, Vec2d& upper) {
    double box[2][2] = {{infinity, infinity}, {-infinity, -infinity}};
    for (const DuneSegment& s : parts.plain.segments) {
        box[0][0] = std::min(box[0][0], s.x), box[1][0] = std::max(box[1][0], s.x);
        box[0][1] = std::min(box[0][1], s.z), box[1][1] = std::max(box[1][1], s.z);
    }
    double farthest = dune_max_distance(parts.plain);
    if (!parts.stretched.chunks.empty()) farthest = std::max(farthest, dune_max_distance(parts.stretched));
    for (int axis = 0; axis < 2; ++axis) {
        lower[axis] = box[0][axis] - dune_margin(parts, box, farthest, axis, 0);
        upper[axis] = box[1][axis] + dune_margin(parts, box, farthest, axis, 1);
    }
}

// Whether the dune is 0 on all of row z between x0 and x1.
bool DuneShape::misses(double x0, double x1, double z) const {
    if (!(std::max(x0, x1) >= lower_.x() && std::min(x0, x1) <= upper_.x() && z >= lower_.y() &&
          z <= upper_.y()))
        return true;
    const double row = z - parts_.origin.y();
    return dune_is_zero(parts_, x0 - parts_.origin.x(), row, x1 - parts_.origin.x(), row);
}

} // namespace marram
