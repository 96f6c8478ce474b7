// SPDX-License-Identifier: Apache-2.0
// Tests of the ruin layer's documentation: extents of the zones, sand conserved exactly, slopes, rooms, wind
// direction, identical bits at any thread count.
#include "procedural/terrain/ruin/ruin.h"

#include "core/math/hash.h"
#include "tests/unit/terrain/block_mesh.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <limits>
#include <numeric>
#include <vector>

namespace marram {
namespace {

// A terrain, a mesh in it, and the result of the layer.
struct RuinField {
    Domain domain;
    std::vector<float> rock;
    std::vector<SandUnits> before, after;
    BlockMesh blocks;
    RuinSettings settings;
    Vec2d wind = Vec2d(1.0, 0.0);
    RuinResult result;

    RuinField(int nx, int nz, double cell, double thickness, double x0, double z0)
        : domain{nx, nz, cell, x0, z0}, rock(domain.count(), 0.0F),
          before(domain.count(), sand_units(thickness)) {}

    Fields below() const { return {rock.data(), before.data(), {}}; }
    RuinLayer layer(RTCScene scene = nullptr) const {
        return RuinLayer(domain, wind, blocks.mesh(), scene, settings);
    }
    void run() {
        after.assign(domain.count(), -1);
        result = layer().move_sand(below(), after.data(), {});
        check();
    }
    // Sand is conserved to the unit and never negative.
    void check() const {
        SandUnits change = 0, least = 0, up = 0, down = 0;
        for (size_t k = 0; k < after.size(); ++k) {
            change += after[k] - before[k];
            least = std::min(least, after[k]);
            (after[k] > before[k] ? up : down) += after[k] - before[k];
        }
        EXPECT_EQ(change, result.supplied);
        EXPECT_EQ(result.given, result.taken + result.supplied);
        EXPECT_EQ(least, 0);
        EXPECT_LE(up, result.given);
        EXPECT_LE(-down, result.taken);
    }
    double rise(int i, int j) const {
        const size_t k = domain.index(i, j);
        return sand_metres(after[k] - before[k]);
    }
    double rise_at(double x, double z) const { // bilinear
        const double u = (x - domain.x0) / domain.cell, v = (z - domain.z0) / domain.cell;
        const int i = int(u), j = int(v);
        const double a = u - i, b = v - j;
        return (1 - b) * ((1 - a) * rise(i, j) + a * rise(i + 1, j)) +
               b * ((1 - a) * rise(i, j + 1) + a * rise(i + 1, j + 1));
    }
};

double ruin_seconds(const std::chrono::steady_clock::time_point& since) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

// A wall across the wind, 0.2 `counts` thick and 6 `counts` wide, its windward face at x = 0, its base 0.5
// `counts` below the sand. `height` above the sand; `counts`: the height that the layer uses.
RuinField ruin_wall(double height, double counts, double run = 0.0) {
    const double cell = counts / 16.0;
    RuinField field(16 * 10, 16 * 9, cell, counts, -3.5 * counts, -4.5 * counts);
    field.blocks.box(0.0, 0.2 * counts + run, 0.5 * counts, counts + height, -3.0 * counts, 3.0 * counts,
                     run);
    return field;
}

struct RuinExtents {
    double scour = 0.0, echo = 0.0, depth = 0.0, crest = 0.0, drift = 0.0, drift_height = 0.0;
};

// Measured along the middle of the wall in steps of 1/100 H.
RuinExtents ruin_extents(const RuinField& field, double height, double back) {
    RuinExtents e;
    const double step = 0.01 * height;
    for (double d = 0.0; d < 3.3 * height; d += step) {
        const double r = field.rise_at(-d, 0.0);
        if (r < -0.002 * height) e.scour = d;
        if (r > 0.002 * height) e.echo = d;
        e.depth = std::max(e.depth, -r), e.crest = std::max(e.crest, r);
    }
    for (double x = field.domain.cell; x < 6.0 * height; x += step) {
        const double r = field.rise_at(back + x, 0.0);
        if (r > 0.002 * height) e.drift = x;
        e.drift_height = std::max(e.drift_height, r);
    }
    return e;
}

TEST(Ruin, ZonesOfWallsFollowTheirHeight) {
    for (const double height : {0.5, 1.0, 2.0, 4.0, 8.0, 30.0, 60.0}) {
        const double h = std::min(height, 30.0);
        RuinField field = ruin_wall(height, h);
        field.run();
        const RuinExtents e = ruin_extents(field, h, 0.2 * h);
        std::printf("wall of %4.1f m: scour to %.3f H, %.3f H deep; echo to %.3f H, %.3f H high; drift to "
                    "%.3f H, %.3f "
                    "H high\n",
                    height, e.scour / h, e.depth / h, e.echo / h, e.crest / h, e.drift / h,
                    e.drift_height / h);
        EXPECT_NEAR(e.scour / h, 0.4, 0.1) << height;
        EXPECT_NEAR(e.echo / h, 2.0, 0.2) << height;
        EXPECT_NEAR(e.depth / h, 0.25, 0.03) << height;
        EXPECT_NEAR(e.crest / h, 0.16, 0.02) << height;
        EXPECT_NEAR(e.drift / h, 4.0, 0.4) << height;
        EXPECT_NEAR(e.drift_height / h, 0.3, 0.03) << height;
    }
}

TEST(Ruin, FacesOfFiftyFiveDegreesAreTheBorder) {
    for (const double angle : {40.0, 50.0, 53.0, 57.0, 65.0, 80.0}) {
        const double height = 4.0, run = height / std::tan(angle * degree);
        // the foot is 0.5 H below the sand, so the face meets the sand at a third of its run
        RuinField field = ruin_wall(height, height, 1.5 * run);
        field.settings.drift = 0.0;
        field.run();
        if (angle < 55.0) {
            EXPECT_EQ(field.result.windward, 0) << angle;
            EXPECT_EQ(field.after, field.before) << angle;
        } else {
            EXPECT_EQ(field.result.windward, 192) << angle; // lines: 6 H wide, 32 per H
            double deepest = 0.0;
            for (double x = -height; x < 0.5 * run; x += 0.05)
                deepest = std::min(deepest, field.rise_at(x, 0.0));
            EXPECT_LT(deepest, -0.2 * height) << angle;
        }
    }
}

// Steepest triangle of the grid away from the walls, in degrees. Triangles: a sample and its two axis
// neighbours.
double ruin_steepest(const RuinField& field, const std::function<bool(double, double)>& leave_out) {
    const Domain& d = field.domain;
    double steepest = 0.0;
    for (int j = 1; j + 1 < d.nz; ++j)
        for (int i = 1; i + 1 < d.nx; ++i) {
            if (leave_out(d.x(i), d.z(j))) continue;
            for (const int a : {-1, 1})
                for (const int b : {-1, 1}) {
                    if (leave_out(d.x(i + a), d.z(j)) || leave_out(d.x(i), d.z(j + b))) continue;
                    const auto h = [&](int p, int q) { return sand_metres(field.after[d.index(p, q)]); };
                    steepest =
                        std::max(steepest, std::hypot(h(i + a, j) - h(i, j), h(i, j + b) - h(i, j)) / d.cell);
                }
        }
    return std::atan(steepest) / degree;
}

TEST(Ruin, WhatItBuildsLiesAtReposeOrBelow) {
    for (const double depth : {0.25, 1.0}) {
        RuinField field = ruin_wall(4.0, 4.0);
        field.settings.scour_depth = depth;
        field.settings.drift_height = 1.0;
        field.run();
        const double steepest = ruin_steepest(
            field, [](double x, double z) { return x >= 0.0 && x <= 0.8 && std::abs(z) <= 12.0; });
        std::printf("steepest triangle: %.2f degrees\n", steepest);
        EXPECT_LT(steepest, 34.0);
        EXPECT_GT(steepest, 25.0);
    }
}

TEST(Ruin, OnGentleDunesToo) {
    RuinField field = ruin_wall(4.0, 4.0);
    field.wind = Vec2d(0.9, 0.3);
    for (int j = 0; j < field.domain.nz; ++j)
        for (int i = 0; i < field.domain.nx; ++i) // slopes of up to 15 degrees
            field.before[field.domain.index(i, j)] = sand_units(
                4.0 + 0.8 * std::sin(0.3 * field.domain.x(i)) + 0.4 * std::cos(0.4 * field.domain.z(j)));
    field.run();
    const double steepest = ruin_steepest(field, [](double x, double z) {
        return x >= -0.3 && x <= 1.1 && std::abs(z) <= 12.3; // also leaves out triangles across the wall
    });
    std::printf("steepest triangle on dunes: %.2f degrees\n", steepest);
    EXPECT_LT(steepest, 36.0);
    EXPECT_GT(field.result.taken, 0);
}

TEST(Ruin, SandIsAccountedForToTheUnit) {
    for (const double supply : {0.0, 0.3, 1.0})
        for (const double thickness : {0.0, 0.2, 5.0}) {
            RuinField field = ruin_wall(4.0, 4.0);
            for (size_t k = 0; k < field.before.size(); ++k) {
                field.before[k] = sand_units(thickness * unit_double(mix64(k)) * 2.0);
                field.rock[k] = float(4.0 - thickness);
            }
            field.settings.supply = supply;
            field.run();
            EXPECT_GT(field.result.windward, 0);
            if (supply == 0.0) {
                EXPECT_EQ(field.result.supplied, 0);
            }
            if (thickness == 0.0) {
                EXPECT_EQ(field.result.taken, 0);
            }
            if (thickness == 5.0) {
                EXPECT_GT(field.result.taken, 0);
            }
        }
    // A closed field (supply 0) where the echo dune would be outside of the terrain: only sand that can be
    // deposited is taken.
    RuinField border = ruin_wall(4.0, 4.0);
    border.domain.x0 = -1.0;
    border.settings.drift = 0.0, border.settings.supply = 0.0;
    border.run();
    EXPECT_EQ(border.result.supplied, 0);
    EXPECT_EQ(border.result.given, border.result.taken);
}

TEST(Ruin, ScourStopsAtBedrock) {
    RuinField field = ruin_wall(4.0, 4.0);
    std::fill(field.before.begin(), field.before.end(), sand_units(0.3));
    std::fill(field.rock.begin(), field.rock.end(), 3.7F);
    field.run();
    int bare = 0;
    for (const SandUnits s : field.after) bare += s == 0;
    EXPECT_GT(bare, 100); // about 6 H by 0.2 H: 96 by 4 samples
}

TEST(Ruin, AColumnScoursByItsWidthAndTrailsATaperingDrift) {
    RuinField column(16 * 12, 16 * 6, 1.0 / 16.0, 2.0, -3.0, -3.0);
    column.blocks.box(0.0, 1.0, 0.0, 10.0, -0.5, 0.5);
    column.run();
    const RuinExtents e = ruin_extents(column, 1.0, 1.0);
    std::printf("column 1 m wide, 8 m high: scour to %.3f m, echo to %.3f m, drift to %.3f m, %.3f m high\n",
                e.scour, e.echo, e.drift, e.drift_height);
    EXPECT_NEAR(e.scour, 0.4, 0.1);
    EXPECT_NEAR(e.echo, 2.0, 0.3);
    EXPECT_GT(e.drift, 2.5);
    EXPECT_LE(e.drift_height, 0.5 * std::tan(34.0 * degree));
    const auto half_width = [&](double x) {
        double z = 0.0;
        while (column.rise_at(x, z) > 0.005) z += 0.01;
        return z;
    };
    EXPECT_NEAR(half_width(1.2), 0.5, 0.12);
    EXPECT_LT(half_width(3.0), half_width(2.0));
    EXPECT_LT(half_width(2.0), half_width(1.2) + 0.01);
}

// Four walls 3 m above the sand, 10 x 10 m inside, with a door of 1.2 m in the lee wall.
RuinField ruin_room(bool closed = true) {
    RuinField field(180, 140, 0.2, 2.0, -12.0, -14.0);
    field.blocks.box(0.0, 0.5, 0.0, 5.0, -5.5, 5.5);
    if (closed) {
        field.blocks.box(10.5, 11.0, 0.0, 5.0, -5.5, -0.6);
        field.blocks.box(10.5, 11.0, 0.0, 5.0, 0.6, 5.5);
        field.blocks.box(0.5, 10.5, 0.0, 5.0, -5.5, -5.0);
        field.blocks.box(0.5, 10.5, 0.0, 5.0, 5.0, 5.5);
    }
    for (int j = 0; j < field.domain.nz; ++j)
        for (int i = 0; i < field.domain.nx; ++i)
            field.before[field.domain.index(i, j)] =
                sand_units(2.0 + 0.1 * std::sin(field.domain.x(i)) * std::cos(field.domain.z(j)));
    return field;
}

TEST(Ruin, SandInARoomLevelsUp) {
    RuinField field = ruin_room();
    field.run();
    EXPECT_EQ(field.result.rooms, 1);
    double sum = 0.0, squares = 0.0, was = 0.0, were = 0.0, n = 0.0;
    for (int j = 0; j < field.domain.nz; ++j)
        for (int i = 0; i < field.domain.nx; ++i) {
            const double x = field.domain.x(i), z = field.domain.z(j);
            if (x < 1.5 || x > 8.5 || std::abs(z) > 4.0) continue;
            const double now = sand_metres(field.after[field.domain.index(i, j)]),
                         then = sand_metres(field.before[field.domain.index(i, j)]);
            sum += now, squares += now * now, was += then, were += then * then, n += 1.0;
        }
    const double spread = std::sqrt(std::max(squares / n - sum / n * (sum / n), 0.0)),
                 had = std::sqrt(were / n - was / n * (was / n));
    std::printf("room: sand up by %.3f m, spread %.4f m, before %.4f m\n", (sum - was) / n, spread, had);
    EXPECT_NEAR((sum - was) / n, 0.2 * 2.0, 0.1); // heights are rounded to powers of two: 3 m counts as 2 m
    EXPECT_LT(spread, 0.02 * had);
    // Without the closing walls there is no room.
    RuinField open = ruin_room(false);
    open.run();
    EXPECT_EQ(open.result.rooms, 0);
}

TEST(Ruin, WhatStandsInTheLeeIsNotScoured) {
    RuinField field(240, 96, 0.125, 2.0, -6.0, -6.0);
    field.blocks.box(0.0, 0.3, 0.0, 4.0, -5.0, 5.0);
    field.blocks.box(8.0, 8.3, 0.0, 4.0, -5.0,
                     5.0); // four heights downwind: a third of it is outside of the shelter
    field.run();
    double first = 0.0, second = 0.0;
    for (double d = 0.0; d < 1.5; d += 0.05) {
        first = std::min(first, field.rise_at(-d, 0.0));
        second = std::min(second, field.rise_at(8.0 - d, 0.0));
    }
    EXPECT_NEAR(first, -0.5, 0.06);
    EXPECT_NEAR(second, -0.25 * 8.0 / 6.0 * (7.7 / 8.0), 0.06);
    // A lintel above the sand has no effect.
    RuinField lintel(160, 96, 0.125, 2.0, -10.0, -6.0);
    lintel.blocks.box(0.0, 0.5, 4.0, 5.0, -5.0, 5.0);
    lintel.run();
    EXPECT_EQ(lintel.after, lintel.before);
}

TEST(Ruin, TheWindTurnsTheResult) {
    std::vector<RuinField> fields;
    for (const double turn : {0.0, 30.0 * degree, 90.0 * degree, 210.0 * degree}) {
        RuinField& field = fields.emplace_back(280, 280, 0.125, 2.0, -17.5, -17.5);
        field.blocks.turn = turn;
        field.wind = Vec2d(std::cos(turn), std::sin(turn));
        field.blocks.box(0.0, 1.0, 1.0, 4.0, -4.0, 3.0);
        field.settings.inside = 0.0;
        field.run();
        double most = 0.0, sum = 0.0, n = 0.0;
        for (double s = -5.0; s < 12.0; s += 0.1)
            for (double t = -5.0; t < 5.0; t += 0.1) {
                if (s > -0.2 && s < 1.2 && t > -4.2 && t < 3.2) continue; // samples at the wall differ
                const double there = field.rise_at(s * field.wind.x() - t * field.wind.y(),
                                                   s * field.wind.y() + t * field.wind.x());
                const double away = std::abs(there - fields[0].rise_at(s, t));
                most = std::max(most, away), sum += away, n += 1.0;
            }
        std::printf("wind turned by %3.0f degrees: differs by %.4f m at most, %.5f m on average\n",
                    turn / degree, most, sum / n);
        EXPECT_LT(most, 0.15); // 2 H = 4 m, pit of 0.5 m: within 1.2 cells at the slope of repose
        EXPECT_LT(sum / n, 0.005);
    }
    // The wall is fixed and the wind turns: the pit is on the new windward side.
    RuinField turned(280, 280, 0.125, 2.0, -17.5, -17.5);
    turned.blocks.box(-1.0, 1.0, 1.0, 4.0, -4.0, 4.0);
    turned.wind = Vec2d(-1.0, 0.0);
    turned.run();
    EXPECT_LT(turned.rise_at(1.25, 0.0), -0.3);
    EXPECT_GT(turned.rise_at(-1.25, 0.0), 0.3);
}

TEST(Ruin, OffTheTerrainNothingChanges) {
    RuinField field = ruin_wall(4.0, 4.0);
    for (const double x0 : {1000.0, -1000.0}) {
        RuinField away = field;
        away.domain.x0 = x0;
        EXPECT_TRUE(away.layer().touched().empty());
        away.run();
        EXPECT_EQ(away.after, away.before);
    }
    RuinField none = field;
    none.blocks = {};
    none.run();
    EXPECT_EQ(none.after, none.before);
    RuinField over = field; // floats above the sand
    for (size_t v = 1; v < over.blocks.positions.size(); v += 3) over.blocks.positions[v] += 50.0F;
    over.run();
    EXPECT_EQ(over.after, over.before);
    RuinField under = field; // completely buried
    for (size_t v = 1; v < under.blocks.positions.size(); v += 3) under.blocks.positions[v] -= 50.0F;
    under.run();
    EXPECT_EQ(under.after, under.before);
}

TEST(Ruin, StrangeInputGivesNumbers) {
    const double huge = std::numeric_limits<double>::max();
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (const double v : {-huge, -1.0, 0.0, 1e-300, 7.0, huge}) {
        RuinField field = ruin_wall(2.0, 2.0);
        field.settings = {v, v, v, v, v, v, v};
        field.wind = Vec2d(v, v);
        field.run();
    }
    RuinField broken = ruin_wall(2.0, 2.0);
    broken.blocks.triangles.insert(broken.blocks.triangles.end(), {0U, 1U, 8U, 0U, 0U, 1U, 0U, 1U, 99U});
    broken.blocks.positions.insert(broken.blocks.positions.end(), {nan, 0.0F, 1e30F});
    RuinField whole = ruin_wall(2.0, 2.0);
    broken.run(), whole.run();
    EXPECT_EQ(broken.result.windward, whole.result.windward);
    RuinField tiny(1, 1, 1.0, 1.0, 0.0, 0.0); // a single sample
    tiny.blocks.box(-1.0, 1.0, 0.0, 5.0, -1.0, 1.0);
    tiny.run();
    RuinField wide = ruin_wall(2.0, 2.0); // a wall of 200 km
    wide.blocks = {};
    wide.blocks.box(0.0, 0.4, 1.0, 4.0, -1e5, 1e5);
    wide.run();
    EXPECT_NEAR(ruin_extents(wide, 2.0, 0.4).scour, 0.8, 0.2);
    EXPECT_NEAR(ruin_extents(wide, 2.0, 0.4).depth, 0.5, 0.06);
    RuinField sheet(160, 160, 0.125, 1.0, -10.0, -10.0); // one triangle in either orientation
    for (const auto& flip : {std::array{0U, 1U, 2U}, std::array{0U, 2U, 1U}}) {
        sheet.blocks = {};
        sheet.blocks.corner(0.0, 0.0, -4.0), sheet.blocks.corner(0.0, 0.0, 4.0),
            sheet.blocks.corner(0.0, 5.0, 0.0);
        sheet.blocks.triangles.assign(flip.begin(), flip.end());
        sheet.run();
        EXPECT_LT(sheet.rise_at(-0.1, 0.0), -0.2);
        EXPECT_GT(sheet.rise_at(0.4, 0.0), 0.2);
    }
}

TEST(Ruin, SameBitsFarFromTheOrigin) {
    RuinField near(160, 144, 0.25, 4.0, -14.0, -18.0),
        far(160, 144, 0.25, 4.0, 65536.0 - 14.0, -32768.0 - 18.0);
    near.blocks.box(0.0, 1.0, 2.0, 8.0, -12.0, 12.0);
    far.blocks.box(65536.0, 65537.0, 2.0, 8.0, -32768.0 - 12.0, -32768.0 + 12.0);
    near.run(), far.run();
    EXPECT_GT(near.result.taken, 0);
    EXPECT_EQ(near.after, far.after);
}

TEST(Ruin, SameBitsOnAnyThreadCount) {
    std::vector<std::vector<SandUnits>> results;
    for (const int threads : {1, 2, 5}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        RuinField field = ruin_room();
        field.wind = Vec2d(0.8, 0.6);
        field.run();
        results.push_back(field.after);
    }
    EXPECT_EQ(results[0], results[1]);
    EXPECT_EQ(results[0], results[2]);
}

TEST(Ruin, OnlyTouchedTilesAreStaleAfterAnEdit) {
    RuinField field(1024, 1024, 0.25, 2.0, -128.0, -128.0);
    field.blocks.box(0.0, 1.0, 0.0, 4.0, -4.0, 4.0);
    const RuinLayer before = field.layer();
    EXPECT_TRUE(field.layer().changed_since(before, field.domain).none());
    field.settings.drift_length = 8.0;
    const RuinLayer edited = field.layer();
    const Tiles stale = edited.changed_since(before, field.domain);
    EXPECT_GT(stale.count(), 0);
    EXPECT_LT(stale.count(), 16);
    std::vector<SandUnits> a(field.domain.count()), b(field.domain.count());
    before.move_sand(field.below(), a.data(), {});
    edited.move_sand(field.below(), b.data(), {});
    int outside = 0, differ = 0;
    for (int j = 0; j < field.domain.nz; ++j)
        for (int i = 0; i < field.domain.nx; ++i) {
            const size_t k = field.domain.index(i, j);
            if (a[k] == b[k]) continue;
            ++differ;
            outside += !stale.has(i / Tiles::side, j / Tiles::side);
        }
    EXPECT_GT(differ, 0);
    EXPECT_EQ(outside, 0);
}

TEST(Ruin, TheLayerIsMadeFromAScene) {
    RuinField field = ruin_wall(4.0, 4.0);
    field.run();
    MarramMesh mesh = field.blocks.mesh();
    mesh.name = "ruin";
    std::vector<MarramValue> list;
    const auto number = [&](const char* name, const double& v) {
        MarramValue value{};
        value.name = name, value.type = MARRAM_NUMBER, value.numbers = &v, value.number_count = 1,
        value.place = "";
        value.text = "";
        list.push_back(value);
    };
    const double one = 1.0, depth = 0.25, length = 4.0, high = 0.3, inside = 0.2;
    number("layer[0].scour", one), number("layer[0].scour_depth", depth), number("layer[0].drift", one);
    number("layer[0].drift_length", length), number("layer[0].drift_height", high);
    number("layer[0].inside", inside), number("layer[0].supply", one);
    MarramValue named{};
    named.name = "layer[0].mesh", named.type = MARRAM_MESH_NAME, named.text = "ruin", named.place = "";
    list.push_back(named);
    const Values values(list);
    const LayerValues own(values, 0);
    const RTCDevice device = rtcNewDevice("set_affinity=0,start_threads=0");
    const RTCScene scene = rtcNewScene(device);
    int warnings = 0;
    LayerContext context{own, field.domain, field.wind, 0, {}, {}, {}, scene, {}};
    context.mesh = [&](std::string_view name) -> const MarramMesh& {
        EXPECT_EQ(name, "ruin");
        return mesh;
    };
    context.warn = [&](const std::string&, const std::string&, const std::string&) { ++warnings; };
    const std::unique_ptr<TerrainLayer> layer = ruin_layer_type().make(context);
    context.domain.x0 += 1e4;
    EXPECT_FALSE(ruin_layer_type().make(context) == nullptr);
    EXPECT_EQ(warnings, 1);
    rtcReleaseScene(scene); // the layer keeps no reference to the scene
    rtcReleaseDevice(device);
    std::vector<SandUnits> sand(field.domain.count());
    EXPECT_TRUE(layer->evaluate_whole(field.below(), {nullptr, sand.data(), {}}, {}));
    EXPECT_EQ(sand, field.after);
    EXPECT_FALSE(layer->evaluate_whole(field.below(), {nullptr, sand.data(), {}}, [] { return true; }));
    EXPECT_EQ(sand, field.before);
}

TEST(Ruin, CostIsPrinted) {
    RuinField field(512, 512, 0.25, 2.0, -64.0, -64.0);
    for (int k = 0; k < 9; ++k) {
        const double x = -36.0 + 24.0 * (k % 3), z = -36.0 + 24.0 * (k / 3);
        field.blocks.box(x, x + 1.0, 0.0, 5.0, z - 5.0, z + 5.0);
        field.blocks.box(x + 9.0, x + 10.0, 0.0, 5.0, z - 5.0, z + 5.0);
        field.blocks.box(x + 1.0, x + 9.0, 0.0, 5.0, z + 4.0, z + 5.0);
        field.blocks.box(x + 1.0, x + 9.0, 0.0, 5.0, z - 5.0, z - 4.0);
    }
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        const auto begin = std::chrono::steady_clock::now();
        const std::clock_t cpu = std::clock();
        field.run();
        const double wall = ruin_seconds(begin), busy = double(std::clock() - cpu) / CLOCKS_PER_SEC;
        const Rect r = field.layer().touched();
        const double samples = double(r.i1 - r.i0) * (r.j1 - r.j0);
        std::printf(
            "%d thread(s): %.0f ns a sample of the zones, %.0f ns of processors; %d rooms, %d + %d faces\n",
            threads, wall * 1e9 / samples, busy * 1e9 / samples, field.result.rooms, field.result.windward,
            field.result.lee);
    }
    EXPECT_EQ(field.result.rooms, 9);
}

} // namespace
} // namespace marram
