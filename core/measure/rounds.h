// SPDX-License-Identifier: Apache-2.0
// The times of a dial's settings in each round, and their evaluation.
#pragma once

#include "core/math/median.h"
#include "core/measure/report.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace marram {

class Rounds {
  public:
    Rounds(size_t settings, size_t base) : seconds_(settings), base_(base) {}

    void add(size_t setting, double seconds) { seconds_[setting].push_back(seconds); }

    // Each ratio is within one round, so that changes of the machine's speed between rounds cancel. Seconds
    // are the ratio times the base's median, so that both columns agree.
    void finish(std::vector<SettingResult>& results) const {
        const auto from = [&](size_t i) { // skip the first round, a warm-up
            return seconds_[i].size() > 1 && seconds_[base_].size() > 1 ? size_t(1) : size_t(0);
        };
        const std::vector<double>& base = seconds_[base_];
        const double base_seconds =
            median({base.begin() + std::ptrdiff_t(std::min(from(base_), base.size())), base.end()});
        for (size_t i = 0; i < seconds_.size(); ++i) {
            std::vector<double> mine, ratios;
            for (size_t r = from(i); r < std::min(seconds_[i].size(), base.size()); ++r) {
                mine.push_back(seconds_[i][r]);
                if (base[r] > 0.0) ratios.push_back(seconds_[i][r] / base[r]);
            }
            results[i].ratio = median(ratios);
            results[i].seconds = ratios.empty() ? median(mine) : results[i].ratio * base_seconds;
            results[i].rounds = int(mine.size());
        }
    }
    bool has(size_t setting) const { return !seconds_[setting].empty(); }
    double first(size_t setting) const { return has(setting) ? seconds_[setting].front() : 0.0; }
    // A ratio to 0 seconds is undefined.
    bool base_is_positive() const { return !seconds_[base_].empty() && seconds_[base_].front() > 0.0; }
    void set_base(size_t base) { base_ = base; }

  private:
    std::vector<std::vector<double>> seconds_; // [setting][round]
    size_t base_;
};

} // namespace marram
