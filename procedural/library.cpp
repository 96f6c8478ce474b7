// SPDX-License-Identifier: Apache-2.0
// The library's entry point. Its table maps the type names of scene files to procedurals.
//
// To add a procedural: create a folder, write a function that fills a MarramProcedural, and add it to the
// table below.
#include "procedural/erosion/rock.h"
#include "procedural/groom/groom.h"
#include "procedural/groom/imported.h"
#include "procedural/terrain/terrain.h"
#include "procedural/wind/wind.h"

#include <array>
#include <vector>

extern "C" __attribute__((visibility("default"))) const MarramLibrary* marram_library(uint32_t abi) {
    using namespace marram;
    static const std::array procedurals = {
        groom_procedural(),
        strands_procedural(),
        terrain_procedural(),
        rock_procedural(),
    };
    static const std::vector<MarramReportEntry> reports = [] {
        std::vector<MarramReportEntry> list;
        for (const auto entries : {groom_report_entries(), strands_report_entries(), terrain_report_entries(),
                                   rock_report_entries()})
            list.insert(list.end(), entries.begin(), entries.end());
        return list;
    }();
    static const MarramLibrary library{MARRAM_ABI_VERSION,
                                       MARRAM_EMBREE_MAJOR,
                                       sizeof(MarramLibrary),
                                       "marram_procedural",
                                       MARRAM_VERSION,
                                       wind_params().data(),
                                       static_cast<uint32_t>(wind_params().size()),
                                       sizeof(MarramParam),
                                       procedurals.data(),
                                       static_cast<uint32_t>(procedurals.size()),
                                       sizeof(MarramProcedural),
                                       reports.data(),
                                       static_cast<uint32_t>(reports.size()),
                                       sizeof(MarramReportEntry)};
    return abi == MARRAM_ABI_VERSION ? &library : nullptr;
}
