// SPDX-License-Identifier: Apache-2.0
// A procedural library, loaded: what it declares, as far as this version of the contract knows it. What a procedural of it does in a
// scene is core/geometry/plugin_host.h.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "core/scene/description.h"

#include <string>
#include <vector>

namespace marram {

// A list of tables whose elements have types of their own, and one of these types.
struct ProceduralItemType {
    MarramItemType item{};
    std::vector<MarramParam> params;
};

// A procedural as it is declared. Pointers lead into the library.
struct ProceduralType {
    MarramProcedural calls{};
    std::vector<MarramParam> params;
    std::vector<MarramAttribute> attributes; // that every instance has
    std::vector<ProceduralItemType> item_types;
    std::string unusable; // why this version cannot host it: "" where it can
};

class PluginLibrary {
  public:
    // Throws InputError, placed at `place`, for a file that is not a library, has no entry point, speaks another ABI, or was built with
    // another Embree.
    PluginLibrary(const std::string& path, const Place& place);
    ~PluginLibrary();
    PluginLibrary(const PluginLibrary&) = delete;
    PluginLibrary& operator=(const PluginLibrary&) = delete;

    const std::string& path() const { return path_; }
    const std::string& name() const { return name_; } // its own
    const std::string& version() const { return version_; }
    const std::vector<ProceduralType>& types() const { return types_; }
    const std::vector<MarramParam>& wind_params() const { return wind_params_; }
    const std::vector<MarramReportEntry>& report_entries() const { return report_entries_; }
    const ProceduralType* find(const std::string& type) const; // nullptr where the library has no such type

  private:
    void read(const Place& place);

    std::string path_, name_, version_;
    void* handle_ = nullptr;
    std::vector<ProceduralType> types_;
    std::vector<MarramParam> wind_params_;
    std::vector<MarramReportEntry> report_entries_;
};

// Declarations of a library as the scene checker wants them. In procedurals the wind's parameters stand as optional ones: what
// a procedural does not say itself is taken from the scene's [wind]; a list of tables of its own replaces the scene's.
std::vector<ParamSpec> wind_specs(const PluginLibrary& library);
std::vector<ItemSchema> procedural_schemas(const PluginLibrary& library);

inline constexpr std::string_view wind_prefix = "wind.";

} // namespace marram
