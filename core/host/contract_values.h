// SPDX-License-Identifier: Apache-2.0
// A procedural's parameter values in the contract's form, with the contents of the files that they name.
#pragma once

#include "core/geometry/attribute_values.h"
#include "core/host/plugin_library.h"
#include "core/host/volume_value.h"
#include "core/image/image.h"
#include "core/math/problem.h"

#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace marram {

// Geometry that a parameter names.
struct GeometryName {
    std::string name;
    Place place;
};

// Attributes of the scene's curves, without values, by the curves' name.
using CurveAttributes = std::map<std::string, std::vector<AttributeValues>>;

class ContractValues {
  public:
    // Takes the item's values; wind parameters that it does not set come from the scene's wind. Throws
    // InputError if a file cannot be read. `curves` must outlive this object.
    ContractValues(const ProceduralType& type, const Item& item, const ParamSet& wind,
                   const CurveAttributes& curves);

    MarramValues list() const; // points into this object
    // One line for each image with holes or values that stand alone (core/image/data_image.h), with its
    // place.
    const std::vector<Problem>& warnings() const { return warnings_; }
    // Of the values, which point to them: to be kept as long as the contract says (MarramVolume).
    const std::vector<std::shared_ptr<const VolumeValue>>& volumes() const { return volumes_; }
    // Digest of names, values and file contents, without places.
    uint64_t digest() const;
    // The names in values of a type, each once, with their places in the scene.
    std::vector<GeometryName> names_of(MarramParamType type) const;

  private:
    void add(const MarramParam& param, std::string name, const ParamValue& value);
    const MarramKeyframes* keyframes(const Keyframes& keys);
    void add_param(const MarramParam& param, const Item& item, const ParamSet& wind);
    const MarramGrid* image(const ParamValue& value);
    const MarramPlacement* placement(const ParamValue& value); // nullptr if the image's file does not say
    const MarramGrid* table(const ParamValue& value, MarramValue& out);
    void add_attributes(MarramValue& out);

    const CurveAttributes& curves_;
    std::vector<Problem> warnings_;
    std::vector<MarramValue> values_;
    std::deque<std::string> texts_;
    std::deque<std::vector<float>> numbers_;
    std::deque<Image> images_;
    std::map<std::string, const MarramGrid*> image_grids_; // by file
    std::deque<MarramGrid> grids_;
    std::deque<MarramPlacement> placements_;
    std::vector<std::shared_ptr<const VolumeValue>> volumes_;
    std::deque<MarramKeyframes> keyframes_;
    std::string type_name_; // of the procedural
    std::deque<std::vector<MarramAttribute>> attributes_;
};

} // namespace marram
