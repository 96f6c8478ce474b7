// SPDX-License-Identifier: Apache-2.0
// The groom procedural.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

// Its entry in the library's table. `params`: groom_params(), followed by the wind's with the prefix "wind.".
MarramProcedural groom_procedural();

// The entries of a groom's frame report.
std::span<const MarramReportEntry> groom_report_entries();

} // namespace marram
