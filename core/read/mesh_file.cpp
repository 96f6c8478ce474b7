// SPDX-License-Identifier: Apache-2.0
#include "core/read/mesh_file.h"
#include "core/math/file_types.h"

#include "core/geometry/embree_buffer.h"
#include "core/geometry/mesh_sides.h"
#include "core/read/mesh_reader.h"

#include <fmt/format.h>

#include <algorithm>

namespace marram {

namespace {

using Triangle = std::array<uint32_t, 3>;

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
    constexpr size_t max_edges = 256; // of polygons that differ
    if (a.size() != b.size()) return false;
    std::vector<std::pair<uint32_t, uint32_t>> edges; // of an odd number of both; none: a polygon ends
    const auto toggle = [&](uint32_t from, uint32_t to) {
        const std::pair edge = std::minmax({from, to});
        if (const auto same = std::ranges::find(edges, edge); same != edges.end())
            edges.erase(same);
        else
            edges.push_back(edge);
    };
    for (size_t t = 0; t < a.size() && edges.size() <= max_edges; ++t) {
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

Mesh load_mesh(const std::string& path, const MeshLoading& loading) {
    const std::string extension = extension_of(path);
    const std::string kinds = listed_files(mesh_files);
    if (!is_one_of(extension, mesh_files))
        throw InputError(Place{path}, fmt::format("meshes of the type \"{}\" are not known", extension),
                         "save it as " + kinds);
    std::string bytes = extension == ".vdb" ? read_bytes(path, kinds) : read_text(path, kinds);
    Mesh mesh = extension == ".obj"   ? read_obj(path, bytes, loading.warnings)
                : extension == ".ply" ? read_ply(path, bytes)
                                      : read_vdb(path, bytes);
    if (mesh.triangles.empty())
        throw InputError(Place{path}, "has no triangles",
                         "check that the surface was exported, not only its points");
    if (mesh.triangles.size() > max_count || mesh.positions.size() > max_count)
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

} // namespace marram
