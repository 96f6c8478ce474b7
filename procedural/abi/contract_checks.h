// SPDX-License-Identifier: Apache-2.0
// Checks the data that a host passes against its declarations before anything is read from it. A faulty host
// gets a message with the fault and the allowed values, and cannot crash the library. Each array of the host
// is read once: about 2 ms for a million triangles.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

struct ContractFault {
    std::string place; // of the value, as given by the host
    std::string what, remedy;
};

// Returns all faults of the values of create(): unknown or repeated names, wrong types and counts, numbers
// that are not finite or out of range, unknown choices, ramps and keys that are empty or out of order, null
// pointers. Missing values are reported only when they are read (Values::at).
// items: the declared types of list elements. A value of an element is checked against the element's type.
std::vector<ContractFault> value_faults(std::span<const MarramParam> params,
                                        std::span<const MarramValue> values,
                                        std::span<const MarramItemType> items = {});

// Returns the first fault of a frame; `what` is "" if there is none. Faults: null pointers, motion samples
// that are not 1 to 64 equally spaced numbers, meshes without positions or triangles, vertex indices out of
// range, coordinates that Embree would drop, curves whose offsets do not ascend, colliders of another
// RTCDevice, not committed, without one of the meshes, or with an instance in its place. For the last two,
// one ray is traced through one triangle of each mesh.
ContractFault frame_fault(const MarramFrame& frame, std::span<const MarramMesh> meshes,
                          std::span<const MarramCurves> curves);

// True if all are finite and within the range that Embree accepts.
bool usable_coordinates(const float* numbers, size_t count);

// Returns the first fault of a view, as frame_fault().
ContractFault view_fault(const MarramView& view);

} // namespace marram
