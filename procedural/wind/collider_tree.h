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
// It holds no pointer into the frame, and serves later frames in which the meshes are the same.
//
// Cost: 25 bytes and 35 ns a triangle to make on two threads, where Embree takes 280 ns for its own; a question 0.1 to 0.3 us.
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
        uint32_t mesh;         // of the frame
        uint32_t begin, count; // in the list of triangles
    };

    // Of every mesh of the frame, the triangles that touch `reach` at any motion sample, at sample `time`. `like`: the tree of
    // another sample of the same frame and reach, to share its clusters.
    ColliderTree(const MarramFrame& frame, const Eigen::AlignedBox3d& reach, uint32_t time,
                 const ColliderTree* like = nullptr);

    bool empty() const { return nodes_.empty(); }
    const Cluster& cluster(uint32_t i) const { return shape_->clusters[i]; }
    uint32_t triangle(const Cluster& cluster, uint32_t i) const {
        return shape_->triangles[cluster.begin + i];
    }
    size_t bytes() const;        // its own
    size_t shared_bytes() const; // together with the trees of other motion samples

    // The clusters that may hold a triangle within the region (none where it is not finite or beyond 1e18); false: there are more than `most` (found holds some of them).
    bool find(const Region& region, size_t most, std::vector<uint32_t>& found) const;

    // Calls visit(cluster) for those that may hold a triangle within `radius` of p, roughly the nearest first. visit returns the
    // radius to go on with.
    template <typename Visit>
    void nearest(const Vec3d& p, double radius, Visit&& visit) const {
        if (nodes_.empty()) return;
        const Vec3d from = p - origin_.cast<double>();
        const double spare = rounding_of(from.cwiseAbs().maxCoeff() + radius);
        const auto limit_of = [spare](double r) {
            return float((r + spare) * (r + spare) * (1.0 + 0x1p-20));
        };
        const Vec3f place = from.cast<float>();
        struct Waiting {
            float squared; // no nearer than this
            uint32_t child;
            bool cluster;
        } stack[stack_size];
        size_t top = 0;
        stack[top++] = {0.0F, uint32_t(nodes_.size() - 1), false};
        float limit = limit_of(radius);
        while (top > 0) {
            const Waiting next = stack[--top];
            if (next.squared > limit) continue;
            if (next.cluster) {
                limit = limit_of(visit(cluster(next.child)));
                continue;
            }
            Distances8 distances;
            distances_to(nodes_[next.child], place.data(), distances);
            const Run run = shape_->nodes[next.child];
            const size_t first = top;
            for (uint32_t i = 0; i < run.count; ++i) {
                const float squared = distances.squared[i];
                if (!(squared <= limit)) continue;
                size_t at = top++;
                for (; at > first && stack[at - 1].squared < squared; --at) stack[at] = stack[at - 1];
                stack[at] = {squared, run.first + i, next.child < shape_->levels[1]};
            }
        }
    }

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

    struct alignas(64) Distances8 {
        VFloat squared;
    };
    static double rounding_of(double greatest) { return 16.0 * 0x1p-24 * greatest + 0x1p-120; }
    static void distances_to(const Node& node, const float* p, Distances8& out);
    static std::shared_ptr<const Shape> make_shape(const MarramFrame& frame,
                                                   const Eigen::AlignedBox3d& reach);
    void prefetch(const MarramMesh* meshes, size_t node, uint32_t time) const;
    void bound_child(const MarramMesh* meshes, size_t node, uint32_t i, bool is_cluster, uint32_t time);
    void walk(const Question& question, size_t most, std::vector<uint32_t>& found, bool& whole) const;

    std::shared_ptr<const Shape> shape_;
    Vec3f origin_; // boxes and slabs are relative to it
    WideVector<Node> nodes_;
};

} // namespace marram
