// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/polylines.h"

#include "core/math/problem.h"

#include <fmt/format.h>
#include <tiny_obj_loader.h>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace marram {

std::vector<std::vector<Vec3d>> load_polylines(const std::string& file) {
    if (std::filesystem::path(file).extension() != ".obj")
        throw InputError({file}, "is no .obj file", "convert the curves to l elements of an .obj file");
    std::ifstream text(file); // tinyobjloader takes what it cannot parse for 0
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
    tinyobj::attrib_t attributes;
    std::vector<tinyobj::shape_t> shapes;
    std::vector<tinyobj::material_t> unused;
    std::string warning, error;
    if (!tinyobj::LoadObj(&attributes, &shapes, &unused, &warning, &error, file.c_str(), nullptr, false))
        throw InputError({file}, "cannot be read: " + error, "export it anew");
    const size_t points = attributes.vertices.size() / 3;
    std::vector<std::vector<Vec3d>> lines;
    for (const tinyobj::shape_t& shape : shapes) {
        size_t next = 0;
        for (const int count : shape.lines.num_line_vertices) {
            std::vector<Vec3d>& line = lines.emplace_back();
            for (int i = 0; i < count; ++i) {
                const int index = shape.lines.indices[next++].vertex_index;
                if (index < 0 || size_t(index) >= points)
                    throw InputError({file},
                                     fmt::format("line {} names a vertex that is not there", lines.size()),
                                     "check that the file is complete");
                const auto* v = &attributes.vertices[3 * size_t(index)];
                const Vec3d p{double(v[0]), double(v[1]), double(v[2])};
                constexpr double most = 1e8; // as scenes may have
                if (!(p.cwiseAbs().maxCoeff() <= most))
                    throw InputError({file}, fmt::format("vertex {} is beyond 1e8 m", index + 1),
                                     "scale it down");
                line.push_back(p);
            }
        }
    }
    if (lines.empty()) throw InputError({file}, "has no lines", "give l elements, as \"l 1 2 3\"");
    return lines;
}

} // namespace marram
