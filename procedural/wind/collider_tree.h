// SPDX-License-Identifier: Apache-2.0
// The triangles of the colliders in clusters, and a tree over these, made for one question: which triangles may come near
// the hull of a few points? A strand stands on its skin, so a ball around its sweep, which is what Embree's point query takes,
// is full of triangles that the sweep itself is well above. Here every cluster and every node is bounded by a box and by a
// slab across its mean normal: a plane parts the sweep from the skin below it long before a triangle is looked at.
//
// Made from the mesh tables of the contract, for one motion sample, over the triangles within a groom's reach. Triangles are
// sorted along a Morton curve of their own mesh; a run of neighbours that shares a cell is a cluster (8 at most), runs
// of clusters are nodes (8 at most), runs of nodes the nodes above (T. Karras, "Maximizing Parallelism in the Construction of
// BVHs, Octrees, and k-d Trees", 2012: cells are common prefixes).
//
// Cost: 24 bytes and about 35 ns a triangle to make on two threads, an eighth of what Embree takes to build its own; a question
// 0.1 to 0.3 us.
#pragma once

#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"
#include "procedural/simd.h"

#include <Eigen/Geometry>

#include <memory>
#include <span>
#include <vector>

namespace marram {

// The hull of some points, thickened by a radius; perhaps within the radius of a plane besides.
class Region {
  public:
    static constexpr size_t most_points = 24;

    explicit Region(double radius) : radius_(radius) {}
    void add(const Vec3d& p) { points_[count_++] = p; }
    void flatten(const Vec3d& unit_normal) {
        normal_ = unit_normal;
    } // the plane goes through the first point

    std::span<const Vec3d> points() const { return {points_, count_}; }
    double radius() const { return radius_; }
    const Vec3d& normal() const { return normal_; } // 0: not flat

  private:
    Vec3d points_[most_points];
    size_t count_ = 0;
    double radius_;
    Vec3d normal_ = Vec3d::Zero();
};

class ColliderTree {
  public:
    struct Cluster {
        uint32_t begin, end; // in triangles()
        const MarramMesh* mesh;
    };

    // Of every mesh of the frame, the triangles that touch `reach` at any motion sample, at sample `time`. `like`: the tree of
    // another sample of the same frame and reach, to share its clusters.
    ColliderTree(const MarramFrame& frame, const Eigen::AlignedBox3d& reach, uint32_t time,
                 const ColliderTree* like = nullptr);

    bool empty() const { return nodes_.empty(); }
    const Cluster& cluster(uint32_t i) const { return shape_->clusters[i]; }
    std::span<const uint32_t> triangles(const Cluster& cluster) const {
        return {shape_->triangles.data() + cluster.begin, cluster.end - cluster.begin};
    }
    size_t bytes() const;        // its own
    size_t shared_bytes() const; // together with the trees of other motion samples

    // The clusters that may hold a triangle within the region; false: there are more than `most` (found holds some of them).
    bool find(const Region& region, size_t most, std::vector<uint32_t>& found) const;

  private:
    static constexpr size_t stack_size = 256;
    struct Run {
        uint32_t first, count;
    };
    struct Shape { // the same at every motion sample
        std::vector<uint32_t> triangles;
        std::vector<Cluster> clusters;
        std::vector<Run> nodes;       // what they stand for: clusters below `leaves`, nodes from there on
        std::vector<uint32_t> levels; // where each level of nodes begins, and the end
    };
    struct alignas(64) Node { // of the eight things in its run; those it has not are nowhere
        Wide3f low, high;     // boxes
        Wide3f normal;        // slabs: bottom <= normal . x <= top
        VFloat bottom, top;
    };
    struct Question;

    static std::shared_ptr<const Shape> make_shape(const MarramFrame& frame,
                                                   const Eigen::AlignedBox3d& reach);
    void prefetch(size_t node, uint32_t time) const;
    void bound_child(size_t node, uint32_t i, bool is_cluster, uint32_t time);
    void walk(const Question& question, size_t most, std::vector<uint32_t>& found, bool& whole) const;

    std::shared_ptr<const Shape> shape_;
    Vec3f origin_; // boxes and slabs are relative to it
    WideVector<Node> nodes_;
};

} // namespace marram
