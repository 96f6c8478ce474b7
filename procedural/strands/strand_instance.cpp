// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/strand_instance.h"

#include "core/math/clock.h"
#include "procedural/strands/wind_words.h"

#include <fmt/format.h>

namespace marram {

void StrandInstance::take_wind(Wind given) {
    wind = std::move(given);
    automatic.rays = wind.shielding && wind.shielding->spread > 0.0 && wind.shielding->rays == 0;
    automatic.step = wind.jiggle && wind.jiggle->step == 0.0;
    chosen_for.reset();
    announced.reset();
    gust_start = {};
    gusts_checked = false;
    begun = false;
}

void StrandInstance::announce_long_work(int64_t past_samples) {
    LongWork amount = work();
    amount.samples = frame.time_count;
    amount.past_samples = past_samples;
    amount.collides = wind.collision && frame.stage == MARRAM_FINAL;
    marram::announce_long_work(host, fmt::format("{}.long_work", type()).c_str(), place(), amount,
                               frame.frame, announced);
}

// The skin's poses over the window of the jiggle, or only that window.
PastSkin StrandInstance::read_jiggle_past() {
    const Jiggle& jiggle = *wind.jiggle;
    const double length = longest() + (curves_move() ? 0.5 * travel_of_curves() : 0.0);
    if (mesh)
        return read_past(frame, mesh_index(), jiggle, length, measure_travel(frame, mesh_instances),
                         [&](int64_t samples) { announce_long_work(samples); });
    PastSkin only_window;
    only_window.window = jiggle_window(jiggle, std::span(frame.times, frame.time_count), frame.fps,
                                       2.0 * length, frame.tolerance);
    return only_window;
}

// True if rest strands move within the jiggle's window.
bool StrandInstance::moves_in_window() {
    if (moves() || curves_move()) return true;
    const PastSkin window = read_jiggle_past();
    return sample_past_transforms(frame, *wind.jiggle, window.window, mesh_instances) || window.moves();
}

// Chooses the automatic settings from the description and this frame only. If a renderer begins a frame again
// with other motion samples between the same ends, the earlier choice is kept. Warns if the tolerance cannot
// be reached.
void StrandInstance::choose_settings() {
    const double length = longest(), tolerance = frame.tolerance > 0.0 ? frame.tolerance : 1e-3 * length;
    const ChosenFor now{frame.frame, frame.times[0], frame.times[frame.time_count - 1], tolerance,
                        frame.stage};
    if (chosen_for != now) {
        chosen_for.reset(); // if choosing is cancelled, nothing is chosen
        inexact.clear();
        wind.noise.left_out = negligible_octaves(wind, length, tolerance);
        choose_cvs();
        if (automatic.rays) {
            bool enough = true;
            const bool many_reference_segments = wind.reference_segments > 2 * min_cvs();
            wind.shielding->rays = cone_rays(*wind.shielding, length, max_turn_fraction(wind),
                                             many_reference_segments, tolerance, enough);
            if (!enough) inexact.push_back(fmt::format("wind.shielding.rays = {}", wind.shielding->rays));
        }
        if (automatic.step) {
            wind.jiggle->step = default_jiggle_step;
            if (frame.stage == MARRAM_FINAL) {
                const bool moved = moves_in_window();
                const Choice choice = jiggle_step_for(pilot(tolerance), moved);
                wind.jiggle->step = choice.value;
                if (!choice.enough) inexact.push_back(fmt::format("wind.jiggle.step = {:.6g}", choice.value));
            }
        }
        chosen_for = now;
    }
    for (const std::string& setting : inexact)
        warn(fmt::format("{}.inexact", type()), "the tolerance is not reached with " + setting,
             "set it by hand, or give a larger tolerance");
}

MarramOutput StrandInstance::begin(LentFrame lent) {
    frame = lent.frame;
    meshes = std::move(lent.meshes);
    if ((wind.collision || wind.shielding) && frame.mesh_count > 0 && !frame.colliders)
        throw SceneFault("contract.no_colliders", "", "MarramFrame.colliders is NULL",
                         "pass the committed scene of the frame's meshes");
    workers.clear();
    lay_out();
    set_gust_plane_once(host, frame, bounds_without_meshes(), wind, gust_start);
    const double choosing = wall_seconds();
    choose_settings();
    choosing_seconds = wall_seconds() - choosing;
    const bool blown = frame.stage != MARRAM_REST;
    bool moving = moves() || (blown && (wind_moves(wind) || moving_meshes_matter(wind, frame)));
    past = {};
    if (wind.jiggle && frame.stage == MARRAM_FINAL) {
        past = read_jiggle_past();
        const bool instances_moved = sample_past_transforms(frame, *wind.jiggle, past.window, mesh_instances);
        // Without motion there is no jiggle.
        if (past.moves() || instances_moved || curves_move() || wind_moves(wind))
            moving = true;
        else
            past = {};
    }
    time_count = moving ? frame.time_count : 1;
    frame.time_count = time_count;
    const double before = wall_seconds();
    chain = {}; // release the last frame's trees before building new ones
    chain = make_chain();
    warn_of_gusts(host, place(), chain);
    gust_bounds = wind.gusts ? bounds() : Eigen::AlignedBox3d();
    const bool skin_moves = moves() || curves_move() || (mesh && mesh->moves != 0) ||
                            std::ranges::any_of(mesh_instances, [](const MeshInstance& m) {
                                return m.mesh && m.mesh->moves != 0;
                            });
    if (!gusts_checked && !skin_moves) warn_of_untouching_gusts(host, wind, frame, gust_bounds);
    gusts_checked = true;
    announce_long_work(past.window.count());
    finish_frame();
    prepare_seconds = wall_seconds() - before;
    return output();
}

std::string StrandInstance::summary() const { return wind_summary(wind, frame, gust_bounds); }

void StrandInstance::report(const ReportSink& sink) {
    size_t scratch = 0;
    const CollisionCounts counts = report_chain(workers, sink, scratch);
    warn_of_collisions(host, place(), skin_name(), time_count > 1, counts);
    if (automatic.rays) sink("chosen.shield_rays", wind.shielding->rays);
    if (automatic.step && past.window.count() > 0) sink("chosen.jiggle_step", wind.jiggle->step);
    if (wind.noise.left_out > 0) sink("chosen.octaves", wind.noise.octaves - wind.noise.left_out);
    sink("seconds.prepare_wind", prepare_seconds);
    report_own(sink);
    const Bytes held = bytes();
    const size_t shared = held.shared + past.bytes();
    const size_t lasting = shared + held.own + trees.bytes() + chain.gust_bytes() + scratch;
    sink("memory.curve_extra_bytes", double(std::max(lasting, held.peak_of_placing)));
    if (mesh_instances.size() < 2) return;
    sink("instances.count", double(mesh_instances.size() - 1));
    sink("instances.shared_bytes", double(shared));
}

} // namespace marram
