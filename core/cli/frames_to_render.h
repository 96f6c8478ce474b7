// SPDX-License-Identifier: Apache-2.0
// The frames that a run renders, one after the other, alone or with other processes (--claim).
#pragma once

#include "core/shot/farm/claim.h"
#include "core/shot/frame.h"

#include <memory>
#include <optional>
#include <vector>

namespace marram {

struct FrameChoice {
    bool resume = false;         // leave out frames whose picture is there
    std::optional<double> lease; // s: claim frames, and leave out those of others
    bool quiet = false;
};

// With claims every frame is there at the end: those that others render are waited for, and taken over if
// they end without having finished. Prints which frames are left out.
class FramesToRender {
  public:
    FramesToRender(const std::vector<FrameFiles>& frames, FrameChoice choice);

    // The next one; nullptr: there is none. Throws Cancelled if interrupted.
    const FrameFiles* next();

    // Of the frame that next() has returned:
    const std::atomic<bool>& stop() const; // set when its work is to end: an interrupt, or its claim is lost
    bool is_lost() const;                  // another process has it: it is not to be saved
    bool holds() const { return !claim_ || claim_->held(); } // whether it may be saved
    bool may_save();                                         // the same; if not, says so
    void saved() { is_saved_ = true; }                       // it need not be looked at again

  private:
    const FrameFiles* claimed(const FrameFiles& frame);
    void say_left_out(const FrameFiles& frame);
    void wait();

    FrameChoice choice_;
    Claims claims_;
    std::vector<const FrameFiles*> all_;
    std::vector<const FrameFiles*> open_; // not known to be finished
    std::vector<std::string> others_;     // that others hold, since the pass began
    size_t at_ = 0;                       // in open_
    const FrameFiles* current_ = nullptr;
    std::unique_ptr<Claim> claim_; // of the current frame
    bool is_saved_ = false, waits_ = false;
};

// Prints which frames, and parts of them, are there: a JSON object a frame. Parts of one follow each other.
// Throws Cancelled if interrupted.
void print_list(const std::vector<FrameFiles>& frames);

} // namespace marram
