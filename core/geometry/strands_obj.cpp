// SPDX-License-Identifier: Apache-2.0
// Reads strands from Wavefront OBJ files: vertices (v), and lines through them (l). Numbers are parsed here
// to the nearest float; tinyobjloader is off by up to a unit in the last place.
#include "core/geometry/mesh_reader.h"
#include "core/geometry/polylines.h"
#include "core/geometry/strand_file.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace marram {

namespace {

class ObjStrandsReader {
  public:
    ObjStrandsReader(const std::string& path, std::string_view bytes) : path_(path), bytes_(bytes) {}
    StrandFile read();

  private:
    std::string_view word(std::string_view& line) const;
    void read_vertex(std::string_view line);
    void read_line(std::string_view line);
    [[noreturn]] void fail(std::string_view at, const std::string& what, const std::string& fix) const {
        throw InputError(place_of(path_, bytes_, size_t(at.data() - bytes_.data())), what, fix);
    }

    const std::string& path_;
    std::string_view bytes_;
    std::vector<Vec3f> vertices_;
    std::vector<uint32_t> order_; // vertices of all CVs
    StrandFile strands_;
};

// Takes the next word off the line; "" at its end or at a comment.
std::string_view ObjStrandsReader::word(std::string_view& line) const {
    constexpr std::string_view blanks = " \t\r";
    line.remove_prefix(std::min(line.find_first_not_of(blanks), line.size()));
    const std::string_view taken = line.substr(0, line.find_first_of(blanks));
    if (taken.starts_with('#')) return line.substr(0, 0);
    line.remove_prefix(taken.size());
    return taken;
}

void ObjStrandsReader::read_vertex(std::string_view line) {
    Vec3f vertex;
    for (int axis = 0; axis < 3; ++axis) {
        const std::string_view text = word(line);
        double value = 0.0;
        if (parse_number(text, value) != NumberFault::none)
            fail(text, "this vertex is not three finite numbers", "give \"v x y z\"");
        if (!(std::fabs(value) <= greatest_curve_coordinate))
            fail(text, fmt::format("the coordinate {} is beyond 1e8 m", value), "scale it down");
        vertex[axis] = float(value);
    }
    vertices_.push_back(vertex);
}

// l 1 2 3, or l 1/1 2/2 with texture coordinates; negative indices count back from the latest vertex.
void ObjStrandsReader::read_line(std::string_view line) {
    uint32_t count = 0;
    for (std::string_view text = word(line); !text.empty(); text = word(line), ++count) {
        int64_t index = 0;
        const std::string_view first = text.substr(0, text.find('/'));
        const auto [stop, error] = std::from_chars(first.data(), first.data() + first.size(), index);
        if (error != std::errc() || stop != first.data() + first.size() || index == 0)
            fail(text, fmt::format("\"{}\" is no index of a vertex", text.substr(0, 32)),
                 "give \"l 1 2 3\"; indices count from 1");
        if (index < 0) index += int64_t(vertices_.size()) + 1;
        if (index < 1 || uint64_t(index) > greatest_count)
            fail(text, fmt::format("\"{}\" names a vertex that is not there", text.substr(0, 32)),
                 "check that the file is complete");
        order_.push_back(uint32_t(index - 1));
    }
    strands_.counts.push_back(count);
}

StrandFile ObjStrandsReader::read() {
    if (const size_t zero = bytes_.find('\0'); zero != std::string_view::npos)
        fail(bytes_.substr(zero), "holds binary data", "check that it is an OBJ file and save it again");
    const char newline = bytes_.find('\n') == std::string_view::npos ? '\r' : '\n';
    for (size_t begin = 0; begin < bytes_.size();) {
        const size_t end = std::min(bytes_.find(newline, begin), bytes_.size());
        std::string_view line = bytes_.substr(begin, end - begin);
        if (const size_t last = line.find_last_not_of(" \t\r");
            last != std::string_view::npos && line[last] == '\\' && line.find('#') == std::string_view::npos)
            fail(line.substr(last), "this line goes on in the next", "write each element on one line");
        const std::string_view kind = word(line);
        if (kind == "v") read_vertex(line);
        if (kind == "l") read_line(line);
        begin = end + 1;
    }
    if (strands_.counts.empty()) throw InputError({path_}, "has no lines", "give l elements, as \"l 1 2 3\"");
    StrandSample& sample = strands_.samples.emplace_back();
    sample.points.reserve(order_.size());
    for (const uint32_t vertex : order_) {
        if (vertex >= vertices_.size()) // checked last: a vertex may follow its line
            throw InputError(
                {path_}, fmt::format("a line names vertex {}, there are {}", vertex + 1, vertices_.size()),
                "check that the file is complete");
        sample.points.push_back(vertices_[vertex]);
    }
    remove_short_curves(path_, strands_);
    return std::move(strands_);
}

} // namespace

StrandFile read_obj_strands(const std::string& file, std::string_view bytes) {
    return ObjStrandsReader(file, bytes).read();
}

} // namespace marram
