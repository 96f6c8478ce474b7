// SPDX-License-Identifier: Apache-2.0
// A tree over the triangles of the colliders, grouped in clusters. It answers one query: which triangles may
// be near the convex hull of a few points? A strand starts on its skin. So a ball around its sweep, as in
// Embree's point query, contains many triangles that are well below the sweep. Here every cluster and node is
// bounded by a box and by a slab perpendicular to its mean normal: one plane separates the sweep from the
// skin below it before any triangle is tested.
//
// It is built from the mesh tables of the plugin interface, for one motion sample, over the triangles within
// a groom's query bounds: blocks of up to 64 neighbours (triangle_blocks.h), and nodes above them, of at most
// eight blocks or nodes each (T. Karras, "Maximizing Parallelism in the Construction of BVHs, Octrees, and
// k-d Trees", 2012: cells are common prefixes). The contents of a block, clusters of up to eight triangles,
// are built at the first query that reaches it: fur and grass query a small part of a fine skin.
//
// It holds no pointer into the frame, and can be reused in later frames with the same meshes.
//
// Cost: 5 bytes and 30 ns a triangle on one thread, where Embree takes 500 ns for its own BVH; in blocks that
// were queried, 60 bytes and 70 ns a triangle more; a query takes 0.1 to 0.3 us.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/wind/collision/triangle_blocks.h"

#include <Eigen/Geometry>

#include <atomic>
#include <bit>
#include <memory>
#include <span>
#include <vector>

namespace marram {

// The convex hull of some points, expanded by a radius; optionally only the part within the radius of a
// plane.
class SearchRegion {
  public:
    static constexpr size_t max_points = 24;

    explicit SearchRegion(double radius) : radius_(radius) {}
    void add(const Vec3d& p) { points_[count_++] = p; }
    // Keeps only the part within the radius of the plane with this normal through the first point.
    void limit_to_slab(const Vec3d& unit_normal) { normal_ = unit_normal; }

    std::span<const Vec3d> points() const { return {points_, count_}; }
    double radius() const { return radius_; }
    const Vec3d& normal() const { return normal_; } // 0: no slab

  private:
    Vec3d points_[max_points];
    size_t count_ = 0;
    double radius_;
    Vec3d normal_ = Vec3d::Zero();
};

// Up to eight triangles, corners as in their mesh; unused lanes repeat the last.
struct alignas(64) TriangleCluster {
    Wide3f corner[3];
    uint32_t triangle[lanes];
};

struct NearCluster {
    const TriangleCluster* cluster; // valid as long as the tree
    uint32_t mesh;                  // index in the frame
    uint32_t count;                 // of triangles
};

class ColliderTree {
  public:
    // Contains the triangles of all colliding meshes that touch `query_bounds` at any motion sample, at
    // sample `time`. `share_with`: the tree of another sample of the same frame and query bounds, whose
    // blocks are shared.
    ColliderTree(const MarramFrame& frame, const Eigen::AlignedBox3d& query_bounds, uint32_t time,
                 const ColliderTree* share_with = nullptr);
    ~ColliderTree();
    ColliderTree(const ColliderTree&) = delete;
    ColliderTree& operator=(const ColliderTree&) = delete;

    bool empty() const { return nodes_.empty(); }
    size_t bytes() const;        // its own, at present
    size_t shared_bytes() const; // shared with the trees of other motion samples

    // `meshes` below: the meshes it was built from, or equal ones.

    // Finds the clusters that may have a triangle within the region (none if it is not finite or its radius
    // is beyond embree_limit). False: there are more than `most` (found has some of them).
    bool find(const MarramMesh* meshes, const SearchRegion& region, size_t most,
              std::vector<NearCluster>& found) const;

    // Calls visit(cluster) for those that may have a triangle within `radius` of p, usually in the order of
    // the lower bounds on their distances. visit returns the radius to continue with.
    template <typename Visit>
    void nearest(const MarramMesh* meshes, const Vec3d& p, double radius, Visit&& visit) const {
        if (nodes_.empty()) return;
        const Vec3d from = p - origin_.cast<double>();
        const double rounding_margin = rounding_of(from.cwiseAbs().maxCoeff() + radius);
        const auto limit_of = [rounding_margin](double r) {
            return float((r + rounding_margin) * (r + rounding_margin) * (1.0 + 0x1p-20));
        };
        const Vec3f place = from.cast<float>();
        struct StackEntry {
            float squared; // lower bound on the squared distance
            uint32_t child;
            enum { node, block, cluster } kind;
            uint32_t of_block;
        } stack[2 * stack_size + lanes];
        size_t top = 0;
        stack[top++] = {0.0F, uint32_t(nodes_.size() - 1), StackEntry::node, 0};
        float limit = limit_of(radius);
        while (top > 0) {
            const StackEntry next = stack[--top];
            if (next.squared > limit) continue;
            if (next.kind == StackEntry::cluster) {
                limit = limit_of(visit(cluster_of(next.of_block, next.child)));
                continue;
            }
            const bool leaf = next.kind == StackEntry::block;
            const Run run =
                leaf ? Run{0, clusters_of(meshes, next.child).clusters} : topology_->nodes[next.child];
            Distances8 distances;
            distances_to(leaf ? clusters_of(meshes, next.child).node : nodes_[next.child], place.data(),
                         limit, distances);
            const auto kind =
                leaf ? StackEntry::cluster
                     : (next.child < topology_->levels[1] ? StackEntry::block : StackEntry::node);
            // Best first. When half of the stack is in use, depth first, which needs at most stack_size more
            // (build_topology() limits the depth).
            const size_t first = top <= stack_size ? 0 : top;
            for (uint32_t bits = distances.within & ((1U << run.count) - 1U); bits != 0; bits &= bits - 1) {
                const auto i = uint32_t(std::countr_zero(bits));
                const float squared = distances.squared[int(i)];
                size_t at = top++;
                for (; at > first && stack[at - 1].squared < squared; --at) stack[at] = stack[at - 1];
                stack[at] = {squared, run.first + i, kind, next.child};
            }
        }
    }

  private:
    static constexpr size_t stack_size = 256;
    struct Run {
        uint32_t first, count;
    };
    struct Block {
        uint32_t mesh;       // index in the frame
        uint32_t first, end; // in the list of runs
    };
    struct Topology { // the same at every motion sample
        std::vector<TriangleRun> runs;
        std::vector<Block> blocks;
        std::vector<Run> nodes;       // their children: blocks in the first level, nodes above
        std::vector<uint32_t> levels; // start of each level of nodes, and the end
        Vec3f origin = Vec3f::Zero();
    };
    struct alignas(64) Node { // of the eight children in its run; unused lanes are empty
        Wide3f low, high;     // boxes
        Wide3f normal;        // slabs: bottom <= normal . x <= top
        VFloat bottom, top;
    };
    struct alignas(64) ClusteredBlock {         // a block that was queried
        Node node;                              // bounds of its clusters
        uint32_t clusters;                      // their number; they follow in memory
        uint32_t triangles[block_most / lanes]; // number in each
        const TriangleCluster& cluster(uint32_t i) const {
            return reinterpret_cast<const TriangleCluster*>(this + 1)[i];
        }
    };
    struct RegionQuery;
    struct BlockCorners;

    struct alignas(64) Distances8 {
        VFloat squared;
        uint32_t within; // bits of those within the limit
    };
    static double rounding_of(double greatest) { return 16.0 * 0x1p-24 * greatest + 0x1p-120; }
    static void distances_to(const Node& node, const float* p, float limit, Distances8& out);
    static std::shared_ptr<const Topology> build_topology(const MarramFrame& frame,
                                                          const Eigen::AlignedBox3d& query_bounds);
    void prefetch(const MarramMesh* meshes, uint32_t block) const;
    void gather_corners(const MarramMesh* meshes, const Block& block, BlockCorners& out) const;
    __attribute__((noinline)) const ClusteredBlock* build_clusters(const MarramMesh* meshes,
                                                                   uint32_t block) const;
    const ClusteredBlock& clusters_of(const MarramMesh* meshes, uint32_t block) const {
        const ClusteredBlock* built = clustered_blocks_[block].load(std::memory_order_acquire);
        return built ? *built : *build_clusters(meshes, block);
    }
    NearCluster cluster_of(uint32_t block, uint32_t i) const { // of a block with clusters
        const ClusteredBlock& built = *clustered_blocks_[block].load(std::memory_order_acquire);
        return {&built.cluster(i), topology_->blocks[block].mesh, built.triangles[i]};
    }
    void walk(const MarramMesh* meshes, const RegionQuery& question, size_t most,
              std::vector<NearCluster>& found, bool& complete) const;

    std::shared_ptr<const Topology> topology_;
    uint32_t time_;
    Vec3f origin_; // of boxes and slabs
    WideVector<Node> nodes_;
    mutable std::vector<std::atomic<const ClusteredBlock*>>
        clustered_blocks_; // [blocks]; the contents depend on the block only
};

} // namespace marram
