// SPDX-License-Identifier: Apache-2.0
// Erosion over levels: each level equals the next finer one smoothed, bedding is visible, and invalid
// requests are reported.
#include "procedural/erosion/erosion.h"
#include "tests/unit/erosion/rock_shapes.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstdio>
#include <limits>

namespace marram::testing {
namespace {

// Wear by a wind along x on the faces that face it.
void facing_wear(const LevelMesh& mesh, uint64_t, std::span<double> rate) {
    for (size_t v = 0; v < rate.size(); ++v)
        rate[v] = 1e-3 * std::max(0.0, -normal_of(mesh, v).dot(Vec3d(0.95, -0.1, 0.3).normalized()));
}

ErosionSettings layered(int levels, double voxel) {
    ErosionSettings settings;
    settings.levels = levels;
    settings.voxel = voxel;
    settings.years = 150.0;
    settings.hardness.strata.thickness = 0.12;
    settings.hardness.strata.contrast = 4.0;
    settings.hardness.strata.dip = 10.0 * degree;
    return settings;
}

const LevelMesh& sandstone() {
    static const LevelMesh box =
        rock_box({0.0, 0.5, 0.0}, {0.5, 0.5, 0.4}, Eigen::AngleAxisd(0.3, Vec3d::UnitY()).toRotationMatrix());
    return box;
}

ErosionResult erode_sandstone(const ErosionSettings& settings, const ErosionHooks& hooks = {}) {
    return erode(sandstone().positions, sandstone().triangles, settings, facing_wear, hooks);
}

TEST(Erosion, ALevelIsTheNextOnesSmoothed) {
    ErosionResult result = erode_sandstone(layered(4, 0.02)); // three octaves
    ASSERT_EQ(result.levels.size(), 4u);
    EXPECT_DOUBLE_EQ(result.years, 150.0);
    for (const auto& [a, b] : {std::pair{0, 1}, {1, 2}, {2, 3}, {0, 3}}) {
        const LevelParity parity = level_parity(result.levels[size_t(a)].rock, result.levels[size_t(b)].rock);
        std::printf("level %d against %d: mean %.3f, rms %.3f, 99 %% %.3f, most %.3f voxels\n", a, b,
                    parity.mean, parity.rms, parity.at_99, parity.most);
        EXPECT_LT(parity.rms, 0.15);
        EXPECT_LT(parity.at_99, 0.5);
        EXPECT_LT(parity.most, 0.75);
    }
    // A finer level adds detail that the coarser one cannot represent.
    EXPECT_GT(mesh_area(result.levels[3].rock.mesh()), 1.02 * mesh_area(result.levels[0].rock.mesh()));
}

TEST(Erosion, SoftBedsLieDeeper) {
    ErosionSettings settings = layered(2, 0.03);
    settings.hardness.strata.dip = 0.0;
    ErosionResult result = erode_sandstone(settings);
    const LevelMesh& mesh = result.levels.back().rock.mesh();
    std::vector<double> hardness(mesh.vertex_count());
    rock_hardness(settings.hardness, mesh.positions, 0.0, hardness);
    const LevelMesh& box = sandstone();
    LevelSet before = LevelSet::from_mesh(box.positions, box.triangles, 0.1); // its band covers all depths
    std::vector<float> depth(mesh.vertex_count());
    before.sample(mesh.positions, depth);
    double soft = 0.0, hard = 0.0, soft_count = 0.0, hard_count = 0.0;
    for (size_t v = 0; v < mesh.vertex_count(); ++v) {
        const Vec3d p = vertex_of(mesh, v), n = normal_of(mesh, v);
        if (p.y() < 0.2 || p.y() > 0.8 || n.x() > -0.5) continue;
        (hardness[v] < 1.0 ? soft : hard) -= double(depth[v]);
        (hardness[v] < 1.0 ? soft_count : hard_count) += 1.0;
    }
    EXPECT_GT(soft / soft_count, 1.2 * hard / hard_count);
}

TEST(Erosion, ShelteredFacesStay) {
    ErosionResult result = erode_sandstone(layered(3, 0.03));
    const LevelMesh& mesh = result.levels.back().rock.mesh();
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.3, Vec3d::UnitY()).toRotationMatrix();
    size_t count = 0;
    for (size_t v = 0; v < mesh.vertex_count(); ++v) { // on the lee face, away from its edges
        const Vec3d p = turn.transpose() * (vertex_of(mesh, v) - Vec3d(0.0, 0.5, 0.0));
        if (p.x() < 0.4 || std::abs(p.y()) > 0.3 || std::abs(p.z()) > 0.2) continue;
        EXPECT_NEAR(p.x(), 0.5, 0.03 * 0.03);
        ++count;
    }
    EXPECT_GT(count, 100u);
}

TEST(Erosion, GrainsWearWhatFacesTheWindAndSameBitsForAnyThreads) {
    const RTCDevice device = rtcNewDevice(nullptr);
    GrainSettings grains;
    grains.paths = 8000;
    grains.ground = 0.0;
    grains.height = 0.3;
    grains.reach = 1.0;
    ErosionSettings settings = layered(2, 0.04);
    settings.years = 200.0;
    const auto worn = [&](size_t threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        ErosionResult result = erode(sandstone().positions, sandstone().triangles, settings,
                                     grain_wear({.device = device, .winds = {{grains, 1.0}}}));
        return result.levels.back().rock.mesh();
    };
    const LevelMesh one = worn(1), two = worn(2);
    EXPECT_EQ(one.positions, two.positions);
    EXPECT_EQ(one.triangles, two.triangles);
    rtcReleaseDevice(device);
    EXPECT_LT(mesh_volume(one), 0.99 * 0.8);
    EXPECT_GT(mesh_volume(one), 0.3 * 0.8);
}

TEST(Erosion, StopsWhereItIsCancelledAndTellsHowFarItIs) {
    int asked = 0;
    double last = 0.0;
    const ErosionHooks hooks{[&] { return ++asked > 6; },
                             [&](double share, const std::string& words) {
                                 EXPECT_GE(share, last);
                                 EXPECT_LE(share, 1.0);
                                 EXPECT_FALSE(words.empty());
                                 last = share;
                             }};
    const ErosionResult result = erode_sandstone(layered(3, 0.02), hooks);
    EXPECT_TRUE(result.cancelled);
    EXPECT_LT(result.levels.size(), 3u);
    EXPECT_GT(last, 0.0);
}

TEST(Erosion, SaysWhatCannotBeDone) {
    for (const auto& change : std::vector<std::function<void(ErosionSettings&)>>{
             [](auto& s) { s.levels = 0; }, [](auto& s) { s.levels = 99; }, [](auto& s) { s.voxel = -1.0; },
             [](auto& s) { s.years = std::nan(""); }, [](auto& s) { s.detail = 2.0; }}) {
        ErosionSettings settings = layered(1, 0.1);
        change(settings);
        EXPECT_NE(erosion_settings_fault(settings), "");
        EXPECT_THROW(erode_sandstone(settings), std::invalid_argument);
    }
    EXPECT_THROW(erode({}, {}, layered(1, 0.1), facing_wear), LevelSetError);
    EXPECT_THROW(erode_sandstone(layered(3, 0.5)),
                 LevelSetError); // the voxels of the first level are larger than the rock
    // Wear that is NaN, or removes the whole rock.
    const RockWear wild = [](const LevelMesh&, uint64_t, std::span<double> rate) {
        std::fill(rate.begin(), rate.end(), std::nan(""));
    };
    EXPECT_NO_THROW(erode(sandstone().positions, sandstone().triangles, layered(2, 0.05), wild));
    ErosionSettings all = layered(2, 0.05);
    all.years = 1e5;
    EXPECT_NO_THROW(erode_sandstone(all));
}

TEST(Hardness, OfAVoxelIsThatOfItsMeanWear) {
    HardnessSettings settings;
    settings.strata.thickness = 0.1;
    settings.strata.contrast = 5.0;
    settings.strata.dip = 20.0 * degree;
    const Vec3d across(std::sin(20.0 * degree), std::cos(20.0 * degree), 0.0);
    for (const double footprint : {0.03, 0.25, 0.7}) {
        const std::vector<float> at{0.3F, 0.7F, -2.0F};
        std::vector<double> mean(1);
        rock_hardness(settings, at, footprint, mean);
        std::vector<float> points;
        constexpr int count = 20000;
        for (int k = 0; k < count; ++k) {
            const Vec3d p = Vec3d(0.3, 0.7, -2.0) + footprint * ((k + 0.5) / count - 0.5) * across;
            for (int axis = 0; axis < 3; ++axis) points.push_back(float(p[axis]));
        }
        std::vector<double> each(count);
        rock_hardness(settings, points, 0.0, each);
        double rate = 0.0;
        for (const double h : each) rate += 1.0 / h / count;
        EXPECT_NEAR(1.0 / mean[0], rate, 1e-3 * rate) << footprint;
    }
}

TEST(Hardness, HasBedsNoiseAndMasks) {
    HardnessSettings settings;
    const std::vector<float> points{0.0F, 0.0F, 0.0F, 5.0F, 1.0F, 2.0F, -3.0F, 7.0F, 0.5F};
    std::vector<double> hardness(3);
    rock_hardness(settings, points, 0.0, hardness);
    EXPECT_EQ(hardness, std::vector<double>(3, 1.0));
    settings.masks.push_back({Vec3d::Zero(), Vec3d::Ones(), 8.0, 0.2});
    rock_hardness(settings, points, 0.0, hardness);
    EXPECT_DOUBLE_EQ(hardness[0], 8.0);
    EXPECT_DOUBLE_EQ(hardness[1], 1.0);
    for (const double extreme : {1e6, 1e-3}) { // more overlap than a float could hold the product of
        HardnessSettings overlapping;
        overlapping.masks.assign(200, {Vec3d::Zero(), Vec3d::Ones(), extreme, 0.2});
        rock_hardness(overlapping, points, 0.0, hardness);
        EXPECT_TRUE(std::isfinite(float(hardness[0])) && float(hardness[0]) > 0.0F) << hardness[0];
    }
    settings.strata = {.thickness = 0.5,
                       .contrast = 4.0,
                       .laminae = 0.5,
                       .dip = 0.3,
                       .dip_direction = 1.0,
                       .fold = 0.2,
                       .fold_length = 3.0};
    settings.noise = 3.0;
    std::vector<float> many;
    for (int k = 0; k < 3000; ++k)
        for (const float step : {0.013F, 0.017F, 0.011F}) many.push_back(3.0F + float(k) * step);
    std::vector<double> all(3000), one(1);
    rock_hardness(settings, many, 0.02, all);
    const auto [least, greatest] = std::minmax_element(all.begin(), all.end());
    EXPECT_GT(*greatest / *least, 3.0);
    EXPECT_LT(*greatest / *least, 40.0);
    for (const size_t k : {0u, 13u, 2999u}) { // alone: the same value as in the batch
        rock_hardness(settings, std::span(many).subspan(3 * k, 3), 0.02, one);
        EXPECT_EQ(one[0], all[k]);
    }
}

} // namespace
} // namespace marram::testing
