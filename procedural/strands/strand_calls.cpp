// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/strand_calls.h"

#include "procedural/abi/border.h"
#include "procedural/wind/keyed_wind.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

namespace marram {

std::vector<MarramParam> with_wind_params(std::span<const MarramParam> own) {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> list;
        for (const MarramParam& param : wind_params()) list.push_back(std::string("wind.") + param.name);
        return list;
    }();
    std::vector<MarramParam> list(own.begin(), own.end());
    for (size_t i = 0; i < wind_params().size(); ++i) {
        list.push_back(wind_params()[i]);
        list.back().name = names[i].c_str();
    }
    return list;
}

void set_gust_plane_once(const MarramHost& host, const MarramFrame& frame,
                         const Eigen::AlignedBox3d& strand_bounds, Wind& wind, GustStart& start) {
    if (!wind.gusts || (start.fixed && (!start.follows_bounds || start.warned))) return;
    Eigen::AlignedBox3d bounds;
    if (frame.mesh_count == 0) bounds = strand_bounds;
    std::vector<float> positions;
    for (uint32_t i = 0; i < frame.mesh_count; ++i) {
        positions.resize(3 * size_t(frame.meshes[i].vertex_count));
        pose_lent_mesh(frame, i, frame.bind_frame, positions.data(), nullptr);
        for (size_t v = 0; v + 2 < positions.size(); v += 3)
            bounds.extend(Vec3d(double(positions[v]), double(positions[v + 1]), double(positions[v + 2])));
    }
    Gusts& gusts = *wind.gusts;
    if (!start.fixed) {
        start.fixed = true;
        start.follows_bounds = gusts.num_gusts > 0 && (!gusts.center || !gusts.extent || !gusts.distance);
        start.bounds = bounds;
        set_gust_plane(gusts, bounds.min(), bounds.max(), gust_carrier(wind));
    } else if (bounds.min() != start.bounds.min() || bounds.max() != start.bounds.max()) {
        send(host, MARRAM_WARNING, "gusts.start", "wind.gusts.num_gusts",
             fmt::format(
                 "gusts start across the bounds that the meshes had in the first frame rendered, and in "
                 "frame {:.6g} the bounds differ: rendered alone it would have other gusts",
                 frame.frame),
             fmt::format("give wind.gusts.center = [{:.4g}, {:.4g}, {:.4g}], extent = [{:.4g}, {:.4g}] and "
                         "distance = {:.4g}",
                         gusts.center->x(), gusts.center->y(), gusts.center->z(), gusts.extent->x(),
                         gusts.extent->y(), *gusts.distance));
        start.warned = true;
    }
}

bool moving_meshes_matter(const Wind& wind, const MarramFrame& frame) {
    if (!wind.collision && !wind.shielding) return false;
    for (uint32_t i = 0; i < frame.mesh_count; ++i)
        if (frame.meshes[i].time_count > 1) return true;
    return false;
}

CollisionCounts report_chain(Workers& workers, const ReportSink& sink, size_t& scratch, uint64_t& unsolved) {
    StageClock sum;
    CollisionCounts counts;
    unsolved = 0;
    scratch = 0;
    for (const Worker& worker : workers) {
        sum += worker.chain.clock;
        counts += worker.chain.counts;
        unsolved += worker.chain.unsolved_blades;
        scratch += worker.strands.bytes() + worker.chain.past.bytes();
        for (const auto& pose : worker.chain.jiggled) scratch += pose.capacity() * sizeof(Wide3f);
    }
    for (const StageClock::Stage& stage : StageClock::stages()) sink(stage.path, sum.*stage.seconds);
    if (unsolved > 0) sink("bend.unsolved", double(unsolved));
    sink("collision.contacts", double(counts.contacts));
    sink("collision.pushed_out", double(counts.pushed_out));
    sink("collision.unresolved", double(counts.unresolved));
    sink("collision.targets_not_raised", double(counts.targets_not_raised));
    sink("collision.dips", double(counts.dips));
    sink("collision.goal_angle", counts.goal_angle);
    sink("collision.turned_angle", counts.turned_angle);
    return counts;
}

void announce_long_work(const MarramHost& host, const char* id, const std::string& place,
                        const LongWork& work, double frame, std::optional<double>& announced) {
    // Thread seconds per CV of one motion sample; `bend` also of one past sample of jiggle. Collision: 0.2e-6
    // on a hill (scenes/default.toml), 0.6e-6 on a ball (talk.toml), 1.4e-6 along a head (long_hair.toml).
    constexpr double bend = 0.05e-6, collide = 1e-6, long_work = 30.0;
    const auto past_samples = double(std::max<int64_t>(work.past_samples, 0));
    const double seconds =
        work.cvs * (bend * (work.samples + past_samples) + (work.collides ? collide * work.samples : 0.0));
    if (seconds < long_work || announced == frame) return;
    announced = frame;
    const std::string what = fmt::format("{:.3g} CVs, {:.4g} per strand, at {} motion samples and {} past "
                                         "samples of jiggle take about {:.0f} s of "
                                         "one processor for a frame alone",
                                         work.cvs, work.cvs_per_strand, work.samples, past_samples, seconds);
    send(host, MARRAM_INFO, id, place, what, work.remedy);
}

void warn_of_gusts(const MarramHost& host, const std::string& place, const ChainFrame& chain) {
    constexpr size_t much = size_t(1) << 30;
    // Those of past samples are made later; there are about as many at each.
    const int64_t past_samples = chain.past_wind && chain.wind->gusts ? chain.window.count() : 0;
    size_t of_instants = 0;
    for (const ChainFrame::Instant& instant : chain.instants) of_instants += instant.wind.gusts.bytes();
    const double bytes = double(of_instants) *
                         (1.0 + double(past_samples) / double(std::max<size_t>(chain.instants.size(), 1)));
    if (bytes < double(much)) return;
    const std::string what = fmt::format(
        "gusts among the strands take about {:.0f} MiB, for {} motion samples and {} past samples of jiggle",
        bytes / double(1 << 20), chain.instants.size(), past_samples);
    send(host, MARRAM_WARNING, "gusts.memory", place, what,
         "lower wind.gusts.num_gusts, radius_range or life_range");
}

namespace {

// "3 at 'house', strand rooted at (1, 0, 2); 1 at 'ground', ..."
template <typename Count>
std::string places_without_room(const CollisionCounts& counts, Count&& count) {
    std::string text;
    for (const auto& [mesh, at] : counts.no_room)
        if (const uint64_t n = count(at); n > 0)
            text += fmt::format("{}{} {}, root at ({:.4g}, {:.4g}, {:.4g})", text.empty() ? "" : "; ", n,
                                mesh.empty() ? "in the open" : fmt::format("at '{}'", mesh), at.place.x(),
                                at.place.y(), at.place.z());
    return text;
}

} // namespace

void warn_of_collisions(const MarramHost& host, const std::string& place, const std::string& skin,
                        bool all_samples, const CollisionCounts& counts) {
    const std::string of = all_samples ? " (all motion samples together)" : "";
    bool roots_at_others = false, roots_at_own = false, segments = false, dips_at_own = false;
    for (const auto& [mesh, at] : counts.no_room) {
        (mesh == skin ? roots_at_own : roots_at_others) |= at.roots > 0;
        segments |= at.segments > 0;
        dips_at_own |= mesh == skin && at.dips > 0;
    }
    if (counts.unresolved > 0) {
        std::string remedy;
        const auto add = [&](bool applies, const char* text) {
            if (applies) remedy += (remedy.empty() ? "" : "; ") + std::string(text);
        };
        add(roots_at_others,
            "move that mesh away from the roots, grow nothing there (density_by, density_mask), or "
            "give it collides = false");
        add(roots_at_own, "raise wind.collision.offset_root");
        add(segments, "leave more space around the strands, or make them shorter there (length_by)");
        send(
            host, MARRAM_WARNING, "collision.unresolved", place,
            fmt::format("{} segments or roots have no free direction{}: {}", counts.unresolved, of,
                        places_without_room(counts, [](const NoRoom& at) { return at.roots + at.segments; })),
            remedy);
    }
    if (counts.dips > 0)
        send(host, MARRAM_WARNING, "collision.dips", place,
             fmt::format("{} rendered strands penetrate a mesh by more than the tolerance{}: {}", counts.dips,
                         of, places_without_room(counts, [](const NoRoom& at) { return at.dips; })),
             dips_at_own
                 ? "roots are closer to the mesh than the strand radius, or the gap is too narrow: use "
                   "thinner strands or raise wind.collision.offset_root"
                 : "the gap is too narrow: use thinner strands or more CVs, or leave more space");
}

} // namespace marram
