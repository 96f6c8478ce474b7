// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/mesh/lattice.h"

#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <cstdio>
#include <cstring>

namespace marram {
namespace {

double uniform(uint64_t seed, uint64_t i) { return 2.0 * unit_double(hash(seed, i)) - 1.0; }

LatticeNet even_net(int nu, int nv, double step, double turn = 0.0) {
    LatticeNet net;
    net.nu = nu, net.nv = nv;
    net.origin = {7.3, 5.9};
    net.along_row = step * Vec2d(std::cos(turn), std::sin(turn));
    net.across_rows = step * Vec2d(-std::sin(turn), std::cos(turn));
    net.offsets.assign(size_t(nu) * size_t(nv), Vec3d::Zero());
    return net;
}

LatticeNet random_net(uint64_t seed, double most, bool skewed = true) {
    LatticeNet net = even_net(6, 5, 4.0, skewed ? 0.4 : 0.0);
    if (skewed) net.across_rows += 0.3 * net.along_row;
    for (size_t k = 0; k < net.offsets.size(); ++k)
        net.offsets[k] =
            most * Vec3d(uniform(seed, 3 * k), uniform(seed, 3 * k + 1), uniform(seed, 3 * k + 2));
    return net;
}

// Bedrock, sand and a mask on a grid, with room for the output of a layer.
struct FlatGround {
    explicit FlatGround(const Domain& d) : domain(d), bedrock(d.count()), sand(d.count()), mask(d.count()) {
        for (int j = 0; j < d.nz; ++j)
            for (int i = 0; i < d.nx; ++i) {
                const double x = d.x(i), z = d.z(j);
                bedrock[d.index(i, j)] = float(2.0 * std::sin(0.31 * x) + std::cos(0.23 * z + 0.1 * x));
                sand[d.index(i, j)] = sand_units(std::max(0.0, std::sin(0.2 * x - 0.17 * z)));
                mask[d.index(i, j)] = float(0.5 + 0.5 * std::sin(0.4 * z));
            }
        views = {{"m", mask.data()}};
    }
    Fields fields() const { return {bedrock.data(), sand.data(), views}; }

    Domain domain;
    std::vector<float> bedrock;
    std::vector<SandUnits> sand;
    std::vector<float> mask;
    std::vector<MaskView> views;
};

struct Result {
    std::vector<float> bedrock, mask;
    std::vector<SandUnits> sand;
    bool operator==(const Result& o) const {
        return sand == o.sand && std::memcmp(bedrock.data(), o.bedrock.data(), bedrock.size() * 4) == 0 &&
               std::memcmp(mask.data(), o.mask.data(), mask.size() * 4) == 0;
    }
};

Result evaluate(const LatticeLayer& layer, const FlatGround& below, int width = Tiles::side) {
    const Domain& d = below.domain;
    Result result{below.bedrock, std::vector<float>(d.count(), -1.0F), std::vector<SandUnits>(d.count(), -1)};
    float* masks[] = {result.mask.data()};
    const LayerOutput out{layer.writes().bedrock ? result.bedrock.data() : nullptr, result.sand.data(),
                          masks};
    tbb::parallel_for(0, (d.nz + width - 1) / width, [&](int row) {
        for (int i = 0; i < d.nx; i += width)
            layer.evaluate({i, row * width, std::min(i + width, d.nx), std::min((row + 1) * width, d.nz)},
                           below.fields(), out);
    });
    return result;
}

const Domain ground_domain{200, 150, 0.25, -5.0, -4.0};
constexpr auto bedrock = LatticeLayer::Target::bedrock;

TEST(Lattice, NetThatIsNotBentChangesNoBit) {
    const FlatGround below(ground_domain);
    for (const auto target : {bedrock, LatticeLayer::Target::sand}) {
        const LatticeLayer layer(even_net(5, 4, 6.0, 0.3), below.domain, target, {"m"});
        EXPECT_TRUE(evaluate(layer, below) == (Result{below.bedrock, below.mask, below.sand}));
        EXPECT_EQ(layer.reach(), 0.0);
    }
}

TEST(Lattice, LeavesBitsOutsideOfItsSupport) {
    const FlatGround below(ground_domain);
    const LatticeLayer layer(random_net(3, 1.0), below.domain, bedrock, {"m"});
    const Result result = evaluate(layer, below);
    Eigen::Matrix2d axes;
    const LatticeNet net = random_net(3, 1.0);
    axes << net.along_row.x(), net.across_rows.x(), net.along_row.y(), net.across_rows.y();
    int outside = 0, changed = 0;
    for (int j = 0; j < below.domain.nz; ++j)
        for (int i = 0; i < below.domain.nx; ++i) {
            const Vec2d p = axes.inverse() * (Vec2d(below.domain.x(i), below.domain.z(j)) - net.origin);
            const size_t at = below.domain.index(i, j);
            const bool same = result.bedrock[at] == below.bedrock[at] && result.sand[at] == below.sand[at] &&
                              result.mask[at] == below.mask[at];
            if (p.x() > -2.0 && p.y() > -2.0 && p.x() < net.nu + 1.0 && p.y() < net.nv + 1.0) {
                changed += !same;
                continue;
            }
            ++outside;
            ASSERT_TRUE(same) << i << " " << j;
        }
    EXPECT_GT(outside, 5000);
    EXPECT_GT(changed, 5000);
}

TEST(Lattice, KnownVerticalShearIsExact) {
    const FlatGround below(ground_domain);
    LatticeNet net = even_net(8, 7, 4.0, 0.2);
    for (int j = 0; j < net.nv; ++j)
        for (int i = 0; i < net.nu; ++i) net.offsets[size_t(j * net.nu + i)].y() = 0.7 + 0.4 * i - 0.25 * j;
    const LatticeLayer layer(net, below.domain, bedrock, {"m"});
    const Result result = evaluate(layer, below);
    EXPECT_TRUE(result.sand == below.sand);
    EXPECT_TRUE(result.mask == below.mask);
    int tested = 0;
    for (int j = 0; j < below.domain.nz; ++j)
        for (int i = 0; i < below.domain.nx; ++i) {
            const Vec2d p = Vec2d(below.domain.x(i), below.domain.z(j)) - net.origin;
            const double u = p.dot(net.along_row) / 16.0, v = p.dot(net.across_rows) / 16.0;
            if (u < 1.0 || v < 1.0 || u > net.nu - 2.0 || v > net.nv - 2.0) continue;
            const size_t at = below.domain.index(i, j);
            const double exact = below.bedrock[at] + 0.7 + 0.4 * u - 0.25 * v;
            ASSERT_NEAR(result.bedrock[at], exact, 1e-12 + std::abs(exact) * 0x1p-24);
            ++tested;
        }
    EXPECT_GT(tested, 4000);
}

TEST(Lattice, WholeShiftMovesSamplesAndKeepsThickness) {
    const FlatGround below(ground_domain);
    LatticeNet net = even_net(8, 8, 4.0);
    for (Vec3d& offset : net.offsets) offset = {0.75, 0.0, -0.5}; // 3 and -2 samples
    const LatticeLayer layer(net, below.domain, bedrock, {"m"});
    const Result result = evaluate(layer, below);
    for (int j = 60; j < 100; ++j)
        for (int i = 80; i < 120; ++i) {
            const size_t to = below.domain.index(i, j), from = below.domain.index(i - 3, j + 2);
            ASSERT_NEAR(result.bedrock[to], below.bedrock[from], 1e-6);
            ASSERT_NEAR(sand_metres(result.sand[to]), sand_metres(below.sand[from]), 1e-8);
            ASSERT_NEAR(result.mask[to], below.mask[from], 1e-6);
        }
}

// The fields are known in closed form, so the interpolation error can be measured: third order.
TEST(Lattice, ResampledHeightsConverge) {
    double error[2] = {0.0, 0.0};
    for (int fine = 0; fine < 2; ++fine) {
        Domain d = ground_domain;
        if (fine) d.nx *= 2, d.nz *= 2, d.cell *= 0.5;
        const FlatGround below(d);
        const LatticeLayer layer(random_net(11, 1.0), d, bedrock, {"m"});
        ASSERT_FALSE(layer.map().fold());
        const Result result = evaluate(layer, below);
        for (int j = 8; j < d.nz - 8; ++j)
            for (int i = 8; i < d.nx - 8; ++i) {
                const Vec2d p = layer.map().inverse({d.x(i), d.z(j)});
                const double exact = 2.0 * std::sin(0.31 * p.x()) + std::cos(0.23 * p.y() + 0.1 * p.x()) +
                                     layer.map().offset(p).y();
                error[fine] = std::max(error[fine], std::abs(result.bedrock[d.index(i, j)] - exact));
            }
    }
    std::printf("greatest error of a resampled height: %.2e m, half the cell: %.2e m\n", error[0], error[1]);
    EXPECT_LT(error[0], 1e-4);
    EXPECT_LT(error[1], 0.2 * error[0]);
}

TEST(Lattice, MapAndInverseCancel) {
    constexpr double cell = 0.25;
    double worst = 0.0, squeezed = 1.0;
    int nets = 0;
    for (uint64_t seed = 0; seed < 200; ++seed) {
        const LatticeMap map(random_net(seed, 1.0 + 0.02 * double(seed)), 1e-9 * cell);
        if (map.fold()) continue;
        ++nets;
        for (uint64_t k = 0; k < 300; ++k) {
            const Vec2d p(14.0 + 20.0 * uniform(seed + 1000, 2 * k),
                          14.0 + 20.0 * uniform(seed + 1000, 2 * k + 1));
            squeezed = std::min(squeezed, map.jacobian(p));
            worst = std::max(
                {worst, (map.inverse(map.forward(p)) - p).norm(), (map.forward(map.inverse(p)) - p).norm()});
        }
    }
    std::printf("%d nets, smallest Jacobian %.4f, worst of map and inverse %.1e cells\n", nets, squeezed,
                worst / cell);
    EXPECT_GT(nets, 40);
    EXPECT_LT(squeezed, 0.05);
    EXPECT_LT(worst, 1e-6 * cell);
}

TEST(Lattice, FoldsAreFoundWhereTheyAre) {
    int folded = 0, free = 0;
    constexpr int steps = 12;
    for (uint64_t seed = 0; seed < 200; ++seed) {
        const LatticeNet net = random_net(seed, 0.5 + 0.04 * double(seed));
        const LatticeMap map(net, 1e-9);
        const auto fold = map.fold();
        double lowest = infinity, in_cell = infinity;
        for (int v = -2 * steps; v <= (net.nv + 1) * steps; ++v)
            for (int u = -2 * steps; u <= (net.nu + 1) * steps; ++u) {
                const double cu = double(u) / steps, cv = double(v) / steps;
                const double j = map.jacobian(net.origin + cu * net.along_row + cv * net.across_rows);
                lowest = std::min(lowest, j);
                if (fold && cu >= fold->i && cu <= fold->i + 1 && cv >= fold->j && cv <= fold->j + 1)
                    in_cell = std::min(in_cell, j);
            }
        if (!fold) {
            ++free;
            ASSERT_GT(lowest, LatticeMap::min_jacobian) << seed;
        } else {
            ++folded;
            // Samples a twelfth of a cell apart may miss the minimum slightly.
            ASSERT_LT(in_cell, 0.03) << seed;
        }
    }
    std::printf("%d nets folded, %d free\n", folded, free);
    EXPECT_GT(folded, 20);
    EXPECT_GT(free, 20);
}

// Second differences of the offset are continuous along a line through the whole support.
TEST(Lattice, FadesWithoutACrease) {
    const LatticeNet net = random_net(5, 1.0, false);
    const LatticeMap map(net, 1e-9);
    constexpr double step = 1e-2;
    const auto bend = [&](double x, int axis) {
        const auto at = [&](double t) { return map.offset({t, 14.0})[axis]; };
        return (at(x - step) - 2.0 * at(x) + at(x + step)) / (step * step);
    };
    for (int axis = 0; axis < 3; ++axis)
        for (double x = net.origin.x() - 9.0; x < net.origin.x() + 30.0; x += step)
            // The third derivative of an offset of 1 m over cells of 4 m is at most 8 / 4^3.
            ASSERT_NEAR(bend(x, axis), bend(x + step, axis), 0.13 * step) << x;
    EXPECT_EQ(map.offset({net.origin.x() - 8.0, 14.0}), Vec3d::Zero());
    EXPECT_NE(map.offset({net.origin.x() - 7.5, 14.0}), Vec3d::Zero());
}

TEST(Lattice, ReachIsHonest) {
    const FlatGround below(ground_domain);
    const LatticeLayer layer(random_net(3, 1.2), below.domain, bedrock, {"m"});
    ASSERT_FALSE(layer.map().fold());
    const Result before = evaluate(layer, below);
    const Domain& d = below.domain;
    double furthest = 0.0;
    for (uint64_t k = 0; k < 40; ++k) {
        const int i = 20 + int(160 * unit_double(hash(91, k))), j = 20 + int(110 * unit_double(hash(92, k)));
        FlatGround other = below;
        other.views = {{"m", other.mask.data()}};
        other.bedrock[d.index(i, j)] += 1.0F;
        other.sand[d.index(i, j)] += sand_units(1.0);
        other.mask[d.index(i, j)] = 0.0F;
        const Result after = evaluate(layer, other);
        for (int b = 0; b < d.nz; ++b)
            for (int a = 0; a < d.nx; ++a) {
                const size_t at = d.index(a, b);
                if (before.bedrock[at] == after.bedrock[at] && before.sand[at] == after.sand[at] &&
                    before.mask[at] == after.mask[at])
                    continue;
                furthest = std::max(furthest, d.cell * std::hypot(a - i, b - j));
            }
    }
    std::printf("reach %.2f m, the furthest change %.2f m\n", layer.reach(), furthest);
    EXPECT_LE(furthest, layer.reach());
    EXPECT_GT(furthest, 0.3 * layer.reach());
}

TEST(Lattice, SameBitsHoweverItIsCutAndOnAnyNumberOfThreads) {
    const FlatGround below(ground_domain);
    const LatticeLayer layer(random_net(3, 1.2), below.domain, bedrock, {"m"});
    const Result whole = evaluate(layer, below);
    EXPECT_TRUE(evaluate(layer, below, 17) == whole);
    EXPECT_TRUE(evaluate(layer, below, 1000) == whole);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_TRUE(evaluate(layer, below) == whole);
}

TEST(Lattice, SandAloneIsNeverNegative) {
    const FlatGround below(ground_domain);
    LatticeNet net = random_net(8, 1.0);
    for (Vec3d& offset : net.offsets) offset.y() -= 0.5;
    const LatticeLayer layer(net, below.domain, LatticeLayer::Target::sand, {"m"});
    EXPECT_FALSE(layer.writes().bedrock);
    const Result result = evaluate(layer, below);
    int none = 0;
    for (const SandUnits sand : result.sand) {
        ASSERT_GE(sand, 0);
        none += sand == 0;
    }
    EXPECT_GT(none, 1000);
    EXPECT_FALSE(result.sand == below.sand);
}

TEST(Lattice, ChangedTilesHoldEveryChange) {
    const Domain d{400, 300, 0.25, -30.0, -20.0};
    const FlatGround below(d);
    for (const bool moved : {false, true}) {
        LatticeNet net = random_net(3, 1.0);
        const LatticeLayer before(net, d, bedrock, {"m"});
        net.offsets[8] += Vec3d(0.5, 1.0, 0.3);
        if (moved) net.origin.x() += 3.0;
        const LatticeLayer after(net, d, bedrock, {"m"});
        const Tiles changed = after.changed_since(before, d);
        EXPECT_FALSE(changed.all());
        const Result a = evaluate(before, below), b = evaluate(after, below);
        int differ = 0;
        for (int j = 0; j < d.nz; ++j)
            for (int i = 0; i < d.nx; ++i) {
                const size_t at = d.index(i, j);
                if (a.bedrock[at] == b.bedrock[at] && a.sand[at] == b.sand[at] && a.mask[at] == b.mask[at])
                    continue;
                ++differ;
                ASSERT_TRUE(changed.has(i / Tiles::side, j / Tiles::side)) << i << " " << j;
            }
        EXPECT_GT(differ, 1000);
    }
}

TEST(Lattice, ExtremesStayFinite) {
    for (const double cell : {1e-6, 1.0, 1e6})
        for (const double lift : {0.0, 1e9, -1e9}) {
            const Domain d{70, 66, cell, 1e6, -1e6};
            const FlatGround below(d);
            LatticeNet net = random_net(4, 0.0);
            net.origin = {1e6 + 20 * cell, -1e6 + 20 * cell};
            net.along_row *= cell, net.across_rows *= cell;
            for (size_t k = 0; k < net.offsets.size(); ++k)
                net.offsets[k] = {cell * uniform(1, k), lift, cell * uniform(2, k)};
            for (const auto target : {bedrock, LatticeLayer::Target::sand}) {
                const LatticeLayer layer(net, d, target, {"m"});
                ASSERT_FALSE(layer.map().fold());
                const Result result = evaluate(layer, below);
                for (const float b : result.bedrock) ASSERT_TRUE(std::isfinite(b));
                for (const float m : result.mask) ASSERT_TRUE(m >= 0.0F && m <= 1.0F);
                for (const SandUnits s : result.sand) ASSERT_GE(s, 0);
            }
        }
}

// ---- From a scene -------------------------------------------------------------------------------------------------------

std::vector<DrawnCurve> rows_of(const LatticeNet& net, bool bent) {
    std::vector<DrawnCurve> rows(static_cast<size_t>(net.nv));
    for (int j = 0; j < net.nv; ++j)
        for (int i = 0; i < net.nu; ++i) {
            const Vec2d rest = net.origin + i * net.along_row + j * net.across_rows;
            Vec3d p(rest.x(), 20.0, rest.y());
            if (bent) p += net.offsets[size_t(j * net.nu + i)];
            rows[size_t(j)].points.push_back(p);
        }
    return rows;
}

std::string fault_of(const std::vector<DrawnCurve>& rest, const std::vector<DrawnCurve>& bent,
                     std::string* what = nullptr) {
    const auto text = [](const char* name, MarramParamType type, const char* value) {
        return MarramValue{name, type, nullptr, 0, value, nullptr, "scene.toml:3:1"};
    };
    const MarramValue list[] = {
        text("layer[0].rest", MARRAM_CURVES_NAME, "rest"), text("layer[0].bent", MARRAM_CURVES_NAME, "bent"),
        text("layer[0].target", MARRAM_CHOICE, "bedrock"), text("layer[0].masks", MARRAM_TEXT, "m, n")};
    const Values all(list);
    const LayerValues values(all, 0);
    const LayerContext context{values,
                               ground_domain,
                               Vec2d(1, 0),
                               0,
                               {"n", "m"},
                               [&](std::string_view name) { return name == "rest" ? rest : bent; },
                               {},
                               nullptr,
                               [&](const std::string&, const std::string& warned, const std::string&) {
                                   if (what) *what = warned;
                               }};
    try {
        const auto layer = lattice_layer_type().make(context);
        EXPECT_EQ(layer->mask_names(), (std::vector<std::string>{"m", "n"}));
        EXPECT_EQ(lattice_layer_type().masks(values), layer->mask_names());
        return "";
    } catch (const SceneFault& fault) {
        EXPECT_EQ(fault.place, "scene.toml:3:1");
        if (what) *what = fault.what();
        return fault.id;
    }
}

TEST(Lattice, IsMadeFromDrawnCurves) {
    const LatticeNet net = random_net(2, 1.0);
    const LatticeNet read = lattice_net(rows_of(net, false), rows_of(net, true), "");
    EXPECT_EQ(read.nu, net.nu);
    EXPECT_EQ(read.nv, net.nv);
    EXPECT_LT((read.along_row - net.along_row).norm() + (read.across_rows - net.across_rows).norm(), 1e-12);
    for (size_t k = 0; k < net.offsets.size(); ++k)
        EXPECT_LT((read.offsets[k] - net.offsets[k]).norm(), 1e-12);
    EXPECT_EQ(fault_of(rows_of(net, false), rows_of(net, true)), "");
}

TEST(Lattice, RefusesWhatIsNoLattice) {
    const LatticeNet net = random_net(2, 1.0);
    const auto rest = rows_of(net, false), bent = rows_of(net, true);
    auto other = bent;
    other.pop_back();
    EXPECT_EQ(fault_of(rest, other), "lattice.rows_differ");
    other = bent;
    other[2].points.pop_back();
    EXPECT_EQ(fault_of(rest, other), "lattice.rows_differ");
    other = rest;
    other[2].points[1].x() += 0.5;
    EXPECT_EQ(fault_of(other, bent), "lattice.uneven");
    other = rest;
    for (DrawnCurve& row : other) row = rest[0];
    EXPECT_EQ(fault_of(other, bent), "lattice.no_area");
    other = bent;
    other[1].points[1].y() = infinity;
    EXPECT_EQ(fault_of(rest, other), "lattice.too_far");
    EXPECT_EQ(fault_of({}, {}), "lattice.too_few");
}

TEST(Lattice, WarnsOfALiftBeyondTheTerrain) {
    LatticeNet net = even_net(6, 5, 4.0);
    std::string warned;
    net.offsets[size_t(2 * net.nu + 3)] = {0.0, 5.0, 0.0};
    EXPECT_EQ(fault_of(rows_of(net, false), rows_of(net, true), &warned), "");
    EXPECT_EQ(warned, "");
    net.offsets[size_t(2 * net.nu + 3)] = {0.0, -1e7, 0.0};
    EXPECT_EQ(fault_of(rows_of(net, false), rows_of(net, true), &warned), "");
    EXPECT_EQ(warned.find("the lattice moves the ground up or down by as much as 1e+07 m"), 0U) << warned;
}

TEST(Lattice, RefusesAFoldAndNamesItsCell) {
    LatticeNet net = even_net(6, 5, 4.0);
    net.offsets[size_t(2 * net.nu + 3)] = {12.0, 0.0, 0.0}; // three cells: past two neighbours
    std::string what;
    EXPECT_EQ(fault_of(rows_of(net, false), rows_of(net, true), &what), "lattice.fold");
    const LatticeMap map(net, 1e-9);
    const auto fold = map.fold();
    ASSERT_TRUE(fold);
    EXPECT_NE(what.find("(" + std::to_string(fold->i) + ", " + std::to_string(fold->j) + ")"),
              std::string::npos);
    // The slope of the offset falls to -1 and below ahead of the moved point, at most two cells ahead.
    EXPECT_GE(fold->i, 3);
    EXPECT_LE(fold->i, 4);
    double lowest = infinity;
    for (double u = 0.0; u <= 1.0; u += 0.05)
        for (double v = 0.0; v <= 1.0; v += 0.05)
            lowest = std::min(lowest, map.jacobian(net.origin + (fold->i + u) * net.along_row +
                                                   (fold->j + v) * net.across_rows));
    EXPECT_LE(lowest, LatticeMap::min_jacobian);
}

TEST(Lattice, Speed) {
    const Domain d{1024, 1024, 0.03, -5.0, -4.0};
    const FlatGround below(d);
    const LatticeLayer layer(random_net(3, 1.2), d, bedrock, {"m"});
    for (const int threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
        const auto start = std::chrono::steady_clock::now();
        evaluate(layer, below);
        const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        std::printf("%d threads: %.0f ns a sample\n", threads, 1e9 * s / double(d.count()));
    }
}

} // namespace
} // namespace marram
