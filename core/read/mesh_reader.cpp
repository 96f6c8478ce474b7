// SPDX-License-Identifier: Apache-2.0
#include "core/read/mesh_reader.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>

namespace marram {

std::string read_bytes(const std::string& path, const std::string& kinds) {
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

std::string read_text(const std::string& path, const std::string& kinds) {
    std::string bytes = read_bytes(path, kinds);
    bytes.erase(0, byte_order_mark(path, bytes));
    return bytes;
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
                    std::vector<std::array<uint32_t, 3>>& triangles) {
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
