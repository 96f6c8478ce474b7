// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/pilot.h"

#include "procedural/strands/mesh_instances.h"

#include "procedural/wind/bend.h"
#include "procedural/wind/keyed_wind.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace marram {
namespace {

constexpr double safety_factor = 1.25;
constexpr double default_tolerance_ratio = 1e-3; // of the longest strand, if the frame has no tolerance

double tolerance_of(const PilotGroom& pilot) {
    return pilot.frame.tolerance > 0.0
               ? pilot.frame.tolerance
               : default_tolerance_ratio * pilot.instance_scale * longest_strand(pilot.groom);
}

// A sample of a groom's roots with their blends of guides.
struct RootSample {
    std::vector<Root> roots;
    std::vector<GuideBlend> blends;
    std::optional<Guided> guided; // points into blends

    RootSample(const PilotGroom& pilot, size_t most) {
        const size_t count = std::min(most, pilot.roots.size());
        for (size_t i = 0; i < count; ++i) {
            roots.push_back(pilot.roots[i * pilot.roots.size() / count]);
            if (pilot.guided) blends.push_back(pilot.guided->blends[i * pilot.roots.size() / count]);
        }
        if (pilot.guided) guided.emplace(Guided{pilot.guided->set, blends, pilot.guided->skin});
    }
    RootSample(const RootSample&) = delete;
    RootSample& operator=(const RootSample&) = delete;
    const Guided* guides() const { return guided ? &*guided : nullptr; }
};

// The 99th percentile; of fewer than a hundred distances the maximum.
double percentile_99(std::vector<double>& distances) {
    if (distances.empty()) return 0.0;
    const auto at = distances.end() - 1 - long(distances.size() / 100);
    std::nth_element(distances.begin(), at, distances.end());
    return *at;
}

double distance(const Wide3f& a, const Wide3f& b, int lane) {
    const double x = double(a.x[lane]) - double(b.x[lane]), y = double(a.y[lane]) - double(b.y[lane]),
                 z = double(a.z[lane]) - double(b.z[lane]);
    return std::sqrt(x * x + y * y + z * z);
}

// Appends for each strand the greatest distance between a CV of `fine`, which has `every` times as many
// segments, and the point of the polygon of `coarse` at the same parameter.
void add_polygon_errors(const WideVector<Wide3f>& coarse, const WideVector<Wide3f>& fine, size_t strands,
                        size_t segments, size_t every, std::vector<double>& distances) {
    const size_t cvs = segments + 1, fine_cvs = segments * every + 1;
    for (size_t i = 0; i < strands; ++i) {
        const Wide3f* a = coarse.data() + i / lanes * cvs;
        const Wide3f* b = fine.data() + i / lanes * fine_cvs;
        double most = 0.0;
        for (size_t k = 0; k < fine_cvs; ++k) {
            const size_t s = std::min(k / every, segments - 1);
            const VFloat share = splat_float(float(k - s * every) / float(every));
            most = std::max(most, distance(a[s] + (a[s + 1] - a[s]) * share, b[k], int(i % lanes)));
        }
        distances.push_back(most);
    }
}
// The 99th percentile of these.
double polygon_error(const WideVector<Wide3f>& coarse, const WideVector<Wide3f>& fine, size_t strands,
                     size_t segments, size_t every) {
    std::vector<double> distances;
    add_polygon_errors(coarse, fine, strands, segments, every, distances);
    return percentile_99(distances);
}

void bend_as_groomed(const PilotGroom& pilot, double frame, Strands& strands) {
    if (!pilot.groom.blade) return bend(pilot.wind, frame, pilot.frame.fps, strands);
    Blade blade = *pilot.groom.blade;
    resolve_blades(pilot.wind, strands.cvs, pilot.instance_scale * longest_strand(pilot.groom),
                   pilot.frame.tolerance, blade);
    bend_blades(pilot.wind, blade, frame, pilot.frame.fps, strands);
}

// strength: of the wind that reaches the strands, 0 to 1.
void bend_sample(const PilotGroom& pilot, const RootSample& some, double frame, int cvs, Strands& strands,
                 double strength = 1.0) {
    strands.resize(int(some.roots.size()), cvs, false);
    expand(pilot.groom, pilot.wind, {pilot.bind, pilot.bind}, some.roots, strands, some.guides());
    scale_strands(strands, pilot.instance_scale);
    const double response = max_response(pilot.wind) * strength;
    // Fields that act at each CV bend a strand within its length: more CVs show it.
    const bool local = pilot.wind.fields_at_cvs;
    std::vector<FieldAt> fields;
    if (local) {
        fields = fields_at(pilot.wind.fields, frame);
        LocalWind wind{pilot.wind.direction, pilot.wind.speed, pilot.wind.response, fields};
        wind.at_cvs = true;
        local_wind(wind, strands);
    }
    for (size_t i = 0; i < strands.envelope.size(); ++i) {
        const double u = double(i % size_t(cvs)) / double(cvs - 1);
        const double own = std::clamp(pilot.groom.envelope(u), 0.0, 1.0);
        strands.envelope[i] =
            local ? strands.wind_response[i] * float(own * strength) : splat_float(float(own * response));
    }
    const bool sags = pilot.groom.blade && pilot.groom.blade->sags;
    if ((response > 0.0 && wind_bends(pilot.wind)) || sags)
        bend_as_groomed(pilot, frame, strands);
    else
        std::copy(strands.rest.begin(), strands.rest.end(), strands.pose.begin());
}

// Poses of strands that jiggle on a static skin at a time, in the full wind: shelter differs from frame to
// frame.
// Empty before jiggle.start_frame.
WideVector<Wide3f> jiggled(const JigglePilot& pilot, double time, double step, Strands& strands) {
    Wind wind = pilot.wind;
    wind.collision.reset();
    wind.shielding.reset();
    wind.jiggle->step = step;
    MarramFrame frame = pilot.frame;
    frame.frame = time;
    frame.times = &time;
    frame.time_count = 1;
    const JiggleWindow window =
        jiggle_window(*wind.jiggle, {&time, 1}, frame.fps, 2.0 * pilot.length, pilot.tolerance);
    if (window.empty()) return {};
    ChainInput input{wind, pilot.envelope, frame, pilot.skin, {}, pilot.basis, window};
    pilot.expand(wind, strands);
    input.rest = {};
    for (const Wide3f& p : strands.rest)
        for (int lane = 0; lane < lanes; ++lane)
            input.rest.extend(Vec3d(double(p.x[lane]), double(p.y[lane]), double(p.z[lane])));
    input.blade = pilot.blade;
    const ChainFrame chain = make_chain_frame(input);
    RestStrandSource rest_strands;
    rest_strands.at_time = [&](auto, Strands& out) { pilot.expand(wind, out); };
    rest_strands.at_bind = [&](Strands& out) { pilot.expand(wind, out); };
    rest_strands.moves = rest_strands.moved = false;
    ChainScratch scratch;
    jiggle_patch(chain, rest_strands, strands, scratch);
    return std::move(scratch.jiggled[0]);
}

// Greatest error in m of the radius when the width profile is interpolated linearly over so many segments.
double width_error(const Groom& groom, int segments) {
    constexpr int samples = 1024;
    double most = 0.0;
    for (int i = 0; i <= samples; ++i) {
        const double u = double(i) / samples, at = u * segments;
        const int k = std::min(int(at), segments - 1);
        const double a = groom.width_profile(double(k) / segments),
                     b = groom.width_profile(double(k + 1) / segments);
        most = std::max(most, std::abs(a + (b - a) * (at - k) - groom.width_profile(u)));
    }
    return 0.5 * groom.width * most;
}

// Fewest segments that resolve curls and frizz: six per turn.
int segments_of_shape(const Groom& groom) {
    double turns = 0.0;
    if (groom.curl_radius > 0.0) turns = std::max(turns, groom.curl_turns);
    if (groom.frizz_amplitude > 0.0) turns = std::max(turns, groom.frizz_frequency);
    return int(std::clamp(std::ceil(6.0 * turns), 2.0, 999.0));
}

// Errors at doubling segment counts, as a function of any count.
class SegmentErrors {
  public:
    // distances: [level], from `least << level` segments to twice the last of them
    SegmentErrors(const std::vector<double>& distances, int least) : least_(least) {
        const size_t levels = distances.size();
        // The power by which the error falls. The finest has an error, too: with it, distances fall faster
        // than errors at the last levels.
        const auto power = [&](size_t level) {
            if (level + 1 >= levels || !(distances[level + 1] > 0.0)) return 1.0;
            return std::clamp(std::log2(distances[level] / distances[level + 1]), 1.0, 2.0);
        };
        for (size_t level = 0; level < levels; ++level) {
            powers_.push_back(power(levels > 2 ? std::min(level, levels - 3) : 0));
            errors_.push_back(distances[level] /
                              (1.0 - std::pow(2.0, -powers_.back() * double(levels - level))));
        }
    }
    double at(int segments) const {
        size_t level = 0;
        while (level + 1 < errors_.size() && least_ << (level + 1) <= segments) ++level;
        return errors_[level] * std::pow(double(least_ << level) / segments, powers_[level]);
    }

  private:
    int least_;
    std::vector<double> errors_, powers_;
};

// The same distances of strands that jiggle, in gusts, on a static skin: while they swing, few CVs show less
// of their shape than at rest. Raises `distances` where these are greater.
void measure_jiggle(const PilotGroom& pilot, std::span<const double> moments, int least,
                    std::vector<double>& distances) {
    const RootSample some(pilot, 200); // so that two of them are beyond the 99th percentile
    const auto levels = int(distances.size());
    const int finest = least << levels;
    for (const double moment : moments) {
        const MarramFrame& frame = pilot.frame;
        const double time = frame.bind_frame + moment;
        const double length = pilot.instance_scale * longest_strand(pilot.groom);
        const auto pose = [&](int segments) {
            const auto lay_out = [&](const Wind& wind, Strands& out) {
                expand(pilot.groom, wind, {pilot.bind, pilot.bind}, some.roots, out, some.guides());
                scale_strands(out, pilot.instance_scale);
            };
            const JigglePilot swinging{pilot.wind,
                                       frame,
                                       &pilot.skin,
                                       pilot.groom.envelope,
                                       pilot.groom.basis,
                                       length,
                                       tolerance_of(pilot),
                                       some.roots.size(),
                                       segments + 1,
                                       false,
                                       lay_out,
                                       pilot.groom.blade ? &*pilot.groom.blade : nullptr};
            Strands strands;
            strands.resize(int(some.roots.size()), segments + 1, false);
            return jiggled(swinging, time, default_jiggle_step, strands);
        };
        const WideVector<Wide3f> fine = pose(finest);
        if (fine.empty()) continue; // before jiggle.start_frame
        for (int level = 0; level < levels; ++level) {
            const int segments = least << level;
            double& distance = distances[size_t(level)];
            distance = std::max(distance, polygon_error(pose(segments), fine, some.roots.size(),
                                                        size_t(segments), size_t(finest / segments)));
        }
    }
}

// The error of sheltered strands, m times CVs. The sheltered share of a strand is the mean over its CVs of
// what is 0 or 1, both ends included: up to 1 / (2 CVs) off that of the whole strand, or of its edge where
// each CV has its own.
double shelter_error(const PilotGroom& pilot, const RootSample& some, double frame) {
    if (!pilot.wind.shielding) return 0.0;
    constexpr int segments = 64;
    constexpr double change =
        0.1; // of the wind's strength; the pose is not linear in it, so two places are tried
    Strands strands;
    double error = 0.0;
    for (const double strength : {1.0, 0.5}) {
        bend_sample(pilot, some, frame, segments + 1, strands, strength);
        const WideVector<Wide3f> pose = strands.pose;
        bend_sample(pilot, some, frame, segments + 1, strands, strength - change);
        error = std::max(error, polygon_error(strands.pose, pose, some.roots.size(), segments, 1) / change);
    }
    return 0.5 * pilot.wind.shielding->shield * error;
}

} // namespace

Choice cvs_for(const PilotGroom& pilot) {
    constexpr int max_segments = 999;
    constexpr double moments[] = {0.0, 97.0, 1009.0}; // frames after bind_frame: other places in the noise
    const int least = segments_of_shape(pilot.groom);
    const double tolerance = tolerance_of(pilot);
    int levels = 5; // the finest level has 2^levels times the fewest segments
    while (levels > 1 && least << levels > 1024) --levels;
    const int finest = least << levels;
    const RootSample some(pilot, 171);
    std::vector<double> distances(static_cast<size_t>(levels)); // of each level from the finest
    Strands strands;
    for (const double moment : moments) {
        const double frame = pilot.frame.bind_frame + moment;
        bend_sample(pilot, some, frame, finest + 1, strands);
        const WideVector<Wide3f> fine = strands.pose;
        for (int level = 0; level < levels; ++level) {
            const int segments = least << level;
            bend_sample(pilot, some, frame, segments + 1, strands);
            double& distance = distances[size_t(level)];
            distance = std::max(distance, polygon_error(strands.pose, fine, some.roots.size(),
                                                        size_t(segments), size_t(finest / segments)));
        }
    }
    if (pilot.wind.jiggle) measure_jiggle(pilot, moments, least, distances);
    const double sheltered = shelter_error(pilot, some, pilot.frame.bind_frame + moments[0]);
    const SegmentErrors errors(distances, least);
    for (int segments = least; segments <= max_segments; ++segments) {
        if (safety_factor * (errors.at(segments) + sheltered / (segments + 1)) <= tolerance &&
            pilot.instance_scale * width_error(pilot.groom, segments) <= tolerance)
            return {double(segments + 1), true};
    }
    return {double(max_segments + 1), false};
}

JigglePilot jiggle_pilot(const PilotGroom& pilot, double tolerance, size_t strands) {
    const auto some = std::make_shared<const RootSample>(pilot, strands);
    return {pilot.wind,
            pilot.frame,
            &pilot.skin,
            pilot.groom.envelope,
            pilot.groom.basis,
            pilot.instance_scale * longest_strand(pilot.groom),
            tolerance,
            some->roots.size(),
            pilot.groom.cvs,
            false,
            [&groom = pilot.groom, bind = pilot.bind, some, scale = pilot.instance_scale](const Wind& wind,
                                                                                          Strands& out) {
                expand(groom, wind, {bind, bind}, some->roots, out, some->guides());
                scale_strands(out, scale);
            },
            pilot.groom.blade ? &*pilot.groom.blade : nullptr};
}

namespace {

constexpr double moments_apart = 32.0; // frames

// Whether the wind differs from time to time by chance alone.
bool is_stationary(const Wind& wind) {
    if (wind.keys || wind.jiggle->start_frame || std::ranges::any_of(wind.fields, field_moves)) return false;
    if (!wind.gusts) return true;
    const Gusts& gusts = *wind.gusts;
    // Random gusts that start within a shorter time pass between two moments, or all at one.
    const double starts_over = gusts.start_frame.y() - gusts.start_frame.x();
    return gusts.controls.empty() && (gusts.num_gusts == 0 || starts_over >= moments_apart);
}

} // namespace

JiggleMoments jiggle_moments(const Wind& wind, double frame) {
    constexpr double within = 9.375; // within a step of every length
    JiggleMoments moments;
    moments.stationary = is_stationary(wind);
    const double together = moments.stationary ? 4.0 * moments_apart : 16.0; // frames
    const double first = std::floor(frame / together) * together;
    if (moments.stationary)
        for (int i = 0; i < 4; ++i) moments.frames.push_back(first + i * moments_apart + within);
    else
        moments.frames = {first + within, first + 1.375, first + 5.375, first + 13.375, first + together};
    moments.strands = moments.stationary ? 128 : 200;
    return moments;
}

namespace {

// Errors of steps of jiggle against a step of a quarter of a frame.
class StepErrors {
  public:
    StepErrors(const JigglePilot& pilot, const JiggleMoments& moments)
        : pilot_(pilot), pooled_(moments.stationary) {
        strands_.irregular = pilot.irregular;
        strands_.resize(int(pilot.count), pilot.cvs, false);
        for (const double moment : moments.frames)
            if (WideVector<Wide3f> fine = jiggled(pilot, moment, reference_step, strands_); !fine.empty())
                moments_.push_back({moment, std::move(fine)});
    }
    double of(double step) {
        std::vector<double> distances;
        double most = 0.0;
        for (const Moment& moment : moments_) {
            const WideVector<Wide3f> coarse = jiggled(pilot_, moment.frame, step, strands_);
            add_polygon_errors(coarse, moment.fine, pilot_.count, size_t(pilot_.cvs - 1), 1, distances);
            if (pooled_) continue;
            most = std::max(most, percentile_99(distances));
            distances.clear();
        }
        if (pooled_) most = percentile_99(distances);
        const double ratio = reference_step / step; // the error falls with the square of the step
        return most / (1.0 - ratio * ratio);
    }

  private:
    static constexpr double reference_step = 0.25;
    struct Moment {
        double frame;
        WideVector<Wide3f> fine;
    };
    const JigglePilot& pilot_;
    bool pooled_;
    Strands strands_;
    std::vector<Moment> moments_;
};

} // namespace

Choice jiggle_step_for(const JigglePilot& pilot, const JiggleMoments& moments, bool skin_moves) {
    constexpr double shortest = 1.0 / 64.0;
    constexpr int64_t max_past_samples = 2048;
    const Jiggle& jiggle = *pilot.wind.jiggle;
    const Choice default_choice{default_jiggle_step, true};
    if (skin_moves || pilot.count == 0 || !wind_moves(pilot.wind)) return default_choice;
    Jiggle other = jiggle;
    other.step = default_jiggle_step;
    int64_t past_samples = 0;
    for (const double moment : moments.frames) {
        const JiggleWindow window =
            jiggle_window(other, {&moment, 1}, pilot.frame.fps, 2.0 * pilot.length, pilot.tolerance);
        if (!window.empty()) past_samples = std::max(past_samples, window.most_samples());
    }
    if (past_samples == 0) return default_choice; // all are before jiggle.start_frame
    if (past_samples * 2 > max_past_samples) return {default_jiggle_step, false};
    StepErrors errors(pilot, moments);
    double step = default_jiggle_step, error = errors.of(step);
    const auto enough = [&](double e) { return safety_factor * e <= pilot.tolerance; };
    while (!jiggle.start_frame && step < 2.0 && enough(error)) {
        const double error_of_longer = errors.of(2.0 * step);
        if (!enough(error_of_longer)) break;
        step *= 2.0;
        error = error_of_longer;
    }
    while (!enough(error)) {
        if (step <= shortest || past_samples * 2 > max_past_samples) return {step, false};
        step *= 0.5;
        error *= 0.25; // a step half as long has at most a quarter of the error
        past_samples *= 2;
    }
    return {step, true};
}

} // namespace marram
