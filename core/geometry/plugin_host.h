// SPDX-License-Identifier: Apache-2.0
// The renderer's end of the contract: one procedural of a scene. Everything the renderer knows of it it learns here, through
// core/plugin/marram_plugin.h.
#pragma once

#include "core/geometry/contract_values.h"
#include "core/geometry/state_store.h"

#include <atomic>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace marram {

// Whoever asked for this work wants no more of it.
struct Cancelled {};

// Receives how much of a preparation is done: its share 0 ... 1, and in words.
using PrepareProgress = std::function<void(double, const std::string&)>;

// One procedural of a scene, from create to destroy.
class Procedural {
  public:
    // Hands over the item's values and, where it has none of its own, the scene's wind. Throws InputError with what the
    // procedural objects to, and for images and tables that cannot be read.
    Procedural(std::shared_ptr<PluginLibrary> library, const Item& item, const ParamSet& wind,
               const std::atomic<bool>& cancel, std::shared_ptr<const CurveAttributes> curves = {});
    ~Procedural();
    Procedural(const Procedural&) = delete;
    Procedural& operator=(const Procedural&) = delete;

    const std::string& name() const { return name_; }
    const Place& place() const { return place_; }
    const PluginLibrary& library() const { return *library_; }
    MarramOutputKind kind() const { return type_->calls.kind; }
    const MarramProcedural& calls() const { return type_->calls; }
    const std::vector<MarramAttribute>& attributes() const { return attributes_; }
    // What its parameters name, each once: it depends on them.
    const std::vector<GeometryName>& meshes() const { return meshes_; }
    const std::vector<GeometryName>& curves() const { return curves_; }
    bool names_mesh(const std::string& mesh) const;
    bool names_curves(const std::string& curves) const;
    bool names(const std::string& geometry) const { return names_mesh(geometry) || names_curves(geometry); }
    // Of its values, with all that files hold which they name, and of the library's version.
    uint64_t digest() const { return digest_; }

    // Unique to the instance: an update that creates it anew changes it.
    uint64_t instance_number() const { return instance_number_; }

    int material = -1;                        // index into the scene's materials
    uint32_t roles = MARRAM_ALL_ROLES;        // of the mesh that it makes
    uint32_t pending_inputs = MARRAM_NOTHING; // MarramChange of what it depends on, since its last update

    // Each throws InputError with the procedural's own words, or Cancelled.
    bool prepares() const { return type_->calls.prepare != nullptr; }
    void prepare(const MarramFrame& frame, StateStore& states, const PrepareProgress& progress);
    MarramOutput begin(const MarramFrame& frame);
    MarramPatch patch(uint32_t index);
    void tessellate(uint32_t index, const MarramPatchBuffers& buffers); // from any thread
    void mesh(MarramMeshBuffers& buffers);
    bool has_pose() const { return type_->calls.pose != nullptr; }
    void pose(double frame, float* positions); // from any thread
    bool has_view() const { return type_->calls.begin_view != nullptr; }
    MarramOutput begin_view(const MarramView& view);
    void view_mesh(MarramMeshBuffers& buffers);
    std::vector<std::pair<std::string, double>> report();
    // What it has generated since begin(), as text of a scene; "" where there is nothing.
    std::string describe();
    std::vector<std::string> take_warnings();
    // Takes over the values of another description of the same procedural; `inputs` (MarramChange) is what has changed of the geometry
    // that it depends on. Returns what that touches of its output. A procedural that cannot update is made anew.
    uint32_t update(const Item& item, const ParamSet& wind, uint32_t inputs);
    // What went wrong in a call that the procedural made: what its own failure is about.
    void blame(std::exception_ptr thrown);
    // Takes over the place, the roles and the geometry that the item names: what the graph is made of. update() does so too.
    void look_at(const Item& item, const ParamSet& wind);
    // An objection of the renderer's own to what was handed over.
    [[noreturn]] void refuse(const std::string& what, const std::string& fix) const;

  private:
    static void on_message(void* user, const MarramMessage* message);
    static int on_cancelled(void* user);
    static void on_progress(void* user, double share, const char* words);
    void check(MarramStatus status);
    void read_attributes();
    void take_names(const ContractValues& values);
    void forget_faults();

    std::shared_ptr<PluginLibrary> library_;
    std::string name_;
    Place place_;
    std::vector<GeometryName> meshes_, curves_;
    uint64_t digest_ = 0;
    const ProceduralType* type_ = nullptr;
    const std::atomic<bool>* cancel_;
    std::shared_ptr<const CurveAttributes> curve_attributes_; // of the scene's curves
    const PrepareProgress* progress_ = nullptr;               // while prepare runs
    MarramHost host_{};                                       // lent from create to destroy
    MarramInstance* instance_ = nullptr;
    uint64_t instance_number_ = 0;
    std::vector<MarramAttribute> attributes_; // names point into attribute_names_
    std::deque<std::string> attribute_names_;
    std::exception_ptr thrown_; // in a call that the procedural made
    std::mutex messages_lock_;
    std::vector<Problem> faults_;
    std::vector<std::string> warnings_;
};

} // namespace marram
