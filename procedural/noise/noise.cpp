// SPDX-License-Identifier: Apache-2.0
#include "procedural/noise/noise.h"

#include "procedural/noise/wavelet_noise.h"

#include <cmath>

namespace marram {
namespace {

MARRAM_INLINE VFloat fade(VFloat t) { return t * t * t * (t * (t * 6.0F - 15.0F) + 10.0F); }
MARRAM_INLINE VFloat mix_linear(VFloat t, VFloat a, VFloat b) { return a + t * (b - a); }

MARRAM_INLINE VFloat with_sign(VFloat x, VUint sign_bit) {
    return bits_as<VFloat>(bits_as<VUint>(x) ^ (sign_bit << 31));
}

// gradient . (x, y, z); four bits of h select one of (+-1, +-1, 0), (+-1, 0, +-1), (0, +-1, +-1).
MARRAM_INLINE VFloat gradient3(VUint h, VFloat x, VFloat y, VFloat z) {
    const VUint low = h & 15U;
    const VFloat u = low < 8U ? x : y;
    const VUint cube = h & 13U; // 12 and 14 are the two repeated directions, which use x
    VFloat v = cube == 12U ? x : z;
    v = low < 4U ? y : v;
    return with_sign(u, h & 1U) + with_sign(v, (h >> 1) & 1U);
}

// The same in four dimensions: five bits of h; one component is 0, the other three +-1.
MARRAM_INLINE VFloat gradient4(VUint h, VFloat x, VFloat y, VFloat z, VFloat w) {
    const VUint low = h & 31U;
    const VFloat a = low < 24U ? x : y;
    const VFloat b = low < 16U ? y : z;
    const VFloat c = low < 8U ? z : w;
    return with_sign(a, h & 1U) + with_sign(b, (h >> 1) & 1U) + with_sign(c, (h >> 2) & 1U);
}

struct Cell {
    VUint corner[3][2]; // hashed contribution of each axis, low and high side
    VFloat fraction[3];
    VFloat blend[3];
};

MARRAM_INLINE Cell cell_of(const Wide3d& p) {
    Cell cell;
    const VDouble coordinate[3] = {p.x, p.y, p.z};
    constexpr uint32_t stride[3] = {0x9e3779b1U, 0x85ebca77U, 0xc2b2ae3dU}; // odd: a bijection on each axis
    for (int axis = 0; axis < 3; ++axis) {
        VInt index;
        const VDouble base = vfloor(coordinate[axis], index);
        cell.fraction[axis] = to_float(coordinate[axis] - base);
        cell.blend[axis] = fade(cell.fraction[axis]);
        cell.corner[axis][0] = bits_as<VUint>(index) * stride[axis];
        cell.corner[axis][1] = cell.corner[axis][0] + stride[axis];
    }
    return cell;
}

// Hash of one corner. The axes are mixed in one after the other, so that planes of the lattice do not repeat.
MARRAM_INLINE VUint corner_hash(const Cell& cell, int i, int j, int k, uint32_t seed) {
    const VUint h = (cell.corner[0][i] ^ seed) + cell.corner[1][j] * 3U;
    return mix32((h ^ (h >> 15)) * 0x2c1b3c6dU + cell.corner[2][k]);
}

MARRAM_INLINE VFloat blend3(const Cell& cell, const VFloat v[8]) {
    const VFloat x00 = mix_linear(cell.blend[0], v[0], v[1]), x10 = mix_linear(cell.blend[0], v[2], v[3]);
    const VFloat x01 = mix_linear(cell.blend[0], v[4], v[5]), x11 = mix_linear(cell.blend[0], v[6], v[7]);
    return mix_linear(cell.blend[2], mix_linear(cell.blend[1], x00, x10),
                      mix_linear(cell.blend[1], x01, x11));
}

MARRAM_INLINE Wide3f perlin3(const Wide3d& p, uint32_t seed) {
    const Cell cell = cell_of(p);
    VFloat v[3][8];
    for (int corner = 0; corner < 8; ++corner) {
        const int i = corner & 1, j = (corner >> 1) & 1, k = corner >> 2;
        const VUint h = corner_hash(cell, i, j, k, seed);
        const VFloat x = cell.fraction[0] - float(i), y = cell.fraction[1] - float(j),
                     z = cell.fraction[2] - float(k);
        for (int component = 0; component < 3; ++component)
            v[component][corner] = gradient3(h >> (8 * component), x, y, z);
    }
    return {blend3(cell, v[0]), blend3(cell, v[1]), blend3(cell, v[2])};
}

// The fourth coordinate is the same for all points of a call: its cell and blend are scalars.
struct Layers {
    uint32_t index; // of the layer below w
    float fraction; // towards the layer above
    float blend;
};

MARRAM_INLINE Layers layers_at(double w) {
    const double base = std::floor(w);
    const float t = float(w - base);
    return {static_cast<uint32_t>(static_cast<int64_t>(base)), t,
            t * t * t * (t * (t * 6.0F - 15.0F) + 10.0F)};
}

MARRAM_INLINE uint32_t layer_seed(uint32_t seed, uint32_t layer) { return seed ^ (layer * 0x27d4eb2fU); }

MARRAM_INLINE Wide3f perlin4(const Wide3d& p, double w, uint32_t seed) {
    const Cell cell = cell_of(p);
    const Layers layers = layers_at(w);
    Wide3f side[2];
    for (int l = 0; l < 2; ++l) {
        VFloat v[3][8];
        for (int corner = 0; corner < 8; ++corner) {
            const int i = corner & 1, j = (corner >> 1) & 1, k = corner >> 2;
            const VUint h = corner_hash(cell, i, j, k, layer_seed(seed, layers.index + uint32_t(l)));
            const VFloat x = cell.fraction[0] - float(i), y = cell.fraction[1] - float(j);
            const VFloat z = cell.fraction[2] - float(k), u = splat_float(layers.fraction - float(l));
            for (int component = 0; component < 3; ++component)
                v[component][corner] = gradient4(h >> (8 * component), x, y, z, u);
        }
        side[l] = {blend3(cell, v[0]), blend3(cell, v[1]), blend3(cell, v[2])};
    }
    return side[0] + (side[1] - side[0]) * splat_float(layers.blend);
}

struct Fold { // (|noise| - mean) scale has mean 0 and Perlin's rms
    float mean, scale;
};

Fold fold_of(bool four) {
    const double rms = four ? perlin_rms_4d : perlin_rms_3d;
    const double mean = four ? perlin_fold_mean_4d : perlin_fold_mean_3d;
    return {float(mean), float(rms / std::sqrt(rms * rms - mean * mean))};
}

MARRAM_INLINE VFloat folded(VFloat noise, Fold fold) {
    return (bits_as<VFloat>(bits_as<VUint>(noise) & 0x7fffffffU) - fold.mean) *
           fold.scale; // without the sign bit
}

// Coordinates that do not resolve a quarter of a cell, and infinities, become 0: no index overflows.
constexpr double noise_reach = 0x1p50;
MARRAM_INLINE VDouble in_reach(VDouble x) { return select(vabs(x) <= noise_reach, x, 0.0); }
MARRAM_INLINE Wide3d in_reach(const Wide3d& p) { return {in_reach(p.x), in_reach(p.y), in_reach(p.z)}; }

// The sum over octaves of octave_at(point in cells, octave), normalised to the rms of one octave.
template <typename Octave>
MARRAM_INLINE void sum_octaves(const FractalNoise& noise, const Wide3d* points, int count, Wide3f* out,
                               Octave&& octave_at) {
    double squares = 0.0, weight = 1.0;
    for (int octave = 0; octave < noise.octaves; ++octave, weight *= noise.gain) squares += weight * weight;
    const double scale = 1.0 / std::sqrt(squares);
    for (int i = 0; i < count; ++i) {
        Wide3f sum{};
        double frequency = noise.frequency, amplitude = scale;
        for (int octave = 0; octave < noise.octaves - noise.left_out; ++octave) {
            const Wide3f value = octave_at(in_reach(points[i] * splat(frequency)), octave);
            sum = sum + value * splat_float(float(amplitude));
            frequency *= noise.lacunarity;
            amplitude *= noise.gain;
        }
        out[i] = sum;
    }
}

MARRAM_INLINE uint32_t octave_seed(const FractalNoise& noise, int octave) {
    return noise.seed + uint32_t(octave) * 0x6d2b79f5U;
}

MARRAM_HOT void perlin_noise(const FractalNoise& noise, const Wide3d* points, int count, bool four, double w,
                             Wide3f* out) {
    sum_octaves(noise, points, count, out, [&](const Wide3d& p, int octave) MARRAM_ALWAYS_INLINE {
        const uint32_t seed = octave_seed(noise, octave);
        return four ? perlin4(p, w, seed) : perlin3(p, seed);
    });
}

MARRAM_HOT void billow_noise(const FractalNoise& noise, const Wide3d* points, int count, bool four, double w,
                             Wide3f* out) {
    const Fold fold = fold_of(four);
    sum_octaves(noise, points, count, out, [&](const Wide3d& p, int octave) MARRAM_ALWAYS_INLINE {
        const uint32_t seed = octave_seed(noise, octave);
        const Wide3f value = four ? perlin4(p, w, seed) : perlin3(p, seed);
        return Wide3f{folded(value.x, fold), folded(value.y, fold), folded(value.z, fold)};
    });
}

MARRAM_HOT void wavelet_noise(const FractalNoise& noise, const Quad* tile, const Wide3d* points, int count,
                              bool four, double w, Wide3f* out) {
    const Layers layers = layers_at(four ? w : 0.0);
    const float u = layers.blend, norm = 1.0F / std::sqrt(u * u + (1.0F - u) * (1.0F - u));
    const VFloat share = splat_float((1.0F - u) * norm), next_share = splat_float(u * norm);
    sum_octaves(noise, points, count, out, [&](const Wide3d& p, int octave) MARRAM_ALWAYS_INLINE {
        const uint32_t seed = octave_seed(noise, octave);
        const Wide3d q = wavelet_turn(p);
        const Wide3f value = wavelet_at(tile, q + wavelet_offset(layer_seed(seed, layers.index)));
        if (!four) return value;
        const Wide3f next = wavelet_at(tile, q + wavelet_offset(layer_seed(seed, layers.index + 1U)));
        return value * share + next * next_share;
    });
}

} // namespace

void vector_noise(const FractalNoise& noise, const Wide3d* points, int count, bool four, double w,
                  Wide3f* out) {
    const double place = std::abs(w) <= noise_reach ? w : 0.0;
    switch (noise.type) {
    case NoiseType::perlin:
        return perlin_noise(noise, points, count, four, place, out);
    case NoiseType::billow:
        return billow_noise(noise, points, count, four, place, out);
    case NoiseType::wavelet:
        return wavelet_noise(noise, wavelet_tile(), points, count, four, place, out);
    }
}

} // namespace marram
