// SPDX-License-Identifier: Apache-2.0
// What the procedurals that blow strands (groom, strands) share where the host calls them.
#pragma once

#include "procedural/wind/chain.h"

#include <tbb/enumerable_thread_specific.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

struct Worker { // what a thread keeps from patch to patch
    Strands strands;
    ChainScratch chain;
};
using Workers = tbb::enumerable_thread_specific<Worker>;

// Receives the entries of a report.
using ReportSink = void (*)(void* user, const char* path, double value);

// A procedural's own parameters and behind them the wind's as "wind.<name>". Their names live as long as the library.
std::vector<MarramParam> with_wind_params(std::span<const MarramParam> own);

// Gusts start across the scene's bounds at the shot's first frame, where the scene does not say where. `box`: of the strands
// themselves, which count where there are no meshes.
MarramStatus fix_gusts_once(const MarramFrame& frame, const Eigen::AlignedBox3d& box, Wind& wind,
                            bool& fixed);

// Whether meshes that move within the shutter move strands: by collision, and by sheltering them from the wind.
bool moving_meshes_matter(const Wind& wind, const MarramFrame& frame);

// Throws SceneFault for buffers of a patch that are NULL, and attributes that are not there.
void check_buffers(const MarramPatchBuffers* buffers, uint32_t time_count, bool oriented,
                   size_t attribute_count);

// Sums up what all threads did, and reports it. Returns the counts of collisions; `scratch` is the memory that threads keep.
CollisionCounts report_chain(Workers& workers, ReportSink sink, void* user, size_t& scratch);

// Warns of what collision could not do. place: "" or where the message points.
void warn_of_collisions(const MarramHost& host, const std::string& place, bool all_samples,
                        const CollisionCounts& counts);

// What the chain has to do in a frame.
struct LongWork {
    double cvs = 0.0, cvs_a_strand = 0.0;
    uint32_t samples = 1; // of motion
    int64_t steps = 0;    // of jiggle
    bool collides = false;
    const char* remedy = "";
};
// Announces work that takes long before it begins, so that who asked for it by mistake need not wait to learn it; once a frame.
void announce(const MarramHost& host, const char* id, const std::string& place, const LongWork& work,
              double frame, std::optional<double>& announced);

// Warns of gusts that take much memory.
void warn_of_gusts(const MarramHost& host, const std::string& place, const ChainFrame& chain);

} // namespace marram
