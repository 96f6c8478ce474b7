// SPDX-License-Identifier: Apache-2.0
// Compares bend, shielding and jiggle of whole strands with the oracle, on random strands.
#include "tests/chain/furred_collision.h"
#include "tests/oracle/bend.h"
#include "tests/oracle/jiggle.h"
#include "tests/oracle/shield.h"

#include "procedural/wind/bend.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

std::vector<Vec3d> rest_of(const Strands& s, int i) {
    std::vector<Vec3d> cvs;
    for (int k = 0; k < s.cvs; ++k) {
        const Wide3f& p = s.rest[size_t(i / lanes) * size_t(s.cvs) + size_t(k)];
        cvs.emplace_back(double(p.x[i % lanes]), double(p.y[i % lanes]), double(p.z[i % lanes]));
    }
    return cvs;
}

std::vector<Vec3d> pose_of(const Strands& s, int i) {
    std::vector<Vec3d> cvs;
    for (int k = 0; k < s.cvs; ++k) {
        const Wide3f& p = s.pose[size_t(i / lanes) * size_t(s.cvs) + size_t(k)];
        cvs.emplace_back(double(p.x[i % lanes]), double(p.y[i % lanes]), double(p.z[i % lanes]));
    }
    return cvs;
}

double length_of(const std::vector<Vec3d>& cvs) {
    double sum = 0.0;
    for (size_t k = 1; k < cvs.size(); ++k) sum += (cvs[k] - cvs[k - 1]).norm();
    return sum;
}

// A coat on a sphere, bent without noise: noise has its own reference (tests/unit/noise/noise_test.cpp).
struct Bent {
    FurredWorld world{{sphere_mesh(1.0F, 24, 0.05F, 9.0F)}};
    Groom groom = plain_coat(1500, 7, 0.1, 0.4, 0.004);
    Wind wind;
    std::vector<float> profile = std::vector<float>(7, 0.5F);
    Ramp envelope = Ramp(std::vector<double>{0, 1, 1, 0.5}, "linear");
};

} // namespace

TEST(Stages, BendAgreesWithTheOracle) {
    double worst = 0.0;
    size_t strands = 0;
    for (const uint32_t seed : {1U, 2U, 3U}) {
        Bent b;
        b.groom.seed = seed;
        b.wind = plain_wind(Vec3d(1.0, 0.3 * seed, -0.7), 0.9);
        b.wind.noise_amplitude = 0.0;
        b.wind.reference_segments = seed == 2 ? 12 : 0;
        const ChainFrame chain = make_chain_frame(
            {b.wind, b.envelope, b.world.frame(), &b.world.mesh(0), b.profile, MARRAM_BSPLINE});
        ChainScratch scratch;
        for (Strands& s : grow(b.groom, b.wind, b.world.surface(0))) {
            run_chain(chain, 0, s, scratch);
            for (int i = 0; i < s.count; ++i, ++strands) {
                const std::vector<Vec3d> rest = rest_of(s, i);
                oracle::Bend bend;
                bend.wind = b.wind.direction;
                bend.global_rotate = b.wind.global_rotate;
                bend.ramp_rotate = b.wind.ramp_rotate;
                bend.reference_segments = b.wind.reference_segments;
                for (int k = 0; k < s.cvs; ++k) bend.envelope.push_back(b.envelope(double(k) / (s.cvs - 1)));
                const std::vector<Vec3d> right = oracle::bend_curve(rest, bend), mine = pose_of(s, i);
                for (size_t k = 0; k < right.size(); ++k)
                    worst = std::max(worst, (right[k] - mine[k]).norm() / length_of(rest));
            }
        }
    }
    std::printf("bend: %zu strands (seeds 1, 2, 3), worst CV %.2g of the length\n", strands, worst);
    EXPECT_GE(strands, 1000U);
    EXPECT_LT(worst, 1e-5);
}

TEST(Stages, ShieldingAgreesWithTheOracle) {
    size_t strands = 0, cvs = 0, grazing = 0, differ = 0, sheltered = 0, windward_roots = 0, wrong_roots = 0;
    for (const uint32_t seed : {1U, 2U}) {
        std::vector<Mesh> meshes = {sphere_mesh(1.0F, 24, 0.05F, 9.0F), sphere_mesh(0.4F, 12, 0.0F, 1.0F)};
        for (Vec3f& p : meshes[1].positions) p += Vec3f(-2.0F, 0.3F, 0.2F);
        const oracle::TriangleSet set = triangle_set(meshes);
        const FurredWorld world(std::move(meshes));
        Groom groom = plain_coat(1500, 6, 0.1, 0.4, 0.004);
        groom.seed = seed;
        Wind wind = plain_wind(Vec3d(1.0, -0.2 * seed, 0.1), 0.9);
        Shielding shielding;
        shielding.offset = 3.0;
        shielding.per_cv = true;
        const Colliders colliders = world.colliders();
        for (Strands& s : grow(groom, wind, world.surface(0))) {
            shield(shielding, wind.direction, colliders, {}, s);
            for (int i = 0; i < s.count; ++i, ++strands) {
                const auto right =
                    oracle::shield_curve(rest_of(s, i), wind.direction, shielding.offset, 1e-6, set);
                for (int k = 0; k < s.cvs; ++k, ++cvs) {
                    const bool mine =
                        s.shield[size_t(i / lanes) * size_t(s.cvs) + size_t(k)][i % lanes] > 0.5F;
                    sheltered += right.hit[size_t(k)];
                    if (k == 0) { // on the skin: its facing decides, unless something else is in the way
                        const Wide3d& n = s.root_normal[size_t(i / lanes)];
                        const Vec3d normal(n.x[i % lanes], n.y[i % lanes], n.z[i % lanes]);
                        if (normal.dot(wind.direction) < -0.3) {
                            ++windward_roots;
                            wrong_roots += mine && !right.hit[0];
                        } else if (normal.dot(wind.direction) > 0.3) {
                            wrong_roots += !mine;
                        }
                        continue;
                    }
                    if (mine == right.hit[size_t(k)]) continue;
                    right.grazing[size_t(k)] ? ++grazing : ++differ;
                }
            }
        }
    }
    std::printf("shield: %zu strands (seeds 1, 2), %zu CVs, %zu sheltered; %zu differ, %zu within 1e-6 of an "
                "edge; %zu "
                "windward roots, %zu roots wrong\n",
                strands, cvs, sheltered, differ, grazing, windward_roots, wrong_roots);
    EXPECT_GE(strands, 1000U);
    EXPECT_EQ(differ, 0U);
    EXPECT_EQ(wrong_roots, 0U);
}

// Wind from a cone of directions: the ground that strands grow on does not shelter them.
TEST(Stages, AConeOfWindIsWholeOverOpenGround) {
    const FurredWorld world({plane_mesh(Vec2f(8.0F, 8.0F), 4)});
    const Groom groom = plain_coat(500, 5, 0.1, 0.3, 0.004);
    const Wind wind = plain_wind(Vec3d::UnitX(), 0.6);
    Shielding shielding;
    shielding.offset = 20.0;
    shielding.spread = 15 * degree;
    shielding.rays = 64;
    const Colliders colliders = world.colliders();
    float most = 0.0F;
    for (Strands& s : grow(groom, wind, world.surface(0))) {
        shield(shielding, wind.direction, colliders, {}, s);
        for (const VFloat& alpha : s.shield)
            for (int lane = 0; lane < lanes; ++lane) most = std::max(most, alpha[lane]);
    }
    std::printf("cone over open ground: greatest sheltered share %.3f\n", double(most));
    EXPECT_EQ(most, 0.0F);
}

TEST(Stages, JiggleAgreesWithTheOracle) {
    double worst = 0.0;
    size_t strands = 0;
    for (const double damping : {0.2, 1.0, 3.0}) {
        Bent b;
        b.groom.count = 400;
        b.wind = plain_wind(Vec3d(1.0, 0.0, 0.3), 0.9);
        Jiggle jiggle;
        jiggle.frequency = 3.0;
        jiggle.damping = damping;
        jiggle.stiffness = Ramp(std::vector<double>{0, 4, 1, 1}, "linear");
        jiggle.start_frame = 1.0;
        b.wind.jiggle = jiggle;
        constexpr double time = 20.3, fps = 24.0;
        const JiggleWindow window = jiggle_window(jiggle, std::array{time}, fps, 1.0, 1e-7);
        JiggleFilter filter;
        for (Strands& s : grow(b.groom, b.wind, b.world.surface(0))) {
            std::fill(s.envelope.begin(), s.envelope.end(), splat_float(0.8F));
            filter.begin(jiggle, window, fps, s.cvs, s.blocks);
            std::vector<oracle::History> histories(static_cast<size_t>(s.count));
            for (oracle::History& history : histories) history.cubic = true;
            for (double frame = 1.0; frame < time + 2.0 * jiggle.step; frame += jiggle.step) {
                bend(b.wind, frame, fps, s);
                for (int i = 0; i < s.count; ++i) {
                    histories[size_t(i)].times.push_back(frame / fps);
                    histories[size_t(i)].poses.push_back(pose_of(s, i));
                }
            }
            JiggleState state;
            const auto bent = [&](int64_t past_sample, WideVector<Wide3f>& pose) {
                bend(b.wind, jiggle.frame_of(past_sample), fps, s);
                pose = s.pose;
            };
            WideVector<Wide3f> out;
            filter.advance(state, 0, time, bent);
            filter.emit(state, time, s, bent, out);
            std::vector<double> omega;
            for (int k = 0; k < s.cvs; ++k)
                omega.push_back(2.0 * pi * jiggle.frequency * jiggle.stiffness(double(k) / (s.cvs - 1)));
            for (int i = 0; i < s.count; ++i, ++strands) {
                const std::vector<Vec3d> rest = rest_of(s, i);
                std::vector<double> lengths;
                for (size_t k = 1; k < rest.size(); ++k) lengths.push_back((rest[k] - rest[k - 1]).norm());
                const auto filtered = oracle::filtered_pose(histories[size_t(i)], omega, damping, time / fps);
                const auto right = oracle::restored_lengths(
                    filtered, oracle::pose_at(histories[size_t(i)], time / fps), lengths);
                for (int k = 0; k < s.cvs; ++k) {
                    const Wide3f& p = out[size_t(i / lanes) * size_t(s.cvs) + size_t(k)];
                    const Vec3d mine(double(p.x[i % lanes]), double(p.y[i % lanes]), double(p.z[i % lanes]));
                    worst = std::max(worst, (mine - right[size_t(k)]).norm() / length_of(rest));
                }
            }
        }
    }
    std::printf("jiggle: %zu strands, worst CV %.2g of the length\n", strands, worst);
    EXPECT_GE(strands, 1000U);
    EXPECT_LT(worst, 1e-5);
}

// More CVs give the same pose of a strand.
TEST(Stages, PosesConvergeAsCvsAreAdded) {
    FurredWorld world({sphere_mesh(1.0F, 24, 0.0F, 1.0F)});
    std::vector<Vec3d> tips[4];
    const int cvs[4] = {5, 9, 17, 65};
    double length = 0.3;
    for (int c = 0; c < 4; ++c) {
        Groom groom = plain_coat(300, cvs[c], length, length, 0.004);
        Wind wind = plain_wind(Vec3d(1.0, 0.2, 0.0), 0.7);
        wind.noise_amplitude = 0.3;
        wind.reference_segments = 4;
        const Ramp whole;
        const std::vector<float> profile(size_t(cvs[c]), 0.5F);
        const ChainFrame chain =
            make_chain_frame({wind, whole, world.frame(), &world.mesh(0), profile, MARRAM_BSPLINE});
        ChainScratch scratch;
        for (Strands& s : grow(groom, wind, world.surface(0))) {
            run_chain(chain, 0, s, scratch);
            for (int i = 0; i < s.count; ++i) {
                const std::vector<Vec3d> pose = pose_of(s, i);
                for (int quarter = 1; quarter <= 4; ++quarter)
                    tips[c].push_back(pose[size_t(quarter * (cvs[c] - 1) / 4)]);
            }
        }
    }
    double far[3] = {};
    for (int c = 0; c < 3; ++c) {
        for (size_t i = 0; i < tips[3].size(); ++i)
            far[c] = std::max(far[c], (tips[c][i] - tips[3][i]).norm() / length);
        std::printf("%2d CVs: farthest from 65 CVs %.4f of the length\n", cvs[c], far[c]);
    }
    EXPECT_LT(far[1], 0.6 * far[0]);
    EXPECT_LT(far[2], 0.6 * far[1]);
    EXPECT_LT(far[0], 0.2);
}

} // namespace marram
