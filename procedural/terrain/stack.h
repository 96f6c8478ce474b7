// SPDX-License-Identifier: Apache-2.0
// A stack of layers, evaluated tile by tile. It caches the output of each layer. An edit re-evaluates only
// the affected tiles, from the first changed layer up; each layer above grows the set of tiles by its reach.
//
// Memory a sample: 8 bytes for each layer that writes sand, 4 for each layer that writes bedrock, 4 for each
// mask.
#pragma once

#include "procedural/terrain/layer.h"

#include <cstdlib>

namespace marram {

// A layer with the type and digest of its inputs.
struct StackLayer {
    std::string type;
    uint64_t digest = 0; // of its values and inputs; same type and digest: same layer
    std::shared_ptr<const TerrainLayer> layer;
};

class Stack {
  public:
    // Work of the last evaluate() for one layer.
    struct Work {
        int tiles = 0; // evaluated
        double seconds = 0.0;
    };

    explicit Stack(const Domain& domain);

    // The current layer at this index if it has this type (and digest), else NULL.
    std::shared_ptr<const TerrainLayer> find(size_t index, const std::string& type) const;
    std::shared_ptr<const TerrainLayer> find(size_t index, const std::string& type, uint64_t digest) const;

    // Replaces the layers, bottom to top. Evaluates nothing.
    void set_layers(std::vector<StackLayer> layers);

    // Brings all layers up to date. Returns false if cancelled; the next call completes the rest.
    bool evaluate(const std::function<bool()>& cancelled);

    const Domain& domain() const { return domain_; }
    // Tiles whose final terrain may have changed since the last call. Valid after evaluate().
    Tiles take_changed();
    // The terrain after all layers, or the input of `layer`. Valid after evaluate().
    Fields fields() const { return fields(entries_.size()); }
    Fields fields(size_t layer) const;
    std::vector<Work> work() const;
    const std::string& type(size_t layer) const { return entries_[layer].made.type; }
    const TerrainLayer& layer(size_t index) const { return *entries_[index].made.layer; }
    // Notes of the last evaluate_whole() of the layer.
    const LayerNotes& notes(size_t layer) const { return entries_[layer].notes; }
    size_t bytes() const;
    uint64_t digest() const; // of the types and inputs of all layers

  private:
    template <typename T>
    struct Free {
        void operator()(T* memory) const { std::free(memory); }
    };
    template <typename T>
    using Buffer = std::unique_ptr<T[], Free<T>>;

    struct Entry {
        StackLayer made;
        Tiles stale; // tiles to evaluate
        Buffer<float> bedrock;
        Buffer<SandUnits> sand;
        std::vector<Buffer<float>> masks;
        std::vector<MaskView> views; // all masks up to and including this layer
        Work work;
        LayerNotes notes;
    };

    void allocate(Entry& entry);
    LayerOutput output(Entry& entry, std::vector<float*>& masks) const;
    bool evaluate(size_t index, const std::function<bool()>& cancelled);

    Domain domain_;
    Buffer<float> flat_; // zeros from calloc: pages that are only read use no physical memory
    Buffer<SandUnits> bare_;
    std::vector<Entry> entries_;
    Tiles changed_;
};

} // namespace marram
