// SPDX-License-Identifier: Apache-2.0
#include "core/view/handles.h"

#include "core/view/wire.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <set>
#include <string>
#include <vector>

namespace marram {
namespace {

using nlohmann::json;

constexpr size_t max_gusts = 500;    // shown
constexpr size_t max_points = 2'000; // of one value

// An element of a list of the wind: its transform moves it.
json wind_handle(const ParamSet& wind, const ParamValue& transform, const char* list, const char* kind,
                 size_t index) {
    const std::string element = fmt::format("{}[{}]", list, index);
    const ParamValue* const inner = wind.find(element + ".inner");
    std::vector<double> keys = transform.numbers;
    if (keys.empty()) keys = {1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0};
    return {{"key", "wind." + element + ".transform"},
            {"list", std::string("wind.") + list},
            {"index", index},
            {"kind", kind},
            {"shape", wind.text(element + ".shape")},
            {"inner", inner && inner->numbers.size() == 3 ? json(inner->numbers) : json(nullptr)},
            {"keys", keys},
            {"interpolation", transform.text.empty() ? "linear" : transform.text}};
}

} // namespace

json handles_of(const Shot& shot) {
    const SceneDescription& scene = shot.description;
    json handles = json::array();
    for (const auto& [list, kind] : {std::pair("gusts.control", "gust"), std::pair("field", "field")})
        for (size_t i = 0;; ++i) {
            const ParamValue* const transform = scene.wind.find(fmt::format("{}[{}].transform", list, i));
            if (!transform) break;
            handles.push_back(wind_handle(scene.wind, *transform, list, kind, i));
        }
    for (const Item& item : scene.curves) {
        const ParamValue* const points = item.params.find("points");
        if (points && points->numbers.size() <= 3 * max_points)
            handles.push_back({{"key", "curves." + item.name_in_file() + ".points"},
                               {"kind", "points"},
                               {"points", points->numbers},
                               {"closed", item.params.boolean("closed")}});
    }
    return handles;
}

json gusts_message(const Shot& shot) {
    std::vector<Procedural::Gust> gusts;
    std::set<std::array<double, 4>> known; // grooms share the scene's gusts, unless they have their own
    for (const auto& procedural : shot.geometry.procedurals)
        for (const Procedural::Gust& gust : procedural->gusts())
            if (known.insert({gust.center.x(), gust.center.y(), gust.center.z(), gust.radius}).second)
                gusts.push_back(gust);
    const size_t shown = std::min(gusts.size(), max_gusts);
    std::ranges::partial_sort(gusts, gusts.begin() + std::ptrdiff_t(shown), std::greater<>(),
                              &Procedural::Gust::radius);
    json list = json::array();
    for (size_t i = 0; i < shown; ++i)
        list.push_back({{"center", json_of(gusts[i].center)},
                        {"radius", gusts[i].radius},
                        {"strength", gusts[i].strength}});
    return list;
}

} // namespace marram
