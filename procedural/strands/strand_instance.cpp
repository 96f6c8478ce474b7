// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/strand_instance.h"

#include "core/math/clock.h"
#include "core/math/digest.h"
#include "procedural/strands/wind_words.h"
#include "procedural/wind/keyed_wind.h"
#include "procedural/wind/noise_along.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>

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
    forget_past();
}

void StrandInstance::drop_states() {
    jiggle_states.clear();
    guide_states.clear();
    kept_cvs = 0.0;
}

void StrandInstance::forget_past() {
    past = {};
    drop_states();
    step_choice.reset();
    last_frame.reset();
    chain.past_wind.reset();
}

StrandInstance::KeptState::~KeptState() {
    if (!state_) return;
    const std::lock_guard lock(owner_->states_mutex_);
    state_->in_use = false;
}

// With states_mutex_ held.
StrandInstance::KeptState StrandInstance::if_it_fits(JiggleState& state, const Strands& strands) {
    constexpr double bytes_of_cv =
        2.0 * sizeof(Wide3d) / lanes + 4.0 * sizeof(Wide3f) / lanes + sizeof(float);
    if (state.in_use) return {};
    if (!state.kept) {
        const double cvs = double(strands.blocks) * lanes * strands.cvs;
        if (kept_cvs + cvs > wind.jiggle->memory * 1e6 / bytes_of_cv) return {};
        kept_cvs += cvs;
        state.kept = true;
    }
    state.in_use = true;
    return {*this, state};
}

StrandInstance::KeptState StrandInstance::kept_state(uint32_t patch, size_t batch, const Strands& strands) {
    if (jiggle_states.empty()) return {};
    const std::lock_guard lock(states_mutex_);
    std::deque<JiggleState>& batches = jiggle_states[patch];
    while (batches.size() <= batch) batches.emplace_back();
    return if_it_fits(batches[batch], strands);
}

StrandInstance::KeptState StrandInstance::guide_state(size_t batch, const Strands& strands) {
    if (jiggle_states.empty()) return {};
    const std::lock_guard lock(states_mutex_);
    while (guide_states.size() <= batch) guide_states.emplace_back();
    return if_it_fits(guide_states[batch], strands);
}

PastSettings StrandInstance::settings_of_past() const {
    const Blade* const bent = blade();
    return {wind.jiggle->step,
            frame.fps,
            frame.bind_frame,
            min_cvs(),
            wind.noise.left_out,
            bent ? bent->pieces : 0,
            bent ? bent->tolerance : 0.0};
}

// States are kept from the second frame on: a frame that stays alone needs none.
void StrandInstance::prepare_states() {
    const bool another = last_frame && *last_frame != frame.frame;
    last_frame = frame.frame;
    if (another || !jiggle_states.empty()) jiggle_states.resize(output().patch_count);
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
    for (MeshInstance& mesh_instance : mesh_instances)
        mesh_instance.past_transforms.clear(); // longest() reads them
    const double length = longest() + (curves_move() ? 0.5 * travel_of_curves() : 0.0);
    if (mesh)
        return read_past(frame, mesh_index(), jiggle, length, measure_travel(frame, mesh_instances),
                         past_settings == settings_of_past() ? past : PastSkin{},
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

// The step of jiggle, by what is the same in neighbouring frames where possible: it is then not chosen
// again, and what they keep stays valid. The tolerance is rounded down by up to 9 %.
Choice StrandInstance::choose_step(double tolerance) {
    const double length = longest(); // before past transforms are known
    const bool moved = moves_in_window();
    const double rounded = std::exp2(0.125 * std::floor(8.0 * std::log2(tolerance)));
    const JiggleMoments moments = jiggle_moments(wind, frame.times[0]);
    const StepChoice::For now{moments.frames.front(), rounded, length, frame.fps, frame.bind_frame, min_cvs(),
                              wind.noise.left_out,    moved};
    if (!step_choice || step_choice->made_for != now) {
        step_choice.reset();
        step_choice = StepChoice{now, jiggle_step_for(pilot(rounded, moments.strands), moments, moved)};
    }
    return step_choice->choice;
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
                const Choice choice = choose_step(tolerance);
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

// The ground that the wind blows over, as it is in this frame: the past is that over the same ground.
void StrandInstance::find_ground() {
    std::shared_ptr<GroundAir> found;
    if (wind.over && frame.stage != MARRAM_REST) {
        const auto mesh_of = [&](const MarramMesh& m) {
            return m.instance_of == 0 && wind.over->mesh == m.name;
        };
        const auto named = std::ranges::find_if(meshes, mesh_of);
        if (named == meshes.end())
            throw SceneFault("wind.no_ground", wind.over->place,
                             "there is no mesh '" + wind.over->mesh + "' for the wind to blow over",
                             "name one of the scene's");
        found = GroundAir::over(*named);
        if (found->ground().heights.empty())
            throw SceneFault("wind.no_ground", wind.over->place,
                             "the mesh '" + wind.over->mesh +
                                 "' has no area seen from above, or is not finite",
                             "name a mesh that lies below the wind");
    }
    if (found != ground) forget_past();
    ground = std::move(found);
}

// The curves that the wind follows, as they are in this frame: the past is that along the same curves.
void StrandInstance::find_guides() {
    if (frame.stage != MARRAM_REST && lend_guides(frame, wind.fields)) forget_past();
}

MarramOutput StrandInstance::begin(LentFrame lent) {
    frame = lent.frame;
    meshes = std::move(lent.meshes);
    if ((wind.collision || wind.shielding) && frame.mesh_count > 0 && !frame.colliders)
        throw SceneFault("contract.no_colliders", "", "MarramFrame.colliders is NULL",
                         "pass the committed scene of the frame's meshes");
    workers.clear();
    lay_out();
    const double finding = wall_seconds();
    find_ground();
    find_guides();
    begin_seconds.prepare += wall_seconds() - finding;
    set_gust_plane_once(host, frame, bounds_without_meshes(), wind, gust_start);
    const double choosing = wall_seconds();
    choose_settings();
    begin_seconds.choose += wall_seconds() - choosing;
    const bool blown = frame.stage != MARRAM_REST;
    bool moving = moves() || (blown && (wind_moves(wind) || moving_meshes_matter(wind, frame)));
    if (!wind.jiggle || frame.stage != MARRAM_FINAL) {
        forget_past();
    } else {
        Digest instances;
        instances.add(made_digest());
        for (const MeshInstance& m : mesh_instances)
            instances.add(m.mesh ? m.mesh->name : "").add(m.transform_at_bind.data(), 16 * sizeof(double));
        if (instances.value() != instances_digest) drop_states();
        instances_digest = instances.value();
        PastSkin read = read_jiggle_past();
        const bool instances_moved = sample_past_transforms(frame, *wind.jiggle, read.window, mesh_instances);
        // Without motion there is no jiggle.
        if (read.moves() || instances_moved || curves_move() || wind_moves(wind))
            moving = true;
        else
            read = {};
        if (past_settings != settings_of_past()) chain.past_wind.reset();
        if (!read.window.same_runs(past.window) || past_settings != settings_of_past()) drop_states();
        past = std::move(read);
        past_settings = settings_of_past();
        prepare_states();
    }
    time_count = moving ? frame.time_count : 1;
    frame.time_count = time_count;
    const double before = wall_seconds();
    const std::shared_ptr<PastWind> past_wind = chain.past_wind;
    chain = {}; // release the last frame's trees before building new ones
    chain = make_chain(past_wind.get());
    warn_of_gusts(host, place(), chain);
    gust_bounds = wind.gusts || !wind.fields.empty() ? bounds() : Eigen::AlignedBox3d();
    const bool skin_moves = moves() || curves_move() || (mesh && mesh->moves != 0) ||
                            std::ranges::any_of(mesh_instances, [](const MeshInstance& m) {
                                return m.mesh && m.mesh->moves != 0;
                            });
    if (!gusts_checked && !skin_moves) warn_of_untouching_gusts(host, wind, frame, gust_bounds);
    gusts_checked = true;
    announce_long_work(past.window.empty() ? 0 : past.window.most_samples());
    finish_frame();
    begin_seconds.prepare += wall_seconds() - before;
    return output();
}

std::string StrandInstance::summary() const { return wind_summary(wind, frame, gust_bounds); }

std::vector<GustSphere> StrandInstance::random_gusts() const {
    if (!wind.gusts) return {};
    const Wind now = wind.keys ? wind_at(wind, frame.frame) : wind;
    return random_gusts_at(*now.gusts, gust_carrier(wind), frame.frame, frame.fps);
}

namespace {

// Strands of two CVs that lie in one point each.
Strands strands_at(std::span<const double> points) {
    Strands strands;
    const size_t count = points.size() / 3;
    strands.resize(int(count), 2, false);
    for (size_t i = 0; i < size_t(strands.blocks) * lanes; ++i) {
        const double* const p = points.data() + 3 * std::min(i, count - 1); // also in lanes without a strand
        const size_t block = i / lanes;
        const auto lane = int(i % lanes);
        for (size_t k = 0; k < 2; ++k) set_lane(strands.rest[2 * block + k], lane, {p[0], p[1], p[2]});
        Wide3d& origin = strands.noise_origin[block];
        origin.x[lane] = p[0], origin.y[lane] = p[1], origin.z[lane] = p[2];
    }
    return strands;
}

} // namespace

std::vector<AirSample> StrandInstance::air_at(std::span<const double> points) const {
    if (points.empty()) return {};
    const WindAt at = wind_with_gusts(wind, frame.frame, frame.fps, true, everywhere(), ground.get());
    const Wind& now = *at.wind;
    Strands strands = strands_at(points);
    std::ranges::fill(strands.gust, VFloat{});
    if (!at.gusts.levels.empty()) add_gusts(at.gusts, strands);
    local_wind({now.direction, now.speed, now.response, at.fields, at.ground,
                now.over ? now.over->speed : SpeedHeight{}},
               strands);
    const NoiseTimes times = noise_times(now, frame.frame, frame.fps);
    const VDouble root{};
    std::vector<AirSample> samples;
    for (size_t i = 0; i < points.size() / 3; ++i) {
        const size_t block = i / lanes;
        const auto lane = int(i % lanes);
        if (lane == 0 && now.noise_amplitude > 0.0)
            noise_along(now, times, strands.noise_origin[block], &root, 1, strands);
        const Wide3d& d = strands.wind_direction[block];
        const Wide3f& n = strands.values[0];
        samples.push_back(
            {Vec3d(d.x[lane], d.y[lane], d.z[lane]) * double(strands.wind_speed[block][lane]),
             now.noise_amplitude > 0.0
                 ? Vec3d(Vec3f(n.x[lane], n.y[lane], n.z[lane]).cast<double>() * now.noise_amplitude)
                 : Vec3d::Zero(),
             std::clamp(now.calm + double(strands.gust[2 * block][lane]), 0.0, 1.0)});
    }
    return samples;
}

std::vector<ShelterRay> StrandInstance::shelter_rays(std::span<const double> cvs,
                                                     const double* root_normal) const {
    const ChainFrame::Instant& instant = chain.instants.front();
    const Wind& now = *instant.wind.wind;
    if (!now.shielding || cvs.empty()) return {};
    Strands strand;
    strand.resize(1, int(cvs.size() / 3), false);
    for (size_t k = 0; k < size_t(strand.cvs); ++k)
        set_lane(strand.rest[k], 0, {cvs[3 * k], cvs[3 * k + 1], cvs[3 * k + 2]});
    strand.root_normal[0] = splat3(root_normal);
    return marram::shelter_rays(*now.shielding, now.direction, instant.colliders, instant.obstacle_heights,
                                strand);
}

void StrandInstance::report(const ReportSink& sink) {
    size_t scratch = 0;
    uint64_t unsolved = 0;
    const CollisionCounts counts = report_chain(workers, sink, scratch, unsolved);
    warn_of_unsolved_blades(host, place(), unsolved);
    warn_of_collisions(host, place(), skin_name(), time_count > 1, counts);
    if (automatic.rays) sink("chosen.shield_rays", wind.shielding->rays);
    if (automatic.step && !past.window.empty()) sink("chosen.jiggle_step", wind.jiggle->step);
    if (wind.noise.left_out > 0) sink("chosen.octaves", wind.noise.octaves - wind.noise.left_out);
    sink("seconds.choose_settings", begin_seconds.choose);
    sink("seconds.prepare_wind", begin_seconds.prepare);
    report_own(sink);
    begin_seconds = {};
    const Bytes held = bytes();
    size_t maps = 0; // of fields
    for (const PlacedField& field : wind.fields) maps += field_bytes(field);
    const size_t shared = held.shared + past.bytes() + (ground ? ground->bytes() : 0) + maps;
    size_t states = 0;
    for (const auto& batches : jiggle_states)
        for (const JiggleState& state : batches) states += state.bytes();
    for (const JiggleState& state : guide_states) states += state.bytes();
    const size_t lasting = shared + held.own + trees.bytes() + chain.gust_bytes() + states + scratch;
    sink("memory.curve_extra_bytes", double(std::max(lasting, held.peak_of_placing)));
    if (mesh_instances.size() < 2) return;
    sink("instances.count", double(mesh_instances.size() - 1));
    sink("instances.shared_bytes", double(shared));
}

} // namespace marram
