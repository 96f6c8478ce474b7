// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "procedural/wind/gusts.h"
#include "procedural/wind/wind.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace marram {

// The wind at one time, and its gusts.
struct WindAt {
    const Wind* wind = nullptr; // `own`, or the scene's if it has no keys
    std::shared_ptr<const Wind> own;
    GustField gusts;             // refers to wind->gusts
    std::vector<FieldAt> fields; // of wind->fields
    GroundAir::At ground;        // of wind->over
};
// with_gusts: false if the caller needs none. `within`: as in gusts_at(). `ground`: nullptr: none.
WindAt wind_with_gusts(const Wind& wind, double frame, double fps, bool with_gusts,
                       const Eigen::AlignedBox3d& within, GroundAir* ground);
// The air over the ground at a frame. Makes what it has not made yet, in parallel loops.
GroundAir::At ground_at(const Wind& wind, double frame, GroundAir* ground);

// The wind at the past samples of jiggle, each made when it is first asked for; another thread that asks
// for the same one waits. Any thread. `wind` must outlive it; what it gives lives as long as the PastWind
// that gave it.
class PastWind {
  public:
    struct Key {                             // with the same Wind, unchanged: the same wind at a sample
        double fps = 0.0, step = 0.0;        // step: frames between samples
        Eigen::AlignedBox3d within;          // m, world space: as in gusts_at()
        std::shared_ptr<GroundAir> ground{}; // nullptr: none
    };
    // Samples first ... last. Shares what `earlier` (of an earlier frame, may be nullptr) has made, if its
    // key and its Wind are the same; the caller drops it when the values of the wind change.
    PastWind(const Wind& wind, const Key& key, int64_t first, int64_t last, PastWind* earlier);
    const WindAt& at(int64_t past_sample);
    size_t bytes() const; // of those made

  private:
    struct Made {
        std::once_flag once;
        WindAt wind;
        std::atomic<size_t> bytes{0};
    };
    const Wind* wind_;
    Key key_;
    int64_t first_;
    std::vector<std::shared_ptr<Made>> made_; // [past sample - first]
};

} // namespace marram
