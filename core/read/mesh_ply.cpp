// SPDX-License-Identifier: Apache-2.0
// Reads meshes from PLY files (ply_file.h). Used are, of the element "vertex", x y z, nx ny nz, and s t | u v
// | texture_u texture_v; of the element "face" the list vertex_indices | vertex_index.
#include "core/read/mesh_reader.h"
#include "core/read/ply_file.h"

#include <fmt/format.h>

#include <limits>

namespace marram {

namespace {

// Destination of a property. The first eight are a vertex's numbers.
enum MeshSlot { px, py, pz, nx, ny, nz, tu, tv, vertex_slots, face_corners };

int mesh_slot_of(const std::string& element, const PlyProperty& property) {
    constexpr std::pair<std::string_view, MeshSlot> names[] = {
        {"x", px}, {"y", py}, {"z", pz}, {"nx", nx}, {"ny", ny},        {"nz", nz},
        {"s", tu}, {"t", tv}, {"u", tu}, {"v", tv},  {"texture_u", tu}, {"texture_v", tv},
    };
    if (element == "face" && property.is_list &&
        (property.name == "vertex_indices" || property.name == "vertex_index"))
        return face_corners;
    if (element == "vertex" && !property.is_list)
        for (const auto& [name, slot] : names)
            if (property.name == name) return slot;
    return ply_ignored;
}

class PlyMesh {
  public:
    PlyMesh(const std::string& path, std::string_view bytes) : file_(path, bytes, mesh_slot_of) {}
    Mesh read();

  private:
    void check_header() const;
    void read_vertices(const PlyElement& element, Mesh& mesh);
    void read_faces(const PlyElement& element, uint64_t vertex_count);
    void read_corners(const PlyProperty& property, uint64_t vertex_count);

    PlyFile file_;
    std::vector<uint32_t> corners_, face_sizes_;
};

void PlyMesh::check_header() const {
    for (const PlyElement& element : file_.elements()) {
        if (element.name == "vertex" && !(element.has(px) && element.has(py) && element.has(pz)))
            file_.fail_header("the vertices have no x, y and z", "save the mesh again");
        if (element.name == "face" && element.count > 0 && !element.has(face_corners))
            file_.fail_header("the faces have no list vertex_indices", "save the mesh again");
        if ((element.name == "vertex" || element.name == "face") && element.count > max_count)
            file_.fail_header(fmt::format("{} entries of \"{}\" are too many", element.count, element.name),
                              "split it into several files");
    }
}

void PlyMesh::read_vertices(const PlyElement& element, Mesh& mesh) {
    const bool has_normals = element.has(nx) && element.has(ny) && element.has(nz);
    const bool has_uvs = element.has(tu) && element.has(tv);
    mesh.positions.reserve(element.count + 2); // plus spare bytes
    if (has_normals) mesh.normals.reserve(element.count + 2);
    if (has_uvs) mesh.uvs.reserve(element.count + 2);
    double values[vertex_slots] = {};
    for (uint64_t i = 0; i < element.count; ++i) {
        file_.begin_entry(element, i);
        for (const PlyProperty& property : element.properties) {
            if (property.slot == ply_ignored) {
                file_.skip_property(property);
                continue;
            }
            const double value = values[size_t(property.slot)] = file_.read_number(property, property.type);
            if (!(std::fabs(value) <= std::numeric_limits<float>::max()))
                file_.fail(fmt::format("\"{}\" is not a finite number", property.name),
                           "write a finite number");
            if (property.slot <= pz && std::fabs(value) > embree_limit)
                file_.fail(fmt::format("the coordinate {} is beyond 1e18", value), "scale the mesh down");
        }
        file_.end_entry();
        mesh.positions.push_back(Vec3d(values[px], values[py], values[pz]).cast<float>());
        if (has_normals) mesh.normals.push_back(Vec3d(values[nx], values[ny], values[nz]).cast<float>());
        if (has_uvs) mesh.uvs.push_back(Vec2d(values[tu], values[tv]).cast<float>());
    }
}

void PlyMesh::read_corners(const PlyProperty& property, uint64_t vertex_count) {
    const uint64_t size = file_.list_length(property);
    if (size < 3) file_.fail(fmt::format("a face of {} corners", size), "a face needs at least 3");
    if (size > max_polygon)
        file_.fail(fmt::format("a face of {} corners, more than {}", size, max_polygon), "split it");
    for (uint64_t i = 0; i < size; ++i) {
        const double index = file_.read_number(property, property.type);
        if (!(index >= 0.0 && index < double(vertex_count) && index == std::floor(index)))
            file_.fail(
                fmt::format("vertex index {} is out of range, the file has {} vertices", index, vertex_count),
                "indices count from 0; check that the file is complete");
        corners_.push_back(uint32_t(index));
    }
    face_sizes_.push_back(uint32_t(size));
}

void PlyMesh::read_faces(const PlyElement& element, uint64_t vertex_count) {
    constexpr size_t usual_corners = 3;
    corners_.reserve(element.count * usual_corners);
    face_sizes_.reserve(element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
        file_.begin_entry(element, i);
        for (const PlyProperty& property : element.properties)
            if (property.slot == face_corners)
                read_corners(property, vertex_count);
            else
                file_.skip_property(property);
        file_.end_entry();
    }
}

Mesh PlyMesh::read() {
    file_.read_header();
    check_header();
    const PlyElement* vertices = file_.find("vertex");
    const uint64_t vertex_count = vertices ? vertices->count : 0;
    Mesh mesh;
    for (const PlyElement& element : file_.elements()) {
        file_.check_room(element);
        if (element.name == "vertex")
            read_vertices(element, mesh);
        else if (element.name == "face")
            read_faces(element, vertex_count);
        else
            file_.skip_element(element);
    }
    file_.check_end();
    mesh.triangles.reserve(corners_.size() - 2 * face_sizes_.size() + 2);
    const uint32_t* next = corners_.data();
    for (uint32_t size : face_sizes_) {
        append_polygon(mesh.positions, {next, size}, mesh.triangles);
        next += size;
    }
    return mesh;
}

} // namespace

Mesh read_ply(const std::string& path, std::string& bytes) { return PlyMesh(path, bytes).read(); }

} // namespace marram
