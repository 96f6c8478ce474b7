// SPDX-License-Identifier: Apache-2.0
// The kinds of dunes that winds form from sand on hard ground.
#pragma once

#include <string>

namespace marram {

// pictures: a folder for pictures, "" for none.

// Directions in which sand of a source extends on hard ground, under pairs of winds, against theory.
void print_fingers(const std::string& pictures);

// One heap in one wind, in two and in five: elongation, arms and slip faces.
void print_kinds(const std::string& pictures);

} // namespace marram
