// SPDX-License-Identifier: Apache-2.0
#include "core/cli/frames.h"

#include "core/image/atomic_file.h"
#include "core/math/problem.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace marram {
namespace {

constexpr long most_frames = 1'000'000;

// "A-B" of whole numbers, either of which may be negative: "1-24", "-10--5".
std::optional<std::pair<long, long>> parse_range(const std::string& text) {
    long first = 0, last = 0;
    const char* end = text.data() + text.size();
    const auto a = std::from_chars(text.data(), end, first);
    if (a.ec != std::errc{} || a.ptr == end || *a.ptr != '-') return {};
    const auto b = std::from_chars(a.ptr + 1, end, last);
    if (b.ec != std::errc{} || b.ptr != end) return {};
    return std::pair{first, last};
}

std::vector<double> whole_frames(long first, long last) {
    std::vector<double> frames;
    for (long f = first; f <= last; ++f) frames.push_back(double(f));
    return frames;
}

} // namespace

RunFiles::RunFiles(const std::vector<std::string>& read) {
    for (const std::string& file : read) known_.emplace(destination_of(file), file);
}

void RunFiles::write(const std::string& file) {
    if (file.empty()) return;
    const auto [other, fresh] = known_.emplace(destination_of(file), file);
    if (!fresh)
        throw InputError({file}, "this would overwrite '" + other->second + "'",
                         "give every file a name of its own");
}

std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output) {
    const bool has_place = output.find('#') != std::string::npos;
    if (request.frame) return {*request.frame};
    std::pair<long, long> range{std::lround(scene_range.x()), std::lround(scene_range.y())};
    if (request.range) {
        const auto parsed = parse_range(*request.range);
        if (!parsed || parsed->first > parsed->second || parsed->second - parsed->first >= most_frames)
            throw InputError({"--frames " + *request.range}, "this is no range of frames",
                             "give first and last, such as 1-24");
        range = *parsed;
        if (range.first != range.second && !has_place)
            throw InputError({"--frames " + *request.range},
                             "all frames would go to one file, '" + output + "'",
                             "put a #### where the frame's number belongs");
    } else if (!has_place) {
        return {scene_range.x()};
    }
    return whole_frames(range.first, range.second);
}

} // namespace marram
