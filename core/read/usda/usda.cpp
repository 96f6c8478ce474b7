// SPDX-License-Identifier: Apache-2.0
#include "core/read/usda/usda.h"

#include "core/read/mesh_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace marram {

namespace {

constexpr int deepest_prim = 256; // prims are read recursively

enum class UsdaKind { end, word, number, text, path, asset, mark };

struct UsdaToken {
    UsdaKind kind = UsdaKind::end;
    std::string_view text; // without quotes
    size_t at = 0;
    bool is(char mark) const { return kind == UsdaKind::mark && text[0] == mark; }
    bool is_word(std::string_view word) const { return kind == UsdaKind::word && text == word; }
};

// Kind of a type's elements, and how many numbers each has.
enum class UsdaElements { doubles, integers, texts, unknown };
struct UsdaType {
    UsdaElements elements = UsdaElements::unknown;
    size_t width = 1;
    bool is_single = false; // numbers are rounded to floats, as USD stores them
    int64_t least = std::numeric_limits<int64_t>::min(), greatest = std::numeric_limits<int64_t>::max();
};

UsdaType usda_type(std::string_view name) {
    constexpr int64_t no_less = std::numeric_limits<int64_t>::min(),
                      no_more = std::numeric_limits<int64_t>::max();
    struct Whole {
        std::string_view name;
        int64_t least, greatest;
    };
    for (const Whole& one :
         {Whole{"bool", no_less, no_more}, Whole{"uchar", 0, 255},
          Whole{"int", std::numeric_limits<int32_t>::min(), std::numeric_limits<int32_t>::max()},
          Whole{"uint", 0, std::numeric_limits<uint32_t>::max()}, Whole{"int64", no_less, no_more},
          Whole{"uint64", 0, no_more}})
        if (name == one.name) return {UsdaElements::integers, 1, false, one.least, one.greatest};
    for (const std::string_view one : {"string", "token", "asset"})
        if (name == one) return {UsdaElements::texts, 1};
    if (name == "int2" || name == "int3" || name == "int4")
        return {UsdaElements::integers, size_t(name.back() - '0'), false, std::numeric_limits<int32_t>::min(),
                std::numeric_limits<int32_t>::max()};
    if (name == "timecode") return {UsdaElements::doubles, 1};
    for (const std::string_view one : {"quath", "quatf", "quatd"})
        if (name == one) return {UsdaElements::doubles, 4, name.back() != 'd'};
    // A base, a width and, except for plain types, the precision: float3, point3f, matrix4d.
    const size_t digit = name.find_first_of("0123456789");
    const std::string_view base = name.substr(0, digit);
    const bool plain = base == "half" || base == "float" || base == "double";
    if (digit == std::string_view::npos)
        return plain ? UsdaType{UsdaElements::doubles, 1, base != "double"} : UsdaType{};
    const size_t width = size_t(name[digit] - '0');
    const std::string_view rest = name.substr(digit + 1);
    if (width < 2 || width > 4) return {};
    if (plain && rest.empty()) return {UsdaElements::doubles, width, base != "double"};
    if (rest != "h" && rest != "f" && rest != "d") return {};
    for (const std::string_view one : {"point", "vector", "normal", "color", "texCoord"})
        if (base == one) return {UsdaElements::doubles, width, rest != "d"};
    if (base == "matrix" || base == "frame") return {UsdaElements::doubles, width * width};
    return {};
}

bool is_usda_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' ||
           static_cast<unsigned char>(c) >= 0x80u; // of UTF-8
}
bool is_usda_digit(char c) { return c >= '0' && c <= '9'; }

class UsdaReader {
  public:
    UsdaReader(const std::string& path, std::string_view bytes) : path_(path), bytes_(bytes) {}
    UsdaLayer read();

  private:
    // Tokens
    void advance();
    void skip_blanks();
    bool skip_comment();
    void take_quoted();
    void take_between(std::string_view close, bool on_one_line, UsdaKind kind, const char* what);
    UsdaToken take() {
        const UsdaToken taken = next_;
        advance();
        return taken;
    }
    bool take_if(char mark) {
        const bool found = next_.is(mark);
        if (found) advance();
        return found;
    }
    void expect(char mark, const char* where);
    std::string_view expect_word(const char* what);

    // Statements
    UsdaPrim read_prim(int depth);
    void read_statement(UsdaPrim& prim, int depth);
    void read_variants();
    void read_relationship();
    void read_attribute(UsdaPrim& prim);
    void read_samples(UsdaAttribute& attribute, const UsdaType& type, bool is_array);
    std::vector<UsdaMetadata> read_metadata();
    void skip_value();
    void skip_group();
    void count_not_followed(std::string_view what, size_t at);
    bool is_empty_value() const;

    // Values
    UsdaValue read_value(const UsdaType& type, bool is_array);
    template <typename Element>
    UsdaValue read_elements(const UsdaType& type, bool is_array);
    template <typename Element>
    size_t read_element(const UsdaType& type, std::vector<Element>& out);
    void read_one(const UsdaType&, std::vector<double>& out);
    void read_one(const UsdaType& type, std::vector<int64_t>& out);
    void read_one(const UsdaType&, std::vector<std::string_view>& out);
    template <typename Element>
    void reserve_array(std::vector<Element>& out) const;

    [[noreturn]] void fail(size_t at, const std::string& what, const std::string& fix) const {
        throw InputError(place_of(path_, bytes_, at), what, fix);
    }
    [[noreturn]] void fail_next(const std::string& expected) const {
        if (next_.kind == UsdaKind::end)
            fail(next_.at, "the file ends where " + expected + " is expected",
                 "check that the file is complete");
        fail(next_.at, fmt::format("found \"{}\", expected {}", next_.text.substr(0, 32), expected),
             "check the file against USD's text format");
    }

    const std::string& path_;
    std::string_view bytes_;
    size_t at_ = 0; // after the next token
    UsdaToken next_;
    std::vector<UsdaNotFollowed> not_followed_;
};

// ---- Tokens

bool UsdaReader::skip_comment() {
    const std::string_view rest = bytes_.substr(at_);
    if (rest.starts_with("/*")) {
        const size_t end = bytes_.find("*/", at_ + 2);
        if (end == std::string_view::npos) fail(at_, "this comment does not end", "close it with */");
        at_ = end + 2;
        return true;
    }
    if (!rest.starts_with('#') && !rest.starts_with("//")) return false;
    at_ = std::min(bytes_.find_first_of("\r\n", at_), bytes_.size());
    return true;
}

void UsdaReader::skip_blanks() {
    do at_ = std::min(bytes_.find_first_not_of(" \t\r\n", at_), bytes_.size());
    while (at_ < bytes_.size() && skip_comment());
}

// Takes text up to `close`; at_ is after the opening mark.
void UsdaReader::take_between(std::string_view close, bool on_one_line, UsdaKind kind, const char* what) {
    size_t end = at_;
    while (true) {
        end = bytes_.find_first_of(
            on_one_line ? std::string_view("\\\"'@>\n\r") : std::string_view("\\\"'@>"), end);
        if (end == std::string_view::npos || (on_one_line && (bytes_[end] == '\n' || bytes_[end] == '\r')))
            fail(next_.at, fmt::format("this {} does not end", what),
                 "close it; check that the file is complete");
        if (bytes_.substr(end).starts_with(close)) break;
        end += bytes_[end] == '\\' && kind == UsdaKind::text ? 2 : 1;
    }
    next_.kind = kind;
    next_.text = bytes_.substr(at_, end - at_);
    at_ = end + close.size();
}

void UsdaReader::take_quoted() {
    const std::string_view quote = bytes_.substr(at_, 1), three = bytes_.substr(at_, 3);
    const bool is_long = three.size() == 3 && three[1] == quote[0] && three[2] == quote[0];
    at_ += is_long ? 3 : 1;
    take_between(is_long ? three : quote, !is_long, UsdaKind::text, "text");
}

void UsdaReader::advance() {
    skip_blanks();
    next_ = {UsdaKind::end, {}, at_};
    if (at_ == bytes_.size()) return;
    const char c = bytes_[at_];
    const auto take_while = [&](UsdaKind kind, auto&& belongs) {
        const size_t begin = at_++;
        while (at_ < bytes_.size() && belongs(bytes_[at_])) ++at_;
        next_ = {kind, bytes_.substr(begin, at_ - begin), begin};
    };
    if (c == '"' || c == '\'') return take_quoted();
    if (c == '<') {
        ++at_;
        return take_between(">", true, UsdaKind::path, "path");
    }
    if (c == '@') {
        const bool three = bytes_.substr(at_).starts_with("@@@");
        at_ += three ? 3 : 1;
        return take_between(three ? "@@@" : "@", true, UsdaKind::asset, "asset path");
    }
    if (is_usda_letter(c))
        return take_while(UsdaKind::word, [](char d) {
            return is_usda_letter(d) || is_usda_digit(d) || d == ':' || d == '.';
        });
    if (is_usda_digit(c) || c == '-' || c == '+' || c == '.')
        return take_while(UsdaKind::number, [](char d) {
            return is_usda_letter(d) || is_usda_digit(d) || d == '.' || d == '-' || d == '+';
        });
    next_ = {UsdaKind::mark, bytes_.substr(at_++, 1), next_.at};
}

void UsdaReader::expect(char mark, const char* where) {
    if (!take_if(mark)) fail_next(fmt::format("'{}' {}", mark, where));
}

std::string_view UsdaReader::expect_word(const char* what) {
    if (next_.kind != UsdaKind::word) fail_next(what);
    return take().text;
}

// ---- Statements

// Skips from an opening bracket to the one that closes it.
void UsdaReader::skip_group() {
    const size_t begin = next_.at;
    size_t depth = 0;
    do {
        if (next_.kind == UsdaKind::end)
            fail(begin, fmt::format("this {} is not closed", bytes_[begin]),
                 "check that the file is complete");
        if (next_.is('(') || next_.is('[') || next_.is('{')) ++depth;
        if (next_.is(')') || next_.is(']') || next_.is('}')) --depth;
        advance();
    } while (depth > 0);
}

// Skips any value after '='. An asset or a path may be followed by a path and a time offset.
void UsdaReader::skip_value() {
    if (next_.is('(') || next_.is('[') || next_.is('{')) return skip_group();
    if (next_.kind == UsdaKind::end || next_.kind == UsdaKind::mark) fail_next("a value");
    bool refers = false;
    do {
        refers = next_.kind == UsdaKind::asset || next_.kind == UsdaKind::path;
        advance();
    } while (refers && next_.kind == UsdaKind::path);
    if (refers && next_.is('(')) skip_group();
}

void UsdaReader::count_not_followed(std::string_view what, size_t at) {
    const auto known = std::ranges::find(not_followed_, what, &UsdaNotFollowed::what);
    if (known != not_followed_.end())
        ++known->count;
    else
        not_followed_.push_back({what, 1, at});
}

// Whether the next value is None or an empty list.
bool UsdaReader::is_empty_value() const {
    const size_t behind = bytes_.find_first_not_of(" \t\r\n", at_);
    return next_.is_word("None") ||
           (next_.is('[') && behind != std::string_view::npos && bytes_[behind] == ']');
}

bool brings_content(std::string_view key) {
    for (const std::string_view one : {"subLayers", "references", "payload", "inherits", "specializes"})
        if (key == one) return true;
    return false;
}

// Shading networks are connections, and nobody reads them here.
bool is_shading(std::string_view type) {
    return type == "Material" || type == "Shader" || type == "NodeGraph";
}

bool is_list_edit(std::string_view word) {
    for (const std::string_view one : {"prepend", "append", "add", "delete", "reorder"})
        if (word == one) return true;
    return false;
}

std::vector<UsdaMetadata> UsdaReader::read_metadata() {
    std::vector<UsdaMetadata> metadata;
    if (!take_if('(')) return metadata;
    while (!take_if(')')) {
        if (next_.kind == UsdaKind::text || next_.is(';') || next_.is(',')) { // a text by itself is a comment
            advance();
            continue;
        }
        const size_t at = next_.at;
        std::string_view key = expect_word("metadata or ')'");
        const bool is_edit = is_list_edit(key) && next_.kind == UsdaKind::word;
        const bool is_removal = key == "delete" || key == "reorder";
        if (is_edit) key = take().text;
        expect('=', "behind a key of metadata");
        if (brings_content(key) && !(is_edit && is_removal) && !is_empty_value()) count_not_followed(key, at);
        const bool one =
            next_.kind == UsdaKind::word || next_.kind == UsdaKind::number || next_.kind == UsdaKind::text;
        if (one && !is_edit) metadata.push_back({key, next_.text});
        skip_value();
    }
    return metadata;
}

void UsdaReader::read_variants() {
    if (next_.kind != UsdaKind::text) fail_next("the name of a variant set");
    advance();
    expect('=', "behind the name of a variant set");
    if (!next_.is('{')) fail_next("'{'");
    skip_group();
}

void UsdaReader::read_relationship() {
    expect_word("the name of a relationship");
    if (take_if('=')) skip_value();
    read_metadata();
}

void UsdaReader::read_samples(UsdaAttribute& attribute, const UsdaType& type, bool is_array) {
    expect('{', "before time samples");
    while (!take_if('}')) {
        double time = 0.0;
        if (next_.kind != UsdaKind::number || parse_number(next_.text, time) != NumberFault::none)
            fail_next("the time of a sample, or '}',");
        if (!attribute.samples.empty() && !(time > attribute.samples.back().first))
            fail(next_.at, fmt::format("the time {} of a sample does not come after the one before", time),
                 "sort the samples by time, each time once");
        advance();
        expect(':', "behind the time of a sample");
        attribute.samples.emplace_back(time, read_value(type, is_array));
        if (!next_.is('}')) expect(',', "between time samples");
    }
}

void UsdaReader::read_attribute(UsdaPrim& prim) {
    UsdaAttribute attribute;
    attribute.at = next_.at;
    attribute.type = expect_word("an attribute, a prim or '}'");
    const bool is_array = take_if('[');
    if (is_array) expect(']', "behind the type of an array");
    std::string_view name = expect_word("the name of an attribute");
    const size_t dot = std::min(name.rfind('.'), name.size());
    const std::string_view field = name.substr(dot); // ".timeSamples", ".connect"
    attribute.name = name.substr(0, dot);
    const UsdaType type = usda_type(attribute.type);
    if (field == ".timeSamples") {
        expect('=', "behind timeSamples");
        read_samples(attribute, type, is_array);
    } else if (take_if('=')) {
        if (field == ".connect" && !is_shading(prim.type) && !is_empty_value())
            count_not_followed("connect", attribute.at);
        if (field.empty() || field == ".default")
            attribute.value = read_value(type, is_array);
        else
            skip_value();
    }
    attribute.metadata = read_metadata();
    prim.attributes.push_back(std::move(attribute));
}

bool is_specifier(const UsdaToken& token) {
    return token.is_word("def") || token.is_word("over") || token.is_word("class");
}

void UsdaReader::read_statement(UsdaPrim& prim, int depth) {
    if (take_if(';')) return;
    if (is_specifier(next_)) return void(prim.children.push_back(read_prim(depth + 1)));
    if (next_.is_word("variantSet")) {
        count_not_followed("variantSet", next_.at);
        advance();
        return read_variants();
    }
    for (const std::string_view word : {"custom", "varying", "uniform", "config"})
        if (next_.is_word(word)) advance();
    if (next_.kind == UsdaKind::word && is_list_edit(next_.text)) {
        const bool reorders = take().text == "reorder";
        if (reorders && (next_.is_word("nameChildren") || next_.is_word("properties"))) {
            advance();
            expect('=', "behind what is reordered");
            return skip_value();
        }
    }
    for (const std::string_view word : {"custom", "varying", "uniform"})
        if (next_.is_word(word)) advance();
    if (next_.is_word("rel")) {
        advance();
        return read_relationship();
    }
    read_attribute(prim);
}

UsdaPrim UsdaReader::read_prim(int depth) {
    if (depth > deepest_prim)
        fail(next_.at, fmt::format("prims are nested more than {} deep", deepest_prim),
             "flatten the hierarchy");
    UsdaPrim prim;
    prim.at = next_.at;
    prim.specifier = take().text;
    if (next_.kind == UsdaKind::word) prim.type = take().text;
    if (next_.kind != UsdaKind::text) fail_next("the name of a prim");
    prim.name = take().text;
    prim.metadata = read_metadata();
    expect('{', "before what a prim holds");
    while (!next_.is('}')) read_statement(prim, depth);
    advance();
    return prim;
}

UsdaLayer UsdaReader::read() {
    if (bytes_.starts_with("PXR-USDC"))
        fail(0, "is a binary USD file", "save it as text, for example with usdcat -o NAME.usda");
    constexpr std::string_view head = "#usda 1.0";
    if (!bytes_.starts_with(head))
        fail(0, "does not begin with \"#usda 1.0\"", "check that it is USD as text");
    at_ = head.size();
    if (at_ < bytes_.size() && std::string_view(" \t\r\n").find(bytes_[at_]) == std::string_view::npos)
        fail(at_, "is of another version than \"#usda 1.0\"", "save it as that version");
    advance();
    UsdaLayer layer;
    layer.metadata = read_metadata();
    while (next_.kind != UsdaKind::end) {
        if (take_if(';')) continue;
        if (next_.is_word("reorder")) {
            advance();
            expect_word("rootPrims");
            expect('=', "behind what is reordered");
            skip_value();
            continue;
        }
        if (!is_specifier(next_)) fail_next("def, over or class");
        layer.prims.push_back(read_prim(1));
    }
    layer.not_followed = std::move(not_followed_);
    return layer;
}

// ---- Values

void UsdaReader::read_one(const UsdaType&, std::vector<double>& out) {
    double value = 0.0;
    const bool may = next_.kind == UsdaKind::number || next_.kind == UsdaKind::word; // a word: inf, nan
    const NumberFault fault = may ? parse_number(next_.text, value) : NumberFault::not_a_number;
    if (fault == NumberFault::not_a_number) fail_next("a number");
    // No error yet: unused attributes may have any value, such as the extent of an empty prim.
    out.push_back(fault == NumberFault::none ? value : std::numeric_limits<double>::quiet_NaN());
    advance();
}

void UsdaReader::read_one(const UsdaType& type, std::vector<int64_t>& out) {
    if (next_.is_word("true") || next_.is_word("false")) {
        out.push_back(take().text == "true");
        return;
    }
    int64_t value = 0;
    const WholeFault fault = next_.kind == UsdaKind::number
                                 ? parse_whole(next_.text, type.least, type.greatest, value)
                                 : WholeFault::not_whole;
    if (fault == WholeFault::not_whole) fail_next("a whole number");
    if (fault == WholeFault::out_of_range)
        fail(next_.at, fmt::format("{} is beyond the range of its type", next_.text.substr(0, 32)),
             "check the value against its type");
    out.push_back(value);
    advance();
}

void UsdaReader::read_one(const UsdaType&, std::vector<std::string_view>& out) {
    if (next_.kind != UsdaKind::text && next_.kind != UsdaKind::asset) fail_next("a text");
    out.push_back(take().text);
}

// Reads a number, or a tuple of them, which may hold tuples in turn (the rows of a matrix). Returns how many
// numbers.
template <typename Element>
size_t UsdaReader::read_element(const UsdaType& type, std::vector<Element>& out) {
    const size_t before = out.size();
    if (!next_.is('(')) {
        read_one(type, out);
        return 1;
    }
    size_t depth = 0;
    bool separated = true; // a comma has been read, or nothing yet
    do {
        if (take_if('(')) {
            if (!separated || ++depth > 2) fail_next("',' or ')'");
        } else if (take_if(')')) {
            --depth;
            separated = false;
        } else if (take_if(',')) {
            if (separated) fail_next("a number");
            separated = true;
        } else {
            if (!separated) fail_next("',' or ')'");
            read_one(type, out);
            separated = false;
        }
    } while (depth > 0);
    return out.size() - before;
}

// Reserves a number per comma before the closing bracket: no reallocation, no spare memory.
template <typename Element>
void UsdaReader::reserve_array(std::vector<Element>& out) const {
    const std::string_view rest = bytes_.substr(next_.at);
    const size_t end = std::min(rest.find(']'), rest.size());
    const auto commas = std::count(rest.begin(), rest.begin() + std::ptrdiff_t(end), ',');
    const bool is_empty = commas == 0 && next_.is(']');
    if (!is_empty) out.reserve(size_t(commas) + 1);
}

template <typename Element>
UsdaValue UsdaReader::read_elements(const UsdaType& type, bool is_array) {
    std::vector<Element> out;
    const auto read_checked = [&] {
        const size_t at = next_.at;
        if (const size_t count = read_element(type, out); count != type.width)
            fail(at, fmt::format("an element of {} numbers stands where {} are expected", count, type.width),
                 "check the value against its type");
    };
    if (!is_array) {
        read_checked();
        return out;
    }
    expect('[', "before an array");
    if constexpr (!std::is_same_v<Element, std::string_view>) reserve_array(out);
    while (!take_if(']')) {
        read_checked();
        if (!next_.is(']')) expect(',', "between the elements of an array, or ']'");
    }
    return out;
}

UsdaValue UsdaReader::read_value(const UsdaType& type, bool is_array) {
    if (next_.is_word("None")) {
        advance();
        return {};
    }
    switch (type.elements) {
    case UsdaElements::doubles: {
        UsdaValue value = read_elements<double>(type, is_array);
        if (type.is_single)
            for (double& number : std::get<std::vector<double>>(value)) number = double(float(number));
        return value;
    }
    case UsdaElements::integers:
        return read_elements<int64_t>(type, is_array);
    case UsdaElements::texts:
        return read_elements<std::string_view>(type, is_array);
    case UsdaElements::unknown:
        break;
    }
    skip_value();
    return {};
}

} // namespace

size_t usda_type_width(std::string_view type) {
    const UsdaType found = usda_type(type);
    const bool numbers = found.elements == UsdaElements::doubles || found.elements == UsdaElements::integers;
    return numbers ? found.width : 0;
}

UsdaLayer read_usda(const std::string& path, std::string_view bytes) {
    return UsdaReader(path, bytes).read();
}

} // namespace marram
