// SPDX-License-Identifier: Apache-2.0
#include "core/write/grid_export.h"
#include "core/math/file_types.h"

#include "core/image/atomic_file.h"
#include "core/image/image.h"
#include "core/read/grid_placement.h"
#include "core/read/mesh_reader.h"
#include "core/write/export_name.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <set>

namespace marram {
namespace {

bool is_flat(const GridValues& grid) { return grid.grid.nz == 1 && grid.grid.components == 1; }

bool alike(const GridValues& a, const GridValues& b) {
    return is_flat(b) && a.grid.nx == b.grid.nx && a.grid.ny == b.grid.ny;
}

double length(const double* axis) { return Vec3d(axis).norm(); }

GridPlacement placement_of(const MarramGrid& grid) {
    GridPlacement placement;
    placement.cell = length(grid.axes[0]);
    const double rows = length(grid.axes[1]);
    placement.center = {grid.origin[0] + 0.5 * placement.cell * (grid.nx - 1),
                        grid.origin[2] + 0.5 * rows * (grid.ny - 1)};
    placement.size = {placement.cell * grid.nx, rows * grid.ny};
    return placement;
}

void write_all_grids(const std::string& path, const MeshGeometry& mesh) {
    const GridValues& first = mesh.grids[0];
    std::vector<Layer> layers = {{"", {"Y"}, first.values.data(), false}};
    for (const GridValues& other : mesh.grids)
        if (alike(first, other)) layers.push_back({"grid", {other.name}, other.values.data(), false});
    write_exr(path, int(first.grid.nx), int(first.grid.ny), layers,
              metadata_of(placement_of(first.grid), mesh.name));
}

void write_height_tiff(const std::string& path, const MeshGeometry& mesh) {
    const GridValues& height = mesh.grids[0];
    write_grey_tiff(path, int(height.grid.nx), int(height.grid.ny), height.values.data(),
                    description_of(metadata_of(placement_of(height.grid), mesh.name)));
}

size_t write_height_png(const std::string& path, const MeshGeometry& mesh,
                        const std::optional<Vec2d>& range) {
    const GridValues& height = mesh.grids[0];
    GridPlacement placement = placement_of(height.grid);
    placement.range = range ? *range : height_range(mesh);
    if (!(placement.range.x() < placement.range.y()))
        placement.range.y() = placement.range.x() + 1.0; // flat: all 0
    constexpr double most = 65535.0;
    const double steps = most / (placement.range.y() - placement.range.x());
    std::vector<uint16_t> pixels(height.values.size());
    for (size_t i = 0; i < pixels.size(); ++i)
        pixels[i] =
            uint16_t(std::clamp((double(height.values[i]) - placement.range.x()) * steps + 0.5, 0.0, most));
    write_grey_png(path, int(height.grid.nx), int(height.grid.ny), pixels.data(),
                   metadata_of(placement, mesh.name));
    return size_t(std::ranges::count_if(height.values, [&](float v) {
        return double(v) < placement.range.x() || double(v) > placement.range.y();
    }));
}

} // namespace

Vec2d height_range(const MeshGeometry& mesh) {
    const auto [low, high] = std::ranges::minmax(mesh.grids.at(0).values);
    return {double(low), double(high)};
}

size_t write_grids(const std::string& path, const MeshGeometry& mesh, const std::optional<Vec2d>& range) {
    if (mesh.grids.empty() || !is_flat(mesh.grids[0]))
        throw InputError({path}, "'" + mesh.name + "' hands out no grid of heights",
                         "bake a procedural that does, such as a terrain");
    const std::string extension = extension_of(path);
    if (extension == ".png") return write_height_png(path, mesh, range);
    if (extension == ".tif" || extension == ".tiff")
        write_height_tiff(path, mesh);
    else
        write_all_grids(path, mesh);
    return 0;
}

// ---- The surface

namespace {

static_assert(std::endian::native == std::endian::little);

// Buffered binary output to a file, row by row.
class PlyRows {
  public:
    explicit PlyRows(AtomicFile& file) : file_(file) { buffer_.reserve(chunk + max_row); }
    ~PlyRows() = default;
    PlyRows(const PlyRows&) = delete;
    PlyRows& operator=(const PlyRows&) = delete;
    template <typename Value>
    void add(const Value* values, size_t count) {
        const auto* bytes = reinterpret_cast<const char*>(values);
        buffer_.insert(buffer_.end(), bytes, bytes + count * sizeof(Value));
        if (buffer_.size() >= chunk) flush();
    }
    void flush() {
        file_.write(buffer_.data(), buffer_.size());
        buffer_.clear();
    }

  private:
    static constexpr size_t chunk = size_t(1) << 20, max_row = size_t(1) << 12;
    AtomicFile& file_;
    std::vector<char> buffer_;
};

std::string ply_properties(const MeshGeometry& mesh, MarramRate rate, std::set<std::string>& taken) {
    std::string text;
    for (const AttributeValues& attribute : mesh.attributes)
        if (attribute.rate == rate)
            for (uint32_t c = 0; c < attribute.components; ++c)
                text +=
                    fmt::format("property float {}\n",
                                unique_name(attribute.components > 1 ? fmt::format("{}_{}", attribute.name, c)
                                                                     : attribute.name,
                                            "attribute", taken));
    return text;
}

std::string ply_header(const MeshGeometry& mesh, bool has_normals) {
    std::set<std::string> of_vertex = {"x", "y", "z", "nx", "ny",        "nz",
                                       "s", "t", "u", "v",  "texture_u", "texture_v"},
                          of_face = {"vertex_index", "vertex_indices"};
    std::string text = "ply\nformat binary_little_endian 1.0\ncomment baked by Marram: y up, metres\n";
    text += fmt::format("element vertex {}\nproperty float x\nproperty float y\nproperty float z\n",
                        mesh.positions.at(0).size());
    if (has_normals) text += "property float nx\nproperty float ny\nproperty float nz\n";
    if (!mesh.uvs.empty()) text += "property float s\nproperty float t\n";
    text += ply_properties(mesh, MARRAM_PER_VERTEX, of_vertex);
    text += fmt::format("element face {}\nproperty list uchar uint vertex_indices\n", mesh.triangles.size());
    return text + ply_properties(mesh, MARRAM_PER_FACE, of_face) + "end_header\n";
}

} // namespace

void write_surface_ply(const std::string& path, const MeshGeometry& mesh) {
    const bool has_normals = !mesh.normals.empty() && !mesh.normals[0].empty();
    AtomicFile file(path);
    file.write(ply_header(mesh, has_normals));
    PlyRows rows(file);
    const auto add_attributes = [&](MarramRate rate, size_t i) {
        for (const AttributeValues& attribute : mesh.attributes)
            if (attribute.rate == rate)
                rows.add(attribute.values.data() + i * attribute.components, attribute.components);
    };
    for (size_t v = 0; v < mesh.positions.at(0).size(); ++v) {
        rows.add(mesh.positions[0][v].data(), 3);
        if (has_normals) rows.add(mesh.normals[0][v].data(), 3);
        if (!mesh.uvs.empty()) rows.add(mesh.uvs[v].data(), 2);
        add_attributes(MARRAM_PER_VERTEX, v);
    }
    for (size_t t = 0; t < mesh.triangles.size(); ++t) {
        constexpr uint8_t corners = 3;
        rows.add(&corners, 1);
        rows.add(mesh.triangles[t].data(), 3);
        add_attributes(MARRAM_PER_FACE, t);
    }
    rows.flush();
    file.commit();
}

} // namespace marram
