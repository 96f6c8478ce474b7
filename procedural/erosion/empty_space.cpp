// SPDX-License-Identifier: Apache-2.0
// Occupied cells are found from blocks of an octree down: Embree's point query calls back for every primitive
// in a leaf whose bounds touch a sphere; a block of cells is empty if none is called for its circumscribed
// sphere. Only leaf entries are read, no vertices. Embree does not call back for curves, points and
// subdivision surfaces.
//
// Each cell has the radius of an empty ball around its centre, so that a point at the distance r from the centre has
// that radius less r. Between the centre of a cell and another cell whose index differs by i, j and k lie
// max(|i| - 1/2, 0), ... cells; the radius is at least the root of the sum of these squares. The least of these squares
// over the occupied cells is separable (T. Saito and J. Toriwaki, "New algorithms for Euclidean distance transformation",
// Pattern Recognition 1994): first along x, then along y, then along z. Near something, where grains need rays if little
// is known to be empty, the radius is then enlarged by bisection with point queries: around 1.5 10^6 triangles this saves
// 0.7 of 3.4 rays a grain.
//
// Rounding. Embree works in floats: the spheres are wider by 2^-20 of the largest coordinate and the longest
// edge.
#include "procedural/erosion/empty_space.h"

#include "procedural/abi/parallel.h"

#include <algorithm>
#include <cmath>

namespace marram {
namespace {

constexpr int max_cells = 128;
constexpr int codes_per_cell = 8;
constexpr int near_codes = 2 * codes_per_cell; // below this a radius is enlarged, by at most as much
constexpr int max_code = 255;
constexpr int unreached = 1 << 14; // half cells; its square and twice that fit into an int

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
    // The radius of an empty ball around a cell's centre, in codes. `least` is known to be empty.
    int bisect_radius(const Vec3d& centre, int least) const {
        int most = std::min(least + near_codes, max_code) + 1;
        while (least + 1 < most) {
            const int middle = (least + most) / 2;
            const bool touches = touches_sphere(scene, centre, middle * cell / codes_per_cell + margin);
            (touches ? most : least) = middle;
        }
        return least;
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

// One pass of the distance transform: line[i] = min over j of line[j] + max(2 |i - j| - 1, 0)^2.
void transform_line(int* line, size_t stride, int count, std::vector<int>& copy) {
    copy.resize(size_t(count));
    for (int i = 0; i < count; ++i) copy[size_t(i)] = line[size_t(i) * stride];
    for (int i = 0; i < count; ++i) {
        int least = copy[size_t(i)];
        for (int away = 1; away < count && (2 * away - 1) * (2 * away - 1) < least; ++away) {
            const int gap = (2 * away - 1) * (2 * away - 1);
            if (i >= away) least = std::min(least, copy[size_t(i - away)] + gap);
            if (i + away < count) least = std::min(least, copy[size_t(i + away)] + gap);
        }
        line[size_t(i) * stride] = least;
    }
}

MARRAM_INLINE VFloat as_float(VInt x) { return __builtin_convertvector(x, VFloat); }

// How long the parabolas stay at least in the balls around their points at t that are empty. Within a ball of
// radius `free` that is 2 free / (v + sqrt(v^2 + 2 g free)).
MARRAM_INLINE VFloat clear_time(const EmptySpaceGrid& grid, const Parabolas8& p, VFloat t) {
    const VFloat fall = t * p.gravity;
    VFloat to_centre{}, outside{}, squared{}; // squares: of distances and velocity
    VInt index{};
    for (int axis = 2; axis >= 0; --axis) {
        VFloat x = p.x[axis] + t * p.v[axis], v = p.v[axis];
        if (axis == 1) x -= 0.5F * t * fall, v -= fall;
        const VFloat inside = vmin(vmax(x, VFloat{}), splat_float(grid.high[axis]));
        const VInt cell = __builtin_convertvector(inside * grid.cells_per_metre, VInt);
        const VInt at = cell < grid.count[axis] ? cell : VInt{} + (grid.count[axis] - 1);
        index = index * grid.count[axis] + at;
        const VFloat away = inside - (as_float(at) + 0.5F) * grid.cell;
        to_centre += away * away, outside += (x - inside) * (x - inside), squared += v * v;
    }
    VInt codes;
    for (int lane = 0; lane < lanes; ++lane) codes[lane] = grid.codes[index[lane]];
    const VFloat distance = vmax(as_float(codes) * grid.code - vsqrt(to_centre), VFloat{});
    const VFloat free = vmax(vsqrt(distance * distance + outside) - p.clearance, VFloat{});
    const VFloat sum = vsqrt(squared) + vsqrt(squared + 2.0F * p.gravity * free);
    return sum > VFloat{} ? 2.0F * free / sum : (free > VFloat{} ? p.t_max : VFloat{});
}

MARRAM_HOT void step_parabolas(const EmptySpaceGrid& grid, int steps, ParabolaPair& pair) {
    VFloat t[2] = {pair[0].t_clear, pair[1].t_clear};
    VInt near[2] = {};
    for (int k = 0; k < steps; ++k)
        for (size_t n = 0; n < 2; ++n) {
            const Parabolas8& p = pair[n];
            const VFloat time = clear_time(grid, p, t[n]);
            near[n] = ~(time > vmax(p.min_step, t[n] * 0x1p-20F)); // else t_clear might not change
            t[n] = near[n] ? t[n] : t[n] + time;
        }
    for (size_t n = 0; n < 2; ++n) pair[n].t_clear = t[n], pair[n].is_near = near[n];
}

} // namespace

void EmptySpace::step(ParabolaPair& parabolas, int steps) const {
    if (!grid_.codes.empty())
        step_parabolas(grid_, steps, parabolas);
    else
        for (Parabolas8& p : parabolas) p.is_near = VInt{} - 1;
}

EmptySpace::EmptySpace(RTCScene scene, const Eigen::AlignedBox3d& box, int cells) {
    const Vec3d extent = box.sizes();
    const double longest = extent.maxCoeff(),
                 coordinate = std::max(box.min().cwiseAbs().maxCoeff(), box.max().cwiseAbs().maxCoeff());
    if (!(longest > 0.0) || !(coordinate < infinity)) return;
    CellGrid grid;
    grid.scene = scene, grid.low = box.min();
    grid.cell = longest / std::clamp(cells, 1, max_cells);
    if (!(float(1.0 / grid.cell) < float(infinity))) return; // smaller than floats can divide
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
    grid_.codes.resize(squares.size());
    marram::parallel_for(0, count.z(), [&](int z) {
        for (int y = 0; y < count.y(); ++y)
            for (int x = 0; x < count.x(); ++x) {
                const size_t i = grid.at(x, y, z);
                const double known = 0.5 * std::sqrt(double(squares[i])); // cells
                const int least = std::min(int(codes_per_cell * known), max_code);
                const Vec3d centre = grid.low + grid.cell * (Vec3d(x, y, z) + Vec3d::Constant(0.5));
                grid_.codes[i] = uint8_t(least < near_codes ? grid.bisect_radius(centre, least) : least);
            }
    });
    low_ = grid.low;
    for (int axis = 0; axis < 3; ++axis)
        grid_.high[axis] = float(grid.cell * count[axis]), grid_.count[axis] = count[axis];
    grid_.cell = float(grid.cell), grid_.cells_per_metre = float(1.0 / grid.cell);
    grid_.code = float(grid.cell / codes_per_cell * (1.0 - 0x1p-20));
}

} // namespace marram
