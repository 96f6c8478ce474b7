// SPDX-License-Identifier: Apache-2.0
#include "core/shot/frame_list.h"

#include "core/math/frame_name.h"
#include "core/math/problem.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <unordered_set>

namespace marram {
namespace {

constexpr int64_t max_frames = 1'000'000;
constexpr double units = 1e6; // per frame: frames are counted in integers of 1e-6, so decimals are exact

// Parses a list from left to right. Characters in messages count from 1.
class FrameList {
  public:
    FrameList(const std::string& text, const std::string& option) : text_(text), option_(option) {}

    std::vector<double> frames() {
        std::vector<double> frames;
        std::unordered_set<int64_t> seen;
        size_t count = 0;
        do {
            const size_t begin = at_;
            for (const int64_t frame : piece()) {
                if (++count > size_t(max_frames)) refuse_count(begin);
                if (seen.insert(frame).second) frames.push_back(double(frame) / units);
            }
        } while (next_is(','));
        if (at_ < text_.size())
            refuse(at_, fmt::format("'{}' is not expected here", text_.substr(at_)),
                   "separate frames and ranges by commas, such as 1-100x5,120");
        return frames;
    }

  private:
    std::vector<int64_t> piece() {
        const size_t begin = at_;
        const int64_t first = number("frame");
        int64_t last = first, step = int64_t(units);
        if (next_is('-')) {
            last = number("last frame of the range");
            if (last < first)
                refuse(begin, fmt::format("the range {} goes backwards", text_.substr(begin, at_ - begin)),
                       fmt::format("write {}-{}", double(last) / units, double(first) / units));
            const size_t at = at_ + 1;
            if (next_is('x')) step = number("step");
            if (step <= 0)
                refuse(at, "the step is not above 0", "give how many frames to go on, such as 1-100x5");
        } else if (at_ < text_.size() && text_[at_] == 'x') {
            refuse(at_, "a step belongs to a range", "give first and last frame before it, such as 1-100x5");
        }
        if ((last - first) / step >= max_frames) refuse_count(begin);
        std::vector<int64_t> frames;
        for (int64_t frame = first; frame <= last; frame += step) frames.push_back(frame);
        return frames;
    }

    // In units.
    int64_t number(const char* what) {
        const char *begin = text_.data() + at_, *end = text_.data() + text_.size();
        double value = 0.0;
        const auto [after, error] = std::from_chars(begin, end, value, std::chars_format::fixed);
        const std::string_view digits(begin, size_t(after - begin));
        if (error == std::errc::invalid_argument || !std::isfinite(value))
            refuse(at_,
                   begin == end ? fmt::format("the {} is missing", what)
                                : fmt::format("'{}' is no {}", begin, what),
                   "give frames and ranges, such as 1-24 or 1-100x5,120");
        if (error != std::errc{} || std::abs(value) > latest_frame)
            refuse(at_, fmt::format("{} is too large", digits),
                   fmt::format("give frames from {} to {}", -latest_frame, latest_frame));
        const size_t point = digits.find('.');
        if (point != std::string_view::npos && digits.size() - point - 1 > 6)
            refuse(at_, fmt::format("{} has more than six decimals", digits), "give fewer");
        at_ += digits.size();
        return std::llround(value * units);
    }

    bool next_is(char c) {
        if (at_ >= text_.size() || text_[at_] != c) return false;
        ++at_;
        return true;
    }

    [[noreturn]] void refuse(size_t at, const std::string& what, const std::string& fix) const {
        throw InputError({option_ + " " + text_},
                         at > 0 ? fmt::format("{} (character {})", what, at + 1) : what, fix);
    }
    [[noreturn]] void refuse_count(size_t at) const {
        refuse(at, fmt::format("these are more than {} frames", max_frames), "render them in several runs");
    }

    const std::string &text_, &option_;
    size_t at_ = 0;
};

} // namespace

std::vector<double> parse_frames(const std::string& list, const std::string& option) {
    return FrameList(list, option).frames();
}

std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output) {
    const bool has_place = has_frame_mark(output);
    if (request.frame) return {*request.frame};
    if (request.list) {
        std::vector<double> frames = parse_frames(*request.list);
        if (frames.size() > 1 && !has_place)
            throw InputError({"--frames " + *request.list},
                             "all frames would go to one file, '" + output + "'",
                             "put a #### where the frame's number belongs");
        return frames;
    }
    if (!has_place) return {scene_range.x()};
    std::vector<double> frames;
    for (long f = std::lround(scene_range.x()); f <= std::lround(scene_range.y()); ++f)
        frames.push_back(double(f));
    return frames;
}

} // namespace marram
