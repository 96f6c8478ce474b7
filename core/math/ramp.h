// SPDX-License-Identifier: Apache-2.0
// A ramp: a function of one variable given by knots (position, value), constant before the first and after
// the last.
#pragma once

#include <cassert>
#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

namespace marram {

class Ramp {
  public:
    enum class Interpolation {
        constant,
        linear,
        smooth
    }; // smooth: cubic Hermite with flat ends between two knots

    Ramp() : positions_{0.0}, values_{1.0} {} // 1 everywhere
    // knots = p0 v0 p1 v1 ..., positions strictly ascending, at least one knot (checked where scenes are
    // read).
    Ramp(std::span<const double> knots, std::string_view interpolation)
        : interpolation_(interpolation == "constant" ? Interpolation::constant
                         : interpolation == "smooth" ? Interpolation::smooth
                                                     : Interpolation::linear) {
        assert(knots.size() >= 2 && knots.size() % 2 == 0);
        for (size_t i = 0; i + 1 < knots.size(); i += 2) {
            positions_.push_back(knots[i]);
            values_.push_back(knots[i + 1]);
        }
    }

    double operator()(double x) const {
        if (!(x > positions_.front())) return values_.front();
        for (size_t i = 1; i < positions_.size(); ++i) {
            if (x >= positions_[i]) continue;
            double t = (x - positions_[i - 1]) / (positions_[i] - positions_[i - 1]);
            if (interpolation_ == Interpolation::constant) t = 0.0;
            if (interpolation_ == Interpolation::smooth) t = t * t * (3.0 - 2.0 * t);
            return values_[i - 1] + t * (values_[i] - values_[i - 1]);
        }
        return values_.back();
    }

    std::span<const double> positions() const { return positions_; }
    std::span<const double> values() const { return values_; }
    Interpolation interpolation() const { return interpolation_; }
    bool operator==(const Ramp&) const = default;

  private:
    std::vector<double> positions_, values_;
    Interpolation interpolation_ = Interpolation::linear;
};

} // namespace marram
