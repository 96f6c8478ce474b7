// SPDX-License-Identifier: Apache-2.0
// The sort is by counting, ten bits at a time, in chunks side by side: tbb::parallel_sort took four times as long on two
// million triangles.
#include "procedural/wind/morton_order.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace marram {
namespace {

constexpr int axis_bits = 10, number_bits = 32;
constexpr size_t chunk = 1 << 16; // triangles a task
constexpr uint64_t left_out = ~uint64_t(0);

struct Box {
    float low[3], high[3];
};

constexpr float nowhere = std::numeric_limits<float>::infinity();
constexpr Box no_box{{nowhere, nowhere, nowhere}, {-nowhere, -nowhere, -nowhere}};

void extend(Box& box, const float* p) {
    for (int axis = 0; axis < 3; ++axis) {
        box.low[axis] = std::min(box.low[axis], p[axis]);
        box.high[axis] = std::max(box.high[axis], p[axis]);
    }
}

const float* corner(const MarramMesh& mesh, uint32_t time, size_t triangle, size_t i) {
    return mesh.positions[time] + 3 * size_t(mesh.triangles[3 * triangle + i]);
}

// Whether the triangle is finite at all samples (Embree drops others, too), and touches the reach at one.
bool matters(const MarramMesh& mesh, size_t triangle, const Box& reach) {
    bool touches = false;
    for (uint32_t time = 0; time < mesh.time_count; ++time) {
        Box box = no_box;
        float sum = 0.0F;
        for (size_t i = 0; i < 3; ++i) {
            const float* p = corner(mesh, time, triangle, i);
            sum += 0.0F * (p[0] + p[1] + p[2]);
            extend(box, p);
        }
        if (sum != 0.0F) return false; // NaN
        bool apart = false;
        for (int axis = 0; axis < 3; ++axis)
            apart |= box.low[axis] > reach.high[axis] || box.high[axis] < reach.low[axis];
        touches |= !apart;
    }
    return touches;
}

uint32_t spread_bits(uint32_t x) { // abc -> a00b00c
    x = (x | x << 16) & 0x030000ffU;
    x = (x | x << 8) & 0x0300f00fU;
    x = (x | x << 4) & 0x030c30c3U;
    return (x | x << 2) & 0x09249249U;
}

struct Grid {
    float low[3], cells[3]; // cells a metre; 0 along an axis without extent

    explicit Grid(const Box& box) {
        for (int axis = 0; axis < 3; ++axis) {
            const double size = double(box.high[axis]) - double(box.low[axis]);
            low[axis] = box.low[axis];
            cells[axis] = size > 0.0 ? float(std::min(double(1 << axis_bits) / size, 1e30)) : 0.0F;
        }
    }
    uint64_t code(const float* a, const float* b, const float* c) const {
        constexpr float last = (1 << axis_bits) - 1;
        uint32_t code = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float middle = (a[axis] + b[axis] + c[axis]) * (1.0F / 3.0F);
            code |= spread_bits(uint32_t(std::min(std::max((middle - low[axis]) * cells[axis], 0.0F), last)))
                    << axis;
        }
        return code;
    }
};

template <typename Work>
void each_chunk(size_t count, Work&& work) { // work(chunk, begin, end)
    tbb::parallel_for(size_t(0), (count + chunk - 1) / chunk,
                      [&](size_t i) { work(i, i * chunk, std::min(count, (i + 1) * chunk)); });
}

// By the bits from number_bits on; equal codes stay in order.
void sort_by_code(std::vector<uint64_t>& codes) {
    constexpr size_t digits = 1 << axis_bits;
    std::vector<uint64_t> other(codes.size());
    std::vector<std::array<size_t, digits>> begins((codes.size() + chunk - 1) / chunk);
    for (int shift = number_bits; shift < number_bits + 3 * axis_bits; shift += axis_bits) {
        const auto digit = [shift](uint64_t code) { return size_t(code >> shift) % digits; };
        each_chunk(codes.size(), [&](size_t i, size_t begin, size_t end) {
            begins[i].fill(0);
            for (size_t t = begin; t < end; ++t) ++begins[i][digit(codes[t])];
        });
        size_t sum = 0;
        for (size_t d = 0; d < digits; ++d)
            for (auto& counts : begins) sum += std::exchange(counts[d], sum);
        each_chunk(codes.size(), [&](size_t i, size_t begin, size_t end) {
            for (size_t t = begin; t < end; ++t) other[begins[i][digit(codes[t])]++] = codes[t];
        });
        codes.swap(other);
    }
}

} // namespace

std::vector<uint64_t> morton_order(const MarramMesh& mesh, const Eigen::AlignedBox3d& reach) {
    Box near; // the reach, in floats
    for (int axis = 0; axis < 3; ++axis) {
        near.low[axis] = std::nextafter(float(reach.min()[axis]), -nowhere);
        near.high[axis] = std::nextafter(float(reach.max()[axis]), nowhere);
    }
    // Around what is finite, at all samples: what flies in later lies elsewhere at the first.
    Box all = tbb::parallel_reduce(
        tbb::blocked_range<size_t>(0, mesh.vertex_count, chunk), no_box,
        [&](const auto& range, Box box) {
            for (uint32_t time = 0; time < mesh.time_count; ++time)
                for (size_t v = range.begin(); v < range.end(); ++v) {
                    const float* p = mesh.positions[time] + 3 * v;
                    if (0.0F * (p[0] + p[1] + p[2]) == 0.0F) extend(box, p);
                }
            return box;
        },
        [](Box a, const Box& b) {
            extend(a, b.low);
            extend(a, b.high);
            return a;
        });
    for (int axis = 0; axis < 3; ++axis) {
        all.low[axis] = std::max(all.low[axis], near.low[axis]);
        all.high[axis] = std::min(all.high[axis], near.high[axis]);
        if (!(all.low[axis] <= all.high[axis])) return {};
    }
    const Grid grid(all);
    std::vector<uint64_t> codes(mesh.triangle_count);
    each_chunk(codes.size(), [&](size_t, size_t begin, size_t end) {
        for (size_t t = begin; t < end; ++t) {
            codes[t] = left_out;
            if (matters(mesh, t, near))
                codes[t] = grid.code(corner(mesh, 0, t, 0), corner(mesh, 0, t, 1), corner(mesh, 0, t, 2))
                               << number_bits |
                           t;
        }
    });
    std::erase(codes, left_out);
    sort_by_code(codes);
    return codes;
}

} // namespace marram
