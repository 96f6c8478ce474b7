// SPDX-License-Identifier: Apache-2.0
// A loaded procedural library: its declarations, as far as this version of the contract knows them. For a
// procedural in a scene see core/host/plugin_host.h.
#pragma once

#include "core/host_values/declarations.h"
#include "core/plugin/marram_plugin.h"

#include <string>
#include <vector>

namespace marram {

class PluginLibrary {
  public:
    // Throws InputError, placed at `place`, for a file that is not a library, has no entry point, has another
    // ABI version, or was built with another Embree.
    PluginLibrary(const std::string& path, const Place& place);
    ~PluginLibrary();
    PluginLibrary(const PluginLibrary&) = delete;
    PluginLibrary& operator=(const PluginLibrary&) = delete;

    const std::string& path() const { return path_; }
    const std::string& name() const { return name_; } // declared by the library
    const std::string& version() const { return version_; }
    const std::vector<ProceduralType>& types() const { return types_; }
    const std::vector<MarramParam>& wind_params() const { return wind_params_; }
    const std::string& wind_help() const { return wind_help_; }
    const std::vector<MarramReportEntry>& report_entries() const { return report_entries_; }
    const ProceduralType* find(const std::string& type) const; // nullptr if the library has no such type

  private:
    void read(const Place& place);

    std::string path_, name_, version_;
    void* handle_ = nullptr;
    std::vector<ProceduralType> types_;
    std::vector<MarramParam> wind_params_;
    std::string wind_help_;
    std::vector<MarramReportEntry> report_entries_;
};

// Declarations of a library in the form of the scene checker. In procedurals the wind's parameters are
// optional: those not set come from the scene's [wind]; a list of tables of its own replaces the scene's.
std::vector<ParamSpec> wind_specs(const PluginLibrary& library);
std::vector<ItemSchema> procedural_schemas(const PluginLibrary& library);

inline constexpr std::string_view wind_prefix = "wind.";

} // namespace marram
