// SPDX-License-Identifier: Apache-2.0
// Sums that do not depend on the order of their terms, bit for bit: each term is rounded to a multiple of a
// fixed unit, and the multiples are added as integers of 128 bits. So sums of parts, added, are the sum of
// the whole.
//
// A double keeps 53 bits of a running sum, and what it drops depends on what came before. Here a term is
// exact if its last bit is at least the unit: a float (24 bits) from 2^23 units on. Smaller terms are rounded
// to the nearest unit, greater ones than `max_term` count as max_term. 2^16 terms fit.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace marram {

__extension__ typedef __int128 Int128;

template <int unit_exponent>
class ExactSum {
  public:
    static constexpr int max_exponent = 126 - 16 + unit_exponent; // 2^16 terms stay below 2^126 units
    static constexpr double max_term = std::bit_cast<double>(uint64_t(1023 + max_exponent) << 52);

    // The nearest multiple of the unit; NaN counts as 0. Takes about 2 ns.
    static constexpr Int128 to_units(double term) {
        const auto bits = std::bit_cast<uint64_t>(term < -max_term  ? -max_term
                                                  : term > max_term ? max_term
                                                                    : term);
        const uint64_t fraction = (bits & ((uint64_t(1) << 52) - 1)) | uint64_t(1) << 52;
        const int exponent =
            int(bits >> 52 & 0x7ff);     // |term| = fraction 2^(exponent - 1075); 0: far below a unit
        if (exponent == 0x7ff) return 0; // NaN
        const int shift = exponent - 1075 - unit_exponent;
        Int128 size = 0;
        if (shift >= 0)
            size = Int128(fraction) << shift;
        else if (shift >= -53)
            size = Int128((fraction + (uint64_t(1) << (-shift - 1))) >> -shift);
        return bits >> 63 != 0 ? -size : size;
    }
    // The nearest double.
    static double to_double(Int128 units) { return std::ldexp(double(units), unit_exponent); }

    void add(double term) { units_ += to_units(term); }
    double value() const { return to_double(units_); }
    ExactSum& operator+=(const ExactSum& other) {
        units_ += other.units_;
        return *this;
    }
    friend ExactSum operator-(ExactSum a, const ExactSum& b) {
        a.units_ -= b.units_;
        return a;
    }
    bool operator==(const ExactSum&) const = default;

    Int128 units() const { return units_; }
    static ExactSum of_units(Int128 units) {
        ExactSum sum;
        sum.units_ = units;
        return sum;
    }

  private:
    Int128 units_ = 0;
};

} // namespace marram
