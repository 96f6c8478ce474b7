// SPDX-License-Identifier: Apache-2.0
// What a host hands over, checked against what was declared before anything is read from it: a faulty host is told what is
// wrong and what is allowed, and never crashes the library. What it lends is read once: some 2 ms for a million triangles.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>
#include <string>
#include <vector>

namespace marram {

struct ContractFault {
    std::string place; // of the value, as the host gave it
    std::string what, remedy;
};

// All faults of the values of create(): unknown or repeated names, wrong types and counts, numbers that are not finite or out of
// range, choices that do not exist, ramps and keys that are empty or out of order, null pointers. Absent values are not looked
// for here: whoever reads one says that it is missing (Values::at).
// items: the types that elements of lists may have; such a value is held against what the type of its element declares.
std::vector<ContractFault> value_faults(std::span<const MarramParam> params,
                                        std::span<const MarramValue> values,
                                        std::span<const MarramItemType> items = {});

// The first fault of a frame, none where what is "": null pointers, motion samples that are not 1 to 64 numbers in equal steps, meshes
// without positions or triangles, vertices that are not there or that Embree would drop, curves whose offsets do not ascend, a scene of
// another device.
ContractFault frame_fault(const MarramFrame& frame, std::span<const MarramMesh> meshes,
                          std::span<const MarramCurves> curves);

// Whether all are finite and no larger than Embree takes.
bool usable_coordinates(const float* numbers, size_t count);

// The first fault of a view, likewise.
ContractFault view_fault(const MarramView& view);

} // namespace marram
