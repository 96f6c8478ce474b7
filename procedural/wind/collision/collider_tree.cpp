// SPDX-License-Identifier: Apache-2.0
// Rounding. Boxes and slabs are floats rounded outwards; normals are floats used as they are. The points of a
// query are rounded to floats and multiplied in floats. The error is less than 16 ulp of the largest
// coordinate, and the query is expanded by that much.
#include "procedural/wind/collision/collider_tree.h"

#include "procedural/abi/parallel.h"
#include "procedural/abi/values.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <new>
#include <stdexcept>

namespace marram {
namespace {

constexpr uint32_t node_most = lanes; // blocks or nodes

constexpr float float_infinity = std::numeric_limits<float>::infinity();

float round_down(double x) {
    const auto f = float(x);
    return double(f) > x ? std::nextafter(f, -float_infinity) : f;
}
float round_up(double x) { return -round_down(-x); }

// The end of the longest run from `begin` on that is a whole cell and has at most `most` elements; the last
// run need not be a cell.
size_t run_end(size_t begin, size_t most, const std::vector<uint64_t>& keys) {
    if (begin + most >= keys.size()) return keys.size();
    const uint64_t differs = keys[begin] ^ keys[begin + most];
    if (differs == 0) return begin + most;
    const int above = 63 - std::countl_zero(differs);
    size_t end = begin + 1;
    while (keys[end] >> above == keys[begin] >> above) ++end;
    return end;
}

struct BlocksOfMesh {
    uint32_t mesh; // index in the frame
    TriangleBlocks blocks;
};

// Sorts meshes along a Morton curve through the centres of their boxes, so that nodes above several meshes
// are compact.
void sort_by_place(std::vector<BlocksOfMesh>& meshes, const Eigen::AlignedBox3f& box) {
    std::vector<std::pair<uint32_t, size_t>> order; // Morton code and index
    const Eigen::Array3d low = box.min().cast<double>().array(),
                         size = box.max().cast<double>().array() - low;
    for (size_t i = 0; i < meshes.size(); ++i) {
        const Eigen::AlignedBox3f& one = meshes[i].blocks.box;
        const Eigen::Array3d centre = 0.5 * (one.min().cast<double>() + one.max().cast<double>()).array();
        const Eigen::Array3d share = (size > 0.0).select((centre - low) / size, 0.0);
        const auto cell = (share * 1023.0).cast<uint32_t>();
        order.emplace_back(morton_code(cell[0], cell[1], cell[2]), i);
    }
    std::ranges::sort(order);
    std::vector<BlocksOfMesh> sorted;
    for (const auto& [code, i] : order) sorted.push_back(std::move(meshes[i]));
    meshes = std::move(sorted);
}

} // namespace

// Keys: the mesh's place in the order of sort_by_place() in the high bits, Morton code in the low bits.
std::shared_ptr<const ColliderTree::Topology>
ColliderTree::build_topology(const MarramFrame& frame, const Eigen::AlignedBox3d& query_bounds) {
    auto topology = std::make_shared<Topology>();
    std::vector<BlocksOfMesh> meshes;
    Eigen::AlignedBox3f box;
    for (uint32_t m = 0; m < frame.mesh_count; ++m) {
        if ((frame.meshes[m].roles & MARRAM_COLLIDES) == 0) continue;
        TriangleBlocks blocks = triangle_blocks(frame.meshes[m], query_bounds);
        if (blocks.blocks.empty()) continue;
        box.extend(blocks.box);
        meshes.push_back({m, std::move(blocks)});
    }
    if (meshes.size() > 1) sort_by_place(meshes, box);
    std::vector<uint64_t> keys; // of blocks, then of each level of nodes
    for (size_t i = 0; i < meshes.size(); ++i) {
        const TriangleBlocks& part = meshes[i].blocks;
        const auto base = uint32_t(topology->runs.size());
        topology->runs.insert(topology->runs.end(), part.runs.begin(), part.runs.end());
        for (const TriangleBlock& block : part.blocks) {
            topology->blocks.push_back({meshes[i].mesh, base + block.first, base + block.end});
            keys.push_back(uint64_t(i) << 32 | block.code);
        }
    }
    // The centre of the triangles within the query bounds. A ground plane that is miles wide must not move it
    // far away, which would cost accuracy.
    if (!keys.empty()) topology->origin = 0.5F * box.min() + 0.5F * box.max();
    // Builds levels of nodes until one node is left.
    size_t below = 0; // start of the level below in its own table
    while (!keys.empty()) {
        topology->levels.push_back(uint32_t(topology->nodes.size()));
        std::vector<uint64_t> above;
        for (size_t begin = 0; begin < keys.size();) {
            const size_t end = run_end(begin, node_most, keys);
            topology->nodes.push_back({uint32_t(below + begin), uint32_t(end - begin)});
            above.push_back(keys[begin]);
            begin = end;
        }
        below = topology->levels.back();
        if (above.size() == 1) break;
        keys = std::move(above);
    }
    topology->levels.push_back(uint32_t(topology->nodes.size()));
    if (lanes * (topology->levels.size() + 2) > stack_size)
        throw std::length_error("the colliders' tree is too deep");
    return topology;
}

namespace {

// Bounds of a cluster or a node: a box, and a slab across `normal`, which is 0 if there is none.
struct Bounds {
    float low[3], high[3], normal[3], bottom, top;
};

constexpr Bounds no_bounds{{float_infinity, float_infinity, float_infinity},
                           {-float_infinity, -float_infinity, -float_infinity},
                           {0, 0, 0},
                           float_infinity,
                           -float_infinity};

template <typename Node>
void set_lane(Node& node, uint32_t i, const Bounds& bounds) {
    const auto lane = int(i);
    node.low.x[lane] = bounds.low[0];
    node.low.y[lane] = bounds.low[1];
    node.low.z[lane] = bounds.low[2];
    node.high.x[lane] = bounds.high[0];
    node.high.y[lane] = bounds.high[1];
    node.high.z[lane] = bounds.high[2];
    node.normal.x[lane] = bounds.normal[0];
    node.normal.y[lane] = bounds.normal[1];
    node.normal.z[lane] = bounds.normal[2];
    node.bottom[lane] = bounds.bottom;
    node.top[lane] = bounds.top;
}

struct alignas(64) Corners8 { // of triangles; unused lanes repeat the last
    Wide3f corner[3];
};

MARRAM_INLINE VFloat smaller(VFloat a, VFloat b) { return a < b ? a : b; }
MARRAM_INLINE VFloat greater(VFloat a, VFloat b) { return a > b ? a : b; }
MARRAM_INLINE float min_of(VFloat v) {
    v = smaller(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
    v = smaller(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
    return std::min(v[0], v[1]);
}
MARRAM_INLINE float sum_of(VFloat v) {
    v = v + __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3);
    v = v + __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5);
    return v[0] + v[1];
}

MARRAM_INLINE Wide3f lower(const Wide3f& a, const Wide3f& b) {
    return {smaller(a.x, b.x), smaller(a.y, b.y), smaller(a.z, b.z)};
}
MARRAM_INLINE Wide3f upper(const Wide3f& a, const Wide3f& b) {
    return {greater(a.x, b.x), greater(a.y, b.y), greater(a.z, b.z)};
}

// Bounds of `groups` times eight triangles, relative to the origin. In floats: subtracting the origin costs
// half an ulp, a product with the normal less than 4 ulp of the largest coordinate times the square root of
// 3. The bounds are widened by that.
MARRAM_HOT void bound(const Corners8* triangles, size_t groups, const float* origin, Bounds& out) {
    const Wide3f o{splat_float(origin[0]), splat_float(origin[1]), splat_float(origin[2])};
    Wide3f low{splat_float(float_infinity), splat_float(float_infinity), splat_float(float_infinity)};
    Wide3f high = Wide3f{} - low, n{};
    for (size_t i = 0; i < groups; ++i) {
        const Wide3f &a = triangles[i].corner[0], &b = triangles[i].corner[1], &c = triangles[i].corner[2];
        low = lower(low, lower(a, lower(b, c)));
        high = upper(high, upper(a, upper(b, c)));
        n = n + cross(b - a, c - a);
    }
    low = low - o;
    high = high - o;
    out.low[0] = min_of(low.x);
    out.low[1] = min_of(low.y);
    out.low[2] = min_of(low.z);
    out.high[0] = -min_of(-high.x);
    out.high[1] = -min_of(-high.y);
    out.high[2] = -min_of(-high.z);
    float greatest = 0.0F;
    for (int axis = 0; axis < 3; ++axis) greatest = std::max({greatest, -out.low[axis], out.high[axis]});
    for (int axis = 0; axis < 3; ++axis) {
        out.low[axis] -= 0x1p-23F * greatest;
        out.high[axis] += 0x1p-23F * greatest;
    }
    const double sum[3] = {double(sum_of(n.x)), double(sum_of(n.y)), double(sum_of(n.z))};
    const double size = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    const bool flat = size > 0.0 && size < 1e300;
    for (int axis = 0; axis < 3; ++axis) out.normal[axis] = flat ? float(sum[axis] / size) : 0.0F;
    VFloat bottom = splat_float(float_infinity), top = -bottom;
    for (size_t i = 0; i < groups; ++i)
        for (const Wide3f& p : triangles[i].corner) {
            const VFloat h =
                (p.x - o.x) * out.normal[0] + (p.y - o.y) * out.normal[1] + (p.z - o.z) * out.normal[2];
            bottom = smaller(bottom, h);
            top = greater(top, h);
        }
    out.bottom = min_of(bottom) - 0x1p-20F * greatest;
    out.top = -min_of(-top) + 0x1p-20F * greatest;
}

// Bounds of a node's children. The extent along n of something in the slab [bottom, top] across m is limited
// by the slab and by its box: n . x = m . x + (n - m) . x.
template <typename Node>
Bounds bounds_of_children(const Node& node) {
    const auto lane = [](const Wide3f& v, int i) {
        return Vec3d(double(v.x[i]), double(v.y[i]), double(v.z[i]));
    };
    Vec3d low = Vec3d::Constant(infinity), high = -low, n = Vec3d::Zero();
    for (int i = 0; i < lanes; ++i) {
        if (!(node.low.x[i] <= node.high.x[i])) continue;
        low = low.cwiseMin(lane(node.low, i));
        high = high.cwiseMax(lane(node.high, i));
        n += lane(node.normal, i) * (lane(node.high, i) - lane(node.low, i)).squaredNorm();
    }
    const double size = n.norm();
    const Vec3f normal = size > 0.0 ? Vec3f((n / size).cast<float>()) : Vec3f(Vec3f::Zero());
    n = normal.cast<double>();
    double bottom = infinity, top = -bottom;
    for (int i = 0; i < lanes; ++i) {
        if (!(node.low.x[i] <= node.high.x[i])) continue;
        const Vec3d centre = 0.5 * (lane(node.low, i) + lane(node.high, i)),
                    half = lane(node.high, i) - centre;
        const Vec3d rest = n - lane(node.normal, i);
        const double middle = n.dot(centre), by_box = n.cwiseAbs().dot(half);
        const double off = rest.dot(centre), by_slab = rest.cwiseAbs().dot(half);
        const double rounding_margin = 1e-14 * (centre.cwiseAbs().maxCoeff() + half.maxCoeff());
        top = std::max(top, std::min(middle + by_box, double(node.top[i]) + off + by_slab) + rounding_margin);
        bottom = std::min(bottom, std::max(middle - by_box, double(node.bottom[i]) + off - by_slab) -
                                      rounding_margin);
    }
    Bounds bounds{};
    for (int axis = 0; axis < 3; ++axis) {
        bounds.low[axis] = float(low[axis]); // exact: it was a float
        bounds.high[axis] = float(high[axis]);
        bounds.normal[axis] = normal[axis];
    }
    bounds.bottom = round_down(bottom);
    bounds.top = round_up(top);
    return bounds;
}

} // namespace

struct ColliderTree::BlockCorners {
    uint32_t count = 0;
    uint32_t triangles[block_most];
    Corners8 corners[block_most / lanes];
};

// Neighbours in space may be far apart in the tables of a large mesh, so indices are loaded first, then
// corners.
void ColliderTree::gather_corners(const MarramMesh* meshes, const Block& block, BlockCorners& out) const {
    const MarramMesh& mesh = meshes[block.mesh];
    const float* positions = mesh.positions[mesh.time_count > 1 ? time_ : 0];
    uint32_t vertices[block_most][3];
    out.count = 0;
    for (uint32_t r = block.first; r < block.end; ++r) {
        const TriangleRun run = topology_->runs[r];
        const uint32_t* from = mesh.triangles + 3 * size_t(run.first);
        std::memcpy(vertices[out.count], from, 3 * sizeof(uint32_t) * run.count);
        for (uint32_t i = 0; i < run.count; ++i) out.triangles[out.count++] = run.first + i;
    }
    const uint32_t groups = (out.count + lanes - 1) / lanes;
    for (uint32_t i = 0; i < groups * lanes; ++i) {
        const uint32_t* vertex = vertices[std::min(i, out.count - 1)];
        Corners8& group = out.corners[i / lanes];
        const auto lane = int(i % lanes);
        for (size_t k = 0; k < 3; ++k) {
            const float* p = positions + 3 * size_t(vertex[k]);
            group.corner[k].x[lane] = p[0];
            group.corner[k].y[lane] = p[1];
            group.corner[k].z[lane] = p[2];
        }
    }
}

// While one block is bounded, the corners of the next and the indices of the third next are prefetched.
void ColliderTree::prefetch(const MarramMesh* meshes, uint32_t number) const {
    const auto each = [&](uint32_t ahead, auto&& visit) {
        if (number + ahead >= topology_->blocks.size()) return;
        const Block& block = topology_->blocks[number + ahead];
        for (uint32_t r = block.first; r < block.end; ++r) visit(meshes[block.mesh], topology_->runs[r]);
    };
    each(3, [](const MarramMesh& mesh, const TriangleRun& run) {
        __builtin_prefetch(mesh.triangles + 3 * size_t(run.first));
        __builtin_prefetch(mesh.triangles + 3 * size_t(run.first + run.count - 1));
    });
    each(1, [&](const MarramMesh& mesh, const TriangleRun& run) {
        const float* positions = mesh.positions[mesh.time_count > 1 ? time_ : 0];
        for (const uint32_t t : {run.first, run.first + run.count - 1})
            for (size_t k = 0; k < 3; ++k)
                __builtin_prefetch(positions + 3 * size_t(mesh.triangles[3 * size_t(t) + k]));
    });
}

ColliderTree::ColliderTree(const MarramFrame& frame, const Eigen::AlignedBox3d& query_bounds, uint32_t time,
                           const ColliderTree* share_with)
    : topology_(share_with ? share_with->topology_ : build_topology(frame, query_bounds)), time_(time),
      origin_(topology_->origin), nodes_(topology_->nodes.size()),
      clustered_blocks_(topology_->blocks.size()) {
    const std::vector<uint32_t>& levels = topology_->levels;
    for (size_t level = 0; level + 1 < levels.size(); ++level)
        marram::parallel_for(
            tbb::blocked_range<size_t>(levels[level], levels[level + 1], 64), [&](const auto& range) {
                BlockCorners corners;
                for (size_t n = range.begin(); n < range.end(); ++n) {
                    const Run run = topology_->nodes[n];
                    for (uint32_t i = 0; i < node_most; ++i) {
                        Bounds bounds = no_bounds;
                        if (i < run.count && level > 0) {
                            bounds = bounds_of_children(nodes_[run.first + i]);
                        } else if (i < run.count) {
                            prefetch(frame.meshes, run.first + i);
                            gather_corners(frame.meshes, topology_->blocks[run.first + i], corners);
                            bound(corners.corners, (corners.count + lanes - 1) / lanes, origin_.data(),
                                  bounds);
                        }
                        set_lane(nodes_[n], i, bounds);
                    }
                }
            });
}

ColliderTree::~ColliderTree() {
    for (const auto& block : clustered_blocks_)
        ::operator delete(const_cast<ClusteredBlock*>(block.load()), std::align_val_t(64));
}

namespace {

// Splits `order` into `parts` of equal size, plus or minus one, across the longest extent of the centroids,
// recursively. Calls each(begin, end) for the final parts.
template <typename Each>
void part(const float (*places)[block_most], uint8_t* order, uint32_t begin, uint32_t end, uint32_t parts,
          Each&& each) {
    if (parts == 1) {
        each(begin, end);
        return;
    }
    int longest = 0;
    float most = -1.0F;
    for (int axis = 0; axis < 3; ++axis) {
        float low = float_infinity, high = -float_infinity;
        for (uint32_t i = begin; i < end; ++i) {
            low = std::min(low, places[axis][order[i]]);
            high = std::max(high, places[axis][order[i]]);
        }
        if (high - low > most) most = high - low, longest = axis;
    }
    const uint32_t middle = begin + (end - begin) * (parts / 2) / parts;
    const float* along = places[longest];
    std::nth_element(order + begin, order + middle, order + end, [along](uint8_t a, uint8_t b) {
        return std::pair(along[a], a) < std::pair(along[b], b);
    });
    part(places, order, begin, middle, parts / 2, each);
    part(places, order, middle, end, parts - parts / 2, each);
}

} // namespace

// Several threads may build the clusters of a block at once: the first to finish is kept.
const ColliderTree::ClusteredBlock* ColliderTree::build_clusters(const MarramMesh* meshes,
                                                                 uint32_t number) const {
    BlockCorners all;
    gather_corners(meshes, topology_->blocks[number], all);
    float places[3][block_most];
    uint8_t order[block_most];
    for (uint32_t i = 0; i < all.count; ++i) {
        const Corners8& group = all.corners[i / lanes];
        const auto lane = int(i % lanes);
        order[i] = uint8_t(i);
        places[0][i] = group.corner[0].x[lane] + group.corner[1].x[lane] + group.corner[2].x[lane];
        places[1][i] = group.corner[0].y[lane] + group.corner[1].y[lane] + group.corner[2].y[lane];
        places[2][i] = group.corner[0].z[lane] + group.corner[1].z[lane] + group.corner[2].z[lane];
    }
    const uint32_t clusters = (all.count + lanes - 1) / lanes;
    void* memory =
        ::operator new(sizeof(ClusteredBlock) + clusters * sizeof(TriangleCluster), std::align_val_t(64));
    auto* made = new (memory) ClusteredBlock;
    auto* into = new (made + 1) TriangleCluster[clusters];
    made->clusters = 0;
    part(places, order, 0, all.count, clusters, [&](uint32_t begin, uint32_t end) {
        TriangleCluster& cluster = into[made->clusters];
        Corners8 corners;
        for (uint32_t i = 0; i < lanes; ++i) {
            const uint32_t from = order[std::min(begin + i, end - 1)];
            const Corners8& group = all.corners[from / lanes];
            const auto lane = int(i), source = int(from % lanes);
            for (int k = 0; k < 3; ++k) {
                corners.corner[k].x[lane] = group.corner[k].x[source];
                corners.corner[k].y[lane] = group.corner[k].y[source];
                corners.corner[k].z[lane] = group.corner[k].z[source];
            }
            cluster.triangle[i] = all.triangles[from];
        }
        std::copy(corners.corner, corners.corner + 3, cluster.corner);
        Bounds bounds;
        bound(&corners, 1, origin_.data(), bounds);
        set_lane(made->node, made->clusters, bounds);
        made->triangles[made->clusters++] = end - begin;
    });
    for (uint32_t i = clusters; i < node_most; ++i) set_lane(made->node, i, no_bounds);
    const ClusteredBlock* existing = nullptr;
    if (clustered_blocks_[number].compare_exchange_strong(existing, made, std::memory_order_acq_rel))
        return made;
    ::operator delete(memory, std::align_val_t(64));
    return existing;
}

size_t ColliderTree::bytes() const {
    size_t sum =
        nodes_.capacity() * sizeof(Node) + clustered_blocks_.capacity() * sizeof(clustered_blocks_[0]);
    for (const auto& block : clustered_blocks_)
        if (const ClusteredBlock* built = block.load(std::memory_order_acquire))
            sum += sizeof(ClusteredBlock) + built->clusters * sizeof(TriangleCluster);
    return sum;
}

size_t ColliderTree::shared_bytes() const {
    return topology_->runs.capacity() * sizeof(TriangleRun) + topology_->blocks.capacity() * sizeof(Block) +
           topology_->nodes.capacity() * sizeof(Run);
}

struct alignas(64) ColliderTree::RegionQuery {
    float low[3], high[3]; // of the expanded hull
    float points[SearchRegion::max_points][3];
    size_t count;
    float radius;
    bool flat;
    Wide3f normal, abs_normal; // of its plane, in all lanes
    float height;
};

namespace {

// A mask as bits.
MARRAM_INLINE uint32_t bits_of(VInt mask) {
    const VInt bits = mask & VInt{1, 2, 4, 8, 16, 32, 64, 128};
    uint64_t pairs[4];
    std::memcpy(pairs, &bits, sizeof pairs);
    const uint64_t all = pairs[0] | pairs[1] | pairs[2] | pairs[3];
    return uint32_t(all | all >> 32) & 0xffU;
}

// Bits of the children that may overlap the region.
template <typename Node, typename RegionQuery>
MARRAM_INLINE uint32_t touched(const Node& node, const RegionQuery& q) {
    VInt apart = (node.low.x > q.high[0]) | (node.high.x < q.low[0]) | (node.low.y > q.high[1]) |
                 (node.high.y < q.low[1]) | (node.low.z > q.high[2]) | (node.high.z < q.low[2]);
    VFloat least = splat_float(float_infinity), most = -least;
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
        const VFloat reach = dot(extent, q.abs_normal) * wider + q.radius;
        apart |= (h > reach) | (h < -reach);
    }
    return bits_of(~apart);
}

template <typename Node>
MARRAM_INLINE void prefetch_node(const Node* node) {
    for (size_t line = 0; line < sizeof(Node); line += 64)
        __builtin_prefetch(reinterpret_cast<const char*>(node) + line);
}

} // namespace

// Lower bounds on the squared distances, from the box, or from the slab and the ball around the box.
// Perpendicular to the slab it is the gap to it; parallel to it, the distance to the ball's projection.
// Together they separate clusters that lie side by side below p.
MARRAM_HOT void ColliderTree::distances_to(const Node& node, const float* p, float limit, Distances8& out) {
    const VFloat zero{}, half = splat_float(0.5F);
    const auto outside = [&](VFloat below, VFloat above)
                             MARRAM_ALWAYS_INLINE { return greater(greater(below, above), zero); };
    const Wide3f place{splat_float(p[0]), splat_float(p[1]), splat_float(p[2])};
    const Wide3f under = node.low - place, over = place - node.high;
    const VFloat x = outside(under.x, over.x), y = outside(under.y, over.y), z = outside(under.z, over.z);
    const VFloat h = dot(node.normal, place);
    const VFloat gap = outside(node.bottom - h, h - node.top);
    const Wide3f from = place - (node.low + node.high) * half, extent = (node.high - node.low) * half;
    const VFloat height = dot(from, node.normal), squared = dot(from, from);
    const VFloat lateral = vsqrt(greater(squared * (1.0F - 0x1p-20F) - height * height, zero));
    const VFloat lateral_gap = greater(lateral - vsqrt(dot(extent, extent)) * (1.0F + 0x1p-20F), zero);
    out.squared = greater(x * x + y * y + z * z, gap * gap + lateral_gap * lateral_gap);
    out.within = bits_of(out.squared <= limit);
}

// Traverses the tree from the root down; complete = false: more than `most` clusters.
MARRAM_HOT void ColliderTree::walk(const MarramMesh* meshes, const RegionQuery& q, size_t most,
                                   std::vector<NearCluster>& found, bool& complete) const {
    const Node* const nodes = nodes_.data();
    const Run* const runs = topology_->nodes.data();
    const uint32_t above_blocks = topology_->levels[1]; // from here on the children of nodes are nodes
    uint32_t stack[stack_size];
    size_t top = 0;
    stack[top++] = uint32_t(nodes_.size() - 1);
    while (top > 0) {
        const uint32_t n = stack[--top];
        const uint32_t first = runs[n].first;
        const uint32_t child_mask = (1U << runs[n].count) - 1U;
        uint32_t bits = touched(nodes[n], q) & child_mask;
        if (n >= above_blocks) {
            for (; bits != 0; bits &= bits - 1) {
                const uint32_t child = first + uint32_t(std::countr_zero(bits));
                stack[top++] = child;
                prefetch_node(nodes + child);
            }
            continue;
        }
        for (uint32_t later = bits; later != 0; later &= later - 1)
            if (const ClusteredBlock* next =
                    clustered_blocks_[first + uint32_t(std::countr_zero(later))].load(
                        std::memory_order_acquire))
                prefetch_node(&next->node);
        for (; bits != 0; bits &= bits - 1) {
            const uint32_t number = first + uint32_t(std::countr_zero(bits));
            const ClusteredBlock& block = clusters_of(meshes, number);
            const uint32_t cluster_mask = (1U << block.clusters) - 1U;
            for (uint32_t in = touched(block.node, q) & cluster_mask; in != 0; in &= in - 1) {
                if (found.size() >= most) {
                    complete = false;
                    return;
                }
                const auto i = uint32_t(std::countr_zero(in));
                found.push_back({&block.cluster(i), topology_->blocks[number].mesh, block.triangles[i]});
            }
        }
    }
}

bool ColliderTree::find(const MarramMesh* meshes, const SearchRegion& region, size_t most,
                        std::vector<NearCluster>& found) const {
    found.clear();
    if (nodes_.empty()) return true;
    RegionQuery q;
    q.count = region.points().size();
    const Vec3d origin = origin_.cast<double>();
    Vec3d low = Vec3d::Constant(infinity), high = -low;
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
    if (!(radius < embree_limit)) return true;
    for (int axis = 0; axis < 3; ++axis) {
        q.low[axis] = float(low[axis] - radius);
        q.high[axis] = float(high[axis] + radius);
    }
    q.radius = float(radius);
    q.flat = !region.normal().isZero(0.0);
    const Vec3f n = region.normal().cast<float>();
    q.normal = {splat_float(n.x()), splat_float(n.y()), splat_float(n.z())};
    q.abs_normal = {splat_float(std::abs(n.x())), splat_float(std::abs(n.y())), splat_float(std::abs(n.z()))};
    q.height = q.flat ? float(region.normal().dot(region.points()[0] - origin)) : 0.0F;
    bool complete = true;
    walk(meshes, q, most, found, complete);
    return complete;
}

} // namespace marram
