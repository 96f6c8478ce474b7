// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/strand_file.h"

#include "core/geometry/mesh_reader.h"
#include "core/math/hash.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace marram {

namespace {

// Removes the entries that are not `kept`; `components` values per entry.
template <typename Value>
void keep(std::vector<Value>& values, size_t components, const std::vector<char>& kept) {
    size_t to = 0;
    for (size_t i = 0; i < kept.size(); ++i) {
        if (!kept[i]) continue;
        for (size_t k = 0; k < components; ++k) values[to++] = values[i * components + k];
    }
    values.resize(to);
}

} // namespace

float integer_to_float(int64_t value, uint64_t& folded) {
    if (value >= -greatest_whole && value <= greatest_whole) return float(value);
    ++folded;
    return float(mix64(uint64_t(value)) >> 40);
}

void remove_short_curves(const std::string& file, StrandFile& strands) {
    std::vector<char> curves(strands.counts.size());
    std::ranges::transform(strands.counts, curves.begin(), [](uint32_t count) { return count > 1; });
    const auto left_out = std::ranges::count(curves, char(false));
    if (size_t(left_out) == curves.size())
        throw InputError({file}, "has no strand of two points or more",
                         "check that the strands were exported");
    if (left_out == 0) return;
    std::vector<char> cvs;
    for (size_t c = 0; c < curves.size(); ++c) cvs.insert(cvs.end(), strands.counts[c], curves[c]);
    for (StrandSample& sample : strands.samples) {
        keep(sample.points, 1, cvs);
        if (!sample.widths.empty()) keep(sample.widths, 1, cvs);
    }
    for (AttributeValues& attribute : strands.attributes)
        keep(attribute.values, attribute.components, attribute.rate == MARRAM_PER_CURVE ? curves : cvs);
    keep(strands.counts, 1, curves);
    strands.warnings.push_back(fmt::format("{} of {} strands have fewer than two points: they are left out",
                                           left_out, curves.size()));
}

StrandFile load_strand_file(const std::string& file, double fps) {
    const std::string extension = extension_of(file);
    constexpr const char* kinds = ".hair, .usda, .ply or .obj";
    if (extension == ".hair") return read_hair_strands(file);
    if (extension != ".usda" && extension != ".ply" && extension != ".obj")
        throw InputError({file}, fmt::format("strands of the type \"{}\" are not known", extension),
                         fmt::format("save them as {}", kinds));
    const std::string bytes = read_bytes(file, kinds);
    return extension == ".usda"  ? read_usda_strands(file, bytes, fps)
           : extension == ".ply" ? read_ply_strands(file, bytes)
                                 : read_obj_strands(file, bytes);
}

} // namespace marram
