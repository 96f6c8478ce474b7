// SPDX-License-Identifier: Apache-2.0
// The live view: a page in the browser that plays a scene's strands in their wind, changes its values while
// they blow, and shows pictures of the path tracer.
//
//   pages --- messages --- server (server_library.h, a thread) --- Inbox --- LiveView::run (a thread): OpenScene -> World
//         -> strand_packing, mesh_packing or the film -> server
//
// All work on the scene is done in run(), one piece after another: changes first, then frames, then a
// picture, which stops for both within a tile's time, then pictures for files, which stop for all others. No
// file is written but by "save" and by an order of pictures.
#pragma once

#include "core/view/frame_series.h"
#include "core/view/inbox.h"
#include "core/view/live_picture.h"
#include "core/view/mesh_packing.h"
#include "core/view/open_scene.h"
#include "core/view/strand_packing.h"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

namespace marram {

struct ViewSettings {
    std::string scene;
    Overrides overrides; // state_folder "": states of simulations stay in memory
    uint16_t port = 0;   // 0: any that is free
    int threads = 1;
    // Bytes that the process may take, asked before each build; 0: as many as there are.
    std::function<uint64_t()> memory = [] { return uint64_t(0); };
};

class LiveView {
  public:
    // Starts the server. Throws InputError if the port is in use, or the library of the view is missing.
    explicit LiveView(ViewSettings settings);
    ~LiveView();
    LiveView(const LiveView&) = delete;
    LiveView& operator=(const LiveView&) = delete;

    std::string address() const;                                      // for a browser; has the token
    void run();                                                       // serves until end() is called
    void end();                                                       // from any thread
    const ChangedValues& unsaved() const { return scene_.changed(); } // after run()

  private:
    // What a page has been sent.
    struct SentState {
        uint64_t revision = 0, selection = 0; // 0: nothing
        std::optional<StrandSelection> strands;
        std::vector<std::pair<uint64_t, uint64_t>> meshes; // number of its DrawnMesh, digest
    };

    void handle(std::vector<ChangeRequest> changes);
    void change(const ChangeRequest& change);
    void load();
    // False: it failed, which all pages are told; its mistakes are in `problems`.
    bool attempt(std::vector<Problem>& problems, const std::function<void()>& work);
    void tell(ViewClient client, const nlohmann::json& message);
    void tell_all(const nlohmann::json& message);
    nlohmann::json scene_message();
    void welcome(ViewClient client);
    void serve_frame(ViewClient client, const ViewFrameRequest& request);
    void answer(ViewClient client, SentState& sent, const ViewFrameRequest& request, const World& world,
                double chain_ms);
    void serve_rays(ViewClient client, const RaysRequest& request);
    void send_meshes(ViewClient client, SentState& sent, const World& world, WireMessage& frame);
    void work_on_picture(ViewClient client, const PictureRequest& request);
    void send_picture();
    void work_on_series(ViewClient client, const SeriesRequest& request);
    void end_series(const std::vector<Problem>& problems); // if there is one; its page is told
    void free_picture();                                   // its geometry is kept for what is built next
    bool work();
    void show_progress(const std::stop_token& end);
    void evaluate_first_frame();

    ViewSettings settings_;
    Inbox inbox_; // before the server, which calls it
    std::string token_;
    std::unique_ptr<ViewServer> server_;
    OpenScene scene_;
    std::map<ViewClient, SentState> sent_;
    KeptGeometry kept_;
    std::vector<DrawnMesh> drawn_; // of the last frame's meshes
    std::optional<LivePicture> picture_;
    std::optional<FrameSeries> series_;
    std::vector<Problem> change_problems_,
        frame_problems_;      // of the last change and of the last frame or picture
    nlohmann::json problems_; // the message about both
    nlohmann::json bounds_;   // of the scene's first frame
    bool bounds_are_due_ = true;
    std::vector<Problem> build_warnings_;
    uint64_t all_strands_ = 0; // of the last frame, shown or not
    uint64_t last_selection_ = 0;
    double next_file_check_ = 0.0; // wall clock
    BuildProgress progress_;
    std::atomic<double> busy_since_{0.0}; // 0: not
    std::atomic<bool> ended_{false};
};

} // namespace marram
