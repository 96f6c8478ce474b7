// SPDX-License-Identifier: Apache-2.0
// What `marram measure` found, as a table for the terminal, as CSV, as a plot for each dial and as one page for a browser.
#pragma once

#include "core/measure/dials.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

struct SettingResult {
    std::string refused;   // why it could not be measured; "" where it was
    double seconds = 0.0;  // median over the rounds
    double ratio = 0.0;    // to the base's: median of the rounds' ratios
    double error = 0.0;    // root mean square; of motion: what 99 strands in 100 stay below
    double worst = 0.0;    // of a strand, or pixel
    double most = 0.0;     // of poses: metres that 99 strands in 100 stay below
    uint64_t crossing = 0; // strands that a mesh crosses
    int rounds = 0;
    bool front = false; // no other setting is both faster and more exact
};

struct DialResult {
    Dial dial;
    std::vector<SettingResult> settings; // as those of the dial
    size_t base = 0;                     // the one that the ratios are against
    std::string rule; // by which the tolerance turns this dial, how well it fits here; "": it does not
};

struct Measurement {
    std::string scene;
    double frame = 0.0;
    int threads = 1;
    uint64_t strands = 0, cvs = 0, triangles = 0;
    std::vector<DialResult> dials;
    std::vector<std::string> left_out;
};

// Marks those settings that no other beats in both; those that were refused are none.
void mark_front(DialResult& result);

// "1" for poses, "px" for motion: what the errors are counted in.
std::string error_unit(DialError error);

std::string to_table(const Measurement& measurement);
std::string to_csv(const Measurement& measurement);
std::string to_svg(const DialResult& result); // a whole file
std::string to_html(const Measurement& measurement);

} // namespace marram
