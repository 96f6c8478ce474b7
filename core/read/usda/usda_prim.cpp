// SPDX-License-Identifier: Apache-2.0
// Looks up attributes, samples and metadata of a prim.
#include "core/read/usda/usda.h"

#include <algorithm>

namespace marram {

const UsdaValue* UsdaPrim::find(std::string_view wanted, const UsdaAttribute** of) const {
    const auto is_there = [](const UsdaValue& value) {
        return !std::holds_alternative<std::monostate>(value);
    };
    const auto found = [&](const UsdaAttribute& attribute, const UsdaValue& value) {
        if (of) *of = &attribute;
        return &value;
    };
    for (const UsdaAttribute& attribute : attributes)
        if (attribute.name == wanted && is_there(attribute.value)) return found(attribute, attribute.value);
    for (const UsdaAttribute& attribute : attributes)
        if (attribute.name == wanted)
            for (const auto& [time, value] : attribute.samples)
                if (is_there(value)) return found(attribute, value);
    return nullptr;
}

std::vector<std::pair<double, const UsdaValue*>> UsdaPrim::samples(std::string_view wanted,
                                                                   const UsdaAttribute** of) const {
    std::vector<std::pair<double, const UsdaValue*>> all;
    for (const UsdaAttribute& attribute : attributes) {
        if (attribute.name != wanted) continue;
        for (const auto& [time, value] : attribute.samples)
            if (!std::holds_alternative<std::monostate>(value)) all.emplace_back(time, &value);
        if (all.empty()) continue;
        if (of) *of = &attribute;
        break;
    }
    return all;
}

UsdaPrim::Samples UsdaPrim::samples_around(std::string_view wanted, double time) const {
    const auto is_there = [](const std::pair<double, UsdaValue>& sample) {
        return !std::holds_alternative<std::monostate>(sample.second);
    };
    for (const UsdaAttribute& attribute : attributes) {
        if (attribute.name != wanted) continue;
        const auto& all = attribute.samples;
        const auto middle =
            std::ranges::upper_bound(all, time, {}, &std::pair<double, UsdaValue>::first) - all.begin();
        Samples found{&attribute};
        for (auto i = middle; i > 0 && !found.before; --i)
            if (is_there(all[size_t(i) - 1])) found.before = &all[size_t(i) - 1];
        for (auto i = size_t(middle); i < all.size() && !found.after; ++i)
            if (is_there(all[i])) found.after = &all[i];
        if (found.before || found.after) return found;
    }
    return {};
}

std::string_view UsdaPrim::metadata_of(std::string_view wanted, std::string_view key) const {
    for (const UsdaAttribute& attribute : attributes)
        if (attribute.name == wanted)
            if (const std::string_view found = find_metadata(attribute.metadata, key); !found.empty())
                return found;
    return {};
}

std::string_view find_metadata(const std::vector<UsdaMetadata>& metadata, std::string_view key) {
    for (const UsdaMetadata& entry : metadata)
        if (entry.key == key) return entry.value;
    return {};
}

} // namespace marram
