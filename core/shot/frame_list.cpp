// SPDX-License-Identifier: Apache-2.0
#include "core/shot/frame_list.h"

#include "core/math/frame_name.h"
#include "core/math/problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>
#include <unordered_set>

namespace marram {
namespace {

constexpr int64_t max_frames = 1'000'000;
constexpr double units = 1e6; // per frame: frames are counted in integers of 1e-6, so decimals are exact

// Parses a list from left to right. Characters in messages count from 1.
class FrameList {
  public:
    FrameList(const std::string& text, const std::string& option, FrameDialect dialect)
        : text_(text), option_(option), dialect_(dialect) {}

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
    // A frame, or a range with what follows it.
    std::vector<int64_t> piece() {
        const size_t begin = at_;
        const int64_t first = number("frame");
        if (at_ < text_.size() && is_step(text_[at_]))
            refuse(at_, "a step belongs to a range", "give first and last frame before it, such as 1-100x5");
        if (!next_is('-')) return {first};
        Range range{first, number("last frame of the range"), int64_t(units)};
        const bool is_backwards = range.last < range.first;
        const bool may_go_backwards = dialect_ == FrameDialect::opencue ||
                                      dialect_ == FrameDialect::fileseq ||
                                      (dialect_ == FrameDialect::openjd && has_step());
        if (is_backwards && !may_go_backwards)
            refuse(begin, fmt::format("the range {} goes backwards", text_.substr(begin, at_ - begin)),
                   fmt::format("write {}-{}", double(range.last) / units, double(range.first) / units));
        if (is_backwards) range.step = -range.step;
        char kind = 'x';
        if (has_step()) {
            kind = text_[at_++];
            if (kind == ':') check_colon();
            range.step = step(is_backwards);
        }
        const bool is_stepped = kind == 'x' || (kind == ':' && dialect_ == FrameDialect::openjd);
        const int64_t closest = is_stepped ? std::abs(range.step) : int64_t(units);
        if (std::abs(range.last - range.first) / closest >= max_frames) refuse_count(begin);
        if (is_stepped) return stepped(range);
        if (kind == 'y') return left_out(range, begin);
        return dialect_ == FrameDialect::opencue ? interleaved(range) : staggered(range);
    }

    struct Range {
        int64_t first, last, step; // step: below 0 if last is
        bool has(int64_t frame) const { return step > 0 ? frame <= last : frame >= last; }
    };

    static std::vector<int64_t> stepped(const Range& range) {
        std::vector<int64_t> frames;
        for (int64_t frame = range.first; range.has(frame); frame += range.step) frames.push_back(frame);
        return frames;
    }

    static Range with_step(Range range, int64_t step) {
        range.step = step;
        return range;
    }

    static int64_t sign(const Range& range) { return range.step > 0 ? 1 : -1; }

    std::vector<int64_t> left_out(const Range& range, size_t begin) {
        std::vector<int64_t> frames;
        for (const int64_t frame : stepped(with_step(range, sign(range) * int64_t(units))))
            if ((frame - range.first) % range.step != 0) frames.push_back(frame);
        if (frames.empty())
            refuse(begin, fmt::format("the step of {} leaves no frame out", text_.substr(begin, at_ - begin)),
                   "A-ByN has those frames that A-BxN has not: give another step");
        return frames;
    }

    // Adds the frames that are not there yet.
    static void add(const std::vector<int64_t>& more, std::vector<int64_t>& frames,
                    std::unordered_set<int64_t>& there) {
        for (const int64_t frame : more)
            if (there.insert(frame).second) frames.push_back(frame);
    }

    // As OpenCue does it: each pass begins a frame later than the one before, with half of its step.
    static std::vector<int64_t> interleaved(Range range) {
        std::vector<int64_t> frames;
        std::unordered_set<int64_t> there;
        const int64_t one = sign(range) * int64_t(units);
        for (int64_t step = range.step / one; step > 0; step /= 2, range.first += one)
            add(stepped(with_step(range, step * one)), frames, there);
        return frames;
    }

    static std::vector<int64_t> staggered(const Range& range) {
        std::vector<int64_t> frames;
        std::unordered_set<int64_t> there;
        const int64_t one = sign(range) * int64_t(units);
        const int64_t longest =
            (range.last - range.first) / one + 1; // longer steps have the first frame alone
        for (int64_t step = std::min(range.step / one, longest); step > 0; --step)
            add(stepped(with_step(range, step * one)), frames, there);
        return frames;
    }

    static bool is_step(char c) { return c == 'x' || c == 'y' || c == ':'; }
    bool has_step() const { return at_ < text_.size() && is_step(text_[at_]); }

    // After a ':'.
    void check_colon() {
        if (dialect_ == FrameDialect::marram)
            refuse(at_ - 1,
                   "':' is read in several ways: in OpenJD it is a step, in OpenCue an interleaved order, in "
                   "fileseq a staggered one",
                   "write a step as 1-10x2, or choose with --frames-dialect");
    }

    // In units.
    int64_t step(bool is_backwards) {
        const size_t at = at_;
        const int64_t value = number("step");
        if (is_backwards && value >= 0)
            refuse(at, "the step of a range that goes backwards is not below 0", "write it with a minus");
        if (!is_backwards && value <= 0)
            refuse(at, "the step is not above 0", "give how many frames to go on, such as 1-100x5");
        const char kind = text_[at - 1];
        const bool is_order = kind == ':' && dialect_ != FrameDialect::openjd;
        if ((is_order || kind == 'y') && value % int64_t(units) != 0)
            refuse(at, fmt::format("after '{}' a whole number is needed", kind), "give one, such as 1-100y5");
        return value;
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
    FrameDialect dialect_;
    size_t at_ = 0;
};

} // namespace

std::vector<double> parse_frames(const std::string& list, const std::string& option, FrameDialect dialect) {
    return FrameList(list, option, dialect).frames();
}

std::vector<double> frames_to_make(const FrameRequest& request, const Vec2d& scene_range,
                                   const std::string& output) {
    const bool has_place = has_frame_mark(output);
    if (request.frame) return {*request.frame};
    if (request.list) {
        std::vector<double> frames = parse_frames(*request.list, "--frames", request.dialect);
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

std::string skip_frames_outside(std::vector<double>& frames, const FrameRequest& request,
                                const Vec2d& scene_range) {
    if (!request.skip_outside) return "";
    std::vector<double> outside;
    std::erase_if(frames, [&](double frame) {
        if (frame >= scene_range.x() && frame <= scene_range.y()) return false;
        outside.push_back(frame);
        return true;
    });
    if (outside.empty()) return "";
    const auto [low, high] = std::ranges::minmax(outside);
    const std::string which = outside.size() == 1
                                  ? fmt::format("frame {} is", low)
                                  : fmt::format("{} frames, {} to {}, are", outside.size(), low, high);
    return fmt::format("--skip-outside: {} skipped: the scene has frames {} to {}", which, scene_range.x(),
                       scene_range.y());
}

} // namespace marram
