// SPDX-License-Identifier: Apache-2.0
#include "core/host/plugin_library.h"

#include "core/math/known_part.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <new>

namespace marram {
namespace {

// Parameters that the host adds: the material, and the roles of a procedural that makes a mesh.
std::vector<ParamSpec> host_params(const MarramProcedural& calls) {
    std::vector<ParamSpec> params = {
        {"material", ParamType::reference, "", "none", {}, {}, "material", "default: a plain grey"}};
    if (calls.kind == MARRAM_MESH) std::ranges::move(role_params(), std::back_inserter(params));
    return params;
}

} // namespace

PluginLibrary::PluginLibrary(const std::string& path, const Place& place) : path_(path) {
    // dlopen would search the system's folders for a bare name.
    const std::string absolute = std::filesystem::absolute(path).string();
    // Never unmapped: when a parallel loop of the library has ended, a worker thread of TBB may still be
    // returning through its code.
    handle_ = dlopen(absolute.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (!handle_) {
        const std::string reason = dlerror();
        if (reason.find("failed to map segment") != std::string::npos ||
            reason.find("annot allocate memory") != std::string::npos)
            throw std::bad_alloc();
        throw InputError(place, "cannot load the procedural library: " + reason,
                         "build it, or correct its path");
    }
    try {
        read(place);
    } catch (...) {
        dlclose(handle_);
        throw;
    }
}

void PluginLibrary::read(const Place& place) {
    const auto entry = reinterpret_cast<MarramLibraryFunction>(dlsym(handle_, MARRAM_ENTRY_POINT));
    if (!entry)
        throw InputError(place, "'" + path_ + "' has no function " MARRAM_ENTRY_POINT,
                         "build it against core/plugin/marram_plugin.h of this version");
    const MarramLibrary* given = entry(MARRAM_ABI_VERSION);
    if (const auto fault = library_fault(given, MARRAM_EMBREE_MAJOR))
        throw InputError(place, "'" + path_ + "' " + fault->what, fault->fix);
    const MarramLibrary library = known_part(given);
    name_ = library.name ? library.name : "";
    version_ = library.version ? library.version : "";
    wind_params_ = known_parts(library.wind_params, library.wind_param_count, library.wind_param_stride);
    std::erase_if(wind_params_, [](const MarramParam& param) { return !is_usable(param); });
    wind_help_ = library.wind_help ? library.wind_help : "";
    report_entries_ =
        known_parts(library.report_entries, library.report_entry_count, library.report_entry_stride);
    for (const MarramProcedural& calls :
         known_parts(library.procedurals, library.procedural_count, library.procedural_stride)) {
        if (!calls.name || !calls.help)
            throw InputError(place, "'" + path_ + "' has a procedural without a name or help",
                             "fix the library");
        types_.push_back(known_type(calls));
    }
    std::erase_if(report_entries_, [](const MarramReportEntry& entry) { return !entry.path || !entry.unit; });
}

PluginLibrary::~PluginLibrary() { dlclose(handle_); }

const ProceduralType* PluginLibrary::find(const std::string& type) const {
    const auto found =
        std::ranges::find_if(types_, [&](const ProceduralType& t) { return type == t.calls.name; });
    return found == types_.end() ? nullptr : &*found;
}

std::vector<ParamSpec> wind_specs(const PluginLibrary& library) { return specs_of(library.wind_params()); }

std::vector<ItemSchema> procedural_schemas(const PluginLibrary& library) {
    std::vector<ItemSchema> schemas;
    for (const ProceduralType& type : library.types()) {
        ItemSchema schema{type.calls.name, type.calls.help, {}};
        schema.unusable = type.unusable;
        if (type.unusable.empty()) {
            schema.params = host_params(type.calls);
            for (ParamSpec& spec : specs_of(type.params)) {
                // Elements of lists keep their defaults: a list replaces the scene's as a whole.
                if (spec.name.starts_with(wind_prefix) && list_of(spec.name).empty()) spec.initial = "none";
                schema.params.push_back(std::move(spec));
            }
            schema.lists = lists_of(type);
        }
        schemas.push_back(std::move(schema));
    }
    return schemas;
}

} // namespace marram
