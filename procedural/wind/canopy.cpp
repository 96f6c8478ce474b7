// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/canopy.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace marram {
namespace {

constexpr double leaf_drag = 0.2, friction_ratio = 0.3; // c_d, beta
constexpr double attenuation_per_index = leaf_drag / (2.0 * friction_ratio * friction_ratio);
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

// Cells are as wide as the stand is high, so that they hold many strands, but at least a 512th of its extent.
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
    constexpr double most_cells = 512.0;
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
    for (const Sum& sum : sums) {
        indices_.push_back(float(sum.area / (cell_ * cell_)));
        heights_.push_back(float(sum.area > 0.0 ? sum.height / sum.area : mean_height_));
        squares += sum.area * sum.area;
    }
    mean_index_ = area > 0.0 ? squares / area / (cell_ * cell_) : 0.0; // weighted by what it bears
    const double slowing = attenuation_ ? *attenuation_ / attenuation_per_index : mean_index_;
    if (slowing > 0.0) adjustment_ = 3.0 * mean_height_ / (leaf_drag * slowing);
}

size_t Canopy::bytes() const {
    const std::lock_guard lock(mutex_);
    return (indices_.capacity() + heights_.capacity() + known_.size() * indices_.size()) * sizeof(float);
}

// Rows run across the wind's main axis; the air at a sample was `shift` columns further in the row before.
std::shared_ptr<const Canopy::Indices> Canopy::upwind_indices(const Vec3d& direction) const {
    const Vec2d level(direction.x(), direction.z());
    const bool blows = level.norm() > 0.0;
    const double angle = blows ? std::atan2(level.y(), level.x()) : infinity;
    const std::lock_guard lock(mutex_);
    if (const auto found = known_.find(angle); found != known_.end()) return found->second;
    constexpr size_t most_directions = 64;
    if (known_.size() >= most_directions) known_.clear(); // those in use live on
    auto made = std::make_shared<Indices>(indices_);
    if (blows) {
        const Vec2d d = level.normalized();
        const bool along_x = std::abs(d.x()) > std::abs(d.y());
        const double major = along_x ? d.x() : d.y(), shift = (along_x ? d.y() : d.x()) / std::abs(major);
        const int rows = along_x ? nx_ : nz_, columns = along_x ? nz_ : nx_, forward = major > 0.0 ? 1 : -1;
        const auto at = [&](int row, int column) {
            return along_x ? size_t(column) * size_t(nx_) + size_t(row)
                           : size_t(row) * size_t(nx_) + size_t(column);
        };
        const double step = cell_ * std::hypot(1.0, shift) / adjustment_, left = std::exp(-step);
        const double gained = -std::expm1(-step), slope = gained / step - left;
        for (int n = 1; n < rows; ++n) {
            const int row = forward > 0 ? n : rows - 1 - n;
            for (int column = 0; column < columns; ++column) {
                const double from = column - shift;
                const int whole = int(std::floor(from));
                const double part = from - whole;
                const auto before = [&](const Indices& field) {
                    const auto one = [&](int c) {
                        return c < 0 || c >= columns ? 0.0 : double(field[at(row - forward, c)]);
                    };
                    return one(whole) + part * (one(whole + 1) - one(whole));
                };
                const double here = double(indices_[at(row, column)]), there = before(indices_);
                (*made)[at(row, column)] =
                    float(here * gained + (there - here) * slope + left * before(*made));
            }
        }
    }
    known_.emplace(angle, made);
    return made;
}

Canopy::Stand Canopy::stand_at(double x, double z, const Indices& upwind) const {
    Stand stand{0.0, mean_height_};
    const double a = (x - x0_) / cell_, b = (z - z0_) / cell_;
    if (indices_.empty() || !(a >= 0.0 && b >= 0.0 && a < nx_ - 1 && b < nz_ - 1)) return stand;
    const int i = int(a), j = int(b);
    const size_t first = size_t(j) * size_t(nx_) + size_t(i);
    const auto mean = [&](const std::vector<float>& field) {
        const auto row = [&](size_t at) {
            return double(field[at]) + (a - i) * (double(field[at + 1]) - double(field[at]));
        };
        return row(first) + (b - j) * (row(first + size_t(nx_)) - row(first));
    };
    const double index = mean(upwind);
    stand.height = mean(heights_);
    stand.attenuation = attenuation_
                            ? *attenuation_ * std::min(mean_index_ > 0.0 ? index / mean_index_ : 0.0, 1.0)
                            : std::min(attenuation_per_index * index, most_attenuation);
    return stand;
}

Canopy::Stand Canopy::at(double x, double z, const Vec3d& direction) const {
    return stand_at(x, z, *upwind_indices(direction));
}

void Canopy::attenuate(const Vec3d& direction, Strands& strands) const {
    const std::shared_ptr<const Indices> upwind = upwind_indices(direction);
    strands.canopy.resize(size_t(strands.blocks) * size_t(strands.cvs));
    for (int i = 0; i < strands.blocks; ++i) {
        const Wide3f* const rest = strands.rest.data() + size_t(i) * size_t(strands.cvs);
        VDouble attenuation{}, per_height{};
        for (int lane = 0; lane < lanes; ++lane) {
            const Stand stand = stand_at(double(rest[0].x[lane]), double(rest[0].z[lane]), *upwind);
            attenuation[lane] = stand.attenuation;
            per_height[lane] = stand.height > 0.0 ? 1.0 / stand.height : 0.0;
        }
        canopy_profile(rest, strands.root_normal[size_t(i)], attenuation, per_height, strands.cvs,
                       strands.canopy.data() + size_t(i) * size_t(strands.cvs));
    }
}

} // namespace marram
