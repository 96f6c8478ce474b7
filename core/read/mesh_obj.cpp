// SPDX-License-Identifier: Apache-2.0
// Reads Wavefront OBJ through tinyobjloader's callbacks. tinyobjloader reads what it cannot parse as 0,
// reports no line numbers and checks no index. So a scan of our own checks the text first and reports errors
// with their position.
#include "core/read/mesh_reader.h"

#include <fmt/format.h>
#include <tiny_obj_loader.h>

#include <algorithm>
#include <istream>
#include <limits>
#include <optional>
#include <streambuf>

namespace marram {

namespace {

constexpr uint32_t none = ~0u;

enum Kind { position, uv, normal, kind_count };
constexpr const char* kind_names[kind_count] = {"vertex", "uv", "normal"};
constexpr const char* kind_keywords[kind_count] = {"v", "vt", "vn"};

bool is_blank(char c) { return c == ' ' || c == '\t'; }

// ---- The scan

// Normalizes the text so that the scan and tinyobjloader agree: lines end in \n, and lines continued with a
// backslash are joined. Every byte stays at its offset. Returns the offsets of the newlines that were
// removed.
std::vector<size_t> normalize_lines(std::string& bytes) {
    for (size_t i = bytes.find('\r'); i != std::string::npos; i = bytes.find('\r', i + 1))
        bytes[i] = i + 1 < bytes.size() && bytes[i + 1] == '\n' ? ' ' : '\n';
    std::vector<size_t> joined;
    for (size_t i = bytes.find('\\'); i != std::string::npos; i = bytes.find('\\', i + 1)) {
        const size_t next = bytes.find_first_not_of(" \t", i + 1);
        const size_t start = bytes.find_first_not_of(" \t", bytes.rfind('\n', i) + 1);
        // A comment that ends in a backslash, such as a folder's name, is not continued.
        if (next == std::string::npos || bytes[next] != '\n' || bytes[start] == '#') continue;
        bytes[i] = bytes[next] = ' ';
        joined.push_back(next);
    }
    return joined;
}

class Scan {
  public:
    Scan(const std::string& path, std::string& bytes) : path_(path), bytes_(bytes) {}

    void run();
    size_t count(Kind kind) const { return counts_[kind]; }
    // Whether faces name uvs or normals of which the file has none at all: their indices mean nothing.
    bool has_dangling(Kind kind) const {
        return kind != position && counts_[kind] == 0 && (forward_[kind] > 0 || backward_offset_[kind] > 0);
    }
    // One line about the faces that name such uvs or normals; "" if there are none.
    std::optional<Problem> dangling_warning() const;
    size_t corners() const { return corners_; }
    size_t faces() const { return faces_; }

  private:
    void line(size_t begin, size_t end);
    void numbers(Kind kind, size_t begin, size_t end);
    void face(size_t begin, size_t end);
    void corner(size_t begin, size_t end);
    void index(Kind kind, size_t begin, size_t end);
    void check_forward_indices() const;
    [[noreturn]] void fail_index(Kind kind, size_t begin, size_t end) const;
    std::string_view token(size_t begin, size_t end) const { return {bytes_.data() + begin, end - begin}; }
    size_t skip_blanks(size_t at, size_t end) const {
        while (at < end && is_blank(bytes_[at])) ++at;
        return at;
    }
    size_t skip_word(size_t at, size_t end) const {
        while (at < end && !is_blank(bytes_[at])) ++at;
        return at;
    }
    Place place(size_t offset) const;
    [[noreturn]] void fail(size_t offset, const std::string& what, const std::string& fix) const;

    const std::string& path_;
    std::string& bytes_;
    std::vector<size_t> joined_;
    size_t counts_[kind_count] = {0, 0, 0};
    size_t corners_ = 0, faces_ = 0;
    // The largest index of each kind that is used before it is defined: OBJ does not forbid that.
    int64_t forward_[kind_count] = {0, 0, 0};
    size_t forward_offset_[kind_count] = {0, 0, 0};
    // The first index of each kind that counts back although none is defined yet; 0: there is none.
    size_t backward_offset_[kind_count] = {0, 0, 0};
    // Of each kind: number of faces with an index of it, the first such index, the last such face (from 1).
    size_t naming_faces_[kind_count] = {0, 0, 0};
    size_t naming_offset_[kind_count] = {0, 0, 0}, last_naming_[kind_count] = {0, 0, 0};
};

Place Scan::place(size_t offset) const {
    // Restore the joined newlines, so that lines are counted correctly.
    std::string text = bytes_.substr(0, offset);
    for (size_t newline : joined_)
        if (newline < offset) text[newline] = '\n';
    text += '\n';
    return place_of(path_, text, offset);
}

void Scan::fail(size_t offset, const std::string& what, const std::string& fix) const {
    throw InputError(place(offset), what, fix);
}

std::optional<Problem> Scan::dangling_warning() const {
    std::string names;
    size_t faces = 0, first = bytes_.size();
    for (const Kind kind : {uv, normal}) {
        if (!has_dangling(kind)) continue;
        names +=
            fmt::format("{}{}s ({})", names.empty() ? "" : " and ", kind_names[kind], kind_keywords[kind]);
        faces = std::max(faces, naming_faces_[kind]);
        first = std::min(first, naming_offset_[kind]);
    }
    if (faces == 0) return std::nullopt;
    return Problem{place(first),
                   fmt::format("{} to {} that the file does not have, read without them",
                               faces == 1 ? "a face refers" : fmt::format("{} faces refer", faces), names),
                   "export the mesh with them, or without these indices", "mesh.missing_values"};
}

void Scan::run() {
    joined_ = normalize_lines(bytes_);
    if (const size_t zero = bytes_.find('\0'); zero != std::string::npos)
        fail(zero, "holds binary data", "check that it is an OBJ file and save it again");
    for (size_t begin = 0; begin < bytes_.size();) {
        size_t end = bytes_.find('\n', begin);
        if (end == std::string::npos) end = bytes_.size();
        line(begin, end);
        begin = end + 1;
    }
    check_forward_indices();
}

void Scan::line(size_t begin, size_t end) {
    const size_t word = skip_blanks(begin, end);
    const size_t word_end = skip_word(word, end);
    const std::string_view keyword = token(word, word_end);
    if (keyword.empty() || (keyword[0] != 'v' && keyword != "f")) return;
    // tinyobjloader does not stop at a comment behind the numbers: blank it out.
    if (const size_t comment = token(word_end, end).find('#'); comment != std::string_view::npos)
        std::fill(bytes_.begin() + std::ptrdiff_t(word_end + comment), bytes_.begin() + std::ptrdiff_t(end),
                  ' ');
    if (keyword == "f") return face(word, end);
    for (int kind = 0; kind < kind_count; ++kind)
        if (keyword == kind_keywords[kind]) return numbers(Kind(kind), word, end);
}

void Scan::numbers(Kind kind, size_t begin, size_t end) {
    constexpr int fewest[kind_count] = {3, 1, 3},
                  most[kind_count] = {8, 3, 3}; // v: x y z, w, colour; vt: u, v, w
    int count = 0;
    for (size_t at = skip_blanks(skip_word(begin, end), end); at < end; ++count) {
        const size_t stop = skip_word(at, end);
        double value = 0.0;
        const NumberFault fault = parse_number(token(at, stop), value);
        if (fault == NumberFault::not_a_number)
            fail(at, fmt::format("\"{}\" is not a number", token(at, stop)), "write a number");
        if (count < 3 &&
            (fault == NumberFault::not_finite || std::fabs(value) > std::numeric_limits<float>::max()))
            fail(at, fmt::format("\"{}\" is not a finite number", token(at, stop)), "write a finite number");
        if (kind == position && count < 3 && std::fabs(value) > embree_limit)
            fail(at, fmt::format("the coordinate {} is beyond 1e18", token(at, stop)), "scale the mesh down");
        at = skip_blanks(stop, end);
    }
    if (count < fewest[kind] || count > most[kind])
        fail(begin, fmt::format("a {} of {} numbers", kind_names[kind], count),
             fmt::format("write {} to {}", fewest[kind], most[kind]));
    // tinyobjloader's indices are signed 32-bit integers.
    if (++counts_[kind] >= size_t(std::numeric_limits<int>::max()))
        fail(begin, "has more than 2,147,483,646 vertices", "split it into several files");
}

void Scan::face(size_t begin, size_t end) {
    uint32_t count = 0;
    for (size_t at = skip_blanks(skip_word(begin, end), end); at < end; ++count) {
        const size_t stop = skip_word(at, end);
        corner(at, stop);
        at = skip_blanks(stop, end);
    }
    if (count < 3) fail(begin, fmt::format("a face of {} corners", count), "a face needs at least 3");
    if (count > max_polygon)
        fail(begin, fmt::format("a face of {} corners, more than {}", count, max_polygon), "split it");
    corners_ += count;
    ++faces_;
}

// Checks i, i/j, i//k or i/j/k. Slashes with nothing behind them are blanked out: tinyobjloader would read
// the next corner there.
void Scan::corner(size_t begin, size_t end) {
    constexpr Kind order[kind_count] = {position, uv, normal};
    size_t at = begin;
    for (int part = 0; part < kind_count; ++part) {
        const size_t slash = at + std::min(token(at, end).find('/'), end - at);
        if (part == 0 || slash > at) index(order[part], at, slash);
        at = slash + 1;
        if (slash < end) continue;
        while (bytes_[end - 1] == '/') bytes_[--end] = ' ';
        return;
    }
    fail(begin, fmt::format("\"{}\" is not a corner of a face", token(begin, end)), "write vertex/uv/normal");
}

void Scan::index(Kind kind, size_t begin, size_t end) {
    const std::string_view text = token(begin, end);
    if (last_naming_[kind] != faces_ + 1) { // the first index of this kind in this face
        if (naming_faces_[kind]++ == 0) naming_offset_[kind] = begin;
        last_naming_[kind] = faces_ + 1;
    }
    constexpr int64_t most = std::numeric_limits<int32_t>::max(); // tinyobjloader's limit
    int64_t value = 0;
    const WholeFault fault = parse_whole(text, -most, most, value);
    if (fault == WholeFault::not_whole)
        fail(begin, fmt::format("\"{}\" is not a {} index", text, kind_names[kind]), "write a whole number");
    if (value == 0 && fault == WholeFault::none)
        fail(begin, fmt::format("{} index 0", kind_names[kind]), "count from 1, or from -1 backwards");
    if (fault == WholeFault::none && value < 0 && kind != position && counts_[kind] == 0) {
        if (backward_offset_[kind] == 0) backward_offset_[kind] = begin;
        return;
    }
    if (fault == WholeFault::out_of_range || (value < 0 && -value > int64_t(counts_[kind])))
        fail_index(kind, begin, end);
    if (value > int64_t(counts_[kind]) && value > forward_[kind]) {
        forward_[kind] = value;
        forward_offset_[kind] = begin;
    }
}

void Scan::fail_index(Kind kind, size_t begin, size_t end) const {
    fail(begin,
         fmt::format("{} index {} is out of range, {} are defined so far", kind_names[kind],
                     token(begin, end), counts_[kind]),
         "check that the file is complete");
}

void Scan::check_forward_indices() const {
    for (int kind = 0; kind < kind_count; ++kind) {
        if (has_dangling(Kind(kind))) continue;
        if (const size_t at = backward_offset_[kind]; at > 0)
            fail(at, fmt::format("a {} index counts back beyond the first", kind_names[kind]),
                 "check that the file is complete");
        if (forward_[kind] > int64_t(counts_[kind]))
            fail(forward_offset_[kind],
                 fmt::format("{} index {} is out of range, the file defines {}", kind_names[kind],
                             forward_[kind], counts_[kind]),
                 "check that the file is complete");
    }
}

// ---- tinyobjloader

struct Corner {
    uint32_t position, uv, normal; // `none` if the file gives none
};

struct ObjData {
    std::vector<Vec3f> positions, normals;
    std::vector<Vec2f> uvs;
    std::vector<Corner> corners;
    std::vector<uint32_t> face_sizes;
};

struct MemoryStream : std::streambuf {
    explicit MemoryStream(std::string& bytes) {
        setg(bytes.data(), bytes.data(), bytes.data() + bytes.size());
    }
};

// Converts an index of the file (0: absent) to an offset.
uint32_t resolve(int index, size_t defined) {
    if (index == 0) return none;
    return index > 0 ? uint32_t(index) - 1 : uint32_t(int64_t(defined) + index);
}

void take_face(void* user, tinyobj::index_t* indices, int count) {
    ObjData& data = *static_cast<ObjData*>(user);
    for (int i = 0; i < count; ++i)
        data.corners.push_back({resolve(indices[i].vertex_index, data.positions.size()),
                                resolve(indices[i].texcoord_index, data.uvs.size()),
                                resolve(indices[i].normal_index, data.normals.size())});
    data.face_sizes.push_back(uint32_t(count));
}

ObjData parse(const std::string& path, std::string& bytes, const Scan& scan) {
    ObjData data;
    data.positions.reserve(scan.count(position) + 2); // plus spare bytes
    data.normals.reserve(scan.count(normal));
    data.uvs.reserve(scan.count(uv));
    data.corners.reserve(scan.corners());
    data.face_sizes.reserve(scan.faces());
    using Real = tinyobj::real_t;
    tinyobj::callback_t callbacks;
    callbacks.vertex_cb = [](void* user, Real x, Real y, Real z, Real) {
        static_cast<ObjData*>(user)->positions.emplace_back(x, y, z);
    };
    callbacks.normal_cb = [](void* user, Real x, Real y, Real z) {
        static_cast<ObjData*>(user)->normals.emplace_back(x, y, z);
    };
    callbacks.texcoord_cb = [](void* user, Real u, Real v, Real) {
        static_cast<ObjData*>(user)->uvs.emplace_back(u, v);
    };
    callbacks.index_cb = take_face;
    MemoryStream memory(bytes);
    std::istream stream(&memory);
    std::string warnings, errors;
    const bool parsed = tinyobj::LoadObjWithCallback(stream, callbacks, &data, nullptr, &warnings, &errors);
    for (Corner& corner : data.corners) {
        if (scan.has_dangling(uv)) corner.uv = none;
        if (scan.has_dangling(normal)) corner.normal = none;
    }
    // The scan and tinyobjloader must agree.
    bool in_range = true;
    for (const Corner& corner : data.corners)
        in_range &= corner.position < data.positions.size() &&
                    (corner.uv == none || corner.uv < data.uvs.size()) &&
                    (corner.normal == none || corner.normal < data.normals.size());
    if (!parsed || !in_range || data.positions.size() != scan.count(position) ||
        data.normals.size() != scan.count(normal) || data.uvs.size() != scan.count(uv) ||
        data.corners.size() != scan.corners() || data.face_sizes.size() != scan.faces())
        throw InputError(Place{path}, "cannot be read as an OBJ file",
                         "save it again with one statement a line");
    return data;
}

// ---- Conversion to a mesh

// Makes a vertex for each different (position, uv, normal). Vertices of one position form a linked list.
class Splitter {
  public:
    Splitter(ObjData& data, Mesh& mesh) : data_(data), mesh_(mesh), has_uvs_(false), has_normals_(false) {
        for (const Corner& corner : data.corners) {
            has_uvs_ |= corner.uv != none;
            has_normals_ |= corner.normal != none;
        }
        mesh.positions = std::move(data.positions);
        if (has_uvs_) mesh.uvs.assign(mesh.positions.size(), Vec2f::Zero());
        if (has_normals_) mesh.normals.assign(mesh.positions.size(), Vec3f::Zero());
        variants_.assign(mesh.positions.size(), {none, none, none, false});
    }

    uint32_t vertex(const Corner& corner) {
        for (uint32_t v = corner.position;; v = variants_[v].next) {
            if (!variants_[v].used) return use(v, corner);
            if (variants_[v].uv == corner.uv && variants_[v].normal == corner.normal) return v;
            if (variants_[v].next == none) {
                variants_[v].next = uint32_t(variants_.size());
                variants_.push_back({none, none, none, false});
                mesh_.positions.push_back(Vec3f(mesh_.positions[corner.position]));
                if (has_uvs_) mesh_.uvs.push_back(Vec2f::Zero());
                if (has_normals_) mesh_.normals.push_back(Vec3f::Zero());
            }
        }
    }

  private:
    struct Variant {
        uint32_t uv, normal, next;
        bool used;
    };

    uint32_t use(uint32_t v, const Corner& corner) {
        variants_[v] = {corner.uv, corner.normal, none, true};
        if (corner.uv != none) mesh_.uvs[v] = data_.uvs[corner.uv];
        if (corner.normal != none) mesh_.normals[v] = data_.normals[corner.normal];
        return v;
    }

    ObjData& data_;
    Mesh& mesh_;
    bool has_uvs_, has_normals_;
    std::vector<Variant> variants_;
};

} // namespace

Mesh read_obj(const std::string& path, std::string& bytes, std::vector<Problem>* warnings) {
    Scan scan(path, bytes);
    scan.run();
    if (std::optional<Problem> warning = scan.dangling_warning(); warnings && warning)
        warnings->push_back(*std::move(warning));
    if (scan.corners() > max_count)
        throw InputError(Place{path}, "has more than 4,294,967,294 corners", "split it into several files");
    ObjData data = parse(path, bytes, scan);
    bytes = std::string();
    Mesh mesh;
    mesh.triangles.reserve(data.corners.size() - 2 * data.face_sizes.size());
    Splitter splitter(data, mesh);
    std::vector<uint32_t> polygon;
    const Corner* next = data.corners.data();
    for (uint32_t size : data.face_sizes) {
        polygon.clear();
        for (uint32_t i = 0; i < size; ++i) polygon.push_back(splitter.vertex(*next++));
        append_polygon(mesh.positions, polygon, mesh.triangles);
    }
    return mesh;
}

} // namespace marram
