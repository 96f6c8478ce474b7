// SPDX-License-Identifier: Apache-2.0
// The groom as the contract sees it.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

// The entry of the library's table. `params` = groom_params() with the wind's behind them, prefixed "wind.".
MarramProcedural groom_procedural();

// What a groom reports of a frame.
std::span<const MarramReportEntry> groom_report_entries();

} // namespace marram
