// SPDX-License-Identifier: Apache-2.0
// Makes values signed distances again, for level_set.cpp alone.
//
// Renormalisation, each pass. Voxels with a neighbour of opposite sign keep the surface in place: they become
// phi / |grad phi|, per axis by the larger of the central difference and half the one-sided ones (after Russo
// and Smereka, J. Comput. Phys. 163, 2000). The others take three steps of
// phi_t = -sign(phi) (|grad phi| - 1) with Godunov's flux and second-order one-sided differences (ENO).
// Voxels without wear stay bitwise the same, so that a sheltered face does not creep over many passes.
#pragma once

#include "core/math/simd.h"
#include "procedural/erosion/level_set_leaves.h"

#include <openvdb/tools/Prune.h>

namespace marram {
namespace {

constexpr int relaxing_steps = 3;
constexpr float relaxing_step = 0.5F; // in h

// Eight voxels along z, a row of a leaf. p points to the first, whose neighbours are at +-x, +-y and +-1.

MARRAM_INLINE VFloat magnitude(VFloat a) { return a < 0.0F ? -a : a; }

MARRAM_INLINE VInt beside_surface(const float* p, int x, int y) {
    const VInt inside = vload(p) < 0.0F;
    VInt differ = {};
    for (const int step : {x, -x, y, -y, 1, -1}) differ = differ | ((vload(p + step) < 0.0F) ^ inside);
    return differ;
}

// Distances of voxels beside the surface, in voxels: phi / |grad phi|. See the top of
// the file.
MARRAM_INLINE VFloat subcell_distance(const float* p, int x, int y) {
    const VFloat phi = vload(p);
    VFloat square = {};
    for (const int step : {x, y, 1}) {
        const VFloat next = vload(p + step), previous = vload(p - step);
        const VFloat one_sided = vmax(magnitude(next - phi), magnitude(phi - previous));
        const VFloat greatest = vmax(magnitude(next - previous), one_sided) * 0.5F;
        square = square + greatest * greatest;
    }
    return phi / vsqrt(vmax(square, splat_float(0.04F)));
}

MARRAM_INLINE VFloat minmod(VFloat a, VFloat b) {
    return a * b > 0.0F ? (magnitude(a) < magnitude(b) ? a : b) : VFloat{};
}

// |grad phi| by Godunov's flux, upwind from the surface, with second-order one-sided differences.
MARRAM_INLINE VFloat upwind_slope(const float* p, int x, int y) {
    const VFloat phi = vload(p);
    const VInt outside = phi >= 0.0F;
    VFloat square = {};
    for (const int step : {x, y, 1}) {
        const VFloat next = vload(p + step), previous = vload(p - step);
        const VFloat here = next - 2.0F * phi + previous;
        VFloat minus = phi - previous + 0.5F * minmod(here, phi - 2.0F * previous + vload(p - 2 * step));
        VFloat plus = next - phi - 0.5F * minmod(here, vload(p + 2 * step) - 2.0F * next + phi);
        minus = outside ? minus : -minus, plus = outside ? plus : -plus;
        const VFloat a = vmax(minus, VFloat{}), b = vmin(plus, VFloat{});
        square = square + vmax(a * a, b * b);
    }
    return vsqrt(square);
}

// The active voxels of each row of a leaf, as bits.
using RowBits = std::array<uint8_t, size_t(leaf_side) * leaf_side>;

RowBits active_rows(const Leaf& leaf) {
    RowBits rows;
    for (size_t row = 0; row < rows.size(); ++row)
        rows[row] = uint8_t(leaf.getValueMask().getWord<uint64_t>(openvdb::Index(row / leaf_side)) >>
                            (row % leaf_side * leaf_side));
    return rows;
}

// body(first voxel of the row, pointer into the block, mask) for the rows with active voxels.
template <int halo, typename F>
MARRAM_INLINE void for_active_rows(const RowBits& rows, const Block<halo, float>& phi, F&& body) {
    for (int row = 0; row < leaf_side * leaf_side; ++row)
        if (const int bits = rows[size_t(row)]; bits != 0) {
            const float* const p = phi.values.data() + Block<halo, float>::index(row >> 3, row & 7, 0);
            const VInt active = (VInt{1, 2, 4, 8, 16, 32, 64, 128} & bits) != 0;
            body(row * leaf_side, p, active);
        }
}

// The distances beside the surface, to `to`, which holds those of now. before: those before the wear, or
// null.
MARRAM_HOT void place_surface(const RowBits& rows, const Block<1, float>& phi, const float* before,
                              float* to) {
    constexpr int x = Block<1, float>::step_i, y = Block<1, float>::step_j;
    for_active_rows(rows, phi, [&](int at, const float* p, VInt active) MARRAM_ALWAYS_INLINE {
        const VFloat distance = subcell_distance(p, x, y);
        VInt changes = active & beside_surface(p, x, y);
        VFloat result = distance;
        if (before) {
            const VFloat old = vload(before + at);
            changes = changes & (vload(p) != old);
            result = vmax(distance, old);
        }
        vstore(to + at, changes ? result : vload(p));
    });
}

// One step of phi_t = -sign(phi) (|grad phi| - 1) for voxels not beside the surface.
MARRAM_HOT void relax(const RowBits& rows, const Block<2, float>& phi, const float* before, float* to) {
    constexpr int x = Block<2, float>::step_i, y = Block<2, float>::step_j;
    for_active_rows(rows, phi, [&](int at, const float* p, VInt active) MARRAM_ALWAYS_INLINE {
        const VFloat old = vload(p), change = relaxing_step * (upwind_slope(p, x, y) - 1.0F);
        VInt changes = active & ~beside_surface(p, x, y);
        if (before) changes = changes & (old != vload(before + at));
        const VFloat result =
            old < 0.0F ? vmin(old + change, splat_float(-1e-3F)) : vmax(old - change, splat_float(1e-3F));
        vstore(to + at, changes ? result : old);
    });
}

// update(active voxels, block around a leaf, its values before the wear or null, its new values) for each
// leaf.
template <int halo, typename F>
void update_leaves(FloatTree& tree, Leaves& leaves, bool worn, F&& update) {
    for_leaves(leaves, [&](size_t begin, size_t end) {
        const openvdb::tree::ValueAccessor<const FloatTree> accessor(tree);
        Block<halo, float> phi;
        for (size_t n = begin; n < end; ++n) {
            const Leaf& leaf = leaves.leaf(n);
            phi.gather(Neighbourhood<FloatTree>(accessor, leaf.origin()));
            float* const to = leaves.getBuffer(n, 2).data();
            std::copy_n(leaf.buffer().data(), leaf_voxels, to);
            update(active_rows(leaf), phi, worn ? leaves.getBuffer(n, 1).data() : nullptr, to);
        }
    });
    leaves.swapLeafBuffer(2);
}

// Restores phi to a distance and keeps the surface in place. Buffer 2 is scratch. With `worn`, buffer 1 holds
// the distances before the wear, and voxels without change are kept.
void renormalise(FloatTree& tree, Leaves& leaves, bool worn) {
    update_leaves<1>(tree, leaves, worn, place_surface);
    for (int step = 0; step < relaxing_steps; ++step) update_leaves<2>(tree, leaves, worn, relax);
}

// Deactivates voxels outside the band and sets them to +-band.
void trim(FloatTree& tree, const Leaves& leaves) {
    for_leaves(leaves, [&](size_t begin, size_t end) {
        for (size_t n = begin; n < end; ++n) {
            Leaf& leaf = leaves.leaf(n);
            float* const phi = leaf.buffer().data();
            for (openvdb::Index at = 0; at < openvdb::Index(leaf_voxels); ++at)
                if (leaf.isValueOn(at) && !(std::abs(phi[at]) < band)) {
                    phi[at] = std::copysign(band, phi[at]);
                    leaf.setValueOff(at);
                } else if (!leaf.isValueOn(at)) {
                    phi[at] = std::copysign(band, phi[at]);
                }
        }
    });
    openvdb::tools::pruneLevelSet(tree);
}

} // namespace
} // namespace marram
