// SPDX-License-Identifier: Apache-2.0
// A groom with bend = "blade" is evaluated as it is, as blades, and with bend = "talk", as strands that
// dials turn. The wind is steady and the same everywhere: the scene's direction and air, at speeds from 0
// to the scene's largest; no noise, gusts, shelter, fields, ground, canopy, jiggle, collision, and an
// envelope of 1. (In those, response scales the turn while a blade takes the share of the speed: the fit
// holds where the wind is whole.)
//
// The fit (bend_fit.cpp) calls the bend with a strength over the strand, set as ramp_rotate at a response
// and a global_rotate of 1, so the formula of the bend is not needed here. Its strengths over the speed
// become response and global_rotate, its profile ramp_rotate. All errors of the fit are those of the lines
// that are printed, evaluated once more, at the fitted speeds and between them.
//
// LIMITS. One response and one ramp serve all strands of a groom. A blade's turn depends also on its length
// (by its cube), its width and its angle to the wind; strands of the talk all turn by the same shares of
// their angles. A blade of weight is held up or pulled down, and one with sags = true differs from its
// groomed shape in still air; the talk knows neither. A strand that points against the wind is turned over
// by the talk at any speed, and bent little as a blade in a weak one.
#include "core/measure/bend.h"

#include "core/measure/bend_trial.h"
#include "core/measure/dial_settings.h"
#include "core/measure/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace marram {
namespace {

constexpr size_t fitted_speeds = 8;
constexpr std::array profile_knots = {0.0, 0.12, 0.3, 0.6, 1.0}; // denser at the root, where blades bend most

// Names of grooms of blades in the file, each once.
std::vector<std::string> grooms_of_blades(const Shot& shot) {
    std::vector<std::string> names;
    for (const Item& item : shot.description.procedurals) {
        const ParamValue* bend = item.params.find("bend");
        if (bend && bend->text == "blade" && std::ranges::find(names, item.name_in_file()) == names.end())
            names.push_back(item.name_in_file());
    }
    return names;
}

const Item& item_of(const Shot& shot, const std::string& groom) {
    return *std::ranges::find(shot.description.procedurals, groom,
                              [](const Item& item) { return item.name_in_file(); });
}

std::string vector_text(const std::vector<double>& numbers) {
    return fmt::format("[{}, {}, {}]", numbers[0], numbers[1], numbers[2]);
}

std::string knots_text(const std::vector<Vec2d>& knots) {
    std::string text;
    for (const Vec2d& knot : knots)
        text += fmt::format("{}[{:.4g}, {:.3g}]", text.empty() ? "" : ", ", knot.x(), knot.y());
    return "[" + text + "]";
}

std::string ramp_text(const ParamValue& ramp) {
    std::string knots;
    for (size_t i = 0; i + 1 < ramp.numbers.size(); i += 2)
        knots += fmt::format("{}[{}, {}]", i > 0 ? ", " : "", ramp.numbers[i], ramp.numbers[i + 1]);
    return fmt::format("{{ knots = [{}], interpolation = \"{}\" }}", knots, ramp.text);
}

struct BendDials { // in TOML
    std::string response, global_rotate, ramp_rotate;
};

// Changes that leave a groom a steady wind and the dials that turn it; the whole tables are set, so that
// nothing of the scene's stays in them.
class SteadyWind {
  public:
    SteadyWind(const Shot& shot, const std::string& groom, double frame)
        : shot_(shot), item_(item_of(shot, groom)), table_("procedural." + groom + ".") {
        const ParamValue& direction = *wind_value(shot, item_, "direction");
        std::vector<double> towards = direction.numbers;
        if (direction.keys) direction.keys->at(frame, towards);
        wind_ = fmt::format("direction = {}, air_density = {}, reference_segments = {}, calm = 1, noise = {{ "
                            "amplitude = 0 }}",
                            vector_text(towards), wind_value(shot, item_, "air_density")->numbers[0],
                            wind_value(shot, item_, "reference_segments")->numbers[0]);
        groom_ = {table_ + "wind={}", table_ + "envelope=[[0, 1]]", table_ + "wind_by=[]"};
        if (item_.params.boolean("canopy")) groom_.push_back(table_ + "canopy_attenuation=0");
        if (item_.params.integer("cvs") == 0) groom_.push_back(table_ + "cvs=17");
    }

    // Of the strands.
    void set_share(double share) {
        const ParamValue *count = item_.params.find("count"), *density = item_.params.find("density");
        if (count && count->given)
            amount_ =
                fmt::format("{}count={:.0f}", table_, std::max(std::round(count->numbers[0] * share), 1.0));
        else if (density)
            amount_ = fmt::format("{}density={}", table_, density->numbers[0] * share);
    }

    std::vector<std::string> blades(double speed) const {
        std::vector<std::string> changes = groom_changes();
        changes.push_back(fmt::format("wind={{ {}, speed = {} }}", wind_, speed));
        return changes;
    }
    std::vector<std::string> turned(double speed, const BendDials& dials) const {
        std::vector<std::string> changes = groom_changes();
        changes.push_back(table_ + "bend=\"talk\"");
        changes.push_back(table_ + "blade={}");
        changes.push_back(
            fmt::format("wind={{ {}, speed = {}, response = {}, global_rotate = {}, ramp_rotate = {} }}",
                        wind_, speed, dials.response, dials.global_rotate, dials.ramp_rotate));
        return changes;
    }
    // The scene's, at the first key.
    BendDials own_dials() const {
        return {ramp_text(*wind_value(shot_, item_, "response")),
                fmt::format("{}", wind_value(shot_, item_, "global_rotate")->numbers[0]),
                ramp_text(*wind_value(shot_, item_, "ramp_rotate"))};
    }
    // 0: not known.
    double max_speed() const {
        const ParamValue* speed = wind_value(shot_, item_, "speed");
        if (wind_value(shot_, item_, "record") || !speed) return 0.0;
        return std::ranges::max(speed->keys ? speed->keys->numbers : speed->numbers);
    }

  private:
    std::vector<std::string> groom_changes() const {
        std::vector<std::string> changes = groom_;
        changes.push_back(amount_);
        return changes;
    }

    const Shot& shot_;
    const Item& item_;
    std::string table_, wind_, amount_;
    std::vector<std::string> groom_;
};

std::vector<Vec2d> at_profile_knots(const std::vector<double>& values) {
    std::vector<Vec2d> knots;
    for (size_t i = 0; i < values.size(); ++i) knots.emplace_back(profile_knots[i], values[i]);
    return knots;
}

// Strengths and profile as dials, each in its range: response ends at 1, and so does the profile if
// global_rotate can hold the rest.
BendDials dials_of_fit(const BendFit& fit, const std::vector<double>& speeds) {
    constexpr double negligible = 0.005; // of the response
    const double strongest = fit.strengths.back();
    std::vector<Vec2d> response = {Vec2d::Zero()};
    for (size_t j = 0; j < speeds.size(); ++j)
        response.emplace_back(speeds[j], strongest > 0.0 ? fit.strengths[j] / strongest : 0.0);
    std::vector<double> profile = fit.profile;
    for (double& value : profile) value *= std::max(strongest, 1.0);
    return {knots_text(fewer_knots(response, negligible)), fmt::format("{:.3g}", std::min(strongest, 1.0)),
            knots_text(at_profile_knots(profile))};
}

double angle_between(const Vec3d& a, const Vec3d& b) {
    return std::atan2(a.cross(b).norm(), a.dot(b)) / degree;
}

struct WeightedAngle {
    double angle, weight;
};

// Median and 95th percentile.
BendError error_of(std::vector<WeightedAngle> angles) {
    std::ranges::sort(angles, {}, &WeightedAngle::angle);
    double whole = 0.0, sum = 0.0;
    for (const WeightedAngle& one : angles) whole += one.weight;
    BendError error;
    for (const auto& [angle, weight] : angles) {
        if (sum <= 0.5 * whole) error.median = angle;
        if (sum <= 0.95 * whole) error.most = angle;
        sum += weight;
    }
    return error;
}

void add_angles(const Directions& a, const Directions& b, const std::vector<double>& weights,
                std::vector<WeightedAngle>& angles) {
    for (size_t k = 0; k < a.size(); ++k) angles.push_back({angle_between(a[k], b[k]), weights[k]});
}

// Errors over all speeds of the strands' parts.
class ErrorsOverArc {
  public:
    void add(const BendTrial& trial, const Directions& a, const Directions& b) {
        for (size_t k = 0; k < a.size(); ++k) {
            const auto part =
                std::min(size_t(trial.positions()[k] * double(parts_.size())), parts_.size() - 1);
            parts_[part].push_back({angle_between(a[k], b[k]), trial.weights()[k]});
        }
    }
    size_t parts() const { return parts_.size(); }
    BendError part(size_t i) const { return error_of(parts_[i]); }
    BendError whole() const {
        std::vector<WeightedAngle> all;
        for (const auto& part : parts_) all.insert(all.end(), part.begin(), part.end());
        return error_of(all);
    }

  private:
    std::array<std::vector<WeightedAngle>, 4> parts_;
};

// One groom.
class BendMeasurement {
  public:
    BendMeasurement(const Shot& shot, const Session& session, const std::string& groom,
                    const TimeLimit& limit)
        : wind_(shot, groom, session.frame), session_(session), limit_(limit), budget_(limit.left()),
          trial_(session.request, session.frame, thinned(shot, first_share), groom, limit.stop()) {
        result_.groom = groom;
        result_.max_speed = session.request.bend_speed > 0.0 ? session.request.bend_speed : wind_.max_speed();
    }

    bool has_speed() const { return result_.max_speed > 0.0; }

    BendResult measure() {
        session_.progress.now("bend: " + result_.groom);
        choose_strands();
        std::vector<double> fitted;
        for (size_t j = 1; j <= fitted_speeds; ++j) { // denser at low speeds: drag grows with the square
            const double share = double(j) / double(fitted_speeds);
            fitted.push_back(result_.max_speed * share * std::sqrt(share));
        }
        const BendDials own = wind_.own_dials(), fit = fitted_dials(fitted);
        result_.dials = {"response = " + fit.response, "global_rotate = " + fit.global_rotate,
                         "ramp_rotate = " + fit.ramp_rotate};
        std::vector<double> speeds = {0.0};
        for (const double speed : fitted) {
            speeds.push_back(0.5 * (speeds.back() + speed));
            speeds.push_back(speed);
        }
        compare(speeds, own, fit);
        return std::move(result_);
    }

  private:
    static constexpr double first_share = 1e-4;

    // Takes some hundreds of the groom's strands, and of all other grooms next to none.
    void choose_strands() {
        constexpr double enough = 300.0, countable = 30.0;
        for (double share = first_share; share < 1.0; share *= 10.0) {
            wind_.set_share(share);
            trial_.bent(wind_.blades(0.0));
            const auto strands = double(trial_.strands());
            if (strands < countable) continue;
            wind_.set_share(std::min(share * enough / strands, 1.0));
            return;
        }
        wind_.set_share(1.0);
    }

    BendDials fitted_dials(const std::vector<double>& speeds) {
        BendTargets targets;
        targets.knots = profile_knots.size();
        for (const double speed : speeds) targets.directions.push_back(trial_.bent(wind_.blades(speed)));
        targets.weights = trial_.weights();
        result_.strands = trial_.strands();
        if (result_.strands == 0) return wind_.own_dials();
        const BendFit fit = fit_bend(
            targets,
            [&](const std::vector<double>& strengths) {
                return trial_.bent(
                    wind_.turned(1.0, {"[[0, 0], [1, 1]]", "1", exact_knots(at_profile_knots(strengths))}));
            },
            [&] { return limit_.left() < 0.4 * budget_; });
        return dials_of_fit(fit, speeds);
    }

    static std::string exact_knots(const std::vector<Vec2d>& knots) {
        std::string text;
        for (const Vec2d& knot : knots)
            text += fmt::format("{}[{}, {}]", text.empty() ? "" : ", ", knot.x(), knot.y());
        return "[" + text + "]";
    }

    void compare(const std::vector<double>& speeds, const BendDials& own, const BendDials& fit) {
        const Directions rest = trial_.bent(wind_.turned(0.0, own));
        ErrorsOverArc turned, before, after;
        for (const double speed : speeds) {
            const Directions blades = trial_.bent(wind_.blades(speed));
            result_.unsolved = std::max(result_.unsolved, trial_.unsolved());
            const Directions by_own = trial_.bent(wind_.turned(speed, own)),
                             by_fit = trial_.bent(wind_.turned(speed, fit));
            const std::vector<double>& weights = trial_.weights();
            result_.by_speed.push_back({speed, speed, bend_error(blades, rest, weights),
                                        bend_error(by_own, blades, weights),
                                        bend_error(by_fit, blades, weights)});
            if (speed == 0.0) continue;
            turned.add(trial_, blades, rest);
            before.add(trial_, by_own, blades);
            after.add(trial_, by_fit, blades);
        }
        for (size_t i = 0; i < after.parts(); ++i)
            result_.by_arc.push_back({double(i) / double(after.parts()),
                                      double(i + 1) / double(after.parts()), turned.part(i), before.part(i),
                                      after.part(i)});
        result_.before = before.whole();
        result_.after = after.whole();
    }

    SteadyWind wind_;
    const Session& session_;
    const TimeLimit& limit_;
    double budget_;
    BendTrial trial_;
    BendResult result_;
};

} // namespace

BendError bend_error(const Directions& a, const Directions& b, const std::vector<double>& weights) {
    std::vector<WeightedAngle> angles;
    add_angles(a, b, weights, angles);
    return error_of(std::move(angles));
}

double bend_weight(const Shot& shot) { return grooms_of_blades(shot).empty() ? 0.0 : 3.0; }

void measure_bend(const Shot& shot, const Session& session, double seconds, Measurement& measurement) {
    const std::vector<std::string> grooms = grooms_of_blades(shot);
    const auto leave_out = [&](const std::string& why) { measurement.left_out.push_back("bend: " + why); };
    if (grooms.empty()) return leave_out("no groom has bend = \"blade\"");
    for (const std::string& groom : grooms) {
        const TimeLimit limit(session, seconds / double(grooms.size()));
        try {
            const bool ended = limit.in_time([&] {
                BendMeasurement bend(shot, session, groom, limit);
                if (!bend.has_speed())
                    return leave_out(groom + " has no wind with a speed: give the largest with --bend-speed");
                BendResult result = bend.measure();
                if (result.strands == 0) return leave_out(groom + " has no strands");
                measurement.bends.push_back(std::move(result));
            });
            if (!ended) leave_out(groom + " was not measured: no time was left, give more with --seconds");
        } catch (const InputError& error) {
            leave_out(groom + " was refused: " + error.problems.front().what);
        }
    }
}

} // namespace marram
