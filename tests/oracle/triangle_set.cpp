// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/triangle_set.h"

#include <algorithm>
#include <numeric>

namespace marram::oracle {
namespace {

Eigen::AlignedBox3d box_of(const Triangle& t) {
    Eigen::AlignedBox3d box(t.a);
    return box.extend(t.b).extend(t.c);
}

} // namespace

TriangleSet::TriangleSet(std::vector<Triangle> triangles, Search search)
    : triangles_(std::move(triangles)), search_(search) {
    for (const Triangle& t : triangles_) bounds_.extend(box_of(t));
    if (search_ == Search::grid && !triangles_.empty()) build();
}

int TriangleSet::cell_index(int axis, double x) const {
    const double index = std::floor((x - bounds_.min()[axis]) / cell_);
    return int(std::clamp(index, -1.0, double(size_[axis])));
}

void TriangleSet::build() {
    double mean = 0.0;
    for (const Triangle& t : triangles_) mean += box_of(t).sizes().maxCoeff() / double(triangles_.size());
    const double widest = bounds_.sizes().maxCoeff();
    cell_ = std::max(mean, widest * 1e-6); // at most a million layers, before the limit on all cells
    if (!(cell_ > 0.0)) cell_ = 1.0;       // all triangles in one point
    const double most = 8.0 * double(triangles_.size()) + 64.0;
    for (;; cell_ *= 1.25) {
        const Vec3d count = (bounds_.sizes() / cell_).array().floor() + 1.0;
        if (count.prod() > most) continue;
        for (int axis = 0; axis < 3; ++axis) size_[axis] = int(count[axis]);
        break;
    }
    const size_t cells = size_t(size_[0]) * size_t(size_[1]) * size_t(size_[2]);
    auto for_each_cell = [&](const Triangle& t, auto&& act) {
        const Eigen::AlignedBox3d box = box_of(t);
        int low[3], high[3];
        for (int axis = 0; axis < 3; ++axis) {
            low[axis] = std::max(cell_index(axis, box.min()[axis]), 0);
            high[axis] = std::min(cell_index(axis, box.max()[axis]), size_[axis] - 1);
        }
        for (int z = low[2]; z <= high[2]; ++z)
            for (int y = low[1]; y <= high[1]; ++y)
                for (int x = low[0]; x <= high[0]; ++x)
                    act((size_t(z) * size_t(size_[1]) + size_t(y)) * size_t(size_[0]) + size_t(x));
    };
    first_.assign(cells + 1, 0);
    for (const Triangle& t : triangles_) for_each_cell(t, [&](size_t cell) { ++first_[cell + 1]; });
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    listed_.resize(first_.back());
    std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
    for (size_t i = 0; i < triangles_.size(); ++i)
        for_each_cell(triangles_[i], [&](size_t cell) { listed_[next[cell]++] = uint32_t(i); });
}

template <typename Visitor>
void TriangleSet::visit(const Vec3d& p, const Vec3d& q, double reach, Visitor&& visitor) const {
    if (triangles_.empty()) return;
    if (search_ == Search::one_by_one) {
        for (size_t i = 0; i < triangles_.size(); ++i)
            if (visitor(int(i))) return;
        return;
    }
    const double coordinate =
        std::max({bounds_.min().cwiseAbs().maxCoeff(), bounds_.max().cwiseAbs().maxCoeff(),
                  p.cwiseAbs().maxCoeff(), q.cwiseAbs().maxCoeff()});
    reach += 16.0 * std::numeric_limits<double>::epsilon() * coordinate; // a few roundings of a coordinate
    int axis;
    (q - p).cwiseAbs().maxCoeff(&axis);
    const int other[2] = {(axis + 1) % 3, (axis + 2) % 3};
    const int begin = std::max(cell_index(axis, std::min(p[axis], q[axis]) - reach), 0);
    const int end = std::min(cell_index(axis, std::max(p[axis], q[axis]) + reach), size_[axis] - 1);
    for (int layer = begin; layer <= end; ++layer) {
        double from = 0.0, to = 1.0; // the part of the segment within reach of the layer
        const double run = q[axis] - p[axis];
        if (std::abs(run) > reach) { // clipping shorter ones saves little and could divide by 0
            const double low = bounds_.min()[axis] + layer * cell_ - reach, high = low + cell_ + 2.0 * reach;
            const double t0 = (low - p[axis]) / run, t1 = (high - p[axis]) / run;
            constexpr double slack = 1e-12; // the quotients' rounding, relative to the segment
            from = std::clamp(std::min(t0, t1) - slack, 0.0, 1.0);
            to = std::clamp(std::max(t0, t1) + slack, 0.0, 1.0);
        }
        int low[3], high[3];
        low[axis] = high[axis] = layer;
        for (int i : other) {
            const double x0 = p[i] + from * (q[i] - p[i]), x1 = p[i] + to * (q[i] - p[i]);
            low[i] = std::max(cell_index(i, std::min(x0, x1) - reach), 0);
            high[i] = std::min(cell_index(i, std::max(x0, x1) + reach), size_[i] - 1);
        }
        for (int z = low[2]; z <= high[2]; ++z)
            for (int y = low[1]; y <= high[1]; ++y)
                for (int x = low[0]; x <= high[0]; ++x) {
                    const size_t cell =
                        (size_t(z) * size_t(size_[1]) + size_t(y)) * size_t(size_[0]) + size_t(x);
                    for (uint32_t i = first_[cell]; i < first_[cell + 1]; ++i)
                        if (visitor(int(listed_[i]))) return;
                }
    }
}

Nearest TriangleSet::nearest(const Vec3d& p, const Vec3d& q, double limit, const Filter& filter) const {
    Nearest best;
    best.closest.distance = no_limit;
    if (triangles_.empty()) return best;
    Eigen::AlignedBox3d box(p);
    box.extend(q);
    const double gap =
        bounds_.exteriorDistance(box.center()); // of the box's centre: a starting value, not a bound
    const double everything = gap + bounds_.diagonal().norm() + box.diagonal().norm();
    double reach =
        search_ == Search::one_by_one ? everything : std::max(cell_, gap - 0.5 * box.diagonal().norm());
    for (;; reach *= 2.0) { // done as soon as the best distance is within the reach
        reach = std::min(reach, limit);
        visit(p, q, reach, [&](int i) {
            if (i == best.triangle) return false;
            const Triangle& t = triangles_[size_t(i)];
            const double bound = std::min(best.closest.distance, limit);
            if ((box_of(t).exteriorDistance(box)) * (1.0 - 1e-12) > bound) return false;
            const Closest found = closest(p, q, t);
            const bool nearer = found.distance < best.closest.distance ||
                                (found.distance == best.closest.distance && i < best.triangle);
            if (found.distance <= limit && nearer && (!filter || filter(i))) best = {found, i};
            return false;
        });
        if (best.closest.distance <= reach || reach >= limit || reach > everything) return best;
    }
}

std::vector<int> TriangleSet::within(const Vec3d& p, const Vec3d& q, double reach) const {
    std::vector<int> result;
    visit(p, q, reach, [&](int i) {
        result.push_back(i);
        return false;
    });
    std::sort(result.begin(), result.end());
    result.erase(std::unique(result.begin(), result.end()), result.end());
    std::erase_if(result, [&](int i) { return closest(p, q, triangles_[size_t(i)]).distance > reach; });
    return result;
}

std::vector<Hit> TriangleSet::crossings(const Vec3d& p, const Vec3d& q) const {
    std::vector<int> crossed;
    visit(p, q, 0.0, [&](int i) {
        if (crosses(p, q, triangles_[size_t(i)])) crossed.push_back(i);
        return false;
    });
    std::sort(crossed.begin(), crossed.end());
    crossed.erase(std::unique(crossed.begin(), crossed.end()), crossed.end());
    std::vector<Hit> hits;
    for (int i : crossed) hits.push_back({i, crossing(p, q, triangles_[size_t(i)])});
    std::stable_sort(hits.begin(), hits.end(),
                     [](const Hit& a, const Hit& b) { return a.crossing.parameter < b.crossing.parameter; });
    return hits;
}

bool TriangleSet::any_crossing(const Vec3d& p, const Vec3d& q) const {
    bool found = false;
    visit(p, q, 0.0, [&](int i) { return found = crosses(p, q, triangles_[size_t(i)]); });
    return found;
}

} // namespace marram::oracle
