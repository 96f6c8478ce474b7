// SPDX-License-Identifier: Apache-2.0
// Shared by readers of USD layers (usda.h): values of a given type, and transforms of prims. All throw
// InputError with the place in the file.
#pragma once

#include "core/math/vec.h"
#include "core/read/mesh_reader.h"
#include "core/read/usda/usda.h"

#include <fmt/format.h>

#include <initializer_list>
#include <optional>

namespace marram {

// For column vectors: p' = M p. USD writes matrices for row vectors, p' = p M.
using UsdaTransform = Eigen::Matrix4d;

class UsdaScene {
  public:
    UsdaScene(const std::string& path, std::string_view bytes); // reads the layer; keeps references to both
    const UsdaLayer& layer() const { return layer_; }
    const UsdaTransform& root() const { return root_; } // upAxis and metersPerUnit

    // The value for every time, else the earliest sample; nullptr if there is none. Throws InputError if it
    // has another type.
    template <typename Elements>
    const Elements* elements(const UsdaPrim& prim, std::string_view name, size_t* at = nullptr,
                             std::string_view* interpolation = nullptr) const;
    std::string_view choice(const UsdaPrim& prim, std::string_view name, std::string_view otherwise,
                            std::initializer_list<std::string_view> known) const;

    // The transform by a prim's xformOpOrder, below `above`. With a time: samples are interpolated linearly,
    // quaternions by slerp; constant before the first and after the last. Without: as elements().
    UsdaTransform transform_of(const UsdaPrim& prim, const UsdaTransform& above,
                               std::optional<double> time = {}) const;
    // Times at which its ops have samples.
    std::vector<double> transform_times(const UsdaPrim& prim) const;

    Place place(size_t at) const { return place_of(path_, bytes_, at); }
    [[noreturn]] void fail(size_t at, const std::string& what, const std::string& fix) const {
        throw InputError(place(at), what, fix);
    }

  private:
    UsdaTransform op_of(const UsdaPrim& prim, std::string_view op, std::optional<double> time) const;
    std::optional<std::vector<double>> op_numbers(const UsdaPrim& prim, std::string_view op,
                                                  std::optional<double> time, size_t& at) const;

    const std::string& path_;
    std::string_view bytes_;
    UsdaLayer layer_;
    UsdaTransform root_ = UsdaTransform::Identity();
};

// True for a "def" prim that is active.
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
