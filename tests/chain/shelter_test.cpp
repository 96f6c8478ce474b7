// SPDX-License-Identifier: Apache-2.0
// Shelter that fades, shelter from a cone of wind, and the error because jiggle uses the present shelter for
// past frames.
#include "tests/chain/furred_collision.h"
#include "tests/oracle/shield.h"
#include "tests/whole.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

namespace marram {
namespace {

Vec3d lane_of(const Wide3f& p, int lane) { return {double(p.x[lane]), double(p.y[lane]), double(p.z[lane])}; }
Vec3d lane_of(const Wide3d& p, int lane) { return {p.x[lane], p.y[lane], p.z[lane]}; }

// A furred sphere and two smaller ones upwind of it, one behind the other.
struct Spheres {
    std::vector<Mesh> meshes = {sphere_mesh(1.0F, 24, 0.05F, 9.0F), sphere_mesh(0.5F, 12, 0.0F, 1.0F),
                                sphere_mesh(0.3F, 12, 0.0F, 1.0F)};
    std::vector<int> first; // triangle of each mesh
    oracle::TriangleSet set;

    Spheres() {
        for (Vec3f& p : meshes[1].positions) p += Vec3f(-2.0F, 0.3F, 0.2F);
        for (Vec3f& p : meshes[2].positions) p += Vec3f(-1.45F, 0.5F, -0.4F);
        int triangles = 0;
        for (const Mesh& mesh : meshes) {
            first.push_back(triangles);
            triangles += int(mesh.triangles.size());
        }
        set = triangle_set(meshes);
    }
    size_t mesh_of(int triangle) const {
        return size_t(std::upper_bound(first.begin(), first.end(), triangle) - first.begin()) - 1;
    }
};

} // namespace

TEST(Shelter, ThatFadesAgreesWithTheOracle) {
    for (const bool in_heights : {false, true}) {
        size_t strands = 0, cvs = 0, faded = 0, grazing = 0;
        double worst = 0.0;
        for (const uint32_t seed : {1U, 2U}) {
            const Spheres spheres;
            const FurredWorld world(spheres.meshes);
            Groom groom = plain_coat(800, 6, 0.1, 0.4, 0.004);
            groom.seed = seed;
            const Wind wind = plain_wind(Vec3d(1.0, -0.2 * seed, 0.1), 0.9);
            Shielding shielding;
            shielding.offset = 3.0;
            shielding.per_cv = true;
            (in_heights ? shielding.wake_heights : shielding.wake) = in_heights ? 1.5 : 1.2;
            const Colliders colliders = world.colliders();
            const std::vector<double> heights = obstacle_heights(colliders);
            const oracle::Fade fade = [&](int triangle) {
                if (!in_heights) return 1.2;
                double low = 1e9, high = -1e9;
                for (const Vec3f& p : spheres.meshes[spheres.mesh_of(triangle)].positions) {
                    low = std::min(low, double(p.y()));
                    high = std::max(high, double(p.y()));
                }
                return 1.5 * (high - low);
            };
            for (Strands& s : grow(groom, wind, world.surface(0))) {
                shield(shielding, wind.direction, colliders, heights, s);
                for (int i = 0; i < s.count; ++i, ++strands)
                    for (int k = 1; k < s.cvs; ++k, ++cvs) { // roots are on the skin: Stages.Shielding...
                        const size_t at = size_t(i / lanes) * size_t(s.cvs) + size_t(k);
                        const oracle::Shelter right = oracle::shelter_from(
                            lane_of(s.rest[at], i % lanes), -wind.direction, 3.0, 1e-6, spheres.set, fade);
                        faded += right.value > 0.0 && right.value < 1.0;
                        if (right.grazing)
                            ++grazing;
                        else
                            worst = std::max(worst, std::abs(right.value - double(s.shield[at][i % lanes])));
                    }
            }
        }
        std::printf("wake in %s: %zu strands (seeds 1, 2), %zu CVs, %zu in fading shelter, %zu within 1e-6 "
                    "of an edge, "
                    "worst %.2g\n",
                    in_heights ? "heights" : "metres", strands, cvs, faded, grazing, worst);
        EXPECT_GE(strands, 1000U);
        EXPECT_GT(faded, 500U);
        EXPECT_LT(worst, 1e-5);
    }
}

// Compares the chain's lattice of directions with the oracle's integral over the cone: the difference
// decreases as expected for a cone and has zero mean.
TEST(Shelter, FromAConeOfWindComesToTheOraclesIntegral) {
    constexpr std::array rays = {16, 64, 256, 1024};
    const Spheres spheres;
    const FurredWorld world(spheres.meshes);
    const Groom groom = plain_coat(512, 4, 0.1, 0.4, 0.004);
    const Wind wind = plain_wind(Vec3d(1.0, -0.2, 0.1), 0.9);
    Shielding shielding;
    shielding.offset = 3.0;
    shielding.per_cv = true;
    shielding.wake = 4.0;
    shielding.spread = 12 * degree;
    const Colliders colliders = world.colliders();
    const std::vector<Strands> patches = grow(groom, wind, world.surface(0));
    std::vector<double> right;
    size_t partly = 0;
    for (const Strands& s : patches)
        for (int i = 0; i < s.count; ++i)
            for (int k = 1; k < s.cvs; k += 2) {
                const size_t block = size_t(i / lanes);
                right.push_back(oracle::cone_shelter(
                    lane_of(s.rest[block * size_t(s.cvs) + size_t(k)], i % lanes),
                    lane_of(s.root_normal[block], i % lanes), wind.direction, shielding.spread, 1024, 3.0,
                    1e-6, spheres.set, [](int) { return 4.0; }));
                partly += right.back() > 0.02 && right.back() < 0.7;
            }
    double rms[rays.size()] = {};
    for (size_t r = 0; r < rays.size(); ++r) {
        shielding.rays = rays[r];
        double mean = 0.0, square = 0.0, worst = 0.0;
        size_t at = 0;
        for (Strands s : patches) {
            shield(shielding, wind.direction, colliders, {}, s);
            for (int i = 0; i < s.count; ++i)
                for (int k = 1; k < s.cvs; k += 2) {
                    const double d =
                        double(s.shield[size_t(i / lanes) * size_t(s.cvs) + size_t(k)][i % lanes]) -
                        right[at++];
                    mean += d;
                    square += d * d;
                    worst = std::max(worst, std::abs(d));
                }
        }
        mean /= double(at);
        rms[r] = std::sqrt(square / double(at));
        std::printf(
            "cone of 12 degrees, %4d rays, %zu CVs, %zu partly sheltered: mean %+.2g, rms %.2g, worst %.2g\n",
            rays[r], at, partly, mean, rms[r], worst);
        EXPECT_LT(std::abs(mean), 0.15 * rms[r]);
        EXPECT_LT(worst, 16.0 * rms[r]);
    }
    EXPECT_GT(partly, 150U);
    EXPECT_LT(rms[1], 0.5 * rms[0]);
    EXPECT_LT(rms[2], 0.5 * rms[1]);
    EXPECT_LT(rms[3], 0.5 * rms[1]); // as fine as the oracle's 1024 directions
}

namespace {

// Meshes at a frame; strands grow on the first mesh.
using Stage = std::function<std::vector<Mesh>(double frame)>;

struct HeldShelterError {
    double worst = 0.0; // relative to the length
    double share = 0.0; // fraction of strands with an error above 1 % of their length
    size_t strands = 0;
};

// Compares strands that jiggle at frame 20 in the chain, with present shelter, with strands that use the
// shelter of each past time.
HeldShelterError error_of_held_shelter(const Stage& stage, double spread) {
    const double now = 20.0;
    const FurredWorld world(stage(now));
    const FurredWorld at_rest(stage(0.0));
    const Groom groom = plain_coat(1500, 6, 0.2, 0.3, 0.004);
    Wind wind = plain_wind(Vec3d::UnitX(), 0.9);
    wind.noise_amplitude = 0.0;
    Jiggle jiggle;
    jiggle.frequency = 3.0;
    jiggle.damping = 0.3;
    jiggle.step = 0.5;
    wind.jiggle = jiggle;
    Shielding shielding;
    shielding.offset = 6.0;
    shielding.spread = spread;
    shielding.rays = 64;
    wind.shielding = shielding;
    const std::vector<float> profile(6, 0.5F);
    const Ramp whole;
    const auto framed = [&](const FurredWorld& w, const double& time) {
        MarramFrame frame = w.frame();
        frame.times = &time;
        frame.stage = MARRAM_BENT;
        return frame;
    };
    const JiggleWindow window = jiggle_window(jiggle, std::span(&now, 1), 24.0, 1.0, 1e-6);
    const MarramFrame frame = framed(world, now);
    const ChainFrame chain =
        make_chain_frame({wind, whole, frame, &world.mesh(0), profile, MARRAM_BSPLINE, window});

    std::vector<Strands> truth = grow(groom, wind, {at_rest.surface(0), world.surface(0)});
    std::vector<std::vector<Strands>> history; // [sample][patch], at rest, and blown there and then
    for (int64_t past_sample = window.first; past_sample <= window.last; ++past_sample) {
        const double time = jiggle.frame_of(past_sample);
        const FurredWorld then(stage(time));
        const MarramFrame past = framed(then, time);
        const ChainFrame there =
            make_chain_frame({wind, whole, past, &then.mesh(0), profile, MARRAM_BSPLINE});
        ChainScratch scratch;
        history.push_back(grow(groom, wind, {at_rest.surface(0), then.surface(0)}));
        for (size_t p = 0; p < truth.size(); ++p) {
            run_chain(there, 0, history.back()[p], scratch);
        }
    }
    HeldShelterError swung;
    size_t off = 0;
    for (size_t p = 0; p < truth.size(); ++p) {
        Strands held = truth[p];
        ChainScratch scratch;
        const auto rest_of = [](const Strands& from, Strands& to) {
            to.rest = from.rest;
            to.rest_normal = from.rest_normal;
            to.noise_origin = from.noise_origin;
            to.root_normal = from.root_normal;
            to.width = from.width;
        };
        const RestStrandSource expand{[&](uint32_t, Strands& s) { rest_of(truth[p], s); },
                                      [&](int64_t past_sample, Strands& s) {
                                          rest_of(history[size_t(past_sample - window.first)][p], s);
                                      }};
        jiggle_patch(chain, expand, held, scratch);
        Strands bent = truth[p];
        ChainScratch other;
        run_chain(chain, 0, bent, other); // the pose at the present time, for restoring lengths
        JiggleFilter filter;
        JiggleState state;
        filter.begin(jiggle, window, 24.0, 6, bent.blocks);
        const auto blown = [&](int64_t past_sample, WideVector<Wide3f>& pose) {
            pose = history[size_t(past_sample - window.first)][p].pose;
        };
        WideVector<Wide3f> right;
        filter.advance(state, 0, now, blown);
        filter.emit(state, now, bent, blown, right);
        for (int i = 0; i < held.count; ++i, ++swung.strands) {
            double length = 0.0, far = 0.0;
            for (int k = 0; k < held.cvs; ++k) {
                const size_t at = size_t(i / lanes) * size_t(held.cvs) + size_t(k);
                if (k > 0)
                    length +=
                        (lane_of(held.rest[at], i % lanes) - lane_of(held.rest[at - 1], i % lanes)).norm();
                far = std::max(
                    far, (lane_of(scratch.jiggled[0][at], i % lanes) - lane_of(right[at], i % lanes)).norm());
            }
            swung.worst = std::max(swung.worst, far / length);
            off += far > 0.01 * length;
        }
    }
    swung.share = double(off) / double(swung.strands);
    return swung;
}

void turn_about_y(Mesh& mesh, double angle) {
    const Eigen::Matrix3f turn = Eigen::AngleAxisf(float(angle), Vec3f::UnitY()).toRotationMatrix();
    for (Vec3f& p : mesh.positions) p = turn * p;
}

} // namespace

// An obstacle that moves across the wind in front of a field, and a body that rotates in its own shelter. If
// nothing moves, holding the shelter is exact. Otherwise the strands that the edge of the shelter has passed
// within their memory, about 1 / (damping omega) = 0.18 s, have errors. Their number grows with the speed;
// the largest error is the full effect of shelter.
TEST(Shelter, HeldForJiggleIsOffWhereItsEdgeHasJustPassed) {
    struct Row {
        const char* what;
        double speed, spread,
            most; // m/s or degrees/s; most: fraction of strands with an error above 1 % of their length
    };
    const auto crossing = [](double speed) -> Stage {
        return [speed](double frame) {
            std::vector<Mesh> meshes = {plane_mesh(Vec2f(4.0F, 4.0F), 8), sphere_mesh(0.6F, 16, 0.0F, 1.0F)};
            for (Vec3f& p : meshes[1].positions)
                p += Vec3f(-3.0F, 0.4F, float(speed * (frame - 20.0) / 24.0));
            return meshes;
        };
    };
    const auto turning = [](double speed) -> Stage {
        return [speed](double frame) {
            std::vector<Mesh> meshes = {sphere_mesh(1.0F, 24, 0.05F, 9.0F)};
            turn_about_y(meshes[0], speed * degree * frame / 24.0);
            return meshes;
        };
    };
    for (const bool body : {false, true})
        for (const double spread : {0.0, 10.0 * degree}) {
            if (body != (spread > 0.0) && !testing::whole_run()) continue;
            double before = 0.0;
            for (const double speed : {0.0, 0.25, 1.0, 4.0}) {
                if ((speed == 0.25 || speed == 4.0) && !testing::whole_run()) continue;
                const double rate = body ? 90.0 * speed : speed;
                const HeldShelterError swung =
                    error_of_held_shelter(body ? turning(rate) : crossing(rate), spread);
                std::printf("shelter held: %s %6.2f %s, cone %2.0f degrees: %zu strands, %.2f %% off by more "
                            "than 1 %% of "
                            "their length, worst %.2g\n",
                            body ? "body turns at" : "ball crosses at", rate, body ? "degrees/s" : "m/s",
                            spread / degree, swung.strands, 100.0 * swung.share, swung.worst);
                EXPECT_GE(swung.strands, 1000U);
                EXPECT_TRUE(speed > 0.0 || swung.worst < 1e-6);
                EXPECT_GE(swung.share, before);
                before = swung.share;
            }
        }
}

} // namespace marram
