// SPDX-License-Identifier: Apache-2.0
// The guarantees of wind collision: no segment of a strand with a free root crosses a triangle, the curve
// penetrates by less than the tolerance, and strands get as close to their targets as with the oracle.
#include "core/read/mesh_file.h"
#include "tests/chain/furred_collision.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <functional>

namespace marram {
namespace {

struct CollisionErrors {
    size_t strands = 0, crossed = 0, dipping = 0, rooted_within = 0;
    double deepest = 0.0;
};

CollisionErrors examine(const Fur& fur, const oracle::TriangleSet& set, MarramBasis basis, double tolerance,
                        bool verbose = true) {
    CollisionErrors kept;
    kept.strands = fur.count();
    for (size_t i = 0; i < kept.strands; ++i) {
        const std::vector<Vec3d> cvs = fur.strand(i);
        // A root closer to a collider than the curve's radius there is not free.
        if (set.nearest(cvs[0], cvs[0]).closest.distance < fur.radii(i)[0]) {
            ++kept.rooted_within;
            continue;
        }
        bool crossed = false;
        for (size_t k = 0; k + 1 < cvs.size(); ++k)
            for (const auto& hit : set.crossings(cvs[k], cvs[k + 1])) {
                crossed = true;
                if (verbose)
                    std::printf("    strand %zu segment %zu crosses triangle %d, margin %.3g\n", i, k,
                                hit.triangle, hit.crossing.margin);
            }
        kept.crossed += crossed;
        const auto spline = basis == MARRAM_BSPLINE ? oracle::Spline::b_spline : oracle::Spline::catmull_rom;
        double deepest = 0.0;
        for (const double dip : oracle::deepest_penetrations(cvs, fur.radii(i), spline, 24, tolerance, set))
            deepest = std::max(deepest, dip);
        kept.dipping += deepest > tolerance;
        kept.deepest = std::max(kept.deepest, deepest);
    }
    return kept;
}

// Solves the same strands with the oracle, with the chain's clearances.
double oracle_turned_fraction(const Fur& bent, const Fur& solved, const oracle::TriangleSet& set,
                              size_t stride, bool straight_out) {
    double turned = 0.0, goal = 0.0;
    std::vector<std::vector<double>> clearances(solved.count());
    for (const SegmentTrace& trace : solved.trace)
        clearances[trace.strand].push_back(trace.segment.clearance);
    for (size_t i = 0; i < solved.count(); i += stride) {
        const Strands& s = bent.patches[i / 512];
        if (clearances[i].size() + 1 != size_t(s.cvs)) continue; // the root is not free
        std::vector<Vec3d> rest;
        for (int k = 0; k < s.cvs; ++k) {
            const Wide3f& p = s.rest[i % 512 / lanes * size_t(s.cvs) + size_t(k)];
            const auto lane = int(i % lanes);
            rest.emplace_back(double(p.x[lane]), double(p.y[lane]), double(p.z[lane]));
        }
        const oracle::StrandTurn turn =
            oracle::collide_strand(rest, bent.strand(i), clearances[i], set, 0.0, straight_out);
        turned += turn.turned;
        goal += turn.goal;
    }
    return goal > 0.0 ? turned / goal : 1.0;
}

double chain_turned_fraction(const Fur& fur, size_t stride) {
    double turned = 0.0, goal = 0.0;
    for (const SegmentTrace& trace : fur.trace) {
        if (trace.strand % stride != 0) continue;
        turned += std::max(trace.turned.turned_angle, 0.0);
        goal += trace.turned.goal_angle;
    }
    return goal > 0.0 ? turned / goal : 1.0;
}

constexpr std::array<std::array<double, 3>, 6> winds = {
    {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};

// Wind from six directions at full strength. Tolerance: 0.5 % of the shortest strand.
void check_guarantees(const char* name, std::vector<Mesh> meshes, FurOptions options, size_t share_stride) {
    const oracle::TriangleSet set = triangle_set(meshes);
    const FurredWorld world(std::move(meshes));
    options.tolerance = 0.005 * options.length[0];
    options.global_rotate = 1.0;
    for (const auto& wind : winds) {
        options.wind = Vec3d(wind.data());
        const Fur fur = blow(world, options, false);
        const CollisionErrors kept = examine(fur, set, options.basis, options.tolerance);
        std::printf("  %-14s wind %2.0f %2.0f %2.0f: %zu strands, %zu rooted in a collider, %zu crossing, "
                    "%zu dipping (deepest %.2g of %.2g); "
                    "contacts %zu, turned out %zu, unresolved %zu, dips %zu, reached %.4f\n",
                    name, wind[0], wind[1], wind[2], kept.strands, kept.rooted_within, kept.crossed,
                    kept.dipping, kept.deepest, options.tolerance, size_t(fur.counts.contacts),
                    size_t(fur.counts.pushed_out), size_t(fur.counts.unresolved), size_t(fur.counts.dips),
                    fur.counts.turned_angle / fur.counts.goal_angle);
        EXPECT_EQ(kept.crossed, 0U);
        EXPECT_EQ(kept.dipping, 0U);
        EXPECT_EQ(fur.counts.unresolved, 0U);
        if (&wind != &winds.front() && &wind != &winds[3]) continue;
        const Fur traced = blow(world, options, true);
        Fur bent = blow(world, options, false);
        {
            // The targets: bent but not collided.
            const Ramp whole;
            ChainFrame chain = make_chain_frame(
                {bent.wind, whole, world.frame(), &world.mesh(0), bent.profile, options.basis});
            chain.frame.stage = MARRAM_BENT;
            ChainScratch scratch;
            for (Strands& strands : bent.patches) run_chain(chain, 0, strands, scratch);
        }
        const double mine = chain_turned_fraction(traced, share_stride),
                     theirs = oracle_turned_fraction(bent, traced, set, share_stride, true);
        const double arc_only = oracle_turned_fraction(bent, traced, set, share_stride, false);
        std::printf("  %-14s share of the way %.4f, oracle %.4f; turning out in the arc's plane alone %.4f\n",
                    name, mine, theirs, arc_only);
        EXPECT_NEAR(mine, theirs, 0.01);
        EXPECT_GT(mine, arc_only - 0.01);
    }
}

// A cloth-like sheet with sharp overhanging folds.
Mesh folded_sheet(int n) {
    Mesh mesh;
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
            const double u = 2.0 * i / n - 1.0, v = 2.0 * j / n - 1.0;
            const double fold = 6.0 * u;
            const double x = u + 0.12 * std::sin(2.0 * fold),
                         y = 0.12 * (1.0 - std::cos(fold)) + 0.05 * std::sin(3.0 * v);
            mesh.positions.emplace_back(float(x), float(y), float(v));
        }
    const auto at = [&](int i, int j) { return uint32_t(j * (n + 1) + i); };
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            mesh.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j)});
            mesh.triangles.push_back({at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)});
        }
    return mesh;
}

// Meshes at a time of the shutter, 0 to 1; strands grow on the first mesh.
using Stage = std::function<std::vector<Mesh>(double time)>;

// Between two keys CVs and vertices move linearly; curves that are free at both keys may cross or penetrate
// in between. Solves at `keys` times of the shutter and checks 8 instants, the same for every number of keys.
CollisionErrors between_keys(const Stage& stage, size_t keys, const FurOptions& options) {
    std::vector<Mesh> meshes = stage(0.0);
    std::vector<std::vector<FurredWorld::Positions>> later(meshes.size());
    for (size_t key = 1; key < keys; ++key) {
        std::vector<Mesh> then = stage(double(key) / double(keys - 1));
        for (size_t m = 0; m < meshes.size(); ++m) later[m].push_back(then[m].positions);
    }
    const FurredWorld world(meshes, later);
    Fur fur; // its strands are interpolated between keys below
    fur.groom = plain_coat(options.count, options.cvs, options.length[0], options.length[1], options.width);
    fur.wind = plain_wind(options.wind, options.global_rotate);
    fur.wind.collision = options.collision;
    for (int k = 0; k < options.cvs; ++k)
        fur.profile.push_back(float(0.5 * fur.groom.width_profile(double(k) / (options.cvs - 1))));
    const Ramp whole;
    MarramFrame frame = world.frame();
    frame.tolerance = options.tolerance;
    const ChainFrame chain =
        make_chain_frame({fur.wind, whole, frame, &world.mesh(0), fur.profile, options.basis});
    ChainScratch scratch;
    std::vector<std::vector<Strands>> solved;
    for (uint32_t key = 0; key < keys; ++key) {
        solved.push_back(grow(fur.groom, fur.wind, {world.surface(0, 0), world.surface(0, key)}));
        for (Strands& strands : solved.back()) run_chain(chain, key, strands, scratch);
    }
    constexpr int instants = 8;
    CollisionErrors worst;
    for (int instant = 0; instant < instants; ++instant) {
        const double at = (instant + 0.5) / instants * double(keys - 1);
        const size_t key = size_t(at);
        const auto part = float(at - double(key));
        std::vector<Mesh> now = meshes;
        for (size_t m = 0; m < now.size(); ++m) {
            const auto& from = key == 0 ? meshes[m].positions : later[m][key - 1];
            for (size_t v = 0; v < from.size(); ++v)
                now[m].positions[v] = (1.0F - part) * from[v] + part * later[m][key][v];
        }
        fur.patches = solved[key];
        for (size_t p = 0; p < fur.patches.size(); ++p)
            for (size_t i = 0; i < fur.patches[p].pose.size(); ++i)
                for (VFloat Wide3f::*axis : {&Wide3f::x, &Wide3f::y, &Wide3f::z})
                    fur.patches[p].pose[i].*axis = (1.0F - part) * solved[key][p].pose[i].*axis +
                                                   part * solved[key + 1][p].pose[i].*axis;
        const CollisionErrors kept = examine(fur, triangle_set(now), options.basis, options.tolerance, false);
        worst.strands = kept.strands;
        worst.crossed += kept.crossed;
        worst.dipping += kept.dipping;
        worst.deepest = std::max(worst.deepest, kept.deepest);
    }
    return worst;
}

void holds_between_keys(const char* name, const Stage& stage) {
    FurOptions options{.count = 600};
    options.tolerance = 0.005 * options.length[0];
    double with_two = 0.0;
    for (const size_t keys : {2U, 3U, 5U, 9U}) {
        const CollisionErrors kept = between_keys(stage, keys, options);
        const double looks = 8.0 * double(kept.strands);
        const double crossing = double(kept.crossed) / looks;
        std::printf("  between keys, %-28s %2zu keys: %.3f %% of strands cross, %.3f %% dip by more than the "
                    "tolerance, "
                    "deepest %.2g of the shortest strand\n",
                    name, keys, 100.0 * crossing, 100.0 * double(kept.dipping) / looks,
                    kept.deepest / options.length[0]);
        if (keys == 2) with_two = crossing;
        EXPECT_LT(crossing, 0.1);
        EXPECT_LT(kept.deepest, 0.05 * options.length[0]);
        EXPECT_TRUE(keys != 9 || crossing <= 0.1 * with_two);
    }
}

std::string shared_mesh(const char* name) {
    const std::string path = std::string(MARRAM_SOURCE_DIR) + "/../shared/data/" + name;
    return std::filesystem::exists(path) ? path : "";
}

} // namespace

TEST(Promise, IsKeptOnABumpySphere) {
    check_guarantees("sphere 40k", {sphere_mesh(1.0F, 71, 0.03F, 9.0F)}, {.count = 4000}, 4);
}

TEST(Promise, IsKeptOnADenseSphere) {
    check_guarantees("sphere 2M", {sphere_mesh(1.0F, 500, 0.03F, 9.0F)}, {.count = 1000}, 40);
}

TEST(Promise, IsKeptOnAFoldedSheet) {
    check_guarantees("folded sheet", {folded_sheet(60)},
                     {.count = 2000, .length = {0.1, 0.2}, .width = 0.002}, 2);
}

TEST(Promise, IsKeptByCatmullRomStrands) {
    check_guarantees("catmull-rom", {sphere_mesh(1.0F, 40, 0.1F, 12.0F)},
                     {.count = 2000, .basis = MARRAM_CATMULL_ROM}, 4);
}

TEST(Promise, IsKeptOnACreature) {
    check_guarantees("creature",
                     {load_mesh(std::string(MARRAM_SOURCE_DIR) + "/scenes/meshes/creature.ply", true)},
                     {.count = 4000, .length = {0.05, 0.08}, .width = 0.0015}, 4);
}

TEST(Promise, IsKeptOnACow) {
    const std::string path = shared_mesh("spot.obj");
    if (path.empty()) GTEST_SKIP() << "there is no shared data";
    check_guarantees("spot", {load_mesh(path, true)}, {.count = 4000, .length = {0.08, 0.12}, .width = 0.002},
                     4);
}

TEST(Promise, IsKeptOnACarBody) {
    const std::string path = shared_mesh("beetle.obj");
    if (path.empty()) GTEST_SKIP() << "there is no shared data";
    check_guarantees("beetle", {load_mesh(path, true)},
                     {.count = 4000, .length = {0.04, 0.06}, .width = 0.001}, 4);
}

// Half a frame of 1/24 s: a body that rotates in wind (45 and 360 degrees/s), one that breathes, and a ball
// that is pushed into the fur (2 m/s).
TEST(Promise, IsMeasuredBetweenMotionKeys) {
    constexpr double shutter = 0.5 / 24.0;
    const auto body = [](const std::function<Vec3f(const Vec3f&)>& moved) {
        std::vector<Mesh> meshes = {sphere_mesh(1.0F, 40, 0.03F, 9.0F)};
        for (Vec3f& p : meshes[0].positions) p = moved(p);
        return meshes;
    };
    for (const double speed : {45.0, 360.0})
        holds_between_keys(speed < 100.0 ? "body turning 45 degrees/s" : "body turning 360 degrees/s",
                           [&](double time) {
                               const Eigen::Matrix3f turn =
                                   Eigen::AngleAxisf(float(speed * degree * shutter * time), Vec3f::UnitY())
                                       .toRotationMatrix();
                               return body([&](const Vec3f& p) { return Vec3f(turn * p); });
                           });
    holds_between_keys("body breathing", [&](double time) {
        return body([&](const Vec3f& p) { return Vec3f(p * float(1.0 + 0.02 * time)); });
    });
    holds_between_keys("ball pushed in at 2 m/s", [&](double time) {
        std::vector<Mesh> meshes = body([](const Vec3f& p) { return p; });
        meshes.push_back(sphere_mesh(0.5F, 24, 0.0F, 1.0F));
        for (Vec3f& p : meshes[1].positions) p += Vec3f(0.0F, float(1.66 - 2.0 * shutter * time), 0.0F);
        return meshes;
    });
}

} // namespace marram
