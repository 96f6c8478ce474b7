// SPDX-License-Identifier: Apache-2.0
// Stanford PLY: ascii and binary, any scalar types, any elements and properties besides. What is used: of the
// element "vertex" x y z, nx ny nz, and s t | u v | texture_u texture_v; of the element "face" the list
// vertex_indices | vertex_index.
//
// No memory is taken on a header's word: every element must first fit into the bytes that are there.
#include "core/geometry/mesh_reader.h"

#include <fmt/format.h>

#include <bit>
#include <charconv>
#include <cstring>
#include <limits>

namespace marram {

namespace {

static_assert(std::endian::native == std::endian::little);

enum class Format { ascii, little, big };
enum class Scalar { int8, uint8, int16, uint16, int32, uint32, float32, float64 };
constexpr size_t scalar_bytes[] = {1, 1, 2, 2, 4, 4, 4, 8};

// Where a property goes. The first eight are a vertex's numbers.
enum Slot { px, py, pz, nx, ny, nz, tu, tv, vertex_slots, face_corners, ignored };

struct Property {
    std::string name;
    Scalar type = Scalar::float32;
    bool is_list = false;
    Scalar count_type = Scalar::uint8; // of a list
    Slot slot = ignored;
};

struct Element {
    std::string name;
    uint64_t count = 0;
    std::vector<Property> properties;
};

struct PlyHeader {
    Format format = Format::ascii;
    std::vector<Element> elements;
};

bool parse_scalar(std::string_view word, Scalar& type) {
    constexpr std::pair<std::string_view, Scalar> names[] = {
        {"char", Scalar::int8},       {"int8", Scalar::int8},       {"uchar", Scalar::uint8},
        {"uint8", Scalar::uint8},     {"short", Scalar::int16},     {"int16", Scalar::int16},
        {"ushort", Scalar::uint16},   {"uint16", Scalar::uint16},   {"int", Scalar::int32},
        {"int32", Scalar::int32},     {"uint", Scalar::uint32},     {"uint32", Scalar::uint32},
        {"float", Scalar::float32},   {"float32", Scalar::float32}, {"double", Scalar::float64},
        {"float64", Scalar::float64},
    };
    for (const auto& [name, scalar] : names)
        if (word == name) {
            type = scalar;
            return true;
        }
    return false;
}

Slot slot_of(const std::string& element, const Property& property) {
    constexpr std::pair<std::string_view, Slot> names[] = {
        {"x", px}, {"y", py}, {"z", pz}, {"nx", nx}, {"ny", ny},        {"nz", nz},
        {"s", tu}, {"t", tv}, {"u", tu}, {"v", tv},  {"texture_u", tu}, {"texture_v", tv},
    };
    if (element == "face" && property.is_list &&
        (property.name == "vertex_indices" || property.name == "vertex_index"))
        return face_corners;
    if (element == "vertex" && !property.is_list)
        for (const auto& [name, slot] : names)
            if (property.name == name) return slot;
    return ignored;
}

bool has_slot(const Element& element, Slot slot) {
    for (const Property& property : element.properties)
        if (property.slot == slot) return true;
    return false;
}

class PlyReader {
  public:
    PlyReader(const std::string& path, std::string_view bytes) : path_(path), bytes_(bytes) {}
    Mesh read();

  private:
    // The header
    void read_header();
    bool read_header_line(const std::vector<std::string_view>& words);
    void read_format(const std::vector<std::string_view>& words);
    void read_element(const std::vector<std::string_view>& words);
    void read_property(const std::vector<std::string_view>& words);
    void check_header() const;
    std::vector<std::string_view> header_words();
    [[noreturn]] void fail_header(const std::string& what, const std::string& fix) const {
        throw InputError(place_of(path_, bytes_, line_), what, fix);
    }

    // The body
    void read_vertices(const Element& element, Mesh& mesh);
    void read_faces(const Element& element, uint64_t vertex_count);
    void read_corners(const Property& property, uint64_t vertex_count);
    void skip_element(const Element& element);
    void skip_property(const Property& property);
    uint64_t list_length(const Property& property);
    void check_room(const Element& element) const;
    void begin_entry(const Element& element, uint64_t number);
    void end_entry();
    void check_end() const;
    void skip_blank_lines();
    double read_number(const Property& property, Scalar type);
    double read_ascii(const Property& property);
    double read_binary(Scalar type);
    [[noreturn]] void fail(const std::string& what, const std::string& fix) const;

    const std::string& path_;
    std::string_view bytes_;
    size_t at_ = 0;       // the next byte
    size_t token_ = 0;    // start of the last number: where faults are
    size_t line_ = 0;     // start of the header's line
    std::string newline_; // of the header
    PlyHeader header_;
    bool has_format_ = false;
    const Element* element_ = nullptr; // being read
    uint64_t number_ = 0;              // of its entry
    std::vector<uint32_t> corners_, face_sizes_;
};

void PlyReader::fail(const std::string& what, const std::string& fix) const {
    const std::string entry = element_ ? fmt::format("{} {}: ", element_->name, number_) : std::string();
    if (header_.format == Format::ascii) throw InputError(place_of(path_, bytes_, token_), entry + what, fix);
    throw InputError(Place{path_}, entry + what, fix);
}

// ---- The header

// The words of the next line. The file's first line tells how its lines end.
std::vector<std::string_view> PlyReader::header_words() {
    constexpr size_t longest_line = 4096;
    line_ = at_;
    const size_t end = bytes_.substr(0, at_ + longest_line).find(newline_, at_);
    if (end == std::string_view::npos)
        fail_header("the header does not end", "check that the file is complete");
    std::vector<std::string_view> words;
    const std::string_view line = bytes_.substr(at_, end - at_);
    for (size_t begin = 0; begin < line.size();) {
        const size_t stop = std::min(line.find_first_of(" \t\r", begin), line.size());
        if (stop > begin) words.push_back(line.substr(begin, stop - begin));
        begin = stop + 1;
    }
    at_ = end + newline_.size();
    return words;
}

void PlyReader::read_format(const std::vector<std::string_view>& words) {
    has_format_ = true;
    if (words.size() == 3 && words[2] == "1.0") {
        if (words[1] == "ascii") return void(header_.format = Format::ascii);
        if (words[1] == "binary_little_endian") return void(header_.format = Format::little);
        if (words[1] == "binary_big_endian") return void(header_.format = Format::big);
    }
    fail_header("this format is not known", "save it as ascii or binary PLY 1.0");
}

void PlyReader::read_element(const std::vector<std::string_view>& words) {
    Element element;
    if (words.size() != 3) fail_header("an element needs a name and a count", "write \"element vertex 8\"");
    element.name = words[1];
    const char* end = words[2].data() + words[2].size();
    const auto [stop, error] = std::from_chars(words[2].data(), end, element.count);
    if (stop != end || error != std::errc())
        fail_header(fmt::format("\"{}\" is not a count", words[2]), "write a whole number, 0 or more");
    for (const Element& other : header_.elements)
        if (other.name == element.name)
            fail_header(fmt::format("the element \"{}\" stands twice", element.name), "remove one");
    header_.elements.push_back(std::move(element));
}

void PlyReader::read_property(const std::vector<std::string_view>& words) {
    if (header_.elements.empty()) fail_header("a property before any element", "move it behind its element");
    Element& element = header_.elements.back();
    Property property;
    property.is_list = words.size() == 5 && words[1] == "list";
    if (!property.is_list && words.size() != 3)
        fail_header("a property needs a type and a name", "write \"property float x\"");
    property.name = words.back();
    if (!parse_scalar(words[words.size() - 2], property.type))
        fail_header(fmt::format("the type \"{}\" is not known", words[words.size() - 2]),
                    "use a PLY type such as float");
    if (property.is_list && !parse_scalar(words[2], property.count_type))
        fail_header(fmt::format("the type \"{}\" is not known", words[2]), "use a PLY type such as uchar");
    if (property.is_list && property.count_type >= Scalar::float32)
        fail_header("a list's length is not a whole number", "use a PLY type such as uchar");
    property.slot = slot_of(element.name, property);
    if (property.slot != ignored && has_slot(element, property.slot))
        fail_header(fmt::format("the property \"{}\" is given twice", property.name), "remove one");
    element.properties.push_back(std::move(property));
}

// False at the end of the header.
bool PlyReader::read_header_line(const std::vector<std::string_view>& words) {
    if (words.empty() || words[0] == "comment" || words[0] == "obj_info") return true;
    if (words[0] == "end_header") return false;
    if (words[0] == "format")
        read_format(words);
    else if (words[0] == "element")
        read_element(words);
    else if (words[0] == "property")
        read_property(words);
    else
        fail_header(fmt::format("the header says \"{}\"", words[0].substr(0, 32)),
                    "expected format, comment, element, property or end_header");
    return true;
}

void PlyReader::check_header() const {
    if (!has_format_) fail_header("the header names no format", "add the line \"format ascii 1.0\"");
    for (const Element& element : header_.elements) {
        if (element.name == "vertex" &&
            !(has_slot(element, px) && has_slot(element, py) && has_slot(element, pz)))
            fail_header("the vertices have no x, y and z", "save the mesh again");
        if (element.name == "face" && element.count > 0 && !has_slot(element, face_corners))
            fail_header("the faces have no list vertex_indices", "save the mesh again");
        if ((element.name == "vertex" || element.name == "face") && element.count > greatest_count)
            fail_header(fmt::format("{} entries of \"{}\" are too many", element.count, element.name),
                        "split it into several files");
    }
}

void PlyReader::read_header() {
    if (!bytes_.starts_with("ply") || bytes_.size() < 4 || (bytes_[3] != '\n' && bytes_[3] != '\r'))
        fail_header("does not begin with the line \"ply\"", "check that it is a PLY file");
    newline_ = bytes_[3] == '\n' ? "\n" : bytes_.substr(3).starts_with("\r\n") ? "\r\n" : "\r";
    at_ = 3 + newline_.size();
    while (read_header_line(header_words())) {
    }
    check_header();
}

// ---- The body

// Refuses counts that the rest of the file cannot hold, before anything is made room for.
void PlyReader::check_room(const Element& element) const {
    uint64_t bytes = 0;
    for (const Property& property : element.properties) {
        const Scalar first = property.is_list ? property.count_type : property.type;
        bytes += header_.format == Format::ascii ? 2 : scalar_bytes[size_t(first)]; // a digit and a space
    }
    const uint64_t left = bytes_.size() - at_ + 1; // the last line may lack its end
    if (bytes > 0 && element.count > left / bytes)
        throw InputError(
            Place{path_},
            fmt::format(
                "{} entries of \"{}\" do not fit in the {} bytes that are left, the file is truncated",
                element.count, element.name, left - 1),
            "check that the file is complete");
}

void PlyReader::skip_blank_lines() {
    while (at_ < bytes_.size() && std::strchr(" \t\r\n", bytes_[at_]) && bytes_[at_] != '\0') ++at_;
}

void PlyReader::begin_entry(const Element& element, uint64_t number) {
    element_ = &element;
    number_ = number;
    if (header_.format != Format::ascii) return;
    skip_blank_lines();
    token_ = at_;
    if (at_ == bytes_.size())
        fail(fmt::format("the file is truncated, {} entries were announced", element.count),
             "check that the file is complete");
}

void PlyReader::end_entry() {
    if (header_.format != Format::ascii) return;
    while (at_ < bytes_.size() && (bytes_[at_] == ' ' || bytes_[at_] == '\t')) ++at_;
    token_ = at_;
    if (at_ < bytes_.size() && bytes_[at_] != '\n' && bytes_[at_] != '\r')
        fail("the line holds more values than the header announces", "check the header against the lines");
}

double PlyReader::read_ascii(const Property& property) {
    while (at_ < bytes_.size() && (bytes_[at_] == ' ' || bytes_[at_] == '\t')) ++at_;
    token_ = at_;
    while (at_ < bytes_.size() && bytes_[at_] != ' ' && bytes_[at_] != '\t' && bytes_[at_] != '\n' &&
           bytes_[at_] != '\r')
        ++at_;
    const std::string_view text = bytes_.substr(token_, at_ - token_);
    if (text.empty()) {
        const bool over = at_ == bytes_.size();
        fail(over ? "the file is truncated" : fmt::format("the line ends before \"{}\"", property.name),
             over ? "check that the file is complete" : "check the header against the lines");
    }
    double value = 0.0;
    const NumberFault fault = parse_number(text, value);
    if (fault == NumberFault::not_a_number)
        fail(fmt::format("\"{}\" is not a number", text.substr(0, 32)), "write a number");
    // What is not used may be anything.
    return fault == NumberFault::not_finite ? std::numeric_limits<double>::quiet_NaN() : value;
}

template <typename Value>
double value_at(const char* bytes, bool swapped) {
    std::array<char, sizeof(Value)> buffer;
    for (size_t i = 0; i < buffer.size(); ++i) buffer[i] = bytes[swapped ? buffer.size() - 1 - i : i];
    return double(std::bit_cast<Value>(buffer));
}

double PlyReader::read_binary(Scalar type) {
    if (bytes_.size() - at_ < scalar_bytes[size_t(type)])
        fail("the file is truncated", "check that the file is complete");
    const char* from = bytes_.data() + at_;
    at_ += scalar_bytes[size_t(type)];
    const bool swapped = header_.format == Format::big;
    switch (type) {
    case Scalar::int8:
        return value_at<int8_t>(from, swapped);
    case Scalar::uint8:
        return value_at<uint8_t>(from, swapped);
    case Scalar::int16:
        return value_at<int16_t>(from, swapped);
    case Scalar::uint16:
        return value_at<uint16_t>(from, swapped);
    case Scalar::int32:
        return value_at<int32_t>(from, swapped);
    case Scalar::uint32:
        return value_at<uint32_t>(from, swapped);
    case Scalar::float32:
        return value_at<float>(from, swapped);
    case Scalar::float64:
        return value_at<double>(from, swapped);
    }
    return 0.0;
}

double PlyReader::read_number(const Property& property, Scalar type) {
    return header_.format == Format::ascii ? read_ascii(property) : read_binary(type);
}

uint64_t PlyReader::list_length(const Property& property) {
    const double length = read_number(property, property.count_type);
    if (!(length >= 0.0 && length == std::floor(length)))
        fail(fmt::format("the length of \"{}\" is {}", property.name, length),
             "write a whole number, 0 or more");
    const uint64_t bytes = header_.format == Format::ascii ? 1 : scalar_bytes[size_t(property.type)];
    if (length > double(bytes_.size() - at_) / double(bytes))
        fail(fmt::format("the list \"{}\" of {} numbers goes beyond the file's end, it is truncated",
                         property.name, length),
             "check that the file is complete");
    return uint64_t(length);
}

void PlyReader::skip_property(const Property& property) {
    const uint64_t count = property.is_list ? list_length(property) : 1;
    for (uint64_t i = 0; i < count; ++i) read_number(property, property.type);
}

void PlyReader::skip_element(const Element& element) {
    if (element.properties.empty()) return;
    for (uint64_t i = 0; i < element.count; ++i) {
        begin_entry(element, i);
        for (const Property& property : element.properties) skip_property(property);
        end_entry();
    }
}

void PlyReader::read_vertices(const Element& element, Mesh& mesh) {
    const bool has_normals = has_slot(element, nx) && has_slot(element, ny) && has_slot(element, nz);
    const bool has_uvs = has_slot(element, tu) && has_slot(element, tv);
    mesh.positions.reserve(element.count + 2); // and the spare bytes
    if (has_normals) mesh.normals.reserve(element.count + 2);
    if (has_uvs) mesh.uvs.reserve(element.count + 2);
    double values[vertex_slots] = {};
    for (uint64_t i = 0; i < element.count; ++i) {
        begin_entry(element, i);
        for (const Property& property : element.properties) {
            if (property.slot == ignored) {
                skip_property(property);
                continue;
            }
            const double value = values[property.slot] = read_number(property, property.type);
            if (!(std::fabs(value) <= std::numeric_limits<float>::max()))
                fail(fmt::format("\"{}\" is not a finite number", property.name), "write a finite number");
            if (property.slot <= pz && std::fabs(value) > greatest_coordinate)
                fail(fmt::format("the coordinate {} is beyond 1e18", value), "scale the mesh down");
        }
        end_entry();
        mesh.positions.push_back(Vec3d(values[px], values[py], values[pz]).cast<float>());
        if (has_normals) mesh.normals.push_back(Vec3d(values[nx], values[ny], values[nz]).cast<float>());
        if (has_uvs) mesh.uvs.push_back(Vec2d(values[tu], values[tv]).cast<float>());
    }
}

void PlyReader::read_corners(const Property& property, uint64_t vertex_count) {
    const uint64_t size = list_length(property);
    if (size < 3) fail(fmt::format("a face of {} corners", size), "a face needs at least 3");
    if (size > greatest_polygon)
        fail(fmt::format("a face of {} corners, more than {}", size, greatest_polygon), "split it");
    for (uint64_t i = 0; i < size; ++i) {
        const double index = read_number(property, property.type);
        if (!(index >= 0.0 && index < double(vertex_count) && index == std::floor(index)))
            fail(
                fmt::format("vertex index {} is out of range, the file has {} vertices", index, vertex_count),
                "indices count from 0; check that the file is complete");
        corners_.push_back(uint32_t(index));
    }
    face_sizes_.push_back(uint32_t(size));
}

void PlyReader::read_faces(const Element& element, uint64_t vertex_count) {
    constexpr size_t usual_corners = 3;
    corners_.reserve(element.count * usual_corners);
    face_sizes_.reserve(element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
        begin_entry(element, i);
        for (const Property& property : element.properties)
            if (property.slot == face_corners)
                read_corners(property, vertex_count);
            else
                skip_property(property);
        end_entry();
    }
}

// More data than announced: some of the mesh would be missing.
void PlyReader::check_end() const {
    const size_t rest = bytes_.find_first_not_of(std::string_view(" \t\r\n\0", 5), at_);
    if (rest == std::string_view::npos) return;
    const Place place = header_.format == Format::ascii ? place_of(path_, bytes_, rest) : Place{path_};
    throw InputError(place, "the file goes on behind the last entry announced",
                     "check the counts in the header");
}

Mesh PlyReader::read() {
    read_header();
    uint64_t vertex_count = 0;
    for (const Element& element : header_.elements)
        if (element.name == "vertex") vertex_count = element.count;
    Mesh mesh;
    for (const Element& element : header_.elements) {
        check_room(element);
        if (element.name == "vertex")
            read_vertices(element, mesh);
        else if (element.name == "face")
            read_faces(element, vertex_count);
        else
            skip_element(element);
    }
    check_end();
    mesh.triangles.reserve(corners_.size() - 2 * face_sizes_.size() + 2);
    const uint32_t* next = corners_.data();
    for (uint32_t size : face_sizes_) {
        append_polygon(mesh.positions, {next, size}, mesh.triangles);
        next += size;
    }
    return mesh;
}

} // namespace

Mesh read_ply(const std::string& path, std::string& bytes) { return PlyReader(path, bytes).read(); }

} // namespace marram
