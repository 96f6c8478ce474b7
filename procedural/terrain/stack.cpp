// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/stack.h"

#include "core/math/clock.h"
#include "core/math/digest.h"
#include "procedural/abi/parallel.h"

#include <atomic>
#include <new>
#include <utility>

namespace marram {

namespace {

// Uses malloc because a vector would zero the memory serially; the layers fill it in parallel.
template <typename T>
T* allocated(size_t count) {
    if (void* memory = std::malloc(std::max<size_t>(count, 1) * sizeof(T))) return static_cast<T*>(memory);
    throw std::bad_alloc();
}

template <typename T>
T* zeros(size_t count) {
    if (void* memory = std::calloc(std::max<size_t>(count, 1), sizeof(T))) return static_cast<T*>(memory);
    throw std::bad_alloc();
}

} // namespace

Stack::Stack(const Domain& domain)
    : domain_(domain), flat_(zeros<float>(domain.count())), bare_(zeros<SandUnits>(domain.count())),
      changed_(domain, true) {}

std::shared_ptr<const TerrainLayer> Stack::find(size_t index, const std::string& type) const {
    return index < entries_.size() && entries_[index].made.type == type ? entries_[index].made.layer
                                                                        : nullptr;
}

std::shared_ptr<const TerrainLayer> Stack::find(size_t index, const std::string& type,
                                                uint64_t digest) const {
    if (index >= entries_.size()) return nullptr;
    const StackLayer& there = entries_[index].made;
    return there.type == type && there.digest == digest ? there.layer : nullptr;
}

void Stack::allocate(Entry& entry) {
    const TerrainLayer::Writes writes = entry.made.layer->writes();
    if (writes.bedrock) entry.bedrock.reset(allocated<float>(domain_.count()));
    if (writes.sand) entry.sand.reset(allocated<SandUnits>(domain_.count()));
    for (size_t m = 0; m < entry.made.layer->mask_names().size(); ++m)
        entry.masks.emplace_back(allocated<float>(domain_.count()));
}

void Stack::set_layers(std::vector<StackLayer> layers) {
    std::vector<Entry> before = std::move(entries_);
    entries_.clear();
    if (layers.size() != before.size()) changed_ = Tiles(domain_, true); // the top layer may be removed
    std::vector<MaskView> views;
    for (size_t k = 0; k < layers.size(); ++k) {
        const StackLayer& given = layers[k];
        // A layer of the same type and index keeps its buffers if it writes the same fields and masks.
        Entry* old = k < before.size() && before[k].made.type == given.type ? &before[k] : nullptr;
        if (old) {
            const TerrainLayer &a = *old->made.layer, &b = *given.layer;
            if (a.writes().sand != b.writes().sand || a.writes().bedrock != b.writes().bedrock ||
                a.mask_names() != b.mask_names())
                old = nullptr;
        }
        Entry entry = old ? std::move(*old) : Entry{};
        if (!old)
            entry.stale = Tiles(domain_, true);
        else if (given.digest != entry.made.digest)
            entry.stale.add(given.layer->changed_since(*entry.made.layer, domain_));
        entry.made = given;
        if (!old) allocate(entry);
        const std::vector<std::string> names = given.layer->mask_names();
        for (size_t m = 0; m < names.size(); ++m) views.push_back({names[m], entry.masks[m].get()});
        entry.views = views;
        entry.work = {};
        entries_.push_back(std::move(entry));
    }
}

Fields Stack::fields(size_t layer) const {
    Fields fields{flat_.get(), bare_.get(), {}};
    for (size_t k = 0; k < layer; ++k) {
        if (entries_[k].bedrock) fields.bedrock = entries_[k].bedrock.get();
        if (entries_[k].sand) fields.sand = entries_[k].sand.get();
        fields.masks = entries_[k].views;
    }
    return fields;
}

LayerOutput Stack::output(Entry& entry, std::vector<float*>& masks) const {
    for (const Buffer<float>& mask : entry.masks) masks.push_back(mask.get());
    return {entry.bedrock.get(), entry.sand.get(), masks, &entry.notes};
}

bool Stack::evaluate(size_t index, const std::function<bool()>& cancelled) {
    Entry& entry = entries_[index];
    const TerrainLayer& layer = *entry.made.layer;
    const Fields below = fields(index);
    std::vector<float*> masks;
    LayerOutput out = output(entry, masks);
    if (!std::isfinite(layer.reach())) {
        entry.notes = {};
        return layer.evaluate_whole(below, out, cancelled);
    }
    out.notes = nullptr; // notes are not thread-safe
    const std::vector<Rect> rects = entry.stale.rects();
    std::atomic<bool> stopped = false;
    marram::parallel_for(size_t(0), rects.size(), [&](size_t r) {
        if (stopped.load(std::memory_order_relaxed)) return;
        if (cancelled()) stopped = true;
        layer.evaluate(rects[r], below, out);
    });
    return !stopped;
}

bool Stack::evaluate(const std::function<bool()>& cancelled) {
    for (Entry& entry : entries_) entry.work = {};
    for (size_t k = 0; k < entries_.size(); ++k) {
        Entry& entry = entries_[k];
        if (!std::isfinite(entry.made.layer->reach())) entry.stale = entry.stale.grown(infinity);
        entry.work = {entry.stale.count(), 0.0};
        if (entry.stale.none()) continue;
        const double begin = wall_seconds();
        if (!evaluate(k, cancelled)) return false;
        entry.work.seconds = wall_seconds() - begin;
        if (k + 1 < entries_.size())
            entries_[k + 1].stale.add(entry.stale.grown(entries_[k + 1].made.layer->reach()));
        else
            changed_.add(entry.stale);
        entry.stale = Tiles(domain_);
    }
    return true;
}

uint64_t Stack::digest() const {
    Digest digest;
    for (const Entry& entry : entries_) digest.add(entry.made.type).add(entry.made.digest);
    return digest.value();
}

Tiles Stack::take_changed() { return std::exchange(changed_, Tiles(domain_)); }

std::vector<Stack::Work> Stack::work() const {
    std::vector<Work> work;
    for (const Entry& entry : entries_) work.push_back(entry.work);
    return work;
}

size_t Stack::bytes() const {
    size_t bytes = 0;
    for (const Entry& entry : entries_)
        bytes +=
            domain_.count() * ((entry.bedrock ? sizeof(float) : 0) + (entry.sand ? sizeof(SandUnits) : 0) +
                               entry.masks.size() * sizeof(float));
    return bytes;
}

} // namespace marram
