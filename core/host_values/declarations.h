// SPDX-License-Identifier: Apache-2.0
// What a library declares, in the form of core/scene: for marram's own host and for libmarram_host.so, so
// that both accept the same values. Throws nothing but std::bad_alloc. Cost: microseconds for each parameter.
#pragma once

#include "core/plugin/marram_plugin.h"
#include "core/scene/description.h"

#include <optional>
#include <string>
#include <vector>

namespace marram {

// An element type of a typed list of tables.
struct ProceduralItemType {
    MarramItemType item{};
    std::vector<MarramParam> params;
};

// Declaration of a procedural. Its pointers point into the library.
struct ProceduralType {
    MarramProcedural calls{};
    std::vector<MarramParam> params;
    std::vector<MarramAttribute> attributes; // of every instance
    std::vector<ProceduralItemType> item_types;
    std::string unusable; // why this version cannot host it; "" if it can
};

// Why a host that was built with this Embree cannot use the library. `what` continues "the library ...";
// there is no place. nullopt: it can.
std::optional<Problem> library_fault(const MarramLibrary* library, uint32_t embree_major);

// Copies a declaration as far as this version of the contract knows it.
ProceduralType known_type(const MarramProcedural& calls);

// Whether its type is known and no text is NULL. The functions below take such parameters only.
bool is_usable(const MarramParam& param);

std::vector<ParamSpec> specs_of(const std::vector<MarramParam>& params);
// The lists whose elements have types.
std::vector<ListSchema> lists_of(const ProceduralType& type);
// The type of the parameter that this was made from by specs_of() or lists_of().
MarramParamType contract_type(const ParamSpec& spec);

} // namespace marram
