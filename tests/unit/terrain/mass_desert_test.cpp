// SPDX-License-Identifier: Apache-2.0
// The mass desert: equal seeds give equal dunes, statistics match the settings, an edit changes one dune
// only.
#include "procedural/terrain/mass/mass_desert.h"

#include "core/math/digest.h"
#include "core/math/hash.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <ctime>
#include <map>
#include <set>

using namespace marram;

namespace {

const Vec2d mass_low(-700.0, -300.0), mass_high(3300.0, 3700.0);

// Digest of all members of a dune.
uint64_t dune_digest(const MassDune& dune) {
    Digest digest;
    digest.add(dune.id).add(uint64_t(dune.kind));
    for (const double x : {dune.at.x(), dune.at.y(), dune.angle, dune.height, dune.width, dune.length})
        digest.add(&x, sizeof x);
    for (const std::vector<Vec2d>& crest : dune.crests)
        digest.add(crest.data(), crest.size() * sizeof(Vec2d));
    for (const auto& crest : dune.crests) digest.add(DuneShape(crest, false, dune.settings).digest());
    return digest.value();
}

std::map<uint64_t, uint64_t> digests(const std::vector<MassDune>& dunes) {
    std::map<uint64_t, uint64_t> by_id;
    for (const MassDune& dune : dunes) by_id[dune.id] = dune_digest(dune);
    return by_id;
}

// Kolmogorov-Smirnov statistic: maximum difference between the distribution of `values` and F, times the root
// of their number.
template <typename Function>
double ks(std::vector<double> values, Function&& f) {
    std::sort(values.begin(), values.end());
    double worst = 0.0;
    const double n = double(values.size());
    for (size_t i = 0; i < values.size(); ++i)
        worst = std::max(
            {worst, std::abs(f(values[i]) - double(i) / n), std::abs(f(values[i]) - double(i + 1) / n)});
    return worst * std::sqrt(n);
}
constexpr double ks_limit = 1.95; // exceeded by chance once in 1000

double nearest(const std::vector<MassDune>& dunes) {
    double least = infinity;
    for (size_t a = 0; a < dunes.size(); ++a)
        for (size_t b = 0; b < a; ++b) least = std::min(least, (dunes[a].at - dunes[b].at).norm());
    return least;
}

MassSettings all_of(MassKind kind) {
    MassSettings settings;
    settings.kind = kind;
    return settings;
}

struct MassGround {
    explicit MassGround(const Domain& d) : domain(d), bedrock(d.count()), sand(d.count()) {}
    Fields fields() const { return {bedrock.data(), sand.data(), {}}; }
    Domain domain;
    std::vector<float> bedrock;
    std::vector<SandUnits> sand;
};

std::vector<SandUnits> evaluated(const TerrainLayer& layer, const MassGround& ground) {
    std::vector<SandUnits> sand(ground.domain.count());
    const std::vector<Rect> rects = Tiles(ground.domain, true).rects();
    tbb::parallel_for(size_t(0), rects.size(), [&](size_t r) {
        layer.evaluate(rects[r], ground.fields(), {nullptr, sand.data(), {}});
    });
    return sand;
}

// A single dune with +x downwind.
MassDune alone(MassKind kind, double height) {
    MassSettings settings = all_of(kind);
    settings.arrangement = MassArrangement::cells;
    settings.spacing = {2000.0, 2000.0};
    settings.height = {height, height};
    settings.dispersion = 0.0;
    return generate_dunes(settings, {0.0, 0.0}, {2000.0, 2000.0}).at(0);
}

} // namespace

TEST(MassDesert, SameSeedSameDunesAtAnyThreadCountAndArea) {
    MassSettings settings;
    for (const MassArrangement arrangement :
         {MassArrangement::random, MassArrangement::across, MassArrangement::cells}) {
        settings.arrangement = arrangement;
        const auto many = digests(generate_dunes(settings, mass_low, mass_high));
        EXPECT_GT(many.size(), 100U);
        {
            const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
            EXPECT_EQ(digests(generate_dunes(settings, mass_low, mass_high)), many);
        }
        const auto part = generate_dunes(settings, {100.0, 200.0}, {1300.0, 1500.0});
        EXPECT_GT(part.size(), 20U);
        for (const auto& [id, digest] : digests(part)) EXPECT_EQ(many.at(id), digest);
        size_t inside = 0;
        for (const MassDune& dune : generate_dunes(settings, mass_low, mass_high))
            inside +=
                dune.at.x() >= 100.0 && dune.at.y() >= 200.0 && dune.at.x() < 1300.0 && dune.at.y() < 1500.0;
        EXPECT_EQ(inside, part.size());
        MassSettings other = settings;
        other.seed = 1;
        for (const auto& [id, digest] : digests(generate_dunes(other, mass_low, mass_high)))
            EXPECT_TRUE(!many.contains(id) || many.at(id) != digest);
    }
}

TEST(MassDesert, IdsAreUniqueAndExactAsDoubles) {
    MassSettings settings;
    for (const MassArrangement arrangement :
         {MassArrangement::random, MassArrangement::across, MassArrangement::cells}) {
        settings.arrangement = arrangement;
        std::set<uint64_t> ids;
        for (const MassDune& dune : generate_dunes(settings, mass_low, mass_high)) {
            EXPECT_TRUE(ids.insert(dune.id).second);
            EXPECT_EQ(uint64_t(double(dune.id)), dune.id);
        }
    }
}

TEST(MassDesert, HeightsAndAnglesAreDistributedAsAsked) {
    MassSettings settings = all_of(MassKind::dome);
    settings.spacing = {40.0, 60.0};
    settings.dispersion = 12.0 * degree;
    settings.wind = Vec2d(0.6, 0.8);
    const auto dunes = generate_dunes(settings, mass_low, mass_high);
    ASSERT_GT(dunes.size(), 1000U);
    std::vector<double> heights;
    double mean = 0.0, square = 0.0;
    for (const MassDune& dune : dunes) {
        heights.push_back(dune.height);
        EXPECT_GE(dune.height, 2.0);
        EXPECT_LE(dune.height, 6.0);
        const double turn = dune.angle - std::atan2(0.8, 0.6);
        mean += turn;
        square += turn * turn;
    }
    const double n = double(dunes.size()), statistic = ks(heights, [](double h) { return (h - 2.0) / 4.0; });
    const double deviation = std::sqrt(square / n - mean / n * mean / n) / degree;
    std::printf("%zu dunes: KS of the heights %.2f (limit %.2f), angle %.2f +- %.2f degrees\n", dunes.size(),
                statistic, ks_limit, mean / n / degree, deviation);
    EXPECT_LT(statistic, ks_limit);
    EXPECT_LT(std::abs(mean / n), 3.3 * settings.dispersion / std::sqrt(n));
    EXPECT_NEAR(deviation, 12.0, 12.0 * 3.3 / std::sqrt(2.0 * n));
}

TEST(MassDesert, SpacingAndDensity) {
    MassSettings settings = all_of(MassKind::dome);
    for (const Vec2d& spacing : {Vec2d(80.0, 80.0), Vec2d(80.0, 140.0)}) {
        settings.spacing = spacing;
        settings.arrangement = MassArrangement::random;
        const auto dunes = generate_dunes(settings, mass_low, mass_high);
        const double mean = 0.5 * spacing.sum(), filled = double(dunes.size()) * mean * mean / 16e6;
        std::printf(
            "random, spacing %g to %g: %zu dunes, nearest %.2f m, %.2f a square of the mean spacing\n",
            spacing.x(), spacing.y(), dunes.size(), nearest(dunes), filled);
        EXPECT_GE(nearest(dunes), spacing.x());
        EXPECT_GT(filled,
                  0.5); // dart throwing saturates at 0.70 if all spacings are equal
        EXPECT_LT(filled, 1.0);
        std::vector<double> x; // no grid: positions modulo the mean spacing are uniform
        for (const MassDune& dune : dunes)
            x.push_back(dune.at.x() / spacing.y() - std::floor(dune.at.x() / spacing.y()));
        EXPECT_LT(ks(x, [](double t) { return t; }), ks_limit);
        settings.arrangement = MassArrangement::cells;
        const auto cells = generate_dunes(settings, mass_low, mass_high);
        EXPECT_GE(nearest(cells), spacing.x() * (1.0 - 1e-12)); // rounding of positions
        EXPECT_NEAR(double(cells.size()) * mean * mean / 16e6, 1.0, 0.05);
    }
    settings.density = 0.25;
    const auto few = generate_dunes(settings, mass_low, mass_high);
    settings.density = 1.0;
    const auto all = digests(generate_dunes(settings, mass_low, mass_high));
    const double n = double(all.size());
    EXPECT_NEAR(double(few.size()), 0.25 * n, 3.3 * std::sqrt(n * 0.25 * 0.75));
    for (const auto& [id, digest] : digests(few)) EXPECT_EQ(all.at(id), digest);
}

TEST(MassDesert, RowsAcrossTheWindAndDunesAlongACurve) {
    MassSettings settings = all_of(MassKind::transverse);
    settings.arrangement = MassArrangement::across;
    settings.spacing = {100.0, 120.0};
    std::set<int64_t> rows; // the wind blows to +x: all dunes of a row have the same x
    const auto ridges = generate_dunes(settings, {0.0, 0.0}, {1100.0, 2000.0});
    for (const MassDune& dune : ridges) rows.insert(std::llround(dune.at.x()));
    EXPECT_NEAR(double(rows.size()), 10.0, 1.0);
    for (auto row = rows.begin(); std::next(row) != rows.end(); ++row) {
        EXPECT_GE(*std::next(row) - *row, 99);
        EXPECT_LE(*std::next(row) - *row, 121);
    }
    settings.kind = MassKind::barchan;
    settings.arrangement = MassArrangement::along;
    settings.curves = {{{0.0, 500.0}, {600.0, 500.0}, {600.0, 500.0}, {1000.0, 500.0}}};
    const auto dunes = generate_dunes(settings, {0.0, 0.0}, {1100.0, 2000.0});
    ASSERT_EQ(dunes.size(), 9U);
    for (size_t i = 0; i < dunes.size(); ++i) {
        EXPECT_EQ(dunes[i].at.y(), 500.0);
        if (i == 0) continue;
        EXPECT_GE(dunes[i].at.x() - dunes[i - 1].at.x(), 100.0 - 1e-9); // rounding of positions
        EXPECT_LE(dunes[i].at.x() - dunes[i - 1].at.x(), 120.0 + 1e-9);
    }
    settings.follow = true;
    settings.wind = Vec2d(0.9, 0.1).normalized();
    settings.dispersion = 0.0;
    for (const MassDune& dune : generate_dunes(settings, {0.0, 0.0}, {1100.0, 2000.0}))
        EXPECT_NEAR(dune.angle, 90.0 * degree, 1e-12);
}

TEST(MassDesert, KindsFollowTheRegimeChart) {
    EXPECT_EQ(regime_kind(0.1, 0.0, 0.0), MassKind::barchan);
    EXPECT_EQ(regime_kind(0.5, 0.1, 0.0), MassKind::barchanoid);
    EXPECT_EQ(regime_kind(1.0, 0.0, 0.0), MassKind::transverse);
    EXPECT_EQ(regime_kind(0.1, 0.5, 0.0), MassKind::seif);
    EXPECT_EQ(regime_kind(1.0, 1.0, 0.0), MassKind::star);
    EXPECT_EQ(regime_kind(0.5, 0.0, 1.0), MassKind::parabolic);
    EXPECT_EQ(regime_kind(0.1, 0.8, 1.0), MassKind::nabkha);
    MassSettings settings;
    settings.height = {0.3, 0.9};
    for (const MassDune& dune : generate_dunes(settings, mass_low, mass_high))
        EXPECT_EQ(dune.kind, MassKind::dome);
    settings.sand_cover = 0.35; // at a boundary kinds mix
    settings.height = {2.0, 6.0};
    double barchans = 0.0, all = 0.0;
    for (const MassDune& dune : generate_dunes(settings, mass_low, mass_high)) {
        EXPECT_TRUE(dune.kind == MassKind::barchan || dune.kind == MassKind::barchanoid);
        barchans += dune.kind == MassKind::barchan;
        all += 1.0;
    }
    EXPECT_NEAR(barchans / all, 0.5, 3.3 * 0.5 / std::sqrt(all));
}

TEST(MassDesert, BarchansLieOnTheLinesOfTheField) {
    for (const double height : {2.0, 3.0, 5.0, 8.0, 20.0}) {
        const MassDune dune = alone(MassKind::barchan, height);
        EXPECT_NEAR(dune.width, 8.6 * height + 8.8, 1e-9);
        EXPECT_NEAR(dune.length, 5.5 * height + 10.8, 1e-9);
        const DuneShape shape(dune.crests[0], false, dune.settings);
        const auto at = [&](double u, double v) { return shape.sample(dune.at + Vec2d(u, v)).height; };
        const double rim = 0.002 * height,
                     step = dune.length / 400.0; // a smoothstep has this height 2.6 % before its foot
        double foot = 0.0, top = 0.0, windward = 0.0, slip = 0.0, half = 0.0, tip = 0.0;
        for (double u = -1.5 * dune.length; u < height; u += step) {
            const double h = at(u, 0.0), slope = (at(u + 0.5 * step, 0.0) - at(u - 0.5 * step, 0.0)) / step;
            if (h < rim && u < 0.0) foot = -u;
            top = std::max(top, h);
            if (u < -2.0 * step) windward = std::max(windward, slope);
            if (u > 2.0 * step) slip = std::max(slip, -slope);
        }
        for (double u = -1.1 * dune.length; u < dune.width; u += 8.0 * step)
            for (double v = 0.0; v < 0.7 * dune.width; v += 2.0 * step)
                if (at(u, v) > rim) half = std::max(half, v), tip = std::max(tip, u);
        std::printf("H %.0f m: W %.3f, L %.3f of the line, height %.4f, windward %.1f, slip face %.1f "
                    "degrees, horns %.2f W\n",
                    height, 2.0 * half / dune.width, foot / dune.length, top / height,
                    std::atan(windward) / degree, std::atan(slip) / degree, tip / dune.width);
        EXPECT_NEAR(2.0 * half / dune.width, 1.0, 0.06);
        EXPECT_NEAR(foot / dune.length, 1.0, 0.04);
        EXPECT_NEAR(top / height, 1.0, 0.01);
        EXPECT_NEAR(std::atan(slip) / degree, 33.0, 1.0);
        EXPECT_NEAR(tip / dune.width, 0.3, 0.1); // the horns point downwind
        if (height < 3.0 || height > 8.0)
            continue; // lower dunes are flatter, higher dunes steeper: see the documentation
        EXPECT_NEAR(std::atan(windward) / degree, 12.0, 1.5);
    }
}

// Distance along x or z from a dune's place to the furthest of 400 random points with sand.
double furthest_sand(const DuneShape& shape, const Vec2d& place) {
    double furthest = 0.0;
    for (uint64_t i = 0; i < 400; ++i) {
        const Vec2d share(unit_double(hash(1, i)), unit_double(hash(2, i)));
        const Vec2d p = shape.lower() + (shape.upper() - shape.lower()).cwiseProduct(share);
        const double h = shape.sample(p).height;
        EXPECT_TRUE(std::isfinite(h));
        if (h > 0.0) furthest = std::max(furthest, (p - place).cwiseAbs().maxCoeff());
    }
    return furthest;
}

TEST(MassDesert, LongHornsStayWithinTheReach) {
    for (const MassKind kind : {MassKind::barchan, MassKind::barchanoid}) {
        MassSettings settings = all_of(kind);
        settings.horn_length = 2.0;
        for (const MassDune& dune : generate_dunes(settings, {0.0, 0.0}, {1000.0, 1000.0}))
            for (const std::vector<Vec2d>& crest : dune.crests)
                EXPECT_LT(furthest_sand(DuneShape(crest, false, dune.settings), dune.at),
                          mass_reach(settings));
    }
}

TEST(MassDesert, EveryKindHasCrestsOf9To33PointsAndStaysWithinItsReach) {
    for (int k = 0; k < 8; ++k) {
        MassSettings settings = all_of(MassKind(k));
        settings.boundary_noise = 2.0;
        const double reach = mass_reach(settings);
        double top = 0.0, steepest = 0.0;
        const auto dunes = generate_dunes(settings, {0.0, 0.0}, {500.0, 500.0});
        ASSERT_GT(dunes.size(), 5U);
        for (const MassDune& dune : dunes) {
            EXPECT_EQ(dune.crests.size() > 1, dune.kind == MassKind::star);
            double highest = 0.0;
            for (const std::vector<Vec2d>& crest : dune.crests) {
                EXPECT_GE(crest.size(), 9U);
                EXPECT_LE(crest.size(), 33U);
                const DuneShape shape(crest, false, dune.settings);
                ASSERT_FALSE(shape.empty());
                EXPECT_LT(furthest_sand(shape, dune.at), reach);
                for (const DuneCrestPoint& p : shape.crest_points()) highest = std::max(highest, p.height);
            }
            EXPECT_NEAR(highest / dune.height, 1.0, 0.02);
            top = std::max(top, highest);
            steepest = std::max(steepest, dune.settings.inner_slope_angle);
        }
        const bool slip_face_by_angle =
            MassKind(k) == MassKind::barchan || MassKind(k) == MassKind::barchanoid ||
            MassKind(k) == MassKind::transverse || MassKind(k) == MassKind::parabolic;
        EXPECT_EQ(steepest > 0.0, slip_face_by_angle) << mass_kind_name(MassKind(k));
    }
    const MassDune seif = alone(MassKind::seif, 6.0); // slip faces on both sides
    const DuneShape ridge(seif.crests[0], false, seif.settings);
    const DuneCrestPoint middle = ridge.crest_points()[ridge.crest_points().size() / 2];
    for (const double side : {-1.0, 1.0}) {
        double slip = 0.0;
        for (double v = 0.2; v < 3.0; v += 0.1)
            slip = std::max(slip, (ridge.sample(middle.at + Vec2d(0.0, side * (v - 0.1))).height -
                                   ridge.sample(middle.at + Vec2d(0.0, side * v)).height) /
                                      0.1);
        EXPECT_NEAR(std::atan(slip) / degree, 33.0, 3.0);
    }
}

TEST(MassDesert, AnEditChangesOneDuneOfAThousand) {
    MassSettings settings;
    const auto dunes = generate_dunes(settings, mass_low, mass_high);
    ASSERT_GT(dunes.size(), 800U);
    const auto before = digests(dunes);
    const MassDune& one = dunes[dunes.size() / 2];
    DuneEdit moved{one.id, {12.0, -4.0}, 0.0, 1.0, 1.0, false},
        shaped{one.id, {0.0, 0.0}, 0.3, 1.5, 0.5, false}, removed{one.id, {0.0, 0.0}, 0.0, 1.0, 1.0, true};
    for (const DuneEdit& edit : {moved, shaped, removed}) {
        settings.edits = {edit};
        const auto edited = generate_dunes(settings, mass_low, mass_high);
        const auto after = digests(edited);
        EXPECT_EQ(after.size(), before.size() - (edit.remove ? 1 : 0));
        for (const auto& [id, digest] : after) EXPECT_EQ(digest == before.at(id), id != one.id);
        const auto found = std::ranges::find(edited, one.id, &MassDune::id);
        if (edit.remove) {
            EXPECT_TRUE(found == edited.end());
            continue;
        }
        EXPECT_EQ(found->at, Vec2d(one.at + edit.move));
        EXPECT_DOUBLE_EQ(found->height, one.height * edit.scale * edit.height_factor);
        EXPECT_DOUBLE_EQ(found->angle, one.angle + edit.rotate);
        const double span = (one.crests[0].back() - one.crests[0].front()).norm();
        EXPECT_NEAR((found->crests[0].back() - found->crests[0].front()).norm(), span * edit.scale,
                    1e-9 * span);
    }
}

TEST(MassDesert, AnEditEvaluatesTheTilesOfItsDuneAlone) {
    const Domain domain{600, 500, 1.0, 0.25, -3.5};
    const MassGround ground(domain);
    MassSettings settings;
    const Vec2d low(-100.0, -100.0), high(700.0, 600.0);
    const MassLayer before({}, domain, generate_dunes(settings, low, high), 1.0);
    const auto sand = evaluated(before, ground);
    EXPECT_TRUE(
        MassLayer({}, domain, generate_dunes(settings, low, high), 1.0).changed_since(before, domain).none());
    EXPECT_TRUE(
        MassLayer({}, domain, generate_dunes(settings, low, high), 2.0).changed_since(before, domain).all());
    for (const MassDune& dune : before.dunes()) {
        if ((dune.at - Vec2d(300.0, 250.0)).norm() > 60.0) continue;
        settings.edits = {{dune.id, {10.0, 5.0}, 0.2, 1.1, 1.0, false}};
        const MassLayer after({}, domain, generate_dunes(settings, low, high), 1.0);
        const Tiles changed = after.changed_since(before, domain);
        EXPECT_GT(changed.count(), 0);
        EXPECT_LT(changed.count(), 20);
        auto partly = sand;
        for (const Rect& rect : changed.rects())
            after.evaluate(rect, ground.fields(), {nullptr, partly.data(), {}});
        const auto whole = evaluated(after, ground);
        EXPECT_TRUE(partly == whole);
        EXPECT_FALSE(whole == sand);
    }
}

TEST(MassDesert, TheFieldIsTheSameInAnyRectanglesAndInAPartOfTheDomain) {
    const Domain domain{300, 200, 1.0, 0.0, 0.0}, part{128, 64, 1.0, 64.0, 64.0};
    MassSettings settings;
    settings.spacing = {50.0, 70.0}; // dunes overlap
    const Vec2d low(-400.0, -400.0), high(700.0, 600.0);
    const MassLayer layer({}, domain, generate_dunes(settings, low, high), 1.0);
    const MassGround ground(domain);
    const auto sand = evaluated(layer, ground);
    auto odd = std::vector<SandUnits>(domain.count());
    for (int j = 0; j < domain.nz; j += 7)
        for (int i = 0; i < domain.nx; i += 37)
            layer.evaluate({i, j, std::min(i + 37, domain.nx), std::min(j + 7, domain.nz)}, ground.fields(),
                           {nullptr, odd.data(), {}});
    EXPECT_TRUE(odd == sand);
    const MassLayer smaller({}, part, generate_dunes(settings, low, high), 1.0);
    const auto there = evaluated(smaller, MassGround(part));
    for (int j = 0; j < part.nz; ++j)
        for (int i = 0; i < part.nx; ++i)
            ASSERT_EQ(there[part.index(i, j)], sand[domain.index(i + 64, j + 64)]);
    EXPECT_GT(std::ranges::count_if(sand, [](SandUnits s) { return s > 0; }), 10000);
}

TEST(MassDesert, TheLayerMissesNothingOfItsDunes) {
    const Domain domain{400, 400, 0.5, 900.0, 900.0};
    const MassGround ground(domain);
    double worst = 0.0;
    for (int k = 0; k < 8; ++k)
        for (const double angle : {0.0, 0.5, 2.2}) {
            MassSettings settings = all_of(MassKind(k));
            settings.arrangement = MassArrangement::cells;
            settings.spacing = {2000.0, 2000.0};
            settings.wind = Vec2d(std::cos(angle), std::sin(angle));
            auto dunes = generate_dunes(settings, {-2000.0, -2000.0}, {2000.0, 2000.0});
            ASSERT_FALSE(dunes.empty());
            dunes.resize(1);
            settings.edits = {{dunes[0].id, Vec2d(1000.0, 1000.0) - dunes[0].at, 0.0, 1.0, 1.0, false}};
            dunes = generate_dunes(settings, {-2000.0, -2000.0}, {2000.0, 2000.0});
            dunes.resize(1);
            const auto sand = evaluated(MassLayer({}, domain, dunes, 1.0), ground);
            std::vector<DuneShape> shapes;
            for (const auto& crest : dunes[0].crests) shapes.emplace_back(crest, false, dunes[0].settings);
            for (int j = 0; j < domain.nz; j += 5)
                for (int i = 0; i < domain.nx; i += 7) {
                    double highest = 0.0;
                    for (const DuneShape& shape : shapes)
                        highest = std::max(highest, shape.sample({domain.x(i), domain.z(j)}).height);
                    worst = std::max(worst, highest - sand_metres(sand[domain.index(i, j)]));
                }
        }
    std::printf("heights that the layer misses: %.2g m at most\n", worst);
    EXPECT_LT(worst, 1e-9); // the sand unit is 2^-32 m
}

// Maximum slope of both sides of barchans away from crest and foot, and size of the bounding boxes relative
// to their contents.
TEST(MassDesert, SidesHaveTheirSlopesAndBoxesAreTight) {
    for (int k = 0; k < 8; ++k) {
        double spare = 0.0, windward = 0.0, slip = 0.0;
        for (const double turn : {0.0, 0.5, 1.9}) {
            MassDune dune = alone(MassKind(k), 5.0);
            for (Vec2d& p : dune.crests[0]) p = dune.at + Eigen::Rotation2Dd(turn) * Vec2d(p - dune.at);
            const DuneShape shape(dune.crests[0], false, dune.settings);
            const Vec2d size = shape.upper() - shape.lower();
            Vec2d low = Vec2d::Constant(infinity), high = -low;
            constexpr int nodes = 120;
            std::vector<DuneSample> row(nodes), above(nodes);
            const Vec2d step = size / (nodes - 1.0);
            for (int j = 0; j < nodes; ++j) {
                const double z = shape.lower().y() + j * step.y();
                shape.row(shape.lower().x(), z, step.x(), nodes, row.data());
                for (int i = 0; i < nodes; ++i) {
                    const DuneSample& s = row[size_t(i)];
                    if (!(s.height > 0.0)) continue;
                    const Vec2d p(shape.lower().x() + i * step.x(), z);
                    low = low.cwiseMin(p), high = high.cwiseMax(p);
                    if (i == 0 || j == 0 || s.dist < 1.5 || s.height < 0.3) continue;
                    const double slope = std::hypot((s.height - row[size_t(i) - 1].height) / step.x(),
                                                    (s.height - above[size_t(i)].height) / step.y());
                    if (s.outer == 1.0) windward = std::max(windward, std::atan(slope) / degree);
                    if (s.inner == 1.0) slip = std::max(slip, std::atan(slope) / degree);
                }
                std::swap(row, above);
            }
            spare = std::max(spare, size.prod() / (high - low).prod());
        }
        std::printf("%-10s box at most %.2f of what it holds; outer side at most %.1f, inner %.1f degrees\n",
                    std::string(mass_kind_name(MassKind(k))).c_str(), spare, windward, slip);
        EXPECT_LT(spare, 2.6); // the bound uses the outer width on the inner side too
        if (MassKind(k) != MassKind::barchan) continue;
        EXPECT_LT(spare, 2.1);
        EXPECT_LT(windward, 30.0); // the flanks are steeper than the middle, but below repose
        EXPECT_LT(slip, 36.0);
        EXPECT_GT(slip, 32.0);
    }
}

TEST(MassDesert, BarchansDifferInMoreThanSize) {
    std::vector<double> ratios;
    for (const MassDune& dune : generate_dunes(all_of(MassKind::barchan), mass_low, mass_high)) {
        const Vec2d axis(std::cos(dune.angle), std::sin(dune.angle));
        ratios.push_back((dune.crests[0].front() - dune.at).dot(axis) /
                         (dune.crests[0].back() - dune.at).dot(axis));
    }
    std::sort(ratios.begin(), ratios.end());
    EXPECT_LT(ratios[ratios.size() / 10], 0.85); // one horn is longer than the other
    EXPECT_GT(ratios[ratios.size() * 9 / 10], 1.15);
}

TEST(MassDesert, MergingIsContinuousAndLeavesWhatIsAlone) {
    EXPECT_EQ(merged_thickness(3.0, 0.0, 1.0), 3.0);
    EXPECT_EQ(merged_thickness(0.0, 0.0, 1.0), 0.0);
    EXPECT_EQ(merged_thickness(3.0, 2.0, 0.0), 3.0);
    double last = merged_thickness(2.0, 0.0, 1.0), slope = 0.0;
    constexpr double step = 1e-3;
    for (double b = step; b < 5.0; b += step) {
        const double h = merged_thickness(2.0, b, 1.0), next = (h - last) / step;
        EXPECT_EQ(h, merged_thickness(b, 2.0, 1.0));
        EXPECT_GE(h, std::max(2.0, b));
        EXPECT_LE(h, std::max(2.0, b) + 0.25);
        EXPECT_LT(std::abs(next - slope), 3.0 * step); // no crease: the slope changes by at most about 1 / k
        last = h;
        slope = next;
    }
}

TEST(MassDesert, Extremes) {
    MassSettings settings;
    EXPECT_TRUE(generate_dunes(settings, {5.0, 5.0}, {5.0, 5.0}).empty());
    EXPECT_TRUE(generate_dunes(settings, {5.0, 5.0}, {-5.0, -5.0}).empty());
    EXPECT_TRUE(generate_dunes(settings, {0.0, 0.0}, {infinity, 5.0}).empty());
    EXPECT_TRUE(generate_dunes(settings, {1e12, 0.0}, {1e12 + 100.0, 5.0}).empty());
    settings.height = {4.0, 4.0};
    for (const MassDune& dune : generate_dunes(settings, mass_low, mass_high)) EXPECT_EQ(dune.height, 4.0);
    settings.spacing = {1e5, 2e5};
    EXPECT_LE(generate_dunes(settings, {0.0, 0.0}, {1000.0, 1000.0}).size(), 1U);
    settings.spacing = {10.0, 10.0};
    for (const MassArrangement arrangement :
         {MassArrangement::random, MassArrangement::across, MassArrangement::cells}) {
        settings.arrangement = arrangement;
        EXPECT_THROW(generate_dunes(settings, {0.0, 0.0}, {12000.0, 12000.0}), SceneFault);
    }
    settings = {};
    settings.height = {0.0, 1e9};
    settings.slip_angle = settings.horn_length = settings.windward_angle = 0.0;
    settings.spacing = {1000.0, 2000.0};
    settings.wind = Vec2d::Zero();
    for (int kind = 0; kind < 8; ++kind) {
        settings.kind = MassKind(kind);
        for (const MassDune& dune : generate_dunes(settings, {-3e3, -3e3}, {3e3, 3e3}))
            for (const auto& crest : dune.crests) {
                const DuneShape shape(crest, false, dune.settings);
                EXPECT_TRUE(shape.empty() || std::isfinite(shape.sample(dune.at).height));
                for (const Vec2d& p : crest) EXPECT_TRUE(p.allFinite());
            }
    }
}

TEST(MassDesert, ParametersHaveDistinctNames) {
    const LayerType type = mass_desert_layer_type();
    std::set<std::string> names;
    for (const MarramParam& param : type.params) EXPECT_TRUE(names.insert(param.name).second) << param.name;
    EXPECT_TRUE(names.contains("edit[].id") && names.contains("combine"));
}

TEST(MassDesert, AThousandDunesOn2048Squared) {
    const Domain domain{2048, 2048, 1.0, 0.0, 0.0};
    const MassGround ground(domain);
    MassSettings settings;
    settings.spacing = {40.0, 58.0};
    auto begin = std::chrono::steady_clock::now();
    std::clock_t spent = std::clock();
    const auto cpu = [&spent] {
        const std::clock_t now = std::clock();
        return double(now - std::exchange(spent, now)) / CLOCKS_PER_SEC;
    };
    const auto seconds = [&begin] {
        const auto now = std::chrono::steady_clock::now();
        return std::chrono::duration<double>(now - std::exchange(begin, now)).count();
    };
    auto dunes = generate_dunes(settings, {0.0, 0.0}, {2048.0, 2048.0});
    const double described = seconds();
    const size_t count = dunes.size();
    const MassLayer layer({}, domain, std::move(dunes), 1.0);
    const double made = seconds(), cpu_before = cpu();
    const auto sand = evaluated(layer, ground);
    const double swept = seconds(), cpu_swept = cpu();
    const auto covered = std::ranges::count_if(sand, [](SandUnits s) { return s > 0; });
    std::printf("%zu dunes, %.0f %% covered: described in %.3f s, made in %.3f s, evaluated in %.3f s; "
                "time of all threads %.3f s before and %.3f s in evaluation\n",
                count, 100.0 * double(covered) / double(domain.count()), described, made, swept, cpu_before,
                cpu_swept);
    EXPECT_GE(count, 900U);
    EXPECT_GT(covered, 100000);
}
