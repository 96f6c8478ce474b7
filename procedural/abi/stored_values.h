// SPDX-License-Identifier: Apache-2.0
// A deep copy of the values passed to create() or update(), for procedurals that read them later.
#pragma once

#include "core/math/known_part.h"
#include "core/plugin/marram_plugin.h"

#include <deque>
#include <span>
#include <string>
#include <vector>

namespace marram {

class StoredValues {
  public:
    StoredValues() = default;
    // The values must already be checked (contract_checks.h).
    explicit StoredValues(std::span<const MarramValue> values) {
        for (MarramValue value : values) {
            value.name = texts_.emplace_back(value.name).c_str();
            value.text = texts_.emplace_back(value.text).c_str();
            value.place = texts_.emplace_back(value.place ? value.place : "").c_str();
            value.numbers = numbers_.emplace_back(value.numbers, value.numbers + value.number_count).data();
            if (value.grid) {
                MarramGrid grid = *value.grid;
                const size_t count = size_t(grid.nx) * grid.ny * grid.nz * grid.components;
                grid.values = pixels_.emplace_back(grid.values, grid.values + count).data();
                grid.name = value.text;
                value.grid = &grids_.emplace_back(grid);
            }
            if (value.placement) value.placement = &placements_.emplace_back(known_part(value.placement));
            if (value.keyframes) {
                MarramKeyframes keys = known_part(value.keyframes);
                keys.frames = numbers_.emplace_back(keys.frames, keys.frames + keys.count).data();
                keys.numbers =
                    numbers_.emplace_back(keys.numbers, keys.numbers + keys.count * value.number_count)
                        .data();
                keys.interpolation = texts_.emplace_back(keys.interpolation).c_str();
                value.keyframes = &keyframes_.emplace_back(keys);
            }
            values_.push_back(value);
        }
    }
    StoredValues(StoredValues&&) = default;
    StoredValues& operator=(StoredValues&&) = default;
    StoredValues(const StoredValues&) = delete;

    std::span<const MarramValue> all() const { return values_; }

  private:
    // Deques keep their elements at fixed addresses.
    std::vector<MarramValue> values_;
    std::deque<std::string> texts_;
    std::deque<std::vector<double>> numbers_;
    std::deque<std::vector<float>> pixels_;
    std::deque<MarramGrid> grids_;
    std::deque<MarramPlacement> placements_;
    std::deque<MarramKeyframes> keyframes_;
};

} // namespace marram
