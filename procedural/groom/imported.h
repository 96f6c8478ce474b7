// SPDX-License-Identifier: Apache-2.0
// The procedural "strands": imported strands, blown by the scene's wind.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

// Its entry in the library's table. `params`: its own, followed by the wind's with the prefix "wind.".
MarramProcedural strands_procedural();

// The entries of its frame report, in addition to a groom's.
std::span<const MarramReportEntry> strands_report_entries();

} // namespace marram
