// SPDX-License-Identifier: Apache-2.0
// A dune's height, mask and other values, at eight points at once. The model and its symbols are in
// dune_shape.cpp; here are the closed forms of its integrals over a segment, and the far field.
//
// A segment, in coordinates along it with P above t = 0: V0 at t0, V1 at t1 = t0 + l, side s, A = s^2 +
// eps^2, R = sqrt(A + t^2), c = t / R, p = R0 R1 + t0 t1 (>= A by the Cauchy-Schwarz inequality). With
// c1 - c0 = A l (R0 + R1) / (R0 R1 (p + A)),
//     I  = [t (3A + 2t^2) / (3 A^2 R^3)]  = [c - c^3/3] / A^2
//        = l (R0 + R1) / (3 R0 R1 (p + A)) (1/R0^2 + 1/R1^2 + (R0^2 + t1^2) / (R0 R1 p))       integral of w
//     J  = [-1 / (3 R^3)]                                                                       of t w
//     K  = [c^3 / (3A)]  = l (R0 + R1) / (R0 R1 (p + A)) (c1^2 + c1 c0 + c0^2) / 3              of t^2 w
//     M  = [-1/R] - A J                                                                         of t^3 w
// The right-hand forms avoid the cancellation of [...], which loses (D / eps)^4 roundings far beyond an end.
// Between the ends p loses (l / eps)^2 of them: 10^-10 at l = 1000 eps.
//
// Far field. A run of 8 segments is replaced by one point with its length and attribute integrals if its
// centre is at a distance r >= 10 reach and >= 10 of its radii rho. Its part of the sum is at most 3/4 l D^4
// / r^5. Its own error is at most 15 (rho / (r - rho))^2 of that in I (the first moment about the centre is
// 0) and 5 rho / (r - rho) of the change of an attribute in the run. Summed over both directions of a curve,
// at D = reach, where the height is 0: below 1e-5 of I and 2e-5 of an attribute's change in a run. Both fall
// as D^4. The worst case is a curve that fills the plane with branches 2 reach apart: 1e-5 by the mean second
// moment of a run. The far field is blended in over the next 10 % of r, which avoids a step.
#include "procedural/terrain/dune/dune_shape.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

struct DuneSums {
    VDouble weight{}, height{}, outer{}, inner{}, pinch{}, side{}, x{}, z{};
};

struct DuneLanes {
    VDouble height, mask, outer, inner, dist, x, z;
};

// Sums the closed forms of the file head over a run of segments. Neighbours share an end: one square root a
// segment.
template <bool cubic, bool directed>
MARRAM_INLINE void dune_near(const DuneSegment* s, const DuneSegment* end, double softening2, double sign,
                             VDouble px, VDouble pz, DuneSums& sums) {
    VDouble dx = px - s->x, dz = pz - s->z;
    VDouble r0 = dx * dx + dz * dz + softening2, root0 = vsqrt(r0), inverse0 = 1.0 / root0;
    VDouble cube0 = inverse0 * inverse0 * inverse0;
    for (; s != end; ++s) {
        const double nx = sign * s->uz, nz = -sign * s->ux, l = s->length;
        const VDouble t0 = -(dx * s->ux + dz * s->uz), t1 = t0 + l;
        const VDouble side = dx * nx + dz * nz, a = side * side + softening2;
        dx = px - s[1].x, dz = pz - s[1].z;
        const VDouble r1 = dx * dx + dz * dz + softening2, root1 = vsqrt(r1);
        const VDouble p = vmax(root0 * root1 + t0 * t1, a), pp = p * (p + a);
        const VDouble share = 1.0 / (root1 * pp); // one division for both inverses
        const VDouble inverse1 = share * pp, both = inverse0 * inverse1;
        const VDouble cube1 = inverse1 * inverse1 * inverse1;
        const VDouble scaled = l * (root0 + root1) * both * (share * root1);
        const VDouble squares = inverse0 * inverse0 + inverse1 * inverse1;
        const VDouble i = scaled * (squares * p + (r0 + t1 * t1) * both) * (1.0 / 3.0);
        const VDouble j = (cube0 - cube1) * (1.0 / 3.0);
        const VDouble first = j - t0 * i; // moments about the segment's start
        sums.weight += i;
        sums.height += s->height[0] * i + s->height[1] * first;
        if (cubic) {
            const VDouble c0 = t0 * inverse0, c1 = t1 * inverse1;
            const VDouble k = scaled * p * (c1 * c1 + c1 * c0 + c0 * c0) * (1.0 / 3.0);
            const VDouble m = (inverse0 - inverse1) - a * j;
            sums.height += s->height[2] * (k - t0 * (j + first)) +
                           s->height[3] * (m - t0 * (3.0 * k - t0 * (2.0 * j + first)));
        }
        sums.outer += s->outer[0] * i + s->outer[1] * first;
        sums.inner += s->inner[0] * i + s->inner[1] * first;
        sums.pinch += s->pinch[0] * i + s->pinch[1] * first;
        const VDouble turned = side * i;
        sums.side += turned;
        if (directed) sums.x += s->ux * j - nx * turned, sums.z += s->uz * j - nz * turned;
        r0 = r1, root0 = root1, inverse0 = inverse1, cube0 = cube1;
    }
}

// Adds the run as one point with weight `far`, and `near` with weight 1 - far.
MARRAM_INLINE void dune_blend(const DuneChunk& c, VDouble far, VDouble dx, VDouble dz, VDouble r2, VDouble px,
                              VDouble pz, const DuneSums& near, DuneSums& sums) {
    const VDouble rest = 1.0 - far, w = far / (r2 * r2 * vsqrt(r2));
    sums.weight += near.weight * rest + c.length * w;
    sums.height += near.height * rest + c.height * w;
    sums.outer += near.outer * rest + c.outer * w;
    sums.inner += near.inner * rest + c.inner * w;
    sums.pinch += near.pinch * rest + c.pinch * w;
    sums.side += near.side * rest + (c.side_x * px + c.side_z * pz - c.side_0) * w;
    sums.x += near.x * rest - c.length * dx * w;
    sums.z += near.z * rest - c.length * dz * w;
}

MARRAM_INLINE void dune_add(const DuneSums& near, DuneSums& sums) {
    sums.weight += near.weight, sums.height += near.height, sums.outer += near.outer;
    sums.inner += near.inner, sums.pinch += near.pinch, sums.side += near.side;
    sums.x += near.x, sums.z += near.z;
}

template <bool cubic, bool directed>
MARRAM_INLINE DuneSums dune_sums(const DuneField& field, double sign, VDouble x, VDouble z) {
    DuneSums sums;
    const VDouble px = field.xx * x + field.xz * z, pz = field.xz * x + field.zz * z;
    const DuneSegment* segments = field.segments.data();
    const DuneChunk *chunk = field.chunks.data(), *end = chunk + field.chunks.size();
    for (; chunk != end; ++chunk) {
        const DuneChunk& c = *chunk;
        const VDouble dx = px - c.x, dz = pz - c.z, r2 = dx * dx + dz * dz;
        const VDouble above = (r2 - c.far_begin) * c.far_blend;
        DuneSums near;
        if (any(above < 1.0))
            dune_near<cubic, directed>(segments + c.first, segments + c.last, field.softening2, sign, px, pz,
                                       near);
        if (any(above > 0.0)) {
            const VDouble t = vmin(vmax(above, VDouble{}), 1.0);
            dune_blend(c, t * t * (3.0 - 2.0 * t), dx, dz, r2 + field.softening2, px, pz, near, sums);
        } else
            dune_add(near, sums);
    }
    return sums;
}

MARRAM_INLINE VDouble dune_ramp(const DuneRamp& ramp, VDouble x) {
    VDouble y = splat(ramp.values[0]);
    for (size_t k = 0; k < ramp.values.size(); ++k) {
        VDouble t = (x - ramp.positions[k]) * ramp.inverses[k];
        if (ramp.smooth) t = t * t * (3.0 - 2.0 * t);
        y = select(x >= ramp.positions[k], ramp.values[k] + t * ramp.steps[k], y);
    }
    return y;
}

// Relative height of a slope at the fraction `x` of its width; 0 beyond the foot.
MARRAM_INLINE VDouble dune_slope(const DuneRamp& ramp, VDouble x, VDouble pinch) {
    VDouble pinched = x;
    if (any(pinch > 0.0)) {
        constexpr double least = 1e-300; // the logarithm's domain; below it x is 0
        const VDouble power = vexp(vlog(vmin(vmax(x, least), 1.0)) / (1.0 + pinch));
        pinched = select(pinch > 0.0, select(x > least, power, 0.0), x);
    }
    const VDouble y = dune_ramp(ramp, pinched);
    return select(x < 1.0, y, 0.0);
}

// Weighted means of a field at eight points.
struct DuneMeans {
    VDouble D, d, share, height, outer, inner, pinch; // share: of the outer side
};

MARRAM_INLINE DuneMeans dune_means(const DuneParts& parts, double softening2, const DuneSums& sums) {
    const VDouble zero{}, one = splat(1.0), inverse = 1.0 / sums.weight;
    DuneMeans m;
    const VDouble D2 = 1.0 / vsqrt(0.75 * sums.weight);
    m.D = vsqrt(D2);
    m.d = vsqrt(vmax(D2 - softening2, zero));
    const VDouble t = vmin(vmax(0.5 + sums.side * inverse / m.D, zero), one);
    m.share = t * t * (3.0 - 2.0 * t);
    m.height = vmax(sums.height * inverse, zero), m.pinch = vmax(sums.pinch * inverse, zero);
    m.outer = sums.outer * inverse;
    m.inner = parts.cotangent > 0.0 ? m.height * parts.cotangent : sums.inner * inverse;
    return m;
}

// Distance from the rounded crest, in slope widths.
MARRAM_INLINE VDouble dune_slope_coordinate(const DuneParts& parts, VDouble d, VDouble width,
                                            VDouble softening) {
    const double r = parts.settings.crest_radius;
    if (r > 0.0) d = d * d / (vsqrt(d * d + r * r) + r);
    return d / vmax(width, softening);
}

// Computes everything except the direction from the means of the outer slope (o) and of the inner slope (i).
MARRAM_INLINE void dune_combine_slopes(const DuneParts& parts, const DuneMeans& o, const DuneMeans& i,
                                       double outer_softening, double inner_softening, DuneLanes& out) {
    const DuneSettings& s = parts.settings;
    const VDouble zero{}, one = splat(1.0), b = o.share;
    const VDouble soft_o = splat(std::sqrt(outer_softening)), soft_i = splat(std::sqrt(inner_softening));
    const VDouble xo = dune_slope_coordinate(parts, o.d, o.outer, soft_o),
                  xi = dune_slope_coordinate(parts, i.d, i.inner, soft_i);
    const VDouble there = vmin(vmax(o.outer, o.inner) / soft_o, one);
    const VDouble so = dune_slope(parts.outer_slope, xo, o.pinch);
    const VDouble si =
        parts.cotangent > 0.0 ? vmax(1.0 - xi, zero) : dune_slope(parts.inner_slope, xi, i.pinch);
    out.height = there * (b * (o.height * so) + (1.0 - b) * (i.height * si));
    const VDouble xm = s.max_dist > 0.0 ? i.d / s.max_dist : b * vmin(xo, one) + (1.0 - b) * vmin(xi, one);
    const VDouble mask = dune_ramp(parts.mask, xm);
    out.mask = select(xm < 1.0, vmin(vmax(mask, zero), one), zero);
    out.outer = select(xo < 1.0, b, zero);
    out.inner = select(xi < 1.0, 1.0 - b, zero);
    const VLong in = (xo < 1.0) | (xi < 1.0) | (xm < 1.0);
    out.dist = select(in, vmin(i.d, parts.reach), parts.reach);
}

MARRAM_INLINE void dune_sample_direction(const DuneParts& parts, const DuneSums& sums, VDouble D,
                                         DuneLanes& out) {
    const VDouble norm = vsqrt(sums.x * sums.x + sums.z * sums.z);
    const VLong in = (norm > 1e-9 * D * sums.weight) & (out.dist < parts.reach);
    out.x = select(in, sums.x / norm, 0.0);
    out.z = select(in, sums.z / norm, 0.0);
}

// With a stretched plane, the plain distance is computed only where the inner slope, mask or direction needs
// it.
template <bool cubic, bool directed>
MARRAM_INLINE void dune_evaluate(const DuneParts& parts, VDouble x, VDouble z, DuneLanes& out) {
    const DuneField &plain = parts.plain, &stretched = parts.stretched;
    if (stretched.chunks.empty()) {
        const DuneSums sums = dune_sums<cubic, directed>(plain, parts.outer_sign, x, z);
        const DuneMeans means = dune_means(parts, plain.softening2, sums);
        dune_combine_slopes(parts, means, means, plain.softening2, plain.softening2, out);
        if (directed) dune_sample_direction(parts, sums, means.D, out);
        return;
    }
    const DuneMeans outer =
        dune_means(parts, stretched.softening2, dune_sums<cubic, false>(stretched, parts.outer_sign, x, z));
    DuneMeans inner = outer;
    if (directed || parts.settings.max_dist > 0.0 || any(outer.share < 1.0)) {
        const DuneSums sums = dune_sums<cubic, directed>(plain, parts.outer_sign, x, z);
        inner = dune_means(parts, plain.softening2, sums);
        dune_combine_slopes(parts, outer, inner, stretched.softening2, plain.softening2, out);
        if (directed) dune_sample_direction(parts, sums, inner.D, out);
        return;
    }
    dune_combine_slopes(parts, outer, inner, stretched.softening2, plain.softening2, out);
}

struct DuneEval {
    // Points must be inside the dune's box; coordinates are relative to its origin.
    MARRAM_HOT static void heights(const DuneParts& parts, const VDouble& x, const VDouble& z,
                                   DuneLanes& out);
    MARRAM_HOT static void all(const DuneParts& parts, const VDouble& x, const VDouble& z, DuneLanes& out);
};

MARRAM_HOT void DuneEval::heights(const DuneParts& parts, const VDouble& x, const VDouble& z,
                                  DuneLanes& out) {
    if (parts.cubic)
        dune_evaluate<true, false>(parts, x, z, out);
    else
        dune_evaluate<false, false>(parts, x, z, out);
}

MARRAM_HOT void DuneEval::all(const DuneParts& parts, const VDouble& x, const VDouble& z, DuneLanes& out) {
    if (parts.cubic)
        dune_evaluate<true, true>(parts, x, z, out);
    else
        dune_evaluate<false, true>(parts, x, z, out);
}

DuneSample dune_lane(const DuneLanes& out, int i) {
    return {out.height[i], out.mask[i], out.outer[i], out.inner[i], out.dist[i], Vec2d(out.x[i], out.z[i])};
}

// Calls miss(begin, end) or hit(begin, end) for each stretch of a row. Tests 64 samples first, then 8.
template <typename Misses, typename Miss, typename Hit>
void dune_row(int count, const Misses& misses, const Miss& miss, const Hit& hit) {
    constexpr int tile = 64;
    for (int i = 0; i < count; i += tile) {
        const int end = std::min(i + tile, count);
        if (misses(i, end)) {
            miss(i, end);
            continue;
        }
        for (int k = i; k < end; k += lanes) {
            const int stop = std::min(k + lanes, end);
            if (misses(k, stop))
                miss(k, stop);
            else
                hit(k, stop);
        }
    }
}

} // namespace

DuneSample DuneShape::outside() const {
    DuneSample sample;
    sample.dist = parts_.reach;
    return sample;
}

DuneSample DuneShape::sample(const Vec2d& at) const {
    if (empty() ||
        !(at.x() >= lower_.x() && at.x() <= upper_.x() && at.y() >= lower_.y() && at.y() <= upper_.y()))
        return outside();
    DuneLanes out;
    DuneEval::all(parts_, splat(at.x() - parts_.origin.x()), splat(at.y() - parts_.origin.y()), out);
    return dune_lane(out, 0);
}

void DuneShape::row(double x, double z, double cell, int count, double* height, double* mask) const {
    DuneLanes out;
    dune_row(
        count, [&](int i, int end) { return empty() || misses(x + i * cell, x + (end - 1) * cell, z); },
        [&](int i, int end) {
            std::fill(height + i, height + end, 0.0);
            std::fill(mask + i, mask + end, 0.0);
        },
        [&](int i, int end) {
            VDouble px;
            // Clamp to the box: the dune is 0 on its edge and beyond.
            for (int k = 0; k < lanes; ++k)
                px[k] = std::clamp(x + std::min(i + k, end - 1) * cell, lower_.x(), upper_.x()) -
                        parts_.origin.x();
            DuneEval::heights(parts_, px, splat(z - parts_.origin.y()), out);
            for (int k = i; k < end; ++k) height[k] = out.height[k - i], mask[k] = out.mask[k - i];
        });
}

void DuneShape::row(double x, double z, double cell, int count, DuneSample* samples) const {
    DuneLanes out;
    dune_row(
        count, [&](int i, int end) { return empty() || misses(x + i * cell, x + (end - 1) * cell, z); },
        [&](int i, int end) { std::fill(samples + i, samples + end, outside()); },
        [&](int i, int end) {
            VDouble px;
            for (int k = 0; k < lanes; ++k)
                px[k] = std::clamp(x + std::min(i + k, end - 1) * cell, lower_.x(), upper_.x()) -
                        parts_.origin.x();
            DuneEval::all(parts_, px, splat(z - parts_.origin.y()), out);
            for (int k = i; k < end; ++k) samples[k] = dune_lane(out, k - i);
        });
}

} // namespace marram
