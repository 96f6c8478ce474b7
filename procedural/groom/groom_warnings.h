// SPDX-License-Identifier: Apache-2.0
// What a groom tells its user: what is allowed and hardly meant, what takes long, what could not be done.
#pragma once

#include "procedural/groom/groom_instance.h"
#include "procedural/values.h"

namespace marram {

// Strands that nobody will see.
void warn_of_nothing(const MarramHost& host, const Values& given, const Groom& groom);

// Before a frame's work: rounding far from the origin, lengths in the wrong unit, minutes of work.
void warn_of_rounding(const GroomInstance& instance);
void warn_of_length(const GroomInstance& instance);
void announce_long_work(GroomInstance& instance);

} // namespace marram
