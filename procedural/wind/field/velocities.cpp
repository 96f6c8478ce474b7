// SPDX-License-Identifier: Apache-2.0
#include "procedural/wind/field/velocities.h"

#include "core/math/known_part.h"
#include "procedural/abi/parallel.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

// The largest speed of a slice of samples.
double max_speed_of(const MarramGrid& grid, uint32_t k) {
    const size_t count = size_t(grid.nx) * grid.ny;
    const float* const first = grid.values + 3 * count * k;
    float most = 0.0F;
    for (size_t s = 0; s < count; ++s) {
        const float *v = first + 3 * s, squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        most = std::max(most, squared);
    }
    return std::sqrt(double(most));
}

} // namespace

Velocities velocities_of(const MarramVolume& given) {
    const MarramVolume volume = known_part(&given);
    Velocities velocities;
    velocities.staggered = volume.staggered != 0;
    if (volume.frames && volume.count > 1)
        velocities.frames.assign(volume.frames, volume.frames + volume.count);
    for (const MarramGrid& grid : known_parts(volume.grids, volume.count, volume.grid_stride)) {
        VelocitySamples& samples = velocities.grids.emplace_back();
        samples.counts = {int(grid.nx), int(grid.ny), int(grid.nz)};
        samples.values = grid.values;
        samples.center = Vec3d(grid.origin);
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3d step(grid.axes[axis]);
            samples.half.col(axis) = 0.5 * samples.counts[size_t(axis)] * step;
            samples.center += 0.5 * (samples.counts[size_t(axis)] - 1) * step;
        }
        std::vector<double> slices(grid.nz);
        parallel_for(0, int(grid.nz), [&](int k) { slices[size_t(k)] = max_speed_of(grid, uint32_t(k)); });
        velocities.max_speed = std::max(velocities.max_speed, *std::ranges::max_element(slices));
    }
    return velocities;
}

VelocityTimes velocity_times(const Velocities& velocities, double frame) {
    const std::vector<double>& frames = velocities.frames;
    if (frames.empty() || frame <= frames.front()) return {};
    const size_t last = frames.size() - 1;
    if (frame >= frames.back()) return {last, last, 0.0};
    const size_t second = size_t(std::ranges::upper_bound(frames, frame) - frames.begin());
    const double begin = frames[second - 1], end = frames[second];
    return {second - 1, second, (frame - begin) / (end - begin)};
}

} // namespace marram
