// SPDX-License-Identifier: Apache-2.0
// Parses USD layers as text (.usda): the tree of prims with their attributes, as in the file. Readers give
// types and names a meaning: usda_curves.h.
//
// Kept are: metadata of the layer, prims and attributes that is one word, number or text; attributes with
// numbers, integers, texts or arrays of these, and all their time samples. Skipped, with a check of brackets
// only: relationships, connections, variants, dictionaries, lists in metadata. Nothing is composed:
// references, payloads, sublayers, inherits and variants are counted but not followed.
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

// Elements in sequence, the numbers of a tuple or a matrix side by side. monostate: None, no value, or an
// unknown type.
//   doubles   half, float, double, timecode and types made of them: point3f, quatf, matrix4d, ...; halves and
//             floats as floats. NaN: not finite in the file
//   integers  bool, uchar, int, uint, int64, uint64 below 2^63
//   texts     string, token, asset: without quotes, escapes unchanged
using UsdaValue =
    std::variant<std::monostate, std::vector<double>, std::vector<int64_t>, std::vector<std::string_view>>;

struct UsdaMetadata {
    std::string_view key, value;
};

// One statement. An attribute with a value and time samples may have two.
struct UsdaAttribute {
    std::string_view type, name; // "point3f", "points"
    size_t at = 0;               // offset in the file
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

    // The value of an attribute: the one for every time, else its earliest sample; nullptr if there is
    // neither. `of`, if given, is set to the statement.
    const UsdaValue* find(std::string_view name, const UsdaAttribute** of = nullptr) const;
    // The time samples of an attribute that have a value, by ascending time; `of` as above.
    std::vector<std::pair<double, const UsdaValue*>> samples(std::string_view name,
                                                             const UsdaAttribute** of = nullptr) const;
    // The last of these up to a time and the first one after it; nullptr if there is none. Cost: a binary
    // search.
    struct Samples {
        const UsdaAttribute* of = nullptr; // nullptr: there are no samples
        const std::pair<double, UsdaValue>*before = nullptr, *after = nullptr;
    };
    Samples samples_around(std::string_view name, double time) const;
    // Metadata of an attribute, from any of its statements; "" if none has it.
    std::string_view metadata_of(std::string_view name, std::string_view key) const;
};

// A way to bring in other content, "references" or "variantSet": how often the layer uses it, and where
// first.
struct UsdaNotFollowed {
    std::string_view what;
    size_t count = 0, at = 0;
};

struct UsdaLayer {
    std::vector<UsdaMetadata> metadata;
    std::vector<UsdaPrim> prims;
    std::vector<UsdaNotFollowed> not_followed; // in the order of their first use
};

// The result points into `bytes`. Throws InputError with line and column for what is not .usda or does not
// follow the grammar. Memory: for arrays about the size of the file, four times that if every number has one
// digit; some 150 bytes per prim or attribute. No count in the file causes an allocation.
UsdaLayer read_usda(const std::string& path, std::string_view bytes);

// Numbers per element of a type: 3 for "point3f", 16 for "matrix4d"; 0: the type is unknown or text.
size_t usda_type_width(std::string_view type);

// "" if there is no such key.
std::string_view find_metadata(const std::vector<UsdaMetadata>& metadata, std::string_view key);

} // namespace marram
