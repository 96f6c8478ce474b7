// SPDX-License-Identifier: Apache-2.0
// Triangles of a mesh along a Morton curve: neighbours in the list are neighbours in space.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <Eigen/Geometry>

#include <vector>

namespace marram {

// For every triangle that touches `reach` at any motion sample and is finite at all of them: 30 bits of Morton code of its
// place within the mesh at the first sample, and below them, in 32 bits, its number; sorted. The same for any number of
// threads. Cost: 16 bytes and about 8 ns a triangle on two threads while it runs.
std::vector<uint64_t> morton_order(const MarramMesh& mesh, const Eigen::AlignedBox3d& reach);

} // namespace marram
