// SPDX-License-Identifier: Apache-2.0
// Grids of velocities, as the host lends them (MarramVolume), and their interpolation.
//
// Samples are at the centres of voxels; the box of a grid is that of its voxels, half a voxel beyond the
// outer samples. Between samples velocities are trilinear, in the outer half voxel those of the nearest
// samples. In a staggered grid component a of sample (i, j, k) is at the face half a voxel before it along
// axis a, and each component is interpolated between its own places.
//
// ERROR: the interpolation is in floats: 3e-7 of the largest velocity around.
#pragma once

#include "core/math/simd.h"
#include "core/math/vec.h"
#include "core/plugin/marram_plugin.h"

#include <array>
#include <cstddef>
#include <vector>

namespace marram {

struct VelocitySamples {
    std::array<int, 3> counts{};
    Vec3d center = Vec3d::Zero(); // of its box, m
    Eigen::Matrix3d half =
        Eigen::Matrix3d::Identity(); // column a: from the centre to the middle of a face, m
    const float* values = nullptr;   // the host's: 3 a sample, the first axis fastest
};

struct Velocities {
    std::vector<double> frames; // strictly ascending; empty with one grid
    std::vector<VelocitySamples> grids;
    bool staggered = false;
    double max_speed = 0.0; // m/s
};

// `volume` must have passed the checks of contract_checks.h, and outlive the result.
Velocities velocities_of(const MarramVolume& volume);

// The two grids around a frame, and the share of the second.
struct VelocityTimes {
    size_t first = 0, second = 0;
    double share = 0.0;
};
VelocityTimes velocity_times(const Velocities& velocities, double frame);

// Along one axis of n samples: the lower of two neighbours, how far on the upper is (0 or 1), and the share
// of the upper.
struct SamplePair {
    VInt lower, step;
    VFloat share;
};
// x: -1 ... 1 over the n voxels. shift: of the samples, in voxels.
MARRAM_INLINE SamplePair sample_pair(const VDouble& x, int n, double shift) {
    const VDouble at = vmin(vmax((x + 1.0) * (0.5 * n) - (0.5 + shift), VDouble{}), double(n - 1));
    SamplePair pair;
    const VDouble below = vfloor(at, pair.lower);
    pair.share = to_float(at - below);
    const VInt last = VInt{} + (n - 1);
    pair.step = pair.lower < last ? VInt{} + 1 : VInt{};
    return pair;
}

MARRAM_INLINE VFloat mixed(VFloat a, VFloat b, VFloat share) { return a + (b - a) * share; }

// `channels` of eight places in a grid of `stride` floats a sample, from the channel `first` on.
template <int channels, int stride>
MARRAM_INLINE void trilinear(const float* values, const std::array<int, 3>& counts, const SamplePair& x,
                             const SamplePair& y, const SamplePair& z, VFloat* out) {
    alignas(32) float corners[8][channels][lanes];
    for (int lane = 0; lane < lanes; ++lane) {
        const ptrdiff_t row = ptrdiff_t(counts[0]) * stride, slice = row * counts[1];
        const float* const base =
            values + x.lower[lane] * ptrdiff_t(stride) + y.lower[lane] * row + z.lower[lane] * slice;
        const ptrdiff_t dx = x.step[lane] * ptrdiff_t(stride), dy = y.step[lane] * row,
                        dz = z.step[lane] * slice;
        for (int corner = 0; corner < 8; ++corner) {
            const float* const sample =
                base + (corner & 1 ? dx : 0) + (corner & 2 ? dy : 0) + (corner & 4 ? dz : 0);
            for (int c = 0; c < channels; ++c) corners[corner][c][lane] = sample[c];
        }
    }
    for (int c = 0; c < channels; ++c) {
        const auto along_x = [&](int corner) MARRAM_ALWAYS_INLINE {
            return mixed(vload(corners[corner][c]), vload(corners[corner + 1][c]), x.share);
        };
        out[c] =
            mixed(mixed(along_x(0), along_x(2), y.share), mixed(along_x(4), along_x(6), y.share), z.share);
    }
}

// The neighbours of eight places along the three axes.
struct GridPlaces {
    SamplePair x, y, z;
    SamplePair face_x, face_y, face_z; // of the component along that axis, if the grid is staggered
};
// x: in units of the box.
MARRAM_INLINE GridPlaces grid_places(const std::array<int, 3>& counts, bool staggered, const Wide3d& x) {
    GridPlaces places{sample_pair(x.x, counts[0], 0.0), sample_pair(x.y, counts[1], 0.0),
                      sample_pair(x.z, counts[2], 0.0)};
    if (staggered) {
        places.face_x = sample_pair(x.x, counts[0], -0.5);
        places.face_y = sample_pair(x.y, counts[1], -0.5);
        places.face_z = sample_pair(x.z, counts[2], -0.5);
    }
    return places;
}

// Velocities there, in the axes of the file.
MARRAM_INLINE Wide3d velocities_at(const VelocitySamples& grid, bool staggered, const GridPlaces& at) {
    VFloat v[3];
    if (!staggered) {
        trilinear<3, 3>(grid.values, grid.counts, at.x, at.y, at.z, v);
    } else {
        trilinear<1, 3>(grid.values, grid.counts, at.face_x, at.y, at.z, v);
        trilinear<1, 3>(grid.values + 1, grid.counts, at.x, at.face_y, at.z, v + 1);
        trilinear<1, 3>(grid.values + 2, grid.counts, at.x, at.y, at.face_z, v + 2);
    }
    return to_double(Wide3f{v[0], v[1], v[2]});
}

} // namespace marram
