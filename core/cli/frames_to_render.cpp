// SPDX-License-Identifier: Apache-2.0
#include "core/cli/frames_to_render.h"

#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/math/frame_name.h"

#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <thread>

namespace marram {
namespace {

constexpr double max_wait = 2.0;        // s between two looks at the frames of others
constexpr double looks_in_a_lease = 10; // or more often, if the lease is short
constexpr size_t max_named = 3;         // frames that the line about waiting names

} // namespace

FramesToRender::FramesToRender(const std::vector<FrameFiles>& frames, FrameChoice choice)
    : choice_(choice), claims_(choice.lease.value_or(default_lease)) {
    for (const FrameFiles& frame : frames) open_.push_back(&frame);
    all_ = open_;
}

const std::atomic<bool>& FramesToRender::stop() const { return claim_ ? claim_->stop() : interrupted(); }

bool FramesToRender::is_lost() const { return claim_ && claim_->lost(); }

bool FramesToRender::may_save() {
    if (holds()) return true;
    print_message("{}: another process has taken its claim over, and renders it: not saved\n",
                  output_of(*current_));
    return false;
}

void FramesToRender::say_left_out(const FrameFiles& frame) {
    if (!choice_.quiet) print_message("{}: is there already\n", output_of(frame));
}

// The frame if this process now holds its claim, and it is still to be rendered.
const FrameFiles* FramesToRender::claimed(const FrameFiles& frame) {
    Claims::Taken taken = claims_.take(output_of(frame), interrupted());
    if (!taken.claim) {
        others_.push_back(fmt::format("{} ({})", output_of(frame), taken.holder));
        return nullptr;
    }
    if (!taken.taken_over.empty() && !choice_.quiet)
        print_message("{}: taken over from {}\n", output_of(frame), taken.taken_over);
    // Again: it may have been finished between the first look and the claim.
    if (is_rendered(frame)) {
        is_saved_ = true;
        return nullptr;
    }
    claim_ = std::move(taken.claim);
    return &frame;
}

void FramesToRender::wait() {
    if (!waits_ && !choice_.quiet) {
        const size_t count = others_.size(), named = std::min(count, max_named);
        others_.resize(named);
        print_message("waiting for {} that other processes render: {}{}\n",
                      count == 1 ? "a frame" : fmt::format("{} frames", count), fmt::join(others_, ", "),
                      named < count ? ", ..." : "");
    }
    waits_ = true;
    const double seconds = std::min(max_wait, *choice_.lease / looks_in_a_lease);
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (std::chrono::steady_clock::now() < end) {
        if (interrupted()) throw Cancelled{};
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
}

const FrameFiles* FramesToRender::next() {
    claim_.reset();
    current_ = nullptr;
    for (;;) {
        // Frames that were lost or are held by others stay open.
        if (is_saved_) open_.erase(open_.begin() + std::ptrdiff_t(--at_));
        is_saved_ = false;
        if (at_ == open_.size()) {
            if (!choice_.lease) return nullptr;
            if (open_.empty()) {
                for (const FrameFiles* frame : all_) claims_.remove_stale(output_of(*frame));
                return nullptr;
            }
            if (others_.size() == open_.size()) wait();
            others_.clear();
            at_ = 0;
        }
        if (interrupted()) throw Cancelled{};
        const FrameFiles& frame = *open_[at_++];
        if (choice_.resume && !waits_ && is_rendered(frame)) {
            say_left_out(frame);
            is_saved_ = true;
            continue;
        }
        current_ = choice_.lease ? claimed(frame) : &frame;
        if (!current_) continue;
        waits_ = false;
        return current_;
    }
}

void print_list(const std::vector<FrameFiles>& frames) {
    for (auto files = frames.begin(); files != frames.end();) {
        const bool there = is_picture_rendered(*files);
        nlohmann::ordered_json frame = {
            {"frame", numbered("#", files->frame)}, {"picture", files->picture}, {"there", there}};
        const double number = files->frame;
        for (; files != frames.end() && files->frame == number; ++files) {
            if (interrupted()) throw Cancelled{};
            if (!files->is_part) continue;
            frame["parts"].push_back(
                {{"samples", fmt::format("{}-{}", files->part.first_sample, files->part.end_sample - 1)},
                 {"state", files->state},
                 {"there", there || is_rendered(*files)}});
        }
        print_result("{}\n", frame.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    }
}

} // namespace marram
