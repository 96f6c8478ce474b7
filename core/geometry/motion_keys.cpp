// SPDX-License-Identifier: Apache-2.0
// Between two keys everything moves along a straight line. If the true path is smooth, its distance from that
// line is p'' h^2 / 8: it falls with the square of the time between keys. The paths of meshes are known, so
// their distance is computed. A path that bends sharply, at a key of the animator's or from one shape to the
// next, is not smooth: numbers of keys with a key at the bend fit, others may be far off, and more keys are
// not always better. So numbers are tried one by one.
//
// The distance of strands is measured at a few instants and extrapolated by that law. A strand that a
// collider releases jumps: no number of keys can follow it, so it must not raise the number. A strand is
// taken to jump if twice as many keys leave more than half of its distance; for a smooth path it is a
// quarter. A few very fast strands must not make all others expensive: the tolerance holds for 99 %.
//
// If the tolerance is in pixels, the distance of each CV from the camera decides what is allowed there.
#include "core/geometry/motion_keys.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace marram {

std::vector<double> motion_times(double open, double close, uint32_t keys) {
    if (!(open < close)) return {open};
    std::vector<double> times(keys);
    const auto last = double(keys - 1);
    for (uint32_t i = 0; i < keys; ++i) times[i] = (open * (last - i) + close * i) / last;
    times.front() = open;
    times.back() = close;
    return times;
}

namespace {

// Vertices whose path bends most at the shape of that index: in metres, and enlarged by the view.
std::array<size_t, 2> sharpest_bends(const SceneMesh& mesh, size_t shape, const View& view) {
    const std::vector<MeshShape>& shapes = mesh.object().shapes;
    const auto velocity = [&](size_t from, size_t vertex) -> Vec3d {
        if (from >= shapes.size() - 1) return Vec3d::Zero(); // before the first shape, or after the last
        return (shapes[from + 1].positions[vertex] - shapes[from].positions[vertex]).cast<double>() /
               (shapes[from + 1].frame - shapes[from].frame);
    };
    const Eigen::Affine3d placed = mesh.to_world(shapes[shape].frame);
    std::array<size_t, 2> most{};
    std::array<double, 2> by{};
    for (size_t v = 0; v < shapes[shape].positions.size(); ++v) {
        const double bend = (placed.linear() * (velocity(shape, v) - velocity(shape - 1, v))).norm();
        const double seen = bend * view.enlarged(placed * shapes[shape].positions[v].cast<double>());
        if (bend > by[0]) by[0] = bend, most[0] = v;
        if (seen > by[1]) by[1] = seen, most[1] = v;
    }
    return most;
}

// Points at which the motion error of a mesh is measured. If only a transform moves it, the error is affine
// in the point, so in metres the corners of its box suffice. In pixels, points near the camera count more,
// which can be any vertex; if the mesh deforms, each vertex moves by itself.
class MotionProbes {
  public:
    MotionProbes(const SceneMesh& mesh, const View& view, double open, double close) : mesh_(mesh) {
        const std::vector<Vec3f>& positions = mesh.object().mesh.positions;
        const std::vector<MeshShape>& shapes = mesh.object().shapes;
        constexpr size_t enough = 1024;
        if (!shapes.empty() || view.reference_depth > 0.0)
            for (size_t i = 0; i < positions.size(); i += 1 + positions.size() / enough)
                vertices_.push_back(i);
        for (size_t i = 0; i < shapes.size() && !positions.empty(); ++i)
            if (shapes[i].frame > open && shapes[i].frame < close)
                for (const size_t vertex : sharpest_bends(mesh, i, view)) vertices_.push_back(vertex);
        if (!shapes.empty()) return;
        Eigen::AlignedBox3d box;
        for (const Vec3f& p : positions) box.extend(p.cast<double>());
        for (int i = 0; i < 8 && !box.isEmpty(); ++i)
            corners_.push_back(box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(i)));
    }

    std::vector<Vec3d> at(double frame) const {
        std::vector<Vec3d> points;
        const Eigen::Affine3d placed = mesh_.to_world(frame);
        for (const Vec3d& corner : corners_) points.push_back(placed * corner);
        for (const Vec3d& vertex : mesh_.vertices_at(vertices_, frame)) points.push_back(vertex);
        return points;
    }

  private:
    const SceneMesh& mesh_;
    std::vector<Vec3d> corners_; // object space
    std::vector<size_t> vertices_;
};

double motion_error(const MotionProbes& probes, const std::vector<double>& bends, const View& view,
                    uint32_t keys, double open, double close, double enough) {
    // Fractions of the time between two keys at which to measure. Smooth motion is worst in the middle; no
    // whole number of turns has zero error at all of them.
    constexpr std::array shares = {0.5, 0.25, 0.75, 0.118, 0.382, 0.618, 0.882};
    const std::vector<double> times = motion_times(open, close, keys);
    double worst = 0.0;
    const auto look_between = [&](size_t key, std::span<const double> instants) {
        const double begin = times[key], length = times[key + 1] - begin;
        const std::vector<Vec3d> a = probes.at(begin), b = probes.at(times[key + 1]);
        for (const double instant : instants) {
            const double t = (instant - begin) / length;
            const std::vector<Vec3d> exact = probes.at(instant);
            for (size_t i = 0; i < exact.size(); ++i)
                worst = std::max(worst,
                                 (exact[i] - ((1.0 - t) * a[i] + t * b[i])).norm() * view.enlarged(exact[i]));
        }
    };
    // Bends first: they reject a number of keys soonest.
    for (auto bend = bends.begin(); bend != bends.end();) {
        const auto next = std::ranges::upper_bound(times, *bend);
        const auto end = std::find_if(bend, bends.end(), [&](double b) { return !(b < *next); });
        look_between(size_t(next - times.begin()) - 1, {bend, end});
        if (worst > enough) return worst;
        bend = end;
    }
    for (uint32_t key = 0; key + 1 < keys && !(worst > enough); ++key) {
        std::array<double, shares.size()> instants{};
        for (size_t i = 0; i < shares.size(); ++i)
            instants[i] = times[key] + shares[i] * (times[key + 1] - times[key]);
        look_between(key, instants);
    }
    return worst;
}

} // namespace

double motion_error(const SceneMesh& mesh, const View& view, uint32_t keys, double open, double close,
                    double enough) {
    if (!(open < close && mesh.moves_within(open, close))) return 0.0;
    return motion_error(MotionProbes(mesh, view, open, close), mesh.bends_within(open, close), view, keys,
                        open, close, enough);
}

uint32_t motion_keys_for(const SceneMesh& mesh, double tolerance, const View& view, double open, double close,
                         uint32_t least) {
    if (!(open < close && mesh.moves_within(open, close))) return least;
    const MotionProbes probes(mesh, view, open, close);
    const std::vector<double> bends = mesh.bends_within(open, close);
    for (uint32_t keys = least; keys <= max_motion_keys; ++keys)
        if (motion_error(probes, bends, view, keys, open, close, tolerance) <= tolerance) return keys;
    constexpr uint32_t many = 48; // with fewer, the error of smooth motion is twice that with 64
    uint32_t best = max_motion_keys;
    double error = std::numeric_limits<double>::infinity();
    for (uint32_t keys = max_motion_keys; keys > many && keys >= least; --keys) {
        const double with = motion_error(probes, bends, view, keys, open, close, error);
        if (with < error) error = with, best = keys;
    }
    return best;
}

void StrandMotion::add(std::span<const float* const> samples, size_t cvs, const View& view) {
    const size_t last = samples.size() - 1;
    levels_ = 1;
    while (levels_ < max_levels && size_t{1} << (levels_ + 1) <= last) ++levels_;
    assert(last >= 4 && last == size_t{1} << levels_);
    Gap gap{};
    std::vector<Vec3d> p(samples.size());
    for (size_t k = 0; k < cvs; ++k) {
        for (size_t i = 0; i < p.size(); ++i)
            p[i] = Eigen::Map<const Vec3f>(samples[i] + 4 * k).cast<double>();
        const double large = view.enlarged(p[last / 2]);
        for (size_t level = 0; level < levels_; ++level) {
            const size_t step = last >> level;
            double most = double(gap[level]);
            for (size_t i = 0; i < last; ++i) {
                const size_t key = i / step * step;
                const double t = double(i - key) / double(step);
                most = std::max(most, large * (p[i] - (p[key] + (p[key + step] - p[key]) * t)).norm());
            }
            gap[level] = float(most);
        }
    }
    gaps_.push_back(gap);
}

void StrandMotion::add(const StrandMotion& other) {
    if (other.gaps_.empty()) return;
    levels_ = other.levels_;
    gaps_.insert(gaps_.end(), other.gaps_.begin(), other.gaps_.end());
}

bool StrandMotion::jumps(const Gap& gap, double tolerance) const {
    const float fewer = gap[levels_ - 2], more = gap[levels_ - 1];
    return double(fewer) > tolerance && more > 0.5F * fewer;
}

double StrandMotion::jump_fraction(double tolerance) const {
    const auto count =
        std::count_if(gaps_.begin(), gaps_.end(), [&](const Gap& gap) { return jumps(gap, tolerance); });
    return gaps_.empty() ? 0.0 : double(count) / double(gaps_.size());
}

double StrandMotion::residual_error(uint32_t keys, double tolerance) const {
    size_t level = 0;
    while (level + 1 < levels_ && (size_t{1} << (level + 1)) + 1 <= keys) ++level;
    std::vector<float> gaps;
    for (const Gap& gap : gaps_)
        if (!jumps(gap, tolerance)) gaps.push_back(gap[level]);
    if (gaps.empty()) return 0.0;
    const auto most = gaps.end() - 1 - long(gaps.size() / 100);
    std::nth_element(gaps.begin(), most, gaps.end());
    const double fewer = double(size_t{1} << level) / double(keys - 1);
    return double(*most) * fewer * fewer;
}

uint32_t StrandMotion::keys_for(double tolerance) const {
    uint32_t keys = 2;
    while (keys < max_motion_keys && strand_motion_margin * residual_error(keys, tolerance) > tolerance)
        ++keys;
    return keys;
}

} // namespace marram
