// SPDX-License-Identifier: Apache-2.0
// Greedy refinement of a Delaunay triangulation in tiles (Garland and Heckbert, "Fast Polygonal Approximation
// of Terrains and Height Fields", 1995): the sample with the largest error becomes a vertex, until no error
// exceeds the tolerance.
//
// Error of a sample in a triangle of vertices a, b, c:  e = |wa ha + wb hb + wc hc - h| / t,  w the sample's
// barycentric coordinates, h heights, t its tolerance: constant, or with cameras  t = max(metres, pixels
// angle min |sample - camera|). A sample on an edge counts in both triangles. The error between samples is
// not bounded: where a mesh edge crosses an edge of the growth surface, the two surfaces can differ by more
// than t.
//
// Gradient: a renderer interpolates the vertex normals of a triangle. A long triangle with one vertex at the
// foot of a dune can be within t of the ground and still spread the foot's normal over metres of ground. With
// a gradient tolerance g
//   e = max(e, |wa ga + wb gb + wc gc - grad h| / g),   g = gradient max(1, angle min |sample - camera| / cell),
// where grad h uses central differences (one-sided at the border of the domain) and |.| is the length of a 2D
// vector. The second factor is a pixel's width in cells, if there are cameras. Under a light of elevation s
// the relative irradiance error on level ground is below g cot(s). Renderers interpolate unit normals, not
// gradients; the difference is of second order in the variation within a triangle. The error at a vertex is
// 0, so refinement terminates, at the latest when every sample is a vertex. Along a sharp crest or foot this
// does happen: the gradient changes within a cell or two, and all samples of a strip become vertices. Slopes
// are clamped to 1024, where ground counts as vertical; g is at least 2^-20, above the rounding error of a
// slope's plane (below 2^-23 for coordinates below 2^7 and slopes up to 2^10). With g both errors are
// squared: this avoids a square root and keeps the order of refinement.
//
// Tiles: the grid is cut into tiles of at most 64 x 64 cells, so that a tile's heights fit into the L1 cache
// and tiles can run on any thread. Each border line between two tile corners is simplified first (Douglas and
// Peucker 1973, with the errors above). Both adjacent tiles use its vertices unchanged and later add none on
// the border, so there are no cracks. On a border edge both tiles interpolate the same two full gradients, so
// normals are continuous there and each border sample is within g. Borders cost few triangles, but even a
// flat field has two triangles a tile.
//
// Delaunay: a new vertex splits its triangle (or two, if it lies on an edge). Opposite edges are flipped
// while the vertex beyond lies strictly inside the circumcircle (Lawson 1977). The test is exact in int64:
// coordinates are below 2^7, its value below 2^35.
//
// Edge cases: below 2 x 2 samples there are no triangles. At tolerance 0 coplanar samples are merged. Heights
// are evaluated with a relative error of a few 2^-53, so the tolerance is at least 2^-48 of the largest
// height; otherwise rounding would refine an exact plane. Tiles that are one cell wide need no special case.
//
// Cost: n samples, v vertices: about n (scan) + 6 v triangle scans, eight samples of a row at a time; memory
// 8 bytes a sample of a tile and thread, and 12 bytes a triangle twice. With a gradient tolerance 20 bytes a
// sample of a tile and thread: slopes are computed when a tile is loaded, once for each sample except those
// on borders. Loading and scanning then take 1.6 times as long; the rest of the extra time is due to the
// additional vertices.
#include "procedural/terrain/mesh/mesher.h"

#include "core/math/simd.h"
#include "procedural/abi/parallel.h"
#include "procedural/terrain/mesh/tile_triangulation.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace marram {
namespace {

constexpr int mesh_tile = 64; // cells; 128 is 1.1 to 1.5 times slower for the same number of triangles

// Largest slope. Steeper ground counts as vertical: its normal is within 0.001 of the horizontal.
constexpr double mesh_steepest = 1024.0;
// Minimum gradient tolerance; see the head of this file.
constexpr double mesh_least_gradient = 0x1p-20;

struct MeshSlope {
    float x, z;
};

// NaN (from cells of size 0) becomes mesh_steepest.
MARRAM_INLINE float mesh_rise(float from, float to, double a_step) {
    const double slope = (double(to) - double(from)) * a_step;
    return float(std::max(-mesh_steepest, std::min(mesh_steepest, slope)));
}
MARRAM_HOT void mesh_rises(const float* from, const float* to, double a_step, int count,
                           float* __restrict out) {
    for (int k = 0; k < count; ++k) out[k] = mesh_rise(from[k], to[k], a_step);
}

// Adds one ulp before rounding to float, because rounding to nearest may lose half an ulp.
MARRAM_INLINE VFloat mesh_rounded_up(VDouble weight) { return to_float((1.0 + 0x1p-23) * weight); }

// Cameras and tolerances.
struct MeshView {
    const Vec3d* cameras = nullptr; // NULL: tolerances are constant
    size_t count = 0;
    double least = 0.0;               // minimum height tolerance, m
    double tolerance_per_metre = 0.0; // height tolerance per metre of distance
    double slope_weight = 0.0;        // 1 / squared gradient tolerance; 0: off
    double cells2 = 0.0;              // squared width of a pixel in cells, per squared metre of distance
};
// Samples on a line: (i, j), (i + di, j + dj) and so on.
struct MeshRun {
    int i, j, di, dj, count;
};

// Computes weights for camera-dependent tolerances: 1 / height tolerance and, if enabled, 1 / squared
// gradient tolerance. `heights` is read eight at a time. Comparisons with NaN are false, so the constant
// bound applies. With gradients both weights share one float square root and division; the added 2^-22 covers
// their three roundings of 2^-24.
MARRAM_HOT void mesh_camera_weights(const MeshView& view, const Domain& domain, const MeshRun& run,
                                    const float* heights, float* weights, float* slope_weights) {
    for (int k = 0; k < run.count; k += lanes) {
        const VDouble steps = lane_index_double + double(k);
        const VDouble x = domain.x0 + (run.i + run.di * steps) * domain.cell,
                      z = domain.z0 + (run.j + run.dj * steps) * domain.cell;
        const VFloat height = vload(heights + k);
        VDouble nearest = splat(infinity);
        for (size_t c = 0; c < view.count; ++c) {
            const VDouble dx = x - view.cameras[c].x(), dy = to_double(height) - view.cameras[c].y(),
                          dz = z - view.cameras[c].z();
            nearest = vmin(dx * dx + dy * dy + dz * dz, nearest);
        }
        const size_t bytes = sizeof(float) * size_t(std::min(lanes, run.count - k));
        if (view.slope_weight == 0.0) {
            const VFloat weight =
                mesh_rounded_up(1.0 / vmax(view.tolerance_per_metre * vsqrt(nearest), view.least));
            std::memcpy(weights + k, &weight, bytes);
            continue;
        }
        const VDouble inverse = to_double(1.0F / vsqrt(to_float(nearest))) * (1.0 + 0x1p-22);
        const VFloat weight =
            mesh_rounded_up(vmin(inverse * (1.0 / view.tolerance_per_metre), 1.0 / view.least));
        const VFloat slope =
            mesh_rounded_up(vmin(inverse * inverse * (1.0 / view.cells2), 1.0) * view.slope_weight);
        std::memcpy(weights + k, &weight, bytes), std::memcpy(slope_weights + k, &slope, bytes);
    }
}

// The error measure. Errors times weights() are compared with threshold().
class MeshMeasure {
  public:
    MeshMeasure(const Domain& domain, const float* heights, const MeshTolerance& tolerance)
        : domain_(domain), heights_(heights), slopes_(tolerance.gradient > 0.0) {
        const float highest = marram::parallel_reduce(
            tbb::blocked_range<size_t>(0, domain.count()), 0.0F,
            [&](const tbb::blocked_range<size_t>& range, float most) {
                for (size_t s = range.begin(); s < range.end(); ++s)
                    most = std::max(most, std::abs(heights[s]));
                return most;
            },
            [](float a, float b) { return std::max(a, b); });
        // Lower bound 1e-30 m: its reciprocal fits a float, and if all heights are 0 nothing is rounded.
        view_.least = std::max({1e-30, 0x1p-48 * double(highest), tolerance.metres});
        view_.tolerance_per_metre = tolerance.pixels * tolerance.pixel_angle;
        if (view_.tolerance_per_metre > 0.0)
            view_.cameras = tolerance.cameras.data(), view_.count = tolerance.cameras.size();
        if (!slopes_) return;
        inverse_steps_[0] = 1.0 / domain.cell, inverse_steps_[1] = 0.5 / domain.cell;
        const double gradient = std::max(tolerance.gradient, mesh_least_gradient);
        const double cells = tolerance.pixel_angle / domain.cell;
        view_.slope_weight = 1.0 / (gradient * gradient), view_.cells2 = cells * cells;
    }

    bool slopes() const { return slopes_; }
    double threshold() const { return view_.count > 0 || slopes_ ? 1.0 : view_.least; }
    float height(int i, int j) const { return heights_[domain_.index(i, j)]; }
    const float* heights(int i, int j) const { return heights_ + domain_.index(i, j); }
    uint32_t sample(int i, int j) const { return uint32_t(domain_.index(i, j)); }

    // Central differences; one-sided at the border of the domain.
    MeshSlope slope(int i, int j) const {
        const int i0 = std::max(i - 1, 0), i1 = std::min(i + 1, domain_.nx - 1);
        const int j0 = std::max(j - 1, 0), j1 = std::min(j + 1, domain_.nz - 1);
        return {mesh_rise(height(i0, j), height(i1, j), inverse_steps_[i1 - i0 - 1]),
                mesh_rise(height(i, j0), height(i, j1), inverse_steps_[j1 - j0 - 1])};
    }

    // The same for `count` samples of a row, starting at (i, j).
    void slopes(int i, int j, int count, float* x, float* z) const {
        const int j0 = std::max(j - 1, 0), j1 = std::min(j + 1, domain_.nz - 1);
        const float* row = heights(i, j);
        mesh_rises(heights(i, j0), heights(i, j1), inverse_steps_[j1 - j0 - 1], count, z);
        mesh_rises(row, row + 2, inverse_steps_[1], count - 2, x + 1);
        x[0] = slope(i, j).x, x[count - 1] = slope(i + count - 1, j).x;
    }

    void weights(const MeshRun& run, const float* heights, float* weights, float* slope_weights) const {
        if (view_.count > 0) return mesh_camera_weights(view_, domain_, run, heights, weights, slope_weights);
        std::fill_n(weights, run.count, slopes_ ? mesh_rounded_up(splat(1.0 / view_.least))[0] : 1.0F);
        if (slopes_) std::fill_n(slope_weights, run.count, mesh_rounded_up(splat(view_.slope_weight))[0]);
    }

  private:
    const Domain& domain_;
    const float* heights_;
    MeshView view_;
    double inverse_steps_[2]{}; // 1/m: inverse length of one cell and of two cells
    bool slopes_;
};

// Borders of the tiles: cells are divided evenly.
std::vector<int> mesh_lines(int cells) {
    const int count = (cells + mesh_tile - 1) / mesh_tile;
    std::vector<int> lines;
    for (int t = 0; t <= count; ++t) lines.push_back(int(int64_t(cells) * t / count));
    return lines;
}

// A border line between two tile corners: the samples kept between them, in order, without the corners.
struct MeshLine {
    std::vector<uint32_t> samples;
    std::vector<int> steps;
    uint32_t first = 0; // index of its first vertex
};

// The samples of a line, padded for vector loads.
struct MeshLineSamples {
    std::vector<float> heights, weights, slopes_x, slopes_z, slope_weights;

    MeshLineSamples(const MeshMeasure& measure, const MeshRun& run) {
        const size_t count = size_t(run.count) + lanes;
        for (std::vector<float>* values : {&heights, &weights, &slopes_x, &slopes_z, &slope_weights})
            values->resize(count);
        for (int s = 0; s < run.count; ++s) {
            const int i = run.i + s * run.di, j = run.j + s * run.dj;
            const MeshSlope slope = measure.slopes() ? measure.slope(i, j) : MeshSlope{};
            heights[size_t(s)] = measure.height(i, j);
            slopes_x[size_t(s)] = slope.x, slopes_z[size_t(s)] = slope.z;
        }
        measure.weights(run, heights.data(), weights.data(), slope_weights.data());
    }
    // Error of sample s for the edge from a to b; squared if slopes are used.
    template <bool slopes>
    double error(int a, int b, int s) const {
        const auto off = [&](const std::vector<float>& v) {
            return (double(v[size_t(a)]) * (b - s) + double(v[size_t(b)]) * (s - a)) / (b - a) -
                   double(v[size_t(s)]);
        };
        const double height = std::abs(off(heights)) * double(weights[size_t(s)]);
        if (!slopes) return height;
        const double x = off(slopes_x), z = off(slopes_z);
        return std::max(height * height, (x * x + z * z) * double(slope_weights[size_t(s)]));
    }
    // The sample between a and b with the largest error; -1: none exceeds the threshold.
    template <bool slopes>
    int worst(int a, int b, double threshold) const {
        int where = -1;
        for (int s = a + 1; s < b; ++s) {
            const double e = error<slopes>(a, b, s);
            if (e > threshold) threshold = e, where = s;
        }
        return where;
    }
};

MeshLine mesh_line(const MeshMeasure& measure, int i, int j, int di, int dj, int steps) {
    const MeshLineSamples samples(measure, {i, j, di, dj, steps + 1});
    MeshLine line;
    std::vector<std::pair<int, int>> spans{{0, steps}};
    while (!spans.empty()) {
        const auto [a, b] = spans.back();
        spans.pop_back();
        const int where = measure.slopes() ? samples.worst<true>(a, b, measure.threshold())
                                           : samples.worst<false>(a, b, measure.threshold());
        if (where < 0) continue;
        line.steps.push_back(where);
        spans.push_back({a, where}), spans.push_back({where, b});
    }
    std::sort(line.steps.begin(), line.steps.end());
    for (const int s : line.steps) line.samples.push_back(measure.sample(i + s * di, j + s * dj));
    return line;
}

// The triangles of one tile before global numbering.
struct MeshTileResult {
    std::vector<uint32_t> inner, triangles; // samples of inner vertices; vertex indices within the tile
    uint32_t first = 0;                     // global index of the first inner vertex
    size_t first_triangle = 0;              // offset into RenderMesh::triangles
};

class Mesher {
  public:
    Mesher(const Domain& domain, const float* heights, const MeshTolerance& tolerance)
        : measure_(domain, heights, tolerance), i_(mesh_lines(domain.nx - 1)), j_(mesh_lines(domain.nz - 1)),
          columns_(int(i_.size()) - 1), rows_(int(j_.size()) - 1),
          across_(size_t(columns_) * size_t(rows_ + 1)), along_(size_t(columns_ + 1) * size_t(rows_)),
          pieces_(size_t(columns_) * size_t(rows_)) {}

    RenderMesh run() {
        marram::parallel_for(0, rows_ + 1, [&](int r) { simplify_lines(r); });
        tbb::enumerable_thread_specific<MeshTile> tiles;
        marram::parallel_for(0, int(pieces_.size()), [&](int p) { refine(p, tiles.local()); });
        RenderMesh mesh = number();
        marram::parallel_for(0, int(pieces_.size()), [&](int p) { join(p, mesh); });
        return mesh;
    }

  private:
    MeshLine& across(int c, int r) { return across_[size_t(r * columns_ + c)]; }     // along +x
    MeshLine& along(int c, int r) { return along_[size_t(r * (columns_ + 1) + c)]; } // along +z
    uint32_t corner(int c, int r) const { return uint32_t(r * (columns_ + 1) + c); }

    void simplify_lines(int r) {
        for (int c = 0; c <= columns_; ++c) {
            const int i = i_[size_t(c)], j = j_[size_t(r)];
            if (c < columns_) across(c, r) = mesh_line(measure_, i, j, 1, 0, i_[size_t(c) + 1] - i);
            if (r < rows_) along(c, r) = mesh_line(measure_, i, j, 0, 1, j_[size_t(r) + 1] - j);
        }
    }

    void load(MeshGrid& grid, int c, int r) const {
        const int i0 = i_[size_t(c)], j0 = j_[size_t(r)];
        grid.width = i_[size_t(c) + 1] - i0, grid.depth = j_[size_t(r) + 1] - j0;
        grid.stride = grid.width + 1 + lanes;
        grid.threshold = measure_.threshold();
        grid.heights.assign(size_t(grid.stride) * size_t(grid.depth + 2), 0.0F);
        grid.weights.assign(grid.heights.size(), 0.0F);
        grid.slopes = measure_.slopes();
        if (grid.slopes) grid.slope_weights.assign(grid.heights.size(), 0.0F);
        grid.slopes_x.resize(grid.slope_weights.size()), grid.slopes_z.resize(grid.slope_weights.size());
        for (int j = 0; j <= grid.depth; ++j) load_row(grid, i0, j0 + j, size_t(j) * size_t(grid.stride));
        if (grid.width < 2) return;
        for (int j = 1; j < grid.depth; ++j) {
            const size_t at = size_t(j) * size_t(grid.stride) + 1;
            measure_.weights({i0 + 1, j0 + j, 1, 0, grid.width - 1}, &grid.heights[at], &grid.weights[at],
                             grid.slope_weights.data() + (grid.slopes ? at : 0));
        }
    }

    void load_row(MeshGrid& grid, int i0, int j, size_t row) const {
        std::copy_n(measure_.heights(i0, j), grid.width + 1, &grid.heights[row]);
        if (grid.slopes) measure_.slopes(i0, j, grid.width + 1, &grid.slopes_x[row], &grid.slopes_z[row]);
    }

    void refine(int p, MeshTile& tile) {
        const int c = p % columns_, r = p / columns_;
        load(tile.grid, c, r);
        const int width = tile.grid.width, depth = tile.grid.depth;
        tile.begin();
        // Add border vertices in the order of the corners; join() numbers them in the same order.
        int last = 0;
        for (const int s : along(c, r).steps) last = tile.add_border(last, 0, s);
        last = 1;
        for (const int s : across(c, r + 1).steps) last = tile.add_border(last, s, depth);
        last = 2;
        for (const int s : backwards(along(c + 1, r).steps)) last = tile.add_border(last, width, s);
        last = 3;
        for (const int s : backwards(across(c, r).steps)) last = tile.add_border(last, s, 0);
        const size_t border = tile.points.size();
        tile.refine();
        MeshTileResult& piece = pieces_[size_t(p)];
        for (size_t v = border; v < tile.points.size(); ++v)
            piece.inner.push_back(
                measure_.sample(i_[size_t(c)] + tile.points[v].i, j_[size_t(r)] + tile.points[v].j));
        piece.triangles.assign(tile.vertex.begin(), tile.vertex.end());
    }

    static std::vector<int> backwards(const std::vector<int>& steps) {
        return {steps.rbegin(), steps.rend()};
    }

    // Numbers the vertices: corners, border lines, then the inner vertices of each tile.
    RenderMesh number() {
        RenderMesh mesh;
        std::vector<uint32_t>& samples = mesh.samples;
        for (const int j : j_)
            for (const int i : i_) samples.push_back(measure_.sample(i, j));
        for (std::vector<MeshLine>* lines : {&across_, &along_}) {
            for (MeshLine& line : *lines) {
                line.first = uint32_t(samples.size());
                samples.insert(samples.end(), line.samples.begin(), line.samples.end());
            }
        }
        size_t vertices = samples.size(), indices = 0;
        for (MeshTileResult& piece : pieces_) {
            piece.first = uint32_t(vertices), piece.first_triangle = indices;
            vertices += piece.inner.size(), indices += piece.triangles.size();
        }
        samples.resize(vertices);
        mesh.triangles.resize(indices);
        return mesh;
    }

    void join(int p, RenderMesh& mesh) {
        const int c = p % columns_, r = p / columns_;
        std::vector<uint32_t> border{corner(c, r), corner(c, r + 1), corner(c + 1, r + 1), corner(c + 1, r)};
        const auto add = [&](const MeshLine& line, bool reversed) {
            const uint32_t count = uint32_t(line.samples.size());
            for (uint32_t k = 0; k < count; ++k)
                border.push_back(line.first + (reversed ? count - 1 - k : k));
        };
        add(along(c, r), false), add(across(c, r + 1), false), add(along(c + 1, r), true);
        add(across(c, r), true);
        const MeshTileResult& piece = pieces_[size_t(p)];
        const uint32_t count = uint32_t(border.size());
        std::copy(piece.inner.begin(), piece.inner.end(), mesh.samples.begin() + ptrdiff_t(piece.first));
        for (size_t k = 0; k < piece.triangles.size(); ++k) {
            const uint32_t v = piece.triangles[k];
            mesh.triangles[piece.first_triangle + k] = v < count ? border[v] : piece.first + (v - count);
        }
    }

    MeshMeasure measure_;
    std::vector<int> i_, j_; // tile borders
    int columns_, rows_;
    std::vector<MeshLine> across_, along_;
    std::vector<MeshTileResult> pieces_;
};

} // namespace

RenderMesh mesh_terrain(const Domain& domain, const float* heights, const MeshTolerance& tolerance) {
    if (domain.nx < 2 || domain.nz < 2) return {};
    return Mesher(domain, heights, tolerance).run();
}

} // namespace marram
