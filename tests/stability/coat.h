// SPDX-License-Identifier: Apache-2.0
// A coat of fur on a bumpy ball with all stages of the chain, at any size and position: for results that must
// not depend on either.
#pragma once

#include "tests/chain/furred_world.h"
#include "tests/stability/scene.h"

#include <memory>
#include <span>

namespace marram::stability {

struct CoatSpec {
    double size = 1.0;           // m, the ball's radius; the whole scene scales with it
    Vec3d place = Vec3d::Zero(); // of the ball's center
    double frame = 12.0;
    std::vector<double> times{}; // motion samples; empty: the frame alone
    bool gusts = true, shielding = true, jiggle = false, collision = true;
    double hair = 1.0; // strand width in thousandths of the size
    std::optional<double> offset_scale{};
};

class Coat {
  public:
    // Roots are those of the coat of size 1 at the origin, so that strands can be compared.
    explicit Coat(const CoatSpec& spec);

    std::span<const Root> roots() const { return roots_; }
    double longest() const { return 0.25 * spec_.size; }
    const MarramFrame& frame() const { return frame_; }
    const oracle::TriangleSet& triangles() const { return set_; }
    // The final poses of these roots at every motion sample, [time][root], tessellated in batches of `batch`.
    std::vector<std::vector<Curve>> poses(std::span<const Root> roots, size_t batch,
                                          ChainScratch& scratch) const;
    std::vector<Curve> rest(std::span<const Root> roots) const;

  private:
    RestStrandSource expand_of(std::span<const Root> roots) const;

    CoatSpec spec_;
    std::unique_ptr<FurredWorld> world_;
    oracle::TriangleSet set_;
    Groom groom_;
    Wind wind_;
    std::vector<Root> roots_;
    std::vector<double> times_;
    std::vector<float> profile_;
    MarramFrame frame_{};
    ChainFrame chain_;
};

} // namespace marram::stability
