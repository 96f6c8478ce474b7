// SPDX-License-Identifier: Apache-2.0
#include "core/read/ply_file.h"

#include "core/read/mesh_reader.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace marram {

namespace {

static_assert(std::endian::native == std::endian::little);

constexpr size_t ply_scalar_bytes[] = {1, 1, 2, 2, 4, 4, 4, 8};

template <typename Whole>
bool is_in_range_of(double value) {
    return value == std::floor(value) && value >= double(std::numeric_limits<Whole>::min()) &&
           value <= double(std::numeric_limits<Whole>::max());
}

bool parse_ply_scalar(std::string_view word, PlyScalar& type) {
    constexpr std::pair<std::string_view, PlyScalar> names[] = {
        {"char", PlyScalar::int8},       {"int8", PlyScalar::int8},       {"uchar", PlyScalar::uint8},
        {"uint8", PlyScalar::uint8},     {"short", PlyScalar::int16},     {"int16", PlyScalar::int16},
        {"ushort", PlyScalar::uint16},   {"uint16", PlyScalar::uint16},   {"int", PlyScalar::int32},
        {"int32", PlyScalar::int32},     {"uint", PlyScalar::uint32},     {"uint32", PlyScalar::uint32},
        {"float", PlyScalar::float32},   {"float32", PlyScalar::float32}, {"double", PlyScalar::float64},
        {"float64", PlyScalar::float64},
    };
    for (const auto& [name, scalar] : names)
        if (word == name) {
            type = scalar;
            return true;
        }
    return false;
}

template <typename Value>
double ply_value(const char* bytes, bool swapped) {
    std::array<char, sizeof(Value)> buffer;
    for (size_t i = 0; i < buffer.size(); ++i) buffer[i] = bytes[swapped ? buffer.size() - 1 - i : i];
    return double(std::bit_cast<Value>(buffer));
}

} // namespace

bool ply_holds(PlyScalar type, double value) {
    switch (type) {
    case PlyScalar::int8:
        return is_in_range_of<int8_t>(value);
    case PlyScalar::uint8:
        return is_in_range_of<uint8_t>(value);
    case PlyScalar::int16:
        return is_in_range_of<int16_t>(value);
    case PlyScalar::uint16:
        return is_in_range_of<uint16_t>(value);
    case PlyScalar::int32:
        return is_in_range_of<int32_t>(value);
    case PlyScalar::uint32:
        return is_in_range_of<uint32_t>(value);
    case PlyScalar::float32:
    case PlyScalar::float64:
        break;
    }
    return true;
}

const PlyElement* PlyFile::find(std::string_view element) const {
    for (const PlyElement& one : elements_)
        if (one.name == element) return &one;
    return nullptr;
}

void PlyFile::fail_header(const std::string& what, const std::string& fix) const {
    throw InputError(place_of(path_, bytes_, line_), what, fix);
}

void PlyFile::fail(const std::string& what, const std::string& fix) const {
    const std::string entry = element_ ? fmt::format("{} {}: ", element_->name, number_) : std::string();
    if (format_ == PlyFormat::ascii) throw InputError(place_of(path_, bytes_, token_), entry + what, fix);
    throw InputError(Place{path_}, entry + what, fix);
}

// ---- The header

// The words of the next line. The first line of the file determines the line ending: a carriage return alone,
// else a line feed, which may follow a carriage return in some lines only.
std::vector<std::string_view> PlyFile::header_words() {
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

void PlyFile::read_format(const std::vector<std::string_view>& words) {
    has_format_ = true;
    if (words.size() == 3 && words[2] == "1.0") {
        if (words[1] == "ascii") return void(format_ = PlyFormat::ascii);
        if (words[1] == "binary_little_endian") return void(format_ = PlyFormat::little);
        if (words[1] == "binary_big_endian") return void(format_ = PlyFormat::big);
    }
    fail_header("this format is not known", "save it as ascii or binary PLY 1.0");
}

void PlyFile::read_element(const std::vector<std::string_view>& words) {
    PlyElement element;
    if (words.size() != 3) fail_header("an element needs a name and a count", "write \"element vertex 8\"");
    element.name = words[1];
    int64_t count = 0;
    if (parse_whole(words[2], 0, std::numeric_limits<int64_t>::max(), count) != WholeFault::none)
        fail_header(fmt::format("\"{}\" is not a count", words[2]), "write a whole number, 0 or more");
    element.count = uint64_t(count);
    for (const PlyElement& other : elements_)
        if (other.name == element.name)
            fail_header(fmt::format("the element \"{}\" stands twice", element.name), "remove one");
    elements_.push_back(std::move(element));
}

void PlyFile::read_property(const std::vector<std::string_view>& words) {
    if (elements_.empty()) fail_header("a property before any element", "move it behind its element");
    PlyElement& element = elements_.back();
    PlyProperty property;
    property.is_list = words.size() == 5 && words[1] == "list";
    if (!property.is_list && words.size() != 3)
        fail_header("a property needs a type and a name", "write \"property float x\"");
    property.name = words.back();
    if (!parse_ply_scalar(words[words.size() - 2], property.type))
        fail_header(fmt::format("the type \"{}\" is not known", words[words.size() - 2]),
                    "use a PLY type such as float");
    if (property.is_list && !parse_ply_scalar(words[2], property.count_type))
        fail_header(fmt::format("the type \"{}\" is not known", words[2]), "use a PLY type such as uchar");
    if (property.is_list && property.count_type >= PlyScalar::float32)
        fail_header("a list's length is not a whole number", "use a PLY type such as uchar");
    property.slot = slot_of_(element.name, property);
    if (property.slot >= 0 && element.has(property.slot))
        fail_header(fmt::format("the property \"{}\" is given twice", property.name), "remove one");
    element.properties.push_back(std::move(property));
}

// False at the end of the header.
bool PlyFile::read_header_line(const std::vector<std::string_view>& words) {
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

void PlyFile::read_header() {
    if (!bytes_.starts_with("ply") || bytes_.size() < 4 || (bytes_[3] != '\n' && bytes_[3] != '\r'))
        fail_header("does not begin with the line \"ply\"", "check that it is a PLY file");
    newline_ = bytes_[3] == '\n' || bytes_.substr(3).starts_with("\r\n") ? "\n" : "\r";
    at_ = bytes_.find(newline_) + newline_.size();
    while (read_header_line(header_words())) {
    }
    if (!has_format_) fail_header("the header names no format", "add the line \"format ascii 1.0\"");
}

// ---- The body

// Rejects counts that the rest of the file cannot hold, before memory is allocated.
void PlyFile::check_room(const PlyElement& element) const {
    uint64_t bytes = 0;
    for (const PlyProperty& property : element.properties) {
        const PlyScalar first = property.is_list ? property.count_type : property.type;
        bytes += format_ == PlyFormat::ascii ? 2 : ply_scalar_bytes[size_t(first)]; // a digit and a space
    }
    const uint64_t left = bytes_.size() - at_ + 1; // the last line may lack its newline
    if (bytes > 0 && element.count > left / bytes)
        throw InputError(
            Place{path_},
            fmt::format(
                "{} entries of \"{}\" do not fit in the {} bytes that are left, the file is truncated",
                element.count, element.name, left - 1),
            "check that the file is complete");
}

void PlyFile::skip_blank_lines() {
    while (at_ < bytes_.size() && std::strchr(" \t\r\n", bytes_[at_]) && bytes_[at_] != '\0') ++at_;
}

void PlyFile::begin_entry(const PlyElement& element, uint64_t number) {
    element_ = &element;
    number_ = number;
    if (format_ != PlyFormat::ascii) return;
    skip_blank_lines();
    token_ = at_;
    if (at_ == bytes_.size())
        fail(fmt::format("the file is truncated, {} entries were announced", element.count),
             "check that the file is complete");
}

void PlyFile::end_entry() {
    if (format_ != PlyFormat::ascii) return;
    const std::string_view continued = continued_before_;
    continued_before_ = {};
    while (at_ < bytes_.size() && (bytes_[at_] == ' ' || bytes_[at_] == '\t')) ++at_;
    token_ = at_;
    if (at_ == bytes_.size() || bytes_[at_] == '\n' || bytes_[at_] == '\r') return;
    constexpr const char* fix = "check the header against the lines";
    if (continued.empty()) fail("the line holds more values than the header announces", fix);
    // An entry may take several lines, the last to its end. Else a value is missing where it went on to the
    // next line.
    token_ = continued_at_;
    fail(fmt::format("the line ends before \"{}\"", continued), fix);
}

double PlyFile::read_ascii(const PlyProperty& property) {
    while (at_ < bytes_.size() && (bytes_[at_] == ' ' || bytes_[at_] == '\t')) ++at_;
    if (at_ < bytes_.size() && (bytes_[at_] == '\n' || bytes_[at_] == '\r')) {
        if (continued_before_.empty()) {
            continued_at_ = at_;
            continued_before_ = property.name;
        }
        skip_blank_lines();
    }
    token_ = at_;
    while (at_ < bytes_.size() && bytes_[at_] != ' ' && bytes_[at_] != '\t' && bytes_[at_] != '\n' &&
           bytes_[at_] != '\r')
        ++at_;
    const std::string_view text = bytes_.substr(token_, at_ - token_);
    if (text.empty()) fail("the file is truncated", "check that the file is complete");
    double value = 0.0;
    const NumberFault fault = parse_number(text, value);
    if (fault == NumberFault::not_a_number)
        fail(fmt::format("\"{}\" is not a number", text.substr(0, 32)), "write a number");
    // No error yet: unused properties may have any value.
    return fault == NumberFault::not_finite ? std::numeric_limits<double>::quiet_NaN() : value;
}

double PlyFile::read_binary(PlyScalar type) {
    if (bytes_.size() - at_ < ply_scalar_bytes[size_t(type)])
        fail("the file is truncated", "check that the file is complete");
    const char* from = bytes_.data() + at_;
    at_ += ply_scalar_bytes[size_t(type)];
    const bool swapped = format_ == PlyFormat::big;
    switch (type) {
    case PlyScalar::int8:
        return ply_value<int8_t>(from, swapped);
    case PlyScalar::uint8:
        return ply_value<uint8_t>(from, swapped);
    case PlyScalar::int16:
        return ply_value<int16_t>(from, swapped);
    case PlyScalar::uint16:
        return ply_value<uint16_t>(from, swapped);
    case PlyScalar::int32:
        return ply_value<int32_t>(from, swapped);
    case PlyScalar::uint32:
        return ply_value<uint32_t>(from, swapped);
    case PlyScalar::float32:
        return ply_value<float>(from, swapped);
    case PlyScalar::float64:
        return ply_value<double>(from, swapped);
    }
    return 0.0;
}

double PlyFile::read_number(const PlyProperty& property, PlyScalar type) {
    return format_ == PlyFormat::ascii ? read_ascii(property) : read_binary(type);
}

uint64_t PlyFile::list_length(const PlyProperty& property) {
    const double length = read_number(property, property.count_type);
    if (!(length >= 0.0 && length == std::floor(length)))
        fail(fmt::format("the length of \"{}\" is {}", property.name, length),
             "write a whole number, 0 or more");
    const uint64_t bytes = format_ == PlyFormat::ascii ? 1 : ply_scalar_bytes[size_t(property.type)];
    if (length > double(bytes_.size() - at_) / double(bytes))
        fail(fmt::format("the list \"{}\" of {} numbers goes beyond the file's end, it is truncated",
                         property.name, length),
             "check that the file is complete");
    return uint64_t(length);
}

void PlyFile::skip_property(const PlyProperty& property) {
    const uint64_t count = property.is_list ? list_length(property) : 1;
    for (uint64_t i = 0; i < count; ++i) read_number(property, property.type);
}

void PlyFile::skip_element(const PlyElement& element) {
    if (element.properties.empty()) return;
    for (uint64_t i = 0; i < element.count; ++i) {
        begin_entry(element, i);
        for (const PlyProperty& property : element.properties) skip_property(property);
        end_entry();
    }
}

// Rejects data beyond the last entry: some of the mesh would be missing.
void PlyFile::check_end() const {
    const size_t rest = bytes_.find_first_not_of(std::string_view(" \t\r\n\0", 5), at_);
    if (rest == std::string_view::npos) return;
    const Place place = format_ == PlyFormat::ascii ? place_of(path_, bytes_, rest) : Place{path_};
    throw InputError(place, "the file goes on behind the last entry announced",
                     "check the counts in the header");
}

} // namespace marram
