// SPDX-License-Identifier: Apache-2.0
// What grown strands (groom) and imported ones (strands) share: a frame of the wind's chain on rest strands.
// Where rest strands come from, and what only one of the two has, the derived classes say in the hooks below.
#pragma once

#include "procedural/abi/border.h"
#include "procedural/strands/mesh_instances.h"
#include "procedural/strands/past.h"
#include "procedural/strands/pilot.h"
#include "procedural/strands/strand_calls.h"
#include "procedural/wind/chain.h"

#include <deque>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace marram {

// Settings that the tolerance chooses.
struct Automatic {
    bool cvs = false, rays = false, step = false;
};

// Settings that may differ from frame to frame and change the past.
struct PastSettings {
    double step = 0.0, fps = 0.0, bind_frame = 0.0;
    int cvs = 0, octaves_left_out = 0;
    int blade_pieces = 0;
    double blade_tolerance = 0.0;
    bool operator==(const PastSettings&) const = default;
};

// The step of jiggle that was chosen, and what for.
struct StepChoice {
    struct For {
        double moment, tolerance, length, fps, bind_frame;
        int cvs, octaves_left_out;
        bool skin_moves;
        bool operator==(const For&) const = default;
    } made_for;
    Choice choice;
};

// The wind at a point of the air, as MarramProcedural.air tells it.
struct AirSample {
    Vec3d velocity, noise;
    double share;
};

struct StrandInstance : Instance {
    Wind wind; // includes the settings chosen for the frame
    Automatic automatic;
    uint64_t values_digest = 0; // of all values
    std::optional<ChosenFor> chosen_for;
    std::vector<std::string> inexact; // settings, with their values, that do not reach the tolerance

    MarramFrame frame{};
    std::vector<MarramMesh> meshes;           // the frame's
    const MarramMesh* mesh = nullptr;         // that strands grow on or are bound to; nullptr: not bound
    std::vector<MeshInstance> mesh_instances; // the mesh and its instances; one if strands are not bound
    uint32_t time_count = 1;                  // motion samples that the chain computes
    ChainFrame chain;
    std::shared_ptr<GroundAir> ground; // of wind.over
    ColliderTrees trees;
    PastSkin past; // its window is used even without a skin
    // What jiggle keeps from frame to frame: [patch][batch of strands with one CV count], and of the guides.
    std::vector<std::deque<JiggleState>> jiggle_states;
    std::deque<JiggleState> guide_states; // [batch of guides]
    double kept_cvs = 0.0;                // in these, with unused lanes
    std::optional<StepChoice> step_choice;
    uint64_t instances_digest = 0;    // of mesh_instances: which, and where at bind_frame; and made_digest()
    PastSettings past_settings;       // that jiggle_states, guide_states and `past` were made with
    std::optional<double> last_frame; // rendered with these values, if any
    GustStart gust_start;
    bool gusts_checked = false;      // for gusts that touch nothing
    Eigen::AlignedBox3d gust_bounds; // of the strands in the last frame begun, if there are gusts
    // Wall seconds within begin() since the last report(): a renderer may begin a frame more than once.
    struct {
        double place = 0.0; // placing or binding strands
        double choose = 0.0, prepare = 0.0;
    } begin_seconds;
    std::optional<double> announced; // the frame for which long work was announced
    Workers workers;

    virtual ~StrandInstance() = default;

    MarramOutput begin(LentFrame lent);
    std::string summary() const;
    std::vector<GustSphere> random_gusts() const;
    std::vector<AirSample> air_at(std::span<const double> points) const; // x, y, z of each
    std::vector<ShelterRay> shelter_rays(std::span<const double> cvs, const double* root_normal) const;
    void report(const ReportSink& sink);

    // The state of a batch of a patch, for one thread at a time: none if it is not kept, if another thread
    // works on the same patch, or if it would take more memory than jiggle.memory (get() is then nullptr,
    // and the patch runs through its whole window). `strands` has the batch's size.
    class KeptState {
      public:
        KeptState() = default;
        KeptState(StrandInstance& owner, JiggleState& state) : owner_(&owner), state_(&state) {}
        ~KeptState();
        KeptState(const KeptState&) = delete;
        KeptState& operator=(const KeptState&) = delete;
        JiggleState* get() const { return state_; }

      private:
        StrandInstance* owner_ = nullptr;
        JiggleState* state_ = nullptr;
    };
    KeptState kept_state(uint32_t patch, size_t batch, const Strands& strands);
    KeptState guide_state(size_t batch, const Strands& strands);

    uint32_t mesh_index() const { return uint32_t(mesh - meshes.data()); }
    bool instances_move() const { // within the shutter
        return std::ranges::any_of(mesh_instances, &MeshInstance::moves);
    }
    void warn(const std::string& id, const std::string& what, const std::string& remedy) const {
        send(host, MARRAM_WARNING, id.c_str(), place(), what, remedy);
    }

  protected:
    // Stores new values of the wind: what was chosen and checked for the old ones is void.
    void take_wind(Wind given);
    // Forgets the past: new frames begin with a whole window. To be called where strands are placed or bound
    // anew.
    void forget_past();
    void announce_long_work(int64_t past_samples);

    // ---- Hooks: constant data
    virtual const char* type() const = 0;         // for ids of messages
    virtual const std::string& place() const = 0; // of messages that concern all strands
    virtual const std::string& skin_name() const = 0;

    // ---- Hooks: a frame
    // Finds mesh and mesh_instances, and places or binds the strands if they are not yet or no longer.
    virtual void lay_out() = 0;
    virtual Eigen::AlignedBox3d bounds_without_meshes() const { return {}; } // of strands, if no mesh is lent
    virtual double longest() const = 0; // upper bound of strands on any instance, m
    virtual void choose_cvs() {} // by the frame's tolerance, if automatic.cvs; and what depends on the count
    virtual int min_cvs() const = 0;                       // of a strand
    virtual const Blade* blade() const { return nullptr; } // that the strands bend as
    // Strands that are evaluated to choose the step of jiggle.
    virtual JigglePilot pilot(double tolerance, size_t strands) const = 0;
    virtual bool moves() const = 0;                         // rest strands, within the shutter
    virtual uint64_t made_digest() const { return 0; }      // of the choice of strands that the frame makes
    virtual bool curves_move() const { return false; }      // imported strands, in their file, at any time
    virtual double travel_of_curves() const { return 0.0; } // of those in the last 256 frames, roughly, m
    virtual LongWork work() const = 0; // CVs of the frame, and the remedy if there are many
    virtual ChainFrame make_chain(PastWind* earlier) = 0; // `earlier`: of an earlier frame, may be nullptr
    virtual Eigen::AlignedBox3d bounds() const = 0;       // of all strands, for gusts
    virtual void finish_frame() {}                        // warnings, and what else the frame needs
    virtual MarramOutput output() = 0;

    // ---- Hooks: statistics
    struct Bytes {
        size_t shared = 0;          // kept once for all instances, except StrandInstance::past
        size_t own = 0;             // for the instances of a mesh, except what StrandInstance holds
        size_t peak_of_placing = 0; // of placing roots, before anything else is allocated
    };
    virtual Bytes bytes() const = 0;
    virtual void report_own(const ReportSink& sink) const = 0;

  private:
    void find_ground();
    void find_guides();
    void choose_settings();
    Choice choose_step(double tolerance);
    PastSettings settings_of_past() const;
    void prepare_states();
    void drop_states(); // the states alone; poses of the skin and the chosen step stay
    KeptState if_it_fits(JiggleState& state, const Strands& strands);
    std::mutex states_mutex_; // of in_use and the lengths of lists
    PastSkin read_jiggle_past();
    bool moves_in_window();
};

} // namespace marram
