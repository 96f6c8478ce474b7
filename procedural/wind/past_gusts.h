// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "procedural/wind/gusts.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace marram {

// The gusts at the past samples of jiggle, each made when it is first asked for; another thread that asks
// for the same one waits. Any thread. `gusts` must outlive it; a field lives as long as the PastGusts that
// gave it.
class PastGusts {
  public:
    struct Key {                      // with the same Gusts, unchanged, and wind: the same gusts at a sample
        double fps = 0.0, step = 0.0; // step: frames between samples
        Eigen::AlignedBox3d within;   // m, world space: as in gusts_at()
    };
    // Samples first ... last. Shares what `earlier` (of an earlier frame, may be nullptr) has made, if its
    // key and its Gusts are the same; the caller drops it when the values of the wind change.
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
