// SPDX-License-Identifier: Apache-2.0
#include "core/math/ripples.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <complex>
#include <cstdio>
#include <cstring>

namespace marram {
namespace {

constexpr double wavelength = 0.11, repose = 34.0 * degree;
const RippleSettings settings{wavelength, 0.008, repose, 7};

Vec2d heading(double angle) { return {std::cos(angle), std::sin(angle)}; }

// A plane with its gradient (uphill) towards `uphill`.
Vec2d incline(double slope, double uphill) { return std::tan(slope) * heading(uphill); }

Vec3d on_plane(const Vec2d& d, const Vec2d& gradient) { return {d.x(), d.dot(gradient), d.y()}; }

// Howard's law from the balance of forces on a grain at the threshold of motion: |drag D along the wind +
// weight along the surface| = friction. D is found by bisection; the result is the direction of the sum.
Vec3d direction_by_forces(double wind, double slope, double uphill) {
    const Vec2d gradient = incline(slope, uphill);
    const Vec3d w = on_plane(heading(wind), gradient).normalized();
    const Vec3d f = on_plane(-heading(uphill), gradient).normalized();
    const Vec3d weight = std::sin(slope) * f;
    const double friction = std::cos(slope) * std::tan(repose);
    double low = 0.0, high = 10.0;
    for (int n = 0; n < 100; ++n) {
        const double drag = 0.5 * (low + high);
        ((drag * w + weight).norm() < friction ? low : high) = drag;
    }
    return (low * w + weight).normalized();
}

TEST(Ripples, DirectionIsTheBalanceOfForces) {
    for (const double slope : {0.0, 3.0, 12.0, 20.0, 29.0, 33.0})
        for (double wind = 0.0; wind < 360.0; wind += 25.0)
            for (double uphill = 0.0; uphill < 360.0; uphill += 40.0) {
                const Vec2d gradient = incline(slope * degree, uphill * degree);
                const Vec2d d = ripple_direction(3.0 * heading(wind * degree), gradient, repose);
                const Vec3d way = on_plane(d, gradient);
                ASSERT_NEAR(way.norm(), 1.0, 1e-12);
                ASSERT_LT((way - direction_by_forces(wind * degree, slope * degree, uphill * degree)).norm(),
                          1e-9);
                // The law as published, and the deflection is downhill.
                const Vec3d w = on_plane(heading(wind * degree), gradient).normalized();
                const Vec3d f = on_plane(-heading(uphill * degree), gradient).normalized();
                const double sin_beta = w.cross(f).norm(), sin_delta = w.cross(way).norm();
                ASSERT_NEAR(sin_delta, std::tan(slope * degree) * sin_beta / std::tan(repose), 1e-9);
                ASSERT_GE(way.dot(f), w.dot(f) - 1e-12);
            }
    EXPECT_EQ(ripple_direction(Vec2d::Zero(), {0.1, 0.2}, repose), Vec2d::Zero());
}

// Displacements on a square of n by n points with spacing `step`.
std::vector<double> patch(const RippleField& field, int n, double step, const Vec2d& origin,
                          const auto& point_at) {
    std::vector<double> metres(size_t(n) * size_t(n));
    tbb::parallel_for(0, n, [&](int j) {
        std::vector<RipplePoint> row(static_cast<size_t>(n));
        for (int i = 0; i < n; ++i) row[size_t(i)] = point_at(Vec2d(origin + step * Vec2d(i, j)));
        field.displacements(row, std::span(metres).subspan(size_t(j) * size_t(n), size_t(n)));
    });
    return metres;
}

// Angle in radians between `expected` and the direction across the crests in a rectangle of a patch, by the
// structure tensor in the surface.
double crest_angle_error(const std::vector<double>& h, int n, double step, const Vec2d& gradient,
                         const Vec3d& expected, int i0, int j0, int side) {
    const Vec3d normal = Vec3d(-gradient.x(), 1.0, -gradient.y()).normalized(),
                other = normal.cross(expected);
    double aa = 0.0, ab = 0.0, bb = 0.0;
    for (int j = std::max(j0, 1); j < std::min(j0 + side, n - 1); ++j)
        for (int i = std::max(i0, 1); i < std::min(i0 + side, n - 1); ++i) {
            const auto at = [&](int x, int z) { return h[size_t(z) * size_t(n) + size_t(x)]; };
            const double dx = (at(i + 1, j) - at(i - 1, j)) / (2 * step),
                         dz = (at(i, j + 1) - at(i, j - 1)) / (2 * step);
            const double a = dx * expected.x() + dz * expected.z(), b = dx * other.x() + dz * other.z();
            aa += a * a, ab += a * b, bb += b * b;
        }
    return 0.5 * std::atan2(2.0 * ab, aa - bb);
}

TEST(Ripples, MeasuredCrestsFollowTheLaw) {
    const RippleField field(settings);
    constexpr int n = 193;
    constexpr double step = wavelength / 12.0;
    double worst = 0.0, within = 0.0, windows = 0.0;
    for (const double slope : {0.0, 8.0, 15.0, 22.0, 28.0})
        for (const double uphill : {0.0, 50.0, 90.0, 140.0, 250.0}) {
            const Vec2d gradient = incline(slope * degree, uphill * degree);
            const Vec3d law = direction_by_forces(20.0 * degree, slope * degree, uphill * degree);
            const auto h = patch(field, n, step, {uphill, slope}, [&](const Vec2d& at) {
                return RipplePoint{at, heading(20.0 * degree), gradient, 1.0};
            });
            const double off = crest_angle_error(h, n, step, gradient, law, 0, 0, n) / degree;
            EXPECT_LT(std::abs(off), 5.0) << slope << " " << uphill;
            worst = std::max(worst, std::abs(off));
            for (int j = 0; j + 48 < n; j += 48) // windows of four wavelengths
                for (int i = 0; i + 48 < n; i += 48, windows += 1.0)
                    within += std::abs(crest_angle_error(h, n, step, gradient, law, i, j, 48)) < 5.0 * degree;
        }
    std::printf(
        "crests of 16 wavelengths: at most %.2f degrees off the law; of 4: %.1f %% within 5 degrees\n", worst,
        100.0 * within / windows);
    EXPECT_GT(within / windows, 0.85);
}

// The wind turns by two degrees per wavelength along x.
TEST(Ripples, CrestsFollowAWindThatTurns) {
    const RippleField field(settings);
    constexpr int n = 577, side = 96;
    constexpr double step = wavelength / 12.0;
    const auto turn = [](const Vec2d& at) {
        return at.x() / wavelength * degree * 2.0 - 0.5 * at.y() / wavelength * degree;
    };
    const auto h = patch(field, n, step, {0.0, 0.0}, [&](const Vec2d& at) {
        return RipplePoint{at, heading(turn(at)), Vec2d::Zero(), 1.0};
    });
    double worst = 0.0, sum = 0.0, count = 0.0;
    for (int j = 0; j + side < n; j += side)
        for (int i = 0; i + side < n; i += side, count += 1.0) {
            const Vec2d way = heading(turn(step * Vec2d(i + side / 2, j + side / 2)));
            const double off =
                crest_angle_error(h, n, step, Vec2d::Zero(), {way.x(), 0.0, way.y()}, i, j, side) / degree;
            worst = std::max(worst, std::abs(off));
            sum += off;
        }
    std::printf("turning wind: windows of 8 wavelengths %.2f degrees off on the average, %.2f at most\n",
                sum / count, worst);
    EXPECT_LT(worst, 8.0);
    EXPECT_LT(std::abs(sum / count), 1.0);
}

TEST(Ripples, SpacingIsAsAsked) {
    const RippleField field(settings);
    constexpr int samples = 1024, lines = 48, per = 16; // 64 wavelengths, 16 samples each
    for (const double slope : {0.0, 20.0}) {
        const Vec2d gradient = incline(slope * degree, 75.0 * degree);
        const Vec3d way = direction_by_forces(0.0, slope * degree, 75.0 * degree);
        std::vector<RipplePoint> line(samples);
        std::vector<double> h(samples), power(2 * samples / per + 1);
        for (int k = 0; k < lines; ++k) {
            for (int i = 0; i < samples; ++i)
                line[size_t(i)] = {Vec2d(way.x(), way.z()) * (i * wavelength / per) + Vec2d(0.0, 1.3 * k),
                                   heading(0.0), gradient, 1.0};
            field.displacements(line, h);
            for (size_t f = 1; f < power.size(); ++f) {
                std::complex<double> sum = 0.0;
                for (size_t i = 0; i < samples; ++i) {
                    const double hann = 0.5 - 0.5 * std::cos(2.0 * pi * (double(i) + 0.5) / samples);
                    sum += hann * h[i] * std::polar(1.0, -2.0 * pi * double(f * i % samples) / samples);
                }
                power[f] += std::norm(sum);
            }
        }
        const double bins = double(samples) / per; // bin of a wavelength of 1
        double sum = 0.0, mean = 0.0, square = 0.0, smooth = 0.0, peak = 0.0;
        for (size_t f = size_t(0.5 * bins); f <= size_t(1.5 * bins); ++f) {
            const double at = double(f) / bins, around = power[f - 1] + 2.0 * power[f] + power[f + 1];
            sum += power[f], mean += power[f] * at, square += power[f] * at * at;
            if (around > smooth) smooth = around, peak = at;
        }
        mean /= sum;
        const double spread = std::sqrt(square / sum - mean * mean);
        std::printf("slope %.0f: peak at %.3f, mean %.3f, deviation %.3f of the frequency asked for\n", slope,
                    peak, mean, spread);
        EXPECT_NEAR(peak, 1.0, 0.1);
        EXPECT_NEAR(mean, 1.0, 0.05);
        EXPECT_LT(spread, 0.2);
    }
}

TEST(Ripples, SteepSideIsTheLeeAndTheMeanIsNought) {
    const RippleField field(settings);
    constexpr int n = 401;
    constexpr double step = wavelength / 20.0;
    const auto h = patch(field, n, step, {0.0, 0.0}, [&](const Vec2d& at) {
        return RipplePoint{at, heading(0.0), Vec2d::Zero(), 1.0};
    });
    double mean = 0.0, square = 0.0, greatest = 0.0, skew = 0.0, rising = 0.0;
    for (size_t k = 0; k < h.size(); ++k) {
        mean += h[k], square += h[k] * h[k];
        greatest = std::max(greatest, std::abs(h[k]));
        if (k % n + 1 == n) continue;
        const double rise = (h[k + 1] - h[k]) / step;
        skew += rise * rise * rise;
        rising += rise > 0.0;
    }
    const double count = double(h.size());
    std::printf("mean %.4f, deviation %.3f, greatest %.3f of the height; %.0f %% rises downwind\n",
                mean / count / 0.008, std::sqrt(square / count) / 0.008, greatest / 0.008,
                100.0 * rising / count);
    EXPECT_LT(std::abs(mean / count), 0.01 * 0.008);
    EXPECT_LE(greatest, 0.5 * 0.008);
    EXPECT_GT(greatest, 0.45 * 0.008);
    EXPECT_NEAR(std::sqrt(square / count), 0.33 * 0.008, 0.05 * 0.008);
    EXPECT_LT(skew, 0.0);            // the steepest slopes descend downwind
    EXPECT_GT(rising / count, 0.55); // so they take less of the length
}

// Crests along downwind lines, matched from one line to the next. A crest without a match is an end or a
// fork.
TEST(Ripples, HaveJunctionsButLongCrests) {
    const RippleField field(settings);
    constexpr int n = 481;
    constexpr double step = wavelength / 12.0;
    const auto h = patch(field, n, step, {50.0, 0.0}, [&](const Vec2d& at) {
        return RipplePoint{at, heading(0.0), Vec2d::Zero(), 1.0};
    });
    std::vector<std::vector<int>> crests(n);
    for (size_t j = 0; j < n; ++j)
        for (int i = 1; i + 1 < n; ++i) {
            const double* at = &h[j * n + size_t(i)];
            if (at[0] > at[-1] && at[0] >= at[1] && at[0] > 0.0) crests[j].push_back(i);
        }
    double ends = 0.0, all = 0.0;
    const auto lone = [](const std::vector<int>& line, const std::vector<int>& next) {
        int count = 0;
        for (const int i : line) {
            if (i < 12 || i > n - 12) continue;
            int nearest = n;
            for (const int k : next) nearest = std::min(nearest, std::abs(k - i));
            count += nearest > 4;
        }
        return count;
    };
    for (size_t j = 0; j + 1 < n; ++j)
        ends += lone(crests[j], crests[j + 1]) + lone(crests[j + 1], crests[j]),
            all += double(crests[j].size());
    const double area = 40.0 * 40.0, length = all / 12.0; // square wavelengths; wavelengths of crest
    std::printf("%.0f ends of crests: one in %.0f square wavelengths, two in %.0f wavelengths of crest\n",
                ends, area / ends, 2.0 * length / ends);
    EXPECT_GT(ends, area / 200.0);
    EXPECT_LT(ends, area / 20.0);
}

TEST(Ripples, NoneAbove30Degrees) {
    const RippleField field(settings);
    for (uint64_t k = 0; k < 2000; ++k) {
        const double uphill = 2.0 * pi * unit_double(hash(1, k));
        const Vec2d at(10.0 * unit_double(hash(2, k)), 10.0 * unit_double(hash(3, k)));
        const double steep = 30.0 * degree + 59.9 * degree * unit_double(hash(4, k));
        ASSERT_EQ(field.displacement({at, Vec2d::UnitX(), incline(steep + 1e-9, uphill), 1.0}), 0.0);
        ASSERT_EQ(ripples_on_slope(incline(26.0 * degree * unit_double(hash(5, k)), uphill)), 1.0);
    }
    EXPECT_NEAR(ripples_on_slope(incline(28.0 * degree, 1.0)), 0.5, 0.05);
}

TEST(Ripples, SameBitsAloneAndFiniteForAnyPoint) {
    const RippleField field(settings), same(settings), other({wavelength, 0.008, repose, 8});
    std::vector<RipplePoint> points;
    const double values[] = {0.0, -0.0, 1e-300, 1e-9, 0.3, 1.0, -7.5, 1e6, 1e18, -1e300};
    for (uint64_t k = 0; k < 5000; ++k) {
        const auto any = [&](uint64_t what) { return values[hash(hash(what, k), 1) % std::size(values)]; };
        points.push_back({{any(1), any(2)}, {any(3), any(4)}, {any(5), any(6)}, unit_double(hash(7, k))});
        ASSERT_TRUE(ripple_direction(points.back().wind, points.back().gradient, repose).allFinite());
    }
    std::vector<double> metres(points.size());
    field.displacements(points, metres);
    int differ = 0;
    for (size_t k = 0; k < points.size(); ++k) {
        ASSERT_TRUE(std::abs(metres[k]) <= 0.004) << k;
        ASSERT_EQ(same.displacement(points[k]), metres[k]);
        differ += metres[k] != other.displacement(points[k]);
    }
    EXPECT_GT(differ, 100);
}

// Compares slopes with differences of displacements at constant wind, gradient and strength.
TEST(Ripples, SlopesAreThoseOfTheHeights) {
    const RippleField field(settings);
    for (const double incline_of : {0.0, 10.0, 20.0})
        for (const double wind : {0.0, 70.0, 200.0}) {
            const auto point = [&](const Vec2d& at) {
                return RipplePoint{at, heading(wind * degree), incline(incline_of * degree, 1.0), 0.7};
            };
            constexpr double step = wavelength / 400.0;
            double error = 0.0, worst = 0.0, square = 0.0, largest = 0.0, expected = 0.0;
            constexpr int count = 4000;
            for (uint64_t k = 0; k < count; ++k) {
                const Vec2d at(40.0 * unit_double(hash(1, k)), 40.0 * unit_double(hash(2, k)));
                const RipplePoint p = point(at);
                double metres;
                Vec2d slope;
                field.displacements({&p, 1}, {&metres, 1}, {&slope, 1});
                ASSERT_EQ(metres, field.displacement(p));
                const auto rise = [&](const Vec2d& way) {
                    return (field.displacement(point(at + way)) - field.displacement(point(at - way))) /
                           (2.0 * step);
                };
                const Vec2d differences(rise({step, 0.0}), rise({0.0, step}));
                error += (slope - differences).squaredNorm() / count;
                worst = std::max(worst, (slope - differences).norm());
                largest = std::max(largest, slope.norm());
                square += slope.squaredNorm() / count;
                expected = field.slope_variance(p);
            }
            std::printf(
                "[ ripples ] on %2.0f degrees: slopes off by %.3f of their mean size, %.3f of %.3f at "
                "most; mean square %.5f, said %.5f\n",
                incline_of, std::sqrt(error / square), worst, largest, square, expected);
            EXPECT_LT(std::sqrt(error / square), 0.04);
            EXPECT_LT(worst, 0.25 * largest);
            EXPECT_NEAR(square, expected, 0.08 * expected);
        }
}

// The phase advances by the wave vector: on level ground and uphill, where a wavelength along the surface is
// shorter in the map.
TEST(Ripples, WaveIsTheSpacingOnTheGround) {
    const RippleField field(settings);
    const RipplePoint level{{0.0, 0.0}, heading(0.4), Vec2d::Zero(), 1.0};
    EXPECT_NEAR((field.wave(level) - 2.0 * pi / wavelength * heading(0.4)).norm(), 0.0, 1e-9);
    const RipplePoint upwards{{0.0, 0.0}, {1.0, 0.0}, {std::tan(20.0 * degree), 0.0}, 1.0};
    EXPECT_NEAR(field.wave(upwards).x(), 2.0 * pi / (wavelength * std::cos(20.0 * degree)), 1e-9);
}

} // namespace
} // namespace marram
