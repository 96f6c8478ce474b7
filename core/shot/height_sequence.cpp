// SPDX-License-Identifier: Apache-2.0
#include "core/shot/height_sequence.h"

#include "core/write/grid_export.h"

#include <algorithm>
#include <utility>

namespace marram {

void HeightSequence::add(const World& world, const std::string& file) {
    const MeshGeometry& mesh = mesh_of_heights(world, file);
    const Vec2d heights = height_range(mesh);
    range_ = frames_.empty() ? heights
                             : Vec2d(std::min(range_.x(), heights.x()), std::max(range_.y(), heights.y()));
    frames_.emplace_back();
    const size_t bytes = mesh.grids[0].values.size() * sizeof(float);
    if (bytes > budget_) return;
    budget_ -= bytes;
    MeshGeometry kept;
    kept.name = mesh.name;
    kept.grids = {mesh.grids[0]};
    frames_.back().emplace().meshes.push_back(std::move(kept));
}

std::optional<World> HeightSequence::take(size_t i) { return std::exchange(frames_[i], std::nullopt); }

} // namespace marram
