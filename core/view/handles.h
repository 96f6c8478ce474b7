// SPDX-License-Identifier: Apache-2.0
// What a page shows of the wind, in metres and world space: gusts by hand, fields and points of drawn curves,
// which are moved with the pointer, and random gusts, which are not.
#pragma once

#include "core/shot/shot.h"

#include <nlohmann/json.hpp>

namespace marram {

// The parameters that can be dragged, a list of:
//   gusts by hand and fields:  { key, list, index, kind: "gust" or "field", shape, inner, keys, interpolation }
//   points of drawn curves:    { key, kind: "points", points: x y z x y z ..., closed }
// key: as of --set; list and index: the table that it is in. shape: as in the scene. keys: 10 numbers each,
// as of KeyedTransform (core/math/transform.h). inner: half sides of a box where its influence is full, as
// shares of the outer box; null: not given.
nlohmann::json handles_of(const Shot& shot);

// The random gusts of the frame that was built last, a list of { center, radius, strength } as of
// MarramProcedural.gusts: all, or the 500 of the largest radius.
nlohmann::json gusts_message(const Shot& shot);

} // namespace marram
