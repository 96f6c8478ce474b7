// SPDX-License-Identifier: Apache-2.0
// The triangulation of one tile of a terrain, for mesher.cpp, which describes the method.
#pragma once

#include "core/math/simd.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace marram {

struct MeshPoint {
    int i, j;
    double height;
};

// Twice the signed area of a, b, c; positive if their normal points up.
MARRAM_INLINE int64_t mesh_twice_area(const MeshPoint& a, const MeshPoint& b, const MeshPoint& c) {
    return int64_t(b.j - a.j) * (c.i - a.i) - int64_t(b.i - a.i) * (c.j - a.j);
}

// Heights of a tile and weights; an error times its weight is compared with `threshold`. Constant tolerance: weights 1, and
// the tolerance as threshold. With cameras or a gradient tolerance: weights 1 / tolerance, threshold 1. With a gradient
// tolerance also slopes, and all errors are squared. Border samples have weight 0: their vertices are already chosen. Rows are padded for
// vector loads.
struct MeshGrid {
    int width = 0, depth = 0, stride = 0; // cells; floats from row to row
    double threshold = 0.0;
    bool slopes = false;
    std::vector<float> heights, weights, slopes_x, slopes_z, slope_weights;
};

struct MeshLargestError {
    double error;
    int sample; // -1: none exceeds the threshold
};

// The sample in a triangle with the largest error: of heights, or of heights and slopes. Ties: the first sample.
MeshLargestError mesh_largest_error(const MeshGrid& grid, const MeshPoint& a, const MeshPoint& b,
                                    const MeshPoint& c);
MeshLargestError mesh_largest_error_slopes(const MeshGrid& grid, const MeshPoint& a, const MeshPoint& b,
                                           const MeshPoint& c);

struct MeshHeapEntry { // heap entry: a triangle that exceeds the tolerance
    double error;
    int triangle;
    uint32_t stamp;
    bool operator<(const MeshHeapEntry& other) const {
        return error != other.error ? error < other.error : triangle > other.triangle;
    }
};

// The triangulation of a tile. Buffers are reused for the next tile.
struct MeshTile {
    MeshGrid grid;
    std::vector<MeshPoint> points;
    std::vector<int> vertex, twin;  // 3 a triangle; edge k goes from vertex k to k + 1; twin -1: border
    std::vector<int> candidate;     // sample with the largest error of each triangle
    std::vector<uint32_t> stamp;    // version of each triangle; heap entries with an older stamp are void
    std::vector<MeshHeapEntry> bad; // heap
    std::vector<int> stack, border_edge; // triangles to legalise; border edge that starts at each vertex
    bool scanning = false;               // true once the border is complete

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
    // The new vertex p is always vertex 2 of its triangles, so edge 0 is the one that may flip.
    void set(int t, int a, int b, int p) {
        int* v = &vertex[3 * size_t(t)];
        v[0] = a, v[1] = b, v[2] = p;
        ++stamp[size_t(t)];
    }
    static int next(int e) { return e % 3 == 2 ? e - 2 : e + 1; }

    // True if q is strictly inside the circumcircle of p, a, b.
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
        const MeshPoint &a = points[size_t(v[0])], &b = points[size_t(v[1])], &c = points[size_t(v[2])];
        const MeshLargestError w =
            grid.slopes ? mesh_largest_error_slopes(grid, a, b, c) : mesh_largest_error(grid, a, b, c);
        candidate[size_t(t)] = w.sample;
        if (w.sample < 0) return;
        bad.push_back({w.error, t, stamp[size_t(t)]});
        std::push_heap(bad.begin(), bad.end());
    }
    // Restores the Delaunay property. Each triangle that is not flipped is final for this vertex and is
    // scanned once.
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
    // Insert vertex p on a border edge, on an inner edge, or inside a triangle.
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
            if (mesh_twice_area(points[size_t(vertex[size_t(e)])], points[size_t(vertex[size_t(next(e))])],
                                points[size_t(p)]) == 0)
                return split_edge(e, p);
        }
        split_triangle(t, p);
    }
    // Adds vertices until no error exceeds the threshold.
    void refine() {
        scanning = true;
        for (int t = 0; t < int(candidate.size()); ++t) scan(t);
        while (!bad.empty()) {
            const MeshHeapEntry worst = bad.front();
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
    // Adds a vertex on the border edge that starts at vertex `last`.
    int add_border(int last, int i, int j) {
        const int p = add_point(i, j);
        split_border(border_edge[size_t(last)], p);
        return p;
    }
};

} // namespace marram
