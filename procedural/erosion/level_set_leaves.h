// SPDX-License-Identifier: Apache-2.0
// The voxels of a level set by leaves of 8 x 8 x 8, with their neighbours. Includes OpenVDB: only for level_set.cpp and
// level_set_distances.h.
#pragma once

#include "procedural/abi/parallel.h"
#include "procedural/erosion/level_mesh.h"

#include <openvdb/Grid.h>
#include <openvdb/openvdb.h>
#include <openvdb/tree/LeafManager.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

namespace marram {

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using openvdb::Int32Tree;
using Leaf = FloatTree::LeafNodeType;
using Leaves = openvdb::tree::LeafManager<FloatTree>;
using CellLeaves = openvdb::tree::LeafManager<Int32Tree>;

inline constexpr int leaf_side = 8, leaf_voxels = leaf_side * leaf_side * leaf_side;
inline constexpr float band = float(level_set_band);
inline constexpr float min_inside_cell = 0.02F;

// phi: the signed distance, negative in rock, in voxels.

// A leaf and its 26 neighbours, or the values of tiles in their place.
template <typename Tree>
struct Neighbourhood {
    using T = typename Tree::ValueType;
    std::array<const T*, 27> leaf; // its values, or null
    std::array<T, 27> tile;
    Neighbourhood(const openvdb::tree::ValueAccessor<const Tree>& accessor, const Coord& origin) {
        int n = 0;
        for (int x = -1; x <= 1; ++x)
            for (int y = -1; y <= 1; ++y)
                for (int z = -1; z <= 1; ++z, ++n) {
                    const Coord at = origin.offsetBy(leaf_side * x, leaf_side * y, leaf_side * z);
                    const auto* const found = accessor.probeConstLeaf(at);
                    leaf[size_t(n)] = found ? found->buffer().data() : nullptr;
                    tile[size_t(n)] = leaf[size_t(n)] ? T(0) : accessor.getValue(at);
                }
    }
    // i, j, k from -8 to 15
    T at(int i, int j, int k) const {
        const int n = ((i + 8) >> 3) * 9 + ((j + 8) >> 3) * 3 + ((k + 8) >> 3);
        const T* const l = leaf[size_t(n)];
        return l ? l[((i & 7) << 6) | ((j & 7) << 3) | (k & 7)] : tile[size_t(n)];
    }
};

// Values of a leaf and `halo` voxels around it, contiguous.
template <int halo, typename T>
struct Block {
    static constexpr int side = leaf_side + 2 * halo;
    static constexpr int step_i = side * side, step_j = side;
    std::array<T, size_t(side) * side * side> values;

    static int index(int i, int j, int k) { return ((i + halo) * side + (j + halo)) * side + (k + halo); }
    T at(int i, int j, int k) const { return values[size_t(index(i, j, k))]; }
    const T* pointer(int i, int j, int k) const { return values.data() + index(i, j, k); }

    template <typename Tree>
    void gather(const Neighbourhood<Tree>& around) {
        for (int i = -halo; i < leaf_side + halo; ++i)
            for (int j = -halo; j < leaf_side + halo; ++j) {
                const auto n = size_t(((i + 8) >> 3) * 9 + ((j + 8) >> 3) * 3);
                const int row = ((i & 7) << 6) | ((j & 7) << 3);
                T* const out = values.data() + index(i, j, 0);
                gather_part<halo>(around, n, row + leaf_side - halo, out - halo);
                gather_part<leaf_side>(around, n + 1, row, out);
                gather_part<halo>(around, n + 2, row, out + leaf_side);
            }
    }

  private:
    // `count` is a constant, so that memcpy is inlined: a call took a sixth of the time.
    template <int count, typename Tree>
    static void gather_part(const Neighbourhood<Tree>& around, size_t n, int from, T* out) {
        if (const T* const leaf = around.leaf[n])
            std::memcpy(out, leaf + from, count * sizeof(T));
        else
            for (int k = 0; k < count; ++k) out[k] = around.tile[n];
    }
};

struct Float3 {
    float x = 0.0F, y = 0.0F, z = 0.0F;
    Float3 operator+(const Float3& o) const { return {x + o.x, y + o.y, z + o.z}; }
    Float3 operator-(const Float3& o) const { return {x - o.x, y - o.y, z - o.z}; }
    Float3 operator*(float s) const { return {x * s, y * s, z * s}; }
    float dot(const Float3& o) const { return x * o.x + y * o.y + z * o.z; }
};

inline Float3 cross(const Float3& a, const Float3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline Float3 unit(const Float3& v) {
    const float length = std::sqrt(v.dot(v));
    return length > 1e-12F ? v * (1.0F / length) : Float3{0.0F, 1.0F, 0.0F};
}

template <int halo>
Float3 central_gradient(const Block<halo, float>& phi, int i, int j, int k) {
    const float* const p = phi.pointer(i, j, k);
    constexpr int x = Block<halo, float>::step_i, y = Block<halo, float>::step_j;
    return Float3{p[x] - p[-x], p[y] - p[-y], p[1] - p[-1]} * 0.5F;
}

// Trilinear interpolation of the corners c[(i * 2 + j) * 2 + k] of a cell.
template <typename T>
T trilinear(const std::array<T, 8>& c, const Float3& t) {
    const auto mix = [](const T& a, const T& b, float s) { return a * (1.0F - s) + b * s; };
    return mix(mix(mix(c[0], c[1], t.z), mix(c[2], c[3], t.z), t.y),
               mix(mix(c[4], c[5], t.z), mix(c[6], c[7], t.z), t.y), t.x);
}

// Where phi < 0 in a block: bit k + halo of row (i, j).
template <int halo>
struct InsideRows {
    static constexpr int side = Block<halo, float>::side;
    std::array<uint32_t, size_t(side) * side> rows;

    explicit InsideRows(const Block<halo, float>& phi) {
        for (int row = 0; row < side * side; ++row) {
            const float* const p = phi.values.data() + row * side;
            uint32_t bits = 0;
            for (int k = 0; k < side; ++k) bits |= uint32_t(p[k] < 0.0F) << k;
            rows[size_t(row)] = bits;
        }
    }
    uint32_t row(int i, int j) const { return rows[size_t((i + halo) * side + j + halo)]; }

    // Bit k: the corners of the cell from voxel (i, j, k) on are not all on one side.
    uint32_t mixed_cells(int i, int j) const {
        const uint32_t a = row(i, j), b = row(i, j + 1), c = row(i + 1, j), d = row(i + 1, j + 1);
        const uint32_t any = a | b | c | d, all = a & b & c & d;
        return ((any | any >> 1) & ~(all & all >> 1)) >> halo & 0xffU;
    }
    // Bit k: one of the edges from voxel (i, j, k) along the axes ends on the other side.
    uint32_t crossed_edges(int i, int j) const {
        const uint32_t a = row(i, j);
        return ((a ^ row(i + 1, j)) | (a ^ row(i, j + 1)) | (a ^ a >> 1)) >> halo & 0xffU;
    }
};

// body(i, j, k) for the bits k of each row (i, j) of a leaf.
void for_voxels(auto&& bits, auto&& body) {
    for (int i = 0; i < leaf_side; ++i)
        for (int j = 0; j < leaf_side; ++j)
            for (uint32_t left = bits(i, j); left != 0; left &= left - 1) body(i, j, std::countr_zero(left));
}

// Mesh vertex of a cell. place: from the lower corner of the cell, in voxels.
struct CellVertex {
    Float3 place, normal;
};

inline CellVertex cell_vertex(const std::array<float, 8>& corner, const std::array<Float3, 8>& slope) {
    Float3 sum;
    float count = 0.0F;
    const auto cross = [&](int a, int b) {
        const float pa = corner[size_t(a)], pb = corner[size_t(b)];
        if ((pa < 0.0F) == (pb < 0.0F)) return;
        const float t = pa / (pa - pb);
        const auto at = [](int c) { return Float3{float(c >> 2 & 1), float(c >> 1 & 1), float(c & 1)}; };
        sum = sum + at(a) * (1.0F - t) + at(b) * t;
        count += 1.0F;
    };
    for (const int bit : {1, 2, 4})
        for (int c = 0; c < 8; ++c)
            if (!(c & bit)) cross(c, c | bit);
    Float3 p = sum * (1.0F / count);
    const auto inside = [](float s) { return std::clamp(s, min_inside_cell, 1.0F - min_inside_cell); };
    for (int step = 0; step < 2; ++step) {
        const Float3 g = trilinear(slope, p);
        const float square = g.dot(g);
        if (!(square > 0.04F)) break; // a crease: no useful gradient
        p = p - g * (trilinear(corner, p) / square);
        p = {inside(p.x), inside(p.y), inside(p.z)};
    }
    return {p, unit(trilinear(slope, p))};
}

void for_leaves(const Leaves& leaves, const auto& body) {
    marram::parallel_for(tbb::blocked_range<size_t>(0, leaves.leafCount(), 8),
                         [&](const tbb::blocked_range<size_t>& range) { body(range.begin(), range.end()); });
}

} // namespace marram
