// SPDX-License-Identifier: Apache-2.0
// The library's entry point. Its table maps the type names of scene files to procedurals.
//
// To add a procedural: write a class with the members that entry_points.h asks for, in a folder of its own,
// and add it to the list below.
#include "procedural/abi/entry_points.h"
#include "procedural/loaded_rock.h"
#include "procedural/strands/grown/groom_instance.h"
#include "procedural/strands/imported/imported_instance.h"
#include "procedural/terrain/terrain_instance.h"
#include "procedural/wind/wind.h"

#include <array>
#include <vector>

namespace marram {
namespace {

template <typename... Procedurals>
struct ProceduralList {
    static constexpr size_t count = sizeof...(Procedurals);
    static std::array<MarramProcedural, count> tables() { return {Procedurals::table()...}; }
    static std::vector<MarramReportEntry> report_entries() {
        std::vector<MarramReportEntry> list;
        const auto add = [&](std::span<const MarramReportEntry> entries) {
            for (const MarramReportEntry& entry : entries) list.push_back(entry);
        };
        (add(Procedurals::Declaration::report_entries()), ...);
        return list;
    }
};

using All = ProceduralList<EntryPoints<GroomInstance>, EntryPoints<ImportInstance>,
                           EntryPoints<TerrainInstance>, LoadedRock>;

} // namespace
} // namespace marram

extern "C" __attribute__((visibility("default"))) const MarramLibrary* marram_library(uint32_t abi) {
    using namespace marram;
    static const std::array procedurals = All::tables();
    static const std::vector<MarramReportEntry> reports = All::report_entries();
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
                                       sizeof(MarramReportEntry),
                                       wind_help};
    return abi == MARRAM_ABI_VERSION ? &library : nullptr;
}
