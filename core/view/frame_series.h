// SPDX-License-Identifier: Apache-2.0
// Frames that a page has ordered into a folder: the files that `marram render` writes, one after another.
#pragma once

#include "core/shot/frame.h"
#include "core/view/inbox.h"
#include "core/view/wire.h"

#include <atomic>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace marram {

class FrameSeries {
  public:
    // Makes the folder of the order; it is relative to that of the scene, and its parent must exist. Pictures
    // are NAME.####.exr, NAME that of the scene file, #### the frame. settings: of the shot, key=value.
    // Throws InputError: frames that are no list, a folder that cannot be written, pictures that are there
    // and may not be replaced.
    FrameSeries(ViewClient client, SeriesRequest request, const Shot& shot, const std::string& scene,
                std::vector<std::string> settings, const std::atomic<bool>& stop);
    FrameSeries(const FrameSeries&) = delete;
    FrameSeries& operator=(const FrameSeries&) = delete;

    ViewClient client() const { return client_; }
    const SeriesRequest& request() const { return request_; }
    size_t saved() const { return next_; } // pictures
    bool done() const { return next_ == files_.size(); }

    // Renders until the next picture is saved, or `stop` is set: the samples then stay, and the next call
    // goes on to the same bits. `kept` is moved from, and set to the frame's geometry. memory: bytes that the
    // process may take; 0: as many as there are. show(): called between passes, when nothing else changes
    // this. The shot is that of the constructor, unchanged. Throws InputError, and Cancelled if `stop` is set
    // while geometry is built.
    void work(Shot& shot, KeptGeometry& kept, int threads, uint64_t memory,
              const std::function<void()>& show);

    nlohmann::json progress() const; // "series": how far it is
    WireMessage last_picture()
        const; // "series_picture": the last one saved, RGBA of 8 bits, at most about a million pixels
    nlohmann::json end() const; // "series_done": where the pictures are, and the warnings

  private:
    void trace(KeptGeometry& kept, const std::function<void()>& show);

    ViewClient client_;
    SeriesRequest request_;
    FrameOptions options_;
    ParamSet camera_;
    std::string folder_;
    std::vector<FrameFiles> files_;
    size_t next_ = 0; // index of the frame in work
    const std::atomic<bool>& stop_;
    FrameStats stats_;
    std::unique_ptr<Frame> frame_; // in work or, once it is saved, the last one
    bool frame_saved_ = false;     // frame_ is
    Film paused_film_;             // samples of the frame in work, while it was stopped
    std::set<std::string> warnings_;
};

} // namespace marram
