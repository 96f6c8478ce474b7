// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/noise.h"

#include "core/math/hash.h"

namespace marram::oracle {
namespace {

// Perlin's 16 gradients in the order of the low four bits.
constexpr int cube_edges[16][3] = {{1, 1, 0},  {-1, 1, 0},  {1, -1, 0}, {-1, -1, 0}, {1, 0, 1},  {-1, 0, 1},
                                   {1, 0, -1}, {-1, 0, -1}, {0, 1, 1},  {0, -1, 1},  {0, 1, -1}, {0, -1, -1},
                                   {1, 1, 0},  {0, -1, 1},  {-1, 1, 0}, {0, -1, -1}};

// Edge directions of a hypercube by five bits: the top two give the zero axis, in descending order (3: x,
// 2: y, 1: z, 0: w), the low three the signs of the other axes in order.
Eigen::Vector4d hypercube_edge(uint32_t bits) {
    const int absent = 3 - int((bits >> 3) & 3U); // 24 to 31: x is zero, ..., 0 to 7: w
    Eigen::Vector4d edge = Eigen::Vector4d::Zero();
    int sign = 0;
    for (int axis = 0; axis < 4; ++axis)
        if (axis != absent) edge[axis] = ((bits >> sign++) & 1U) != 0U ? -1.0 : 1.0;
    return edge;
}

// A cell's number on an axis: the lattice repeats after 2^32 cells.
uint32_t cell_number(double base) { return uint32_t(int64_t(base)); }

double fade(double t) { return ((6.0 * t - 15.0) * t + 10.0) * t * t * t; }

uint32_t corner_hash(uint32_t x, uint32_t y, uint32_t z, uint32_t seed) {
    const uint32_t plane = ((x * 0x9e3779b1U) ^ seed) + y * 0x85ebca77U * 3U;
    return mix32((plane ^ (plane >> 15)) * 0x2c1b3c6dU + z * 0xc2b2ae3dU);
}

// Sum over the corners of the cell around `cells`; contribution(hash, offset from the corner) for one
// component.
template <typename Contribution>
Vec3d blended(const Vec3d& cells, uint32_t seed, Contribution&& contribution) {
    const Vec3d base = cells.array().floor(), fraction = cells - base;
    Vec3d sum = Vec3d::Zero();
    for (uint32_t corner = 0; corner < 8; ++corner) {
        const uint32_t step[3] = {corner & 1U, (corner >> 1) & 1U, corner >> 2};
        double weight = 1.0;
        Vec3d offset;
        for (int axis = 0; axis < 3; ++axis) {
            const double t = fade(fraction[axis]);
            weight *= step[axis] == 1U ? t : 1.0 - t;
            offset[axis] = fraction[axis] - double(step[axis]);
        }
        const uint32_t h = corner_hash(cell_number(base.x()) + step[0], cell_number(base.y()) + step[1],
                                       cell_number(base.z()) + step[2], seed);
        for (int component = 0; component < 3; ++component)
            sum[component] += weight * contribution(h >> (8 * component), offset);
    }
    return sum;
}

template <typename Octave>
Vec3d octaves(const Fractal& noise, const Vec3d& metres, Octave&& octave) {
    Vec3d sum = Vec3d::Zero();
    double squares = 0.0, weight = 1.0, frequency = noise.frequency;
    for (int i = 0; i < noise.octaves; ++i) {
        sum += weight * octave(Vec3d(metres * frequency), noise.seed + uint32_t(i) * 0x6d2b79f5U);
        squares += weight * weight;
        weight *= noise.gain;
        frequency *= noise.lacunarity;
    }
    return sum / std::sqrt(squares);
}

} // namespace

Vec3d perlin(const Vec3d& cells, uint32_t seed) {
    return blended(cells, seed, [](uint32_t bits, const Vec3d& offset) {
        const int* edge = cube_edges[bits & 15U];
        return edge[0] * offset.x() + edge[1] * offset.y() + edge[2] * offset.z();
    });
}

Vec3d perlin(const Vec3d& cells, double fourth, uint32_t seed) {
    const double base = std::floor(fourth), fraction = fourth - base;
    auto layer = [&](uint32_t step) {
        const uint32_t layer_seed = seed ^ ((cell_number(base) + step) * 0x27d4eb2fU);
        return blended(cells, layer_seed, [&](uint32_t bits, const Vec3d& offset) {
            return hypercube_edge(bits).dot(
                Eigen::Vector4d(offset.x(), offset.y(), offset.z(), fraction - double(step)));
        });
    };
    return (1.0 - fade(fraction)) * layer(0) + fade(fraction) * layer(1);
}

Vec3d fractal_noise(const Fractal& noise, const Vec3d& metres) {
    return octaves(noise, metres, [](const Vec3d& cells, uint32_t seed) { return perlin(cells, seed); });
}

Vec3d fractal_noise(const Fractal& noise, const Vec3d& metres, double fourth) {
    return octaves(noise, metres,
                   [&](const Vec3d& cells, uint32_t seed) { return perlin(cells, fourth, seed); });
}

} // namespace marram::oracle
