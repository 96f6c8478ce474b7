// SPDX-License-Identifier: Apache-2.0
#include "core/shot/stats.h"

#include "core/math/frame_name.h"

#include "core/image/atomic_file.h"
#include "core/math/clock.h"

#include <nlohmann/json.hpp>

#include <sys/resource.h>

namespace marram {
namespace {

// Adds the report entries of procedurals, whose paths core does not know: "collision.contacts" becomes
// "contacts" in the object "collision". If core has an entry of the same path, the two are summed.
void add_report(const Report& report, nlohmann::ordered_json& json) {
    for (const auto& [path, entry] : report.entries()) {
        nlohmann::ordered_json* at = &json;
        size_t begin = 0;
        for (size_t dot = path.find('.'); dot != std::string::npos;
             begin = dot + 1, dot = path.find('.', begin))
            at = &(*at)[path.substr(begin, dot - begin)];
        if (entry.declared.path && entry.declared.combine == MARRAM_EACH) continue; // BuildStats::chosen
        const double value =
            report(path) + (at->contains(path.substr(begin)) ? double((*at)[path.substr(begin)]) : 0.0);
        const std::string_view unit = entry.declared.path && entry.declared.unit ? entry.declared.unit : "";
        if (unit == "count" || unit == "bytes")
            (*at)[path.substr(begin)] = uint64_t(value);
        else
            (*at)[path.substr(begin)] = value;
    }
}

// The units of what procedurals report, by path, except counts, bytes and the seconds of stages.
nlohmann::ordered_json units_of(const Report& report) {
    nlohmann::ordered_json units = nlohmann::ordered_json::object();
    for (const auto& [path, entry] : report.entries()) {
        if (!entry.declared.path || entry.declared.combine == MARRAM_EACH) continue;
        const std::string_view unit = entry.declared.unit ? entry.declared.unit : "";
        if (!unit.empty() && unit != "count" && unit != "bytes") units[path] = unit;
    }
    return units;
}

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
    json["seconds"] = {{"load", stats.load},
                       {"procedural_meshes", build.procedural_meshes},
                       {"colliders", build.colliders},
                       {"choose_keys", build.choose_keys},
                       {"bvh", build.bvh},
                       {"trace", stats.trace},
                       {"total", stats.total}};
    json["motion"] = {{"keys", build.motion_keys}, // error: metres, predicted when the keys were chosen
                      {"error", build.motion_error},
                      {"mesh_error", build.mesh_motion_error},
                      {"jumps", build.motion_jumps},
                      {"camera_poses", stats.camera_poses}};
    json["chosen"] = build.chosen; // settings chosen by the tolerance
    json["memory"] = {{"budget_bytes", stats.memory_budget},
                      {"peak_bytes", uint64_t(usage.ru_maxrss) * 1024}, // of the process so far
                      {"curve_bytes", build.curve_bytes},
                      {"curve_extra_bytes", build.attribute_bytes},
                      {"embree_bytes", build.embree_bytes}, // BVHs and vertices, after the build
                      {"embree_peak_bytes", build.embree_peak_bytes},
                      {"volume_bytes", build.volume_bytes}};
    if (build.patches > 0) // of lazy curves
        json["lazy"] = {{"patches", build.patches},
                        {"built", build.built_patches},
                        {"evicted", build.evicted_patches},
                        {"rebuilt", build.rebuilt_patches},
                        {"thread_seconds", build.lazy_thread_seconds},
                        {"merging", build.lazy_merging}};
    json["rays"] = stats.render.rays.intersect + stats.render.rays.occluded;
    json["dropped_rays"] = stats.render.rays.invalid;
    json["samples"] = {{"most", stats.render.max_samples}, {"mean", stats.render.mean_samples}}; // per pixel
    json["dropped_samples"] = stats.render.nonfinite_samples;
    json["clamped"] = stats.render.clamped_fraction;
    json["cut_throughput"] = stats.render.cut_throughput; // mean, of paths cut by max_depth
    add_report(build.report, json);
    json["units"] = units_of(build.report);
    return json;
}

} // namespace

StatsFile::StatsFile(std::string path) : path_(std::move(path)) {}

void StatsFile::write(const std::string& path, const std::vector<std::string>& frames) {
    AtomicFile file(path);
    if (frames.size() != 1) file.write("[\n");
    for (size_t i = 0; i < frames.size(); ++i) {
        if (i > 0) file.write(",\n");
        file.write(frames[i]);
    }
    file.write(frames.size() != 1 ? "\n]\n" : "\n");
    file.commit();
}

void StatsFile::add(const FrameStats& frame) {
    if (path_.empty()) return;
    try {
        write_or_keep(frame);
    } catch (const InputError& error) { // the other frames are worth more
        if (!fault_) fault_ = error;
    }
}

void StatsFile::write_or_keep(const FrameStats& frame) {
    std::string text = to_json(frame).dump(2);
    const std::string own = numbered(path_, frame.frame);
    if (own != path_) return write(own, {std::move(text)});
    frames_.push_back(std::move(text));
    constexpr double rest = 20.0; // pause between writes, in units of the last write's time
    const double begin = wall_seconds();
    if (begin - written_ < rest * cost_) return;
    write(path_, frames_);
    written_ = wall_seconds();
    cost_ = written_ - begin;
}

void StatsFile::finish() {
    if (!frames_.empty()) return write(path_, frames_);
    if (fault_) throw InputError(*fault_);
}

} // namespace marram
