// SPDX-License-Identifier: Apache-2.0
// dune_solver: dunes that the wind forms from the sand below, over days, years or centuries.
//
//     [[procedural.layer]]
//     type = "dune_solver"
//     days_per_frame = 30
//     speed = 9                       # m/s
//
// Model (solver/solver.cpp): shear stress over the ground and its separation bubbles; sand flux that follows
// it over a saturation length; erosion and deposition; avalanches. At frame `start` the terrain is as the
// layers below make it; at frame f the wind has blown for (f - start) days_per_frame. Frames can be evaluated
// in any order. Rock that sticks out shapes the wind, and sand leaves it bare.
//
// Wind. It blows in the scene's wind direction with `speed` 10 m above the ground (default: the scene's wind
// speed), as
//   steady    constant; with second_share, that fraction of each `season` is turned by second_turn: two winds
//             form seifs
//   chaotic   redrawn every `hold` hours: direction from a normal distribution (`spread`), shear velocity
//             from a Weibull distribution (`shape`); a wide spread forms star dunes
//   record    measured: a CSV with columns time (hours), speed (m/s at 10 m) and direction (degrees clockwise
//             from north, *from* which it blows; +x is east, -z north). An entry blows until the next one, also
//             over a gap, which is warned of; the record repeats after its end. Entries shorter than a minute are merged
//             until they last as long, and move as much sand (a warning says so)
// It may differ from place to place (wind_field.cpp): it follows the curves that `wind_along` names within
// about `wind_reach`, or `wind_map` gives its parts along and across. The air is computed for one direction
// in 15 degrees of such a field; the report has their number; each after the first adds half of the cost of a
// step. The report has the drift potential and its resultant (dp, rdp, kg/(m s)) and their ratio, without the
// field.
//
// Time and cost. A time step costs less than 40 ns a sample on two cores (build/marram_bench). It is seconds
// to hours long: shorter for finer cells (with the square of the cell) and stronger wind, and set by
// `stability`. The report has the number of steps. `marram measure` shows time against error for cell,
// stability and shear_resolution.
//
// States. A host that prepares frames stores a state every `keep_every` frames and one at each requested
// whole frame; a later frame continues from the latest one. Each whole frame ends a time step, so a frame is
// bit-identical whichever states exist. Any change of the terrain's parameters or inputs, also in layers
// above, restarts the simulation.
//
// Plants. `plants` names a mask: the fraction of the ground that they cover. `frontal_area` is their frontal
// area per area of ground where the mask is 1; it divides the stress on the sand by 1 + 16 area. With
// `growth` (m a year) they start at `start_cover` of the mask, grow back to the mask and `plant_height`, and
// die where sand buries them or erodes below them faster than that: barchans become parabolic dunes. `cover`
// names an output mask, the cover at this frame, for grooms and materials. With `wake` the wind recovers
// behind plants over a length, 2.1 plant heights in nature: sand gathers in tufts and in a tail behind each
// (nabkhas). Cells must be smaller than a tuft.
//
//     [[procedural.layer]]
//     type = "dune_solver"
//     plants = "meadow"
//     growth = 6
//     cover = "grass"
//
// Obstacles. `obstacle` names a mesh that stands in the wind and in the sand: a ruin, boulders. It enters the
// model as rock with the height of its top (obstacle.cpp; doors and arches are open). The air separates in
// front of its walls and behind them, and closes in from the sides (separation.cpp): sand gathers there,
// climbs and buries walls, and is left in rooms and in the lee. The sand inside the mesh stays as it is; in
// the picture it is raised or lowered to the level beside it, which is not counted as moved. No plants grow
// there. The mesh stands as it is at the frame asked for, from the start. Cells should be at most half as
// wide as a wall is thick: thinner walls do not keep the sand levels of their two sides apart.
//
//     [[procedural.layer]]
//     type = "dune_solver"
//     obstacle = "ruin"
//
// Limits. One such layer a terrain. Grooms on the terrain are placed anew each frame; the ground does not
// move within a shutter interval.
#include "procedural/terrain/solver/dune_solver_layer.h"

#include "procedural/abi/param.h"
#include "procedural/terrain/mask_layer.h"
#include "procedural/terrain/shape_layer.h"

#include "core/math/hash.h"
#include "procedural/abi/state_bytes.h"
#include "procedural/terrain/obstacle.h"
#include "procedural/terrain/simulation.h"
#include "procedural/terrain/wind_field.h"
#include "procedural/wind/measured_wind.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace marram {
namespace {

constexpr double dune_day = 86400.0;

struct DuneRun {
    DuneSolverSettings settings;
    WindHistory wind;
    WindField field;
    Obstacle obstacle;
    DriftPotential drift;
    std::string plants;                         // mask name; "": none
    std::string cover;                          // name of the output mask; "": none
    double frames = 0.0, seconds_a_frame = 0.0; // since the start
    double start = 0.0;
    int keep_every = 10;
    std::string place;
};

// The terrain with the obstacle as bedrock: the sand that it displaces is set aside.
struct DuneGround {
    std::vector<Obstacle::Top> tops;
    std::vector<float> bedrock;       // empty without an obstacle
    std::vector<SandUnits> sand;      // likewise
    std::vector<SandUnits> displaced; // by each of `tops`

    DuneGround(const Domain& domain, const Fields& below, const Obstacle& obstacle) {
        if (obstacle.empty()) return;
        tops = obstacle.tops(below);
        bedrock.assign(below.bedrock, below.bedrock + domain.count());
        sand.assign(below.sand, below.sand + domain.count());
        for (const Obstacle::Top& top : tops) {
            const size_t k = top.sample;
            const SandUnits on_top = std::min(
                std::max(sand_units(below.height(k) - double(top.height)), SandUnits(0)), below.sand[k]);
            displaced.push_back(below.sand[k] - on_top);
            bedrock[k] = std::max(bedrock[k], top.height), sand[k] = on_top;
        }
    }
    // Puts the displaced sand back. `blown`: the solver's sand.
    void finish(const Domain& domain, const Fields& below, SandUnits* blown) const {
        std::vector<SandUnits> on_top;
        for (size_t k = 0; k < tops.size(); ++k) {
            const size_t at = tops[k].sample;
            on_top.push_back(blown[at]);
            blown[at] +=
                on_top[k] > 0 ? sand_units(double(bedrock[at]) - double(below.bedrock[at])) : displaced[k];
        }
        fill_obstacle(domain, below.bedrock, tops, on_top, blown);
    }
};

class DuneSolverLayer : public TerrainLayer {
  public:
    DuneSolverLayer(DuneRun run, const Domain& domain, Simulation* simulation)
        : run_(std::move(run)), domain_(domain), simulation_(simulation) {}

    Writes writes() const override { return {.bedrock = false, .sand = true}; }
    std::vector<std::string> mask_names() const override {
        return run_.cover.empty() ? std::vector<std::string>() : std::vector<std::string>{run_.cover};
    }
    double reach() const override { return infinity; }
    void evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const override;
    bool evaluate_whole(const Fields& below, const LayerOutput& out,
                        const std::function<bool()>& cancelled) const override;

  private:
    bool advance(DuneSolver& solver, double from, const std::function<bool()>& cancelled) const;

    DuneRun run_;
    Domain domain_;
    Simulation* simulation_; // may be NULL
};

void DuneSolverLayer::evaluate(const Rect& rect, const Fields& below, const LayerOutput& out) const {
    for (int j = rect.j0; j < rect.j1; ++j)
        std::copy_n(below.sand + domain_.index(rect.i0, j), rect.i1 - rect.i0,
                    out.sand + domain_.index(rect.i0, j));
}

// Runs from `from`, in frames since the start, to run_.frames. Returns false if cancelled.
bool DuneSolverLayer::advance(DuneSolver& solver, double from, const std::function<bool()>& cancelled) const {
    const double end = run_.frames * run_.seconds_a_frame;
    DuneCallbacks callbacks;
    callbacks.cancelled = cancelled;
    callbacks.progress = [&](const DuneProgress& progress) {
        if (!simulation_) return;
        const bool years = end > seconds_per_year;
        const double unit = years ? seconds_per_year : dune_day;
        simulation_->progress(solver.time() / end,
                              fmt::format("{:.1f} {} of {:.1f}, {} steps", solver.time() / unit,
                                          years ? "years" : "days", end / unit, progress.steps));
    };
    for (double at = from; at < run_.frames;) {
        const double next = std::min(std::floor(at) + 1.0, run_.frames);
        if (!solver.advance(run_.wind, next * run_.seconds_a_frame - solver.time(), callbacks)) return false;
        at = next;
        const bool whole = at == std::floor(at);
        if (simulation_ && whole && (std::fmod(at, run_.keep_every) == 0.0 || at == run_.frames))
            simulation_->store(run_.start + at, bytes_of(solver.save()));
    }
    return true;
}

bool DuneSolverLayer::evaluate_whole(const Fields& below, const LayerOutput& out,
                                     const std::function<bool()>& cancelled) const {
    if (!out.sand) return true;
    evaluate({0, 0, domain_.nx, domain_.nz}, below, out);
    const bool blown = run_.frames > 0.0 && run_.seconds_a_frame > 0.0;
    if (!blown && run_.cover.empty()) return true;
    std::string problem = DuneSolver::problem(domain_, run_.settings, below.bedrock, below.sand, run_.field);
    if (!problem.empty())
        throw SceneFault("terrain.dune_solver", run_.place, problem, "change the layers below, or the cells");
    const DuneGround ground(domain_, below, run_.obstacle);
    const float* const bedrock = ground.bedrock.empty() ? below.bedrock : ground.bedrock.data();
    const SandUnits* const sand = ground.sand.empty() ? below.sand : ground.sand.data();
    if (!ground.tops.empty())
        problem = DuneSolver::problem(domain_, run_.settings, bedrock, sand, run_.field);
    if (!problem.empty())
        throw SceneFault("terrain.dune_solver", run_.place, "with the obstacle: " + problem,
                         "give an obstacle that is less high");
    if (!run_.obstacle.empty() && ground.tops.empty() && out.notes)
        out.notes->warnings.push_back({run_.place,
                                       "the obstacle hangs above the ground: nothing stands there",
                                       "lower the mesh until it stands in the sand"});
    const float* plants = run_.plants.empty() ? nullptr : find_mask(below, run_.plants);
    std::vector<float> free_plants; // none grow in the obstacle
    if (plants && !ground.tops.empty()) {
        free_plants.assign(plants, plants + domain_.count());
        for (const Obstacle::Top& top : ground.tops) free_plants[top.sample] = 0.0F;
        plants = free_plants.data();
    }
    DuneSolver solver(domain_, run_.settings, bedrock, sand, plants, run_.field);
    double from = 0.0;
    if (blown && simulation_) {
        double frame = 0.0;
        const std::vector<char> bytes = simulation_->load(run_.start + run_.frames, frame);
        DuneState state;
        if (!bytes.empty() && frame >= run_.start && read_bytes(bytes, domain_.count(), state) &&
            state.plant_height.empty() == !(plants && run_.settings.growth.rate > 0.0)) {
            solver.restore(state);
            from = frame - run_.start;
        }
    }
    if (blown && !advance(solver, from, cancelled)) return false;
    solver.sand({out.sand, domain_.count()});
    if (!ground.tops.empty()) ground.finish(domain_, below, out.sand);
    if (!run_.cover.empty()) solver.cover({out.masks[0], domain_.count()});
    if (!out.notes) return true;
    const double area = domain_.cell * domain_.cell;
    out.notes->numbers = {{"days", solver.time() / dune_day},
                          {"steps", double(solver.steps())},
                          {"sand_in", sand_metres(solver.in()) * area},
                          {"sand_out", sand_metres(solver.out()) * area},
                          {"sand_airborne", sand_metres(solver.airborne()) * area},
                          {"dp", run_.drift.dp},
                          {"rdp", run_.drift.rdp},
                          {"rdp_dp", run_.drift.ratio()},
                          {"wind_directions", double(solver.wind_directions())},
                          {"obstacle_samples", double(ground.tops.size())}};
    return true;
}

// ---- From the scene -------------------------------------------------------------------------------------------------

constexpr std::array dune_solver_values = {
    param::number("start", "frame", "1", -1e6, 1e6,
                  "frame at which the terrain is as the layers below make it"),
    param::number("days_per_frame", "days", "10", 0, 1e6, "that the wind blows from frame to frame"),
    param::choice("border", "\"periodic\"", "periodic|open|walled",
                  "periodic: sand wraps around; open: sand leaves, `influx` enters; walled: no sand crosses"),
    param::number("influx", "", "0", 0, 1, "over open borders, share of the saturated flux"),
    param::choice("wind", "\"steady\"", "steady|chaotic|record", "how it changes with time"),
    param::number("speed", "m/s", "none", 0, 150,
                  "wind speed 10 m above the ground (chaotic: the mean); absent: the scene's wind.speed"),
    param::number("second_turn", "deg", "90", -360, 360,
                  "angle from the first to the second direction of a steady wind, from +x towards +z"),
    param::number("second_share", "", "0", 0, 1, "fraction of the season in which the second wind blows"),
    param::number("season", "days", "30", 1e-3, 1e6, "both winds together"),
    param::number("spread", "deg", "40", 0, 1e4, "of a chaotic wind's directions: deviation"),
    param::number("shape", "", "3", 0.5, 100,
                  "shape of the Weibull distribution of shear velocity; larger: less variation"),
    param::number("hold", "h", "24", 1e-3, 1e6, "how long a chaotic wind stays as it is"),
    param::table("record", "none", "time|speed|direction",
                 "CSV of a measured wind: columns time (h), speed (m/s at 10 m), direction (deg from north, "
                 "from which)"),
    param::curves("wind_along", "none", "curves that the wind follows, turned by up to 30 degrees"),
    param::number("wind_reach", "m", "50", 1e-3, 1e6,
                  "distance from a curve at which the wind follows it by half"),
    param::image("wind_map", "none", "",
                 "image of the wind along and across its direction, relative to it: (1, 0) changes nothing"),
    param::mesh("obstacle", "none", "", "a mesh that stands in the wind and in the sand, such as a ruin"),
    param::text("plants", "none", "name of a mask: the share of the ground that plants cover"),
    param::number("frontal_area", "", "0.2", 0, 100, "of plants per area of ground, where the mask is 1"),
    param::number("growth", "m/year", "0", 0, 1000, "of small plants; 0: plants stay as they are"),
    param::number("plant_height", "m", "1", 0.001, 100, "of full-grown plants"),
    param::number("wake", "", "0", 0, 100,
                  "length over which the wind recovers behind plants, in plant heights; 0: at once"),
    param::number("start_cover", "", "0", 0, 1, "share of the mask that growing plants start with"),
    param::text("cover", "none", "name of the mask handed out: where plants are now"),
    param::number("repose", "deg", "34", 5, 80,
                  "static angle of repose: sand starts to slide; it stops 1 degree below"),
    param::number("stability", "", "0.5", 0.001, 1,
                  "time step, as a share of the time scale of the fastest wave; beyond 1 waves would grow",
                  "1|0.5|0.25|0.125", "seconds.procedural_meshes"),
    param::number(
        "shear_resolution", "", "1", 0.01, 1,
        "of the wind's stress: waves along the grid's axis nearest to the wind that are shorter than "
        "2 cells over "
        "this make none",
        "0.25|0.5|0.75|1", "seconds.procedural_meshes"),
    param::integer("keep_every", "frames", "10", 1, 1e6, "a state is stored every so many frames"),
    param::integer("seed", "", "0", 0, 2147483647, "of chaotic wind"),
};

double dune_shear_velocity(const LayerContext& context) {
    const double speed = context.values.has("speed") ? context.values.number("speed") : context.wind_speed;
    return shear_velocity_of(speed);
}

std::string place_of_record(const LayerContext& context) {
    if (context.values.has("record")) return context.values.place("record");
    return context.record ? context.record->place : context.values.place("wind");
}

// Reads the record's columns by name; time in seconds.
WindRecord dune_record(const LayerContext& context) {
    const LayerValues& values = context.values;
    const bool own = values.has("record");
    const std::string place = place_of_record(context);
    if (!own && !context.record)
        throw SceneFault("terrain.wind_record", place, "a recorded wind has no record",
                         "give record = \"FILE.csv\", or wind.record to the scene");
    const MeasuredWind measured =
        read_measured_wind(own ? values.at("record") : *context.record, "terrain.wind_record", place);
    WindRecord record{measured.time, measured.speed, measured.from};
    std::vector<double> intervals;
    for (size_t k = 1; k < record.time.size(); ++k) intervals.push_back(record.time[k] - record.time[k - 1]);
    std::vector<double> sorted = intervals;
    std::sort(sorted.begin(), sorted.end());
    const double usual =
        sorted.empty() ? 0.0 : sorted[(sorted.size() - 1) / 2] / seconds_per_hour; // the median
    const auto longest = std::max_element(intervals.begin(), intervals.end());
    if (*longest > 10.0 * usual * seconds_per_hour && context.warn)
        context.warn(
            place,
            fmt::format(
                "the record has a gap of {:.3g} h after {:.6g} h (entries are {:.3g} h apart): the wind "
                "before it blows until its end",
                *longest / seconds_per_hour,
                record.time[size_t(longest - intervals.begin())] / seconds_per_hour, usual),
            "fill the gap, or begin the record after it");
    return record;
}

// Entries shorter than a minute would each be a time step of the solver.
WindHistory dune_recorded_wind(const LayerContext& context, const WindRecord& record,
                               const SandPhysics& physics, double known) {
    constexpr double shortest = 60.0; // seconds
    const std::string place = place_of_record(context);
    if (known < shortest)
        throw SceneFault("terrain.wind_record", place,
                         fmt::format("the record covers {:.3g} seconds, less than a minute", known),
                         "give its times in hours");
    const std::vector<TimedWind> winds = winds_of(record);
    if (std::ranges::none_of(winds, [](const TimedWind& timed) { return timed.seconds < shortest; }))
        return recorded_wind(record);
    std::vector<TimedWind> merged = merged_winds(winds, shortest, physics);
    if (context.warn)
        context.warn(
            place,
            fmt::format("the record's entries are as little as {:.3g} s apart: its {} are merged to {} of a "
                        "minute or more, which move as much sand",
                        std::ranges::min_element(winds, {}, &TimedWind::seconds)->seconds, winds.size(),
                        merged.size()),
            "give its times in hours, or means over some minutes");
    return wind_sequence(std::move(merged));
}

// The wind history. `known`: seconds of it that represent its statistics, for the drift potential.
WindHistory dune_wind(const LayerContext& context, const SandPhysics& physics, double& known) {
    const LayerValues& values = context.values;
    const std::string kind = values.text("wind");
    if (kind != "record" && values.has("record") && context.warn)
        context.warn(values.place("record"), "the record has no effect: the wind is " + kind,
                     "give wind = \"record\"");
    if (kind == "record") {
        const WindRecord record = dune_record(context);
        known = record.time.back() - record.time.front() + last_duration(record);
        return dune_recorded_wind(context, record, physics, known);
    }
    const double strength = dune_shear_velocity(context),
                 heading = std::atan2(context.wind.y(), context.wind.x());
    if (kind == "chaotic") {
        ChaoticWind chaos;
        chaos.towards = heading;
        chaos.spread = values.number("spread") * degree;
        chaos.mean = strength;
        chaos.shape = values.number("shape");
        chaos.seconds = values.number("hold") * seconds_per_hour;
        chaos.seed = hash(context.seed, uint64_t(values.integer("seed")));
        known = 1000.0 * chaos.seconds;
        return chaotic_wind(chaos);
    }
    const double share = values.number("second_share"), season = values.number("season") * dune_day;
    known = season;
    const SandWind first{context.wind.x(), context.wind.y(), strength};
    if (share == 0.0) return steady_wind(first);
    const double turned = heading + values.number("second_turn") * degree;
    return wind_sequence(
        {{first, (1.0 - share) * season}, {{std::cos(turned), std::sin(turned), strength}, share * season}});
}

WindField dune_wind_field(const LayerContext& context) {
    const LayerValues& values = context.values;
    if (values.has("wind_along") && values.has("wind_map"))
        throw SceneFault("terrain.wind_field", values.place("wind_map"), "the wind has curves and a map",
                         "give wind_along or wind_map");
    if (values.has("wind_map"))
        return wind_field_of_image(*values.at("wind_map").grid, context.domain, values.place("wind_map"));
    if (!values.has("wind_along")) return {};
    return wind_field_along(context.curves(values.text("wind_along")), values.number("wind_reach"),
                            context.domain, context.wind, values.place("wind_along"));
}

std::string dune_cover(const LayerValues& values) {
    if (!values.has("cover")) return "";
    check_mask_name(values.text("cover"), values.place("cover"));
    return values.text("cover");
}

// Whether the wind exceeds the threshold anywhere within its first `known` seconds.
bool moves_sand(const DuneRun& run, double known) {
    if (run.drift.dp > 0.0 || run.field.empty()) return run.drift.dp > 0.0;
    const double strongest = double(*std::max_element(run.field.strength.begin(), run.field.strength.end()));
    std::vector<TimedWind> winds = winds_between(run.wind, 0.0, known);
    for (TimedWind& timed : winds) timed.wind.shear_velocity *= strongest;
    return drift_potential(winds, run.settings.physics).dp > 0.0;
}

std::unique_ptr<TerrainLayer> make_dune_solver(const LayerContext& context) {
    const LayerValues& values = context.values;
    DuneRun run;
    const std::string border = values.text("border");
    run.settings.border = border == "open"     ? DuneBorder::open
                          : border == "walled" ? DuneBorder::walled
                                               : DuneBorder::periodic;
    run.settings.influx = values.number("influx");
    run.settings.stability = values.number("stability");
    run.settings.shear_resolution = values.number("shear_resolution");
    run.settings.avalanche.starts = values.number("repose") * degree;
    run.settings.avalanche.stops = run.settings.avalanche.starts - degree;
    double known = 0.0;
    run.wind = dune_wind(context, run.settings.physics, known);
    const bool recorded = values.text("wind") == "record";
    run.field = dune_wind_field(context);
    if (values.has("obstacle")) {
        run.obstacle = Obstacle(context.domain, context.mesh(values.text("obstacle")));
        if (run.obstacle.empty() && context.warn)
            context.warn(values.place("obstacle"),
                         "the mesh '" + values.text("obstacle") + "' is not on the terrain",
                         "move it, or make the terrain larger");
        if (run.obstacle.open_samples() > 0 && context.warn)
            context.warn(values.place("obstacle"),
                         fmt::format("the mesh '{}' is not closed: it is hollow in {} samples",
                                     values.text("obstacle"), run.obstacle.open_samples()),
                         "close it if sand should not fill it");
        if (!run.obstacle.empty()) {
            run.settings.separation.convergence = 0.25;
            run.settings.physics.steepest = std::max(1.0, std::tan(run.settings.avalanche.starts));
        }
    }
    run.drift = drift_potential(winds_between(run.wind, 0.0, known), run.settings.physics);
    if (values.has("plants")) run.plants = required_mask_name(context, "plants");
    run.cover = dune_cover(values);
    if (!run.cover.empty() && run.plants.empty())
        throw SceneFault("terrain.dune_solver", values.place("cover"), "cover needs plants",
                         "name a mask by plants");
    for (const char* name : {"growth", "start_cover", "wake"})
        if (run.plants.empty() && values.number(name) > 0.0)
            throw SceneFault("terrain.dune_solver", values.place(name), fmt::format("{} needs plants", name),
                             "name a mask by plants");
    PlantGrowth& growth = run.settings.growth;
    growth.rate = values.number("growth") / seconds_per_year;
    growth.height = values.number("plant_height");
    growth.start_cover = values.number("start_cover");
    growth.frontal_area = values.number("frontal_area");
    growth.wake = values.number("wake");
    run.start = values.number("start");
    run.frames = std::max(context.frame - run.start, 0.0);
    run.seconds_a_frame = values.number("days_per_frame") * dune_day;
    run.keep_every = values.integer("keep_every");
    run.place = values.place("type");
    if (!moves_sand(run, known) && context.warn)
        context.warn(values.place("type"),
                     "the wind never exceeds the threshold of sand transport: only avalanches move sand",
                     recorded ? "use a record of stronger wind" : "set speed above about 6 m/s");
    return std::make_unique<DuneSolverLayer>(std::move(run), context.domain, context.simulation);
}

} // namespace

// ---- States ---------------------------------------------------------------------------------------------------------

namespace {

constexpr uint64_t dune_state_format = 0x6d617272616d4403; // the last byte is the format version

void visit_fields(auto& state, auto& visit) {
    visit(state.sand, state.height_before, state.plant_height, state.seam_flux, state.airborne,
          state.seam_direction, state.seam_saturated, state.time, state.step_before, state.step_allowed,
          state.steps, state.in, state.out);
}

} // namespace

std::vector<char> bytes_of(const DuneState& state) {
    StateWriter out;
    out(dune_state_format);
    visit_fields(state, out);
    return std::move(out.bytes);
}

bool read_bytes(std::span<const char> bytes, size_t samples, DuneState& state) {
    StateReader in(bytes);
    uint64_t format = 0;
    in(format);
    if (format != dune_state_format) return false;
    visit_fields(state, in);
    return in.at_end() && state.sand.size() == samples && state.height_before.size() == samples &&
           (state.plant_height.empty() || state.plant_height.size() == samples);
}

LayerType dune_solver_layer_type() {
    LayerType type{"dune_solver", "dunes that the wind makes of the sand below", dune_solver_values,
                   make_dune_solver, [](const LayerValues& values) {
                       const std::string cover = dune_cover(values);
                       return cover.empty() ? std::vector<std::string>() : std::vector<std::string>{cover};
                   }};
    type.evolves = true;
    return type;
}

} // namespace marram
