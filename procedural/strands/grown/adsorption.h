// SPDX-License-Identifier: Apache-2.0
// Random sequential adsorption of discs: how many attempts it takes to place some on a surface, each at
// random and kept if it overlaps none that was kept before.
//
// With coverage c = (number per unit area) * pi r^2 / 4, r the least distance, and attempts t in the same
// unit,
//     dc/dt = phi(c),   phi(c) = 1 - 4 c + 6 sqrt(3)/pi c^2 + (40/(sqrt(3) pi) - 176/(3 pi^2)) c^3 + O(c^4)
// (P. Schaaf and J. Talbot, "Surface exclusion effects in adsorption processes", J. Chem. Phys. 91, 1989),
// accurate to 1 % up to a coverage of 0.2.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace marram {

// Attempts per kept disc up to coverage c: the integral of dc / phi(c), divided by c.
inline double attempts_per_disc(double coverage) {
    if (coverage <= 0.0) return 1.0;
    constexpr int steps = 256;
    constexpr double b2 = 3.30797, b3 = 1.40688;
    double attempts = 0.0;
    for (int i = 0; i < steps; ++i) {
        const double c = coverage * (i + 0.5) / steps;
        attempts += 1.0 / (1.0 - 4.0 * c + b2 * c * c + b3 * c * c * c);
    }
    return attempts / steps;
}

// The order in which discs are kept: the share of all, by the share of all attempts that were made. Linear
// between equal steps of the coverage.
class KeptByAttempts {
  public:
    // coverage: at the end; 0: every attempt is kept.
    explicit KeptByAttempts(double coverage) {
        for (int i = 0; i <= steps; ++i) {
            const double c = coverage * i / steps;
            attempts_[size_t(i)] = i * attempts_per_disc(c);
        }
        for (double& a : attempts_) a /= attempts_.back();
    }
    double attempts(double kept) const {
        const double at = std::clamp(kept, 0.0, 1.0) * steps;
        const auto i = std::min(size_t(at), size_t(steps - 1));
        return attempts_[i] + (at - double(i)) * (attempts_[i + 1] - attempts_[i]);
    }
    double kept(double attempts) const {
        const auto above = std::upper_bound(attempts_.begin() + 1, attempts_.end() - 1, attempts);
        const auto i = size_t(above - attempts_.begin()) - 1;
        return (double(i) + (attempts - attempts_[i]) / (attempts_[i + 1] - attempts_[i])) / steps;
    }

  private:
    static constexpr int steps = 256;
    std::array<double, steps + 1> attempts_;
};

} // namespace marram
