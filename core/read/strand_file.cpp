// SPDX-License-Identifier: Apache-2.0
#include "core/read/strand_file.h"
#include "core/math/file_types.h"

#include "core/math/hash.h"
#include "core/read/mesh_reader.h"
#include "core/read/obj_lines.h"
#include "core/read/polylines.h"

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
    if (value >= -max_whole && value <= max_whole) return float(value);
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

void reverse_strands(StrandFile& strands) {
    const auto turn = [&](auto& values, size_t components) {
        auto begin = values.begin();
        for (const uint32_t count : strands.counts) {
            const auto end = begin + std::ptrdiff_t(count * components);
            std::reverse(begin, end); // of all numbers, then of those of each CV
            for (; begin != end; begin += std::ptrdiff_t(components))
                std::reverse(begin, begin + std::ptrdiff_t(components));
        }
    };
    for (StrandSample& sample : strands.samples) {
        turn(sample.points, 1);
        if (!sample.widths.empty()) turn(sample.widths, 1);
    }
    for (AttributeValues& attribute : strands.attributes)
        if (attribute.rate == MARRAM_PER_CV) turn(attribute.values, attribute.components);
    for (StrandFile& take : strands.takes) reverse_strands(take);
}

StrandFile read_obj_strands(const std::string& file, std::string_view bytes) {
    ObjLines lines = read_obj_lines(file, bytes);
    StrandFile strands;
    strands.counts = std::move(lines.counts);
    StrandSample& sample = strands.samples.emplace_back();
    sample.points.reserve(lines.order.size());
    for (const uint32_t vertex : lines.order) sample.points.push_back(lines.vertices[vertex].cast<float>());
    remove_short_curves(file, strands);
    return strands;
}

StrandFile load_strand_file(const std::string& file, const StrandReading& reading) {
    const std::string extension = extension_of(file);
    const std::string kinds = listed_files(strand_files);
    if (!is_one_of(extension, strand_files))
        throw InputError({file}, fmt::format("strands of the type \"{}\" are not known", extension),
                         "save them as " + kinds);
    check_prims(file, extension, reading.prims);
    if (reading.cvs_per_strand > 0 && extension != ".ply")
        throw InputError({file}, "cvs_per_strand is for a .ply of points, and this is none",
                         "leave cvs_per_strand out");
    const std::string bytes = extension == ".hair" ? "" : read_text(file, kinds);
    StrandFile strands;
    if (extension == ".hair")
        strands = read_hair_strands(file);
    else if (extension == ".usda")
        strands = read_usda_strands(file, bytes, reading);
    else if (extension == ".ply")
        strands = read_ply_strands(file, bytes, reading);
    else if (extension == ".obj")
        strands = read_obj_strands(file, bytes);
    else
        throw std::logic_error("no reader for " + extension);
    if (reading.reverse) reverse_strands(strands);
    return strands;
}

} // namespace marram
