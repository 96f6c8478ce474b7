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
// Sides (`convergence`, for terrains with obstacles). The flow around the ends of a wall closes in on its
// wake: in plan both sides of a bubble move in by a quarter of the distance from the brink (in front of a
// face: from the face). So the shelter of a wall is a triangle twice as long as the wall is wide, if that is
// shorter than the bubble (compare the shadow dunes of P. Hesp, Sedimentology 28, 1981). The bubble falls to
// its sides with a slope of 1/2. Terrains of dunes alone leave it off: their bubbles are wider than long.
//
// The curves run along rays (downwind_rays.h): heights are interpolated onto the rays, the excess of the
// bubbles back, so ground without bubbles is unchanged. On periodic ground a ray starts before the first row
// by the maximum length of a bubble.
//
// Cost: 3 ns a cell on one core; rays are independent. With convergence 4 to 10 ns more. Memory:
// 4 bytes a cell, 8 with convergence (more for oblique winds over non-periodic ground).
#include "procedural/air/separation.h"

#include "procedural/abi/parallel.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace marram {
namespace {

constexpr int separation_rays = DownwindRays::width;
constexpr float separation_side_slope = 0.5F; // of a narrowed bubble, towards its sides
constexpr float infinity_f = std::numeric_limits<float>::infinity();

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

// Moves values of the rays across the periodic border, where other rays, `shift` columns further, continue
// them. Interpolates; infinity is no bubble: beside it the finite value counts.
void separation_shift(double shift, std::vector<float>& values) {
    const std::vector<float> from = values;
    const auto count = long(from.size());
    const long whole = long(std::floor(shift));
    const float part = float(shift - std::floor(shift));
    for (long k = 0; k < count; ++k) {
        const float a = from[size_t(((k - whole) % count + count) % count)];
        const float b = from[size_t(((k - whole - 1) % count + count) % count)];
        if (part == 0.0F)
            values[size_t(k)] = a;
        else
            values[size_t(k)] = std::isinf(a) || std::isinf(b) ? std::min(a, b) : a + part * (b - a);
    }
}

// Lowers the excess near the sides of bubbles, which move inwards with the distance from brink or face.
// `upwind`: bubbles extend upwind from their faces, not downwind from their brinks. `warm`: rows that the
// longest bubble crosses.
void separation_narrow(const DownwindGrid& course, const DownwindRays& rays, bool upwind, int warm,
                       double convergence, WideVector<float>& excess) {
    const auto count = size_t(rays.count());
    const float ray_spacing = float(course.cell * course.cell / course.spacing()); // metres between rays
    const float inset_per_row = float(convergence * course.spacing());
    // Metres across the wind to the nearest side of a bubble; infinity: no side.
    std::vector<float> side_distance(count), distance_before(count, infinity_f);
    // On periodic ground bubbles enter the first row from the last ones.
    for (int n = course.periodic ? -warm : 0; n < course.rows; ++n) {
        if (course.periodic && n == 0)
            separation_shift((upwind ? -1.0 : 1.0) * course.rows * course.drift, distance_before);
        const int step = n < 0 ? n + course.rows : n;
        float* const row =
            excess.data() + size_t(course.row(upwind ? course.rows - 1 - step : step)) * rays.pitch();
        // An open border is no side: the distance starts at infinity.
        const auto sweep = [&](size_t k, float& side) {
            side = row[k] > 0.0F ? side + ray_spacing : 0.0F;
            return side;
        };
        float side = infinity_f;
        if (course.periodic)
            for (size_t k = 0; k < count; ++k) sweep(k, side);
        for (size_t k = 0; k < count; ++k) side_distance[k] = sweep(k, side);
        side = infinity_f;
        if (course.periodic)
            for (size_t k = count; k-- > 0;) sweep(k, side);
        for (size_t k = count; k-- > 0;) {
            side_distance[k] = std::max(
                std::min({side_distance[k], sweep(k, side), distance_before[k] - inset_per_row}), 0.0F);
            // A bubble that starts in the next row is not narrowed by this one.
            distance_before[k] = row[k] > 0.0F ? side_distance[k] : infinity_f;
            if (n >= 0) row[k] = std::min(row[k], separation_side_slope * side_distance[k]);
        }
    }
}

} // namespace

void Separation::find(const DownwindGrid& course, const SeparationSettings& settings, const float* height,
                      double range, size_t pitch, float* excess) {
    const double longest = 3.0 / (std::sqrt(2.0) * std::min(settings.lee, settings.windward)); // K at m = C
    const double spacing = course.spacing();
    const int warm = int(std::min(std::ceil(longest * range / spacing) + 2.0, double(course.rows)));
    const DownwindRays rays(course, warm, warm);
    const bool narrows = settings.convergence > 0.0;
    rays_.resize(rays.pitch() * size_t(course.rows));
    if (narrows) front_rays_.resize(rays_.size());
    struct Scratch {
        WideVector<float> height, excess;
    };
    tbb::enumerable_thread_specific<Scratch> scratches;
    marram::parallel_for(0, rays.groups(), [&](int group) {
        Scratch& mine = scratches.local();
        const int length = rays.length();
        mine.height.resize(size_t(length) * separation_rays);
        mine.excess.assign(size_t(length) * separation_rays, 0.0F);
        rays.gather(height, pitch, group, mine.height.data());
        separation_sweep(mine.height.data(), mine.excess.data(), length, spacing, 1, settings.steepest,
                         settings.lee);
        if (narrows) {
            rays.store(mine.excess.data(), group, rays_.data());
            mine.excess.assign(size_t(length) * separation_rays, 0.0F);
        }
        separation_sweep(mine.height.data(), mine.excess.data(), length, spacing, -1, settings.steepest,
                         settings.windward);
        rays.store(mine.excess.data(), group, narrows ? front_rays_.data() : rays_.data());
    });
    if (narrows) {
        marram::parallel_for(0, 2, [&](int front) {
            separation_narrow(course, rays, front == 1, warm, settings.convergence,
                              front == 1 ? front_rays_ : rays_);
        });
        for (size_t k = 0; k < rays_.size(); ++k) rays_[k] = std::max(rays_[k], front_rays_[k]);
    }
    rays.scatter(rays_.data(), excess, pitch);
}

} // namespace marram
