// SPDX-License-Identifier: Apache-2.0
// USD layers as text (.usda): the tree of prims with their attributes, as it stands in the file. What types and names mean is its
// readers' business: usda_curves.h.
//
// Kept are: the layer's and each prim's and attribute's metadata of one word, number or text; attributes with numbers, whole numbers,
// texts or arrays of these, and all their time samples. Read over, and checked for nothing but their brackets: relationships, connections,
// variants, dictionaries, lists in metadata. Nothing is composed: references, payloads, sublayers and inherits are not followed.
//
// Grammar: the text format of OpenUSD's Sdf ("Usda File Format Specification").
#pragma once

#include "core/math/problem.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace marram {

// Elements one after the other, the numbers of a tuple or a matrix side by side; nothing: None, no value, or a type not known here.
//   doubles   half, float, double, timecode and what is made of them: point3f, quatf, matrix4d, ...; halves and floats as floats. NaN: not
//             finite in the file
//   integers  bool, uchar, int, uint, int64, uint64 below 2^63
//   texts     string, token, asset: between their quotes, escapes as they stand
using UsdaValue =
    std::variant<std::monostate, std::vector<double>, std::vector<int64_t>, std::vector<std::string_view>>;

struct UsdaMetadata {
    std::string_view key, value;
};

// One statement: of an attribute with a value and time samples there may be two.
struct UsdaAttribute {
    std::string_view type, name; // "point3f", "points"
    size_t at = 0;               // where it stands in the file
    UsdaValue value;
    std::vector<std::pair<double, UsdaValue>> samples; // by ascending time
    std::vector<UsdaMetadata> metadata;
};

struct UsdaPrim {
    std::string_view specifier, type, name; // "def", "Xform", "hair"
    size_t at = 0;
    std::vector<UsdaMetadata> metadata;
    std::vector<UsdaAttribute> attributes;
    std::vector<UsdaPrim> children;

    // The value of an attribute: the one for every time, else its earliest sample; nullptr where there is neither. `of`, where it is
    // given, is set to the statement.
    const UsdaValue* find(std::string_view name, const UsdaAttribute** of = nullptr) const;
    // The time samples of an attribute that hold something, by ascending time; `of` as above.
    std::vector<std::pair<double, const UsdaValue*>> samples(std::string_view name,
                                                             const UsdaAttribute** of = nullptr) const;
    // Of these, the last one up to a time and the first one behind it; nullptr where there is none. Cost: a binary search.
    struct Samples {
        const UsdaAttribute* of = nullptr; // nullptr: there are no samples
        const std::pair<double, UsdaValue>*before = nullptr, *after = nullptr;
    };
    Samples samples_around(std::string_view name, double time) const;
    // Of whichever of an attribute's statements has it; "" where none has.
    std::string_view metadata_of(std::string_view name, std::string_view key) const;
};

struct UsdaLayer {
    std::vector<UsdaMetadata> metadata;
    std::vector<UsdaPrim> prims;
};

// Points into `bytes`. Throws InputError with line and column for what is no .usda, and for all that does not follow the grammar.
// Memory: of arrays about the size of the file, four times that where every number has one digit; some 150 bytes a prim or attribute;
// nothing on a count's word.
UsdaLayer read_usda(const std::string& path, std::string_view bytes);

// How many numbers an element of a type has: 3 of "point3f", 16 of "matrix4d"; 0: the type is not known, or is one of texts.
size_t usda_type_width(std::string_view type);

// "" where there is no such key.
std::string_view find_metadata(const std::vector<UsdaMetadata>& metadata, std::string_view key);

} // namespace marram
