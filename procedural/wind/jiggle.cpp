// SPDX-License-Identifier: Apache-2.0
// Length of the window. x(t) is the integral of omega S(omega sigma) g(t - sigma) over sigma > 0 (S and C: see
// jiggle_step.cpp). Taking the target as constant before a run's first sample, T before its epoch, changes g by at
// most `reach` there, and x by at most reach * tail(omega T), where
//
//     tail(X) = integral of |S| from X to infinity
//             = C(X)                                                                       zeta >= 1, exactly: S > 0
//             <= e^(-zeta X) min(1 / (zeta p), (1 + zeta X) / zeta^2), p = sqrt(1 - zeta^2)         zeta < 1
//
// from |sin| <= 1 and from |sin x| <= x. The second bound stays finite at zeta
// = 1, where it equals the exact (1 + X) e^-X. The bound decreases with omega: the CV with the lowest
// stiffness decides.
//
// Longer steps. An error of the target at age T reaches the pose as tail'(omega T). A cubic between samples
// h apart is off by a power of h between 2 (at a kink) and 4 (smooth motion), so where the tail has fallen
// to e^-2 = 0.14, e^-4, ... of its start, steps of 2, 4, ... samples add about as much error as those after
// them: half the samples for the same error. Doubling at each factor of e would more than double the error.
//
// Period. A frame alone pays for the window and for half a period on average; a sequence for its own samples
// and for a window once a period. The period is the power of two between half and all of the window's samples.
#include "procedural/wind/jiggle.h"

#include "procedural/abi/param.h"
#include "procedural/wind/jiggle_step.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>

namespace marram {
namespace {

constexpr double initial_damping = 0.3;
constexpr double default_window_tolerance = 1e-6; // of the reach, if no tolerance is given
constexpr double max_past_samples =
    1e5; // each costs a bend of every strand: with more, a frame would take hours

constexpr int max_level = 3;           // steps of eight samples
constexpr double decay_of_level = 2.0; // e^-2: see above
constexpr int64_t shortest_period = 4;
constexpr int64_t cubic_reach = 2; // samples after the one before a time that its cubic needs

constexpr std::array jiggle_values = {
    param::keyable(
        param::number("jiggle.frequency", "Hz", "none", 0, 1e9,
                      "natural frequency of the spring where stiffness is 1; 0 or absent: no jiggle")),
    param::keyable(param::number(
        "jiggle.damping", "", "none", 0, 1e3,
        "damping ratio: below 1 strands overshoot, at 0 they never come to rest; default: 0.3")),
    param::ramp("jiggle.stiffness", "", "none", 0, 1e9,
                "scale of the frequency from root (0) to tip (1); default: [[0, 4], [1, 1]]"),
    param::number("jiggle.step", "frames", "none", 1e-3, 1e3,
                  "time between samples of the past; default: as long as the tolerance allows",
                  "0.125|0.25|0.5|1|2", "seconds.jiggle"),
    param::number("jiggle.start_frame", "frames", "none", -1e7, 1e7,
                  "strands stay in their bent pose until this frame; required if damping is 0"),
    param::number(
        "jiggle.memory", "MB", "none", 0, 1e6,
        "of states kept for the next frame, 100 bytes a CV: it alters no picture, only the time of frames "
        "after the first; default: 1024"),
};

[[noreturn]] void refuse(const Values& values, const char* name, const std::string& what,
                         const std::string& remedy) {
    throw SceneFault("jiggle.setting", values.at(name).place, what, remedy);
}

void refuse_without_frequency(const Values& values) {
    for (const MarramParam& param : jiggle_values) {
        const std::string name = std::string("wind.") + param.name;
        if (values.has(name))
            refuse(values, name.c_str(), std::string(param.name) + " has no effect without jiggle.frequency",
                   "add it in Hz, such as jiggle.frequency = 2");
    }
}

double min_stiffness(const Ramp& stiffness) { // minimum over the strand
    double least = std::min(stiffness(0.0), stiffness(1.0));
    for (size_t i = 0; i < stiffness.positions().size(); ++i)
        if (stiffness.positions()[i] > 0.0 && stiffness.positions()[i] < 1.0)
            least = std::min(least, stiffness.values()[i]);
    return least;
}

// The smallest angle whose tail is below `share`, to 0.1 %, rounded up.
double window_radians(double damping, double share) {
    if (!(jiggle_tail(damping, 0.0) > share)) return 0.0;
    double low = 0.0, high = 1.0;
    while (jiggle_tail(damping, high) > share && high < 1e300) {
        low = high;
        high *= 2.0;
    }
    while (high - low > 1e-3 * high) {
        const double middle = 0.5 * (low + high);
        (jiggle_tail(damping, middle) > share ? low : high) = middle;
    }
    return high;
}

} // namespace

std::span<const MarramParam> jiggle_params() { return jiggle_values; }

std::optional<Jiggle> read_jiggle(const Values& values, std::optional<double> swing) {
    const bool given = values.has("wind.jiggle.frequency");
    std::string any_of_it;
    for (const MarramParam& param : jiggle_values)
        if (const std::string name = std::string("wind.") + param.name; values.has(name)) any_of_it = name;
    if (given) any_of_it = "wind.jiggle.frequency";
    const bool swings = swing && !any_of_it.empty();
    if (!given && !swings) {
        refuse_without_frequency(values);
        return std::nullopt;
    }
    if (given && values.number("wind.jiggle.frequency") == 0.0) { // a groom may switch it off
        if (values.keyframes("wind.jiggle.frequency"))
            refuse(values, "wind.jiggle.frequency",
                   "jiggle.frequency is 0 at a key: strands would come loose",
                   "keep it above 0, or fade the wind instead");
        return std::nullopt;
    }
    Jiggle jiggle;
    jiggle.place = values.at(any_of_it).place;
    jiggle.frequency = given ? values.number("wind.jiggle.frequency") : *swing;
    const auto number_or = [&](const char* name, double initial) {
        return values.has(name) ? values.number(name) : initial;
    };
    jiggle.damping = number_or("wind.jiggle.damping", initial_damping);
    jiggle.step = number_or("wind.jiggle.step", 0.0);
    jiggle.memory = number_or("wind.jiggle.memory", jiggle.memory);
    constexpr std::array initial_stiffness = {0.0, 4.0, 1.0, 1.0};
    jiggle.stiffness = values.has("wind.jiggle.stiffness") ? values.ramp("wind.jiggle.stiffness")
                                                           : Ramp(initial_stiffness, "linear");
    for (const double value : jiggle.stiffness.values())
        if (!(value > 0.0))
            refuse(values, "wind.jiggle.stiffness", "jiggle.stiffness is not above 0 everywhere",
                   "it scales the frequency, keep it positive");
    if (values.has("wind.jiggle.start_frame")) jiggle.start_frame = values.number("wind.jiggle.start_frame");
    if (jiggle.damping == 0.0 && !jiggle.start_frame)
        refuse(values, "wind.jiggle.damping",
               "jiggle.damping = 0 needs a start: the oscillation never decays",
               "give jiggle.start_frame, or some damping");
    return jiggle;
}

int64_t Jiggle::sample_before(double frame) const {
    auto sample = int64_t(std::floor(frame / step));
    if (frame_of(sample) > frame) --sample; // if the division was rounded across a sample
    if (frame_of(sample + 1) <= frame) ++sample;
    return sample;
}

int64_t JiggleWindow::most_samples() const {
    if (start && (length >= endless || first == *start)) return count(); // single steps from the start on
    const int64_t knots = std::accumulate(steps.begin(), steps.end(), period) + int64_t(steps.size());
    return std::min(knots + cubic_reach + 1, count());
}

JiggleRun JiggleWindow::run_at(int64_t sample, uint32_t phase) const {
    if (length < endless) {
        const int64_t shifted = sample - int64_t(phase) % period;
        const int64_t epoch = sample - (shifted % period + period) % period;
        if (!start || epoch - length > *start) return {epoch - length, epoch};
    }
    return {*start, *start};
}

int JiggleWindow::level_at(const JiggleRun& run, int64_t sample) const {
    if (sample >= run.epoch) return 0;
    int level = 0;
    for (int64_t reached = steps[0]; run.epoch - sample > reached; reached += steps[size_t(level)] << level)
        ++level;
    return level;
}

namespace {

// The steps before an epoch, for a memory in samples and the age at which each level begins.
void lay_out_steps(const std::vector<double>& ages, double memory, JiggleWindow& window) {
    double covered = 0.0;
    for (size_t level = 0; level < ages.size() && (level == 0 || covered < memory); ++level) {
        const bool last = level + 1 == ages.size() || !(ages[level + 1] < memory);
        const double size = std::ldexp(1.0, int(level));
        const double left = std::max(0.0, (last ? memory : ages[level + 1]) - covered) / size;
        // An even number, not 0, but for the last: the cubic of a longer step reaches into the next by its
        // own size, and from the last of them not beyond what a time after the epoch needs.
        const double count = last ? std::ceil(left) : std::max(2.0, 2.0 * std::ceil(0.5 * left));
        window.steps.push_back(int64_t(count));
        covered += count * size;
    }
    window.length = int64_t(covered);
}

} // namespace

JiggleWindow jiggle_window(const Jiggle& jiggle, std::span<const double> times, double fps, double reach,
                           double tolerance) {
    const double asked = tolerance > 0.0 ? tolerance / reach : default_window_tolerance;
    const double share = std::exp2(2.0 * std::floor(0.5 * std::log2(asked)));
    const double omega = 2.0 * pi * jiggle.frequency * min_stiffness(jiggle.stiffness);
    const auto samples_of = [&](double radians) { return radians / omega * fps / jiggle.step; };
    const double memory = reach > 0.0 ? samples_of(window_radians(jiggle.damping, share)) : 0.0;

    JiggleWindow window;
    if (jiggle.start_frame) window.start = jiggle.sample_before(*jiggle.start_frame);
    const int64_t now = jiggle.sample_before(times.front());
    window.last = jiggle.sample_before(times.back()) + cubic_reach;
    if (window.start && window.last - cubic_reach < *window.start) return {};
    if (memory < max_past_samples * double(1 << max_level)) {
        std::vector<double> ages;
        for (int level = 0; level <= max_level; ++level)
            ages.push_back(level == 0 ? 0.0
                                      : samples_of(window_radians(jiggle.damping,
                                                                  jiggle_tail(jiggle.damping, 0.0) *
                                                                      std::exp(-decay_of_level * level))));
        lay_out_steps(ages, memory, window);
        const int64_t knots = std::accumulate(window.steps.begin(), window.steps.end(), int64_t{0});
        window.period =
            std::max(shortest_period, int64_t(std::bit_ceil(uint64_t(std::max<int64_t>(knots / 2, 1)))));
        window.first = now - (window.period - 1) - window.length;
    } else {
        window.length = JiggleWindow::endless;
        if (!window.start) check_past_samples(jiggle, memory);
    }
    if (window.start && (window.length == JiggleWindow::endless || window.first < *window.start))
        window.first = *window.start;
    check_past_samples(jiggle, double(window.most_samples()));
    return window;
}

void check_past_samples(const Jiggle& jiggle, double samples) {
    if (samples < max_past_samples) return;
    throw SceneFault("jiggle.too_long", jiggle.place,
                     "jiggle needs more than " + std::to_string(int(max_past_samples)) +
                         " samples of past frames",
                     "give more jiggle.damping, a higher frequency, a longer "
                     "jiggle.step, or a later jiggle.start_frame");
}

} // namespace marram
