// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/canopy.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr double leaf_drag = 0.2, friction_ratio = 0.3; // c_d, beta
constexpr double attenuation_per_index = leaf_drag / (2.0 * friction_ratio * friction_ratio);
constexpr int upwind_points = 8;

// Distances in l at which the upwind mean is sampled: the middles of eight equal parts of the weight exp(-s).
std::array<double, upwind_points> upwind_distances() {
    std::array<double, upwind_points> distances{};
    for (int k = 0; k < upwind_points; ++k) distances[size_t(k)] = -std::log(1.0 - (k + 0.5) / upwind_points);
    return distances;
}

MARRAM_HOT void canopy_profile(const Wide3f* rest, const Wide3d& normal, const VDouble& attenuation,
                               const VDouble& per_height, int cvs, VFloat* out) {
    const Wide3d root = to_double(rest[0]);
    for (int k = 0; k < cvs; ++k) {
        const VDouble z = dot(to_double(rest[k]) - root, normal);
        const VDouble below = 1.0 - vmin(vmax(z * per_height, 0.0), 1.0);
        out[k] = to_float(vexp(-(attenuation * below)));
    }
}

} // namespace

// Cells are as wide as the stand is high, so that they hold many strands, but at least a 2048th of its extent.
Canopy::Canopy(const std::vector<CanopyStrand>& strands, std::optional<double> attenuation)
    : attenuation_(attenuation) {
    if (strands.empty()) return;
    Vec2d lower = Vec2d::Constant(infinity), upper = -lower;
    double area = 0.0, weighted_height = 0.0;
    for (const CanopyStrand& strand : strands) {
        lower = lower.cwiseMin(Vec2d(strand.x, strand.z));
        upper = upper.cwiseMax(Vec2d(strand.x, strand.z));
        area += strand.area;
        weighted_height += strand.area * strand.height;
    }
    mean_height_ = area > 0.0 ? weighted_height / area : 0.0;
    const Vec2d extent = upper - lower;
    constexpr double most_cells = 2048.0;
    cell_ = std::max(mean_height_, extent.maxCoeff() / most_cells);
    if (!(cell_ > 0.0)) return;
    // A border of two cells, in which P_0 falls to 0.
    x0_ = lower.x() - 1.5 * cell_, z0_ = lower.y() - 1.5 * cell_;
    nx_ = int(extent.x() / cell_) + 5, nz_ = int(extent.y() / cell_) + 5;
    struct Sum {
        double area = 0.0, height = 0.0;
    };
    std::vector<Sum> sums(size_t(nx_) * size_t(nz_));
    for (const CanopyStrand& strand : strands) { // shared between the four samples around it
        const double x = (strand.x - x0_) / cell_, z = (strand.z - z0_) / cell_;
        const int i = int(x), j = int(z);
        const double u = x - i, v = z - j;
        for (const auto& [di, dj, weight] :
             {std::tuple(0, 0, (1.0 - u) * (1.0 - v)), std::tuple(1, 0, u * (1.0 - v)),
              std::tuple(0, 1, (1.0 - u) * v), std::tuple(1, 1, u * v)}) {
            Sum& sum = sums[size_t(j + dj) * size_t(nx_) + size_t(i + di)];
            sum.area += weight * strand.area;
            sum.height += weight * strand.area * strand.height;
        }
    }
    double squares = 0.0;
    samples_.resize(sums.size());
    for (size_t k = 0; k < sums.size(); ++k) {
        const Sum& sum = sums[k];
        samples_[k] = {float(sum.area / (cell_ * cell_)),
                       float(sum.area > 0.0 ? sum.height / sum.area : mean_height_)};
        squares += sum.area * sum.area;
    }
    mean_index_ =
        area > 0.0 ? squares / area / (cell_ * cell_) : 0.0; // of ground that bears plants: weighted by them
    if (mean_index_ > 0.0) adjustment_ = 3.0 * mean_height_ / (leaf_drag * mean_index_);
}

std::array<double, 2> Canopy::sample(double x, double z) const {
    const double a = (x - x0_) / cell_, b = (z - z0_) / cell_;
    if (!(a >= 0.0 && b >= 0.0 && a < nx_ - 1 && b < nz_ - 1)) return {0.0, mean_height_};
    const int i = int(a), j = int(b);
    const double u = a - i, v = b - j;
    const auto* const first = samples_.data() + size_t(j) * size_t(nx_) + size_t(i);
    const auto* const second = first + nx_;
    std::array<double, 2> out{};
    for (size_t c = 0; c < 2; ++c)
        out[c] = (1.0 - v) * ((1.0 - u) * double(first[0][c]) + u * double(first[1][c])) +
                 v * ((1.0 - u) * double(second[0][c]) + u * double(second[1][c]));
    return out;
}

Canopy::Stand Canopy::at(double x, double z, const Vec3d& direction) const {
    static const std::array<double, upwind_points> distances = upwind_distances();
    const Vec2d level(direction.x(), direction.z());
    const Vec2d step = level.norm() > 0.0 ? Vec2d(level.normalized() * adjustment_) : Vec2d(0.0, 0.0);
    double index = 0.0;
    for (const double s : distances) index += sample(x - step.x() * s, z - step.y() * s)[0] / upwind_points;
    Stand stand;
    stand.height = sample(x, z)[1];
    stand.attenuation = attenuation_
                            ? *attenuation_ * std::min(mean_index_ > 0.0 ? index / mean_index_ : 0.0, 1.0)
                            : std::min(attenuation_per_index * index, most_attenuation);
    return stand;
}

void Canopy::attenuate(const Vec3d& direction, Strands& strands) const {
    strands.canopy.resize(size_t(strands.blocks) * size_t(strands.cvs));
    for (int i = 0; i < strands.blocks; ++i) {
        const Wide3f* const rest = strands.rest.data() + size_t(i) * size_t(strands.cvs);
        VDouble attenuation{}, per_height{};
        for (int lane = 0; lane < lanes; ++lane) {
            const Stand stand = at(double(rest[0].x[lane]), double(rest[0].z[lane]), direction);
            attenuation[lane] = stand.attenuation;
            per_height[lane] = stand.height > 0.0 ? 1.0 / stand.height : 0.0;
        }
        canopy_profile(rest, strands.root_normal[size_t(i)], attenuation, per_height, strands.cvs,
                       strands.canopy.data() + size_t(i) * size_t(strands.cvs));
    }
}

} // namespace marram
