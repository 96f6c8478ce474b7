// SPDX-License-Identifier: Apache-2.0
// Warnings of a groom: settings that are valid but unlikely, long computations, and goals that were not
// reached.
#pragma once

#include "procedural/abi/values.h"
#include "procedural/strands/grown/covered_roots.h"
#include "procedural/strands/grown/groom_instance.h"

#include <cstdint>

namespace marram {

// Warns of invisible strands.
void warn_invisible_strands(const MarramHost& host, const Values& given, const Groom& groom);

// Warns of values that have no effect because of other values.
void warn_of_ignored(const MarramHost& host, const Values& given, const Groom& groom);

// After the roots are placed: no strands; guides that are far from the mesh.
void warn_of_no_strands(const GroomInstance& instance);
void warn_of_tiles(GroomInstance& instance); // images in UDIM tiles
// covers: [covering mesh]; of: the number of roots before any were left out.
void warn_of_covered_roots(const GroomInstance& instance, std::span<const Cover> covers, uint64_t of);
// left_out: roots beyond the reach of all guides; of: the number of roots before.
void warn_beyond_guides(const GroomInstance& instance, uint64_t left_out, uint64_t of);
void warn_of_guides(const GroomInstance& instance, const Binding& binding);

// Before a frame is computed: rounding far from the origin, lengths in the wrong unit, long computations.
void warn_of_rounding(const GroomInstance& instance);
void warn_of_length(const GroomInstance& instance);

} // namespace marram
