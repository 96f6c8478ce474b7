// SPDX-License-Identifier: Apache-2.0
// Compares transforms with their definition, and the shear of single waves with the documented formula.
#include "procedural/air/shear.h"

#include "core/math/hash.h"
#include "core/math/vec.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <complex>
#include <cstdio>
#include <vector>

namespace marram {
namespace {

TEST(DuneTransform, IsTheDefinition) {
    for (const int n : {1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 15, 16, 30, 49, 60, 64, 97, 100, 128, 250, 256}) {
        const Transform transform(n);
        WideVector<WideComplex> data(static_cast<size_t>(n)), scratch(data.size());
        std::vector<std::complex<double>> x(data.size());
        for (int lane : {0, 5}) {
            for (int j = 0; j < n; ++j) {
                x[j] = {unit_double(hash(lane, j)) - 0.5, unit_double(hash(lane + 9, j)) - 0.5};
                data[j].re[lane] = float(x[j].real()), data[j].im[lane] = float(x[j].imag());
            }
        }
        WideVector<WideComplex> input = data;
        const WideComplex* result = transform.run(data.data(), scratch.data());
        double worst = 0.0;
        for (int k = 0; k < n; ++k) {
            std::complex<double> sum = 0.0;
            for (int j = 0; j < n; ++j)
                sum += std::complex<double>(input[j].re[5], input[j].im[5]) *
                       std::polar(1.0, -2.0 * pi * double(j) * k / n);
            worst = std::max(worst, std::abs(sum - std::complex<double>(result[k].re[5], result[k].im[5])));
        }
        EXPECT_LT(worst, 1e-6 * std::sqrt(n) * std::log2(n + 2)) << n;
    }
}

TEST(DuneTransform, GoodSizesHaveSmallFactors) {
    EXPECT_EQ(Transform::good_size(1), 1);
    EXPECT_EQ(Transform::good_size(7), 8);
    EXPECT_EQ(Transform::good_size(2048), 2048);
    EXPECT_EQ(Transform::good_size(2049), 2160);
}

// A sum of waves, evaluated directly.
TEST(DuneShear, WavesHaveTheStressOfTheFormula) {
    struct Size {
        int rows, columns;
    };
    for (const Size size : {Size{64, 48}, {45, 30}, {24, 100}, {128, 128}, {3, 3}, {31, 17}}) {
        const double cell = 0.7;
        const size_t pitch = size_t(Shear::pitch(size.columns));
        Shear shear(size.rows, size.columns, cell);
        for (const double angle : {0.0, 0.4, 2.0, -1.1}) {
            const double wr = std::cos(angle), wc = std::sin(angle);
            std::vector<float> surface(pitch * size_t(size.rows)), along(surface.size()),
                across(surface.size());
            std::vector<double> expected_along(surface.size()), expected_across(surface.size());
            const ShearCoefficients coefficients{3.5, 2.0, 0.8};
            struct Wave {
                int row, column;
                double height, phase;
            };
            for (const Wave wave :
                 {Wave{1, 0, 0.1, 0.3}, {1, 1, 0.05, 1.0}, {-1, 1, 0.07, 2.0}, {0, 1, 0.2, 0.1}}) {
                const double kr = 2 * pi * wave.row / (size.rows * cell),
                             kc = 2 * pi * wave.column / (size.columns * cell);
                const double ka = kr * wr + kc * wc, ks = kc * wr - kr * wc, k = std::hypot(ka, ks);
                const std::complex<double> t(coefficients.in_phase,
                                             coefficients.out_of_phase * (ka > 0 ? 1 : -1));
                for (int a = 0; a < size.rows; ++a)
                    for (int b = 0; b < size.columns; ++b) {
                        const auto h = std::polar(wave.height, kr * a * cell + kc * b * cell + wave.phase);
                        const size_t at = size_t(a) * pitch + size_t(b);
                        surface[at] += float(h.real());
                        expected_along[at] += (t * h * ka * ka / k).real();
                        expected_across[at] += (t * h * ka * ks / k).real() * coefficients.cross;
                    }
            }
            shear.perturbation(coefficients, wr, wc, surface.data(), size.rows, size.columns, along.data(),
                               across.data());
            for (int a = 0; a < size.rows; ++a)
                for (int b = 0; b < size.columns; ++b) {
                    const size_t at = size_t(a) * pitch + size_t(b);
                    ASSERT_NEAR(along[at], expected_along[at], 3e-6) << a << ' ' << b << ' ' << size.rows;
                    ASSERT_NEAR(across[at], expected_across[at], 3e-6);
                }
        }
    }
}

// Half the resolution of 64 rows is 16 waves: what is longer has the stress that it has alone at full
// resolution.
TEST(DuneShear, WavesBelowItsResolutionMakeNone) {
    constexpr int rows = 64, columns = 40;
    const size_t pitch = size_t(Shear::pitch(columns));
    Shear whole(rows, columns, 0.7), half(rows, columns, 0.7, 0.5);
    std::vector<float> slow(pitch * rows), both(slow.size());
    const auto wave = [](int a, int b, int row, int column) {
        return float(0.1 *
                     std::cos(2.0 * pi * (double(row * a) / rows + double(column * b) / columns) + 0.4));
    };
    for (int a = 0; a < rows; ++a)
        for (int b = 0; b < columns; ++b) {
            const size_t at = size_t(a) * pitch + size_t(b);
            slow[at] = wave(a, b, 3, 1) + wave(a, b, 16, -2) + wave(a, b, -9, 15);
            both[at] = slow[at] + wave(a, b, 17, 3) + wave(a, b, -29, 0) + wave(a, b, 32, 5);
        }
    std::vector<float> along(slow.size()), across(slow.size()), half_along(slow.size()),
        half_across(slow.size());
    whole.perturbation({}, 0.8, 0.6, slow.data(), rows, columns, along.data(), across.data());
    half.perturbation({}, 0.8, 0.6, both.data(), rows, columns, half_along.data(), half_across.data());
    for (int a = 0; a < rows; ++a)
        for (int b = 0; b < columns; ++b) {
            const size_t at = size_t(a) * pitch + size_t(b);
            ASSERT_NEAR(half_along[at], along[at], 1e-5);
            ASSERT_NEAR(half_across[at], across[at], 1e-5);
        }
}

TEST(SpeedDuneShear, Printed) {
    for (const int n : {256, 512, 1024, 2048}) {
        Shear shear(n, n, 1.0);
        std::vector<float> surface(size_t(n) * size_t(Shear::pitch(n)), 1.0F), along(surface.size()),
            across(surface.size());
        double best = infinity;
        for (int k = 0; k < 5; ++k) {
            const auto start = std::chrono::steady_clock::now();
            shear.perturbation({}, 1.0, 0.0, surface.data(), n, n, along.data(), across.data());
            best = std::min(best,
                            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
        }
        std::printf("%d: %.2f ms, %.1f ns a cell\n", n, best * 1e3, best * 1e9 / (double(n) * n));
    }
}

} // namespace
} // namespace marram
