// SPDX-License-Identifier: Apache-2.0
// Counting sort, ten bits at a time, over parallel chunks: a parallel sort by TBB took four times as long on
// two million triangles.
#include "procedural/wind/collision/triangle_blocks.h"

#include "core/math/simd.h"
#include "procedural/abi/parallel.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

namespace marram {
namespace {

constexpr int axis_bits = 10, number_bits = 32;
constexpr size_t chunk = 1 << 16;   // triangles or vertices a task
constexpr uint32_t cell_holds = 48; // triangles, roughly

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
Box joined(Box a, const Box& b) { // either may be empty
    for (int axis = 0; axis < 3; ++axis) {
        a.low[axis] = std::min(a.low[axis], b.low[axis]);
        a.high[axis] = std::max(a.high[axis], b.high[axis]);
    }
    return a;
}

// Bounds of `groups` groups of eight vertices, each three vectors of x y z x y z ...; false: some are not
// finite.
MARRAM_HOT bool around_groups(const float* p, size_t groups, Box& box) {
    using Loose = float __attribute__((vector_size(lanes * 4), aligned(4)));
    VFloat low[3], high[3], sum{};
    for (int k = 0; k < 3; ++k) low[k] = splat_float(nowhere), high[k] = -low[k];
    for (size_t i = 0; i < groups; ++i)
        for (int k = 0; k < 3; ++k) {
            const VFloat v = *reinterpret_cast<const Loose*>(p + (3 * i + size_t(k)) * lanes);
            low[k] = v < low[k] ? v : low[k];
            high[k] = v > high[k] ? v : high[k];
            sum += v * 0.0F;
        }
    bool finite = true;
    for (int k = 0; k < 3; ++k)
        for (int i = 0; i < lanes; ++i) {
            const int axis = (k * lanes + i) % 3;
            box.low[axis] = std::min(box.low[axis], low[k][i]);
            box.high[axis] = std::max(box.high[axis], high[k][i]);
            finite = finite && sum[i] == 0.0F;
        }
    return finite;
}

// Bounds of the finite vertices; `finite`: all are.
struct Extent {
    Box box = no_box;
    bool finite = true;
};
void add_vertices(const float* positions, size_t begin, size_t end, Extent& extent) {
    const size_t groups = (end - begin) / lanes;
    Box box = no_box;
    if (around_groups(positions + 3 * begin, groups, box)) {
        extent.box = joined(extent.box, box);
        begin += groups * lanes;
    }
    for (size_t v = begin; v < end; ++v) {
        const float* p = positions + 3 * v;
        if (0.0F * (p[0] + p[1] + p[2]) == 0.0F)
            extend(extent.box, p);
        else
            extent.finite = false;
    }
}

const float* corner(const MarramMesh& mesh, uint32_t time, size_t triangle, size_t i) {
    return mesh.positions[time] + 3 * size_t(mesh.triangles[3 * triangle + i]);
}

// True: the triangle is finite at all samples (Embree drops others, too), and touches the reach at one of
// them.
bool is_finite_and_in_reach(const MarramMesh& mesh, size_t triangle, const Box& reach) {
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

// Grid whose cells hold about cell_holds triangles each, if the mesh is a surface.
class TriangleGrid {
  public:
    struct Cell {
        uint32_t at[4]; // the last is 0
        bool operator==(const Cell& other) const {
            return ((at[0] ^ other.at[0]) | (at[1] ^ other.at[1]) | (at[2] ^ other.at[2])) == 0;
        }
    };

    TriangleGrid(const Box& box, size_t triangles) {
        const size_t filled = triangles / (3 * cell_holds) + 1; // of 4^bits, more or less
        bits_ = std::min((int(std::bit_width(filled)) + 1) / 2, axis_bits);
        last_ = float((1 << bits_) - 1);
        for (int axis = 0; axis < 3; ++axis) {
            const double size = double(box.high[axis]) - double(box.low[axis]);
            low_[axis] = box.low[axis];
            cells_[axis] = size > 0.0 ? float(std::min(double(1 << bits_) / size, 1e30)) : 0.0F;
        }
    }
    Cell cell(const float* a, const float* b, const float* c) const {
        Cell cell{};
        for (int axis = 0; axis < 3; ++axis) {
            const float middle = (a[axis] + b[axis] + c[axis]) * (1.0F / 3.0F);
            cell.at[axis] =
                uint32_t(int(std::min(std::max((middle - low_[axis]) * cells_[axis], 0.0F), last_)));
        }
        return cell;
    }
    uint32_t code(const Cell& cell) const {
        const int up = axis_bits - bits_;
        return morton_code(cell.at[0] << up, cell.at[1] << up, cell.at[2] << up);
    }

  private:
    int bits_;
    float low_[3], cells_[3], last_; // cells_: cells a metre; 0 along an axis without extent
};

template <typename Work>
void each_chunk(size_t count, Work&& work) { // work(chunk, begin, end)
    marram::parallel_for(size_t(0), (count + chunk - 1) / chunk,
                         [&](size_t i) { work(i, i * chunk, std::min(count, (i + 1) * chunk)); });
}

// Sorts by the bits from number_bits on; the sort is stable.
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

struct Runs {
    std::vector<TriangleRun> runs;
    std::vector<uint32_t> codes; // [runs]
};

// `all`: every triangle passes is_finite_and_in_reach().
void add_runs(const MarramMesh& mesh, size_t begin, size_t end, const TriangleGrid& grid, bool all,
              const Box& reach, Runs& out) {
    TriangleGrid::Cell cell{};
    uint32_t count = 0; // of the open run
    for (size_t t = begin; t < end; ++t) {
        if (!all && !is_finite_and_in_reach(mesh, t, reach)) {
            count = 0;
            continue;
        }
        const TriangleGrid::Cell now =
            grid.cell(corner(mesh, 0, t, 0), corner(mesh, 0, t, 1), corner(mesh, 0, t, 2));
        if (count > 0 && count < block_most && now == cell) {
            out.runs.back().count = ++count;
            continue;
        }
        cell = now;
        count = 1;
        out.runs.push_back({uint32_t(t), 1});
        out.codes.push_back(grid.code(cell));
    }
}

// Each block takes as many runs as fit or, if a cell boundary comes before that, as many whole cells as fit.
std::vector<TriangleBlock> blocks_of(const std::vector<TriangleRun>& runs,
                                     const std::vector<uint32_t>& codes) {
    std::vector<TriangleBlock> blocks;
    for (size_t begin = 0; begin < runs.size();) {
        size_t end = begin, count = 0;
        while (end < runs.size() && count + runs[end].count <= block_most) count += runs[end++].count;
        const uint32_t differs = end < runs.size() ? codes[begin] ^ codes[end] : 0;
        if (differs != 0) {
            const int above = 31 - std::countl_zero(differs);
            while (codes[end - 1] >> above != codes[begin] >> above) --end;
        }
        blocks.push_back({codes[begin], uint32_t(begin), uint32_t(end)});
        begin = end;
    }
    return blocks;
}

} // namespace

TriangleBlocks triangle_blocks(const MarramMesh& mesh, const Eigen::AlignedBox3d& reach) {
    TriangleBlocks result;
    Box near; // the reach, in floats
    for (int axis = 0; axis < 3; ++axis) {
        near.low[axis] = std::nextafter(float(reach.min()[axis]), -nowhere);
        near.high[axis] = std::nextafter(float(reach.max()[axis]), nowhere);
    }
    // Over all samples: a mesh that enters the reach later is elsewhere at the first.
    const Extent whole = marram::parallel_reduce(
        tbb::blocked_range<size_t>(0, mesh.vertex_count, chunk), Extent{},
        [&](const auto& range, Extent extent) {
            for (uint32_t time = 0; time < mesh.time_count; ++time)
                add_vertices(mesh.positions[time], range.begin(), range.end(), extent);
            return extent;
        },
        [](const Extent& a, const Extent& b) {
            return Extent{joined(a.box, b.box), a.finite && b.finite};
        });
    Box box = whole.box;
    bool all = whole.finite;
    for (int axis = 0; axis < 3; ++axis) {
        all = all && box.low[axis] >= near.low[axis] && box.high[axis] <= near.high[axis];
        box.low[axis] = std::max(box.low[axis], near.low[axis]);
        box.high[axis] = std::min(box.high[axis], near.high[axis]);
        if (!(box.low[axis] <= box.high[axis])) return result;
    }
    result.box = {Vec3f(box.low[0], box.low[1], box.low[2]), Vec3f(box.high[0], box.high[1], box.high[2])};

    const TriangleGrid grid(box, mesh.triangle_count);
    std::vector<Runs> parts((mesh.triangle_count + chunk - 1) / chunk);
    each_chunk(mesh.triangle_count, [&](size_t i, size_t begin, size_t end) {
        add_runs(mesh, begin, end, grid, all, near, parts[i]);
    });
    std::vector<size_t> first(parts.size() + 1, 0);
    for (size_t i = 0; i < parts.size(); ++i) first[i + 1] = first[i] + parts[i].runs.size();
    std::vector<TriangleRun> runs(first.back());
    std::vector<uint64_t> order(first.back());
    marram::parallel_for(size_t(0), parts.size(), [&](size_t i) {
        std::copy(parts[i].runs.begin(), parts[i].runs.end(), runs.begin() + long(first[i]));
        for (size_t r = 0; r < parts[i].codes.size(); ++r)
            order[first[i] + r] = uint64_t(parts[i].codes[r]) << number_bits | (first[i] + r);
    });
    sort_by_code(order);
    std::vector<uint32_t> codes(order.size());
    result.runs.resize(order.size());
    each_chunk(order.size(), [&](size_t, size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
            result.runs[i] = runs[uint32_t(order[i])];
            codes[i] = uint32_t(order[i] >> number_bits);
        }
    });
    result.blocks = blocks_of(result.runs, codes);
    return result;
}

} // namespace marram
