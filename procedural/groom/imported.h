// SPDX-License-Identifier: Apache-2.0
// strands: curves that were groomed elsewhere, blown by the scene's wind.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

// The entry of the library's table. `params` = its own with the wind's behind them, prefixed "wind.".
MarramProcedural strands_procedural();

// What it reports of a frame, beside what a groom reports.
std::span<const MarramReportEntry> strands_report_entries();

} // namespace marram
