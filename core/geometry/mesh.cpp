// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/mesh.h"

#include "core/geometry/mesh_reader.h"
#include "core/geometry/mesh_sides.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace marram {

namespace {

using Triangle = std::array<uint32_t, 3>;

constexpr uint32_t none = ~0u;
constexpr size_t vertices_a_task = 4096;

// ---- Vertex normals

// The corners (3 * triangle + k) at each welded vertex, in the triangles' order.
struct Fans {
    std::vector<uint64_t> begin; // positions.size() + 1
    std::vector<uint64_t> corners;
};

Fans fans_of(std::span<const uint32_t> first, std::span<const Triangle> triangles) {
    Fans fans{std::vector<uint64_t>(first.size() + 1, 0), std::vector<uint64_t>(triangles.size() * 3)};
    for (const Triangle& t : triangles)
        for (uint32_t v : t) ++fans.begin[first[v] + 1];
    for (size_t v = 0; v < first.size(); ++v) fans.begin[v + 1] += fans.begin[v];
    std::vector<uint64_t> next(fans.begin.begin(), fans.begin.end() - 1);
    for (size_t t = 0; t < triangles.size(); ++t)
        for (size_t k = 0; k < 3; ++k) fans.corners[next[first[triangles[t][k]]]++] = 3 * t + k;
    return fans;
}

// One corner of a triangle.
struct Corner {
    Vec3d normal = Vec3d::Zero(); // unit
    double angle = 0.0;           // 0: the triangle has no significant area
    double area = 0.0;            // twice the triangle's
};

Corner corner_at(std::span<const Vec3f> positions, const Triangle& t, size_t k) {
    const Vec3d p = positions[t[k]].cast<double>();
    const Vec3d a = positions[t[(k + 1) % 3]].cast<double>() - p;
    const Vec3d b = positions[t[(k + 2) % 3]].cast<double>() - p;
    Corner corner;
    const Vec3d cross = a.cross(b);
    corner.area = cross.norm();
    if (!(corner.area > 0.0)) return corner;
    corner.normal = cross / corner.area;
    // If the triangle is less high than a few rounding errors of its coordinates, its normal is noise, but an
    // obtuse corner would still give it the weight of half a circle: it gets none.
    const double longest = std::sqrt(std::max({a.squaredNorm(), b.squaredNorm(), (b - a).squaredNorm()}));
    const double rounding = p.cwiseAbs().maxCoeff() * double(std::numeric_limits<float>::epsilon());
    constexpr double roundings = 2.0;
    if (corner.area > roundings * rounding * longest) corner.angle = std::atan2(corner.area, a.dot(b));
    return corner;
}

Vec3f normal_at(std::span<const Vec3f> positions, std::span<const Triangle> triangles,
                std::span<const uint64_t> fan, uint32_t vertex) {
    Vec3d all = Vec3d::Zero(), own = Vec3d::Zero(), flat = Vec3d::Zero(), one = Vec3d::Zero();
    double weight = 0.0;
    for (uint64_t c : fan) {
        const Triangle& t = triangles[c / 3];
        const Corner corner = corner_at(positions, t, c % 3);
        weight += corner.angle;
        all += corner.angle * corner.normal;
        const bool is_own = t[c % 3] == vertex;
        if (is_own) own += corner.angle * corner.normal;
        if (is_own && corner.angle > 0.0 && one.isZero(0.0)) one = corner.normal;
        flat += corner.area * corner.normal;
    }
    constexpr double vanishing = 1e-6; // relative to the weights: less is rounding error
    for (const Vec3d& sum : {all, own})
        if (sum.norm() > vanishing * weight) return sum.normalized().cast<float>();
    if (!one.isZero(0.0)) return one.cast<float>();
    if (flat.norm() > 0.0) return (flat / flat.norm()).cast<float>();
    return Vec3f::UnitY();
}

// ---- Loading

// Makes the file's normals unit and fills in those that are missing.
void finish_normals(Mesh& mesh, bool smooth) {
    size_t missing = 0;
    for (Vec3f& normal : mesh.normals) {
        const Vec3d exact = normal.cast<double>();
        const double length = exact.norm();
        if (length > 0.0) normal = (exact / length).cast<float>();
        missing += length > 0.0 ? 0 : 1;
    }
    if (missing == mesh.normals.size()) mesh.normals.clear();
    if (mesh.normals.empty()) {
        if (smooth) mesh.normals = vertex_normals(mesh.positions, mesh.triangles);
    } else if (missing > 0) {
        const std::vector<Vec3f> computed = vertex_normals(mesh.positions, mesh.triangles);
        for (size_t v = 0; v < mesh.normals.size(); ++v)
            if (mesh.normals[v].isZero(0.0f)) mesh.normals[v] = computed[v];
    }
}

// Whether two meshes have the same polygons, whichever way these are wound and divided into triangles: a
// polygon's triangles follow each other, and its edges are those of an odd number of them.
bool same_polygons(const std::vector<Triangle>& a, const std::vector<Triangle>& b) {
    constexpr size_t most_edges = 256; // of polygons that differ
    if (a.size() != b.size()) return false;
    std::vector<std::pair<uint32_t, uint32_t>> edges; // of an odd number of both; none: a polygon ends
    const auto toggle = [&](uint32_t from, uint32_t to) {
        const std::pair edge = std::minmax({from, to});
        if (const auto same = std::ranges::find(edges, edge); same != edges.end())
            edges.erase(same);
        else
            edges.push_back(edge);
    };
    for (size_t t = 0; t < a.size() && edges.size() <= most_edges; ++t) {
        if (edges.empty() && a[t] == b[t]) continue;
        for (const Triangle& triangle : {a[t], b[t]})
            for (size_t k = 0; k < 3; ++k) toggle(triangle[k], triangle[(k + 1) % 3]);
    }
    return edges.empty();
}

// The sides of a mesh as read, before missing normals are made.
void settle(Mesh& mesh, const MeshLoading& loading, bool may_be_wrong) {
    if (loading.first_shape) { // vertices that meet at one frame must not change sides
        if (loading.flip)
            for (Vec3f& normal : mesh.normals) normal = -normal;
        if (same_polygons(mesh.triangles, loading.first_shape->triangles))
            mesh.triangles = loading.first_shape->triangles;
        return;
    }
    const MeshSides sides = may_be_wrong ? settle_sides(mesh) : MeshSides{};
    if (loading.sides) *loading.sides = sides;
    if (loading.flip) flip_sides(mesh);
}

} // namespace

// An open hash table over the positions' bits.
std::vector<uint32_t> weld(std::span<const Vec3f> positions) {
    const size_t slots = std::bit_ceil(positions.size() * 2 + 1);
    std::vector<uint32_t> table(slots, none);
    std::vector<uint32_t> first(positions.size());
    for (uint32_t v = 0; v < positions.size(); ++v) {
        const Vec3f p = positions[v] + Vec3f::Zero(); // -0 becomes 0
        uint64_t hash = 0;
        for (int axis = 0; axis < 3; ++axis) {
            hash = (hash ^ std::bit_cast<uint32_t>(p[axis])) * 0x9e3779b97f4a7c15ull; // golden ratio
            hash ^= hash >> 32;
        }
        size_t slot = hash & (slots - 1);
        while (table[slot] != none && positions[table[slot]] != positions[v]) slot = (slot + 1) & (slots - 1);
        if (table[slot] == none) table[slot] = v;
        first[v] = table[slot];
    }
    return first;
}

std::vector<Vec3f> vertex_normals(std::span<const Vec3f> positions, std::span<const Triangle> triangles) {
    const std::vector<uint32_t> first = weld(positions);
    const Fans fans = fans_of(first, triangles);
    std::vector<Vec3f> normals(positions.size());
    tbb::parallel_for(tbb::blocked_range<size_t>(0, positions.size(), vertices_a_task),
                      [&](const auto& range) {
                          for (size_t v = range.begin(); v != range.end(); ++v) {
                              const uint64_t begin = fans.begin[first[v]], end = fans.begin[first[v] + 1];
                              const std::span<const uint64_t> fan(fans.corners.data() + begin, end - begin);
                              normals[v] = normal_at(positions, triangles, fan, uint32_t(v));
                          }
                      });
    return normals;
}

Mesh load_mesh(const std::string& path, const MeshLoading& loading) {
    const std::string extension = extension_of(path);
    if (extension != ".obj" && extension != ".ply" && extension != ".vdb")
        throw InputError(Place{path}, fmt::format("meshes of the type \"{}\" are not known", extension),
                         "save it as .obj, .ply or .vdb");
    constexpr const char* kinds = ".obj, .ply or .vdb";
    std::string bytes = extension == ".vdb" ? read_bytes(path, kinds) : read_text(path, kinds);
    Mesh mesh = extension == ".obj"   ? read_obj(path, bytes, loading.warnings)
                : extension == ".ply" ? read_ply(path, bytes)
                                      : read_vdb(path, bytes);
    if (mesh.triangles.empty())
        throw InputError(Place{path}, "has no triangles",
                         "check that the surface was exported, not only its points");
    if (mesh.triangles.size() > greatest_count || mesh.positions.size() > greatest_count)
        throw InputError(Place{path}, "has more than 4,294,967,294 vertices or triangles",
                         "split it into several files");
    settle(mesh, loading, extension != ".vdb");
    finish_normals(mesh, loading.smooth);
    reserve_spare_bytes(mesh.positions);
    reserve_spare_bytes(mesh.normals);
    reserve_spare_bytes(mesh.uvs);
    reserve_spare_bytes(mesh.triangles);
    return mesh;
}

// ---- Shared by readers

std::string read_bytes(const std::string& path, const char* kinds) {
    std::error_code error;
    const std::filesystem::file_status status = std::filesystem::status(path, error);
    if (!std::filesystem::exists(status))
        throw InputError(Place{path}, "there is no such file", "check the path");
    if (!std::filesystem::is_regular_file(status))
        throw InputError(Place{path}, "is not an ordinary file",
                         fmt::format("give the path of an {} file", kinds));
    std::ifstream file(path, std::ios::binary);
    std::string bytes(file ? std::filesystem::file_size(path, error) : 0, '\0');
    if (!file || error || !file.read(bytes.data(), std::streamsize(bytes.size())))
        throw InputError(Place{path}, "cannot be read", "check the file's permissions");
    return bytes;
}

std::string read_text(const std::string& path, const char* kinds) {
    std::string bytes = read_bytes(path, kinds);
    bytes.erase(0, byte_order_mark(path, bytes));
    return bytes;
}

std::string extension_of(const std::string& path) {
    std::string extension = std::filesystem::path(path).extension().string();
    for (char& c : extension)
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    return extension;
}

namespace {

double turn(const Vec2d& a, const Vec2d& b, const Vec2d& c) {
    return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
}

// Projects the polygon to the coordinate plane in which its area is largest, oriented anticlockwise.
std::vector<Vec2d> flatten(std::span<const Vec3f> positions, std::span<const uint32_t> corners) {
    const Vec3d origin = positions[corners[0]].cast<double>();
    Vec3d normal = Vec3d::Zero(); // Newell's method: twice the areas of the three projections
    for (size_t i = 0; i < corners.size(); ++i) {
        const Vec3d a = positions[corners[i]].cast<double>() - origin;
        const Vec3d b = positions[corners[(i + 1) % corners.size()]].cast<double>() - origin;
        normal += a.cross(b);
    }
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::vector<Vec2d> flat;
    flat.reserve(corners.size());
    for (uint32_t corner : corners) {
        const Vec3d p = positions[corner].cast<double>() - origin;
        flat.push_back(normal[axis] < 0.0 ? Vec2d(p[v], p[u]) : Vec2d(p[u], p[v]));
    }
    return flat;
}

bool is_strictly_convex(std::span<const Vec2d> flat) {
    const size_t n = flat.size();
    for (size_t i = 0; i < n; ++i)
        if (!(turn(flat[i], flat[(i + 1) % n], flat[(i + 2) % n]) > 0.0)) return false;
    return true;
}

// True if the corner turns left and its triangle contains no other corner. Corners at the same points (a
// polygon with a slit) are ignored.
bool is_ear(std::span<const Vec2d> flat, std::span<const uint32_t> ring, size_t i) {
    const size_t n = ring.size();
    const Vec2d &a = flat[ring[(i + n - 1) % n]], &b = flat[ring[i]], &c = flat[ring[(i + 1) % n]];
    if (!(turn(a, b, c) > 0.0)) return false;
    for (uint32_t corner : ring) {
        const Vec2d& p = flat[corner];
        if (p == a || p == b || p == c) continue;
        if (turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0) return false;
    }
    return true;
}

} // namespace

void append_polygon(std::span<const Vec3f> positions, std::span<const uint32_t> corners,
                    std::vector<Triangle>& triangles) {
    if (corners.size() == 3) {
        triangles.push_back({corners[0], corners[1], corners[2]});
        return;
    }
    const std::vector<Vec2d> flat = flatten(positions, corners);
    if (is_strictly_convex(flat)) {
        for (size_t i = 1; i + 1 < corners.size(); ++i)
            triangles.push_back({corners[0], corners[i], corners[i + 1]});
        return;
    }
    std::vector<uint32_t> ring(corners.size());
    for (size_t i = 0; i < ring.size(); ++i) ring[i] = uint32_t(i);
    size_t at = 1;
    while (ring.size() > 3) {
        const size_t n = ring.size();
        size_t tried = 0;
        while (tried < n && !is_ear(flat, ring, (at + tried) % n)) ++tried;
        const size_t ear = (at + tried) % n; // a polygon that crosses itself may have none: take any corner
        triangles.push_back(
            {corners[ring[(ear + n - 1) % n]], corners[ring[ear]], corners[ring[(ear + 1) % n]]});
        ring.erase(ring.begin() + std::ptrdiff_t(ear));
        at = ear + 1; // skip one: avoids a fan of slivers
    }
    triangles.push_back({corners[ring[0]], corners[ring[1]], corners[ring[2]]});
}

} // namespace marram
