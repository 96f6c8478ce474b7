// SPDX-License-Identifier: Apache-2.0
// Scenes whose wind has fields from files and curves: what is read, said, and the same in any order of
// frames.
#include "tests/unit/read/vdb_files.h"
#include "tests/unit/strands/strand_poses.h"

#include <fmt/format.h>

namespace marram::testing {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;

// A folder of velocities: whirls about y over the ground, one a frame, each faster.
struct FieldScene : ::testing::Test {
    fs::path folder = fs::temp_directory_path() / fmt::format("marram_fields_{}", ::getpid());
    FieldScene() {
        fs::create_directories(folder);
        for (int frame = 3; frame <= 6; ++frame) write(fmt::format("whirl.{:04}.vdb", frame), 2.0 * frame);
        write("whirl.vdb", 6.0);
    }
    ~FieldScene() override { fs::remove_all(folder); }

    void write(const std::string& name, double spin) const {
        write_vdb(file(name),
                  {velocity_grid(Coord(-8, -2, -8), Coord(16, 8, 16), voxels_of(0.125),
                                 [&](const Vec3d& p) -> Vec3d { return spin * Vec3d::UnitY().cross(p); })});
    }
    std::string file(const std::string& name) const { return (folder / name).string(); }
    std::string grid(const std::string& name, const std::string& more = "") const {
        return fmt::format("field = [{{ shape = \"grid\", velocities = \"{}\"{} }}]\n", file(name), more);
    }
    std::string sequence(const std::string& frames = "[3, 6]", const std::string& more = "") const {
        return fmt::format(
            "field = [{{ shape = \"grid\", velocities = {{ file = \"{}\", frames = {} }}{} }}]\n",
            file("whirl.####.vdb"), frames, more);
    }
};

std::string scene_of(const std::string& wind) {
    return "[wind]\nspeed = 3\nglobal_rotate = 0.6\nnoise = { amplitude = 0 }\n" + wind +
           "\n[[curves]]\nname = \"path\"\ntype = \"points\"\npoints = [[-2, 0, -1], [0, 0, 0], [1, 0, "
           "2]]\n" +
           mesh("ground", "plane", "size = [2, 2]") + groom("hair", "ground");
}

constexpr const char* still_path = "field = [{ shape = \"curves\", along = \"path\", reach = 0.4 }]\n";

TEST_F(FieldScene, BendsStrandsByItsVelocities) {
    const Pose still = pose_of_scene(scene_of("")), whirled = pose_of_scene(scene_of(grid("whirl.vdb")));
    EXPECT_GT(largest_difference(still, whirled), 0.01);
    EXPECT_GT(largest_difference(still, pose_of_scene(scene_of(still_path))), 0.01);
    EXPECT_EQ(pose_of_scene(scene_of(grid("whirl.vdb", ", weight = 0"))), still);
    EXPECT_EQ(pose_of_scene(scene_of(grid("whirl.vdb", ", transform = { translate = [30, 0, 0] }"))), still);
}

// Frame 4 of the sequence is a whirl of 8 radians a second; frame 4.5 one of 9; before the first and after
// the last: these.
TEST_F(FieldScene, IsInterpolatedBetweenItsFrames) {
    const std::string scene = scene_of(sequence());
    for (const auto& [frame, spin] :
         {std::pair(4.0, 8.0), {4.5, 9.0}, {3.0, 6.0}, {1.0, 6.0}, {6.0, 12.0}, {80.0, 12.0}}) {
        write("one.vdb", spin);
        EXPECT_LT(largest_difference(pose_of_scene(scene, frame), pose_of_scene(scene_of(grid("one.vdb")))),
                  2e-6)
            << frame;
    }
}

// Also the past that jiggle reads, and weights with keys.
TEST_F(FieldScene, HasTheSameBitsInAnyOrderOfFrames) {
    const std::string all = fmt::format(
        "jiggle = {{ frequency = 4, damping = 0.4 }}\n"
        "field = [{{ shape = \"grid\", velocities = {{ file = \"{}\", frames = [3, 6] }}, mode = "
        "\"replace\", "
        "weight = {{ keys = [[2, 0], [8, 1]] }}, transform = {{ keys = [{{ frame = 1 }}, {{ frame = 9, "
        "translate = [0.5, 0, 0] }}] }} }}, {{ shape = \"curves\", along = \"path\", reach = 0.5 }}]\n"
        "direction = {{ keys = [[1, [1, 0, 0]], [9, [0, 0, 1]]] }}\n",
        file("whirl.####.vdb"));
    expect_independent_frames(scene_of(all), {7.0, 3.25, 12.5, 4.0, 5.0, 5.125, 40.0, 7.0}, scene_of(""));
}

TEST_F(FieldScene, IsUpdated) {
    TestScene scene(scene_of(sequence()));
    pose_of(scene, 4.5);
    const std::string other = scene_of(grid("whirl.vdb") + "\n");
    scene.update(other);
    EXPECT_EQ(pose_of(scene, 4.5), pose_of_scene(other, 4.5));
    write("whirl.vdb", -20.0); // the same name, another file
    scene.update(other);
    EXPECT_EQ(pose_of(scene, 4.5), pose_of_scene(other, 4.5));
    scene.update(scene_of(sequence()));
    EXPECT_EQ(pose_of(scene, 4.5), pose_of_scene(scene_of(sequence()), 4.5));
}

TEST_F(FieldScene, SaysWhatIsWrong) {
    write_vdb(file("nan.vdb"), {velocity_grid(Coord(0), Coord(3), voxels_of(1.0),
                                              [](const Vec3d&) { return Vec3d(0, std::nan(""), 0); })});
    std::ofstream(file("text.vdb")) << "no volume";
    const std::pair<std::string, std::string> cases[] = {
        {sequence("[2, 8]"), "has no file for 3 of 7 frames: 2, 7, 8: write them"},
        {sequence("[3.5, 6]"), "velocities.frames is [3.5, 6]: give the first and the last frame"},
        {sequence("[6, 3]"), "velocities.frames is [6, 3]"},
        {sequence("[1, 1e9]"), "velocities.frames"},
        {grid("whirl.####.vdb"), "velocities is a sequence without frames: give { file ="},
        {fmt::format("field = [{{ shape = \"grid\", velocities = {{ file = \"{}\", frames = [1, 2] }} }}]",
                     file("whirl.vdb")),
         "velocities.file is one file for all frames"},
        {fmt::format("field = [{{ shape = \"grid\", velocities = {{ file = \"{}\", grid = \"wind\" }} }}]",
                     file("whirl.vdb")),
         "whirl.vdb: does not hold one vector grid \"wind\", but \"vel\""},
        {"field = [{ shape = \"grid\", velocities = {} }]", "velocities names no file"},
        {"field = [{ shape = \"grid\", velocities = { fil = \"a\" } }]", "fil"},
        {"field = [{ shape = \"grid\", velocities = 3 }]",
         "velocities is 3: give the path of an OpenVDB file"},
        {grid("absent.vdb"), "there is no file"},
        {grid("nan.vdb"), "nan.vdb: has the velocity nan m/s in voxel (0, 0, 0)"},
        {grid("text.vdb"), "text.vdb: is no OpenVDB file, or is damaged"},
        {"field = [{ shape = \"grid\" }]", "wind.field[0].velocities is missing"},
        {"field = [{ shape = \"curves\", along = \"path\" }]", "wind.field[0].reach is missing"},
        {"field = [{ shape = \"image\" }]", "wind.field[0].map is missing"},
        {"field = [{ shape = \"curves\", along = \"paht\", reach = 1 }]", "paht"},
        {"field = [{ shape = \"box\", reach = 1 }]",
         "wind.field[0].reach has no effect on a field of shape \"box\""},
        {grid("whirl.vdb", ", swirl = 2"), "wind.field[0].swirl has no effect"},
        {"field = [{ shape = \"curves\", along = \"path\", reach = 1, transform = { translate = [1, 0, 0] } "
         "}]",
         "wind.field[0].transform has no effect"},
        {grid("whirl.vdb", ", ramp = [[0, 1]]"), "wind.field[0].ramp is not 0 at 1"}};
    for (const auto& [wind, message] : cases) {
        const std::string said = problems_of_scene(scene_of(wind));
        EXPECT_NE(said.find(message), std::string::npos) << message << ": " << said;
    }
}

// Grooms share the numbers of a file; a scene of many frames that does not fit is refused.
TEST_F(FieldScene, IsReadOnce) {
    const std::string two = scene_of(grid("whirl.vdb")) + groom("more", "ground");
    TestScene scene(two);
    fs::remove(file("whirl.vdb"));
    EXPECT_FALSE(pose_of(scene, 1.0).empty());
    EXPECT_EQ(scene.stats.volume_bytes, 16U * 8U * 16U * 12U);
}

// Procedurals in C take volumes, too.
TEST_F(FieldScene, IsLentToAnyProcedural) {
    for (int frame = 1; frame <= 2; ++frame)
        write_vdb(file(fmt::format("rise.{}.vdb", frame)),
                  {velocity_grid(Coord(0), Coord(2), voxels_of(1.0),
                                 [&](const Vec3d& p) { return Vec3d(0.0, frame * (1.0 + p.x()), 0.0); })});
    TestScene scene(fmt::format("\n[[procedural]]\ntype = \"hill\"\nname = \"dune\"\nair = {{ file = \"{}\", "
                                "frames = [1, 2] }}\n",
                                file("rise.#.vdb")));
    const World world = scene.build();
    float most = 0.0F;
    for (const Vec3f& p : world.meshes[0].positions[0]) most = std::max(most, p.y());
    EXPECT_EQ(most, 4.0F);
}

TEST_F(FieldScene, IsSummarized) {
    TestScene scene(scene_of(sequence() + ""));
    scene.build();
    const std::string text = scene.geometry.procedurals.front()->summarize();
    EXPECT_NE(text.find("fields: 1, grid of 16 x 8 x 16 voxels and 4 frames"), std::string::npos) << text;
}

} // namespace
} // namespace marram::testing
