// SPDX-License-Identifier: Apache-2.0
// Occupied cells are found from blocks of an octree down: Embree's point query calls back for every primitive in a
// leaf whose bounds touch a sphere; a block of cells is empty if none is called for its circumscribed
// sphere. Only leaf entries are read, no vertices. Embree does not call back for curves, points and subdivision
// surfaces.
//
// Distances: between two cells whose indices differ by i, j and k lie max(|i| - 1, 0), ... cells, so that points in
// them are at least the root of the sum of these squares apart, in cells. The least of these squares over the occupied
// cells is separable (T. Saito and J. Toriwaki, "New algorithms for Euclidean distance transformation", Pattern
// Recognition 1994): first along x, then along y, then along z.
//
// Rounding. Embree works in floats: the spheres are wider by 2^-20 of the largest coordinate and the longest edge.
#include "procedural/erosion/empty_space.h"

#include "procedural/parallel.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr int max_cells = 128;
constexpr double codes_per_cell = 4.0;
constexpr int largest_code = 255;
constexpr int unreached = 1 << 14; // cells; its square and twice that fit into an int

bool on_primitive(RTCPointQueryFunctionArguments* arguments) {
    *static_cast<bool*>(arguments->userPtr) = true;
    arguments->query->radius = 0.0F; // no more are needed
    return true;
}

bool touches_sphere(RTCScene scene, const Vec3d& centre, double radius) {
    RTCPointQuery query{};
    query.x = float(centre.x()), query.y = float(centre.y()), query.z = float(centre.z());
    query.radius = std::nextafter(float(radius), float(infinity));
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    bool found = false;
    rtcPointQuery(scene, &query, &context, on_primitive, &found);
    return found;
}

struct CellGrid {
    RTCScene scene;
    Vec3d low;
    double cell, margin;
    Eigen::Vector3i count;
    std::vector<uint8_t> occupied;

    size_t at(int x, int y, int z) const {
        return (size_t(z) * size_t(count.y()) + size_t(y)) * size_t(count.x()) + size_t(x);
    }
    // Marks the occupied cells of a block with edges of `edge` cells, a power of two.
    void mark(const Eigen::Vector3i& first, int edge) {
        if ((first.array() >= count.array()).any()) return;
        const double half = 0.5 * edge * cell;
        const Vec3d centre = low + cell * first.cast<double>() + Vec3d::Constant(half);
        if (!touches_sphere(scene, centre, half * std::sqrt(3.0) + margin)) return;
        if (edge == 1) {
            occupied[at(first.x(), first.y(), first.z())] = 1;
            return;
        }
        for (int k = 0; k < 8; ++k)
            mark(first + edge / 2 * Eigen::Vector3i(k & 1, k >> 1 & 1, k >> 2), edge / 2);
    }
};

// One pass of the distance transform: line[i] = min over j of line[j] + max(|i - j| - 1, 0)^2.
void transform_line(int* line, size_t stride, int count, std::vector<int>& copy) {
    copy.resize(size_t(count));
    for (int i = 0; i < count; ++i) copy[size_t(i)] = line[size_t(i) * stride];
    for (int i = 0; i < count; ++i) {
        int least = copy[size_t(i)];
        for (int away = 1; away < count && (away - 1) * (away - 1) < least; ++away) {
            const int gap = (away - 1) * (away - 1);
            if (i >= away) least = std::min(least, copy[size_t(i - away)] + gap);
            if (i + away < count) least = std::min(least, copy[size_t(i + away)] + gap);
        }
        line[size_t(i) * stride] = least;
    }
}

struct alignas(64) Cells8 {
    VInt at[3];
    VFloat outside;
};

struct GridScale {
    float high[3], cells_per_metre;
    int last[3];
};

MARRAM_INLINE VFloat smaller(VFloat a, VFloat b) { return a < b ? a : b; }
MARRAM_INLINE VFloat greater(VFloat a, VFloat b) { return a > b ? a : b; }

MARRAM_HOT void find_cells(const GridScale& grid, const Parabolas8& p, Cells8& cells) {
    const VFloat t = p.t_clear, half = splat_float(0.5F) * t * t;
    cells.outside = VFloat{};
    for (int axis = 0; axis < 3; ++axis) {
        const VFloat x = p.x[axis] + t * p.v[axis] + half * p.a[axis];
        const VFloat inside = smaller(greater(x, VFloat{}), splat_float(grid.high[axis]));
        const VInt cell = __builtin_convertvector(inside * grid.cells_per_metre, VInt);
        cells.at[axis] = cell < grid.last[axis] ? cell : VInt{} + grid.last[axis];
        cells.outside = cells.outside + (x - inside) * (x - inside);
    }
}

// Within the ball of radius `free` a parabola stays at least for 2 free / (v + sqrt(v^2 + 2 a free)).
MARRAM_HOT void take_steps(const VFloat& distance, const VFloat& outside, Parabolas8& p, VInt& done) {
    const VFloat free = greater(vsqrt(distance * distance + outside) - p.clearance, VFloat{});
    VFloat squared{}, squared_a{};
    for (int axis = 0; axis < 3; ++axis) {
        const VFloat v = p.v[axis] + p.t_clear * p.a[axis];
        squared = squared + v * v;
        squared_a = squared_a + p.a[axis] * p.a[axis];
    }
    const VFloat a = vsqrt(squared_a);
    const VFloat sum = vsqrt(squared) + vsqrt(squared + 2.0F * a * free);
    const VFloat time = sum > VFloat{} ? 2.0F * free / sum : (free > VFloat{} ? p.t_max : VFloat{});
    const VInt near = ~(time > greater(p.min_step, p.t_clear * 0x1p-20F)); // else `clear` might not change
    p.t_clear = near ? p.t_clear : p.t_clear + time;
    done = near | (p.t_clear >= p.t_max);
}

} // namespace

uint32_t EmptySpace::step(Parabolas8& parabolas) const {
    Cells8 cells;
    alignas(64) VFloat distance{};
    if (!codes_.empty()) {
        GridScale grid;
        for (int axis = 0; axis < 3; ++axis)
            grid.high[axis] = float(high_[axis] - low_[axis]), grid.last[axis] = count_[axis] - 1;
        grid.cells_per_metre = float(cells_per_metre_);
        find_cells(grid, parabolas, cells);
        for (int lane = 0; lane < lanes; ++lane)
            distance[lane] =
                float(code_) *
                float(codes_[(size_t(cells.at[2][lane]) * size_t(count_[1]) + size_t(cells.at[1][lane])) *
                                 size_t(count_[0]) +
                             size_t(cells.at[0][lane])]);
    } else {
        cells.outside = VFloat{};
    }
    alignas(64) VInt done;
    take_steps(distance, cells.outside, parabolas, done);
    uint32_t bits = 0;
    for (int lane = 0; lane < lanes; ++lane) bits |= (done[lane] != 0 ? 1U : 0U) << lane;
    return bits;
}

EmptySpace::EmptySpace(RTCScene scene, const Eigen::AlignedBox3d& box, int cells) {
    const Vec3d extent = box.sizes();
    const double longest = extent.maxCoeff(),
                 coordinate = std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff());
    if (!(longest > 0.0) || !(coordinate < infinity)) return;
    CellGrid grid;
    grid.scene = scene, grid.low = box.min();
    grid.cell = longest / std::clamp(cells, 1, max_cells);
    grid.margin = 0x1p-20 * (coordinate + longest);
    for (int axis = 0; axis < 3; ++axis)
        grid.count[axis] = std::clamp(int(std::ceil(extent[axis] / grid.cell)), 1, max_cells);
    const Eigen::Vector3i count = grid.count;
    const size_t columns = size_t(count.x()), rows = size_t(count.y()), layers = size_t(count.z());
    grid.occupied.resize(columns * rows * layers);
    int edge = 1;
    while (4 * edge < count.maxCoeff()) edge *= 2;
    marram::parallel_for(0, 64,
                         [&](int k) { grid.mark(edge * Eigen::Vector3i(k & 3, k >> 2 & 3, k >> 4), edge); });
    std::vector<int> squares(grid.occupied.size());
    for (size_t i = 0; i < squares.size(); ++i)
        squares[i] = grid.occupied[i] != 0 ? 0 : unreached * unreached;
    marram::parallel_for(size_t(0), layers, [&](size_t z) {
        std::vector<int> copy;
        int* const layer = squares.data() + z * rows * columns;
        for (size_t y = 0; y < rows; ++y) transform_line(layer + y * columns, 1, count.x(), copy);
        for (size_t x = 0; x < columns; ++x) transform_line(layer + x, columns, count.y(), copy);
    });
    marram::parallel_for(size_t(0), rows, [&](size_t y) {
        std::vector<int> copy;
        for (size_t x = 0; x < columns; ++x)
            transform_line(squares.data() + y * columns + x, rows * columns, count.z(), copy);
    });
    codes_.resize(squares.size());
    for (size_t i = 0; i < squares.size(); ++i)
        codes_[i] = uint8_t(std::min(codes_per_cell * std::sqrt(double(squares[i])), double(largest_code)));
    low_ = grid.low, high_ = grid.low + grid.cell * count.cast<double>();
    cells_per_metre_ = 1.0 / grid.cell;
    code_ = grid.cell / codes_per_cell * (1.0 - 0x1p-20);
    count_ = count;
}

} // namespace marram
