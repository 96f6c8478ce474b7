// SPDX-License-Identifier: Apache-2.0
// What curves take in memory, known before they are made. So a frame that does not fit into the memory that the
// process may take (BuildSettings::memory) ends before its first ray, and says how much would do.
#pragma once

#include "core/world/build_state.h"

namespace marram {

struct CurveMemory {       // bytes
    uint64_t arrays = 0;   // vertices, normals, indices, attributes
    uint64_t bvh = 0;      // Embree's
    uint64_t building = 0; // that Embree takes besides while it builds this
    uint64_t total() const { return arrays + bvh + building; }
};

// Of all curves of a procedural, whose attributes are chosen, if they were traced as so many straight pieces a
// segment (0: as cubics), with that many of their motion keys at most. Within an eighth of what Embree takes
// (tests/unit/world/memory_test.cpp).
CurveMemory curve_memory(const CurveBuild& item, uint32_t pieces, uint32_t most_keys = max_motion_keys);

// Bytes a segment or triangle: of Embree's BVH, and of what building it takes besides.
struct BvhCost {
    double bvh, building;
};
BvhCost bvh_of_cubics(MarramShape shape, double keys);

// Of the BVH of still triangles, also while it is built; likewise.
uint64_t triangle_bvh_bytes(uint64_t triangles);

// Throws InputError. needed: bytes that would do, or more than that if at_least. or_else: what helps besides
// more memory.
[[noreturn]] void refuse_memory(uint64_t needed, uint64_t limit, const std::string& what_for, bool at_least,
                                const std::string& or_else);

// Before curves are made: whether they fit, with all that were made before. If not, they count as refused.
bool fits_memory(Build& build, const CurveBuild& item);
// Whether a procedural reads what was refused: then it is, too.
bool reads_refused(Build& build, const Procedural& procedural);
// Throws InputError if curves were refused.
void raise_refused(const Build& build);

// Before curves are attached: throws InputError if their BVH, with that of all meshes, does not fit.
void check_memory(const Build& build);

// Lets Embree's device take what is left. Throws InputError if nothing is.
void limit_device(const Build& build);

} // namespace marram
