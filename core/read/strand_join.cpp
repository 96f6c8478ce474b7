// SPDX-License-Identifier: Apache-2.0
#include "core/read/strand_join.h"

#include <fmt/format.h>

#include <algorithm>

namespace marram {

namespace {

void per_cv(AttributeValues& attribute, const std::vector<uint32_t>& counts) {
    if (attribute.rate == MARRAM_PER_CV) return;
    std::vector<float> values;
    for (size_t c = 0; c < counts.size(); ++c)
        for (uint32_t i = 0; i < counts[c]; ++i)
            values.insert(values.end(), attribute.values.begin() + std::ptrdiff_t(c * attribute.components),
                          attribute.values.begin() + std::ptrdiff_t((c + 1) * attribute.components));
    attribute.values = std::move(values);
    attribute.rate = MARRAM_PER_CV;
}

} // namespace

std::vector<std::string> join_strands(const Place& place, const std::string& path, StrandFile part,
                                      StrandFile& all) {
    std::vector<std::string> lacking;
    if (all.samples.empty()) {
        all = std::move(part);
        return lacking;
    }
    if (part.basis != all.basis) all.basis = MARRAM_CATMULL_ROM; // as polylines are drawn
    const size_t curves = all.counts.size(), cvs = all.samples.front().points.size(),
                 more_curves = part.counts.size(), more_cvs = part.samples.front().points.size();
    const auto lacks = [&](const std::string& name) {
        lacking.push_back(fmt::format("not all curves have \"{}\": it is 0 for those that lack it", name));
    };
    for (AttributeValues& attribute : part.attributes) {
        const auto same = std::ranges::find(all.attributes, attribute.name, &AttributeValues::name);
        if (same == all.attributes.end()) {
            lacks(attribute.name);
            if (all.attributes.size() == max_strand_attributes)
                throw InputError(
                    place,
                    fmt::format("\"{}\" and the prims before it have more than {} primvars in all", path,
                                max_strand_attributes),
                    "leave out those that nobody uses, or split the file");
            attribute.values.insert(
                attribute.values.begin(),
                (attribute.rate == MARRAM_PER_CURVE ? curves : cvs) * attribute.components, 0.0F);
            all.attributes.push_back(std::move(attribute));
            continue;
        }
        if (same->components != attribute.components)
            throw InputError(place,
                             fmt::format("\"{}\" has {} numbers in \"{}\", {} before", attribute.name,
                                         attribute.components, path, same->components),
                             "rename one of them");
        if (same->rate != attribute.rate) {
            per_cv(*same, all.counts);
            per_cv(attribute, part.counts);
        }
        same->discrete = same->discrete && attribute.discrete;
        same->values.insert(same->values.end(), attribute.values.begin(), attribute.values.end());
    }
    for (AttributeValues& attribute : all.attributes) {
        const bool per_curve = attribute.rate == MARRAM_PER_CURVE;
        const size_t right = (per_curve ? curves + more_curves : cvs + more_cvs) * attribute.components;
        if (attribute.values.size() == right) continue;
        lacks(attribute.name);
        attribute.values.resize(right, 0.0F);
    }
    for (size_t i = 0; i < all.samples.size(); ++i) {
        StrandSample &to = all.samples[i], &from = part.samples[i];
        to.points.insert(to.points.end(), from.points.begin(), from.points.end());
        if (to.widths.empty() && from.widths.empty()) continue;
        if (to.widths.empty() || from.widths.empty()) lacks("widths");
        to.widths.resize(cvs, 0.0F);
        from.widths.resize(more_cvs, 0.0F);
        to.widths.insert(to.widths.end(), from.widths.begin(), from.widths.end());
    }
    all.counts.insert(all.counts.end(), part.counts.begin(), part.counts.end());
    all.deviation = std::max(all.deviation, part.deviation);
    return lacking;
}

void match_attributes(std::vector<StrandFile>& takes) {
    std::vector<AttributeValues> kinds; // without values
    for (const StrandFile& take : takes)
        for (const AttributeValues& one : take.attributes) {
            const auto same = std::ranges::find(kinds, one.name, &AttributeValues::name);
            if (same == kinds.end()) {
                AttributeValues& kind = kinds.emplace_back(one);
                kind.values.clear();
            } else if (same->rate != one.rate) {
                same->rate = MARRAM_PER_CV;
            }
        }
    for (StrandFile& take : takes) {
        std::vector<AttributeValues> all = kinds;
        for (AttributeValues& one : all) {
            const auto own = std::ranges::find(take.attributes, one.name, &AttributeValues::name);
            if (own == take.attributes.end()) {
                const size_t entries =
                    one.rate == MARRAM_PER_CURVE ? take.counts.size() : take.samples.front().points.size();
                one.values.assign(entries * one.components, 0.0F);
                continue;
            }
            if (own->rate != one.rate) per_cv(*own, take.counts);
            one.values = std::move(own->values);
        }
        take.attributes = std::move(all);
    }
}

} // namespace marram
