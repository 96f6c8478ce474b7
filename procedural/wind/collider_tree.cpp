// SPDX-License-Identifier: Apache-2.0
// Rounding. Boxes and slabs are floats rounded outwards, normals are floats taken as they are. A question's points are
// rounded to floats and multiplied in floats: it is off by less than 16 ulp of its greatest coordinate, and is thickened by
// that much.
#include "procedural/wind/collider_tree.h"

#include "procedural/wind/morton_order.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <stdexcept>

namespace marram {
namespace {

constexpr uint32_t cluster_most = lanes; // triangles
constexpr uint32_t node_most = lanes;    // clusters or nodes

constexpr float nowhere = std::numeric_limits<float>::infinity();
constexpr double far_away = 1e18; // beyond what meshes may have

float round_down(double x) {
    const auto f = float(x);
    return double(f) > x ? std::nextafter(f, -nowhere) : f;
}
float round_up(double x) { return -round_down(-x); }

// The end of the longest run from `begin` on that is a whole cell and holds at most `most`; the last run need not be a cell.
template <typename Key>
size_t run_end(size_t begin, size_t count, size_t most, Key&& key) {
    if (begin + most >= count) return count;
    const uint64_t differs = key(begin) ^ key(begin + most);
    if (differs == 0) return begin + most;
    const int above = 63 - std::countl_zero(differs);
    size_t end = begin + 1;
    while (key(end) >> above == key(begin) >> above) ++end;
    return end;
}

} // namespace

// Keys: the mesh's number above, the Morton code below.
std::shared_ptr<const ColliderTree::Shape> ColliderTree::make_shape(const MarramFrame& frame,
                                                                    const Eigen::AlignedBox3d& reach) {
    auto shape = std::make_shared<Shape>();
    std::vector<uint64_t> keys; // of clusters, then of each level of nodes
    for (uint32_t m = 0; m < frame.mesh_count; ++m) {
        const MarramMesh& mesh = frame.meshes[m];
        const std::vector<uint64_t> order = morton_order(mesh, reach);
        const auto code = [&](size_t i) { return order[i] >> 32; };
        const size_t base = shape->triangles.size();
        shape->triangles.resize(base + order.size());
        std::transform(order.begin(), order.end(), shape->triangles.begin() + long(base),
                       [](uint64_t entry) { return uint32_t(entry); });
        for (size_t begin = 0; begin < order.size();) {
            const size_t end = run_end(begin, order.size(), cluster_most, code);
            shape->clusters.push_back({m, uint32_t(base + begin), uint32_t(end - begin)});
            keys.push_back(uint64_t(m) << 32 | code(begin));
            begin = end;
        }
    }
    shape->clusters.shrink_to_fit();
    // Levels of nodes, until one is left.
    size_t below = 0; // where the level below begins in its own table
    while (!keys.empty()) {
        shape->levels.push_back(uint32_t(shape->nodes.size()));
        std::vector<uint64_t> above;
        for (size_t begin = 0; begin < keys.size();) {
            const size_t end = run_end(begin, keys.size(), node_most, [&](size_t i) { return keys[i]; });
            shape->nodes.push_back({uint32_t(below + begin), uint32_t(end - begin)});
            above.push_back(keys[begin]);
            begin = end;
        }
        below = shape->levels.back();
        if (above.size() == 1) break;
        keys = std::move(above);
    }
    shape->levels.push_back(uint32_t(shape->nodes.size()));
    if (lanes * shape->levels.size() > stack_size) throw std::length_error("the colliders' tree is too deep");
    return shape;
}

namespace {

// What bounds a cluster or a node: a box, and a slab across `normal`, which is 0 where there is none.
struct Bounds {
    float low[3], high[3], normal[3], bottom, top;
};

constexpr Bounds no_bounds{
    {nowhere, nowhere, nowhere}, {-nowhere, -nowhere, -nowhere}, {0, 0, 0}, nowhere, -nowhere};

struct alignas(64) Corners8 { // of triangles, relative to the tree's origin; spare lanes repeat the last
    Wide3f corner[3];
};

MARRAM_INLINE VFloat smaller(VFloat a, VFloat b) { return a < b ? a : b; }
MARRAM_INLINE VFloat greater(VFloat a, VFloat b) { return a > b ? a : b; }
MARRAM_INLINE float least_of(VFloat v) {
    v = smaller(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
    v = smaller(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
    return std::min(v[0], v[1]);
}
MARRAM_INLINE float sum_of(VFloat v) {
    v = v + __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3);
    v = v + __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5);
    return v[0] + v[1];
}

// In floats: subtracting the origin has cost half an ulp, a product with the normal costs less than 4 ulp of the greatest
// coordinate times the square root of 3. That is added.
MARRAM_HOT void bound(const Corners8& t, Bounds& out) {
    const Wide3f &a = t.corner[0], &b = t.corner[1], &c = t.corner[2];
    out.low[0] = least_of(smaller(a.x, smaller(b.x, c.x)));
    out.low[1] = least_of(smaller(a.y, smaller(b.y, c.y)));
    out.low[2] = least_of(smaller(a.z, smaller(b.z, c.z)));
    out.high[0] = -least_of(-greater(a.x, greater(b.x, c.x)));
    out.high[1] = -least_of(-greater(a.y, greater(b.y, c.y)));
    out.high[2] = -least_of(-greater(a.z, greater(b.z, c.z)));
    float greatest = 0.0F;
    for (int axis = 0; axis < 3; ++axis) greatest = std::max({greatest, -out.low[axis], out.high[axis]});
    for (int axis = 0; axis < 3; ++axis) {
        out.low[axis] -= 0x1p-23F * greatest;
        out.high[axis] += 0x1p-23F * greatest;
    }
    const Wide3f n = cross(b - a, c - a);
    const double sum[3] = {double(sum_of(n.x)), double(sum_of(n.y)), double(sum_of(n.z))};
    const double size = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    const double inverse = size > 0.0 && size < 1e300 ? 1.0 / size : 0.0;
    for (int axis = 0; axis < 3; ++axis) out.normal[axis] = float(sum[axis] * inverse);
    const auto height = [&](const Wide3f& p) MARRAM_ALWAYS_INLINE {
        return p.x * out.normal[0] + p.y * out.normal[1] + p.z * out.normal[2];
    };
    const VFloat ha = height(a), hb = height(b), hc = height(c);
    out.bottom = least_of(smaller(ha, smaller(hb, hc))) - 0x1p-20F * greatest;
    out.top = -least_of(-greater(ha, greater(hb, hc))) + 0x1p-20F * greatest;
}

// Around all that a node holds. Along n, something within the slab [bottom, top] across m reaches as far as the slab and its box
// allow: n . x = m . x + (n - m) . x.
template <typename Node>
Bounds around(const Node& node) {
    const auto lane = [](const Wide3f& v, int i) {
        return Vec3d(double(v.x[i]), double(v.y[i]), double(v.z[i]));
    };
    Vec3d low = Vec3d::Constant(double(nowhere)), high = -low, n = Vec3d::Zero();
    for (int i = 0; i < lanes; ++i) {
        if (!(node.low.x[i] <= node.high.x[i])) continue;
        low = low.cwiseMin(lane(node.low, i));
        high = high.cwiseMax(lane(node.high, i));
        n += lane(node.normal, i) * (lane(node.high, i) - lane(node.low, i)).squaredNorm();
    }
    const double size = n.norm();
    const Vec3f normal = size > 0.0 ? Vec3f((n / size).cast<float>()) : Vec3f(Vec3f::Zero());
    n = normal.cast<double>();
    double bottom = double(nowhere), top = -bottom;
    for (int i = 0; i < lanes; ++i) {
        if (!(node.low.x[i] <= node.high.x[i])) continue;
        const Vec3d centre = 0.5 * (lane(node.low, i) + lane(node.high, i)),
                    half = lane(node.high, i) - centre;
        const Vec3d rest = n - lane(node.normal, i);
        const double middle = n.dot(centre), by_box = n.cwiseAbs().dot(half);
        const double off = rest.dot(centre), by_slab = rest.cwiseAbs().dot(half);
        const double spare = 1e-14 * (centre.cwiseAbs().maxCoeff() + half.maxCoeff());
        top = std::max(top, std::min(middle + by_box, double(node.top[i]) + off + by_slab) + spare);
        bottom = std::min(bottom, std::max(middle - by_box, double(node.bottom[i]) + off - by_slab) - spare);
    }
    Bounds bounds{};
    for (int axis = 0; axis < 3; ++axis) {
        bounds.low[axis] = float(low[axis]); // it was a float
        bounds.high[axis] = float(high[axis]);
        bounds.normal[axis] = normal[axis];
    }
    bounds.bottom = round_down(bottom);
    bounds.top = round_up(top);
    return bounds;
}

} // namespace

ColliderTree::ColliderTree(const MarramFrame& frame, const Eigen::AlignedBox3d& reach, uint32_t time,
                           const ColliderTree* like)
    : shape_(like ? like->shape_ : make_shape(frame, reach)), origin_(Vec3f::Zero()),
      nodes_(shape_->nodes.size()) {
    // The middle of what there is within reach at the first sample: the same for all. A ground that goes on for miles
    // must not take it far away, and with it the digits.
    if (like) {
        origin_ = like->origin_;
    } else if (!shape_->clusters.empty()) {
        Eigen::AlignedBox3f all;
        for (const Cluster& cluster : shape_->clusters) {
            const MarramMesh& mesh = frame.meshes[cluster.mesh];
            const Eigen::Map<const Vec3f> p(mesh.positions[0] +
                                            3 * size_t(mesh.triangles[3 * size_t(triangle(cluster, 0))]));
            all.extend(p.cast<double>().cwiseMax(reach.min()).cwiseMin(reach.max()).cast<float>().eval());
        }
        origin_ = 0.5F * all.min() + 0.5F * all.max();
    }
    const std::vector<uint32_t>& levels = shape_->levels;
    for (size_t level = 0; level + 1 < levels.size(); ++level)
        tbb::parallel_for(tbb::blocked_range<size_t>(levels[level], levels[level + 1], 64),
                          [&](const auto& range) {
                              for (size_t n = range.begin(); n < range.end(); ++n) {
                                  if (level == 0) prefetch(frame.meshes, n, time);
                                  for (uint32_t i = 0; i < node_most; ++i)
                                      bound_child(frame.meshes, n, i, level == 0, time);
                              }
                          });
}

// On a large mesh clusters that are neighbours may be far apart in memory. Those of the next nodes are sent for.
void ColliderTree::prefetch(const MarramMesh* meshes, size_t n, uint32_t time) const {
    const auto each = [&](size_t node, auto&& visit) {
        if (node >= shape_->levels[1]) return;
        const Run run = shape_->nodes[node];
        for (uint32_t i = run.first; i < run.first + run.count; ++i) {
            const Cluster& cluster = shape_->clusters[i];
            for (uint32_t k = 0; k < cluster.count; ++k)
                visit(meshes[cluster.mesh], 3 * size_t(triangle(cluster, k)));
        }
    };
    each(n + 2, [](const MarramMesh& mesh, size_t at) { __builtin_prefetch(mesh.triangles + at); });
    each(n + 1, [&](const MarramMesh& mesh, size_t at) {
        const float* positions = mesh.positions[mesh.time_count > 1 ? time : 0];
        for (size_t k = 0; k < 3; ++k) __builtin_prefetch(positions + 3 * size_t(mesh.triangles[at + k]));
    });
}

void ColliderTree::bound_child(const MarramMesh* meshes, size_t n, uint32_t i, bool is_cluster,
                               uint32_t time) {
    const Run run = shape_->nodes[n];
    Bounds bounds = no_bounds;
    if (i < run.count && is_cluster) {
        const Cluster& cluster = shape_->clusters[run.first + i];
        const MarramMesh& mesh = meshes[cluster.mesh];
        const float* positions = mesh.positions[mesh.time_count > 1 ? time : 0];
        Corners8 corners;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            const size_t at = 3 * size_t(triangle(cluster, std::min(lane, cluster.count - 1)));
            for (size_t k = 0; k < 3; ++k) {
                const float* p = positions + 3 * size_t(mesh.triangles[at + k]);
                corners.corner[k].x[lane] = p[0] - origin_.x();
                corners.corner[k].y[lane] = p[1] - origin_.y();
                corners.corner[k].z[lane] = p[2] - origin_.z();
            }
        }
        bound(corners, bounds);
    } else if (i < run.count) {
        bounds = around(nodes_[run.first + i]);
    }
    Node& node = nodes_[n];
    node.low.x[i] = bounds.low[0];
    node.low.y[i] = bounds.low[1];
    node.low.z[i] = bounds.low[2];
    node.high.x[i] = bounds.high[0];
    node.high.y[i] = bounds.high[1];
    node.high.z[i] = bounds.high[2];
    node.normal.x[i] = bounds.normal[0];
    node.normal.y[i] = bounds.normal[1];
    node.normal.z[i] = bounds.normal[2];
    node.bottom[i] = bounds.bottom;
    node.top[i] = bounds.top;
}

size_t ColliderTree::bytes() const { return nodes_.capacity() * sizeof(Node); }

size_t ColliderTree::shared_bytes() const {
    return shape_->triangles.capacity() * sizeof(uint32_t) + shape_->clusters.capacity() * sizeof(Cluster) +
           shape_->nodes.capacity() * sizeof(Run);
}

struct alignas(64) ColliderTree::Question {
    float low[3], high[3]; // of the thickened hull
    float points[Region::most_points][3];
    size_t count;
    float radius;
    bool flat;
    Wide3f normal, normal_size; // of its plane, in all lanes
    float height;
};

namespace {

// The children that are not apart from the region, as bits.
template <typename Node, typename Question>
MARRAM_INLINE uint32_t touched(const Node& node, const Question& q) {
    VInt apart = (node.low.x > q.high[0]) | (node.high.x < q.low[0]) | (node.low.y > q.high[1]) |
                 (node.high.y < q.low[1]) | (node.low.z > q.high[2]) | (node.high.z < q.low[2]);
    VFloat least = splat_float(nowhere), most = -least;
    for (size_t i = 0; i < q.count; ++i) {
        const VFloat h =
            node.normal.x * q.points[i][0] + node.normal.y * q.points[i][1] + node.normal.z * q.points[i][2];
        least = h < least ? h : least;
        most = h > most ? h : most;
    }
    apart |= (least - q.radius > node.top) | (most + q.radius < node.bottom);
    if (q.flat) {
        const VFloat half = splat_float(0.5F), wider = splat_float(1.0F + 0x1p-20F);
        const Wide3f centre = (node.low + node.high) * half, extent = (node.high - node.low) * half;
        const VFloat h = dot(centre, q.normal) - q.height;
        const VFloat reach = dot(extent, q.normal_size) * wider + q.radius;
        apart |= (h > reach) | (h < -reach);
    }
    const VInt bits = ~apart & VInt{1, 2, 4, 8, 16, 32, 64, 128};
    uint64_t pairs[4];
    std::memcpy(pairs, &bits, sizeof pairs);
    const uint64_t all = pairs[0] | pairs[1] | pairs[2] | pairs[3];
    return uint32_t(all | all >> 32) & 0xffU;
}

} // namespace

// The square of what a box, or a slab and the ball around the box, say of the distance, at least. Across the slab it is the gap
// to it; along it, the way to the ball's shadow: together they tell clusters apart that lie side by side below p.
MARRAM_HOT void ColliderTree::distances_to(const Node& node, const float* p, Distances8& out) {
    const VFloat zero{}, half = splat_float(0.5F);
    const auto outside = [&](VFloat below, VFloat above)
                             MARRAM_ALWAYS_INLINE { return greater(greater(below, above), zero); };
    const Wide3f place{splat_float(p[0]), splat_float(p[1]), splat_float(p[2])};
    const Wide3f under = node.low - place, over = place - node.high;
    const VFloat x = outside(under.x, over.x), y = outside(under.y, over.y), z = outside(under.z, over.z);
    const VFloat h = dot(node.normal, place);
    const VFloat gap = outside(node.bottom - h, h - node.top);
    const Wide3f from = place - (node.low + node.high) * half, extent = (node.high - node.low) * half;
    const VFloat across = dot(from, node.normal), whole = dot(from, from);
    const VFloat along = vsqrt(greater(whole * (1.0F - 0x1p-20F) - across * across, zero));
    const VFloat beyond = greater(along - vsqrt(dot(extent, extent)) * (1.0F + 0x1p-20F), zero);
    out.squared = greater(x * x + y * y + z * z, gap * gap + beyond * beyond);
}

// The tree from the root down; false: more than `most` clusters.
MARRAM_HOT void ColliderTree::walk(const Question& q, size_t most, std::vector<uint32_t>& found,
                                   bool& whole) const {
    const Node* const nodes = nodes_.data();
    const Run* const runs = shape_->nodes.data();
    const uint32_t above_clusters = shape_->levels[1]; // nodes from here on hold nodes
    uint32_t stack[stack_size];
    size_t top = 0;
    stack[top++] = uint32_t(nodes_.size() - 1);
    while (top > 0) {
        const uint32_t n = stack[--top];
        const uint32_t first = runs[n].first;
        const uint32_t there = (1U << runs[n].count) - 1U;
        for (uint32_t bits = touched(nodes[n], q) & there; bits != 0; bits &= bits - 1) {
            const uint32_t child = first + uint32_t(std::countr_zero(bits));
            if (n >= above_clusters) {
                stack[top++] = child;
                for (size_t line = 0; line < sizeof(Node); line += 64)
                    __builtin_prefetch(reinterpret_cast<const char*>(nodes + child) + line);
                continue;
            }
            if (found.size() >= most) {
                whole = false;
                return;
            }
            found.push_back(child);
        }
    }
}

bool ColliderTree::find(const Region& region, size_t most, std::vector<uint32_t>& found) const {
    found.clear();
    if (nodes_.empty()) return true;
    Question q;
    q.count = region.points().size();
    const Vec3d origin = origin_.cast<double>();
    Vec3d low = Vec3d::Constant(double(nowhere)), high = -low;
    double greatest = 0.0;
    for (size_t i = 0; i < q.count; ++i) {
        const Vec3d p = region.points()[i] - origin;
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
        if (!p.allFinite()) return true;
        greatest = std::max(greatest, p.cwiseAbs().maxCoeff());
        for (int axis = 0; axis < 3; ++axis) q.points[i][axis] = float(p[axis]);
    }
    const double radius = region.radius() + rounding_of(greatest + region.radius());
    if (!(radius < far_away)) return true;
    for (int axis = 0; axis < 3; ++axis) {
        q.low[axis] = float(low[axis] - radius);
        q.high[axis] = float(high[axis] + radius);
    }
    q.radius = float(radius);
    q.flat = !region.normal().isZero(0.0);
    const Vec3f n = region.normal().cast<float>();
    q.normal = {splat_float(n.x()), splat_float(n.y()), splat_float(n.z())};
    q.normal_size = {splat_float(std::abs(n.x())), splat_float(std::abs(n.y())),
                     splat_float(std::abs(n.z()))};
    q.height = q.flat ? float(region.normal().dot(region.points()[0] - origin)) : 0.0F;
    bool whole = true;
    walk(q, most, found, whole);
    return whole;
}

} // namespace marram
