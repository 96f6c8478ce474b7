// SPDX-License-Identifier: Apache-2.0
// The strands that a page draws: some of a frame's, always the same ones, packed for the line.
//
// A strand is chosen if a hash of its id is below a share of all, so the same strands are seen whatever the
// frame, and a larger share adds strands to those of a smaller one. Procedurals that follow
// BuildSettings::share have chosen already, by a hash of their own: of the rest no strand is evaluated.
#pragma once

#include "core/geometry/world.h"
#include "core/view/wire.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace marram {

// A run of strands whose positions are quantized to 16 bits in a bounding box of their own, which is sent
// with each frame.
struct StrandChunk {
    uint64_t first_vertex = 0, vertices = 0; // of the part's chosen strands
    size_t first = 0, last = 0;              // [first, last) in StrandPart::strands
};

// The chosen strands of one CurveGeometry.
struct StrandPart {
    std::vector<uint32_t> strands;      // indices, ascending
    std::vector<uint64_t> first_vertex; // [strands + 1] among the vertices that are sent
    std::vector<StrandChunk> chunks;
};

struct StrandSelection {
    uint64_t layout = 0; // digest of the curves that it was made for: strands, their ids and CVs
    uint32_t budget = 0;
    std::vector<StrandPart> parts; // [World::curves]
};

// Digest of which strands there are and how many CVs they have: a selection is valid while it is the same.
uint64_t layout_digest(const World& world);

uint64_t all_strands(const World& world);        // with those that BuildSettings::share left out
double share_for(uint32_t budget, uint64_t all); // BuildSettings::share for about so many strands of all

// budget: target number of strands over all curves; their hashes decide, so it may be exceeded a little.
StrandSelection select_strands(const World& world, uint32_t budget, uint64_t layout);
// The strand of world.curves[part] that a vertex of the part belongs to; none if there is no such vertex.
std::optional<uint32_t> strand_of(const StrandSelection& selection, uint32_t part, uint32_t vertex);

// The colours of a part, linear.
struct StrandColors {
    Vec3f root = Vec3f::Ones(), tip = Vec3f::Ones();
};

// The message "strands": what does not change from frame to frame.
WireMessage strands_message(const World& world, const StrandSelection& selection, uint64_t number,
                            const std::vector<StrandColors>& colors);

// Appends the vertices of a frame, and their boxes as header["parts"]. The positions are the first motion
// sample's. 16 bits: within half a step (and the rounding of floats) of the positions; else the same
// floats.
void add_strand_positions(const World& world, const StrandSelection& selection, bool as_floats,
                          WireMessage& message);

} // namespace marram
