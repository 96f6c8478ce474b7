// SPDX-License-Identifier: Apache-2.0
// The table of layer types. To add one, write its file and add a line here.
#include "procedural/abi/param.h"
#include "procedural/terrain/base_layers.h"
#include "procedural/terrain/dune/dune_layer.h"
#include "procedural/terrain/layer_types.h"
#include "procedural/terrain/mask_layer.h"
#include "procedural/terrain/mass/mass_desert.h"
#include "procedural/terrain/mesh/fusion.h"
#include "procedural/terrain/mesh/lattice.h"
#include "procedural/terrain/ruin/ruin.h"
#include "procedural/terrain/sand/ripples.h"
#include "procedural/terrain/sand/stones.h"
#include "procedural/terrain/solver/dune_solver_layer.h"

#include <array>

namespace marram {

std::span<const LayerType> layer_types() {
    static const std::array types = {
        flat_layer_type(),   noise_layer_type(),   image_layer_type(),   mask_layer_type(),
        dune_layer_type(),   lattice_layer_type(), ripples_layer_type(), mass_desert_layer_type(),
        fusion_layer_type(), ruin_layer_type(),    stones_layer_type(),  dune_solver_layer_type(),
    };
    return types;
}

const LayerType* find_layer_type(std::string_view name) {
    for (const LayerType& type : layer_types())
        if (type.name == name) return &type;
    return nullptr;
}

std::span<const MarramItemType> layer_item_types() {
    // Parameters of every layer type, before its own.
    static constexpr std::array common = {
        param::text("name", "none", "for masks, edits and reports; absent: its type"),
        param::boolean("on", "true", "false: the layer is ignored"),
    };
    static const std::vector<std::vector<MarramParam>> params = [] {
        std::vector<std::vector<MarramParam>> lists;
        for (const LayerType& type : layer_types()) {
            std::vector<MarramParam>& list = lists.emplace_back(common.begin(), common.end());
            list.insert(list.end(), type.params.begin(), type.params.end());
        }
        return lists;
    }();
    static const std::vector<MarramItemType> items = [] {
        std::vector<MarramItemType> list;
        for (size_t t = 0; t < params.size(); ++t) {
            const LayerType& type = layer_types()[t];
            list.push_back({"layer", type.name, type.help, params[t].data(), uint32_t(params[t].size()),
                            sizeof(MarramParam)});
        }
        return list;
    }();
    return items;
}

} // namespace marram
