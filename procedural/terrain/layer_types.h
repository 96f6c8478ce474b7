// SPDX-License-Identifier: Apache-2.0
// The kinds of layers, by the name that a scene gives as [[procedural.layer]] type = "...", and what a layer is made from.
#pragma once

#include "procedural/terrain/layer.h"
#include "procedural/terrain/simulation.h"
#include "procedural/values.h"

#include <span>
#include <string>

namespace marram {

// The values of one element of the list of layers.
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

// A drawn curve as it came from the scene.
struct DrawnCurve {
    std::vector<Vec3d> points;
    bool closed = false;
};

// What a layer is made from besides its values.
struct LayerContext {
    const LayerValues& values;
    Domain domain;
    Vec2d wind = Vec2d(1.0, 0.0);   // unit: where the scene's wind goes to, x and z
    uint64_t seed = 0;              // of the terrain
    std::vector<std::string> masks; // that the layers below hand out
    // The curves of that name; one that is not there is a SceneFault.
    std::function<std::vector<DrawnCurve>(std::string_view name)> curves;
    // The mesh of that name, at the first motion sample of the frame, and the scene in which rays meet it under its geometry_id, with the
    // mask MARRAM_NAMED; one that is not there is a SceneFault. Both live as long as the layer is being made.
    std::function<const MarramMesh&(std::string_view name)> mesh;
    RTCScene scene = nullptr;
    std::function<void(const std::string& place, const std::string& what, const std::string& remedy)> warn;
    double frame = 0.0;               // of a layer that evolves
    double wind_speed = 0.0;          // the scene's, m/s
    Simulation* simulation = nullptr; // states of earlier frames; outlives the layer; NULL: none
    const Layer* before = nullptr;    // of this type, at this place of the stack until now; NULL: none
};

struct LayerType {
    const char* name;
    const char* help;
    std::span<const MarramParam> params; // without those that all layers have (layers.cpp)
    // Throws SceneFault where the values make no sense together.
    std::unique_ptr<Layer> (*make)(const LayerContext& context);
    // The masks that it will hand out, for what is declared before anything is made. NULL: none.
    std::vector<std::string> (*masks)(const LayerValues& values) = nullptr;
    bool evolves = false; // with the frame, from a state of its past
};

std::span<const LayerType> layer_types();
const LayerType* find_layer_type(std::string_view name);

// The declarations for MarramProcedural.item_types.
std::span<const MarramItemType> layer_item_types();

} // namespace marram
