// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/collision/colliders.h"

#include "procedural/abi/parallel.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <bit>

namespace marram {

Colliders colliders_at(const MarramFrame& frame, uint32_t time_index) {
    Colliders colliders;
    if (!frame.colliders || frame.mesh_count == 0) return colliders;
    colliders.scene = frame.colliders;
    colliders.lent = frame.meshes;
    colliders.time_index = time_index;
    colliders.time = frame.time_count > 1 ? float(time_index) / float(frame.time_count - 1) : 0.0F;
    for (uint32_t i = 0; i < frame.mesh_count; ++i) {
        const MarramMesh& mesh = frame.meshes[i];
        if (mesh.geometry_id >= colliders.meshes.size())
            colliders.meshes.resize(mesh.geometry_id + 1, nullptr);
        colliders.meshes[mesh.geometry_id] = &mesh;
    }
    return colliders;
}

namespace {

// Appends hashes of the bytes, in chunks hashed in parallel.
void add_hash(const void* bytes, size_t count, std::vector<uint64_t>& key) {
    constexpr size_t chunk = size_t(1) << 20;
    const size_t chunks = (count + chunk - 1) / chunk, first = key.size();
    key.resize(first + 2 * chunks);
    marram::parallel_for(size_t(0), chunks, [&](size_t i) {
        const size_t begin = i * chunk, end = std::min(count, begin + chunk);
        const XXH128_hash_t hash = XXH3_128bits(static_cast<const char*>(bytes) + begin, end - begin);
        key[first + 2 * i] = hash.low64;
        key[first + 2 * i + 1] = hash.high64;
    });
}

bool any_moves(const MarramFrame& frame) {
    return std::any_of(frame.meshes, frame.meshes + frame.mesh_count,
                       [](const MarramMesh& mesh) { return mesh.time_count > 1; });
}

// All data that the trees depend on.
std::vector<uint64_t> key_of(const MarramFrame& frame, const Eigen::AlignedBox3d& query_bounds,
                             std::span<Colliders* const> colliders) {
    std::vector<uint64_t> key;
    for (const Vec3d& corner : {query_bounds.min(), query_bounds.max()})
        for (int axis = 0; axis < 3; ++axis) key.push_back(std::bit_cast<uint64_t>(corner[axis]));
    // If nothing moves, one tree serves any number of samples.
    const bool moves = any_moves(frame);
    for (size_t i = 0; i < (moves ? colliders.size() : std::min<size_t>(colliders.size(), 1)); ++i)
        key.push_back(!colliders[i]->any() ? ~uint64_t(0) : moves ? colliders[i]->time_index : 0);
    for (uint32_t i = 0; i < frame.mesh_count; ++i) {
        const MarramMesh& mesh = frame.meshes[i];
        key.insert(key.end(), {mesh.roles, mesh.vertex_count, mesh.triangle_count, mesh.time_count});
        add_hash(mesh.triangles, 3 * sizeof(uint32_t) * mesh.triangle_count, key);
        for (uint32_t t = 0; t < mesh.time_count; ++t)
            add_hash(mesh.positions[t], 3 * sizeof(float) * mesh.vertex_count, key);
    }
    return key;
}

} // namespace

bool ColliderTrees::build_or_reuse(const MarramFrame& frame, const Eigen::AlignedBox3d& query_bounds,
                                   std::span<Colliders* const> colliders) {
    std::vector<uint64_t> key = key_of(frame, query_bounds, colliders);
    const bool changed = key != key_;
    if (changed) {
        key_.clear();
        trees_.clear(); // free the old ones before building
        const size_t count = any_moves(frame) ? colliders.size() : std::min<size_t>(colliders.size(), 1);
        for (size_t i = 0; i < count; ++i)
            trees_.push_back(colliders[i]->any() ? std::make_shared<ColliderTree>(
                                                       frame, query_bounds, colliders[i]->time_index,
                                                       i > 0 ? trees_[0].get() : nullptr)
                                                 : nullptr);
        key_ = std::move(key);
    }
    for (size_t i = 0; i < colliders.size(); ++i) colliders[i]->tree = trees_[std::min(i, trees_.size() - 1)];
    return changed;
}

size_t ColliderTrees::bytes() const {
    size_t sum = 0;
    const ColliderTree* last = nullptr;
    for (const auto& tree : trees_) {
        if (tree && tree.get() != last) sum += tree->bytes() + (last ? 0 : tree->shared_bytes());
        if (tree) last = tree.get();
    }
    return sum;
}

} // namespace marram
