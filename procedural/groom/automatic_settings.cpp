// SPDX-License-Identifier: Apache-2.0
#include "procedural/groom/automatic_settings.h"

#include "procedural/groom/groom_warnings.h"
#include "procedural/groom/pilot.h"

#include <fmt/format.h>

namespace marram {
namespace {

// Sets `moved` if the skin moves within the jiggle's window at the default step.
MarramStatus find_skin_motion(GroomInstance& instance, bool& moved) {
    moved = instance.mesh->time_count > 1 ||
            std::any_of(instance.mesh_instances.begin(), instance.mesh_instances.end(),
                        [](const MeshInstance& mesh_instance) { return mesh_instance.moves(); });
    if (moved) return MARRAM_OK;
    Jiggle jiggle = *instance.wind.jiggle;
    jiggle.step = default_jiggle_step;
    PastSkin past;
    const MarramStatus status = read_past(instance.frame, uint32_t(instance.mesh - instance.meshes.data()),
                                          jiggle, longest_strand(instance.groom), past, 0.0,
                                          [&](int64_t samples) { announce_long_work(instance, samples); });
    moved = past.moves();
    if (status != MARRAM_OK) return status;
    return sample_past_transforms(instance.frame, jiggle, past.window, instance.mesh_instances, moved);
}

void warn_tolerance_missed(GroomInstance& instance, const std::string& what) {
    instance.inexact.push_back("the tolerance is not reached with " + what);
}

} // namespace

MarramStatus choose_settings(GroomInstance& instance) {
    Groom& groom = instance.groom;
    Wind& wind = instance.wind;
    const auto& open = instance.automatic;
    const MarramFrame& frame = instance.frame;
    const double instance_scale = max_instance_scale(instance.mesh_instances),
                 length = instance_scale * longest_strand(groom);
    const double tolerance = frame.tolerance > 0.0 ? frame.tolerance : 1e-3 * length;
    const ChosenFor now{frame.frame, frame.times[0], frame.times[frame.time_count - 1], tolerance,
                        frame.stage};
    const auto warn = [&] {
        for (const std::string& text : instance.inexact)
            instance.warn("groom.inexact", text, "set it by hand, or give a larger tolerance");
    };
    if (instance.chosen_for == now) {
        warn();
        return MARRAM_OK;
    }
    instance.inexact.clear();
    wind.noise.left_out = negligible_octaves(wind, length, tolerance);
    const PilotGroom pilot{groom,
                           wind,
                           frame,
                           *instance.mesh,
                           instance.roots,
                           instance.poses(0).bind,
                           instance.guided(0, instance.roots.size()),
                           instance_scale};
    if (open.cvs) {
        const Choice choice = cvs_for(pilot);
        groom.cvs = int(choice.value);
        if (!choice.enough) warn_tolerance_missed(instance, "cvs = " + std::to_string(groom.cvs));
    }
    if (open.rays) {
        bool enough = true;
        const bool many_reference_segments = wind.reference_segments > 2 * groom.cvs;
        wind.shielding->rays = cone_rays(*wind.shielding, length, max_turn_fraction(wind),
                                         many_reference_segments, tolerance, enough);
        if (!enough)
            warn_tolerance_missed(instance, "wind.shielding.rays = " + std::to_string(wind.shielding->rays));
    }
    instance.radius_profile.clear();
    for (int k = 0; k < groom.cvs; ++k)
        instance.radius_profile.push_back(
            float(0.5 * groom.width_profile(double(k) / double(groom.cvs - 1))));
    if (open.step) {
        wind.jiggle->step = default_jiggle_step;
        if (frame.stage == MARRAM_FINAL) {
            bool moved = false;
            if (const MarramStatus status = find_skin_motion(instance, moved); status != MARRAM_OK)
                return status;
            const Choice choice = jiggle_step_for(jiggle_pilot(pilot), moved);
            wind.jiggle->step = choice.value;
            if (!choice.enough)
                warn_tolerance_missed(instance, fmt::format("wind.jiggle.step = {:.6g}", choice.value));
        }
    }
    instance.chosen_for = now;
    warn();
    return MARRAM_OK;
}

} // namespace marram
