// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/plugin/marram_plugin.h"

#include <span>

namespace marram {

MarramProcedural rock_procedural();
std::span<const MarramReportEntry> rock_report_entries();

} // namespace marram
