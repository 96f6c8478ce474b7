// SPDX-License-Identifier: Apache-2.0
// Combines what procedurals report about a frame, as their libraries declare it. Core prints the entries
// without knowing their meaning.
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
        MarramReportEntry declared{}; // points into its library: valid while that is loaded
        double value = 0.0;
        std::map<std::string, double> each; // MARRAM_EACH only: value by procedural
    };

    // Makes each declared entry exist with value 0, so that it is printed even if no procedural reports it;
    // but not those of patterns ("terrain.layer[].*.seconds").
    void declare(std::span<const MarramReportEntry> entries);
    // Adds what one procedural reports. Entries in thread seconds (summed over threads) are not added as they
    // are: `wall`, the elapsed seconds, is divided among them in proportion, each part going to
    // "seconds.<stage>"; without such entries all of it goes to "seconds.expand". An undeclared path is a sum
    // without a unit.
    void add(const std::string& procedural, std::span<const std::pair<std::string, double>> entries,
             double wall);
    // Adds core's own value to one entry, of no procedural.
    void add(std::string_view path, double value);

    // The combined value; 0 if there is no such entry. A ratio is computed here, from its two parts.
    double operator()(std::string_view path) const;
    const std::map<std::string, Entry, std::less<>>& entries() const { return entries_; }

  private:
    Entry& entry(std::string_view path); // made as the first pattern that matches declares it

    std::map<std::string, Entry, std::less<>> entries_;
    std::vector<MarramReportEntry> patterns_;
};

// Sum of all "seconds.<stage>": elapsed seconds spent on making curves.
double strand_seconds(const Report& report);

} // namespace marram
