// SPDX-License-Identifier: Apache-2.0
#include "procedural/terrain/mesh/tile_triangulation.h"

#include <cstdlib>

namespace marram {
namespace {

// Edge function: twice the signed area of a sample and an edge. Positive inside, linear in i and j, exact.
struct MeshEdge {
    double value, per_i, per_j, inverse; // at the first sample of the row; 1 / per_i
    VDouble lane;                        // offset of each lane
};

MARRAM_INLINE MeshEdge mesh_edge(const MeshPoint& a, const MeshPoint& b, const MeshPoint& start) {
    const double per_i = b.j - a.j, per_j = a.i - b.i;
    return {double(mesh_twice_area(a, b, start)), per_i, per_j, per_i != 0.0 ? 1.0 / per_i : 0.0,
            per_i * lane_index_double};
}
MARRAM_INLINE VDouble mesh_along(const MeshEdge& edge, double steps) {
    return (edge.value + edge.per_i * steps) + edge.lane;
}
// Clips a row to the part that can lie inside the edge. One extra sample allows for rounding; lanes are
// tested exactly.
MARRAM_INLINE void mesh_clip(const MeshEdge& edge, int start, int& lower, int& upper) {
    const double crossing = -edge.value * edge.inverse;
    if (edge.per_i > 0.0) lower = std::max(lower, start + int(std::ceil(crossing)) - 1);
    if (edge.per_i < 0.0) upper = std::min(upper, start + int(std::floor(crossing)) + 1);
}

struct alignas(sizeof(VDouble)) MeshLanes {
    VDouble error, sample;
};

// The largest error of all lanes. On ties the first sample wins.
MARRAM_INLINE MeshLargestError mesh_reduce(const MeshLanes& worst) {
    MeshLargestError result{0.0, -1};
    for (int k = 0; k < lanes; ++k) {
        const int sample = int(worst.sample[k]);
        if (sample < 0) continue;
        if (worst.error[k] > result.error || (worst.error[k] == result.error && sample < result.sample))
            result = {worst.error[k], sample};
    }
    return result;
}

// The plane of one slope component over a triangle. a, b, c: its vertex values divided by twice the area;
// each is weighted by the edge function of the opposite edge.
MARRAM_INLINE MeshEdge mesh_slope_plane(const MeshEdge& ea, const MeshEdge& eb, const MeshEdge& ec, double a,
                                        double b, double c) {
    const double per_i = ea.per_i * a + eb.per_i * b + ec.per_i * c;
    return {ea.value * a + eb.value * b + ec.value * c, per_i, ea.per_j * a + eb.per_j * b + ec.per_j * c,
            0.0, per_i * lane_index_double};
}
MARRAM_INLINE VDouble mesh_load_lanes(const std::vector<float>& values, int at) {
    return to_double(vload(values.data() + at));
}
// Squared difference between the interpolated gradient and that of each sample, divided by the squared
// tolerance.
MARRAM_INLINE VDouble mesh_slope_error(const MeshGrid& grid, int at, VDouble x, VDouble z) {
    const VDouble dx = x - mesh_load_lanes(grid.slopes_x, at), dz = z - mesh_load_lanes(grid.slopes_z, at);
    return (dx * dx + dz * dz) * mesh_load_lanes(grid.slope_weights, at);
}

// Updates the largest error of each lane. a, b, c: edge functions, negative outside. off: errors.
MARRAM_INLINE void mesh_update_largest(VDouble a, VDouble b, VDouble c, VDouble off, int at,
                                       MeshLanes& worst) {
    const VDouble error = select(vmin(vmin(a, b), c) < 0.0, 0.0, off);
    worst.sample = select(worst.error < error, lane_index_double + double(at), worst.sample);
    worst.error = vmax(worst.error, error);
}

template <bool slopes>
MARRAM_INLINE MeshLargestError mesh_largest_error_of(const MeshGrid& grid, const MeshPoint& a,
                                                     const MeshPoint& b, const MeshPoint& c) {
    const int64_t area = mesh_twice_area(a, b, c);
    if (area <= 1) return {0.0, -1}; // contains no samples except its vertices (Pick's theorem)
    const int i0 = std::min({a.i, b.i, c.i}), i1 = std::max({a.i, b.i, c.i});
    const int j0 = std::min({a.j, b.j, c.j}), j1 = std::max({a.j, b.j, c.j});
    const double scale = 1.0 / double(area);
    const double ha = a.height * scale, hb = b.height * scale, hc = c.height * scale;
    const MeshPoint start{i0, j0, 0.0};
    MeshEdge ea = mesh_edge(b, c, start), eb = mesh_edge(c, a, start), ec = mesh_edge(a, b, start);
    MeshEdge x{}, z{};
    if constexpr (slopes) {
        const auto plane = [&](const std::vector<float>& v) MARRAM_ALWAYS_INLINE {
            const auto at = [&](const MeshPoint& p) {
                return double(v[size_t(p.j * grid.stride + p.i)]) * scale;
            };
            return mesh_slope_plane(ea, eb, ec, at(a), at(b), at(c));
        };
        x = plane(grid.slopes_x), z = plane(grid.slopes_z);
    }
    MeshLanes worst{splat(grid.threshold), splat(-1.0)};
    for (int j = j0; j <= j1; ++j) {
        int lower = i0, upper = i1;
        if (i1 - i0 >= lanes)
            for (const MeshEdge* e : {&ea, &eb, &ec}) mesh_clip(*e, i0, lower, upper);
        for (int i = lower; i <= upper; i += lanes) {
            const double steps = i - i0;
            const VDouble wa = mesh_along(ea, steps), wb = mesh_along(eb, steps), wc = mesh_along(ec, steps);
            const int at = j * grid.stride + i;
            const VDouble height = wa * ha + wb * hb + wc * hc;
            VDouble off =
                vabs(height - mesh_load_lanes(grid.heights, at)) * mesh_load_lanes(grid.weights, at);
            if constexpr (slopes)
                off = vmax(off * off, mesh_slope_error(grid, at, mesh_along(x, steps), mesh_along(z, steps)));
            mesh_update_largest(wa, wb, wc, off, at, worst);
        }
        ea.value += ea.per_j, eb.value += eb.per_j, ec.value += ec.per_j;
        x.value += x.per_j, z.value += z.per_j;
    }
    return mesh_reduce(worst);
}

// The largest error in a triangle if it exceeds the threshold: of heights only; of heights and slopes,
// squared.

} // namespace

MARRAM_HOT MeshLargestError mesh_largest_error(const MeshGrid& grid, const MeshPoint& a, const MeshPoint& b,
                                               const MeshPoint& c) {
    return mesh_largest_error_of<false>(grid, a, b, c);
}
MARRAM_HOT MeshLargestError mesh_largest_error_slopes(const MeshGrid& grid, const MeshPoint& a,
                                                      const MeshPoint& b, const MeshPoint& c) {
    return mesh_largest_error_of<true>(grid, a, b, c);
}

} // namespace marram
