// SPDX-License-Identifier: Apache-2.0
// Numbers are parsed here: tinyobjloader reads what it cannot parse as 0, wraps large indices, drops what
// stands behind a number, and is off by up to a unit in the last place.
#include "core/read/obj_lines.h"

#include "core/read/mesh_reader.h"
#include "core/read/polylines.h"

#include <fmt/format.h>

#include <cmath>

namespace marram {

namespace {

class ObjLinesReader {
  public:
    ObjLinesReader(const std::string& path, std::string_view bytes) : path_(path), bytes_(bytes) {}
    ObjLines read();

  private:
    std::string_view word(std::string_view& line) const;
    void read_vertex(std::string_view line);
    void read_line(std::string_view line);
    [[noreturn]] void fail(std::string_view at, const std::string& what, const std::string& fix) const {
        throw InputError(place_of(path_, bytes_, size_t(at.data() - bytes_.data())), what, fix);
    }

    const std::string& path_;
    std::string_view bytes_;
    ObjLines lines_;
};

// Takes the next word off the line; "" at its end or at a comment.
std::string_view ObjLinesReader::word(std::string_view& line) const {
    constexpr std::string_view blanks = " \t\r";
    line.remove_prefix(std::min(line.find_first_not_of(blanks), line.size()));
    const std::string_view taken = line.substr(0, line.find_first_of(blanks));
    if (taken.starts_with('#')) return line.substr(0, 0);
    line.remove_prefix(taken.size());
    return taken;
}

void ObjLinesReader::read_vertex(std::string_view line) {
    Vec3d vertex;
    for (int axis = 0; axis < 3; ++axis) {
        const std::string_view text = word(line);
        if (parse_number(text, vertex[axis]) != NumberFault::none)
            fail(text, "this vertex is not three finite numbers", "give \"v x y z\"");
        if (!(std::fabs(vertex[axis]) <= max_curve_coordinate))
            fail(text, fmt::format("the coordinate {} is beyond 1e8 m", vertex[axis]), "scale it down");
    }
    double unused = 0.0; // w or a colour
    for (std::string_view text = word(line); !text.empty(); text = word(line))
        if (parse_number(text, unused) == NumberFault::not_a_number)
            fail(text, fmt::format("\"{}\" is not a number", text.substr(0, 32)), "write a number");
    lines_.vertices.push_back(vertex);
}

// l 1 2 3, or l 1/1 2/2 with texture coordinates; negative indices count back from the latest vertex.
void ObjLinesReader::read_line(std::string_view line) {
    constexpr auto most = int64_t(max_count);
    uint32_t count = 0;
    for (std::string_view text = word(line); !text.empty(); text = word(line), ++count) {
        const size_t slash = std::min(text.find('/'), text.size());
        int64_t index = 0, unused = 0;
        const WholeFault fault = parse_whole(text.substr(0, slash), -most, most, index);
        const bool has_uv = slash + 1 < text.size();
        const bool bad_uv =
            has_uv && parse_whole(text.substr(slash + 1), -most, most, unused) != WholeFault::none;
        if (fault == WholeFault::not_whole || (fault == WholeFault::none && index == 0) || bad_uv)
            fail(text, fmt::format("\"{}\" is no index of a vertex", text.substr(0, 32)),
                 "give \"l 1 2 3\"; indices count from 1");
        if (index < 0) index += int64_t(lines_.vertices.size()) + 1;
        if (fault == WholeFault::out_of_range || index < 1)
            fail(text, fmt::format("\"{}\" names a vertex that is not there", text.substr(0, 32)),
                 "check that the file is complete");
        lines_.order.push_back(uint32_t(index - 1));
    }
    lines_.counts.push_back(count);
}

ObjLines ObjLinesReader::read() {
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
    if (lines_.counts.empty()) throw InputError({path_}, "has no lines", "give l elements, as \"l 1 2 3\"");
    for (const uint32_t vertex : lines_.order)
        if (vertex >= lines_.vertices.size()) // checked last: a vertex may follow its line
            throw InputError({path_},
                             fmt::format("a line names vertex {}, there are {}", uint64_t(vertex) + 1,
                                         lines_.vertices.size()),
                             "check that the file is complete");
    return std::move(lines_);
}

} // namespace

ObjLines read_obj_lines(const std::string& file, std::string_view bytes) {
    return ObjLinesReader(file, bytes).read();
}

} // namespace marram
