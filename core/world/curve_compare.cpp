// SPDX-License-Identifier: Apache-2.0
#include "core/world/curve_compare.h"

#include "core/geometry/time_step.h"
#include "core/plugin/embree.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

namespace marram {
namespace {

// CV k of a curve at a motion sample; the phantom vertices at both ends are skipped.
Vec3d cv(const CurveGeometry& curves, size_t time, uint64_t curve, uint32_t k) {
    const float* p = curves.vertices[time] + 4 * (curves.layout().first_vertex(curve) + 1 + k);
    return {double(p[0]), double(p[1]), double(p[2])};
}

double length_of(const CurveGeometry& curves, uint64_t curve) {
    double length = 0.0;
    for (uint32_t k = 1; k < curves.layout().cvs(curve); ++k)
        length += (cv(curves, 0, curve, k) - cv(curves, 0, curve, k - 1)).norm();
    return length;
}

// The point at fraction u of the CVs, along the CV polygon.
Vec3d on_polygon(const CurveGeometry& curves, uint64_t curve, double u) {
    const uint32_t cvs = curves.layout().cvs(curve);
    const double at = u * double(cvs - 1);
    const uint32_t k = std::min(uint32_t(at), cvs - 2);
    const double t = at - double(k);
    return (1.0 - t) * cv(curves, 0, curve, k) + t * cv(curves, 0, curve, k + 1);
}

// CV k at fraction s of the shutter, linear between the motion samples that it is traced with.
Vec3d in_motion(const CurveGeometry& curves, double s, uint64_t curve, uint32_t k) {
    const bool end_keys_only = !curves.end_keys_only.empty() && curves.end_keys_only[curve] != 0;
    const KeyPair keys = keys_around(curves.vertices.size(), s, end_keys_only);
    return (1.0 - keys.within) * cv(curves, keys.before, curve, k) +
           keys.within * cv(curves, keys.after, curve, k);
}

// Largest distance between CVs at the first motion sample.
double farthest_cv(const CurveGeometry& a, const CurveGeometry& b, uint64_t c) {
    const bool a_is_finer = a.layout().cvs(c) > b.layout().cvs(c);
    const CurveGeometry &fine = a_is_finer ? a : b, &coarse = a_is_finer ? b : a;
    const uint32_t cvs = fine.layout().cvs(c);
    double largest = 0.0;
    for (uint32_t k = 0; k < cvs; ++k) {
        const Vec3d there = cvs == coarse.layout().cvs(c)
                                ? cv(coarse, 0, c, k)
                                : on_polygon(coarse, c, double(k) / double(cvs - 1));
        largest = std::max(largest, (cv(fine, 0, c, k) - there).norm());
    }
    return largest;
}

// Statistics of distance(mine, reference, curve), the largest distance of each strand.
template <typename Distance>
CurveDistance gap(const World& mine, const World& reference, double limit, Distance&& distance) {
    if (mine.curves.size() != reference.curves.size())
        throw std::invalid_argument("not the same curves are compared");
    std::vector<double> largest;
    for (size_t g = 0; g < mine.curves.size(); ++g) {
        const CurveGeometry &a = mine.curves[g], &b = reference.curves[g];
        if (a.curve_count != b.curve_count) throw std::invalid_argument("not the same strands are compared");
        const size_t first = largest.size();
        largest.resize(first + a.curve_count);
        tbb::parallel_for(uint64_t(0), a.curve_count,
                          [&](uint64_t c) { largest[first + c] = distance(a, b, c); });
    }
    if (largest.empty()) return {};
    CurveDistance gap;
    gap.strands = largest.size();
    double squares = 0.0;
    for (const double d : largest) squares += d * d;
    gap.beyond = double(std::count_if(largest.begin(), largest.end(), [&](double d) { return d > limit; })) /
                 double(largest.size());
    gap.rms = std::sqrt(squares / double(largest.size()));
    const auto most = largest.end() - 1 - long(largest.size() / 100); // the worst if fewer than 100 strands
    std::nth_element(largest.begin(), most, largest.end());
    gap.most = *most;
    gap.worst = *std::max_element(most, largest.end());
    return gap;
}

bool hits_mesh(const World& world, const Vec3d& from, const Vec3d& to, double skipped) {
    const Vec3d way = to - from;
    if (!(way.squaredNorm() > 0.0)) return false;
    RTCRay ray;
    ray.org_x = float(from.x());
    ray.org_y = float(from.y());
    ray.org_z = float(from.z());
    ray.dir_x = float(way.x());
    ray.dir_y = float(way.y());
    ray.dir_z = float(way.z());
    ray.tnear = float(skipped);
    ray.tfar = 1.0F;
    ray.time = 0.0F;
    ray.mask = ~0U;
    ray.id = 0;
    ray.flags = 0;
    marram_occluded1(world.colliders.get(), &ray);
    return ray.tfar < 0.0F;
}

} // namespace

CurveDistance relative_cv_distance(const World& mine, const World& reference) {
    return gap(mine, reference, std::numeric_limits<double>::infinity(),
               [](const CurveGeometry& a, const CurveGeometry& b, uint64_t c) {
                   const double length = length_of(b, c);
                   return length > 0.0 ? farthest_cv(a, b, c) / length : 0.0;
               });
}

CurveDistance cv_distance(const World& mine, const World& reference, double limit) {
    return gap(mine, reference, limit, farthest_cv);
}

CurveDistance motion_cv_distance(const World& mine, const World& reference, const View& view, double limit) {
    return gap(mine, reference, limit, [&](const CurveGeometry& a, const CurveGeometry& b, uint64_t c) {
        double largest = 0.0;
        for (size_t time = 0; time < b.vertices.size(); ++time) {
            const double s = b.vertices.size() > 1 ? double(time) / double(b.vertices.size() - 1) : 0.0;
            for (uint32_t k = 0; k < a.layout().cvs(c); ++k)
                largest = std::max(largest, view.enlarged(cv(b, time, c, k)) *
                                                (in_motion(a, s, c, k) - cv(b, time, c, k)).norm());
        }
        return largest;
    });
}

uint64_t count_crossing_strands(const World& world) {
    if (world.meshes.empty()) return 0;
    uint64_t count = 0;
    for (const CurveGeometry& curves : world.curves)
        count += tbb::parallel_deterministic_reduce(
            tbb::blocked_range<uint64_t>(0, curves.curve_count, 256), uint64_t(0),
            [&](const auto& range, uint64_t part) {
                for (uint64_t c = range.begin(); c < range.end(); ++c)
                    for (uint32_t k = 0; k + 1 < curves.layout().cvs(c); ++k)
                        if (hits_mesh(world, cv(curves, 0, c, k), cv(curves, 0, c, k + 1),
                                      k == 0 ? 1e-3 : 0.0)) {
                            ++part;
                            break;
                        }
                return part;
            },
            std::plus<>());
    return count;
}

} // namespace marram
