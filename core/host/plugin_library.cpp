// SPDX-License-Identifier: Apache-2.0
#include "core/host/plugin_library.h"

#include "core/math/known_part.h"
#include "core/scene/param_types.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <new>

namespace marram {
namespace {

// Empty if this program does not know the type.
std::optional<ParamType> type_of(const MarramParam& param) {
    const MarramTypeForm* form = marram_type_form(param.type);
    return form ? param_type_of(form->name) : std::nullopt;
}

bool is_known(const MarramParam& param) { return type_of(param).has_value(); }

ParamSpec spec_of(const MarramParam& param) {
    ParamSpec spec{param.name,    type_of(param).value_or(ParamType::unavailable),
                   param.unit,    param.initial,
                   param.minimum, param.maximum,
                   param.choices, param.help};
    // The name may be that of a procedural, which makes a mesh or curves.
    if (param.type == MARRAM_MESH_NAME) {
        spec.each = spec.choices == "each";
        spec.choices = "mesh|procedural";
    }
    if (param.type == MARRAM_CURVES_NAME) spec.choices = "curves|procedural";
    if (param.sweep) spec.sweep = param.sweep;
    if (param.sweep_time) spec.sweep_time = param.sweep_time;
    return spec;
}

std::vector<ParamSpec> specs_of(const std::vector<MarramParam>& params) {
    std::vector<ParamSpec> specs;
    for (const MarramParam& param : params) specs.push_back(spec_of(param));
    return specs;
}

// True if no text is NULL: others read them without a check.
bool has_all_texts(const MarramParam& param) {
    return param.name && param.unit && param.initial && param.choices && param.help;
}

std::string unusable_because(const ProceduralType& type) {
    const MarramProcedural& calls = type.calls;
    const auto stride_is_wrong = [](uint32_t count, uint32_t stride) { return count > 0 && stride == 0; };
    if (stride_is_wrong(calls.param_count, calls.param_stride) ||
        stride_is_wrong(calls.attribute_count, calls.attribute_stride) ||
        stride_is_wrong(calls.item_type_count, calls.item_type_stride))
        return "it has an array whose stride is 0";
    if (!std::ranges::all_of(type.params, has_all_texts)) return "a text of its parameters is NULL";
    for (const ProceduralItemType& item : type.item_types)
        if (!item.item.list || !item.item.type || !item.item.help ||
            !std::ranges::all_of(item.params, has_all_texts))
            return "a text of its lists is NULL";
    for (const MarramAttribute& attribute : type.attributes)
        if (!attribute.name || !attribute.help) return "a text of its attributes is NULL";
    const auto is_each = [](const MarramParam& param) {
        return param.type == MARRAM_MESH_NAME && std::string_view(param.choices) == "each";
    };
    if (std::ranges::count_if(type.params, is_each) > 1)
        return "more than one of its parameters stands for one instance each";
    const auto unknown = [](const std::vector<MarramParam>& params) -> std::string {
        const auto found = std::ranges::find_if_not(params, is_known);
        return found == params.end()
                   ? ""
                   : fmt::format(
                         "its parameter {} has a type that this version of the contract does not know",
                         found->name);
    };
    if (std::string why = unknown(type.params); !why.empty()) return why;
    for (const ProceduralItemType& item : type.item_types)
        if (std::string why = unknown(item.params); !why.empty()) return why;
    const bool curves = calls.kind == MARRAM_CURVES;
    if (!curves && calls.kind != MARRAM_MESH)
        return "its output is of a kind that this version of the contract does not know";
    if (!calls.create || !calls.begin || !calls.destroy || (curves && (!calls.patch || !calls.tessellate)) ||
        (!curves && !calls.mesh) || (!calls.begin_view != !calls.view_mesh))
        return "it lacks a function that the contract asks for";
    return "";
}

ProceduralType read_type(const MarramProcedural& calls) {
    ProceduralType type;
    type.calls = calls;
    type.params = known_parts(calls.params, calls.param_count, calls.param_stride);
    type.attributes = known_parts(calls.attributes, calls.attribute_count, calls.attribute_stride);
    for (const MarramItemType& item :
         known_parts(calls.item_types, calls.item_type_count, calls.item_type_stride))
        type.item_types.push_back({item, known_parts(item.params, item.param_count, item.param_stride)});
    type.unusable = unusable_because(type);
    return type;
}

// Parameters that the host adds: the material, and the roles of a procedural that makes a mesh.
std::vector<ParamSpec> host_params(const MarramProcedural& calls) {
    std::vector<ParamSpec> params = {
        {"material", ParamType::reference, "", "none", {}, {}, "material", "default: a plain grey"}};
    if (calls.kind == MARRAM_MESH) std::ranges::move(role_params(), std::back_inserter(params));
    return params;
}

std::vector<ListSchema> lists_of(const ProceduralType& type) {
    std::vector<ListSchema> lists;
    for (const ProceduralItemType& item : type.item_types) {
        auto list = std::ranges::find(lists, item.item.list, &ListSchema::name);
        if (list == lists.end()) {
            lists.push_back({item.item.list, {}, {}});
            list = std::prev(lists.end());
        }
        list->types.push_back({item.item.type, item.item.help, specs_of(item.params)});
    }
    for (ListSchema& list : lists) {
        list.type = {"type", ParamType::choice, "", "", {}, {}, "", "what this one is"};
        for (const ItemSchema& one : list.types)
            list.type.choices += (list.type.choices.empty() ? "" : "|") + one.type;
    }
    return lists;
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
    const std::string fix = "build it against core/plugin/marram_plugin.h of this version";
    if (!entry) throw InputError(place, "'" + path_ + "' has no function " MARRAM_ENTRY_POINT, fix);
    const MarramLibrary* given = entry(MARRAM_ABI_VERSION);
    if (!given || given->abi != MARRAM_ABI_VERSION) {
        const std::string found = given ? " " + std::to_string(given->abi) : "";
        throw InputError(place,
                         "'" + path_ + "' speaks another version" + found + " of the contract than " +
                             std::to_string(MARRAM_ABI_VERSION),
                         fix);
    }
    if (given->embree_major != 0 && given->embree_major != MARRAM_EMBREE_MAJOR)
        throw InputError(place,
                         fmt::format("'{}' was built with Embree {}, this renderer with Embree {}", path_,
                                     given->embree_major, MARRAM_EMBREE_MAJOR),
                         "build both with one Embree");
    if (!is_sized(given)) throw InputError(place, "'" + path_ + "' has not set MarramLibrary.size", fix);
    const MarramLibrary library = known_part(given);
    name_ = library.name ? library.name : "";
    version_ = library.version ? library.version : "";
    if ((library.wind_param_count > 0 && library.wind_param_stride == 0) ||
        (library.procedural_count > 0 && library.procedural_stride == 0) ||
        (library.report_entry_count > 0 && library.report_entry_stride == 0))
        throw InputError(place, "'" + path_ + "' has an array whose stride is 0",
                         "give the size of its elements");
    wind_params_ = known_parts(library.wind_params, library.wind_param_count, library.wind_param_stride);
    std::erase_if(wind_params_,
                  [](const MarramParam& param) { return !is_known(param) || !has_all_texts(param); });
    report_entries_ =
        known_parts(library.report_entries, library.report_entry_count, library.report_entry_stride);
    for (const MarramProcedural& calls :
         known_parts(library.procedurals, library.procedural_count, library.procedural_stride)) {
        if (!calls.name || !calls.help)
            throw InputError(place, "'" + path_ + "' has a procedural without a name or help",
                             "fix the library");
        types_.push_back(read_type(calls));
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
