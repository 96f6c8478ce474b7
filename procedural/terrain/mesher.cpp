// SPDX-License-Identifier: Apache-2.0
// Greedy refinement of a Delaunay triangulation in tiles (Garland and Heckbert, "Fast Polygonal Approximation of Terrains and
// Height Fields", 1995): the sample with the greatest error of all becomes a vertex, until no error is beyond the tolerance.
//
// Error of a sample in a triangle of vertices a, b, c:  e = |wa ha + wb hb + wc hc - h| / t,  w the sample's barycentric
// coordinates, h heights, t its tolerance: constant, or with cameras  t = max(metres, pixels angle min |sample - camera|).
// A sample on an edge counts in both triangles. Samples bound nothing between them: where an edge of the mesh crosses an edge of the
// growth surface the two can differ by more than t.
//
// Tiles: the grid is cut into tiles of at most 64 x 64 cells, so that a tile's heights stay in the first cache and tiles can go
// to any thread. Each line between two corners of tiles is first simplified by itself (Douglas and Peucker 1973, with the error
// above); both tiles that share it take its vertices as they are, so no crack can open. No vertex is added on a tile's border later.
// What borders cost in triangles is small, but a flat field still has two triangles a tile.
//
// Delaunay: a new vertex splits its triangle (or two, when it lies on an edge); edges opposite to it flip while the vertex beyond
// lies strictly inside the circumcircle (Lawson 1977). The test is exact in int64: coordinates below 2^7, its value below 2^35.
//
// Edge cases: below 2 x 2 samples there is no triangle. Coplanar samples merge at tolerance 0. A height is evaluated with a
// relative error of a few 2^-53, so no tolerance is below 2^-48 of the greatest height: an exact plane would be refined by rounding.
// A tile that one strip of cells fills is a tile like any other.
//
// Cost: n samples, v vertices: about n (scan) + 6 v triangles scanned, eight samples of a row at a time; memory 8 bytes a sample of a
// tile and thread, and 12 bytes a triangle twice.
#include "procedural/terrain/mesher.h"

#include "procedural/simd.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace marram {
namespace {

constexpr int mesh_tile = 64; // cells; 128 takes 1.1 to 1.5 times as long for as many triangles

struct MeshPoint {
    int i, j;
    double height;
};

// Twice the area of a, b, c; positive where their normal points up.
MARRAM_INLINE int64_t mesh_turn(const MeshPoint& a, const MeshPoint& b, const MeshPoint& c) {
    return int64_t(b.j - a.j) * (c.i - a.i) - int64_t(b.i - a.i) * (c.j - a.j);
}

// The heights of a tile, and one over the tolerance of each sample. Border samples weigh 0: they are settled. Rows end in a pad
// that a vector may read.
struct MeshGrid {
    int width = 0, depth = 0, stride = 0; // cells; floats from row to row
    double threshold = 0.0;
    std::vector<float> heights, weights;
};

struct MeshWorst {
    double error;
    int sample; // -1: none is beyond the threshold
};

// Twice the area of the triangle that a sample makes with an edge: positive inside, linear in i and j, exact.
struct MeshEdge {
    double value, per_i, per_j, inverse; // at the first sample of the row; 1 / per_i
    VDouble lane;                        // what each lane adds
};

MARRAM_INLINE MeshEdge mesh_edge(const MeshPoint& a, const MeshPoint& b, const MeshPoint& start) {
    const VDouble lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const double per_i = b.j - a.j, per_j = a.i - b.i;
    return {double(mesh_turn(a, b, start)), per_i, per_j, per_i != 0.0 ? 1.0 / per_i : 0.0, per_i * lane};
}
MARRAM_INLINE VDouble mesh_along(const MeshEdge& edge, double steps) {
    return (edge.value + edge.per_i * steps) + edge.lane;
}
// Keeps the part of a row that can lie inside the edge. One sample more at the end makes up for rounding; lanes are tested exactly.
MARRAM_INLINE void mesh_clip(const MeshEdge& edge, int start, int& lower, int& upper) {
    const double crossing = -edge.value * edge.inverse;
    if (edge.per_i > 0.0) lower = std::max(lower, start + int(std::ceil(crossing)) - 1);
    if (edge.per_i < 0.0) upper = std::min(upper, start + int(std::floor(crossing)) + 1);
}

struct alignas(sizeof(VDouble)) MeshLanes {
    VDouble error, sample;
};

// Ties go to the sample that comes first.
MARRAM_INLINE MeshWorst mesh_reduce(const MeshLanes& worst) {
    MeshWorst result{0.0, -1};
    for (int k = 0; k < lanes; ++k) {
        const int sample = int(worst.sample[k]);
        if (sample < 0) continue;
        if (worst.error[k] > result.error || (worst.error[k] == result.error && sample < result.sample))
            result = {worst.error[k], sample};
    }
    return result;
}

MARRAM_INLINE void mesh_eight(const MeshGrid& grid, int at, VDouble a, VDouble b, VDouble c, VDouble height,
                              MeshLanes& worst) {
    const VDouble lane = {0, 1, 2, 3, 4, 5, 6, 7};
    VFloat sample, weight;
    std::memcpy(&sample, grid.heights.data() + at, sizeof sample);
    std::memcpy(&weight, grid.weights.data() + at, sizeof weight);
    const VDouble off = vabs(height - to_double(sample)) * to_double(weight);
    // Two selections: a mask made by `and` from two comparisons would be taken apart lane by lane.
    const VDouble error = vmin(vmin(a, b), c) < 0.0 ? VDouble{} : off;
    worst.sample = worst.error < error ? lane + double(at) : worst.sample;
    worst.error = vmax(worst.error, error);
}

// The greatest error in a triangle, where it is beyond the threshold.
MARRAM_HOT MeshWorst mesh_worst(const MeshGrid& grid, const MeshPoint& a, const MeshPoint& b,
                                const MeshPoint& c) {
    const int64_t area = mesh_turn(a, b, c);
    if (area <= 1) return {0.0, -1}; // no sample but its vertices (Pick's theorem)
    const int i0 = std::min({a.i, b.i, c.i}), i1 = std::max({a.i, b.i, c.i});
    const int j0 = std::min({a.j, b.j, c.j}), j1 = std::max({a.j, b.j, c.j});
    const double scale = 1.0 / double(area);
    const double ha = a.height * scale, hb = b.height * scale, hc = c.height * scale;
    const MeshPoint start{i0, j0, 0.0};
    MeshEdge ea = mesh_edge(b, c, start), eb = mesh_edge(c, a, start), ec = mesh_edge(a, b, start);
    MeshLanes worst{splat(grid.threshold), splat(-1.0)};
    for (int j = j0; j <= j1; ++j) {
        int lower = i0, upper = i1;
        if (i1 - i0 >= lanes)
            for (const MeshEdge* e : {&ea, &eb, &ec}) mesh_clip(*e, i0, lower, upper);
        for (int i = lower; i <= upper; i += lanes) {
            const double steps = i - i0;
            const VDouble wa = mesh_along(ea, steps), wb = mesh_along(eb, steps), wc = mesh_along(ec, steps);
            mesh_eight(grid, j * grid.stride + i, wa, wb, wc, wa * ha + wb * hb + wc * hc, worst);
        }
        ea.value += ea.per_j, eb.value += eb.per_j, ec.value += ec.per_j;
    }
    return mesh_reduce(worst);
}

struct MeshBad { // a triangle beyond the tolerance
    double error;
    int triangle;
    uint32_t stamp;
    bool operator<(const MeshBad& other) const {
        return error != other.error ? error < other.error : triangle > other.triangle;
    }
};

// The triangulation of a tile. Buffers are used again for the next one.
struct MeshTile {
    MeshGrid grid;
    std::vector<MeshPoint> points;
    std::vector<int> vertex, twin; // 3 a triangle; edge k from vertex k to vertex k + 1; twin -1: border
    std::vector<int> candidate;    // of a triangle: its worst sample
    std::vector<uint32_t> stamp;   // counts what a triangle was: older entries of the heap are void
    std::vector<MeshBad> bad;      // a heap
    std::vector<int> stack, border_edge; // to be made Delaunay; the border edge that starts at a vertex
    bool scanning = false;               // not before the border is whole

    int add_triangle() {
        const int t = int(candidate.size());
        vertex.resize(vertex.size() + 3);
        twin.resize(twin.size() + 3);
        candidate.push_back(-1);
        stamp.push_back(0);
        return t;
    }
    void link(int edge, int other) {
        twin[size_t(edge)] = other;
        if (other >= 0)
            twin[size_t(other)] = edge;
        else
            border_edge[size_t(vertex[size_t(edge)])] = edge;
    }
    // A new vertex p is always vertex 2 of its triangles: edge 0 is the one that may flip.
    void set(int t, int a, int b, int p) {
        int* v = &vertex[3 * size_t(t)];
        v[0] = a, v[1] = b, v[2] = p;
        ++stamp[size_t(t)];
    }
    static int next(int e) { return e % 3 == 2 ? e - 2 : e + 1; }

    // q strictly inside the circumcircle of p, a, b.
    bool inside_circle(int p, int a, int b, int q) const {
        const MeshPoint &P = points[size_t(p)], &A = points[size_t(a)], &B = points[size_t(b)],
                        &Q = points[size_t(q)];
        const int64_t px = P.j - Q.j, py = P.i - Q.i, ax = A.j - Q.j, ay = A.i - Q.i, bx = B.j - Q.j,
                      by = B.i - Q.i;
        const int64_t pp = px * px + py * py, aa = ax * ax + ay * ay, bb = bx * bx + by * by;
        return px * (ay * bb - aa * by) - py * (ax * bb - aa * bx) + pp * (ax * by - ay * bx) > 0;
    }
    void scan(int t) {
        const int* v = &vertex[3 * size_t(t)];
        const MeshWorst w =
            mesh_worst(grid, points[size_t(v[0])], points[size_t(v[1])], points[size_t(v[2])]);
        candidate[size_t(t)] = w.sample;
        if (w.sample < 0) return;
        bad.push_back({w.error, t, stamp[size_t(t)]});
        std::push_heap(bad.begin(), bad.end());
    }
    // Every triangle left on the way is a final one of the new vertex, and is scanned once.
    void legalise() {
        while (!stack.empty()) {
            const int t = stack.back();
            stack.pop_back();
            const int e = 3 * t, h = twin[size_t(e)];
            if (h >= 0) {
                const int h1 = next(h), h2 = next(h1);
                const int a = vertex[size_t(e)], b = vertex[size_t(e + 1)], p = vertex[size_t(e + 2)],
                          q = vertex[size_t(h2)];
                if (inside_circle(p, a, b, q)) {
                    const int n = h / 3, aq = twin[size_t(h1)], qb = twin[size_t(h2)];
                    const int bp = twin[size_t(e + 1)], pa = twin[size_t(e + 2)];
                    set(t, a, q, p), set(n, q, b, p);
                    link(3 * t, aq), link(3 * t + 1, 3 * n + 2), link(3 * t + 2, pa);
                    link(3 * n, qb), link(3 * n + 1, bp);
                    stack.push_back(n), stack.push_back(t);
                    continue;
                }
            }
            if (scanning) scan(t);
        }
    }
    // At p on a border edge, on an inner edge, inside a triangle.
    void split_border(int e, int p) {
        const int e1 = next(e), e2 = next(e1), t = e / 3, n = add_triangle();
        const int a = vertex[size_t(e)], b = vertex[size_t(e1)], c = vertex[size_t(e2)];
        const int bc = twin[size_t(e1)], ca = twin[size_t(e2)];
        set(t, b, c, p), set(n, c, a, p);
        link(3 * t, bc), link(3 * t + 1, 3 * n + 2), link(3 * t + 2, -1);
        link(3 * n, ca), link(3 * n + 1, -1);
        stack.push_back(t), stack.push_back(n);
        legalise();
    }
    void split_edge(int e, int p) {
        const int h = twin[size_t(e)];
        const int e1 = next(e), e2 = next(e1), h1 = next(h), h2 = next(h1);
        const int a = vertex[size_t(e)], b = vertex[size_t(e1)], c = vertex[size_t(e2)],
                  d = vertex[size_t(h2)];
        const int bc = twin[size_t(e1)], ca = twin[size_t(e2)], ad = twin[size_t(h1)], db = twin[size_t(h2)];
        const int t = e / 3, n = h / 3, t2 = add_triangle(), n2 = add_triangle();
        set(t, b, c, p), set(t2, c, a, p), set(n, a, d, p), set(n2, d, b, p);
        link(3 * t, bc), link(3 * t2, ca), link(3 * n, ad), link(3 * n2, db);
        link(3 * t + 1, 3 * t2 + 2), link(3 * t2 + 1, 3 * n + 2), link(3 * n + 1, 3 * n2 + 2),
            link(3 * n2 + 1, 3 * t + 2);
        for (int s : {n2, n, t2, t}) stack.push_back(s);
        legalise();
    }
    void split_triangle(int t, int p) {
        const int e = 3 * t;
        const int a = vertex[size_t(e)], b = vertex[size_t(e + 1)], c = vertex[size_t(e + 2)];
        const int ab = twin[size_t(e)], bc = twin[size_t(e + 1)], ca = twin[size_t(e + 2)];
        const int t1 = add_triangle(), t2 = add_triangle();
        set(t, a, b, p), set(t1, b, c, p), set(t2, c, a, p);
        link(3 * t, ab), link(3 * t1, bc), link(3 * t2, ca);
        link(3 * t + 1, 3 * t1 + 2), link(3 * t1 + 1, 3 * t2 + 2), link(3 * t2 + 1, 3 * t + 2);
        for (int s : {t2, t1, t}) stack.push_back(s);
        legalise();
    }
    int add_point(int i, int j) {
        points.push_back({i, j, double(grid.heights[size_t(j * grid.stride + i)])});
        border_edge.push_back(-1);
        return int(points.size()) - 1;
    }
    void insert(int t) {
        const int at = candidate[size_t(t)];
        const int p = add_point(at % grid.stride, at / grid.stride);
        for (int k = 0; k < 3; ++k) {
            const int e = 3 * t + k;
            if (mesh_turn(points[size_t(vertex[size_t(e)])], points[size_t(vertex[size_t(next(e))])],
                          points[size_t(p)]) == 0)
                return split_edge(e, p);
        }
        split_triangle(t, p);
    }
    // Adds vertices until no sample is beyond the threshold.
    void refine() {
        scanning = true;
        for (int t = 0; t < int(candidate.size()); ++t) scan(t);
        while (!bad.empty()) {
            const MeshBad worst = bad.front();
            std::pop_heap(bad.begin(), bad.end());
            bad.pop_back();
            if (stamp[size_t(worst.triangle)] == worst.stamp) insert(worst.triangle);
        }
    }
    void begin() {
        points.clear(), vertex.clear(), twin.clear(), candidate.clear(), stamp.clear(), bad.clear(),
            border_edge.clear();
        scanning = false;
        const int a = add_point(0, 0), b = add_point(0, grid.depth), c = add_point(grid.width, grid.depth),
                  d = add_point(grid.width, 0);
        const int t = add_triangle(), n = add_triangle();
        set(t, a, b, d), set(n, c, d, b);
        link(3 * t, -1), link(3 * t + 1, 3 * n + 1), link(3 * t + 2, -1);
        link(3 * n, -1), link(3 * n + 2, -1);
    }
    // A vertex on the border edge that starts at `last`.
    int add_border(int last, int i, int j) {
        const int p = add_point(i, j);
        split_border(border_edge[size_t(last)], p);
        return p;
    }
};

// What an error is measured against. Errors times weight() are compared with `threshold`.
class MeshMeasure {
  public:
    MeshMeasure(const Domain& domain, const float* heights, const MeshTolerance& tolerance)
        : domain_(domain), heights_(heights), cameras_(tolerance.cameras),
          a_metre_(tolerance.pixels * tolerance.pixel_angle) {
        const float highest = tbb::parallel_reduce(
            tbb::blocked_range<size_t>(0, domain.count()), 0.0F,
            [&](const tbb::blocked_range<size_t>& range, float most) {
                for (size_t s = range.begin(); s < range.end(); ++s)
                    most = std::max(most, std::abs(heights[s]));
                return most;
            },
            [](float a, float b) { return std::max(a, b); });
        // 1e-30 m: its reciprocal is a float, and on a terrain without any height there is nothing to round.
        least_ = std::max({1e-30, 0x1p-48 * double(highest), tolerance.metres});
        camera_ = a_metre_ > 0.0 && !cameras_.empty();
    }

    double threshold() const { return camera_ ? 1.0 : least_; }
    float height(int i, int j) const { return heights_[domain_.index(i, j)]; }
    uint32_t sample(int i, int j) const { return uint32_t(domain_.index(i, j)); }

    float weight(int i, int j) const {
        if (!camera_) return 1.0F;
        const double x = domain_.x(i), y = height(i, j), z = domain_.z(j);
        double nearest = infinity;
        for (const Vec3d& camera : cameras_) {
            const double dx = x - camera.x(), dy = y - camera.y(), dz = z - camera.z();
            nearest = std::min(nearest, dx * dx + dy * dy + dz * dz);
        }
        // One unit of a float's last place more: rounded to nearest it may lose half of one.
        return float((1.0 + 0x1p-23) / std::max(least_, a_metre_ * std::sqrt(nearest)));
    }

  private:
    const Domain& domain_;
    const float* heights_;
    const std::vector<Vec3d>& cameras_;
    double a_metre_, least_ = 0.0; // tolerance per metre of distance
    bool camera_ = false;
};

// Where tiles meet: equal shares of the cells.
std::vector<int> mesh_lines(int cells) {
    const int count = (cells + mesh_tile - 1) / mesh_tile;
    std::vector<int> lines;
    for (int t = 0; t <= count; ++t) lines.push_back(int(int64_t(cells) * t / count));
    return lines;
}

// A border between two corners: the samples kept strictly between them, from the first corner on.
struct MeshLine {
    std::vector<uint32_t> samples;
    std::vector<int> steps;
    uint32_t first = 0; // vertex
};

MeshLine mesh_line(const MeshMeasure& measure, int i, int j, int di, int dj, int steps) {
    std::vector<double> heights, weights;
    for (int s = 0; s <= steps; ++s) {
        heights.push_back(measure.height(i + s * di, j + s * dj));
        weights.push_back(measure.weight(i + s * di, j + s * dj));
    }
    MeshLine line;
    std::vector<std::pair<int, int>> spans{{0, steps}};
    while (!spans.empty()) {
        const auto [a, b] = spans.back();
        spans.pop_back();
        double worst = measure.threshold();
        int where = -1;
        for (int s = a + 1; s < b; ++s) {
            const double height = (heights[size_t(a)] * (b - s) + heights[size_t(b)] * (s - a)) / (b - a);
            const double error = std::abs(height - heights[size_t(s)]) * weights[size_t(s)];
            if (error > worst) worst = error, where = s;
        }
        if (where < 0) continue;
        line.steps.push_back(where);
        spans.push_back({a, where}), spans.push_back({where, b});
    }
    std::sort(line.steps.begin(), line.steps.end());
    for (const int s : line.steps) line.samples.push_back(measure.sample(i + s * di, j + s * dj));
    return line;
}

// One tile's triangles before they are numbered.
struct MeshPiece {
    std::vector<uint32_t> inner, triangles; // samples of inner vertices; vertices of the tile
    uint32_t first = 0;                     // vertex
    size_t first_triangle = 0;              // index
};

class Mesher {
  public:
    Mesher(const Domain& domain, const float* heights, const MeshTolerance& tolerance)
        : measure_(domain, heights, tolerance), i_(mesh_lines(domain.nx - 1)), j_(mesh_lines(domain.nz - 1)),
          columns_(int(i_.size()) - 1), rows_(int(j_.size()) - 1),
          across_(size_t(columns_) * size_t(rows_ + 1)), along_(size_t(columns_ + 1) * size_t(rows_)),
          pieces_(size_t(columns_) * size_t(rows_)) {}

    RenderMesh run() {
        tbb::parallel_for(0, rows_ + 1, [&](int r) { simplify_lines(r); });
        tbb::enumerable_thread_specific<MeshTile> tiles;
        tbb::parallel_for(0, int(pieces_.size()), [&](int p) { refine(p, tiles.local()); });
        RenderMesh mesh = number();
        tbb::parallel_for(0, int(pieces_.size()), [&](int p) { join(p, mesh); });
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
        for (int j = 0; j <= grid.depth; ++j) {
            const size_t row = size_t(j) * size_t(grid.stride);
            for (int i = 0; i <= grid.width; ++i)
                grid.heights[row + size_t(i)] = measure_.height(i0 + i, j0 + j);
            if (j == 0 || j == grid.depth) continue;
            for (int i = 1; i < grid.width; ++i)
                grid.weights[row + size_t(i)] = measure_.weight(i0 + i, j0 + j);
        }
    }

    void refine(int p, MeshTile& tile) {
        const int c = p % columns_, r = p / columns_;
        load(tile.grid, c, r);
        const int width = tile.grid.width, depth = tile.grid.depth;
        tile.begin();
        // The border in the order of the corners: join() numbers its vertices in the same.
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
        MeshPiece& piece = pieces_[size_t(p)];
        for (size_t v = border; v < tile.points.size(); ++v)
            piece.inner.push_back(
                measure_.sample(i_[size_t(c)] + tile.points[v].i, j_[size_t(r)] + tile.points[v].j));
        piece.triangles.assign(tile.vertex.begin(), tile.vertex.end());
    }

    static std::vector<int> backwards(const std::vector<int>& steps) {
        return {steps.rbegin(), steps.rend()};
    }

    // Vertices: corners, lines, then what is inside each tile.
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
        for (MeshPiece& piece : pieces_) {
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
        const MeshPiece& piece = pieces_[size_t(p)];
        const uint32_t count = uint32_t(border.size());
        std::copy(piece.inner.begin(), piece.inner.end(), mesh.samples.begin() + ptrdiff_t(piece.first));
        for (size_t k = 0; k < piece.triangles.size(); ++k) {
            const uint32_t v = piece.triangles[k];
            mesh.triangles[piece.first_triangle + k] = v < count ? border[v] : piece.first + (v - count);
        }
    }

    MeshMeasure measure_;
    std::vector<int> i_, j_; // where tiles meet
    int columns_, rows_;
    std::vector<MeshLine> across_, along_;
    std::vector<MeshPiece> pieces_;
};

} // namespace

RenderMesh mesh_terrain(const Domain& domain, const float* heights, const MeshTolerance& tolerance) {
    if (domain.nx < 2 || domain.nz < 2) return {};
    return Mesher(domain, heights, tolerance).run();
}

} // namespace marram
