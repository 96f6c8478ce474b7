// SPDX-License-Identifier: Apache-2.0
// Moving cameras: their pose at a frame, and how many poses the shutter needs.
#include "core/shot/scene/scene_camera.h"
#include "core/shot/shot.h"
#include "tests/unit/cli/program.h"

namespace marram::testing {
namespace {

constexpr const char* base = "[camera]\nposition = [0, 1, 5]\ntarget = [0, 1, 0]\nfov = 40\n";
constexpr const char* rest = "[film]\nsize = [400, 300]\n";

SceneDescription described(const Folder& folder, const std::string& camera) {
    static const PluginSet plugins = default_plugins();
    return load_scene(folder.write("scene.toml", base + camera + rest), {}, plugins.schema);
}

} // namespace

TEST(Camera, StandsWhereItsKeysPutIt) {
    const Folder folder;
    const SceneDescription still = described(folder, "");
    ASSERT_EQ(camera_at(still, 7.0).poses.size(), 1U);
    EXPECT_LT((camera_at(still, 7.0).poses[0].position - Vec3d(0, 1, 5)).norm(), 1e-12);
    const SceneDescription moving = described(folder, "transform = { keys = [{ frame = 1 }, { frame = 11, "
                                                      "rotate = [0, 90, 0], translate = [2, 0, 0] }] }\n");
    const CameraPose end = camera_at(moving, 11.0).poses.at(0), before = camera_at(moving, -3.0).poses.at(0);
    EXPECT_LT((end.position - Vec3d(7, 1, 0)).norm(), 1e-12); // a quarter turn about y, then 2 m along x
    EXPECT_LT((end.orientation * Vec3d(0, 0, -1) - Vec3d(-1, 0, 0)).norm(), 1e-12);
    EXPECT_LT((before.position - Vec3d(0, 1, 5)).norm(), 1e-12);
    EXPECT_EQ(camera_at(moving, 6.0).poses.size(), 1U) << "the shutter is closed";
}

// Lens, lights and materials follow their keys; what has none stays.
TEST(Keys, OfTheScenesOwnTablesAreThoseOfTheFrame) {
    const Folder folder;
    const std::string scene =
        "frames = [1, 9]\n[camera]\nposition = [0, 1, 5]\ntarget = [0, 1, 0]\nfov = { keys = [[1, 40], [9, "
        "20]] }\n"
        "focus = { keys = [[1, 2], [9, 4]], interpolation = \"smooth\" }\nlens_radius = { keys = [[5, 0], "
        "[6, 0.1]] }\n"
        "[film]\nsize = [16, 16]\nexposure = { keys = [[1, 0], [9, 2]], interpolation = \"constant\" }\n"
        "[[light]]\ntype = \"sun\"\ndirection = { keys = [[1, [0, 1, 0]], [9, [1, 0, 0]]] }\nirradiance = "
        "[1, 1, 1]\n"
        "[[light]]\ntype = \"sky\"\nzenith = { keys = [[1, [1, 1, 1]], [9, 0]] }\nstrength = 2\n"
        "[[material]]\nname = \"m\"\ntype = \"diffuse\"\ncolor = { keys = [[1, [0.2, 0.2, 0.2]], [9, [0.6, "
        "0.2, 0]]] }\n";
    const std::string file = folder.write("scene.toml", scene);
    const std::atomic<bool> go{false};
    Shot shot = load_shot(file, {}, go);
    const Camera camera = camera_at(shot.description, 5.0);
    EXPECT_NEAR(camera.vertical_fov, 30.0 * degree, 1e-12);
    EXPECT_EQ(camera.lens_radius, 0.0);
    EXPECT_NEAR(camera.focus_distance, 3.0, 1e-12);
    for (const double frame : {5.0, 9.0, 1.0, 5.0}) { // in any order
        set_frame(shot, frame);
        const double share = (frame - 1.0) / 8.0;
        EXPECT_LT((std::get<SunLight>(shot.lights[0]).direction - Vec3d(share, 1.0 - share, 0)).norm(),
                  1e-12);
        EXPECT_NEAR(double(std::get<SkyLight>(shot.lights[1]).zenith.x()), 1.0 - share, 1e-6);
        const auto& diffuse = std::get<DiffuseSettings>(shot.materials[0].settings);
        EXPECT_NEAR(double(diffuse.color.color.x()), 0.2 + 0.4 * share, 1e-6);
    }
    const auto refused = [&](const std::string& what, const std::string& by) {
        std::string wrong = scene;
        wrong.replace(wrong.find(what), what.size(), by);
        try {
            load_shot(folder.write("wrong.toml", wrong), {}, go);
        } catch (const InputError& error) {
            return to_string(error.problems.at(0));
        }
        return std::string();
    };
    EXPECT_NE(refused("[1, 0, 0]", "[0, -3, 0]")
                  .find("the sun turns by more than 170 degrees between frames 1 and 9"),
              std::string::npos);
    EXPECT_NE(refused("[1, 0, 0]", "[0, 0, 0]").find("direction is (nearly) zero at frame 9"),
              std::string::npos);
    EXPECT_NE(refused("[9, [0.6, 0.2, 0]]", "[9, [1.6, 0.2, 0]]").find("key 2 of material.m.color"),
              std::string::npos);
    EXPECT_NE(refused("position = [0, 1, 5]", "position = { keys = [[1, [0, 1, 5]]] }")
                  .find("camera.position has keys"),
              std::string::npos);
}

// Interpolated poses match the true camera to a twentieth of a pixel: for cameras that turn, that walk, whose
// keys are flat at their ends, and that shake within one shutter.
TEST(Camera, HasAsManyPosesAsItsShutterNeeds) {
    struct Move {
        const char *what, *keys;
        double open, close;
    };
    const std::vector<Move> moves = {
        {"turns by 1 degree",
         "keys = [{ frame = 1 }, { frame = 3, rotate = [0, 1, 0] }], interpolation = \"smooth\"", 1.5, 2.5},
        {"turns by 40",
         "keys = [{ frame = 1 }, { frame = 3, rotate = [0, 40, 0] }], interpolation = \"smooth\"", 1.5, 2.5},
        {"from key to key",
         "keys = [{ frame = 2 }, { frame = 3, translate = [1, 0, 0] }], interpolation = \"smooth\"", 2, 3},
        {"through a key",
         "keys = [{ frame = 1 }, { frame = 2, rotate = [0, 5, 0] }, { frame = 3, rotate = [0, 10, 0] }], "
         "interpolation = "
         "\"smooth\"",
         1.75, 2.25},
        {"rolls", "keys = [{ frame = 1 }, { frame = 3, rotate = [0, 0, 60] }]", 1.5, 2.5},
        {"is shaken",
         "keys = [{ frame = 1.5 }, { frame = 1.75, translate = [0.1, 0, 0] }, { frame = 2 }, { frame = 2.25, "
         "translate = "
         "[-0.1, 0, 0] }, { frame = 2.5 }]",
         1.5, 2.5}};
    const Folder folder;
    const double pixel = 2.0 * std::tan(20 * degree) / 300.0;
    for (const Move& move : moves) {
        const std::string keys = fmt::format("transform = {{ {} }}\n", move.keys);
        const SceneDescription open =
            described(folder, fmt::format("shutter = [{}, {}]\n", move.open - 2.0, move.close - 2.0) + keys);
        const SceneDescription closed = described(folder, keys);
        const std::vector<CameraPose> poses = camera_at(open, 2.0).poses;
        double worst = 0.0;
        for (int i = 0; i <= 400; ++i) {
            const double share = i / 400.0, at = share * double(poses.size() - 1);
            const size_t key = std::min(size_t(at), poses.size() - 2);
            const Vec3d place =
                poses[key].position + (at - double(key)) * (poses[key + 1].position - poses[key].position);
            const Eigen::Quaterniond facing =
                poses[key].orientation.slerp(at - double(key), poses[key + 1].orientation);
            const CameraPose right =
                camera_at(closed, move.open + share * (move.close - move.open)).poses.at(0);
            worst = std::max({worst, (right.position - place).norm() / 5.0 / pixel,
                              right.orientation.angularDistance(facing) / pixel});
        }
        std::printf("camera that %s: %zu poses, off by %.3f pixels at most\n", move.what, poses.size(),
                    worst);
        EXPECT_LT(worst, 0.06) << move.what;
    }
}

TEST(Camera, RefusesToBeScaledAtItsLine) {
    const Folder folder;
    const std::string file =
        folder.write("scene.toml", std::string(base) + "transform = { scale = 2 }\n" + rest +
                                       "[[mesh]]\nname = \"a\"\ntype = \"box\"\n");
    const ProgramResult refused = marram({"render", file, "-o", folder / "out.png"});
    EXPECT_EQ(refused.code, 2);
    EXPECT_TRUE(refused.err.find("scene.toml:5:") != std::string::npos &&
                refused.err.find("scale") != std::string::npos)
        << refused.err;
}

} // namespace marram::testing
