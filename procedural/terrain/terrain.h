// SPDX-License-Identifier: Apache-2.0
// The procedural "terrain", documented in terrain.cpp.
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

MarramProcedural terrain_procedural();
std::span<const MarramReportEntry> terrain_report_entries();

} // namespace marram
