// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/polylines.h"

#include "core/geometry/mesh_reader.h"

#include <fmt/format.h>
#include <tiny_obj_loader.h>

#include <charconv>
#include <cmath>
#include <sstream>

namespace marram {

namespace {

// tinyobjloader reads what it cannot parse as 0: check the vertices first.
void check_obj_vertices(const std::string& file, const std::string& bytes) {
    std::istringstream text(bytes);
    std::string word;
    int number = 1;
    for (std::string row; std::getline(text, row); ++number) {
        std::istringstream words(row);
        if (!(words >> word) || word != "v") continue;
        for (int axis = 0; axis < 3; ++axis) {
            double value = 0.0;
            words >> word;
            const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
            if (!words || error != std::errc() || end != word.data() + word.size() || !std::isfinite(value))
                throw InputError({file, number, 0}, "this vertex is not three finite numbers",
                                 "give \"v x y z\"");
        }
    }
}

std::vector<Polyline> read_obj_polylines(const std::string& file, const std::string& bytes) {
    check_obj_vertices(file, bytes);
    tinyobj::attrib_t attributes;
    std::vector<tinyobj::shape_t> shapes;
    std::vector<tinyobj::material_t> unused;
    std::string warning, error;
    std::istringstream text(bytes);
    if (!tinyobj::LoadObj(&attributes, &shapes, &unused, &warning, &error, &text, nullptr, false))
        throw InputError({file}, "cannot be read: " + error, "export it anew");
    const size_t points = attributes.vertices.size() / 3;
    std::vector<Polyline> lines;
    for (const tinyobj::shape_t& shape : shapes) {
        size_t next = 0;
        for (const int count : shape.lines.num_line_vertices) {
            std::vector<Vec3d>& line = lines.emplace_back().points;
            for (int i = 0; i < count; ++i) {
                const int index = shape.lines.indices[next++].vertex_index;
                if (index < 0 || size_t(index) >= points)
                    throw InputError({file},
                                     fmt::format("line {} names a vertex that is not there", lines.size()),
                                     "check that the file is complete");
                const auto* v = &attributes.vertices[3 * size_t(index)];
                const Vec3d p{double(v[0]), double(v[1]), double(v[2])};
                if (!(p.cwiseAbs().maxCoeff() <= greatest_curve_coordinate))
                    throw InputError({file}, fmt::format("vertex {} is beyond 1e8 m", index + 1),
                                     "scale it down");
                line.push_back(p);
            }
        }
    }
    return lines;
}

} // namespace

std::vector<Polyline> load_polylines(const std::string& file) {
    const std::string extension = extension_of(file);
    if (extension != ".obj" && extension != ".ply" && extension != ".usda")
        throw InputError({file}, fmt::format("curves of the type \"{}\" are not known", extension),
                         extension == ".hair" ? "write type = \"strands\""
                                              : "save them as .obj, .ply or .usda");
    const std::string bytes = read_bytes(file, ".obj, .ply or .usda");
    std::vector<Polyline> lines = extension == ".obj"   ? read_obj_polylines(file, bytes)
                                  : extension == ".ply" ? read_ply_polylines(file, bytes)
                                                        : read_usda_polylines(file, bytes);
    if (lines.empty())
        throw InputError({file}, "has no lines", "give l elements, as \"l 1 2 3\", edges, or a strand_id");
    return lines;
}

} // namespace marram
