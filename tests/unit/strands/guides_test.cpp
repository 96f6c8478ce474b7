// SPDX-License-Identifier: Apache-2.0
// Child strands interpolated from guides: equal to a guide at its root, continuous between guides, separated
// at partings.
#include "procedural/strands/grown/guides.h"

#include "procedural/strands/grown/roots.h"
#include "procedural/strands/grown/strand_shape.h"
#include "tests/unit/strands/test_surfaces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

using namespace marram;

namespace {

struct Guides {
    std::vector<float> vertices;
    std::vector<uint64_t> offsets{0};
    LentCurves lent;

    void add(const std::vector<Vec3d>& points) {
        const auto put = [&](const Vec3d& p) {
            vertices.insert(vertices.end(), {float(p.x()), float(p.y()), float(p.z()), 0.001F});
        };
        put(2.0 * points[0] - points[1]);
        for (const Vec3d& p : points) put(p);
        put(2.0 * points.back() - points[points.size() - 2]);
        offsets.push_back(offsets.back() + points.size());
    }
    std::shared_ptr<GuideSet> set(const TestSurface& mesh, GuideSettings settings,
                                  std::vector<std::vector<Vec3d>> lines = {}) {
        lent.curves.curve_count = offsets.size() - 1;
        lent.curves.offsets = offsets.data();
        settings.curves = "guides";
        return std::make_shared<GuideSet>(settings, lent, vertices.data(), mesh.surface(),
                                          uint32_t(mesh.positions.size() / 3), std::move(lines),
                                          [] { return false; });
    }
};

GuideSettings settings_of(int blend, double parting = pi) {
    GuideSettings settings;
    settings.blend = blend;
    settings.parting = parting;
    return settings;
}

// Guides on a lattice over [0, 1]^2 that lean towards `direction`.
Guides lattice(
    int n, const std::function<Vec3d(const Vec3d&)>& direction,
    const std::function<double(const Vec3d&)>& length = [](const Vec3d&) { return 0.3; }) {
    Guides guides;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const Vec3d root((i + 0.5) / n, 0.0, (j + 0.5) / n);
            std::vector<Vec3d> points;
            for (int k = 0; k < 5; ++k)
                points.push_back(root + direction(root).normalized() * (length(root) * k / 4.0));
            guides.add(points);
        }
    return guides;
}

// CVs of a child at `root`, relative to its root.
std::vector<Vec3d> child(const GuideSet& set, const Vec3d& root, int cvs) {
    const GuideBlend blend = set.blend_at(root, Vec3d::UnitY());
    const auto guides = set.resampled(cvs);
    std::vector<Vec3d> points(size_t(cvs), Vec3d::Zero());
    for (size_t k = 0; k < size_t(cvs); ++k)
        for (int i = 0; i < max_blended; ++i)
            points[k] += double(blend.weight[i]) * (*guides)[blend.guide[i] * size_t(cvs) + k].cast<double>();
    return points;
}

} // namespace

TEST(Guides, AChildAtAGuideIsThatGuide) {
    const TestSurface mesh = grid_surface(8, 1.0);
    Guides guides = lattice(6, [](const Vec3d& p) { return Vec3d(p.x() - 0.5, 1.0, p.z()); });
    const auto set = guides.set(mesh, settings_of(4));
    ASSERT_EQ(set->count(), 36u);
    for (size_t g = 0; g < 36; ++g) {
        const GuideBlend blend = set->blend_at(set->guide(g).root, Vec3d::UnitY());
        EXPECT_EQ(blend.guide[0], g);
        EXPECT_EQ(blend.weight[0], 1.0F);
        EXPECT_NEAR(set->length_of(blend), 0.3, 1e-6);
    }
}

TEST(Guides, WeightsSumToOneAndChangeWithoutJumps) {
    const TestSurface mesh = grid_surface(8, 1.0);
    Guides guides =
        lattice(7, [](const Vec3d& p) { return Vec3d(std::sin(7.0 * p.x()), 1.0, std::cos(5.0 * p.z())); });
    for (const int blend : {1, 2, 3, 4}) {
        const auto set = guides.set(mesh, settings_of(blend));
        double most = 0.0;
        std::vector<Vec3d> before;
        constexpr int steps = 20000;
        for (int i = 0; i <= steps; ++i) {
            const Vec3d root(0.03 + 0.91 * i / steps, 0.0, 0.11 + 0.7 * i / steps);
            const GuideBlend b = set->blend_at(root, Vec3d::UnitY());
            EXPECT_NEAR(b.weight[0] + b.weight[1] + b.weight[2] + b.weight[3], 1.0F, 1e-6F);
            const std::vector<Vec3d> now = child(*set, root, 6);
            if (i > 0) most = std::max(most, (now.back() - before.back()).norm());
            before = now;
        }
        // A step is 6e-5 m; tips of neighbouring guides, 0.14 m apart, differ by about 0.2 m. With one guide
        // the tip jumps at cell borders.
        if (blend > 1)
            EXPECT_LT(most, 3e-3) << blend;
        else
            EXPECT_GT(most, 0.05);
    }
}

TEST(Guides, DoNotCrossAPartingThatTwoSidesOfGuidesMake) {
    const TestSurface mesh = grid_surface(8, 1.0);
    Guides guides = lattice(8, [](const Vec3d& p) { return Vec3d(p.x() < 0.5 ? -1.0 : 1.0, 0.3, 0.0); });
    const auto parted = guides.set(mesh, settings_of(3, 60.0 * degree)),
               blended = guides.set(mesh, settings_of(3));
    double least = 1.0, min_blended = 1.0;
    for (int i = 0; i < 2000; ++i) {
        const Vec3d root(0.3 + 0.4 * (i + 0.5) / 2000.0, 0.0, 0.37);
        const double side = root.x() < 0.5 ? -1.0 : 1.0;
        least = std::min(least, side * child(*parted, root, 5).back().x());
        min_blended = std::min(min_blended, side * child(*blended, root, 5).back().x());
    }
    EXPECT_GT(least, 0.28) << "m, as far as the guides themselves reach to their side";
    EXPECT_LT(min_blended, 0.15) << "without: they stand up in the middle";
}

TEST(Guides, DoNotCrossADrawnParting) {
    const TestSurface mesh = grid_surface(8, 1.0);
    Guides guides = lattice(
        8, [](const Vec3d&) { return Vec3d(0.1, 1.0, 0.0); },
        [](const Vec3d& p) { return p.x() < 0.5 ? 0.1 : 0.4; });
    const auto set = guides.set(mesh, settings_of(4), {{{0.5, 0.0, -0.1}, {0.5, 0.0, 0.6}, {0.5, 0.0, 1.1}}});
    for (int i = 0; i < 2000; ++i) {
        const Vec3d root(0.3 + 0.4 * (i + 0.5) / 2000.0, 0.0, 0.61);
        EXPECT_NEAR(set->length_of(set->blend_at(root, Vec3d::UnitY())), root.x() < 0.5 ? 0.1 : 0.4, 1e-6);
    }
}

TEST(Guides, OnTheFarSideOfAThinBodyDoNotCount) {
    TestSurface mesh = grid_surface(4, 1.0), below = grid_surface(4, 1.0);
    const auto first = uint32_t(mesh.positions.size() / 3);
    for (size_t i = 1; i < below.positions.size(); i += 3) below.positions[i] = -0.01F;
    mesh.positions.insert(mesh.positions.end(), below.positions.begin(), below.positions.end());
    mesh.uvs.clear();
    for (size_t i = 0; i < below.triangles.size(); i += 3)
        mesh.triangles.insert(
            mesh.triangles.end(),
            {first + below.triangles[i], first + below.triangles[i + 2], first + below.triangles[i + 1]});
    Guides guides;
    for (int i = 0; i < 10; ++i) {
        const double x = 0.05 + 0.1 * i;
        guides.add({{x, 0.0, 0.5}, {x, 0.2, 0.5}});
        guides.add({{x, -0.01, 0.5}, {x, -0.5, 0.5}});
    }
    const auto set = guides.set(mesh, settings_of(4));
    for (int i = 0; i < 100; ++i)
        EXPECT_NEAR(set->length_of(set->blend_at({0.01 * i, 0.0, 0.5}, Vec3d::UnitY())), 0.2, 1e-6);
}

// Children in a groom have the shape of the guides with equal segments of the blended length, also on a
// rotated skin.
TEST(Guides, ChildrenOfAGroomHaveTheirShapeOnASkinThatTurns) {
    const TestSurface bind = grid_surface(8, 1.0);
    TestSurface now = bind; // rotated about x by 90 degrees: y becomes z, z becomes -y
    for (size_t i = 0; i < now.positions.size(); i += 3) {
        now.positions[i + 1] = -bind.positions[i + 2];
        now.positions[i + 2] = bind.positions[i + 1];
    }
    Guides guides = lattice(5, [](const Vec3d&) { return Vec3d(0.6, 0.8, 0.0); });
    GuideSettings settings = settings_of(3);
    settings.length = {0.5, 0.5};
    const auto set = guides.set(bind, settings);
    Groom groom;
    groom.count = 300;
    groom.guides = settings;
    groom.length = {0.0, set->longest_child()};
    groom.width = 0.01;
    groom.cvs = 6;
    const std::vector<Root> roots = place_roots(groom, bind.surface(), [] { return false; }).roots;
    std::vector<GuideBlend> blends;
    for (const Root root : roots)
        blends.push_back(set->blend_at(bind.surface().point(root.triangle, root_weights(groom.seed, root)),
                                       Vec3d::UnitY()));
    const Guided guided{*set, blends, bind.surface()};
    Strands strands;
    strands.resize(int(roots.size()), 6, false);
    expand(groom, Wind{}, {bind.surface(), now.surface()}, roots, strands, &guided);
    for (size_t i = 0; i < roots.size(); ++i) {
        const auto at = [&](size_t k) {
            const Wide3f& v = strands.rest[i / lanes * 6 + k];
            return Vec3d(double(v.x[i % lanes]), double(v.y[i % lanes]), double(v.z[i % lanes]));
        };
        for (size_t k = 1; k < 6; ++k)
            EXPECT_LT((at(k) - at(k - 1) - Vec3d(0.6, 0.0, 0.8) * 0.03).norm(), 1e-6)
                << "half as long as the guides";
    }
}

// Strands grow as far from guides as these are apart, and fade out beyond.
TEST(Guides, ReachAsFarAsTheirSpacing) {
    const TestSurface bind = grid_surface(8, 1.0);
    Guides guides = lattice(4, [](const Vec3d&) { return Vec3d(0.0, 1.0, 0.0); });
    GuideSettings settings = settings_of(3);
    const auto set = guides.set(bind, settings);
    EXPECT_GT(set->reach(), 1.4 * 0.25) << "the spacing is 1/4";
    EXPECT_LT(set->reach(), 2.2 * 0.25);
    const auto density = [&](double beyond) { return set->density_at(Vec3d(0.125 - beyond, 0.0, 0.125)); };
    EXPECT_EQ(set->density_at(Vec3d(0.25, 0.0, 0.25)), 1.0) << "between four guides";
    EXPECT_EQ(density(0.99 * set->reach()), 1.0);
    EXPECT_NEAR(density(1.25 * set->reach()), 0.5, 1e-9);
    EXPECT_EQ(density(1.5 * set->reach()), 0.0);
    settings.reach = 0.1;
    EXPECT_EQ(guides.set(bind, settings)->reach(), 0.1);
    Guides one = lattice(1, [](const Vec3d&) { return Vec3d(0.0, 1.0, 0.0); });
    EXPECT_EQ(one.set(bind, settings_of(3))->density_at(Vec3d(9.0, 0.0, 0.0)), 1.0) << "it has no spacing";
}
