// SPDX-License-Identifier: Apache-2.0
// The settings of each dial are run in interleaved rounds, and the result is the median of the rounds' time
// ratios, so that slow changes of the machine's speed cancel. The first round measures the errors and warms
// up: its times count only if there is no second. The time is divided among the dials by their weights. The
// settings of a dial share a limit of twice its time (TimeLimit): what has not ended then is cancelled, and the report lists
// it as not measured.
#include "core/measure/measure.h"

#include "core/math/clock.h"
#include "core/measure/errors.h"
#include "core/measure/rounds.h"
#include "core/measure/session.h"
#include "core/render/film.h"
#include "core/render/integrator.h"
#include "core/shot/scene/scene_camera.h"
#include "core/shot/settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

namespace marram {
namespace {

constexpr const char* no_time = "not measured: no time was left, give more with --seconds";

World build(Shot& shot, const Dial& dial, const Session& session, const std::atomic<bool>& stop,
            FrameStats& stats) {
    set_frame(shot, session.frame);
    BuildSettings settings = build_settings(shot, session.frame);
    if (dial.error != DialError::motion) settings.shutter_open = settings.shutter_close = 0.0;
    settings.trace_curves = dial.time == "strands and BVH" || dial.error == DialError::image ||
                            dial.error == DialError::view; // rays are traced
    settings.render_meshes = dial.error == DialError::view;
    settings.attributes =
        dial.error == DialError::image ? wanted_attributes(shot, {}) : std::vector<std::string>{};
    if (dial.error == DialError::surface) settings.state_folder.clear(); // simulations start anew
    BuildProgress progress;
    return build_world(shot.geometry, settings, stop, progress, stats.build);
}

// The setting that ratios refer to: the scene's own, or the first that is not refused.
size_t base_of(const Dial& dial, const std::vector<SettingResult>& results) {
    for (size_t i = 0; i < results.size(); ++i)
        if (dial.settings[i].own && results[i].refused.empty()) return i;
    for (size_t i = 0; i < results.size(); ++i)
        if (results[i].refused.empty()) return i;
    return 0;
}

// A surface may be simulated: a fine setting may take far more time than there is. (Strands are thinned, so
// that there is time for every setting.) The settings of such a dial begin with the coarsest and end with the
// reference.
bool coarsest_first(const Dial& dial) { return dial.error == DialError::surface; }

// The order of measuring: the reference, the base, then the others. Coarsest first: the base second, as
// ratios refer to it, and the reference last.
std::vector<size_t> order_of(const Dial& dial, size_t base) {
    std::vector<size_t> order;
    for (size_t i = 0; i < dial.settings.size(); ++i)
        if (i != base && i != dial.reference) order.push_back(i);
    const bool coarsest = coarsest_first(dial);
    if (base != dial.reference) order.insert(order.begin() + (coarsest && !order.empty() ? 1 : 0), base);
    order.insert(coarsest ? order.end() : order.begin(), dial.reference);
    return order;
}

// What errors refer to if there was no time for the reference: the finest setting that was measured. Those
// before the reference are sorted. Where the base belongs among them is not known, but what is finer takes
// longer: half as much again is more than times differ by chance, and less than the next setting takes.
size_t finest_measured(const Dial& dial, const Rounds& rounds, size_t base) {
    size_t finest = base;
    for (size_t i = 0; i < dial.settings.size(); ++i)
        if (rounds.has(i) && (i < dial.reference || !rounds.has(finest))) finest = i;
    return rounds.first(base) > 1.5 * rounds.first(finest) ? base : finest;
}

// The errors of a dial's settings. What is built before the reference waits for it.
class Errors {
  public:
    // tolerance: of the scene, metres
    Errors(DialResult& result, const Session& session, const std::vector<Shot>& scenes, double tolerance)
        : result_(result), session_(session), scenes_(scenes), tolerance_(tolerance),
          by_attribute_(result.settings.size()) {}

    // Takes a setting of a dial without_contact: as the scene is, and before contact.
    void add(size_t setting, World world, World before_contact) {
        if (setting == result_.dial.reference) {
            after_contact_ = std::move(world); // this dial's reference is always the first
            add(setting, std::move(before_contact));
            return;
        }
        if (!after_contact_) return;
        compare_after_contact(world, *after_contact_, tolerance_, result_.settings[setting]);
        add(setting, std::move(before_contact));
    }

    void add(size_t setting, World world) {
        if (result_.dial.error == DialError::surface) // what is not compared would wait in memory
            world.colliders.reset(), world.collider_scenes.clear();
        if (setting == result_.dial.reference)
            refer_to(setting, std::move(world));
        else if (reference_)
            compare(setting, world);
        else
            waiting_.emplace(setting, std::move(world));
    }

    // All that could be measured has been added. If the reference could not, errors are against `finest`.
    void finish(size_t finest) {
        if (!waiting_.empty()) {
            const std::vector<DialSetting>& settings = result_.dial.settings;
            result_.dial.explain +=
                fmt::format(" {} was not measured: errors are against {}, the finest that was.",
                            settings[result_.dial.reference].label, settings[finest].label);
            World world = std::move(waiting_.at(finest));
            waiting_.erase(finest);
            refer_to(finest, std::move(world));
        }
        if (result_.dial.error == DialError::surface) choose_attributes();
    }

  private:
    void refer_to(size_t setting, World world) {
        result_.dial.reference = setting;
        reference_ = std::move(world);
        compare(setting, *reference_);
        for (const auto& [other, made] : waiting_) compare(other, made);
        waiting_.clear();
    }

    void compare(size_t setting, const World& world) {
        if (session_.cancel.load()) throw Cancelled{};
        SettingResult& result = result_.settings[setting];
        const Dial& dial = result_.dial;
        const bool meshes = dial.error == DialError::surface || dial.error == DialError::view;
        if (meshes && setting == dial.reference) return; // no error
        if (dial.error == DialError::surface) {
            compare_surfaces(world, *reference_, result);
            compare_attributes(world, *reference_, by_attribute_[setting]);
        } else if (dial.error == DialError::view) {
            compare_views(scenes_[setting], session_.frame, world, *reference_, result);
        } else {
            compare_strands(dial, scenes_[setting], session_.frame, world, *reference_, result);
        }
    }

    // A dial that moves no surface but changes attributes is one of attributes.
    void choose_attributes() {
        const auto wrong = [](const SettingResult& setting) { return setting.error > 0.0; };
        if (std::ranges::any_of(result_.settings, wrong) || std::ranges::none_of(by_attribute_, wrong))
            return;
        result_.dial.error = DialError::attribute;
        for (size_t i = 0; i < by_attribute_.size(); ++i) {
            SettingResult& setting = result_.settings[i];
            if (!setting.refused.empty() || i == result_.dial.reference) continue;
            setting.error = by_attribute_[i].error, setting.worst = by_attribute_[i].worst;
            setting.refused = by_attribute_[i].refused;
        }
    }

    DialResult& result_;
    const Session& session_;
    const std::vector<Shot>& scenes_; // [setting]
    double tolerance_;
    std::optional<World> reference_, after_contact_; // after_contact_: the reference as the scene is
    std::map<size_t, World> waiting_;
    std::vector<SettingResult> by_attribute_; // of a dial of meshes
};

// Compares the rule that chooses motion keys with the measurement: its law over the settings, and its
// prediction for the scene.
std::string motion_rule(const DialResult& result, const Shot& shot, const Session& session,
                        const BuildStats& own) {
    std::string rule = "Rule: the error falls with the square of the keys less one";
    double three = 0.0, low = INFINITY, high = 0.0;
    for (size_t i = 0; i < result.settings.size(); ++i) {
        if (!result.settings[i].refused.empty() || i == result.dial.reference) continue;
        const double keys = result.dial.settings[i].number;
        const double error = result.settings[i].error;
        if (keys == 3) three = error;
        if (keys <= 3 || three <= 0.0) continue;
        const double miss = error * (keys - 1.0) * (keys - 1.0) / (4.0 * three);
        low = std::min(low, miss);
        high = std::max(high, miss);
    }
    if (high > 0.0)
        rule +=
            fmt::format("; measured errors are {:.2f} to {:.2f} of that, from those of 3 keys", low, high);
    rule += ".";
    if (own.motion_error > 0.0) {
        const BuildSettings settings = build_settings(shot, session.frame);
        const double unit = pixel_size(shot, session.frame);
        double measured = 0.0;
        for (size_t i = 0; i < result.settings.size(); ++i)
            if (result.dial.settings[i].own) measured = result.settings[i].error;
        rule += fmt::format(
            " The tolerance, {:.3g} pixels, chose {} keys: {:.3g} foreseen, {:.3g} measured; {:.2g} % of "
            "the strands looked at jump, which no number of keys follows.",
            settings.tolerance / unit, own.motion_keys, own.motion_error / unit, measured,
            100.0 * own.motion_jumps);
    }
    return rule;
}

// The same for a dial over numbers: its law, scaled to the finest setting before the reference, and the
// choice of the tolerance.
std::string dial_rule(const DialResult& result, double tolerance, const BuildStats* chosen) {
    const Dial& dial = result.dial;
    const auto number = [&](size_t i) { return dial.settings[i].number; };
    const double reference = dial.law(number(dial.reference)); // it has an error, too
    double least = 0.0, factor = 0.0, low = INFINITY, high = 0.0, measured = 0.0;
    const auto each = [&](auto&& visit) {
        for (size_t i = 0; i < result.settings.size(); ++i)
            if (result.settings[i].refused.empty() && i != dial.reference && number(i) > 0.0)
                visit(dial.law(number(i)) - reference, result.settings[i].most);
    };
    each([&](double law, double most) {
        if (law <= 0.0 || most <= 0.0 || (least > 0.0 && law >= least)) return;
        least = law;
        factor = most / law;
    });
    each([&](double law, double most) {
        if (law <= 0.0 || law == least || factor <= 0.0) return; // law == least: the scale itself
        low = std::min(low, most / (factor * law));
        high = std::max(high, most / (factor * law));
    });
    if (factor <= 0.0) return fmt::format("Rule: the error {}; no error was measured.", dial.law_words);
    std::string rule = fmt::format("Rule: the error {}", dial.law_words);
    if (high > 0.0) rule += fmt::format("; measured errors are {:.2f} to {:.2f} of that", low, high);
    rule += fmt::format("; the reference is off by about {:.2g} m.", factor * reference);
    for (size_t i = 0; i < result.settings.size(); ++i)
        if (dial.settings[i].by_tolerance) measured = result.settings[i].most;
    if (!chosen) return rule;
    for (const auto& [name, value] : chosen->chosen)
        if (name.ends_with("." + dial.name))
            rule += fmt::format(" The tolerance chose {} = {:.6g}.", name, value);
    // Settings before the reference have been measured against it, and it has an error of its own.
    const double own_error = factor * reference;
    rule += fmt::format(" 99 strands in 100 are within {:.3g} m of the reference, the tolerance is {:.3g} m",
                        measured, tolerance);
    return rule +
           (own_error > 0.25 * tolerance
                ? fmt::format(": too coarse a reference to tell, its own error may be {:.2g} m.", own_error)
                : std::string("."));
}

// A dial whose settings build the scene: its strands or its meshes.
class BuildDial {
  public:
    BuildDial(const Dial& dial, const Session& session, double budget)
        : result_{dial, std::vector<SettingResult>(dial.settings.size()), 0, {}}, dial_(dial),
          session_(session), end_(wall_seconds() + budget), limit_(session, 2.0 * budget),
          own_limit_(session, budget), scenes_(dial.settings.size()) {}

    DialResult measure() {
        for (size_t i = 0; i < dial_.settings.size(); ++i) attempt(i, [&] { load(i); });
        size_t base = base_of(dial_, result_.settings);
        order_ = order_of(dial_, base);
        Rounds rounds(dial_.settings.size(), base);
        const double tolerance =
            refused(base).empty() ? build_settings(scenes_[base], session_.frame).tolerance : 0.0;
        Errors errors(result_, session_, scenes_, tolerance);
        const double begin = wall_seconds();
        first_round(base, rounds, errors);
        errors.finish(finest_measured(dial_, rounds, base));
        more_rounds(rounds, wall_seconds() - begin);
        base = base_of(dial_, result_.settings); // there may have been no time for the one before
        rounds.set_base(base);
        result_.base = rounds.base_is_positive() ? base : result_.dial.reference;
        rounds.set_base(result_.base);
        rounds.finish(result_.settings);
        mark_front(result_);
        if (refused(base).empty()) describe_rule(base); // else nothing was measured
        return std::move(result_);
    }

  private:
    std::string& refused(size_t i) { return result_.settings[i].refused; }
    const TimeLimit& limit_of(size_t i) const {
        return coarsest_first(dial_) && dial_.settings[i].own ? own_limit_ : limit_;
    }
    std::vector<std::string> changes_of(size_t i) const {
        std::vector<std::string> changes = session_.thinned;
        changes.insert(changes.end(), dial_.settings[i].changes.begin(), dial_.settings[i].changes.end());
        return changes;
    }
    void load(size_t i) { scenes_[i] = load_with(session_.request, limit_of(i).stop(), changes_of(i)); }

    // Does work for a setting. False: the setting is refused, for lack of time or by an error of the scene.
    template <typename Work>
    bool attempt(size_t i, const Work& work) {
        try {
            if (!limit_of(i).in_time(work)) refused(i) = no_time;
        } catch (const InputError& error) {
            refused(i) = "refused: " + error.problems.front().what;
        }
        return refused(i).empty();
    }

    // Builds each setting once, for its error.
    void first_round(size_t base, Rounds& rounds, Errors& errors) {
        double coarser = 0.0; // wall seconds of a coarser setting: finer ones take at least as long
        for (const size_t i : order_) {
            if (!refused(i).empty()) continue;
            if (const std::string& lost = refused(dial_.reference); !lost.empty() && lost != no_time)
                refused(i) = "not measured: its reference is refused";
            else if (i != base && limit_.left() <= coarser)
                refused(i) = no_time;
            if (!refused(i).empty()) continue;
            session_.progress.now(fmt::format("{}: {}", dial_.name, dial_.settings[i].label));
            FrameStats stats;
            World world;
            const double start = wall_seconds();
            if (!attempt(i, [&] { world = build(scenes_[i], dial_, session_, limit_of(i).stop(), stats); }))
                continue;
            if (coarsest_first(dial_) && i != base) coarser = wall_seconds() - start;
            rounds.add(i, seconds_of(dial_, stats));
            if (dial_.settings[i].own) scene_stats_ = stats.build;
            if (dial_.settings[i].by_tolerance) by_tolerance_ = stats.build;
            add_errors(i, std::move(world), errors);
        }
    }

    void add_errors(size_t i, World world, Errors& errors) {
        if (dial_.without_contact.empty()) return errors.add(i, std::move(world));
        World before_contact;
        if (attempt(i, [&] {
                std::vector<std::string> changes = changes_of(i);
                changes.insert(changes.end(), dial_.without_contact.begin(), dial_.without_contact.end());
                Shot scene = load_with(session_.request, limit_of(i).stop(), changes);
                FrameStats untimed;
                before_contact = build(scene, dial_, session_, limit_of(i).stop(), untimed);
            }))
            errors.add(i, std::move(world), std::move(before_contact));
    }

    // Times all settings again, as often as there is time. round: seconds of one.
    void more_rounds(Rounds& rounds, double round) {
        for (int r = 1; r < session_.request.rounds && wall_seconds() + round < end_; ++r)
            for (const size_t i : order_) {
                if (!refused(i).empty()) continue;
                session_.progress.now(fmt::format("{}: {}", dial_.name, dial_.settings[i].label));
                FrameStats stats;
                const bool ended = limit_of(i).in_time([&] {
                    if (dial_.error == DialError::surface) load(i); // a mesh that has been made would be kept
                    build(scenes_[i], dial_, session_, limit_of(i).stop(), stats);
                });
                if (!ended) break;
                rounds.add(i, seconds_of(dial_, stats));
            }
    }

    void describe_rule(size_t base) {
        if (dial_.error == DialError::motion)
            result_.rule = motion_rule(result_, scenes_[base], session_, scene_stats_);
        if (dial_.law)
            result_.rule = dial_rule(result_, build_settings(scenes_[base], session_.frame).tolerance,
                                     by_tolerance_ ? &*by_tolerance_ : nullptr);
    }

    DialResult result_;
    const Dial& dial_;
    const Session& session_;
    const double end_;
    // limit_: twice the budget, so that a dial with an expensive setting gets one round. own_limit_: half of that, for
    // the scene's own setting if it is simulated. The procedurals of scenes_ read them as long as they live.
    const TimeLimit limit_, own_limit_;
    std::vector<Shot> scenes_;
    std::vector<size_t> order_;
    BuildStats scene_stats_;                 // of the scene's own setting
    std::optional<BuildStats> by_tolerance_; // of the setting that the tolerance chooses
};

struct Picture {
    std::vector<float> pixels;
    double seconds = 0.0;
};

// Adds to the rounds until they are complete, or stops with Cancelled.
void measure_samples(DialResult& result, Rounds& rounds, const Session& session,
                     const std::atomic<bool>& stop, double budget) {
    Dial& dial = result.dial;
    const double end = wall_seconds() + budget;
    constexpr uint32_t widest = 160;
    Shot shot = load_shot(session.request.scene, session.request.overrides, stop);
    auto [width, height] = film_size(shot);
    if (width > widest) {
        Overrides small = session.request.overrides;
        small.size = {widest, std::max(1U, (height * widest + width / 2) / width)};
        shot = load_shot(session.request.scene, small, stop);
        std::tie(width, height) = film_size(shot);
    }
    session.progress.now(dial.name + ": strands");
    FrameStats built;
    const World world = build(shot, dial, session, stop, built);
    const Lights lights(shot.lights, world);
    const Camera camera = camera_at(shot.description, session.frame);
    const auto picture = [&](uint32_t samples, uint64_t seed) {
        RenderSettings settings = render_settings(shot, session.frame);
        settings.samples = samples;
        settings.seed ^= seed;
        const std::vector<std::string> layers = {"beauty"};
        Film film = make_film(width, height, layers, world);
        RenderProgress progress;
        progress.cancel = &stop;
        const double begin = wall_seconds();
        const RenderStats stats = render(world, lights, shot.materials, camera, settings, film, &progress);
        if (stats.cancelled) throw Cancelled{};
        return Picture{find_layer(film, "beauty")->values, wall_seconds() - begin};
    };
    constexpr uint64_t other_seed = 0x5bd1e995;
    const double per_sample = picture(1, other_seed).seconds;
    DialSetting& finest = dial.settings[dial.reference];
    const auto affordable = uint32_t(std::clamp(0.5 * budget / per_sample, 4.0, 65536.0));
    if (finest.samples > affordable) { // use fewer, and leave out settings close to it
        finest.samples = affordable;
        finest.label = std::to_string(affordable);
    }
    for (size_t i = 0; i < dial.settings.size(); ++i)
        if (i != dial.reference && dial.settings[i].samples > finest.samples / 2)
            result.settings[i].refused = no_time;
    session.progress.now(fmt::format("{}: {}", dial.name, finest.label));
    const Picture reference = picture(finest.samples, other_seed);
    rounds.add(dial.reference, reference.seconds); // rendered once: it is expensive
    double mean = 0.0;
    for (const float p : reference.pixels) mean += double(p) / double(reference.pixels.size());
    for (int r = 0; r < session.request.rounds; ++r) {
        const double begin = wall_seconds();
        for (size_t i = 0; i < dial.settings.size(); ++i) {
            SettingResult& setting = result.settings[i];
            if (!setting.refused.empty() || i == dial.reference) continue;
            session.progress.now(fmt::format("{}: {}", dial.name, dial.settings[i].label));
            const Picture mine = picture(dial.settings[i].samples, 0);
            rounds.add(i, mine.seconds);
            if (r > 0 || !(mean > 0.0)) continue;
            double squares = 0.0;
            for (size_t p = 0; p < mine.pixels.size(); ++p) {
                const double off = std::abs(double(mine.pixels[p]) - double(reference.pixels[p])) / mean;
                squares += off * off;
                setting.worst = std::max(setting.worst, off);
            }
            setting.error = std::sqrt(squares / double(mine.pixels.size()));
        }
        if (wall_seconds() + (wall_seconds() - begin) > end) break;
    }
}

DialResult measure_pictures(const Dial& dial, const Session& session, double budget) {
    DialResult result{dial, std::vector<SettingResult>(dial.settings.size()), 0, {}};
    Rounds rounds(dial.settings.size(), 0);
    const TimeLimit limit(session, 2.0 * budget);
    limit.in_time([&] { measure_samples(result, rounds, session, limit.stop(), budget); });
    for (size_t i = 0; i < dial.settings.size(); ++i)
        if (!rounds.has(i)) result.settings[i].refused = no_time;
    result.base = base_of(dial, result.settings);
    rounds.set_base(result.base);
    rounds.finish(result.settings);
    mark_front(result);
    return result;
}

// Builds the scene as it is, counts what it has, and chooses how many of its strands are measured.
void choose_strands(Session& session, Measurement& measurement) {
    const MeasureRequest& request = session.request;
    Dial all;
    all.time = "strands and BVH";
    FrameStats stats;
    const TimeLimit limit(session, session.progress.left());
    Shot whole, fewer;
    const auto build_and_count = [&](Shot& shot) {
        stats = {};
        return limit.in_time([&] {
            shot = load_with(request, limit.stop(), session.thinned);
            build(shot, all, session, limit.stop(), stats);
            measurement.built = true;
            measurement.strands = stats.build.curves;
            measurement.cvs = stats.build.cvs;
            measurement.triangles = stats.build.triangles;
        });
    };
    if (!build_and_count(whole)) {
        measurement.left_out.push_back(fmt::format(
            "every setting: the scene was not built within --seconds {:g}, give more", request.seconds));
        return;
    }
    // One round over all dials costs about 100 builds of the scene's strands. Allow for about 3 rounds.
    constexpr double builds = 300.0;
    const double share = request.seconds / builds / std::max(seconds_of(all, stats), 1e-9);
    if (share >= 1.0) return;
    session.thinned = thinned(whole, share);
    if (build_and_count(fewer))
        measurement.left_out.push_back(
            fmt::format("strands: {:.2g} % of them were measured, so that there is time for every setting; "
                        "--seconds asks for more (the picture has them all)",
                        100.0 * share));
}

} // namespace

MeasureProgress::MeasureProgress(double seconds) : begin_(wall_seconds()), seconds_(seconds) {}

void MeasureProgress::now(std::string phase) {
    const std::lock_guard lock(mutex_);
    phase_ = std::move(phase);
}

std::pair<std::string, double> MeasureProgress::state() const {
    const std::lock_guard lock(mutex_);
    return {phase_, (wall_seconds() - begin_) / seconds_};
}

double MeasureProgress::left() const { return begin_ + seconds_ - wall_seconds(); }

void measure(const Shot& shot, const MeasureRequest& request, MeasureProgress& progress,
             const std::atomic<bool>& cancel, Measurement& measurement) {
    Session session{request, request.frame, progress, cancel};
    const DialList list = dials_of(shot);
    measurement = {request.scene, request.frame, request.threads, 0, 0, 0, {}, list.left_out};
    const auto weight_from = [&](size_t i) { // of the dials to come
        double sum = 0.0;
        for (size_t k = i; k < list.dials.size(); ++k) sum += list.dials[k].weight;
        return sum;
    };
    const double bend = bend_weight(shot);
    measure_bend(shot, session, std::max(progress.left(), 0.0) * bend / (bend + weight_from(0)), measurement);
    choose_strands(session, measurement);
    for (size_t i = 0; i < list.dials.size(); ++i) {
        const Dial& dial = list.dials[i];
        const double budget = std::max(progress.left(), 0.0) * dial.weight / weight_from(i);
        measurement.dials.push_back(dial.error == DialError::image
                                        ? measure_pictures(dial, session, budget)
                                        : BuildDial(dial, session, budget).measure());
    }
}

} // namespace marram
