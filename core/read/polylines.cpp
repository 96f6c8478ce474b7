// SPDX-License-Identifier: Apache-2.0
#include "core/read/polylines.h"
#include "core/math/file_types.h"

#include "core/read/mesh_reader.h"
#include "core/read/obj_lines.h"

#include <fmt/format.h>

namespace marram {

namespace {

std::vector<Polyline> read_obj_polylines(const std::string& file, std::string_view bytes) {
    const ObjLines obj = read_obj_lines(file, bytes);
    std::vector<Polyline> lines;
    lines.reserve(obj.counts.size());
    auto next = obj.order.begin();
    for (const uint32_t count : obj.counts) {
        std::vector<Vec3d>& points = lines.emplace_back().points;
        for (uint32_t i = 0; i < count; ++i) // as floats, which scenes keep
            points.push_back(obj.vertices[*next++].cast<float>().cast<double>());
    }
    return lines;
}

} // namespace

void check_prims(const std::string& file, const std::string& extension, std::span<const std::string> prims) {
    if (!prims.empty() && extension != ".usda")
        throw InputError({file}, "prims chooses among the prims of a .usda, and this is none",
                         "leave prims out");
}

std::vector<Polyline> load_polylines(const std::string& file, std::span<const std::string> prims,
                                     std::vector<std::string>* warnings) {
    const std::string extension = extension_of(file);
    const std::string kinds = listed_files(polyline_files);
    if (!is_one_of(extension, polyline_files))
        throw InputError({file}, fmt::format("curves of the type \"{}\" are not known", extension),
                         extension == ".hair" ? "write type = \"strands\"" : "save them as " + kinds);
    check_prims(file, extension, prims);
    const std::string bytes = read_text(file, kinds);
    std::vector<Polyline> lines = extension == ".obj"   ? read_obj_polylines(file, bytes)
                                  : extension == ".ply" ? read_ply_polylines(file, bytes)
                                                        : read_usda_polylines(file, bytes, prims, warnings);
    if (lines.empty())
        throw InputError({file}, "has no lines", "give l elements, as \"l 1 2 3\", edges, or a strand_id");
    return lines;
}

} // namespace marram
