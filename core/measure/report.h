// SPDX-License-Identifier: Apache-2.0
// The results of `marram measure`: as a table for the terminal, as CSV, as a plot for each dial and as an
// HTML page.
#pragma once

#include "core/measure/bend.h"
#include "core/measure/dials.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct SettingResult {
    std::string refused;  // why it could not be measured; "" if it was
    double seconds = 0.0; // ratio times the base's median
    double ratio = 0.0;   // of times to the base's: median over the rounds
    double error = 0.0;   // root mean square; of motion: 99th percentile of the strands
    double worst = 0.0;   // maximum over strands, vertices or pixels
    double most = 0.0;    // of poses: 99th percentile of the strands, metres
    double beyond =
        0.0; // of dials without_contact: fraction of strands that are, after contact, farther than the
             // tolerance from the reference
    uint64_t crossing = 0; // strands that cross a mesh
    int rounds = 0;
    bool front = false; // no other setting is both faster and more exact
};

struct DialResult {
    Dial dial;
    std::vector<SettingResult> settings; // parallel to dial.settings
    size_t base = 0;                     // the setting that ratios refer to
    std::string rule; // the rule by which the tolerance sets this dial, and how well it fits; "": none
};

struct Measurement {
    std::string scene;
    double frame = 0.0;
    int threads = 1;
    uint64_t strands = 0, cvs = 0, triangles = 0;
    std::vector<DialResult> dials;
    std::vector<std::string> left_out;
    bool built = false; // else the scene's strands, CVs and triangles are unknown
    std::vector<BendResult> bends{};
};

// Marks the settings on the Pareto front of time and error. Refused settings are not on it.
void mark_front(DialResult& result);

// Unit of the errors: "px", "m" or "1".
std::string error_unit(DialError error);

std::string to_table(const Measurement& measurement);
std::string to_csv(const Measurement& measurement);
std::string to_svg(const DialResult& result); // a complete file
std::string to_html(const Measurement& measurement);

} // namespace marram
