// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>

#include <string>

namespace marram {

// What a file of a mesh, strands or a picture contains, as text: what `marram info FILE` prints. "" if its
// extension is that of no such file. Throws InputError if it cannot be read.
std::string file_summary(const std::string& path);

// "8 x 0.5 x 6 m around (0, 0.25, 0)"; "empty" for an empty box.
std::string box_text(const Eigen::AlignedBox3f& box);

} // namespace marram
