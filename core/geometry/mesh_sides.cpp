// SPDX-License-Identifier: Apache-2.0
// A part is a connected component of the graph whose nodes are triangles and whose links are edges with
// exactly two of them. A search over it gives each triangle a sign relative to the first: neighbours that run
// along their edge in the same direction have opposite signs. Triangles with two corners at one position are
// ignored: they have no side.
//
// A closed part of negative volume is a cavity if the other parts wind around it. The winding number of a
// point is a sum along a ray in +x: +1 for each triangle that it leaves through, -1 for each that it enters
// through. It is 1 in a body, 0 in a cavity of it, and 0 outside, also in a notch. Whether a triangle
// covers the point, seen along x, is decided edge by edge, with the same arithmetic for both triangles at
// an edge: rays through edges and vertices are counted once.
#include "core/geometry/mesh_sides.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace marram {
namespace {

using Triangle = std::array<uint32_t, 3>;

constexpr uint32_t no_triangle = ~0U;

// The triangles of a mesh with welded corners.
class Welded {
  public:
    explicit Welded(const Mesh& mesh) : mesh_(mesh), first_(weld(mesh.positions)) {}

    Triangle operator[](size_t t) const {
        const Triangle& corners = mesh_.triangles[t];
        return {first_[corners[0]], first_[corners[1]], first_[corners[2]]};
    }
    bool collapsed(size_t t) const {
        const auto [a, b, c] = (*this)[t];
        return a == b || b == c || c == a;
    }
    size_t triangle_count() const { return mesh_.triangles.size(); }
    size_t vertex_count() const { return first_.size(); }

  private:
    const Mesh& mesh_;
    std::vector<uint32_t> first_;
};

// [3 * triangle + k]: the only other triangle at the edge from corner k to the next, or no_triangle.
std::vector<uint32_t> links_of(const Welded& welded) {
    struct End {
        uint32_t to, triangle;
        uint8_t edge;
    };
    const auto each_edge = [&](auto&& visit) {
        for (size_t t = 0; t < welded.triangle_count(); ++t) {
            if (welded.collapsed(t)) continue;
            const Triangle corners = welded[t];
            for (uint8_t k = 0; k < 3; ++k) {
                const uint32_t a = corners[k], b = corners[(k + 1U) % 3];
                visit(std::min(a, b), End{std::max(a, b), uint32_t(t), k});
            }
        }
    };
    std::vector<uint64_t> begin(welded.vertex_count() + 1, 0);
    each_edge([&](uint32_t from, const End&) { ++begin[from + 1]; });
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<End> ends(begin.back());
    std::vector<uint64_t> next(begin.begin(), begin.end() - 1);
    each_edge([&](uint32_t from, const End& end) { ends[next[from]++] = end; });
    std::vector<uint32_t> links(3 * welded.triangle_count(), no_triangle);
    for (size_t v = 0; v < welded.vertex_count(); ++v) {
        const auto first = ends.begin() + std::ptrdiff_t(begin[v]),
                   last = ends.begin() + std::ptrdiff_t(begin[v + 1]);
        std::sort(first, last, [](const End& a, const End& b) { return a.to < b.to; });
        for (auto at = first; at != last;) {
            const auto stop = std::find_if(at, last, [&](const End& end) { return end.to != at->to; });
            if (stop - at == 2) {
                links[3 * size_t(at[0].triangle) + at[0].edge] = at[1].triangle;
                links[3 * size_t(at[1].triangle) + at[1].edge] = at[0].triangle;
            }
            at = stop;
        }
    }
    return links;
}

bool has_edge(const Triangle& corners, uint32_t from, uint32_t to) {
    for (size_t k = 0; k < 3; ++k)
        if (corners[k] == from && corners[(k + 1) % 3] == to) return true;
    return false;
}

struct Part {
    std::vector<uint32_t> triangles;
    bool closed = true, one_sided = false;
};

// The part of a triangle. turned: filled for its triangles, relative to the first.
Part part_from(uint32_t start, const Welded& welded, const std::vector<uint32_t>& links,
               std::vector<char>& visited, std::vector<char>& turned) {
    Part part;
    part.triangles.push_back(start);
    visited[start] = 1;
    for (size_t i = 0; i < part.triangles.size(); ++i) {
        const uint32_t t = part.triangles[i];
        const Triangle corners = welded[t];
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t other = links[3 * size_t(t) + k];
            if (other == no_triangle) {
                part.closed = false;
                continue;
            }
            const bool against = has_edge(welded[other], corners[k], corners[(k + 1) % 3]);
            const auto sign = static_cast<char>((turned[t] != 0) != against);
            if (visited[other] == 0) {
                visited[other] = 1;
                turned[other] = sign;
                part.triangles.push_back(other);
            } else {
                part.one_sided |= turned[other] != sign;
            }
        }
    }
    return part;
}

// Sums over a part with its triangles turned.
struct PartSums {
    double area = 0.0, turned_area = 0.0, volume = 0.0; // volume: with the turned ones turned
    double normals_area =
        0.0; // where vertex normals are on the same side, less that where they are on the other
};

PartSums sums_of(const Part& part, const Mesh& mesh, const std::vector<char>& turned) {
    PartSums sums;
    const Vec3d origin = mesh.positions[mesh.triangles[part.triangles[0]][0]].cast<double>();
    for (const uint32_t t : part.triangles) {
        const Triangle& corners = mesh.triangles[t];
        const auto at = [&](size_t k) { return Vec3d(mesh.positions[corners[k]].cast<double>() - origin); };
        const Vec3d a = at(0), b = at(1), c = at(2), cross = (b - a).cross(c - a);
        const double area = 0.5 * cross.norm(), sign = turned[t] != 0 ? -1.0 : 1.0;
        sums.area += area;
        sums.turned_area += turned[t] != 0 ? area : 0.0;
        sums.volume += sign * a.dot(cross) / 6.0;
        if (mesh.normals.empty()) continue;
        double side = 0.0;
        for (const uint32_t v : corners) side += sign * mesh.normals[v].cast<double>().dot(cross);
        sums.normals_area += side > 0.0 ? area : side < 0.0 ? -area : 0.0;
    }
    return sums;
}

struct ClosedPart {
    double volume;
    std::vector<uint32_t> triangles;
};

Vec3f centroid(const Mesh& mesh, uint32_t t) {
    const auto& [a, b, c] = mesh.triangles[t];
    return (mesh.positions[a] + mesh.positions[b] + mesh.positions[c]) / 3.0F;
}

// A point of a part, and how often the other parts wind around it.
struct Probe {
    Vec3f point;
    size_t part;
    int winding = 0;
};

// What a triangle adds to the winding number of a point; corners relative to the point.
int crossing(const std::array<Vec3d, 3>& corners) {
    int covers = 0; // seen along x: 1 anticlockwise, -1 clockwise
    for (size_t k = 0; k < 3; ++k) {
        const Vec3d &from = corners[k], &to = corners[(k + 1) % 3];
        const bool rises = from.y() <= 0.0 && to.y() > 0.0, falls = to.y() <= 0.0 && from.y() > 0.0;
        if (!rises && !falls) continue;
        const Vec3d &low = rises ? from : to, &high = rises ? to : from;
        if (low.z() * high.y() - low.y() * high.z() > 0.0) covers += rises ? -1 : 1;
    }
    return corners[0].dot(corners[1].cross(corners[2])) * covers > 0.0 ? covers : 0;
}

// turned: as for sums_of(). probes: sorted by y.
void add_windings(const Mesh& mesh, const std::vector<char>& turned, const std::vector<ClosedPart>& parts,
                  std::vector<Probe>& probes) {
    const auto y_of = [](const Probe& probe) { return probe.point.y(); };
    for (size_t part = 0; part < parts.size(); ++part)
        for (const uint32_t t : parts[part].triangles) {
            const auto& [a, b, c] = mesh.triangles[t];
            const Vec3f &p = mesh.positions[a], &q = mesh.positions[b], &r = mesh.positions[c];
            const auto [bottom, top] = std::minmax({p.y(), q.y(), r.y()});
            const auto [near, far] = std::minmax({p.z(), q.z(), r.z()});
            for (auto probe = std::ranges::lower_bound(probes, bottom, {}, y_of);
                 probe != probes.end() && probe->point.y() <= top; ++probe) {
                if (probe->part == part || probe->point.z() < near || probe->point.z() > far) continue;
                const Vec3d point = probe->point.cast<double>();
                const int sign = turned[t] != 0 ? -1 : 1;
                probe->winding +=
                    sign * crossing({Vec3d(p.cast<double>() - point), Vec3d(q.cast<double>() - point),
                                     Vec3d(r.cast<double>() - point)});
            }
        }
}

// Closed parts of negative volume that are no cavities. A cavity has all its probes in other parts; a part
// that crosses another has some outside.
void count_inside_out(const Mesh& mesh, const std::vector<char>& turned, const std::vector<ClosedPart>& parts,
                      MeshSides& sides) {
    constexpr size_t probes_per_part = 16;
    sides.closed_parts = parts.size();
    std::vector<Probe> probes;
    for (size_t i = 0; i < parts.size(); ++i) {
        const std::vector<uint32_t>& triangles = parts[i].triangles;
        const size_t step = (triangles.size() + probes_per_part - 1) / probes_per_part;
        for (size_t k = 0; k < triangles.size() && parts[i].volume < 0.0; k += step)
            probes.push_back({centroid(mesh, triangles[k]), i});
    }
    if (probes.empty()) return;
    std::ranges::sort(probes, {}, [](const Probe& probe) { return probe.point.y(); });
    add_windings(mesh, turned, parts, probes);
    std::vector<char> outside(parts.size(), 0);
    for (const Probe& probe : probes)
        if (probe.winding <= 0) outside[probe.part] = 1;
    for (size_t i = 0; i < parts.size(); ++i)
        if (outside[i] != 0 && sides.inside_out++ == 0)
            sides.first_inside_out = centroid(mesh, parts[i].triangles[0]);
}

void swap_sides(Triangle& triangle) { std::swap(triangle[1], triangle[2]); }

} // namespace

MeshSides settle_sides(Mesh& mesh) {
    constexpr double tie = 1e-6;  // of the area: rounding decides nothing
    constexpr double flat = 1e-6; // of area^1.5: a part that encloses nothing has no inside
    const Welded welded(mesh);
    const std::vector<uint32_t> links = links_of(welded);
    std::vector<char> visited(mesh.triangles.size(), 0), turned(mesh.triangles.size(), 0);
    std::vector<ClosedPart> closed;
    for (uint32_t start = 0; start < mesh.triangles.size(); ++start) {
        if (visited[start] != 0 || welded.collapsed(start)) continue;
        Part part = part_from(start, welded, links, visited, turned);
        const auto turn_all = [&] {
            for (const uint32_t t : part.triangles) turned[t] = static_cast<char>(turned[t] == 0);
        };
        if (part.one_sided) {
            for (const uint32_t t : part.triangles) turned[t] = 0;
            continue;
        }
        PartSums sums = sums_of(part, mesh, turned);
        const bool encloses = part.closed && std::abs(sums.volume) > flat * std::pow(sums.area, 1.5);
        const double majority = sums.turned_area - 0.5 * sums.area;
        const bool is_tie = std::abs(majority) <= tie * sums.area;
        if (is_tie ? encloses && sums.volume < 0.0 : majority > 0.0) {
            turn_all();
            sums.volume = -sums.volume;
            sums.normals_area = -sums.normals_area;
        }
        if (sums.normals_area < -tie * sums.area && !(encloses && sums.volume > 0.0)) {
            turn_all();
            sums.volume = -sums.volume;
        }
        if (encloses) closed.push_back({sums.volume, std::move(part.triangles)});
    }
    MeshSides sides;
    count_inside_out(mesh, turned, closed, sides);
    for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
        if (turned[t] == 0) continue;
        swap_sides(mesh.triangles[t]);
        if (sides.turned++ == 0) sides.first_turned = centroid(mesh, t);
    }
    return sides;
}

void flip_sides(Mesh& mesh) {
    for (Triangle& triangle : mesh.triangles) swap_sides(triangle);
    for (Vec3f& normal : mesh.normals) normal = -normal;
}

} // namespace marram
