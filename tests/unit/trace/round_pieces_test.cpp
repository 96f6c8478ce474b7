// SPDX-License-Identifier: Apache-2.0
// Round pieces: their entry points against ray marching; and tracing through Embree's flat pieces against a
// test of every piece, also where fibres overlap, lie half in the skin, or are close behind each other.
#include "core/geometry/time_step.h"
#include "core/math/hash.h"
#include "core/trace/hit.h"
#include "core/trace/round_pieces.h"
#include "tests/unit/world/build_scene.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace marram {
namespace {

using testing::TestScene;

struct Random { // numbers by hashing a counter
    uint64_t seed, at = 0;
    double operator()() { return unit_double(hash(seed, at++)); }
    Vec3d within() { return {2.0 * (*this)() - 1.0, 2.0 * (*this)() - 1.0, 2.0 * (*this)() - 1.0}; }
    Vec3d direction() {
        const double z = 2.0 * (*this)() - 1.0, phi = 2.0 * pi * (*this)(), r = std::sqrt(1.0 - z * z);
        return {r * std::cos(phi), r * std::sin(phi), z};
    }
};

// A cone with a sphere at both ends.
bool inside(const RoundPiece& piece, const Vec3d& point) {
    const auto in_ball = [&](const Vec4d& corner) {
        return (point - corner.head<3>()).squaredNorm() < corner[3] * corner[3];
    };
    if (in_ball(piece.begin) || in_ball(piece.end)) return true;
    const Vec3d axis = (piece.end - piece.begin).head<3>(), from = point - piece.begin.head<3>();
    const double along = from.dot(axis) / axis.squaredNorm();
    const double radius = piece.begin[3] + along * (piece.end[3] - piece.begin[3]);
    return along > 0.0 && along < 1.0 && (from - along * axis).norm() < radius;
}

// The first of 4000 steps at which the ray is inside and was not before, refined by bisection to double
// precision; -1: none.
double march(const RoundPiece& piece, const Vec3d& origin, const Vec3d& direction, double far) {
    constexpr int steps = 4000;
    const auto in = [&](double t) { return inside(piece, origin + t * direction); };
    bool before = in(0.0);
    for (int i = 1; i <= steps; ++i) {
        double t1 = far * i / steps, t0 = far * (i - 1) / steps;
        const bool now = in(t1);
        if (now && !before) {
            for (int k = 0; k < 60; ++k) (in(0.5 * (t0 + t1)) ? t1 : t0) = 0.5 * (t0 + t1);
            return t1;
        }
        before = now;
    }
    return -1.0;
}

TEST(RoundPieces, AreEnteredWhereMarchingEntersThem) {
    for (const double taper : {0.0, 0.02}) {
        Random random{5};
        int entered = 0, balls = 0, edges = 0;
        double off = 0.0;
        constexpr int rays = 20000;
        for (int i = 0; i < rays; ++i) {
            const double length = i % 10 == 0 ? 0.0 : 0.5 * random(),
                         radius = 0.2 * std::pow(10.0, -1.5 * random());
            RoundPiece piece;
            piece.begin << 0.3 * random.within(), radius + taper * length;
            piece.end << Vec3d(piece.begin.head<3>() + length * random.direction()), radius;
            const Vec3d axis = (piece.end - piece.begin).head<3>();
            const Vec3d at = piece.begin.head<3>() + random() * axis + radius * random.within();
            const Vec3d origin =
                i % 4 == 0 ? Vec3d(at + 0.3 * random.within()) : Vec3d(1.5 * random.direction());
            Vec3d direction = (at - origin).normalized();
            if (i % 7 == 0 && length > 0.0) direction = axis / length; // along the axis
            Entry entry;
            const bool met = enter(piece, origin, direction, 0.0, entry);
            const double marched = march(piece, origin, direction, 4.0);
            if (met != (marched >= 0.0) || (met && std::abs(entry.t - marched) > 1e-3)) {
                ++edges; // the ray cuts less than one step
                continue;
            }
            if (!met) continue;
            ++entered;
            balls += entry.along == 0.0 || entry.along == 1.0;
            off = std::max(off, std::abs(entry.t - marched));
        }
        std::printf("[ round ] taper %.2f: %d of %d rays enter, %d of them a ball; %d differ at an edge; "
                    "entries off by %.1e m\n",
                    taper, entered, rays, balls, edges, off);
        EXPECT_GT(entered, rays / 3);
        EXPECT_GT(balls, rays / 20);
        EXPECT_LT(edges, rays / 250);
        // A ball extends beyond a cone by r taper^2 / 2, and an oblique ray enters it earlier.
        EXPECT_LT(off, taper > 0.0 ? 1e-3 : 1e-12);
    }
}

// A moving ball with thick fur that overlaps itself and lies half in the skin.
const std::string thick = R"(
[[mesh]]
name = "body"
type = "sphere"
divisions = 8
transform = { keys = [{ frame = 0.5 }, { frame = 1.5, translate = [0.02, 0.05, 0], rotate = [0, 4, 0] }] }
[[procedural]]
name = "fur"
type = "groom"
on = "body"
count = 2000
cvs = 5
length = [0.15, 0.3]
lean = 75
arc = 30
comb = [0, -1, 0]
comb_variation = 60
width = 0.03
width_profile = [[0, 1], [1, 0.1]]
shape = "round"
basis = "catmull-rom"
)";

// The nearest hit of all pieces and meshes, found by testing each.
struct Nearest {
    double t;
    int64_t strand; // -1: a mesh or nothing
};

RoundPiece piece_at(const CurveGeometry& curves, size_t curve, size_t i, float time) {
    const size_t stride = (curves.cvs_per_curve - 1) * curves.pieces + 1;
    const Step step = step_of(curves.round_pieces.size(), time);
    const auto corner = [&](size_t k) -> Vec4d {
        const auto key = [&](size_t n) {
            return Vec4d(Vec4f::Map(curves.round_pieces[n] + 4 * (curve * stride + k)).cast<double>());
        };
        const Vec4d a = key(step.first);
        return step.within > 0.0 ? Vec4d(a + step.within * (key(step.first + 1) - a)) : a;
    };
    RoundPiece piece{corner(i), corner(i + 1)};
    piece.begin[3] = std::abs(piece.begin[3]);
    piece.end[3] = std::abs(piece.end[3]);
    return piece;
}

Nearest ask_all(const World& world, const Ray& ray) {
    RTCRayHit query{};
    query.ray = {ray.origin.x(),
                 ray.origin.y(),
                 ray.origin.z(),
                 ray.tnear,
                 ray.direction.x(),
                 ray.direction.y(),
                 ray.direction.z(),
                 ray.time,
                 ray.tfar,
                 ~0U,
                 0,
                 0};
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    marram_intersect1(world.colliders.get(), &query, 0);
    Nearest nearest{query.ray.tfar, -1};
    const CurveGeometry& curves = world.curves[0];
    const Vec3d origin = ray.origin.cast<double>(), direction = ray.direction.cast<double>();
    for (size_t curve = 0; curve < curves.curve_count; ++curve)
        for (size_t i = 0; i < size_t(curves.cvs_per_curve - 1) * curves.pieces; ++i) {
            Entry entry;
            if (enter(piece_at(curves, curve, i, ray.time), origin, direction, ray.tnear, entry) &&
                entry.t < nearest.t)
                nearest = {entry.t, int64_t(curve)};
        }
    return nearest;
}

struct Differences {
    int curves = 0, other = 0, occluded = 0, rays = 0;
};

Differences compare(const World& world, int rays, bool near) {
    Random random{9};
    Differences differences{};
    for (int i = 0; i < rays; ++i) {
        Ray ray;
        ray.time = world.times.size() > 1 ? float(random()) : 0.0F;
        const Vec3d to = 1.1 * random.within(),
                    from = near ? Vec3d((1.0 + 0.15 * random()) * random.direction())
                                : Vec3d(3.0 * random.direction());
        ray.origin = from.cast<float>();
        ray.direction = (to - from).normalized().cast<float>();
        if (i % 3 == 0) ray.tfar = float((near ? 0.3 : 3.0) * random());
        if (i % 5 == 0) ray.tnear = float(0.1 * random());
        if (!(ray.tnear < ray.tfar)) continue;
        ++differences.rays;
        const Nearest expected = ask_all(world, ray);
        SurfacePoint point;
        const bool hit = intersect(world, ray, point, false);
        const bool fibre = hit && point.shape == PointShape::round;
        differences.curves += fibre;
        const double t = hit ? point.distance : ray.tfar;
        // Two fibres can be hit at the same distance within the ray's float precision.
        differences.other += expected.t < std::numeric_limits<double>::infinity()
                                 ? !(std::abs(t - expected.t) <= 1e-5) || fibre != (expected.strand >= 0)
                                 : hit;
        differences.occluded += occluded(world, ray) != (hit);
    }
    return differences;
}

TEST(RoundPieces, AreFoundAsByAskingEachOne) {
    for (const bool moving : {false, true}) {
        TestScene scene(thick);
        scene.settings.curve_pieces = 2;
        if (moving) {
            scene.settings.shutter_open = -0.25;
            scene.settings.shutter_close = 0.25;
        }
        World world = scene.build();
        ASSERT_EQ(world.curves[0].pieces, 2U);
        EXPECT_EQ(world.times.size() > 1, moving);
        for (const bool near : {false, true}) {
            const Differences found = compare(world, 1500, near);
            std::printf(
                "[ round ] %s, rays from %s: %d of %d meet a fibre, %d meet another, %d occluded otherwise\n",
                moving ? "moving" : "at rest", near ? "within the fur" : "outside", found.curves, found.rays,
                found.other, found.occluded);
            EXPECT_GT(found.curves, found.rays / 5);
            EXPECT_LE(found.other, found.rays / 300); // silhouettes, which Embree decides in floats
            EXPECT_LE(found.occluded, found.rays / 300);
        }
        // The reach is needed to find fibres whose axis is behind a nearer hit.
        world.reach = 1e-9;
        const Differences lost = compare(world, 500, false);
        std::printf("[ round ] without reach: %d of %d meet another\n", lost.other, lost.rays);
        EXPECT_GT(lost.other, 5);
    }
}

} // namespace
} // namespace marram
