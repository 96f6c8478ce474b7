// SPDX-License-Identifier: Apache-2.0
// Stanford PLY: parses the header and the numbers of a file, ascii and binary of either byte order, with any
// scalar types, elements and properties. Readers give them a meaning: mesh_ply.cpp, curves_ply.cpp. All throw
// InputError with line and column (binary: element and number).
//
// An entry of an ascii file begins on a new line and may take several.
//
// Counts in a header are not trusted: before memory is allocated, every element must fit into the rest of the
// file (check_room).
#pragma once

#include "core/math/problem.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace marram {

enum class PlyFormat { ascii, little, big };
enum class PlyScalar { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

inline constexpr int ply_ignored = -1;

struct PlyProperty {
    std::string name;
    PlyScalar type = PlyScalar::float32;
    bool is_list = false;
    PlyScalar count_type = PlyScalar::uint8; // of a list
    int slot = ply_ignored;                  // meaning given by the reader
    bool is_whole() const { return type < PlyScalar::float32; }
};

struct PlyElement {
    std::string name;
    uint64_t count = 0;
    std::vector<PlyProperty> properties;
    bool has(int slot) const {
        for (const PlyProperty& property : properties)
            if (property.slot == slot) return true;
        return false;
    }
};

// Whether a number of an ascii file is one of its type. Always true for the types of floats.
bool ply_holds(PlyScalar type, double value);

class PlyFile {
  public:
    using SlotOf = int (*)(const std::string& element, const PlyProperty& property);
    // Keeps references to both. `slot_of` maps a property to a slot of the reader; each slot may occur once
    // per element.
    PlyFile(const std::string& path, std::string_view bytes, SlotOf slot_of)
        : path_(path), bytes_(bytes), slot_of_(slot_of) {}

    void read_header();
    const std::vector<PlyElement>& elements() const { return elements_; }
    // nullptr if there is none of that name.
    const PlyElement* find(std::string_view element) const;

    // Reads the body, element by element in the header's order, each entry between begin_entry() and
    // end_entry().
    void check_room(const PlyElement& element) const;
    void begin_entry(const PlyElement& element, uint64_t number);
    void end_entry();
    double read_number(const PlyProperty& property, PlyScalar type); // NaN if not finite in the file
    uint64_t list_length(const PlyProperty& property);
    void skip_property(const PlyProperty& property);
    void skip_element(const PlyElement& element);
    void check_end() const;

    // Throws for the header's last line, or for the number read last.
    [[noreturn]] void fail_header(const std::string& what, const std::string& fix) const;
    [[noreturn]] void fail(const std::string& what, const std::string& fix) const;

  private:
    bool read_header_line(const std::vector<std::string_view>& words);
    void read_format(const std::vector<std::string_view>& words);
    void read_element(const std::vector<std::string_view>& words);
    void read_property(const std::vector<std::string_view>& words);
    std::vector<std::string_view> header_words();
    void skip_blank_lines();
    double read_ascii(const PlyProperty& property);
    double read_binary(PlyScalar type);

    const std::string& path_;
    std::string_view bytes_;
    SlotOf slot_of_;
    size_t at_ = 0;       // the next byte
    size_t token_ = 0;    // start of the last number, for errors
    size_t line_ = 0;     // start of the header's line
    std::string newline_; // of the header
    PlyFormat format_ = PlyFormat::ascii;
    bool has_format_ = false;
    std::vector<PlyElement> elements_;
    const PlyElement* element_ = nullptr; // being read
    uint64_t number_ = 0;                 // of its entry
    // Where an ascii entry went on to a second line, and the property before which it did.
    size_t continued_at_ = 0;
    std::string_view continued_before_;
};

} // namespace marram
