// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/predicates.h"

#include <vector>

namespace marram::oracle {
namespace {

// An exact number as a sum of non-overlapping doubles, smallest first (Shewchuk 1997, GROW-EXPANSION).
using Expansion = std::vector<double>;

void add(Expansion& sum, double x) {
    size_t kept = 0;
    for (double part : sum) {
        const double total = x + part;
        const double virtual_part = total - x;
        const double error = (x - (total - virtual_part)) + (part - virtual_part);
        if (error != 0.0) sum[kept++] = error;
        x = total;
    }
    sum.resize(kept);
    if (x != 0.0 || sum.empty()) sum.push_back(x); // if the leading part cancels, the next one has the sign
}

Expansion difference(double a, double b) {
    Expansion result{a};
    add(result, -b);
    return result;
}

Expansion product(const Expansion& a, const Expansion& b) {
    Expansion result;
    for (double x : a)
        for (double y : b) {
            const double high = x * y;
            add(result, std::fma(x, y, -high));
            add(result, high);
        }
    return result;
}

int exact_sign(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    Expansion row[3][3];
    for (int i = 0; i < 3; ++i) {
        row[0][i] = difference(b[i], a[i]);
        row[1][i] = difference(c[i], a[i]);
        row[2][i] = difference(d[i], a[i]);
    }
    Expansion determinant;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        for (double x : product(row[0][i], product(row[1][j], row[2][k]))) add(determinant, x);
        for (double x : product(row[0][i], product(row[1][k], row[2][j]))) add(determinant, -x);
    }
    const double leading = determinant.back(); // zeros are dropped, except for a sum of 0
    return leading > 0.0 ? 1 : leading < 0.0 ? -1 : 0;
}

} // namespace

int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    constexpr double e = 0x1p-53, error_factor = (7.0 + 56.0 * e) * e;
    const Vec3d x = b - a, y = c - a, z = d - a;
    double determinant = 0.0, magnitude = 0.0;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        determinant += x[i] * (y[j] * z[k] - y[k] * z[j]);
        magnitude += std::abs(x[i]) * (std::abs(y[j] * z[k]) + std::abs(y[k] * z[j]));
    }
    if (determinant > error_factor * magnitude) return 1;
    if (determinant < -error_factor * magnitude) return -1;
    return exact_sign(a, b, c, d);
}

} // namespace marram::oracle
