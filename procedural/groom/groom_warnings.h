// SPDX-License-Identifier: Apache-2.0
// What a groom tells its user: what is allowed and hardly meant, what takes long, what could not be done.
#pragma once

#include "procedural/groom/groom_instance.h"
#include "procedural/values.h"

namespace marram {

// Strands that nobody will see.
void warn_of_nothing(const MarramHost& host, const Values& given, const Groom& groom);

// Values that change nothing beside the others that are given.
void warn_of_ignored(const MarramHost& host, const Values& given, const Groom& groom);

// Of a placed groom: no strand grows; guides that are far from the mesh.
void warn_of_no_strands(const GroomInstance& instance);
void warn_of_guides(const GroomInstance& instance, const Binding& binding);

// Before a frame's work: rounding far from the origin, lengths in the wrong unit, minutes of work.
void warn_of_rounding(const GroomInstance& instance);
void warn_of_length(const GroomInstance& instance);
void announce_long_work(GroomInstance& instance);

} // namespace marram
