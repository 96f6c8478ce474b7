// SPDX-License-Identifier: Apache-2.0
// TerrainLayer types by the scene's name, [[procedural.layer]] type = "...", and the inputs that create a
// layer.
#pragma once

#include "procedural/abi/values.h"
#include "procedural/air/guides.h"
#include "procedural/terrain/layer.h"
#include "procedural/terrain/simulation.h"

#include <span>
#include <string>

namespace marram {

// The parameter values of one element of the layer list.
class LayerValues {
  public:
    LayerValues(const Values& all, int index) : all_(all), prefix_("layer[" + std::to_string(index) + "].") {}

    bool has(std::string_view name) const { return all_.has(full(name)); }
    const MarramValue& at(std::string_view name) const { return all_.at(full(name)); }
    double number(std::string_view name) const { return at(name).numbers[0]; }
    int integer(std::string_view name) const { return int(at(name).numbers[0]); }
    bool boolean(std::string_view name) const { return at(name).numbers[0] != 0.0; }
    Vec2d vec2(std::string_view name) const { return Vec2d(at(name).numbers); }
    std::string text(std::string_view name) const { return at(name).text; }
    std::string place(std::string_view name) const { return at(name).place; }
    Ramp ramp(std::string_view name) const { return all_.ramp(full(name)); }

  private:
    std::string full(std::string_view name) const { return prefix_ + std::string(name); }
    const Values& all_;
    std::string prefix_;
};

// Inputs that create a layer, besides its values.
struct LayerContext {
    const LayerValues& values;
    Domain domain;
    Vec2d wind = Vec2d(1.0, 0.0);   // unit: the direction in which the scene's wind blows, x and z
    uint64_t seed = 0;              // of the terrain
    std::vector<std::string> masks; // output masks of the layers below
    // The curves with that name. Throws SceneFault if there are none.
    std::function<std::vector<DrawnCurve>(std::string_view name)> curves;
    // The mesh with that name, at the frame's first motion sample. Throws SceneFault if there is none.
    // `scene` holds it under its geometry_id, with the ray mask MARRAM_NAMED. Both are valid only while the
    // layer is created.
    std::function<const MarramMesh&(std::string_view name)> mesh;
    RTCScene scene = nullptr;
    std::function<void(const std::string& place, const std::string& what, const std::string& remedy)> warn;
    double frame = 0.0;                   // for types with `evolves`
    double wind_speed = 0.0;              // the scene's, m/s; 0 if its direction is vertical
    const MarramValue* record = nullptr;  // the scene's wind.record; may be NULL
    bool steady_wind = true;              // false: it is vertical, or a record has its directions
    Simulation* simulation = nullptr;     // states of earlier frames; outlives the layer; may be NULL
    const TerrainLayer* before = nullptr; // the layer of this type that it replaces in the stack; may be NULL
};

struct LayerType {
    const char* name;
    const char* help;
    std::span<const MarramParam> params; // without those common to all layers (layers.cpp)
    // Throws SceneFault if the values are inconsistent.
    std::unique_ptr<TerrainLayer> (*make)(const LayerContext& context);
    // Names of its output masks, known before the layer is created. NULL: none.
    std::vector<std::string> (*masks)(const LayerValues& values) = nullptr;
    bool evolves = false; // simulated from frame to frame
};

std::span<const LayerType> layer_types();
const LayerType* find_layer_type(std::string_view name);

// The declarations for MarramProcedural.item_types.
std::span<const MarramItemType> layer_item_types();

} // namespace marram
