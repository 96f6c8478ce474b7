// SPDX-License-Identifier: Apache-2.0
// Shared code of the entry points of the procedurals that blow strands (groom, strands).
#pragma once

#include "procedural/abi/border.h"
#include "procedural/wind/chain.h"

#include <tbb/enumerable_thread_specific.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Of the attribute "contact".
constexpr const char* contact_help =
    "what collision did to the segment before a CV: 0 nothing, 1 it met a mesh, 2 it found no free direction";

struct Worker { // per-thread memory, reused between patches
    Strands strands;
    ChainScratch chain;
};
using Workers = tbb::enumerable_thread_specific<Worker>;

// Inputs, besides the scene's values, of the settings chosen by the tolerance.
struct ChosenFor {
    double frame, first, last, tolerance;
    MarramStage stage;
    bool operator==(const ChosenFor&) const = default;
};

// A procedural's own parameters, followed by the wind's as "wind.<name>". The names are static.
std::vector<MarramParam> with_wind_params(std::span<const MarramParam> own);

// Where random gusts start.
struct GustStart {
    bool fixed = false;
    bool follows_bounds = false; // center, extent or distance is computed from `bounds`
    bool warned = false;
    Eigen::AlignedBox3d bounds; // at bind_frame, of the meshes, or of the strands if there are none
};
// Unless the scene gives their start, random gusts start across the bounds of the meshes at bind_frame. It is
// fixed in the first frame, so that gusts do not jump from frame to frame. Warns once if the bounds differ in
// a later frame: an evolving terrain has no pose at bind_frame, so that frame rendered alone would have other
// gusts. strand_bounds: used if there are no meshes. Poses all meshes, in later frames only if the start
// follows their bounds.
void set_gust_plane_once(const MarramHost& host, const MarramFrame& frame,
                         const Eigen::AlignedBox3d& strand_bounds, Wind& wind, GustStart& start);

// True if meshes that move within the shutter affect the strands: by collision or by shielding.
bool moving_meshes_matter(const Wind& wind, const MarramFrame& frame);

// Reports the times and counts of all threads. Returns the counts of collisions; `scratch`: memory of the
// threads, bytes.
CollisionCounts report_chain(Workers& workers, const ReportSink& sink, size_t& scratch,
                             uint64_t& unsolved_blades);

// Warns of unresolved collisions and penetrations: how many, at which meshes, where, and what helps there.
// place: "" or where the message points. skin: name of the mesh that strands grow on; "": none.
void warn_of_collisions(const MarramHost& host, const std::string& place, const std::string& skin,
                        bool all_samples, const CollisionCounts& counts);

// The amount of work of the chain in a frame.
struct LongWork {
    double cvs = 0.0, cvs_per_strand = 0.0;
    uint32_t samples = 1;     // of motion
    int64_t past_samples = 0; // of jiggle
    bool collides = false;
    const char* remedy = "";
};
// Announces long work before it starts, once per frame, so that unintended settings are noticed early.
void announce_long_work(const MarramHost& host, const char* id, const std::string& place,
                        const LongWork& work, double frame, std::optional<double>& announced);

// Warns of gusts that need much memory.
void warn_of_gusts(const MarramHost& host, const std::string& place, const ChainFrame& chain);

} // namespace marram
