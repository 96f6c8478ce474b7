// SPDX-License-Identifier: Apache-2.0
#include "core/host_values/declarations.h"

#include "core/math/known_part.h"
#include "core/scene/param_types.h"

#include <fmt/format.h>

#include <algorithm>

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
    spec.keyable = param.keyable != 0;
    return spec;
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
    if ((calls.param_count > 0 && !calls.params) || (calls.attribute_count > 0 && !calls.attributes) ||
        (calls.item_type_count > 0 && !calls.item_types))
        return "it has an array that is NULL";
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

} // namespace

std::optional<Problem> library_fault(const MarramLibrary* given, uint32_t embree_major) {
    const auto fault = [](std::string what, const char* fix) { return Problem{{}, std::move(what), fix}; };
    if (!given || given->abi != MARRAM_ABI_VERSION)
        return fault(fmt::format("speaks another version{} of the contract than {}",
                                 given ? fmt::format(" {}", given->abi) : "", MARRAM_ABI_VERSION),
                     "build both with one marram_plugin.h");
    if (given->embree_major != 0 && given->embree_major != embree_major)
        return fault(fmt::format("was built with Embree {}, this host with Embree {}", given->embree_major,
                                 embree_major),
                     "build both with one Embree");
    if (!is_sized(given)) return fault("has not set MarramLibrary.size", "set it to the size of the struct");
    const MarramLibrary library = known_part(given);
    if ((library.wind_param_count > 0 && library.wind_param_stride == 0) ||
        (library.procedural_count > 0 && library.procedural_stride == 0) ||
        (library.report_entry_count > 0 && library.report_entry_stride == 0))
        return fault("has an array whose stride is 0", "give the size of its elements");
    return {};
}

ProceduralType known_type(const MarramProcedural& calls) {
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

bool is_usable(const MarramParam& param) { return is_known(param) && has_all_texts(param); }

std::vector<ParamSpec> specs_of(const std::vector<MarramParam>& params) {
    std::vector<ParamSpec> specs;
    for (const MarramParam& param : params) specs.push_back(spec_of(param));
    return specs;
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

MarramParamType contract_type(const ParamSpec& spec) {
    const std::string_view name = row_of(spec.type).contract_name;
    int type = 0;
    while (marram_type_form(MarramParamType(type))->name != name) ++type;
    if (type == MARRAM_MESH_NAME && spec.choices.starts_with("curves")) return MARRAM_CURVES_NAME;
    return MarramParamType(type);
}

} // namespace marram
