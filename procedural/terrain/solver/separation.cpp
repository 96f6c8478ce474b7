// SPDX-License-Identifier: Apache-2.0
// Flow separation: bubbles behind brinks and in front of steep faces.
//
// Behind a brink the wind separates and reattaches about six brink heights downwind. Linear theory does not
// include this, but the air above flows as over a smooth surface: the ground and the streamline that bounds
// the bubble (O. Zeman and N. Jensen, 1988; K. Kroy, G. Sauermann, H. Herrmann, Phys. Rev. E 66, 2002). With
// x downwind of the brink, height h_b and slope m there, meeting the ground of height h_r at x = r with slope
// 0:
//
//   s(x) = h_b + m x + b2 x^2 + b3 x^3,  b2 = -(2 m r + 3 D) / r^2,  b3 = (m r + 2 D) / r^3,  D = h_b - h_r
//
// It is steepest at x = -b2 / 3 b3. Setting the slope there to -C, the steepest descent of a separated flow
// (14 degrees), gives (2 m r + 3 D)^2 = 3 r (m r + 2 D) (m + C), hence r = K D with
//
//   K = 3 / (C - m + sqrt(C (C + m)))     (6 for a level brink, C = 1/4)
//
// So r is where the straight line of slope -1 / K from the brink meets the ground. It is found by tracing the
// line, to a fraction of a cell. m is clamped to -C ... C. Ground above the streamline stays; the ground's
// slope at r is taken as 0.
//
// A brink is where the ground falls more steeply than `steepest` to the next sample downwind, outside of a
// bubble. A face that rises more steeply than `steepest` has a bubble in front: the same curve traced upwind,
// with C = `windward`. So linear theory never gets a steeper slope.
//
// Rays. The curves run along the wind, at any angle to the grid: ray r is at column r + n drift in the n-th
// row downwind. Heights are interpolated linearly between columns onto the rays, and the excess of the
// bubbles linearly back, so ground without bubbles is unchanged. On periodic ground a ray starts before the
// first row by the maximum length of a bubble.
//
// Cost: 3 ns a cell on one core; rays are independent. Memory: 4 bytes a cell (more for oblique winds over
// non-periodic ground).
#include "procedural/terrain/solver/separation.h"

#include "procedural/parallel.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

constexpr int separation_rays = 16; // rays processed together

// Profile of one ray; its samples are 16 floats apart.
struct SeparationRay {
    const float* height;
    float* excess;
    int length;

    float at(int n) const { return height[size_t(n) * separation_rays]; }
    float& above(int n) const { return excess[size_t(n) * separation_rays]; }
};

// Traces the streamline from the brink at `start` in steps of `step` (1 or -1). Returns the first sample at
// or beyond the point where it meets the ground.
int separation_trace_bubble(const SeparationRay& ray, double cell, int start, int step, double steepest) {
    const double brink = double(ray.at(start));
    const int before = start - step;
    const double slope = before >= 0 && before < ray.length ? (brink - double(ray.at(before))) / cell : 0.0;
    const double m = std::clamp(slope, -steepest, steepest);
    const double k = 3.0 / (steepest - m + std::sqrt(steepest * (steepest + m)));
    const int last = step > 0 ? ray.length - 1 : 0;
    double reach = 0.0, ground = brink,
           above = 0.0; // above: line minus ground at the previous sample
    int n = start;
    while (n != last) {
        n += step;
        const double d = double(std::abs(n - start)) * cell, here = double(ray.at(n));
        const double line = brink - d / k - here;
        if (line <= 0.0) {
            const double part = above > line ? above / (above - line) : 1.0;
            const double there = double(ray.at(n - step));
            reach = d - (1.0 - part) * cell;
            ground = there + part * (here - there);
            break;
        }
        above = line;
    }
    if (reach == 0.0) { // beyond the end: the ground continues level
        ground = double(ray.at(last));
        reach = (brink - ground) * k;
    }
    const double drop = brink - ground;
    if (!(reach > cell) || !(drop > 0.0)) return start + step;
    const double b2 = -(2.0 * m * reach + 3.0 * drop) / (reach * reach);
    const double b3 = (m * reach + 2.0 * drop) / (reach * reach * reach);
    for (n = start; n != last;) {
        n += step;
        const double x = double(std::abs(n - start)) * cell;
        if (x >= reach) return n;
        const double s = brink + x * (m + x * (b2 + x * b3));
        ray.above(n) = std::max(ray.above(n), float(s - double(ray.at(n))));
    }
    return last;
}

MARRAM_HOT bool separation_any_step(const float* from, const float* to, float steep) {
    VInt found{};
    for (int k = 0; k < separation_rays; k += lanes) {
        found |= vload(from + k) - vload(to + k) > steep;
    }
    int sum = 0;
    for (int l = 0; l < lanes; ++l) sum |= found[l];
    return sum != 0;
}

// Interpolates between each value and the next.
MARRAM_HOT void separation_between(const float* values, float part, int count, float* out) {
    int k = 0;
    for (; k + lanes <= count; k += lanes) {
        const VFloat a = vload(values + k), b = vload(values + k + 1);
        vstore(out + k, a + part * (b - a));
    }
    for (; k < count; ++k) out[k] = values[k] + part * (values[k + 1] - values[k]);
}

// All bubbles of sixteen rays in the direction of `step`.
void separation_sweep(const float* height, float* excess, int length, double cell, int step, double threshold,
                      double steepest) {
    const float fall = float(threshold * cell);
    int free_from[separation_rays];
    std::fill_n(free_from, separation_rays, step > 0 ? 0 : length - 1);
    const int last = step > 0 ? length - 1 : 0;
    for (int n = length - 1 - last; n != last; n += step) {
        const float* const here = height + size_t(n) * separation_rays;
        const float* const next = height + size_t(n + step) * separation_rays;
        if (!separation_any_step(here, next, fall)) continue;
        for (int lane = 0; lane < separation_rays; ++lane)
            if (here[lane] - next[lane] > fall && (n - free_from[lane]) * step >= 0)
                free_from[lane] =
                    separation_trace_bubble({height + lane, excess + lane, length}, cell, n, step, steepest);
    }
}

struct SeparationOffset {
    int whole;
    float part;
};
SeparationOffset separation_offset(const DownwindGrid& course, int step) {
    const double shift = step * course.drift, whole = std::floor(shift);
    return {int(whole), float(shift - whole)};
}

} // namespace

void Separation::find(const DownwindGrid& course, const SeparationSettings& settings, const float* height,
                      double range, size_t pitch, float* excess) {
    const int rows = course.rows, columns = course.columns;
    const double pace = course.cell * std::hypot(1.0, course.drift); // length of a ray from row to row
    const double longest = 3.0 / (std::sqrt(2.0) * std::min(settings.lee, settings.windward)); // K at m = C
    const int warm =
        course.periodic ? int(std::min(std::ceil(longest * range / pace) + 2.0, double(rows))) : 0;
    const int swept = int(std::ceil(std::abs(course.drift) * (rows - 1)));
    const int first = course.periodic || course.drift < 0.0 ? 0 : -swept; // first ray
    const int count = columns + (course.periodic ? 0 : swept + 1);
    const int groups = (count + separation_rays - 1) / separation_rays;
    const size_t ray_pitch = size_t(groups) * separation_rays;
    rays_.resize(ray_pitch * size_t(rows));

    struct Scratch {
        WideVector<float> height, excess;
    };
    tbb::enumerable_thread_specific<Scratch> scratches;
    marram::parallel_for(0, groups, [&](int group) {
        Scratch& mine = scratches.local();
        const int length = warm + rows + (course.periodic ? warm : 0), r0 = first + group * separation_rays;
        mine.height.resize(size_t(length) * separation_rays);
        mine.excess.assign(size_t(length) * separation_rays, 0.0F);
        for (int n = 0; n < length; ++n) {
            const int step = n - warm;
            const SeparationOffset offset = separation_offset(course, step);
            const int wrapped = course.periodic ? ((step % rows) + rows) % rows : step;
            const float* row = height + size_t(course.row(wrapped)) * pitch;
            float* const out = mine.height.data() + size_t(n) * separation_rays;
            int b = r0 + offset.whole;
            if (course.periodic) b = ((b % columns) + columns) % columns;
            if (b >= 0 && b + separation_rays < columns)
                separation_between(row + b, offset.part, separation_rays, out);
            else
                for (int l = 0; l < separation_rays; ++l) {
                    int c = b + l, d = b + l + 1;
                    if (course.periodic)
                        c %= columns, d %= columns;
                    else
                        c = std::clamp(c, 0, columns - 1), d = std::clamp(d, 0, columns - 1);
                    out[l] = row[c] + offset.part * (row[d] - row[c]);
                }
        }
        separation_sweep(mine.height.data(), mine.excess.data(), length, pace, 1, settings.steepest,
                         settings.lee);
        separation_sweep(mine.height.data(), mine.excess.data(), length, pace, -1, settings.steepest,
                         settings.windward);
        for (int step = 0; step < rows; ++step)
            std::memcpy(rays_.data() + size_t(course.row(step)) * ray_pitch + size_t(group * separation_rays),
                        mine.excess.data() + size_t(step + warm) * separation_rays,
                        separation_rays * sizeof(float));
    });

    marram::parallel_for(0, rows, [&](int step) {
        const SeparationOffset offset = separation_offset(course, step);
        const size_t row = size_t(course.row(step));
        const float* const from = rays_.data() + row * ray_pitch;
        float* const to = excess + row * pitch;
        if (course.periodic) {
            int r = ((-offset.whole % columns) + columns) % columns;
            for (int b = 0; b < columns;) { // runs without wraparound
                const float before = from[r == 0 ? columns - 1 : r - 1];
                to[b] = std::max(from[r] + offset.part * (before - from[r]), 0.0F);
                const int run = std::min(columns - b, columns - r);
                separation_between(from + r, 1.0F - offset.part, run - 1, to + b + 1);
                b += run;
                r = 0;
            }
        } else
            for (int b = 0; b < columns; ++b) {
                const int r = b - offset.whole - first;
                const float here = r < count ? from[r] : 0.0F, before = r > 0 ? from[r - 1] : 0.0F;
                to[b] = here + offset.part * (before - here);
            }
    });
}

} // namespace marram
