// SPDX-License-Identifier: Apache-2.0
// The curve of a dune: the drawn points cleaned, pushed, smoothed and resampled. Step 1 of the model in
// dune_shape.cpp.
#include "procedural/terrain/dune/dune_construction.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr double dune_max_coordinate = 1e9; // coordinates, metres
constexpr int dune_max_segments = 4096, dune_max_breaks = 512;
constexpr double dune_corner = 0.93969262078590838; // cos(20 degrees)

DuneLine dune_resampled_evenly(const DuneLine& line, int count) {
    DuneLine out;
    out.closed = line.closed;
    for (int i = 0; i < count; ++i) out.at.push_back(line.point(line.length() * i / count));
    out.at.push_back(line.at.back());
    out.measure();
    return out;
}

// Keeps all points and inserts more, at most `spacing` apart.
DuneLine dune_subdivided(const DuneLine& line, double spacing) {
    DuneLine out;
    out.closed = line.closed;
    for (size_t i = 1; i < line.at.size(); ++i) {
        const int n = std::max(1, int(std::ceil((line.arc[i] - line.arc[i - 1]) / spacing)));
        for (int k = 0; k < n; ++k)
            out.at.push_back(line.at[i - 1] + (double(k) / n) * (line.at[i] - line.at[i - 1]));
    }
    out.at.push_back(line.at.back());
    out.measure();
    return out;
}

Vec2d dune_direction(const Vec2d& from, const Vec2d& to, const Vec2d& otherwise) {
    const double length = (to - from).norm();
    return length > 0.0 ? Vec2d((to - from) / length) : otherwise;
}

void dune_push(DuneLine& line, const Ramp& push, double outer_sign) {
    const size_t n = line.at.size() - 1;
    std::vector<Vec2d> moved(line.at);
    Vec2d last(1.0, 0.0);
    for (size_t i = 0; i <= n; ++i) {
        const size_t before = i > 0 ? i - 1 : line.closed ? n - 1 : 0;
        const size_t after = i < n ? i + 1 : line.closed ? 1 : n;
        const Vec2d in = dune_direction(line.at[before], line.at[i], Vec2d::Zero());
        const Vec2d out = dune_direction(line.at[i], line.at[after], Vec2d::Zero());
        last = dune_direction(Vec2d::Zero(), in + out, last); // a reversal has no normal: keep the last one
        const double u = line.closed && i == n ? 0.0 : line.arc[i] / line.length();
        moved[i] -= outer_sign * push(u) * Vec2d(last.y(), -last.x());
    }
    line.at = std::move(moved);
    if (line.closed) line.at.back() = line.at.front();
    line.measure();
}

// Point k of an evenly sampled line, extended beyond its ends.
Vec2d dune_extended(const DuneLine& line, int k) {
    const int n = int(line.at.size()) - 1;
    if (line.closed) return line.at[size_t(((k % n) + n) % n)];
    const int turns = int(std::floor(double(k) / (2.0 * n)));
    k -= 2 * n * turns;
    const Vec2d first = line.at.front(), last = line.at.back();
    const Vec2d shift = 2.0 * turns * (last - first);
    return k <= n ? Vec2d(line.at[size_t(k)] + shift)
                  : Vec2d(2.0 * last - line.at[size_t(2 * n - k)] + shift);
}

void dune_smooth(DuneLine& line, double deviation) { // deviation in steps of the line
    const int n = int(line.at.size()) - 1, half = int(std::ceil(4.0 * deviation));
    std::vector<double> weights;
    double sum = 0.0;
    for (int k = -half; k <= half; ++k) {
        weights.push_back(std::exp(-0.5 * (k / deviation) * (k / deviation)));
        sum += weights.back();
    }
    std::vector<Vec2d> extended, smooth(line.at);
    for (int k = -half; k <= n + half; ++k) extended.push_back(dune_extended(line, k));
    for (int i = 0; i <= n; ++i) {
        Vec2d mean = Vec2d::Zero(); // of the offsets from the point, so that ends stay bit-identical
        for (int k = 0; k <= 2 * half; ++k)
            mean += weights[size_t(k)] * (extended[size_t(i + k)] - line.at[size_t(i)]);
        smooth[size_t(i)] += mean / sum;
    }
    if (line.closed) smooth.back() = smooth.front();
    if (!line.closed) smooth.front() = line.at.front(), smooth.back() = line.at.back();
    line.at = std::move(smooth);
    line.measure();
}

void dune_add_knots(std::vector<double>& breaks, const Ramp& ramp) {
    for (const double p : ramp.positions())
        if (p > 0.0 && p < 1.0) breaks.push_back(p);
}

// Length fractions of the fixed points of the resampled curve: ends, knots, corners.
std::vector<double> dune_fixed_points(const DuneLine& line, const DuneSettings& s, double spacing) {
    std::vector<double> knots, corners;
    for (const Ramp* ramp : {&s.main_curve_shape, &s.outer_slope_fall_off_along_curve,
                             &s.inner_slope_fall_off_along_curve, &s.crest_pinch})
        dune_add_knots(knots, *ramp);
    for (size_t i = 1; i + 1 < line.at.size(); ++i) {
        const Vec2d in = dune_direction(line.at[i - 1], line.at[i], Vec2d(1.0, 0.0));
        const Vec2d out = dune_direction(line.at[i], line.at[i + 1], in);
        if (in.dot(out) < dune_corner) corners.push_back(line.arc[i] / line.length());
    }
    if (knots.size() > size_t(dune_max_breaks)) knots.clear();
    if (corners.size() > size_t(dune_max_breaks)) corners.clear();
    std::vector<double> all(std::move(knots)), kept = {0.0};
    all.insert(all.end(), corners.begin(), corners.end());
    std::sort(all.begin(), all.end());
    const double nearest =
        std::min(1e-4 * spacing / line.length(), 1e-2); // moves a peak no more than eps does
    for (const double u : all)
        if (u - kept.back() > nearest && 1.0 - u > nearest) kept.push_back(u);
    kept.push_back(1.0);
    return kept;
}

} // namespace

DuneLine dune_cleaned_polyline(std::span<const Vec2d> points, bool closed, Vec2d& origin) {
    DuneLine line;
    Vec2d low(infinity, infinity), high(-infinity, -infinity);
    for (const Vec2d& p : points) {
        if (!(p.cwiseAbs().maxCoeff() <= dune_max_coordinate) || !p.allFinite()) continue;
        low = low.cwiseMin(p), high = high.cwiseMax(p);
        line.at.push_back(p);
    }
    if (line.at.empty()) return line;
    origin = 0.5 * (low + high);
    const double rounding = 1e-12 * (origin.cwiseAbs().maxCoeff() + (high - low).maxCoeff());
    size_t kept = 0;
    for (const Vec2d& p : line.at) {
        const Vec2d here = p - origin;
        if (kept == 0 || (here - line.at[kept - 1]).norm() > rounding) line.at[kept++] = here;
    }
    line.at.resize(kept);
    if (closed)
        while (line.at.size() > 1 && (line.at.back() - line.at.front()).norm() <= rounding)
            line.at.pop_back();
    line.closed = closed && line.at.size() > 2;
    if (line.closed) line.at.push_back(line.at.front());
    line.measure();
    return line;
}

DuneLine dune_pushed_and_smoothed(DuneLine line, const DuneSettings& s, double spacing, double outer_sign) {
    const auto pushes = s.crest_push.values();
    const bool push = std::any_of(pushes.begin(), pushes.end(), [](double v) { return v != 0.0; });
    double deviation = s.smoothing * s.slope_width;
    if (line.closed) deviation = std::min(deviation, line.length() / 16.0);
    if (!(deviation > 0.0)) {
        if (!push) return line;
        line = dune_subdivided(line, std::max(spacing / 4.0, line.length() / 16384.0));
        dune_push(line, s.crest_push, outer_sign);
        return line;
    }
    // Fine enough for the Gaussian and for the result, but not finer than the Gaussian resolves.
    const double step =
        std::max({std::min(spacing / 4.0, deviation / 2.0), deviation / 16.0, line.length() / 32768.0});
    const int count = std::max(32, int(std::ceil(line.length() / step)));
    line = dune_resampled_evenly(line, count);
    if (push) {
        dune_push(line, s.crest_push, outer_sign);
        if (!(line.length() > 0.0)) return line;
        line = dune_resampled_evenly(line, count);
    }
    dune_smooth(line, std::min(deviation / (line.length() / count), 64.0));
    return line;
}

std::vector<double> dune_stations(const DuneLine& line, const DuneSettings& s, double spacing) {
    const std::vector<double> breaks = dune_fixed_points(line, s, spacing);
    const double fewest = line.closed ? 8.0 : 2.0;
    const double share =
        std::clamp(spacing / line.length(), 1.0 / (dune_max_segments - 2 * dune_max_breaks), 1.0 / fewest);
    std::vector<double> stations;
    for (size_t i = 1; i < breaks.size(); ++i) {
        const double step = breaks[i] - breaks[i - 1];
        const int n = std::max(1, int(std::ceil(step / share - 1e-6))); // 1e-6: ignore rounding
        for (int k = 0; k < n; ++k) stations.push_back(breaks[i - 1] + step * k / n);
    }
    stations.push_back(1.0);
    return stations;
}

} // namespace marram
