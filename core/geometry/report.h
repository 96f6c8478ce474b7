// SPDX-License-Identifier: Apache-2.0
// What procedurals report of a frame, combined as their libraries declare it. Core prints the entries without knowing what they say.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <map>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {

class Report {
  public:
    struct Entry {
        MarramReportEntry declared{}; // lives as long as its library
        double value = 0.0;
        std::map<std::string, double> each; // of MARRAM_EACH, by procedural
    };

    // Entries that are declared are there, with 0, whether anybody reports them or not. Twice is as once.
    void declare(std::span<const MarramReportEntry> entries);
    // What one procedural says. Of thread seconds each entry's share of `wall` seconds is added to "seconds.<stage>" instead; where it
    // reports none, they all go to "seconds.expand". Paths that nobody has declared are sums without a unit.
    void add(const std::string& procedural, std::span<const std::pair<std::string, double>> entries,
             double wall);
    void add(std::string_view path, double value);

    double operator()(std::string_view path) const; // 0 where there is no such entry; ratios are worked out
    const std::map<std::string, Entry, std::less<>>& entries() const { return entries_; }

  private:
    std::map<std::string, Entry, std::less<>> entries_;
};

// All "seconds.<stage>": what it took to make curves.
double strand_seconds(const Report& report);

} // namespace marram
