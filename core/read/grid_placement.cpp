// SPDX-License-Identifier: Apache-2.0
#include "core/read/grid_placement.h"

#include "core/math/problem.h"
#include "core/read/mesh_reader.h"

#include <fmt/format.h>

#include <cmath>
#include <map>

namespace marram {

namespace {

constexpr std::string_view placement_head = "marram:";
constexpr double max_metadata = 1e9; // metres

std::map<std::string, std::string> placement_texts(const std::string& path) {
    std::map<std::string, std::string> texts;
    const auto add = [&](const std::string& key, const std::string& value) {
        if (key.starts_with(placement_head)) texts.emplace(key, value);
    };
    for (const auto& [key, value] : read_all_metadata(path)) {
        add(key, value);
        if (key != "ImageDescription") continue;
        for (size_t begin = 0; begin < value.size();) {
            const size_t end = std::min(value.find('\n', begin), value.size());
            const size_t blank = std::min(value.find(' ', begin), end);
            add(value.substr(begin, blank - begin),
                value.substr(std::min(blank + 1, end), end - std::min(blank + 1, end)));
            begin = end + 1;
        }
    }
    return texts;
}

} // namespace

std::vector<Metadata> metadata_of(const GridPlacement& placement, const std::string& mesh) {
    return {{"marram:grid", mesh},
            {"marram:cell", placement.cell},
            {"marram:center_x", placement.center.x()},
            {"marram:center_z", placement.center.y()},
            {"marram:size_x", placement.size.x()},
            {"marram:size_z", placement.size.y()},
            {"marram:range_low", placement.range.x()},
            {"marram:range_high", placement.range.y()}};
}

std::string description_of(std::span<const Metadata> metadata) {
    std::string text;
    for (const auto& [key, value] : metadata) {
        std::string line = std::visit([](const auto& v) { return fmt::format("{}", v); }, value);
        for (char& c : line)
            if (c == '\n' || c == '\r') c = ' ';
        text += fmt::format("{} {}\n", key, line);
    }
    return text;
}

FilePlacement read_placement(const std::string& path) {
    const std::map<std::string, std::string> texts = placement_texts(path);
    const auto pair = [&](const char* first, const char* second, bool positive) -> std::optional<Vec2d> {
        Vec2d values;
        int given = 0;
        for (const char* key : {first, second}) {
            const auto found = texts.find(std::string(placement_head) + key);
            if (found == texts.end()) continue;
            double& value = values[given++];
            if (parse_number(found->second, value) != NumberFault::none ||
                !(std::abs(value) <= max_metadata) || (positive && !(value > 0.0)))
                throw InputError(
                    {path}, fmt::format("its metadata say {} {}", found->first, shortened(found->second, 40)),
                    fmt::format("give a number {} {:g}, or remove it",
                                positive ? "above 0 and up to" : "of a size up to", max_metadata));
        }
        if (given == 1)
            throw InputError(
                {path},
                fmt::format("its metadata have one of {0}{1} and {0}{2}", placement_head, first, second),
                "give both, or remove it");
        return given == 2 ? std::optional(values) : std::nullopt;
    };
    return {pair("center_x", "center_z", false), pair("size_x", "size_z", true),
            pair("range_low", "range_high", false)};
}

} // namespace marram
