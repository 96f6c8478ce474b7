// SPDX-License-Identifier: Apache-2.0
#include "core/cli/stats.h"

#include "core/image/atomic_file.h"

#include <nlohmann/json.hpp>

#include <chrono>

#include <sys/resource.h>

namespace marram {
namespace {

nlohmann::ordered_json to_json(const FrameStats& stats) {
    const BuildStats& build = stats.build;
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    nlohmann::ordered_json json;
    json["frame"] = stats.frame;
    json["threads"] = stats.threads;
    json["curves"] = build.curves;
    json["cvs"] = build.cvs;
    json["segments"] = build.segments;
    json["triangles"] = build.triangles;
    json["seconds"] = {{"load", stats.load},           {"terrain", 0.0},
                       {"colliders", build.colliders}, {"expand", build.expand},
                       {"gusts", build.gusts},         {"shield", build.shield},
                       {"bend", build.bend},           {"jiggle", build.jiggle},
                       {"collide", build.collide},     {"curves_bvh", build.curves_bvh},
                       {"trace", stats.trace},         {"total", stats.total}};
    json["collision"] = {{"contacts", build.contacts},
                         {"pushed_out", build.pushed_out},
                         {"unresolved", build.unresolved},
                         {"skipped_pushes", build.skipped_pushes},
                         {"dips", build.dips},
                         {"reached", build.collision_reached}};
    json["motion"] = {{"keys", build.motion_keys}, // error: metres, foreseen where the keys were chosen
                      {"error", build.motion_error},
                      {"mesh_error", build.mesh_motion_error},
                      {"jumps", build.motion_jumps},
                      {"camera_poses", stats.camera_poses}};
    json["chosen"] = build.chosen;                                      // by the tolerance
    json["memory"] = {{"peak_bytes", uint64_t(usage.ru_maxrss) * 1024}, // of the process so far
                      {"curve_bytes", build.curve_bytes},
                      {"curve_extra_bytes", build.curve_extra_bytes}};
    json["rays"] = stats.render.rays.intersect + stats.render.rays.occluded;
    json["dropped_rays"] = stats.render.rays.dropped;
    json["samples"] = {{"most", stats.render.most_samples}, {"mean", stats.render.mean_samples}}; // a pixel
    json["dropped_samples"] = stats.render.dropped_samples;
    json["clamped"] = stats.render.clamped;
    return json;
}

} // namespace

void write_stats(const std::string& path, const std::vector<FrameStats>& frames) {
    nlohmann::ordered_json json;
    if (frames.size() == 1) {
        json = to_json(frames.front());
    } else {
        json = nlohmann::ordered_json::array();
        for (const FrameStats& frame : frames) json.push_back(to_json(frame));
    }
    AtomicWriter writer(path);
    writer.write(json.dump(2));
    writer.write("\n");
    writer.commit();
}

double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

} // namespace marram
