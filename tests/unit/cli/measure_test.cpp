// SPDX-License-Identifier: Apache-2.0
// `marram measure`: every dial of a scene, its errors against the finest setting, and reports that list what
// was left out.
#include "core/measure/measure.h"
#include "program.h"

#include <algorithm>
#include <limits>

namespace marram::testing {
namespace {

using Row = std::map<std::string, std::string>;

std::vector<std::string> fields(const std::string& line) {
    std::vector<std::string> all{""};
    bool quoted = false;
    for (size_t i = 0; i < line.size(); ++i) {
        if (line[i] == '"')
            quoted = !quoted;
        else if (line[i] == ',' && !quoted)
            all.emplace_back();
        else
            all.back() += line[i];
    }
    return all;
}

std::map<std::string, std::vector<Row>> rows_by_dial(const std::string& csv) {
    std::map<std::string, std::vector<Row>> dials;
    const std::vector<std::string> all = lines(csv), header = fields(all.at(0));
    for (size_t i = 1; i < all.size(); ++i) {
        const std::vector<std::string> values = fields(all[i]);
        EXPECT_EQ(values.size(), header.size()) << all[i];
        Row row;
        for (size_t k = 0; k < header.size(); ++k) row[header[k]] = values.at(k);
        dials[row["dial"]].push_back(row);
    }
    return dials;
}

double number(const Row& row, const std::string& name) { return std::stod(row.at(name)); }

const SceneText windy = {
    .film = "size = [24, 16]\nsamples = 16\nmax_depth = 3\n",
    .wind = "speed = 6\nglobal_rotate = 1\nnoise = { amplitude = 0.5, frequency = 2, octaves = 3 }\n"
            "shielding = { shield = 0.7, offset = 1, spread = 20 }\n"
            "jiggle = { frequency = 2, damping = 0.3 }\n"
            "collision = { solver = \"exact\" }\n",
    .groom = "count = 100\ncvs = 5\nlength = [0.3, 0.5]\nwidth = 0.02\n",
    .more = "[[mesh]]\nname = \"stone\"\ntype = \"sphere\"\nradius = 0.4\ndivisions = 8\n"};

TEST(Measure, TurnsEveryDialOfAScene) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", windy);
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "1", "--set",
                "camera.shutter=[-0.5, 0.5]", "--set", "film.motion_keys=5"});
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.err, "");
    const auto dials = rows_by_dial(read_file(folder / "report/measure.csv"));
    std::set<std::string> files = {"a.toml", "report/measure.csv", "report/measure.html"};
    for (const std::string name : {"contact", "shield_per", "shield_rays", "jiggle_step", "tolerance",
                                   "motion_keys", "cvs", "octaves", "samples"}) {
        SCOPED_TRACE(name);
        EXPECT_CONTAINS(done.out, "\n" + name + ":");
        files.insert("report/" + name + ".svg");
        ASSERT_TRUE(dials.contains(name));
        int own = 0, references = 0, front = 0;
        const auto reference =
            std::ranges::find(dials.at(name), "1", [](const Row& row) { return row.at("reference"); });
        ASSERT_NE(reference, dials.at(name).end());
        for (const Row& row : dials.at(name)) {
            EXPECT_EQ(row.at("refused"), "") << row.at("setting");
            // Both columns are consistent: seconds are those of the reference times the ratio.
            EXPECT_NEAR(number(row, "seconds") * number(*reference, "ratio"),
                        number(*reference, "seconds") * number(row, "ratio"),
                        1e-3 * number(*reference, "seconds") * number(row, "ratio"));
            EXPECT_GE(number(row, "worst"), number(row, "error"));
            own += row.at("own") == "1";
            front += row.at("front") == "1";
            references += row.at("reference") == "1";
            if (row.at("reference") == "1") {
                EXPECT_EQ(number(row, "error"), 0.0);
            }
        }
        EXPECT_EQ(references, 1);
        EXPECT_GE(front, 1);
        EXPECT_EQ(own, 1);
    }
    EXPECT_EQ(folder.names(), files);
    // Finer is better, for dials where this is known.
    for (const std::string name : {"cvs", "samples", "octaves"}) {
        const std::vector<Row>& rows = dials.at(name);
        double coarser = std::numeric_limits<double>::infinity();
        for (size_t i = 0; i < rows.size() && rows[i].at("setting") != "by the tolerance"; ++i) {
            if (name == "cvs" && rows[i].at("own") == "1")
                continue; // without reference_segments: another pose
            EXPECT_LT(number(rows[i], "error"), coarser) << name << " " << i;
            coarser = number(rows[i], "error");
        }
    }
    const std::vector<Row>& contact = dials.at("contact");
    EXPECT_EQ(contact[0].at("setting"), "exact");
    EXPECT_EQ(contact[0].at("crossed"), "0");
    EXPECT_GT(number(contact[1], "crossed"), 0.0) << "without collision the wind blows grass into the ground";
    for (const std::string law : {"falls with the square of the number of segments",
                                  "falls with the number of rays", "grows with the square of the step"})
        EXPECT_CONTAINS(done.out, "Rule: the error " + law);
    EXPECT_CONTAINS(done.out, "The tolerance chose grass.cvs = ");
    const std::string page = read_file(folder / "report/measure.html");
    EXPECT_CONTAINS(page, "<svg");
    EXPECT_EQ(page.find("http"), page.find("http://www.w3.org/2000/svg")) << "nothing is fetched";
}

TEST(Measure, SaysWhatTheToleranceChoseAndHowWellItHolds) {
    const Folder folder;
    SceneText blown = windy;
    blown.wind = "speed = 6\nglobal_rotate = 1\nnoise = { amplitude = 2, frequency = 1 }\n";
    const std::string scene = folder.write("a.toml", blown);
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "1", "--set",
                "camera.shutter=[-0.5, 0.5]", "--set", "tolerance_pixels=0.5"});
    EXPECT_EQ(done.code, 0) << done.err;
    const auto rows = rows_by_dial(read_file(folder / "report/measure.csv")).at("motion_keys");
    const auto own =
        std::find_if(rows.begin(), rows.end(), [](const Row& row) { return row.at("own") == "1"; });
    ASSERT_NE(own, rows.end());
    EXPECT_EQ(own->at("setting"), "by the tolerance");
    EXPECT_LE(number(*own, "error"), 0.5);
    EXPECT_CONTAINS(done.out,
                    "Rule: the error falls with the square of the keys less one; measured errors are");
    EXPECT_CONTAINS(done.out, "The tolerance, 0.5 pixels, chose");
    EXPECT_CONTAINS(read_file(folder / "report/measure.html"), "The tolerance, 0.5 pixels, chose");
}

// A desert without strands: its cells, a layer's own dials, and the mesh that the camera sees.
TEST(Measure, TurnsTheDialsOfATerrain) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", R"(tolerance_pixels = 1
[camera]
position = [-14, 5, 10]
target = [0, 0, 0]
[film]
size = [64, 36]
samples = 4
max_depth = 2
[[light]]
type = "sky"
[[material]]
name = "soil"
type = "sand"
[[curves]]
name = "ridge"
type = "points"
points = [[-9, 0, -3], [0, 0, 4], [9, 0, -2]]
[[procedural]]
type = "terrain"
name = "desert"
material = "soil"
size = [32, 24]
cell = 0.5
[[procedural.layer]]
type = "flat"
target = "sand"
height = 1
[[procedural.layer]]
type = "dune"
along = "ridge"
max_height = 2
slope_width = 6
[[procedural.layer]]
type = "ripples"
wavelength = 0.5
height = 0.05
)");
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "1"});
    EXPECT_EQ(done.code, 0) << done.err;
    const auto dials = rows_by_dial(read_file(folder / "report/measure.csv"));
    for (const std::string name : {"cell", "dune.search_accuracy", "ripples.displaced", "view_detail"}) {
        SCOPED_TRACE(name);
        ASSERT_TRUE(dials.contains(name)) << done.out;
        const std::vector<Row>& rows = dials.at(name);
        for (size_t i = 0; i < rows.size(); ++i) {
            EXPECT_EQ(rows[i].at("refused"), "") << rows[i].at("setting");
            if (i > 0 && rows[i].at("setting") != "as it is") {
                EXPECT_LE(number(rows[i], "error"), number(rows[i - 1], "error")) << rows[i].at("setting");
            }
        }
        EXPECT_GT(number(rows[0], "error"), 0.0);
    }
    // The scene's tolerance holds for the rendered mesh, in pixels.
    for (const Row& row : dials.at("view_detail"))
        if (row.at("setting") == "1 px") {
            EXPECT_LT(number(row, "error"), 1.0);
            EXPECT_EQ(row.at("own"), "1");
        }
}

constexpr const char* small_picture = R"([camera]
position = [-14, 5, 10]
target = [0, 0, 0]
[film]
size = [32, 18]
samples = 1
max_depth = 2
[wind]
speed = 10
[[light]]
type = "sky"
[[material]]
name = "soil"
type = "diffuse"
)";

const std::string small_dunes = std::string(small_picture) + R"([[procedural]]
type = "terrain"
name = "desert"
material = "soil"
size = [15, 11]
cell = 1
[[procedural.layer]]
type = "mass_desert"
kind = "dome"
height = [0.4, 0.8]
spacing = [6, 7]
[[procedural.layer]]
type = "dune_solver"
days_per_frame = 0.25
start = 0
)";

// A simulation starts anew for each setting and round.
TEST(Measure, TurnsTheDialsOfADuneSolver) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", small_dunes);
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "1"});
    EXPECT_EQ(done.code, 0) << done.err;
    const auto dials = rows_by_dial(read_file(folder / "report/measure.csv"));
    for (const std::string name : {"cell", "dune_solver.stability", "dune_solver.shear_resolution"}) {
        SCOPED_TRACE(name);
        ASSERT_TRUE(dials.contains(name)) << done.out;
        const std::vector<Row>& rows = dials.at(name);
        EXPECT_GT(number(rows[0], "error"), number(rows[2], "error")) << done.out;
        EXPECT_GT(number(rows[2], "error"), 0.0) << done.out;
    }
    const std::vector<Row>& steps =
        dials.at("dune_solver.stability"); // steps of 1, 1/2, 1/4: of second order
    EXPECT_GT(number(steps[0], "error"), 3.0 * number(steps[1], "error")) << done.out;
}

// One round, in this process: the tests choose when the time is over.
void measure_dunes(const Folder& folder, const std::vector<std::string>& changes, double seconds,
                   MeasureProgress& progress, const std::atomic<bool>& cancel, Measurement& measurement) {
    static const std::atomic<bool> never{false};
    Overrides overrides;
    overrides.settings = changes;
    const std::string scene = folder.write("a.toml", small_dunes);
    measure(load_shot(scene, overrides, never), {scene, overrides, 1.0, seconds, 1, 1}, progress, cancel,
            measurement);
}

void expect_no_time(const DialResult& result, size_t setting) {
    EXPECT_CONTAINS(result.settings[setting].refused, "no time was left, give more with --seconds");
    EXPECT_EQ(result.settings[setting].rounds, 0);
}

TEST(Measure, ReportsThatThereWasNoTimeAtAll) {
    const Folder folder;
    const std::atomic<bool> go{false}, stop{true};
    MeasureProgress none(0.0);
    Measurement measurement;
    measure_dunes(folder, {}, 0.0, none, go, measurement);
    ASSERT_GE(measurement.dials.size(), 4u);
    for (const DialResult& result : measurement.dials) {
        SCOPED_TRACE(result.dial.name);
        for (size_t i = 0; i < result.settings.size(); ++i) expect_no_time(result, i);
    }
    const std::string table = to_table(measurement);
    EXPECT_CONTAINS(table, "frame 1: not built");
    EXPECT_CONTAINS(table, "the scene was not built within --seconds 0");
    EXPECT_THROW(measure_dunes(folder, {}, 0.0, none, stop, measurement), Cancelled) << "an interrupt";
}

// The time is over soon after this has begun: when somebody asks for the fifth time.
class TimeUntil : public MeasureProgress {
  public:
    explicit TimeUntil(std::string phase) : MeasureProgress(1000.0), phase_(std::move(phase)) {}
    double left() const override {
        return state().first == phase_ && ++asked_ >= 5 ? 0.0 : MeasureProgress::left();
    }

  private:
    std::string phase_;
    mutable std::atomic<int> asked_ = 0;
};

// The finest cells come last. Their simulation takes a hundred times as long as it takes to tell it to stop.
TEST(Measure, StopsASimulationWhenItsTimeIsOver) {
    const Folder folder;
    const std::atomic<bool> go{false};
    TimeUntil finest("cell: 0.125");
    Measurement measurement;
    measure_dunes(folder, {"procedural.desert.layer[1].days_per_frame=2"}, 1000.0, finest, go, measurement);
    ASSERT_GE(measurement.dials.size(), 4u);
    const std::string table = to_table(measurement);
    const DialResult& cell = measurement.dials[0];
    ASSERT_EQ(cell.dial.name, "cell");
    for (size_t i = 0; i < cell.settings.size(); ++i) {
        SCOPED_TRACE(cell.dial.settings[i].label);
        if (cell.dial.settings[i].label == "0.125") {
            expect_no_time(cell, i);
            continue;
        }
        EXPECT_EQ(cell.settings[i].refused, "");
        EXPECT_EQ(cell.settings[i].rounds, 1);
    }
    // The finest takes the reference's place, and the report says so.
    EXPECT_EQ(cell.dial.settings[cell.dial.reference].label, "0.25") << table;
    EXPECT_EQ(cell.settings[cell.dial.reference].error, 0.0);
    EXPECT_GT(cell.settings[0].error, cell.settings[1].error) << table;
    EXPECT_GT(cell.settings[1].error, 0.0) << table;
    EXPECT_CONTAINS(table, "0.125 was not measured: errors are against 0.25, the finest that was");
    for (size_t k = 1; k < measurement.dials.size(); ++k) {
        SCOPED_TRACE(measurement.dials[k].dial.name);
        for (size_t i = 0; i < measurement.dials[k].settings.size(); ++i)
            expect_no_time(measurement.dials[k], i);
    }
}

// The wear of a rock has no heights, unlike a terrain beside it: its attribute is compared.
TEST(Measure, TurnsThePathsOfARock) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", std::string(small_picture) + R"([[mesh]]
name = "block"
type = "sphere"
material = "soil"
[[procedural]]
type = "rock"
name = "boulder"
mesh = "block"
material = "soil"
paths = 64000
[[procedural]]
type = "terrain"
name = "desert"
size = [8, 8]
[[procedural.layer]]
type = "noise"
)");
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "1"});
    EXPECT_EQ(done.code, 0) << done.err;
    const auto dials = rows_by_dial(read_file(folder / "report/measure.csv"));
    ASSERT_TRUE(dials.contains("paths")) << done.out;
    const std::vector<Row>& rows = dials.at("paths");
    EXPECT_EQ(rows[0].at("unit"), "1");
    for (const Row& row : rows)
        if (row.at("own") == "1") {
            EXPECT_GT(number(row, "error"), 0.001) << done.out;
        }
    EXPECT_EQ(number(rows[3], "error"), 0.0); // the reference
}

// Levels of erosion have different meshes: their distances are compared. A coarse level is the fine one,
// smoothed.
TEST(Measure, TurnsTheLevelsOfARock) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", std::string(small_picture) + R"([[mesh]]
name = "block"
type = "sphere"
material = "soil"
[[procedural]]
type = "rock"
name = "boulder"
mesh = "block"
material = "soil"
paths = 5000
levels = 2
voxel = 0.1
years = 20
)");
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "1"});
    EXPECT_EQ(done.code, 0) << done.err;
    const auto dials = rows_by_dial(read_file(folder / "report/measure.csv"));
    ASSERT_TRUE(dials.contains("level")) << done.out;
    const std::vector<Row>& rows = dials.at("level");
    ASSERT_EQ(rows.size(), 3u) << done.out; // and "as it is"
    EXPECT_EQ(rows[0].at("unit"), "m");
    EXPECT_GT(number(rows[0], "error"), 0.001) << done.out;
    EXPECT_LT(number(rows[0], "error"), 0.1) << done.out; // half a voxel of the first level
    EXPECT_EQ(number(rows[1], "error"), 0.0);             // the reference
    EXPECT_EQ(number(rows[2], "error"), 0.0);
    EXPECT_LT(number(rows[0], "ratio"), 1.0) << done.out;
}

TEST(Measure, SaysWhatItLeavesOut) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    const ProgramResult done =
        marram({"measure", scene, "--out", folder / "report", "--seconds", "1000", "--rounds", "2"});
    EXPECT_EQ(done.code, 0) << done.err;
    for (const std::string why : {"bend: no groom has bend = \"blade\"", "nothing jiggles",
                                  "nothing is shielded", "the shutter does not open", "has one octave"})
        EXPECT_CONTAINS(done.out, why);
    const ProgramResult bare = marram({"measure", scene, "--out", folder / "report", "--seconds", "1000",
                                       "--rounds", "2", "--set", "procedural.grass.count=1", "--set",
                                       "wind.collision={ solver = \"steps\", "
                                       "rotation_steps = 5 }"});
    EXPECT_EQ(bare.code, 0) << bare.err;
    EXPECT_CONTAINS(bare.out, "5 steps");
    EXPECT_CONTAINS(bare.out, "refused: rotation_steps belongs to solver");
    const auto contact = rows_by_dial(read_file(folder / "report/measure.csv")).at("contact");
    EXPECT_EQ(contact.back().at("setting"), "256 steps");
    EXPECT_EQ(contact.back().at("reference"), "1") << "exact contact is refused there";
}

TEST(Measure, DamagesNothingWhereItCannotWrite) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    folder.write("taken", "mine");
    const ProgramResult done = marram({"measure", scene, "--out", folder / "taken"});
    EXPECT_EQ(done.code, 2);
    EXPECT_CONTAINS(done.err, "the folder for the report cannot be made");
    EXPECT_EQ(read_file(folder / "taken"), "mine");
    EXPECT_EQ(marram({"measure", folder / "none.toml", "--out", folder / "report"}).code, 2);
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.toml", "taken"}));
}

DialResult three_settings() {
    DialResult result;
    result.dial.name = "a dial";
    result.dial.time = "bend";
    result.dial.settings = {
        {"fast", {}, true, 0}, {"a, \"b\"", {}, false, 0}, {"<best>", {}, false, 0}, {"no", {}, false, 0}};
    result.dial.reference = 2;
    result.settings.resize(4);
    const double ratios[] = {1.0, 3.0, 2.0}, errors[] = {0.1, 0.05, 0.0};
    for (size_t i = 0; i < 3; ++i) {
        result.settings[i].ratio = result.settings[i].seconds = ratios[i];
        result.settings[i].error = result.settings[i].worst = errors[i];
    }
    result.settings[3].refused = "refused: a, b & c";
    mark_front(result);
    return result;
}

TEST(MeasureReport, TheFrontIsWhatNothingBeatsInBoth) {
    const DialResult result = three_settings();
    EXPECT_TRUE(result.settings[0].front);
    EXPECT_FALSE(result.settings[1].front) << "slower and less exact than the third";
    EXPECT_TRUE(result.settings[2].front);
    EXPECT_FALSE(result.settings[3].front);
}

TEST(MeasureReport, NamesWithMarksOfTheFormatStayWhole) {
    Measurement measurement;
    measurement.scene = "a & b.toml";
    measurement.dials.push_back(three_settings());
    const auto dials = rows_by_dial(to_csv(measurement));
    ASSERT_EQ(dials.at("a dial").size(), 4U);
    EXPECT_EQ(dials.at("a dial")[1].at("setting"), "a, b") << "doubled quotes, dropped by this reader";
    EXPECT_EQ(dials.at("a dial")[3].at("refused"), "refused: a, b & c");
    const std::string page = to_html(measurement);
    EXPECT_CONTAINS(page, "&lt;best&gt;");
    EXPECT_CONTAINS(page, "a &amp; b.toml");
    EXPECT_EQ(page.find("<best>"), std::string::npos);
    EXPECT_CONTAINS(to_table(measurement), "refused: a, b & c");
}

} // namespace
} // namespace marram::testing
