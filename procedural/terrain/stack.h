// SPDX-License-Identifier: Apache-2.0
// A stack of layers, evaluated tile by tile, that keeps what each layer wrote: an edit evaluates again only the tiles that it touches,
// from the first layer that differs, grown by the reach of each layer above.
//
// Memory: a layer keeps 8 bytes a sample where it writes sand, 4 where it writes bedrock, 4 for each mask.
#pragma once

#include "procedural/terrain/layer.h"

#include <cstdlib>

namespace marram {

// A layer and what it is made from.
struct StackLayer {
    std::string type;
    uint64_t digest = 0; // of its values and inputs: two of the same type and digest are the same layer
    std::shared_ptr<const Layer> layer;
};

class Stack {
  public:
    // What evaluate() did to one layer.
    struct Work {
        int tiles = 0; // evaluated
        double seconds = 0.0;
    };

    explicit Stack(const Domain& domain);

    // The layer at that position now, where it has this type (and digest).
    std::shared_ptr<const Layer> find(size_t index, const std::string& type) const;
    std::shared_ptr<const Layer> find(size_t index, const std::string& type, uint64_t digest) const;

    // Other layers, bottom to top. Nothing is computed yet.
    void set_layers(std::vector<StackLayer> layers);

    // Brings all layers up to date. false: cancelled; what is missing is done by the next call.
    bool evaluate(const std::function<bool()>& cancelled);

    const Domain& domain() const { return domain_; }
    // Where the terrain above all layers may have changed since this was last asked. Valid after evaluate().
    Tiles take_changed();
    // The terrain above all layers, or above those below `layer`. Valid after evaluate().
    Fields fields() const { return fields(entries_.size()); }
    Fields fields(size_t layer) const;
    std::vector<Work> work() const;
    const std::string& type(size_t layer) const { return entries_[layer].made.type; }
    const Layer& layer(size_t index) const { return *entries_[index].made.layer; }
    // What the layer said when it was last evaluated as a whole.
    const LayerNotes& notes(size_t layer) const { return entries_[layer].notes; }
    size_t bytes() const;
    uint64_t digest() const; // of what the layers are made from

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
        std::vector<MaskView> views; // of all masks up to and with this layer
        Work work;
        LayerNotes notes;
    };

    void allocate(Entry& entry);
    LayerOutput output(Entry& entry, std::vector<float*>& masks) const;
    bool evaluate(size_t index, const std::function<bool()>& cancelled);

    Domain domain_;
    Buffer<float> flat_; // zeros: pages that are only read take no memory
    Buffer<SandUnits> bare_;
    std::vector<Entry> entries_;
    Tiles changed_;
};

} // namespace marram
