// SPDX-License-Identifier: Apache-2.0
// What pages ask for, until the view has time for it. Queues are bounded: of a page's frames the newest two
// wait, of its pictures the newest, and of changes of one value the newest.
#pragma once

#include "core/math/vec.h"
#include "core/view/server_library.h"

#include <array>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace marram {

// A grid of points on a plane: columns along u, rows along v, which are half sides; m.
struct AirPlane {
    Vec3d center, u, v;
    uint32_t columns, rows;
};

// Strands, meshes and what is shown with them at a frame.
struct ViewFrameRequest {
    uint64_t seq = 0;
    double frame = 1.0;
    uint32_t budget = 20000;       // strands
    bool floats = false;           // else 16 bits
    std::string values{};          // an attribute that colours strands and meshes; "": none
    bool gusts = true;             // where the random ones are is told, too
    std::optional<AirPlane> air{}; // a plane on which the wind is wanted
};

// The rays that find the shelter of a strand.
struct RaysRequest {
    uint64_t seq = 0, selection = 0; // selection: of the strands that the page has
    double frame = 1.0;
    uint32_t part = 0, vertex = 0; // any vertex of the strand, as in "strands"
};

struct PictureRequest {
    uint64_t seq = 0;
    double frame = 1.0;
    Vec3d position = Vec3d::Zero(), target = -Vec3d::UnitZ(), up = Vec3d::UnitY();
    double fov = 40.0; // degrees, vertical
    uint32_t width = 480, height = 270;
    std::optional<std::array<uint32_t, 4>>
        crop{}; // traced alone: x, y from the top left, width, height; pixels
    std::string layer = "beauty";
    double exposure = 0.0; // stops
    uint32_t samples = 64;
    uint32_t budget = 0; // of a draft: about so many strands, wider in turn; 0: all
};

// A camera that stands still.
struct SeriesCamera {
    Vec3d position, target, up;
    double fov; // degrees, vertical, of the film
};

// Frames to be rendered into files.
struct SeriesRequest {
    uint64_t seq = 0;
    std::string folder, frames;           // frames: as --frames
    std::string format = "exr";           // or png
    bool replace = false;                 // pictures that exist
    std::optional<SeriesCamera> camera{}; // none: the scene's
};

// What a page wants changed, for all pages.
struct ChangeRequest {
    enum class Kind { set, undo, redo, reset, save, reload } kind = Kind::set;
    std::string key;
    std::optional<std::string> value{}; // of set; none: the file's value
    uint64_t gesture = 0;               // of set: those of one drag have the same number; 0: none
};

class Inbox {
  public:
    // Called from the server's thread.
    void join(ViewClient client);
    void leave(ViewClient client);
    // Frame requests that are given up are added to `skipped`. False: the client is to be disconnected.
    bool receive(ViewClient client, std::string_view message, std::vector<uint64_t>& skipped);

    // Called by the view. What is taken is no longer there.
    void wait(double seconds); // until there is something, or the time is over
    std::vector<ViewClient> take_new_clients();
    std::vector<ViewClient> take_left_clients();
    std::vector<ChangeRequest> take_changes();
    std::optional<std::pair<ViewClient, ViewFrameRequest>> take_frame(); // of the clients in turn
    std::optional<std::pair<ViewClient, RaysRequest>> take_rays();       // the newest of a client
    // The picture to work on, of the first client that wants one. Stays until it is replaced or ended; a
    // client's next frame ends it, too.
    std::optional<std::pair<ViewClient, PictureRequest>> picture();
    void end_picture(ViewClient client, uint64_t seq);
    // The frames to render into files, of the first client that wants any. They stay until they are ended.
    std::optional<std::pair<ViewClient, SeriesRequest>> series();
    void end_series(ViewClient client, uint64_t seq);
    void end_pictures(); // all: their scene has changed

    // begin_*: clears stop_work() and notes what is worked on. stop_work() is set when something arrives that
    // the present work should stop for. A change stops frames and pictures, but no other change; another
    // frame or picture stops a picture; a frame of fewer strands one of more, of the same client.
    void begin_change();
    void begin_frame(ViewClient client, uint32_t budget);
    void begin_picture(); // or series
    const std::atomic<bool>& stop_work() const { return stop_work_; }
    std::vector<ViewClient> clients(); // that are connected
    void end_all();                    // stops the present work, and wait() returns at once from now on

  private:
    struct Client {
        bool is_new = true;
        std::deque<ViewFrameRequest> frames;
        std::optional<PictureRequest> picture;
        std::optional<SeriesRequest> series;
        std::optional<RaysRequest> rays;
    };
    void arrived(bool is_change);
    enum class Work { change, frame, picture };
    void begin(Work work, ViewClient client, uint32_t budget);

    std::mutex mutex_;
    std::condition_variable something_;
    std::map<ViewClient, Client> clients_;
    std::vector<ViewClient> left_;
    std::deque<ChangeRequest> changes_;
    ViewClient last_served_ = 0;
    ViewClient works_for_ = 0; // of a frame
    uint32_t works_on_budget_ = 0;
    Work work_ = Work::change;
    bool fresh_ = false, ended_ = false;
    std::atomic<bool> stop_work_{false};
};

} // namespace marram
