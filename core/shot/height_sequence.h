// SPDX-License-Identifier: Apache-2.0
// Heights of a sequence that is baked to .png files. All files have the range of all frames: ranges of single
// frames would make the sequence flicker. So heights are kept until the last frame is built. Frames beyond
// the budget have to be built a second time.
#pragma once

#include "core/shot/bake.h"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace marram {

class HeightSequence {
  public:
    static constexpr size_t default_budget = size_t(1) << 30; // bytes: 64 frames of 2048 x 2048 samples
    explicit HeightSequence(size_t budget = default_budget) : budget_(budget) {}

    // Adds the next frame. file: as for write_baked(). Throws InputError if the world has no heights.
    void add(const World& world, const std::string& file);

    // Lowest and highest sample of all frames added.
    Vec2d range() const { return range_; }

    // Frame i, in the order of add(), as a world that write_baked() writes as .png; it is then forgotten.
    // nullopt: it was beyond the budget.
    std::optional<World> take(size_t i);

  private:
    size_t budget_;
    Vec2d range_ = Vec2d::Zero();
    std::vector<std::optional<World>> frames_;
};

} // namespace marram
