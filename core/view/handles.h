// SPDX-License-Identifier: Apache-2.0
// What a page shows and moves with the pointer: gusts and fields of the wind, points of drawn curves.
#pragma once

#include "core/shot/shot.h"

#include <nlohmann/json.hpp>

namespace marram {

// A list of values that are places:
//   gusts by hand and fields:  { key, list, index, kind: "gust" or "field", shape, inner, keys, interpolation }
//   points of drawn curves:    { key, kind: "points", points: x y z x y z ..., closed }
// key: as of --set. keys: 10 numbers each, as of KeyedTransform. inner: of a gust's box, or null.
nlohmann::json handles_of(const Shot& shot);

// The random gusts of the frame that was built last: { center, radius, strength }, the largest of many.
nlohmann::json gusts_message(const Shot& shot);

} // namespace marram
