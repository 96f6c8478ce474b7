// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "procedural/wind/gusts.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace marram {

// The gusts at the past samples of jiggle, each made when it is first asked for. Any thread.
class PastGusts {
  public:
    struct Key { // two with the same key have the same gusts at a sample
        double fps = 0.0, step = 0.0;
        Eigen::AlignedBox3d within;
    };
    // Samples first ... last. Takes over what `earlier` (of an earlier frame, may be nullptr) has made.
    PastGusts(const Gusts& gusts, const Vec3d& wind_direction, const Key& key, int64_t first, int64_t last,
              PastGusts* earlier);
    const GustField& at(int64_t past_sample);
    size_t bytes() const; // of those made

  private:
    struct Made {
        std::once_flag once;
        GustField field;
        std::atomic<size_t> bytes{0};
    };
    const Gusts* gusts_;
    Vec3d wind_direction_;
    Key key_;
    int64_t first_;
    std::vector<std::shared_ptr<Made>> made_; // [past sample - first]
};

} // namespace marram
