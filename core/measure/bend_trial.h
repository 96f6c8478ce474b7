// SPDX-License-Identifier: Apache-2.0
// The strands of one groom, evaluated again and again with other settings.
#pragma once

#include "core/measure/bend_fit.h"
#include "core/measure/measure.h"
#include "core/world/kept_geometry.h"

#include <atomic>
#include <string>
#include <vector>

namespace marram {

class BendTrial {
  public:
    // Loads the scene of the request with `changes`. groom: its name in the file; a list of meshes makes
    // several of one name. `stop` cancels, and must outlive this. Throws InputError and Cancelled.
    BendTrial(const MeasureRequest& request, double frame, const std::vector<std::string>& changes,
              std::string groom, const std::atomic<bool>& stop);

    // The directions of the segments after the stages up to the bend, if the groom has these changes, too.
    // Only the groom takes them and the scene's wind: what it grows on stays as it is. Throws InputError
    // and Cancelled.
    Directions bent(const std::vector<std::string>& changes);

    // Of the last directions.
    const std::vector<double>& weights() const { return weights_; } // [segment], share of the strands' length
    const std::vector<double>& positions() const {
        return positions_;
    } // [segment], of its middle along the strand
    size_t strands() const { return strands_; }
    uint64_t unsolved() const { return unsolved_; } // strands whose pose is only the nearest that was found

  private:
    void read(const CurveGeometry& curves, uint64_t every, Directions& directions);

    const MeasureRequest& request_;
    std::string groom_;
    std::vector<std::string> changes_;
    const std::atomic<bool>& stop_;
    Shot shot_;
    BuildSettings settings_;
    KeptGeometry kept_;
    std::vector<double> weights_, positions_;
    size_t strands_ = 0;
    uint64_t unsolved_ = 0;
};

} // namespace marram
