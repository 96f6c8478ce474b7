// SPDX-License-Identifier: Apache-2.0
// Reads curves from PLY files; polylines.h says what is supported.
#include "core/read/curves_ply.h"

#include "core/read/mesh_reader.h"
#include "core/read/polylines.h"
#include "core/read/strand_file.h"

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
    if (element == "strand" || element == "curve")
        if (property.name == "strand_id" || property.name == "curve_id") return curve_id;
    return ply_ignored;
}

bool is_curve_element(const PlyElement& element) {
    return element.name == "strand" || element.name == "curve";
}

class PlyCurves {
  public:
    PlyCurves(const std::string& path, std::string_view bytes, bool with_columns, uint32_t points_per_curve)
        : path_(path), file_(path, bytes, curve_slot_of), with_columns_(with_columns),
          points_per_curve_(points_per_curve) {}
    PlyCurvesContent read();

  private:
    static constexpr uint32_t nobody = ~0u;

    void check_header() const;
    std::vector<PlyColumn> columns_of(const PlyElement& element) const;
    int64_t read_id(const PlyProperty& property);
    void read_column(const PlyProperty& property, PlyColumn& column);
    void read_vertices(const PlyElement& element);
    void read_entries(const PlyElement& element);
    void read_edges(const PlyElement& element, uint64_t vertex_count);
    uint32_t read_end(const PlyProperty& property, uint64_t vertex_count);
    void join(uint32_t vertex, uint32_t other);
    void walk(uint32_t begin);
    void along_edges();
    void by_id();
    void by_number();
    void end_curve(bool closed) {
        content_.first.push_back(content_.order.size());
        content_.closed.push_back(closed);
    }

    const std::string& path_;
    PlyFile file_;
    bool with_columns_;
    uint32_t points_per_curve_;
    PlyCurvesContent content_;
    std::vector<int64_t> ids_;                        // [vertex], if there are ids
    std::vector<std::array<uint32_t, 2>> neighbours_; // [vertex], if there are edges
};

void PlyCurves::check_header() const {
    const PlyElement *vertices = file_.find("vertex"), *edges = file_.find("edge"),
                     *faces = file_.find("face");
    if (!vertices) file_.fail_header("there is no element \"vertex\"", "save the curves again");
    if (!(vertices->has(curve_x) && vertices->has(curve_y) && vertices->has(curve_z)))
        file_.fail_header("the vertices have no x, y and z", "save the curves again");
    for (const PlyElement& element : file_.elements()) {
        const bool is_read = &element == vertices || &element == edges || is_curve_element(element);
        if (element.count > max_count && is_read)
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

std::vector<PlyColumn> PlyCurves::columns_of(const PlyElement& element) const {
    std::vector<PlyColumn> columns;
    for (const PlyProperty& property : element.properties)
        if (with_columns_ && property.slot == ply_ignored && !property.is_list) {
            columns.push_back({property.name, property.type, {}, 0});
            columns.back().values.reserve(element.count);
        }
    return columns;
}

int64_t PlyCurves::read_id(const PlyProperty& property) {
    const double value = file_.read_number(property, property.type);
    if (!std::isfinite(value))
        file_.fail(fmt::format("\"{}\" is not a finite number", property.name), "write a finite number");
    if (value != std::floor(value) || std::fabs(value) > 4294967295.0) // ascii numbers can be anything
        file_.fail(fmt::format("\"{}\" is {}", property.name, value), "write a whole number of 32 bits");
    return int64_t(value);
}

void PlyCurves::read_column(const PlyProperty& property, PlyColumn& column) {
    const double value = file_.read_number(property, property.type);
    if (!std::isfinite(float(value)))
        file_.fail(fmt::format("\"{}\" is not a finite number", property.name),
                   "write a finite number that a float holds");
    if (!ply_holds(property.type, value))
        file_.fail(fmt::format("\"{}\" is {}, which its type does not hold", property.name, value),
                   "declare it as float");
    const bool is_whole = property.is_whole() && std::fabs(value) < 0x1p62 && value == std::floor(value);
    column.values.push_back(is_whole ? integer_to_float(int64_t(value), column.folded) : float(value));
}

void PlyCurves::read_vertices(const PlyElement& element) {
    content_.points.reserve(element.count);
    content_.of_vertices = columns_of(element);
    if (element.has(curve_id)) ids_.reserve(element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
        file_.begin_entry(element, i);
        Vec3d point = Vec3d::Zero();
        size_t column = 0;
        for (const PlyProperty& property : element.properties) {
            if (property.slot == ply_ignored) {
                if (with_columns_ && !property.is_list)
                    read_column(property, content_.of_vertices[column++]);
                else
                    file_.skip_property(property);
                continue;
            }
            if (property.slot == curve_id) {
                ids_.push_back(read_id(property));
                continue;
            }
            const double value = file_.read_number(property, property.type);
            if (!std::isfinite(value))
                file_.fail(fmt::format("\"{}\" is not a finite number", property.name),
                           "write a finite number");
            if (std::fabs(value) > max_curve_coordinate)
                file_.fail(fmt::format("the coordinate {} is beyond 1e8 m", value), "scale it down");
            point[property.slot] = value;
        }
        file_.end_entry();
        content_.points.push_back(point);
    }
}

// One entry per curve.
void PlyCurves::read_entries(const PlyElement& element) {
    if (content_.has_entries)
        file_.fail_header("has an element \"strand\" and an element \"curve\"", "keep one of them");
    content_.has_entries = true;
    content_.entries = element.count;
    content_.of_entries = columns_of(element);
    if (element.properties.empty()) return;
    for (uint64_t i = 0; i < element.count; ++i) {
        file_.begin_entry(element, i);
        size_t column = 0;
        for (const PlyProperty& property : element.properties)
            if (property.slot == curve_id)
                content_.entry_ids.push_back(read_id(property));
            else if (property.is_list)
                file_.skip_property(property);
            else
                read_column(property, content_.of_entries[column++]);
        file_.end_entry();
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
        file_.fail(
            fmt::format("the edge from {} to {} is a duplicate, or joins a vertex to itself", vertex, other),
            "join each two vertices once");
    if (both[1] != nobody)
        file_.fail(fmt::format("vertex {} has three edges, a curve does not fork", vertex),
                   "split it into curves that end there");
    both[both[0] == nobody ? 0 : 1] = other;
}

void PlyCurves::read_edges(const PlyElement& element, uint64_t vertex_count) {
    if (content_.points.size() != vertex_count)
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

// Follows the edges from an end, or around a ring. Removes the neighbours of visited vertices.
void PlyCurves::walk(uint32_t begin) {
    const bool closed = neighbours_[begin][1] != nobody;
    uint32_t from = nobody, at = begin;
    while (at != nobody) {
        content_.order.push_back(at);
        const std::array<uint32_t, 2> both = neighbours_[at];
        neighbours_[at] = {nobody, nobody};
        const uint32_t next = both[0] == from ? both[1] : both[0];
        from = at;
        at = next == begin ? nobody : next;
    }
    end_curve(closed);
}

void PlyCurves::along_edges() {
    for (uint32_t v = 0; v < neighbours_.size(); ++v) // ends: one neighbour
        if (neighbours_[v][0] != nobody && neighbours_[v][1] == nobody) walk(v);
    for (uint32_t v = 0; v < neighbours_.size(); ++v) // the rest are rings
        if (neighbours_[v][0] != nobody) walk(v);
}

void PlyCurves::by_id() {
    std::unordered_map<int64_t, uint32_t> curve_of;
    std::vector<uint32_t> curves(ids_.size());
    std::vector<uint64_t> sizes;
    for (size_t v = 0; v < ids_.size(); ++v) {
        if (v > 0 && ids_[v] == ids_[v - 1]) {
            curves[v] = curves[v - 1];
        } else {
            const auto [found, is_new] = curve_of.emplace(ids_[v], uint32_t(sizes.size()));
            if (is_new) {
                sizes.push_back(0);
                content_.ids.push_back(ids_[v]);
            }
            curves[v] = found->second;
        }
        ++sizes[curves[v]];
    }
    for (const uint64_t size : sizes) content_.first.push_back(content_.first.back() + size);
    content_.closed.assign(sizes.size(), false);
    content_.order.resize(ids_.size());
    std::vector<uint64_t> next(content_.first.begin(), content_.first.end() - 1);
    for (size_t v = 0; v < ids_.size(); ++v) content_.order[next[curves[v]]++] = uint32_t(v);
}

void PlyCurves::by_number() {
    const size_t points = content_.points.size(), each = points_per_curve_ == 0 ? points : points_per_curve_;
    if (points % each != 0)
        throw InputError({path_}, fmt::format("its {} points are not strands of {} each", points, each),
                         "give another cvs_per_strand");
    content_.is_cloud = true;
    content_.order.reserve(points);
    for (size_t i = 0; i < points; ++i) {
        content_.order.push_back(uint32_t(i));
        if ((i + 1) % each == 0) end_curve(false);
    }
}

PlyCurvesContent PlyCurves::read() {
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
        } else if (with_columns_ && is_curve_element(element)) {
            read_entries(element);
        } else {
            file_.skip_element(element);
        }
    }
    file_.check_end();
    if (!neighbours_.empty()) {
        along_edges();
    } else if (!ids_.empty()) {
        by_id();
    } else {
        by_number();
    }
    if (points_per_curve_ > 0 && !content_.is_cloud)
        throw InputError({path_},
                         "cvs_per_strand is for points without edges and ids, and this file has them",
                         "leave cvs_per_strand out");
    return std::move(content_);
}

} // namespace

PlyCurvesContent read_ply_curves(const std::string& file, std::string_view bytes, bool with_columns,
                                 uint32_t points_per_curve) {
    return PlyCurves(file, bytes, with_columns, points_per_curve).read();
}

std::vector<Polyline> read_ply_polylines(const std::string& file, std::string_view bytes) {
    const PlyCurvesContent content = read_ply_curves(file, bytes, false);
    std::vector<Polyline> lines(content.closed.size());
    for (size_t c = 0; c < lines.size(); ++c) {
        lines[c].closed = content.closed[c] != 0;
        for (uint64_t i = content.first[c]; i < content.first[c + 1]; ++i)
            lines[c].points.push_back(content.points[content.order[i]]);
    }
    return lines;
}

} // namespace marram
