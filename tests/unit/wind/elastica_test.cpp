// SPDX-License-Identifier: Apache-2.0
// Compares the elastica with beam theory and with itself on fine chains, and checks its promises.
#include "procedural/wind/blade/elastica.h"
#include "procedural/wind/strands.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cfloat>
#include <cstdio>
#include <cstring>

using namespace marram;

namespace {

// One block of blades.
struct Blades {
    WideVector<Wide3f> rest, normal, pose, pose_normal, wind;
    WideVector<VFloat> rigidity, drag, weight;
    ElasticaScratch scratch;
    int cvs;

    explicit Blades(int n)
        : rest(size_t(n)), normal(size_t(n)), pose(size_t(n)), pose_normal(size_t(n)), wind(size_t(n)),
          rigidity(size_t(n)), drag(size_t(n)), weight(size_t(n)), cvs(n) {}

    int solve(int pieces, double tolerance = 1e-3, bool hangs = false) {
        return std::popcount(
            elastica({cvs, pieces, rest.data(), normal.data(), pose.data(), pose_normal.data(),
                      rigidity.data(), drag.data(), weight.data(), wind.data(), tolerance, hangs},
                     scratch));
    }
};

Vec3d at(const WideVector<Wide3f>& values, int k, int lane) {
    const Wide3f& v = values[size_t(k)];
    return {double(v.x[lane]), double(v.y[lane]), double(v.z[lane])};
}

double length_of(const Blades& blades, int lane) {
    double length = 0.0;
    for (int k = 1; k < blades.cvs; ++k)
        length += (at(blades.rest, k, lane) - at(blades.rest, k - 1, lane)).norm();
    return length;
}

// An upright blade of length and rigidity 1 in a wind of 1 m/s along x.
void set_upright(Blades& blades, int lane, double drag, double weight = 0.0) {
    for (int k = 0; k < blades.cvs; ++k) {
        set_lane(blades.rest[size_t(k)], lane, Vec3d(0.0, k / (blades.cvs - 1.0), 0.0));
        set_lane(blades.normal[size_t(k)], lane, Vec3d(0.0, 0.0, 1.0));
        set_lane(blades.wind[size_t(k)], lane, Vec3d(1.0, 0.0, 0.0));
        blades.rigidity[size_t(k)][lane] = 1.0f;
        blades.drag[size_t(k)][lane] = float(drag);
        blades.weight[size_t(k)][lane] = float(weight);
    }
}

// A random tapered blade that bends by `curl` radians at rest. `ca`, `b`: load length^3 / rigidity at the
// root.
void set_random(Blades& blades, int lane, uint64_t seed, double ca, double b, double curl) {
    const auto draw = [&](uint64_t i) { return 2.0 * unit_double(hash(seed, i)) - 1.0; };
    const auto unit = [&](uint64_t i, double lift) -> Vec3d {
        return (Vec3d(draw(i), draw(i + 1), draw(i + 2)) + Vec3d(0.0, lift, 0.0)).normalized();
    };
    const int n = blades.cvs;
    const double length = 0.5 + 0.4 * draw(0), rigidity = std::pow(10.0, -4.0 + draw(1)),
                 speed = 11.0 + 10.0 * draw(2);
    const double unit_load = rigidity / (length * length * length);
    const Vec3d wind = speed * unit(3, 0.0), curl_axis = unit(6, 0.0);
    const Eigen::AngleAxisd turn(curl / (n - 1), curl_axis);
    Vec3d tangent = unit(9, 2.0), point(draw(12), draw(13), draw(14));
    for (int k = 0; k < n; ++k) {
        const double u = k / (n - 1.0), middle = (k + 0.5) / (n - 1.0);
        const size_t i = size_t(k);
        set_lane(blades.rest[i], lane, point);
        set_lane(blades.normal[i], lane, tangent.unitOrthogonal());
        set_lane(blades.wind[i], lane, wind * (0.6 + 0.4 * middle));
        blades.rigidity[i][lane] = float(rigidity * (1.0 - 0.6 * u));
        blades.drag[i][lane] = float(ca * unit_load / (speed * speed) * (1.0 - 0.4 * middle));
        blades.weight[i][lane] = float(b * unit_load * (1.0 - 0.4 * middle));
        point += tangent * (length / (n - 1));
        tangent = turn * tangent;
    }
}

double max_distance(const Blades& blades, const WideVector<Wide3f>& other, int lane) {
    double distance = 0.0;
    for (int k = 0; k < blades.cvs; ++k)
        distance = std::max(distance, (at(blades.pose, k, lane) - at(other, k, lane)).norm());
    return distance / length_of(blades, lane);
}

bool all_finite(const Blades& blades) {
    for (int k = 0; k < blades.cvs; ++k)
        for (int lane = 0; lane < lanes; ++lane)
            if (!at(blades.pose, k, lane).allFinite() || !at(blades.pose_normal, k, lane).allFinite())
                return false;
    return true;
}

// The change of a segment's length, relative to what rounding both ends to float may cause.
double length_error(const Blades& blades, int lane) {
    double worst = 0.0;
    for (int k = 1; k < blades.cvs; ++k) {
        const Vec3d a = at(blades.pose, k - 1, lane), b = at(blades.pose, k, lane);
        const double before = (at(blades.rest, k, lane) - at(blades.rest, k - 1, lane)).norm();
        const float largest = float(std::max(a.cwiseAbs().maxCoeff(), b.cwiseAbs().maxCoeff()));
        const double ulp = double(std::nextafter(largest, FLT_MAX)) - double(largest);
        worst = std::max(worst, std::abs((b - a).norm() - before) / (1e-13 * before + 1.74 * ulp));
    }
    return worst;
}

} // namespace

TEST(Elastica, NoLoadsKeepTheRestBitForBit) {
    Blades blades(9);
    for (int lane = 0; lane < lanes; ++lane) set_random(blades, lane, uint64_t(lane), 10.0, 3.0, 2.0);
    for (int k = 0; k < 9; ++k) // odd lanes have no loads: no wind, or no drag
        for (int lane = 1; lane < lanes; lane += 2) {
            blades.weight[size_t(k)][lane] = 0.0f;
            if (lane % 4 == 1)
                set_lane(blades.wind[size_t(k)], lane, Vec3d(0.0, 0.0, 0.0));
            else
                blades.drag[size_t(k)][lane] = 0.0f;
        }
    for (const int pieces : {1, 4}) {
        EXPECT_EQ(0, blades.solve(pieces));
        for (int lane = 0; lane < lanes; ++lane)
            for (int k = 1; k < 9; ++k) {
                const bool same = at(blades.rest, k, lane) == at(blades.pose, k, lane) &&
                                  at(blades.normal, k, lane) == at(blades.pose_normal, k, lane);
                EXPECT_EQ(lane % 2 == 1, same);
            }
    }
}

// And small loads keep it to float rounding.
TEST(Elastica, TheRestIsTheLimitOfSmallLoads) {
    Blades blades(9);
    for (int lane = 0; lane < lanes; ++lane) set_random(blades, lane, uint64_t(lane), 1e-9, 1e-9, 2.0);
    for (const int pieces : {1, 4}) {
        EXPECT_EQ(0, blades.solve(pieces));
        for (int lane = 0; lane < lanes; ++lane) EXPECT_LT(max_distance(blades, blades.rest, lane), 2e-6);
    }
}

TEST(Elastica, SmallLoadsBendACantilever) {
    Blades blades(8);
    for (int lane = 0; lane < lanes; ++lane) set_upright(blades, lane, 1e-3 * (lane + 1));
    double before = 0.0;
    for (const int pieces : {1, 2, 4, 8}) {
        EXPECT_EQ(0, blades.solve(pieces, 1e-5));
        const double error = at(blades.pose, 7, 0).x() / (1e-3 / 8.0) - 1.0;
        std::printf("%d pieces: tip of a cantilever off by %.2g of its displacement\n", pieces, error);
        EXPECT_LT(std::abs(error), 0.01 / (pieces * pieces) + 5e-4); // floats: 1e-7 of the length
        if (pieces == 2) {
            EXPECT_LT(std::abs(error), 0.35 * before);
        }
        before = std::abs(error);
        EXPECT_NEAR(at(blades.pose, 7, 7).x(), 8.0 * at(blades.pose, 7, 0).x(), 1e-6);
    }
}

// With gravity alone, and as a dead load: the clamped heavy elastica. An upright blade is stable to
// B = 7.837 (Greenhill 1881) and hangs below itself far beyond.
TEST(Elastica, HeavyBladesStandUpToGreenhillsLimit) {
    Blades blades(8);
    const double weights[lanes] = {2.0, 6.0, 7.5, 8.2, 9.0, 12.0, 30.0, 50.0};
    for (int lane = 0; lane < lanes; ++lane) set_upright(blades, lane, 1e-4, weights[lane]);
    EXPECT_EQ(0, blades.solve(8, 1e-5));
    for (int lane = 0; lane < lanes; ++lane) {
        std::printf("B = %g: tip at height %.4f\n", weights[lane], at(blades.pose, 7, lane).y());
        if (lane < 3)
            EXPECT_GT(at(blades.pose, 7, lane).y(), 0.99);
        else
            EXPECT_LT(at(blades.pose, 7, lane).y(), 0.95);
    }
    EXPECT_LT(at(blades.pose, 7, 7).y(), -0.3);
}

// M. Luhar and H. Nepf, Limnol. Oceanogr. 56, 2011: an upright blade without weight. The angle is that of the
// tip's tangent from the vertical.
TEST(Elastica, HasTheAnglesOfLuharAndNepf) {
    const std::pair<double, double> cases[] = {{1.0, 9.31}, {10.0, 47.09}, {100.0, 76.71}};
    for (const auto& [ca, degrees] : cases) {
        Blades blades(65);
        for (int lane = 0; lane < lanes; ++lane) set_upright(blades, lane, ca);
        blades.solve(8, 1e-5);
        const Vec3d tip = at(blades.pose, 64, 0) - at(blades.pose, 63, 0);
        const double angle = std::atan2(tip.x(), tip.y()) / degree;
        std::printf("Ca = %g: tip at %.2f degrees (%.2f)\n", ca, angle, degrees);
        EXPECT_NEAR(angle, degrees, 0.05);
    }
}

// A blade that sags from its shape without weight, and then bends in the wind, is one that hangs as it
// sagged.
TEST(Elastica, HangsAsItSagged) {
    double worst = 0.0, moved = 0.0;
    for (uint64_t seed = 0; seed < 40; ++seed) {
        Blades natural(16);
        for (int lane = 0; lane < lanes; ++lane)
            set_random(natural, lane, seed * lanes + uint64_t(lane), 5.0, 2.0, 0.5);
        Blades hanging = natural;
        natural.solve(4, 1e-5);
        Blades still = hanging;
        for (Wide3f& w : still.wind) w = Wide3f{};
        still.solve(4, 1e-5);
        hanging.rest = still.pose;
        hanging.solve(4, 1e-5, true);
        for (int lane = 0; lane < lanes; ++lane) {
            worst = std::max(worst, max_distance(hanging, natural.pose, lane));
            moved = std::max(moved, max_distance(still, natural.rest, lane));
        }
        // Without wind it keeps its shape to the bit.
        for (Wide3f& w : hanging.wind) w = Wide3f{};
        hanging.solve(4, 1e-5, true);
        for (int k = 0; k < hanging.cvs; ++k)
            for (int lane = 0; lane < lanes; ++lane)
                EXPECT_EQ(at(hanging.pose, k, lane), at(hanging.rest, k, lane));
    }
    std::printf("sagged by up to %.2g of the length; hanging off by up to %.2g\n", moved, worst);
    EXPECT_GT(moved, 0.1);
    EXPECT_LT(worst, 3e-4);
}

TEST(Elastica, KeepsLengthsAndNormals) {
    double worst = 0.0, tilt = 0.0;
    for (uint64_t i = 0; i < 400; ++i) {
        Blades blades(2 + int(i % 11));
        for (int lane = 0; lane < lanes; ++lane)
            set_random(blades, lane, 8 * i + uint64_t(lane), std::pow(10.0, double(i % 7) - 1.0), 5.0, 1.0);
        blades.solve(1 << (i % 4));
        for (int lane = 0; lane < lanes; ++lane) {
            worst = std::max(worst, length_error(blades, lane));
            for (int k = 0; k + 1 < blades.cvs; ++k) {
                const Vec3d r = (at(blades.rest, k + 1, lane) - at(blades.rest, k, lane)).normalized();
                const Vec3d p = (at(blades.pose, k + 1, lane) - at(blades.pose, k, lane)).normalized();
                tilt = std::max(
                    {tilt,
                     std::abs(r.dot(at(blades.normal, k, lane)) - p.dot(at(blades.pose_normal, k, lane))),
                     std::abs(at(blades.pose_normal, k, lane).norm() - 1.0)});
            }
        }
    }
    std::printf("segments: %.3f of the bound; normals: %.2g\n", worst, tilt);
    EXPECT_LT(worst, 1.0);
    EXPECT_LT(tilt, 2e-5);
}

TEST(Elastica, ABladeIsTheSameInAnyLaneAndCompany) {
    for (uint64_t i = 0; i < 200; ++i) {
        const int pieces = 1 << (i % 3);
        Blades one(8), other(8);
        for (int lane = 0; lane < lanes; ++lane) {
            set_random(one, lane, 100 * i + uint64_t(lane), std::pow(10.0, double(i % 6) - 1.0), 3.0, 1.0);
            set_random(other, lane, 5000 * i + uint64_t(lane),
                       std::pow(10.0, double((i + uint64_t(lane)) % 6)), -9.0, 0.1);
        }
        const int from = int(i % 8), to = int((3 * i + 1) % 8);
        set_random(other, to, 100 * i + uint64_t(from), std::pow(10.0, double(i % 6) - 1.0), 3.0, 1.0);
        one.solve(pieces);
        other.solve(pieces);
        for (int k = 0; k < 8; ++k) {
            ASSERT_EQ(at(one.pose, k, from), at(other.pose, k, to)) << i;
            ASSERT_EQ(at(one.pose_normal, k, from), at(other.pose_normal, k, to)) << i;
        }
    }
}

// Of fourth order from two pieces on, until floats end it.
TEST(Elastica, ConvergesOnceExtrapolated) {
    Blades blades(8);
    for (int lane = 0; lane < lanes; ++lane) set_random(blades, lane, uint64_t(lane), 30.0, 2.0, 1.0);
    std::vector<WideVector<Wide3f>> poses;
    for (const int pieces : {1, 2, 4, 8, 32}) {
        EXPECT_EQ(0, blades.solve(pieces, 1e-6));
        poses.push_back(blades.pose);
    }
    double before = 0.0;
    for (size_t i = 0; i < 4; ++i) {
        double sum = 0.0;
        for (int lane = 0; lane < lanes; ++lane) sum += max_distance(blades, poses[i], lane) / lanes;
        std::printf("%d pieces: mean error %.3g\n", 1 << i, sum);
        if (i > 0) {
            EXPECT_LT(sum, before / 8.0 + 3e-6);
        }
        before = sum;
    }
}

// Whatever way the wind blows across a rest that is curved by 3 radians: the kinks at its CVs turn the strand
// in their plane, across it and about it.
TEST(Elastica, KinksBendTheRightWay) {
    std::vector<double> errors;
    for (uint64_t i = 0; i < 20; ++i) {
        Blades blades(8);
        for (int lane = 0; lane < lanes; ++lane)
            set_random(blades, lane, hash(i, uint64_t(lane)), 3.0, 0.0, 3.0);
        blades.solve(32, 1e-6);
        const WideVector<Wide3f> reference = blades.pose;
        blades.solve(2, 1e-6);
        for (int lane = 0; lane < lanes; ++lane) errors.push_back(max_distance(blades, reference, lane));
    }
    std::ranges::sort(errors);
    std::printf("kinks of 25 degrees, 2 pieces: median %.2g, worst %.2g\n", errors[errors.size() / 2],
                errors.back());
    EXPECT_LT(errors[errors.size() / 2], 3e-5);
    EXPECT_LT(errors.back(), 1e-4);
}

// elastica_pieces() keeps the errors of 99 % of the blades below the tolerance.
TEST(Elastica, ErrorsAreBelowTheTolerance) {
    for (const double tolerance : {1e-3, 1e-4})
        for (const double ca : {0.1, 1.0, 10.0, 100.0, 1e3, 1e4}) {
            std::vector<double> errors;
            int unconverged = 0, pieces = 0;
            for (uint64_t i = 0; i < 100; ++i) {
                Blades blades(8);
                for (int lane = 0; lane < lanes; ++lane) {
                    const uint64_t seed = hash(i, uint64_t(lane));
                    const double x = unit_double(hash(seed, 1000)), y = unit_double(hash(seed, 1001));
                    set_random(blades, lane, seed, ca * std::pow(10.0, x - 1.0),
                               2.0 * ca * (y - 0.5) / (1.0 + ca / 4.0), 1.0);
                }
                blades.solve(32, 1e-6);
                const WideVector<Wide3f> reference = blades.pose;
                pieces = elastica_pieces(8, ca, ca / (1.0 + ca / 4.0), tolerance);
                unconverged += blades.solve(pieces, 0.5 * tolerance);
                for (int lane = 0; lane < lanes; ++lane)
                    errors.push_back(max_distance(blades, reference, lane));
            }
            std::ranges::sort(errors);
            const double percentile = errors[errors.size() * 99 / 100 - 1];
            std::printf("Ca to %-6g tolerance %g: %d pieces, median %.2g, 99 %% %.2g, worst %.2g, %d of %zu "
                        "unconverged\n",
                        ca, tolerance, pieces, errors[errors.size() / 2], percentile, errors.back(),
                        unconverged, errors.size());
            EXPECT_LT(percentile, tolerance);
            EXPECT_LE(unconverged, ca > 1e3 ? 8 : 0);
        }
}

TEST(Elastica, AnythingIsBounded) {
    int unconverged = 0;
    for (uint64_t i = 0; i < 64; ++i)
        for (const int pieces : {1, 2, 8}) {
            Blades blades(6);
            for (int lane = 0; lane < lanes; ++lane)
                set_random(blades, lane, 8 * i + uint64_t(lane), 10.0, 5.0, 1.0);
            for (size_t k = 0; k < 6; ++k) {
                if (k > 0 && (k == 1 || i % 2))
                    set_lane(blades.rest[k], 0, at(blades.rest, int(k) - 1, 0)); // no length
                if (k == 1 + i % 5) set_lane(blades.rest[k], 1, at(blades.rest, int(k) - 1, 1));
                if (i % 3) blades.rigidity[k][2] = 0.0f;
                if (k == i % 6) blades.rigidity[k][3] = 0.0f;
                blades.drag[k][4] *= 1e11f;
                blades.weight[k][5] *= i % 2 ? 1e11f : -1e11f;
                set_lane(blades.wind[k], 6, Vec3d(0.0, 0.0, 0.0));
                if (k == 3) set_lane(blades.rest[k], 7, at(blades.rest, 1, 7)); // folds back onto itself
                if (i % 5 == 0)                                                 // along the blade
                    set_lane(blades.wind[k], 7,
                             (i % 2 ? 9.0 : -9.0) * (at(blades.rest, 1, 7) - at(blades.rest, 0, 7)));
            }
            unconverged += blades.solve(pieces);
            ASSERT_TRUE(all_finite(blades)) << i;
            for (int lane = 0; lane < lanes; ++lane)
                ASSERT_LT(length_error(blades, lane), 1.0) << i << " " << lane;
        }
    std::printf("%d of %d hostile blades unconverged\n", unconverged, 64 * 3 * lanes);
}
