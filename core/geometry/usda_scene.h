// SPDX-License-Identifier: Apache-2.0
// What readers of USD layers (usda.h) share: values by what they ought to hold, and where prims stand. All throw InputError with the
// place in the file.
#pragma once

#include "core/geometry/mesh_reader.h"
#include "core/geometry/usda.h"
#include "core/math/vec.h"

#include <fmt/format.h>

#include <initializer_list>
#include <optional>

namespace marram {

// Columns are images of the axes: p' = M p. USD writes matrices for rows, p' = p M.
using UsdaPlacing = Eigen::Matrix4d;

class UsdaScene {
  public:
    UsdaScene(const std::string& path, std::string_view bytes); // reads; borrows both
    const UsdaLayer& layer() const { return layer_; }
    const UsdaPlacing& root() const { return root_; } // upAxis and metersPerUnit

    // nullptr where the prim does not say; a fault where what it says is of another kind. For every time, else the earliest sample.
    template <typename Elements>
    const Elements* elements(const UsdaPrim& prim, std::string_view name, size_t* at = nullptr,
                             std::string_view* interpolation = nullptr) const;
    std::string_view choice(const UsdaPrim& prim, std::string_view name, std::string_view otherwise,
                            std::initializer_list<std::string_view> known) const;

    // A prim's xformOpOrder, below `above`. With a time: between samples numbers go straight, quaternions along the sphere; before the
    // first and behind the last they rest. Without: as elements().
    UsdaPlacing placing_of(const UsdaPrim& prim, const UsdaPlacing& above,
                           std::optional<double> time = {}) const;
    // When its ops have samples.
    std::vector<double> placing_times(const UsdaPrim& prim) const;

    [[noreturn]] void fail(size_t at, const std::string& what, const std::string& fix) const {
        throw InputError(place_of(path_, bytes_, at), what, fix);
    }

  private:
    UsdaPlacing op_of(const UsdaPrim& prim, std::string_view op, std::optional<double> time) const;
    std::optional<std::vector<double>> op_numbers(const UsdaPrim& prim, std::string_view op,
                                                  std::optional<double> time, size_t& at) const;

    const std::string& path_;
    std::string_view bytes_;
    UsdaLayer layer_;
    UsdaPlacing root_ = UsdaPlacing::Identity();
};

// A prim that is there: a "def" that is active.
bool is_usda_def(const UsdaPrim& prim);

template <typename Elements>
const Elements* UsdaScene::elements(const UsdaPrim& prim, std::string_view name, size_t* at,
                                    std::string_view* interpolation) const {
    const UsdaAttribute* of = nullptr;
    const UsdaValue* value = prim.find(name, &of);
    if (!value) return nullptr;
    if (at) *at = of->at;
    if (interpolation) *interpolation = prim.metadata_of(name, "interpolation");
    const Elements* found = std::get_if<Elements>(value);
    if (!found) fail(of->at, fmt::format("\"{}\" has the type {}", name, of->type), "export the curves anew");
    return found;
}

} // namespace marram
