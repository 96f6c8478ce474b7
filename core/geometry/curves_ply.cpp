// SPDX-License-Identifier: Apache-2.0
// Polylines in PLY files: see polylines.h for what is read.
#include "core/geometry/mesh_reader.h"
#include "core/geometry/ply_file.h"
#include "core/geometry/polylines.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <unordered_map>

namespace marram {

namespace {

enum CurveSlot { curve_x, curve_y, curve_z, curve_id, edge_begin, edge_end };

int curve_slot_of(const std::string& element, const PlyProperty& property) {
    constexpr std::pair<std::string_view, CurveSlot> of_vertex[] = {
        {"x", curve_x}, {"y", curve_y}, {"z", curve_z}, {"strand_id", curve_id}, {"curve_id", curve_id}};
    constexpr std::pair<std::string_view, CurveSlot> of_edge[] = {{"vertex1", edge_begin},
                                                                  {"vertex2", edge_end}};
    if (property.is_list) return ply_ignored;
    if (element == "vertex")
        for (const auto& [name, slot] : of_vertex)
            if (property.name == name) return slot;
    if (element == "edge")
        for (const auto& [name, slot] : of_edge)
            if (property.name == name) return slot;
    return ply_ignored;
}

class PlyCurves {
  public:
    PlyCurves(const std::string& path, std::string_view bytes)
        : path_(path), file_(path, bytes, curve_slot_of) {}
    std::vector<Polyline> read();

  private:
    static constexpr uint32_t nobody = ~0u;

    void check_header() const;
    void read_vertices(const PlyElement& element);
    void read_edges(const PlyElement& element, uint64_t vertex_count);
    uint32_t read_end(const PlyProperty& property, uint64_t vertex_count);
    void join(uint32_t vertex, uint32_t other);
    Polyline walk(uint32_t begin);
    std::vector<Polyline> along_edges();
    std::vector<Polyline> by_id() const;

    const std::string& path_;
    PlyFile file_;
    std::vector<Vec3d> points_;
    std::vector<int64_t> ids_;                        // one a vertex, where there are
    std::vector<std::array<uint32_t, 2>> neighbours_; // of each vertex, where there are edges
};

void PlyCurves::check_header() const {
    const PlyElement *vertices = file_.find("vertex"), *edges = file_.find("edge"),
                     *faces = file_.find("face");
    if (!vertices) file_.fail_header("there is no element \"vertex\"", "save the curves again");
    if (!(vertices->has(curve_x) && vertices->has(curve_y) && vertices->has(curve_z)))
        file_.fail_header("the vertices have no x, y and z", "save the curves again");
    for (const PlyElement& element : file_.elements()) {
        if (element.count > greatest_count && (&element == vertices || &element == edges))
            file_.fail_header(fmt::format("{} entries of \"{}\" are too many", element.count, element.name),
                              "split it into several files");
        for (const PlyProperty& property : element.properties)
            if (property.slot >= curve_id && !property.is_whole())
                file_.fail_header(fmt::format("the property \"{}\" is no whole number", property.name),
                                  "give it an integer type such as int");
    }
    if (edges && edges->count > 0 && !(edges->has(edge_begin) && edges->has(edge_end)))
        file_.fail_header("the edges have no vertex1 and vertex2", "save the curves again");
    if (faces && faces->count > 0 && !edges && !vertices->has(curve_id))
        file_.fail_header("is a mesh: it has faces, neither edges nor a strand_id",
                          "export the curves alone, or read it as a [[mesh]]");
}

void PlyCurves::read_vertices(const PlyElement& element) {
    points_.reserve(element.count);
    if (element.has(curve_id)) ids_.reserve(element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
        file_.begin_entry(element, i);
        Vec3d point = Vec3d::Zero();
        for (const PlyProperty& property : element.properties) {
            if (property.slot == ply_ignored) {
                file_.skip_property(property);
                continue;
            }
            const double value = file_.read_number(property, property.type);
            if (!std::isfinite(value))
                file_.fail(fmt::format("\"{}\" is not a finite number", property.name),
                           "write a finite number");
            if (property.slot == curve_id) {
                if (value != std::floor(value) || std::fabs(value) > 4294967295.0) // ascii may say anything
                    file_.fail(fmt::format("\"{}\" is {}", property.name, value),
                               "write a whole number of 32 bits");
                ids_.push_back(int64_t(value));
                continue;
            }
            if (std::fabs(value) > greatest_curve_coordinate)
                file_.fail(fmt::format("the coordinate {} is beyond 1e8 m", value), "scale it down");
            point[property.slot] = value;
        }
        file_.end_entry();
        points_.push_back(point);
    }
}

uint32_t PlyCurves::read_end(const PlyProperty& property, uint64_t vertex_count) {
    const double index = file_.read_number(property, property.type);
    if (!(index >= 0.0 && index < double(vertex_count) && index == std::floor(index)))
        file_.fail(
            fmt::format("vertex index {} is out of range, the file has {} vertices", index, vertex_count),
            "indices count from 0; check that the file is complete");
    return uint32_t(index);
}

void PlyCurves::join(uint32_t vertex, uint32_t other) {
    std::array<uint32_t, 2>& both = neighbours_[vertex];
    if (both[0] == other || vertex == other)
        file_.fail(fmt::format("the edge from {} to {} leads nowhere new", vertex, other),
                   "join each two vertices once");
    if (both[1] != nobody)
        file_.fail(fmt::format("vertex {} has three edges, a curve does not fork", vertex),
                   "split it into curves that end there");
    both[both[0] == nobody ? 0 : 1] = other;
}

void PlyCurves::read_edges(const PlyElement& element, uint64_t vertex_count) {
    if (points_.size() != vertex_count)
        file_.fail_header("the edges stand before the vertices", "write the element \"vertex\" first");
    neighbours_.assign(vertex_count, {nobody, nobody});
    for (uint64_t i = 0; i < element.count; ++i) {
        file_.begin_entry(element, i);
        uint32_t ends[2] = {};
        for (const PlyProperty& property : element.properties)
            if (property.slot == edge_begin || property.slot == edge_end)
                ends[property.slot - edge_begin] = read_end(property, vertex_count);
            else
                file_.skip_property(property);
        join(ends[0], ends[1]);
        join(ends[1], ends[0]);
        file_.end_entry();
    }
}

// From an end, or around a ring. What has been walked has no neighbours any more.
Polyline PlyCurves::walk(uint32_t begin) {
    Polyline line;
    line.closed = neighbours_[begin][1] != nobody;
    uint32_t from = nobody, at = begin;
    while (at != nobody) {
        line.points.push_back(points_[at]);
        const std::array<uint32_t, 2> both = neighbours_[at];
        neighbours_[at] = {nobody, nobody};
        const uint32_t next = both[0] == from ? both[1] : both[0];
        from = at;
        at = next == begin ? nobody : next;
    }
    return line;
}

std::vector<Polyline> PlyCurves::along_edges() {
    std::vector<Polyline> lines;
    for (uint32_t v = 0; v < points_.size(); ++v) // ends: one neighbour
        if (neighbours_[v][0] != nobody && neighbours_[v][1] == nobody) lines.push_back(walk(v));
    for (uint32_t v = 0; v < points_.size(); ++v) // what is left are rings
        if (neighbours_[v][0] != nobody) lines.push_back(walk(v));
    return lines;
}

std::vector<Polyline> PlyCurves::by_id() const {
    std::vector<Polyline> lines;
    std::unordered_map<int64_t, size_t> line_of;
    for (size_t v = 0; v < points_.size(); ++v) {
        const auto [found, is_new] = line_of.emplace(ids_[v], lines.size());
        if (is_new) lines.emplace_back();
        lines[found->second].points.push_back(points_[v]);
    }
    return lines;
}

std::vector<Polyline> PlyCurves::read() {
    file_.read_header();
    check_header();
    const uint64_t vertex_count = file_.find("vertex")->count;
    for (const PlyElement& element : file_.elements()) {
        file_.check_room(element);
        if (element.name == "vertex") {
            if (element.count == 0)
                throw InputError({path_}, "has no vertices", "check that the curves were exported");
            read_vertices(element);
        } else if (element.name == "edge" && element.count > 0) {
            read_edges(element, vertex_count);
        } else {
            file_.skip_element(element);
        }
    }
    file_.check_end();
    if (!neighbours_.empty()) return along_edges();
    if (!ids_.empty()) return by_id();
    return {{std::move(points_), false}};
}

} // namespace

std::vector<Polyline> read_ply_polylines(const std::string& file, std::string_view bytes) {
    return PlyCurves(file, bytes).read();
}

} // namespace marram
